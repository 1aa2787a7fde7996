# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Status bits: stuck taxels among living ones, ends of the range, wraps and repeats."""

import numpy as np
import pytest

from tactile_ros.devices.fault_flags import ChipFaultDetector, StuckDetector
from tactile_ros.types import TaxelStatus

STALE, STUCK = TaxelStatus.STALE, TaxelStatus.STUCK
FULL = np.array([5e-3, 5e-3, 8e-3])


def follow(readings: np.ndarray, others: float = 0.0) -> np.ndarray:
    """Stuck taxels after each row of readings, shape (s, t)."""
    return (StuckDetector(readings.shape[1], others).follow_frames(readings) & STUCK) > 0


def noisy(rows: int, taxels: int = 4) -> np.ndarray:
    return np.random.default_rng(0).normal(size=(rows, taxels, 3))


def test_stuck_detector_marks_the_tenth_alike_until_it_moves() -> None:
    readings = noisy(100)
    readings[60:80, 2] = readings[60, 2]
    stuck = follow(readings, others=0.5)
    assert np.flatnonzero(stuck[:, 2]).tolist() == list(range(69, 80))
    assert not np.delete(stuck, 2, axis=1).any()


def test_stuck_detector_does_not_judge_a_still_board() -> None:
    readings = noisy(200)
    readings[60:] = readings[60]
    assert not follow(readings, others=0.5).any()
    assert follow(readings).all(axis=1)[-1]


def test_stuck_detector_learns_rest_as_a_whole() -> None:
    """After a rest of 1000 readings one of 300 is no wonder, however lively the touch was."""
    readings = np.concatenate([np.repeat(noisy(1), 1000, axis=0), noisy(200)])
    readings = np.concatenate([readings, np.repeat(readings[-1:], 300, axis=0)])
    detector = StuckDetector(1, least_changes=10)
    for row in readings[:, :1]:
        detector.follow(row)
        assert not detector.status().any()


@pytest.mark.parametrize('sigma', [0.3, 1.0, 3.0])
def test_stuck_detector_lets_quiet_readings_live_and_finds_their_end(sigma: float) -> None:
    """100 000 readings of few steps of a converter: no false alarm, and a freeze is seen."""
    counts = np.rint(sigma * noisy(25_000)) + 500
    each, whole = StuckDetector(4, others=0.5), StuckDetector(1)
    for row in counts:
        each.follow(row)
        whole.follow(row.reshape(1, -1))
        assert not each.status().any()
        assert not whole.status().any()
    said = []
    for _ in range(100):
        whole.follow(counts[-1].reshape(1, -1))
        said.append(int(whole.status()[0]))
    assert np.flatnonzero(said)[0] < (5 if sigma >= 1 else 20)
    assert said[-1] == STALE | STUCK


def test_stuck_detector_leaves_uninformative_repeats_out() -> None:
    detector = StuckDetector(1)
    rows = noisy(60, 1)
    for row in rows:
        detector.follow(row)
    for _ in range(50):
        detector.follow(rows[-1], informative=False)
    assert not detector.status().any()
    for _ in range(20):
        detector.follow(rows[-1])
    assert detector.status().tolist() == [STALE | STUCK]
    detector.follow(np.zeros((1, 3)), informative=False)
    assert not detector.status().any()


def test_stuck_detector_finds_a_returning_fault_as_soon() -> None:
    readings = noisy(5000)
    for start in range(100, 5000, 1000):
        readings[start : start + 900, 2] = readings[start, 2]
    stuck = follow(readings, others=0.5)[:, 2].reshape(5, 1000)
    assert (stuck.sum(axis=1) == stuck[0].sum()).all()
    assert stuck[0].sum() >= 880


class Reader:
    """A detector over one chip, fed with x alone."""

    def __init__(self) -> None:
        self.detector = ChipFaultDetector(1, FULL)

    def __call__(self, share: float, fresh: bool = True, good: bool = True) -> int:
        values = np.array([[share * FULL[0], 1e-3, 0.0]])
        codes = np.array([[round(share * 32768), 7, 0]], np.int64).astype(np.uint16)
        return int(self.detector.status(codes, values, np.array([good]), np.array([fresh]))[0])


def test_chip_faults_follow_a_wrap_until_it_comes_back() -> None:
    read = Reader()
    way = [*np.arange(0.0, 1.6, 0.05), *np.arange(1.6, -0.01, -0.05)]
    for true in way:
        status = read((true + 1) % 2 - 1)
        assert (status == 0) == (true < 0.98), true
        assert status in (0, TaxelStatus.SATURATED, TaxelStatus.WRAPPED)


def test_chip_faults_believe_what_lasts() -> None:
    read = Reader()
    read(0.0)
    statuses = [read(0.8) for _ in range(150)]
    assert all(status & TaxelStatus.WRAPPED for status in statuses[:100])
    assert not any(status & TaxelStatus.WRAPPED for status in statuses[100:])
    read = Reader()
    read(0.0)
    read.detector.forget()
    assert read(0.8) == 0


@pytest.mark.parametrize(('quiet', 'after'), [(1, 10), (8, 108)])
def test_chip_faults_judge_repeats_by_the_chips_own_noise(quiet: int, after: int) -> None:
    """`quiet` readings alike are usual for this chip; more of them are needed to condemn it."""
    read = Reader()
    for i in range(200):
        marks = [read(1e-3 * (i % 7)) for _ in range(quiet)]
        assert not any(marks) or i == 0  # nothing is known of a chip that has not changed yet
    statuses = [read(0.3) for _ in range(200)]
    first = statuses.index(STUCK | STALE) + 1
    assert first == pytest.approx(after, abs=2)
    assert set(statuses[first:]) == {STUCK | STALE}
    doubted = next(i for i, status in enumerate(statuses, start=1) if status)
    assert doubted == pytest.approx({10: 4, 108: 108}[after], abs=2)
    assert read(0.31) == 0


def test_stuck_detector_keeps_the_run_of_unread_taxels() -> None:
    detector = StuckDetector(1)
    good = np.ones(1, bool)
    for row in noisy(60, 1):
        detector.follow(row, good)
    for _ in range(9):
        assert not (detector.status() & STUCK).any()
        detector.follow(np.zeros((1, 3)), ~good)
        detector.follow(row, good)
    assert (detector.status() & STUCK).all()
    detector.forget()
    assert not (detector.status() & STUCK).any()


def test_chip_faults_mark_repeats_read_too_early() -> None:
    read = Reader()
    assert read(0.1) == 0
    assert read(0.1, fresh=False) == TaxelStatus.STALE
    assert read(0.1) == 0
    assert read(0.2, fresh=False) == 0


def test_chip_faults_do_not_judge_unread_chips() -> None:
    read = Reader()
    read(0.1)
    assert read(0.999, good=False) == 0
    assert read(0.1) == 0
