# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Patches of touched taxels on any layout, against a slow flood over a table of distances."""

import numpy as np
import pytest

from tactile_ros.estimators.contact_patches import PatchFinder, neighbours
from tactile_ros.sensors.taxel_array.config import grid_positions, radial_positions

RINGS = np.vstack([radial_positions(24, r, r + 5e-3) for r in (5e-3, 10e-3, 15e-3)])


@pytest.mark.parametrize(
    ('positions', 'count'),
    [
        (radial_positions(), 16),
        (grid_positions(3, 4, 5e-3), 3 * 3 + 2 * 4 + 2 * 2 * 3),
        (np.zeros((1, 3)), 0),
        (RINGS, None),
    ],
    ids=['ring', 'matrix', 'one', 'rings'],
)
def test_neighbours_of_any_layout(positions: np.ndarray, count: int | None) -> None:
    pairs = neighbours(positions)
    assert count is None or len(pairs) == count
    assert (pairs[:, 0] < pairs[:, 1]).all()
    assert len(np.unique(pairs, axis=0)) == len(pairs)
    away = np.linalg.norm(positions[pairs[:, 0]] - positions[pairs[:, 1]], axis=1)
    assert (away <= 3 * away.min(initial=1.0)).all()
    load = np.ones((1, len(positions)))
    found = PatchFinder(positions, load[0], 2).find(load, load, load > 0)
    assert found.count.tolist() == [1]  # the whole array hangs together


def test_neighbours_turn_and_grow_with_the_array() -> None:
    cos, sin = np.cos(0.4), np.sin(0.4)
    turn = np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]])
    grid = grid_positions(5, 7, 1e-3)
    np.testing.assert_array_equal(neighbours(grid), neighbours(3 * grid @ turn.T))


def slow(positions: np.ndarray, touched: np.ndarray) -> list[set[int]]:
    """Patches by a flood; neighbours on a matrix are within 1.5 pitches."""
    away = np.linalg.norm(positions[:, None] - positions[None], axis=2)
    left, found = set(np.flatnonzero(touched)), []
    while left:
        front = [left.pop()]
        patch = set(front)
        while front:
            near = {i for i in left if away[front[-1], i] < 1.5e-3}
            front.pop()
            front += near
            patch |= near
            left -= near
        found.append(patch)
    return found


@pytest.mark.parametrize('share', [0.1, 0.3, 0.45, 0.95])
def test_patches_are_those_of_a_slow_flood(share: float) -> None:
    positions = grid_positions(20, 25, 1e-3)
    finder = PatchFinder(positions, np.full(500, 1e-6), 500)
    rng = np.random.default_rng(1)
    touched = rng.uniform(size=(4, 500)) < share
    load = np.where(touched, rng.uniform(0.5, 1.0, touched.shape), 0.0)
    batch = finder.find(load, 0 * load, touched)
    for row in range(4):
        wanted = slow(positions, touched[row])
        found = [set(np.flatnonzero(batch.label[row] == k)) for k in range(batch.count[row])]
        assert sorted(map(sorted, found)) == sorted(map(sorted, wanted))
        live = finder.find(load[row : row + 1], 0 * load[:1], touched[row : row + 1])
        for name in ('label', 'load', 'position', 'position_cov', 'variance'):
            np.testing.assert_array_equal(getattr(live, name)[0], getattr(batch, name)[row])
        total = [load[row, list(patch)].sum() for patch in wanted]
        kept = batch.load[row, : len(wanted)]
        np.testing.assert_allclose(kept, sorted(total, reverse=True))


def test_sums_centres_and_covariances_of_a_patch() -> None:
    positions = grid_positions(4, 5, 2e-3)
    finder = PatchFinder(positions, np.full(20, 4e-6), 3)
    load = np.zeros((1, 20))
    load[0, [0, 1, 5]], load[0, 19] = (1.0, 2.0, 1.0), 7.0
    variance = 0.01 * np.ones((1, 20))
    found = finder.find(load, variance, load > 0)
    assert found.load[0].tolist()[:2] == [7.0, 4.0]
    assert np.isnan(found.load[0, 2])
    wanted = (load[0, [0, 1, 5]] @ positions[[0, 1, 5]]) / 4
    np.testing.assert_allclose(found.position[0, 1], wanted, atol=1e-15)
    away = positions[[0, 1, 5]] - wanted
    cov = away.T @ away * 0.01 / 16
    np.testing.assert_allclose(found.position_cov[0, 1, 0, 1], cov[0, 1])
    assert found.position_cov[0, 1, 0, 0] > cov[0, 0]
    np.testing.assert_allclose(found.variance[0, :2], [0.01, 0.03])


def test_little_pressure_between_two_joins_nothing_and_is_lost_by_none() -> None:
    positions = grid_positions(20, 40, 1e-3)
    finder = PatchFinder(positions, np.full(800, 1e-6), 8)
    load = sum(
        np.exp(-0.5 * np.square(np.linalg.norm(positions[:, :2] - at, axis=1) / 2e-3))
        for at in ([-6e-3, 0.0], [6e-3, 1e-3])
    )[None]
    touched = load > 1e-3
    assert len(slow(positions, touched[0])) == 1
    found = finder.find(load, 0 * load, touched)
    assert found.count.tolist() == [2]
    np.testing.assert_allclose(np.nansum(found.load), load[touched].sum())
    np.testing.assert_allclose(np.sort(found.position[0, :2, 0]), [-6e-3, 6e-3], atol=5e-5)
    assert (found.label[0] >= 0).sum() == touched.sum()
