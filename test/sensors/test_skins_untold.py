# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""A calibration of an array or a sheet says what its recordings could not support."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from tactile_ros.cli.calibrate import sentences
from tactile_ros.sensors import load_sensor
from tactile_ros.types import Recording

REST = 'not learned: rest before any load (no tare rows)'


def lacks(key: str, recording: Recording) -> dict[str, dict[str, float]]:
    """What the quickest calibration says that it was not told."""
    report = load_sensor(key).pipeline(estimator='grid_knn').fit(recording).report
    found = {name: told for name, told in report.items() if name.startswith('not learned: ')}
    assert len(sentences(found)) == len(found)
    return found


def presses(key: str, count: int = 12) -> Recording:
    """The sensor's own programme."""
    sensor = load_sensor(key)
    return sensor.presses(sensor.config(), 0, count)


@pytest.mark.parametrize('key', ['taxel_array', 'five_wire_skin'])
def test_tare_rows_and_stamps_that_lack_are_named(key: str, tmp_path: Path) -> None:
    recording = presses(key)
    assert REST not in lacks(key, recording)
    assert REST in lacks(key, dataclasses.replace(recording, tare=None))
    unstamped = lacks(key, dataclasses.replace(recording, stamp_ns=None))
    assert 'not learned: creep (frames without stamps)' in unstamped
    pipeline = load_sensor(key).pipeline(estimator='grid_knn').fit(recording)
    pipeline.save(tmp_path / 'c.npz')
    assert load_sensor(key).load(tmp_path / 'c.npz').report == pipeline.report


def sheet(places: np.ndarray, loads: np.ndarray) -> Recording:
    """Independent touches of linear potentials, and as many rests."""
    x, y = (places / 0.1).T
    touched = np.column_stack([1 - (x + y) / 2, 0.5 + (x - y) / 2, loads / (loads + 9.0)])
    values = np.concatenate([0.0 * touched, touched])[:, None]
    count, spec = len(places), load_sensor('five_wire_skin')
    blank = np.full((2 * count, 3), np.nan)
    position, force = blank.copy(), blank.copy()
    position[count:, :2], force[:, 2] = places, np.append(0.0 * loads, loads)
    contact = np.repeat([0, 1], count)
    truth = {'position': position, 'force': force, 'in_contact': contact}
    values += 1e-4 * np.random.default_rng(0).normal(size=values.shape)
    return Recording.from_arrays(spec.layout(spec.config()), values, truth=truth)


def grid(edge: int, low: float, high: float) -> np.ndarray:
    """Places (n, 2) (m), each four times."""
    line = np.linspace(low, high, edge)
    return np.repeat(np.stack(np.meshgrid(line, line), -1).reshape(-1, 2), 4, axis=0)


def test_few_places_one_load_and_a_corner_of_the_sheet_are_named() -> None:
    few = grid(3, 0.02, 0.04)
    found = lacks('five_wire_skin', sheet(few, np.full(len(few), 5.0)))
    assert found['not learned: loads beyond those recorded (N)'] == {'least': 5.0, 'most': 5.0}
    for what, wanted in (('place', 25.0), ('force', 49.0)):
        named = found[f'not learned: {what} between so few places']
        assert named == {'places': 9.0, 'wanted': wanted}
    assert found['not learned: places far from all touches']['share of the sheet'] > 0.5


def test_of_49_places_all_over_the_sheet_none_is_missed() -> None:
    many = grid(7, 12.5e-3, 87.5e-3)
    found = lacks('five_wire_skin', sheet(many, np.tile([1.0, 5.0, 9.0, 15.0], 49)))
    assert not [name for name in found if 'places' in name]


def test_taxels_that_were_never_pressed_are_counted() -> None:
    recording = presses('taxel_array')
    recording.truth['taxel_force'][:, 3:5] = 0.0
    found = lacks('taxel_array', recording)
    assert found['not learned: taxels that were never pressed'] == {'taxels': 2.0}
