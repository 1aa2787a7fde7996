"""Boards on serial ports: bytes to frames, through unplugging, damage and loss.

`ReskinBoard` is the ReSkin / AnySkin board, `FramedBoard` one that speaks the framed protocol of
docs/serial_protocol.md.
"""

from __future__ import annotations

import math
import time
from collections import deque
from dataclasses import asdict
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from tactile_ros.devices import framed_protocol, reskin_protocol
from tactile_ros.devices.fault_flags import StillWatch
from tactile_ros.devices.framed_protocol import VERSION, FramedDecoder, Kind, Payload
from tactile_ros.devices.reskin_protocol import ReskinDecoder, foreign
from tactile_ros.devices.timestamps import DeviceTime
from tactile_ros.devices.transport import SerialPort
from tactile_ros.errors import DeviceError, DeviceTimeout
from tactile_ros.types import Array, Bools, Bytes, Closing, Frame, Integers, Layout, TaxelStatus

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy.typing as npt

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


class SerialBoard(Opened):
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


NOMINAL_RATE_HZ = 400.0
CLOCK_RESET_NS = 1_000_000_000
LONG_GAP = 3.0
# share of chips that must change before another one that does not is suspect
OTHERS = 0.5


def uart_transfer_s(chips: int, baud: int) -> float:
    """Time (s) that a frame of `chips` chips takes on a true UART, ten bits a byte."""
    return wire_s(reskin_protocol.frame_bytes(chips), baud)


