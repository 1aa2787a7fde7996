"""sensor_node: read one tactile sensor and publish its frames."""

from __future__ import annotations

import re
import threading
import time
from collections import deque
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field, replace
from queue import Empty, SimpleQueue
from typing import TYPE_CHECKING

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import Point, Quaternion

from tactile_ros import messages
from tactile_ros.enrolment import playing
from tactile_ros.errors import DeviceError, DeviceTimeout, TactileError
from tactile_ros.msg import TactileContact, TactileContacts, TactileFrame, TactileLayout
from tactile_ros.nodes.lifecycle import ManagedNode, data, latched, main_of, pairs
from tactile_ros.nodes.parameters import SensorOptions
from tactile_ros.nodes.player import truth_states
from tactile_ros.nodes.standard_messages import Views
from tactile_ros.sensors import load_sensor
from tactile_ros.types import TaxelStatus

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from rclpy.publisher import Publisher

    from tactile_ros.types import (
        Array,
        ContactState,
        ContactStates,
        Device,
        Frame,
        Layout,
        Recording,
        Twin,
    )

READ_TIMEOUT_S = 0.25
FIRST_RETRY_S = 0.1
LONGEST_RETRY_S = 0.5
# the same complaint is not told again before
REPEAT_S = 10.0
# a quiet chip repeats itself now and then
RARELY = 0.05
MOST_STAMPS = 10_000
MOST_DISCARDING_S = 0.5


@dataclass
class Reading:
    """What the reader has seen, for diagnostics.

    Attributes
    ----------
    frames : int
        Read.
    overruns : int
        Of them those that were pushed out of a full queue.
    failures : int
        Errors of the device or of what came after it.
    waiting : bool
        Nothing is read before everybody who listens is there.
    sentence : str
        Why nothing comes now; empty while frames come.
    last : Frame or None
        The latest frame.
    flagged : int
        Taxel readings with a status bit.
    stamps : deque of int
        Acquisition times (ns) since they were taken last.
    marks : int
        Bits of `TaxelStatus` that came since they were taken last.
    fresh, stale : int
        Frames since then, and those with a STALE taxel.
    """

    frames: int = 0
    overruns: int = 0
    failures: int = 0
    waiting: bool = False
    sentence: str = 'no frame yet'
    last: Frame | None = None
    flagged: int = 0
    stamps: deque[int] = field(default_factory=lambda: deque(maxlen=MOST_STAMPS))
    marks: int = 0
    fresh: int = 0
    stale: int = 0

    def note(self, frame: Frame) -> None:
        """Count a frame."""
        self.frames += 1
        self.fresh += 1
        self.last = frame
        self.stamps.append(frame.stamp_ns or 0)
        if frame.status is not None:
            self.flagged += int(np.count_nonzero(frame.status))
            marks = int(np.bitwise_or.reduce(frame.status))
            self.marks |= marks
            self.stale += bool(marks & TaxelStatus.STALE)

    def take_stamps(self) -> list[int]:
        """Acquisition times (ns) since the last call."""
        return [self.stamps.popleft() for _ in range(len(self.stamps))]

    def take_marks(self) -> TaxelStatus:
        """Bits that came since the last call; STALE only if it came often."""
        marks = TaxelStatus(self.marks)
        if self.stale <= RARELY * self.fresh:
            marks &= ~TaxelStatus.STALE
        self.marks = self.fresh = self.stale = 0
        return marks

    def taxels(self, bit: TaxelStatus) -> list[int]:
        """Taxels of the latest frame that carry a status bit."""
        if self.last is None or self.last.status is None:
            return []
        return [int(i) for i in np.flatnonzero(self.last.status & int(bit))]


