"""What a film has felt where it is touched now."""

from __future__ import annotations

import numpy as np
import pytest

from tactile_ros.conditioning.fading_memory import FadingMemory
from tactile_ros.sensors.five_wire_skin.force import Creep, FilmCreep

TAUS = np.array([0.3, 4.0])
EDGE = 0.015


def stream(count: int = 120) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Forces with a NaN, places that move, stamps with a gap and a step back, and restarts."""
    rng = np.random.default_rng(0)
    force, places = rng.uniform(0, 9, count), 0.05 + 2e-4 * rng.normal(size=(count, 2)).cumsum(0)
    force[[7, 30]], force[50:60] = np.nan, 0.0
    stamps = np.cumsum(rng.integers(5, 30, count)) * 1_000_000
    stamps[40:] += 10_000_000_000
    stamps[80:84] -= 5_000_000_000
    return force, places, stamps, np.isin(np.arange(count), [0, 100])


def test_frames_are_batches_and_arrays_are_the_compiled_loop() -> None:
    force, places, stamps, restart = stream()
    whole = FilmCreep(TAUS, EDGE)(force, places, stamps, restart)
    memory = FilmCreep(TAUS, EDGE)
    one = [
        memory(force[i : i + 1], places[i : i + 1], stamps[i : i + 1], restart[i : i + 1])
        for i in range(len(force))
    ]
    np.testing.assert_array_equal(np.concatenate(one), whole)
    assert np.isfinite(whole).all()


def test_a_past_that_counts_wherever_it_was_is_the_history() -> None:
    force, places, stamps, restart = stream()
    found = FilmCreep(TAUS, np.inf)(force, places, stamps, restart)
    told = FadingMemory(TAUS)(force[:, None], stamps, restart)[:, :, 0]
    np.testing.assert_allclose(found, told, atol=1e-9)


@pytest.mark.parametrize(('away', 'left'), [(0.0, 1.0), (5e-4, 1.0), (0.008, 0.5), (0.02, 0.0)])
def test_a_touch_keeps_of_the_past_what_it_shares_with_where_it_was(
    away: float, left: float
) -> None:
    force, stamps = np.full(200, 5.0), np.arange(200) * 20_000_000
    places = np.full((200, 2), 0.05)
    stayed = FilmCreep(TAUS, EDGE)(force, places, stamps, stamps == 0)
    places[100:, 0] += away
    moved = FilmCreep(TAUS, EDGE)(force, places, stamps, stamps == 0)
    before = moved[99, 1]
    np.testing.assert_allclose(moved[100, 1] / stayed[100, 1], left, atol=0.1)
    assert before == stayed[99, 1]


def test_floating_places_between_touches_do_not_count() -> None:
    stamps = np.arange(60) * 20_000_000
    force = np.where((np.arange(60) < 20) | (np.arange(60) >= 25), 5.0, 0.0)
    places = np.full((60, 2), 0.05)
    known = FilmCreep(TAUS, EDGE)(force, places, stamps, stamps == 0)
    places[20:25] = [np.nan, 0.09]
    np.testing.assert_array_equal(
        FilmCreep(TAUS, EDGE)(force, places, stamps, stamps == 0), known
    )


def test_a_share_that_one_place_alone_tells_is_doubted() -> None:
    rng = np.random.default_rng(3)
    static, groups = rng.uniform(2, 9, 300), np.repeat(np.arange(30), 10)
    means = np.zeros((300, 5))
    means[:, 0] = static * rng.uniform(0, 1, 300)
    means[:10, 4] = static[:10] * rng.uniform(0.2, 1, 10)
    told = static - 0.05 * means[:, 0] - 0.05 * means[:, 4] + 0.01 * rng.normal(size=300)
    creep = Creep().fit(static, means, told, groups)
    spread = np.sqrt((creep.root_**2).sum(axis=0))
    np.testing.assert_allclose(creep.shares_[[0, 4]], 0.05, atol=0.01)
    assert spread[4] > 0.02 > 5 * spread[0]
    assert (creep.shares_[:-1] >= 0).all()


def test_a_frame_that_was_lost_takes_nothing_of_the_past() -> None:
    force, stamps = np.full(200, 5.0), np.arange(200) * 20_000_000
    places = np.full((200, 2), 0.05)
    whole = FilmCreep(TAUS, EDGE)(force, places, stamps, stamps == 0)
    force[100], places[100] = np.nan, np.nan
    lost = FilmCreep(TAUS, EDGE)(force, places, stamps, stamps == 0)
    np.testing.assert_allclose(lost, whole, rtol=1e-9)
