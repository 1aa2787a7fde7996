"""The gradiometer in worlds of warm elastomers and magnets: what [3] is to bear, case by case."""

from __future__ import annotations

import argparse
import dataclasses
from functools import lru_cache

import numpy as np
import pytest

from reference import gradiometer_world as made
from tactile_ros.errors import NotCalibratedError
from tactile_ros.estimators.disc_model import UniformField
from tactile_ros.estimators.disturbance_magnet import (
    NearbyMagnets,
    magnet_fields,
    magnet_shape,
)
from tactile_ros.estimators.polynomial_force import WarmChain
from tactile_ros.estimators.polynomial_ridge import WarmPolynomial
from tactile_ros.pipeline import Pipeline
from tactile_ros.sensors import load_sensor
from tactile_ros.sensors.gradiometer.temperature import ThermalMemory, lagging
from tactile_ros.types import Frame, FrameStatus, Recording, Signals

SENSOR = load_sensor('gradiometer')
SEED = 31
SEEDS = (SEED, 41, 52, 63)


@lru_cache
def world(seed: int = SEED) -> made.World:
    return made.World(seed)


@lru_cache
def fitted(seed: int = SEED) -> Pipeline:
    # presses and noise of its own: shares of specimens with the same draws are off together
    return SENSOR.pipeline(world(seed).config).fit(world(seed).record(300, seed))


def errors(
    pipeline: Pipeline, recording: Recording, name: str = 'force'
) -> tuple[np.ndarray, np.ndarray]:
    states = pipeline.process_batch(recording)
    asked = states.valid.copy()
    asked[: world().rest] = False
    sigma = np.sqrt(np.diagonal(getattr(states, f'{name}_cov'), axis1=1, axis2=2))
    return (getattr(states, name) - recording.truth[name])[asked], sigma[asked]


def stamped(second: float) -> Signals:
    """A frame of a stream that began at 0 s, and of which only the time matters."""
    blank = np.zeros((1, 4, 2))
    return Signals(
        blank, blank, blank, None, np.array([round(1e9 * second)]), np.array([second == 0]),
        np.zeros(1, np.int8), np.ones(1, bool),
    )  # fmt: skip


def rms(error: np.ndarray) -> np.ndarray:
    return np.asarray(np.sqrt((error**2).mean(axis=0)))


@pytest.mark.parametrize(('name', 'count'), [('force', 3), ('torque', 2)])
def test_covariances_hold_by_component_and_by_third_of_the_sigma(name: str, count: int) -> None:
    found = np.zeros((2, count, 4))
    for seed in SEEDS:
        error, sigma = errors(fitted(seed), world(seed).record(2000, 100 + seed), name)
        for k in range(count):
            order = np.argsort(sigma[:, k])
            for part, rows in enumerate((order, *np.array_split(order, 3))):
                within = np.abs(error[rows, k]) / sigma[rows, k]
                found[:, k, part] += [(within < 1).mean(), (within < 2).mean()]
    share = found / len(SEEDS)
    # 5 points, and as many as 300 presses of four specimens leave to chance
    assert (np.abs(share[0] - 0.683) < 0.07).all()
    assert (np.abs(share[1] - 0.954) < 0.05).all()


@pytest.mark.parametrize('magnet', [np.inf, 14e-3])
def test_live_and_batch_have_the_same_bits(magnet: float) -> None:
    recording = world().record(60, 3, made.Scene(magnet=magnet))
    pipeline = fitted()
    many = pipeline.process_batch(recording)
    disturbed = many.status[world().rest :] & FrameStatus.STRAY_FIELD > 0
    assert disturbed.mean() > 0.9 if np.isfinite(magnet) else not disturbed.any()
    pipeline.tare([Frame(None, i, row) for i, row in enumerate(recording.values[: world().rest])])
    base = np.abs(pipeline.baseline - recording.values[: world().rest].mean(axis=0)).max()
    assert base < 1e-12
    rows = range(world().rest, len(recording))
    live = [pipeline.process(Frame(None, i, recording.values[i])) for i in rows]
    for name in ('force', 'force_cov', 'torque', 'torque_cov', 'stray_field'):
        said = np.stack([getattr(one, name) for one in live])
        batch = getattr(many, name)[world().rest :]
        np.testing.assert_allclose(said, batch, rtol=1e-9, atol=1e-15)


