# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""The reference sender, compiled by the host's compiler, against the codec."""

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from tactile_ros.devices.framed_protocol import FramedDecoder, encode, gradiometer
from tactile_ros.types import TaxelStatus

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
