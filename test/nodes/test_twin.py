"""sensor_node on the twin of every sensor: lifecycle, faults at run time, recovery, truth."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.node import Node
from rclpy.parameter import Parameter

from tactile_ros.messages import read_frame, read_layout
from tactile_ros.msg import TactileContacts, TactileFrame, TactileLayout
from tactile_ros.nodes import lifecycle
from tactile_ros.nodes.lifecycle import FAILURE, SUCCESS, data, latched
from tactile_ros.nodes.sensor_node import SensorNode, SignalTruth, parse_fault
from tactile_ros.sensors import list_sensors, load_sensor
from tactile_ros.types import TaxelStatus

if TYPE_CHECKING:
    from conftest import Ros

# a fault that costs frames, and how the driver's counters say so
LOSSES = {
    'reskin_board': ('truncated', ('framing_errors', 'lost_bytes')),
    'magnet_pad': ('nack', ('nacks',)),
    'multipole_skin': ('brown_out', ('resets',)),
    'gradiometer': ('flipped', ('crc_errors', 'lost_bytes')),
    'taxel_array': ('dropped', ('crc_errors', 'framing_errors', 'lost_bytes')),
    'five_wire_skin': ('garbage', ('crc_errors', 'framing_errors', 'lost_bytes')),
}


class Listener(Node):
    """Hears a sensor."""

    def __init__(self) -> None:
        super().__init__('listener')
        self.frames: list[TactileFrame] = []
        self.layouts: list[TactileLayout] = []
        self.truths: list[TactileContacts] = []
        self.diagnostics: list[DiagnosticArray] = []
        self.create_subscription(TactileFrame, 'frame', self.frames.append, data())
        self.create_subscription(TactileLayout, 'layout', self.layouts.append, latched())
        self.create_subscription(TactileContacts, 'truth/contacts', self.truths.append, data())
        self.create_subscription(DiagnosticArray, '/diagnostics', self.diagnostics.append, 10)

    def said(self) -> dict[str, str]:
        """Values of the last diagnostics."""
        if not self.diagnostics:
            return {}
        status = self.diagnostics[-1].status[0]
        return {'message': status.message, **{pair.key: pair.value for pair in status.values}}


def twin_of(ros: Ros, sensor: str, *parameters: str) -> tuple[SensorNode, Listener]:
    """Node and listener; the node is not configured yet."""
    ros.init(f'sensor:={sensor}', 'simulated:=true', 'listeners:=1', *parameters)
    node, listener = ros.add(SensorNode()), ros.add(Listener())
    # only a listener that is matched hears all
    assert ros.until(lambda: node.count_subscribers('frame'))
    return node, listener


def set_fault(ros: Ros, node: Node, text: str) -> object:
    """Set the parameter as `ros2 param set` does."""
    client = node.create_client(SetParametersAtomically, 'sensor_node/set_parameters_atomically')
    parameter = Parameter('fault', value=text).to_parameter_msg()
    request = SetParametersAtomically.Request(parameters=[parameter])
    return ros.call(client, request).result


def threads() -> set[str]:
    return {thread.name for thread in threading.enumerate()} - {'MainThread'}


def began_anew(frames: list[TactileFrame]) -> bool:
    """Whether a sequence started again."""
    return bool((np.diff([message.sequence for message in frames]) < 0).any())


@pytest.mark.parametrize('sensor', list_sensors())
def test_a_twin_lives_and_recovers_from_a_fault(ros: Ros, sensor: str) -> None:
    before = threads()
    node, listener = twin_of(ros, sensor, 'seed:=3')
    lifecycle.start([node])
    assert ros.until(lambda: len(listener.frames) > 30 and listener.truths and listener.layouts)
    layout = read_layout(listener.layouts[0])
    spec = load_sensor(sensor)
    assert layout.shape == spec.layout(spec.config()).shape
    got = [read_frame(message, layout.shape) for message in listener.frames]
    sequence = np.array([frame.sequence for frame in got])
    assert (np.diff(sequence) >= 1).all()
    assert (np.diff([frame.stamp_ns for frame in got]) > 0).all()
    assert sum(message.valid for message in listener.frames) > 25
    fault, names = LOSSES[sensor]
    assert set_fault(ros, listener, f'{fault}:3').successful

    def told() -> bool:
        said = listener.said()
        counted = any(said.get(name, '0') not in ('0', 'not in this protocol') for name in names)
        # diagnostics may be made between the first and the last of three
        return counted and said['injected'] == f'3 {fault}'

    assert ros.until(told), listener.said()
    count = len(listener.frames)
    assert ros.until(lambda: sum(m.valid for m in listener.frames[count:]) > 20)
    assert not began_anew(listener.frames)
    assert node.trigger_deactivate() == SUCCESS
    assert not list(node.timers)
    count = len(listener.frames)
    assert node.trigger_activate() == SUCCESS
    assert ros.until(lambda: began_anew(listener.frames) and len(listener.frames) > count + 5)
    assert node.trigger_deactivate() == SUCCESS
    assert node.trigger_cleanup() == SUCCESS
    assert threads() <= before


def test_an_unplugged_twin_comes_back_within_two_seconds(ros: Ros) -> None:
    node, listener = twin_of(ros, 'gradiometer')
    lifecycle.start([node])
    assert ros.until(lambda: len(listener.frames) > 50)
    set_fault(ros, listener, 'unplug')

    def longest_gap() -> float:
        stamps = [m.header.stamp.sec + 1e-9 * m.header.stamp.nanosec for m in listener.frames]
        return float(np.diff(stamps).max())

    # the twin is away for one second; a port may be open before the next frame is heard
    assert ros.until(lambda: listener.said().get('reconnects') == '1' and longest_gap() > 0.9)
    assert longest_gap() < 1.0 + 2.0
    assert all(m.valid for m in listener.frames)


def test_saturation_is_marked_and_said(ros: Ros) -> None:
    node, listener = twin_of(ros, 'gradiometer')
    lifecycle.start([node])
    assert ros.until(lambda: listener.frames)
    set_fault(ros, listener, 'saturation:40')

    def marked() -> list[TactileFrame]:
        return [m for m in listener.frames if any(s & TaxelStatus.SATURATED for s in m.status)]

    assert ros.until(lambda: 'saturated taxels' in listener.said().get('message', '') and marked())
    assert not any(m.valid for m in marked())
    assert listener.diagnostics[-1].status[0].level == b'\x01'


@pytest.mark.parametrize('sensor', ['gradiometer', 'magnet_pad'])
def test_faults_that_wait_are_withdrawn(ros: Ros, sensor: str) -> None:
    node, listener = twin_of(ros, sensor)
    lifecycle.start([node])
    assert ros.until(lambda: listener.frames)
    assert set_fault(ros, listener, 'saturation:1000').successful
    assert ros.until(lambda: any(m.status and max(m.status) for m in listener.frames))
    assert set_fault(ros, listener, 'none').successful
    seen = len(listener.frames)
    assert ros.until(lambda: sum(m.valid for m in listener.frames[seen:]) > 20)
    assert not set_fault(ros, listener, 'saturation:1001').successful


def test_truth_is_the_signal_at_the_stamp_of_the_frame(ros: Ros) -> None:
    node, listener = twin_of(ros, 'taxel_array', 'seed:=5', 'rate_hz:=200.0')
    lifecycle.start([node])
    assert ros.until(lambda: any(m.in_contact == 1 for m in listener.truths))
    assert ros.until(lambda: sum(m.in_contact == 1 for m in listener.truths) > 60)
    assert ros.until(lambda: listener.layouts)
    truths = {m.sequence: m for m in listener.truths}
    layout = read_layout(listener.layouts[0])
    rows = [
        (float(read_frame(m, layout.shape).values.sum()), truths[m.sequence].wrench.force.z)
        for m in listener.frames
        if m.sequence in truths
    ]
    values, force = np.array(rows).T
    assert np.corrcoef(values, force)[0, 1] > 0.9
    assert {m.session for m in listener.truths} == {5}


def test_the_same_seed_says_the_same(ros: Ros) -> None:
    recordings = [load_sensor('magnet_pad').presses(load_sensor('magnet_pad').config(), s)
                  for s in (1, 1, 2)]  # fmt: skip
    np.testing.assert_array_equal(recordings[0].values, recordings[1].values)
    assert not np.array_equal(recordings[0].values, recordings[2].values)


def test_a_fault_at_the_start_happens_once_it_is_active(ros: Ros) -> None:
    node, listener = twin_of(ros, 'gradiometer', 'fault:="flipped:2"')
    lifecycle.start([node])
    assert ros.until(lambda: listener.said().get('injected') == '2 flipped')
    assert ros.until(lambda: listener.said().get('lost_bytes', '0') != '0')


@pytest.mark.parametrize('text', ['fire', 'flipped:0', 'flipped:-1', 'flipped:x', 'nack'])
def test_a_fault_that_cannot_be_is_refused_with_the_list(ros: Ros, text: str) -> None:
    node, listener = twin_of(ros, 'gradiometer')
    lifecycle.start([node])
    result = set_fault(ros, listener, text)
    assert not result.successful
    assert 'fault must be one of dropped, doubled, flipped' in result.reason
    assert repr(text) in result.reason


def test_a_real_sensor_suffers_no_fault(ros: Ros, capfd: pytest.CaptureFixture[str]) -> None:
    ros.init('port:=/nowhere')
    node = ros.add(SensorNode())
    refused = node.set_parameters([Parameter('fault', value='lost')])[0]
    assert not refused.successful
    assert 'where the sensor is not simulated' in refused.reason
    # together with the twin it is taken, and its name is checked where the twin is known
    changed = [Parameter('simulated', value=True), Parameter('fault', value='fire')]
    assert node.set_parameters_atomically(changed).successful
    assert node.trigger_configure() == FAILURE
    assert 'fault must be one of' in capfd.readouterr().err
    assert node.set_parameters([Parameter('fault', value='')])[0].successful
    assert node.trigger_configure() == SUCCESS


def test_a_configure_that_fails_leaves_nothing_and_can_be_tried_again(
    ros: Ros, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = threads()
    node, listener = twin_of(ros, 'taxel_array')
    real = SensorNode._make_reader

    def broken(_: SensorNode) -> object:
        msg = 'no memory'
        raise RuntimeError(msg)

    monkeypatch.setattr(SensorNode, '_make_reader', broken)
    assert node.trigger_configure() == FAILURE
    assert threads() <= before
    monkeypatch.setattr(SensorNode, '_make_reader', real)
    lifecycle.start([node])
    assert ros.until(lambda: listener.frames)


def test_names_and_counts_of_faults() -> None:
    assert parse_fault('nack', ('nack',)) == ('nack', 1)
    assert parse_fault(' nack:12 ', ('nack',)) == ('nack', 12)


def test_rows_of_truth_repeat_with_the_signal() -> None:
    spec = load_sensor('taxel_array')
    recording = spec.presses(spec.config(), 0)
    truth = SignalTruth(recording, start_ns=7)
    period_ns = round(1e9 / recording.layout.rate_hz)
    assert [truth.row(7 + k * period_ns) for k in (0, 1, len(recording))] == [0, 1, 0]
    # by the board's clock where it has one, however late the frame
    assert truth.row(10**12, 3 * period_ns) == 3
    state, groups = truth.at(7 + 200 * period_ns)
    np.testing.assert_array_equal(state.force, recording.truth['force'][200])
    assert groups['repetition'] == recording.truth['repetition'][200]


def test_a_sensor_without_a_lesson_plays_none(ros: Ros, capfd: pytest.CaptureFixture[str]) -> None:
    ros.init('sensor:=taxel_array', 'simulated:=true', 'scene:=lesson')
    node = ros.add(SensorNode())
    assert node.trigger_configure() == FAILURE
    assert 'scene of taxel_array must be presses; it has no lesson' in capfd.readouterr().err
