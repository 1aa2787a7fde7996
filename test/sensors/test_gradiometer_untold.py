"""The gradiometer where chips tell their temperature only now and then, and beyond the fit's."""

from __future__ import annotations

import dataclasses
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
import pytest

from reference import gradiometer_world as made
from tactile_ros.sensors import load_sensor
from tactile_ros.sensors.gradiometer.target import bent, ends, grown
from tactile_ros.sensors.gradiometer.temperature import (
    HeldTemperature,
    ThermalMemory,
    lagging,
    lately_told,
    temperature_wander,
    told_ago,
)
from tactile_ros.types import FrameStatus, Recording, Signals

if TYPE_CHECKING:
    from tactile_ros.pipeline import Pipeline

SENSOR = load_sensor('gradiometer')
WARM = made.Scene(span=50.0, ramp_s=600.0)
SPELL = 10  # frames in succession without a temperature, 1.07 s apart


@lru_cache
def fitted() -> tuple[made.World, Pipeline]:
    world = made.World(41)
    return world, SENSOR.pipeline(world.config, 'inversion').fit(world.record(500, 4, WARM))


def now_and_then(recording: Recording, rng: np.random.Generator) -> tuple[Recording, np.ndarray]:
    """A recording whose chips are silent for spells, and for how many frames they are."""
    assert recording.temperature_c is not None
    silent = np.zeros(len(recording), np.int64)
    for start in np.flatnonzero(rng.uniform(size=len(recording)) < 0.02):
        silent[start : start + SPELL] = 1
    silent[0] = 0
    count = np.zeros_like(silent)
    for row in range(1, len(silent)):
        count[row] = (count[row - 1] + 1) * silent[row]
    told = np.where(silent[:, None] > 0, np.nan, recording.temperature_c)
    return dataclasses.replace(recording, temperature_c=told), count


