# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""The framed protocol: byte vectors, any cut, damage, whatever else, and the reference sender."""

import re
import shutil
import subprocess
import zlib
from pathlib import Path

import numpy as np
import pytest

from tactile_ros.devices.framed_protocol import (
    FramedDecoder,
    Payload,
    encode,
    five_wires,
    frame_bytes,
    gradiometer,
    taxel_matrix,
    three_axis_chips,
)
from tactile_ros.devices.simulated_serial import BYTE_FAULTS, damage
from tactile_ros.types import TaxelStatus

PAGE = Path(__file__).resolve().parents[2] / 'docs' / 'serial_protocol.md'
PAYLOADS = [
    gradiometer(), three_axis_chips(20), three_axis_chips(5), taxel_matrix(16), taxel_matrix(70),
    five_wires(),
]  # fmt: skip
COUNTS = np.array([[1, -2], [300, -400], [32767, -32768 + 1], [0, 21]])
all_payloads = pytest.mark.parametrize('payload', PAYLOADS, ids=str)


def some(payload: Payload, frames: int, seed: int = 0) -> np.ndarray:
    """Counts within the converter's limits."""
    highest = payload.full_count - 1
    lowest = 0 if payload.one_converter else -highest
    shape = (frames, payload.count, payload.channels)
    return np.random.default_rng(seed).integers(lowest, highest, shape)


def stream(payload: Payload, frames: int, seed: int = 0) -> list[bytes]:
    """Frames of random counts, one by one."""
    data = encode(payload, some(payload, frames, seed), 7, 1000 * np.arange(frames), 25.5)
    size = frame_bytes(payload)
    return [data[i : i + size] for i in range(0, len(data), size)]


def test_page_has_the_bytes_of_the_codec() -> None:
    """The example in docs/serial_protocol.md, byte for byte."""
    blocks = re.findall(r'```hex\n(.*?)```', PAGE.read_text(), re.S)
    page = [bytes.fromhex(re.sub(r'#.*', '', block)) for block in blocks]
    ours = [
        encode(gradiometer(), COUNTS, 258, 16_909_060, 26.53),
        encode(taxel_matrix(6), [[1], [2], [1023], [512], [0], [3]], 1, 20_000),
        encode(five_wires(), [[4660, 65535, 0]], 2, 10_000),
        encode(three_axis_chips(1), [[1, -1, 258]], 3, 30_000, -0.5, 1),
    ]
    assert [data.hex(' ') for data in ours] == [data.hex(' ') for data in page]
    decoded = FramedDecoder(gradiometer()).feed(page[0])
    assert decoded.counts[0].tolist() == COUNTS.tolist()
    assert decoded.time_us == [16_909_060]


@all_payloads
def test_decoder_gives_what_was_encoded(payload: Payload) -> None:
    counts = some(payload, 50)
    warm = np.round(np.random.default_rng(1).uniform(-40, 125, (50, payload.count)), 2)
    data = encode(payload, counts, 2**32 - 3, 2**32 - 5 + np.arange(50), warm)
    decoder = FramedDecoder(payload)
    decoded = decoder.feed(data)
    np.testing.assert_array_equal(decoded.counts, counts)
    assert decoded.counts.dtype == np.float64
    assert decoded.time_us == ((2**32 - 5 + np.arange(50)) % 2**32).tolist()
    assert not any(decoded.lost)
    assert not decoded.status.any()
    wanted = {4: warm, 1: np.repeat(warm[:, :1], payload.count, axis=1)}.get(payload.kind)
    assert (decoded.temperature_c is None) is (wanted is None)
    if wanted is not None:
        np.testing.assert_allclose(decoded.temperature_c, wanted, atol=1e-9)
    assert (decoder.counts.frames, decoder.counts.dropped, decoder.counts.lost_bytes) == (50, 0, 0)


