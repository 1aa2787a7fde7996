# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Simulated boards on pseudo-terminals: the bytes of the real ones, with noise and faults."""

from __future__ import annotations

import os
import select
import tempfile
import threading
import time
import tty
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from tactile_ros.devices import framed_protocol, reskin_protocol, text_lines
from tactile_ros.devices.framed_protocol import Payload
from tactile_ros.devices.timestamps import VirtualClock
from tactile_ros.errors import DeviceError, DeviceTimeout
from tactile_ros.types import Array, Closing, Device, Layout

Driver = Callable[[str, Callable[[], int]], Device]  # on a port, with stamps by a clock (ns)

BYTE_FAULTS = ('dropped', 'doubled', 'flipped', 'garbage', 'inserted', 'truncated', 'shifted')
SERIAL_FAULTS: tuple[str, ...] = (
    *BYTE_FAULTS, 'lost', 'stall', 'unplug', 'stuck_chip', 'saturation',
)  # fmt: skip
LONGEST_RUN = 16
STALL_S = 0.5
AWAY_S = 1.0
LEAST_JUMP_S, MOST_JUMP_S = 2.0, 1000.0
MOST_WAITING = 10_000
# a driver that has just opened the port has no frame yet after which it could count a loss
CALM_S = 0.1
PATIENCE_S, LONGEST_S = 0.2, 5.0  # for a full port to be read: in real time, by hand
SHORTEST_PAUSE_S = 0.002  # frames are written together as USB delivers them
NAN_BYTES = b'\x00\x00\xc0\x7f'


def damage(frame: bytes, kind: str, rng: np.random.Generator) -> bytes:
    """Damage the bytes of one frame, at least two, by one of `BYTE_FAULTS`.

    dropped: 1 to 4 bytes in a row; doubled: one byte; flipped: one bit; garbage: 1 to 16 bytes
    overwritten; inserted: 1 to 16 foreign bytes; truncated: the tail; shifted: one byte lost and
    another doubled, the length kept.
    """
    here, there = (int(place) for place in np.sort(rng.integers(len(frame), size=2)))
    run = rng.bytes(int(rng.integers(1, LONGEST_RUN + 1)))
    damaged = {
        'dropped': frame[:here] + frame[here + 1 + run[0] % 4 :],
        'doubled': frame[: here + 1] + frame[here:],
        'flipped': frame[:here] + bytes([frame[here] ^ 1 << run[0] % 8]) + frame[here + 1 :],
        'garbage': (frame[:here] + run + frame[here + len(run) :])[: len(frame)],
        'inserted': frame[:here] + run + frame[here:],
        'truncated': frame[:here],
        'shifted': frame[:here] + frame[here + 1 : there + 1] + frame[there:],
    }
    return damaged[kind]


