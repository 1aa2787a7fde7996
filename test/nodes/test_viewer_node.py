"""What a viewer hears of running nodes: frames with their own contacts, and the grip."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from geometry_msgs.msg import Point, Quaternion
from rclpy.node import Node

from tactile_ros import messages
from tactile_ros.msg import GripState, TactileContact, TactileContacts, TactileFrame, TactileLayout
from tactile_ros.nodes.lifecycle import qos
from tactile_ros.nodes.viewer_node import WAITING, ViewerNode
from tactile_ros.types import ContactState, Frame, Layout

if TYPE_CHECKING:
    from conftest import Ros

pytestmark = pytest.mark.ros
LAYOUT = Layout(np.zeros((2, 3)), ('Bx', 'By', 'Bz'), 'T')


class Source(Node):
    """Publishes what a sensor's nodes publish, in a namespace."""

    def __init__(self, namespace: str) -> None:
        super().__init__('source', namespace=namespace)
        self.layout = self.create_publisher(TactileLayout, 'layout', qos('layout'))
        self.frame = self.create_publisher(TactileFrame, 'frame', qos())
        self.contacts = self.create_publisher(TactileContacts, 'contacts', qos())
        self.grip = self.create_publisher(GripState, 'grip_node/state', qos())

    def say_layout(self) -> None:
        message = TactileLayout()
        messages.fill_layout(message, LAYOUT, Point, Quaternion)
        self.layout.publish(message)

    def say_frame(self, sequence: int) -> None:
        message = TactileFrame()
        frame = Frame(1000 + sequence, sequence, np.full((2, 3), float(sequence)))
        messages.fill_frame(message, frame, 'tactile_sensor')
        self.frame.publish(message)

    def say_contacts(self, sequence: int) -> None:
        message = TactileContacts()
        force = np.array([[0.0, 0.0, float(sequence)]])
        state = ContactState.assemble(2, {'force': force, 'valid': np.ones(1, bool)})
        messages.fill_contacts(message, state, TactileContact)
        message.sequence = sequence
        self.contacts.publish(message)


def heard_of(source: Source) -> int:
    """Subscriptions that the source has found."""
    publishers = (source.layout, source.frame, source.contacts, source.grip)
    return sum(publisher.get_subscription_count() for publisher in publishers)


def test_frames_come_with_their_own_contacts(ros: Ros) -> None:
    shown: list[tuple[str, Frame, ContactState]] = []
    grips: list[tuple[str, GripState, int]] = []
    ros.init()
    viewer = ros.add(
        ViewerNode(
            ['thumb'],
            lambda name, _, frame, state: shown.append((name, frame, state)),
            lambda *told: grips.append(told),
        )
    )
    source = ros.add(Source('thumb'))
    assert ros.until(lambda: heard_of(source) == 4)
    source.say_layout()
    assert ros.until(lambda: viewer._layouts)
    source.say_frame(2)
    source.say_frame(3)
    source.say_contacts(3)
    source.say_contacts(9)  # of a frame that was not heard
    source.grip.publish(GripState(phase=GripState.HOLD, fingers=['thumb'], force=[1.0]))
    assert ros.until(lambda: shown and grips)
    ((name, frame, state),) = shown
    assert (name, frame.sequence, state.force[2]) == ('thumb', 3, 3.0)
    assert grips[0][1].phase == GripState.HOLD
    assert ros.until(lambda: list(viewer._waiting['thumb']) in ([2, 9], [9, 2]))


def test_without_a_layout_nothing_is_shown(ros: Ros) -> None:
    ros.init()
    viewer = ViewerNode([''], lambda *_: pytest.fail('it has no place'), lambda *_: None)
    ros.add(viewer)
    viewer._on_half('', TactileContacts(sequence=1))
    viewer._on_half('', TactileFrame(sequence=1))
    assert not viewer._waiting['']


def test_frames_without_contacts_are_forgotten(ros: Ros) -> None:
    ros.init()
    viewer = ViewerNode([''], lambda *_: None, lambda *_: None)
    ros.add(viewer)
    for sequence in range(2 * WAITING):
        viewer._on_half('', TactileFrame(sequence=sequence))
    assert len(viewer._waiting['']) == WAITING
    assert next(iter(viewer._waiting[''])) == WAITING
