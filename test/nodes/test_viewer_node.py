# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""What a viewer hears of running nodes: frames with their own contacts, and the grip."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from geometry_msgs.msg import Point, Quaternion

from tactile_ros import messages
from tactile_ros.msg import GripState, TactileContact, TactileContacts, TactileFrame, TactileLayout
from tactile_ros.nodes.lifecycle import qos
from tactile_ros.nodes.viewer_node import WAITING, ViewerNode
from tactile_ros.types import ContactState, Frame, Layout

if TYPE_CHECKING:
    from conftest import Ros

pytestmark = pytest.mark.ros
LAYOUT = Layout(np.zeros((2, 3)), ('Bx', 'By', 'Bz'), 'T')


def frame_of(sequence: int) -> TactileFrame:
    message = TactileFrame()
    frame = Frame(1000 + sequence, sequence, np.full((2, 3), float(sequence)))
    messages.fill_frame(message, frame, 'tactile_sensor')
    return message


def contacts_of(sequence: int) -> TactileContacts:
    message = TactileContacts()
    force = np.array([[0.0, 0.0, float(sequence)]])
    state = ContactState.assemble(2, {'force': force, 'valid': np.ones(1, bool)})
    messages.fill_contacts(message, state, TactileContact)
    message.sequence = sequence
    return message


@pytest.mark.parametrize('named', [['thumb'], []])
def test_frames_come_with_their_own_contacts(named: list[str], ros: Ros) -> None:
    shown: list[tuple[str, Frame, ContactState]] = []
    grips: list[tuple[str, GripState, int]] = []
    ros.init()
    take, hear = lambda name, _, *rest: shown.append((name, *rest)), lambda *of: grips.append(of)
    viewer = ros.add(ViewerNode(named, take, hear))
    kinds = {'layout': TactileLayout, 'frame': TactileFrame, 'contacts': TactileContacts,
             'grip_node/state': GripState}  # fmt: skip
    send = {
        kind: ros.listener.create_publisher(kind, f'thumb/{topic}', qos(topic))
        for topic, kind in kinds.items()
    }
    assert ros.until(lambda: all(p.get_subscription_count() for p in send.values()))
    layout = TactileLayout()
    messages.fill_layout(layout, LAYOUT, Point, Quaternion)
    send[TactileLayout].publish(layout)
    assert ros.until(lambda: viewer._layouts)
    # contacts 9 are of a frame that was not heard
    for message in (frame_of(2), frame_of(3), contacts_of(3), contacts_of(9)):
        send[type(message)].publish(message)
    grip = GripState(phase=GripState.HOLD, fingers=['thumb'], force=[1.0])
    send[GripState].publish(grip)
    assert ros.until(lambda: shown and grips)
    ((name, frame, state),) = shown
    assert (name, frame.sequence, state.force[2]) == ('thumb', 3, 3.0)
    assert grips[0][1].phase == GripState.HOLD
    assert ros.until(lambda: sorted(viewer._waiting['thumb']) == [2, 9])


def test_without_a_layout_or_contacts_nothing_is_shown(ros: Ros) -> None:
    ros.init()
    viewer = ros.add(ViewerNode([''], lambda *_: pytest.fail('it has no place'), print))
    viewer._on_half('', TactileContacts(sequence=1))
    viewer._on_half('', TactileFrame(sequence=1))
    assert not viewer._waiting['']
    for sequence in range(2 * WAITING):
        viewer._on_half('', TactileFrame(sequence=sequence))
    assert list(viewer._waiting['']) == list(range(WAITING, 2 * WAITING))