def judged(pipeline: Pipeline, test: Recording) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Errors of force, their sigmas and the rows of valid presses."""
    states = pipeline.process_batch(test)
    rows = np.flatnonzero(states.valid & (states.in_contact != 0))
    sigma = np.sqrt(np.diagonal(states.force_cov, axis1=1, axis2=2))
    return (states.force - test.truth['force'])[rows], sigma[rows], rows


def rms(error: np.ndarray) -> np.ndarray:
    return np.asarray(np.sqrt((error**2).mean(axis=0)))


def test_sigmas_cover_what_a_held_temperature_is_wrong_by_and_grow_with_its_age() -> None:
    world, pipeline = fitted()
    whole = world.record(500, 5, WARM)
    test, silent = now_and_then(whole, np.random.default_rng(0))
    error, sigma, rows = judged(pipeline, test)
    count, z = silent[rows], np.abs(error) / sigma
    assert (count > 0).sum() > 80
    assert (z[count > 0] < 2).mean() > 0.93
    assert 0.5 < (z[count > 0] < 1).mean() < 0.85
    late, soon = sigma[count > 7, 2], sigma[(count > 0) & (count < 3), 2]
    assert np.median(late) > 3 * np.median(soon)


def test_frames_with_a_temperature_are_as_good_after_frames_without_one() -> None:
    world, pipeline = fitted()
    whole = world.record(500, 5, WARM)
    test, silent = now_and_then(whole, np.random.default_rng(0))
    assert test.temperature_c is not None
    test.temperature_c[20:50] = np.nan  # most of the tare
    silent[20:50] = 1
    error, sigma, rows = judged(pipeline, test)
    told = silent[rows] == 0
    usual = judged(pipeline, whole)[0][told]
    assert (rms(error[told]) < 1.4 * rms(usual)).all()
    assert (np.abs(error[told]) < 2 * sigma[told]).mean() > 0.93


def test_spells_without_a_temperature_are_the_same_live_and_in_a_batch() -> None:
    world, pipeline = fitted()
    test, silent = now_and_then(world.record(100, 6, WARM), np.random.default_rng(3))
    resting = [test.frame(row) for row in range(60)]
    pipeline.tare(resting)
    assert test.temperature_c is not None
    assert test.stamp_ns is not None
    later = Recording.from_arrays(
        pipeline.layout, test.values[60:], stamp_ns=test.stamp_ns[60:],
        temperature_c=test.temperature_c[60:],
    )  # fmt: skip
    batch = pipeline.process_batch(later)
    assert silent[60:].max() >= SPELL
    pipeline.reset()
    for row in range(len(later)):
        live = pipeline.process(later.frame(row))
        np.testing.assert_allclose(live.force, batch.force[row], rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(live.force_cov, batch.force_cov[row], rtol=1e-7, atol=1e-15)
        assert live.status == batch.status[row]


def test_a_stream_that_tells_no_temperature_may_have_any_of_the_fit() -> None:
    world, pipeline = fitted()
    test = world.record(200, 5, WARM)
    test = dataclasses.replace(test, temperature_c=np.full((len(test), 4), np.nan))
    error, sigma, rows = judged(pipeline, test)
    assert (np.abs(error) < 2 * sigma).mean() > 0.9
    status = pipeline.process_batch(test).status[rows]
    assert (status & int(FrameStatus.OUT_OF_RANGE) > 0).all()


def test_sigmas_beyond_the_temperatures_of_a_fit_cover_and_are_not_blankets() -> None:
    world, pipeline = fitted()
    test = world.record(400, 5, made.Scene(span=80.0, ramp_s=600.0))
    error, sigma, rows = judged(pipeline, test)
    assert test.temperature_c is not None
    beyond = np.abs(test.temperature_c[rows, 0] - 35) > 25 + 4
    assert beyond.sum() > 100
    assert (np.abs(error[beyond]) < 2 * sigma[beyond]).mean() > 0.93
    assert (np.median(sigma[beyond], axis=0) < 12 * rms(error[beyond])).all()


def stamped(chip: np.ndarray, second: np.ndarray, begins: np.ndarray | None = None) -> Signals:
    values = np.zeros((len(chip), 1, 2))
    return Signals(
        values, values, values, chip[:, None], (1e9 * second).astype(np.int64),
        np.zeros(len(chip), bool), np.zeros(len(chip), np.int8), np.ones(len(chip), bool), begins,
    )  # fmt: skip


def test_temperatures_wander_as_the_recording_says() -> None:
    second = np.arange(4000) * 0.5
    ramp = temperature_wander(stamped(0.1 * second, second), 0.1 * second, 0.0)
    steady = np.searchsorted(ramp[0], [1.0, 8.0, 64.0])
    np.testing.assert_allclose(ramp[1, steady], 0.1 * ramp[0, steady])
    np.testing.assert_allclose(ramp[2, steady], 0.0, atol=1e-9)
    rng = np.random.default_rng(0)
    walk = np.cumsum(0.1 * rng.normal(size=4000))
    noisy = temperature_wander(stamped(walk, second), walk + 0.05 * rng.normal(size=4000), 0.05)
    at = np.searchsorted(noisy[0], [1.0, 8.0, 32.0])
    np.testing.assert_allclose(noisy[1, at], 0.1 * np.sqrt(2 * noisy[0, at]), rtol=0.25)
    np.testing.assert_allclose(noisy[2, at], 0.5 * noisy[1, at], rtol=0.25)
    assert noisy[1, -1] == pytest.approx(np.sqrt(2) * walk.std(), rel=0.05)


def test_without_times_nothing_tells_how_fast_temperatures_move() -> None:
    chip = np.random.default_rng(0).uniform(20, 50, 200)
    signals = dataclasses.replace(stamped(chip, np.arange(200.0)), stamp_ns=None)
    wander = temperature_wander(signals, chip, 0.0)
    assert np.interp(0.01, wander[0], wander[1]) == pytest.approx(np.sqrt(2) * chip.std())


def test_a_stream_holds_no_temperature_of_another() -> None:
    chip = np.array([20.0, 21.0, np.nan, np.nan, 40.0, np.nan])
    begins = np.array([True, False, False, True, False, False])
    held = HeldTemperature()(stamped(chip, np.arange(6.0), begins))
    assert held.temperature_c is not None
    np.testing.assert_array_equal(held.temperature_c[:, 0], [20, 21, 21, np.nan, 40, 40])
    np.testing.assert_array_equal(told_ago(held), [0, 0, 1, np.inf, 0, 1])


def test_frames_that_tell_nothing_are_held_as_those_that_tell_nan() -> None:
    told = stamped(np.full(3, 30.0), np.arange(3.0))
    silent = stamped(np.full(2, np.nan), np.arange(3.0, 5.0))
    nothing = dataclasses.replace(silent, temperature_c=None)
    held = HeldTemperature()
    held(told)
    found = held(nothing)
    assert (found.temperature_c == 30.0).all()
    assert told_ago(found).tolist() == [1.0, 2.0]
    assert HeldTemperature()(nothing) is nothing  # a stream that never told any


def test_rows_that_never_told_a_temperature_are_learned_from() -> None:
    chip = np.array([30.0, 30.0, np.nan, np.nan, np.nan, 30.0])
    begins = np.arange(6) == 3
    aged = HeldTemperature()(stamped(chip, np.arange(6.0), begins))
    assert lately_told(aged).tolist() == [True, True, False, True, True, True]
    other = HeldTemperature()(stamped(np.full(6, np.nan), np.arange(6.0), begins))
    assert lately_told(other).all()


def test_a_disc_follows_the_line_between_temperatures_that_are_told() -> None:
    second = np.arange(60.0)
    chip = 35 + 0.3 * second
    gaps = chip.copy()
    gaps[20:35] = np.nan
    whole = lagging(stamped(chip, second), chip, 35.0, ThermalMemory(8.0))
    held = HeldTemperature()(stamped(gaps, second))
    assert held.temperature_c is not None
    warm = held.temperature_c[:, 0]
    told = lagging(held, warm, 35.0, ThermalMemory(8.0), np.nan_to_num(chip - warm))
    after = np.isfinite(gaps)
    np.testing.assert_allclose(told[after, 0], whole[after, 0], atol=1e-12)
    off = 25 * (whole[:, 0] - told[:, 0])
    assert (off[~after] > 0).all()
    assert (off <= told[:, 2] + 1e-9).all()


def test_a_cubic_of_the_temperature_is_found_and_grows_as_one() -> None:
    rng = np.random.default_rng(0)
    warm, place = rng.uniform(-1, 1, 800), rng.normal(size=(800, 3))
    errors = 1e-3 * rng.normal(size=(800, 2))
    errors[:, 0] += 0.01 * (4 * warm**3 - 3 * warm)
    bend = bent(errors, warm, place)
    np.testing.assert_allclose(bend[0], 0.01, rtol=0.1)
    assert bend[1] < 2e-4
    far = ends(np.array([0.0, 15.0]), np.array([20.0, 50.0]))
    np.testing.assert_allclose(far, [1.0, 2.0])
    cov = grown(np.tile(np.eye(1), (2, 1, 1)), np.array([0.5]), far)[:, 0, 0]
    np.testing.assert_allclose(cov, [1.0, 7.0**2 + 0.25 * (26.0**2 - 1)])


def shares(pipeline: Pipeline, test: Recording) -> tuple[float, float]:
    """Shares of errors inside one and two sigma."""
    error, sigma, _ = judged(pipeline, test)
    z = np.abs(error) / sigma
    return float((z < 1).mean()), float((z < 2).mean())


def test_a_lag_that_nobody_told_is_told_of_and_held_by_sigmas_of_streams() -> None:
    world = made.World(41)
    loose = made.Scene(span=50.0)  # without stamps, the disc as warm as the chip
    pipeline = SENSOR.pipeline(world.config, 'inversion').fit(world.record(150, 4, loose))
    said = 'not told: how the disc lags behind the chip: no stamps tell it, nor thermal_lag'
    assert said in pipeline.report
    one, two = shares(pipeline, world.record(200, 5, WARM))
    assert one > 0.6  # 0.09 while the disc was taken to be as warm as the chip
    assert two > 0.87
    test = world.record(60, 7, WARM)
    assert test.stamp_ns is not None
    assert test.temperature_c is not None
    pipeline.tare([test.frame(row) for row in range(world.rest)])
    later = Recording.from_arrays(
        pipeline.layout, test.values[60:], stamp_ns=test.stamp_ns[60:],
        temperature_c=test.temperature_c[60:],
    )  # fmt: skip
    batch = pipeline.process_batch(later)
    pipeline.reset()
    for row in range(len(later)):
        live = pipeline.process(later.frame(row))
        np.testing.assert_allclose(live.force_cov, batch.force_cov[row], rtol=1e-7, atol=1e-15)
    same, _ = shares(pipeline, world.record(200, 6, loose))
    assert 0.55 < same < 0.85  # where there is no time, nothing is wider
    features = pipeline.estimation.features_
    features.config = dataclasses.replace(world.config, thermal_lag=8.0)
    assert features.lag_is_told
    assert not any('lags behind' in one for one in pipeline.report)


def test_frames_without_time_may_be_as_far_behind_as_the_lag_that_was_found() -> None:
    world, pipeline = fitted()
    assert not any('lags behind' in one for one in pipeline.report)
    bare = dataclasses.replace(world.record(300, 5, WARM), stamp_ns=None)
    one, two = shares(pipeline, bare)
    assert one > 0.45  # 0.08 while the disc was taken to be as warm as the chip
    assert two > 0.9


def test_a_stream_that_tells_no_temperature_is_flagged_after_one_temperature_too() -> None:
    world, scene = made.World(41), made.Scene(span=0.01, ramp_s=100.0)
    pipeline = SENSOR.pipeline(world.config, 'differences').fit(world.record(60, 4, scene))
    test = world.record(40, 5, scene)
    assert test.temperature_c is not None
    later = test.temperature_c.copy()
    later[30:] = np.nan  # told before, and held
    silent = np.full_like(later, np.nan)
    for told, flagged in ((test.temperature_c, 0), (later, 0), (silent, 1), (None, 1)):
        states = pipeline.process_batch(dataclasses.replace(test, temperature_c=told))
        outside = states.status[states.in_contact != 0] & int(FrameStatus.OUT_OF_RANGE) > 0
        assert outside.mean() == flagged


def test_rows_left_out_since_chips_told_their_temperature_earlier_are_counted() -> None:
    world = made.World(41)
    recording, silent = now_and_then(world.record(200, 4, WARM), np.random.default_rng(0))
    pipeline = SENSOR.pipeline(world.config, 'differences').fit(recording)
    count = int((silent > 0).sum())
    assert count > 10
    told = f'not told: temperatures in {count} rows, which were not learned from'
    assert told in pipeline.report
    whole = SENSOR.pipeline(world.config, 'differences').fit(world.record(200, 4, WARM))
    assert not any('rows, which were not learned' in one for one in whole.report)
