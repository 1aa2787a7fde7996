# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""The five-wire skin on a world that is not the package's own."""

import dataclasses
import time
from collections.abc import Sequence
from functools import lru_cache

import numpy as np
import pytest

from reference import five_wire_sheet as sheets
from reference import five_wire_world as reference
from tactile_ros.conditioning.fading_memory import FadingMemory
from tactile_ros.estimators.power_law_force import PowerLawForce
from tactile_ros.pipeline import Pipeline
from tactile_ros.sensors import load_sensor
from tactile_ros.sensors.five_wire_skin.film import TIME_CONSTANTS, FilmCreep
from tactile_ros.types import Frame, FrameStatus, Recording

SENSOR = load_sensor('five_wire_skin')
LAYOUT = SENSOR.layout(SENSOR.config())


@lru_cache
def learned(kind: str, places: int, seed: int = 70) -> tuple[Pipeline, Recording, object]:
    """Pipeline calibrated on a grid of places, fresh touches, and their world.

    A 'line' solves the border alone, a 'sheet' finite differences; the film of a 'short' is rough.
    """
    short = {'length': 0.012, 'spread': 0.15} if kind == 'short' else {}
    world = reference.FiveWireWorld(seed) if kind == 'line' else sheets.SheetWorld(seed, **short)
    where = np.repeat(reference.grid(places), 8, axis=0)
    load = np.tile(np.linspace(1, 15, 8), places**2)
    pipeline = SENSOR.pipeline().fit(reference.touches(world, LAYOUT, where, load, seed + 1))
    rng = np.random.default_rng(seed + 2)
    fresh, load = rng.uniform(12.5e-3, 87.5e-3, (1500, 2)), rng.uniform(1, 15, 1500)
    return pipeline, reference.touches(world, LAYOUT, fresh, load, seed + 3), world


@pytest.mark.parametrize('kind', ['line', 'sheet'])
def test_force_anywhere_from_49_points(kind: str) -> None:
    pipeline, test, _ = learned(kind, 7)
    states = pipeline.process_batch(test)
    touched = test.truth['in_contact'] == 1
    error = (states.force - test.truth['force'])[touched, 2]
    assert np.sqrt((error**2).mean()) < 0.28
    sigma = np.sqrt(states.force_cov[touched, 2, 2])
    assert 0.4 < (np.abs(error) < sigma).mean() <= 1.0
    assert (np.abs(error) < 3 * sigma).mean() > 0.9


def test_a_floating_foil_is_no_touch_and_shear_is_not_felt() -> None:
    pipeline, test, _ = learned('line', 7)
    states = pipeline.process_batch(test)
    assert (states.in_contact == test.truth['in_contact']).all()
    untouched = states.in_contact == 0
    assert np.isnan(states.position[untouched]).all()
    assert (states.force[untouched, 2] == 0).all()
    assert np.isnan(states.force[:, :2]).all()


def test_the_network_as_printed_gets_worse_between_squares() -> None:
    world = reference.FiveWireWorld(0)
    where, load = np.repeat(reference.grid(4), 15, axis=0), np.tile(np.arange(1.0, 16), 16)
    train = reference.touches(world, LAYOUT, where, load, 1)
    printed = SENSOR.pipeline(estimator='printed').fit(train)
    assert printed.estimators == {'position': 'printed', 'force': 'printed'}
    fresh = np.random.default_rng(2).uniform(12.5e-3, 87.5e-3, (400, 2))
    between = reference.touches(world, LAYOUT, fresh, np.full(400, 8.0), 3)

    def rms(recording: Recording) -> float:
        touched = recording.truth['in_contact'] == 1
        error = printed.process_batch(recording).force - recording.truth['force']
        return float(np.sqrt((error[touched, 2] ** 2).mean()))

    assert rms(between) > 1.2 * rms(train)


def test_unfitted_it_tells_the_place_by_the_formula_and_no_force() -> None:
    pipeline = SENSOR.pipeline()
    recording = SENSOR.presses(SENSOR.config(), 0, 6)
    states = pipeline.process_batch(recording)
    touched = recording.truth['in_contact'] == 1
    error = (states.position - recording.truth['position'])[touched, :2]
    assert np.abs(error).max() < 1e-3
    assert np.isnan(states.force).all()


