# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""sensor_node: read one tactile sensor, real or simulated, and publish its frames."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import replace
from math import nan
from queue import Empty, SimpleQueue

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import Point, Quaternion

from tactile_ros import messages
from tactile_ros.enrolment import playing
from tactile_ros.errors import DeviceError, DeviceTimeout, TactileError
from tactile_ros.msg import TactileContacts, TactileFrame, TactileLayout
from tactile_ros.nodes.graph import frame_of
from tactile_ros.nodes.lifecycle import ManagedNode, diagnostic, qos
from tactile_ros.nodes.parameters import SensorOptions
from tactile_ros.nodes.standard_messages import FrameViews, TruthMessages, header_of
from tactile_ros.sensors import load_sensor
from tactile_ros.types import Device, Frame, Layout, TaxelStatus, Twin

READ_TIMEOUT_S = 0.25
FIRST_RETRY_S = 0.1
LONGEST_RETRY_S = 0.5
REPEAT_S = 10.0  # the same failure is not logged again before
MOST_DISCARDING_S = 0.5
MOST_FRAMES = 10_000
AT_ONCE = 0.5  # of a frame's period: what takes less to read was not waited for
RARELY = 0.05  # a quiet chip repeats itself now and then
SLOW, JITTERY = 0.8, 0.5  # of the nominal rate and of its period
TAXELS = {
    'saturated taxels': TaxelStatus.SATURATED,
    'wrapped taxels': TaxelStatus.WRAPPED,
    'stuck taxels': TaxelStatus.STUCK,
    'taxels in error': TaxelStatus.ERROR,
    'stale taxels': TaxelStatus.STALE,
}
# always reported, also by drivers whose protocol does not have them
EXPECTED = ('dropped', 'crc_errors', 'framing_errors', 'resets', 'reconnects')
# growth of these alone is no trouble
HARMLESS = ('frames', 'not_ready', 'saturated', 'stale', 'repeated', 'missing', 'other_kind')
NOT_MEASURED = 'not measured'
MOST_FAULTS = 1000
RELIEF = 'none'


class SensorDiagnostics:
    """Frames counted by the reader, judged once a second.

    `overruns`: frames pushed out of a full queue; `failures`: errors of the device or a listener;
    `waiting`: somebody who listens is not there yet; `sentence`: why nothing comes, else empty.
    """

    def __init__(self, nominal_hz: float = nan) -> None:
        self.nominal_hz = nominal_hz
        self.frames = self.overruns = self.failures = 0
        self.waiting = False
        self.sentence = 'no frame yet'
        self.last: Frame | None = None
        self._recent: deque[Frame] = deque(maxlen=MOST_FRAMES)  # since the last status
        self._before: dict[str, int] = {}

    def note(self, frame: Frame) -> None:
        """Count a frame."""
        self.frames += 1
        self.last = frame
        self._recent.append(frame)

    def judge(
        self, counters: Mapping[str, int], is_open: bool
    ) -> tuple[bytes, str, dict[str, object]]:
        """Level, sentence and values for the time since the last call, with a device's counters.

        WARN: frames come, but something needs attention; ERROR: none come; STALE: none are read.
        """
        recent, self._recent = list(self._recent), deque(maxlen=MOST_FRAMES)
        rate_hz, jitter_s = pace([frame.stamp_ns or 0 for frame in recent])
        reasons = [self._slowness(rate_hz, jitter_s), *_flags(recent)]
        reasons += [*self._grown({**counters, 'overruns': self.overruns}), self.sentence]
        level, message = DiagnosticStatus.OK, f'{len(recent)} frames in the last second'
        connection = 'streaming'
        if self.waiting and not self.frames:
            level, connection = DiagnosticStatus.STALE, 'open, not read yet'
            message = 'not read before all listeners are there'
        elif not recent or not is_open:
            level, connection = DiagnosticStatus.ERROR, 'silent'
            message = self.sentence or 'no frame came'
        elif any(reasons):
            level = DiagnosticStatus.WARN
            message = '; '.join([message, *filter(None, reasons)])
        values = {
            'connection': connection if is_open else 'not open',
            'rate (Hz)': rate_hz,
            'nominal rate (Hz)': self.nominal_hz,
            'jitter (ms)': 1e3 * jitter_s,
            'frames': self.frames,
            'queue overruns': self.overruns,
            'failures': self.failures,
            **dict.fromkeys(EXPECTED, 'not in this protocol'),
            **counters,
            **taxels_of(self.last),
        }
        return level, message, values

    def _grown(self, counters: Mapping[str, int]) -> list[str]:
        before, self._before = self._before, dict(counters)
        more = {n: v - before.get(n, 0) for n, v in counters.items() if n not in HARMLESS}
        return [f'{count} {name.replace("_", " ")}' for name, count in more.items() if count > 0]

    def _slowness(self, rate_hz: float, jitter_s: float) -> str:
        if rate_hz < SLOW * self.nominal_hz:
            return f'{rate_hz:.3g} Hz instead of {self.nominal_hz:g} Hz'
        irregular = jitter_s * self.nominal_hz > JITTERY
        return f'frames come irregularly: jitter {1e3 * jitter_s:.2g} ms' if irregular else ''


