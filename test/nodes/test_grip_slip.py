"""A real recording of a slip through the whole graph raises the grip; that of a hold does not.

The board's bytes come through a pseudo-terminal to the driver in sensor_node, contact_node tells
slip, grip_node raises the command, and the fake hand moves. The recordings tell slip and no force,
so that the normal force beside it is that of a spring in the way of the fake hand. What is real is
the field that says slip.
"""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

import numpy as np
import pytest
from rclpy.action import ActionClient
from rclpy.node import Node
from std_srvs.srv import Trigger

from tactile_ros.action import Grasp
from tactile_ros.control import GripPhase
from tactile_ros.devices.reskin_protocol import encode
from tactile_ros.msg import GripState, TactileContacts
from tactile_ros.nodes import lifecycle
from tactile_ros.nodes.contact_node import ContactNode
from tactile_ros.nodes.grip_node import GripNode
from tactile_ros.nodes.lifecycle import data
from tactile_ros.nodes.mock_hand import MockHandNode
from tactile_ros.nodes.sensor_node import SensorNode
from tactile_ros.sensors import load_sensor

if TYPE_CHECKING:
    from pathlib import Path

    from conftest import Ros

    from tactile_ros.devices.simulated_serial import SimulatedSerialPort
    from tactile_ros.types import Recording

STIFFNESS, CONTACT_AT = 40.0, 0.3  # N per closure; closure
LEARNT = 72  # pulls that are fitted; the others are unseen
PERIOD_S = 0.01  # as recorded
TARE_ROWS = 10


@pytest.fixture(scope='module')
def pulls() -> Recording:
    return load_sensor('reskin_board').recordings()['slip']


@pytest.fixture(scope='module')
def slip_calibration(pulls: Recording, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp('slip') / 'slip.npz'
    sensor = load_sensor('reskin_board')
    config = dataclasses.replace(sensor.config(), positions=pulls.layout.positions)
    learnt = np.isin(pulls.stream, np.unique(pulls.stream)[:LEARNT])
    sensor.pipeline(config, 'ridge').fit(pulls.select(learnt)).save(path)
    return path


def pull_of(pulls: Recording, slips: bool) -> np.ndarray:
    """Readings of the first unseen pull that slips, or that holds."""
    for stream in np.unique(pulls.stream)[LEARNT:]:
        one = pulls.select(pulls.stream == stream)
        if bool((one.truth['slip'] == 1).any()) == slips:
            return one.values
    raise AssertionError(slips)


class Finger(Node):
    """A board that sends a pull, and contacts that go on with the force of a spring."""

    def __init__(self, rows: np.ndarray, hand: MockHandNode, port: SimulatedSerialPort) -> None:
        super().__init__('finger')
        self.rows, self.row, self.runs = rows, 0, True
        self.hand, self.port = hand, port
        self.contacts: list[TactileContacts] = []
        self.states: list[GripState] = []
        self.felt = self.create_publisher(TactileContacts, 'left/contacts', data())
        self.create_subscription(TactileContacts, 'contacts', self.hand_on, data())
        self.create_subscription(GripState, 'grip_node/state', self.states.append, 10)
        self.tare = self.create_client(Trigger, 'contact_node/tare')
        self.grasp = ActionClient(self, Grasp, 'grip_node/grasp')
        self.create_timer(PERIOD_S, self.send)

    def send(self) -> None:
        """Bytes of the next row; the last of the tare again until the pull may begin."""
        self.port.send(encode(self.rows[self.row]))
        last = len(self.rows) if self.runs else TARE_ROWS
        self.row = min(self.row + 1, last - 1)

    def hand_on(self, message: TactileContacts) -> None:
        """Contacts with the force that the recording does not have."""
        self.contacts.append(message)
        hand = self.hand._hand
        closure = hand.fingers['left'].closure_of(self.hand.joints.position[hand.places('left')])
        message.wrench.force.x = message.wrench.force.y = 0.0
        message.wrench.force.z = STIFFNESS * max(0.0, closure - CONTACT_AT)
        self.felt.publish(message)


@pytest.mark.parametrize('slips', [True, False])
def test_a_real_slip_raises_the_grip(
    ros: Ros, pulls: Recording, port: SimulatedSerialPort, slip_calibration: Path, slips: bool
) -> None:
    places = ', '.join(f'{place:.6f}' for place in pulls.layout.positions.ravel())
    ros.init(
        'hand:=joint_trajectory', 'fingers:=[left]', f'calibration:={slip_calibration}',
        f'port:={port.port}', f'positions:=[{places}]', 'discard_stale:=false', 'rate_hz:=100.0',
        'tare_frames:=10', 'allow_tare_in_contact:=true', 'stiffness_high:=41.0',
        'stale_after:=0.5',
    )  # fmt: skip
    nodes = MockHandNode(), SensorNode(), ContactNode(), GripNode()
    for node in nodes:
        ros.add(node)
    mock, grip = nodes[0], nodes[-1]
    lifecycle.start(list(nodes))
    port.wait_for_reader()
    finger = ros.add(Finger(pull_of(pulls, slips), mock, port))
    finger.runs = False
    assert ros.until(lambda: finger.row == TARE_ROWS - 1 and not grip.unheard)
    assert ros.call(finger.tare, Trigger.Request()).success
    assert ros.until(finger.grasp.server_is_ready)
    sent = finger.grasp.send_goal_async(Grasp.Goal(target_force=2.0, adapt=True))
    assert ros.until(sent.done)
    ended = sent.result().get_result_async()
    assert ros.until(ended.done)
    assert ended.result().result.outcome == Grasp.Result.HELD
    before = finger.states[-1]
    held = mock.joints.position[0]
    finger.contacts.clear()
    finger.runs = True
    assert ros.until(lambda: finger.row == len(finger.rows) - 1)
    assert ros.until(lambda: len(finger.contacts) >= 0.95 * len(finger.rows))
    assert any(message.slip == 1 for message in finger.contacts) == slips
    after = finger.states[-1]
    assert after.phase == GripPhase.HOLD
    raised = after.target_force[0] / before.target_force[0]
    assert (raised > 1.2) == slips
    assert (after.command[0] > before.command[0] + 0.003) == slips
    assert (mock.joints.position[0] > held + 0.003) == slips
    if not slips:
        assert raised == pytest.approx(1.0)
