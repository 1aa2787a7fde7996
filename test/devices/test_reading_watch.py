"""Flags of readings: ends of the range, wraps, repeats and stuck chips, each told from its kin."""

from __future__ import annotations

import numpy as np
import pytest

from tactile_ros.devices.fault_flags import ReadingWatch
from tactile_ros.types import TaxelStatus

STALE, STUCK = TaxelStatus.STALE, TaxelStatus.STUCK
FULL = np.array([5e-3, 5e-3, 8e-3])


class Reader:
    """A watch over one chip, fed with x alone."""

    def __init__(self, **more: float) -> None:
        self.watch = ReadingWatch(1, FULL, **more)  # type: ignore[arg-type]

    def __call__(self, share: float, fresh: bool = True, good: bool = True) -> int:
        values = np.array([[share * FULL[0], 1e-3, 0.0]])
        codes = np.array([[round(share * 32768), 7, 0]], np.int64).astype(np.uint16)
        return int(self.watch.judge(codes, values, np.array([good]), np.array([fresh]))[0])


def test_the_ends_of_the_range_are_saturated() -> None:
    read = Reader(margin=0.02, jump=1.0)
    assert read(0.97) == 0
    assert read(0.981) == TaxelStatus.SATURATED
    assert Reader(margin=0.02)(-0.999) == TaxelStatus.SATURATED
    assert read(0.5) == 0


def test_a_slow_way_over_the_edge_is_a_wrap_until_it_comes_back() -> None:
    read = Reader()
    way = [*np.arange(0.0, 1.6, 0.05), *np.arange(1.6, -0.01, -0.05)]
    for true in way:
        status = read((true + 1) % 2 - 1)
        assert (status == 0) == (true < 0.98), true
        assert status in (0, TaxelStatus.SATURATED, TaxelStatus.WRAPPED)


def test_a_jump_is_not_believed_and_its_return_is() -> None:
    read = Reader(jump=0.5)
    assert [read(x) for x in (0.1, 0.4, -0.2, -0.75, -0.7, 0.0)] == [
        0, 0, TaxelStatus.WRAPPED, TaxelStatus.WRAPPED, TaxelStatus.WRAPPED, 0,
    ]  # fmt: skip


def test_what_lasts_longer_than_it_was_trusted_is_believed() -> None:
    read = Reader()
    read(0.0)
    statuses = [read(0.8) for _ in range(150)]
    assert all(status & TaxelStatus.WRAPPED for status in statuses[:100])
    assert not any(status & TaxelStatus.WRAPPED for status in statuses[100:])
    read = Reader()
    read(0.0)
    read.watch.forget()
    assert read(0.8) == 0


def test_repeats_are_stale_only_when_there_was_no_time() -> None:
    read = Reader()
    assert read(0.1) == 0
    assert read(0.1, fresh=False) == TaxelStatus.STALE
    assert read(0.1) == 0
    assert read(0.2, fresh=False) == 0


@pytest.mark.parametrize(('readings', 'unmarked'), [(600, 1), (100, 2)])
def test_a_repeat_of_a_chip_that_never_did_so_is_soon_stale(readings: int, unmarked: int) -> None:
    read = Reader()
    assert not any([read(1e-3 * (i % 7)) for i in range(readings)])
    marks = [read(0.3) for _ in range(12)]
    assert marks == [*[0] * unmarked, *[STALE] * (9 - unmarked), *[STALE | STUCK] * 3]
    assert read(0.31) == 0


@pytest.mark.parametrize(('quiet', 'after'), [(1, 10), (8, 105)])
def test_a_chip_is_stuck_when_its_own_noise_does_not_explain_it(quiet: int, after: int) -> None:
    """`quiet` readings alike are usual for this chip; more of them are needed to condemn it."""
    read = Reader(stuck_after=10)
    for i in range(200):
        marks = [read(1e-3 * (i % 7)) for _ in range(quiet)]
        assert not any(marks) or i == 0  # nothing is known of a chip that has not changed yet
    statuses = [read(0.3) for _ in range(200)]
    first = statuses.index(STUCK | STALE) + 1
    assert first == pytest.approx(after, abs=2)
    assert set(statuses[first:]) == {STUCK | STALE}
    doubted = statuses.index(STALE) + 1
    assert doubted == pytest.approx({10: 3, 105: 53}[after], abs=1)
    assert read(0.31) == 0


def test_chips_that_were_not_read_are_not_judged() -> None:
    read = Reader()
    read(0.1)
    assert read(0.999, good=False) == 0
    assert read(0.1) == 0


@pytest.mark.parametrize(
    'wrong', [{'margin': 1.0}, {'jump': 0.0}, {'stuck_after': 1}, {'chance': 0.0}]
)
def test_parameters_are_shares(wrong: dict[str, float]) -> None:
    with pytest.raises(ValueError, match='of ReadingWatch must be shares and stuck_after 2'):
        Reader(**wrong)
