# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Fingers, the shipped hands, and files that are none."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from tactile_ros.hands import Finger, list_hands, load_hand
from tactile_ros.hands.description import MOST_BYTES, folder, narrowed, parse
from tactile_ros.types import JointLimits

FINGER = Finger(
    joints=('a', 'b', 'c'), open=[0.0, 0.1, 0.0], pre_grasp=[0.3, 0.5, 0.0],
    closing=[0.0, 0.6, 0.8], lever=[0.0, 0.05, 0.02], free_effort=0.1, sensors=('tip',),
)  # fmt: skip


def test_finger_path_has_three_postures_and_even_speed() -> None:
    corner = FINGER.corner
    assert corner == pytest.approx(0.5 / 1.5)
    np.testing.assert_allclose(FINGER.posture(0.0), FINGER.open)
    np.testing.assert_allclose(FINGER.posture(corner), FINGER.pre_grasp)
    np.testing.assert_allclose(FINGER.posture(1.0), FINGER.pre_grasp + FINGER.closing)
    speeds = [np.linalg.norm(FINGER.posture(c + 0.1) - FINGER.posture(c)) for c in (0.0, 0.2, 0.8)]
    np.testing.assert_allclose(speeds, 0.15)
    finger = Finger(joints=('a',), open=[0.0], pre_grasp=[0.0], closing=[0.8])
    assert (finger.corner, finger.posture(0.5)) == (0.0, pytest.approx([0.4]))
    assert finger.closure_of(np.array([-0.4])) == pytest.approx(-0.5)


@settings(max_examples=40)
@given(st.lists(st.floats(-2, 2), min_size=3, max_size=3))
def test_finger_closure_of_a_position_is_the_nearest(position: list[float]) -> None:
    wanted = np.array(position)
    closure = FINGER.closure_of(wanted)
    assert FINGER.closure_of(FINGER.posture(closure)) == pytest.approx(closure, abs=1e-12)
    nearest = np.linalg.norm(wanted - FINGER.posture(closure))
    others = [np.linalg.norm(wanted - FINGER.posture(c)) for c in np.linspace(-3, 4, 141)]
    assert nearest <= min(others) + 1e-9


def test_finger_speed_and_caps_are_those_of_its_joints() -> None:
    # the last joint moves 0.8 rad over two thirds of the closure
    assert FINGER.fastest(np.array([1.0, 2.0, 0.3])) == pytest.approx(0.3 / 1.2)
    caps = FINGER.caps(4.0)
    np.testing.assert_allclose(caps, [0.15, 0.3, 0.18])
    assert np.isnan(replace(FINGER, lever=[0.0]).caps(4.0)).all()


def test_finger_shortfall_is_of_the_joint_that_comes_closest() -> None:
    wanted = FINGER.posture(0.8)
    halfway = np.array([0.0, wanted[1], 0.1])
    for sent, lacks in ((wanted, 0.0), (FINGER.posture(0.6), 0.2), (halfway, 0.0),
                        (FINGER.posture(0.9), -0.1)):  # fmt: skip
        assert FINGER.shortfall(0.8, np.nan, wanted, sent) == pytest.approx(lacks)


def test_finger_passes_on_the_way_of_a_joint_at_its_limit() -> None:
    finger = load_hand('allegro_v4').fingers['index']
    low, high = np.full(4, -1.0), np.array([1.0, 1.61, 1.7, 1.6])
    inside, beyond = np.array([0.1, 1.6, 0.1, 0.0]), np.array([0.1, 1.7, 0.1, 0.0])
    assert finger.pass_on(inside, low, high) is inside
    made = finger.pass_on(beyond, low, high)
    assert made[1] == high[1]
    assert (made[2:] > beyond[2:]).all()
    assert finger.lever @ made == pytest.approx(finger.lever @ beyond)
    assert finger.pass_on(beyond, low, beyond - 0.1) is beyond  # no joint is left
    stiff = replace(finger, kp=np.zeros(4))  # gains that are not known
    assert stiff.pass_on(beyond, low, high) is beyond


def test_finger_reach_is_that_of_its_weakest_joint() -> None:
    soft = replace(FINGER, kp=[1.0, 1.0, 1.0], torque=[0.0, 0.2, 0.0])
    # 1.3 N m/rad over at most 0.1 rad, or a clip at 0.2 N m, over levers of 50 and 20 mm
    assert soft.reach(np.full(3, -9.0), np.full(3, 9.0), 0.1) == pytest.approx(0.13 / 0.05)
    assert soft.reach(np.full(3, -9.0), np.full(3, 9.0), 0.4) == pytest.approx(0.2 / 0.05)
    assert FINGER.reach(np.full(3, -9.0), np.full(3, 9.0), 0.1) == np.inf
    np.testing.assert_allclose(soft.clipping, [np.inf, 0.95 * 0.2, np.inf])


