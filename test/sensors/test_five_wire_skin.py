# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""The five-wire skin on a world that is not the package's own."""

from __future__ import annotations

import time
from functools import lru_cache
from importlib import import_module
from types import ModuleType

import numpy as np
import pytest

from tactile_ros.pipeline import Pipeline
from tactile_ros.sensors import load_sensor
from tactile_ros.types import Recording, Signals


def world_of(name: str) -> ModuleType:
    """Module of a world."""
    return import_module(f'reference.{name}')


reference, sheets = world_of('five_wire_world'), world_of('five_wire_sheet')
SENSOR = load_sensor('five_wire_skin')
LAYOUT = SENSOR.layout(SENSOR.config())


@lru_cache
def fitted(places: int, loads: int, seed: int = 0) -> tuple[Pipeline, Recording, object]:
    """Pipeline calibrated on a grid, fresh touches, and their world."""
    world = reference.FiveWireWorld(seed)
    where = np.repeat(reference.grid(places), loads, axis=0)
    load = np.tile(np.linspace(1, 15, loads), places**2)
    pipeline = SENSOR.pipeline().fit(reference.touches(world, LAYOUT, where, load, seed + 10))
    rng = np.random.default_rng(seed + 20)
    fresh = rng.uniform(12.5e-3, 87.5e-3, (1500, 2))
    test = reference.touches(world, LAYOUT, fresh, rng.uniform(1, 15, 1500), seed + 30)
    return pipeline, test, world


@pytest.mark.parametrize('seed', [0, 1])
def test_place_from_25_points_comes_near_the_bound(seed: int) -> None:
    pipeline, test, world = fitted(5, 10, seed)
    states = pipeline.process_batch(test)
    touched = test.truth['in_contact'] == 1
    true = test.truth['position'][touched]
    error = np.linalg.norm((states.position[touched] - true)[:, :2], axis=1).mean()
    assert pipeline.estimators['position'] == 'harmonic'
    assert error < 1.3 * world.bound(true[:, :2])


@pytest.mark.parametrize('seed', [0, 1])
def test_force_anywhere_from_49_points(seed: int) -> None:
    pipeline, test, _ = fitted(7, 8, seed)
    states = pipeline.process_batch(test)
    touched = test.truth['in_contact'] == 1
    error = (states.force - test.truth['force'])[touched, 2]
    assert np.sqrt((error**2).mean()) < 0.28
    sigma = np.sqrt(states.force_cov[touched, 2, 2])
    assert 0.4 < (np.abs(error) < sigma).mean() <= 1.0
    assert (np.abs(error) < 3 * sigma).mean() > 0.9


def test_a_floating_foil_is_no_touch_and_shear_is_not_felt() -> None:
    pipeline, test, _ = fitted(7, 8)
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


@lru_cache
def on_a_sheet(places: int, seed: int = 70) -> tuple[Pipeline, Recording, object]:
    """Pipeline calibrated on the world of finite differences, fresh touches, and the world."""
    world = sheets.SheetWorld(seed)
    where = np.repeat(reference.grid(places), 8, axis=0)
    load = np.tile(np.linspace(1, 15, 8), places**2)
    pipeline = SENSOR.pipeline().fit(reference.touches(world, LAYOUT, where, load, seed + 1))
    rng = np.random.default_rng(seed + 2)
    fresh, load = rng.uniform(12.5e-3, 87.5e-3, (1500, 2)), rng.uniform(1, 15, 1500)
    return pipeline, reference.touches(world, LAYOUT, fresh, load, seed + 3), world


@pytest.mark.parametrize('places', [4, 5, 7])
def test_the_model_is_chosen_at_16_25_and_49_places(places: int) -> None:
    for pipeline, _, _ in (on_a_sheet(places), fitted(places, 8)):
        assert pipeline.estimators == {'position': 'harmonic', 'force': 'power'}


