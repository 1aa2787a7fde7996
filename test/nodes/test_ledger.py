"""Rows are recognised by order and content, also when some are lost or look alike."""

from __future__ import annotations

import threading

import numpy as np

from tactile_ros.nodes.player import Ledger
from tactile_ros.types import Frame


def frame(sequence: int, value: float) -> Frame:
    return Frame(sequence, sequence, np.full((1, 1), value))


def sent(*values: float) -> Ledger:
    ledger = Ledger()
    for row, value in enumerate(values):
        ledger.send(10 + row, np.full((1, 1), value))
    return ledger


def never() -> bool:
    return False


def test_rows_come_back_in_order_also_alike() -> None:
    ledger = sent(1, 1, 2)
    assert [ledger.match(frame(7 + i, v)) for i, v in enumerate((1, 1, 2))] == [10, 11, 12]
    assert ledger.lost == 0


def test_a_lost_row_is_counted_and_skipped() -> None:
    ledger = sent(1, 2, 3)
    assert ledger.match(frame(0, 3)) == 12
    assert ledger.lost == 2
    assert ledger.match(frame(1, 3)) is None


def test_a_stranger_is_no_row() -> None:
    ledger = sent(1)
    assert ledger.match(frame(0, 5)) is None
    assert ledger.match(frame(1, 1)) == 10


def test_nan_is_recognised() -> None:
    ledger = sent(np.nan)
    assert ledger.match(frame(0, np.nan)) == 10


def test_through_needs_both_the_frame_and_the_acknowledgement() -> None:
    ledger = sent(1, 2)
    ledger.acknowledge(5)
    assert not ledger.is_through(0)
    ledger.match(frame(5, 1))
    assert ledger.is_through(0)
    ledger.match(frame(6, 2))
    assert not ledger.is_through(1)
    ledger.acknowledge(6)
    assert ledger.wait(1, 1.0, never)


def test_waiting_ends_by_time_by_stop_and_by_giving_up() -> None:
    ledger = sent(1)
    assert not ledger.wait(0, 0.01, never)
    stop = threading.Event()
    threading.Timer(0.02, lambda: (stop.set(), ledger.wake())).start()
    assert not ledger.wait(0, 5.0, stop.is_set)
    assert ledger.give_up() == 1
    assert ledger.lost == 1
    assert ledger.wait(0, 0.0, never)
