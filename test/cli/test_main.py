# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Entry of the command line: refusals, guesses, silence, settings of a folder, Ctrl-C."""

import argparse
import importlib
import json
import os
import select
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from reference.help_examples import examples
from tactile_ros.cli import console
from tactile_ros.cli import main as entry
from tactile_ros.cli.main import COMMANDS, main, parser, sentence, with_guess, with_settings

ENTRY = 'from tactile_ros.cli.main import main; import sys; sys.exit(main(sys.argv[1:]))'


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working folder."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_every_command_has_its_summary_and_takes_quiet() -> None:
    top = parser()
    assert isinstance(top, argparse.ArgumentParser)
    for name, own in top._subparsers._group_actions[0].choices.items():  # type: ignore[union-attr]
        module = importlib.import_module(f'tactile_ros.cli.{name}')
        assert (module.__doc__ or '').split('\n')[0] == COMMANDS[name]
        assert '--quiet' in own.format_help()


@pytest.mark.parametrize('name', [name for name in COMMANDS if name != 'design'])
def test_an_unknown_option_is_answered_by_its_command(
    name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    example = next(line for line in examples() if line.startswith(f'tactile {name}'))
    with pytest.raises(SystemExit) as stop:
        main([*example.split()[1:], '--nonsense'])
    assert stop.value.code == 2
    said = capsys.readouterr().err
    assert f'tactile {name}: error: unrecognized arguments: --nonsense' in said
    assert f'usage: tactile {name}' in said


@pytest.mark.parametrize(
    ('arguments', 'code', 'words'),
    [
        (['calibrate', 'no_such', 'x', '-o', 'y'], 2, 'sensor must be one of five_wire_skin'),
        (['calibrate', 'reskin_board', 'no_such', '-o', 'y'], 1, 'does not exist'),
        (['calibrate', 'reskin_board', 'a\x1b[31mb', '-o', 'y'], 1, 'a\\x1b[31mb does not exist'),
        (['replay', 'x', '--calibration', 'no_such.npz'], 1, 'does not exist'),
        (['replay', 'x', '--calibration', 'c.npz', '--jobs', '0'], 2, '--jobs must be 1 or more'),
        (['bench', 'all', '--jobs', '-1'], 2, '--jobs must be 1 or more; received -1'),
        (['bench', 'no_such'], 2, "roads, taxel_array; received 'no_such'"),
        (['run', '--hand', 'no.yaml'], 2, 'no.yaml cannot be read: No such file or directory'),
        (['demo', '--sensor', 'eflsh'], 2, 'did you mean eflesh'),
    ],
)
def test_what_is_wrong_is_one_sentence(
    arguments: list[str], code: int, words: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(arguments) == code
    printed = capsys.readouterr()
    (said,) = printed.err.strip().splitlines()
    assert words in said
    assert not printed.out


@pytest.mark.parametrize(
    ('words', 'said'),
    [
        (['--foo'], '--foo is no command; there are list, doctor'),
        (['calibration', 'sho', 'x'], 'argument show: invalid choice'),
    ],
)
def test_wrong_words_are_named(
    words: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as stop:
        main(words)
    assert stop.value.code == 2
    assert said in capsys.readouterr().err


def test_a_failure_of_the_system_is_told_without_its_number() -> None:
    assert sentence(FileNotFoundError(2, 'No such file', 'a', None, 'b')) == 'a: b: No such file'
    assert sentence(OSError(28, 'No space left on device')) == 'No space left on device'
    assert sentence(OSError('of its own')) == 'of its own'
    assert len(sentence(ValueError('x' * 5_000_000))) < 2100


def test_sensors_of_the_user_fail_in_one_sentence(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv('TACTILE_SENSORS', f'{folder}{os.pathsep}{folder}/gone')
    assert main(['list']) == 2
    said = f'tactile list: TACTILE_SENSORS must name folders of sensors; {folder}/gone is none\n'
    assert capsys.readouterr().err == said
    assert main(['new', 'own_pad', '--taxels', '2x2', '--folder', f'{folder}/gone']) == 0
    (folder / 'gone' / 'own_pad' / '__init__.py').write_text('raise SystemExit(3)')
    monkeypatch.setattr('tactile_ros.sensors.__path__', [f'{folder}/gone'])
    assert main(['doctor', '--sensor', 'own_pad', '--simulated']) == 1
    assert 'sensor own_pad cannot be loaded (SystemExit: 3)' in capsys.readouterr().err


@pytest.mark.parametrize(
    ('words', 'guess'),
    [
        (['clibrate'], 'calibrate'),
        (['demo', 'grap'], 'grasp'),
        (['run', '--snsor', 'x'], '--sensor'),
        (['calibrate', 'anyskn', 'x', '-o', 'y'], 'anyskin'),
        (['calibrate', 'anyskin', 'spatal', '-o', 'y'], 'spatial'),
        (['calibration', 'shwo', 'x'], 'show'),
        (['doctor', '--sensor', 'eflesh', '--simulated', '--fault', 'fliped'], 'flipped'),
        (['doctor', '--sensor', 'eflesh', '--set', 'prt=x'], 'port'),
    ],
)
def test_a_wrong_word_is_answered_by_a_guess(
    words: list[str], guess: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    try:
        code = main(words)
    except SystemExit as stop:
        code = int(stop.code or 0)
    assert code in (1, 2)
    assert capsys.readouterr().err.strip().endswith(f'did you mean {guess}?')


def test_nothing_is_guessed_where_nothing_is_near() -> None:
    for said in ('x must be one of a, b; received 17', 'no such thing', 'a; did you mean b?',
                 "KEY must be none of reskin, x; received 'reskin'"):  # fmt: skip
        assert with_guess(said) == said
    said = 'unrecognized arguments: --sensr'  # dashes alone are no likeness
    assert with_guess(said, ['-h', '--help', '--quiet', '--json']) == said


def test_quiet_keeps_the_table_and_the_failure(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(console, 'PATIENCE_S', 0.0)
    doctor = ['doctor', '--sensor', 'gradiometer', '--simulated', '--json', '--seconds', '0.1']
    (folder / 'tactile.toml').write_text('sensor = "gradiometer"\n')
    assert main([*doctor, '--quiet']) in (0, 1)
    printed = capsys.readouterr()
    assert json.loads(printed.out)
    assert printed.err == ''
    assert main(['replay', 'x', '--calibration', 'none.npz', '--quiet']) == 1
    assert 'none.npz' in capsys.readouterr().err


@pytest.mark.parametrize(
    ('words', 'wanted'),
    [
        (['run'], ['run', '--sensor=own', '--port=/dev/p', '--calibration=c.npz']),
        (['run', '--simulated'], ['run', '--sensor=own', '--calibration=c.npz', '--simulated']),
        (['run', '--port', 'q'], ['run', '--sensor=own', '--calibration=c.npz', '--port', 'q']),
        (['run', '--sensor', 'x'], ['run', '--sensor', 'x']),
        (['run', '--sens=x'], ['run', '--sens=x']),
        (['view'], ['view', '--sensor=own', '--board=/dev/p', '--calibration=c.npz']),
        (['replay', 'b'], ['replay', '--calibration=c.npz', 'b']),
        (['replay', 'b', '--calibration', 'd'], ['replay', 'b', '--calibration', 'd']),
        (['list'], ['list']),
    ],
)
def test_a_file_sets_what_is_not_given(words: list[str], wanted: list[str], folder: Path) -> None:
    text = 'sensor = "own"\nport = "/dev/p"\ncalibration = "c.npz"\n'
    (folder / 'tactile.toml').write_text(text)
    assert with_settings(words) == wanted


def test_a_recording_that_is_named_is_shown_as_it_is(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / 'tactile.toml').write_text('sensor = "gradiometer"\n')
    assert entry.parse(parser('view'), ['view', 'my_bag']).sensor is None
    assert not capsys.readouterr().err
    assert entry.parse(parser('view'), ['view']).sensor == 'gradiometer'
    assert capsys.readouterr().err == 'set by tactile.toml: --sensor=gradiometer\n'
    (folder / 'tactile.toml').write_text('sensor = "\\u001b[31m"\n')
    entry.parse(parser('view'), ['view'])
    assert capsys.readouterr().err == 'set by tactile.toml: --sensor=\\x1b[31m\n'


@pytest.mark.parametrize(
    ('text', 'words'),
    [
        ('sensr = "x"', "must set texts, one of sensor, port, calibration; received 'sensr'"),
        ('port = 3', 'must set texts'), ('port = ""', 'must set texts'),
        ('[sensor]\na = "b"', 'must set texts'), ('sensor', 'must be plain TOML'),
        ('\udcff', 'must be plain TOML'), ('a = [' * 3000, 'must be plain TOML'),
        ('a = ' + '[' * 4000, 'must be plain TOML'),
        ('.'.join('a' * 4000) + ' = 1', "received 'a'"), ('"a\\nb" = 1', r"received 'a\nb' = 1"),
    ],
)  # fmt: skip
def test_a_file_that_sets_something_else_is_refused(
    text: str, words: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / 'tactile.toml').write_bytes(text.encode(errors='surrogateescape'))
    with pytest.raises(SystemExit) as stop:
        main(['doctor'])
    assert stop.value.code == 2
    assert words in capsys.readouterr().err


def test_without_tomllib_the_file_is_named_and_not_read(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    (folder / 'tactile.toml').write_text('sensor = "own"\n')
    monkeypatch.setitem(sys.modules, 'tomllib', None)
    assert with_settings(['run']) == ['run']
    assert 'tactile.toml is read by Python 3.11 or later alone' in capsys.readouterr().err


def test_the_version_costs_little() -> None:
    code = (
        'import os, subprocess, sys; before = os.times(); '
        'subprocess.run([sys.executable, "-m", "tactile_ros", "--version"], check=True); '
        'after = os.times(); print(after.children_user - before.children_user)'
    )
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, check=True)
    version, spent = done.stdout.split('\n')[:2]
    assert version.startswith('tactile_ros ')
    assert float(spent) < 0.3


def test_main_ends_where_nobody_reads_or_nothing_can_be_written() -> None:
    words = [sys.executable, '-c', ENTRY, 'list', '--quiet']
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        process.stdout.close()
        assert process.stderr.read() == b''
        assert process.wait() == 141
    closed = ['/bin/sh', '-c', f"{sys.executable} -c '{ENTRY}' list --quiet >&-"]
    done = subprocess.run(closed, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (1, 'tactile: standard output is closed\n')


@pytest.mark.parametrize(
    ('line', 'wanted'),
    [('tactile rep', ['replay', 'report']), ('tactile doctor --sensor grad', ['gradiometer'])],
)
def test_tab_completes_commands_and_sensors(line: str, wanted: list[str], tmp_path: Path) -> None:
    pytest.importorskip('argcomplete')
    asked = {
        '_ARGCOMPLETE': '1', '_ARGCOMPLETE_IFS': ' ', 'COMP_LINE': line,
        'COMP_POINT': str(len(line)), '_ARGCOMPLETE_STDOUT_FILENAME': str(tmp_path / 'answer'),
    }  # fmt: skip
    subprocess.run([sys.executable, '-c', ENTRY], env={**os.environ, **asked}, check=False)
    assert (tmp_path / 'answer').read_text().split() == wanted


ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.parametrize(
    ('words', 'after_s'),
    [
        ('list', 0.12), ('doctor --sensor reskin_board --simulated', 0.4), ('record -o bag', 0.5),
        ('demo --output demo', 0.9), ('calibrate reskin_board normal_1 -o c.npz', 0.8),
    ],
)  # fmt: skip
def test_interrupt_ends_a_command_in_one_line(words: str, after_s: float, tmp_path: Path) -> None:
    script = tmp_path / 'tactile'
    text = (ROOT / 'bootstrap' / 'executable.in').read_text()
    text = text.replace('@Python3_EXECUTABLE@', sys.executable).replace('@module@', 'cli')
    script.write_text(text)
    with subprocess.Popen(
        ['/bin/sh', str(script), *words.split()],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True,
        cwd=tmp_path, env={**os.environ, 'PYTHONPATH': str(ROOT)},
    ) as process:  # fmt: skip
        try:
            process.wait(after_s)  # the moment is the case
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGINT)
        _, said = process.communicate(timeout=120)
    assert process.returncode == 130
    assert 'Traceback' not in said
    assert said.splitlines()[-1] == 'tactile: interrupted'
    assert not list(tmp_path.rglob('*.part'))
    try:
        for _ in range(500):  # one that has ended stays until it is reaped
            os.killpg(process.pid, 0)
            select.select([], [], [], 0.02)
    except ProcessLookupError:
        return
    pytest.fail('a process of its group is left')


def test_interrupt_amid_the_imports_says_so() -> None:
    lines = (
        'import os, sys, types; from tactile_ros import cli; cli._started.append(os.getpid())',
        "sys.modules['tactile_ros.files'] = types.ModuleType('begun')",
        'cli._end()',
    )
    words = [sys.executable, '-c', '\n'.join(lines)]
    done = subprocess.run(words, capture_output=True, check=False)
    assert (done.returncode, done.stderr) == (130, b'tactile: interrupted\n')
