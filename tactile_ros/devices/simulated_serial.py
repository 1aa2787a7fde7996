"""Simulated boards on pseudo-terminals: the bytes of the real ones, with noise and faults."""

from __future__ import annotations

import os
import select
import tempfile
import threading
import time
import tty
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal, TypeVar, get_args

import numpy as np
import numpy.typing as npt

from tactile_ros.devices import framed_protocol, reskin_protocol
from tactile_ros.devices.framed_protocol import Kind
from tactile_ros.devices.reskin_protocol import ReskinDecoder
from tactile_ros.devices.serial_board import FramedBoard, SerialBoard
from tactile_ros.errors import DeviceError, DeviceTimeout
from tactile_ros.types import Array, Closing, Layout

if TYPE_CHECKING:
    from collections.abc import Callable

    from tactile_ros.devices.framed_protocol import Payload
    from tactile_ros.devices.timestamps import VirtualClock
    from tactile_ros.types import Device

Damage = Literal['dropped', 'doubled', 'flipped', 'garbage', 'inserted', 'truncated', 'shifted']

DAMAGES: tuple[Damage, ...] = (
    'dropped', 'doubled', 'flipped', 'garbage', 'inserted', 'truncated', 'shifted',
)  # fmt: skip
LONGEST_RUN = 16
HARMLESS_MICROTESLA = 1.0


def damage(frame: bytes, kind: Damage, rng: np.random.Generator) -> bytes:
    """Damage the bytes of one frame.

    Parameters
    ----------
    frame : bytes
        At least two bytes.
    kind : Damage
        dropped: 1 to 4 bytes in a row; doubled: one byte; flipped: one bit; garbage: 1 to 16 bytes
        overwritten; inserted: 1 to 16 foreign bytes; truncated: the tail from anywhere on;
        shifted: one byte lost and another doubled, the length kept.
    rng : Generator
        Where, how many, and what.

    Returns
    -------
    bytes
        The damaged frame.
    """
    here, there = (int(place) for place in np.sort(rng.integers(len(frame), size=2)))
    run = rng.bytes(int(rng.integers(1, LONGEST_RUN + 1)))
    hurt: dict[Damage, bytes] = {
        'dropped': frame[:here] + frame[here + 1 + run[0] % 4 :],
        'doubled': frame[: here + 1] + frame[here:],
        'flipped': frame[:here] + bytes([frame[here] ^ 1 << run[0] % 8]) + frame[here + 1 :],
        'garbage': (frame[:here] + run + frame[here + len(run) :])[: len(frame)],
        'inserted': frame[:here] + run + frame[here:],
        'truncated': frame[:here],
        'shifted': frame[:here] + frame[here + 1 : there + 1] + frame[there:],
    }
    return hurt[kind]


@dataclass(frozen=True)
class Unseen:
    """Outcome of damage of one kind.

    Attributes
    ----------
    kind : str
        Kind of damage.
    trials : int
        Damaged frames, each between good ones.
    passed : float
        Share of the damaged frames that were delivered with wrong numbers.
    misled : float
        Share of them whose numbers are wrong by more than 1 uT (1 degree Celsius) somewhere.
    good_lost : int
        Most good frames lost by one damage.
    """

    kind: str
    trials: int
    passed: float
    misled: float
    good_lost: int


def unseen(
    values: Array,
    temperature_c: npt.ArrayLike,
    kind: Damage,
    seed: int,
    trials: int = 1000,
    quantum: npt.ArrayLike | None = None,
) -> Unseen:
    """Damage one frame of a locked stream again and again, and see what is delivered.

    Parameters
    ----------
    values : ndarray, shape (s, t, 3)
        Readings to draw rows from (T).
    temperature_c : array_like, broadcast to (s, t)
        Chip temperatures (degrees Celsius).
    kind : Damage
        Kind of damage.
    seed : int
        Of the rows, the places and the bytes.
    trials : int
        Frames to damage.
    quantum : array_like, shape (3,), or None
        As the decoder is told.

    Returns
    -------
    Unseen
        The shares.
    """
    rng = np.random.default_rng(seed)
    size = reskin_protocol.frame_bytes(values.shape[1])
    temperature_c = np.broadcast_to(temperature_c, values.shape[:2])
    frames = _cut(reskin_protocol.encode(values, temperature_c), size)
    wrong, worst, lost = 0, 0, 0
    for _ in range(trials):
        sent = [frames[i] for i in rng.integers(len(frames), size=7)]
        stream = b''.join([*sent[:3], damage(sent[3], kind, rng), *sent[4:]])
        decoded = ReskinDecoder(values.shape[1], quantum).feed(stream)
        got = _cut(reskin_protocol.encode(decoded.values, decoded.temperature_c), size)
        false = [frame for frame in got if frame not in sent]
        lost = max(lost, sum(frame not in got for frame in sent[:3] + sent[4:]))
        wrong += bool(false)
        worst += any(_error(frame, sent[3]) > HARMLESS_MICROTESLA for frame in false)
    return Unseen(kind, trials, wrong / trials, worst / trials, lost)