class Reader:
    """Read a device in a thread of its own until closed; no failure of the device ends it.

    Parameters
    ----------
    device : Device
        Not yet entered; opened again with growing pauses where its port is missing.
    deliver : callable
        Takes every frame once and in order: those that came together, one at a time from a queue.
    complain : callable
        Takes a sentence whenever the reason why nothing comes changes.
    ready : callable or None
        Nothing is read before it returns True: whoever must see the first frame is there.
    queue : int
        Frames that may wait for `deliver`, which runs in a thread of its own then; 0: it runs in
        the reader's thread, and the port's own buffer is the queue.
    kept_back_s : float
        Before reading begins, discard what the port hands over faster than this: it was kept
        back, and its age is unknown. 0: nothing is discarded.
    """

    def __init__(
        self,
        device: Device,
        deliver: Callable[[Sequence[Frame]], None],
        complain: Callable[[str], None],
        ready: Callable[[], bool] | None = None,
        queue: int = 0,
        kept_back_s: float = 0.0,
    ) -> None:
        self.reading = Reading()
        self._device = device
        self._deliver = deliver
        self._waiting: Callable[[], list[Frame]] = getattr(device, 'waiting', list)
        self._complain = complain
        self._ready = ready
        self._stop = threading.Event()
        self._opened = ExitStack()
        self._is_open = False
        self._told: dict[str, float] = {}
        self._limit = queue
        self._kept_back_s = kept_back_s
        self._queue: SimpleQueue[Frame | None] = SimpleQueue()
        self._thread = threading.Thread(target=self._run, name='reader', daemon=True)
        self._handing = threading.Thread(target=self._hand_on, name='reader_queue', daemon=True)

    @property
    def is_open(self) -> bool:
        """Whether the device could be opened."""
        return self._is_open

    def open(self) -> bool:
        """Try to open the device now; where its port is missing, the thread goes on trying."""
        try:
            self._opened.enter_context(self._device)
            self._is_open = True
        except DeviceError as err:
            self._note(f'{err}; trying again')
        return self._is_open

    def start(self) -> None:
        """Begin to read."""
        if self._limit:
            self._handing.start()
        self._thread.start()

    def close(self) -> None:
        """End the threads and close the device."""
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join()
        if self._handing.is_alive():
            self._queue.put(None)
            self._handing.join()
        self._opened.close()

    def counters(self) -> dict[str, int]:
        """Counts of the device itself, where it keeps any."""
        counted = getattr(self._device, 'counters', None)
        return dict(counted()) if counted is not None else {}

    def _run(self) -> None:
        """Open, wait for the listeners, read; after a failure again from the top."""
        pause = FIRST_RETRY_S
        while not self._is_open and not self._stop.wait(pause):
            pause = min(2 * pause, LONGEST_RETRY_S)
            self._open_again()
        self.reading.waiting = self._ready is not None
        while self._ready is not None and not self._ready():
            if self._stop.wait(0.01):
                return
        self.reading.waiting = False
        self._discard()
        while not self._stop.is_set():
            self._step()

    def _discard(self) -> None:
        """Read on until a frame has to be waited for."""
        end = time.monotonic() + MOST_DISCARDING_S
        took = 0.0
        with suppress(Exception):  # a failure is told by the reading that follows
            while took < self._kept_back_s and time.monotonic() < end and not self._stop.is_set():
                began = time.monotonic()
                self._device.read(0.0)
                took = time.monotonic() - began

    def _open_again(self) -> None:
        """Try to open; what fails is told."""
        try:
            self.open()
        except (TactileError, OSError, ValueError) as err:
            self._note(f'{err}; trying again')

    def _step(self) -> None:
        """What has come, or the reason why nothing has."""
        try:
            frames = [self._device.read(READ_TIMEOUT_S), *self._waiting()]
        except DeviceTimeout as err:
            self._note(str(err))
        except (TactileError, OSError) as err:
            self._fail(str(err))
        except Exception as err:  # also what no driver may do: the node goes on
            self._fail(f'{type(err).__name__}: {err}')
        else:
            self._take(frames)

    def _fail(self, sentence: str) -> None:
        """Count a failure, tell it, and pause."""
        self.reading.failures += 1
        self._note(sentence)
        self._stop.wait(FIRST_RETRY_S)

    def _take(self, frames: list[Frame]) -> None:
        """Hand frames on, or let them wait in the queue."""
        for frame in frames:
            self.reading.note(frame)
        self.reading.sentence = ''
        if not self._limit:
            self._pass_on(frames)
            return
        for frame in frames:
            if self._queue.qsize() >= self._limit:
                self._push_out()
            self._queue.put(frame)

    def _push_out(self) -> None:
        """Drop the oldest frame, unless it has just been taken."""
        with suppress(Empty):
            self._queue.get_nowait()
            self.reading.overruns += 1

    def _hand_on(self) -> None:
        """Empty the queue until there is nothing more to come."""
        while (frame := self._queue.get()) is not None:
            lost = self.reading.overruns
            self._pass_on([replace(frame, dropped=frame.dropped + lost) if lost else frame])

    def _pass_on(self, frames: list[Frame]) -> None:
        """Hand frames on; a failure there is told and costs them alone."""
        try:
            self._deliver(frames)
        except Exception as err:  # whatever listens must not end the sensor
            self.reading.failures += 1
            self._note(f'{type(err).__name__}: {err}')

    def _note(self, sentence: str) -> None:
        """Complain about each new reason, and about one that comes and goes now and then."""
        self.reading.sentence = sentence
        now = time.monotonic()
        if now - self._told.get(sentence, -REPEAT_S) >= REPEAT_S:
            self._told = {sentence: now}
            self._complain(sentence)


