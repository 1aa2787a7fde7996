# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Neighbours of [2] against a slow vote, ties included."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

from benchmarks.worlds.cell_knn import CellKnn


def slow_distance(a: np.ndarray, b: np.ndarray, power: float) -> float:
    sizes = np.abs(a - b)
    return float(sizes.max() if np.isinf(power) else (sizes**power).sum() ** (1 / power))


def slow_vote(
    samples: np.ndarray, cells: np.ndarray, x: np.ndarray, count: int, power: float
) -> int:
    """Every distance, sorted; then votes, distances and numbers, one after the other."""
    far = [round(slow_distance(row, x, power), 12) for row in samples]
    near = sorted(zip(far, cells.tolist(), strict=True))[:count]
    votes = Counter(cell for _, cell in near)
    reach = {cell: sum(d for d, c in near if c == cell) for cell in votes}
    return min(votes, key=lambda cell: (-votes[cell], round(reach[cell], 9), cell))


@pytest.mark.parametrize('count', [1, 2, 5, 10])
@pytest.mark.parametrize('power', [1.0, 2.0, 3.0, np.inf])
def test_it_is_the_slow_vote(count: int, power: float) -> None:
    rng = np.random.default_rng(count)
    samples = rng.integers(-3, 4, (300, 3)).astype(float)  # many at one distance
    cells = rng.integers(0, 5, 300)
    x = rng.integers(-3, 4, (120, 3)) + 0.5 * rng.integers(0, 2, (120, 3))
    knn = CellKnn(count, power).fit(samples, cells)
    said = knn.predict(x)
    assert said.tolist() == [slow_vote(samples, cells, row, count, power) for row in x]
    order = rng.permutation(300)
    again = CellKnn(count, power).fit(samples[order], cells[order])
    np.testing.assert_array_equal(again.predict(x), said)
    np.testing.assert_array_equal([knn.predict(x[i : i + 1])[0] for i in range(120)], said)


def test_ties_as_stated() -> None:
    x = np.array([[0.0], [2.0], [4.0]])
    knn = CellKnn(2).fit(x, np.array([9, 3, 1]))
    assert knn.predict(np.array([[1.0]])).tolist() == [3]  # one vote each, as far: the lowest
    assert knn.predict(np.array([[0.9]])).tolist() == [9]  # one vote each: the nearer
    assert knn.predict(np.array([[2.0]])).tolist() == [3]  # a distance of zero wins


def test_distances_of_large_fields_do_not_cancel() -> None:
    """Hard case 7: |a|^2 - 2 a b + |b|^2 of 40 mT vectors loses microtesla."""
    rng = np.random.default_rng(0)
    samples = 40e-3 + 3e-6 * rng.normal(size=(200, 6))
    cells = (samples[:, 0] > 40e-3).astype(int)
    said = CellKnn(1).fit(samples, cells).predict(samples + 1e-9)
    np.testing.assert_array_equal(said, cells)