class SimulatedSerialPort(Closing):
    """A port that programs open as they open a board's; `port` stays its path through `unplug`."""

    def __init__(self) -> None:
        self._folder = tempfile.TemporaryDirectory(prefix='tactile_port_')
        self._link = Path(self._folder.name) / 'board'
        self.port = str(self._link)
        self._master = -1
        self._lock = threading.Lock()
        self.replug()

    def close(self) -> None:
        """Unplug and remove the path; closing twice is allowed."""
        self.unplug()
        self._folder.cleanup()

    def unplug(self) -> None:
        """Take the port away under the feet of whoever reads it."""
        with self._lock:
            master, self._master = self._master, -1
            self._link.unlink(missing_ok=True)
            if master >= 0:
                os.close(master)

    def replug(self) -> None:
        """Put the port back under the same path."""
        with self._lock:
            if self._master >= 0:
                return
            self._master, slave = os.openpty()
            tty.setraw(slave)
            os.set_blocking(self._master, False)
            self._link.symlink_to(os.ttyname(slave))
            # with no end of ours open, a hang-up shows that nobody reads
            os.close(slave)

    @property
    def watched(self) -> bool:
        """True while a program has the port open."""
        return not self._poll(0, 0.0) & (select.POLLHUP | select.POLLNVAL)

    def wait_for_reader(self, timeout: float = 10.0) -> None:
        """Return when a program has opened the port; DeviceTimeout after `timeout` (s)."""
        deadline = time.monotonic() + timeout
        while not self.watched:
            if time.monotonic() > deadline:
                msg = f'nobody opened {self.port} within {timeout:g} s'
                raise DeviceTimeout(msg)
            # the kernel wakes nobody when a slave is opened
            time.sleep(0.002)

    def _poll(self, events: int, timeout: float) -> int:
        """Events on our end within a time (s); POLLNVAL when unplugged."""
        if self._master < 0:
            return select.POLLNVAL
        poll = select.poll()
        poll.register(self._master, events)
        return sum(event for _, event in poll.poll(timeout * 1e3))

    def send(self, data: bytes, timeout: float = LONGEST_S) -> None:
        """Write bytes as the board would; return when the port has taken them.

        A DeviceTimeout says that nobody reads within `timeout` (s), a DeviceError that the port is
        unplugged.
        """
        deadline = time.monotonic() + timeout
        while data:
            taken = self._write(data)
            data = data[taken:]
            remaining = deadline - time.monotonic()
            if data and remaining <= 0:
                msg = f'nobody reads {self.port}: {len(data)} bytes were not taken'
                raise DeviceTimeout(msg)
            if data and not taken:
                # in pieces, since unplugging wakes nobody
                self._poll(select.POLLOUT, min(0.05, remaining))

    def _write(self, data: bytes) -> int:
        """Write what fits now."""
        with self._lock:
            if self._master < 0:
                msg = f'{self.port} is unplugged'
                raise DeviceError(msg)
            try:
                return os.write(self._master, data)
            except BlockingIOError:
                return 0


