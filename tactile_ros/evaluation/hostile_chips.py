"""The real driver of MLX90393 chips over a bus that answers its reads with random bytes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.devices.chip_array import ChipArray
from tactile_ros.devices.mlx90393 import ChipPlace, ChipSettings
from tactile_ros.devices.simulated_i2c import ChipArrayTwin
from tactile_ros.devices.timestamps import VirtualClock
from tactile_ros.devices.transport import I2cBus
from tactile_ros.errors import DeviceTimeout
from tactile_ros.evaluation.fault_trials import usable
from tactile_ros.types import Array, Layout

if TYPE_CHECKING:
    from tactile_ros.devices.simulated_i2c import SimulatedI2cBus
    from tactile_ros.devices.transport import I2cMessage

CHIPS = 4
FIELD = (1e-3, 2e-3, -1e-3)
# above the noise of the twin, below any wrong reading that matters
TOLERANCE = 100e-6
PATIENCE_NS = 10 * 10**9


@dataclass
class HostileChips:
    """What the driver made of hostile answers.

    Attributes
    ----------
    strings : int
        Hostile answers.
    beyond : int
        Readings outside of the range that no bit marks.
    wrong : int
        Readings that no bit marks and that are not what the chip measured, where only status
        bytes were hostile.
    recovery_s : float
        Time until all chips could be used again, afterwards (s).
    """

    strings: int = 0
    beyond: int = 0
    wrong: int = 0
    recovery_s: float = 0.0


class HostileBus:
    """A simulated bus, some of whose answers to the reads of measurements are random.

    Parameters
    ----------
    bus : SimulatedI2cBus
        With the chips.
    length : int
        Of the answers that are hostile (bytes).
    hostile : int
        Bytes of them, from the first, that are random.
    rng : Generator
        Of the bytes.

    Attributes
    ----------
    active : bool
        Whether every other answer is hostile.
    strings : int
        Hostile answers so far.
    """

    def __init__(
        self, bus: SimulatedI2cBus, length: int, hostile: int, rng: np.random.Generator
    ) -> None:
        """See the class."""
        self.active = False
        self.strings = 0
        self._bus = bus
        self._length = length
        self._hostile = hostile
        self._rng = rng

    def i2c_rdwr(self, *messages: I2cMessage) -> None:
        """Exchange bytes."""
        self._bus.i2c_rdwr(*messages)
        answer = messages[-1]
        if self.active and answer.len == self._length and self._rng.random() < 0.5:
            self.strings += 1
            for i, byte in enumerate(self._rng.bytes(self._hostile)):
                answer.buf[i] = byte

    def close(self) -> None:
        """Let the bus go."""
        self._bus.close()


def suffer_answers(
    strings: int, resolution: int, status_only: bool, rng: np.random.Generator
) -> HostileChips:
    """Let four chips answer with random bytes.

    Parameters
    ----------
    strings : int
        Hostile answers.
    resolution : int
        Of all axes, 0 to 3; at 3 random codes lie outside of the range, too.
    status_only : bool
        Whether the codes stay what the chip measured.
    rng : Generator
        Of the bytes.

    Returns
    -------
    HostileChips
        What the driver made of them.
    """
    settings = ChipSettings(resolution=(resolution,) * 3)
    places = [ChipPlace(0x0C + i) for i in range(CHIPS)]
    layout = Layout(np.zeros((CHIPS, 3)), ('Bx', 'By', 'Bz'), 'T')
    clock = VirtualClock()
    twin = ChipArrayTwin(places, layout, _field, settings=settings, clock=clock, seed=1)
    length = settings.answer_bytes
    bus = HostileBus(twin.buses[0], length, 1 if status_only else length, rng)
    array = ChipArray(
        [I2cBus('hostile', smbus=bus)], places, layout, settings,
        clock_ns=clock.now_ns, monotonic_ns=clock.now_ns, sleep=clock.sleep,
    )  # fmt: skip
    found = HostileChips()
    with twin, array:
        bus.active = True
        while bus.strings < strings:
            _judge(array, settings, status_only, found)
        bus.active = False
        begun_ns = clock.now_ns()
        while not _all_good(array) and clock.now_ns() - begun_ns < PATIENCE_NS:
            pass
        found.recovery_s = (clock.now_ns() - begun_ns) * 1e-9
    found.strings = bus.strings
    return found


def _field(t: float) -> Array:
    """What the chips measure (T)."""
    return np.tile(FIELD, (CHIPS, 1))


def _judge(
    array: ChipArray, settings: ChipSettings, status_only: bool, found: HostileChips
) -> None:
    """Count what lies in one frame."""
    try:
        frame = array.read(0.1)
    except DeviceTimeout:
        return
    values = frame.values[usable(frame)]
    found.beyond += int(np.count_nonzero((np.abs(values) >= settings.full_scale).any(axis=1)))
    if status_only:
        found.wrong += int(np.count_nonzero((np.abs(values - FIELD) > TOLERANCE).any(axis=1)))


def _all_good(array: ChipArray) -> bool:
    """Whether every chip of the next frame may be used."""
    try:
        return bool(usable(array.read(0.1)).all())
    except DeviceTimeout:
        return False