def test_decoder_turns_limits_and_states_into_status() -> None:
    counts = np.array([[5, 5, 5], [32767, 0, 0], [0, -32767, 0], [7, 7, 7], [8, 8, 8]])
    data = encode(three_axis_chips(5), counts, 0, 0, 20.0, [0, 1, 0, 2, 3])
    decoded = FramedDecoder(three_axis_chips(5)).feed(data)
    stale, error, saturated = TaxelStatus.STALE, TaxelStatus.ERROR, TaxelStatus.SATURATED
    assert decoded.status[0].tolist() == [0, stale | saturated, saturated, error, error]
    assert np.isnan(decoded.counts[0, 3:]).all()
    assert np.isnan(decoded.temperature_c[0]).tolist() == [False] * 3 + [True] * 2
    for payload, sent, status in (
        (taxel_matrix(4), [[0], [1022], [1023], [9]], [0, 0, saturated, 0]),
        (five_wires(4095), [[0, 4094, 4095]], [saturated]),
        (gradiometer(), COUNTS, [0, 0, saturated, 0]),
    ):
        decoded = FramedDecoder(payload).feed(encode(payload, sent, 0, 0))
        assert decoded.status[0].tolist() == status
    assert np.isnan(decoded.temperature_c).all()  # not measured


@all_payloads
def test_decoder_gives_the_same_however_bytes_are_cut(payload: Payload) -> None:
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
        np.testing.assert_array_equal(np.concatenate([p.counts for p in parts]), want.counts)
        assert [lost for part in parts for lost in part.lost] == want.lost
        assert decoder.counts == whole.counts
        assert decoder.pending == whole.pending


@all_payloads
@pytest.mark.parametrize('kind', BYTE_FAULTS)
def test_decoder_never_delivers_damage_and_loses_one_good_frame_at_most(
    payload: Payload, kind: str
) -> None:
    rng = np.random.default_rng(3)
    for trial in range(40):
        frames = stream(payload, 9, trial)
        decoder = FramedDecoder(payload)
        data = b''.join([*frames[:4], damage(frames[4], kind, rng), *frames[5:]])
        got = [one.tobytes() for one in decoder.feed(data).counts]
        assert set(got) <= {one.tobytes() for one in some(payload, 9, trial).astype(np.float64)}
        assert len(got) >= 8
        assert decoder.counts.frames + decoder.counts.dropped == 9


def test_decoder_names_other_frames_by_version_kind_and_length() -> None:
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


FRAMES = stream(gradiometer(), 8)
ANEW = encode(gradiometer(), COUNTS, 0, 0)
SAME_SEQUENCE = encode(gradiometer(), COUNTS, 10, 500)  # of FRAMES[3], at another time


@pytest.mark.parametrize(
    ('sent', 'lost', 'counted'),
    [
        (
            [*FRAMES[:2], FRAMES[1], FRAMES[5], ANEW, FRAMES[2]], [0, 0, 3, 1, 8],
            {'repeated': 1, 'restarts': 1, 'dropped': 12, 'missing': 12},
        ),
        ([*FRAMES[3:5], FRAMES[3], FRAMES[5]], [0, 0, 0], {'repeated': 1}),
        (
            [*FRAMES[3:6], SAME_SEQUENCE], [0, 0, 0, 1],
            {'restarts': 1, 'dropped': 1, 'missing': 1},
        ),
        # a frame in the extent of a damaged one
        (
            [FRAMES[0], FRAMES[1][:20], *FRAMES[2:4]], [0, 1, 0],
            {'crc_errors': 1, 'lost_bytes': 20, 'dropped': 1},
        ),
        # a damaged length delays nothing
        (
            [FRAMES[0], FRAMES[1][:6] + b'\xff\x0f' + FRAMES[1][8:], FRAMES[2]], [0, 1],
            {'framing_errors': 1, 'lost_bytes': 38, 'dropped': 1},
        ),
    ],
)  # fmt: skip
def test_decoder_counts_by_the_sequence(
    sent: list[bytes], lost: list[int], counted: dict[str, int]
) -> None:
    decoder = FramedDecoder(gradiometer())
    came = [decoder.feed(data).lost for data in sent]
    assert [gap for gaps in came for gap in gaps] == lost
    assert came[-1]  # the last one comes at once
    counts = {name: count for name, count in vars(decoder.counts).items() if count}
    assert counts == {'frames': len(lost), **counted}


