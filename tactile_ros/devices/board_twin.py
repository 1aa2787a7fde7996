"""Simulated twin of the ReSkin / AnySkin board: float32 readings without sequence or clock."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.devices.packets import encode
from tactile_ros.devices.serial_board import SerialBoard
from tactile_ros.devices.serial_twin import SERIAL_FAULTS, SerialTwin
from tactile_ros.types import Array, Layout

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy.typing as npt

    from tactile_ros.devices.clock import VirtualClock
    from tactile_ros.types import Device

NAN_BYTES = b'\x00\x00\xc0\x7f'


class BoardTwin(SerialTwin):
    """The board on a pseudo-terminal.

    Parameters
    ----------
    layout : Layout
        Of the sensor; its `rate_hz` is the board's, its `saturation` where its chips clip.
    signal : callable
        Time since the start (s) -> flux density, shape (t, 3) (T).
    noise, temperature_c, seed, clock
        As in `SerialTwin`.
    quantum : array_like, broadcast to (3,), or None
        Step of the chips' readings (T), to which values are rounded.
    driver : callable or None
        Port and clock (ns) -> driver, as a sensor opens it; None: `SerialBoard` on native USB that
        is told `quantum`.

    Notes
    -----
    nan: one field of a frame becomes not a number. The format has no checksum: flipped, garbage
    and shifted may pass unseen, and lost frames leave no trace (`damage`). Saturation is a fault
    only where the layout says at which field.
    """

    faults = (*SERIAL_FAULTS, 'nan')

    def __init__(
        self,
        layout: Layout,
        signal: Callable[[float], Array],
        noise: npt.ArrayLike = 0.0,
        temperature_c: Callable[[float], Array] | None = None,
        seed: int = 0,
        clock: VirtualClock | None = None,
        quantum: npt.ArrayLike | None = None,
        driver: Callable[[str, Callable[[], int]], Device] | None = None,
    ) -> None:
        """See the class."""
        if not np.isfinite(np.asarray(layout.saturation, np.float64)).all():
            self.faults = tuple(fault for fault in self.faults if fault != 'saturation')
        super().__init__(layout, signal, noise, temperature_c, seed, clock)
        self._quantum = None if quantum is None else np.broadcast_to(quantum, 3)
        self._driver = driver

    def device(self, clock_ns: Callable[[], int]) -> Device:
        """The real driver on this twin's port, stamped by `clock_ns`; not yet entered."""
        if self._driver is not None:
            return self._driver(self.port, clock_ns)
        return SerialBoard(self.port, self.layout, clock=clock_ns, quantum=self._quantum)

    def _bytes(self, values: Array, temperature_c: Array, t: float, fault: str) -> bytes:
        """One frame."""
        if self._quantum is not None:
            values = np.rint(values / self._quantum) * self._quantum
        data = encode(values, temperature_c)
        if fault != 'nan':
            return data
        place = 4 * int(self._rng.integers(len(data) // 4))
        return data[:place] + NAN_BYTES + data[place + 4 :]
