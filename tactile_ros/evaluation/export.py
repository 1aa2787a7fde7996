# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Bags as plain tables, csv or parquet: a row for each frame.

A folder for each bag and sensor has `frames`, `contacts` of the live run, `forces` of every taxel
(N), where a calibration gives them, and `layout.json`. `tactile replay` reads a csv of frames.
"""

from __future__ import annotations

import csv
import json
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from tactile_ros.errors import load_package
from tactile_ros.evaluation.bag import Taker
from tactile_ros.evaluation.recording_files import PIECE, Bag, LoadedRecording
from tactile_ros.evaluation.replay import Follower
from tactile_ros.files import temporary_folder, write_atomically
from tactile_ros.pipeline import Pipeline
from tactile_ros.types import STATE_FIELDS, Array, Columns, Layout

Arrow: TypeAlias = Any  # objects of pyarrow, which carry no types
Column: TypeAlias = npt.NDArray[np.generic]
CONTACT_FIELDS = [name for name, (shape, _, _) in STATE_FIELDS.items() if shape in ((), (3,))]


def arrow() -> Arrow:
    """Load pyarrow; MissingPackageError says how to install it."""
    load_package('pyarrow.parquet', 'writing parquet needs pyarrow')
    return load_package('pyarrow', 'writing parquet needs pyarrow')


def arrow_column(column: Column) -> Arrow:
    """Array (n, ...) of numbers as a column of (nested) lists."""
    pa = arrow()
    flat = pa.array(np.ascontiguousarray(column).reshape(-1))
    sizes = column.shape[:0:-1]
    for size in sizes:
        if len(sizes) == 1:
            return pa.FixedSizeListArray.from_arrays(flat, size)
        ends = np.arange(0, len(flat) + 1, size, dtype=np.int32)
        flat = pa.ListArray.from_arrays(ends, flat)
    return flat


class Export:
    """Rows of the table that is shown, sentences about what was left out, bytes that were read."""

    def __init__(self) -> None:
        self.rows: list[tuple[str | int | float, ...]] = []
        self.left_out: list[str] = []
        self.notes: list[str] = []
        self.read_bytes = 0

    def add_bag(self, bag: ExportBag) -> None:
        """Say what could not be read of a bag, and what was not asked for."""
        bag.finish()
        out = [*bag.content.problems, *(f'{s}/frame: {why}' for s, why in bag.left_out.items())]
        self.left_out += [f'{bag.path.name}: {sentence}' for sentence in out]
        self.notes += [f'{bag.path.name}: {sentence}' for sentence in bag.sentences]
        files = [bag.path] if bag.path.is_file() else bag.path.iterdir()
        self.read_bytes += sum(f.stat().st_size for f in files if f.suffix in ('.mcap', '.db3'))


class TaxelForces:
    """Newtons of every taxel of a sensor by the calibration that fits it; x and y are NaN."""

    def __init__(self, pipelines: Sequence[Pipeline], piece: LoadedRecording) -> None:
        self._follower: Follower | None = None
        self.why, self.fits = 'no calibration was named', not pipelines
        for pipeline in pipelines:
            try:
                pipeline.check_layout(piece.recording)
            except ValueError as err:
                found = piece.recording.layout.sensor or 'this sensor'
                self.why = f'the calibration is of {pipeline.sensor}, not of {found}: {err}'
                continue
            self.why, self.fits = 'the calibration gives none', True
            if 'taxel_force' in pipeline.estimators:
                self._follower, self.why = Follower(pipeline, replace(piece, changes=())), ''
                return

    def of(self, piece: LoadedRecording) -> Array | None:
        """Forces (s, t, 3) (N) of the next piece; None: nothing gives them."""
        if self._follower is None:
            return None
        normal = self._follower(piece).taxel_force
        return np.stack([np.full_like(normal, np.nan)] * 2 + [normal], axis=2)


class ParquetFile:
    """Table in a parquet file, whose columns are those of its first rows."""

    def __init__(self, path: Path, _: Layout | None = None) -> None:
        self._path = path.with_suffix('.parquet')
        self._writer: Arrow = None

    def write(self, columns: Mapping[str, Arrow]) -> None:
        """Append rows of arrays, or of columns of pyarrow."""
        table = arrow().table({
            name: arrow_column(column) if isinstance(column, np.ndarray) else column
            for name, column in columns.items()
        })  # fmt: skip
        if self._writer is None:
            self._writer = arrow().parquet.ParquetWriter(
                self._path, table.schema, use_dictionary=False
            )
        self._writer.write_table(table)

    def close(self) -> None:
        """Write its end."""
        if self._writer is not None:
            self._writer.close()


class CsvFile:
    """Table in a csv file; unknown cells are empty, as `recording_files.read_csv` wants them."""

    def __init__(self, path: Path, layout: Layout) -> None:
        self._file = path.with_suffix('.csv').open('w', newline='', encoding='utf-8')
        self._writer, self._layout = csv.writer(self._file, lineterminator='\n'), layout
        self._begun = False

    def write(self, columns: Columns) -> None:
        """Append rows."""
        if not self._begun:
            names = (self._names(name, column.shape[1:]) for name, column in columns.items())
            self._writer.writerow([cell for part in names for cell in part])
            self._begun = True
        parts = (one for part in columns.values() for one in part.reshape(len(part), -1).T)
        cells = [np.where(one != one, '', one.astype(object)).tolist() for one in parts]  # noqa: PLR0124
        self._writer.writerows(zip(*cells, strict=True))

    def close(self) -> None:
        """Write what is left."""
        self._file.close()

    def _names(self, name: str, tail: tuple[int, ...]) -> list[str]:
        axes: Sequence[str] = self._layout.channels if name == 'values' else 'xyz'
        front = '' if name == 'values' else f'{name}_'
        if len(tail) == 2:
            return [f'{front}{axis}_{taxel}' for taxel in range(tail[0]) for axis in axes]
        if tail == (3,) and name not in ('status', 'temperature_c'):
            return [f'{name}_{axis}' for axis in axes]
        return [f'{name}_{i}' for i in range(tail[0])] if tail else [name]


def plain_name(name: str) -> str:
    """Name for a folder or feature, whatever a topic of a bag is called."""
    return re.sub(r'[^\w-]+', '.', name).strip('.') or 'sensor'


def described(layout: Layout) -> dict[str, Any]:
    """Layout as plain numbers and texts."""
    return {
        'sensor': layout.sensor, 'serial': layout.serial, 'frame_id': layout.frame_id,
        'unit': layout.unit, 'channels': list(layout.channels), 'rate_hz': layout.rate_hz,
        'positions': layout.positions.tolist(),
        'rotations': None if layout.rotations is None else layout.rotations.tolist(),
    }  # fmt: skip


class SensorTables:
    """Tables of one sensor of a bag in a folder."""

    def __init__(
        self, folder: Path, piece: LoadedRecording, form: type[ParquetFile | CsvFile],
        pipelines: Sequence[Pipeline],
    ) -> None:  # fmt: skip
        self._folder, self._form, self._layout = folder, form, piece.recording.layout
        folder.mkdir(parents=True)
        write_atomically(folder / 'layout.json', json.dumps(described(self._layout)).encode())
        self._files: dict[str, ParquetFile | CsvFile] = {}
        self.forces = TaxelForces(pipelines, piece)
        self.rows: Counter[str] = Counter()

    def add(self, piece: LoadedRecording) -> None:
        """Append the frames of the next piece."""
        recording, live, forces = piece.recording, piece.contacts, self.forces.of(piece)
        count, (taxels, _) = len(recording), recording.layout.shape
        key = {name: np.asarray(getattr(recording, name)) for name in ('stamp_ns', 'sequence')}
        bits, chips = recording.status, recording.temperature_c
        self._write('frames', {
            **key, 'stream': np.asarray(recording.stream),
            'status': np.zeros((count, taxels), np.uint8) if bits is None else bits,
            'temperature_c': np.full((count, taxels), np.nan) if chips is None else chips,
            'values': recording.values,
        })  # fmt: skip
        if live is not None:
            states = {name: getattr(live.states, name) for name in CONTACT_FIELDS}
            at = {name: column[live.rows] for name, column in key.items()}
            self._write('contacts', {**at, 'heard_ns': live.log_ns, **states})
        if forces is not None:
            self._write('forces', {**key, 'taxel_force': forces})

    def _write(self, name: str, columns: Columns) -> None:
        if name not in self._files:
            self._files[name] = self._form(self._folder / name, self._layout)
        self._files[name].write(columns)
        self.rows[name] += len(columns['stamp_ns'])

    def close(self) -> None:
        """Write the ends of all files."""
        for file in self._files.values():
            file.close()


class ExportBag(Bag):
    """Bag whose truth is left out, with sentences about the rest that is."""

    def __init__(self, path: Path) -> None:
        super().__init__(path, frames=PIECE)
        self.exported: set[str] = set()  # topics of others
        self.fits = False  # a calibration, where some were named, is of one of its sensors
        self.sentences: list[str] = []

    def handler(self, topic: str, kind: str) -> Taker | None:
        """Find the function that takes the messages of a topic."""
        return None if self._role(topic, kind) == 'truth' else super().handler(topic, kind)

    def note_forces(self, space: str, forces: TaxelForces) -> None:
        """Say why there are no newtons of taxels."""
        self.fits |= forces.fits
        if forces.why:
            name = self.sensors[space].name
            self.sentences.append(f'{name}: no newtons of taxels: {forces.why}')

    def finish(self) -> None:
        """Say what was not exported; ValueError where no calibration is of a sensor of the bag."""
        if not self.fits:
            raise ValueError('; '.join(self.sentences))
        types = self.content.types.items()
        others = {*self.unused, *(t for t, kind in types if self._role(t, kind) == 'truth')}
        others -= self.exported
        if others:
            self.sentences.append(f'not exported: {", ".join(sorted(others))}')
        for sensor in self.sensors.values():
            lost = sensor.whole().problems if sensor.times else ()
            self.sentences += [f'{sensor.name}: {sentence}' for sentence in lost]


def write_tables(
    paths: Sequence[Path], target: Path, form: type[ParquetFile | CsvFile],
    pipelines: Sequence[Pipeline],
) -> Export:  # fmt: skip
    """Write a row for each frame of bags into a new folder, with a folder for each sensor.

    Raises TactileError if `target` is there already, cannot be written, or a bag has no frame.
    """
    if form is ParquetFile:
        arrow()
    done = Export()
    with temporary_folder(target) as fresh:
        for path in paths:
            bag, tables = ExportBag(path), dict[str, SensorTables]()
            with ExitStack() as opened:
                for space, piece in bag:
                    if space not in tables:
                        folder = fresh / plain_name(path.stem) / plain_name(piece.name)
                        tables[space] = SensorTables(folder, piece, form, pipelines)
                        opened.callback(tables[space].close)
                    tables[space].add(piece)
            for space, table in tables.items():
                rows = (table.rows[name] for name in ('frames', 'contacts', 'forces'))
                done.rows.append((path.name, bag.sensors[space].name, *rows))
                bag.note_forces(space, table.forces)
            done.add_bag(bag)
    return done
