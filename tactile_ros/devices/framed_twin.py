"""Simulated twin of a framed board: counts, sequence and a clock that drifts and jumps."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.devices.framed import encode
from tactile_ros.devices.framed_board import FramedBoard
from tactile_ros.devices.framed_payloads import Kind
from tactile_ros.devices.serial_twin import SERIAL_FAULTS, SerialTwin
from tactile_ros.types import Array, Layout

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy.typing as npt

    from tactile_ros.devices.clock import VirtualClock
    from tactile_ros.devices.framed_payloads import Payload

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
        data = encode(self._payload, counts, self._sequence, time_us, temperature_c)
        self._sequence += 1
        return data
