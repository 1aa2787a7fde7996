"""One process: the collector is frozen once warm; contacts come without a frame on the wire.

With a hand the grip is part of it, and decides the same numbers as over DDS and without ROS.
"""

from __future__ import annotations

import gc
from dataclasses import dataclass, field
from functools import partial
from types import SimpleNamespace
from typing import TYPE_CHECKING

import numpy as np
import pytest
from rclpy.node import Node
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory

from tactile_ros.devices.packets import encode
from tactile_ros.hands import load_hand
from tactile_ros.messages import fill_frame, fill_header
from tactile_ros.msg import TactileContacts, TactileFrame
from tactile_ros.nodes import grip_node, lifecycle, stack
from tactile_ros.nodes.contact_node import ContactNode
from tactile_ros.nodes.grip_node import GripNode
from tactile_ros.nodes.grip_stage import GripStage
from tactile_ros.nodes.quality import data
from tactile_ros.sensors import load_sensor
from tactile_ros.types import Frame

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from conftest import Ros

    from tactile_ros.devices.simulated import SimulatedSerialPort

PERIOD_NS = 10_000_000
ROWS = 150
HAND = 'joint_trajectory'
COMMANDS = '/joint_trajectory_controller/joint_trajectory'


@pytest.fixture
def collector() -> Iterator[None]:
    gc.unfreeze()
    yield
    gc.unfreeze()


@pytest.mark.usefixtures('collector')
def test_the_collector_is_frozen_once_warm() -> None:
    taken = []
    step = stack.frozen_after(lambda frame, name: taken.append((frame.sequence, name)), frames=3)
    for k in range(2):
        step(Frame(k, k, np.zeros((1, 1))), 'thumb')
    assert gc.get_freeze_count() == 0
    step(Frame(2, 2, np.zeros((1, 1))), 'thumb')
    assert gc.get_freeze_count() > 0
    assert taken == [(0, 'thumb'), (1, 'thumb'), (2, 'thumb')]


@pytest.mark.usefixtures('collector')
def test_contacts_without_a_frame_on_the_wire(
    ros: Ros, port: SimulatedSerialPort, calibration: Path, rows: np.ndarray
) -> None:
    ros.init(f'port:={port.port}', f'calibration:={calibration}')
    contact, sensor = (ros.add(node) for node in stack.build())
    listener = ros.add(Node('listener'))
    heard: list[TactileContacts] = []
    listener.create_subscription(TactileContacts, 'contacts', heard.append, data())
    lifecycle.start([contact, sensor])
    waiting = iter(rows)
    assert ros.until(lambda: heard or port.send(encode(next(waiting))))
    for _ in range(10):
        port.send(encode(next(waiting)))
    assert ros.until(lambda: len(heard) > 10)
    sequence = [message.sequence for message in heard]
    assert sequence == list(range(sequence[0], sequence[0] + len(heard)))
    assert listener.count_subscribers('frame') == 0


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


@pytest.fixture(scope='module')
def press(tmp_path_factory: pytest.TempPathFactory) -> Press:
    recordings = load_sensor('reskin_board').recordings()
    path = tmp_path_factory.mktemp('force') / 'force.npz'
    learnt = recordings['normal_1']
    load_sensor('reskin_board').pipeline(estimator='ridge').fit(learnt).save(path)
    played = recordings['normal_2'].values
    return Press(played[: ROWS + 1], path)


class User(Node):
    """Plays frames and postures, hears commands."""

    def __init__(self) -> None:
        super().__init__('user')
        self.frames = self.create_publisher(TactileFrame, 'left/frame', data())
        self.joints = self.create_publisher(JointState, '/joint_states', 10)
        self.commands: list[JointTrajectory] = []
        self.create_subscription(JointTrajectory, COMMANDS, self.commands.append, data())