GOOD = """
driver: joint_trajectory
options: {names: [a, b, c], lower: [0, 0, 0], upper: [1, 1, 1], velocity: [1, 1, 1]}
fingers:
  left: {joints: [a], open: [0.1], pre_grasp: [0.2], closing: [0.5], sensors: [l]}
  right: {joints: [c], open: [0.3], pre_grasp: [0.4], closing: [0.5], sensors: [r, s]}
"""


def document(**change: object) -> dict[str, object]:
    content = yaml.safe_load(GOOD)
    content.update(change)
    return content


@pytest.mark.parametrize('name', list_hands())
def test_load_hand_closes_every_shipped_one(name: str) -> None:
    hand = load_hand(name)
    limits = hand.driver.limits
    for finger, entry in hand.fingers.items():
        place = hand.places(finger)
        assert [hand.driver.joints[i] for i in place] == list(entry.joints)
        # a synergy that leaves the limits would command what the limiter only cuts
        for closure in (0.0, entry.corner, 1.0):
            assert (entry.posture(closure) >= limits.lower[place] - 1e-9).all(), finger
            assert (entry.posture(closure) <= limits.upper[place] + 1e-9).all(), finger
        assert entry.fastest(limits.velocity[place]) > hand.driver.grip().closing_rate


def test_load_hand_takes_a_file(tmp_path: Path) -> None:
    path = tmp_path / 'mine.yaml'
    path.write_text(GOOD)
    hand = load_hand(str(path))
    assert (hand.name, list(hand.fingers)) == ('mine', ['left', 'right'])
    np.testing.assert_array_equal(hand.posture('open', np.full(3, 0.7)), [0.1, 0.7, 0.3])
    np.testing.assert_array_equal(hand.posture('pre_grasp', np.full(3, 0.7)), [0.2, 0.7, 0.4])


def test_with_limits_draws_the_postures_inside() -> None:
    hand = parse('mine', document())
    narrow = JointLimits(np.full(3, 0.25), np.full(3, 0.45), np.full(3, 2.0), np.full(3, np.inf))
    other = hand.with_limits(narrow)
    assert other.fingers['left'].open == pytest.approx([0.25])
    assert other.fingers['left'].pre_grasp == pytest.approx([0.25])
    for finger in other.fingers.values():
        assert finger.posture(1.0) == pytest.approx([0.45])
    assert other.driver.limits.velocity == pytest.approx([2.0] * 3)
    assert other.driver.effort is None
    closed = JointLimits(np.full(3, 0.2), np.full(3, 0.3), np.full(3, 2.0), np.full(3, np.inf))
    with pytest.raises(ValueError, match=r'finger right of hand mine cannot close within \[0.2\]'):
        hand.with_limits(closed)


def test_with_tips_lengthens_levers_where_joints_bend_the_finger() -> None:
    hand = load_hand('allegro_v4')
    hand = hand.driven_by(replace(hand.driver, tip_offset=0.005))
    assert hand.with_tips().fingers['index'].lever == pytest.approx([0.0, 0.121, 0.067, 0.029])
    assert hand.with_tips().fingers['thumb'].lever == pytest.approx([0.015, 0.0, 0.093, 0.042])


def test_narrowed_keeps_limits_that_a_user_drew_in() -> None:
    def limits(low: float, high: float) -> JointLimits:
        return JointLimits(np.array([low, 0.0]), np.array([high, 1.0]), np.ones(2), np.ones(2))

    shipped, described = limits(0.0, 1.0), limits(-0.5, 1.5)
    assert narrowed(described, shipped, shipped).upper[0] == 1.5
    drawn = narrowed(described, limits(0.0, 0.7), shipped)
    assert (drawn.lower[0], drawn.upper[0]) == (-0.5, 0.7)
    assert narrowed(described, limits(-2.0, 9.0), shipped).upper[0] == 1.5


