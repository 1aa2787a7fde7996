"""A serial port that comes back: opened again with growing pauses after it was unplugged.

With it what drivers share: opening and closing, and reading frames out of a stream of bytes.
"""

from __future__ import annotations

import math
import time
from collections import deque
from typing import TYPE_CHECKING, TypeVar

from tactile_ros.devices.transport import SerialPort
from tactile_ros.errors import DeviceError, DeviceTimeout
from tactile_ros.types import Closing

if TYPE_CHECKING:
    from collections.abc import Callable

    from tactile_ros.types import Frame, Layout

Own = TypeVar('Own', bound='Opened')

FIRST_RETRY_S = 0.05
LONGEST_RETRY_S = 0.5
BITS_PER_BYTE = 10


def wire_s(size: int, baud: int) -> float:
    """Time (s) that `size` bytes take on a true UART: a start bit, eight bits and a stop bit."""
    return size * BITS_PER_BYTE / baud


def check_capacity(what: str, size: int, rate_hz: float, baud: int) -> None:
    """Refuse frames that a UART cannot carry.

    Parameters
    ----------
    what : str
        The frames in words.
    size : int
        Length of one (bytes).
    rate_hz : float
        Frames a second; not a number: unknown, not checked.
    baud : int
        Baud rate.

    Raises
    ------
    ValueError
        If they need more; names both byte rates and the baud rate that is enough.
    """
    needed, carried = size * rate_hz, baud / BITS_PER_BYTE
    if needed > carried:
        enough = math.ceil(needed * BITS_PER_BYTE)
        msg = (
            f'{what} at {rate_hz:g} Hz must fit the port: they are {needed:.0f} bytes/s and '
            f'{baud} baud carry {carried:.0f} bytes/s; lower the rate, raise the baud rate to '
            f'{enough} or more, or set native_usb where the baud rate means nothing'
        )
        raise ValueError(msg)


class ReconnectingPort:
    """Bytes of a port that may be unplugged and plugged in again at any time.

    Parameters
    ----------
    port : str
        Device path.
    baud : int
        Baud rate.
    on_open : callable
        Called after each opening with whether it is a reconnection.

    Attributes
    ----------
    reconnects : int
        Times the port came back.
    failure : str
        Why the port is not open now, in one sentence.
    """

    def __init__(self, port: str, baud: int, on_open: Callable[[bool], None]) -> None:
        """See the class."""
        self.reconnects = 0
        self.failure = ''
        self._port = SerialPort(port, baud)
        self._on_open = on_open
        self._opened_before = False
        self._closed = False
        self._retry_s = 0.0
        self._retry_at = 0.0

    @property
    def port(self) -> str:
        """Device path."""
        return self._port.port

    @property
    def is_open(self) -> bool:
        """Whether the port is held."""
        return self._port.is_open

    def open(self) -> None:
        """Open the port; DeviceError in one sentence if it is missing, busy or forbidden."""
        if self._port.is_open:
            return
        self._port.open()
        self._closed = False
        again, self._opened_before = self._opened_before, True
        self.reconnects += again
        self._retry_s = 0.0
        self._on_open(again)

    def close(self) -> None:
        """Let the port go."""
        self._closed = True
        self._port.close()

    def take(self, timeout: float) -> bytes:
        """Wait at most `timeout` (s) for bytes, or for the port where it is gone.

        Raises
        ------
        DeviceError
            If it was closed.
        """
        if self._closed:
            msg = f'{self.port} is closed'
            raise DeviceError(msg)
        if not self._port.is_open:
            self._reopen(timeout)
            return b''
        try:
            return self._port.read(timeout)
        except DeviceError as err:
            self.failure = str(err)
            self._retry_at = time.monotonic()
            return b''

    def _reopen(self, timeout: float) -> None:
        """Try to open the port when its time has come."""
        pause = self._retry_at - time.monotonic()
        if pause > 0:
            time.sleep(min(pause, timeout))
            if pause > timeout:
                return
        try:
            self.open()
        except DeviceError as err:
            self.failure = str(err)
            self._retry_s = min(max(2 * self._retry_s, FIRST_RETRY_S), LONGEST_RETRY_S)
            self._retry_at = time.monotonic() + self._retry_s


class Opened(Closing):
    """A context manager that opens and closes."""

    def open(self) -> None:
        """Open; DeviceError in one sentence where that cannot be."""
        raise NotImplementedError

    def __enter__(self: Own) -> Own:
        """Open."""
        self.open()
        return self


class StreamingBoard(Opened):
    """A board that sends frames without being asked: its port, and the frames not read yet.

    Parameters
    ----------
    port : str
        Device path.
    baud : int
        Baud rate.
    layout : Layout
        Of the sensor.

    Notes
    -----
    A board adds what happens after an opening (`_restart`), how bytes become frames in `_frames`
    (`_receive`), and why there are none (`_silence`).
    """

    def __init__(self, port: str, baud: int, layout: Layout) -> None:
        """See the class."""
        self._layout = layout
        self._port = ReconnectingPort(port, baud, self._restart)
        self._frames: deque[Frame] = deque()

    @property
    def layout(self) -> Layout:
        """Where the taxels are."""
        return self._layout

    def open(self) -> None:
        """Open the port.

        Raises
        ------
        DeviceError
            If it is missing, busy or forbidden: one sentence with the ports that exist.
        """
        self._port.open()

    def close(self) -> None:
        """Let the port go and forget frames that were not read."""
        self._port.close()
        self._frames.clear()

    def read(self, timeout: float) -> Frame:
        """Wait for the next frame, and for the port where it is unplugged.

        Parameters
        ----------
        timeout : float
            Longest wait (s).

        Returns
        -------
        Frame
            The oldest frame not read yet.

        Raises
        ------
        DeviceTimeout
            If none came in time; says why. A port that is gone is opened again by the next calls,
            with growing pauses of at most 0.5 s.
        DeviceError
            If what comes is another stream than this board's, or it was closed.
        """
        deadline = time.monotonic() + timeout
        while not self._frames:
            data = self._port.take(max(0.0, deadline - time.monotonic()))
            if data:
                self._receive(data)
            if not self._frames and time.monotonic() >= deadline:
                if self._port.is_open:
                    raise self._silence(timeout)
                msg = f'{self._port.failure}; trying again'
                raise DeviceTimeout(msg)
        return self._frames.popleft()

    def waiting(self) -> list[Frame]:
        """Take the frames that came together with the last and were not read yet."""
        frames = list(self._frames)
        self._frames.clear()
        return frames

    def feed(self, data: bytes) -> None:
        """Take bytes that came by another way than the port, as in a simulation; then `read`."""
        self._receive(data)

    def _restart(self, again: bool) -> None:
        """Forget the stream of before; `again`: the port came back."""
        raise NotImplementedError

    def _receive(self, data: bytes) -> None:
        """Queue the frames that end in bytes that have just come."""
        raise NotImplementedError

    def _silence(self, timeout: float) -> DeviceError:
        """Why nothing came through the open port."""
        raise NotImplementedError