@pytest.mark.parametrize(
    ('make', 'why'),
    [
        (lambda: taxel_matrix(0), 'count of a payload must be at least 1'),
        (lambda: three_axis_chips(600), 'fill at most 4096 bytes; received 600'),
        (lambda: taxel_matrix(4, 1024), 'full_count must be 1 to 1023; received 1024'),
        (lambda: encode(gradiometer(), np.zeros((3, 2)), 0, 0), r'shape \(4, 2\) or \(s, 4, 2\)'),
    ],
)
def test_wrong_payloads_and_shapes_are_refused(make: object, why: str) -> None:
    assert callable(make)
    with pytest.raises(ValueError, match=why):
        make()


ROOT = Path(__file__).resolve().parents[2]
SENDER = ROOT / 'docs' / 'firmware' / 'gradiometer'
ARDUINO = Path(__file__).parent / 'arduino'
FLAGS = ['-std=c++11', '-Wall', '-Wextra', '-Wconversion', '-Werror', '-fno-exceptions', '-O1']


def compiled(name: str, folder: Path) -> Path:
    """Build a program of arduino/ around the sender; skip where there is no compiler."""
    compiler = next(
        (path for name in ('c++', 'g++', 'clang++') if (path := shutil.which(name))), ''
    )
    if not compiler:
        pytest.skip('no C++ compiler (c++, g++ or clang++): the reference sender is not compiled')
    source, program = ARDUINO / name, folder / 'program'
    include = [f'-I{SENDER}', f'-I{ARDUINO}']
    done = subprocess.run(
        [compiler, *FLAGS, *include, '-o', str(program), str(source)],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return program


def test_sender_writes_the_bytes_of_the_codec(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    counts = rng.integers(-32767, 32768, (200, 4, 2))
    counts[0] = [[1, -2], [300, -400], [32767, -32767], [0, 21]]
    warm = rng.integers(-4000, 12500, 200)
    sequence = rng.integers(0, 2**32, 200)
    time_us = rng.integers(0, 2**32, 200)
    warm[0], sequence[0], time_us[0] = 2653, 258, 16_909_060
    lines = np.column_stack([warm, sequence, time_us, counts.reshape(200, 8)])
    told = '\n'.join(' '.join(map(str, line)) for line in lines.tolist())
    program = compiled('vectors.cpp', tmp_path)
    done = subprocess.run([str(program)], input=told.encode(), capture_output=True, check=True)
    ours = [
        encode(gradiometer(), counts[i], int(sequence[i]), int(time_us[i]), warm[i] / 100)
        for i in range(200)
    ]
    assert done.stdout == b''.join(ours)


def test_sketch_stream_is_read(tmp_path: Path) -> None:
    """Twenty frames, one of which the port did not take."""
    program = compiled('sketch.cpp', tmp_path)
    data = subprocess.run([str(program)], capture_output=True, check=True).stdout
    decoder = FramedDecoder(gradiometer())
    decoded = decoder.feed(data)
    assert decoder.counts.frames == 19
    assert decoded.lost == [0, 0, 0, 0, 1, *[0] * 14]
    steps = np.diff(decoded.time_us) % 2**32
    assert steps.tolist() == [750, 1000, 1000, 2000, *[1000] * 14]
    assert (np.diff(decoded.time_us) < 0).sum() == 1
    want = [[0, 100], [200, 300], [400, 500], [600, 32767]]
    assert decoded.counts[5].tolist() == want
    assert decoded.status[5].tolist() == [0, 0, 0, TaxelStatus.SATURATED]
    assert np.isnan(decoded.temperature_c).all()
