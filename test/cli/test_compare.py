# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""`tactile compare` as a user meets it."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.replay import write_bag
from tactile_ros.cli.main import main
from tactile_ros.evaluation.recording_files import load_recording
from tactile_ros.sensors import load_sensor

ON = ['--on', 'presses.npz']


@pytest.fixture(scope='module')
def place(board_files: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Presses, two calibrations that did not learn them, and bags of live runs over them."""
    folder = tmp_path_factory.mktemp('compare') / 'here'
    shutil.copytree(board_files, folder)
    presses = load_recording(folder / 'presses.npz')
    rows = np.arange(len(presses))
    run = replace(presses, stamp_ns=10_000_000 * (1 + rows), sequence=rows, stream=None, tare=None)
    run = replace(run, truth={'position': presses.truth['position']})
    spec = load_sensor('reskin_board')
    for name, count in (('a', 200), ('b', 200), ('short', 100)):
        pipeline = spec.load(folder / f'{name.replace("short", "a")}.npz')
        write_bag(folder / f'bag_{name}', pipeline, run.select(slice(0, count)))
    return folder


@pytest.fixture(autouse=True)
def there(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(place)


def rows(capsys: pytest.CaptureFixture[str], *words: str) -> list[dict[str, float]]:
    assert main(['compare', *words, '--json']) == 0
    return json.loads(capsys.readouterr().out)


def test_calibrations_are_compared(capsys: pytest.CaptureFixture[str]) -> None:
    (row,) = rows(capsys, 'a.npz', 'b.npz', *ON)
    assert row['compared'] == 'a.npz and b.npz'
    assert row['figure'] == 'position mean (mm)'
    assert 0 < row['low'] < row['difference'] < row['high']
    assert row['p'] < 0.05
    assert [row] == rows(capsys, 'a.npz', 'b.npz', *ON, '--seed', '0')


def test_live_runs_are_compared_with_one_another_and_with_calibrations(
    capsys: pytest.CaptureFixture[str],
) -> None:
    found = rows(capsys, 'bag_a', 'bag_b', 'a.npz')
    two = [row for row in found if row['figure'] == 'position mean (mm)']
    assert [row['compared'] for row in two] == ['bag_a and bag_b', 'bag_a and a.npz']
    assert two[0]['difference'] > 0
    assert abs(two[1]['difference']) < 1e-9
    assert two[1]['p'] == 1.0


@pytest.mark.parametrize('name', ['out/page.html', 'drawing.svg'])
def test_a_page_or_a_drawing_is_written(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    words = ['compare', 'a.npz', 'b.npz', *ON, '-o', name]
    assert main(words) == 0
    assert 'permutation test that swaps both estimates' in capsys.readouterr().out
    assert 'b.npz against a.npz' in Path(name).read_text()
    Path(name).write_text('mine')
    assert main(words) == 1
    assert Path(name).read_text() == 'mine'
    assert main([*words, '--overwrite']) == 0
    assert main(words) == 0


@pytest.mark.parametrize(
    ('words', 'code', 'why'),
    [
        (['bag_a', 'bag_short'], 2, 'short must have the frames and the truth of bag_a; it has'),
        (['a.npz', 'bag_a', *ON], 2, 'another truth of'),
        (['a.npz', 'b.npz'], 2, 'name the recordings to compare on'),
        (['a.npz'], 2, 'two competitors or more'),
        (['a.npz', 'a.npz', *ON], 2, 'each once'),
        (['a.npz', 'mean', *ON], 2, 'mean is no file and no estimator of'),
        (['ridge', 'grid_knn', *ON], 2, 'add --sensor'),
        (['a.npz', 'gone.npz', *ON], 1, 'gone.npz does not exist'),
        (['a.npz', 'b.npz', '--on', 'nowhere'], 1, 'nowhere does not exist'),
        (['a.npz', 'b.npz', *ON, './presses.npz'], 2, 'each recording once'),
        (['a.npz', 'b.npz', *ON, '-o', 'a.pdf'], 2, 'must end in .html or .svg'),
        (['a.npz', 'b.npz', *ON, '--seed', '-1'], 2, '--seed must be 0 or more'),
    ],
)
def test_wrong_use_is_refused_in_a_sentence(
    words: list[str], code: int, why: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(['compare', *words]) == code
    said = capsys.readouterr().err
    assert why in said
    assert said.count('\n') == 1
