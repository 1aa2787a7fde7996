# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Joints of a hand: commands, the limiter, the watch, and the fake hand that follows."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tactile_ros.control import GripConfig, GripForce, GripInput, GripStep
from tactile_ros.hands import load_hand
from tactile_ros.hands.joints import Guarded, HandJoints, HandWatch, JointLimiter, taking_part
from tactile_ros.nodes.mock_hand_node import MockHand
from tactile_ros.types import JointLimits

HAND = load_hand('joint_trajectory')
MEASURED = np.array([0.3, 0.5])
NONE = np.full(2, np.nan)


def decided(
    closure: np.ndarray, contact: np.ndarray, force: float = 0.0, loaded: bool = False
) -> GripStep:
    """A step of the law for drives of one finger each."""
    count = len(closure)
    law, blank = GripForce(GripConfig(), range(count)), np.zeros(count)
    given = GripInput(blank, blank, blank == 0, blank.astype(np.int8), blank, blank, 0.0)
    asked = {'closure': closure, 'contact': contact, 'target_force': np.full(count, force)}
    return replace(law.step(given, 0.01), loaded=loaded, **asked)


def command(made: HandJoints, closures: np.ndarray) -> Guarded:
    return made.command(decided(closures, NONE), MEASURED, NONE, 0.01, 0.01, 0.0)


def test_hand_joints_begin_as_measured_and_a_drive_that_lacks_time_is_not_stopped() -> None:
    made = HandJoints(HAND, ['left', 'right'])
    slopes = [np.abs(finger.slope).max() for finger in HAND.fingers.values()]
    plants = made.plants(GripConfig())
    assert min(one.fastest for one in plants) == pytest.approx(1.0 / max(slopes), rel=0.2)
    assert not any(one.is_soft for one in plants)
    start = made.closures_of(MEASURED)
    sent = command(made, start)
    np.testing.assert_allclose(sent.position, MEASURED, atol=1e-12)
    assert not sent.limited
    assert np.isnan(sent.effort).all()
    near = command(made, start + 0.1)
    assert near.limited
    np.testing.assert_allclose(near.position - MEASURED, HAND.driver.limits.velocity * 0.01)
    np.testing.assert_allclose(near.reach, start + 0.1)
    np.testing.assert_allclose(near.closure, made.closures_of(near.position), atol=1e-9)
    assert (command(made, start + 2.0).reach < start + 1.0).all()


def test_hand_joints_tell_the_force_of_a_pad_by_lead_and_by_torque() -> None:
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
        sent = made.command(decided(closure, contact, 0.5), start, blank, 0.01, 0.01, at)
    lead = made.lead(start, None, at + 1.0, 0.02)
    assert made.pressed(lead)[0] == pytest.approx(0.5, rel=0.02)
    torque = np.zeros(16)
    torque[place] = finger.kp * (sent.position - start)[place]
    np.testing.assert_allclose(torque[place], 0.5 * finger.lever, atol=2e-3)
    made.stop()
    again = made.lead(start, torque, at, 0.02)
    assert made.pressed(again)[0] == pytest.approx(0.5, rel=0.02)
    assert np.isnan(made.pressed(made.lead(start, np.zeros(16), at, 0.02))[0])


def test_hand_joints_press_on_where_one_is_at_its_limit_and_say_so() -> None:
    hand = load_hand('allegro_v4')
    made, place = HandJoints(hand, ['index']), hand.places('index')
    start = np.zeros(16)
    start[place] = hand.fingers['index'].posture(1.0)  # its second joint may go .054 on
    contact, blank = made.closures_of(start), np.full(16, np.nan)
    for k in range(100):
        closure = contact + min(0.01 * k, 0.3)
        sent = made.command(decided(closure, contact, 0.5), start, blank, 0.01, 0.01, 0.01 * k)
    upper = hand.driver.limits.upper[place]
    assert sent.position[place][1] == upper[1]
    np.testing.assert_allclose(sent.closure, closure)
    assert sent.reach < closure - 0.01
    lead = made.lead(start, None, 2.0, 0.02)
    own = hand.fingers['index'].stiffness
    assert made.pressed(lead)[0] == pytest.approx(0.3 * own, rel=0.05)


@pytest.mark.parametrize(('name', 'share'), [('allegro_v5_pinch', 1.0), ('allegro_v4', 0.0)])
def test_hand_joints_shift_commands_of_joints_that_give_way_under_a_load(
    name: str, share: float
) -> None:
    hand = load_hand(name)
    made, place = HandJoints(hand, ['index']), hand.places('index')
    start = hand.posture('pre_grasp', np.zeros(16))
    closure, blank, given_way = made.closures_of(start), np.full(16, np.nan), np.zeros(16)
    given_way[place] = [0.02, -0.01, 0.0, 0.03]

    def after(seconds: float, moved: np.ndarray, loaded: bool) -> np.ndarray:
        for _ in range(round(seconds / 0.01)):
            step = decided(closure, closure, loaded=loaded)
            sent = made.command(step, start - moved, blank, 0.01, 0.01, 0.0)
        return (sent.position - start)[place]

    np.testing.assert_allclose(after(0.1, 0 * start, True), 0.0, atol=1e-12)
    np.testing.assert_allclose(after(1.0, given_way, True), share * given_way[place], atol=1e-5)
    np.testing.assert_allclose(after(5.0, given_way, False), 0.0, atol=1e-5)
    # a new load is measured from where it came
    np.testing.assert_allclose(after(1.0, given_way, True), 0.0, atol=1e-5)


