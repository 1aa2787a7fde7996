# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Passive matrices: Kirchhoff's laws solved pair by pair, and read-outs undone."""

import numpy as np
import pytest

from tactile_ros.physics.crosstalk import alone, without_floating, without_grounded


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
