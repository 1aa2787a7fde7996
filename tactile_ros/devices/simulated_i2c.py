"""Simulated I2C bus with chips and switches: takes smbus2's messages and charges their time."""

from __future__ import annotations

import ctypes
import errno
import os
from typing import TYPE_CHECKING

from tactile_ros.devices.mux import ChipPlace

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from tactile_ros.devices.clock import Clock
    from tactile_ros.devices.simulated_chip import SimulatedChip
    from tactile_ros.devices.transport import I2cMessage

BITS_PER_BYTE = 9  # with the acknowledgement
READING = 0x0001  # I2C_M_RD


def _nothing() -> None:
    """Nothing is to be done."""


def _ignore(fault: str) -> None:
    """Nobody counts."""


class SimulatedMux:
    """A TCA9548A: one byte, whose bits open channels."""

    def __init__(self) -> None:
        """See the class."""
        self.mask = 0

    def write(self, data: bytes, now_ns: int) -> None:
        """Open the channels of the last byte, at once."""
        self.mask = data[-1] if data else self.mask

    def read(self, count: int) -> bytes:
        """Tell which are open."""
        return bytes((self.mask,)) * count


class SimulatedI2cBus:
    """A bus that stands in for `smbus2.SMBus`: `i2c_rdwr` on real messages.

    Parameters
    ----------
    clock : Clock
        Passes while bytes are on the wire.
    chips : mapping of ChipPlace to SimulatedChip
        Who is there.
    hertz : float
        Clock of the bus (Hz).
    timeout_s : float
        How long the adapter holds a transfer on a stuck bus (s).
    on_transfer : callable
        Called before each transfer.
    on_fault : callable
        Told the name of a fault that happens on the bus.

    Attributes
    ----------
    stuck : int
        Transfers that will find the bus stuck.
    silent : dict
        Transfers that a chip will not acknowledge, by place.
    gone_until_ns : int
        When the adapter is plugged in again (ns).
    busy_s : float
        Time that bytes were on the wire (s).

    Notes
    -----
    Every byte takes 9 clocks, start, repeated start and stop one each. All chips with an address
    answer together, so that two at one address spoil each other's bits, as on wires.
    """

    def __init__(
        self,
        clock: Clock,
        chips: Mapping[ChipPlace, SimulatedChip],
        hertz: float = 400e3,
        timeout_s: float = 0.02,
        on_transfer: Callable[[], None] = _nothing,
        on_fault: Callable[[str], None] = _ignore,
    ) -> None:
        """See the class."""
        self._clock = clock
        self._chips = dict(chips)
        self._at: dict[int, list[tuple[ChipPlace, SimulatedChip]]] = {}
        for place, chip in chips.items():
            self._at.setdefault(place.address, []).append((place, chip))
        self._muxes = {p.mux: SimulatedMux() for p in chips if p.mux is not None}
        self._bit_s = 1 / hertz
        self._timeout_s = timeout_s
        self._on_transfer = on_transfer
        self._on_fault = on_fault
        self.stuck = 0
        self.silent: dict[ChipPlace, int] = {}
        self.gone_until_ns = 0
        self.busy_s = 0.0

    def close(self) -> None:
        """Let go; nothing is held."""

    def power_down(self, now_ns: int) -> None:
        """Take the supply of everything away and give it back."""
        for mux in self._muxes.values():
            mux.mask = 0
        for chip in self._chips.values():
            chip.power_up(now_ns)

    def i2c_rdwr(self, *messages: I2cMessage) -> None:
        """Carry messages in one transaction.

        Raises
        ------
        OSError
            ENODEV unplugged, ETIMEDOUT stuck, EREMOTEIO not acknowledged.
        """
        self._on_transfer()
        now_ns = self._clock.now_ns()
        if now_ns < self.gone_until_ns:
            raise OSError(errno.ENODEV, os.strerror(errno.ENODEV))
        if self.stuck:
            self.stuck -= 1
            self._on_fault('stuck_bus')
            self._clock.sleep(self._timeout_s)
            raise OSError(errno.ETIMEDOUT, os.strerror(errno.ETIMEDOUT))
        bits = 1
        try:
            for message in messages:
                bits += 1 + BITS_PER_BYTE
                listeners = self._listeners(message.addr, now_ns + round(bits * self._bit_s * 1e9))
                if not listeners:
                    raise OSError(errno.EREMOTEIO, os.strerror(errno.EREMOTEIO))
                bits += BITS_PER_BYTE * message.len
                _carry(message, listeners, now_ns + round(bits * self._bit_s * 1e9))
        finally:
            self.busy_s += bits * self._bit_s
            self._clock.sleep(bits * self._bit_s)

    def _listeners(self, address: int, now_ns: int) -> list[SimulatedMux | SimulatedChip]:
        """Who acknowledges an address now."""
        found: list[SimulatedMux | SimulatedChip] = []
        if address in self._muxes:
            found.append(self._muxes[address])
        for place, chip in self._at.get(address, ()):
            if self._reached(place) and self._answers(place, chip, now_ns):
                found.append(chip)
        return found

    def _reached(self, place: ChipPlace) -> bool:
        """Whether the channel of a place is open."""
        if place.mux is None or place.channel is None:
            return True
        return bool(self._muxes[place.mux].mask >> place.channel & 1)

    def _answers(self, place: ChipPlace, chip: SimulatedChip, now_ns: int) -> bool:
        """Whether a chip acknowledges now."""
        if self.silent and self.silent.get(place, 0):
            self.silent[place] -= 1
            self._on_fault('nack')
            return False
        return chip.awake(now_ns)


def _carry(
    message: I2cMessage, listeners: list[SimulatedMux | SimulatedChip], now_ns: int
) -> None:
    """One message of a transaction, between the master and all that listen."""
    if not message.flags & READING:
        for listener in listeners:
            listener.write(bytes(message), now_ns)
        return
    wires = listeners[0].read(message.len)
    for listener in listeners[1:]:
        wires = bytes(a & b for a, b in zip(wires, listener.read(message.len), strict=True))
    ctypes.memmove(message.buf, wires, message.len)
