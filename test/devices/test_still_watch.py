"""Stuck taxels among living ones, and quiet that is honest."""

from __future__ import annotations

import numpy as np
import pytest

from tactile_ros.devices.fault_flags import StillWatch
from tactile_ros.types import TaxelStatus


def follow(readings: np.ndarray, others: float = 0.0) -> np.ndarray:
    """Stuck taxels after each row of readings, shape (s, t)."""
    watch = StillWatch(readings.shape[1], others=others)
    stuck = []
    for row in readings:
        watch.follow(row)
        stuck.append(watch.stuck())
    return np.array(stuck)


def noisy(rows: int, taxels: int = 4) -> np.ndarray:
    return np.random.default_rng(0).normal(size=(rows, taxels, 3))


def test_a_taxel_that_stops_among_others_is_stuck_from_the_tenth_alike_until_it_moves() -> None:
    readings = noisy(100)
    readings[60:80, 2] = readings[60, 2]
    stuck = follow(readings, others=0.5)
    assert np.flatnonzero(stuck[:, 2]).tolist() == list(range(69, 80))
    assert not np.delete(stuck, 2, axis=1).any()


@pytest.mark.parametrize(
    ('changes', 'unmarked'), [(0, 9), (1, 4), (5, 2), (14, 2), (15, 1), (499, 1), (500, 0)]
)
def test_so_many_repeats_pass_before_they_are_doubted(changes: int, unmarked: int) -> None:
    watch = StillWatch(1)
    readings = noisy(changes + 1, 1)
    for row in readings:
        watch.follow(row)
    marked = []
    for _ in range(10):
        watch.follow(readings[-1])
        marked.append(bool(watch.marks().any()))
    assert marked == [False] * unmarked + [True] * (10 - unmarked)


def test_a_board_that_is_still_as_a_whole_has_no_stuck_taxel() -> None:
    readings = noisy(200)
    readings[60:] = readings[60]
    assert not follow(readings, others=0.5).any()
    assert follow(readings).all(axis=1)[-1]


def test_a_taxel_that_always_repeats_itself_often_is_only_quiet() -> None:
    readings = noisy(400)
    readings[:, 1] = np.repeat(noisy(50)[:, 1], 8, axis=0)
    readings[300:312, 1] = readings[300, 1]
    assert not follow(readings, others=0.5)[:, 1].any()


def test_rest_between_touches_is_learnt_as_a_whole() -> None:
    """After a rest of 1000 readings one of 300 is no wonder, however lively the touch was."""
    readings = np.concatenate([np.repeat(noisy(1), 1000, axis=0), noisy(200)])
    readings = np.concatenate([readings, np.repeat(readings[-1:], 300, axis=0)])
    watch = StillWatch(1, changes=10)
    for row in readings[:, :1]:
        watch.follow(row)
        assert not watch.marks().any()


def test_what_never_changed_is_not_judged_where_changes_are_asked_for() -> None:
    def first(changes: int, moving: int) -> int:
        watch = StillWatch(1, changes=changes)
        for row in noisy(moving, 1):
            watch.follow(row)
        for count in range(100):
            watch.follow(np.zeros((1, 3)))
            if watch.stuck().any():
                return count
        return -1

    assert first(10, 5) == -1
    assert first(0, 5) == first(5, 5) == 9


def test_repeats_that_tell_nothing_are_not_counted_and_end_a_run() -> None:
    watch = StillWatch(1)
    rows = noisy(60, 1)
    for row in rows:
        watch.follow(row)
    for _ in range(50):
        watch.follow(rows[-1], telling=False)
    assert not watch.marks().any()
    for _ in range(20):
        watch.follow(rows[-1])
    assert watch.marks().tolist() == [TaxelStatus.STALE | TaxelStatus.STUCK]
    watch.follow(np.zeros((1, 3)), telling=False)
    assert not watch.marks().any()


def test_taxels_that_were_not_read_keep_their_run() -> None:
    watch = StillWatch(1)
    good = np.ones(1, bool)
    for row in noisy(60, 1):
        watch.follow(row, good)
    for _ in range(9):
        assert not watch.stuck().any()
        watch.follow(np.zeros((1, 3)), ~good)
        watch.follow(row, good)
    assert watch.stuck().all()
    watch.forget()
    assert not watch.stuck().any()


def test_a_fault_that_comes_and_goes_is_found_as_soon_every_time() -> None:
    readings = noisy(5000)
    for start in range(100, 5000, 1000):
        readings[start : start + 900, 2] = readings[start, 2]
    stuck = follow(readings, others=0.5)[:, 2].reshape(5, 1000)
    assert (stuck.sum(axis=1) == stuck[0].sum()).all()
    assert stuck[0].sum() >= 880