def taxels_of(frame: Frame | None) -> dict[str, object]:
    """Taxels of a frame by their status bits, and its coldest and hottest chip (C)."""
    status, chips = (None, None) if frame is None else (frame.status, frame.temperature_c)
    bits = np.zeros(0, np.uint8) if status is None else status
    measured = chips is not None and bool(np.isfinite(chips).any())
    return {
        **{name: np.flatnonzero(bits & bit).tolist() for name, bit in TAXELS.items()},
        'lowest temperature (C)': float(np.nanmin(chips)) if measured else NOT_MEASURED,
        'highest temperature (C)': float(np.nanmax(chips)) if measured else NOT_MEASURED,
    }


def _flags(frames: Sequence[Frame]) -> list[str]:
    """Names of the taxel states that came up in frames; STALE only if it came often."""
    rows = [frame.status for frame in frames if frame.status is not None]
    seen = np.bitwise_or.reduce(rows, axis=1) if rows else np.zeros(0, np.uint8)
    bits = int(np.bitwise_or.reduce(seen))
    if np.count_nonzero(seen & TaxelStatus.STALE) <= RARELY * len(frames):
        bits &= ~TaxelStatus.STALE
    return [name for name, bit in TAXELS.items() if bits & bit]


def pace(stamps_ns: Sequence[int]) -> tuple[float, float]:
    """Rate (Hz) and standard deviation of the period (s) of acquisition times; NaN: too few."""
    gaps = np.diff(np.asarray(stamps_ns, np.int64)) * 1e-9
    gaps = gaps[gaps > 0]
    rate_hz = 1.0 / float(gaps.mean()) if len(gaps) else nan
    return rate_hz, float(gaps.std()) if len(gaps) > 1 else nan


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
    ready : callable
        Nothing is read before it returns True.
    queue : int
        Frames that may wait for `deliver` and its own thread; a full queue loses the oldest, which
        is counted. 0: there is none.
    kept_back_s : float
        Discard first what the port hands over faster than this: its age is unknown (s).
    """

    def __init__(
        self,
        device: Device,
        deliver: Callable[[Sequence[Frame]], None],
        complain: Callable[[str], None],
        ready: Callable[[], bool] = lambda: True,
        queue: int = 0,
        kept_back_s: float = 0.0,
        nominal_hz: float = nan,
    ) -> None:
        self.diagnostics = SensorDiagnostics(nominal_hz)
        self.is_open = False
        self.device, self._deliver, self._complain = device, deliver, complain
        self._ready, self._limit, self._kept_back_s = ready, queue, kept_back_s
        self._queue: SimpleQueue[Frame | None] = SimpleQueue()
        self._stop = threading.Event()
        self._opened = ExitStack()
        self._complained: dict[str, float] = {}
        self._thread = threading.Thread(target=self._run, name='reader', daemon=True)
        self._handing = threading.Thread(target=self._hand_on, name='reader_queue', daemon=True)

    def open(self) -> None:
        """Open the device; where its port is missing, the thread goes on trying."""
        try:
            self._opened.enter_context(self.device)
            self.is_open = True
        except DeviceError as err:
            self._note(f'{err}; trying again')

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

    def _run(self) -> None:
        """Open, wait for the listeners, read, hand on."""
        self._await_device()
        self.diagnostics.waiting = True
        while not self._ready():
            if self._stop.wait(0.01):
                return
        self.diagnostics.waiting = False
        self._discard()
        while not self._stop.is_set():
            try:
                frames = [self.device.read(READ_TIMEOUT_S), *self.device.waiting()]
            except DeviceTimeout as err:
                self._note(str(err))
            except Exception as err:  # also what no driver may do
                self._fail(err)
                self._stop.wait(FIRST_RETRY_S)
            else:
                for frame in frames:
                    self.diagnostics.note(frame)
                self.diagnostics.sentence = ''
                (self._queue_up if self._limit else self._pass_on)(frames)

    def _await_device(self) -> None:
        pause = FIRST_RETRY_S
        while not self.is_open and not self._stop.wait(pause):
            pause = min(2 * pause, LONGEST_RETRY_S)
            try:
                self.open()
            except (TactileError, OSError, ValueError) as err:
                self._note(f'{err}; trying again')

    def _discard(self) -> None:
        """Read on until a frame has to be waited for."""
        end = time.monotonic() + MOST_DISCARDING_S
        took = 0.0
        with suppress(Exception):  # a failure is reported by the reading that follows
            while took < self._kept_back_s and time.monotonic() < end and not self._stop.is_set():
                began = time.monotonic()
                self.device.read(0.0)
                took = time.monotonic() - began

    def _queue_up(self, frames: Sequence[Frame]) -> None:
        for frame in frames:
            if self._queue.qsize() >= self._limit:
                with suppress(Empty):  # it has just been taken
                    self._queue.get_nowait()
                    self.diagnostics.overruns += 1
            self._queue.put(frame)

    def _hand_on(self) -> None:
        while (frame := self._queue.get()) is not None:
            lost = self.diagnostics.overruns
            self._pass_on([replace(frame, dropped=frame.dropped + lost) if lost else frame])

    def _pass_on(self, frames: Sequence[Frame]) -> None:
        """Hand frames on; a failure there is logged and costs them alone."""
        try:
            self._deliver(frames)
        except Exception as err:  # whatever listens must not end the sensor
            self._fail(err)

    def _fail(self, err: Exception) -> None:
        self.diagnostics.failures += 1
        foreseen = isinstance(err, (TactileError, OSError))
        self._note(str(err) if foreseen else f'{type(err).__name__}: {err}')

    def _note(self, sentence: str) -> None:
        """Complain about each new reason, and about one that comes and goes now and then."""
        self.diagnostics.sentence = sentence
        now = time.monotonic()
        if now - self._complained.get(sentence, -REPEAT_S) >= REPEAT_S:
            self._complained = {sentence: now}
            self._complain(sentence)


def parse_fault(text: str, possible: Sequence[str]) -> tuple[str, int]:
    """Name and count of a fault, given as `name` or `name:count`; ValueError if not possible."""
    name, _, count = text.strip().partition(':')
    times = int(count) if count.isascii() and count.isdecimal() else int(not count)
    if name not in possible or not 1 <= times <= MOST_FAULTS:
        msg = (
            f'fault must be one of {", ".join(possible)}, with :count of 1 to {MOST_FAULTS} where '
            f'it is to happen more than once; received {text!r}'
        )
        raise ValueError(msg)
    return name, times


class SensorNode(ManagedNode):
    """Publish `frame`, `layout` (latched) and /diagnostics of one sensor, real or simulated.

    On demand also `magnetic_field/chip_<i>` and `image`, and of a twin `truth/contacts`.
    `downstream` takes all frames that came together, and the name of their tf frame, in the
    reader's thread, without a queue; `waits_for` is a further condition for the first frame.
    """

    def __init__(
        self,
        downstream: Callable[[Sequence[Frame], str], None] | None = None,
        waits_for: Callable[[], bool] = lambda: True,
        arguments: Sequence[str] = (),
    ) -> None:
        super().__init__('sensor_node', arguments)
        self._twin: Twin | None = None
        self._reader: Reader | None = None
        self._options = SensorOptions()
        self.declare(self._options)
        self._spec = load_sensor(self.get_parameter('sensor').value)
        self._config, self._connection = self._spec.config(), self._spec.connection()
        self.declare(self._config, self._connection)
        self._frames = self.managed_publisher(TactileFrame, 'frame')
        self._layouts = self.managed_publisher(TactileLayout, 'layout')
        self._downstream, self._waits_for = downstream, waits_for
        self._layout: Layout | None = None
        self._views: FrameViews | None = None
        self._held = ExitStack()
        self._truth = self._truths = None
        self._pending_fault = ''

    def configure(self) -> None:
        """Check the parameters and open the device; a missing port is logged and tried again."""
        self._options = options = self.options(SensorOptions)
        self._config = self.options(type(self._config))
        self._connection = self.options(type(self._connection))
        frame_id = frame_of(self.get_namespace(), options.frame_id, options.frame_prefix)
        layout = self._spec.layout(self._config)
        self._layout = replace(layout, frame_id=frame_id, serial=options.serial)
        if options.simulated:
            self._begin_twin()
        self.check({'fault': options.fault})
        self._pending_fault = options.fault
        self._open()

    def _begin_twin(self) -> None:
        config, seed, signal = self._config, self._options.seed, None
        if self._options.scene == 'presses':  # the twin's own signal
            recording = self._spec.presses(config, seed)
        elif self._spec.new_class is None:
            msg = f'scene of {self._spec.key} must be presses; it shows no new class'
            raise ValueError(msg)
        else:
            recording = self._spec.new_class.scene(config, seed, 0.0)
            signal = playing(recording)
        twin = self._spec.simulate(config, self._connection, signal, seed)
        self._twin = self._held.enter_context(twin)
        self._truth = TruthMessages(recording, self.now_ns())
        self._truths = self.create_publisher(TactileContacts, 'truth/contacts', qos())
        self._held.callback(self.destroy_publisher, self._truths)

    def _open(self) -> None:
        """Open a fresh device: its frames count from 0."""
        if self._twin is None:
            device = self._spec.open(self._config, self._connection, self.now_ns)
        else:
            device = self._twin.device(self.now_ns)
        rate_hz, options = self._layout.rate_hz, self._options
        # not a fixed time: on a busy machine it takes milliseconds to decode what waits
        kept_back_s = AT_ONCE / rate_hz if rate_hz > 0 else 1.0
        queue = options.queue if self._downstream is None else 0
        kept_back_s = kept_back_s if options.discard_stale else 0.0
        complain = self.get_logger().warning  # it is tried again; diagnostics say ERROR
        self._reader = Reader(
            device, self._deliver, complain, self._is_awaited, queue, kept_back_s, rate_hz
        )
        self._reader.open()

    def activate(self) -> None:
        """Publish the layout and begin to read."""
        if self._reader is None:
            self._open()
        message = TactileLayout()
        messages.fill_layout(message, self._layout, Point, Quaternion)
        message.header.stamp = self.get_clock().now().to_msg()
        self._layouts.publish(message)
        options = self._options
        self._views = FrameViews(self, self._layout, options.magnetic_field, options.image)
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
        simulated = changes.get('simulated', self.get_parameter('simulated').value)
        if self._twin is not None:
            if fault not in ('', RELIEF):
                parse_fault(fault, self._twin.faults)
        elif fault and (self._reader is not None or not simulated):
            msg = f'fault must be empty where the sensor is not simulated; received {fault!r}'
            raise ValueError(msg)

    def apply(self, changes: dict[str, object]) -> None:
        """Let the twin suffer a fault."""
        fault = str(changes.get('fault', ''))
        if not fault or self._twin is None:
            return
        if fault == RELIEF:
            self._twin.relieve()
            return
        name, count = parse_fault(fault, self._twin.faults)
        self._twin.inject(name, count)
        self.get_logger().info(f'the twin suffers {name}, {count} times')

    def _is_awaited(self) -> bool:
        heard = self._frames.get_subscription_count() >= self._options.listeners
        return heard and self._waits_for()

    def _deliver(self, frames: Sequence[Frame]) -> None:
        """Hand frames on and publish them and their views, each where somebody listens."""
        frame_id = self._layout.frame_id
        if self._downstream is not None:
            self._downstream(frames, frame_id)
        for frame in frames:
            if self._frames.get_subscription_count():
                message = TactileFrame()
                messages.fill_frame(message, frame, frame_id)
                self._frames.publish(message)
            self._views.publish(frame, frame_id)
            if self._truths is not None and self._truths.get_subscription_count():
                row = self._truth.row_at(frame.stamp_ns, frame.device_time_ns)
                header = header_of(frame.stamp_ns, frame_id)
                self._truths.publish(self._truth.message(row, header, frame.sequence))

    def diagnose(self) -> DiagnosticStatus:
        """Connection, rate, jitter, losses, taxels and temperature."""
        reader = self._reader
        if reader is None:
            return DiagnosticStatus(level=DiagnosticStatus.STALE, name='sensor')
        self._views.offer()
        level, message, values = reader.diagnostics.judge(reader.device.counters(), reader.is_open)
        values['simulated'] = self._twin is not None
        if self._twin is not None:
            suffered = [f'{n} {name}' for name, n in self._twin.injected.items() if n]
            values['injected'] = ', '.join(suffered) or 'nothing'
        hardware_id = f'{self._spec.key} {self._options.serial}'.strip()
        return diagnostic('sensor', message, values, level, hardware_id)
