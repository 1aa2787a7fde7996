# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""The command line as a user meets it: figures out, sentences for what is wrong."""

from __future__ import annotations

import argparse
import dataclasses
import importlib
import json
import os
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

from benchmarks.harness.rows import BenchResult, Row
from tactile_ros.cli import bench, console, demo
from tactile_ros.cli.console import read_config
from tactile_ros.cli.main import COMMANDS, main, sentence
from tactile_ros.errors import TactileError
from tactile_ros.evaluation.recording_files import load_recording, save_recording
from tactile_ros.files import MOST_YAML_BYTES
from tactile_ros.sensors import load_sensor

BENCHES = ', '.join(
    sorted(path.stem for path in (Path(__file__).parents[2] / 'benchmarks').glob('[!_]*.py'))
)


@pytest.fixture(scope='module')
def board_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A small recording of the real board with truth."""
    path = tmp_path_factory.mktemp('recordings') / 'small.npz'
    spatial = load_sensor('reskin_board').recordings()['spatial']
    rows = np.flatnonzero(~spatial.tare & (spatial.truth['position'][:, 0] > 0.0115))
    save_recording(spatial.select(np.sort(np.r_[rows - 1, rows])), path)
    return path


@pytest.fixture(scope='module')
def calibration(board_file: Path) -> Path:
    path = board_file.with_name('calibration.npz')
    command = ['calibrate', 'reskin_board', str(board_file), '-o', str(path)]
    assert main([*command, '--estimator', 'grid_knn', '--json']) == 0
    return path


@pytest.mark.parametrize('name', [name for name in COMMANDS if name != 'design'])
def test_an_unknown_option_is_answered_by_its_command(
    name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    needed = {
        'calibrate': ['reskin_board', 'a.npz', '-o', 'c.npz'],
        'calibration': ['show', 'c.npz'], 'new': ['my_pad', '--taxels', '4x4'],
        'enrol': ['mug'], 'record': ['-o', 'bag'], 'bench': ['replay'],
        'export': ['bag', '--csv', 'out'],
        'replay': ['bag', '--calibration', 'c.npz'], 'compare': ['a.npz', 'b.npz'],
    }  # fmt: skip
    with pytest.raises(SystemExit) as stop:
        main([name, *needed.get(name, []), '--nonsense'])
    assert stop.value.code == 2
    said = capsys.readouterr().err
    assert f'tactile {name}: error: unrecognized arguments: --nonsense' in said
    assert f'usage: tactile {name}' in said


def test_calibrate_prints_errors_of_held_out_groups(
    board_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / 'c.npz'
    command = ['calibrate', 'reskin_board', str(board_file), '-o', str(out)]
    assert main([*command, '--estimator', 'ridge', '--json']) == 0
    (row,) = json.loads(capsys.readouterr().out)
    assert row['target'] == 'position_xy'
    assert row['groups'] > 30  # places, of which two fifths are held out
    assert 0.0005 < row['held-out mean'] < 0.01
    assert out.exists()


def test_calibrate_says_what_it_left_out(
    board_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    recording = load_recording(board_file)
    values = recording.values.copy()
    values[:, 4] = np.nan  # a dead chip
    values[11, 0] = np.nan
    path, out = tmp_path / 'hurt.npz', tmp_path / 'c.npz'
    save_recording(dataclasses.replace(recording, values=values), path)
    command = ['calibrate', 'reskin_board', str(path), '-o', str(out), '--estimator', 'ridge']
    assert main([*command, '--json']) == 0
    printed = capsys.readouterr()
    assert [row['target'] for row in json.loads(printed.out)] == ['position_xy']
    assert (
        printed.err.strip() == 'left out: 1 taxels faulty in every row; 1 rows with a faulty taxel'
    )
    few = tmp_path / 'few.npz'
    save_recording(recording.select(slice(0, 8)), few)
    out.unlink()
    assert main(['calibrate', 'reskin_board', str(few), '-o', str(out)]) == 1
    assert '; left out: 4 usable rows that tell position, which' in capsys.readouterr().err
    assert not out.exists()


@pytest.mark.parametrize(
    ('arguments', 'code', 'words'),
    [
        (
            ['calibrate', 'no_such', 'x', '-o', 'y'],
            2,
            'sensor must be one of five_wire_skin, gradiometer',
        ),
        (['calibrate', 'reskin_board', 'no_such', '-o', 'y'], 1, 'does not exist'),
        (['replay', 'x', '--calibration', 'no_such.npz'], 1, 'does not exist'),
        (['replay', 'x', '--calibration', 'c.npz', '--jobs', '0'], 2, '--jobs must be 1 or more'),
        (['bench', 'all', '--jobs', '-1'], 2, '--jobs must be 1 or more; received -1'),
        (['view', 'no_such'], 1, 'no_such does not exist; name a bag, .npz or .csv'),
        (['view', '--sensor', 'no_such'], 2, 'sensor must be one of five_wire_skin, gradiometer'),
        (['bench', 'no_such'], 2, f"all or one of {BENCHES}; received 'no_such'"),
    ],
)
def test_what_is_wrong_is_one_sentence(
    arguments: list[str], code: int, words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(arguments) == code
    printed = capsys.readouterr()
    (said,) = printed.err.strip().splitlines()
    assert words in said
    assert not printed.out


@pytest.mark.ros
def test_record_makes_a_bag_and_says_that_nothing_came(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = tmp_path / 'bag'
    assert main(['record', '-o', str(bag), '--seconds', '0.1']) == 1
    assert f'{bag} is empty, nothing was heard in /:' in capsys.readouterr().err
    assert (bag / 'metadata.yaml').is_file()
    assert main(['record', '-o', str(bag)]) == 2
    assert 'exists already' in capsys.readouterr().err


@pytest.mark.ros
def test_record_says_where_the_bag_is(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr('tactile_ros.cli.record.refuse_empty', lambda *_: None)
    bag = tmp_path / 'bag'
    assert main(['record', '-o', str(bag), '--seconds', '0.1']) == 0
    assert capsys.readouterr().out.splitlines()[-1] == f'bag: {bag}'


def test_record_that_cannot_begin_fails(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / 'file').touch()
    monkeypatch.setattr('tactile_ros.cli.record.Running', lambda *_, **__: pytest.fail('started'))
    assert main(['record', '-o', str(tmp_path / 'file' / 'bag')]) == 1
    assert 'file/bag cannot be written: Not a directory' in capsys.readouterr().err


def test_calibrate_refuses_truth_that_nothing_learns(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, few = tmp_path / 'c.npz', tmp_path / 'few.npz'
    pulls = load_sensor('reskin_board').recordings()['slip']
    save_recording(pulls.select(slice(0, 600)), few)  # two pulls, both of which slip
    assert main(['calibrate', 'reskin_board', str(few), '-o', str(out)]) == 1
    said = capsys.readouterr().err
    assert f'nothing in {few} can be learned: truth has repetition, slip' in said
    assert not out.exists()


def test_calibrate_learns_slip(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / 'c.npz'
    assert main(['calibrate', 'reskin_board', 'slip', '-o', str(out)]) == 0
    said = capsys.readouterr().out
    assert 'matched_subspace' in said
    assert 'of 68 missed' in said
    assert 'slip' in load_sensor('reskin_board').load(out).estimators


@pytest.mark.parametrize('place', ['', 'file/below/c.npz', 'file/c.npz'])
@pytest.mark.parametrize(
    'command',
    [
        ['calibrate', 'reskin_board', 'spatial', '-o'],
        ['replay', 'spatial', '--calibration', 'CALIBRATION', '--report'],
        ['replay', 'spatial', '--calibration', 'CALIBRATION', '--save'],
        ['bench', 'roads', '--results'],
    ],
    ids=lambda command: command[0],
)
def test_what_cannot_be_written_is_refused_before_the_work(
    command: list[str],
    place: str,
    calibration: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def work(*_: object) -> None:
        pytest.fail('work was begun')

    for name in ('calibrate.find', 'replay.fleet.run_jobs', 'bench.show'):
        monkeypatch.setattr(f'tactile_ros.cli.{name}', work)
    (tmp_path / 'file').touch()
    (tmp_path / 'roads.json').mkdir()
    words = [str(calibration) if word == 'CALIBRATION' else word for word in command]
    assert main([*words, str(tmp_path / place)]) == 1
    printed = capsys.readouterr()
    assert str(tmp_path) in printed.err
    assert 'Errno' not in printed.err
    assert not printed.out
    assert {path.name for path in tmp_path.iterdir()} == {'file', 'roads.json'}


def test_a_failure_of_the_system_is_told_without_its_number() -> None:
    assert sentence(FileNotFoundError(2, 'No such file', 'a', None, 'b')) == 'a: b: No such file'
    assert sentence(OSError(28, 'No space left on device')) == 'No space left on device'
    assert sentence(OSError('of its own')) == 'of its own'


def test_without_benches_the_other_commands_work(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr('tactile_ros.cli.bench.folder', lambda: None)
    assert main(['list']) == 0
    capsys.readouterr()
    assert main(['bench', 'all']) == 1
    (said,) = capsys.readouterr().err.splitlines()
    assert 'the benches are not installed' in said


@pytest.mark.parametrize(
    ('other', 'words'),
    [('no_such', 'no_such does not exist'), ('slip', 'slip has (10, 3) taxels and channels')],
)
def test_replay_names_what_it_leaves_out(
    other: str,
    words: str,
    board_file: Path,
    calibration: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    command = ['replay', other, str(board_file), '--calibration', str(calibration)]
    assert main(command) == 1
    printed = capsys.readouterr()
    assert f'left out: {words}' in printed.err
    assert 'grid_knn' in printed.out


@pytest.mark.parametrize('flags', [[], ['--json']])
def test_replay_says_why_it_shows_no_error(
    flags: list[str], calibration: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ['replay', 'normal_1', '--calibration', str(calibration), *flags]
    assert main(command) == 0
    printed = capsys.readouterr()
    said = printed.err if flags else printed.out
    assert 'normal_1: grid_knn has no error: it estimates position, truth has force_z' in said
    assert not flags or json.loads(printed.out)


def test_config_yaml_changes_fields_and_refuses_others(tmp_path: Path) -> None:
    spec = load_sensor('reskin_board')
    path = tmp_path / 'board.yaml'
    path.write_text('rate_hz: 250.0\nsaturation: [0.0066, 0.0066, 0.0106]\n')
    config = read_config(spec, path)
    assert config.rate_hz == 250.0
    path.write_text('rate_hz: 2.5e2\n')  # a text, says yaml
    assert read_config(spec, path).rate_hz == 250.0
    assert np.allclose(config.saturation, [0.0066, 0.0066, 0.0106])
    refused = {
        'nonsense: 1\n': "must map .*rate_hz.*received .'nonsense'",
        '- 1\n': r'must map .*received \[1\]',
        '!!python/object/apply:os.system ["true"]\n': 'is no plain yaml',
        'rate_hz: [1.0, 2.0]\n': 'rate_hz of ReskinBoardConfig must be a number from',
        'rate_hz: fast\n': 'rate_hz of ReskinBoardConfig must be a number from .*received fast',
        'positions: far\n': 'positions of ReskinBoardConfig must be numbers',
        'positions: [[1, 2], [3]]\n': r'config .*board.yaml: ',
        '#' * (MOST_YAML_BYTES + 1): f'at most {MOST_YAML_BYTES} bytes',
    }
    for text, words in refused.items():
        path.write_text(text)
        with pytest.raises(ValueError, match=words):
            read_config(spec, path)


def test_a_config_that_is_missing_is_named(tmp_path: Path) -> None:
    spec = load_sensor('reskin_board')
    for path in (tmp_path, tmp_path / 'none.yaml'):
        with pytest.raises(ValueError, match=rf'config {path} must be a yaml file; there is none'):
            read_config(spec, path)


def test_parts_of_the_demo_share_no_group() -> None:
    place, normal, shear = demo.parts(seed=0)
    for part, key in ((place, 'position'), (normal, 'session'), (shear, 'repetition')):
        seen = {str(x) for x in part.train.truth[key][~part.train.tare]}
        played = {str(x) for x in part.played.truth[key][~part.played.tare]}
        assert played
        assert not seen & played, part.name
        assert part.played.tare[0]


def test_a_demo_replaces_only_what_a_demo_made(tmp_path: Path) -> None:
    for name in ('bags', 'mine'):
        (tmp_path / name).mkdir()
        (tmp_path / name / 'file').write_text('x')
    before = sorted(tmp_path.rglob('*'))
    with (
        pytest.raises(TactileError, match='holds files and no demo made it'),
        demo.results(tmp_path, overwrite=False),
    ):
        pytest.fail('taken')
    assert sorted(tmp_path.rglob('*')) == before
    for number in ('1', '2'):  # what stops half way changes nothing
        with suppress(ZeroDivisionError), demo.results(tmp_path, overwrite=True) as made:
            (made / 'bags').mkdir()
            1 / 0  # noqa: B018
        with demo.results(tmp_path, overwrite=number == '1') as made:
            (made / 'bags').mkdir()
            (made / 'bags' / 'file').write_text(number)
            (made / 'report.html').write_text(number)
        assert (tmp_path / 'bags' / 'file').read_text() == number
        assert (tmp_path / 'report.html').read_text() == number
        names = {path.name for path in tmp_path.iterdir()}
        assert names == {'bags', 'mine', 'report.html', demo.MARK}


def test_results_of_sensors_lie_apart(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(demo, 'run_twin', lambda _, made, *__, **___: list(made.iterdir()))
    for sensor in ('gradiometer', 'taxel_array', 'gradiometer'):
        assert main(['demo', '--sensor', sensor]) == 0
    made = sorted(path.name for path in (tmp_path / 'out' / 'demo').iterdir())
    assert made == ['gradiometer', 'taxel_array']


def test_files_of_others_are_replaced_on_request_alone(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mine = tmp_path / 'mine.npz'
    mine.write_text('of mine')
    command = ['calibrate', 'reskin_board', 'normal_1', '--estimator', 'ridge', '-o', str(mine)]
    assert main(command) == 1
    assert 'was not written by this command' in capsys.readouterr().err
    assert mine.read_text() == 'of mine'
    assert main([*command, '--overwrite']) == 0
    assert main(command) == 0  # its own
    page = tmp_path / 'mine.html'
    page.write_text('<p>of mine</p>')
    replay = ['replay', 'normal_2', '--calibration', str(mine)]
    assert main([*replay, '--report', str(page)]) == 1
    (tmp_path / 'mine.json').write_text('{}')
    assert main([*replay, '--save', str(tmp_path / 'mine')]) == 1
    assert (tmp_path / 'mine.json').read_text() == '{}'
    assert page.read_text() == '<p>of mine</p>'
    assert main([*replay, '--report', str(page), '--overwrite']) == 0
    assert main([*replay, '--report', str(page)]) == 0


def test_the_list_of_commands_says_what_each_one_does() -> None:
    for name, summary in COMMANDS.items():
        module = importlib.import_module(f'tactile_ros.cli.{name}')
        assert (module.__doc__ or '').split('\n')[0] == summary


def test_the_version_is_told_at_once() -> None:
    code = 'from tactile_ros.cli.main import main; import sys\ntry: main(["--version"])\n'
    code += 'except SystemExit: sys.exit(len({"numpy", "rclpy", "scipy"} & set(sys.modules)))'
    assert subprocess.run([sys.executable, '-c', code], check=False).returncode == 0


@pytest.mark.parametrize(
    ('words', 'meant'),
    [(['replya'], 'did you mean replay?'), (['demo', '--sensor', 'eflsh'], 'did you mean eflesh')],
)
def test_a_slip_of_the_keys_is_understood(
    words: list[str], meant: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with suppress(SystemExit):
        assert main(words) == 2
    assert meant in capsys.readouterr().err
    assert load_sensor('anyskin').key == load_sensor('eflesh').key == 'reskin_board'


def test_benches_side_by_side_tell_the_first_failure(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    options = argparse.Namespace(jobs=2, figures=None)
    assert bench._side_by_side(['no_such', 'none'], 'quick', tmp_path, options) == 2
    printed = capfd.readouterr()
    assert "received 'no_such'" in printed.err
    assert "received 'none'" in printed.err
    assert '2 benches ran at a time' in printed.out


def test_latency_is_measured_after_the_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def run(command: list[str], **_: object) -> subprocess.CompletedProcess[str]:
        return subprocess.CompletedProcess(command, 0, f'{command[4]}\n')

    monkeypatch.setattr(bench.subprocess, 'run', run)
    options = argparse.Namespace(jobs=1, figures=None)
    chosen = ['fidelity', 'latency', 'reskin', 'roads']
    assert bench._side_by_side(chosen, 'normal', tmp_path, options) == 0
    printed = capsys.readouterr().out.split('\n')
    assert printed[:4] == ['reskin', 'fidelity', 'roads', 'latency']
    assert bench._side_by_side(chosen, 'quick', tmp_path, options) == 0
    assert capsys.readouterr().out.split('\n')[:4] == ['reskin', 'fidelity', 'latency', 'roads']


def test_benches_as_json_are_alone_on_stdout(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    class Made:
        @staticmethod
        def run(extent: str, command: str) -> BenchResult:
            return BenchResult('roads', command, [1], [Row(f'of {extent}', 'mm', 1.0, aim=0.5)])

    monkeypatch.setattr(bench, 'load_bench', lambda _: Made)
    words = ['bench', 'roads', '--quick', '--json', '--results', str(tmp_path)]
    assert main(words) == 0
    (told,) = json.loads(capsys.readouterr().out)
    assert told == json.loads((tmp_path / 'roads.json').read_text())
    assert told['rows'][0]['what'] == 'of quick'


def test_nobody_reads_what_is_printed() -> None:
    code = 'import sys; from tactile_ros.cli.main import main; sys.exit(main(["list", "--quiet"]))'
    with subprocess.Popen(
        [sys.executable, '-c', code], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as process:
        process.stdout.close()
        assert process.stderr.read() == b''
        assert process.wait() == 141


def test_main_says_in_a_sentence_that_standard_output_is_closed() -> None:
    code = 'import sys; from tactile_ros.cli.main import main; sys.exit(main(["list", "--quiet"]))'
    done = subprocess.run(
        ['/bin/sh', '-c', f"{sys.executable} -c '{code}' >&-"], capture_output=True, text=True,
        check=False,
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (1, 'tactile: standard output is closed\n')


def test_main_spells_control_characters_out(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(['calibrate', 'reskin_board', 'a\x1b[31mb', '-o', 'x.npz']) == 1
    assert capsys.readouterr().err.startswith('tactile calibrate: a\\x1b[31mb does not exist')


@pytest.mark.parametrize('namespace', ['../x', 'a\x1b[31mb', 'a' * 5000, '1a', 'a b'])
def test_record_refuses_a_namespace_that_ros_would_not_take(
    namespace: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(['record', '-o', str(tmp_path / 'bag'), '--namespace', namespace]) == 2
    said = capsys.readouterr().err
    assert said.startswith('tactile record: namespace must be at most 200 letters')
    assert '\x1b' not in said
    assert len(said) < 250
    assert not (tmp_path / 'bag').exists()


def test_a_report_without_anything_to_draw_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(console, 'check_png', lambda: None)
    BenchResult('plain', 'tactile bench plain', [0], [Row('one figure', 'mm', 1.0)]).write(
        tmp_path
    )
    assert main(['report', str(tmp_path), '--png', str(tmp_path / 'png')]) == 0
    assert 'no picture: these results have nothing to draw' in capsys.readouterr().err


def test_benches_beside_each_other_hear_their_own_nodes_alone(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv('ROS_DOMAIN_ID', '95')
    names = bench.names()
    domains = [int(bench.domain_of(name, names)['ROS_DOMAIN_ID']) for name in names]
    assert len(set(domains)) == len(names)
    assert 0 <= min(domains) <= max(domains) < 102
    monkeypatch.delenv('ROS_DOMAIN_ID')
    assert bench.domain_of(names[0], names)['ROS_DOMAIN_ID'] == '1'


def test_tab_completes_commands(tmp_path: Path) -> None:
    pytest.importorskip('argcomplete')
    asked = {
        '_ARGCOMPLETE': '1', '_ARGCOMPLETE_IFS': ' ', 'COMP_LINE': 'tactile rep',
        'COMP_POINT': '11', '_ARGCOMPLETE_STDOUT_FILENAME': str(tmp_path / 'answer'),
    }  # fmt: skip
    code = 'from tactile_ros.cli.main import main; main()'
    subprocess.run([sys.executable, '-c', code], env={**os.environ, **asked}, check=False)
    assert (tmp_path / 'answer').read_text().split() == ['replay', 'report']
