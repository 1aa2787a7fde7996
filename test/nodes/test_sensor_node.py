# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""sensor_node over real DDS: lifecycle, layout, frames, unplugging, diagnostics, parameters."""

from __future__ import annotations

import itertools
import queue
import threading
from collections.abc import Callable, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING

import numpy as np
import pytest
import yaml
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState

from tactile_ros.errors import DeviceError, DeviceTimeout
from tactile_ros.messages import read_frame, read_layout
from tactile_ros.msg import TactileContacts, TactileFrame, TactileLayout
from tactile_ros.nodes import lifecycle, sensor_node
from tactile_ros.nodes.contact_node import ContactNode
from tactile_ros.nodes.grip_node import GripNode
from tactile_ros.nodes.lifecycle import FAILURE, SUCCESS
from tactile_ros.nodes.mock_hand_node import MockHandNode
from tactile_ros.nodes.player_node import PlayerNode
from tactile_ros.nodes.record_node import RecordNode
from tactile_ros.nodes.sensor_node import Reader, SensorDiagnostics, SensorNode, parse_fault
from tactile_ros.nodes.standard_messages import TruthMessages, header_of
from tactile_ros.sensors import list_sensors, load_sensor
from tactile_ros.types import Device, Frame, TaxelStatus

if TYPE_CHECKING:
    from conftest import Port, Ros

PATIENCE_S = 120.0
AGGREGATOR = Path(__file__).parents[2] / 'config' / 'diagnostics.yaml'
OK, WARN, ERROR, STALE = (
    DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR, DiagnosticStatus.STALE,
)  # fmt: skip
# a fault that costs frames, and how the driver's counters say so
LOSSES = {
    'reskin_board': ('truncated', ('framing_errors', 'lost_bytes')),
    'magnet_pad': ('nack', ('nacks',)),
    'multipole_skin': ('brown_out', ('resets',)),
    'gradiometer': ('flipped', ('crc_errors', 'lost_bytes')),
    'taxel_array': ('dropped', ('crc_errors', 'framing_errors', 'lost_bytes')),
    'five_wire_skin': ('garbage', ('crc_errors', 'framing_errors', 'lost_bytes')),
}


class Sensor:
    """A sensor_node and what is heard of it; it is not configured yet."""

    def __init__(self, ros: Ros, *parameters: str) -> None:
        ros.init('listeners:=1', *parameters)
        self.ros, self.node = ros, ros.add(SensorNode())
        self.frames: list[TactileFrame] = ros.hear(TactileFrame, 'frame')
        self.layouts: list[TactileLayout] = ros.hear(TactileLayout, 'layout')
        self.truths: list[TactileContacts] = ros.hear(TactileContacts, 'truth/contacts')
        # only a listener that is matched hears all
        assert ros.until(lambda: self.node.count_subscribers('frame'))

    def start(self) -> None:
        lifecycle.start([self.node])

    def said(self) -> dict[str, str]:
        """Diagnostics of the node since they were asked for last."""
        status = self.node.diagnose()
        return {'message': status.message, **{pair.key: pair.value for pair in status.values}}

    def frames_read(self) -> list[Frame]:
        shape = read_layout(self.layouts[0]).shape
        return [read_frame(message, shape) for message in self.frames]


def twin_of(ros: Ros, sensor: str, *parameters: str) -> Sensor:
    """An active twin."""
    made = Sensor(ros, f'sensor:={sensor}', 'simulated:=true', *parameters)
    made.start()
    return made


def thread_names() -> set[str]:
    return {thread.name for thread in threading.enumerate()} - {'MainThread'}


@pytest.mark.parametrize('sensor', list_sensors())
def test_sensor_node_recovers_from_a_fault_of_its_twin(ros: Ros, sensor: str) -> None:
    before = thread_names()
    made = twin_of(ros, sensor, 'seed:=3')
    assert ros.until(lambda: len(made.frames) > 30 and made.truths and made.layouts)
    spec = load_sensor(sensor)
    assert read_layout(made.layouts[0]).shape == spec.layout(spec.config()).shape
    got = made.frames_read()
    assert (np.diff([frame.sequence for frame in got]) >= 1).all()
    assert (np.diff([frame.stamp_ns for frame in got]) > 0).all()
    assert sum(message.valid for message in made.frames) > 25
    fault, names = LOSSES[sensor]
    assert ros.change(made.node, fault=f'{fault}:3').successful

    def told() -> bool:
        said = made.said()
        counted = any(said.get(name, '0') not in ('0', 'not in this protocol') for name in names)
        # diagnostics may be made between the first and the last of three
        return counted and said['injected'] == f'3 {fault}'

    assert ros.until(told), made.said()
    count = len(made.frames)
    assert ros.until(lambda: sum(m.valid for m in made.frames[count:]) > 20)
    assert (np.diff([message.sequence for message in made.frames]) > 0).all()
    assert made.node.trigger_deactivate() == SUCCESS
    assert not list(made.node.timers)
    assert made.node.trigger_activate() == SUCCESS
    # frames count anew from every activation
    assert ros.until(lambda: np.diff([m.sequence for m in made.frames]).min() < 0)
    assert made.node.trigger_deactivate() == SUCCESS
    assert made.node.trigger_cleanup() == SUCCESS
    assert thread_names() <= before


