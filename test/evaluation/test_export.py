# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Tables of bags: csv always, parquet where pyarrow is installed."""

from __future__ import annotations

import csv
import json
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from reference import made_bags as make
from tactile_ros.errors import MissingPackageError, RecordingError, TactileError
from tactile_ros.evaluation import export
from tactile_ros.evaluation.export import CsvFile, ParquetFile, plain_name, write_tables
from tactile_ros.evaluation.recording_files import load


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    return make.write_bag(tmp_path / 'bag', n=40, lost=(7, 8))


def test_tables_of_frames_and_contacts_are_the_recording_of_the_bag(
    bag: Path, tmp_path: Path
) -> None:
    done = write_tables([bag], tmp_path / 'out', CsvFile, [])
    assert done.rows == [('bag', 'sensor', 38, 38, 0)]
    assert done.left_out == []
    assert 'bag: sensor: no newtons of taxels: no calibration was named' in done.notes
    assert 'bag: not exported: /truth/contacts' in done.notes
    (stored,) = load(bag).recordings
    place = stored.contacts.states.position
    folder = tmp_path / 'out' / 'bag' / 'sensor'
    (again,) = load(folder / 'frames.csv', stored.recording.layout).recordings
    for name in ('values', 'stamp_ns', 'sequence', 'stream'):
        expected, found = (getattr(r.recording, name) for r in (stored, again))
        np.testing.assert_array_equal(found, expected)
    with (folder / 'contacts.csv').open() as file:
        rows = list(csv.DictReader(file))
    places = [[float(row['position_x']), float(row['position_y'])] for row in rows]
    np.testing.assert_array_equal(places, place[:, :2])
    assert {row['position_z'] for row in rows} == {''}
    assert json.loads((folder / 'layout.json').read_text())['channels'] == ['Bx', 'By', 'Bz']
    parquet = pytest.importorskip('pyarrow.parquet', reason='pip install pyarrow')
    write_tables([bag], tmp_path / 'parquet', ParquetFile, [])
    folder = tmp_path / 'parquet' / 'bag' / 'sensor'
    frames = parquet.read_table(folder / 'frames.parquet').to_pydict()
    np.testing.assert_array_equal(np.array(frames['values']), stored.recording.values)
    assert frames['stamp_ns'] == stored.recording.stamp_ns.tolist()
    assert np.shape(frames['status']) == np.shape(frames['temperature_c']) == (38, 5)
    contacts = parquet.read_table(folder / 'contacts.parquet').to_pydict()
    np.testing.assert_array_equal(contacts['position'], place)


class Fitting:
    """Pipeline of every layout that estimates forces of taxels, and what follows it."""

    estimators = ('taxel_force',)

    def __init__(self, *_: object) -> None: ...

    def check_layout(self, _: object) -> None: ...

    def __call__(self, piece: SimpleNamespace) -> Fitting:
        self.taxel_force = np.full(piece.recording.values.shape[:2], 0.5)
        return self


class Other(Fitting):
    sensor = 'other_pad'

    def check_layout(self, _: object) -> None:
        msg = 'another shape'
        raise ValueError(msg)


def test_newtons_of_taxels_are_written_where_a_calibration_gives_them(
    bag: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(export, 'Follower', Fitting)
    done = write_tables([bag], tmp_path / 'out', CsvFile, [Other(), Fitting()])
    assert done.rows == [('bag', 'sensor', 38, 38, 38)]
    with (tmp_path / 'out' / 'bag' / 'sensor' / 'forces.csv').open() as file:
        row = next(csv.DictReader(file))
    assert [row[f'taxel_force_{axis}_4'] for axis in 'xyz'] == ['', '', '0.5']
    with pytest.raises(ValueError, match='is of other_pad, not of reskin_board: another shape'):
        write_tables([bag], tmp_path / 'other', CsvFile, [Other()])


def test_nothing_is_written_over_or_left_behind(
    bag: Path, tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    with make.Bag(tmp_path / 'empty') as empty:
        empty.put('/text', make.new('String', data='x'))
    with pytest.raises(TactileError, match='exists already'):
        write_tables([bag], bag, CsvFile, [])
    with pytest.raises(RecordingError, match='holds no frames'):
        write_tables([bag, tmp_path / 'empty'], tmp_path / 'out', CsvFile, [])
    monkeypatch.setitem(sys.modules, 'pyarrow', None)
    with pytest.raises(MissingPackageError, match='writing parquet needs pyarrow: pip install'):
        write_tables([bag], tmp_path / 'out', ParquetFile, [])
    assert sorted(path.name for path in tmp_path.iterdir()) == ['bag', 'empty']


def test_names_of_hostile_topics_stay_in_the_folder(tmp_path: Path) -> None:
    with make.Bag(tmp_path / 'bag') as hostile:
        hostile.put('/../../up/layout', make.layout())
        hostile.put('/../../up/frame', make.frame(0, np.zeros(15), 1))
    write_tables([tmp_path / 'bag'], tmp_path / 'in' / 'out', CsvFile, [])
    assert sorted(path.name for path in tmp_path.iterdir()) == ['bag', 'in']
    assert (tmp_path / 'in' / 'out' / 'bag' / 'up' / 'frames.csv').is_file()
    assert [plain_name(name) for name in ('a/b', '..', '')] == ['a.b', 'sensor', 'sensor']