def test_on_a_sheet_with_pads_and_a_rough_film_the_aims_are_held() -> None:
    pipeline, test, world = on_a_sheet(7)
    states, touched = pipeline.process_batch(test), test.truth['in_contact'] == 1
    error = (states.force - test.truth['force'])[touched, 2]
    assert np.sqrt((error**2).mean()) < 0.28
    states = on_a_sheet(5)[0].process_batch(test)
    off = np.linalg.norm((states.position - test.truth['position'])[touched, :2], axis=1)
    assert off.mean() < 1.3 * world.bound(test.truth['position'][touched, :2])


@lru_cache
def fresh_touches(kind: str, places: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Errors and sigmas (s, 3) of x, y (m) and force (N) on held-out places of a world."""
    short = {'length': 0.012, 'spread': 0.15} if kind == 'short' else {}
    world = reference.FiveWireWorld(seed) if kind == 'line' else sheets.SheetWorld(seed, **short)
    where = np.repeat(reference.grid(places), 8, axis=0)
    load = np.tile(np.linspace(1, 15, 8), places**2)
    pipeline = SENSOR.pipeline().fit(reference.touches(world, LAYOUT, where, load, seed + 1))
    rng = np.random.default_rng(seed + 2)
    fresh, load = rng.uniform(12.5e-3, 87.5e-3, (1500, 2)), rng.uniform(1, 15, 1500)
    test = reference.touches(world, LAYOUT, fresh, load, seed + 3)
    states, touched = pipeline.process_batch(test), test.truth['in_contact'] == 1
    error = np.column_stack(
        [
            (states.position - test.truth['position'])[touched, :2],
            (states.force - test.truth['force'])[touched, 2],
        ]
    )
    sigma = np.sqrt(
        np.column_stack(
            [
                states.position_cov[touched][:, [0, 1], [0, 1]],
                states.force_cov[touched, 2, 2],
            ]
        )
    )
    return error, sigma


@pytest.mark.parametrize('places', [5, 7])
@pytest.mark.parametrize('component', [0, 1])
def test_sigmas_of_places_hold_what_they_say_over_worlds_and_seeds(
    places: int, component: int
) -> None:
    worlds = [(kind, seed) for kind in ('sheet', 'line') for seed in (110, 111)]
    shares = []
    for kind, seed in worlds:
        error, sigma = (part[:, component] for part in fresh_touches(kind, places, seed))
        ratio, order = np.abs(error / sigma), np.argsort(sigma, kind='stable')
        thirds = [(ratio[rows] < 1).mean() for rows in np.array_split(order, 3)]
        shares.append([(ratio < 1).mean(), (ratio < 2).mean(), *thirds])
    one, two, *thirds = np.mean(shares, axis=0)
    groups = len(worlds) * places**2  # touches between the same places err together

    def chance(share: float, count: float) -> float:
        return max(0.05, 1.96 * float(np.sqrt(share * (1 - share) / count)))

    assert abs(one - 0.6827) < chance(0.6827, groups)
    assert abs(two - 0.9545) < chance(0.9545, groups)
    assert max(abs(third - 0.6827) for third in thirds) < chance(0.6827, groups / 3)


@pytest.mark.parametrize('places', [5, 7])
def test_sigmas_of_forces_hold_what_they_say_over_films(places: int) -> None:
    """Smooth films are told better than their sigma, rough ones worse; few places say which."""
    shares = []
    for kind in ('sheet', 'line', 'short'):
        for seed in (110, 111):
            error, sigma = (part[:, 2] for part in fresh_touches(kind, places, seed))
            shares.append([(np.abs(error) < n * sigma).mean() for n in (1, 2)])
    one, two = np.mean(shares, axis=0)
    assert abs(one - 0.6827) < (0.07 if places == 7 else 0.16)
    assert two > 0.9


def test_force_at_the_calibration_squares_is_the_dividers_noise() -> None:
    _, _, world = on_a_sheet(7)
    where = np.repeat(reference.grid(4), 60, axis=0)
    load = np.tile(np.linspace(1, 15, 60), 16)
    pipeline = SENSOR.pipeline().fit(reference.touches(world, LAYOUT, where, load, 75))
    test = reference.touches(world, LAYOUT, where, load, 76)
    touched = test.truth['in_contact'] == 1
    error = (pipeline.process_batch(test).force - test.truth['force'])[touched, 2]
    assert np.sqrt((error**2).mean()) < 1.15 * world.least(where, load)


def test_frames_are_batches_bit_for_bit() -> None:
    pipeline, test, _ = on_a_sheet(5)
    batch, first = pipeline.process_batch(test), 300
    pipeline.reset()
    frames = [pipeline.process(test.frame(i)) for i in range(first)]
    for name in ('position', 'position_cov', 'force', 'force_cov', 'in_contact'):
        live = np.array([getattr(state, name) for state in frames])
        np.testing.assert_array_equal(live[5:], getattr(batch, name)[5:first])


def test_contact_is_told_by_the_divider_and_changes_nothing() -> None:
    pipeline, test, _ = fitted(7, 8)
    usable = test.values[5:]
    signals = Signals(
        usable, usable - pipeline.baseline, np.broadcast_to(pipeline.baseline, usable.shape),
        None, None, np.zeros(len(usable), bool), np.ones(len(usable), np.int8),
        np.ones(len(usable), bool),
    )  # fmt: skip
    contact = pipeline.estimation.contact_from_sensor(signals)
    np.testing.assert_array_equal(contact, test.truth['in_contact'][5:])
    assert (signals.in_contact == 1).all()


def test_a_short_tare_adds_no_noise_of_its_own() -> None:
    pipeline, test, _ = fitted(7, 8)
    touched = test.truth['in_contact'] == 1
    shifted = test.values.copy()
    shifted[:5, 0, 2] += 2e-4  # less than the noise of a reading
    other = Recording.from_arrays(
        LAYOUT, shifted, stream=test.stream, tare=test.tare, truth=test.truth
    )
    one, two = (pipeline.process_batch(r).force[touched, 2] for r in (test, other))
    assert np.abs(one - two).max() < 0.02


def test_creep_is_taken_off_where_stamps_tell_the_past() -> None:
    world, rng = sheets.SheetWorld(80), np.random.default_rng(81)
    where = np.repeat(reference.grid(5), 3, axis=0)
    load = np.tile([3.0, 8.0, 14.0], 25) * rng.uniform(0.9, 1.05, 75)
    train = sheets.pressed(world, LAYOUT, where, load, 82)
    test = sheets.pressed(world, LAYOUT, where[::2], load[::2][::-1], 83)
    pipeline = SENSOR.pipeline().fit(train)
    touched = test.truth['in_contact'] == 1

    def rms() -> float:
        error = pipeline.process_batch(test).force - test.truth['force']
        return float(np.sqrt((error[touched, 2] ** 2).mean()))

    with_past, pipeline.estimation.crept_ = rms(), None
    assert with_past < 0.6 * rms()


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
    pipeline, _, _ = fitted(7, 8)
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
        frame = device.read(5.0)
    assert frame.values.shape == (1, 4)
    recording = SENSOR.presses(THREE, 0, 6)
    states = SENSOR.pipeline(THREE).process_batch(recording)
    touched = recording.truth['in_contact'] == 1
    assert np.abs((states.position - recording.truth['position'])[touched, :2]).max() < 1e-3
    for estimator in ('printed', 'ridge'):
        fit = SENSOR.pipeline(THREE, estimator=estimator).fit(recording)
        assert np.isfinite(fit.process_batch(recording).position[touched]).all()


@pytest.mark.parametrize('spots', ['one', 'line', 'still'])
def test_touches_that_tell_no_map_leave_the_formula(spots: str) -> None:
    world, grid = reference.FiveWireWorld(0), reference.grid(5)
    where = np.repeat({'one': grid[12:13], 'line': grid[::5], 'still': grid}[spots], 6, axis=0)
    load = np.tile(np.linspace(1, 15, 6), len(where) // 6)
    lesson = reference.touches(world, LAYOUT, where, load, 1)
    if spots == 'still':
        lesson.values[..., 0] = 0.5
    pipeline = SENSOR.pipeline().fit(lesson)
    assert pipeline.estimators['position'] == 'linear'
    _, test, _ = fitted(5, 10)
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
