# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Past of a film: fading means by place, and forces without what has crept."""

from __future__ import annotations

import numpy as np
import pytest

from tactile_ros.conditioning.fading_memory import FadingMemory
from tactile_ros.sensors.five_wire_skin.film import TIME_CONSTANTS, FilmCreep, FilmMemory

EDGE = 0.015


def stream(count: int = 120) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Forces with a NaN, places that move, stamps with a gap and a step back, and restarts."""
    rng = np.random.default_rng(0)
    force, places = rng.uniform(1, 9, count), 0.05 + 2e-4 * rng.normal(size=(count, 2)).cumsum(0)
    force[[7, 30]], force[50:60] = np.nan, 0.0
    stamps = np.cumsum(rng.integers(5, 30, count)) * 1_000_000
    stamps[40:] += 10_000_000_000
    stamps[80:84] -= 5_000_000_000
    return force, places, stamps, np.isin(np.arange(count), [0, 100])


def crept(edge: float = np.inf, most: float = 1e9, share: float = 0.0) -> FilmCreep:
    creep = FilmCreep(edge, most)
    creep.shares_ = np.full(len(TIME_CONSTANTS), share)
    return creep


def test_frames_are_batches_bit_for_bit() -> None:
    columns = stream()
    whole = FilmMemory()(crept(EDGE, 1.0, -0.03), *columns)
    memory = FilmMemory()
    for row in range(len(columns[0])):
        one = memory(crept(EDGE, 1.0, -0.03), *(column[row : row + 1] for column in columns))
        np.testing.assert_array_equal(one[0][0], whole[0][row])
        np.testing.assert_array_equal(one[1][0], whole[1][row])


def test_means_of_a_past_that_counts_wherever_it_was_are_the_fading_means() -> None:
    force, places, stamps, restart = stream()
    ratios = FilmMemory()(crept(), force, places, stamps, restart)[1]
    means = FadingMemory(TIME_CONSTANTS)(force[:, None], stamps, restart)[:, :, 0]
    held = np.isfinite(force) & (force > 0) & (np.arange(len(force)) < 80)
    np.testing.assert_allclose((ratios * force[:, None])[held], means[held], atol=1e-9)


@pytest.mark.parametrize(('away', 'left'), [(0.0, 1.0), (5e-4, 1.0), (0.008, 0.5), (0.02, 0.0)])
def test_a_touch_keeps_of_the_past_what_it_shares_with_where_it_was(
    away: float, left: float
) -> None:
    force, stamps = np.full(200, 5.0), np.arange(200) * 20_000_000
    places = np.full((200, 2), 0.05)
    stayed = FilmMemory()(crept(EDGE), force, places, stamps, stamps == 0)[1]
    places[100:, 0] += away
    moved = FilmMemory()(crept(EDGE), force, places, stamps, stamps == 0)[1]
    np.testing.assert_allclose(moved[100, 2] / stayed[100, 2], left, atol=0.1)
    assert moved[99, 2] == stayed[99, 2]


def test_a_static_force_that_has_crept_is_taken_back() -> None:
    stamps, places = np.arange(400) * 20_000_000, np.full((400, 2), 0.05)
    creep = crept(np.inf, 1.0, -0.03)
    ratios = FilmMemory()(crept(np.inf, 1.0), np.full(400, 5.0), places, stamps, stamps == 0)[1]
    static = 5.0 * np.exp(0.03 * ratios.sum(axis=1))
    force = FilmMemory()(creep, static, places, stamps, stamps == 0)[0]
    np.testing.assert_allclose(force, 5.0, rtol=2e-4)
    assert (creep.variance(ratios)[1:] > 0).all()


def test_a_lost_frame_takes_nothing_of_the_past() -> None:
    force, stamps = np.full(200, 5.0), np.arange(200) * 20_000_000
    places = np.full((200, 2), 0.05)
    whole = FilmMemory()(crept(EDGE), force, places, stamps, stamps == 0)[1]
    force[100], places[100] = np.nan, np.nan
    lost = FilmMemory()(crept(EDGE), force, places, stamps, stamps == 0)[1]
    np.testing.assert_allclose(np.delete(lost, 100, 0), np.delete(whole, 100, 0), rtol=1e-9)
