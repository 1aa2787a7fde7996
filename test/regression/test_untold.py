# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""What recorded touches leave open, said of any skin."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from tactile_ros.sensors.regression import longest_hold, missing_history, missing_loads
from tactile_ros.types import Signals

SECOND = 10**9


def signals(
    contact: list[int], seconds: list[float] | None, tare: bool = False, restart: int = 0
) -> Signals:
    """Frames of one taxel; a stream begins at rows 0 and `restart`."""
    rows = len(contact)
    blank = np.zeros((rows, 1, 1))
    begins = np.isin(np.arange(rows), [0, restart])
    stamps = None if seconds is None else (SECOND * np.array(seconds)).astype(np.int64)
    resting = np.arange(rows) == 0 if tare else None
    return Signals(
        blank, blank, blank, None, stamps, begins, np.array(contact, np.int8),
        np.ones(rows, bool), begins, resting,
    )  # fmt: skip


@pytest.mark.parametrize(
    ('contact', 'seconds', 'restart', 'longest'),
    [
        ([0, 1, 1, 1, 0, 1, 1], [0, 1, 2, 4, 5, 6, 10], 0, 4.0),
        ([1, 1, 0, 1], [0, 2, 3, 4], 0, 2.0),
        ([0, 1, 1, 1, 1], [0, 1, 3, 5, 6], 3, 2.0),  # a new stream is another touch
        ([0, -1, 0], [0, 1, 2], 0, 0.0),
    ],
)
def test_the_longest_touch(
    contact: list[int], seconds: list[float], restart: int, longest: float
) -> None:
    assert longest_hold(signals(contact, seconds, restart=restart)) == pytest.approx(longest)


def test_the_past_is_open_without_tare_rows_and_without_stamps() -> None:
    rest = 'not told: rest before any load (no tare rows)'
    contact = [0, 1, 1]
    open_ = missing_history(signals(contact, [0, 1, 2]), 0.2)
    assert open_[rest] == {'share of a load that rests may still hold': 0.2}
    assert missing_history(signals(contact, [0, 1, 2]), 0.0)[rest] == {}
    tared = missing_history(signals(contact, [0, 1, 2], tare=True), 0.2)
    assert tared == {'not told: holds beyond the longest (s)': {'longest': 1.0}}
    unstamped = missing_history(signals(contact, None), 0.0)
    assert 'not told: creep (frames without stamps)' in unstamped


@pytest.mark.parametrize(
    ('contact', 'tare', 'begins', 'open_'),
    [
        ([0, 1, 0, 1], [1, 0, 0, 0], [1, 0, 0, 0], False),
        ([1, 0, 1, 1], [0, 1, 0, 0], [1, 0, 0, 0], True),  # tared after a touch
        ([0, 1, 0, 1], [1, 0, 0, 0], [1, 0, 1, 0], True),  # the second stream has none
        ([0, 1, 0, 1], [1, 0, 1, 0], [1, 0, 1, 0], False),
        ([0, 1, 0, 0], [1, 0, 0, 0], [1, 0, 1, 0], False),  # nor any touch
    ],
)
def test_a_rest_counts_before_the_first_load_of_its_stream(
    contact: list[int], tare: list[int], begins: list[int], open_: bool
) -> None:
    rows = np.array(tare, bool), np.array(begins, bool)
    given = dataclasses.replace(signals(contact, None), tare=rows[0], begins=rows[1])
    assert any('rest before any load' in said for said in missing_history(given, 0.1)) == open_


def test_loads_are_those_that_count() -> None:
    told = missing_loads(np.array([[np.nan, 0.0], [4.0, 1e-9], [-1.0, 0.5]]))
    assert told == {'not told: loads beyond those recorded (N)': {'least': 0.5, 'most': 4.0}}
    assert missing_loads(np.full(3, np.nan)) == {'not told: force (no truth of loads)': {}}
