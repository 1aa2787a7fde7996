# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""`tactile design`: a sensor's own module is found, asked and printed."""

import json
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

import tactile_ros.sensors
from tactile_ros.cli.main import main
from tactile_ros.sensors import load_sensor

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
    parser.add_argument('--gap', type=float, default=1.0, help='from magnet to chip (mm)')


def tables(config, options):
    if options.gap <= 0:
        raise ValueError(f'gap of tiny_pad must be above 0 mm; received {options.gap}')
    rows = ((options.gap, np.float64(config.rate_hz), None), (2 * options.gap, np.nan, 'far'))
    columns = ('gap (mm)', 'rate (Hz)', 'said')
    return [Table('gaps', columns, rows, ('wide gaps are weak',)), Table('none', ('a',), ())]
'''


@pytest.fixture(autouse=True)
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


def test_tables_are_printed_with_their_notes(
    home: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    load_sensor('tiny_pad')
    assert 'tactile_ros.sensors.tiny_pad.design' not in sys.modules  # read when it is asked for
    assert main(['design', 'tiny_pad', '--gap', '3']) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[1] == 'gaps'
    assert lines[2].split('  ') == ['gap (mm)', 'rate (Hz)', 'said']
    assert [line.split() for line in lines[4:6]] == [['3', '100', '-'], ['6', '-', 'far']]
    assert lines[6] == '  wide gaps are weak'
    assert 'none' in lines
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


@pytest.mark.parametrize(
    ('arguments', 'words'),
    [
        (['no_such'], 'sensor must be one of five_wire_skin'),
        (['reskin_board'], "tiny_pad); received 'reskin_b"),
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
    assert words in said
    assert not printed.out


@pytest.mark.parametrize(('words', 'code'), [(['--help'], 0), (['--pag', '1'], 2)])
def test_arguments_are_those_of_the_sensor(
    words: list[str], code: int, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as stop:
        main(['design', 'tiny_pad', *words])
    assert stop.value.code == code
    printed = capsys.readouterr()
    wanted = ('tactile design tiny_pad --gap 2', 'from magnet to chip (mm)', '--config')
    assert code or all(text in printed.out for text in wanted)
