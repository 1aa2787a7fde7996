"""Simulated boards on serial ports: a signal, sampled with noise and faults, as their bytes."""

from __future__ import annotations

import threading
import time
from typing import TYPE_CHECKING, TypeVar, get_args

import numpy as np

from tactile_ros.devices.damage import Damage, damage
from tactile_ros.devices.simulated import SimulatedSerialPort
from tactile_ros.errors import DeviceError
from tactile_ros.types import Array, Closing, Layout

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy.typing as npt

    from tactile_ros.devices.clock import VirtualClock
    from tactile_ros.types import Device

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
