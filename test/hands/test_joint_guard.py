"""Whatever is wanted: inside the limits, no faster, near the joints, no jump at a start."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactile_ros.hands.joint_guard import JointGuard
from tactile_ros.types import JointLimits

LIMITS = JointLimits(np.array([-0.5, 0.0]), np.array([1.0, 2.0]), np.array([2.0, 1.0]), np.ones(2))
ANYTHING = st.lists(
    st.one_of(st.floats(allow_nan=True, allow_infinity=True), st.floats(-3, 3)),
    min_size=2, max_size=2,
)  # fmt: skip
MEASURED = st.lists(st.floats(-1, 3), min_size=2, max_size=2)


@given(MEASURED, st.lists(st.tuples(ANYTHING, ANYTHING, st.floats(1e-4, 0.1)), max_size=20))
def test_no_input_leads_out_or_faster(
    start: list[float], steps: list[tuple[list[float], list[float], float]]
) -> None:
    guard = JointGuard(LIMITS, 0.3)
    guard.start(np.array(start))
    before = guard.last
    np.testing.assert_array_equal(before, np.clip(start, LIMITS.lower, LIMITS.upper))
    for wanted, measured, dt in steps:
        position, _ = guard.step(np.array(wanted), np.array(measured), dt)
        assert (position >= LIMITS.lower).all()
        assert (position <= LIMITS.upper).all()
        assert (np.abs(position - before) <= LIMITS.velocity * dt + 1e-12).all()
        before = position


def test_a_target_stays_near_the_measured_joint() -> None:
    guard = JointGuard(LIMITS, 0.3)
    still = np.array([0.2, 0.5])
    guard.start(still)
    for _ in range(100):
        position, limited = guard.step(np.array([0.9, 0.6]), still, 0.05)
    np.testing.assert_allclose(position, [0.5, 0.6])
    assert limited


def test_a_target_that_may_be_sent_is_not_limited_and_nan_keeps_the_last() -> None:
    guard = JointGuard(LIMITS, 0.3)
    still = np.array([0.2, 0.5])
    guard.start(still)
    position, limited = guard.step(still + 0.01, still, 0.05)
    np.testing.assert_array_equal(position, still + 0.01)
    assert not limited
    position, limited = guard.step(np.array([np.nan, 0.5]), still, 0.05)
    np.testing.assert_allclose(position, [0.21, 0.5])
    assert limited


@pytest.mark.parametrize('dt', [0.0, -0.1, np.nan])
def test_without_a_start_or_time_nothing_is_admitted(dt: float) -> None:
    guard = JointGuard(LIMITS, 0.3)
    with pytest.raises(ValueError, match='needs a measured start'):
        guard.step(np.zeros(2), np.zeros(2), 0.01)
    guard.start(np.zeros(2))
    with pytest.raises(ValueError, match='dt > 0'):
        guard.step(np.zeros(2), np.zeros(2), dt)
    guard.stop()
    with pytest.raises(ValueError, match='needs a measured start'):
        guard.step(np.zeros(2), np.zeros(2), 0.01)
