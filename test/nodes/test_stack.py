"""One process: the collector is frozen once warm; contacts come without a frame on the wire."""

from __future__ import annotations

import gc
from typing import TYPE_CHECKING

import numpy as np
import pytest
from rclpy.node import Node

from tactile_ros.devices.packets import encode
from tactile_ros.msg import TactileContacts
from tactile_ros.nodes import lifecycle, stack
from tactile_ros.nodes.quality import data
from tactile_ros.types import Frame

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from conftest import Ros

    from tactile_ros.devices.simulated import SimulatedSerialPort


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
