# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Twins that a fake hand presses: readings over force, ports that come and go."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from rclpy.node import Node
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from tactile_ros.nodes import lifecycle
from tactile_ros.nodes.mock_hand_node import ClosedLoopTwins, MockHandNode, PressTable
from tactile_ros.sensors import load_sensor

if TYPE_CHECKING:
    from pathlib import Path

    from conftest import Ros

V4 = '/allegro_hand_position_controller/commands'
PLEXUS = '/allegro_hand_position_effort_controller/commands'
QB = '/qbhand1/qbhand1_synergy_trajectory_controller/joint_trajectory'
# of the index finger's last three joints, in the driver's order thumb, index, middle, ring
BENT = [0.3, 0.0, 0.0, 0.0, 0.0, 0.5, 0.4, 0.3, *[0.0] * 8]


def begin(ros: Ros, hand: str, *parameters: str) -> tuple[MockHandNode, Node, list[JointState]]:
    """A fake, somebody who commands it, and its joint states."""
    ros.init(f'hand:={hand}', *parameters)
    mock = ros.add(MockHandNode())
    lifecycle.start([mock])
    user = ros.add(Node('user'))
    states: list[JointState] = []
    user.create_subscription(JointState, mock._driver.states, states.append, 10)
    assert ros.until(lambda: states)
    return mock, user, states


def test_positions_arrive_by_the_order_of_the_controller(ros: Ros) -> None:
    joints = [f'ah_joint{f}{j}' for f in range(4) for j in range(4)]
    order = joints[4:] + joints[:4]
    mock, user, states = begin(ros, 'allegro_v4', f'order:=[{", ".join(order)}]')
    commands = user.create_publisher(Float64MultiArray, V4, 1)
    assert ros.until(commands.get_subscription_count)
    commands.publish(Float64MultiArray(data=BENT[4:] + BENT[:4]))
    wanted = dict(zip(joints, BENT, strict=True))

    def arrived() -> bool:
        found = dict(zip(states[-1].name, states[-1].position, strict=True))
        return all(abs(found[name] - wanted[name]) < 1e-3 for name in joints)

    assert ros.until(arrived)
    assert mock.refused == 0


@pytest.mark.parametrize(('hand', 'topic'), [('allegro_v4', V4), ('allegro_plexus', PLEXUS)])
def test_a_command_of_the_wrong_size_is_refused_and_silences_a_plexus(
    ros: Ros, hand: str, topic: str
) -> None:
    mock, user, states = begin(ros, hand)
    commands = user.create_publisher(Float64MultiArray, topic, 1)
    assert ros.until(commands.get_subscription_count)
    commands.publish(Float64MultiArray(data=[0.1] * 15))
    assert ros.until(lambda: mock.refused == 1)
    steps = mock.joints.steps
    assert ros.until(lambda: mock.joints.steps > steps + 5)
    count = len(states)
    assert ros.until(lambda: mock.joints.steps > steps + 25)
    assert (len(states) > count + 5) == (hand == 'allegro_v4')


def test_a_point_is_reached_at_its_time_and_a_stranger_is_refused(ros: Ros) -> None:
    mock, user, states = begin(ros, 'qb_softhand', 'dead_time_s:=0.1')
    commands = user.create_publisher(JointTrajectory, QB, 1)
    assert ros.until(commands.get_subscription_count)
    point = JointTrajectoryPoint(positions=[0.2])
    point.time_from_start.nanosec = 200_000_000
    commands.publish(JointTrajectory(joint_names=['other'], points=[point]))
    assert ros.until(lambda: mock.refused == 1)
    commands.publish(JointTrajectory(joint_names=['qbhand1_synergy_joint'], points=[point]))
    assert ros.until(lambda: states[-1].position[0] == pytest.approx(0.2, abs=1e-3))
    # 25 Hz, 0.1 s dead time and 0.2 s of motion: two states at rest, then four on the way
    track = np.array([state.position[0] for state in states])
    moving = np.flatnonzero((track > 1e-6) & (track < 0.199))
    assert 3 <= len(moving) <= 5


@pytest.mark.parametrize(
    ('fault', 'count', 'finite'), [('partial', 15, True), ('nan', 16, False), ('frozen', 16, True)]
)
def test_faults_are_those_that_were_asked_for(
    ros: Ros, fault: str, count: int, finite: bool
) -> None:
    mock, _, states = begin(ros, 'allegro_v5')
    assert mock.set_parameters([Parameter('fault', value=fault)])[0].successful
    seen = len(states)
    assert ros.until(lambda: len(states) > seen + 5)
    assert len(states[-1].name) == len(states[-1].position) == count
    assert bool(np.isfinite(states[-1].position).all()) == finite


def test_an_unknown_fault_is_refused_and_a_silent_hand_is_silent(ros: Ros) -> None:
    mock, _, states = begin(ros, 'allegro_v5')
    assert not mock.set_parameters([Parameter('fault', value='fire')])[0].successful
    assert mock.set_parameters([Parameter('fault', value='silent')])[0].successful
    steps = mock.joints.steps
    assert ros.until(lambda: mock.joints.steps > steps + 5)
    count = len(states)
    assert ros.until(lambda: mock.joints.steps > steps + 25)
    assert len(states) == count
    assert mock.diagnose().message == 'a fake of allegro_v5'


def test_a_port_appears_at_its_path_and_a_press_is_on_it(tmp_path: Path) -> None:
    port = tmp_path / 'thumb'
    spec = load_sensor('reskin_board')
    table = PressTable(spec.presses(spec.config(), 0))
    np.testing.assert_allclose(table.at(-1.0), table.at(0.0))
    np.testing.assert_allclose(table.at(1e9), table.at(table.force[-1]))
    with ClosedLoopTwins('reskin_board', [str(port)], seed=3) as pressed:
        assert port.is_symlink()
        readings = []
        for force in (0.0, 5.0):
            pressed.force[0] = force
            with pressed.twins[0].device(lambda: 0) as device:
                device.read(1.0)
                readings.append(device.read(1.0).values)
    assert np.abs(readings[1] - readings[0]).max() > 1e-5
    assert readings[0].shape == spec.layout(spec.config()).shape
    assert not port.is_symlink()


def test_a_sensor_without_a_port_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="must have a serial port; received 'magnet_pad'"):
        ClosedLoopTwins('magnet_pad', [str(tmp_path / 'x')])
