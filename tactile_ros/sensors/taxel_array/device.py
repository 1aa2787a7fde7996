"""A taxel array behind a microcontroller on a serial port, real or simulated."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from tactile_ros.devices.connections import FramedConnection, open_framed, simulate_framed
from tactile_ros.devices.framed_protocol import taxel_matrix
from tactile_ros.sensors.taxel_array.config import layout
from tactile_ros.sensors.taxel_array.signal import NOISE
from tactile_ros.sensors.taxel_array.signal import signal as own_signal
from tactile_ros.types.config_fields import whole

if TYPE_CHECKING:
    from collections.abc import Callable

    from tactile_ros.devices.simulated_serial import FramedTwin
    from tactile_ros.devices.timestamps import VirtualClock
    from tactile_ros.sensors.taxel_array.config import TaxelArrayConfig
    from tactile_ros.types import Array, Device


@dataclass(frozen=True)
class TaxelArrayConnection(FramedConnection):
    """A microcontroller that scans the matrix and sends packed counts of 10 bits in frames."""

    full_count: int = whole(1023, 'count of the converter at its full range', 1, 1023)


def open_array(
    config: TaxelArrayConfig, connection: TaxelArrayConnection, clock_ns: Callable[[], int]
) -> Device:
    """Array of `config` at `connection`, with stamps from `clock_ns`; not opened yet."""
    payload = taxel_matrix(len(config.positions), connection.full_count)
    return open_framed(layout(config), connection, payload, 1 / connection.full_count, clock_ns)


def simulate_array(
    config: TaxelArrayConfig,
    connection: TaxelArrayConnection,
    signal: Callable[[float], Array] | None = None,
    seed: int = 0,
    clock: VirtualClock | None = None,
) -> FramedTwin:
    """Twin of an array that plays `signal`, or a simple one of its own; not entered yet."""
    return simulate_framed(
        layout(config),
        connection,
        taxel_matrix(len(config.positions), connection.full_count),
        1 / connection.full_count,
        own_signal(config, seed) if signal is None else signal,
        NOISE if config.noise is None else config.noise,
        seed,
        clock,
    )
