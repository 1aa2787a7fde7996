"""One process: the collector is frozen once warm; contacts come without a frame on the wire.

With a hand the grip is part of it, and decides the same numbers as over DDS and without ROS.
"""

from __future__ import annotations

import gc
from itertools import cycle
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING

import numpy as np
import pytest
from rclpy.node import Node

from reference import grip_roads
from tactile_ros.devices.reskin_protocol import encode
from tactile_ros.msg import TactileContacts
from tactile_ros.nodes import grip_node, lifecycle, stack
from tactile_ros.nodes.lifecycle import data
from tactile_ros.types import Frame

if TYPE_CHECKING:
    from collections.abc import Iterator
    from types import ModuleType

    from conftest import Ros

    from tactile_ros.devices.simulated_serial import SimulatedSerialPort


@pytest.fixture
def collector() -> Iterator[None]:
    gc.unfreeze()
    yield
    gc.unfreeze()


@pytest.mark.usefixtures('collector')
def test_the_collector_is_frozen_once_warm() -> None:
    taken = []
    step = stack.frozen_after(lambda some, name: taken.append((len(some), name)), frames=3)
    frames = [Frame(k, k, np.zeros((1, 1))) for k in range(4)]
    step(frames[:1], 'thumb')
    step(frames[1:2], 'thumb')
    assert gc.get_freeze_count() == 0
    step(frames[2:], 'thumb')
    assert gc.get_freeze_count() > 0
    assert taken == [(1, 'thumb'), (1, 'thumb'), (2, 'thumb')]


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
    waiting = cycle(rows)
    assert ros.until(lambda: heard or port.send(encode(next(waiting))))
    for _ in range(10):
        port.send(encode(next(waiting)))
    assert ros.until(lambda: len(heard) > 10)
    sequence = [message.sequence for message in heard]
    assert sequence == list(range(sequence[0], sequence[0] + len(heard)))
    assert listener.count_subscribers('frame') == 0


@pytest.fixture(scope='module')
def roads() -> ModuleType:
    return grip_roads


@pytest.fixture(scope='module')
def press(roads: ModuleType, tmp_path_factory: pytest.TempPathFactory) -> object:
    return roads.learnt_press(tmp_path_factory.mktemp('force') / 'force.npz')


@pytest.mark.parametrize('direct', [True, False])
def test_every_road_commands_the_same(
    ros: Ros,
    roads: ModuleType,
    press: object,
    monkeypatch: pytest.MonkeyPatch,
    direct: bool,
) -> None:
    clock = roads.Clock()
    monkeypatch.setattr(grip_node, 'time', SimpleNamespace(monotonic=clock.monotonic))
    live = roads.lived(ros, press, clock, direct)
    alone = roads.offline(press)
    assert len(live) == len(alone) == roads.ROWS
    assert np.ptp(live, axis=0)[0] > 0.02
    np.testing.assert_allclose(live, alone, rtol=0, atol=1e-9)


def test_of_frames_that_waited_the_newest_is_answered_and_a_slip_in_any_counts(ros: Ros) -> None:
    ros.init('hand:=joint_trajectory')
    grip = ros.add(grip_node.GripNode())
    taken = []
    grip._take = lambda topic, felt, sequence, _: taken.append((topic, *felt, sequence))
    frames = [Frame(k, k, np.zeros((1, 1))) for k in (1, 2, 3)]
    states = [
        SimpleNamespace(valid=True, status=0, force=np.full(3, float(k)), slip=slip)
        for k, slip in enumerate((-1, 1, -1))
    ]
    grip.take_states('/left/contacts', frames, states)
    grip.take_states('/left/contacts', frames[2:], states[2:])
    two = [2.0, 2.0, 2.0]
    assert taken == [('/left/contacts', two, True, 1, 3), ('/left/contacts', two, True, -1, 3)]


def test_the_nodes_of_a_hand_have_the_names_of_the_processes(ros: Ros) -> None:
    ros.init('hand:=joint_trajectory', 'seed:=3', 'sensor:=gradiometer', 'source:=simulated')
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
