# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""An I2C bus without chips, and places of chips behind a switch."""

import ctypes

from smbus2 import i2c_msg

from tactile_ros.devices.mlx90393 import ChipPlace


def clusters(count: int = 5) -> list[ChipPlace]:
    """Places of clusters of four chips behind the channels of one switch."""
    return [ChipPlace(a, 0, 0x70, i) for i in range(count) for a in range(0x0C, 0x10)]


class Wires:
    """Stands in for smbus2.SMBus: fails as told, or answers with counted bytes."""

    def __init__(self, failure: int = 0) -> None:
        self.failure = failure
        self.seen: list[list[tuple[int, int, bytes]]] = []
        self.closed = 0

    def i2c_rdwr(self, *messages: i2c_msg) -> None:
        self.seen.append([(m.addr, m.flags, bytes(m)) for m in messages])
        if self.failure:
            raise OSError(self.failure, 'told to fail')
        for message in messages:
            if message.flags & 1:
                ctypes.memmove(message.buf, bytes(range(message.len)), message.len)

    def close(self) -> None:
        self.closed += 1
