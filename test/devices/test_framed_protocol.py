"""Codec of the framed protocol: byte vectors, any cut, damage, and whatever else may come."""

from __future__ import annotations

import re
import zlib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tactile_ros.devices.framed_protocol import (
    MOST_BYTES,
    FramedDecoder,
    Payload,
    encode,
    five_wires,
    frame_bytes,
    gradiometer,
    pack_bits,
    taxel_matrix,
    three_axis_chips,
    unpack_bits,
)
from tactile_ros.devices.simulated_serial import BYTE_FAULTS, damage
from tactile_ros.types import TaxelStatus

PAGE = Path(__file__).resolve().parents[2] / 'docs' / 'serial_protocol.md'
PAYLOADS = [
    gradiometer(),
    three_axis_chips(20),
    three_axis_chips(5),
    taxel_matrix(16),
    taxel_matrix(70),
    five_wires(),
]
COUNTS = np.array([[1, -2], [300, -400], [32767, -32768 + 1], [0, 21]])


def some(payload: Payload, frames: int, seed: int = 0) -> np.ndarray:
    """Counts within the converter's limits."""
    highest = payload.full_count - 1
    lowest = -highest if payload.signed else 0
    shape = (frames, payload.count, payload.channels)
    return np.random.default_rng(seed).integers(lowest, highest, shape)


def stream(payload: Payload, frames: int, seed: int = 0) -> list[bytes]:
    """Frames of random counts, one by one."""
    data = encode(payload, some(payload, frames, seed), 7, 1000 * np.arange(frames), 25.5)
    size = frame_bytes(payload)
    return [data[i : i + size] for i in range(0, len(data), size)]


def test_bytes_of_the_page_are_the_codec_s() -> None:
    """The example in docs/serial_protocol.md, byte for byte."""
    blocks = re.findall(r'```hex\n(.*?)```', PAGE.read_text(), re.S)
    assert len(blocks) == 4
    told = [bytes.fromhex(re.sub(r'#.*', '', block)) for block in blocks]
    ours = [
        encode(gradiometer(), COUNTS, 258, 16_909_060, 26.53),
        encode(taxel_matrix(6), [[1], [2], [1023], [512], [0], [3]], 1, 20_000),
        encode(five_wires(), [[4660, 65535, 0]], 2, 10_000),
        encode(three_axis_chips(1), [[1, -1, 258]], 3, 30_000, -0.5, 1),
    ]
    assert [data.hex(' ') for data in ours] == [data.hex(' ') for data in told]
    decoded = FramedDecoder(gradiometer()).feed(told[0])
    assert decoded.counts[0].tolist() == COUNTS.tolist()
    assert decoded.time_us == [16_909_060]


@pytest.mark.parametrize('payload', PAYLOADS, ids=str)
def test_what_is_encoded_is_decoded(payload: Payload) -> None:
    counts = some(payload, 50)
    warm = np.round(np.random.default_rng(1).uniform(-40, 125, (50, payload.count)), 2)
    data = encode(payload, counts, 2**32 - 3, 2**32 - 5 + np.arange(50), warm)
    decoder = FramedDecoder(payload)
    decoded = decoder.feed(data)
    readings = decoded
    np.testing.assert_array_equal(readings.counts, counts)
    assert readings.counts.dtype == np.float64
    assert decoded.time_us == ((2**32 - 5 + np.arange(50)) % 2**32).tolist()
    assert not any(decoded.lost)
    assert not readings.status.any()
    if payload.kind == 4:
        np.testing.assert_allclose(readings.temperature_c, warm, atol=1e-9)
    elif payload.kind == 1:
        np.testing.assert_allclose(readings.temperature_c, np.repeat(warm[:, :1], 4, axis=1))
    else:
        assert readings.temperature_c is None
    assert (decoder.counts.frames, decoder.counts.dropped, decoder.counts.lost_bytes) == (50, 0, 0)


def test_bits_are_packed_lowest_first() -> None:
    """Against the definition: count i is bits 10 i .. 10 i + 9 of the byte string as a number."""
    counts = np.random.default_rng(0).integers(0, 1024, (3, 70)).astype(np.uint16)
    packed = pack_bits(counts)
    for row, data in zip(counts, packed, strict=True):
        number = sum(int(count) << 10 * i for i, count in enumerate(row))
        assert data.tobytes() == number.to_bytes(90, 'little')
    np.testing.assert_array_equal(unpack_bits(packed, 70), counts)


