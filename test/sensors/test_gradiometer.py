# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""The gradiometer in worlds of warm elastomers and magnets: what [3] is to bear, case by case."""

import argparse
import dataclasses
from functools import lru_cache

import numpy as np
import pytest

from reference import gradiometer_world as made
from tactile_ros.pipeline import Pipeline
from tactile_ros.sensors import load_sensor
from tactile_ros.sensors.gradiometer import disc_model
from tactile_ros.sensors.gradiometer.temperature import Thermometer
from tactile_ros.types import Frame, FrameStatus, Recording, Signals

SENSOR = load_sensor('gradiometer')
SEED = 31
SEEDS = (SEED, 41, 52)
WARM = made.Scene(span=50.0, ramp_s=600.0)


@lru_cache
def world(seed: int = SEED) -> made.World:
    return made.World(seed)


@lru_cache
def fitted(seed: int = SEED) -> Pipeline:
    return SENSOR.pipeline(world(seed).config).fit(world(seed).record(300, seed))


@lru_cache
def unlimited() -> tuple[made.World, Pipeline]:
    """A specimen whose pixels reach 1 T, and its calibration without a range."""
    own = made.World(SEED)
    own.config = dataclasses.replace(own.config, saturation=1.0)
    config = dataclasses.replace(own.config, saturation=None)
    return own, SENSOR.pipeline(config).fit(own.record(150, 1))


@lru_cache
def warm_fit() -> Pipeline:
    return SENSOR.pipeline(world().config).fit(world().record(200, 4, WARM))


def errors(
    pipeline: Pipeline, recording: Recording, name: str = 'force'
) -> tuple[np.ndarray, np.ndarray]:
    states = pipeline.process_batch(recording)
    asked = states.valid.copy()
    asked[: world().rest] = False
    sigma = np.sqrt(np.diagonal(getattr(states, f'{name}_cov'), axis1=1, axis2=2))
    return (getattr(states, name) - recording.truth[name])[asked], sigma[asked]


def rms(error: np.ndarray) -> np.ndarray:
    return np.asarray(np.sqrt((error**2).mean(axis=0)))


def noisy(recording: Recording, seed: int, noise: float = 3e-3, gain: float = 2e-3) -> Recording:
    """References with noise (N) and a relative error that is common to all of a frame."""
    rng, force = np.random.default_rng(seed), recording.truth['force']
    wrong = force * (1 + gain * rng.normal(size=(len(force), 1)))
    wrong = wrong + noise * rng.normal(size=force.shape)
    return dataclasses.replace(
        recording, truth={'force': np.where(recording.tare[:, None], 0.0, wrong)}
    )


def signals_of(values: np.ndarray, chips: np.ndarray | None, second: np.ndarray | None) -> Signals:
    count = len(values)
    stamps = None if second is None else (1e9 * second).astype(np.int64)
    return Signals(
        values, values, values, chips, stamps, np.arange(count) == 0, np.zeros(count, np.int8),
        np.ones(count, bool),
    )  # fmt: skip


@pytest.mark.parametrize('turned', [0.0, np.pi / 2])
def test_jacobians_are_the_changes_of_the_models(turned: float) -> None:
    config = made.World(1, turned=turned).config
    answers = [('force', 0), ('force', 2), ('torque', 1), ('position', 0)]
    model = disc_model.disc_prior(config, answers, np.ones(4), 1.3, 33.0, tared=True)
    rng = np.random.default_rng(0)
    x = np.r_[
        0.2, -0.3, -0.5, 0.002, -0.001, 0.3, -0.4, 0.2, 4, -2, 5, 1, 0.01, rng.normal(size=6)
    ]
    p = model.parameters + 0.3 * model.parameter_sigma * rng.normal(size=len(model.parameters))
    for function, count in ((model.readings, 8), (model.answers, 4)):

        def value(x: np.ndarray, p: np.ndarray, count: int = count, function=function):  # noqa: ANN001, ANN202
            out, by_state = np.empty(count), np.zeros((count, len(x)))
            by_parameter = np.zeros((count, len(p)))
            function(x, p, model.data, out, by_state, by_parameter)
            return out, by_state, by_parameter

        for which, at in enumerate((x, p)):
            steps = 1e-5 * np.eye(len(at))
            both = [
                [value(*((x + s, p) if which == 0 else (x, p + s)))[0] for s in (step, -step)]
                for step in steps
            ]
            slope = np.array([(up - down) / 2e-5 for up, down in both]).T
            error = np.abs(value(x, p)[1 + which] - slope).max(axis=0)
            assert (error < 2e-3 * np.abs(slope).max(axis=0) + 1e-6).all()


