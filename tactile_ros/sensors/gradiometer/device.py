"""The gradiometer behind a microcontroller on a serial port, real or simulated."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from tactile_ros.devices.connections import FramedConnection, open_framed, simulate_framed
from tactile_ros.devices.framed_protocol import gradiometer
from tactile_ros.sensors.gradiometer.config import layout
from tactile_ros.sensors.gradiometer.signal import NOISE, temperature
from tactile_ros.sensors.gradiometer.signal import signal as scenes
from tactile_ros.types.config_fields import number

if TYPE_CHECKING:
    from collections.abc import Callable

    from tactile_ros.devices.simulated_serial import FramedTwin
    from tactile_ros.devices.timestamps import VirtualClock
    from tactile_ros.sensors.gradiometer.config import GradiometerConfig
    from tactile_ros.types import Array, Device


@dataclass(frozen=True)
class GradiometerConnection(FramedConnection):
    """A microcontroller that sends eight counts and the chip's temperature in frames."""

    tesla_per_count: float = number(2.5e-6, 'step of a reading', 'T', 1e-9, 1e-3)


def open_gradiometer(
    config: GradiometerConfig, connection: GradiometerConnection, clock_ns: Callable[[], int]
) -> Device:
    """Gradiometer of `config` at `connection`, with stamps from `clock_ns`; not opened yet."""
    scale = connection.tesla_per_count
    return open_framed(layout(config), connection, gradiometer(), scale, clock_ns)


def simulate_gradiometer(
    config: GradiometerConfig,
    connection: GradiometerConnection,
    signal: Callable[[float], Array] | None = None,
    seed: int = 0,
    clock: VirtualClock | None = None,
) -> FramedTwin:
    """Twin of a gradiometer that plays `signal`, or scenes of its own; not entered yet."""
    temperature_c = None
    if signal is None:
        signal, temperature_c = scenes(config, seed), temperature(config)
    return simulate_framed(
        layout(config),
        connection,
        gradiometer(),
        connection.tesla_per_count,
        signal,
        NOISE if config.noise is None else config.noise,
        seed,
        clock,
        temperature_c,
    )
