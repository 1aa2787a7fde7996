# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Loads beyond any that was told, and what a calibration says that it was not told."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from tactile_ros.cli.calibrate import sentences
from tactile_ros.pipeline import Pipeline
from tactile_ros.sensors import load_sensor
from tactile_ros.types import ContactStates, FrameStatus, Recording

TAXELS = load_sensor('taxel_array')
WIRES = load_sensor('five_wire_skin')
CONFIG = dataclasses.replace(TAXELS.config(), objects=())  # type: ignore[type-var]
LAYOUT = TAXELS.layout(CONFIG)
HALF = 20.0  # N, load of half the range
GAIN = 1 / (1 + 0.55 * np.random.default_rng(3).uniform(size=16))


def read(force: np.ndarray, seed: int) -> np.ndarray:
    """Outputs of 10 bits of taxels whose gains differ by 55 %."""
    output = GAIN * force / (force + HALF)
    output = output + 4e-4 * np.random.default_rng(seed).normal(size=output.shape)
    return np.round(np.clip(output, 0, 1) * 1023)[..., None] / 1023


def fitted(top: float) -> Pipeline:
    """Equilibrated by even loads up to some force."""
    force = np.repeat(np.random.default_rng(1).uniform(0.02, top, (120, 1)), 16, axis=1)
    force[:15] = 0
    truth = {'taxel_force': force, 'in_contact': (force[:, 0] > 0).astype(np.int8)}
    return TAXELS.pipeline(CONFIG).fit(Recording.from_arrays(LAYOUT, read(force, 2), truth=truth))


def flagged(states: ContactStates) -> np.ndarray:
    return np.asarray(states.status & FrameStatus.OUT_OF_RANGE > 0)


@pytest.mark.parametrize('top', [1.0, 60.0])
def test_no_reading_is_a_negative_or_an_endless_force(top: float) -> None:
    level = np.linspace(0, 0.99, 100)
    values = np.repeat(level[:, None, None], 16, axis=1)
    states = fitted(top).process_batch(Recording.from_arrays(LAYOUT, values))
    assert (np.diff(states.taxel_force, axis=0) >= -1e-9).all()
    assert states.taxel_force.min() >= 0
    assert states.taxel_force.max() < 100 * top
    assert flagged(states)[-1]
    # 0.99 is more than some taxels say of any load: nothing is known of it
    assert np.sqrt(states.force_cov[-1, 2, 2]) > 0.3 * states.force[-1, 2]


@pytest.mark.parametrize('top', [5.0, 20.0])
def test_heavier_loads_are_inside_two_sigma_and_flagged(top: float) -> None:
    pipeline = fitted(top)
    load = top * np.array([0.3, 0.6, 0.9, 1.0, 1.3, 1.6, 2.0, 3.0])
    states = pipeline.process_batch(
        Recording.from_arrays(LAYOUT, read(np.repeat(load[:, None], 16, axis=1), 4))
    )
    assert flagged(states).tolist() == 4 * [False] + 4 * [True]
    error = states.force[:, 2] - 16 * load
    sigma = np.sqrt(states.force_cov[:, 2, 2])
    assert (np.abs(error)[4:] < 2 * sigma[4:]).all()
    assert (np.diff(sigma[3:]) > 0).all()
    assert (sigma[:4] < 0.01 * 16 * load[:4]).all()


def test_one_loud_taxel_is_flagged_and_makes_the_sum_unsure() -> None:
    pipeline = fitted(20.0)
    values = read(np.full((2, 16), 6.0), 5)
    values[1, 4] = 0.98
    states = pipeline.process_batch(Recording.from_arrays(LAYOUT, values))
    assert flagged(states).tolist() == [False, True]
    error = states.force[1, 2] - 16 * 6.0
    assert error > 20
    assert error < 3 * np.sqrt(states.force_cov[1, 2, 2])


def test_a_short_of_the_film_is_no_force_that_is_sure_of_itself() -> None:
    lesson = WIRES.presses(WIRES.config(), 0, 20)
    force = lesson.truth['force'][:, 2].astype(float)
    touched = np.flatnonzero(lesson.truth['in_contact'] == 1)
    pipeline = WIRES.pipeline().fit(lesson)
    own = pipeline.process_batch(lesson)
    assert not flagged(own).any()
    heaviest = touched[np.nanargmax(force[touched])]
    values = np.repeat(lesson.values[heaviest][None], 6, axis=0)
    values[1:, 0, 2] = 0.85, 0.9, 0.95, 0.99, 0.999
    states = pipeline.process_batch(Recording.from_arrays(WIRES.layout(WIRES.config()), values))
    assert flagged(states).tolist() == [False, *5 * [True]]
    assert (states.force[2:, 2] > 1.3 * force[heaviest]).all()
    sigma = np.sqrt(states.force_cov[:, 2, 2])
    assert (sigma[2:] >= states.force[2:, 2]).all()
    assert sigma[0] < 0.02 * force[heaviest]


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