TAXELS = {
    'saturated taxels': TaxelStatus.SATURATED,
    'wrapped taxels': TaxelStatus.WRAPPED,
    'stuck taxels': TaxelStatus.STUCK,
    'taxels in error': TaxelStatus.ERROR,
    'stale taxels': TaxelStatus.STALE,
}
# always told, also by drivers whose protocol does not have them
EXPECTED = ('dropped', 'crc_errors', 'framing_errors', 'resets', 'reconnects')
# growth of these alone is no trouble
HARMLESS = ('frames', 'not_ready', 'saturated', 'stale', 'repeated', 'missing', 'other_kind')
NOT_MEASURED = 'not measured'
SLOW, JITTERY = 0.8, 0.5


@dataclass(frozen=True)
class Pace:
    """How regularly frames came.

    Attributes
    ----------
    rate_hz : float
        Frames per second of their own stamps; NaN: fewer than two came.
    jitter_s : float
        Standard deviation of the time from frame to frame (s); NaN: fewer than three came.
    """

    rate_hz: float
    jitter_s: float


def pace(stamps_ns: Sequence[int]) -> Pace:
    """Rate and jitter of acquisition times (ns)."""
    gaps = np.diff(np.asarray(stamps_ns, np.int64)) * 1e-9
    gaps = gaps[gaps > 0]
    if not len(gaps):
        return Pace(float('nan'), float('nan'))
    return Pace(1.0 / float(gaps.mean()), float(gaps.std()) if len(gaps) > 1 else float('nan'))


@dataclass
class Health:
    """Judges a sensor once a second.

    Attributes
    ----------
    nominal_hz : float
        Rate of the layout; NaN: unknown.
    name, hardware_id : str
        Of the status.
    """

    nominal_hz: float
    name: str = 'sensor'
    hardware_id: str = ''
    _frames: int = field(default=0, init=False)
    _before: dict[str, int] = field(default_factory=dict, init=False)

    def judge(
        self,
        reading: Reading,
        counters: Mapping[str, int],
        is_open: bool,
        more: Mapping[str, object] | None = None,
    ) -> tuple[bytes, str, dict[str, object]]:
        """Level, sentence and values for what came since the last call.

        Parameters
        ----------
        reading : Reading
            Of the reader; its stamps and marks are taken.
        counters : mapping
            Of the device.
        is_open : bool
            Whether the device could be opened.
        more : mapping or None
            Further values to tell.

        Returns
        -------
        level : bytes
            Of DiagnosticStatus. OK; WARN: frames come, but something needs attention; ERROR: none
            come; STALE: none are read, since nobody listens yet.
        message : str
            Why, in a sentence.
        values : dict
            What is known, by name.
        """
        count, self._frames = reading.frames - self._frames, reading.frames
        found, marks = pace(reading.take_stamps()), reading.take_marks()
        grown = self._grown({**counters, 'overruns': reading.overruns})
        level, message = DiagnosticStatus.OK, f'{count} frames in the last second'
        if reading.waiting and not reading.frames:
            level, message = DiagnosticStatus.STALE, 'not read before all listeners are there'
        elif not count or not is_open:
            level, message = DiagnosticStatus.ERROR, reading.sentence or 'no frame came'
        elif reasons := [*self._slow(found), *_marked(marks), *grown, reading.sentence]:
            told = [reason for reason in reasons if reason]
            level = DiagnosticStatus.WARN if told else level
            message = '; '.join([message, *told])
        values = {
            'connection': _connection(level, is_open),
            'rate (Hz)': found.rate_hz,
            'nominal rate (Hz)': self.nominal_hz,
            'jitter (ms)': 1e3 * found.jitter_s,
            'frames': reading.frames,
            'queue overruns': reading.overruns,
            'failures': reading.failures,
            **dict.fromkeys(EXPECTED, 'not in this protocol'),
            **counters,
            **{name: reading.taxels(bit) for name, bit in TAXELS.items()},
            **temperatures(reading.last),
            **(more or {}),
        }
        return level, message, values

    def _grown(self, counters: Mapping[str, int]) -> list[str]:
        """What was counted since the last call, in words."""
        before, self._before = self._before, dict(counters)
        more = {n: v - before.get(n, 0) for n, v in counters.items() if n not in HARMLESS}
        return [f'{count} {name.replace("_", " ")}' for name, count in more.items() if count > 0]

    def _slow(self, found: Pace) -> list[str]:
        """What is wrong with rate and jitter."""
        if found.rate_hz < SLOW * self.nominal_hz:
            return [f'{found.rate_hz:.3g} Hz instead of {self.nominal_hz:g} Hz']
        if found.jitter_s * self.nominal_hz > JITTERY:
            return [f'frames come irregularly: jitter {1e3 * found.jitter_s:.2g} ms']
        return []


