"""The ReSkin board's wire format byte by byte, and frames found in damaged streams."""

from __future__ import annotations

import itertools
import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from reference.hidden_damage import hidden_damage
from tactile_ros.devices.reskin_protocol import (
    Decoded,
    ReskinDecoder,
    board_size,
    encode,
    foreign,
    frame_bytes,
    plausible,
    readings,
    words,
)
from tactile_ros.devices.simulated_serial import damage

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


seeds = st.integers(0, 2**32 - 1)
QUANTUM = np.array([2.4e-6, 2.4e-6, 3.872e-6])
LENGTH_DAMAGES = ('dropped', 'doubled', 'inserted', 'truncated')


def sent(rng: np.random.Generator, count: int, chips: int) -> list[bytes]:
    steps = rng.integers(-4000, 4000, (count, chips, 3))
    celsius = 25 + rng.integers(-50, 50, (count, chips)) / 45.2
    return [encode(s * 2.4e-6, c) for s, c in zip(steps, celsius, strict=True)]


def got(decoded: Decoded) -> list[bytes]:
    """Delivered frames as they were sent."""
    return [encode(b, t) for b, t in zip(decoded.values, decoded.temperature_c, strict=True)]


def decode(stream: bytes, chips: int) -> list[bytes]:
    return got(ReskinDecoder(chips).feed(stream))


def is_subsequence(part: list[bytes], whole: list[bytes]) -> bool:
    rest = iter(whole)
    return all(frame in rest for frame in part)


@pytest.mark.parametrize('chips', [1, 5, 20])
@pytest.mark.parametrize('head', [0, 1, 17])
def test_three_frames_lock_on_and_are_delivered(chips: int, head: int) -> None:
    frames = sent(np.random.default_rng(chips), 4, chips)
    decoder = ReskinDecoder(chips)
    tail_of_first = frames[0][-head:] if head else b''
    assert got(decoder.feed(tail_of_first + frames[1] + frames[2])) == []
    assert not decoder.locked
    assert got(decoder.feed(frames[3])) == frames[1:]
    assert decoder.locked
    assert decoder.counts.dropped == 0
    assert decoder.counts.lost_bytes == head
    assert decoder.pending == b''


@pytest.mark.parametrize('place', [1, 2])
@pytest.mark.parametrize('kind', ['dropped', 'inserted', 'truncated'])
def test_damage_before_the_lock_costs_no_good_frame(place: int, kind: str) -> None:
    frames = sent(np.random.default_rng(place), 6, 5)
    hurt = damage(frames[place], kind, np.random.default_rng(0))
    stream = b''.join([*frames[:place], hurt, *frames[place + 1 :]])
    delivered = decode(stream, 5)
    assert is_subsequence(delivered, frames)
    assert len(delivered) >= 4 if kind == 'truncated' else len(delivered) == 5


def test_two_frames_are_not_enough_and_noise_never_is() -> None:
    rng = np.random.default_rng(3)
    assert decode(b''.join(sent(rng, 2, 5)), 5) == []
    assert decode(b''.join(sent(rng, 2, 5)) + rng.bytes(82), 5) == []
    assert decode(rng.bytes(200_000), 5) == []
    assert decode(b'\r\n' * 50_000, 5) == []
    assert decode(bytes(50_000), 5) == []
    # as float32, text of nines is 1.8e-4
    assert decode((b'9' * 80 + b'\r\n') * 50, 5) == []


@settings(max_examples=40)
@given(seeds, st.lists(st.integers(0, 82 * 12), max_size=8))
def test_cuts_do_not_matter(seed: int, cuts: list[int]) -> None:
    rng = np.random.default_rng(seed)
    frames = sent(rng, 12, 5)
    for i in rng.choice(12, 3, replace=False):
        frames[i] = damage(frames[i], rng.choice([*LENGTH_DAMAGES, 'garbage', 'flipped']), rng)
    stream = b''.join(frames)
    whole, parts, single = ReskinDecoder(5), ReskinDecoder(5), ReskinDecoder(5)
    wanted = got(whole.feed(stream))
    edges = [0, *sorted(cuts), len(stream)]
    pieces = [stream[a:b] for a, b in itertools.pairwise(edges)]
    assert [f for piece in pieces for f in got(parts.feed(piece))] == wanted
    assert [f for b in stream for f in got(single.feed(bytes([b])))] == wanted
    assert parts.counts == whole.counts == single.counts


