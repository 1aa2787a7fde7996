"""A real recording of a slip through contact_node and grip_node raises the grip; a hold does not.

The recordings tell slip and no force, so that the normal force beside it is that of a spring in
the way of the fake hand. What is real is the field that says slip.
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
from tactile_ros.messages import fill_frame
from tactile_ros.msg import GripState, TactileContacts, TactileFrame
from tactile_ros.nodes import lifecycle
from tactile_ros.nodes.contact_node import ContactNode
from tactile_ros.nodes.grip_node import GripNode
from tactile_ros.nodes.mock_hand import MockHandNode
from tactile_ros.nodes.quality import data
from tactile_ros.sensors import load_sensor
from tactile_ros.types import Frame

if TYPE_CHECKING:
    from pathlib import Path

    from conftest import Ros

    from tactile_ros.types import Recording

STIFFNESS, CONTACT_AT = 40.0, 0.3  # N per closure; closure
LEARNT = 72  # pulls that are fitted; the others are unseen
PERIOD_S = 0.005
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
    """Plays a pull into contact_node, and hands its contacts on with the force of a spring."""

    def __init__(self, rows: np.ndarray, hand: MockHandNode) -> None:
        super().__init__('finger')
        self.rows, self.row, self.runs = rows, 0, True
        self.hand, self.sequence = hand, 0
        self.contacts: list[TactileContacts] = []
        self.states: list[GripState] = []
        self.frames = self.create_publisher(TactileFrame, 'frame', data())
        self.felt = self.create_publisher(TactileContacts, 'left/contacts', data())
        self.create_subscription(TactileContacts, 'contacts', self.hand_on, data())
        self.create_subscription(GripState, 'grip_node/state', self.states.append, 10)
        self.tare = self.create_client(Trigger, 'contact_node/tare')
        self.grasp = ActionClient(self, Grasp, 'grip_node/grasp')
        self.create_timer(PERIOD_S, self.play)

    def play(self) -> None:
        """Next row; the last of the tare again and again until the pull may begin."""
        message = TactileFrame()
        stamp_ns = 1_000_000_000 + 10_000_000 * self.sequence
        fill_frame(message, Frame(stamp_ns, self.sequence, self.rows[self.row]), 'left')
        self.frames.publish(message)
        self.sequence += 1
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
    ros: Ros, pulls: Recording, slip_calibration: Path, slips: bool
) -> None:
    ros.init(
        'hand:=joint_trajectory', 'fingers:=[left]', f'calibration:={slip_calibration}',
        'tare_frames:=10', 'allow_tare_in_contact:=true', 'stiffness_high:=41.0',
        'stale_after:=0.5',
    )  # fmt: skip
    mock, contact, grip = ros.add(MockHandNode()), ros.add(ContactNode()), ros.add(GripNode())
    lifecycle.start([mock, contact, grip])
    finger = ros.add(Finger(pull_of(pulls, slips), mock))
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
    finger.contacts.clear()
    finger.runs = True
    assert ros.until(lambda: finger.row == len(finger.rows) - 1)
    assert any(message.slip == 1 for message in finger.contacts) == slips
    after = finger.states[-1]
    assert after.phase == GripPhase.HOLD
    raised = after.target_force[0] / before.target_force[0]
    assert (raised > 1.2) == slips
    assert (after.command[0] > before.command[0] + 0.003) == slips
    if not slips:
        assert raised == pytest.approx(1.0)
