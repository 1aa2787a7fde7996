# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Hard cases of the five-wire skin: splits, clocks and gaps, the past of a film, bad input.

Numbers are those of the list of hard cases that this package was built against.
"""

from __future__ import annotations

import dataclasses
from functools import lru_cache
from importlib import import_module
from types import ModuleType

import numpy as np
import pytest

from tactile_ros.pipeline import Pipeline
from tactile_ros.sensors import load_sensor
from tactile_ros.types import ContactStates, Frame, FrameStatus, Recording

SENSOR = load_sensor('five_wire_skin')
LAYOUT = SENSOR.layout(SENSOR.config())
RATE_NS = 40_000_000  # of the world's frames
HELD_S, AFTER = 120.0, 250  # a hold, and frames after what went wrong in it


@lru_cache
def world_of(name: str) -> ModuleType:
    """Module of a world."""
    return import_module(f'reference.{name}')


@lru_cache
def creeping() -> tuple[Pipeline, Recording]:
    """Pipeline that learned a film's past, and a hold of two minutes with a rest after it."""
    sheets, rng = world_of('five_wire_sheet'), np.random.default_rng(81)
    world = sheets.SheetWorld(80)
    where = np.repeat(world_of('five_wire_world').grid(5), 3, axis=0)
    load = np.tile([3.0, 8.0, 14.0], 25) * rng.uniform(0.9, 1.05, 75)
    pipeline = SENSOR.pipeline().fit(sheets.pressed(world, LAYOUT, where, load, 82))
    assert 'force_z_without_creep' in pipeline.report
    hold = sheets.pressed(
        world, LAYOUT, np.array([[0.05, 0.04]]), np.array([8.0]), 83, hold_s=HELD_S
    )
    return pipeline, hold


def force(recording: Recording) -> np.ndarray:
    """Normal forces (s,) that the pipeline says of a recording."""
    return creeping()[0].process_batch(recording).force[:, 2]


def held(recording: Recording) -> np.ndarray:
    """Rows in which the skin is touched."""
    return np.flatnonzero(recording.truth['in_contact'] == 1)


def test_case_8_frames_of_one_press_are_never_on_both_sides_of_a_split() -> None:
    sheets, rng = world_of('five_wire_sheet'), np.random.default_rng(5)
    where = rng.uniform(12.5e-3, 87.5e-3, (30, 2))
    train = sheets.pressed(sheets.SheetWorld(84), LAYOUT, where, rng.uniform(3, 14, 30), 85)
    pipeline = SENSOR.pipeline(estimator='grid_knn').fit(train)
    error = pipeline.process_batch(train).force - train.truth['force']
    own = float(np.sqrt((error[held(train), 2] ** 2).mean()))
    # neighbours that are frames of the same press would make the two alike
    assert pipeline.report['force_z']['held_out_rmse'] > 3 * own


def test_case_12_a_gap_of_ten_seconds_in_a_hold_leaves_no_trace() -> None:
    _, hold = creeping()
    rows = held(hold)
    gone = np.arange(rows[500], rows[750])
    kept = np.setdiff1d(np.arange(len(hold)), gone)
    whole, cut = force(hold)[kept], force(hold.select(kept))
    after = kept > gone[-1]
    assert np.abs(cut - whole)[after].max() < 0.02


@pytest.mark.parametrize('step', [0, -1, -1_000_000_000], ids=['still', 'back', 'a second back'])
def test_case_12_a_clock_that_does_not_go_on_begins_anew(step: int) -> None:
    pipeline, hold = creeping()
    first = held(hold)[100]
    told = hold.stamp_ns
    pipeline.reset()
    for row in range(first):
        last = pipeline.process(Frame(int(told[row]), row, hold.values[row]))
    stamp = int(told[first - 1]) + step
    state = pipeline.process(Frame(stamp, first, hold.values[first]))
    pipeline.reset()
    fresh = pipeline.process(Frame(stamp, first, hold.values[first]))
    np.testing.assert_array_equal(state.force, fresh.force)
    assert np.isfinite(state.force[2])
    assert abs(state.force[2] - last.force[2]) < 2.0


def test_case_12_stamps_since_1970_are_as_good_as_those_since_the_start() -> None:
    _, hold = creeping()
    late = dataclasses.replace(hold, stamp_ns=hold.stamp_ns + 1_760_000_000 * 10**9)
    np.testing.assert_array_equal(force(late), force(hold))


@pytest.mark.parametrize('reading', [np.nan, np.inf, 1.0, 1.2, 5.0, -1e6])
def test_case_13_readings_that_cannot_be_in_a_hold_poison_nothing(reading: float) -> None:
    pipeline, hold = creeping()
    broken = held(hold)[1000] + np.arange(3)
    values = hold.values.copy()
    values[broken, 0, 2] = reading
    clean, states = force(hold), pipeline.process_batch(dataclasses.replace(hold, values=values))
    assert np.isnan(states.force[broken]).all()
    assert np.isnan(states.position[broken]).all()
    assert not states.valid[broken].any()
    assert (states.status[broken] & FrameStatus.BAD_TAXELS).all()
    assert (states.taxel_status[broken] != 0).all()
    assert (states.in_contact[broken] == -1).all()
    after = slice(broken[-1] + 1, None)
    assert np.abs(states.force[after, 2] - clean[after]).max() < 1e-3


