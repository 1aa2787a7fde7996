"""sensor_node over real DDS: lifecycle, layout, frames, unplugging, diagnostics, parameters."""

from __future__ import annotations

import itertools
import queue
import threading
import time
from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING

import numpy as np
import pytest
import yaml
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.node import Node
from rclpy.parameter import Parameter

from tactile_ros.devices.reskin_protocol import encode
from tactile_ros.errors import DeviceError, DeviceTimeout
from tactile_ros.messages import read_frame, read_layout
from tactile_ros.msg import TactileContacts, TactileFrame, TactileLayout
from tactile_ros.nodes import lifecycle, sensor_node
from tactile_ros.nodes.contact_node import ContactNode
from tactile_ros.nodes.grip_node import GripNode
from tactile_ros.nodes.lifecycle import FAILURE, SUCCESS, qos
from tactile_ros.nodes.mock_hand_node import MockHandNode
from tactile_ros.nodes.player_node import PlayerNode
from tactile_ros.nodes.record_node import RecordNode
from tactile_ros.nodes.sensor_node import (
    NOT_MEASURED,
    Reader,
    SensorDiagnostics,
    SensorNode,
    pace,
    parse_fault,
    temperatures,
)
from tactile_ros.nodes.standard_messages import TruthMessages, header_of
from tactile_ros.sensors import list_sensors, load_sensor
from tactile_ros.types import Device, Frame, TaxelStatus

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from conftest import Ros

    from tactile_ros.devices.simulated_serial import SimulatedSerialPort

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
        self.create_subscription(TactileFrame, 'frame', self.frames.append, qos())
        self.create_subscription(TactileLayout, 'layout', self.layouts.append, qos('layout'))
        self.create_subscription(TactileContacts, 'truth/contacts', self.truths.append, qos())
        self.create_subscription(DiagnosticArray, '/diagnostics', self.diagnostics.append, 10)

    def ask(self, kind: type, name: str) -> object:
        """Client of a service of the sensor."""
        return self.create_client(kind, f'sensor_node/{name}')

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


def set_parameter(ros: Ros, listener: Listener, name: str, value: object) -> object:
    """Set a parameter as `ros2 param set` does."""
    client = listener.ask(SetParametersAtomically, 'set_parameters_atomically')
    parameter = Parameter(name, value=value).to_parameter_msg()
    request = SetParametersAtomically.Request(parameters=[parameter])
    return ros.call(client, request).result


def set_fault(ros: Ros, listener: Listener, text: str) -> object:
    return set_parameter(ros, listener, 'fault', text)


def thread_names() -> set[str]:
    return {thread.name for thread in threading.enumerate()} - {'MainThread'}


def began_anew(frames: list[TactileFrame]) -> bool:
    """Whether a sequence started again."""
    return bool((np.diff([message.sequence for message in frames]) < 0).any())


@pytest.mark.parametrize('sensor', list_sensors())
def test_a_twin_lives_and_recovers_from_a_fault(ros: Ros, sensor: str) -> None:
    before = thread_names()
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
    assert thread_names() <= before


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


def test_the_same_seed_says_the_same() -> None:
    recordings = [load_sensor('magnet_pad').presses(load_sensor('magnet_pad').config(), s)
                  for s in (1, 1, 2)]  # fmt: skip
    np.testing.assert_array_equal(recordings[0].values, recordings[1].values)
    assert not np.array_equal(recordings[0].values, recordings[2].values)


def test_a_fault_at_the_start_happens_once_it_is_active(ros: Ros) -> None:
    node, listener = twin_of(ros, 'gradiometer', 'fault:="flipped:2"')
    lifecycle.start([node])
    assert ros.until(lambda: listener.said().get('injected') == '2 flipped')
    assert ros.until(lambda: listener.said().get('lost_bytes', '0') != '0')