def test_a_disc_is_the_field_of_magpylib() -> None:
    own = made.World(3, amiss=0.0)
    answers: list[tuple[str, int]] = []
    model = disc_model.disc_prior(own.config, answers, np.zeros(0), 1.0, np.nan, tared=False)
    shift = own.shifts(50, np.random.default_rng(0))
    states = np.zeros((50, disc_model.STATES))
    states[:, :3] = shift / disc_model.MM
    read, _ = disc_model.readings_of(model, model.parameters, states)
    exact = own.field(shift, np.zeros((50, 2)), np.zeros(50))[..., [0, 2]].reshape(50, 8)
    assert np.abs(disc_model.MT * read - exact).max() < 2e-6


@pytest.mark.parametrize(('name', 'count'), [('force', 3), ('torque', 2)])
def test_covariances_hold_by_component(name: str, count: int) -> None:
    found = np.zeros((2, count))
    for seed in SEEDS:
        error, sigma = errors(fitted(seed), world(seed).record(500, 100 + seed), name)
        within = (np.abs(error) / sigma)[:, :count]
        found += [(within < 1).mean(axis=0), (within < 2).mean(axis=0)]
    share = found / len(SEEDS)
    assert (np.abs(share[0] - 0.683) < 0.07).all()
    assert (share[1] > 0.88).all()


def test_noise_of_references_is_found_and_averages_out() -> None:
    pipeline = SENSOR.pipeline(world().config).fit(noisy(world().record(200, 1), 5))
    error, sigma = errors(pipeline, world().record(300, 2))
    assert (rms(error) < [1.2e-3, 1.2e-3, 2e-3]).all()
    found = pipeline.report['force_xyz']
    assert found['groups'] == found['rows']  # frames without times stand alone
    for axis in 'xyz':
        assert found[f'reference_noise_{axis}'] == pytest.approx(3e-3, rel=0.25)
    assert found['inside_one_sigma'] == pytest.approx(0.683, abs=0.05)
    assert (np.abs(error) < 2 * sigma).mean() > 0.85


def test_live_and_batch_have_the_same_bits_beside_a_magnet() -> None:
    recording = world().record(40, 3, made.Scene(magnet=14e-3))
    pipeline = fitted()
    many = pipeline.process_batch(recording)
    disturbed = many.status[world().rest :] & FrameStatus.STRAY_FIELD > 0
    assert disturbed.mean() > 0.9
    pipeline.tare([Frame(None, i, row) for i, row in enumerate(recording.values[: world().rest])])
    base = np.abs(pipeline.baseline - recording.values[: world().rest].mean(axis=0)).max()
    assert base < 1e-12
    rows = range(world().rest, len(recording))
    live = [pipeline.process(Frame(None, i, recording.values[i])) for i in rows]
    for name in ('force', 'force_cov', 'torque', 'torque_cov', 'stray_field'):
        said = np.stack([getattr(one, name) for one in live])
        batch = getattr(many, name)[world().rest :]
        np.testing.assert_allclose(said, batch, rtol=1e-9, atol=1e-15)


def test_0_to_50_degrees_cost_little() -> None:
    hot = rms(errors(warm_fit(), world().record(300, 5, WARM))[0])
    assert (hot < [3e-4, 3e-4, 1.2e-3]).all()
    found = warm_fit().report['disc']
    assert found['remanence_per_degree'] == pytest.approx(-world().weaker, rel=0.15)
    assert found['thermal_lag'] == pytest.approx(world().lag_s, rel=0.2)


