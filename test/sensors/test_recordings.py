# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Shipped recordings: whole counts, a tare row before every touch, truth, and known facts."""

import hashlib
import runpy
from pathlib import Path

import numpy as np
import pytest

from tactile_ros.conditioning.baseline import tare_runs
from tactile_ros.sensors import load_sensor
from tactile_ros.sensors.reskin_board import recordings
from tactile_ros.sensors.reskin_board.config import ReskinBoardConfig, layout
from tactile_ros.types import Recording

FOLDER = Path(recordings.__file__).parent
packed = runpy.run_path(str(Path(__file__).parents[2] / 'training/recordings.py'))['packed']
FINE, COARSE = (0.6, 0.6, 0.968), (2.4, 2.4, 3.872)
# frames, tare rows, chips, quantum (uT), first frame of the first chip (uT)
FACTS = {
    'spatial': (4805, 4805, 5, COARSE, (662.4, -830.4, 7647.2)),
    'normal_1': (3600, 10, 5, COARSE, (604.8, 158.4, 9439.936)),
    'normal_2': (3600, 10, 5, COARSE, None),
    'shear': (7200, 10, 10, FINE, None),
    'slip': (27000 - 900, 900, 10, FINE, None),
}
NAMES = list(FACTS)
# of the counts as little-endian int16, row by row: SHA-256 begins with
DIGESTS = {
    'spatial': '831f3ffa03257005',
    'normal_1': 'f72f9cc4fbbc409c',
    'normal_2': 'f15f1d8017a952b9',
    'shear': '588b96e06cb2bc68',
    'slip': '6bd4bdac8eb8fae8',
}


@pytest.fixture(scope='module')
def shipped() -> dict[str, Recording]:
    return load_sensor('reskin_board').recordings()  # type: ignore[return-value]


def test_the_licence_goes_with_them() -> None:
    licence = (FOLDER / 'LICENSE').read_text()
    assert 'MIT License' in licence
    assert 'Venkatesh Pattabiraman' in licence
    assert 'ab5ca56a87df7cbf59264138998bf74efc216b13' in (FOLDER / 'README.md').read_text()
    files = {path.stem: path.stat().st_size for path in FOLDER.glob('*.npz')}
    assert set(files) == set(NAMES)
    assert sum(files.values()) < 1_000_000


@pytest.mark.parametrize('name', NAMES)
def test_counts_are_the_published_ones(name: str) -> None:
    with np.load(FOLDER / f'{name}.npz', allow_pickle=False) as file:
        counts = recordings.unpacked(file['counts']).astype('<i2')
    assert hashlib.sha256(counts.tobytes()).hexdigest().startswith(DIGESTS[name])


@pytest.mark.parametrize('shape', [(0, 3), (1, 1), (200,), (50, 4)])
@pytest.mark.parametrize('most', [0, 1, 127, 2**15 - 1, 2**31, 2**60])
def test_what_is_packed_comes_back(shape: tuple[int, ...], most: int) -> None:
    rng = np.random.default_rng(most % 97)
    table = rng.integers(-most, most, shape, endpoint=True)
    planes = packed(table)
    assert planes.dtype == np.uint8
    wanted = table[:, 0] if table.shape[1:] == (1,) else table
    np.testing.assert_array_equal(recordings.unpacked(planes), wanted)


@pytest.mark.parametrize('name', NAMES)
def test_values_are_whole_counts(name: str, shipped: dict[str, Recording]) -> None:
    frames, tares, chips, quantum, first = FACTS[name]
    recording = shipped[name]
    assert int(recording.tare.sum()) == tares
    assert len(recording) == frames + tares
    assert recording.layout.shape == (chips, 3)
    assert recording.layout.unit == 'T'
    counts = recording.values / (1e-6 * np.array(quantum))
    np.testing.assert_allclose(counts, np.round(counts), atol=1e-6)
    assert 1e-3 < recording.values.max() < 50e-3
    if first is not None:
        frame = recording.values[~recording.tare][0, 0]
        np.testing.assert_allclose(1e6 * frame, first, atol=1e-3)


@pytest.mark.parametrize('name', NAMES)
def test_stamps_increase_and_a_tare_precedes_every_frame(
    name: str, shipped: dict[str, Recording]
) -> None:
    recording = shipped[name]
    assert (np.diff(recording.stamp_ns)[~recording.restarts[1:]] > 0).all()
    _, serves = tare_runs(recording.tare, recording.restarts)
    assert (serves >= 0).all()


def test_places(shipped: dict[str, Recording]) -> None:
    recording = shipped['spatial']
    place = recording.truth['position']
    np.testing.assert_array_equal(np.isnan(place[:, :2]).any(axis=1), recording.tare)
    assert np.isnan(place[:, 2]).all()
    axes = [np.unique(np.round(1e3 * place[~recording.tare, i], 3)) for i in (0, 1)]
    for axis in axes:
        np.testing.assert_allclose(axis, np.arange(-15, 16))
    spots, counts = np.unique(
        np.round(1e3 * place[~recording.tare, :2]), axis=0, return_counts=True
    )
    assert len(spots) == 31 * 31
    assert set(counts.tolist()) == {5}
    repetition = recording.truth['repetition'][~recording.tare]
    assert np.bincount(repetition).tolist() == [961] * 5  # type: ignore[arg-type]
    # a touch and the tare row before it are one repetition
    assert (recording.truth['repetition'][recording.tare] == repetition).all()


@pytest.mark.parametrize(
    ('name', 'axis', 'most'), [('normal_1', 2, 34.15), ('normal_2', 2, 31.8), ('shear', 0, 17.9)]
)
def test_forces(name: str, axis: int, most: float, shipped: dict[str, Recording]) -> None:
    recording = shipped[name]
    force = recording.truth['force']
    others = [i for i in range(3) if i != axis]
    assert np.isnan(force[:, others]).all()
    assert np.nanmax(force[:, axis]) == pytest.approx(most, abs=0.05)
    assert np.nanmin(force[:, axis]) >= 0
    # the scale missed about every other row
    assert 0.5 < np.isfinite(force[:, axis]).mean() < 0.53
    assert np.isnan(force[recording.tare]).all()
    assert np.unique(recording.truth['repetition']).tolist() == list(range(10))
    assert set(recording.truth['session'].tolist()) == {2 if name == 'normal_2' else 1}
    spots = np.round(recording.layout.positions, 6)
    assert len(np.unique(spots, axis=0)) == len(spots)  # two boards do not coincide


def test_pulls(shipped: dict[str, Recording]) -> None:
    recording = shipped['slip']
    assert np.bincount(recording.stream).tolist() == [300] * 90
    label = recording.truth['slip'].reshape(90, 300)
    assert (label == label[:, :1]).all()
    assert int(label[:, 0].sum()) == 68
    assert recording.tare.reshape(90, 300)[:, :10].all()


def test_unknown_names_and_other_boards_are_refused() -> None:
    board = layout(ReskinBoardConfig())
    with pytest.raises(ValueError, match=r"must be one of spatial.*received 'day_2'"):
        recordings.load('day_2', board)
    with pytest.raises(ValueError, match=r'values of Recording must have shape \(any, 5, 3\)'):
        recordings.load('shear', board)