def test_a_fault_that_cannot_be_is_refused_with_the_list(ros: Ros) -> None:
    node, listener = twin_of(ros, 'gradiometer')
    lifecycle.start([node])
    for text in ('fire', 'flipped:0', 'flipped:-1', 'flipped:x', 'nack'):
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
    before = thread_names()
    node, listener = twin_of(ros, 'taxel_array')
    real = SensorNode._make_reader

    def broken(_: SensorNode) -> object:
        msg = 'no memory'
        raise RuntimeError(msg)

    monkeypatch.setattr(SensorNode, '_make_reader', broken)
    assert node.trigger_configure() == FAILURE
    assert thread_names() <= before
    monkeypatch.setattr(SensorNode, '_make_reader', real)
    lifecycle.start([node])
    assert ros.until(lambda: listener.frames)


def test_names_and_counts_of_faults() -> None:
    assert parse_fault('nack', ('nack',)) == ('nack', 1)
    assert parse_fault(' nack:12 ', ('nack',)) == ('nack', 12)


def test_rows_of_truth_repeat_with_the_signal() -> None:
    spec = load_sensor('taxel_array')
    recording = spec.presses(spec.config(), 0)
    truth = TruthMessages(recording, start_ns=7)
    period_ns = round(1e9 / recording.layout.rate_hz)
    assert [truth.row_at(7 + k * period_ns) for k in (0, 1, len(recording))] == [0, 1, 0]
    # by the board's clock where it has one, however late the frame
    assert truth.row_at(10**12, 3 * period_ns) == 3
    message = truth.message(200, header_of(9, 'thumb'), 4)
    force = message.wrench.force
    np.testing.assert_array_equal([force.x, force.y, force.z], recording.truth['force'][200])
    assert message.repetition == recording.truth['repetition'][200]
    assert (message.sequence, message.header.stamp.nanosec) == (4, 9)


def test_a_sensor_without_a_lesson_plays_none(ros: Ros, capfd: pytest.CaptureFixture[str]) -> None:
    ros.init('sensor:=taxel_array', 'simulated:=true', 'scene:=lesson')
    node = ros.add(SensorNode())
    assert node.trigger_configure() == FAILURE
    assert 'scene of taxel_array must be presses; it has no lesson' in capfd.readouterr().err


PATIENCE_S = 120.0


class Script(Device):
    """A device that does what a list says: frames, errors, and errors on opening."""

    def __init__(self, *acts: object, refusals: int = 0) -> None:
        self.acts = queue.SimpleQueue()
        for act in acts:
            self.acts.put(act)
        self.refusals = refusals
        self.opened = 0
        self.closed = threading.Event()

    def __enter__(self) -> Script:
        if self.refusals:
            self.refusals -= 1
            msg = 'port x does not exist; ports here: y'
            raise DeviceError(msg)
        self.opened += 1
        return self

    def __exit__(self, *_: object) -> None:
        self.closed.set()

    def read(self, timeout: float) -> Frame:
        try:
            act = self.acts.get(timeout=min(timeout, 0.01))
        except queue.Empty:
            msg = 'nothing came'
            raise DeviceTimeout(msg) from None
        if isinstance(act, Exception):
            raise act
        return act


def frame(sequence: int, status: int = 0) -> Frame:
    bits = np.array([0, status], np.uint8) if status else None
    return Frame(sequence, sequence, np.zeros((2, 3)), status=bits)


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setattr(sensor_node, 'FIRST_RETRY_S', 0.001)
    return


def run(device: Script, frames: int, **options: object) -> tuple[Reader, list[Frame], list[str]]:
    """Read until so many frames came, then close."""
    got, said, enough = [], [], threading.Event()

    def deliver(items: Sequence[Frame]) -> None:
        got.extend(items)
        if len(got) >= frames:
            enough.set()
        if items[0].sequence in options.get('fails_at', ()):
            msg = 'a listener failed'
            raise RuntimeError(msg)

    read = Reader(device, deliver, said.append, options.get('ready'))
    read.open()
    read.start()
    came = enough.wait(PATIENCE_S)
    read.close()
    assert came
    assert device.closed.is_set()
    return read, got, said


def test_a_missing_port_is_told_once_and_tried_again() -> None:
    device = Script(frame(0), refusals=5)
    _, got, said = run(device, 1)
    assert [f.sequence for f in got] == [0]
    assert said[0] == 'port x does not exist; ports here: y; trying again'
    assert said.count(said[0]) == 1
    assert device.opened == 1


