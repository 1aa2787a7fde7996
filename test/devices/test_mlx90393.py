# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""The chip's datasheet: conversion times, registers, steps, codes and what it cannot do."""

import errno

import numpy as np
import pytest

from reference.wires import Wires
from tactile_ros.devices.mlx90393 import (
    ChipPlace,
    ChipSettings,
    Decoder,
    Switches,
    conversion_time,
    refuse_conflicts,
    tesla_per_lsb,
)
from tactile_ros.devices.transport import I2cBus
from tactile_ros.errors import NotAcknowledged

# rows DIG_FILT 0..7, columns OSR 0..3 (ms), x, y and z
TABLE_MS = [
    [1.27, 1.84, 3.00, 5.30],
    [1.46, 2.23, 3.76, 6.84],
    [1.84, 3.00, 5.30, 9.91],
    [2.61, 4.53, 8.37, 16.05],
    [4.15, 7.60, 14.52, 28.34],
    [7.22, 13.75, 26.80, 52.92],
    [13.36, 26.04, 51.38, 102.07],
    [25.65, 50.61, 100.53, 200.37],
]


def test_conversion_times_are_the_datasheets() -> None:
    times = [[1e3 * conversion_time(osr, dig) for osr in range(4)] for dig in range(8)]
    np.testing.assert_allclose(times, TABLE_MS, rtol=0, atol=0.01)
    assert ChipSettings().conversion_s == pytest.approx(2.10e-3, abs=0.01e-3)
    assert ChipSettings(temperature=False).conversion_s == pytest.approx(1.84e-3, abs=0.01e-3)


@pytest.mark.parametrize(
    ('gain', 'resolution', 'hallconf', 'xy', 'z'),
    [
        (7, 0, 0xC, 0.1502e-6, 0.242e-6),  # '1x', the finest
        (0, 0, 0xC, 0.751e-6, 1.21e-6),  # '5x', the coarsest
        (7, 3, 0xC, 1.2016e-6, 1.936e-6),
        (1, 2, 0xC, 2.4032e-6, 3.872e-6),  # eFlesh
        (7, 0, 0x0, 0.1573e-6, 0.2534e-6),
    ],
)
def test_steps_and_ranges_are_the_datasheets(
    gain: int, resolution: int, hallconf: int, xy: float, z: float
) -> None:
    step = tesla_per_lsb(gain, (resolution,) * 3, hallconf)
    assert step == pytest.approx([xy, xy, z], rel=1e-3)
    full = ChipSettings(gain, (resolution,) * 3, hallconf=hallconf).full_scale
    assert full == pytest.approx(step * (16384 if resolution == 3 else 32768))


@pytest.mark.parametrize(
    ('resolution', 'code', 'counts'),
    [
        (0, 0x0000, 0), (0, 0x7FFF, 32767), (0, 0x8000, -32768), (1, 0xFFFE, -2), (2, 0x8000, 0),
        (2, 0xFFFF, 32767), (2, 0x0000, -32768), (3, 0x4000, 0), (3, 0x3FFF, -1),
        (3, 0x7FFF, 16383),
    ],
)  # fmt: skip
def test_decoder_turns_codes_into_fields(resolution: int, code: int, counts: int) -> None:
    settings = ChipSettings(gain=7, resolution=(resolution,) * 3)
    answer = bytes((0x03,)) + (46696).to_bytes(2, 'big') + code.to_bytes(2, 'big') * 3
    decoder = Decoder(settings, [46696])
    status, codes = decoder.words(answer)
    values, temperature_c = decoder.values(codes)
    assert status.tolist() == [3]
    assert values[0] == pytest.approx(counts * tesla_per_lsb(7, (resolution,) * 3), abs=1e-15)
    assert temperature_c.tolist() == [35.0]


FORBIDDEN = 'must not be .* at HALLCONF 0xC; received'


@pytest.mark.parametrize(
    ('change', 'sentence'),
    [
        ({'digital_filter': 0, 'oversampling': 0}, FORBIDDEN),
        ({'digital_filter': 0, 'oversampling': 1}, FORBIDDEN),
        ({'digital_filter': 1, 'oversampling': 0}, FORBIDDEN),
        ({'gain': 8}, 'gain of ChipSettings must be a whole number from 0 to 7; received 8'),
        ({'resolution': (0, 0, 4)}, 'resolution of ChipSettings must be finite and from 0 to 3'),
        ({'digital_filter': -1}, 'digital_filter of ChipSettings must be a whole number from 0'),
        ({'hallconf': 5}, 'hallconf of ChipSettings must be 0 or 12; received 5'),
    ],
)
def test_settings_refuse_what_the_chip_cannot_do(change: dict[str, int], sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        ChipSettings(**change)


def behind(mux: int, channel: int = 0) -> ChipPlace:
    return ChipPlace(0x0C, 0, mux, channel)


def test_settings_warn_about_fast_filters() -> None:
    with pytest.warns(UserWarning, match='digital_filter below 2'):
        ChipSettings(digital_filter=0, oversampling=2)


@pytest.mark.parametrize('other', [ChipPlace(0x0C), ChipPlace(0x70), behind(0x70, 1)])
def test_places_of_which_two_would_answer_are_refused(other: ChipPlace) -> None:
    with pytest.raises(ValueError, match='two would answer as'):
        refuse_conflicts([behind(0x70, 1), other])
    refuse_conflicts([ChipPlace(0x0C), ChipPlace(0x0C, 1)])


def test_switches_write_changes_and_what_failed_or_was_forgotten() -> None:
    wires = Wires()
    bus = I2cBus('wires', smbus=wires)
    bus.open()
    switches = Switches(bus, [behind(0x71), behind(0x70)])
    for mux, channel in ((0x70, 1), (0x70, 1), (0x71, 2), (0x71, 3)):
        switches.select(behind(mux, channel))
    switches.select(ChipPlace())
    assert wires.seen == [
        [(0x71, 0, b'\x00')], [(0x70, 0, b'\x02')], [(0x70, 0, b'\x00')], [(0x71, 0, b'\x04')],
        [(0x71, 0, b'\x08')],
    ]  # fmt: skip
    wires.failure = errno.EREMOTEIO
    with pytest.raises(NotAcknowledged, match='nothing answers at 0x71'):
        switches.select(behind(0x71, 2))
    wires.failure = 0
    switches.select(behind(0x71, 3))
    assert wires.seen[6:] == [[(0x71, 0, b'\x08')]]
    switches.forget()
    switches.select(behind(0x71, 3))
    assert wires.seen[7:] == [[(0x70, 0, b'\x00')], [(0x71, 0, b'\x08')]]


@pytest.mark.parametrize(
    'place',
    [(0x07,), (0x78,), (0x0C, -1), (0x0C, 0, 0x70), (0x0C, 0, 0x6F, 1), (0x0C, 0, 0x70, 8)],
)
def test_places_that_cannot_be_are_refused(place: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match='of ChipPlace must be'):
        ChipPlace(*place)
