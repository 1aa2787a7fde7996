# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""`tactile design`: a sensor's own module is found, asked and printed."""

from __future__ import annotations

import json
import sys
from typing import TYPE_CHECKING

import pytest

import tactile_ros.sensors
from tactile_ros.cli.main import main
from tactile_ros.sensors import designable, load_sensor

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

INIT = '''"""A board under another name."""
from dataclasses import replace
from tactile_ros.sensors.reskin_board import SENSOR as BOARD
SENSOR = replace(BOARD, key='tiny_pad')
'''
DESIGN = '''"""Choose the gap of a tiny pad.

example:
  tactile design tiny_pad --gap 2
"""
import numpy as np
from tactile_ros.types import Table


def add_arguments(parser):
    """Arguments of its own."""
    parser.add_argument('--gap', type=float, default=1.0, help='from magnet to chip (mm)')


def tables(config, options):
    """One table."""
    if options.gap <= 0:
        msg = f'gap of tiny_pad must be above 0 mm; received {options.gap}'
        raise ValueError(msg)
    rows = ((options.gap, np.float64(config.rate_hz), None), (2 * options.gap, np.nan, 'far'))
    columns = ('gap (mm)', 'rate (Hz)', 'said')
    return [Table('gaps', columns, rows, ('wide gaps are weak',)), Table('none', ('a',), ())]
'''


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A folder with a tiny sensor that can be designed."""
    folder = tmp_path / 'tiny_pad'
    folder.mkdir()
    (folder / '__init__.py').write_text(INIT)
    (folder / 'design.py').write_text(DESIGN)
    path = [*tactile_ros.sensors.__path__, str(tmp_path)]
    monkeypatch.setattr(tactile_ros.sensors, '__path__', path)
    yield tmp_path
    for name in [name for name in sys.modules if 'tiny_pad' in name]:
        del sys.modules[name]


@pytest.mark.usefixtures('home')
def test_tables_are_printed_with_their_notes(capsys: pytest.CaptureFixture[str]) -> None:
    assert 'tiny_pad' in designable()
    assert main(['design', 'tiny_pad', '--gap', '3']) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[1] == 'gaps'
    assert lines[2].split('  ') == ['gap (mm)', 'rate (Hz)', 'said']
    assert lines[4].split() == ['3', '100', '-']
    assert lines[5].split() == ['6', '-', 'far']
    assert lines[6] == '  wide gaps are weak'
    assert 'none' in lines


def test_json_holds_the_same(home: Path, capsys: pytest.CaptureFixture[str]) -> None:
    config = home / 'c.yaml'
    config.write_text('rate_hz: 50.0\n')
    assert main(['design', 'tiny_pad', '--json', '--config', str(config)]) == 0
    gaps, none = json.loads(capsys.readouterr().out)
    assert gaps['rows'] == [
        {'gap (mm)': 1.0, 'rate (Hz)': 50.0, 'said': None},
        {'gap (mm)': 2.0, 'rate (Hz)': None, 'said': 'far'},
    ]
    assert gaps['notes'] == ['wide gaps are weak']
    assert none == {'title': 'none', 'rows': [], 'notes': []}


@pytest.mark.usefixtures('home')
@pytest.mark.parametrize(
    ('arguments', 'words'),
    [
        (['no_such'], 'sensor must be one of five_wire_skin'),
        (['reskin_board'], "must be one that can be designed (.*tiny_pad); received 'reskin_b"),
        (['tiny_pad', '--gap', '0'], 'gap of tiny_pad must be above 0 mm; received 0.0'),
        (['tiny_pad', '--config', 'none.yaml'], 'config none.yaml must be a yaml file'),
    ],
)
def test_what_is_wrong_is_one_sentence(
    arguments: list[str], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(['design', *arguments]) == 2
    printed = capsys.readouterr()
    (said,) = printed.err.strip().splitlines()
    assert said.startswith('tactile design: ')
    assert all(part in said for part in words.split('.*'))
    assert not printed.out


@pytest.mark.usefixtures('home')
def test_help_is_that_of_the_sensor(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stop:
        main(['design', 'tiny_pad', '--help'])
    assert stop.value.code == 0
    told = capsys.readouterr().out
    assert 'tactile design tiny_pad --gap 2' in told
    assert 'from magnet to chip (mm)' in told
    assert '--config' in told
    with pytest.raises(SystemExit) as stop:
        main(['design', 'tiny_pad', '--pag', '1'])
    assert stop.value.code == 2


@pytest.mark.usefixtures('home')
def test_a_design_is_read_only_when_it_is_asked_for() -> None:
    spec = load_sensor('tiny_pad')
    assert 'tactile_ros.sensors.tiny_pad.design' not in sys.modules
    spec.design()
    assert 'tactile_ros.sensors.tiny_pad.design' in sys.modules


@pytest.mark.parametrize('key', designable())
def test_designs_of_the_package_print(key: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(['design', key, '--json']) == 0
    tables = json.loads(capsys.readouterr().out)
    assert all(table['title'] and table['rows'] for table in tables)