@dataclass(kw_only=True, eq=False)
class SerialTwin(Closing):
    """A simulated board: port, pace, noise and faults of all kinds of boards.

    Parameters
    ----------
    layout : Layout
        Of the sensor; its `rate_hz` is the board's.
    driver : callable
        The real one, on a port and with a clock (ns).
    signal, temperature_c : callable, callable or None
        Time since the start (s) -> values (t, c) (unit of the layout); chip temperatures (t,)
        (degrees Celsius), None: 25.
    noise, seed : array_like, broadcast to (t, c), int
        Standard deviation of white noise (unit of the layout); of noise and faults.
    clock : VirtualClock or None
        Moved by `play`, which sends frames as fast as they are read; None: a thread sends them in
        real time between enter and exit.

    Notes
    -----
    `injected` counts faults that have happened, byte faults only where the frame was really
    damaged; `overruns` writes that the program at the port did not take in 0.2 s: those frames are
    lost, too. In real time, faults wait until a program has had the port open for 0.1 s.

    stall: nothing is measured for 0.5 s. unplug: the port goes for 1 s, and the board starts anew.
    stuck_chip: one taxel repeats its last reading, or all do where one converter reads them.
    saturation: one reads its limit, where there is one. `unseen` are faults that a format without
    a checksum cannot always show.
    """

    faults = SERIAL_FAULTS
    unseen: ClassVar[tuple[str, ...]] = ()
    one_converter = False

    layout: Layout
    driver: Driver
    signal: Callable[[float], Array]
    noise: npt.ArrayLike = 0.0
    temperature_c: Callable[[float], Array] | None = None
    seed: int = 0
    clock: VirtualClock | None = None

    def __post_init__(self) -> None:
        hertz = self.layout.rate_hz
        if not 0 < hertz < np.inf:
            msg = f'rate_hz of the layout of a twin must be above 0; received {hertz}'
            raise ValueError(msg)
        if not np.isfinite(self._limit()).all():
            self.faults = tuple(fault for fault in self.faults if fault != 'saturation')
        self.injected: dict[str, int] = dict.fromkeys(self.faults, 0)
        self.overruns = 0
        self._rng = np.random.default_rng(self.seed)
        self._port: SimulatedSerialPort | None = None
        self._waiting: list[str] = []
        self._lock = threading.Lock()
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None
        self._step = self._silent = self._calm = 0  # periods
        self._away = False
        self._last: Array | None = None

    @property
    def port(self) -> str:
        """Path of the port; it stays the same through `unplug`."""
        return self._line.port

    @property
    def awaited(self) -> bool:
        """True while the port is there and no program has it open."""
        return not self._away and not self._line.watched

    @property
    def _line(self) -> SimulatedSerialPort:
        """The port, made when it is first needed."""
        if self._port is None:
            self._port = SimulatedSerialPort()
        return self._port

    def open(self) -> None:
        """Plug in and, without a virtual clock, begin to send."""
        _ = self._line
        if self.clock is None and self._thread is None:
            self._stop.clear()
            self._thread = threading.Thread(target=self._run, daemon=True)
            self._thread.start()

    def close(self) -> None:
        """Stop sending and remove the port."""
        self._stop.set()
        thread, self._thread = self._thread, None
        if thread is not None:
            thread.join()
        port, self._port = self._port, None
        if port is not None:
            port.close()

    def device(self, clock_ns: Callable[[], int]) -> Device:
        """The real driver on this twin's port, stamped by `clock_ns`; not yet entered."""
        return self.driver(self.port, clock_ns)

    def inject(self, fault: str, count: int = 1) -> None:
        """Let the next `count` frames suffer a fault, after those that are waiting already.

        A fault that is none of `faults`, or more than 10 000 that wait, is a ValueError.
        """
        msg = f'fault must be one of {", ".join(self.faults)}; received {fault!r}'
        with self._lock:
            waiting = len(self._waiting)
            if fault in self.faults and waiting + count <= MOST_WAITING:
                self._waiting += [fault] * count
                return
        if fault in self.faults:
            msg = f'at most {MOST_WAITING} faults may wait; {waiting} do, received {count} more'
        raise ValueError(msg)

    def relieve(self) -> None:
        """Withdraw the faults that wait; one that has begun takes its course."""
        with self._lock:
            self._waiting.clear()

    def play(self, count: int) -> None:
        """Send `count` frames at once, each a period of the virtual clock; return when taken."""
        for _ in range(count):
            data = self.period()
            if data:
                self._line.send(data)

    def period(self) -> bytes:
        """Bytes of the next period of the virtual clock, for whoever carries them to a reader."""
        data = self._next()
        if self.clock is not None:
            self.clock.sleep(1.0 / self.layout.rate_hz)
        return data

    def _run(self) -> None:
        """Send on schedule while somebody reads; what is not taken in time is lost."""
        start, sent, rate_hz = time.monotonic(), 0, self.layout.rate_hz
        calm = self._calm = round(CALM_S * rate_hz)
        while True:
            due = start + sent / rate_hz - time.monotonic()
            if self._stop.wait(max(SHORTEST_PAUSE_S, due)):
                return
            count = int((time.monotonic() - start) * rate_hz) + 1 - sent
            sent += count
            watched = self._line.watched
            self._calm = self._calm - count if watched else calm
            data = b''.join([self._next() for _ in range(count)])
            if data and watched:
                try:
                    self._line.send(data, timeout=PATIENCE_S)
                except DeviceError:
                    self.overruns += 1

    def _next(self) -> bytes:
        """Bytes of the next period, with the fault that waits; none while stalled or away."""
        t = self._step / self.layout.rate_hz
        self._step += 1
        if self._silent:
            self._silent -= 1
            if self._away and not self._silent:
                self._away = False
                self._boot(t)
                self._line.replug()
            return b''
        with self._lock:
            fault = self._waiting.pop(0) if self._waiting and self._calm <= 0 else ''
        if fault:
            self.injected[fault] += 1
        if fault == 'stall':
            self._silent = max(1, round(STALL_S * self.layout.rate_hz)) - 1
            return b''
        if fault == 'unplug':
            self._silent, self._away = max(1, round(AWAY_S * self.layout.rate_hz)), True
            self._line.unplug()
            return b''
        temperature = 25.0 if self.temperature_c is None else self.temperature_c(t)
        values = self._sample(t, fault)
        intact = data = self._bytes(values, np.broadcast_to(temperature, len(values)), t, fault)
        while fault in BYTE_FAULTS and (not data or intact in data):
            data = damage(intact, fault, self._rng)
        return b'' if fault == 'lost' else data

    def _sample(self, t: float, fault: str) -> Array:
        """Values with noise, with one taxel stuck or saturated, or all of a converter stuck."""
        noise = np.asarray(self.noise) * self._rng.standard_normal(self.layout.shape)
        values = np.asarray(self.signal(t), np.float64) + noise
        if fault == 'saturation':
            values[int(self._rng.integers(len(values)))] = self._limit()
        elif fault == 'stuck_chip' and self._last is not None:
            stuck = slice(None) if self.one_converter else slice(1)
            values[stuck] = self._last[stuck]
        self._last = values
        return values

    def _boot(self, t: float) -> None:
        """Start the board anew, as when power comes back at time t (s)."""

    def _limit(self) -> Array:
        """Values at which the board saturates, broadcast to (c,) (unit of the layout)."""
        return np.asarray(self.layout.saturation, np.float64)

    def _bytes(self, values: Array, temperature_c: Array, t: float, fault: str) -> bytes:
        """One frame as the board sends it."""
        raise NotImplementedError


