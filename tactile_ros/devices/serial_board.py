# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Boards on serial ports: bytes to frames, through unplugging, damage and loss."""

from __future__ import annotations

import math
import time
from abc import abstractmethod
from collections import deque
from collections.abc import Callable
from dataclasses import asdict

import numpy as np
import numpy.typing as npt

from tactile_ros.devices import framed_protocol, reskin_protocol
from tactile_ros.devices.fault_flags import StuckDetector, measured_temperature
from tactile_ros.devices.framed_protocol import FramedDecoder, Payload
from tactile_ros.devices.reskin_protocol import ReskinDecoder
from tactile_ros.devices.text_lines import LineDecoder
from tactile_ros.devices.timestamps import ArrivalTime, DeviceTime
from tactile_ros.devices.transport import SerialPort
from tactile_ros.errors import DeviceError, DeviceTimeout
from tactile_ros.types import Array, Bools, Bytes, Closing, Device, Frame, Layout, TaxelStatus

FIRST_RETRY_S = 0.05
LONGEST_RETRY_S = 0.5
BITS_PER_BYTE = 10  # on a UART, with start and stop bit
NOMINAL_RATE_HZ = 400.0
# foreign frames without one of ours before the stream counts as another one
MOST_FOREIGN = 3
# share of chips that must change before another one that does not is suspect
OTHERS = 0.5
# changes after which a board of one converter has not rested since it was opened
LIVELY = 10
ROUNDING = 1e-9  # share of a limit
# readings that a board of the framed protocol counts by their mark
MARKS = {
    'saturated': TaxelStatus.SATURATED, 'stale': TaxelStatus.STALE, 'stuck': TaxelStatus.STUCK,
}  # fmt: skip


def check_uart(what: str, size: int, rate_hz: float, baud: int) -> None:
    """Refuse frames of `size` bytes that a UART cannot carry at a rate, NaN: not checked."""
    needed, carried = size * rate_hz, baud / BITS_PER_BYTE
    if needed > carried:
        msg = (
            f'{what} at {rate_hz:g} Hz must fit the port: they are {needed:.0f} bytes/s and '
            f'{baud} baud carry {carried:.0f} bytes/s; lower the rate, raise the baud rate to '
            f'{math.ceil(needed * BITS_PER_BYTE)} or more, or set native_usb where the baud rate '
            'means nothing'
        )
        raise ValueError(msg)


def _arrival_time(layout: Layout) -> ArrivalTime:
    rate_hz = layout.rate_hz if layout.rate_hz > 0 else NOMINAL_RATE_HZ
    return ArrivalTime(max(1, round(1e9 / rate_hz)))


