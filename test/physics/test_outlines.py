"""Points inside outlines, holes included."""

from __future__ import annotations

import numpy as np

from tactile_ros.physics.coverage import grid_inside, inside

SQUARE = np.array([[-2, -2], [2, -2], [2, 2], [-2, 2.0]])
HOLE = 0.5 * SQUARE[::-1]


def test_inside_a_square_with_a_hole() -> None:
    points = np.array([[1.5, 0], [0, 0], [3, 0], [0, -1.5], [0.5, 0.9]])
    assert inside([SQUARE], points).tolist() == [True, True, False, True, True]
    assert inside([SQUARE, HOLE], points).tolist() == [True, False, False, True, False]


def test_grid_gives_the_area() -> None:
    for pitch in (0.1, 0.05):
        count = len(grid_inside([SQUARE, HOLE], pitch))
        assert abs(count * pitch**2 - 12) < 0.01


def test_a_triangle_and_a_turned_square() -> None:
    triangle = np.array([[0, 0], [1, 0], [0, 1.0]])
    points = np.random.default_rng(0).uniform(-0.5, 1.5, (500, 2))
    wanted = (points > 0).all(axis=1) & (points.sum(axis=1) < 1)
    np.testing.assert_array_equal(inside([triangle], points), wanted)
    diamond = np.array([[1, 0], [0, 1], [-1, 0], [0, -1.0]])
    wanted = np.abs(points).sum(axis=1) < 1
    np.testing.assert_array_equal(inside([diamond], points), wanted)
