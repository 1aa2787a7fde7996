# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""The ReSkin board's wire format byte by byte, and frames found in damaged streams."""

import itertools
import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tactile_ros.devices.reskin_protocol import (
    Decoded,
    ReskinDecoder,
    encode,
    frame_bytes,
    plausible,
    readings,
    words,
)
from tactile_ros.devices.simulated_serial import damage

seeds = st.integers(0, 2**32 - 1)
QUANTUM = np.array([2.4e-6, 2.4e-6, 3.872e-6])
LENGTH_DAMAGES = ('dropped', 'doubled', 'inserted', 'truncated')


def patterns_of(data: bytes, chips: int) -> np.ndarray:
    return words(np.frombuffer(data, np.uint8).reshape(-1, frame_bytes(chips)))


def test_encode_writes_little_endian_floats_then_crlf() -> None:
    # 21.5 = 0x41AC0000, 1 = 0x3F800000, -2 = 0xC0000000, 0.5 = 0x3F000000
    wire = bytes.fromhex('0000ac41 0000803f 000000c0 0000003f 0d0a')
    assert encode([[1e-6, -2e-6, 0.5e-6]], 21.5) == wire
    values, temperature_c = readings(patterns_of(wire, 1))
    assert values.tolist() == [[[1e-6, -2e-6, 0.5e-6]]]
    assert temperature_c.tolist() == [[21.5]]
    assert len(encode(np.zeros((5, 3)))) == frame_bytes(5) == 82
    assert len(encode(np.zeros((7, 20, 3)))) == 7 * frame_bytes(20) == 7 * 322


def test_wrong_shapes_and_counts_are_refused() -> None:
    for chips in (0, -1, 65):
        with pytest.raises(ValueError, match='chips must be 1 to 64'):
            frame_bytes(chips)
    why = r'must have shape \(t, 3\) or \(s, t, 3\); received \(3,\)'
    with pytest.raises(ValueError, match=why):
        encode([1.0, 2.0, 3.0])


CRLF_AS_FLOAT = struct.unpack('<f', b'\x12\x34\r\n')[0]  # 7e-33: pieces of a terminator


@pytest.mark.parametrize('place', range(4))
@pytest.mark.parametrize(
    'number',
    [np.nan, np.inf, -np.inf, 150_000.0, -150_000.0, 125.0, -40.0, 3e38, 1e-9, CRLF_AS_FLOAT],
)
def test_plausibility_is_that_of_the_chip(place: int, number: float) -> None:
    numbers = [25.0, 10.0, -20.0, 30.0]
    numbers[place] = number
    fits = -40 < number < 125 if place == 0 else abs(number) < 150_000
    wire = struct.pack('<4f', *numbers) + b'\r\n'
    assert bool(plausible(patterns_of(wire, 1))[0, 0]) is (fits and abs(number) > 1e-6)


def test_plausibility_on_the_grid_shows_flipped_bits() -> None:
    steps = np.array([[[276, -346, 1975], [32767, -32768, -1], [0, 1, 2]]])
    wire = encode(steps * QUANTUM)
    assert plausible(patterns_of(wire, 3), QUANTUM).all()
    flipped = bytearray(wire)
    flipped[6] ^= 0x01
    patterns = patterns_of(bytes(flipped), 3)
    assert plausible(patterns).all()
    assert plausible(patterns, QUANTUM).tolist() == [[False, True, True]]


def sent(seed: int | np.random.Generator, count: int, chips: int = 5) -> list[bytes]:
    rng = np.random.default_rng(seed)
    steps = rng.integers(-4000, 4000, (count, chips, 3))
    celsius = 25 + rng.integers(-50, 50, (count, chips)) / 45.2
    return [encode(s * 2.4e-6, c) for s, c in zip(steps, celsius, strict=True)]


def got(decoded: Decoded) -> list[bytes]:
    """Delivered frames as they were sent."""
    return [encode(b, t) for b, t in zip(decoded.values, decoded.temperature_c, strict=True)]


def decode(stream: bytes, chips: int = 5) -> list[bytes]:
    return got(ReskinDecoder(chips).feed(stream))


@pytest.mark.parametrize('chips', [1, 5, 20])
@pytest.mark.parametrize('head', [0, 1, 17])
def test_decoder_locks_on_at_three_frames_and_delivers_them(chips: int, head: int) -> None:
    frames = sent(chips, 4, chips)
    decoder = ReskinDecoder(chips)
    tail_of_first = frames[0][-head:] if head else b''
    assert got(decoder.feed(tail_of_first + frames[1] + frames[2])) == []
    assert not decoder.locked
    assert got(decoder.feed(frames[3])) == frames[1:]
    assert decoder.locked
    assert (decoder.counts.dropped, decoder.counts.lost_bytes, decoder.pending) == (0, head, b'')


@pytest.mark.parametrize(
    'stream',
    [
        b''.join(sent(3, 2)),
        b''.join(sent(3, 2)) + np.random.default_rng(3).bytes(82),
        np.random.default_rng(3).bytes(200_000),
        b'\r\n' * 50_000,
        bytes(50_000),
        (b'9' * 80 + b'\r\n') * 50,  # as float32, text of nines is 1.8e-4
    ],
    ids=['two frames', 'and noise', 'noise', 'line ends', 'zeros', 'text'],
)
def test_decoder_finds_no_frame_in_less_or_other(stream: bytes) -> None:
    assert decode(stream) == []