class SerialBoard(Closing, Device):
    """A board that sends frames without being asked, on a port that may be unplugged.

    Parameters
    ----------
    port, layout, decoder, stuck, time_of
        Device path; layout of the sensor; what finds frames in bytes, judges taxels, gives stamps.
    baud, native_usb : int, bool
        Baud rate, which means nothing where the port is USB from end to end: neither its capacity
        is checked then (ValueError) nor time on the wire taken off the stamps.
    clock : callable
        Gives the stamps (ns).
    """

    def __init__(
        self, port: str, layout: Layout, decoder: ReskinDecoder | FramedDecoder | LineDecoder,
        stuck: StuckDetector, time_of: ArrivalTime | DeviceTime, baud: int, native_usb: bool,
        clock: Callable[[], int],
    ) -> None:  # fmt: skip
        if not native_usb:
            check_uart(f'frames of {decoder.content}', decoder.size, layout.rate_hz, baud)
        self.layout = layout
        self._port = SerialPort(port, baud)
        self._stream, self._stuck, self._time_of = decoder, stuck, time_of
        self._clock = clock
        self._age_ns = 0 if native_usb else round(decoder.size * BITS_PER_BYTE / baud * 1e9)
        self._frames: deque[Frame] = deque()
        self._sequence = -1
        self._interrupted = 0
        self._openings = 0
        # the last: frames of which every chip says what it cannot have
        self._counts = {'dropped': 0, 'reconnects': 0, 'temperatures_refused': 0}
        self._closed = False
        self._failure = ''
        self._retry_s = self._retry_at = 0.0

    def counters(self) -> dict[str, int]:
        """Frames, losses and damage since the driver was made, by name.

        `dropped` has those of the decoder and one at least for each of the `reconnects`;
        `suspected` frames are missing by the clock alone.
        """
        return {**asdict(self._stream.counts), **self._counts, **self._time_of.counters()}

    def open(self) -> None:
        """Open the port; DeviceError in one sentence where it is missing, busy or forbidden."""
        if self._port.is_open:
            return
        self._port.open()
        self._closed = False
        self._retry_s = 0.0
        self._counts['reconnects'] += self._openings > 0
        self._interrupted += self._openings > 0
        self._openings += 1
        self._stream.reset()
        self._stuck.forget()
        self._time_of.restart()
        self._restart()

    def close(self) -> None:
        """Let the port go and forget frames that were not read."""
        self._closed = True
        self._port.close()
        self._frames.clear()

    def read(self, timeout: float) -> Frame:
        """Wait at most `timeout` (s) for the next frame, and for the port where it is unplugged.

        A DeviceTimeout says why none came: a port that is gone is tried again with growing pauses
        of at most 0.5 s. A DeviceError says that another stream comes than this board's, or that
        it was closed.
        """
        deadline = time.monotonic() + timeout
        while not self._frames:
            data = self._receive(max(0.0, deadline - time.monotonic()))
            if data:
                self.feed(data)
            if not self._frames and time.monotonic() >= deadline:
                if self._port.is_open:
                    raise self._silence(timeout)
                msg = f'{self._failure}; trying again'
                raise DeviceTimeout(msg)
        return self._frames.popleft()

    def waiting(self) -> list[Frame]:
        """Take the frames that came together with the last and were not read yet."""
        frames = list(self._frames)
        self._frames.clear()
        return frames

    @abstractmethod
    def feed(self, data: bytes) -> None:
        """Queue the frames that end in bytes that have just come, by the port or in its place."""

    def _restart(self) -> None:
        """Forget more of the stream of before."""

    @abstractmethod
    def _silence(self, timeout: float) -> DeviceError:
        """Error that says why nothing came through the open port."""

    def _receive(self, timeout: float) -> bytes:
        """Wait at most `timeout` (s) for bytes, or for the port where it is gone."""
        if self._closed:
            msg = f'{self._port.port} is closed'
            raise DeviceError(msg)
        try:
            if self._port.is_open:
                return self._port.read(timeout)
        except DeviceError as err:
            self._failure, self._retry_at = str(err), time.monotonic()
            return b''
        pause = self._retry_at - time.monotonic()
        if pause > 0:
            time.sleep(min(pause, timeout))
        if pause <= timeout:
            try:
                self.open()
            except DeviceError as err:
                self._retry_s = min(max(2 * self._retry_s, FIRST_RETRY_S), LONGEST_RETRY_S)
                self._failure, self._retry_at = str(err), time.monotonic() + self._retry_s
        return b''

    def _stands_still(self, readings: Array, inside: Bools) -> Bytes:
        """Bits (s, 1) of a board whose one converter repeats all readings `inside` its range."""
        together = readings.reshape(len(readings), 1, -1)
        return self._stuck.follow_frames(together, np.any(inside, axis=(1, 2)))

    def _losses(self, lost: list[int]) -> list[int]:
        """Frames lost before each frame, those of reconnections included."""
        interrupted, self._interrupted = self._interrupted, 0
        return [lost[0] + interrupted, *lost[1:]]

    def _queue(
        self, values: Array, temperature_c: Array | None, status: Bytes, stamp_ns: list[int],
        lost: list[int], device_ns: list[int] | None = None,
    ) -> None:  # fmt: skip
        """Number frames, count those lost before each, and queue them."""
        if temperature_c is not None:
            temperature_c, refused = measured_temperature(temperature_c)
            self._counts['temperatures_refused'] += refused
        marked: Bools = status.any(axis=1)  # type: ignore[assignment]
        for i, gap in enumerate(lost):
            self._counts['dropped'] += gap
            self._sequence += 1 + gap
            frame = Frame(
                stamp_ns[i], self._sequence, values[i],
                temperature_c=None if temperature_c is None else temperature_c[i],
                status=status[i] if marked[i] else None,
                device_time_ns=0 if device_ns is None else device_ns[i],
                dropped=self._counts['dropped'],
            )  # fmt: skip
            self._frames.append(frame)