@settings(max_examples=300)
@given(seeds, st.sampled_from([1, 2, 5]), st.sampled_from(LENGTH_DAMAGES))
def test_damage_of_the_length_is_seen_and_costs_one_good_frame_at_most(
    seed: int, chips: int, kind: str
) -> None:
    rng = np.random.default_rng(seed)
    frames = sent(rng, 20, chips)
    hurt = list(frames)
    places = [3 + int(rng.integers(3)), 10 + int(rng.integers(6)), 19]
    for place in places:
        hurt[place] = damage(frames[place], kind, rng)
    decoder = ReskinDecoder(chips)
    delivered = got(decoder.feed(b''.join(hurt)))
    # a doubled first byte or a lost last one may leave the frame itself whole
    assert is_subsequence(delivered, frames)
    good = [frame for i, frame in enumerate(frames) if i not in places]
    assert sum(frame not in delivered for frame in good) <= len(places) - 1
    assert decoder.counts.frames == len(delivered)


@settings(max_examples=300)
@given(seeds, st.integers(0, 400))
def test_garbage_between_frames_costs_one_good_frame_at_most(seed: int, length: int) -> None:
    rng = np.random.default_rng(seed)
    frames = sent(rng, 12, 5)
    stream = b''.join(frames[:6]) + rng.bytes(length) + b''.join(frames[6:])
    delivered = decode(stream, 5)
    assert is_subsequence(delivered, frames)
    assert len(delivered) >= 11


@settings(max_examples=300)
@given(seeds, st.integers(0, 400))
def test_garbage_before_the_first_frame(seed: int, length: int) -> None:
    rng = np.random.default_rng(seed)
    frames = sent(rng, 5, 5)
    delivered = decode(rng.bytes(length) + b''.join(frames), 5)
    assert is_subsequence(delivered, frames)
    assert len(delivered) >= 4


@given(st.binary(max_size=2000), seeds, st.sampled_from([1, 3]))
def test_anything_may_come(noise: bytes, seed: int, chips: int) -> None:
    frames = sent(np.random.default_rng(seed), 5, chips)
    decoder = ReskinDecoder(chips)
    decoder.feed(noise)
    assert len(decoder.pending) <= 8 * frame_bytes(chips) + 2
    assert set(frames[1:]) <= set(got(decoder.feed(b''.join(frames))))


@pytest.mark.parametrize('chips', [1, 5])
@pytest.mark.parametrize('place', [(0, 1), (1, 2), (0, 0), (2, 3)])
def test_crlf_inside_steady_floats_does_not_confuse(chips: int, place: tuple[int, int]) -> None:
    """A held reading repeats its CR LF at the frame's own period."""
    word = bytearray(struct.pack('<f', 35.3))
    word[place[0] : place[1] + 1] = b'\r\n'[: place[1] - place[0] + 1]
    rng = np.random.default_rng(5)
    body = bytearray(sent(rng, 1, chips)[0])
    spots = range(4, 16 * chips, 4) if place != (2, 3) else [8]
    for spot in spots:
        frame = bytes(body[:spot] + word + body[spot + 4 :])
        assert len(frame) == frame_bytes(chips)
        for head in range(0, len(frame), 3):
            decoder = ReskinDecoder(chips)
            delivered = got(decoder.feed(frame[head:] + frame * 8))
            if place == (2, 3):  # 7e-33: no reading of a chip
                assert all(len(f) == len(frame) for f in delivered)
                continue
            assert delivered == [frame] * (9 if head == 0 else 8), (spot, head)
            hurt = frame[:head] + frame[head + 1 :]
            after = got(decoder.feed(hurt + frame * 3))
            assert set(after) <= {frame}
            assert len(after) >= 2


def test_one_flipped_bit_of_the_terminator_costs_its_frame_alone() -> None:
    frames = sent(np.random.default_rng(8), 8, 5)
    for byte, bit in [(80, 1), (81, 16)]:
        hurt = bytearray(frames[4])
        hurt[byte] ^= bit
        decoder = ReskinDecoder(5)
        stream = b''.join([*frames[:4], bytes(hurt), *frames[5:]])
        decoded = decoder.feed(stream)
        assert got(decoded) == frames[:4] + frames[5:]
        assert decoded.lost == [0, 0, 0, 0, 1, 0, 0]
        assert (decoder.counts.framing_errors, decoder.counts.implausible) == (1, 0)
        assert (decoder.counts.dropped, decoder.counts.lost_bytes) == (1, 82)