@dataclass(kw_only=True, eq=False)
class ReskinTwin(SerialTwin):
    """The ReSkin / AnySkin board: float32 readings (T) without sequence or clock.

    Chips clip at the `saturation` of the layout; `quantum`, broadcast to (3,), is their step (T).
    nan: one field of a frame becomes not a number. Flipped, garbage and shifted may pass
    undetected.
    """

    faults = (*SERIAL_FAULTS, 'nan')
    unseen = ('flipped', 'garbage', 'shifted')

    quantum: npt.ArrayLike | None = None

    def _bytes(self, values: Array, temperature_c: Array, t: float, fault: str) -> bytes:
        if self.quantum is not None:
            values = np.rint(values / np.asarray(self.quantum)) * self.quantum
        data = reskin_protocol.encode(values, temperature_c)
        if fault != 'nan':
            return data
        place = 4 * int(self._rng.integers(len(data) // 4))
        return data[:place] + NAN_BYTES + data[place + 4 :]


@dataclass(kw_only=True, eq=False)
class FramedTwin(SerialTwin):
    """A board of the framed protocol: counts, sequence and a clock that jumps.

    Values are rounded to counts and clipped at the converter's limit. clock_jump: the board's
    clock jumps by 2 to 1000 s, ahead or back.
    """

    faults = (*SERIAL_FAULTS, 'clock_jump')

    payload: Payload
    scale: npt.ArrayLike

    def __post_init__(self) -> None:
        super().__post_init__()
        self.one_converter = self.payload.one_converter
        self._origin_us = 0.0
        self._sequence = 0

    def _boot(self, t: float) -> None:
        self._sequence = 0
        self._origin_us = -t * 1e6

    def _limit(self) -> Array:
        scale = np.broadcast_to(np.asarray(self.scale, np.float64), self.layout.shape)
        return np.asarray(scale[0] * self.payload.full_count)

    def _bytes(self, values: Array, temperature_c: Array, t: float, fault: str) -> bytes:
        if fault == 'clock_jump':
            jump = self._rng.uniform(LEAST_JUMP_S, MOST_JUMP_S) * self._rng.choice((-1, 1))
            self._origin_us += round(jump * 1e6)
        time_us = round(self._origin_us + t * 1e6)
        counts = np.rint(values / np.asarray(self.scale)).astype(np.int64)
        sequence, self._sequence = self._sequence, self._sequence + 1
        return framed_protocol.encode(self.payload, counts, sequence, time_us, temperature_c)


@dataclass(kw_only=True, eq=False)
class LineTwin(SerialTwin):
    """A board that prints lines of numbers with so many `decimals`; hurt digits are not seen."""

    unseen = BYTE_FAULTS
    one_converter = True

    scale: float
    decimals: int

    def _bytes(self, values: Array, temperature_c: Array, t: float, fault: str) -> bytes:
        return text_lines.encode(values / self.scale, self.decimals)
