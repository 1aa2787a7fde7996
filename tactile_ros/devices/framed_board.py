"""A board that speaks the framed protocol of docs/serial_protocol.md: counts to SI frames."""

from __future__ import annotations

import math
import time
from dataclasses import asdict
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.devices.device_time import DeviceTime
from tactile_ros.devices.framed import VERSION, frame_bytes
from tactile_ros.devices.framed_decoder import Decoded, FramedDecoder
from tactile_ros.devices.framed_payloads import Kind, Payload
from tactile_ros.devices.reconnecting import StreamingBoard, check_capacity, wire_s
from tactile_ros.devices.still_watch import StillWatch
from tactile_ros.errors import DeviceError, DeviceTimeout
from tactile_ros.types import Array, Bytes, Frame, Layout, TaxelStatus

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy.typing as npt

# foreign frames without one of ours before the stream is called another one
STRANGERS = 3
# share of pixels or chips that must change before another one that does not is suspect
OTHERS = 0.5
# changes after which a board of one converter is known not to rest since it was opened
LIVELY = 10


class FramedBoard(StreamingBoard):
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
        size = frame_bytes(payload)
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

    def _queue(self, decoded: Decoded, now_ns: int) -> None:
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