class ReskinBoard(SerialBoard):
    """The ReSkin / AnySkin board as a `Device`.

    Parameters
    ----------
    port, layout, baud, native_usb, clock
        As in `SerialBoard`; the layout has 3 channels.
    temperature_measured : bool
        Whether the board sends a temperature that its chips measured.
    quantum : array_like, shape (3,), or None
        Step of the chips' readings (T), where it is exact; detects most flipped bits.
    mark_repeats : bool
        Mark frames that repeat the one before as STALE: for boards that poll faster than chips
        convert.
    conversion_s : float
        Time in which a chip measures (s); half of it is taken off the stamps. 0: unknown.

    Notes
    -----
    A stamp is the arrival of the frame's last byte less its time on the wire and half of
    `conversion_s`. `sequence` grows by one a frame and by the frames known lost: bytes skipped
    over the length of a frame, at least one for a reconnection. `counters()['suspected']` compares
    stamps with their usual spacing: a paused host looks the same, so those are not part of
    `sequence`. Chips that repeat themselves among others that change are STALE, and STUCK when it
    lasts.
    """

    def __init__(
        self, port: str, layout: Layout, baud: int = 115200, native_usb: bool = True,
        temperature_measured: bool = True, clock: Callable[[], int] = time.monotonic_ns,
        quantum: npt.ArrayLike | None = None, mark_repeats: bool = False,
        conversion_s: float = 0.0,
    ) -> None:  # fmt: skip
        taxels, channels = layout.shape
        if channels != 3:
            msg = f'layout of a ReSkin board must have 3 channels; received {channels}'
            raise ValueError(msg)
        self._decoder = ReskinDecoder(taxels, quantum)
        self._time = _arrival_time(layout)
        stuck = StuckDetector(taxels, others=OTHERS, whole=True)
        super().__init__(port, layout, self._decoder, stuck, self._time, baud, native_usb, clock)
        self._age_ns += round(conversion_s / 2 * 1e9)
        self._temperature_measured = temperature_measured
        self._mark_repeats = mark_repeats
        self._last = np.full((1, taxels, 4), np.nan)

    def _restart(self) -> None:
        self._last[:] = np.nan

    def feed(self, data: bytes) -> None:
        """See `SerialBoard.feed`."""
        now_ns = self._clock() - self._age_ns
        decoded = self._decoder.feed(data)
        if not decoded.lost:
            return
        lost = self._losses(decoded.lost)
        stamp_ns = self._time.follow(lost, now_ns)
        temperature_c = decoded.temperature_c if self._temperature_measured else None
        self._queue(decoded.values, temperature_c, self._status(decoded), stamp_ns, lost)

    def _status(self, decoded: reskin_protocol.Decoded) -> Bytes:
        status = self._stuck.follow_frames(decoded.values)
        status[decoded.error] |= np.uint8(TaxelStatus.ERROR)
        clipped = (np.abs(decoded.values) >= self.layout.saturation).any(axis=-1)
        status[clipped] |= np.uint8(TaxelStatus.SATURATED)
        if self._mark_repeats:
            readings = np.concatenate([decoded.values, decoded.temperature_c[..., None]], axis=-1)
            same = readings == np.concatenate([self._last, readings[:-1]])
            status[same.all(axis=-1)] |= np.uint8(TaxelStatus.STALE)
            self._last = readings[-1:]
        return status

    def _silence(self, timeout: float) -> DeviceError:
        port, pending, chips = self._port.port, self._decoder.pending, self.layout.shape[0]
        if self._decoder.locked or not pending:
            return DeviceTimeout(f'no frame came from {port} within {timeout:g} s')
        foreign = reskin_protocol.diagnose_stream(pending, chips)
        if foreign is not None:
            return DeviceError(f'{port}: {foreign}')
        why = f'bytes come from {port}, but no frame of {chips} chips within {timeout:g} s'
        return DeviceTimeout(why)


