"""Drawings as files of their own: whole XML with their look inside."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np

from benchmarks.harness.rows import BenchResult
from benchmarks.worlds import grip_delay_plot, grip_fault_plot
from tactile_ros.evaluation.figures import Plot, standalone


def plot() -> Plot:
    drawn = Plot(
        (1, 100), (1e-3, 1e3), 'time', 'error', log_x=True, log_y=True, description='Error & time'
    )
    drawn.line(np.array([1.0, 100.0]), np.array([1e-3, 1e3]), 'line c0')
    drawn.mark(10.0, 1.0, 0, 'fill c1')
    return drawn


def test_a_drawing_is_whole_and_brings_its_colours() -> None:
    text = standalone(plot())
    root = ET.fromstring(text)
    assert root.tag == '{http://www.w3.org/2000/svg}svg'
    assert root.get('viewBox') == '0 0 360 270'
    assert root.get('aria-label') == 'Error & time'
    style = root.findtext('{http://www.w3.org/2000/svg}style')
    assert style is not None
    assert '--c0: #0060a8' in style
    assert 'path.line' in style
    assert '.c4 {' in style
    assert 'h1' not in style
    assert style.count('{') == style.count('}')


def test_axes_may_both_be_logarithmic() -> None:
    drawn = plot()
    assert np.isclose(drawn.y(1.0), (drawn.y(1e-3) + drawn.y(1e3)) / 2)
    assert np.isclose(drawn.x(10.0), (drawn.x(1.0) + drawn.x(100.0)) / 2)


def test_a_bench_writes_its_drawings(tmp_path: Path) -> None:
    result = BenchResult('b', 'c', [1], [], drawings={'map': standalone(plot())})
    (path,) = result.draw(tmp_path / 'images')
    assert path == tmp_path / 'images' / 'b_map.svg'
    assert path.read_text().startswith('<svg xmlns')
    assert 'drawings' not in result.write(tmp_path).read_text()


def test_faults_of_a_grasp_are_drawn_also_where_nothing_reacted_or_was_heard() -> None:
    world = grip_fault_plot
    at, none = np.linspace(0.01, 0.5, 50), np.zeros(0)
    suffered = [
        world.Suffered(at, np.full(50, 2.0), 0.1),
        world.Suffered(at, np.full(50, 2.0), np.nan),
        world.Suffered(none, none, np.nan),
    ]
    text = world.drawn({'one': suffered, 'other': suffered[2:]}, 2.0, (1.0, 2.4), 0.1)
    ET.fromstring(text)
    assert 'one: 3 faults' in text
    assert text.count('fill c0') == 1 < text.count('line c0')


def test_tails_of_delays_are_drawn_for_runs_with_and_without_a_command() -> None:
    world = grip_delay_plot
    delay = np.append(np.full(99, 2e-3), np.nan)
    text = world.drawn({'stack': delay, 'three nodes': np.full(1, np.nan)}, 1.0)
    ET.fromstring(text)
    assert 'three nodes: no command' in text
    assert text.count('line c0') == 1
    assert 'line c1' not in text
