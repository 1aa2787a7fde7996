"""Tables of any number of axes: cubics are exact, slopes are differences."""

from __future__ import annotations

import numpy as np
import pytest

from tactile_ros.physics.field_table import GridTable

LOW, HIGH = np.array([-1.0, 0.0, 2.0]), np.array([1.0, 3.0, 2.5])


def inside(count: int) -> np.ndarray:
    return np.random.default_rng(0).uniform(LOW, HIGH, (count, 3))


def cubic(p: np.ndarray) -> np.ndarray:
    x, y, z = p.T
    return np.column_stack([x**3 * y**2 * z - y**3 + 1, x * y * z**3])


def wave(p: np.ndarray) -> np.ndarray:
    return np.sin(p @ np.array([2.0, 1.0, 3.0]))[:, None]


def test_cubics_come_back_everywhere() -> None:
    table = GridTable.of(cubic, LOW, HIGH, (4, 5, 6))
    assert table.shape == (4, 5, 6)
    points = np.concatenate([inside(50), [LOW, HIGH]])
    np.testing.assert_allclose(table.at(points), cubic(points), atol=1e-9)


def test_slopes_are_differences() -> None:
    table, points, step = GridTable.of(wave, LOW, HIGH, (9, 9, 9)), inside(20), 1e-6
    values, slopes = table.with_slopes(points)
    np.testing.assert_array_equal(values, table.at(points))
    for axis, e in enumerate(step * np.eye(3)):
        wanted = (table.at(points + e) - table.at(points - e)) / (2 * step)
        np.testing.assert_allclose(slopes[:, :, axis], wanted, atol=1e-6)


@pytest.mark.parametrize('fine', [17, 33])
def test_half_the_step_is_a_sixteenth_of_the_error(fine: int) -> None:
    points = inside(400)
    coarse = fine // 2 + 1
    error = [
        np.abs(GridTable.of(wave, LOW, HIGH, (n, n, n)).at(points) - wave(points)).max()
        for n in (coarse, fine)
    ]
    assert error[1] < error[0] / 11


def test_the_slow_reference_says_the_same() -> None:
    table, points = GridTable.of(wave, LOW, HIGH, (6, 7, 8)), inside(10)
    step = (HIGH - LOW) / (np.array(table.shape) - 1)
    for point, found in zip(points, table.at(points), strict=True):
        at = (point - LOW) / step
        first = np.clip(np.floor(at).astype(int) - 1, 0, np.array(table.shape) - 4)
        total = 0.0
        for corner in np.ndindex(4, 4, 4):
            weight = 1.0
            for axis in range(3):
                for other in range(4):
                    if other != corner[axis]:
                        here = at[axis] - first[axis]
                        weight *= (here - other) / (corner[axis] - other)
            total += weight * table.values[tuple(first + corner)][0]
        assert found[0] == pytest.approx(total, abs=1e-12)
