# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""The fake hand moves as late, as slowly and as far as it is told to."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactile_ros.control import GripConfig
from tactile_ros.hands import load_hand
from tactile_ros.hands.joints import (
    Guarded,
    HandJoints,
    HandWatch,
    JointGuard,
    taking_part,
)
from tactile_ros.nodes.mock_hand_node import MockHand
from tactile_ros.types import JointLimits

HAND = load_hand('joint_trajectory')
LIMITS = HAND.driver.limits
MEASURED = np.array([0.3, 0.5])


def joints() -> HandJoints:
    return HandJoints(HAND, ['left', 'right'])


NONE = np.full(2, np.nan)


def command(made: HandJoints, closures: np.ndarray) -> Guarded:
    return made.command(closures, NONE, [0.0, 0.0], MEASURED, NONE, 0.01, 0.01, 0.0)


def test_the_first_command_is_the_measured_posture_whatever_the_path() -> None:
    made = joints()
    sent = command(made, made.closures_of(MEASURED))
    np.testing.assert_allclose(sent.position, MEASURED, atol=1e-12)
    assert not sent.limited
    assert np.isnan(sent.effort).all()


def test_a_drive_that_only_lacks_time_is_not_stopped_and_one_at_its_offset_is() -> None:
    made = joints()
    start = made.closures_of(MEASURED)
    command(made, start)
    near = command(made, start + 0.1)
    assert near.limited
    np.testing.assert_allclose(near.position - MEASURED, LIMITS.velocity * 0.01)
    np.testing.assert_allclose(near.reach, start + 0.1)
    np.testing.assert_allclose(near.closure, made.closures_of(near.position), atol=1e-9)
    far = command(made, start + 2.0)
    assert (far.reach < start + 1.0).all()


def test_speed_of_the_slowest_joint_is_that_of_the_hand() -> None:
    slopes = [np.abs(finger.slope).max() for finger in HAND.fingers.values()]
    plants = joints().plants(GripConfig())
    assert min(one.fastest for one in plants) == pytest.approx(1.0 / max(slopes), rel=0.2)
    assert not any(one.is_soft for one in plants)


def test_drives_tell_the_force_of_a_pad_by_their_lead_and_by_their_torques() -> None:
    """Torques J^T f over gains: the pad presses along its normal, and nothing else."""
    hand = load_hand('allegro_v4')
    made, finger = HandJoints(hand, ['index']), hand.fingers['index']
    place = hand.places('index')
    start = hand.posture('pre_grasp', np.clip(0.0, hand.driver.lower, hand.driver.upper))
    (plant,) = made.plants(GripConfig())
    assert plant.own == pytest.approx(1.8, rel=0.1)
    contact = made.closures_of(start)
    blank, at = np.full(16, np.nan), 0.0
    for _ in range(60):
        at += 0.01
        closure = contact + min(0.5 * at, 0.5 / plant.own)
        sent = made.command(closure, contact, [0.5], start, blank, 0.01, 0.01, at)
    lead = made.lead(start, None, at + 1.0, 0.02)
    assert made.pressed(lead)[0] == pytest.approx(0.5, rel=0.02)
    torque = np.zeros(16)
    torque[place] = finger.kp * (sent.position - start)[place]
    np.testing.assert_allclose(torque[place], 0.5 * finger.lever, atol=2e-3)
    made.stop()
    again = made.lead(start, torque, at, 0.02)
    assert made.pressed(again)[0] == pytest.approx(0.5, rel=0.02)
    assert np.isnan(made.pressed(made.lead(start, np.zeros(16), at, 0.02))[0])


@pytest.mark.parametrize(('late', 'clip', 'full'), [(0.1, 9.0, False), (0.0, 0.2, True)])
def test_efforts_tell_a_full_drive_and_no_late_command(
    late: float, clip: float, full: bool
) -> None:
    hand = load_hand('allegro_v5_pinch')
    made = HandJoints(hand, ['thumb'])
    start = hand.posture('open', np.zeros(16))
    wanted, blank, last = made.closures_of(start), np.full(1, np.nan), start
    for k in range(300):
        now = 0.01 * k
        closure = wanted + (min(0.3 * now, 0.1) if now < 1.0 else min(0.3 * now - 0.2, 0.5))
        measured = start if k > 20 else last
        lead = made.lead(measured, None, now, 0.02)
        late_lead = made.lead(measured, None, now - late, 0.02)  # what the drive has by then
        effort = np.clip(3.0 * np.nan_to_num(late_lead), -clip, clip)
        made.take_effort(lead, effort)
        guarded = made.command(closure, blank, [0.0], measured, np.nan * start, 0.01, 0.01, now)
        last = guarded.position
    assert guarded.clipped == [full]


def test_sensors_that_take_part_are_those_of_the_fingers() -> None:
    assert taking_part(HAND, ()) == (['left', 'right'], ['left', 'right'])
    assert taking_part(HAND, ('right',)) == (['right'], ['right'])
    with pytest.raises(ValueError, match="fingers must be of left, right; received 'nose'"):
        taking_part(HAND, ('nose',))


