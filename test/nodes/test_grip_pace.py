"""Forces set the pace of a grip; the clock takes over where they do not come."""

from __future__ import annotations

import numpy as np
import pytest

from tactile_ros.nodes.grip_loop import GripPace

PERIOD_NS = 10_000_000


def pace(fingers: int = 1) -> GripPace:
    return GripPace(0.01, 0.015, fingers)


def steps(taken: GripPace, stamps_ns: list[int], delay_s: float = 0.0) -> list[float]:
    """Times (s) between the steps that forces of one finger cause."""
    found = []
    for stamp_ns in stamps_ns:
        now_s = 1e-9 * stamp_ns + delay_s
        if taken.take(0, stamp_ns, now_s):
            found.append(taken.step(now_s))
    return found


def test_every_force_of_its_rate_is_a_step_whatever_its_delay() -> None:
    rng = np.random.default_rng(0)
    stamps = [k * PERIOD_NS + int(rng.integers(-1_000_000, 1_000_000)) for k in range(1, 60)]
    taken = pace()
    made = steps(taken, stamps)
    assert len(made) == len(stamps)
    np.testing.assert_allclose(made[1:], 1e-9 * np.diff(stamps), atol=1e-12)


@pytest.mark.parametrize('rate_hz', [150.0, 333.0, 1000.0])
def test_a_hand_is_commanded_no_faster_than_its_rate(rate_hz: float) -> None:
    stamps = [round(k * 1e9 / rate_hz) for k in range(1, int(2 * rate_hz))]
    made = steps(pace(), stamps)
    assert 195 <= len(made) <= 201


def test_a_burst_of_late_forces_is_stepped_through() -> None:
    taken = pace()
    assert taken.take(0, PERIOD_NS, 0.01)
    taken.step(0.01)
    found = []
    for k in range(2, 5):
        assert taken.take(0, k * PERIOD_NS, 0.05)
        found.append(taken.step(0.05))
    assert found == pytest.approx([0.01] * 3)


def test_a_finger_that_fell_silent_is_not_waited_for() -> None:
    taken = pace(fingers=2)
    assert taken.take(0, None, 0.991)  # of the other nothing was ever heard
    assert taken.take(1, None, 0.991)
    taken.step(0.991)
    assert not taken.take(0, None, 1.0)
    assert taken.take(1, None, 1.001)
    taken.step(1.001)
    assert not taken.take(1, None, 1.011)
    assert taken.is_late(1.017)
    assert taken.take(1, None, 1.021)


def test_the_clock_steps_once_forces_fail_and_forces_take_over_again() -> None:
    taken = pace()
    assert taken.is_late(0.0)
    taken.step(0.0)
    assert not taken.is_late(0.014)
    assert taken.is_late(0.016)
    assert taken.step(0.016) == pytest.approx(0.016)
    assert taken.take(0, 5 * PERIOD_NS, 0.03)
    assert taken.step(0.03) == pytest.approx(0.014)


def test_a_fast_loop_that_is_a_little_late_is_not_stepped_by_the_clock() -> None:
    taken = GripPace(0.001, 0.015, 1)
    taken.step(0.0)
    assert not taken.is_late(0.005)
    assert taken.is_late(0.010)  # at the next look at the clock, where forces fail


@pytest.mark.parametrize('jump_ns', [-3_600_000_000_000, -300_000_000, 3_600_000_000_000])
def test_a_clock_of_stamps_that_jumps_stops_nothing(jump_ns: int) -> None:
    taken = pace()
    taken.take(0, 100 * PERIOD_NS + 10**13, 1.0)
    taken.step(1.0)
    for k in range(1, 4):
        now_s = 1.0 + 0.01 * k
        assert taken.take(0, (100 + k) * PERIOD_NS + 10**13 + jump_ns, now_s)
        since = taken.step(now_s)
        assert since > 0
    assert since == pytest.approx(0.01)
