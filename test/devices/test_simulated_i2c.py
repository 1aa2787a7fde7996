# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""The simulated chips, switches and bus: states, time and faults below the driver."""

import numpy as np
import pytest
from smbus2 import i2c_msg

from tactile_ros.devices.mlx90393 import ChipPlace
from tactile_ros.devices.simulated_i2c import SimulatedChip, SimulatedI2cBus
from tactile_ros.devices.timestamps import VirtualClock

BURST, SINGLE, ERROR, RESET = 0x80, 0x20, 0x10, 0x04
CONVERSION_NS = 2_102_000  # OSR 0, DIG_FILT 2, with temperature


class Bench:
    """A bus with chips that measure a constant, asked byte by byte."""

    def __init__(self, *places: ChipPlace, field: float = 0.0, noise: float = 0.0) -> None:
        self.clock = VirtualClock(10**9)
        self.field = field
        rng = np.random.default_rng(0)
        self.chips = {
            place: SimulatedChip(self.sample, rng, np.full(3, noise), tolerance=0.0)
            for place in places or (ChipPlace(),)
        }
        self.bus = SimulatedI2cBus(self.clock, self.chips)

    def sample(self, time_ns: int) -> tuple[np.ndarray, float]:
        return np.full(3, self.field), 25.0

    def ask(self, written: str, count: int, address: int = 0x0C) -> bytes:
        messages = [i2c_msg.write(address, bytes.fromhex(written))] if written else []
        messages += [i2c_msg.read(address, count)] if count else []
        self.bus.i2c_rdwr(*messages)
        return bytes(messages[-1]) if count else b''

    def configure(self, third: str = '00 08') -> None:
        """Past the reset, with register 2 as told."""
        self.ask('00', 1)
        self.ask(f'60 {third} 08', 1)


def test_simulated_bus_takes_time_for_bytes() -> None:
    bench = Bench(ChipPlace(0x0C, 0, 0x70, 0))
    for written, count, address, clocks in (('01', 0, 0x70, 20), ('3F', 1, 0x0C, 39)):
        begun_ns = bench.clock.now_ns()
        bench.ask(written, count, address)
        assert bench.clock.now_ns() - begun_ns == clocks * 2500
    begun_ns = bench.clock.now_ns()
    bench.ask('4F', 9)
    assert bench.clock.now_ns() - begun_ns == 111 * 2500
    assert bench.bus.busy_s == pytest.approx(170 / 400e3)


def test_simulated_chip_has_data_after_a_conversion_and_once() -> None:
    bench = Bench()
    bench.configure()
    assert bench.ask('3F', 1) == bytes((SINGLE,))
    assert bench.ask('4F', 9)[0] == SINGLE | ERROR | 3
    bench.clock.sleep((CONVERSION_NS - 500_000) * 1e-9)
    assert bench.ask('4F', 9)[0] & ERROR
    bench.clock.sleep(300e-6)
    assert bench.ask('4F', 9)[0] == 3
    assert bench.ask('4F', 9)[0] == ERROR | 3


def test_simulated_chip_refuses_registers_in_burst_mode() -> None:
    bench = Bench()
    bench.configure()
    assert bench.ask('1F', 1) == bytes((BURST,))
    for _ in range(3):
        bench.clock.sleep(CONVERSION_NS * 1e-9)
        assert bench.ask('4F', 9)[0] == BURST | 3
        assert bench.ask('4F', 9)[0] == BURST | ERROR | 3
    for refused in ('50 00', '60 00 00 00', '3F', 'E0', 'D0'):
        assert bench.ask(refused, 1)[0] & (BURST | ERROR) == BURST | ERROR
    assert bench.ask('80', 1) == b'\x00'
    assert bench.ask('50 00', 3)[0] == 0


def test_simulated_bus_hides_channels_behind_switches() -> None:
    places = [ChipPlace(0x0C, 0, 0x70, 1), ChipPlace(0x0C, 0, 0x70, 2), ChipPlace(0x0D)]
    bench = Bench(*places)
    with pytest.raises(OSError, match='Remote I/O error'):
        bench.ask('00', 1)
    assert bench.ask('00', 1, 0x0D) == bytes((RESET,))
    bench.ask('02', 0, 0x70)
    assert bench.ask('', 1, 0x70) == b'\x02'
    assert bench.ask('00', 1) == bytes((RESET,))
    assert bench.ask('00', 1) == b'\x00'
    bench.ask('04', 0, 0x70)
    assert bench.ask('00', 1) == bytes((RESET,))  # the other one
    bench.ask('06', 0, 0x70)
    bench.ask('00', 1)
    bench.bus.power_down(bench.clock.now_ns())
    assert bench.ask('', 1, 0x70) == b'\x00'
