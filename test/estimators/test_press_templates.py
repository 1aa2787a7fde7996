# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Templates of presses between their nodes."""

import numpy as np

from tactile_ros.estimators.press_templates import template_rows

RNG = np.random.default_rng(6)


def test_template_rows_at_a_node_are_the_cubic_spline_of_its_neighbours() -> None:
    half, turns, width = 3, 5, 12
    sides = 2 * half + 1
    flat = RNG.normal(size=(turns * sides * sides, width)).astype(np.float32)
    grid, about = np.array([1e-3, 2e-3, half, half], float), np.array([0.0, turns / 2.0, turns])
    work, parts = np.empty((3, width), np.float32), np.empty((4, width), np.float32)
    pose = np.array([1e-3, -2e-3, 2 * 2.0 / turns, 0.0])
    template_rows(flat, grid, about, pose, work, parts)
    table = flat.reshape(turns, sides, sides, width).astype(float)
    near = table[1:4, 3:6, 1:4]
    knot = np.array([1.0, 4.0, 1.0]) / 6.0
    np.testing.assert_allclose(
        parts[0], np.einsum('i,j,k,ijkd->d', knot, knot, knot, near), 1e-5, 1e-6
    )
