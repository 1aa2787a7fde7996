# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Interfaces of the drivers, letter for letter: topic, type, count, order, limits."""

from types import SimpleNamespace

import numpy as np
import pytest

from tactile_ros.hands import load_driver, load_hand
from tactile_ros.hands.drivers import TRAJECTORY, in_order, read_command, read_joint_states
from tactile_ros.nodes.mock_hand_node import MockHand
from tactile_ros.types import GripCommand

NUMBERS = 'std_msgs/msg/Float64MultiArray'
THUMB_FIRST = [f'ah_joint{finger}{joint}' for finger in '0123' for joint in '0123']
INDEX_FIRST = [f'joint_{i}_0' for i in range(16)]
ACTIVATE, START = 'ros2 control switch_controllers --activate ', 'start the driver of the hand, or'
# hand: command topics with their types, state topic, joints, most commands a second, description
INTERFACES = {
    'allegro_v4': (
        [('/allegro_hand_position_controller/commands', NUMBERS)],
        '/joint_states', THUMB_FIRST, 100.0, 'robot_description',
    ),
    'allegro_plexus': (
        [
            ('/allegro_hand_position_effort_controller/efforts', NUMBERS),
            ('/allegro_hand_position_effort_controller/commands', NUMBERS),
        ],
        '/joint_states', THUMB_FIRST, 100.0, 'robot_description',
    ),
    'allegro_v5': (
        [('/allegroHand_0/joint_cmd', 'sensor_msgs/msg/JointState')],
        '/allegroHand_0/joint_states', INDEX_FIRST, 333.0, '/allegro_hand_description',
    ),
    'allegro_v5_sense': (
        [('/allegroHand_0/joint_cmd', 'sensor_msgs/msg/JointState')],
        '/allegroHand_0/joint_states', INDEX_FIRST, 333.0,
        '/allegroHand_0/allegro_hand_description',
    ),
    'qb_softhand': (
        [('/qbhand1/qbhand1_synergy_trajectory_controller/joint_trajectory',
          'trajectory_msgs/msg/JointTrajectory')],
        '/qbhand1/joint_states', ['qbhand1_synergy_joint'], 25.0, 'robot_description',
    ),
    'qb_softhand_2m': (
        [('/qbhand2m1/qbhand2m1_synergies_trajectory_controller/joint_trajectory',
          'trajectory_msgs/msg/JointTrajectory')],
        '/qbhand2m1/joint_states',
        ['qbhand2m1_synergy_joint', 'qbhand2m1_manipulation_joint'], 25.0, 'robot_description',
    ),
    'joint_trajectory': (
        [('/joint_trajectory_controller/joint_trajectory', 'trajectory_msgs/msg/JointTrajectory')],
        '/joint_states', ['left_finger_joint', 'right_finger_joint'], 250.0, 'robot_description',
    ),
}  # fmt: skip


def blank() -> SimpleNamespace:
    """Something that has the attributes of every message."""
    header = SimpleNamespace(stamp=SimpleNamespace(sec=0, nanosec=0), frame_id='')
    duration = SimpleNamespace(sec=0, nanosec=0)
    point = SimpleNamespace(positions=[], time_from_start=duration)
    return SimpleNamespace(
        header=header, name=[], position=[], data=[], joint_names=[], points=[point]
    )


def command(count: int, effort: float = np.nan) -> GripCommand:
    return GripCommand(3_000_000_007, np.arange(count) / 100, np.full(count, effort))


@pytest.mark.parametrize('name', INTERFACES)
def test_drivers_topics_types_order_and_rate(name: str) -> None:
    topics, states, joints, rate, description = INTERFACES[name]
    driver = load_hand(name).driver
    assert [(topic.name, topic.kind) for topic in driver.topics] == topics
    assert driver.states == states
    assert list(driver.joints) == joints
    assert driver.fastest_hz == rate
    assert driver.grip().rate_hz <= rate
    assert driver.description == description
    controller = topics[-1][0].split('/')[1]
    advice = ACTIVATE + controller if driver.controller else START
    assert driver.remedy.startswith(advice)
    assert ('--deactivate allegro_hand_position_controller' in driver.remedy) == (
        name == 'allegro_plexus'
    )
    mine = type(driver)(command_topic='/my/command', state_topic='/my/states')
    assert (mine.topics[-1].name, mine.states) == ('/my/command', '/my/states')


@pytest.mark.parametrize(('rate_hz', 'horizon_s'), [(25.0, 0.08), (100.0, 0.02), (250.0, 0.02)])
def test_paced_keeps_a_joint_moving_until_the_next_point(rate_hz: float, horizon_s: float) -> None:
    hand = load_hand('joint_trajectory').paced(rate_hz)
    message, driver = blank(), hand.driver
    joints = MockHand(driver.limits, np.zeros(2))
    moved = []
    for step in range(1, 21):
        driver.fill(message, GripCommand(0, np.full(2, 0.01 * step), np.full(2, np.nan)))
        joints.command(*read_command(TRAJECTORY, message, driver.joints))
        for _ in range(4):  # parts of a period
            before = joints.position
            moved.append((joints.step(0.25 / rate_hz) - before)[0])
    assert message.points[0].time_from_start.nanosec == round(1e9 * horizon_s)
    # a target that is reached before the next comes lets the joint stand for half of a period
    assert min(moved[40:]) > 0.5 * max(moved[40:]) > 0.0