def test_limits_of_the_converter_and_what_a_chip_says_become_status() -> None:
    counts = np.array([[5, 5, 5], [32767, 0, 0], [0, -32767, 0], [7, 7, 7], [8, 8, 8]])
    data = encode(three_axis_chips(5), counts, 0, 0, 20.0, [0, 1, 0, 2, 3])
    readings = FramedDecoder(three_axis_chips(5)).feed(data)
    stale, error, saturated = TaxelStatus.STALE, TaxelStatus.ERROR, TaxelStatus.SATURATED
    assert readings.status[0].tolist() == [0, stale | saturated, saturated, error, error]
    assert np.isnan(readings.counts[0, 3:]).all()
    assert readings.temperature_c is not None
    assert np.isnan(readings.temperature_c[0]).tolist() == [False] * 3 + [True] * 2
    full = FramedDecoder(taxel_matrix(4)).feed(
        encode(taxel_matrix(4), [[0], [1022], [1023], [9]], 0, 0)
    )
    assert full.status[0].tolist() == [0, 0, saturated, 0]
    twelve = five_wires(4095)
    wires = FramedDecoder(twelve).feed(encode(twelve, [[0, 4094, 4095]], 0, 0))
    assert wires.status[0].tolist() == [saturated]


def test_a_temperature_that_was_not_measured_is_nan() -> None:
    readings = FramedDecoder(gradiometer()).feed(encode(gradiometer(), COUNTS, 0, 0))
    assert readings.temperature_c is not None
    assert np.isnan(readings.temperature_c).all()


@pytest.mark.parametrize('payload', PAYLOADS, ids=str)
def test_any_cut_gives_the_same(payload: Payload) -> None:
    rng = np.random.default_rng(2)
    frames = stream(payload, 60)
    for i in (0, 5, 9, 10, 20, 31, 45):
        frames[i] = damage(frames[i], BYTE_FAULTS[int(rng.integers(len(BYTE_FAULTS)))], rng)
    foreign = encode(taxel_matrix(3), [[1], [2], [3]], 0, 0)
    data = rng.bytes(30) + b''.join([*frames[:40], foreign, *frames[40:]]) + foreign[:9]
    whole = FramedDecoder(payload)
    want = whole.feed(data)
    for cut in (1, 2, 7, 13, 100):
        decoder = FramedDecoder(payload)
        parts = [decoder.feed(data[i : i + cut]) for i in range(0, len(data), cut)]
        got = np.concatenate([part.counts for part in parts])
        np.testing.assert_array_equal(got, want.counts)
        assert [lost for part in parts for lost in part.lost] == want.lost
        assert decoder.counts == whole.counts
        assert decoder.pending == whole.pending


@pytest.mark.parametrize('payload', PAYLOADS, ids=str)
@pytest.mark.parametrize('kind', BYTE_FAULTS)
def test_damage_is_never_delivered_and_costs_one_good_frame_at_most(
    payload: Payload, kind: str
) -> None:
    rng = np.random.default_rng(3)
    for trial in range(40):
        frames = stream(payload, 9, trial)
        data = b''.join([*frames[:4], damage(frames[4], kind, rng), *frames[5:]])
        decoder = FramedDecoder(payload)
        readings = decoder.feed(data)
        sent = {one.tobytes() for one in some(payload, 9, trial).astype(np.float64)}
        got = [one.tobytes() for one in readings.counts]
        assert set(got) <= sent
        assert len(got) >= 8
        assert decoder.counts.frames + decoder.counts.dropped == 9


def test_a_damaged_length_delays_nothing() -> None:
    frames = stream(gradiometer(), 4)
    hurt = frames[1][:6] + b'\xff\x0f' + frames[1][8:]
    decoder = FramedDecoder(gradiometer())
    came = [len(decoder.feed(data).lost) for data in (frames[0], hurt, *frames[2:])]
    assert came == [1, 0, 1, 1]
    assert decoder.counts.framing_errors == 1


