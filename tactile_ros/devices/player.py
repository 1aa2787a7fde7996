"""Play a recording into a simulated port, row by row, with a word before each touch."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np
import numpy.typing as npt

from tactile_ros.devices.reskin_protocol import encode
from tactile_ros.types import Array, Integers

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable


class Sink(Protocol):
    """Where a player's bytes go: a `SimulatedSerialPort`, or what stands before it."""

    def send(self, data: bytes) -> None:
        """Return when the bytes are taken."""
        ...


@dataclass(frozen=True)
class Touch:
    """One touch of a recording.

    Attributes
    ----------
    values : ndarray, shape (s, t, 3)
        Readings (T).
    stamp_ns : ndarray, shape (s,), or None
        When they were taken (ns); None: one period apart.
    rest : ndarray, shape (t, 3), or None
        Its resting reading (T).
    """

    values: Array
    stamp_ns: Integers | None = None
    rest: Array | None = None


class Player:
    """Rows of a recording as a board's bytes, on the recording's schedule or faster.

    Parameters
    ----------
    port : Sink
        Where the bytes go, a `SimulatedSerialPort` usually.
    speed_up : float
        Recorded time over played time.
    period_s : float
        Played time before rows that have no stamp before them (s).
    temperature_c : float
        Sent for every chip: recordings without temperature need a constant.
    longest_gap_s : float
        Recorded gaps are played as no longer than this (s).

    Attributes
    ----------
    sent : int
        Frames written so far; the next row is the board's frame `sent` when none was lost.

    Notes
    -----
    Every call returns when its last byte is in the port; nothing is sent between calls. So a
    caller may tare, wait for answers or stop between touches, and no sleep stands for a handshake.
    """

    def __init__(
        self,
        port: Sink,
        speed_up: float = 1.0,
        period_s: float = 0.0025,
        temperature_c: float = 25.0,
        longest_gap_s: float = float('inf'),
    ) -> None:
        """See the class."""
        if not speed_up > 0:
            msg = f'speed_up must be above 0; received {speed_up}'
            raise ValueError(msg)
        self.sent = 0
        self._port = port
        self._speed_up = speed_up
        self._period_s = period_s
        self._temperature_c = temperature_c
        self._longest_gap_s = longest_gap_s
        self._due = time.monotonic()

    def play(self, values: npt.ArrayLike, stamp_ns: Integers | None = None) -> None:
        """Send rows one after the other, each at its time; return when the last is written.

        Parameters
        ----------
        values : array_like, shape (s, t, 3)
            Readings (T).
        stamp_ns : ndarray, shape (s,), or None
            When they were taken (ns).

        Raises
        ------
        DeviceTimeout
            If nobody reads the port.
        DeviceError
            If it is unplugged.
        """
        rows = np.asarray(values, np.float64)
        for row, gap in zip(rows, self._gaps(len(rows), stamp_ns), strict=True):
            # a slow reader delays the schedule; the rows that follow do not come in a burst
            self._due = max(self._due + gap, time.monotonic() - gap)
            pause = self._due - time.monotonic()
            if pause > 0:
                time.sleep(pause)
            self._port.send(encode(row, self._temperature_c))
            self.sent += 1

    def rest(self, values: npt.ArrayLike, count: int) -> None:
        """Send one resting reading, shape (t, 3) (T), `count` times, one period apart."""
        row = np.asarray(values, np.float64)
        self.play(np.broadcast_to(row, (count, *row.shape)))

    def touches(
        self, touches: Iterable[Touch], before: Callable[[int, Touch], None] | None = None
    ) -> int:
        """Play touches; before each, the caller may stream its rest and tare.

        Parameters
        ----------
        touches : iterable of Touch
            In the order of playing.
        before : callable or None
            Called with the touch's index and the touch; may call `rest` and `play` itself.

        Returns
        -------
        int
            Frames written, those of `before` included.
        """
        start = self.sent
        for index, touch in enumerate(touches):
            if before is not None:
                before(index, touch)
            self.play(touch.values, touch.stamp_ns)
        return self.sent - start

    def _gaps(self, count: int, stamp_ns: Integers | None) -> Array:
        """Played time before each row (s)."""
        gaps = np.full(count, self._period_s)
        if stamp_ns is not None and count > 1:
            recorded = np.minimum(np.diff(stamp_ns) * 1e-9, self._longest_gap_s)
            gaps[1:] = recorded / self._speed_up
        return gaps
