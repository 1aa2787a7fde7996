# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Networks of resistors: sheets, and crosstalk of passive matrices."""

import numpy as np
import pytest

from reference.sheet_solver import OutlineMesh, sheet_potential
from tactile_ros.physics.crosstalk import alone, without_floating, without_grounded
from tactile_ros.physics.resistive_sheet import SeriesResistance, linear_place, rolled, unrolled

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


def pressed(rows: int, columns: int, kind: str) -> np.ndarray:
    """Conductances under a ring, two blocks, or everywhere."""
    y, x = np.indices((rows, columns))
    away = np.hypot(y - (rows - 1) / 2, x - (columns - 1) / 2) / (min(rows, columns) / 2)
    blocks = ((y < rows / 3) & (x < columns / 3)) | ((y > rows / 1.8) & (x > columns / 1.8))
    chosen = {'ring': (away < 0.8) & (away > 0.35), 'blocks': blocks, 'all': y >= 0}[kind]
    return chosen * np.random.default_rng(3).uniform(0.2, 0.6, (rows, columns))


def kirchhoff(g: np.ndarray, row: int, column: int, grounded: bool) -> float:
    """Output of one crossing: all node equations of the circuit with its resistors R0."""
    rows, columns = g.shape
    nodes = rows + columns
    matrix, current = np.zeros((nodes, nodes)), np.zeros(nodes)
    for i in range(rows):
        for j in range(columns):
            for a, b in ((i, rows + j), (rows + j, i)):
                matrix[a, a] += g[i, j]
                matrix[a, b] -= g[i, j]
    tied = range(columns) if grounded else [column]
    for j in tied:
        matrix[rows + j, rows + j] += 1.0  # R0 to ground
    for i in range(rows):
        if i == row or grounded:  # held by its driver
            matrix[i], current[i] = 0.0, float(i == row)
            matrix[i, i] = 1.0
    return float(np.linalg.lstsq(matrix, current, rcond=None)[0][rows + column])


def outputs(g: np.ndarray, grounded: bool) -> np.ndarray:
    """Outputs of all crossings."""
    every = [kirchhoff(g, *at, grounded) for at in np.ndindex(g.shape)]
    return np.reshape(every, g.shape)


@pytest.mark.parametrize('kind', ['ring', 'all', 'blocks'])
def test_grounded_lines_are_undone_exactly_also_of_many_frames(kind: str) -> None:
    g = pressed(5, 6, kind)
    seen = outputs(g, grounded=True)
    np.testing.assert_allclose(without_grounded(np.stack([seen, seen]))[1], g, atol=1e-9)


@pytest.mark.parametrize(
    ('rows', 'columns', 'kind', 'most'),
    [(8, 9, 'ring', 2e-2), (8, 9, 'all', 1e-3), (8, 9, 'blocks', 1e-3), (20, 25, 'ring', 4e-2)],
)
def test_floating_lines_are_undone(rows: int, columns: int, kind: str, most: float) -> None:
    g = pressed(rows, columns, kind)
    seen = alone(outputs(g, grounded=False))
    found = without_floating(seen)
    np.testing.assert_allclose(found, g, atol=most)
    assert np.abs(found - g).mean() < 0.02 * np.abs(seen - g).mean()


def test_noise_and_nothing_are_survived() -> None:
    assert not without_floating(np.zeros((4, 5))).any()
    g = pressed(8, 9, 'ring')
    noisy = outputs(g, grounded=False) + 5e-4 * np.random.default_rng(1).normal(size=g.shape)
    found = without_floating(np.maximum(alone(noisy), 0.0))
    assert np.sqrt(np.mean(np.square(found - g))) < 0.02
    assert np.isfinite(found).all()
