"""sensor_node over real DDS: lifecycle, layout, frames, unplugging, diagnostics, parameters."""

from __future__ import annotations

import itertools
import threading
import time
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.node import Node
from rclpy.parameter import Parameter

from tactile_ros.devices.reskin_protocol import encode
from tactile_ros.messages import read_frame, read_layout
from tactile_ros.msg import TactileFrame, TactileLayout
from tactile_ros.nodes import lifecycle
from tactile_ros.nodes.lifecycle import data, latched
from tactile_ros.nodes.sensor_node import SensorNode

if TYPE_CHECKING:
    from conftest import Ros

    from tactile_ros.devices.simulated_serial import SimulatedSerialPort


class Listener(Node):
    """Hears a sensor."""

    def __init__(self) -> None:
        super().__init__('listener')
        self.frames: list[TactileFrame] = []
        self.layouts: list[TactileLayout] = []
        self.diagnostics: list[DiagnosticArray] = []
        self.create_subscription(TactileFrame, 'frame', self.frames.append, data())
        self.create_subscription(TactileLayout, 'layout', self.layouts.append, latched())
        self.create_subscription(DiagnosticArray, '/diagnostics', self.diagnostics.append, 10)

    def ask(self, kind: type, name: str) -> object:
        """Client of a service of the sensor."""
        return self.create_client(kind, f'sensor_node/{name}')


@pytest.fixture
def sensor(ros: Ros, port: SimulatedSerialPort) -> SensorNode:
    """An unconfigured node at the simulated port."""
    ros.init(
        f'port:={port.port}',
        'listeners:=1',
        'serial:=A7',
        'frame_id:=thumb',
        'discard_stale:=false',
    )
    return ros.add(SensorNode())


@pytest.fixture
def listener(ros: Ros, sensor: SensorNode) -> Listener:
    return ros.add(Listener())


def send(port: SimulatedSerialPort, rows: Sequence[np.ndarray]) -> None:
    for row in rows:
        port.send(encode(row))


def test_frames_and_layout_reach_a_listener(
    ros: Ros, port: SimulatedSerialPort, sensor: SensorNode, listener: Listener, rows: np.ndarray
) -> None:
    lifecycle.start([sensor])
    assert ros.until(lambda: listener.layouts)
    send(port, rows[:20])
    assert ros.until(lambda: len(listener.frames) == 20)
    layout = read_layout(listener.layouts[0])
    assert (layout.sensor, layout.serial, layout.frame_id) == ('reskin_board', 'A7', 'thumb')
    got = [read_frame(message, layout.shape) for message in listener.frames]
    np.testing.assert_allclose([f.values for f in got], rows[:20], atol=1e-10)
    assert [f.sequence for f in got] == list(range(20))
    assert all(message.valid for message in listener.frames)
    assert (np.diff([f.stamp_ns for f in got]) > 0).all()
    assert {message.header.frame_id for message in listener.frames} == {'thumb'}


def test_unplug_and_replug_within_two_seconds(
    ros: Ros, port: SimulatedSerialPort, sensor: SensorNode, listener: Listener, rows: np.ndarray
) -> None:
    lifecycle.start([sensor])
    send(port, rows[:10])
    assert ros.until(lambda: len(listener.frames) == 10)
    port.unplug()
    assert ros.until(lambda: 'trying again' in sensor.diagnose().message)
    port.replug()
    begin = time.monotonic()
    port.wait_for_reader()
    assert time.monotonic() - begin < 2.0
    # what comes while the port is being opened is lost, as on a real board
    more = itertools.cycle(rows[10:])
    assert ros.until(lambda: len(listener.frames) > 30 or port.send(encode(next(more))))
    sequence = [message.sequence for message in listener.frames]
    assert sequence == sorted(set(sequence))
    assert listener.frames[-1].dropped >= 1


def test_a_port_that_is_missing_at_configure_is_found_later(
    ros: Ros, port: SimulatedSerialPort, sensor: SensorNode, listener: Listener, rows: np.ndarray
) -> None:
    port.unplug()
    lifecycle.start([sensor])
    assert 'does not exist' in sensor.diagnose().message
    port.replug()
    port.wait_for_reader()
    assert ros.until(lambda: listener.frames or send(port, rows[:1]))


