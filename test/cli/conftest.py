# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Recordings, calibrations and a bag of a real board, made once for all commands."""

from pathlib import Path

import numpy as np
import pytest

from reference import made_bags as make
from tactile_ros.evaluation.recording_files import save_recording
from tactile_ros.sensors import load_sensor


@pytest.fixture(scope='session')
def board_files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a.npz and b.npz, which learned much and little, and of files of presses.

    small.npz are places at one edge, each with its tare row; part_0.npz and part_1.npz were
    learned from, presses.npz was not.
    """
    folder = tmp_path_factory.mktemp('board')
    spec = load_sensor('reskin_board')
    spatial = spec.recordings()['spatial']
    for name, count in (('a', 600), ('b', 60)):
        pipeline = spec.pipeline(estimator='ridge').fit(spatial.select(slice(0, count)))
        pipeline.save(folder / f'{name}.npz')
    touches = np.flatnonzero(~spatial.tare & (spatial.truth['position'][:, 0] > 0.0115))
    parts = {
        'small': np.sort(np.r_[touches - 1, touches]), 'presses': slice(600, 800),
        'part_0': slice(0, 200), 'part_1': slice(200, 400),
    }  # fmt: skip
    for name, rows in parts.items():
        save_recording(spatial.select(rows), folder / f'{name}.npz')
    return folder


@pytest.fixture
def there(board_files: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Work in the folder of files."""
    monkeypatch.chdir(board_files)


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    """Bag of one sensor with three frames lost, and of a topic whose name colours terminals."""
    values = load_sensor('reskin_board').recordings()['spatial'].values
    with make.Bag(tmp_path / 'bag') as writer:
        writer.put('/finger/layout', make.layout(), 1, latched=True)
        for row in (k for k in range(20) if k not in (5, 6, 11)):
            stamp = 10_000_000 * (row + 1)
            writer.put('/finger/frame', make.frame(row, values[row], stamp), stamp)
        writer.put('/\x1b[31mred', make.new('String'), 1)
    return tmp_path / 'bag'