@pytest.mark.parametrize('ramp_s', [0.0, 600.0])
def test_0_to_50_degrees_cost_less_than_half_as_much_again(ramp_s: float) -> None:
    scene = made.Scene(span=50.0, ramp_s=ramp_s)
    warm = SENSOR.pipeline(world().config).fit(world().record(500, 4, scene))
    still = SENSOR.pipeline(world().config).fit(world().record(500, 4))
    hot = rms(errors(warm, world().record(500, 5, scene))[0])
    cold = rms(errors(still, world().record(500, 5))[0])
    assert (hot < 1.5 * cold).all()
    found = warm.report['disc']
    assert found['remanence_per_unit'] == pytest.approx(-25 * world().weaker, rel=0.05)
    if ramp_s:
        assert found['thermal_lag'] == pytest.approx(world().lag_s, rel=0.1)


def test_a_tare_that_warms_tells_noise_and_lag_all_the_same() -> None:
    config = dataclasses.replace(world().config, noise=None)
    scene = made.Scene(span=50.0, ramp_s=600.0)
    pipeline = SENSOR.pipeline(config, 'inversion').fit(world().record(300, 4, scene))
    assert pipeline.estimation.features_.readings_.noise == pytest.approx(2e-6, rel=0.3)
    assert pipeline.report['disc']['thermal_lag'] == pytest.approx(world().lag_s, rel=0.1)


def test_a_lag_that_the_config_states_is_taken() -> None:
    config = dataclasses.replace(world().config, thermal_lag=world().lag_s)
    scene = made.Scene(span=50.0, ramp_s=600.0)
    pipeline = SENSOR.pipeline(config).fit(world().record(300, 4, scene))
    assert pipeline.report['disc']['thermal_lag'] == world().lag_s


def test_outside_the_temperatures_of_the_fit_it_says_so() -> None:
    few = world().record(300, 4, made.Scene(span=20.0))
    pipeline = SENSOR.pipeline(world().config).fit(few)
    states = pipeline.process_batch(world().record(300, 5, made.Scene(span=60.0)))
    said = states.status & FrameStatus.OUT_OF_RANGE > 0
    assert 0.4 < said.mean() < 0.8
    sigma = np.sqrt(states.force_cov[:, 2, 2])
    touched = np.arange(len(said)) >= world().rest
    assert np.nanmedian(sigma[touched & said]) > 3 * np.nanmedian(sigma[touched & ~said])


def test_magnets_at_14_mm_are_told_and_covered() -> None:
    inside, told, ratio = [], [], []
    for k in range(120):
        seed = SEEDS[k % len(SEEDS)]
        near = world(seed).record(10, 200 + k, made.Scene(magnet=14e-3))
        error, sigma = errors(fitted(seed), near)
        inside.append((np.abs(error) < 2 * sigma).mean(axis=0))
        ratio.append(np.abs(error) / sigma)
        status = fitted(seed).process_batch(near).status[world().rest :]
        told.append((status & FrameStatus.STRAY_FIELD > 0).mean())
    # 95 %, as far as magnets, each of which is right or wrong as a whole, can tell
    share, chance = np.nanmean(inside, axis=0), np.nanstd(inside, axis=0) / np.sqrt(len(inside))
    assert (share > 0.94).all()
    assert (share + chance > 0.95).all()
    assert (np.median(np.concatenate(ratio), axis=0) > 0.3).all()  # 0.67 if normal: not too wide
    assert np.mean(told) > 0.9


def test_a_rest_in_known_fields_leaves_no_leak() -> None:
    turned = world().record(200, 9, made.Scene(turned=True))
    pipeline = SENSOR.pipeline(world().config).fit(world().record(300, 1), turned)
    clean = pipeline.process_batch(world().record(300, 2))
    for stray in 2e-3 * np.eye(3):
        moved = pipeline.process_batch(world().record(300, 2, made.Scene(stray=tuple(stray))))
        asked = clean.valid & moved.valid
        leak = rms((moved.force - clean.force)[asked])
        assert (leak < 5e-4 * world().config.full_scale).all()