def test_hand_joints_that_are_pulled_far_under_a_load_leave_the_law_its_command() -> None:
    hand = load_hand('allegro_v5_pinch')
    made, place = HandJoints(hand, ['index']), hand.places('index')
    start = hand.posture('pre_grasp', np.zeros(16))
    contact, blank, pulled = made.closures_of(start), np.full(16, np.nan), np.array(start)
    pulled[place] -= 0.25  # most_offset is 0.4
    for k in range(400):
        closure = contact + min(0.01 * k, 0.2)
        measured = pulled if 100 <= k < 300 else start
        step = decided(closure, contact, 1.0, k >= 50)
        sent = made.command(step, measured, blank, 0.01, 0.01, 0.01 * k)
        if k > 50:
            np.testing.assert_allclose(sent.closure, closure, atol=1e-9)
    np.testing.assert_allclose((sent.position - start)[place], 0.2 * hand.fingers['index'].press,
                               atol=1e-3)  # fmt: skip


@pytest.mark.parametrize(('late', 'clip', 'full'), [(0.1, 9.0, False), (0.0, 0.2, True)])
def test_hand_joints_learn_a_full_drive_from_efforts_and_no_late_command(
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
        made.take_effort(lead, effort, now - 0.05)
        guarded = made.command(decided(closure, blank), measured, np.nan * start, 0.01, 0.01, now)
        last = guarded.position
    assert guarded.clipped == [full]
    made.take_effort(np.zeros(16), np.zeros(16), now)  # what leads by nothing is at no limit
    again = made.command(decided(closure, blank), last, np.nan * start, 0.01, 0.01, now + 0.01)
    assert again.clipped == [False]


def test_taking_part_are_the_sensors_of_the_fingers() -> None:
    assert taking_part(HAND, ()) == (['left', 'right'], ['left', 'right'])
    assert taking_part(HAND, ('right',)) == (['right'], ['right'])
    with pytest.raises(ValueError, match="fingers must be of left, right; received 'nose'"):
        taking_part(HAND, ('nose',))


LIMITS = JointLimits(np.array([-0.5, 0.0]), np.array([1.0, 2.0]), np.array([2.0, 1.0]), np.ones(2))
OFFSET = 0.3
STILL = np.array([0.2, 0.5])
ANYTHING = st.lists(
    st.one_of(st.floats(allow_nan=True, allow_infinity=True), st.floats(-3, 3)),
    min_size=2, max_size=2,
)  # fmt: skip
INSIDE = st.tuples(st.floats(-0.5, 1.0), st.floats(0.0, 2.0))


def limiter(start: object = None, offset: float = OFFSET) -> JointLimiter:
    made = JointLimiter(('a', 'b'), LIMITS, offset)
    if start is not None:
        made.start(np.array(start))
    return made


@settings(max_examples=40)
@given(INSIDE, st.lists(st.tuples(ANYTHING, ANYTHING, st.floats(0.0, 0.1)), max_size=20))
def test_joint_limiter_holds_limits_speed_and_offset_at_once_or_sends_nothing(
    start: tuple[float, float], steps: list[tuple[list[float], list[float], float]]
) -> None:
    made = limiter(start)
    before = made.last
    np.testing.assert_array_equal(before, start)
    for wanted, felt, dt in steps:
        measured = np.array(felt)
        if made.refusal(measured, dt):
            with pytest.raises(ValueError, match='was measured'):
                made.step(np.array(wanted), measured, dt)
            continue
        position, limited = made.step(np.array(wanted), measured, dt)
        assert (position >= LIMITS.lower).all()
        assert (position <= LIMITS.upper).all()
        assert (np.abs(position - before) <= LIMITS.velocity * dt + 1e-12).all()
        assert (np.abs(position - measured) <= OFFSET + 1e-12).all()
        assert limited == (not np.allclose(position, wanted, rtol=0.0, atol=1e-12))
        before = position


def test_joint_limiter_takes_the_target_of_a_joint_that_is_pushed_with_it() -> None:
    made, measured = limiter(STILL), STILL.copy()
    for _ in range(20):
        measured = measured - 0.02
        position, _ = made.step(STILL, measured, 0.05)
    np.testing.assert_allclose(position, measured + OFFSET)
    position, limited = made.step(np.array([np.nan, 0.2]), measured, 0.05)  # NaN keeps the last
    np.testing.assert_allclose(position, [measured[0] + OFFSET, measured[1] + OFFSET - 0.05])
    assert limited


@pytest.mark.parametrize(
    ('start', 'offset', 'measured', 'said'),
    [
        (STILL, OFFSET, STILL, ''),
        (STILL, OFFSET, [0.2, 1.7],
         'b was measured 1.200 from its last command; at most 0.3 may lie between them'),
        (STILL, OFFSET, [np.nan, 0.5], 'a was measured at nan, beyond its limits -0.5 and 1'),
        (None, OFFSET, [2.5, 0.5], 'a was measured at 2.500, beyond its limits -0.5 and 1'),
        # a twentieth of the range, and no more than the offset
        (None, OFFSET, [1.07, -0.09], ''),
        (None, OFFSET, [1.08, 0.0], 'a was measured at 1.080, beyond its limits -0.5 and 1'),
        (None, 0.01, [1.05, 0.5], 'a was measured at 1.050, beyond its limits -0.5 and 1'),
        (None, 0.01, [1.009, 0.5], ''),
    ],
)  # fmt: skip
def test_joint_limiter_refuses_by_name(
    start: object, offset: float, measured: object, said: str
) -> None:
    made = limiter(start, offset)
    assert made.refusal(np.array(measured), 0.01) == said
    if start is None and not said:
        made.start(np.array(measured))
        np.testing.assert_array_equal(made.last, np.clip(measured, LIMITS.lower, LIMITS.upper))


@pytest.mark.parametrize(('start', 'dt'), [(None, 0.01), (STILL, -0.1), (STILL, np.nan)])
def test_joint_limiter_admits_nothing_without_a_start_or_time(start: object, dt: float) -> None:
    with pytest.raises(ValueError, match='needs a measured start and dt of 0 or more'):
        limiter(start).step(STILL, STILL, dt)


def watch() -> HandWatch:
    return HandWatch(('a', 'b'), np.ones(2), np.array([0.05, 0.05]), 0.3)


def test_hand_watch_finds_joints_that_freeze_while_commands_move() -> None:
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
    rest, blocked = watch(), watch()  # one stands at its target, one flickers
    for k in range(100):
        rest.take(still, 0.01 * k)
        rest.send(still + 0.02 * np.sin(k), 0.01 * k)
        blocked.take(still + 1e-6 * (k % 2), 0.01 * k)
        blocked.send(still + 0.4, 0.01 * k)
        assert not rest.frozen(0.01 * k) + blocked.frozen(0.01 * k)


def test_hand_watch_names_a_hand_that_others_moved() -> None:
    made = watch()
    assert not made.strayed()
    made.take(np.array([0.2, 0.5]), 0.0)
    made.send(np.array([0.4, 0.5]), 0.0)
    for on_its_way in ([0.3, 0.5], [0.4, 0.54], [0.44, 0.5]):
        made.take(np.array(on_its_way), 0.1)
        assert not made.strayed()
    made.take(np.array([0.4, 1.38]), 0.2)
    assert made.strayed() == 'b came back 0.880 from its last command: it was moved by others'


def test_hand_watch_names_two_sources_and_no_motion_or_knock() -> None:
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


def test_mock_hand_follows_with_its_lag_its_speed_and_its_limits() -> None:
    limits = JointLimits(np.zeros(2), np.ones(2), np.array([100.0, 0.5]), np.ones(2))
    hand = MockHand(limits, np.zeros(2), lag_s=0.1)
    hand.command(np.array([0.8, 0.8]))
    for _ in range(100):
        position = hand.step(0.001)
    assert position == pytest.approx([0.8 * (1 - np.exp(-1)), 0.05], rel=1e-9)
    late = MockHand(limits, np.full(2, 5.0), dead_time_s=0.1)
    np.testing.assert_array_equal(late.position, [1.0, 1.0])
    late.command(np.array([0.4, 9.0]), 0.2)
    track = np.array([late.step(0.01) for _ in range(40)])
    assert track[8, 0] == 1.0
    assert track[19, 0] == pytest.approx(0.67, abs=0.03)
    assert track[30] == pytest.approx([0.4, 1.0], abs=1e-6)


def test_hand_joints_see_a_full_drive_while_its_command_still_rises() -> None:
    hand = load_hand('allegro_v5_pinch')
    made = HandJoints(hand, ['thumb'])
    start = hand.posture('open', np.zeros(16))
    wanted, blank, last, seen = made.closures_of(start), np.full(1, np.nan), start, np.inf
    for k in range(200):
        now = 0.01 * k
        measured = start if k > 20 else last
        lead = made.lead(measured, None, now, 0.02)
        made.take_effort(lead, np.clip(3.0 * np.nan_to_num(lead), -0.3, 0.3), now - 0.05)
        step = decided(wanted + 0.2 * now, blank)
        guarded = made.command(step, measured, np.nan * start, 0.01, 0.01, now)
        last = guarded.position
        if guarded.clipped == [True] and np.isinf(seen):
            seen = now
    assert seen < 1.9