def test_errors_of_the_device_do_not_end_the_reader() -> None:
    device = Script(frame(0), DeviceError('the stream is text'), OSError('gone'), frame(1))
    read, got, said = run(device, 2)
    assert [f.sequence for f in got] == [0, 1]
    assert read.diagnostics.failures == 2
    assert 'the stream is text' in said


def test_a_listener_that_fails_costs_one_frame() -> None:
    read, got, said = run(Script(frame(0), frame(1), frame(2)), 3, fails_at=(1,))
    assert [f.sequence for f in got] == [0, 1, 2]
    assert 'RuntimeError: a listener failed' in said
    assert read.diagnostics.failures == 1


def test_frames_that_came_together_are_handed_on_together() -> None:
    class Bundled(Script):
        """A port that has kept two more frames back."""

        def waiting(self) -> list[Frame]:
            return [frame(k) for k in (1, 2)] if self.acts.empty() else []

    got, enough = [], threading.Event()

    def deliver(items: Sequence[Frame]) -> None:
        got.append([item.sequence for item in items])
        enough.set()

    read = Reader(Bundled(frame(0)), deliver, lambda _: None)
    read.open()
    read.start()
    assert enough.wait(PATIENCE_S)
    read.close()
    assert got == [[0, 1, 2]]
    assert read.diagnostics.frames == 3


def test_nothing_is_read_before_everybody_is_there() -> None:
    device = Script(frame(0))
    asked = []

    def ready() -> bool:
        assert device.acts.qsize() == 1
        asked.append(True)
        return len(asked) > 3

    run(device, 1, ready=ready)
    assert len(asked) == 4


def test_flags_of_the_latest_frame_are_named() -> None:
    stuck = frame(0, TaxelStatus.STUCK | TaxelStatus.SATURATED)
    read, _, _ = run(Script(stuck), 1)
    _, _, values = read.diagnostics.judge({}, is_open=True)
    assert (values['stuck taxels'], values['taxels in error']) == ([1], [])


def test_a_full_queue_drops_the_oldest_and_counts() -> None:
    device = Script(frame(0))
    got, gate, taken = [], threading.Event(), threading.Event()

    def deliver(items: Sequence[Frame]) -> None:
        got.extend((item.sequence, item.dropped) for item in items)
        taken.set()
        assert gate.wait(PATIENCE_S)

    def complain(_: str) -> None:
        """What the empty script says."""

    read = Reader(device, deliver, complain, queue=3)
    read.open()
    read.start()
    assert taken.wait(PATIENCE_S)
    # all others are read while the listener still has the first
    for k in range(1, 10):
        device.acts.put(frame(k))
    while read.diagnostics.frames < 10:
        assert not gate.wait(0.001)
    gate.set()
    read.close()
    first, *others = got
    assert first == (0, 0)
    # three were left, and say how many were lost before them
    assert others == [(k, 6) for k in (7, 8, 9)]
    assert read.diagnostics.overruns == 6
    assert not {'reader', 'reader_queue'} & {thread.name for thread in threading.enumerate()}


def test_an_error_that_no_driver_may_raise_does_not_end_the_reader() -> None:
    read, got, said = run(Script(frame(0), ZeroDivisionError('by zero'), frame(1)), 2)
    assert [f.sequence for f in got] == [0, 1]
    assert 'ZeroDivisionError: by zero' in said
    assert read.diagnostics.failures == 1


