"""The magnet pad on an I2C bus or on a serial port, real or simulated."""

from __future__ import annotations

from dataclasses import dataclass

from tactile_ros.devices.connections import ChipConnection, ChipSensor
from tactile_ros.sensors.magnet_pad.config import layout
from tactile_ros.sensors.magnet_pad.nominal import NOISE
from tactile_ros.sensors.magnet_pad.signal import signal as own_signal


@dataclass(frozen=True)
class MagnetPadConnection(ChipConnection):
    """Two chips on one I2C bus, 0x0C and 0x0D, or a microcontroller that reads them."""


PAD = ChipSensor(layout, own_signal, NOISE)