@pytest.mark.parametrize(
    ('name', 'change', 'joint'),
    [
        ('qb_softhand', {'device_id': 7}, 'qbhand7_synergy_joint'),
        ('allegro_v4', {'prefix': 'ahl_'}, 'ahl_joint10'),
        ('joint_trajectory', {'names': ('jaw_a', 'jaw_b')}, 'jaw_a'),
    ],
)
def test_driven_by_renames_joints_by_place(
    name: str, change: dict[str, object], joint: str
) -> None:
    hand = load_hand(name)
    other = hand.driven_by(replace(hand.driver, **change))
    first = next(iter(hand.fingers))
    assert other.fingers[first].joints[0] == joint
    for finger in hand.fingers:
        np.testing.assert_array_equal(other.places(finger), hand.places(finger))
    assert hand.driven_by(hand.driver).fingers == hand.fingers
    if name == 'joint_trajectory':
        with pytest.raises(ValueError, match='do not have right_finger_joint'):
            hand.driven_by(replace(hand.driver, names=('left_finger_joint', 'x')))


LEFT = {'joints': ['a'], 'open': [0.1], 'pre_grasp': [0.2], 'closing': [0.5], 'sensors': ['l']}


@pytest.mark.parametrize(
    ('change', 'sentence'),
    [
        ({'driver': 'none'}, 'driver of a hand must be one of allegro_plexus'),
        ({'driver': ['x']}, 'driver of a hand must be one of'),
        ({'extra': 1}, 'a description of a hand must have none but driver, fingers, options'),
        ({'fingers': {}}, 'fingers of hand mine must be one or more'),
        ({'fingers': [1]}, 'fingers of mine must be a mapping of names'),
        ({'fingers': {'left': {'joints': ['a']}}}, 'finger left must have closing, open'),
        ({'fingers': {'<b>': {}}}, 'finger <b> must have'),
        ({'options': {'speed': 1}}, 'options of mine must have none but .* received speed'),
        ({'options': {'names': ['a', 'b']}}, 'options of mine: lower of JointTrajectoryHand must'),
        ({'options': {'names': 3}}, 'options of mine:'),
        ({'joints': ['x']}, 'finger left of hand mine: joints must be those of the hand'),
        ({'open': [1.5]}, 'open of finger left of hand mine must lie within the limits'),
        ({'open': [0.0, 0.0]}, 'finger left: open of Finger must have one number for each of its'),
        ({'closing': [0.0]}, 'finger left: closing of Finger must move at least one joint'),
        ({'closing': [np.nan]}, 'finger left: closing of Finger must be finite'),
        ({'sensors': ['<b>']}, 'finger left: sensors of Finger must be at most'),
        ({'side': 2}, 'finger left: side of Finger must be a whole number from -1 to 1'),
    ],
)
def test_parse_refuses_in_one_sentence(change: dict[str, object], sentence: str) -> None:
    if not change.keys() <= {'driver', 'extra', 'fingers', 'options'}:
        change = {'fingers': {'left': {**LEFT, **change}}}
    with pytest.raises(ValueError, match='^' + sentence):
        parse('mine', document(**change))


@pytest.mark.parametrize(
    'text', ['{', 'a: &x [*x, *x]', '- 1', 'x' * (MOST_BYTES + 1), '!!python/object:os.system {}']
)
def test_load_hand_refuses_a_hostile_file(text: str, tmp_path: Path) -> None:
    path = tmp_path / 'bad.yaml'
    path.write_text(text)
    with pytest.raises(ValueError, match=r'bad\.yaml'):
        load_hand(str(path))


def test_load_hand_lists_the_hands() -> None:
    with pytest.raises(ValueError, match=r'hand must be one of allegro_plexus.*, or a \.yaml'):
        load_hand('../config/hands/allegro_v4')
    with pytest.raises(ValueError, match='cannot be read'):
        load_hand('/nowhere/hand.yaml')
    assert folder() is not None


@pytest.mark.parametrize('name', ['allegro_v5', 'allegro_v5_pinch'])
def test_a_left_v5_is_the_right_one_in_a_mirror(name: str) -> None:
    """Spreads and thumb turn the other way, and its second joint counts from pi."""
    right, left = load_hand(name), load_hand(f'{name}_left')
    for key, finger in right.fingers.items():
        sign = np.array([-1.0] * 4 if key == 'thumb' else [-1.0, 1.0, 1.0, 1.0])
        offset = np.array([0.0, np.pi if key == 'thumb' else 0.0, 0.0, 0.0])
        for closure in (0.0, finger.corner, 1.0):
            mirrored = sign * finger.posture(closure) + offset
            np.testing.assert_allclose(left.fingers[key].posture(closure), mirrored, atol=1e-4)
        assert left.fingers[key].stiffness == pytest.approx(finger.stiffness)