def test_a_lag_that_the_config_states_is_taken() -> None:
    config = dataclasses.replace(world().config, thermal_lag=world().lag_s)
    pipeline = SENSOR.pipeline(config).fit(world().record(60, 4, WARM))
    assert pipeline.report['disc']['thermal_lag'] == world().lag_s


def test_outside_the_temperatures_of_the_fit_it_is_flagged() -> None:
    states = warm_fit().process_batch(world().record(300, 5, made.Scene(span=100.0)))
    flagged = states.status & FrameStatus.OUT_OF_RANGE > 0
    assert 0.3 < flagged.mean() < 0.8


def test_without_the_temperatures_of_its_fit_sigmas_are_wider() -> None:
    told = world().record(300, 10, WARM)
    blind = dataclasses.replace(told, temperature_c=np.full((len(told), 4), np.nan))
    error, sigma = errors(warm_fit(), blind)
    assert (np.abs(error) < 2 * sigma).mean() > 0.9
    assert np.median(sigma) > 3 * np.median(errors(warm_fit(), told)[1])


def test_spells_without_a_temperature_are_the_same_live_and_in_a_batch() -> None:
    test = world().record(60, 6, WARM)
    chips = test.temperature_c.copy()
    chips[70:80] = chips[100:105] = np.nan
    test = dataclasses.replace(test, temperature_c=chips)
    pipeline = warm_fit()
    pipeline.tare([test.frame(row) for row in range(world().rest)])
    later = Recording.from_arrays(
        pipeline.layout, test.values[60:], stamp_ns=test.stamp_ns[60:], temperature_c=chips[60:]
    )
    batch = pipeline.process_batch(later)
    assert np.isfinite(batch.force).mean() > 0.9
    pipeline.reset()
    for row in range(len(later)):
        live = pipeline.process(later.frame(row))
        np.testing.assert_allclose(live.force, batch.force[row], rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(live.force_cov, batch.force_cov[row], rtol=1e-7, atol=1e-15)
        assert live.status == batch.status[row]


def test_a_magnet_follows_the_line_between_temperatures_that_are_measured() -> None:
    second = np.arange(60.0)
    chip = 35 + 0.3 * second
    gaps = chip.copy()
    gaps[20:35] = np.nan
    thermometer = Thermometer(8.0).fit(signals_of(np.zeros((60, 1, 2)), chip[:, None], second))
    whole, part = (
        thermometer.follow(signals_of(np.zeros((60, 1, 2)), one[:, None], second), np.zeros(7))
        for one in (chip, gaps)
    )
    after = np.isfinite(gaps)
    np.testing.assert_allclose(part[after, 2], whole[after, 2], atol=1e-9)
    off = np.abs(whole - part)[~after]
    assert (off[:, 0] <= part[~after, 1] + 1e-9).all()
    assert (off[:, 2] <= part[~after, 3] + 1e-9).all()


def test_an_oven_that_begins_to_heat_is_no_noise_of_the_thermometer() -> None:
    second, rng = np.arange(600.0), np.random.default_rng(0)
    chip = np.interp(second, [0, 100, 200, 300, 400, 600], [0, 40, 10, 50, 5, 5])
    values = np.zeros((600, 4, 2))
    assert Thermometer().fit(signals_of(values, chip[:, None], second)).noise_ < 1e-9
    chip = chip + 0.05 * rng.normal(size=600)
    found = Thermometer().fit(signals_of(values, chip[:, None], second))
    assert found.noise_ == pytest.approx(0.05, rel=0.2)


def test_magnets_at_14_mm_are_flagged_and_covered() -> None:
    inside, flagged = [], []
    for k in range(30):
        seed = SEEDS[k % len(SEEDS)]
        near = world(seed).record(5, 200 + k, made.Scene(magnet=14e-3))
        error, sigma = errors(fitted(seed), near)
        inside.append((np.abs(error) < 2 * sigma).mean(axis=0))
        status = fitted(seed).process_batch(near).status[world().rest :]
        flagged.append((status & FrameStatus.STRAY_FIELD > 0).mean())
    assert (np.nanmean(inside, axis=0) > 0.88).all()
    assert np.mean(flagged) > 0.9


def test_fields_leave_no_leak_and_are_estimated() -> None:
    turned = world().record(120, 9, made.Scene(turned=True))
    known = SENSOR.pipeline(world().config).fit(world().record(150, 1), turned)
    for pipeline, most in ((fitted(), 1.5e-3), (known, 5e-4)):
        clean = pipeline.process_batch(world().record(100, 2))
        for stray in 2e-3 * np.eye(3):
            moved = pipeline.process_batch(world().record(100, 2, made.Scene(stray=tuple(stray))))
            asked = clean.valid & moved.valid
            asked[: world().rest] = False
            leak = rms((moved.force - clean.force)[asked])
            assert (leak < most * world().config.full_scale).all()
            if pipeline is known:
                found = moved.stray_field[asked] - stray
                assert np.nanmax(rms(found)[[0, 2]]) < 1e-2 * 2e-3
                assert np.isnan(found[:, 1]).all()


def test_gains_come_from_fields_since_the_tare_although_the_baseline_follows_them() -> None:
    """The twin's programme: magnets pass and the chip warms, at rest as well as in touch."""
    config = dataclasses.replace(SENSOR.config(), rate_hz=20.0, thermal_lag=10.0)
    pipeline = SENSOR.pipeline(config, 'inversion').fit(SENSOR.presses(config, 1))
    assert pipeline.report['disc']['remanence'] == pytest.approx(config.remanence, rel=0.03)
    test = SENSOR.presses(config, 2)
    states = pipeline.process_batch(test)
    touched = states.valid & (test.truth['in_contact'] == 1)
    error = rms((states.force - test.truth['force'])[touched])
    assert (error < 5e-3 * config.full_scale).all()


@pytest.mark.parametrize(
    ('limit', 'common', 'estimator'), [(70e-3, 60e-3, 'inversion'), (15e-3, 0.0, 'polynomial')]
)
def test_case_3_clipped_pixels_look_clean_and_are_flagged_before_the_mean(
    limit: float, common: float, estimator: str
) -> None:
    own, plain_fit = unlimited()
    lesson, fresh = own.record(300, 1), own.record(300, 2)
    touched = np.arange(len(fresh)) >= own.rest
    read = fresh.values + (common * touched)[:, None, None] * np.array([0.6, 0.8])
    clipped = (np.abs(read) >= limit).any(axis=(1, 2)) & touched
    assert clipped.sum() > 200
    read = np.clip(read, -limit, limit)
    # less their mean they are no larger than what the disc alone makes
    usual = np.abs(fresh.values - fresh.values.mean(axis=1, keepdims=True)).max()
    assert np.abs(read - read.mean(axis=1, keepdims=True))[clipped].max() < usual
    seen = Recording.from_arrays(fresh.layout, read, tare=fresh.tare)
    if estimator != 'inversion':
        plain_fit = SENSOR.pipeline(plain_fit.config, estimator).fit(lesson)
    limited = dataclasses.replace(own.config, saturation=limit)
    plain = plain_fit.process_batch(seen)
    right = SENSOR.pipeline(limited, estimator).fit(lesson).process_batch(seen)
    error = np.abs(plain.force - fresh.truth['force'])[clipped & plain.valid]
    assert plain.valid[clipped].mean() > 0.9
    assert (np.median(error, axis=0) > 0.1).all()
    assert not right.valid[clipped].any()
    assert (right.status[clipped] & FrameStatus.SATURATED > 0).all()
    far = touched & (np.abs(read) < limit - 5 * own.noise).all(axis=(1, 2))
    assert right.valid[far].all()


def test_what_no_disc_explains_is_no_force() -> None:
    """A wire that breaks, a magnet on the skin: no newtons by the thousand."""
    own, pipeline = unlimited()
    recording, rng = own.record(200, 2), np.random.default_rng(0)
    values, most = recording.values.copy(), np.abs(own.record(300, 1).truth['force']).max()
    values[own.rest :] += 10 ** rng.uniform(-4, 1, (200, 1, 1)) * rng.normal(size=(200, 4, 2))
    odd = Recording.from_arrays(recording.layout, values, tare=recording.tare)
    states = pipeline.process_batch(odd)
    sigma = np.sqrt(np.diagonal(states.force_cov, axis1=1, axis2=2))
    said = np.isfinite(states.force).all(axis=1)
    assert 0.2 < said[own.rest :].mean() < 0.8
    assert (np.isnan(states.force_cov).all(axis=(1, 2)) == ~said).all()
    assert (states.status[~said] & FrameStatus.ABSTAINED > 0).all()
    lost = ~said & np.isnan(states.torque[:, :2]).all(axis=1)
    assert lost.any()
    assert (states.valid == ~lost).all()
    assert np.nanmax(np.abs(states.force)) <= 2 * most
    assert np.nanmax(sigma) <= most
    clean = pipeline.process_batch(own.record(300, 2))
    assert np.isfinite(clean.force).all()
    assert clean.valid.all()


def test_frames_at_rest_alone_tell_no_force_and_the_report_says_why() -> None:
    rest = world().record(0, 1)
    for told in (rest, dataclasses.replace(rest, truth={})):
        pipeline = SENSOR.pipeline(world().config).fit(told)
        states = pipeline.process_batch(world().record(30, 2))
        assert np.isnan(states.force[states.in_contact != 0]).all()
        assert not states.valid.any()
        assert any('no stiffness' in said for said in pipeline.report)


def test_a_design_trades_range_for_noise() -> None:
    module, parser = SENSOR.design(), argparse.ArgumentParser()
    module.add_arguments(parser)
    gap, magnet, averaging, search = module.tables(SENSOR.config(), parser.parse_args([]))
    noise = [row[2] for row in gap.rows]
    assert noise == sorted(noise)
    assert [row[1] for row in gap.rows] == sorted(row[1] for row in gap.rows)
    assert averaging.rows[1][2] == pytest.approx(0.25, abs=0.03)  # bound at the noise of [3]
    assert search.rows[0][0] == 2.5
    assert len(magnet.rows) == 4
    with pytest.raises(ValueError, match='positive'):
        module.tables(SENSOR.config(), parser.parse_args(['--stray', '-1']))


def test_sigmas_of_few_presses_after_a_long_rest_are_those_of_presses() -> None:
    few = SENSOR.pipeline(world().config).fit(world().record(5, 8))
    error, sigma = errors(few, world().record(300, 2))
    assert (np.abs(error) < 2 * sigma).mean() > 0.7


def test_calibrations_say_what_their_presses_could_not_tell() -> None:
    straight = np.zeros((90, 3))
    straight[60:, 2] = -np.linspace(0.05, 0.6, 30) * world().depth
    pipeline = SENSOR.pipeline(world().config).fit(world().recorded(straight, 3, made.Scene()))
    said = [name for name in pipeline.report if name.startswith('not learned: ')]
    assert any('force beyond' in one and 'full scale is 3.5 N' in one for one in said)
    assert any('no chip measured' in one for one in said)
    assert any('no rest in known fields' in one for one in said)
    test = world().record(300, 2)
    states = pipeline.process_batch(test)
    touched = np.arange(len(test)) >= world().rest
    beyond = states.status & FrameStatus.OUT_OF_RANGE > 0
    assert beyond[touched].mean() > 0.8
    error, sigma = errors(pipeline, test)
    told = np.isfinite(error)  # what sideways presses would mean is mostly not answered
    assert told.mean() < 0.5 or (np.abs(error) < 2 * sigma)[told].mean() > 0.9


def test_the_noise_of_a_tare_of_one_frame_is_stated() -> None:
    error, sigma = [], []
    for k in range(20):
        recording = world().record(20, 500 + k)
        keep = (np.arange(len(recording)) == 0) | (np.arange(len(recording)) >= world().rest)
        one = recording.select(keep)
        states = fitted().process_batch(one)
        error.append((states.force - one.truth['force'])[1:])
        sigma.append(np.sqrt(np.diagonal(states.force_cov, axis1=1, axis2=2))[1:])
    shares = [(np.abs(np.concatenate(error)) < k * np.concatenate(sigma)).mean(axis=0)
              for k in (1, 2)]  # fmt: skip
    assert (shares[0] > 0.55).all()
    assert (shares[1] > 0.9).all()
    lesson = world().record(150, 8)
    few = (np.arange(len(lesson)) == 0) | (np.arange(len(lesson)) >= world().rest)
    poor = SENSOR.pipeline(world().config).fit(lesson.select(few))
    error, sigma = errors(poor, world().record(300, 9))
    assert (np.abs(error) < 2 * sigma).mean() > 0.9


def test_without_the_stray_term_force_is_surer_and_wrong_in_a_field() -> None:
    config = dataclasses.replace(world().config, stray_term=False)
    without = SENSOR.pipeline(config).fit(world().record(200, 1))
    outside = world().record(100, 3, made.Scene(stray=(1e-3, 5e-4, -1e-3)))
    calm = world().record(200, 2)
    assert rms(errors(without, calm)[0]).sum() < 0.95 * rms(errors(fitted(), calm)[0]).sum()
    wrong = np.nanmedian(np.abs(errors(without, outside)[0]))
    assert wrong > 5 * np.median(np.abs(errors(fitted(), outside)[0]))


@pytest.mark.parametrize('estimator', ['polynomial', 'ridge'])
def test_other_estimators_are_chosen_by_name_and_err_more(estimator: str) -> None:
    pipeline = SENSOR.pipeline(world().config, estimator).fit(world().record(300, 1))
    assert set(pipeline.estimators.values()) == {estimator}
    error, sigma = errors(pipeline, world().record(300, 2))
    assert (rms(error) < 0.1).all()
    assert (np.abs(error) < 2 * sigma).mean() > 0.85
    assert set(fitted().estimators.values()) == {'inversion'}
    assert (rms(errors(fitted(), world().record(300, 2))[0]) < 0.2 * rms(error)).all()


def test_difference_basis_sees_no_uniform_field() -> None:
    """Hard case 2: told of the gains, no combination that is left sees the field."""
    response = np.random.default_rng(0).normal(size=(8, 2))
    slope = np.zeros((8, disc_model.STATES))
    slope[:, [disc_model.UNIFORM, disc_model.UNIFORM + 2]] = response
    found = disc_model.difference_basis(slope, np.array([True, False, True]))
    np.testing.assert_allclose(found.T @ found, np.eye(6), atol=1e-12)
    assert np.abs(found.T @ response).max() < 1e-12


def test_touches_lighter_than_the_threshold_are_in_the_covariance() -> None:
    shift = np.zeros((260, 3))
    shift[60:, 2] = -np.random.default_rng(0).uniform(1e-6, 2e-5, 200)
    light = world().recorded(shift, 3, made.Scene())
    states = fitted().process_batch(light)
    error = np.abs(light.truth['force'] - states.force)[60:]
    sigma = np.sqrt(np.diagonal(states.force_cov, axis1=1, axis2=2))[60:]
    assert (error < 3 * sigma).mean() > 0.9
    assert error.max() < 0.02


def test_light_touches_are_told_from_rest_at_any_temperature() -> None:
    scene, shift = made.Scene(span=50.0), np.zeros((260, 3))
    lesson, pressed = world().record(100, 4, scene), np.arange(260) >= world().rest
    pipeline = SENSOR.pipeline(world().config).fit(lesson)
    for depth, contact in ((0.0, 0), (3e-5, 1)):
        shift[pressed, 2] = -depth
        light = world().recorded(shift, 3, scene).select(pressed)
        rest = pipeline.baseline, lesson.temperature_c[lesson.tare].mean(axis=0)
        base, then = (np.repeat(one[None], len(light), axis=0) for one in rest)
        signals = signals_of(light.values, light.temperature_c, None)
        signals = dataclasses.replace(signals, baseline=base, rest_temperature_c=then)
        assert (pipeline.estimation.contact_from_sensor(signals) == contact).all()
