# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""The roads from a sensor's frames to a hand's commands: one process, messages, and no ROS at all.

Frames of a real press and postures of a closing gripper are played row by row, each once the last
has been taken in, on a clock that moves with them alone: so every road has the same times.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Protocol

import numpy as np
from rclpy.node import Node
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory

from tactile_ros.hands import load_hand
from tactile_ros.messages import fill_frame, fill_header
from tactile_ros.msg import TactileFrame
from tactile_ros.nodes import lifecycle
from tactile_ros.nodes.contact_node import ContactNode
from tactile_ros.nodes.grip_loop import GripLoop
from tactile_ros.nodes.grip_node import GripNode
from tactile_ros.nodes.lifecycle import qos
from tactile_ros.sensors import load_sensor
from tactile_ros.types import Frame

PERIOD_NS = 10_000_000
ROWS = 150
HAND = 'joint_trajectory'
COMMANDS = '/joint_trajectory_controller/joint_trajectory'


class Ros(Protocol):
    """Nodes of this process, spun until something holds."""

    def init(self, *parameters: str) -> None:
        """Start ROS with parameters `name:=value`."""
        ...

    def add(self, node: Node) -> Node:
        """Spin a node too."""
        ...

    def until(self, holds: Callable[[], object]) -> bool:
        """Spin until a condition holds; False when it did not in time."""
        ...


@dataclass
class Clock:
    """Wall and monotonic clock that stand still between two rows."""

    ns: int = 1_700_000_000_000_000_000

    def monotonic(self) -> float:
        return 1e-9 * (self.ns - 1_699_999_990_000_000_000)


@dataclass
class Press:
    """A real press with a closing hand beside it."""

    values: np.ndarray
    calibration: Path
    first_ns: int = field(default_factory=lambda: Clock().ns)

    def frame(self, row: int) -> Frame:
        return Frame(self.first_ns + (row + 1) * PERIOD_NS, row, self.values[row])

    def posture(self, row: int) -> list[float]:
        return [0.25 + 2e-4 * row, 0.2]


def learnt_press(path: Path) -> Press:
    """A real press, and at `path` a calibration from another."""
    recordings = load_sensor('reskin_board').recordings()
    load_sensor('reskin_board').pipeline(estimator='ridge').fit(recordings['normal_1']).save(path)
    return Press(recordings['normal_2'].values[: ROWS + 1], path)


class User(Node):
    """Plays frames and postures, hears commands."""

    def __init__(self) -> None:
        super().__init__('user')
        self.frames = self.create_publisher(TactileFrame, 'left/frame', qos())
        self.joints = self.create_publisher(JointState, '/joint_states', 10)
        self.commands: list[JointTrajectory] = []
        self.create_subscription(JointTrajectory, COMMANDS, self.commands.append, qos())


def lived(ros: Ros, press: Press, clock: Clock, direct: bool) -> np.ndarray:
    """Commands of a live road, shape (s, j): one process, or messages from node to node."""
    ros.init(
        f'hand:={HAND}', 'fingers:=[left]', f'calibration:={press.calibration}',
        'allow_tare_in_contact:=true',
    )  # fmt: skip
    grip, user = ros.add(GripNode()), ros.add(User())
    own = ['-r', '__ns:=/left']
    contact = ros.add(ContactNode(direct, grip.take_states if direct else None, own))
    grip.direct = {contact.topic} if direct else set()
    grip.now_ns = lambda: clock.ns
    lifecycle.start([grip, contact])
    assert grip.count_subscribers('/left/contacts') == (0 if direct else 1)
    assert ros.until(lambda: grip._diagnosed.steps and not grip._link.refusal)
    if not direct:
        assert ros.until(user.frames.get_subscription_count)
        assert ros.until(contact._contacts.get_subscription_count)
    grip._loop.grasp(2.0, (), 0.0, True)
    for row in range(ROWS):
        clock.ns = press.first_ns + (row + 1) * PERIOD_NS
        told(ros, user, grip, press.posture(row), clock.ns)
        frame = press.frame(row)
        if direct:
            contact.take([frame], 'left')
        else:
            message = TactileFrame()
            fill_frame(message, frame, 'left')
            user.frames.publish(message)
        assert ros.until(partial(has_taken, grip, row))
    assert ros.until(lambda: len(user.commands) == grip._diagnosed.commands)
    return np.array([message.points[0].positions for message in user.commands])


def told(ros: Ros, user: User, grip: GripNode, posture: list[float], stamp_ns: int) -> None:
    """The grip knows where the hand is."""
    message = JointState(name=['left_finger_joint', 'right_finger_joint'], position=posture)
    fill_header(message.header, stamp_ns, '')
    assert ros.until(user.joints.get_subscription_count)
    user.joints.publish(message)

    def known() -> bool:
        measured = grip._loop._measured
        return measured is not None and measured.tolist() == posture

    assert ros.until(known)


def has_taken(grip: GripNode, row: int) -> bool:
    """The grip has heard the finger of a row."""
    return grip._sequences.get('/left/contacts') == row


def offline(press: Press) -> np.ndarray:
    """Commands without ROS, shape (s, j)."""
    hand = load_hand(HAND)
    stage = GripLoop(hand, hand.grip(), ('left',))
    pipeline = load_sensor('reskin_board').load(press.calibration)
    stage.enable()
    stage.grasp(2.0, (), 0.0, True)
    sent = []
    for row in range(ROWS):
        at = 10.0 + 1e-9 * PERIOD_NS * row
        frame = press.frame(row)
        state = pipeline.process(frame)
        stage.take_joints(np.array(press.posture(row)), at)
        covariance = state.force_cov.ravel().tolist()
        told = state.force.tolist(), bool(state.valid), int(state.slip), at, None, covariance
        stage.take_touch([0], *told)
        decision = stage.step(at, frame.stamp_ns, '', 1e-9 * PERIOD_NS)
        if decision.command is not None:
            sent.append(decision.command.position)
    return np.array(sent)