def test_allegro_plexus_caps_no_higher_than_its_driver_allows() -> None:
    driver = load_hand('allegro_plexus').driver
    for effort, sent in ((0.1, 0.1), (np.nan, 0.345), (5.0, 0.345), (-1.0, 0.0)):
        message = blank()
        driver.fill_caps(message, command(16, effort))
        np.testing.assert_allclose(message.data, sent)


@pytest.mark.parametrize(
    ('name', 'joint', 'low', 'high'),
    [
        ('allegro_v4', 0, 0.263, 1.396), ('allegro_v5', 0, -0.47, 0.47),
        ('allegro_v5', 12, 0.0, 1.78), ('allegro_v5_sense', 0, -0.7, 0.262),
        ('allegro_v5_sense', 8, -0.262, 0.7), ('qb_softhand_2m', 1, -1.0, 1.0),
    ],
)  # fmt: skip
def test_drivers_limits(name: str, joint: int, low: float, high: float) -> None:
    limits = load_hand(name).driver.limits
    assert (limits.lower[joint], limits.upper[joint]) == (low, high)


@pytest.mark.parametrize(
    ('name', 'change', 'sentence'),
    [
        ('allegro_v4', {'lower': [0.0]}, r'lower of AllegroV4 must have shape \(16,\)'),
        ('allegro_v5', {'upper': [-2.0] * 16}, 'lower of JointLimits must be below upper'),
        ('allegro_v5', {'effort': [-0.5] * 16}, 'effort of AllegroV5 must be finite and from'),
        ('qb_softhand', {'motors': 2}, 'lower of QbSoftHand must have one number for each of its'),
        ('qb_softhand', {'upper': [1.5]}, 'upper of QbSoftHand must be finite and from -1'),
        ('joint_trajectory', {'names': ('a;b',)}, 'a joint of JointTrajectoryHand must be'),
    ],
)
def test_drivers_refuse_in_one_sentence(
    name: str, change: dict[str, object], sentence: str
) -> None:
    with pytest.raises(ValueError, match='^' + sentence):
        load_driver(name)(**change)


@pytest.mark.parametrize(
    ('names', 'position', 'sentence'),
    [
        (['elbow', 'b', 'a'], [9.0, 2.0, 1.0], ''),
        (['a'], [1.0], 'must be of all joints of the hand; b is missing'),
        (['a', 'b'], [1.0], 'must have one position for each of 2 names'),
        (['a', 'b'], [1.0, float('nan')], 'must be finite'),
    ],
)
def test_read_joint_states_by_name(names: list[str], position: list[float], sentence: str) -> None:
    message = SimpleNamespace(name=names, position=position)
    if sentence:
        with pytest.raises(ValueError, match=sentence):
            read_joint_states(message, ('a', 'b'))
    else:
        np.testing.assert_array_equal(read_joint_states(message, ('a', 'b')), [1.0, 2.0])
        assert read_joint_states(message, ('x', 'y')) is None


@pytest.mark.parametrize('name', INTERFACES)
def test_read_command_takes_what_fill_writes(name: str) -> None:
    driver = load_hand(name).driver
    wanted, names = command(len(driver.joints), 0.2), list(driver.joints)
    for topic in driver.topics:
        message = blank()
        topic.fill(message, wanted)
        values, horizon_s = read_command(topic.kind, message, driver.joints)
        effort = topic.name.endswith('efforts')
        np.testing.assert_array_equal(values, wanted.effort if effort else wanted.position)
        stamp = message.header.stamp.sec, message.header.stamp.nanosec
        is_state = topic.kind == 'sensor_msgs/msg/JointState'
        assert stamp == ((3, 7) if is_state else (0, 0))  # a trajectory begins now
        assert message.name == (names if is_state else [])
        assert message.joint_names == (names if topic.kind == TRAJECTORY else [])
        if topic.kind == TRAJECTORY:
            assert horizon_s == pytest.approx(driver.horizon_s)
            assert 0.08 <= horizon_s <= 0.2 or not name.startswith('qb')


def test_in_order_names_the_missing() -> None:
    np.testing.assert_array_equal(in_order(('a', 'b', 'c'), ('c', 'a')), [2, 0])
    with pytest.raises(ValueError, match='do not have x'):
        in_order(('a', 'b'), ('a', 'x'))
    with pytest.raises(ValueError, match='name one twice'):
        in_order(('a', 'b'), ('a', 'a'))