def test_gains_come_from_fields_since_the_tare_although_the_baseline_follows_them() -> None:
    """The twin's programme: magnets pass and the chip warms, at rest as well as in touch."""
    config = dataclasses.replace(SENSOR.config(), rate_hz=60.0)
    pipeline = SENSOR.pipeline(config, 'inversion').fit(SENSOR.presses(config, 1))
    assert pipeline.report['disc']['remanence'] == pytest.approx(config.remanence, rel=0.03)
    test = SENSOR.presses(config, 2)
    states = pipeline.process_batch(test)
    touched = states.valid & (test.truth['in_contact'] == 1)
    error = rms((states.force - test.truth['force'])[touched])
    assert (error < 5e-3 * config.full_scale).all()


@pytest.mark.parametrize('estimator', ['inversion', 'polynomial'])
@pytest.mark.parametrize(('limit', 'common'), [(70e-3, 60e-3), (15e-3, 0.0)])
def test_case_3_clipped_pixels_look_clean_and_are_flagged_before_the_mean(
    limit: float, common: float, estimator: str
) -> None:
    own = made.World(SEED)
    own.config = dataclasses.replace(own.config, saturation=1.0)
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
    states = []
    for told in (None, limit):
        config = dataclasses.replace(own.config, saturation=told)
        states.append(SENSOR.pipeline(config, estimator).fit(lesson).process_batch(seen))
    plain, right = states
    error = np.abs(plain.force - fresh.truth['force'])[clipped & plain.valid]
    assert plain.valid[clipped].mean() > 0.9
    assert (np.median(error, axis=0) > 0.1).all()
    assert not right.valid[clipped].any()
    assert (right.status[clipped] & FrameStatus.SATURATED > 0).all()
    far = touched & (np.abs(read) < limit - 5 * own.noise).all(axis=(1, 2))
    assert right.valid[far].all()


@pytest.mark.parametrize('estimator', [None, 'polynomial'])
def test_what_no_disc_explains_is_no_force(estimator: str | None) -> None:
    """A wire that breaks, a magnet on the skin: no newtons by the thousand."""
    config = dataclasses.replace(world().config, saturation=None)
    pipeline = SENSOR.pipeline(config, estimator).fit(world().record(300, 1))
    recording, rng = world().record(200, 2), np.random.default_rng(0)
    values, most = recording.values.copy(), np.abs(world().record(300, 1).truth['force']).max()
    values[world().rest :] += 10 ** rng.uniform(-4, 1, (200, 1, 1)) * rng.normal(size=(200, 4, 2))
    odd = Recording.from_arrays(SENSOR.layout(config), values, tare=recording.tare)
    states = pipeline.process_batch(odd)
    sigma = np.sqrt(np.diagonal(states.force_cov, axis1=1, axis2=2))
    said = np.isfinite(states.force).all(axis=1)
    assert 0.2 < said[world().rest :].mean() < 0.8
    assert (np.isnan(states.force_cov).all(axis=(1, 2)) == ~said).all()
    assert (states.status[~said] & FrameStatus.ABSTAINED > 0).all()
    lost = ~said & np.isnan(states.torque[:, :2]).all(axis=1)
    assert lost.any()
    assert (states.valid == ~lost).all()
    assert np.nanmax(np.abs(states.force)) <= 2 * most
    assert np.nanmax(sigma) <= most
    clean = pipeline.process_batch(world().record(300, 2))
    assert np.isfinite(clean.force).all()
    assert clean.valid.all()


def test_frames_at_rest_alone_tell_no_force_and_the_report_says_why() -> None:
    recording = world().record(50, 1)
    rest = recording.select(np.arange(len(recording)) < world().rest)
    pipeline = SENSOR.pipeline(world().config).fit(dataclasses.replace(rest, truth={}))
    states = pipeline.process_batch(recording)
    assert np.isnan(states.torque[:, 2]).all()
    assert any('no stiffness' in said for said in pipeline.report)


