# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Passive matrices: Kirchhoff's laws solved pair by pair, and read-outs undone."""

from __future__ import annotations

import numpy as np
import pytest

from tactile_ros.physics.crosstalk import (
    alone,
    divided,
    without_floating,
    without_grounded,
)


def pressed(rows: int, columns: int, kind: str) -> np.ndarray:
    """Conductances under a ring, two blocks, or everywhere."""
    y, x = np.indices((rows, columns))
    away = np.hypot(y - (rows - 1) / 2, x - (columns - 1) / 2) / (min(rows, columns) / 2)
    blocks = ((y < rows / 3) & (x < columns / 3)) | ((y > rows / 1.8) & (x > columns / 1.8))
    chosen = {'ring': (away < 0.8) & (away > 0.35), 'blocks': blocks, 'all': y >= 0}[kind]
    return chosen * np.random.default_rng(3).uniform(0.2, 0.6, (rows, columns))


def grounded_output(conductance: np.ndarray) -> np.ndarray:
    """Outputs (..., r, c) of a matrix whose rows are all driven, those not selected to ground."""
    return np.asarray(conductance / (1.0 + conductance.sum(axis=-2, keepdims=True)))


def floating_conductance(conductance: np.ndarray) -> np.ndarray:
    """Conductance (r, c) (1 / R0) between a row and a column while all other lines float.

    G_ij = 1 / (M_ii + M_jj - 2 M_ij), with M the inverse of the Laplacian of the network.
    """
    rows = len(conductance)
    laplacian = np.zeros((sum(conductance.shape),) * 2)
    laplacian[:rows, rows:] = -conductance
    laplacian[rows:, :rows] = -conductance.T
    tied = 1e-6 * conductance.max()  # to ground
    laplacian[np.diag_indices(len(laplacian))] = tied - laplacian.sum(axis=1)
    inverse = np.linalg.inv(laplacian)
    lines = np.diag(inverse)
    return np.asarray(1.0 / (lines[:rows, None] + lines[rows:] - 2 * inverse[:rows, rows:]))


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


@pytest.mark.parametrize('kind', ['ring', 'all', 'blocks'])
@pytest.mark.parametrize('grounded', [True, False])
def test_outputs_are_those_of_kirchhoff(kind: str, grounded: bool) -> None:
    g = pressed(5, 6, kind)
    slow = np.array([[kirchhoff(g, i, j, grounded) for j in range(6)] for i in range(5)])
    fast = grounded_output(g) if grounded else divided(floating_conductance(g))
    np.testing.assert_allclose(fast, slow, atol=2e-5)


def test_sneak_paths_only_add_and_a_single_crossing_has_none() -> None:
    g = pressed(8, 9, 'ring')
    assert (floating_conductance(g) >= g * (1 - 1e-6)).all()
    assert floating_conductance(g)[g == 0].max() > 0.3  # ghosts inside a ring
    lone = np.zeros((8, 9))
    lone[2, 3] = 0.4
    np.testing.assert_allclose(floating_conductance(lone), lone, atol=1e-5)
    np.testing.assert_allclose(alone(divided(g)), g, atol=1e-12)


@pytest.mark.parametrize(
    ('rows', 'columns', 'kind', 'most'),
    [(8, 9, 'ring', 2e-2), (8, 9, 'all', 1e-3), (8, 9, 'blocks', 1e-3), (20, 25, 'ring', 4e-2)],
)
def test_floating_lines_are_undone(rows: int, columns: int, kind: str, most: float) -> None:
    g = pressed(rows, columns, kind)
    seen = floating_conductance(g)
    found = without_floating(seen)
    np.testing.assert_allclose(found, g, atol=most)
    assert np.abs(found - g).mean() < 0.02 * np.abs(seen - g).mean()


def test_grounded_lines_are_undone_exactly_also_of_many_frames() -> None:
    g = np.stack([pressed(8, 9, kind) for kind in ('ring', 'all', 'blocks')])
    np.testing.assert_allclose(without_grounded(grounded_output(g)), g, rtol=1e-12)


def test_noise_and_nothing_are_survived() -> None:
    assert not without_floating(np.zeros((4, 5))).any()
    g = pressed(8, 9, 'ring')
    noisy = divided(floating_conductance(g))
    noisy = noisy + 5e-4 * np.random.default_rng(1).normal(size=g.shape)
    found = without_floating(np.maximum(alone(noisy), 0.0))
    assert np.sqrt(np.mean(np.square(found - g))) < 0.02
    assert np.isfinite(found).all()
