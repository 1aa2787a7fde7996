"""Play a recording into a simulated port, row by row on the recording's schedule."""

from __future__ import annotations

import time
from typing import Protocol

import numpy as np
import numpy.typing as npt

from tactile_ros.devices.reskin_protocol import encode
from tactile_ros.types import Integers


class Sink(Protocol):
    """Receiver of a player's bytes: a `SimulatedSerialPort`, or what stands before it."""

    def send(self, data: bytes) -> None:
        """Return when the bytes are taken."""
        ...


class Player:
    """Rows of a recording as a ReSkin board's bytes, as fast as recorded or faster.

    Parameters
    ----------
    port : Sink
        Receives the bytes.
    speed_up : float
        Recorded time over played time.
    period_s : float
        Played time before rows that have no stamp before them (s).

    Attributes
    ----------
    sent : int
        Frames written so far; the next row is the board's frame `sent` when none was lost.

    Notes
    -----
    `play` returns when its last byte is in the port; nothing is sent between calls. So a caller
    may tare, wait for answers or stop between touches, and no sleep stands for a handshake.
    """

    def __init__(self, port: Sink, speed_up: float = 1.0, period_s: float = 0.0025) -> None:
        if not speed_up > 0:
            msg = f'speed_up must be above 0; received {speed_up}'
            raise ValueError(msg)
        self.sent = 0
        self._port = port
        self._speed_up = speed_up
        self._period_s = period_s
        self._due = time.monotonic()

    def play(self, values: npt.ArrayLike, stamp_ns: Integers | None = None) -> None:
        """Send rows one after the other, each at its time; return when the last is written.

        Parameters
        ----------
        values : array_like, shape (s, t, 3)
            Readings (T).
        stamp_ns : ndarray, shape (s,), or None
            When they were taken (ns); None: one period apart.

        Raises
        ------
        DeviceTimeout
            If nobody reads the port.
        DeviceError
            If it is unplugged.
        """
        rows = np.asarray(values, np.float64)
        gaps = np.full(len(rows), self._period_s)
        if stamp_ns is not None:
            gaps[1:] = np.diff(stamp_ns) * 1e-9 / self._speed_up
        for row, gap in zip(rows, gaps, strict=True):
            # a slow reader delays the schedule; the rows that follow do not come in a burst
            self._due = max(self._due + gap, time.monotonic() - gap)
            pause = self._due - time.monotonic()
            if pause > 0:
                time.sleep(pause)
            self._port.send(encode(row))
            self.sent += 1
