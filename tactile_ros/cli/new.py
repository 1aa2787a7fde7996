# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Begin a sensor of your own: one file that works at once with a simulated board.

The board prints a line of counts for each frame (--lines), or sends the framed protocol of
docs/serial_protocol.md. Nothing that exists is written over. docs/adding_a_sensor.md explains the
parts of the file.

example:
  tactile new my_pad --taxels 4x4 --lines
  tactile new my_jaw --taxels 8x9
"""

from __future__ import annotations

import argparse
import importlib.util
import keyword
import os
import re
import shlex
from pathlib import Path
from string import Template

from tactile_ros.cli.console import refuse_unwritable
from tactile_ros.errors import TactileError, plain
from tactile_ros.files import temporary_folder, write_atomically
from tactile_ros.sensors import list_sensors
from tactile_ros.sensors.registry import ALIASES

FOLDER = Path('my_sensors')
KEY = re.compile(r'[a-z][a-z0-9]*(_[a-z0-9]+)*')
LONGEST_KEY, MOST_TAXELS = 40, 256
BAUDS = ((28, 115_200), (249, 1_000_000), (MOST_TAXELS, 2_000_000))  # carry 80 lines a second


def shape(text: str) -> tuple[int, int]:
    """Rows and columns, as in 4x4."""
    found = re.fullmatch(r'(\d{1,3})x(\d{1,3})', text)
    rows, columns = (int(found[1]), int(found[2])) if found else (0, 0)
    if not 1 <= rows * columns <= MOST_TAXELS:
        msg = f'must be ROWSxCOLUMNS, such as 4x4, of 1 to {MOST_TAXELS} taxels; received {text!r}'
        raise argparse.ArgumentTypeError(msg)
    return rows, columns


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `tactile new`."""
    parser.add_argument('key', metavar='KEY', help='name of the sensor, such as my_pad')
    parser.add_argument('--taxels', type=shape, required=True, metavar='RxC', help='rows, columns')
    parser.add_argument('--lines', action='store_true', help='the board prints text lines')
    parser.add_argument('--folder', type=Path, default=FOLDER, help=f'where it goes ({FOLDER})')


def run(options: argparse.Namespace) -> int:
    """Write the file and say what comes next."""
    key = options.key
    if not KEY.fullmatch(key) or keyword.iskeyword(key) or len(key) > LONGEST_KEY:
        msg = f'KEY must be like my_pad: a-z, 0-9, _, no word of Python, {LONGEST_KEY} at most'
        raise ValueError(f'{msg}; received {key!r}')
    taken = [*list_sensors(), *ALIASES]
    if key in taken or importlib.util.find_spec(f'tactile_ros.sensors.{key}'):
        raise ValueError(f'KEY must be a new name, none of {", ".join(taken)}; received {key!r}')
    place = options.folder / options.key
    if os.path.lexists(place):
        raise TactileError(f'{place} exists already; nothing is written over: name another KEY')
    rows, columns = options.taxels
    text = sensor(options.key, rows, columns, lines=options.lines)
    refuse_unwritable(place / '__init__.py')
    with temporary_folder(place) as fresh:
        write_atomically(fresh / '__init__.py', text.encode())
    print(plain(f'{place / "__init__.py"}'))
    known = [str(options.folder.resolve()), os.environ.get('TACTILE_SENSORS', '')]
    print('next:')
    print(f'  export TACTILE_SENSORS={shlex.quote(os.pathsep.join(filter(None, known)))}')
    print(f'  tactile view --sensor {options.key}')
    print(f'  tactile doctor --sensor {options.key} --port /dev/ttyACM0')
    return 0


def sensor(key: str, rows: int, columns: int, *, lines: bool) -> str:
    """Text of the file."""
    name = key.title().replace('_', '')
    baud = next(baud for most, baud in BAUDS if rows * columns <= most)
    framed = '\nfrom tactile_ros.devices.framed_protocol import Payload, taxel_matrix'
    template = _template('lines' if lines else 'frames')
    connection = template.substitute(name=name, baud=f'{baud:_}')
    return _template('sensor').substitute(
        key=key, name=name, rows=rows, columns=columns, connection=connection,
        kind='LineConnection' if lines else f'FramedConnection{framed}',
        transport='serial: text lines' if lines else 'serial: framed protocol, taxels of 10 bits',
    )  # fmt: skip


def _template(part: str) -> Template:
    return Template(Path(__file__).with_name(f'new_{part}.txt').read_text('utf-8'))
