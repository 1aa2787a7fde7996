"""The five-wire skin behind a microcontroller on a serial port, real or simulated."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from tactile_ros.devices.connections import FramedConnection, open_framed, simulate_framed
from tactile_ros.devices.framed_protocol import five_wires
from tactile_ros.sensors.five_wire_skin.config import layout
from tactile_ros.sensors.five_wire_skin.signal import NOISE
from tactile_ros.sensors.five_wire_skin.signal import signal as own_signal
from tactile_ros.types.config_fields import whole

if TYPE_CHECKING:
    from collections.abc import Callable

    from tactile_ros.devices.simulated_serial import FramedTwin
    from tactile_ros.devices.timestamps import VirtualClock
    from tactile_ros.sensors.five_wire_skin.config import FiveWireSkinConfig
    from tactile_ros.types import Array, Device


@dataclass(frozen=True)
class FiveWireSkinConnection(FramedConnection):
    """A microcontroller that excites the corners in turn and sends its counts in frames."""

    # the converter of the PIC18F25K80 that [5] used
    full_count: int = whole(4095, 'count of the converter at the supply', 1, 0xFFFF)


def open_skin(
    config: FiveWireSkinConfig, connection: FiveWireSkinConnection, clock_ns: Callable[[], int]
) -> Device:
    """Skin of `config` at `connection`, with stamps from `clock_ns`; not opened yet."""
    payload = five_wires(connection.full_count, len(config.channels))
    return open_framed(layout(config), connection, payload, 1 / connection.full_count, clock_ns)


def simulate_skin(
    config: FiveWireSkinConfig,
    connection: FiveWireSkinConnection,
    signal: Callable[[float], Array] | None = None,
    seed: int = 0,
    clock: VirtualClock | None = None,
) -> FramedTwin:
    """Twin of a skin that plays `signal`, or a simple one of its own; not entered yet."""
    return simulate_framed(
        layout(config),
        connection,
        five_wires(connection.full_count, len(config.channels)),
        1 / connection.full_count,
        own_signal(config, seed) if signal is None else signal,
        NOISE if config.noise is None else config.noise,
        seed,
        clock,
    )
