"""Simulated twin of a serial board: a pseudo-terminal that carries the same bytes.

The twin knows bytes, not physics: rows come from a recording or from a model's signal.
"""

from __future__ import annotations

import os
import select
import tempfile
import threading
import time
import tty
from pathlib import Path
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np

from tactile_ros.devices.damage import DAMAGES, Damage, damage
from tactile_ros.devices.packets import encode
from tactile_ros.errors import DeviceError, DeviceTimeout
from tactile_ros.types import Array, Closing

if TYPE_CHECKING:
    from collections.abc import Callable

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
            frame = encode(signal(t), 25.0 if temperature_c is None else temperature_c(t))
            try:
                self.send(frame, timeout=0.0)
            except DeviceError:
                self.overruns += 1
            count += 1


def _as_damage(fault: Fault) -> Damage:
    """The kind of damage that a fault is."""
    return next(kind for kind in DAMAGES if kind == fault)