def arrival_stamps(
    skipped: Integers, now_ns: int, last_ns: int | None, period_ns: int
) -> list[int]:
    """Stamps of frames that came in one read.

    Parameters
    ----------
    skipped : ndarray, shape (s,)
        Frames known lost before each.
    now_ns : int
        When the last byte of the last frame came (ns).
    last_ns : int or None
        Stamp of the frame before (ns).
    period_ns : int
        Nominal period (ns).

    Returns
    -------
    list of int
        s stamps, one period apart, closer where the time since the last frame is shorter; always
        increasing, also when the clock stands still. Only a clock that went back by more than a
        second starts anew.
    """
    place = np.cumsum(skipped + 1)
    if last_ns is not None and now_ns < last_ns - CLOCK_RESET_NS:
        last_ns = None
    spacing = period_ns
    if last_ns is not None:
        spacing = max(1, min(period_ns, (now_ns - last_ns) // int(place[-1])))
        now_ns = max(now_ns, last_ns + spacing * int(place[-1]))
    return [now_ns - spacing * int(back) for back in place[-1] - place]


class ReskinBoard(SerialBoard):
    """The board as a `Device`: a context manager whose `read` gives frames.

    Parameters
    ----------
    port : str
        Device path.
    layout : Layout
        Of the sensor; its taxels are the board's chips, in the order of the wire.
    baud : int
        Baud rate.
    temperature_measured : bool
        False where the board sends a constant: frames carry no temperature then.
    clock : callable
        Gives the stamps (ns).
    transfer_s : float
        Time on the wire that is taken off the stamps (s); 0 for native USB, `uart_transfer_s`
        for a true UART.
    conversion_s : float
        Time that the chips take for a sample (s); half of it is taken off the stamps, which are
        the middle of the measurement then. 0: unknown.
    quantum : array_like, shape (3,), or None
        Step of the chips' readings (T), where it is known exactly; shows most flipped bits.
    mark_repeats : bool
        Mark readings that are equal to the last bit to the frame before as STALE. For boards that
        poll faster than their chips convert; off by default, since a coarse recording at rest
        repeats itself honestly.

    Raises
    ------
    ValueError
        If the layout has no 3 channels, or `transfer_s` says that the port is a true UART and it
        cannot carry the frames at the layout's rate.

    Notes
    -----
    A stamp is the arrival of the frame's last byte less `transfer_s` and half of `conversion_s`;
    the board has no clock.
    `sequence` grows by one a frame and by the frames known lost: bytes skipped over the length of
    a frame, at least one for a reconnection. Whole frames that a board never sent cannot be known;
    `counters()['suspected']` compares stamps with their usual spacing: a paused host or board
    looks the same, so those are not part of `sequence`. Chips that repeat themselves bit for bit
    among others that change are STALE, and STUCK when it lasts (`StillWatch`).
    """

    def __init__(
        self,
        port: str,
        layout: Layout,
        baud: int = 115200,
        temperature_measured: bool = True,
        clock: Callable[[], int] = time.monotonic_ns,
        transfer_s: float = 0.0,
        quantum: npt.ArrayLike | None = None,
        mark_repeats: bool = False,
        conversion_s: float = 0.0,
    ) -> None:
        """See the class."""
        taxels, channels = layout.shape
        if channels != 3:
            msg = f'layout of a serial board must have 3 channels; received {channels}'
            raise ValueError(msg)
        if transfer_s > 0:
            size = reskin_protocol.frame_bytes(taxels)
            check_capacity(f'frames of {taxels} chips', size, layout.rate_hz, baud)
        rate = layout.rate_hz if layout.rate_hz > 0 else NOMINAL_RATE_HZ
        super().__init__(port, baud, layout)
        self._decoder = ReskinDecoder(taxels, quantum)
        self._temperature_measured = temperature_measured
        self._clock = clock
        self._age_ns = round((transfer_s + conversion_s / 2) * 1e9)
        self._period_ns = max(1, round(1e9 / rate))
        self._mark_repeats = mark_repeats
        self._sequence = -1
        self._dropped = 0
        self._last_ns: int | None = None
        self._usual_ns = 0.0
        self._last: tuple[Array, Array] | None = None
        self._interrupted = False
        self._suspected = 0
        self._still = StillWatch(taxels, others=OTHERS)

    def counters(self) -> dict[str, int]:
        """Frames, losses and damage since the driver was made, by name."""
        return {
            **asdict(self._decoder.counts),
            'dropped': self._dropped,
            'reconnects': self._port.reconnects,
            'suspected': self._suspected,
        }

    def _restart(self, again: bool) -> None:
        """Forget the stream of before."""
        self._decoder.reset()
        self._last = None
        self._still.forget()
        self._interrupted |= again

    def _receive(self, data: bytes) -> None:
        """Queue the frames that end in bytes that have just come."""
        now_ns = self._clock()
        decoded = self._decoder.feed(data)
        if len(decoded.skipped):
            self._queue(decoded, now_ns - self._age_ns)

    def _silence(self, timeout: float) -> DeviceError:
        """Why nothing came."""
        port = self._port.port
        pending = self._decoder.pending
        chips = self._layout.shape[0]
        if self._decoder.locked or not pending:
            return DeviceTimeout(f'no frame came from {port} within {timeout:g} s')
        stranger = foreign(pending, chips)
        if stranger is not None:
            return DeviceError(f'{port}: {stranger}')
        return DeviceTimeout(
            f'bytes come from {port}, but no frame of {chips} chips within {timeout:g} s'
        )

    def _queue(self, decoded: reskin_protocol.Decoded, now_ns: int) -> None:
        """Turn decoded rows into frames with stamps, sequence and status."""
        skipped = decoded.skipped
        if self._interrupted:
            skipped = skipped.copy()
            skipped[0] += 1
            self._interrupted = False
            self._usual_ns = 0.0
        stamps = arrival_stamps(skipped, now_ns, self._last_ns, self._period_ns)
        self._suspect(stamps[0], int(skipped[0]))
        status = self._status(decoded)
        for i, stamp_ns in enumerate(stamps):
            self._dropped += int(skipped[i])
            self._sequence += 1 + int(skipped[i])
            frame = Frame(
                stamp_ns=stamp_ns,
                sequence=self._sequence,
                values=decoded.values[i],
                temperature_c=decoded.temperature_c[i] if self._temperature_measured else None,
                status=status[i] if status[i].any() else None,
                dropped=self._dropped,
            )
            self._frames.append(frame)
        self._last_ns = stamps[-1]
        self._last = decoded.values[-1], decoded.temperature_c[-1]

    def _suspect(self, stamp_ns: int, skipped: int) -> None:
        """Count frames that are missing by the clock alone."""
        if self._last_ns is None:
            return
        gap = (stamp_ns - self._last_ns) / (1 + skipped)
        # frames that were kept back come at once: their spacing is not the board's
        usual = max(self._usual_ns or gap, self._period_ns / 2)
        if gap > LONG_GAP * usual:
            self._suspected += round(gap / usual) - 1
        self._usual_ns = usual + 0.05 * (min(gap, LONG_GAP * usual) - usual)

    def _status(self, decoded: reskin_protocol.Decoded) -> Bytes:
        """Bits of every chip in every frame."""
        status = np.zeros(decoded.error.shape, np.uint8)
        status[decoded.error] |= np.uint8(TaxelStatus.ERROR)
        clipped = (np.abs(decoded.values) >= self._layout.saturation).any(axis=-1)
        status[clipped] |= np.uint8(TaxelStatus.SATURATED)
        for row, values in zip(status, decoded.values, strict=True):
            if self._still.follow(values).any():
                row[:] |= self._still.marks()
        if self._mark_repeats:
            status[self._repeats(decoded)] |= np.uint8(TaxelStatus.STALE)
        return status

    def _repeats(self, decoded: reskin_protocol.Decoded) -> Bools:
        """Chips whose reading is the frame before's, to the last bit."""
        readings = np.concatenate([decoded.temperature_c[..., None], decoded.values], axis=-1)
        if self._last is None:
            before = np.full((1, *readings.shape[1:]), np.nan)
        else:
            before = np.concatenate([self._last[1][:, None], self._last[0]], axis=-1)[None]
        same: Bools = (readings == np.concatenate([before, readings[:-1]])).all(axis=-1)
        return same


# foreign frames without one of ours before the stream is called another one
STRANGERS = 3
# changes after which a board of one converter is known not to rest since it was opened
LIVELY = 10


class FramedBoard(SerialBoard):
    """The board as a `Device`: a context manager whose `read` gives frames.

    Parameters
    ----------
    port : str
        Device path.
    layout : Layout
        Of the sensor; its taxels are in the order of the wire.
    payload : Payload
        What the frames carry; as many taxels and channels as the layout.
    scale : array_like, broadcast to (t, c)
        Unit of the layout per count.
    baud : int
        Baud rate.
    native_usb : bool
        The port is USB from end to end, where the baud rate means nothing: its capacity is not
        checked and no time on the wire is taken off the stamps.
    clock : callable
        Gives the stamps (ns).

    Raises
    ------
    ValueError
        If payload and layout differ, a scale is not finite, or the port cannot carry the frames at
        the layout's rate.

    Notes
    -----
    Stamps follow the board's clock, tied to `clock` by the promptest frames (`DeviceTime`), less
    the frame's time on the wire. `Frame.sequence` starts at 0 and grows by one a frame and by
    those that the board's own counter says are lost, one at least for a reconnection or restart.
    Pixels and chips that repeat themselves bit for bit among others that change are STALE, and
    STUCK when it lasts (`StillWatch`). A taxel or wire may rest on one count; all of them together
    repeat themselves only where their one converter has frozen, or where nothing touches and all
    are at an end of its range, which is not judged.
    """

    def __init__(
        self,
        port: str,
        layout: Layout,
        payload: Payload,
        scale: npt.ArrayLike,
        baud: int = 115200,
        native_usb: bool = False,
        clock: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        """See the class."""
        if layout.shape != (payload.count, payload.channels):
            want = (payload.count, payload.channels)
            msg = f'layout of {payload} must have shape {want}; received {layout.shape}'
            raise ValueError(msg)
        if not np.isfinite(np.asarray(scale, np.float64)).all():
            msg = f'scale must be finite; received {scale!r}'
            raise ValueError(msg)
        size = framed_protocol.frame_bytes(payload)
        if not native_usb:
            check_capacity(f'frames of {payload}', size, layout.rate_hz, baud)
        rate_hz = layout.rate_hz
        known = math.isfinite(rate_hz) and rate_hz > 0
        super().__init__(port, baud, layout)
        self._payload = payload
        self._scale = np.broadcast_to(np.asarray(scale, np.float64), layout.shape).copy()
        self._decoder = FramedDecoder(payload)
        self._time = DeviceTime(round(1e9 / rate_hz) if known else 0)
        self._clock = clock
        self._transfer_ns = 0 if native_usb else round(wire_s(size, baud) * 1e9)
        self._sequence = -1
        self._dropped = 0
        self._interrupted = 0
        self._heard = False
        self._said = False
        self._saturated = 0
        self._stale = 0
        self._stuck = 0
        self._as_one = payload.kind in (Kind.TAXELS, Kind.WIRES)
        self._still = (
            StillWatch(1, changes=LIVELY)
            if self._as_one
            else StillWatch(payload.count, others=OTHERS)
        )

    def counters(self) -> dict[str, int]:
        """Frames, losses and damage since the driver was made, by name.

        Returns
        -------
        dict of str to int
            Those of the decoder; `dropped` has one for each reconnection in it. `reconnects`,
            `clock_jumps`, `clock_steps`, `stalls`; `saturated`, `stale` and `stuck`, readings of
            taxels so marked.
        """
        return {
            **asdict(self._decoder.counts),
            'dropped': self._dropped,
            'reconnects': self._port.reconnects,
            'clock_jumps': self._time.clock_jumps,
            'clock_steps': self._time.clock_steps,
            'stalls': self._time.stalls,
            'saturated': self._saturated,
            'stale': self._stale,
            'stuck': self._stuck,
        }

    def _restart(self, again: bool) -> None:
        """Forget the stream of before."""
        self._decoder.reset()
        self._time.restart()
        self._still.forget()
        self._interrupted += again
        self._heard = False
        self._said = False

    def _receive(self, data: bytes) -> None:
        """Queue the frames that end in bytes that have just come."""
        now_ns = self._clock() - self._transfer_ns
        self._heard = True
        decoded = self._decoder.feed(data)
        if decoded.lost:
            self._queue(decoded, now_ns)
        elif self._decoder.strangers >= STRANGERS and not self._said:
            self._said = True
            msg = f'{self._port.port}: {self._stranger()}'
            raise DeviceError(msg)

    def _stranger(self) -> str:
        """What comes and what was expected."""
        own = str(self._payload)
        return (
            f'the stream carries frames of {self._decoder.foreign}, '
            f'not of version {VERSION}, {own}: set the sensor and its taxels to what the board has'
        )

    def _silence(self, timeout: float) -> DeviceTimeout:
        """Why nothing came."""
        port = self._port.port
        if self._decoder.strangers:
            return DeviceTimeout(f'{port}: {self._stranger()}')
        if self._heard and not self._decoder.synchronised:
            return DeviceTimeout(
                f'bytes come from {port}, but no frame of {self._payload} within {timeout:g} s'
            )
        return DeviceTimeout(f'no frame came from {port} within {timeout:g} s')

    def _queue(self, decoded: framed_protocol.Decoded, now_ns: int) -> None:
        """Turn decoded rows into frames with stamps, sequence and status."""
        readings, lost = decoded.readings, decoded.lost
        moments = self._time.follow(decoded.time_us, lost, now_ns)
        values = readings.counts * self._scale
        status = readings.status | self._still_ones(readings.counts)
        status = self._status(status, moments.repeated)
        marked = np.any(status, axis=1)
        temperature_c = readings.temperature_c
        self._dropped += self._interrupted
        self._sequence += self._interrupted
        self._interrupted = 0
        for i, gap in enumerate(lost):
            self._dropped += gap
            self._sequence += 1 + gap
            frame = Frame(
                stamp_ns=moments.stamp_ns[i],
                sequence=self._sequence,
                values=values[i],
                temperature_c=None if temperature_c is None else temperature_c[i],
                status=status[i] if marked[i] else None,
                device_time_ns=moments.device_ns[i],
                dropped=self._dropped,
            )
            self._frames.append(frame)

    def _still_ones(self, counts: Array) -> Bytes:
        """STALE and STUCK of every taxel in every frame; counts have shape (s, t, c)."""
        status = np.zeros(counts.shape[:2], np.uint8)
        for row, frame in zip(status, counts, strict=True):
            if self._repeats(frame):
                row[:] |= self._still.marks()
        return status

    def _repeats(self, counts: Array) -> bool:
        """Whether pixels or chips, or all taxels, of a frame (t, c) are as in the frame before."""
        if not self._as_one:
            return bool(self._still.follow(counts).any())
        between = (counts > 0) & (counts < self._payload.full_count)
        return bool(self._still.follow(counts.reshape(1, -1), telling=bool(between.any())).any())

    def _status(self, status: Bytes, repeated: list[bool]) -> Bytes:
        """Bits of every taxel in every frame, those of repeated samples included."""
        if any(repeated):
            status = status | (np.array(repeated)[:, None] * np.uint8(TaxelStatus.STALE))
        if status.any():
            self._saturated += int(np.count_nonzero(status & np.uint8(TaxelStatus.SATURATED)))
            self._stale += int(np.count_nonzero(status & np.uint8(TaxelStatus.STALE)))
            self._stuck += int(np.count_nonzero(status & np.uint8(TaxelStatus.STUCK)))
        return status