def test_sensor_node_marks_saturation_until_it_is_withdrawn(ros: Ros) -> None:
    made = twin_of(ros, 'gradiometer', 'fault:="flipped:2"')
    # the fault of the start happens once the node is active
    assert ros.until(lambda: made.said().get('injected') == '2 flipped')
    assert ros.until(lambda: made.said()['lost_bytes'] != '0')
    assert ros.change(made.node, fault='saturation:1000').successful
    assert ros.until(lambda: 'saturated taxels' in made.said()['message'])

    def marked() -> list[TactileFrame]:
        return [m for m in made.frames if any(s & TaxelStatus.SATURATED for s in m.status)]

    assert ros.until(marked)
    assert not any(m.valid for m in marked())
    assert ros.change(made.node, fault='none').successful
    seen = len(made.frames)
    assert ros.until(lambda: sum(m.valid for m in made.frames[seen:]) > 20)
    for text in ('fire', 'flipped:0', 'flipped:-1', 'flipped:x', 'nack', 'saturation:1001'):
        result = ros.change(made.node, fault=text)
        assert not result.successful
        assert 'fault must be one of dropped, doubled, flipped' in result.reason
        assert repr(text) in result.reason
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


def test_sensor_node_refuses_what_its_sensor_cannot(
    ros: Ros, capfd: pytest.CaptureFixture[str]
) -> None:
    before = thread_names()
    ros.init('port:=/nowhere')
    node = ros.add(SensorNode())
    refused = ros.change(node, fault='lost')
    assert not refused.successful
    assert 'where the sensor is not simulated' in refused.reason
    # together with the twin it is taken, and its name is checked where the twin is known
    assert ros.change(node, simulated=True, fault='fire').successful
    assert node.trigger_configure() == FAILURE
    assert 'fault must be one of' in capfd.readouterr().err
    assert thread_names() <= before
    assert ros.change(node, fault='', scene='new_class').successful
    assert node.trigger_configure() == FAILURE
    said = 'scene of reskin_board must be presses; it shows no new class'
    assert said in capfd.readouterr().err
    assert ros.change(node, scene='presses').successful
    assert node.trigger_configure() == SUCCESS


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


def frame(sequence: int, status: int = 0, period_s: float = 1e-9) -> Frame:
    bits = np.array([0, status], np.uint8) if status else None
    return Frame(round(sequence * period_s * 1e9), sequence, np.zeros((2, 3)), status=bits)


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sensor_node, 'FIRST_RETRY_S', 0.001)


def run(
    device: Script,
    frames: int,
    hear: Callable[[Sequence[Frame]], None] = lambda _: None,
    **options: object,
) -> tuple[Reader, list[list[Frame]], list[str]]:
    """Read until so many frames came, then close."""
    got, said, enough = [], [], threading.Event()

    def deliver(items: Sequence[Frame]) -> None:
        got.append(list(items))
        if sum(map(len, got)) >= frames:
            enough.set()
        hear(items)

    read = Reader(device, deliver, said.append, **options)
    read.open()
    read.start()
    came = enough.wait(PATIENCE_S)
    read.close()
    assert came
    assert device.closed.is_set()
    return read, got, said


def test_reader_tells_a_missing_port_once_and_tries_again() -> None:
    device = Script(frame(0), refusals=5)
    _, _, said = run(device, 1)
    assert said[0] == 'port x does not exist; ports here: y; trying again'
    assert said.count(said[0]) == device.opened == 1