def test_what_hides_of_a_magnet_follows_from_what_shows() -> None:
    """Where three of six freedoms show, the other three are told as far as patterns tie them."""
    rng = np.random.default_rng(3)
    shape = np.linalg.qr(rng.normal(size=(6, 6)))[0] * np.array([1, 1, 1, 1e-4, 1e-4, 1e-4])
    answer, show = rng.normal(size=(2, 6)), np.eye(6)[:3]
    rest = np.concatenate([show, np.zeros((3, 6))])
    slopes = np.broadcast_to(np.concatenate([answer, rest]), (50, 8, 6))
    magnets = NearbyMagnets(shape, 1.0).fit(rng.normal(size=(50, 3)), slopes)
    strength = 10.0 ** rng.uniform(-5, -3, size=(400, 1))
    field = strength * rng.normal(size=(400, 6)) @ shape.T
    noise = np.full(400, 1e-8)
    left = field @ rest.T + 1e-8 * rng.normal(size=(400, 6))
    size = strength[:, 0]
    mean, cov = magnets.error(np.zeros((400, 3)), left, noise, size, 0.0)
    error, sigma = mean - field @ answer.T, np.sqrt(np.diagonal(cov, axis1=1, axis2=2))
    assert rms(error).max() < 0.05 * rms(field @ answer.T).min()
    assert (np.abs(error) < 2 * sigma).mean() > 0.94
    assert np.linalg.eigvalsh(cov).min() >= -1e-18


def test_magnets_are_weighed_alone_as_among_others() -> None:
    rng = np.random.default_rng(4)
    slopes = rng.normal(size=(50, 13, 6)) * np.r_[np.full(7, 50.0), np.ones(6)][:, None]
    magnets = NearbyMagnets(np.eye(6) / 2 + 0.1, 0.1).fit(rng.normal(size=(50, 3)), slopes)
    seen = (rng.normal(size=(30, 3)), 1e-5 * rng.normal(size=(30, 6)))
    sizes = (10 ** rng.uniform(-6, -5, 30), np.where(np.arange(30) % 3, 1e-4, 0.0))
    loops = magnets.error(*seen, *sizes, 0.01)
    alone = [
        magnets.error(*(part[i : i + 1] for part in (*seen, *sizes)), 0.01) for i in range(30)
    ]
    for k in range(2):
        np.testing.assert_array_equal(np.concatenate([one[k] for one in alone]), loops[k])


def test_magnets_have_no_shape_along_uniform_fields() -> None:
    axes = np.tile(np.eye(3)[[0, 2]], (4, 1))
    field = magnet_fields(world().config.positions, axes)
    differences = UniformField(axes, 1e-6).differences
    seen = magnet_shape(field, differences)
    np.testing.assert_allclose(
        seen @ seen.T / 6, np.cov(field.reshape(-1, 8) @ differences, rowvar=False, bias=True)
        / (field @ differences).var() / 6, atol=0.02,
    )  # fmt: skip
    size = np.linalg.svd(seen, compute_uv=False)
    assert size[3] > 0.5 * size[0]  # four gradients
    assert size[4] < 0.25 * size[0]  # and what bends them


def test_an_expanding_softening_elastomer_is_found() -> None:
    x = np.random.default_rng(0).uniform(-1, 1, (300, 4))
    y = (1 - 0.1 * x[:, 3:]) * ((x[:, 2:3] - 0.05 * x[:, 3:]) ** 2 + x[:, :1])
    found = WarmPolynomial((1, 2, 3), 1).fit(x, y)
    assert found.rise_ == pytest.approx([0.05], abs=1e-3)
    assert found.stiff_ == pytest.approx([-0.1], abs=1e-3)
    with pytest.raises(NotCalibratedError):
        WarmPolynomial().predict(x)


def test_alpha_of_the_chain_is_found_and_a_common_beta_changes_nothing() -> None:
    """Hard case 17: a beta that is equal for all pixels is removed with their mean."""
    rng = np.random.default_rng(1)
    field, heat = rng.normal(size=(400, 8)), rng.uniform(-1, 1, (400, 1))
    target = field[:, :1] - field[:, 2:3] + (field[:, 1:2] - field[:, 3:4]) ** 2
    read = field / (1 + 0.1 * heat)
    beta = 0.3 * heat * np.ones(8)
    chains = [WarmChain().fit(np.hstack([x, heat]), target) for x in (read, read + beta)]
    assert chains[0].alpha_ == pytest.approx([0.1], abs=5e-3)
    said = [
        c.predict(np.hstack([x, heat])) for c, x in zip(chains, (read, read + beta), strict=True)
    ]
    assert np.abs(said[0] - target).max() < 0.05 * target.std()


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


