# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Write bags as csv, parquet, or a data set that robot policies learn from.

`--csv` and `--parquet` write a row for each frame, with a folder for each bag and sensor;
contacts, and newtons of every taxel where a calibration gives them, lie beside (x and y are NaN:
not estimated). `--lerobot` writes a LeRobotDataset v3.0, each bag an episode. Frame i is at
t0 + i / fps and holds a window of the newest tactile frames acquired until then, oldest first, at
their own rate. Each is new in exactly one window: `tactile.<sensor>.new` counts these, the last of
a window, and `tactile.<sensor>.stamp_ns` has all stamps. Joint states, commands and images are the
latest until then, where the bag has them.

Parquet needs pyarrow: pip install 'tactile_ros[export]'.

example:
  tactile export normal_1 --csv out/tables
  tactile export my_bag another_bag --lerobot out/touches --fps 30 --task 'press the pad'
  tactile export my_bag --parquet out/parquet --calibration place.npz
"""

from __future__ import annotations

import argparse
import sys
import time
from argparse import ArgumentTypeError
from pathlib import Path
from tempfile import TemporaryDirectory

from tactile_ros.cli.console import note, refuse_no_new_folder, show, working
from tactile_ros.errors import plain
from tactile_ros.evaluation.bag import write_recording
from tactile_ros.evaluation.export import CsvFile, ParquetFile, write_tables
from tactile_ros.evaluation.fleet import open_calibration
from tactile_ros.evaluation.lerobot import write_dataset
from tactile_ros.sensors import list_sensors, load_sensor

FASTEST = 10_000  # frames a second
TABLES = ('bag', 'sensor', 'frames', 'contacts', 'forces')
FEATURES = ('bag', 'feature', 'samples', 'frames', 'window')


def rate(text: str) -> int:
    """Frames a second of a data set."""
    value = int(text)
    if not 1 <= value <= FASTEST:
        raise ArgumentTypeError(f'must be 1 to {FASTEST}; received {text}')
    return value


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `tactile export`."""
    parser.add_argument('bags', nargs='+', type=Path, help='bags, or shipped names')
    form = parser.add_mutually_exclusive_group(required=True)
    form.add_argument('--csv', type=Path, metavar='OUT', help='new folder of csv tables')
    form.add_argument('--parquet', type=Path, metavar='OUT', help='new folder of parquet tables')
    form.add_argument('--lerobot', type=Path, metavar='OUT', help='new folder of the data set')
    parser.add_argument('--fps', type=rate, default=30, help='frames a second of the data set')
    parser.add_argument('--task', default='touch', help='what the hand does, in words')
    parser.add_argument('--calibration', type=Path, action='append', default=[], help='.npz file')
    parser.add_argument('--json', action='store_true', help='print the table as JSON')


def shipped(name: Path, folder: Path) -> Path:
    """Bag of the recording that a sensor ships by a name; the name where there is none."""
    for spec in map(load_sensor, list_sensors()):
        if one := spec.recordings().get(str(name)):
            write_recording(one, folder / name)
            return folder / name
    return name


def run(options: argparse.Namespace) -> int:
    """Write the files, print what they hold, and return 1 where something could not be read."""
    target = options.csv or options.parquet or options.lerobot
    bags = [path if path.stem.strip('.') else path.resolve() for path in options.bags]
    names = [path.stem for path in bags]
    if len(set(names)) < len(names):
        raise ValueError(f'bags must have different names; received {", ".join(names)}')
    refuse_no_new_folder(target, bags)
    pipelines = [open_calibration(path) for path in options.calibration]
    with working('exporting'), TemporaryDirectory() as folder:
        bags = [path if path.exists() else shipped(path, Path(folder)) for path in bags]
        begun = time.perf_counter()
        if options.lerobot:
            done = write_dataset(bags, target, options.fps, options.task, pipelines)
        else:
            form = CsvFile if options.csv else ParquetFile
            done = write_tables(bags, target, form, pipelines)
    seconds, size = time.perf_counter() - begun, done.read_bytes / 1e6
    show(FEATURES if options.lerobot else TABLES, done.rows, as_json=options.json)
    note([*done.notes, *(f'left out: {sentence}' for sentence in done.left_out)])
    speed = f'{size:.3g} MB in {seconds:.2g} s, {size / seconds:.0f} MB/s'
    print(plain(f'folder: {target}, {speed}'), file=sys.stderr)
    return int(bool(done.left_out))
