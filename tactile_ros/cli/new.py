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

LINES = '''\
@dataclass(frozen=True)
class ${name}Connection(LineConnection):
    """A board that prints a line such as "12,0,513,..." for each frame, row by row."""

    baud: int = fields.whole($baud, 'baud rate; native USB ignores it', 1200, 12_000_000)
    scale: float = fields.number(1 / FULL_COUNT, 'share of the range for each printed count')
'''
FRAMES = '''\
@dataclass(frozen=True)
class ${name}Connection(FramedConnection):
    """A board that sends the framed protocol, taxels of 10 bits, row by row."""

    def payload(self, layout: Layout) -> Payload:
        """Counts of all taxels."""
        return taxel_matrix(layout.shape[0], FULL_COUNT)

    def scale(self) -> float:
        """Share of the range for each count."""
        return 1 / FULL_COUNT
'''
SENSOR = Template('''\
"""$key: $rows x $columns taxels behind a microcontroller.

Change the geometry to yours. `reading` is a guess, for the simulated board and for trials; the
truth is in a calibration from recordings of the real one.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.devices.connections import $kind
from tactile_ros.enrolment import Programme, growing_loads, recorded
from tactile_ros.sensors.registry import SensorSpec
from tactile_ros.sensors.regression import CLASSES, ESTIMATORS, Regression
from tactile_ros.types import Array, Layout
from tactile_ros.types import config_fields as fields

if TYPE_CHECKING:
    from tactile_ros.enrolment import Touches
    from tactile_ros.types import Recording

ROWS, COLUMNS = $rows, $columns
PITCH = 5e-3  # from the middle of a taxel to the next (m)
FULL_COUNT = 1023  # the largest count of the board's converter
NOISE = 1e-3  # of a simulated reading, share of the range
PRESSES = 40  # that are simulated


def places() -> Array:
    """Middles of the taxels, shape (t, 3) (m): row by row, x along a row."""
    row, column = np.divmod(np.arange(ROWS * COLUMNS), COLUMNS)
    x, y = column - (COLUMNS - 1) / 2, row - (ROWS - 1) / 2
    return PITCH * np.column_stack([x, y, np.zeros(ROWS * COLUMNS)])


@dataclass(frozen=True)
class ${name}Config:
    """Geometry and ranges; each field is a parameter of the node."""

    positions: Array = fields.array(places(), 'middles of the taxels', 'm', (-1, 3))
    rotations: Array | None = fields.maybe_array('axes; empty: aligned', '1', ('t', 3, 3))
    saturation: float | Array | None = fields.each_channel((1.0,), 'largest reading', '1')
    noise: float | Array | None = fields.each_channel(None, 'empty: estimated from rest', '1')
    rate_hz: float = fields.number(50.0, 'frames per second', 'Hz', 0.1, 2000)
    track_baseline: bool = fields.switch(True, 'follow slow drift while nothing touches')
    half_force: float = fields.number(5.0, 'force on a taxel that reads one half', 'N', 1e-3)

    def __post_init__(self) -> None:
        """Check values once, at the door."""
        fields.admit(self, channels=1)


def layout(config: ${name}Config) -> Layout:
    """Layout of taxels of one channel."""
    return Layout.of(config, '$key', ('pressure',), '1')


def reading(config: ${name}Config, touches: Touches) -> Array:
    """Readings (s, t, 1), shares of the range: taxels share the force by their distance."""
    away = config.positions - np.nan_to_num(touches.position)[:, None]
    share = np.exp(-0.5 * np.square(away / PITCH).sum(axis=2))
    force = share * touches.force[:, 2:]
    return (force / (force + config.half_force))[..., None]


def presses(
    config: ${name}Config, seed: int = 0, count: int = PRESSES, noise: float | None = None
) -> Recording:
    """Readings of simulated presses, with place and normal force as truth."""
    rng = np.random.default_rng(seed)
    low, high = config.positions.min(axis=0), config.positions.max(axis=0)
    loads = growing_loads(count, 1.0, 10.0, rng)[:, None]
    unseen = np.array([np.nan, np.nan, 0.0])
    return recorded(
        layout(config),
        Programme(rng.uniform(low, high, (count, 3)), loads * np.array([0.0, 0.0, 1.0])),
        lambda touches: reading(config, touches),
        lambda touches: {'position': touches.position, 'force': touches.force + unseen},
        NOISE if noise is None else noise,
        seed,
        (0.0, 1.0),
    )


$connection

SENSOR = SensorSpec(
    key='$key',
    paper='none',
    summary='$rows x $columns taxels of our own',
    transports=('$transport',),
    config=${name}Config,
    connection=${name}Connection,
    layout=layout,
    estimation=partial(Regression, channels=1),
    estimator_names=ESTIMATORS,
    noise=NOISE,
    presses=presses,
    classes=(${name}Config, *CLASSES),
    recordings=dict,
)
''')


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
    parser.add_argument('--taxels', type=shape, required=True, metavar='RxC', help='such as 4x4')
    parser.add_argument('--lines', action='store_true', help='the board prints text lines')
    parser.add_argument('--folder', type=Path, default=FOLDER, help=f'of own sensors ({FOLDER})')


def run(options: argparse.Namespace) -> int:
    """Write the file and say what comes next."""
    refuse_key(options.key)
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


def refuse_key(key: str) -> None:
    """Refuse what cannot be the key of a new sensor.

    Raises
    ------
    ValueError
        If it is no name in small letters, or one that is taken.
    """
    if not KEY.fullmatch(key) or keyword.iskeyword(key) or len(key) > LONGEST_KEY:
        msg = f'KEY must be a name such as my_pad, at most {LONGEST_KEY} letters and digits'
        raise ValueError(f'{msg}; received {key!r}')
    taken = [*list_sensors(), *ALIASES]
    if key in taken or importlib.util.find_spec(f'tactile_ros.sensors.{key}'):
        raise ValueError(f'KEY must be a new name, none of {", ".join(taken)}; received {key!r}')


def sensor(key: str, rows: int, columns: int, *, lines: bool) -> str:
    """Text of the file."""
    name = key.title().replace('_', '')
    baud = next(baud for most, baud in BAUDS if rows * columns <= most)
    framed = '\nfrom tactile_ros.devices.framed_protocol import Payload, taxel_matrix'
    connection = Template(LINES if lines else FRAMES).substitute(name=name, baud=f'{baud:_}')
    return SENSOR.substitute(
        key=key, name=name, rows=rows, columns=columns, connection=connection,
        kind='LineConnection' if lines else f'FramedConnection{framed}',
        transport='serial: text lines' if lines else 'serial: framed protocol, taxels of 10 bits',
    )  # fmt: skip
