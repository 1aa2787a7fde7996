"""The multipole skin on I2C buses or on a serial port, real or simulated."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from tactile_ros.devices.connections import ChipConnection, open_chips, simulate_chips
from tactile_ros.sensors.multipole_skin.config import layout
from tactile_ros.sensors.multipole_skin.signal import NOISE
from tactile_ros.sensors.multipole_skin.signal import signal as own_signal
from tactile_ros.types.fields import whole, whole_numbers

if TYPE_CHECKING:
    from collections.abc import Callable

    from tactile_ros.devices.clock import VirtualClock
    from tactile_ros.sensors.multipole_skin.config import MultipoleSkinConfig
    from tactile_ros.types import Array, Device, Twin

CLUSTERS, CHIPS = 5, 4


@dataclass(frozen=True)
class MultipoleSkinConnection(ChipConnection):
    """Five clusters of four chips behind one switch, or a microcontroller that reads them.

    The default addresses each cluster by a channel of a switch at 0x70, and its four chips by
    their pins, 0x0C to 0x0F.
    """

    addresses: tuple[int, ...] = whole_numbers(
        (0x0C, 0x0D, 0x0E, 0x0F) * CLUSTERS, 'address of each chip', 8, 0x77
    )
    mux_addresses: tuple[int, ...] = whole_numbers(
        (0x70,), 'switch of each chip, or of all; 0: none', 0, 0x77
    )
    mux_channels: tuple[int, ...] = whole_numbers(
        tuple(i // CHIPS for i in range(CLUSTERS * CHIPS)),
        'channel of the switch for each chip, or for all', 0, 7,
    )  # fmt: skip
    gain: int = whole(5, 'GAIN_SEL; 0 has the largest range, 7 the finest step', 0, 7)


def open_skin(
    config: MultipoleSkinConfig, connection: MultipoleSkinConnection, clock_ns: Callable[[], int]
) -> Device:
    """Skin of `config` at `connection`, with stamps from `clock_ns`; not opened yet."""
    return open_chips(layout(config), connection, clock_ns)


def simulate_skin(
    config: MultipoleSkinConfig,
    connection: MultipoleSkinConnection,
    signal: Callable[[float], Array] | None = None,
    seed: int = 0,
    clock: VirtualClock | None = None,
) -> Twin:
    """Twin of a skin that plays `signal`, or a simple one of its own; not entered yet."""
    return simulate_chips(
        layout(config),
        connection,
        own_signal(config, seed) if signal is None else signal,
        NOISE if config.noise is None else config.noise,
        seed,
        clock,
    )
