# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Potentials of sheets against what is known of them without solving, and of each other."""

import numpy as np
import pytest

from reference.sheet_solver import OutlineMesh, sheet_potential
from tactile_ros.physics.resistive_sheet import (
    SeriesResistance,
    linear_place,
    rolled,
    unrolled,
)

SIZE = np.array([0.1, 0.08])
FIRST = np.array([1.0, np.nan, 0.0, np.nan])
SQUARE = 0.1 * np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])


def linear_potentials(places: np.ndarray, size: np.ndarray) -> np.ndarray:
    """Ideal potentials u_AC, u_BD (..., 2) at places (..., 2)."""
    x, y = np.moveaxis(places / size, -1, 0)
    return np.stack([1.0 - (x + y) / 2, 0.5 + (x - y) / 2], axis=-1)


def test_the_formula_turns_round() -> None:
    places = np.random.default_rng(0).uniform(0, 0.08, (20, 2))
    np.testing.assert_allclose(linear_place(linear_potentials(places, SIZE), SIZE), places)


def test_rx_is_that_of_mirrored_sources_up_to_the_border() -> None:
    size, touch = np.array([0.25, 0.2]), 0.015
    places = np.random.default_rng(5).uniform(0.04, 0.96, (200, 2))
    (x, y), (a, b) = (places * size).T, size

    def mirrored(away: np.ndarray) -> np.ndarray:
        far = np.cosh(np.pi * away / a)
        return 0.5 * np.log((far - np.cos(2 * np.pi * x / a)) / (far - 1))

    radius = np.log(2 * a / np.pi * np.sin(np.pi * x / a))
    radius -= sum(mirrored(2 * n * b - 2 * y) for n in range(-3, 5))
    radius += 2 * sum(mirrored(np.full(200, 2 * n * b)) for n in range(1, 5))
    exact = (radius - np.log(0.59 * touch)) / (2 * np.pi)
    found = SeriesResistance(size, touch, 1.0).at(places)
    np.testing.assert_allclose(found, exact, atol=0.01)


def test_hard_case_6_the_direct_solve_is_right_at_ratios_where_iteration_ends_in_zeros() -> None:
    square = np.array([0.1, 0.1])
    line = np.linspace(0, 0.1, 21)
    places = np.stack(np.meshgrid(line, line, indexing='ij'), axis=-1)
    ideal = linear_potentials(places, square)[..., 0]
    for ratio in (1e4, 2.4e4, 1e8, 1e12, 1e16):
        found = sheet_potential(square, (21, 21), np.full((4, 8), ratio * 1e-3), FIRST)
        assert np.abs(found - ideal).max() < (5e-3 if ratio < 2e4 else 1e-3)
        assert found[10, 10] == pytest.approx(0.5, abs=1e-4)


def test_a_square_is_as_the_grid_says() -> None:
    mesh = OutlineMesh.of(SQUARE, 0.1 / 24)
    border = np.full(mesh.border, 24_000 * 1e-3)
    held = mesh.nearest(SQUARE)
    found = mesh.potential(border, held[[0, 2]], np.array([1.0, 0.0]))
    other = sheet_potential(
        np.array([0.1, 0.1]), (25, 25), np.full((4, 8), 24.0), np.array([1, np.nan, 0, np.nan])
    )
    x, y = (mesh.points / 0.1 * 24).T
    on_grid = (np.abs(x - np.round(x)) < 1e-6) & (np.abs(y - np.round(y)) < 1e-6)
    told = other[np.round(x[on_grid]).astype(int), np.round(y[on_grid]).astype(int)]
    np.testing.assert_allclose(found[on_grid], told, atol=2e-3)
    np.testing.assert_allclose(found, 1 - mesh.points.sum(axis=1) / 0.2, atol=5e-3)


def test_a_panel_is_unrolled_and_rolled_without_stretching() -> None:
    flat = np.random.default_rng(1).uniform(-0.05, 0.05, (50, 2))
    turn = flat[:, 0] / 0.2
    panel = np.column_stack([0.2 * np.sin(turn), flat[:, 1], 0.2 * (np.cos(turn) - 1)])
    np.testing.assert_allclose(unrolled(panel, 0.2), flat, atol=1e-12)
    np.testing.assert_allclose(rolled(flat, 0.2), panel, atol=1e-12)
