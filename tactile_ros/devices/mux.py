"""TCA9548A bus switches: which channel is open, and where chips sit behind them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from tactile_ros.devices.mlx90393 import ADDRESSES, DEFAULT_ADDRESS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tactile_ros.devices.transport import I2cBus

MUX_ADDRESSES = range(0x70, 0x78)
CHANNELS = range(8)


@dataclass(frozen=True)
class ChipPlace:
    """Where a chip is reached.

    Attributes
    ----------
    address : int
        Its own, 7 bits.
    bus : int
        Number of its bus in the list of buses.
    mux, channel : int or None
        Switch (0x70 to 0x77) and channel (0 to 7) that it is behind; None: directly on the bus.
    """

    address: int = DEFAULT_ADDRESS
    bus: int = 0
    mux: int | None = None
    channel: int | None = None

    def __post_init__(self) -> None:
        """Refuse places that cannot be."""
        if self.address not in ADDRESSES:
            msg = f'address of ChipPlace must be 0x08 to 0x77; received {self.address:#04x}'
            raise ValueError(msg)
        if self.bus < 0:
            msg = f'bus of ChipPlace must be 0 or more; received {self.bus}'
            raise ValueError(msg)
        direct = self.mux is None and self.channel is None
        if not direct and (self.mux not in MUX_ADDRESSES or self.channel not in CHANNELS):
            msg = (
                'mux and channel of ChipPlace must be 0x70 to 0x77 and 0 to 7, or both None; '
                f'received {self.mux} and {self.channel}'
            )
            raise ValueError(msg)

    def __str__(self) -> str:
        """Name the place in a sentence."""
        where = f'{self.address:#04x} on bus {self.bus}'
        if self.mux is None:
            return where
        return f'{where} behind channel {self.channel} of {self.mux:#04x}'


def clusters(count: int = 5, chips: int = 4, mux: int = 0x70, bus: int = 0) -> list[ChipPlace]:
    """Places of equal clusters behind the channels of one switch, e.g. 5 clusters of 4 chips."""
    addresses = range(DEFAULT_ADDRESS, DEFAULT_ADDRESS + chips)
    return [ChipPlace(a, bus, mux, channel) for channel in range(count) for a in addresses]


def refuse_conflicts(places: Sequence[ChipPlace]) -> None:
    """Refuse places of which two would answer at once.

    Raises
    ------
    ValueError
        If two chips share a place, or one directly on a bus has the address of one behind a
        switch or of a switch.
    """
    taken: set[ChipPlace] = set()
    direct = {(place.bus, place.address) for place in places if place.mux is None}
    switches = {(place.bus, place.mux) for place in places if place.mux is not None}
    for place in places:
        hidden = place.mux is not None and (place.bus, place.address) in direct
        if place in taken or hidden or (place.bus, place.address) in switches:
            msg = f'places of chips must differ; two would answer as {place}'
            raise ValueError(msg)
        taken.add(place)


class Switches:
    """The switches of one bus: opens one channel of one of them, and writes only what changes.

    Parameters
    ----------
    bus : I2cBus
        What carries the writes.
    addresses : sequence of int
        All switches of the bus that have chips behind them.
    """

    def __init__(self, bus: I2cBus, addresses: Sequence[int] = ()) -> None:
        """See the class."""
        self._bus = bus
        self._open: dict[int, int | None] = dict.fromkeys(addresses)

    def forget(self) -> None:
        """Believe nothing of what is open, as after a failure."""
        self._open = dict.fromkeys(self._open)

    def select(self, mux: int | None, channel: int | None) -> None:
        """Open a channel and close those of other switches; chips directly on the bus need none.

        Raises
        ------
        NotAcknowledged
            If a switch does not answer.
        """
        if mux is None or channel is None or self._open.get(mux) == 1 << channel:
            return
        for other, mask in self._open.items():
            if other != mux and mask != 0:
                self._write(other, 0)
        self._write(mux, 1 << channel)

    def _write(self, mux: int, mask: int) -> None:
        """Write a control byte; what is open is unknown until that succeeded."""
        self._open[mux] = None
        self._bus.transfer(mux, bytes((mask,)), 0)
        self._open[mux] = mask
