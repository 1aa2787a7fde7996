# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Entry of the command line: guesses, silence on request, settings of a working folder."""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tactile_ros.cli import console
from tactile_ros.cli import main as entry
from tactile_ros.cli.main import main, parser, settings, with_guess, with_settings


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working folder."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


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


def test_nothing_is_with_guess_where_nothing_is_near() -> None:
    for said in ('x must be one of a, b; received 17', 'no such thing', 'a; did you mean b?'):
        assert with_guess(said) == said


def test_an_interrupt_amid_the_imports_says_so() -> None:
    lines = (
        'import os, sys, types; from tactile_ros import cli; cli._started.append(os.getpid())',
        "sys.modules['tactile_ros.files'] = types.ModuleType('begun')",
        'cli._end()',
    )
    words = [sys.executable, '-c', '\n'.join(lines)]
    done = subprocess.run(words, capture_output=True, check=False)
    assert (done.returncode, done.stderr) == (130, b'tactile: interrupted\n')


def test_what_was_said_is_no_guess() -> None:
    assert 'mean' not in with_guess("KEY must be none of reskin, x; received 'reskin'")


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
        (['doctor'], ['doctor', '--sensor=own', '--port=/dev/p']),
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
    options = entry.parse(parser('view'), ['view', 'my_bag'])
    assert options.sensor is None
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
        ('port = 3', 'must set texts'),
        ('port = ""', 'must set texts'),
        ('[sensor]\na = "b"', 'must set texts'),
        ('sensor', 'must be plain TOML'),
        ('\udcff', 'must be plain TOML'),
        ('a = [' * 3000, 'must be plain TOML'),
        ('a = ' + '[' * 4000, 'must be plain TOML'),
        ('.'.join('a' * 4000) + ' = 1', "received 'a'"),
        ('"a\\nb" = 1', r"received 'a\nb' = 1"),
    ],
)
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
    assert settings() == {}
    assert 'tactile.toml is read by Python 3.11 or later alone' in capsys.readouterr().err


def test_times_of_a_busy_machine_are_doubted(capsys: pytest.CaptureFixture[str]) -> None:
    console.tell_if_busy(0.0)
    assert not capsys.readouterr().err
    console.tell_if_busy(1000.0)
    assert 'times mean little' in capsys.readouterr().err


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


def test_tab_completes_sensors(tmp_path: Path) -> None:
    pytest.importorskip('argcomplete')
    line = 'tactile doctor --sensor grad'
    asked = {
        '_ARGCOMPLETE': '1', '_ARGCOMPLETE_IFS': ' ', 'COMP_LINE': line,
        'COMP_POINT': str(len(line)), '_ARGCOMPLETE_STDOUT_FILENAME': str(tmp_path / 'answer'),
    }  # fmt: skip
    code = 'from tactile_ros.cli.main import main; main()'
    subprocess.run([sys.executable, '-c', code], env={**os.environ, **asked}, check=False)
    assert (tmp_path / 'answer').read_text().strip() == 'gradiometer'


def test_every_command_takes_quiet() -> None:
    top = parser()
    assert isinstance(top, argparse.ArgumentParser)
    for own in top._subparsers._group_actions[0].choices.values():  # type: ignore[union-attr]
        assert '--quiet' in own.format_help()