def test_case_13_a_reset_in_a_hold_costs_what_is_forgotten_and_the_release_is_clean() -> None:
    pipeline, hold = creeping()
    at, end = held(hold)[1500], held(hold)[-1]
    rows = np.arange(len(hold))
    cut = dataclasses.replace(hold, stream=(rows >= at).astype(int), tare=None)
    clean, anew = force(dataclasses.replace(hold, tare=None)), force(cut)
    released = slice(end + 2, None)
    assert not anew[released].any()
    assert not clean[released].any()
    # without its past a film reads what it has crept: a part, never a multiple
    lost = np.abs(anew - clean)[at : at + AFTER] / clean[at : at + AFTER]
    assert lost.max() < 0.3
    assert pipeline.process_batch(cut).in_contact[released].max() == 0


@pytest.mark.parametrize('estimator', [None, 'ridge', 'printed'])
def test_a_short_circuit_is_no_force_whatever_estimates(estimator: str | None) -> None:
    recording = SENSOR.presses(SENSOR.config(), 0, 8)
    pipeline = SENSOR.pipeline(estimator=estimator).fit(recording)
    row = held(recording)[10]
    for reading in (1.0, 5.0):
        values = recording.values[row].copy()
        values[0, 2] = reading
        state = pipeline.process(Frame(None, 0, values))
        assert not state.valid
        assert np.isnan(state.force).all()
        assert np.isnan(state.position).all()
        assert state.in_contact == -1


def test_touched_rows_that_cannot_be_are_not_learned_from() -> None:
    recording = SENSOR.presses(SENSOR.config(), 0, 20)
    spoilt = np.random.default_rng(1).uniform(size=len(recording)) < 0.05
    spoilt &= recording.truth['in_contact'] == 1
    values = recording.values.copy()
    values[spoilt, 0, 2] = 1.0
    spoilt_states, states = (
        states_of(dataclasses.replace(recording, values=one), recording)
        for one in (values, np.where(spoilt[:, None, None], np.nan, values))
    )
    np.testing.assert_array_equal(spoilt_states.force, states.force)


def test_resting_rows_at_the_rail_are_no_rest() -> None:
    recording = SENSOR.presses(SENSOR.config(), 0, 12)
    spoilt = np.random.default_rng(2).uniform(size=len(recording)) < 0.05
    spoilt &= recording.truth['in_contact'] == 0
    values = recording.values.copy()
    values[spoilt, 0, 2] = 1.0
    shorted, lost = (
        SENSOR.pipeline().fit(dataclasses.replace(recording, values=one))
        for one in (values, np.where(spoilt[:, None, None], np.nan, values))
    )
    assert spoilt.sum() > 10
    np.testing.assert_array_equal(shorted.baseline, lost.baseline)
    np.testing.assert_array_equal(shorted.rest_.noise, lost.rest_.noise)
    frames = [recording.frame(i) for i in np.flatnonzero(recording.truth['in_contact'] == 0)[:6]]
    shorted.tare(frames)
    clean, short = shorted.baseline, frames[0].values.copy()
    short[0, 2] = 1.0
    shorted.tare([*frames, dataclasses.replace(frames[0], values=short)])
    np.testing.assert_array_equal(shorted.baseline, clean)


def states_of(lesson: Recording, asked: Recording) -> ContactStates:
    """What a pipeline says of a recording after a lesson."""
    return SENSOR.pipeline().fit(lesson).process_batch(asked)


def test_a_constant_reading_stays_what_it_says_and_a_rest_is_no_touch() -> None:
    pipeline, hold = creeping()
    stamps = RATE_NS * np.arange(50)
    for values in (np.zeros((50, 1, 3)), np.full((50, 1, 3), np.nan), np.ones((50, 1, 3))):
        states = pipeline.process_batch(Recording.from_arrays(LAYOUT, values, stamps))
        assert np.isnan(states.position).all()
        assert not (np.nan_to_num(states.force) != 0).any()
        assert (states.in_contact != 1).all()
    stuck = np.repeat(hold.values[held(hold)[200]][None], 50, axis=0)
    states = pipeline.process_batch(Recording.from_arrays(LAYOUT, stuck))
    assert np.ptp(states.force[:, 2]) == 0.0


@pytest.mark.parametrize('level', [0.0, 0.4])
@pytest.mark.parametrize('key', ['five_wire_skin', 'taxel_array'])
def test_nothing_is_learned_from_one_constant(key: str, level: float) -> None:
    sensor = load_sensor(key)
    lesson = sensor.presses(sensor.config(), 0, 8)
    constant = np.full_like(lesson.values, level)
    pipeline = sensor.pipeline().fit(dataclasses.replace(lesson, values=constant))
    states = pipeline.process_batch(lesson)
    assert not (np.nan_to_num(states.force) != 0).any()
    assert not (np.nan_to_num(states.taxel_force) != 0).any()
    assert 'taxel_force' not in pipeline.estimators
    assert pipeline.estimators.get('position') in (None, 'linear')


@pytest.mark.parametrize('key', ['five_wire_skin', 'taxel_array'])
def test_readings_below_ground_are_no_force(key: str) -> None:
    sensor = load_sensor(key)
    lesson = sensor.presses(sensor.config(), 0, 8)
    values = np.full_like(lesson.values[0], -0.5)
    state = sensor.pipeline().fit(lesson).process(Frame(None, 0, values))
    assert not state.valid
    assert state.status & FrameStatus.BAD_TAXELS
    assert np.isnan(state.force).all()
    assert np.isnan(state.position).all()
    assert state.in_contact == -1
