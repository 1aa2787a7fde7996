# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""`tactile replay` on several recordings and calibrations."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from tactile_ros.cli import console
from tactile_ros.cli.console import Progress
from tactile_ros.cli.main import main
from tactile_ros.evaluation import figures, fleet
from tactile_ros.evaluation.recording_files import save_recording
from tactile_ros.sensors import load_sensor

if TYPE_CHECKING:
    from tactile_ros.evaluation.fleet import Job

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope='module')
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp('replay')
    spec = load_sensor('reskin_board')
    spatial = spec.recordings()['spatial'].select(slice(0, 800))
    spec.pipeline(estimator='ridge').fit(spatial).save(place / 'a.npz')
    spec.pipeline(estimator='ridge').fit(spatial.select(slice(0, 400))).save(place / 'b.npz')
    for i in (0, 1):
        save_recording(spatial.select(slice(200 * i, 200 * i + 200)), place / f'part_{i}.npz')
    return place


def test_several_are_compared_in_one_table_and_saved(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    names = [str(folder / f'part_{i}.npz') for i in (0, 1)]
    calibrations = ['--calibration', str(folder / 'a.npz'), '--calibration', str(folder / 'b.npz')]
    saved = folder / 'out' / 'compared'
    code = main(
        ['replay', *names, 'missing', *calibrations, '--jobs', '1', '--json', '--save', str(saved)]
    )
    assert code == 1  # one of three failed
    printed = capsys.readouterr()
    rows = json.loads(printed.out)
    assert [(row['recording'], row['calibration']) for row in rows] == [
        ('part_0.npz', 'a'), ('part_0.npz', 'b'), ('part_1.npz', 'a'),
        ('part_1.npz', 'b'), ('all', 'a'), ('all', 'b'),
    ]  # fmt: skip
    whole, parts = rows[4], [rows[0], rows[2]]
    assert whole['frames'] == sum(part['frames'] for part in parts) == 400
    mean = sum(part['place mean (mm)'] for part in parts) / 2
    assert whole['place mean (mm)'] == pytest.approx(mean)
    assert '[3/3] missing failed: missing does not exist' in printed.err
    assert 'left out: missing does not exist' in printed.err
    document = json.loads(saved.with_name('compared.json').read_text())
    assert [one['recording'] for one in document['recordings']] == ['part_0.npz', 'part_1.npz']
    assert saved.with_name('compared.npz').is_file()


def test_the_report_and_its_pictures_come_from_the_same_run(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    taken: list[str] = []
    monkeypatch.setattr(
        figures, 'write_png', lambda path, _: taken.append(path.name) or path
    )
    monkeypatch.setattr(console, 'check_png', lambda: None)
    heard: list[Job] = []
    one_by_one = fleet.run_job
    monkeypatch.setattr(fleet, 'run_job', lambda job: heard.append(job) or one_by_one(job))
    calibrations = ['--calibration', str(folder / 'a.npz'), '--calibration', str(folder / 'b.npz')]
    page = tmp_path / 'page.html'
    code = main(
        ['replay', str(folder / 'part_0.npz'), 'missing', *calibrations, '--jobs', '1', '--json',
         '--report', str(page), '--png', str(tmp_path / 'png')]
    )  # fmt: skip
    assert code == 1
    assert len(heard) == 2
    first, *_ = json.loads(capsys.readouterr().out)
    text = page.read_text('utf-8')
    assert 'ridge, a' in text
    assert 'ridge, b' in text
    assert f'>{first["place mean (mm)"]:.2f}<' in text
    assert 'Left out: missing does not exist' in text
    assert taken[:2] == [
        'part_0_npz_where_on_the_pad_it_errs.png', 'part_0_npz_how_far_off_the_place_is.png'
    ]  # fmt: skip


def test_the_installed_command_works_in_processes(folder: Path, tmp_path: Path) -> None:
    script = tmp_path / 'tactile'
    text = (ROOT / 'bootstrap' / 'executable.in').read_text()
    text = text.replace('@Python3_EXECUTABLE@', sys.executable).replace('@module@', 'cli')
    script.write_text(text)
    names = [str(folder / f'part_{i}.npz') for i in (0, 1)]
    done = subprocess.run(
        ['/bin/sh', str(script), 'replay', *names, '--calibration', str(folder / 'a.npz'),
         '--jobs', '2', '--json'],
        capture_output=True, text=True, check=False,
        env={**os.environ, 'PYTHONPATH': str(ROOT)},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert [row['recording'] for row in json.loads(done.stdout)] == [
        'part_0.npz', 'part_1.npz', 'all',
    ]  # fmt: skip
    assert '[2/2]' in done.stderr


@pytest.mark.parametrize(
    'words', [('--tolerance', 'nan'), ('--tolerance', '-1'), ('--delay', '1e300')]
)
def test_replay_refuses_a_time_that_cannot_be(folder: Path, words: tuple[str, str]) -> None:
    with pytest.raises(SystemExit) as stopped:
        main(['replay', 'x', '--calibration', str(folder / 'a.npz'), *words])
    assert stopped.value.code == 2


def test_a_terminal_shows_a_bar(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip('rich')
    monkeypatch.setattr(sys.stderr, 'isatty', lambda: True)
    with Progress(2) as progress:
        progress.step('one')
        progress.step('two', 'it is empty')
    said = capsys.readouterr().err
    assert 'two failed: it is empty' in said
    assert '[1/2]' not in said


def test_a_single_step_says_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    with Progress(1) as progress:
        progress.step('one')
    assert capsys.readouterr().err == ''
