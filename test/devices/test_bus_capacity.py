"""Rates that I2C buses carry: by arithmetic as on the simulated bus, and refused beyond."""

from __future__ import annotations

import dataclasses
import time

import numpy as np
import pytest

from tactile_ros.devices.chip_array import (
    Mode,
    carried_hz,
    check_bus_capacity,
    exchange_bits,
    switch_bits,
)
from tactile_ros.devices.connections import ChipConnection, open_chips, simulate_chips
from tactile_ros.devices.mlx90393 import ChipPlace, ChipSettings, clusters
from tactile_ros.devices.simulated_i2c import ChipArrayTwin
from tactile_ros.devices.timestamps import VirtualClock
from tactile_ros.types import Layout

DIRECT = [ChipPlace(0x0C + i) for i in range(20)]
TWO_BUSES = [ChipPlace(0x0C + i % 10, i // 10) for i in range(20)]
TWO_SWITCHES = [ChipPlace(0x0C, 0, 0x70 + i % 2, i // 2) for i in range(6)]


def layout(chips: int, rate_hz: float) -> Layout:
    return Layout(np.zeros((chips, 3)), ('Bx', 'By', 'Bz'), 'T', rate_hz=rate_hz)


def test_clocks_of_exchanges() -> None:
    assert exchange_bits(1) == 1 + 1 + 9 + 9
    assert exchange_bits(1, 9) == 20 + 1 + 9 + 81


def test_switches_are_written_where_the_channel_changes() -> None:
    assert switch_bits(clusters(2, 3)) == [20, 0, 0, 20, 0, 0]
    assert switch_bits(clusters(1)) == [0] * 4
    assert switch_bits(DIRECT) == [0] * 20
    # to change the switch is to close the other one first
    assert switch_bits(TWO_SWITCHES) == [40] * 6


@pytest.mark.parametrize('places', [DIRECT, clusters(), TWO_BUSES, TWO_SWITCHES, DIRECT[:2]])
@pytest.mark.parametrize('mode', ['single', 'burst'])
@pytest.mark.parametrize('hertz', [100e3, 400e3])
def test_arithmetic_is_what_the_simulated_bus_does(
    places: list[ChipPlace], mode: Mode, hertz: float
) -> None:
    clock = VirtualClock()
    twin = ChipArrayTwin(
        places, layout(len(places), float('nan')), lambda t: np.zeros((len(places), 3)), mode=mode,
        hertz=hertz, tolerance=0.0, clock=clock,
    )  # fmt: skip
    with twin, twin.device(clock.now_ns) as array:
        array.read(1.0)
        begun_ns = clock.now_ns()
        for _ in range(50):
            array.read(1.0)
        rate = 50e9 / (clock.now_ns() - begun_ns)
    carried = carried_hz(places, ChipSettings(), mode == 'burst', hertz)
    # the driver waits a twentieth longer than the conversion
    assert 0.95 * carried <= rate <= 1.0001 * carried


def test_what_buses_cannot_carry_is_refused_with_both_rates_named() -> None:
    connection = ChipConnection(
        addresses=(12, 13, 14, 15) * 5, mux_addresses=(0x70,),
        mux_channels=tuple(i // 4 for i in range(20)),
    )  # fmt: skip
    carried = carried_hz(connection.places(20), connection.settings, False, 400e3)
    assert carried == pytest.approx(125, abs=1)
    open_chips(layout(20, 0.999 * carried), connection, time.monotonic_ns)
    why = (
        r'20 chips, 20 of them behind switches at 200 Hz must fit their I2C bus: in mode single a '
        rf'bus of 400 kHz and conversions of 2\.1 ms carry {carried:.4g} Hz; lower the rate, .* '
        r"mode 'burst', or raise bus_clock"
    )
    with pytest.raises(ValueError, match=why):
        open_chips(layout(20, 200.0), connection, time.monotonic_ns)
    open_chips(layout(20, 170.0), dataclasses.replace(connection, mode='burst'), time.monotonic_ns)
    open_chips(layout(20, 200.0), dataclasses.replace(connection, bus_clock=0), time.monotonic_ns)
    open_chips(layout(20, float('nan')), connection, time.monotonic_ns)


def test_a_slow_bus_and_a_long_conversion_are_refused() -> None:
    slow = ChipConnection(bus_clock=100_000, addresses=(12, 13, 14, 15))
    with pytest.raises(ValueError, match=r'4 chips at 200 Hz .* a bus of 100 kHz .* carry 1'):
        open_chips(layout(4, 200.0), slow, time.monotonic_ns)
    long = ChipConnection(digital_filter=7, oversampling=3, mode='burst')
    with pytest.raises(ValueError, match=r'of 201 ms carry 4.984 Hz; lower the rate, sho'):
        open_chips(layout(2, 100.0), long, time.monotonic_ns)


def test_a_twin_refuses_what_its_driver_refuses() -> None:
    clock = VirtualClock()
    connection = ChipConnection(bus_clock=10_000)
    twin = simulate_chips(layout(2, 100.0), connection, lambda t: np.zeros((2, 3)), 0.0, 0, clock)
    with twin, pytest.raises(ValueError, match='a bus of 10 kHz'):
        twin.device(clock.now_ns)


def test_unknown_rates_pass() -> None:
    check_bus_capacity(DIRECT, ChipSettings(), False, float('nan'), 400e3)