def test_lifecycle_through_its_services(
    ros: Ros, port: SimulatedSerialPort, sensor: SensorNode, listener: Listener, rows: np.ndarray
) -> None:
    change, state = listener.ask(ChangeState, 'change_state'), listener.ask(GetState, 'get_state')

    def to(transition: int) -> str:
        request = ChangeState.Request(transition=Transition(id=transition))
        assert ros.call(change, request).success
        return ros.call(state, GetState.Request()).current_state.label

    assert to(Transition.TRANSITION_CONFIGURE) == 'inactive'
    assert to(Transition.TRANSITION_ACTIVATE) == 'active'
    send(port, rows[:5])
    assert ros.until(lambda: len(listener.frames) == 5)
    assert to(Transition.TRANSITION_DEACTIVATE) == 'inactive'
    assert not list(sensor.timers)
    assert 'reader' not in {thread.name for thread in threading.enumerate()}
    assert to(Transition.TRANSITION_ACTIVATE) == 'active'
    send(port, rows[:5])
    assert ros.until(lambda: len(listener.frames) == 10)
    # frames count from the activation
    assert listener.frames[-1].sequence == 4
    assert to(Transition.TRANSITION_DEACTIVATE) == 'inactive'
    assert to(Transition.TRANSITION_CLEANUP) == 'unconfigured'
    assert to(Transition.TRANSITION_UNCONFIGURED_SHUTDOWN) == 'finalized'


def test_diagnostics_every_second(
    ros: Ros, port: SimulatedSerialPort, sensor: SensorNode, listener: Listener, rows: np.ndarray
) -> None:
    lifecycle.start([sensor])
    send(port, rows[:8])
    broken = rows[8].copy()
    broken[2, 1] = np.nan
    send(port, [broken, *rows[9:14]])

    def caught_up() -> bool:
        last = listener.frames[-1] if listener.frames else None
        return last is not None and np.allclose(last.values, rows[13].ravel(), atol=1e-10)

    def told() -> dict[str, str]:
        last = listener.diagnostics[-1].status[0].values if listener.diagnostics else ()
        return {pair.key: pair.value for pair in last}

    assert ros.until(caught_up)
    # the first may be said before the last frame came
    assert ros.until(lambda: told().get('frames') == str(len(listener.frames)))
    status = listener.diagnostics[-1].status[0]
    assert status.name == 'sensor_node: sensor'
    assert status.hardware_id == 'reskin_board A7'
    values = told()
    assert {'dropped', 'framing_errors', 'implausible', 'reconnects'} <= values.keys()
    # the damage shows as a reading that is marked, or as a frame that is missing
    marked = [message for message in listener.frames if np.isnan(message.values).any()]
    assert not any(message.valid for message in marked)
    assert len(marked) + listener.frames[-1].dropped >= 1
    assert len(listener.frames) >= 12


@pytest.mark.parametrize(
    ('name', 'value', 'sentence'),
    [
        ('rate_hz', -1.0, 'out of range'),
        ('rate_hz', 'fast', 'rate_hz must be a number'),
        ('positions', [1.0, 2.0], 'positions must be a multiple of 3 numbers'),
        ('baud', 5, 'out of range'),
        ('sensor', 'other', 'read-only'),
    ],
)
def test_parameters_are_refused_with_a_sentence(
    sensor: SensorNode, name: str, value: object, sentence: str
) -> None:
    result = sensor.set_parameters([Parameter(name, value=value)])[0]
    assert not result.successful
    assert sentence in result.reason


def test_parameters_change_while_unconfigured_and_not_while_active(
    ros: Ros, sensor: SensorNode, listener: Listener
) -> None:
    client = listener.ask(SetParametersAtomically, 'set_parameters_atomically')

    def set_rate(value: float) -> object:
        parameter = Parameter('rate_hz', value=value).to_parameter_msg()
        request = SetParametersAtomically.Request(parameters=[parameter])
        return ros.call(client, request).result

    assert set_rate(50.0).successful
    lifecycle.start([sensor])
    assert ros.until(lambda: listener.layouts)
    assert listener.layouts[0].rate_hz == 50.0
    refused = set_rate(60.0)
    assert not refused.successful
    assert refused.reason == 'rate_hz is read at configure: deactivate and clean up first'
