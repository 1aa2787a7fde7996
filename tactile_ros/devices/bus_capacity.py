"""How many frames a second I2C buses carry, by arithmetic: clocks of every exchange, conversions.

Every byte takes 9 clocks; start, repeated start and stop take one each. Gaps of the adapter and
clock stretching come on top, so that only what can never be is refused.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

from tactile_ros.devices.mux import Switches

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tactile_ros.devices.mlx90393 import ChipSettings
    from tactile_ros.devices.mux import ChipPlace
    from tactile_ros.devices.transport import I2cBus

BITS_PER_BYTE = 9
COMMAND_BYTES = STATUS_BYTES = MASK_BYTES = 1


class _SwitchWrites:
    """A bus that only counts what is written to its switches."""

    def __init__(self) -> None:
        self.count = 0

    def transfer(self, address: int, data: bytes, count: int) -> bytes:
        """Count a write."""
        self.count += 1
        return bytes(count)


def exchange_bits(written: int, answered: int = 0) -> int:
    """Clocks of one exchange: so many bytes written, then so many answered."""
    parts = (written, answered) if answered else (written,)
    return 1 + sum(1 + BITS_PER_BYTE * (1 + count) for count in parts)


def switch_bits(places: Sequence[ChipPlace]) -> list[int]:
    """Clocks of the switches before each chip, one a place, when all are visited in turn."""
    buses = {place.bus: _SwitchWrites() for place in places}
    switches = {
        number: Switches(
            cast('I2cBus', bus),
            sorted({p.mux for p in places if p.bus == number and p.mux is not None}),
        )
        for number, bus in buses.items()
    }
    bits: list[int] = []
    for place in (*places, *places):
        before = buses[place.bus].count
        switches[place.bus].select(place.mux, place.channel)
        bits.append((buses[place.bus].count - before) * exchange_bits(MASK_BYTES))
    return bits[len(places) :]


def carried_hz(
    places: Sequence[ChipPlace], settings: ChipSettings, burst: bool, bus_hz: float
) -> float:
    """Most frames a second that chips and buses carry, read by one thread.

    Parameters
    ----------
    places : sequence of ChipPlace
        Where the chips are, in the order in which they are read.
    settings : ChipSettings
        Of all chips; they take the nominal time for a measurement.
    burst : bool
        Whether chips measure without end; otherwise all are started, then all are read.
    bus_hz : float
        Clock of the buses (Hz).

    Returns
    -------
    float
        Frames per second.
    """
    switching = switch_bits(places)
    reading = exchange_bits(COMMAND_BYTES, settings.answer_bytes)
    if burst:
        wire_s = (sum(switching) + len(places) * reading) / bus_hz
        return 1 / max(wire_s, settings.conversion_s)
    now_s, ready_s = 0.0, []
    for bits in switching:
        now_s += (bits + exchange_bits(COMMAND_BYTES, STATUS_BYTES)) / bus_hz
        ready_s.append(now_s + settings.conversion_s)
    for bits, ready in zip(switching, ready_s, strict=True):
        now_s = max(now_s + bits / bus_hz, ready) + reading / bus_hz
    return 1 / now_s


def check_bus_capacity(
    places: Sequence[ChipPlace],
    settings: ChipSettings,
    burst: bool,
    rate_hz: float,
    bus_hz: float,
) -> None:
    """Refuse a rate that chips and buses cannot carry.

    Parameters
    ----------
    places, settings, burst, bus_hz
        As in `carried_hz`.
    rate_hz : float
        Frames a second; not a number: as many as there are.

    Raises
    ------
    ValueError
        If it is more; names both rates and what the second follows from.
    """
    carried = carried_hz(places, settings, burst, bus_hz)
    if not rate_hz > carried:
        return
    behind = sum(place.mux is not None for place in places)
    switched = f', {behind} of them behind switches' if behind else ''
    faster = 'the conversion' if burst else "the conversion, read in mode 'burst'"
    msg = (
        f'{len(places)} chips{switched} at {rate_hz:g} Hz must fit their I2C bus: in mode '
        f'{"burst" if burst else "single"} a bus of {bus_hz / 1e3:g} kHz and conversions of '
        f'{1e3 * settings.conversion_s:.3g} ms carry {carried:.4g} Hz; lower the rate, shorten '
        f'{faster}, or raise bus_clock where bus and adapter allow it'
    )
    raise ValueError(msg)
