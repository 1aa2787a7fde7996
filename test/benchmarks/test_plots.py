# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Plots of benches: whole XML, every part is there, and files stay small."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from xml.etree import ElementTree

import numpy as np
import pytest

from benchmarks.harness.plots import (
    drawings,
    edges_of,
    object_map,
    placed,
    taxel_corners,
)
from benchmarks.worlds import grip_delay_plot, grip_fault_plot
from reference import pick_world


def test_every_plot_is_an_svg() -> None:
    rng = np.random.default_rng(0)
    cells = 1e-3 * np.array([[x, y, 5.0] for y in (-5, 5) for x in (-8, 0, 8)])
    true = rng.integers(0, 6, 300)
    places = cells[true] + 1e-3 * rng.normal(size=(300, 3))
    named = {'neighbours': np.where(rng.uniform(size=300) < 0.2, 0, true), 'ours': true}
    costs = {'neighbours': (20.0, 3.5), 'ours': (50.0, 0.3)}
    found = drawings(cells, places, places + 3e-4 * rng.normal(size=(300, 3)), named, true, costs)
    assert {'cells_ours', 'confusion_neighbours', 'errors', 'speed'} <= set(found)
    for name, text in found.items():
        assert ElementTree.fromstring(text).tag.endswith('svg'), name
        assert len(text) < 100_000
    assert '100' in found['cells_ours']


def paths(svg: str, kind: str) -> list[str]:
    """Path data of a class."""
    root = ET.fromstring(svg)
    return [e.get('d', '') for e in root.iter() if e.get('class') == kind]


@pytest.mark.parametrize(
    'build', [pick_world.magnet_gripper, pick_world.suction_cup, pick_world.jaw]
)
def test_an_object_lies_over_its_taxels(build: object) -> None:
    config = build()  # type: ignore[operator]
    corners = taxel_corners(config.positions, config.areas, config.taxel_outlines)
    pressure = np.zeros(len(corners))
    pressure[:3], pressure[3] = (1.0, 0.5, 0.1), np.nan
    lines = edges_of(config.objects[0])
    found = placed(lines, np.array([1e-3, 0.0, 0.3]))
    svg = object_map(corners, pressure, found, lines, 'a part')
    assert len(paths(svg, 's4')) == 1
    assert len(paths(svg, 's1')) == 1
    few = len(corners) <= 500
    assert len(paths(svg, 's0')) == (len(corners) - 3 if few else 0)
    assert len(paths(svg, 'line c1')) == len(paths(svg, 'line ink')) == len(lines)
    assert svg.count('>x<') == int(few)
    assert len(svg) < 100 * 1024


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
