# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""`tactile calibrate`: figures of held-out groups, and what it learns, leaves out or refuses."""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

from tactile_ros.cli.calibrate import sentences
from tactile_ros.cli.main import main
from tactile_ros.evaluation.recording_files import load_recording, save_recording
from tactile_ros.sensors import load_sensor


def test_calibrate_says_what_it_left_out(
    board_files: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    recording = load_recording(board_files / 'small.npz')
    values = recording.values.copy()
    values[:, 4] = np.nan  # a dead chip
    values[11, 0] = np.nan
    path, out = tmp_path / 'hurt.npz', tmp_path / 'c.npz'
    save_recording(dataclasses.replace(recording, values=values), path)
    command = ['calibrate', 'reskin_board', str(path), '-o', str(out), '--estimator', 'ridge']
    assert main([*command, '--json']) == 0
    printed = capsys.readouterr()
    (row,) = json.loads(printed.out)
    assert row['target'] == 'position_xy'
    assert row['groups'] > 30  # places, of which two fifths are held out
    assert 0.0005 < row['held-out mean'] < 0.01
    left_out = 'left out: 1 taxels faulty in every row; 1 rows with a faulty taxel'
    assert printed.err.splitlines()[-1] == left_out
    few = tmp_path / 'few.npz'
    save_recording(recording.select(slice(0, 8)), few)
    out.unlink()
    assert main(['calibrate', 'reskin_board', str(few), '-o', str(out)]) == 1
    assert '; left out: 4 usable rows with position, which' in capsys.readouterr().err
    assert not out.exists()


def test_calibrate_learns_slip_or_says_that_nothing_can_be_learned(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, few = tmp_path / 'c.npz', tmp_path / 'few.npz'
    pulls = load_sensor('reskin_board').recordings()['slip']
    save_recording(pulls.select(slice(0, 600)), few)  # two pulls, both of which slip
    assert main(['calibrate', 'reskin_board', str(few), '-o', str(out)]) == 1
    said = capsys.readouterr().err
    assert 'nothing can be learned from 600 rows: truth has repetition, slip' in said
    assert not out.exists()
    assert main(['calibrate', 'reskin_board', 'slip', '-o', str(out)]) == 0
    said = capsys.readouterr().out
    assert 'matched_subspace' in said
    assert 'of 68 missed' in said
    assert 'slip' in load_sensor('reskin_board').load(out).estimators


def test_sentences_name_models_terms_and_what_was_not_told() -> None:
    report = {
        'force_xyz': {'held_out_rmse': 1.0},
        'model: 27 dipoles': {'worst_error': 1.234e-7, 'noise': 4e-6},
        'term: tilt': {'costs': 4.567, 'buys': 33.1},
        'not learned: temperature': {},
        'found: change of the field at rest': {'per degree': -1.2e-3, 'sigma': 3.6e-4},
    }
    assert sentences(report) == [
        'model: 27 dipoles; it errs by 1.2e-07 at most, noise is 4e-06',
        'term: tilt; estimated it widens errors 4.57 times, left out it would 33.1 times',
        'not learned: temperature',
        'found: change of the field at rest; per degree -0.0012, sigma 0.00036',
    ]


def test_files_of_others_are_replaced_on_request_alone(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mine, page, saved = (tmp_path / f'mine{end}' for end in ('.npz', '.html', '.json'))
    mine.write_text('of mine')
    command = ['calibrate', 'reskin_board', 'normal_1', '--estimator', 'ridge', '-o', str(mine)]
    assert main(command) == 1
    assert 'is a file of another kind' in capsys.readouterr().err
    assert mine.read_text() == 'of mine'
    assert main([*command, '--overwrite']) == 0
    assert main(command) == 0  # its own
    page.write_text('<p>of mine</p>')
    saved.write_text('{}')
    replay = ['replay', 'normal_2', '--calibration', str(mine)]
    assert main([*replay, '--report', str(page)]) == 1
    assert main([*replay, '--save', str(tmp_path / 'mine')]) == 1
    assert (saved.read_text(), page.read_text()) == ('{}', '<p>of mine</p>')
    assert main([*replay, '--report', str(page), '--overwrite']) == 0
    assert main([*replay, '--report', str(page)]) == 0


def test_a_full_disk_leaves_nothing_half(
    board_files: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    def full(*_: object) -> None:
        raise OSError(28, 'No space left on device')

    monkeypatch.setattr('os.fsync', full)
    small, fitted = str(board_files / 'small.npz'), str(board_files / 'a.npz')
    calibrate = ['calibrate', 'reskin_board', small, '--estimator', 'ridge', '-o']
    replay = ['replay', small, '--calibration', fitted]
    for command in (calibrate, [*replay, '--save'], [*replay, '--report']):
        assert main([*command, str(tmp_path / 'out')]) == 1
        assert 'No space left on device' in capsys.readouterr().err.splitlines()[-1]
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize('place', ['', 'file/below/c.npz', 'file/c.npz'])
@pytest.mark.parametrize(
    'command',
    [
        ['calibrate', 'reskin_board', 'spatial', '-o'],
        ['replay', 'spatial', '--calibration', 'a.npz', '--report'],
        ['replay', 'spatial', '--calibration', 'a.npz', '--save'],
        ['bench', 'roads', '--results'],
    ],
    ids=lambda command: command[0],
)
def test_what_cannot_be_written_is_refused_before_the_work(
    command: list[str], place: str, board_files: Path, tmp_path: Path,
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    def work(*_: object) -> None:
        pytest.fail('work was begun')

    for name in ('calibrate.find', 'replay.fleet.run_jobs', 'bench.show'):
        monkeypatch.setattr(f'tactile_ros.cli.{name}', work)
    monkeypatch.chdir(board_files)
    (tmp_path / 'file').touch()
    (tmp_path / 'roads.json').mkdir()
    assert main([*command, str(tmp_path / place)]) == 1
    printed = capsys.readouterr()
    assert str(tmp_path) in printed.err
    assert 'Errno' not in printed.err
    assert not printed.out
    assert {path.name for path in tmp_path.iterdir()} == {'file', 'roads.json'}