TEST_JOINT_GUARD_LIMITS = JointLimits(
    np.array([-0.5, 0.0]), np.array([1.0, 2.0]), np.array([2.0, 1.0]), np.ones(2)
)
OFFSET = 0.3
STILL = np.array([0.2, 0.5])
ANYTHING = st.lists(
    st.one_of(st.floats(allow_nan=True, allow_infinity=True), st.floats(-3, 3)),
    min_size=2, max_size=2,
)  # fmt: skip
INSIDE = st.tuples(st.floats(-0.5, 1.0), st.floats(0.0, 2.0))


def guard(start: object = None) -> JointGuard:
    made = JointGuard(('a', 'b'), TEST_JOINT_GUARD_LIMITS, OFFSET)
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
        assert (position >= TEST_JOINT_GUARD_LIMITS.lower).all()
        assert (position <= TEST_JOINT_GUARD_LIMITS.upper).all()
        assert (np.abs(position - before) <= TEST_JOINT_GUARD_LIMITS.velocity * dt + 1e-12).all()
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
    made = JointGuard(('a', 'b'), TEST_JOINT_GUARD_LIMITS, 0.01)
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


SLACK = np.array([0.05, 0.05])


def watch() -> HandWatch:
    return HandWatch(('a', 'b'), np.ones(2), SLACK, 0.3)


def test_the_same_posture_again_and_again_while_commands_move_is_frozen() -> None:
    made, still = watch(), np.array([0.2, 0.5])
    for k in range(50):
        made.take(still, 0.01 * k)
        made.send(still + np.array([0.01 * k, 0.0]), 0.01 * k)
        assert bool(made.frozen(0.01 * k)) == (k > 36)  # further than the slack since 0.06 s
    assert made.frozen(0.5) == 'joint states are frozen (0.440 s) while commands move'
    made.take(still + np.array([0.0, 1e-6]), 0.51)
    assert not made.frozen(0.51)
    made.forget()
    assert not made.frozen(9.0)


def test_a_hand_at_rest_and_one_that_flickers_are_not() -> None:
    rest, blocked = watch(), watch()
    for k in range(500):
        rest.take(np.array([0.2, 0.5]), 0.01 * k)
        rest.send(np.array([0.2, 0.5]) + 0.02 * np.sin(k), 0.01 * k)
        blocked.take(np.array([0.2, 0.5 + 1e-6 * (k % 2)]), 0.01 * k)
        blocked.send(np.array([0.6, 0.5]), 0.01 * k)
        assert not rest.frozen(0.01 * k)
        assert not blocked.frozen(0.01 * k)


def test_a_hand_that_was_moved_by_others_is_named_and_one_on_its_way_is_not() -> None:
    made = watch()
    assert not made.strayed()
    made.take(np.array([0.2, 0.5]), 0.0)
    made.send(np.array([0.4, 0.5]), 0.0)
    for on_its_way in ([0.3, 0.5], [0.4, 0.54], [0.44, 0.5]):
        made.take(np.array(on_its_way), 0.1)
        assert not made.strayed()
    made.take(np.array([0.4, 1.38]), 0.2)
    assert made.strayed() == 'b came back 0.880 from its last command: it was moved by others'


def test_two_sources_of_joint_states_are_named_and_no_motion_or_knock_is_one() -> None:
    made, there = watch(), np.array([0.2, 0.5])
    for k, moved in enumerate([0.0, 0.01, 0.9, 0.91, 0.95, 0.9]):  # others move it once
        made.take(there + np.array([0.0, moved]), 0.01 * k)
        assert not made.conflicts(0.01 * k)
    for k in range(5):
        made.take(there + 0.6 * (k % 2), 1.0 + 0.01 * k)
        assert bool(made.conflicts(1.0 + 0.01 * k)) == (k > 1)
    assert made.conflicts(1.3) == (
        'a jumps there and back by 0.600: two sources publish its joint states'
    )
    assert not made.conflicts(1.4)


TEST_MOCK_HAND_LIMITS = JointLimits(np.zeros(2), np.ones(2), np.array([100.0, 0.5]), np.ones(2))


def test_a_position_loop_follows_with_its_lag_and_its_speed() -> None:
    hand = MockHand(TEST_MOCK_HAND_LIMITS, np.zeros(2), lag_s=0.1)
    hand.command(np.array([0.8, 0.8]))
    for _ in range(100):
        position = hand.step(0.001)
    assert position[0] == pytest.approx(0.8 * (1 - np.exp(-1)), rel=1e-9)
    assert position[1] == pytest.approx(0.05)


def test_a_command_acts_after_the_dead_time_and_arrives_at_the_horizon() -> None:
    hand = MockHand(TEST_MOCK_HAND_LIMITS, np.zeros(2), dead_time_s=0.1)
    hand.command(np.array([0.4, 0.0]), 0.2)
    track = [hand.step(0.01)[0] for _ in range(40)]
    assert track[8] == 0
    assert track[19] == pytest.approx(0.22, abs=0.03)
    assert track[30] == pytest.approx(0.4, abs=1e-6)


def test_it_stops_at_its_limits() -> None:
    hand = MockHand(TEST_MOCK_HAND_LIMITS, np.full(2, 5.0))
    np.testing.assert_array_equal(hand.position, [1.0, 1.0])
    hand.command(np.array([-3.0, 9.0]))
    for _ in range(500):
        position = hand.step(0.01)
    np.testing.assert_allclose(position, [0.0, 1.0], atol=1e-9)