def test_reader_goes_on_after_any_error() -> None:
    def fail(items: Sequence[Frame]) -> None:
        if items[0].sequence == 1:
            msg = 'a listener failed'
            raise RuntimeError(msg)

    errors = DeviceError('the stream is text'), OSError('gone'), ZeroDivisionError('by zero')
    read, got, said = run(Script(frame(0), *errors, frame(1), frame(2)), 3, fail)
    assert [item.sequence for items in got for item in items] == [0, 1, 2]
    assert read.diagnostics.failures == 4
    expected = {'the stream is text', 'gone', 'ZeroDivisionError: by zero'}
    assert expected | {'RuntimeError: a listener failed'} <= set(said)


def test_reader_hands_on_together_what_came_together() -> None:
    class Bundled(Script):
        def waiting(self) -> list[Frame]:
            return [frame(k) for k in (1, 2)] if self.acts.empty() else []

    read, got, _ = run(Bundled(frame(0)), 1)
    assert [[item.sequence for item in items] for items in got] == [[0, 1, 2]]
    assert read.diagnostics.frames == 3


def test_reader_reads_nothing_before_everybody_is_there() -> None:
    device = Script(frame(0))
    asked = []

    def ready() -> bool:
        assert device.acts.qsize() == 1
        asked.append(True)
        return len(asked) > 3

    run(device, 1, ready=ready)
    assert len(asked) == 4


def test_reader_drops_the_oldest_of_a_full_queue_and_counts() -> None:
    device = Script(frame(0))
    got, gate, taken = [], threading.Event(), threading.Event()

    def deliver(items: Sequence[Frame]) -> None:
        got.extend((item.sequence, item.dropped) for item in items)
        taken.set()
        assert gate.wait(PATIENCE_S)

    read = Reader(device, deliver, lambda _: None, queue=3)
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
    # three were left, and say how many were lost before them
    assert got == [(0, 0), *((k, 6) for k in (7, 8, 9))]
    assert read.diagnostics.overruns == 6
    assert not {'reader', 'reader_queue'} & thread_names()


