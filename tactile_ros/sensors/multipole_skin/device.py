"""The multipole skin on I2C buses or on a serial port, real or simulated."""

from __future__ import annotations

from dataclasses import dataclass

from tactile_ros.devices.connections import ChipConnection, ChipSensor
from tactile_ros.sensors.multipole_skin.config import layout
from tactile_ros.sensors.multipole_skin.signal import NOISE
from tactile_ros.sensors.multipole_skin.signal import signal as own_signal
from tactile_ros.types.config_fields import whole, whole_numbers

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


SKIN = ChipSensor(layout, own_signal, NOISE)