def test_the_crc_covers_every_byte() -> None:
    frame = stream(gradiometer(), 1)[0]
    assert zlib.crc32(frame[:-4]).to_bytes(4, 'little') == frame[-4:]
    for bit in range(8 * len(frame)):
        hurt = bytearray(frame)
        hurt[bit // 8] ^= 1 << bit % 8
        decoder = FramedDecoder(gradiometer())
        assert not len(decoder.feed(bytes(hurt) + bytes(MOST_BYTES)).lost)


def test_other_frames_are_told_by_version_kind_and_length() -> None:
    own = stream(gradiometer(), 3)
    kind = encode(five_wires(), [[1, 2, 3]], 0, 0)
    length = encode(taxel_matrix(72), np.zeros((72, 1), int), 0, 0)
    version = bytearray(own[0])
    version[2] = 9
    version[-4:] = zlib.crc32(version[:-4]).to_bytes(4, 'little')
    decoder = FramedDecoder(gradiometer())
    lost = decoder.feed(own[0] + kind + bytes(version) + own[1] + length + own[2]).lost
    counts = decoder.counts
    assert lost == [0, 0, 0]
    assert (counts.other_version, counts.other_kind, counts.other_length) == (1, 2, 0)
    assert (counts.lost_bytes, counts.framing_errors, counts.crc_errors) == (0, 0, 0)
    matrix = FramedDecoder(taxel_matrix(16))
    matrix.feed(length)
    assert matrix.counts.other_length == 1
    assert matrix.foreign == 'version 1, taxels (kind 2) of 72 in 90 bytes'


def test_sequence_tells_lost_repeated_and_restarted() -> None:
    frames = stream(gradiometer(), 8)
    anew = encode(gradiometer(), COUNTS, 0, 0)
    decoder = FramedDecoder(gradiometer())
    sent = [frames[0], frames[1], frames[1], frames[5], anew, frames[2]]
    assert decoder.feed(b''.join(sent)).lost == [0, 0, 3, 1, 8]
    counts = decoder.counts
    assert (counts.repeated, counts.restarts, counts.dropped, counts.missing) == (1, 1, 12, 12)


def test_an_older_frame_that_comes_again_is_left_out_but_a_board_that_starts_anew_is_not() -> None:
    frames = stream(gradiometer(), 8)
    decoder = FramedDecoder(gradiometer())
    sent = [*frames[3:5], frames[3], frames[5]]
    assert decoder.feed(b''.join(sent)).lost == [0, 0, 0]
    counts = decoder.counts
    assert (counts.repeated, counts.restarts, counts.dropped) == (1, 0, 0)
    anew = encode(gradiometer(), COUNTS, 10, 500)  # the sequence of frames[3], not its time
    assert decoder.feed(anew).lost == [1]
    assert counts.restarts == 1


def test_a_frame_in_a_damaged_frame_s_extent_is_found() -> None:
    frames = stream(gradiometer(), 4)
    decoder = FramedDecoder(gradiometer())
    lost = decoder.feed(frames[0] + frames[1][:20] + frames[2] + frames[3]).lost
    assert lost == [0, 1, 0]
    assert decoder.counts.crc_errors == 1
    assert decoder.counts.lost_bytes == 20


def test_memory_is_bounded_whatever_comes() -> None:
    rng = np.random.default_rng(4)
    foreign = encode(taxel_matrix(3000), np.zeros((3000, 1), int), 0, 0)
    decoder = FramedDecoder(taxel_matrix(2000))
    for data in (rng.bytes(200_000), b'\xa5\x5a' * 50_000, foreign[:8] * 9000, b'\xa5' * 100_000):
        for i in range(0, len(data), 4096):
            decoder.feed(data[i : i + 4096])
            assert decoder.pending < 2 * (MOST_BYTES + 20)
    decoder.reset()
    assert decoder.pending == 0


def mutated(draw: st.DataObject, payload: Payload) -> bytes:
    """A stream of good frames with bytes changed, cut out and put in."""
    data = bytearray(b''.join(stream(payload, 4)))
    for _ in range(draw.draw(st.integers(0, 6))):
        place = draw.draw(st.integers(0, len(data)))
        end = place + draw.draw(st.integers(0, 20))
        data[place:end] = draw.draw(st.binary(max_size=20))
    return bytes(data)


@settings(max_examples=1000)
@given(st.data(), st.sampled_from(PAYLOADS))
def test_no_bytes_raise_and_none_are_believed_wrongly(
    draw: st.DataObject, payload: Payload
) -> None:
    data = (
        draw.draw(st.binary(max_size=400)) if draw.draw(st.booleans()) else mutated(draw, payload)
    )
    cut = draw.draw(st.integers(1, 300))
    decoder = FramedDecoder(payload)
    parts = [decoder.feed(data[i : i + cut]) for i in range(0, len(data), cut)]
    sent = some(payload, 4).astype(np.float64)
    for readings in parts:
        for row in readings.counts:
            assert any(np.array_equal(row, good) for good in sent)
    # after anything at all, the next frames are found
    after = stream(payload, 2, seed=9)
    decoder.feed(after[0])
    assert len(decoder.feed(after[1]).lost) == 1


@pytest.mark.parametrize(
    ('make', 'why'),
    [
        (lambda: taxel_matrix(0), 'count of a payload must be at least 1'),
        (lambda: three_axis_chips(600), 'fill at most 4096 bytes; received 600'),
        (lambda: taxel_matrix(4, 1024), 'full_count must be 1 to 1023; received 1024'),
        (lambda: encode(gradiometer(), np.zeros((3, 2)), 0, 0), r'shape \(4, 2\) or \(s, 4, 2\)'),
    ],
)
def test_wrong_arguments_are_refused(make: object, why: str) -> None:
    assert callable(make)
    with pytest.raises(ValueError, match=why):
        make()