class FramedBoard(SerialBoard):
    """A board of the framed protocol as a `Device`.

    Parameters
    ----------
    port, layout, baud, native_usb, clock
        As in `SerialBoard`; the layout's taxels are in the order of the wire.
    payload : Payload
        Content of the frames; as many taxels and channels as the layout.
    scale : array_like, broadcast to (t, c)
        Unit of the layout per count.

    Notes
    -----
    Stamps follow the board's clock (`DeviceTime`), less the frame's time on the wire. `sequence`
    grows by one a frame and by those that the board's own counter says are lost, one at least for
    a reconnection or restart. Pixels and chips that repeat themselves among others that change are
    STALE, and STUCK when it lasts. Taxels of one converter are judged together, and not where all
    are at an end of its range: nothing may touch.
    """

    def __init__(
        self, port: str, layout: Layout, payload: Payload, scale: npt.ArrayLike,
        baud: int = 115200, native_usb: bool = False,
        clock: Callable[[], int] = time.monotonic_ns,
    ) -> None:  # fmt: skip
        want = (payload.count, payload.channels)
        if layout.shape != want:
            msg = f'layout of {payload} must have shape {want}; received {layout.shape}'
            raise ValueError(msg)
        if not np.isfinite(np.asarray(scale, np.float64)).all():
            msg = f'scale must be finite; received {scale!r}'
            raise ValueError(msg)
        self._decoder = FramedDecoder(payload)
        stuck = StuckDetector(payload.count, others=OTHERS, whole=True)
        if payload.one_converter:
            stuck = StuckDetector(1, least_changes=LIVELY)
        rate_hz = layout.rate_hz
        period_ns = round(1e9 / rate_hz) if math.isfinite(rate_hz) and rate_hz > 0 else 0
        self._time = DeviceTime(period_ns)
        super().__init__(port, layout, self._decoder, stuck, self._time, baud, native_usb, clock)
        self._scale = np.broadcast_to(np.asarray(scale, np.float64), layout.shape).copy()
        self._counts.update(dict.fromkeys(MARKS, 0))
        self._restart()

    def _restart(self) -> None:
        self._bytes_came = self._foreign_reported = False

    def feed(self, data: bytes) -> None:
        """See `SerialBoard.feed`; DeviceError, once, where frames of another kind come."""
        now_ns = self._clock() - self._age_ns
        self._bytes_came = True
        decoded = self._decoder.feed(data)
        if not decoded.lost:
            if self._decoder.foreign_frames >= MOST_FOREIGN and not self._foreign_reported:
                self._foreign_reported = True
                raise DeviceError(self._foreign())
            return
        lost = self._losses(decoded.lost)
        times = self._time.follow(decoded.time_us, lost, now_ns)
        values = decoded.counts * self._scale
        status = self._status(decoded, times.repeated)
        self._queue(values, decoded.temperature_c, status, times.stamp_ns, lost, times.device_ns)

    def _status(self, decoded: framed_protocol.Decoded, repeated: list[bool]) -> Bytes:
        counts, payload = decoded.counts, self._decoder.payload
        if payload.one_converter:
            inside = (counts > 0) & (counts < payload.full_count)
            still = self._stands_still(counts, inside)
        else:
            still = self._stuck.follow_frames(counts)
        status = decoded.status | still
        if any(repeated):
            status |= np.array(repeated)[:, None] * np.uint8(TaxelStatus.STALE)
        if status.any():
            for name, bit in MARKS.items():
                self._counts[name] += int(np.count_nonzero(status & np.uint8(bit)))
        return status

    def _foreign(self) -> str:
        return (
            f'{self._port.port}: the stream carries frames of {self._decoder.foreign}, not of '
            f'version {framed_protocol.VERSION}, {self._decoder.payload}: set the sensor and its '
            'taxels to what the board has'
        )

    def _silence(self, timeout: float) -> DeviceTimeout:
        port, why = self._port.port, 'no frame came from {}'
        if self._decoder.foreign_frames:
            return DeviceTimeout(self._foreign())
        if self._bytes_came and not self._decoder.synchronised:
            why = f'bytes come from {{}}, but no frame of {self._decoder.payload}'
        return DeviceTimeout(f'{why.format(port)} within {timeout:g} s')


class LineBoard(SerialBoard):
    """A board that prints the numbers of a frame in one line of text, as a `Device`.

    A line has the channels of the first taxel, then those of the second; `scale`, broadcast to (t,
    c), is the unit of the layout per printed number. Stamps and `suspected` as in `ReskinBoard`;
    `sequence` grows by one a line and by those that could not be read. Judged together as in
    `FramedBoard`.
    """

    def __init__(
        self, port: str, layout: Layout, scale: npt.ArrayLike = 1.0, baud: int = 115200,
        native_usb: bool = False, clock: Callable[[], int] = time.monotonic_ns,
    ) -> None:  # fmt: skip
        self._decoder = LineDecoder(layout.shape[0] * layout.shape[1])
        stuck = StuckDetector(1, least_changes=LIVELY)
        self._time = _arrival_time(layout)
        super().__init__(port, layout, self._decoder, stuck, self._time, baud, native_usb, clock)
        self._scale = np.broadcast_to(np.asarray(scale, np.float64), layout.shape)

    def feed(self, data: bytes) -> None:
        """See `SerialBoard.feed`."""
        now_ns = self._clock() - self._age_ns
        decoded = self._decoder.feed(data)
        if not decoded.lost:
            return
        lost = self._losses(decoded.lost)
        values = decoded.numbers.reshape(-1, *self.layout.shape) * self._scale
        limit = np.asarray(self.layout.saturation) * (1 - ROUNDING)
        clipped = np.abs(values) >= limit
        status = np.any(clipped, axis=-1) * np.uint8(TaxelStatus.SATURATED)
        status = status | self._stands_still(values, (values != 0) & ~clipped)
        self._queue(values, None, status, self._time.follow(lost, now_ns), lost)

    def _silence(self, timeout: float) -> DeviceTimeout:
        said = f'; the last line was {self._decoder.last}' if self._decoder.last else ''
        what = f'no line of {self._decoder.content.split()[0]} numbers'
        return DeviceTimeout(f'{what} came from {self._port.port} within {timeout:g} s{said}')
