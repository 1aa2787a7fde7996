"""Whatever is wanted: inside the limits, no faster, near the joints, no jump at a start."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactile_ros.hands.joints import JointGuard
from tactile_ros.types import JointLimits

LIMITS = JointLimits(np.array([-0.5, 0.0]), np.array([1.0, 2.0]), np.array([2.0, 1.0]), np.ones(2))
OFFSET = 0.3
STILL = np.array([0.2, 0.5])
ANYTHING = st.lists(
    st.one_of(st.floats(allow_nan=True, allow_infinity=True), st.floats(-3, 3)),
    min_size=2, max_size=2,
)  # fmt: skip
INSIDE = st.tuples(st.floats(-0.5, 1.0), st.floats(0.0, 2.0))


def guard(start: object = None) -> JointGuard:
    made = JointGuard(('a', 'b'), LIMITS, OFFSET)
    if start is not None:
        made.start(np.array(start))
    return made


@given(INSIDE, st.lists(st.tuples(ANYTHING, ANYTHING, st.floats(0.0, 0.1)), max_size=20))
def test_limits_speed_and_offset_hold_at_once_or_nothing_is_sent(
    start: tuple[float, float], steps: list[tuple[list[float], list[float], float]]
) -> None:
    made = guard(start)
    before = made.last
    np.testing.assert_array_equal(before, start)
    for wanted, felt, dt in steps:
        measured = np.array(felt)
        if made.refusal(measured, dt):
            with pytest.raises(ValueError, match='was measured'):
                made.step(np.array(wanted), measured, dt)
            continue
        position, _ = made.step(np.array(wanted), measured, dt)
        assert (position >= LIMITS.lower).all()
        assert (position <= LIMITS.upper).all()
        assert (np.abs(position - before) <= LIMITS.velocity * dt + 1e-12).all()
        assert (np.abs(position - measured) <= OFFSET + 1e-12).all()
        before = position


def test_a_target_stays_near_the_measured_joint() -> None:
    made = guard(STILL)
    for _ in range(100):
        position, limited = made.step(np.array([0.9, 0.6]), STILL, 0.05)
    np.testing.assert_allclose(position, [0.5, 0.6])
    assert limited


def test_a_joint_that_is_pushed_away_takes_its_target_with_it() -> None:
    made, measured = guard(STILL), STILL.copy()
    for _ in range(20):
        measured = measured - 0.02
        assert not made.refusal(measured, 0.05)
        position, _ = made.step(STILL, measured, 0.05)
        assert (np.abs(position - measured) <= OFFSET + 1e-12).all()
    np.testing.assert_allclose(position, measured + OFFSET)


def test_a_joint_that_jumps_is_refused_and_named() -> None:
    made = guard(STILL)
    assert made.refusal(STILL + np.array([0.0, 1.2]), 0.01) == (
        'b was measured 1.200 from its last command; at most 0.3 may lie between them'
    )
    assert made.refusal(np.array([np.nan, 0.5]), 0.01).startswith('a was measured at nan')
    assert not made.refusal(STILL, 0.01)


def test_a_start_beyond_the_limits_is_refused_and_no_more_than_slack_is_clipped() -> None:
    made = guard()
    assert made.refusal(np.array([2.5, 0.5]), 0.01) == (
        'a was measured at 2.500, beyond its limits -0.5 and 1'
    )
    # a twentieth of the range
    assert not made.refusal(np.array([1.07, -0.09]), 0.01)
    assert made.refusal(np.array([1.08, 0.0]), 0.01)
    made.start(np.array([1.07, -0.09]))
    np.testing.assert_array_equal(made.last, [1.0, 0.0])


def test_a_first_command_is_no_further_from_the_joint_than_any_other() -> None:
    made = JointGuard(('a', 'b'), LIMITS, 0.01)
    assert made.refusal(np.array([1.05, 0.5]), 0.01)
    measured = np.array([1.009, 0.5])
    assert not made.refusal(measured, 0.01)
    made.start(measured)
    position, _ = made.step(measured, measured, 0.01)
    np.testing.assert_array_equal(position, [1.0, 0.5])


def test_a_target_that_may_be_sent_is_not_limited_and_nan_keeps_the_last() -> None:
    made = guard(STILL)
    position, limited = made.step(STILL + 0.01, STILL, 0.05)
    np.testing.assert_array_equal(position, STILL + 0.01)
    assert not limited
    position, limited = made.step(np.array([np.nan, 0.5]), STILL, 0.05)
    np.testing.assert_allclose(position, [0.21, 0.5])
    assert limited


@pytest.mark.parametrize('dt', [-0.1, np.nan])
def test_without_a_start_or_time_nothing_is_admitted(dt: float) -> None:
    made = guard()
    with pytest.raises(ValueError, match='needs a measured start'):
        made.step(np.zeros(2), np.zeros(2), 0.01)
    made.start(np.zeros(2))
    with pytest.raises(ValueError, match='dt of 0 or more'):
        made.step(np.zeros(2), np.zeros(2), dt)
    made.stop()
    with pytest.raises(ValueError, match='needs a measured start'):
        made.step(np.zeros(2), np.zeros(2), 0.01)
