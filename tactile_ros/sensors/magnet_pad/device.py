"""The magnet pad on an I2C bus or on a serial port, real or simulated."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from tactile_ros.devices.connections import ChipConnection, open_chips, simulate_chips
from tactile_ros.sensors.magnet_pad.config import layout
from tactile_ros.sensors.magnet_pad.signal import NOISE
from tactile_ros.sensors.magnet_pad.signal import signal as own_signal

if TYPE_CHECKING:
    from collections.abc import Callable

    from tactile_ros.devices.clock import VirtualClock
    from tactile_ros.sensors.magnet_pad.config import MagnetPadConfig
    from tactile_ros.types import Array, Device, Twin


@dataclass(frozen=True)
class MagnetPadConnection(ChipConnection):
    """Two chips on one I2C bus, 0x0C and 0x0D, or a microcontroller that reads them."""


def open_pad(
    config: MagnetPadConfig, connection: MagnetPadConnection, clock_ns: Callable[[], int]
) -> Device:
    """Pad of `config` at `connection`, with stamps from `clock_ns`; not opened yet."""
    return open_chips(layout(config), connection, clock_ns)


def simulate_pad(
    config: MagnetPadConfig,
    connection: MagnetPadConnection,
    signal: Callable[[float], Array] | None = None,
    seed: int = 0,
    clock: VirtualClock | None = None,
) -> Twin:
    """Twin of a pad that plays `signal`, or a simple one of its own; not entered yet."""
    return simulate_chips(
        layout(config),
        connection,
        own_signal(config, seed) if signal is None else signal,
        NOISE if config.noise is None else config.noise,
        seed,
        clock,
    )