@pytest.mark.parametrize('number', [np.nan, np.inf, 2e5])
def test_an_implausible_field_condemns_its_frame_alone(number: float) -> None:
    frames = sent(np.random.default_rng(9), 8, 5)
    hurt = bytearray(frames[4])
    hurt[20:24] = struct.pack('<f', number)
    decoder = ReskinDecoder(5)
    assert got(decoder.feed(b''.join([*frames[:4], bytes(hurt), *frames[5:]]))) == (
        frames[:4] + frames[5:]
    )
    assert (decoder.counts.framing_errors, decoder.counts.implausible) == (0, 1)
    assert decoder.counts.dropped == 1


def with_dead_chip(frame: bytes, chip: int) -> bytes:
    return frame[: 16 * chip] + struct.pack('<4f', 451.8, np.nan, 0, 0) + frame[16 * chip + 16 :]


@pytest.mark.parametrize('alive', [0, 5])
def test_a_chip_that_stays_implausible_is_marked_and_the_others_serve(alive: int) -> None:
    frames = sent(np.random.default_rng(10), 12, 5)
    stream = [*frames[:alive], *(with_dead_chip(f, 2) for f in frames[alive:])]
    decoded = ReskinDecoder(5).feed(b''.join(stream))
    assert len(decoded.lost) == 12
    assert sum(decoded.lost) == 0
    assert np.isnan(decoded.values[alive:, 2]).all()
    assert decoded.error[alive:].tolist() == [[False, False, True, False, False]] * (12 - alive)
    assert not decoded.error[:alive].any()
    whole = ReskinDecoder(5).feed(b''.join(frames))
    others = [0, 1, 3, 4]
    np.testing.assert_array_equal(decoded.values[:, others], whole.values[:, others])


def test_a_chip_that_recovers_is_used_again() -> None:
    frames = sent(np.random.default_rng(11), 12, 5)
    stream = [*(with_dead_chip(f, 0) for f in frames[:6]), *frames[6:]]
    decoded = ReskinDecoder(5).feed(b''.join(stream))
    assert decoded.error[:, 0].tolist() == [True] * 6 + [False] * 6
    assert got(decoded)[6:] == frames[6:]


def test_a_board_without_a_majority_of_chips_is_not_believed() -> None:
    frames = sent(np.random.default_rng(12), 20, 2)
    assert decode(b''.join(with_dead_chip(f, 0) for f in frames), 2) == []


def test_tiny_fields_are_delivered_too() -> None:
    frames = [struct.pack('<4f', 25.0, 1e-9 * i, 1e-38, 5.0 + i) + b'\r\n' for i in range(1, 12)]
    decoded = ReskinDecoder(1).feed(b''.join(frames))
    assert len(decoded.lost) == 11
    np.testing.assert_allclose(decoded.values[:, 0, 2], 1e-6 * (5.0 + np.arange(1, 12)), rtol=1e-6)


def test_reset_forgets_the_stream_and_keeps_the_counts() -> None:
    frames = sent(np.random.default_rng(13), 6, 5)
    decoder = ReskinDecoder(5)
    decoder.feed(b''.join(frames[:3]) + frames[3][:40])
    decoder.reset()
    assert got(decoder.feed(frames[4] + frames[5])) == []
    assert decoder.counts.frames == 3
    assert decoder.counts.lost_bytes == 40


def test_a_flood_is_decoded_in_one_go_and_nothing_piles_up() -> None:
    frames = sent(np.random.default_rng(14), 200, 20)
    decoder = ReskinDecoder(20)
    assert got(decoder.feed(b''.join(frames) + frames[0][:100])) == frames
    assert len(decoder.pending) == 100


def test_damage_of_the_length_never_passes() -> None:
    rows = np.random.default_rng(0).integers(-4000, 4000, (200, 5, 3)) * QUANTUM
    for kind in LENGTH_DAMAGES:
        share = hidden_damage(rows, kind, seed=2, trials=150)
        assert share.passed == 0
        assert share.good_lost <= 1


def test_most_flipped_bits_pass_and_the_grid_shows_half_of_them() -> None:
    rows = np.random.default_rng(0).integers(-4000, 4000, (200, 5, 3)) * QUANTUM
    plain = hidden_damage(rows, 'flipped', seed=3, trials=300)
    gridded = hidden_damage(rows, 'flipped', seed=3, trials=300, quantum=QUANTUM)
    assert 0.8 < plain.passed < 0.95
    assert plain.good_lost == gridded.good_lost == 0
    assert gridded.misled < 0.6 * plain.misled
