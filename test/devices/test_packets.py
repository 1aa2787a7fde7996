"""The board's wire format, from its description byte by byte."""

from __future__ import annotations

import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from tactile_ros.devices.reskin_protocol import (
    board_size,
    encode,
    foreign,
    frame_bytes,
    plausible,
    readings,
    words,
)

fields = st.floats(-149_000, 149_000, width=32).filter(lambda x: x == 0 or abs(x) >= 1e-6)
temperatures = st.floats(-39.0, 124.0, width=32).filter(lambda x: x == 0 or abs(x) >= 1e-6)


def rows(data: bytes, chips: int) -> np.ndarray:
    return np.frombuffer(data, np.uint8).reshape(-1, frame_bytes(chips))


def frame(*numbers: float) -> bytes:
    return struct.pack(f'<{len(numbers)}f', *numbers) + b'\r\n'


def test_one_chip_is_four_little_endian_floats_then_crlf() -> None:
    # 21.5 = 0x41AC0000, 1 = 0x3F800000, -2 = 0xC0000000, 0.5 = 0x3F000000
    wire = bytes.fromhex('0000ac41 0000803f 000000c0 0000003f 0d0a')
    assert encode([[1e-6, -2e-6, 0.5e-6]], 21.5) == wire
    values, temperature_c = readings(words(rows(wire, 1)))
    assert values.tolist() == [[[1e-6, -2e-6, 0.5e-6]]]
    assert temperature_c.tolist() == [[21.5]]


def test_a_frame_of_five_chips_has_82_bytes() -> None:
    assert len(encode(np.zeros((5, 3)))) == frame_bytes(5) == 82
    assert len(encode(np.zeros((7, 20, 3)))) == 7 * frame_bytes(20) == 7 * 322


@pytest.mark.parametrize('chips', [0, -1, 65])
def test_impossible_boards_are_refused(chips: int) -> None:
    with pytest.raises(ValueError, match='chips must be 1 to 64'):
        frame_bytes(chips)


def test_values_of_another_shape_are_refused() -> None:
    with pytest.raises(
        ValueError, match=r'must have shape \(t, 3\) or \(s, t, 3\); received \(3,\)'
    ):
        encode([1.0, 2.0, 3.0])


@given(
    arrays(np.float32, (3, 4, 3), elements=fields),
    arrays(np.float32, (3, 4), elements=temperatures),
)
def test_what_was_encoded_is_decoded(b: np.ndarray, t: np.ndarray) -> None:
    wire = encode(b.astype(np.float64) / 1e6, t)
    patterns = words(rows(wire, 4))
    possible, natural = plausible(patterns)
    values, temperature_c = readings(patterns)
    assert possible.all()
    assert natural.all()
    np.testing.assert_array_equal(temperature_c, t)
    np.testing.assert_allclose(values, b.astype(np.float64) / 1e6, rtol=1e-7)
    assert encode(values, temperature_c) == wire


@pytest.mark.parametrize('place', range(4))
@pytest.mark.parametrize(
    'number', [np.nan, np.inf, -np.inf, 150_000.0, -150_000.0, 125.0, -40.0, 3e38]
)
def test_plausibility_is_that_of_the_chip(place: int, number: float) -> None:
    numbers = [25.0, 10.0, -20.0, 30.0]
    numbers[place] = number
    fits = -40 < number < 125 if place == 0 else abs(number) < 150_000
    possible, natural = plausible(words(rows(frame(*numbers), 1)))
    assert bool(possible[0, 0]) is bool(natural[0, 0]) is fits


def test_signalling_nan_is_implausible_and_silent() -> None:
    wire = struct.pack('<f', 25.0) + b'\x01\x00\xa0\x7f' + struct.pack('<2f', 1, 2) + b'\r\n'
    patterns = words(rows(wire, 1))
    possible, _ = plausible(patterns)
    assert not possible.any()
    values, temperature_c = readings(patterns, ~possible)
    assert np.isnan(values).all()
    assert np.isnan(temperature_c).all()


def test_pieces_of_a_terminator_are_no_reading() -> None:
    # CR LF as the upper half of a float32 is 7e-33
    wire = struct.pack('<f', 25.0) + b'\x12\x34\r\n' + struct.pack('<2f', 1, 2) + b'\r\n'
    assert not plausible(words(rows(wire, 1)))[0].any()


def test_tiny_fields_are_possible_but_not_natural() -> None:
    possible, natural = plausible(words(rows(frame(25.0, 1e-9, 2.0, 0.0), 1)))
    assert possible.all()
    assert not natural.any()


def test_the_grid_of_the_chips_shows_flipped_bits() -> None:
    quantum = np.array([2.4e-6, 2.4e-6, 3.872e-6])
    steps = np.array([[[276, -346, 1975], [32767, -32768, -1], [0, 1, 2]]])
    wire = encode(steps * quantum)
    assert plausible(words(rows(wire, 3)), quantum)[1].all()
    flipped = bytearray(wire)
    flipped[6] ^= 0x01
    assert plausible(words(rows(bytes(flipped), 3)))[1].all()
    assert plausible(words(rows(bytes(flipped), 3)), quantum)[0].tolist() == [[False, True, True]]


def test_text_is_recognised_and_refused_with_the_reason() -> None:
    anyskin = b'25.10,1.00,2.00,3.0025.20,1.50,2.50,3.50\r\n' * 3
    reskin = b'1.00\t2.00\t3.00\t25.10\t1.50\t2.50\t3.50\t25.20\t\r\n' * 3
    assert 'fuse' in str(foreign(anyskin, 5))
    assert 'tabs' in str(foreign(reskin, 5))


@pytest.mark.parametrize('chips', [1, 4, 10, 20])
def test_a_board_of_another_size_is_named(chips: int) -> None:
    rng = np.random.default_rng(chips)
    stream = encode(rng.normal(0, 1e-3, (6, chips, 3)))[7:]
    assert board_size(stream) == chips
    assert f'frames of {chips} chips, not of 5' in str(foreign(stream, 5))
    assert foreign(stream, chips) is None


def test_noise_is_nothing_known() -> None:
    noise = np.random.default_rng(0).bytes(5000)
    assert foreign(noise, 5) is None
    assert foreign(b'', 5) is None