def lived(ros: Ros, press: Press, clock: Clock, direct: bool) -> np.ndarray:
    """Commands of a live road, shape (s, j): one process, or messages from node to node."""
    ros.init(
        f'hand:={HAND}', 'fingers:=[left]', f'calibration:={press.calibration}',
        'allow_tare_in_contact:=true',
    )  # fmt: skip
    grip, user = ros.add(GripNode()), ros.add(User())
    own = ['-r', '__ns:=/left']
    contact = ros.add(ContactNode(direct, grip.take_state if direct else None, own))
    grip.direct = {contact.topic} if direct else set()
    grip.now_ns = lambda: clock.ns
    lifecycle.start([grip, contact])
    assert grip.count_subscribers('/left/contacts') == (0 if direct else 1)
    assert ros.until(lambda: grip._steps and user.count_publishers(COMMANDS))
    if not direct:
        assert ros.until(user.frames.get_subscription_count)
        assert ros.until(contact._contacts.get_subscription_count)
    grip._stage.grasp(2.0, (), 0.0, True)
    for row in range(ROWS):
        clock.ns = press.first_ns + (row + 1) * PERIOD_NS
        told(ros, user, grip, press.posture(row), clock.ns)
        frame = press.frame(row)
        if direct:
            contact.take(frame, 'left')
        else:
            message = TactileFrame()
            fill_frame(message, frame, 'left')
            user.frames.publish(message)
        assert ros.until(partial(has_taken, grip, row))
    assert ros.until(lambda: len(user.commands) == grip._commands)
    return np.array([message.points[0].positions for message in user.commands])


def told(ros: Ros, user: User, grip: GripNode, posture: list[float], stamp_ns: int) -> None:
    """The grip knows where the hand is."""
    message = JointState(name=['left_finger_joint', 'right_finger_joint'], position=posture)
    fill_header(message.header, stamp_ns, '')
    assert ros.until(user.joints.get_subscription_count)
    user.joints.publish(message)

    def known() -> bool:
        measured = grip._stage._measured
        return measured is not None and measured.tolist() == posture

    assert ros.until(known)


def has_taken(grip: GripNode, row: int) -> bool:
    """The grip has heard the finger of a row."""
    return grip._sequences.get('/left/contacts') == row


def offline(press: Press) -> np.ndarray:
    """Commands without ROS, shape (s, j)."""
    hand = load_hand(HAND)
    stage = GripStage(hand, hand.driver.grip(), ('left',))
    pipeline = load_sensor('reskin_board').load(press.calibration)
    stage.enable()
    stage.grasp(2.0, (), 0.0, True)
    sent = []
    for row in range(ROWS):
        at = 10.0 + 1e-9 * PERIOD_NS * row
        frame = press.frame(row)
        state = pipeline.process(frame)
        stage.take_joints(np.array(press.posture(row)), at)
        stage.take_touch(0, state.force.tolist(), bool(state.valid), int(state.slip), at)
        decision = stage.step(at, frame.stamp_ns, '', 1e-9 * PERIOD_NS)
        if decision.command is not None:
            sent.append(decision.command.position)
    return np.array(sent)


@pytest.mark.parametrize('direct', [True, False])
def test_every_road_commands_the_same(
    ros: Ros, press: Press, monkeypatch: pytest.MonkeyPatch, direct: bool
) -> None:
    clock = Clock()
    monkeypatch.setattr(grip_node, 'time', SimpleNamespace(monotonic=clock.monotonic))
    live = lived(ros, press, clock, direct)
    alone = offline(press)
    assert len(live) == len(alone) == ROWS
    assert np.ptp(live, axis=0)[0] > 0.02
    np.testing.assert_allclose(live, alone, rtol=0, atol=1e-9)


def test_the_nodes_of_a_hand_have_the_names_of_the_processes(ros: Ros) -> None:
    ros.init(f'hand:={HAND}', 'seed:=3', 'sensor:=gradiometer', 'source:=simulated')
    nodes = [ros.add(node) for node in stack.build()]
    names = [node.get_fully_qualified_name() for node in nodes]
    assert names == [
        '/grip_node', '/left/contact_node', '/right/contact_node',
        '/left/sensor_node', '/right/sensor_node',
    ]  # fmt: skip
    assert [node.get_parameter('seed').value for node in nodes[3:]] == [3, 4]
    assert nodes[0].direct == {'/left/contacts', '/right/contacts'}
    lifecycle.start(nodes)
    listener = ros.add(Node('listener'))
    assert ros.until(lambda: not nodes[0].unheard or nodes[0].unheard == ['joint states'])
    assert listener.count_subscribers('/left/contacts') == 0
