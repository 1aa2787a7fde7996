"""Plots of arrays: every taxel and line is there, and files stay small."""

from __future__ import annotations

import xml.etree.ElementTree as ET

import numpy as np
import pytest

from benchmarks.harness.plots import (
    costs,
    curves,
    edges_of,
    object_map,
    placed,
    taxel_corners,
)
from reference import pick_world


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


def test_lines_are_placed_by_turn_and_shift() -> None:
    line = np.array([[1.0, 0.0], [0.0, 1.0]])
    found = placed([line], np.array([1.0, 2.0, np.pi / 2]))[0]
    np.testing.assert_allclose(found, [[1.0, 3.0], [0.0, 2.0]], atol=1e-12)


def test_curves_and_costs_name_what_they_draw() -> None:
    x = np.linspace(1, 3, 5)
    svg = curves({'one': (x, x), 'two': (x, x**2)}, ('x', 'y'), 'two curves', log_y=True)
    assert len(paths(svg, 'line c0')) == len(paths(svg, 'line c1')) == 1
    assert 'one' in svg
    assert 'two' in svg
    svg = costs({'slow': (100.0, 1e-3), 'quick': (2.0, 0.1)}, ('us', 'error'), 'methods')
    assert len(paths(svg, 'fill c0')) == len(paths(svg, 'fill c1')) == 1
