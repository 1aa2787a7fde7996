"""ReSkin / AnySkin board on a serial port: bytes to frames, through unplugging and damage."""

from __future__ import annotations

import time
from dataclasses import asdict
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.devices.framing import Decoded, FrameDecoder
from tactile_ros.devices.packets import foreign, frame_bytes
from tactile_ros.devices.reconnecting import StreamingBoard, check_capacity, wire_s
from tactile_ros.devices.still_watch import StillWatch
from tactile_ros.errors import DeviceError, DeviceTimeout
from tactile_ros.types import Array, Bools, Bytes, Frame, Integers, Layout, TaxelStatus

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy.typing as npt

NOMINAL_RATE_HZ = 400.0
CLOCK_RESET_NS = 1_000_000_000
LONG_GAP = 3.0
# share of chips that must change before another one that does not is suspect
OTHERS = 0.5


def uart_transfer_s(chips: int, baud: int) -> float:
    """Time (s) that a frame of `chips` chips takes on a true UART, ten bits a byte."""
    return wire_s(frame_bytes(chips), baud)


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


class SerialBoard(StreamingBoard):
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
            check_capacity(f'frames of {taxels} chips', frame_bytes(taxels), layout.rate_hz, baud)
        rate = layout.rate_hz if layout.rate_hz > 0 else NOMINAL_RATE_HZ
        super().__init__(port, baud, layout)
        self._decoder = FrameDecoder(taxels, quantum)
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

    def _queue(self, decoded: Decoded, now_ns: int) -> None:
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

    def _status(self, decoded: Decoded) -> Bytes:
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

    def _repeats(self, decoded: Decoded) -> Bools:
        """Chips whose reading is the frame before's, to the last bit."""
        readings = np.concatenate([decoded.temperature_c[..., None], decoded.values], axis=-1)
        if self._last is None:
            before = np.full((1, *readings.shape[1:]), np.nan)
        else:
            before = np.concatenate([self._last[1][:, None], self._last[0]], axis=-1)[None]
        same: Bools = (readings == np.concatenate([before, readings[:-1]])).all(axis=-1)
        return same