def _cut(stream: bytes, size: int) -> list[bytes]:
    """Whole frames, one by one."""
    return [stream[i : i + size] for i in range(0, len(stream), size)]


def _error(frame: bytes, truth: bytes) -> float:
    """Largest difference of two frames' fields (uT, degrees Celsius)."""
    fields = np.frombuffer(frame[:-2], '<f4').astype(np.float64)
    return float(np.abs(fields - np.frombuffer(truth[:-2], '<f4')).max())


Fault = Literal[
    'dropped', 'doubled', 'flipped', 'garbage', 'inserted', 'truncated', 'shifted', 'lost', 'nan'
]


class SimulatedSerialPort(Closing):
    """A port that programs open as they open a board's; the other end is in our hands.

    Parameters
    ----------
    seed : int
        Of the places and bytes of faults.
    patience_s : float
        Longest wait for a full port to be read (s).

    Attributes
    ----------
    port : str
        Path to open; it stays the same through `unplug` and `replug`.
    overruns : int
        Writes of the stream that were lost since nobody took them, as on a real board.
    """

    def __init__(self, seed: int = 0, patience_s: float = 5.0) -> None:
        """See the class."""
        self._folder = tempfile.TemporaryDirectory(prefix='tactile_port_')
        self._link = Path(self._folder.name) / 'board'
        self.port = str(self._link)
        self.overruns = 0
        self._patience_s = patience_s
        self._rng = np.random.default_rng(seed)
        self._master = -1
        self._faults: list[Fault] = []
        self._lock = threading.RLock()
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None
        self.replug()

    def close(self) -> None:
        """Stop the stream, unplug and remove the path; closing twice is allowed."""
        self.stop()
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
            # with no end of ours open, a hang-up tells whether somebody reads
            os.close(slave)

    def wait_for_reader(self, timeout: float = 10.0) -> None:
        """Return when a program has opened the port.

        Raises
        ------
        DeviceTimeout
            If none does within `timeout` (s).
        """
        deadline = time.monotonic() + timeout
        while self._hung_up():
            if time.monotonic() > deadline:
                msg = f'nobody opened {self.port} within {timeout:g} s'
                raise DeviceTimeout(msg)
            # the kernel wakes nobody when a slave is opened
            time.sleep(0.002)

    @property
    def watched(self) -> bool:
        """Whether a program has the port open."""
        return not self._hung_up()

    def _hung_up(self) -> bool:
        """Whether no program has the port open."""
        return bool(self._poll(0, 0.0) & (select.POLLHUP | select.POLLNVAL))

    def _poll(self, events: int, timeout: float) -> int:
        """Wait for events on our end; POLLNVAL when unplugged."""
        if self._master < 0:
            return select.POLLNVAL
        poll = select.poll()
        poll.register(self._master, events)
        return sum(event for _, event in poll.poll(timeout * 1e3))

    def inject(self, fault: Fault, count: int = 1) -> None:
        """Let the next `count` writes suffer a fault, after those that are waiting already.

        Parameters
        ----------
        fault : Fault
            A kind of `damage`, or lost: the write never happens (a stall), or nan: one field of it
            becomes not a number.
        count : int
            Writes to hit.

        Raises
        ------
        ValueError
            If the fault is unknown.
        """
        if fault not in get_args(Fault):
            msg = f'fault must be one of {", ".join(get_args(Fault))}; received {fault!r}'
            raise ValueError(msg)
        with self._lock:
            self._faults += [fault] * count

    def _suffer(self, data: bytes) -> bytes:
        """The data with the next waiting fault in it."""
        if not self._faults:
            return data
        fault = self._faults.pop(0)
        if fault == 'lost':
            return b''
        if fault == 'nan':
            place = 4 * int(self._rng.integers(len(data) // 4))
            return data[:place] + b'\x00\x00\xc0\x7f' + data[place + 4 :]
        return damage(data, _as_damage(fault), self._rng)

    def send(self, data: bytes, timeout: float | None = None) -> None:
        """Write bytes as the board would, faults included; return when the port has taken them.

        Parameters
        ----------
        data : bytes
            Usually one frame.
        timeout : float or None
            Longest wait for a full port to be read (s); None: the port's own patience.

        Raises
        ------
        DeviceTimeout
            If nobody reads: what was not taken is lost.
        DeviceError
            If the port is unplugged.
        """
        with self._lock:
            data = self._suffer(data)
        deadline = time.monotonic() + (self._patience_s if timeout is None else timeout)
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

    def received(self, timeout: float) -> bytes:
        """Bytes that the reader sent to the board, waiting at most `timeout` (s) for the first."""
        ready = self._poll(select.POLLIN, timeout) & select.POLLIN
        return os.read(self._master, 4096) if ready else b''

    def stream(
        self,
        signal: Callable[[float], Array],
        rate_hz: float,
        temperature_c: Callable[[float], Array] | None = None,
    ) -> None:
        """Send frames of a signal from a thread until `stop`, as a board does that nobody asks.

        Parameters
        ----------
        signal : callable
            Time since the start (s) -> values, shape (t, 3) (T).
        rate_hz : float
            Frames per second.
        temperature_c : callable or None
            Time -> chip temperatures, shape (t,) (degrees Celsius); None: 25.

        Raises
        ------
        DeviceError
            If it streams already.
        """
        if self._thread is not None:
            msg = f'{self.port} streams already'
            raise DeviceError(msg)
        self._stop.clear()
        self._thread = threading.Thread(
            target=self._run, args=(signal, rate_hz, temperature_c), daemon=True
        )
        self._thread.start()

    def stop(self) -> None:
        """End the stream and its thread."""
        self._stop.set()
        thread, self._thread = self._thread, None
        if thread is not None:
            thread.join()

    def _run(
        self,
        signal: Callable[[float], Array],
        rate_hz: float,
        temperature_c: Callable[[float], Array] | None,
    ) -> None:
        """Send on schedule; what the port does not take is lost."""
        start = time.monotonic()
        count = 0
        while not self._stop.wait(max(0.0, start + count / rate_hz - time.monotonic())):
            t = count / rate_hz
            warm = 25.0 if temperature_c is None else temperature_c(t)
            frame = reskin_protocol.encode(signal(t), warm)
            try:
                self.send(frame, timeout=0.0)
            except DeviceError:
                self.overruns += 1
            count += 1


def _as_damage(fault: Fault) -> Damage:
    """The kind of damage that a fault is."""
    return next(kind for kind in DAMAGES if kind == fault)


Own = TypeVar('Own', bound='SerialTwin')

MOST_WAITING = 10_000
STALL_S = 0.5
AWAY_S = 1.0
# a driver that has just opened the port knows no frame yet to which a loss could be told
CALM_S = 0.1
PATIENCE_S = 0.2
# frames are written together as USB delivers them
SHORTEST_PAUSE_S = 0.002

BYTE_FAULTS: tuple[Damage, ...] = get_args(Damage)
SERIAL_FAULTS = (*BYTE_FAULTS, 'lost', 'stall', 'unplug', 'stuck_chip', 'saturation')


class SerialTwin(Closing):
    """What all simulated boards share: port, pace, noise and faults.

    Parameters
    ----------
    layout : Layout
        Of the sensor; its `rate_hz` is the board's.
    signal : callable
        Time since the start (s) -> values, shape (t, c) (unit of the layout).
    noise : array_like, broadcast to (t, c)
        Standard deviation of white noise (unit of the layout).
    temperature_c : callable or None
        Time (s) -> chip temperatures, shape (t,) (degrees Celsius); None: 25.
    seed : int
        Of noise and faults.
    clock : VirtualClock or None
        Moved by `play`, which sends frames as fast as they are read; None: a thread sends them in
        real time between enter and exit.

    Attributes
    ----------
    injected : dict of str to int
        Faults that have happened; byte faults only where the frame was really damaged.
    overruns : int
        Writes that the program at the port did not take in 0.2 s; such frames are lost beyond
        `injected`.

    Notes
    -----
    In real time, faults wait until a program has had the port open for 0.1 s.
    stall: nothing is measured for 0.5 s. unplug: the port goes for 1 s, and the board starts anew.
    stuck_chip: one taxel repeats its last reading, or all do where one converter reads them
    (`one_converter`). saturation: one reads its limit.
    """

    faults: tuple[str, ...] = SERIAL_FAULTS
    one_converter = False

    def __init__(
        self,
        layout: Layout,
        signal: Callable[[float], Array],
        noise: npt.ArrayLike = 0.0,
        temperature_c: Callable[[float], Array] | None = None,
        seed: int = 0,
        clock: VirtualClock | None = None,
    ) -> None:
        """See the class."""
        if not 0 < layout.rate_hz < np.inf:
            msg = f'rate_hz of the layout of a twin must be above 0; received {layout.rate_hz}'
            raise ValueError(msg)
        self.layout = layout
        self.injected: dict[str, int] = dict.fromkeys(self.faults, 0)
        self.overruns = 0
        self._signal = signal
        self._noise = np.broadcast_to(np.asarray(noise, np.float64), layout.shape)
        self._temperature_c = temperature_c
        self._rng = np.random.default_rng(seed)
        self._clock = clock
        self._port: SimulatedSerialPort | None = None
        self._waiting: list[str] = []
        self._lock = threading.Lock()
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None
        self._step = 0
        self._silent = 0
        self._away = 0
        self._calm = 0
        self._last: Array | None = None

    @property
    def port(self) -> str:
        """Path of the port; it stays the same through `unplug`."""
        return self._line.port

    @property
    def awaited(self) -> bool:
        """Whether the port is there and no program has it open."""
        return not self._away and not self._line.watched

    @property
    def _line(self) -> SimulatedSerialPort:
        """The port, made when it is first needed."""
        if self._port is None:
            self._port = SimulatedSerialPort()
        return self._port

    def __enter__(self: Own) -> Own:
        """Plug in and, without a virtual clock, begin to send."""
        _ = self._line
        if self._clock is None and self._thread is None:
            self._stop.clear()
            self._thread = threading.Thread(target=self._run, daemon=True)
            self._thread.start()
        return self

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
        raise NotImplementedError

    def inject(self, fault: str, count: int = 1) -> None:
        """Let the next `count` frames suffer a fault, after those that are waiting already.

        Parameters
        ----------
        fault : str
            One of `faults`.
        count : int
            Frames to hit.

        Raises
        ------
        ValueError
            If the fault is unknown, or more than 10 000 would wait.
        """
        if fault not in self.faults:
            msg = f'fault must be one of {", ".join(self.faults)}; received {fault!r}'
            raise ValueError(msg)
        with self._lock:
            if len(self._waiting) + count > MOST_WAITING:
                msg = (
                    f'at most {MOST_WAITING} faults may wait; {len(self._waiting)} do, '
                    f'received {count} more'
                )
                raise ValueError(msg)
            self._waiting += [fault] * count

    def relieve(self) -> None:
        """Withdraw the faults that wait; one that has begun takes its course."""
        with self._lock:
            self._waiting.clear()

    def play(self, count: int) -> None:
        """Send `count` frames at once, each a period of the virtual clock; return when taken.

        Raises
        ------
        DeviceTimeout
            If nobody reads the port.
        """
        for _ in range(count):
            data = self.period()
            if data:
                self._line.send(data)

    def period(self) -> bytes:
        """Bytes of the next period of the virtual clock, for whoever carries them to a reader."""
        data = self._next()
        if self._clock is not None:
            self._clock.sleep(1.0 / self.layout.rate_hz)
        return data

    def _run(self) -> None:
        """Send on schedule while somebody reads."""
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
                self._send(data)

    def _send(self, data: bytes) -> None:
        """Write; what is not taken in time is lost."""
        try:
            self._line.send(data, timeout=PATIENCE_S)
        except DeviceError:
            self.overruns += 1

    def _next(self) -> bytes:
        """Bytes of the next period, with the fault that waits; none while stalled or away."""
        t = self._step / self.layout.rate_hz
        self._step += 1
        if self._away or self._silent:
            self._pass()
            return b''
        with self._lock:
            fault = self._waiting.pop(0) if self._waiting and self._calm <= 0 else ''
        if fault:
            self.injected[fault] += 1
        if fault in ('stall', 'unplug'):
            self._go_away(fault)
            return b''
        values = self._sample(t, fault)
        warm = 25.0 if self._temperature_c is None else self._temperature_c(t)
        data = self._bytes(values, np.broadcast_to(warm, len(values)), t, fault)
        return b'' if fault == 'lost' else self._hurt(data, fault)

    def _go_away(self, fault: str) -> None:
        """Begin a stall, or take the port away."""
        if fault == 'stall':
            self._silent = max(1, round(STALL_S * self.layout.rate_hz)) - 1
            return
        self._away = max(1, round(AWAY_S * self.layout.rate_hz))
        self._line.unplug()

    def _pass(self) -> None:
        """Let a period of silence pass; put the port back at its end."""
        self._silent = max(0, self._silent - 1)
        if self._away:
            self._away -= 1
            if not self._away:
                self._boot((self._step - 1) / self.layout.rate_hz)
                self._line.replug()

    def _sample(self, t: float, fault: str) -> Array:
        """Values with noise, with one taxel stuck or saturated, or all of a converter stuck."""
        values = np.asarray(self._signal(t), np.float64) + self._noise * self._rng.standard_normal(
            self.layout.shape
        )
        if fault == 'saturation':
            values[int(self._rng.integers(len(values)))] = self._limit()
        elif fault == 'stuck_chip' and self._last is not None:
            stuck = slice(None) if self.one_converter else slice(1)
            values[stuck] = self._last[stuck]
        self._last = values
        return values

    def _hurt(self, data: bytes, fault: str) -> bytes:
        """The frame with a fault of its bytes, drawn again until bytes but no frame are left."""
        for kind in BYTE_FAULTS:
            while kind == fault:
                hurt = damage(data, kind, self._rng)
                if hurt and data not in hurt:
                    return hurt
        return data

    def _boot(self, t: float) -> None:
        """Start the board anew, as when power comes back at time t (s)."""

    def _limit(self) -> Array:
        """Values at which the board saturates, broadcast to (c,) (unit of the layout)."""
        limit: Array = self.layout.saturation if self.layout.saturation is not None else np.ones(1)
        return limit

    def _bytes(self, values: Array, temperature_c: Array, t: float, fault: str) -> bytes:
        """One frame as the board sends it."""
        raise NotImplementedError


NAN_BYTES = b'\x00\x00\xc0\x7f'


class BoardTwin(SerialTwin):
    """The board on a pseudo-terminal.

    Parameters
    ----------
    layout : Layout
        Of the sensor; its `rate_hz` is the board's, its `saturation` where its chips clip.
    signal : callable
        Time since the start (s) -> flux density, shape (t, 3) (T).
    noise, temperature_c, seed, clock
        As in `SerialTwin`.
    quantum : array_like, broadcast to (3,), or None
        Step of the chips' readings (T), to which values are rounded.
    driver : callable or None
        Port and clock (ns) -> driver, as a sensor opens it; None: `SerialBoard` on native USB that
        is told `quantum`.

    Notes
    -----
    nan: one field of a frame becomes not a number. The format has no checksum: flipped, garbage
    and shifted may pass unseen, and lost frames leave no trace (`damage`). Saturation is a fault
    only where the layout says at which field.
    """

    faults = (*SERIAL_FAULTS, 'nan')

    def __init__(
        self,
        layout: Layout,
        signal: Callable[[float], Array],
        noise: npt.ArrayLike = 0.0,
        temperature_c: Callable[[float], Array] | None = None,
        seed: int = 0,
        clock: VirtualClock | None = None,
        quantum: npt.ArrayLike | None = None,
        driver: Callable[[str, Callable[[], int]], Device] | None = None,
    ) -> None:
        """See the class."""
        if not np.isfinite(np.asarray(layout.saturation, np.float64)).all():
            self.faults = tuple(fault for fault in self.faults if fault != 'saturation')
        super().__init__(layout, signal, noise, temperature_c, seed, clock)
        self._quantum = None if quantum is None else np.broadcast_to(quantum, 3)
        self._driver = driver

    def device(self, clock_ns: Callable[[], int]) -> Device:
        """The real driver on this twin's port, stamped by `clock_ns`; not yet entered."""
        if self._driver is not None:
            return self._driver(self.port, clock_ns)
        return SerialBoard(self.port, self.layout, clock=clock_ns, quantum=self._quantum)

    def _bytes(self, values: Array, temperature_c: Array, t: float, fault: str) -> bytes:
        """One frame."""
        if self._quantum is not None:
            values = np.rint(values / self._quantum) * self._quantum
        data = reskin_protocol.encode(values, temperature_c)
        if fault != 'nan':
            return data
        place = 4 * int(self._rng.integers(len(data) // 4))
        return data[:place] + NAN_BYTES + data[place + 4 :]


LEAST_JUMP_S = 2.0
MOST_JUMP_S = 1000.0


class FramedTwin(SerialTwin):
    """A board that speaks the framed protocol, on a pseudo-terminal.

    Parameters
    ----------
    layout : Layout
        Of the sensor; its `rate_hz` is the board's.
    payload : Payload
        What the frames carry.
    scale : array_like, broadcast to (t, c)
        Unit of the layout per count; values are rounded to counts and clipped at the converter's
        limit.
    signal : callable
        Time since the start (s) -> values, shape (t, c) (unit of the layout).
    noise, temperature_c, seed, clock
        As in `SerialTwin`.
    drift : float
        Share by which the board's clock is fast.
    start_us : int
        The board's clock at the start (microseconds); it wraps at 2^32.
    baud, native_usb
        As the driver is told; a pseudo-terminal keeps no baud rate.

    Notes
    -----
    clock_jump: the board's clock jumps by 2 to 1000 s, ahead or back.
    """

    faults = (*SERIAL_FAULTS, 'clock_jump')

    def __init__(
        self,
        layout: Layout,
        payload: Payload,
        scale: npt.ArrayLike,
        signal: Callable[[float], Array],
        noise: npt.ArrayLike = 0.0,
        temperature_c: Callable[[float], Array] | None = None,
        seed: int = 0,
        clock: VirtualClock | None = None,
        drift: float = 0.0,
        start_us: int = 0,
        baud: int = 115200,
        native_usb: bool = True,
    ) -> None:
        """See the class."""
        super().__init__(layout, signal, noise, temperature_c, seed, clock)
        self.one_converter = payload.kind in (Kind.TAXELS, Kind.WIRES)
        self._payload = payload
        self._scale = np.broadcast_to(np.asarray(scale, np.float64), layout.shape)
        self._baud = baud
        self._native_usb = native_usb
        self._drift = drift
        self._origin_us = float(start_us)
        self._sequence = 0

    def device(self, clock_ns: Callable[[], int]) -> FramedBoard:
        """The real driver on this twin's port, stamped by `clock_ns`; not yet entered."""
        return FramedBoard(
            self.port,
            self.layout,
            self._payload,
            self._scale,
            baud=self._baud,
            native_usb=self._native_usb,
            clock=clock_ns,
        )

    def _boot(self, t: float) -> None:
        """Begin sequence and clock at 0."""
        self._sequence = 0
        self._origin_us = -t * (1 + self._drift) * 1e6

    def _limit(self) -> Array:
        """The converter's limit."""
        limit: Array = self._scale[0] * self._payload.full_count
        return limit

    def _bytes(self, values: Array, temperature_c: Array, t: float, fault: str) -> bytes:
        """One frame; its sequence is used up also where it is lost."""
        if fault == 'clock_jump':
            jump = self._rng.uniform(LEAST_JUMP_S, MOST_JUMP_S) * self._rng.choice((-1, 1))
            self._origin_us += round(jump * 1e6)
        time_us = round(self._origin_us + t * (1 + self._drift) * 1e6)
        counts = np.rint(values / self._scale).astype(np.int64)
        data = framed_protocol.encode(
            self._payload, counts, self._sequence, time_us, temperature_c
        )
        self._sequence += 1
        return data