@settings(max_examples=15)
@given(seeds, st.lists(st.integers(0, 82 * 12), max_size=8))
def test_decoder_gives_the_same_however_bytes_are_cut(seed: int, cuts: list[int]) -> None:
    rng = np.random.default_rng(seed)
    frames = sent(rng, 12)
    for i in rng.choice(12, 3, replace=False):
        frames[i] = damage(frames[i], rng.choice([*LENGTH_DAMAGES, 'garbage', 'flipped']), rng)
    stream = b''.join(frames)
    whole, parts, single = ReskinDecoder(5), ReskinDecoder(5), ReskinDecoder(5)
    wanted = got(whole.feed(stream))
    pieces = [stream[a:b] for a, b in itertools.pairwise([0, *sorted(cuts), len(stream)])]
    assert [f for piece in pieces for f in got(parts.feed(piece))] == wanted
    assert [f for b in stream for f in got(single.feed(bytes([b])))] == wanted
    assert parts.counts == whole.counts == single.counts


@settings(max_examples=150)
@given(seeds, st.sampled_from([1, 2, 5]), st.sampled_from(LENGTH_DAMAGES))
def test_decoder_loses_one_good_frame_at_most_by_damage_of_the_length(
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
    rest = iter(frames)
    assert all(frame in rest for frame in delivered)  # in their order
    good = [frame for i, frame in enumerate(frames) if i not in places]
    assert sum(frame not in delivered for frame in good) <= len(places) - 1
    assert decoder.counts.frames == len(delivered)


@given(st.binary(max_size=2000), seeds, st.sampled_from([1, 3]))
def test_decoder_finds_frames_after_anything(noise: bytes, seed: int, chips: int) -> None:
    frames = sent(seed, 5, chips)
    decoder = ReskinDecoder(chips)
    decoder.feed(noise)
    assert len(decoder.pending) <= 8 * frame_bytes(chips) + 2
    assert set(frames[1:]) <= set(got(decoder.feed(b''.join(frames))))


@pytest.mark.parametrize('chips', [1, 5])
@pytest.mark.parametrize('place', [(0, 1), (1, 2), (0, 0), (2, 3)])
def test_decoder_is_not_confused_by_crlf_in_steady_readings(
    chips: int, place: tuple[int, int]
) -> None:
    """A held reading repeats its CR LF at the frame's own period."""
    word = bytearray(struct.pack('<f', 35.3))
    word[place[0] : place[1] + 1] = b'\r\n'[: place[1] - place[0] + 1]
    body = bytearray(sent(5, 1, chips)[0])
    spots = range(4, 16 * chips, 4) if place != (2, 3) else [8]
    for spot in spots:
        frame = bytes(body[:spot] + word + body[spot + 4 :])
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


@pytest.mark.parametrize(
    ('place', 'hurt', 'errors'),
    [
        (80, b'\x0c', (1, 0)),
        (81, b'\x1a', (1, 0)),
        *((20, struct.pack('<f', number), (0, 1)) for number in (np.nan, np.inf, 2e5)),
    ],
)
def test_decoder_drops_a_bad_frame_alone(place: int, hurt: bytes, errors: tuple[int, int]) -> None:
    frames = sent(8, 8)
    bad = frames[4][:place] + hurt + frames[4][place + len(hurt) :]
    decoder = ReskinDecoder(5)
    decoded = decoder.feed(b''.join([*frames[:4], bad, *frames[5:]]))
    assert got(decoded) == frames[:4] + frames[5:]
    assert decoded.lost == [0, 0, 0, 0, 1, 0, 0]
    counts = decoder.counts
    assert (counts.framing_errors, counts.implausible) == errors
    assert (counts.dropped, counts.lost_bytes) == (1, 82)


def with_dead_chip(frame: bytes, chip: int) -> bytes:
    return frame[: 16 * chip] + struct.pack('<4f', 451.8, np.nan, 0, 0) + frame[16 * chip + 16 :]


@pytest.mark.parametrize(('dead', 'alive_again'), [(0, 12), (5, 12), (0, 6)])
def test_decoder_marks_a_faulty_chip_while_the_others_serve(dead: int, alive_again: int) -> None:
    frames = sent(10, 12)
    stream = list(frames)
    stream[dead:alive_again] = [with_dead_chip(f, 2) for f in frames[dead:alive_again]]
    decoded = ReskinDecoder(5).feed(b''.join(stream))
    assert decoded.lost == [0] * 12
    wanted = np.zeros((12, 5), bool)
    wanted[dead:alive_again, 2] = True
    assert decoded.error.tolist() == wanted.tolist()
    assert np.isnan(decoded.values).all(axis=2).tolist() == wanted.tolist()
    whole = ReskinDecoder(5).feed(b''.join(frames))
    np.testing.assert_array_equal(decoded.values[~wanted], whole.values[~wanted])


def test_decoder_does_not_believe_a_minority_of_chips() -> None:
    assert decode(b''.join(with_dead_chip(f, 0) for f in sent(12, 20, 2)), 2) == []


def test_decoder_reset_forgets_the_stream_and_keeps_the_counts() -> None:
    frames = sent(13, 6)
    decoder = ReskinDecoder(5)
    decoder.feed(b''.join(frames[:3]) + frames[3][:40])
    decoder.reset()
    assert got(decoder.feed(frames[4] + frames[5])) == []
    assert (decoder.counts.frames, decoder.counts.lost_bytes) == (3, 40)