def test_place_from_25_points_comes_near_the_bound_and_models_serve_from_16() -> None:
    models = {'position': 'harmonic', 'force': 'power'}
    assert learned('sheet', 4)[0].estimators == models
    for pipeline, test, world in (learned('line', 5), learned('sheet', 5)):
        assert pipeline.estimators == models
        touched = test.truth['in_contact'] == 1
        true = test.truth['position'][touched, :2]
        off = np.linalg.norm(pipeline.process_batch(test).position[touched, :2] - true, axis=1)
        assert off.mean() < 1.3 * world.bound(true)


def fresh_touches(kind: str, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Errors and sigmas (s, 3) of x, y (m) and force (N) on held-out places of a world."""
    pipeline, test, _ = learned(kind, 7, seed)
    states, touched = pipeline.process_batch(test), test.truth['in_contact'] == 1
    error = np.column_stack(
        [(states.position - test.truth['position'])[touched, :2],
         (states.force - test.truth['force'])[touched, 2]]
    )  # fmt: skip
    variance = np.column_stack(
        [states.position_cov[touched][:, [0, 1], [0, 1]], states.force_cov[touched, 2, 2]]
    )
    return error, np.sqrt(variance)


def chance(share: float, count: float) -> float:
    """Deviation of a share of touches that chance allows; those between places err together."""
    return max(0.05, 1.96 * float(np.sqrt(share * (1 - share) / count)))


@pytest.mark.parametrize('component', [0, 1])
def test_sigmas_of_places_hold_what_they_say_over_worlds_and_seeds(component: int) -> None:
    worlds = [(kind, seed) for kind in ('sheet', 'line') for seed in (110, 111)]
    shares = []
    for kind, seed in worlds:
        error, sigma = (part[:, component] for part in fresh_touches(kind, seed))
        ratio, order = np.abs(error / sigma), np.argsort(sigma, kind='stable')
        thirds = [(ratio[rows] < 1).mean() for rows in np.array_split(order, 3)]
        shares.append([(ratio < 1).mean(), (ratio < 2).mean(), *thirds])
    one, two, *thirds = np.mean(shares, axis=0)
    groups = 49 * len(worlds)
    assert abs(one - 0.6827) < chance(0.6827, groups)
    assert abs(two - 0.9545) < chance(0.9545, groups)
    assert max(abs(third - 0.6827) for third in thirds) < chance(0.6827, groups / 3)


def test_sigmas_of_forces_hold_what_they_say_over_films() -> None:
    """Smooth films are told better than their sigma, rough ones worse."""
    shares = []
    for kind in ('sheet', 'line', 'short'):
        error, sigma = (part[:, 2] for part in fresh_touches(kind, 110))
        shares.append([(np.abs(error) < n * sigma).mean() for n in (1, 2)])
    one, two = np.mean(shares, axis=0)
    assert abs(one - 0.6827) < 0.1
    assert two > 0.9


def test_force_at_the_calibration_squares_is_the_dividers_noise() -> None:
    _, _, world = learned('sheet', 7)
    where = np.repeat(reference.grid(4), 60, axis=0)
    load = np.tile(np.linspace(1, 15, 60), 16)
    pipeline = SENSOR.pipeline().fit(reference.touches(world, LAYOUT, where, load, 75))
    test = reference.touches(world, LAYOUT, where, load, 76)
    touched = test.truth['in_contact'] == 1
    error = (pipeline.process_batch(test).force - test.truth['force'])[touched, 2]
    assert np.sqrt((error**2).mean()) < 1.15 * world.least(where, load)


def test_a_short_tare_adds_no_noise_of_its_own() -> None:
    pipeline, test, _ = learned('line', 7)
    touched = test.truth['in_contact'] == 1
    shifted = test.values.copy()
    shifted[:5, 0, 2] += 2e-4  # less than the noise of a reading
    other = Recording.from_arrays(
        LAYOUT, shifted, stream=test.stream, tare=test.tare, truth=test.truth
    )
    one, two = (pipeline.process_batch(r).force[touched, 2] for r in (test, other))
    assert np.abs(one - two).max() < 0.02


@lru_cache
def creeping() -> tuple[Pipeline, Recording]:
    """Pipeline that learned a film's past, and a hold of a minute with a rest after it."""
    world, rng = sheets.SheetWorld(80), np.random.default_rng(81)
    where = np.repeat(reference.grid(5), 3, axis=0)
    load = np.tile([3.0, 8.0, 14.0], 25) * rng.uniform(0.9, 1.05, 75)
    pipeline = SENSOR.pipeline().fit(sheets.pressed(world, LAYOUT, where, load, 82))
    assert 'force_z_without_creep' in pipeline.report
    place, load = np.array([[0.05, 0.04]]), np.array([8.0])
    return pipeline, sheets.pressed(world, LAYOUT, place, load, 83, hold_s=80.0)


def test_creep_is_taken_off_where_stamps_tell_the_past() -> None:
    pipeline, hold = creeping()
    free = dataclasses.replace(hold, stamp_ns=None)
    touched = hold.truth['in_contact'] == 1

    def rms(recording: Recording) -> float:
        error = pipeline.process_batch(recording).force - recording.truth['force']
        return float(np.sqrt((error[touched, 2] ** 2).mean()))

    assert rms(hold) < 0.6 * rms(free)


def test_an_offset_that_a_pulled_down_foil_shows_at_rest_moves_no_place() -> None:
    world, rng = reference.FiveWireWorld(3), np.random.default_rng(31)
    where, load = np.repeat(reference.grid(5), 8, axis=0), np.tile(np.linspace(1, 15, 8), 25)
    train = reference.touches(world, LAYOUT, where, load, 32, floating=False)
    pipeline = SENSOR.pipeline().fit(train)
    fresh = rng.uniform(12.5e-3, 87.5e-3, (300, 2))
    test = reference.touches(world, LAYOUT, fresh, rng.uniform(1, 15, 300), 33, floating=False)
    touched = test.truth['in_contact'] == 1

    def miss(offset: float) -> float:
        moved = Recording.from_arrays(
            LAYOUT, np.add(test.values, [offset, -offset, 0.0]), stream=test.stream, tare=test.tare
        )
        error = pipeline.process_batch(moved).position - test.truth['position']
        return float(np.linalg.norm(error[touched, :2], axis=1).mean())

    assert miss(5e-3) < 1.1 * miss(0.0) + 2e-5


def test_hard_case_16_a_floating_foil_and_too_small_a_resistance_stay_finite() -> None:
    pipeline, _, _ = learned('line', 7)
    values = np.array([[0.9, 0.1, 1e-7], [0.5, 0.5, 0.999], [np.inf, -3.0, 0.5], [0.4, 0.6, 1.2]])
    wild = Recording.from_arrays(LAYOUT, values[:, None])
    states = pipeline.process_batch(wild)
    assert states.in_contact[0] == 0
    assert states.force[0, 2] == 0.0
    assert np.isnan(states.position[0]).all()
    assert np.isfinite(states.force[1, 2])
    assert states.force[1, 2] < 40.0
    assert not states.valid[2]
    assert np.isfinite(states.force_cov[1, 2, 2])


def test_the_gaps_threshold_force_is_reported() -> None:
    world, rng = sheets.SheetWorld(90, gap=0.6), np.random.default_rng(91)
    where = rng.uniform(12.5e-3, 87.5e-3, (400, 2))
    pipeline = SENSOR.pipeline().fit(
        reference.touches(world, LAYOUT, where, rng.uniform(0.1, 6, 400), 92)
    )
    told = pipeline.report['contact']
    assert 0.3 < told['threshold_force'] < 1.2
    assert told['lightest_felt'] > 0.3


THREE = SENSOR.config(third_excitation=True)


def with_a_third(recording: Recording, world: object, seed: int) -> Recording:
    """The same touches, with the potential under a third excitation: a sum of the two."""
    clean = world.potentials(np.nan_to_num(recording.truth['position'][:, :2], nan=0.05))
    third = 0.1 + 0.8 * (clean[:, 0] - clean[:, 1] + 0.5)
    third += world.noise * np.random.default_rng(seed).normal(size=len(third))
    return Recording.from_arrays(
        SENSOR.layout(THREE),
        np.concatenate([recording.values, third[:, None, None]], axis=2),
        stream=recording.stream,
        tare=recording.tare,
        truth=recording.truth,
    )


def test_a_third_excitation_makes_the_place_better_and_frames_stay_batches() -> None:
    world, rng = reference.FiveWireWorld(3), np.random.default_rng(4)
    where = np.repeat(reference.grid(5), 8, axis=0)
    train = reference.touches(world, LAYOUT, where, np.tile(np.linspace(1, 15, 8), 25), 5)
    fresh = rng.uniform(12.5e-3, 87.5e-3, (800, 2))
    test = reference.touches(world, LAYOUT, fresh, rng.uniform(1, 15, 800), 6)
    touched, found = test.truth['in_contact'] == 1, {}
    three = SENSOR.pipeline(THREE).fit(with_a_third(train, world, 7))
    more = with_a_third(test, world, 8)
    for name, pipeline, told in (('two', SENSOR.pipeline().fit(train), test), ('3', three, more)):
        states = pipeline.process_batch(told)
        error = (states.position - test.truth['position'])[touched, :2]
        sigma = np.sqrt(states.position_cov[touched][:, [0, 1], [0, 1]])
        found[name] = np.linalg.norm(error, axis=1).mean()
        assert 0.6 < (np.abs(error) < sigma).mean() < 0.77
    assert found['3'] < 0.92 * found['two']
    batch, first = three.process_batch(more), 100
    three.reset()
    frames = [three.process(more.frame(i)) for i in range(first)]
    live = np.array([state.position_cov for state in frames])
    np.testing.assert_array_equal(live[5:], batch.position_cov[5:first])


def test_a_third_excitation_comes_through_the_twin_and_unfitted_the_formula_stays() -> None:
    twin = SENSOR.simulate(THREE, SENSOR.connection(), seed=1)
    with twin, twin.device(time.monotonic_ns) as device:
        frame = device.read(60.0)
    assert frame.values.shape == (1, 4)
    recording = SENSOR.presses(THREE, 0, 6)
    states = SENSOR.pipeline(THREE).process_batch(recording)
    touched = recording.truth['in_contact'] == 1
    assert np.abs((states.position - recording.truth['position'])[touched, :2]).max() < 1e-3
    for estimator in ('printed', 'ridge'):
        fit = SENSOR.pipeline(THREE, estimator=estimator).fit(recording)
        assert np.isfinite(fit.process_batch(recording).position[touched]).all()


@pytest.mark.parametrize('spots', [[12], [0, 5, 10, 15, 20], [0, 4, 21], range(25)])
def test_touches_that_tell_no_map_leave_the_formula(spots: Sequence[int]) -> None:
    where = np.repeat(reference.grid(5)[spots], 6, axis=0)
    load = np.tile(np.linspace(1, 15, 6), len(where) // 6)
    lesson = reference.touches(reference.FiveWireWorld(0), LAYOUT, where, load, 1)
    if len(spots) == 25:
        lesson.values[..., 0] = 0.5
    pipeline = SENSOR.pipeline().fit(lesson)
    assert pipeline.estimators['position'] == 'linear'
    _, test, _ = learned('line', 5)
    states, touched = pipeline.process_batch(test), test.truth['in_contact'] == 1
    error = (states.position - test.truth['position'])[touched, :2]
    sigma = np.sqrt(np.diagonal(states.position_cov, axis1=1, axis2=2))[touched, :2]
    assert (np.abs(error) < 2 * sigma).mean() > 0.9


def test_one_load_tells_no_force() -> None:
    where = np.repeat(reference.grid(5), 2, axis=0)
    lesson = reference.touches(reference.FiveWireWorld(0), LAYOUT, where, np.full(50, 5.0), 1)
    pipeline = SENSOR.pipeline().fit(lesson)
    assert pipeline.estimators == {'position': 'harmonic'}
    assert np.isnan(pipeline.process_batch(lesson).force[lesson.truth['in_contact'] == 1]).all()


# ---------------------------------------------------------------- hard cases


def force(recording: Recording) -> np.ndarray:
    """Normal forces (s,) that the pipeline says of a recording."""
    return creeping()[0].process_batch(recording).force[:, 2]


def held(recording: Recording) -> np.ndarray:
    """Rows in which the skin is touched."""
    return np.flatnonzero(recording.truth['in_contact'] == 1)


def test_case_8_frames_of_one_press_are_never_on_both_sides_of_a_split() -> None:
    rng = np.random.default_rng(5)
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


@pytest.mark.parametrize('reading', [np.nan, np.inf, 1.0, -1e6])
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
    lost = np.abs(anew - clean)[at : at + 250] / clean[at : at + 250]
    assert lost.max() < 0.3
    assert pipeline.process_batch(cut).in_contact[released].max() == 0


@pytest.mark.parametrize('contact', [1, 0], ids=['touched', 'resting'])
def test_rows_at_the_rail_are_neither_learned_from_nor_rest(contact: int) -> None:
    recording = SENSOR.presses(SENSOR.config(), 0, 20)
    spoilt = np.random.default_rng(1).uniform(size=len(recording)) < 0.05
    spoilt &= recording.truth['in_contact'] == contact
    assert spoilt.sum() > 10
    values = recording.values.copy()
    values[spoilt, 0, 2] = 1.0
    shorted, lost = (
        SENSOR.pipeline().fit(dataclasses.replace(recording, values=one))
        for one in (values, np.where(spoilt[:, None, None], np.nan, values))
    )
    np.testing.assert_array_equal(shorted.baseline, lost.baseline)
    np.testing.assert_array_equal(shorted.rest_.noise, lost.rest_.noise)
    one, other = (pipeline.process_batch(recording) for pipeline in (shorted, lost))
    np.testing.assert_array_equal(one.force, other.force)


def test_a_tare_leaves_frames_at_the_rail_out() -> None:
    recording = SENSOR.presses(SENSOR.config(), 0, 6)
    pipeline = SENSOR.pipeline()
    frames = [recording.frame(i) for i in np.flatnonzero(recording.truth['in_contact'] == 0)[:6]]
    pipeline.tare(frames)
    clean, short = pipeline.baseline, frames[0].values.copy()
    short[0, 2] = 1.0
    pipeline.tare([*frames, dataclasses.replace(frames[0], values=short)])
    np.testing.assert_array_equal(pipeline.baseline, clean)


def test_a_constant_reading_stays_what_it_says_and_a_rest_is_no_touch() -> None:
    pipeline, hold = creeping()
    stamps = 40_000_000 * np.arange(50)
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


# ---------------------------------------------------------------- past of a film


def stream(count: int = 120) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Forces with a NaN, stamps with a gap and a step back, and restarts."""
    rng = np.random.default_rng(0)
    force = rng.uniform(1, 9, count)
    force[[7, 30]], force[50:60] = np.nan, 0.0
    stamps = np.cumsum(rng.integers(5, 30, count)) * 1_000_000
    stamps[40:] += 10_000_000_000
    stamps[80:84] -= 5_000_000_000
    return force, stamps, np.isin(np.arange(count), [0, 100])


def crept(share: float = 0.0) -> FilmCreep:
    curve = PowerLawForce()
    curve.gap_ = 0.0
    creep = FilmCreep(curve)
    creep.shares_ = np.full(len(TIME_CONSTANTS), share)
    return creep


def test_film_memory_of_frames_is_that_of_a_batch() -> None:
    columns = stream()
    whole = crept(-0.03).undo(*columns, FadingMemory(TIME_CONSTANTS))
    memory = FadingMemory(TIME_CONSTANTS)
    for row in range(len(columns[0])):
        one = crept(-0.03).undo(*(column[row : row + 1] for column in columns), memory)
        np.testing.assert_array_equal(one[0][0], whole[0][row])
        np.testing.assert_array_equal(one[1][0], whole[1][row])


def test_a_static_force_that_has_crept_is_taken_back_and_a_lost_frame_takes_nothing() -> None:
    stamps = np.arange(400) * 20_000_000
    ratios = crept().undo(np.full(400, 5.0), stamps, stamps == 0, FadingMemory(TIME_CONSTANTS))[1]
    static = 5.0 * np.exp(0.03 * ratios.sum(axis=1))  # 9 % in the end
    force, _ = crept(-0.03).undo(static, stamps, stamps == 0, FadingMemory(TIME_CONSTANTS))
    np.testing.assert_allclose(force, 5.0, rtol=1e-3)
    assert (crept(-0.03).variance(ratios)[1:] > 0).all()
    static[100] = np.nan
    lost, _ = crept(-0.03).undo(static, stamps, stamps == 0, FadingMemory(TIME_CONSTANTS))
    assert np.isnan(lost[100])
    np.testing.assert_allclose(np.delete(lost, 100), 5.0, rtol=1e-3)