@pytest.mark.parametrize('count', [5, 12])
def test_sigmas_of_few_presses_after_a_long_rest_are_those_of_presses(count: int) -> None:
    few = SENSOR.pipeline(world().config).fit(world().record(count, 8))
    error, sigma = errors(few, world().record(300, 2))
    assert (np.abs(error) < 2 * sigma).mean() > 0.7


def test_a_fit_at_rest_tells_no_force() -> None:
    rested = SENSOR.pipeline(world().config).fit(world().record(0, 8))
    states = rested.process_batch(world().record(30, 2))
    assert np.isnan(states.force[states.in_contact != 0]).all()
    assert not states.valid.any()


def test_without_the_temperatures_of_its_fit_sigmas_are_wider() -> None:
    warm = made.Scene(span=40.0)
    pipeline = SENSOR.pipeline(world().config).fit(world().record(400, 9, warm))
    told = world().record(300, 10, warm)
    blind = Recording.from_arrays(
        SENSOR.layout(world().config), told.values, tare=told.tare, truth=told.truth
    )
    error, sigma = errors(pipeline, blind)
    assert (np.abs(error) < 2 * sigma).mean() > 0.9
    assert (sigma > 3 * errors(pipeline, told)[1].max(axis=0)).mean() > 0.9
    status = pipeline.process_batch(blind).status
    assert (status[world().rest :] & FrameStatus.OUT_OF_RANGE > 0).all()


def test_calibrations_say_what_their_presses_could_not_tell() -> None:
    straight = np.zeros((160, 3))
    straight[60:, 2] = -np.linspace(0.05, 0.6, 100) * world().depth
    pipeline = SENSOR.pipeline(world().config).fit(world().recorded(straight, 3, made.Scene()))
    said = [name for name in pipeline.report if name.startswith('not told: ')]
    assert any('force beyond' in one and 'full scale is 3.5 N' in one for one in said)
    assert any('other ways than the 1' in one for one in said)
    assert any('no chip told' in one for one in said)
    assert any('no rest in known fields' in one for one in said)
    test = world().record(300, 2)
    states = pipeline.process_batch(test)
    touched = np.arange(len(test)) >= world().rest
    beyond = states.status & FrameStatus.OUT_OF_RANGE > 0
    assert beyond[touched].mean() > 0.8
    error, sigma = errors(pipeline, test)
    assert ((np.abs(error) < 2 * sigma).mean(axis=0) > 0.9).all()


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
    assert (shares[0] > 0.6).all()
    assert (shares[1] > 0.92).all()
    lesson = world().record(300, 8)
    few = (np.arange(len(lesson)) == 0) | (np.arange(len(lesson)) >= world().rest)
    poor = SENSOR.pipeline(world().config).fit(lesson.select(few))
    error, sigma = errors(poor, world().record(300, 9))
    assert (np.abs(error) < 2 * sigma).mean() > 0.9


def test_a_noisier_thermometer_widens_what_a_stream_begins_with() -> None:
    noisy = made.World(SEED, thermometer=0.05)
    scene = made.Scene(span=30.0, ramp_s=600.0)
    pipeline = SENSOR.pipeline(noisy.config).fit(noisy.record(800, 4, scene))
    noise = pipeline.estimation.features_.readings_.thermometer_  # type: ignore[attr-defined]
    assert noise == pytest.approx(0.05, rel=0.15)
    chip, state = np.array([35.0]), ThermalMemory(10.0)
    doubt = [lagging(stamped(second), chip, 35.0, state)[0, 1] for second in (0.0, 1.0, 2.0, 3.0)]
    assert doubt[0] == 1.0
    assert (np.diff(doubt) < 0).all()
    error, sigma = errors(pipeline, noisy.record(800, 5, scene))
    assert ((np.abs(error) < 2 * sigma).mean(axis=0) > 0.9).all()