def test_what_was_kept_back_is_discarded_however_long_it_takes_to_decode(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    now = itertools.count(0.0, 4e-3)  # 4 ms from one look at the clock to the next
    monkeypatch.setattr(sensor_node, 'time', SimpleNamespace(monotonic=lambda: next(now)))

    class Buffered(Script):
        """Frames 0 to 4 were kept back; later ones come when somebody waits."""

        def read(self, timeout: float) -> Frame:
            if timeout == 0.0 and self.acts.qsize() <= 2:
                msg = 'nothing now'
                raise DeviceTimeout(msg)
            return super().read(max(timeout, 0.01))

    got, enough = [], threading.Event()

    def deliver(items: Sequence[Frame]) -> None:
        got.extend(item.sequence for item in items)
        if len(got) == 2:
            enough.set()

    device = Buffered(*(frame(k) for k in range(7)))
    read = Reader(device, deliver, lambda _: None, kept_back_s=25e-3)
    read.open()
    read.start()
    assert enough.wait(PATIENCE_S)
    read.close()
    assert got == [5, 6]


AGGREGATOR = Path(__file__).parents[2] / 'config' / 'diagnostics.yaml'
OK, WARN, ERROR, STALE = (
    DiagnosticStatus.OK,
    DiagnosticStatus.WARN,
    DiagnosticStatus.ERROR,
    DiagnosticStatus.STALE,
)


def frames(
    reading: SensorDiagnostics, count: int, period_s: float = 0.01, status: int = 0
) -> None:
    """Let frames come."""
    bits = np.array([0, status], np.uint8) if status else None
    for _ in range(count):
        k = reading.frames
        reading.note(Frame(round(k * period_s * 1e9), k, np.zeros((2, 3)), status=bits))
    reading.sentence = ''


def test_regular_frames_are_well() -> None:
    reading = SensorDiagnostics(100.0)
    frames(reading, 100)
    level, message, values = reading.judge({'dropped': 0}, is_open=True)
    assert (level, message) == (OK, '100 frames in the last second')
    assert values['rate (Hz)'] == pytest.approx(100.0)
    assert values['jitter (ms)'] == pytest.approx(0.0, abs=1e-6)
    assert values['connection'] == 'streaming'
    assert values['crc_errors'] == 'not in this protocol'
    assert values['dropped'] == 0


def test_trouble_of_the_last_second_warns_and_is_forgotten() -> None:
    reading = SensorDiagnostics(100.0)
    frames(reading, 50)
    frames(reading, 50, status=TaxelStatus.STUCK | TaxelStatus.SATURATED)
    level, message, values = reading.judge({'crc_errors': 2}, is_open=True)
    assert level == WARN
    assert message.endswith('; saturated taxels; stuck taxels; 2 crc errors')
    assert values['stuck taxels'] == [1]
    frames(reading, 100)
    assert reading.judge({'crc_errors': 2}, is_open=True)[0] == OK


def test_slow_and_irregular_frames_warn() -> None:
    reading = SensorDiagnostics(100.0)
    frames(reading, 50, 0.02)
    level, message, _ = reading.judge({}, is_open=True)
    assert (level, message) == (WARN, '50 frames in the last second; 50 Hz instead of 100 Hz')
    jumpy = SensorDiagnostics(100.0)
    for k, stamp in enumerate(np.cumsum([0.001, 0.019] * 50)):
        jumpy.note(Frame(round(stamp * 1e9), k, np.zeros((2, 3))))
    jumpy.sentence = ''
    level, message, _ = jumpy.judge({}, is_open=True)
    assert level == WARN
    assert 'irregularly: jitter 9 ms' in message


def test_silence_is_an_error_with_its_reason() -> None:
    reading = SensorDiagnostics(100.0)
    reading.sentence = 'port x was unplugged; trying again'
    level, message, values = reading.judge({}, is_open=True)
    assert (level, message) == (ERROR, 'port x was unplugged; trying again')
    assert values['connection'] == 'silent'
    assert reading.judge({}, is_open=False)[2]['connection'] == 'not open'


def test_what_waits_for_its_listeners_is_stale() -> None:
    reading = SensorDiagnostics(100.0)
    reading.waiting = True
    level, message, _ = reading.judge({}, is_open=True)
    assert level == STALE
    assert 'listeners' in message


def test_pace_of_few_frames_is_unknown() -> None:
    assert np.isnan(pace([])).all()
    assert np.isnan(pace([5])).all()
    rate_hz, jitter_s = pace([0, 10_000_000])
    assert rate_hz == pytest.approx(100.0)
    assert np.isnan(jitter_s)


@pytest.mark.parametrize(('often', 'warns'), [(19, True), (20, False)])
def test_a_reading_that_repeats_itself_now_and_then_is_no_trouble(often: int, warns: bool) -> None:
    reading = SensorDiagnostics(100.0)
    frames(reading, 1, status=TaxelStatus.STALE)
    frames(reading, often - 1)
    level, _, values = reading.judge({}, is_open=True)
    assert (level == WARN) is warns
    assert values['stale taxels'] == []


def test_temperatures_are_the_extremes_or_not_measured() -> None:
    warm = Frame(0, 0, np.zeros((2, 3)), np.array([31.0, np.nan]))
    assert list(temperatures(warm).values()) == [31.0, 31.0]
    assert set(temperatures(Frame(0, 0, np.zeros((2, 3)))).values()) == {NOT_MEASURED}
    assert set(temperatures(None).values()) == {NOT_MEASURED}


def analyzers() -> dict[str, dict[str, object]]:
    parameters = yaml.safe_load(AGGREGATOR.read_text())['analyzers']['ros__parameters']
    return {name: x for name, x in parameters.items() if isinstance(x, dict)}


@pytest.mark.parametrize('space', ['', 'hand/thumb'])
def test_the_aggregator_sorts_every_name_that_is_published(
    ros: Ros, space: str, tmp_path: Path
) -> None:
    arguments = [f'bag:={tmp_path}/bag', 'simulated:=true', 'recording:=spatial',
                 f'port:={tmp_path}/board', 'tare:=false', 'hand:=qb_softhand']  # fmt: skip
    ros.init(*arguments, remaps=[f'__ns:=/{space}'] if space else [])
    nodes = [ContactNode(), SensorNode(), RecordNode(), PlayerNode(), MockHandNode(), GripNode()]
    for node in nodes:
        ros.add(node)
    heard: dict[str, DiagnosticStatus] = {}
    listener = ros.add(Node('diagnostics_listener'))
    listener.create_subscription(
        DiagnosticArray, '/diagnostics', lambda m: heard.update({s.name: s for s in m.status}), 10
    )
    lifecycle.start(nodes)
    assert ros.until(lambda: len(heard) == len(nodes))
    for name in heard:
        matches = [
            key
            for key, analyzer in analyzers().items()
            if any(word in name for word in analyzer['contains'])
        ]
        assert len(matches) == 1, name
    words = {word for analyzer in analyzers().values() for word in analyzer['contains']}
    assert {word for word in words if any(word in name for name in heard)} == words
    for analyzer in analyzers().values():
        assert analyzer['type'] == 'diagnostic_aggregator/GenericAnalyzer'
        assert analyzer['timeout'] > lifecycle.DIAGNOSTICS_PERIOD_S


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

    assert ros.until(caught_up)
    # the first may be said before the last frame came
    assert ros.until(lambda: listener.said().get('frames') == str(len(listener.frames)))
    status = listener.diagnostics[-1].status[0]
    assert status.name == 'sensor_node: sensor'
    assert status.hardware_id == 'reskin_board A7'
    assert {'dropped', 'framing_errors', 'implausible', 'reconnects'} <= listener.said().keys()
    # the damage shows as a reading that is marked, or as a frame that is missing
    marked = [message for message in listener.frames if np.isnan(message.values).any()]
    assert not any(message.valid for message in marked)
    assert len(marked) + listener.frames[-1].dropped >= 1
    assert len(listener.frames) >= 12


def test_parameters_are_refused_with_a_sentence(sensor: SensorNode) -> None:
    for name, value, sentence in (
        ('rate_hz', -1.0, 'out of range'),
        ('rate_hz', 'fast', 'rate_hz must be a number'),
        ('positions', [1.0, 2.0], 'positions must be a multiple of 3 numbers'),
        ('baud', 5, 'out of range'),
        ('sensor', 'other', 'read-only'),
    ):
        result = sensor.set_parameters([Parameter(name, value=value)])[0]
        assert not result.successful
        assert sentence in result.reason


def test_parameters_change_while_unconfigured_and_not_while_active(
    ros: Ros, sensor: SensorNode, listener: Listener
) -> None:
    assert set_parameter(ros, listener, 'rate_hz', 50.0).successful
    lifecycle.start([sensor])
    assert ros.until(lambda: listener.layouts)
    assert listener.layouts[0].rate_hz == 50.0
    refused = set_parameter(ros, listener, 'rate_hz', 60.0)
    assert not refused.successful
    assert refused.reason == 'rate_hz is read at configure: deactivate and clean up first'
