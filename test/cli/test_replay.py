# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""`tactile replay` on several recordings and calibrations."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tactile_ros.cli import console
from tactile_ros.cli.main import main
from tactile_ros.evaluation import figures, fleet
from tactile_ros.evaluation.fleet import Job
from tactile_ros.evaluation.report import figure_text

ROOT = Path(__file__).parents[2]
TWO = ['--calibration', 'a.npz', '--calibration', 'b.npz', '--jobs', '1', '--json']
pytestmark = pytest.mark.usefixtures('there')


def test_several_are_compared_in_one_table_and_saved(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    saved = tmp_path / 'out' / 'compared'
    code = main(['replay', 'part_0.npz', 'part_1.npz', 'missing', *TWO, '--save', str(saved)])
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
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    drawn: list[str] = []
    monkeypatch.setattr(figures, 'write_png', lambda path, _: drawn.append(path.name) or path)
    monkeypatch.setattr(console, 'check_png', lambda: None)
    heard: list[Job] = []
    one_by_one = fleet.run_job
    monkeypatch.setattr(fleet, 'run_job', lambda job: heard.append(job) or one_by_one(job))
    page = tmp_path / 'page.html'
    pages = ['--report', str(page), '--png', str(tmp_path / 'png')]
    assert main(['replay', 'part_0.npz', 'missing', *TWO, *pages]) == 1
    assert len(heard) == 2
    first, *_ = json.loads(capsys.readouterr().out)
    text = page.read_text('utf-8')
    assert 'ridge, a' in text
    assert 'ridge, b' in text
    assert f'>{figure_text(first["place mean (mm)"])}<' in text
    assert 'Left out: missing does not exist' in text
    names = ('is_something_touching', 'where_on_the_pad_it_errs', 'how_far_off_the_place_is')
    assert drawn[:3] == [f'part_0_npz_{name}.png' for name in names]


def test_the_installed_command_works_in_processes(tmp_path: Path) -> None:
    script = tmp_path / 'tactile'
    text = (ROOT / 'bootstrap' / 'executable.in').read_text()
    text = text.replace('@Python3_EXECUTABLE@', sys.executable).replace('@module@', 'cli')
    script.write_text(text)
    done = subprocess.run(
        ['/bin/sh', str(script), 'replay', 'part_0.npz', 'part_1.npz', '--calibration', 'a.npz',
         '--jobs', '2', '--json'],
        capture_output=True, text=True, check=False,
        env={**os.environ, 'PYTHONPATH': str(ROOT)},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert [row['recording'] for row in json.loads(done.stdout)] == [
        'part_0.npz', 'part_1.npz', 'all',
    ]  # fmt: skip
    assert '[2/2]' in done.stderr


def test_replay_names_what_it_leaves_out_and_why_it_shows_no_error(
    capsys: pytest.CaptureFixture[str],
) -> None:
    command = ['--calibration', 'a.npz', '--jobs', '1']
    assert main(['replay', 'slip', 'part_0.npz', *command]) == 1
    printed = capsys.readouterr()
    assert 'left out: slip has (10, 3) taxels and channels' in printed.err
    assert 'ridge' in printed.out
    for flags in ([], ['--json']):
        assert main(['replay', 'normal_1', *command, *flags]) == 0
        printed = capsys.readouterr()
        why = 'normal_1: ridge has no error: it estimates position, truth has force_z'
        assert why in (printed.err if flags else printed.out)
        assert not flags or json.loads(printed.out)


@pytest.mark.parametrize(
    'words', [('--tolerance', 'nan'), ('--tolerance', '-1'), ('--delay', '1e300')]
)
def test_replay_refuses_a_time_that_cannot_be(words: tuple[str, str]) -> None:
    with pytest.raises(SystemExit) as stopped:
        main(['replay', 'x', '--calibration', 'a.npz', *words])
    assert stopped.value.code == 2