def test_reader_discards_what_was_kept_back_however_long_it_takes_to_decode(
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

    _, got, _ = run(Buffered(*(frame(k) for k in range(7))), 2, kept_back_s=25e-3)
    assert [item.sequence for items in got for item in items] == [5, 6]


def judged(count: int, period_s: float = 0.01, status: int = 0) -> tuple[bytes, str, object]:
    """Diagnostics at a nominal 100 Hz of frames of which the last has a status."""
    reading = SensorDiagnostics(100.0)
    for k in range(count):
        reading.note(frame(k, status if k == count - 1 else 0, period_s))
    reading.sentence = ''
    return reading.judge({}, is_open=True)


def test_diagnostics_warn_of_the_last_second_and_forget() -> None:
    reading = SensorDiagnostics(100.0)
    for status in (TaxelStatus.STUCK | TaxelStatus.SATURATED, 0):
        for k in range(100):
            reading.note(frame(reading.frames, status if k > 50 else 0, 0.01))
        reading.sentence = ''
        level, message, values = reading.judge({'crc_errors': 2}, is_open=True)
        told = '; saturated taxels; stuck taxels; 2 crc errors' if status else ''
        assert level == (WARN if status else OK)
        assert message == f'100 frames in the last second{told}'
        assert values['stuck taxels'] == ([1] if status else [])
        assert values['rate (Hz)'] == pytest.approx(100.0)
        assert (values['connection'], values['resets']) == ('streaming', 'not in this protocol')


def test_diagnostics_warn_of_slow_and_irregular_frames() -> None:
    level, message, _ = judged(50, 0.02)
    assert (level, message) == (WARN, '50 frames in the last second; 50 Hz instead of 100 Hz')
    jumpy = SensorDiagnostics(100.0)
    for k, stamp in enumerate(np.cumsum([0.001, 0.019] * 50)):
        jumpy.note(Frame(round(stamp * 1e9), k, np.zeros((2, 3))))
    level, message, _ = jumpy.judge({}, is_open=True)
    assert level == WARN
    assert 'irregularly: jitter 9 ms' in message


def test_diagnostics_of_silence_are_an_error_with_its_reason() -> None:
    reading = SensorDiagnostics(100.0)
    reading.sentence = 'port x was unplugged; trying again'
    level, message, values = reading.judge({}, is_open=True)
    assert (level, message) == (ERROR, 'port x was unplugged; trying again')
    assert values['connection'] == 'silent'
    assert reading.judge({}, is_open=False)[2]['connection'] == 'not open'
    reading.waiting = True
    level, message, _ = reading.judge({}, is_open=True)
    assert (level, 'listeners' in message) == (STALE, True)


@pytest.mark.parametrize(('frames', 'level'), [(19, WARN), (20, OK)])
def test_a_reading_that_repeats_itself_now_and_then_is_no_trouble(
    frames: int, level: bytes
) -> None:
    assert judged(frames, status=TaxelStatus.STALE)[0] == level


def test_the_aggregator_sorts_every_name_that_is_published(ros: Ros, tmp_path: Path) -> None:
    parameters = yaml.safe_load(AGGREGATOR.read_text())['analyzers']['ros__parameters']
    analyzers = [x for x in parameters.values() if isinstance(x, dict)]
    arguments = [f'bag:={tmp_path}/bag', 'simulated:=true', 'recording:=spatial',
                 f'port:={tmp_path}/board', 'tare:=false', 'hand:=qb_softhand']  # fmt: skip
    ros.init(*arguments, remaps=['__ns:=/hand/thumb'])
    kinds = (ContactNode, SensorNode, RecordNode, PlayerNode, MockHandNode, GripNode)
    nodes = [ros.add(kind()) for kind in kinds]
    heard: list[DiagnosticArray] = ros.hear(DiagnosticArray, '/diagnostics')
    lifecycle.start(nodes)
    assert ros.until(lambda: len({m.status[0].name for m in heard}) == len(nodes))
    names = {m.status[0].name for m in heard}
    words = [analyzer['contains'] for analyzer in analyzers]
    for name in names:
        assert sum(any(word in name for word in some) for some in words) == 1, name
    assert all(any(word in name for name in names) for some in words for word in some)
    for analyzer in analyzers:
        assert analyzer['type'] == 'diagnostic_aggregator/GenericAnalyzer'
        assert analyzer['timeout'] > lifecycle.DIAGNOSTICS_PERIOD_S


@pytest.fixture
def sensor(ros: Ros, port: Port) -> Sensor:
    """An unconfigured node at the simulated port."""
    return Sensor(
        ros, f'port:={port.port}', 'serial:=A7', 'frame_id:=thumb', 'discard_stale:=false'
    )


def test_sensor_node_publishes_what_its_board_sends(
    ros: Ros, port: Port, sensor: Sensor, rows: np.ndarray
) -> None:
    assert ros.change(sensor.node, rate_hz=50.0).successful
    sensor.start()
    assert ros.until(lambda: sensor.layouts)
    refused = ros.change(sensor.node, rate_hz=50.0)
    assert refused.reason == 'rate_hz is read at configure: deactivate and clean up first'
    port.play(rows[:20])
    assert ros.until(lambda: len(sensor.frames) == 20)
    layout = read_layout(sensor.layouts[0])
    assert (layout.sensor, layout.serial, layout.frame_id) == ('reskin_board', 'A7', 'thumb')
    assert layout.rate_hz == 50.0
    got = sensor.frames_read()
    np.testing.assert_allclose([f.values for f in got], rows[:20], atol=1e-10)
    assert [f.sequence for f in got] == list(range(20))
    assert all(message.valid for message in sensor.frames)
    assert (np.diff([f.stamp_ns for f in got]) > 0).all()
    assert {message.header.frame_id for message in sensor.frames} == {'thumb'}
    change = {'transition': Transition(id=Transition.TRANSITION_ACTIVE_SHUTDOWN)}
    assert ros.ask(ChangeState, 'sensor_node/change_state', **change).success
    assert 'reader' not in thread_names()


def test_sensor_node_survives_a_port_that_comes_and_goes(
    ros: Ros, port: Port, sensor: Sensor, rows: np.ndarray
) -> None:
    port.unplug()
    sensor.start()
    assert 'does not exist' in sensor.said()['message']
    port.replug()
    port.wait_for_reader(PATIENCE_S)
    more = itertools.cycle(rows)
    assert ros.until(lambda: len(sensor.frames) > 10 or port.play([next(more)]))
    port.unplug()
    assert ros.until(lambda: 'trying again' in sensor.said()['message'])
    port.replug()
    port.wait_for_reader(PATIENCE_S)
    # what comes while the port is being opened is lost, as on a real board
    count = len(sensor.frames)
    assert ros.until(lambda: len(sensor.frames) > count + 20 or port.play([next(more)]))
    sequence = [message.sequence for message in sensor.frames]
    assert sequence == sorted(set(sequence))
    assert sensor.frames[-1].dropped >= 1