def _marked(marks: TaxelStatus) -> list[str]:
    """Names of the taxel states that came up."""
    return [name for name, bit in TAXELS.items() if marks & bit]


def _connection(level: bytes, is_open: bool) -> str:
    """State of the connection in a word or two."""
    if not is_open:
        return 'not open'
    named = {DiagnosticStatus.ERROR: 'silent', DiagnosticStatus.STALE: 'open, not read yet'}
    return named.get(level, 'streaming')


def temperatures(frame: Frame | None) -> dict[str, object]:
    """Coldest and hottest chip of a frame (degrees Celsius)."""
    warm = None if frame is None else frame.temperature_c
    names = ('lowest temperature (C)', 'highest temperature (C)')
    if warm is None or not np.isfinite(warm).any():
        return dict.fromkeys(names, NOT_MEASURED)
    return dict(zip(names, (float(np.nanmin(warm)), float(np.nanmax(warm))), strict=True))


MOST_FAULTS = 1000
RELIEF = 'none'
PATTERN = re.compile(r'(?P<name>[a-z_]+)(:(?P<count>[0-9]{1,6}))?')


def parse_fault(text: str, known: Sequence[str]) -> tuple[str, int]:
    """Name and count of a fault.

    Parameters
    ----------
    text : str
        `name` or `name:count`.
    known : sequence of str
        Faults that the twin can suffer.

    Returns
    -------
    name : str
        One of `known`.
    count : int
        How many frames or transfers suffer it.

    Raises
    ------
    ValueError
        If it is none; lists those that are.
    """
    found = PATTERN.fullmatch(text.strip())
    name = '' if found is None else found['name']
    count = int(found['count'] or 1) if found is not None else 0
    if name not in known or not 1 <= count <= MOST_FAULTS:
        msg = (
            f'fault must be one of {", ".join(known)}, with :count of 1 to {MOST_FAULTS} where it '
            f'is to happen more than once; received {text!r}'
        )
        raise ValueError(msg)
    return name, count


class SignalTruth:
    """What the signal of a twin says at a time: rows of its recording, again and again.

    Parameters
    ----------
    recording : Recording
        What the twin's signal plays, with truth; evenly spaced.
    start_ns : int
        Node's time at the signal's beginning (ns).

    Notes
    -----
    The clock of a twin's board begins with its signal, so it tells the row that a frame carries
    however late the frame was sent and read.
    """

    def __init__(self, recording: Recording, start_ns: int) -> None:
        self._start_ns = start_ns
        self._rate_hz = recording.layout.rate_hz
        self._truth = recording.truth
        self._states: ContactStates = truth_states(recording)
        self._count = len(recording)

    def row(self, stamp_ns: int, device_time_ns: int = 0) -> int:
        """Row that was played at a time (ns), by the board's clock where it has one."""
        since_ns = device_time_ns or stamp_ns - self._start_ns
        return round(since_ns * 1e-9 * self._rate_hz) % self._count

    def at(self, stamp_ns: int, device_time_ns: int = 0) -> tuple[ContactState, dict[str, int]]:
        """Truth at a time (ns), and the groups that it belongs to."""
        row = self.row(stamp_ns, device_time_ns)
        names = ('session', 'repetition')
        groups = {n: int(np.asarray(self._truth[n][row])) for n in names if n in self._truth}
        return self._states[row], groups


