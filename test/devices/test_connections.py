# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Connections: what they let in, where they find chips, and what cannot be carried."""

import dataclasses
import time

import numpy as np
import pytest

from tactile_ros.devices.chip_array import ChipArray
from tactile_ros.devices.connections import ChipConnection
from tactile_ros.devices.mlx90393 import ChipPlace
from tactile_ros.devices.serial_board import FramedBoard
from tactile_ros.types import Layout

FOUR = Layout(np.zeros((4, 3)), ('Bx', 'By', 'Bz'), 'T', rate_hz=50.0)
ADDRESSES = (0x0C, 0x0D, 0x0E, 0x0F)


def test_chip_connection_places_chips_behind_switches() -> None:
    connection = ChipConnection(
        addresses=ADDRESSES, mux_addresses=(0x70, 0x70, 0, 0x71), mux_channels=(0, 1, 0, 7)
    )
    assert connection.places(4) == [
        ChipPlace(0x0C, 0, 0x70, 0),
        ChipPlace(0x0D, 0, 0x70, 1),
        ChipPlace(0x0E, 0),
        ChipPlace(0x0F, 0, 0x71, 7),
    ]


@pytest.mark.parametrize(
    ('wrong', 'words'),
    [
        ({'addresses': (12,)}, 'addresses must have one number for each of 4 chips; received 1'),
        ({'bus_of_chip': (0, 0)}, 'bus_of_chip must have one number for each of 4 chips'),
        ({'bus_of_chip': (1,)}, 'bus_of_chip must be 0 to 0, a number in buses /dev/i2c-1'),
        ({'mux_addresses': (0x20,)}, 'mux and channel of ChipPlace must be 0x70 to 0x77'),
        ({'addresses': (12, 12, 13, 14)}, 'must differ; two would answer'),
    ],
)
def test_chip_connection_refuses_places(wrong: dict[str, object], words: str) -> None:
    connection = dataclasses.replace(ChipConnection(addresses=ADDRESSES), **wrong)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match=words):
        connection.open(FOUR, time.monotonic_ns)


@pytest.mark.parametrize(
    ('wrong', 'words'),
    [
        ({'transport': 'spi'}, 'transport of ChipConnection must be one of i2c, serial; receive'),
        ({'mode': 'slow'}, 'mode of ChipConnection must be one of single, burst'),
        ({'baud': 300}, 'baud of ChipConnection must be a whole number from 1200'),
    ],
)
def test_chip_connection_refuses_values(wrong: dict[str, object], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        ChipConnection(**wrong)  # type: ignore[arg-type]


def test_chip_connection_chooses_the_driver_by_transport() -> None:
    connection = ChipConnection(addresses=ADDRESSES)
    assert isinstance(connection.open(FOUR, time.monotonic_ns), ChipArray)
    serial = dataclasses.replace(connection, transport='serial')
    assert isinstance(serial.open(FOUR, time.monotonic_ns), FramedBoard)