AT_ONCE = 0.5  # of a frame's period: what takes less to read was not waited for


class SensorNode(ManagedNode):
    """Publish `frame`, `layout` (latched) and /diagnostics of one sensor, real or simulated.

    On demand also `magnetic_field/chip_<i>` and `image`, and of a twin `truth/contacts`.

    Parameters
    ----------
    downstream : callable or None
        Takes every frame, those that came together at once, and the name of their tf frame in the
        reader's thread, before they are published: the one-process road, which has no queue.
    waits_for : callable or None
        Further condition for the first frame.
    arguments : sequence of str
        ROS arguments for this node alone.
    """

    def __init__(
        self,
        downstream: Callable[[Sequence[Frame], str], None] | None = None,
        waits_for: Callable[[], bool] | None = None,
        arguments: Sequence[str] = (),
    ) -> None:
        super().__init__('sensor_node', arguments)
        self._twin: Twin | None = None
        self._reader: Reader | None = None
        self.declare(SensorOptions())
        self._spec = load_sensor(self.get_parameter('sensor').value)
        self.declare(self._spec.config(), self._spec.connection())
        self._frames = self.managed_publisher(TactileFrame, 'frame', data())
        self._layouts = self.managed_publisher(TactileLayout, 'layout', latched())
        self._downstream = downstream
        self._waits_for = waits_for
        self._options = SensorOptions()
        self._layout: Layout | None = None
        self._health = Health(float('nan'))
        self._views: Views | None = None
        self._held = ExitStack()
        self._truth: SignalTruth | None = None
        self._truths: Publisher | None = None
        self._pending_fault = ''

    def configure(self) -> None:
        """Check the parameters and open the device; a missing port is told and tried again."""
        self._options = self.options(SensorOptions)
        config = self.options(type(self._spec.config()))
        self._layout = replace(
            self._spec.layout(config), frame_id=self._options.frame_id, serial=self._options.serial
        )
        if self._options.simulated:
            self._begin_twin(config)
        self.check({'fault': self._options.fault})
        self._pending_fault = self._options.fault
        self._reader = self._make_reader()
        self._reader.open()

    def _begin_twin(self, config: object) -> None:
        """Let the twin answer from now until cleanup."""
        connection = self.options(type(self._spec.connection()))
        seed = self._options.seed
        signal, recording = self._scene(config)
        twin = self._spec.simulate(config, connection, signal, seed)
        self._twin = self._held.enter_context(twin)
        self._truth = SignalTruth(recording, self.now_ns())
        self._truths = self.create_publisher(TactileContacts, 'truth/contacts', data())
        self._held.callback(self.destroy_publisher, self._truths)

    def _scene(self, config: object) -> tuple[Callable[[float], Array] | None, Recording]:
        """Signal of the twin, None: its own, and the truth of it."""
        seed, lesson = self._options.seed, self._spec.lesson
        if self._options.scene == 'presses':
            return None, self._spec.presses(config, seed)
        if lesson is None:
            msg = f'scene of {self._spec.key} must be presses; it has no lesson'
            raise ValueError(msg)
        recording = lesson.scene(config, seed, 0.0)
        return playing(recording), recording

    def _make_reader(self) -> Reader:
        """Reader of a fresh device: its frames count from 0."""
        config = self.options(type(self._spec.config()))
        connection = self.options(type(self._spec.connection()))
        device: Device = (
            self._spec.open(config, connection, self.now_ns)
            if self._twin is None
            else self._twin.device(self.now_ns)
        )
        queue = self._options.queue if self._downstream is None else 0
        return Reader(
            device,
            self._deliver,
            self.get_logger().error,
            self._is_awaited,
            queue,
            self._kept_back_s(),
        )

    def _kept_back_s(self) -> float:
        """Frames that come so much faster than they are taken have waited in the port (s)."""
        rate_hz = self._layout.rate_hz
        if not self._options.discard_stale:
            return 0.0
        # not a fixed time: on a busy machine it takes milliseconds to decode what waits
        return AT_ONCE / rate_hz if rate_hz > 0 else 1.0

    def activate(self) -> None:
        """Publish the layout and begin to read."""
        if self._reader is None:
            self._reader = self._make_reader()
            self._reader.open()
        message = TactileLayout()
        messages.fill_layout(message, self._layout, Point, Quaternion)
        message.header.stamp = self.get_clock().now().to_msg()
        self._layouts.publish(message)
        name = f'{self._spec.key} {self._options.serial}'.strip()
        self._health = Health(self._layout.rate_hz, hardware_id=name)
        self._views = Views(self, self._layout, self._options.magnetic_field, self._options.image)
        pending, self._pending_fault = self._pending_fault, ''
        self.apply({'fault': pending})
        self._reader.start()

    def deactivate(self) -> None:
        """End the reader; the port is free then."""
        if self._reader is not None:
            self._reader.close()
            self._reader = None
        if self._views is not None:
            self._views.close()
            self._views = None

    def cleanup(self) -> None:
        """Free the port, end the twin."""
        self.deactivate()
        self._held.close()
        self._twin = self._truth = self._truths = None

    def check(self, changes: dict[str, object]) -> None:
        """Refuse a fault that this sensor cannot suffer."""
        fault = str(changes.get('fault', ''))
        if not fault:
            return
        simulated = changes.get('simulated', self.get_parameter('simulated').value)
        if self._twin is not None:
            if fault != RELIEF:
                parse_fault(fault, self._twin.faults)
        elif self._reader is not None or not simulated:
            msg = f'fault must be empty where the sensor is not simulated; received {fault!r}'
            raise ValueError(msg)

    def apply(self, changes: dict[str, object]) -> None:
        """Let the twin suffer a fault."""
        fault = str(changes.get('fault', ''))
        if fault == RELIEF and self._twin is not None:
            self._twin.relieve()
        elif fault and self._twin is not None:
            name, count = parse_fault(fault, self._twin.faults)
            self._twin.inject(name, count)
            self.get_logger().info(f'the twin suffers {name}, {count} times')

    def _is_awaited(self) -> bool:
        """Everybody who must see the first frame is there."""
        heard = self._frames.get_subscription_count() >= self._options.listeners
        return heard and (self._waits_for is None or self._waits_for())

    def _deliver(self, frames: Sequence[Frame]) -> None:
        """Hand frames on and publish them."""
        frame_id = self._options.frame_id
        if self._downstream is not None:
            self._downstream(frames, frame_id)
        for frame in frames:
            self._publish(frame, frame_id)

    def _publish(self, frame: Frame, frame_id: str) -> None:
        """Publish a frame and its views, each where somebody listens."""
        if self._frames.get_subscription_count():
            message = TactileFrame()
            messages.fill_frame(message, frame, frame_id)
            self._frames.publish(message)
        self._views.publish(frame, frame_id)
        if self._truths is not None and self._truths.get_subscription_count():
            self._publish_truth(frame, frame_id)

    def _publish_truth(self, frame: Frame, frame_id: str) -> None:
        """What the twin's signal says at the frame's stamp."""
        state, groups = self._truth.at(frame.stamp_ns, frame.device_time_ns)
        message = TactileContacts()
        messages.fill_contacts(message, state, TactileContact)
        messages.fill_header(message.header, frame.stamp_ns, frame_id)
        message.sequence = frame.sequence
        for name, value in groups.items():
            setattr(message, name, value)
        self._truths.publish(message)

    def diagnose(self) -> DiagnosticStatus:
        """Connection, rate, jitter, losses, taxels and temperature."""
        if self._reader is None:
            return DiagnosticStatus(level=DiagnosticStatus.STALE, name='sensor')
        self._views.look()
        more = {'simulated': self._twin is not None}
        if self._twin is not None:
            suffered = {name: n for name, n in self._twin.injected.items() if n}
            more['injected'] = ', '.join(f'{n} {k}' for k, n in suffered.items()) or 'nothing'
        reader = self._reader
        level, message, values = self._health.judge(
            reader.reading, reader.counters(), reader.is_open, more
        )
        status = DiagnosticStatus(level=level, name='sensor', message=message)
        status.hardware_id = self._health.hardware_id
        status.values = pairs(values)
        return status


def build() -> Sequence[ManagedNode]:
    """The node of this executable."""
    return [SensorNode()]


def main() -> None:
    """Run sensor_node until it is told to stop."""
    main_of(build)


if __name__ == '__main__':
    main()
