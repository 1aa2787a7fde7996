"""The gradiometer in worlds of warm elastomers and magnets: what [3] is to bear, case by case."""

from __future__ import annotations

import argparse
import dataclasses
import importlib.util
import sys
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

from tactile_ros.errors import NotCalibratedError
from tactile_ros.estimators.warm_chain import WarmChain
from tactile_ros.estimators.warm_polynomial import WarmPolynomial
from tactile_ros.physics import compiled
from tactile_ros.pipeline import Pipeline
from tactile_ros.sensors import load_sensor
from tactile_ros.sensors.gradiometer.stray import gradient_patterns
from tactile_ros.types import Frame, FrameStatus, Recording

FILE = Path(__file__).parents[1] / 'reference' / 'gradiometer_world.py'
SPEC = importlib.util.spec_from_file_location('gradiometer_world', FILE)
assert SPEC is not None
assert SPEC.loader is not None
WORLD = importlib.util.module_from_spec(SPEC)
sys.modules[SPEC.name] = WORLD  # its dataclass looks itself up
SPEC.loader.exec_module(WORLD)
SENSOR = load_sensor('gradiometer')
SEED = 31


@lru_cache
def world() -> WORLD.World:  # type: ignore[name-defined]
    return WORLD.World(SEED)


@lru_cache
def fitted() -> Pipeline:
    return SENSOR.pipeline(world().config).fit(world().record(300, 1))


def errors(pipeline: Pipeline, recording: Recording) -> tuple[np.ndarray, np.ndarray]:
    states = pipeline.process_batch(recording)
    asked = states.valid.copy()
    asked[: world().rest] = False
    sigma = np.sqrt(np.diagonal(states.force_cov, axis1=1, axis2=2))
    return (states.force - recording.truth['force'])[asked], sigma[asked]


def rms(error: np.ndarray) -> np.ndarray:
    return np.asarray(np.sqrt((error**2).mean(axis=0)))


def test_covariances_hold_by_component_and_by_third_of_the_sigma() -> None:
    error, sigma = errors(fitted(), world().record(3000, 2))
    for k in range(3):
        for rows in np.array_split(np.argsort(sigma[:, k]), 3):
            within = np.abs(error[rows, k]) / sigma[rows, k]
            assert 0.56 < (within < 1).mean() < 0.82
            assert (within < 2).mean() > 0.87


def test_live_and_batch_have_the_same_bits() -> None:
    recording = world().record(60, 3)
    pipeline = fitted()
    many = pipeline.process_batch(recording)
    pipeline.tare([Frame(None, i, row) for i, row in enumerate(recording.values[: world().rest])])
    rows = range(world().rest, len(recording))
    live = [pipeline.process(Frame(None, i, recording.values[i])) for i in rows]
    exact = np.array_equal if compiled.AVAILABLE else np.allclose
    base = np.abs(pipeline.baseline - recording.values[: world().rest].mean(axis=0)).max()
    assert base < 1e-12
    assert exact(np.stack([one.force for one in live]), many.force[world().rest :])
    assert exact(np.stack([one.force_cov for one in live]), many.force_cov[world().rest :])


def test_without_a_compiler_the_numbers_are_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    recording = world().record(200, 4, WORLD.Scene(magnet=30e-3))
    chain = SENSOR.pipeline(world().config, 'polynomial').fit(world().record(300, 1))
    pipelines = (fitted(), chain)
    first = [pipeline.process_batch(recording) for pipeline in pipelines]
    monkeypatch.setattr(compiled, 'AVAILABLE', False)
    for pipeline, before in zip(pipelines, first, strict=True):
        after = pipeline.process_batch(recording)
        np.testing.assert_allclose(after.force, before.force, rtol=1e-9, atol=1e-11)
        np.testing.assert_allclose(after.force_cov, before.force_cov, rtol=1e-6, atol=1e-18)


@pytest.mark.parametrize('ramp_s', [0.0, 600.0])
def test_0_to_50_degrees_cost_less_than_half_as_much_again(ramp_s: float) -> None:
    scene = WORLD.Scene(span=50.0, ramp_s=ramp_s)
    warm = SENSOR.pipeline(world().config).fit(world().record(500, 4, scene))
    still = SENSOR.pipeline(world().config).fit(world().record(500, 4))
    hot = rms(errors(warm, world().record(500, 5, scene))[0])
    cold = rms(errors(still, world().record(500, 5))[0])
    assert (hot < 1.5 * cold).all()
    found = warm.report['disc']
    assert found['remanence_per_unit'] == pytest.approx(-25 * world().weaker, rel=0.05)
    if ramp_s:
        assert found['thermal_lag'] == pytest.approx(world().lag_s, rel=0.1)


def test_a_lag_that_the_config_states_is_taken() -> None:
    config = dataclasses.replace(world().config, thermal_lag=world().lag_s)
    scene = WORLD.Scene(span=50.0, ramp_s=600.0)
    pipeline = SENSOR.pipeline(config).fit(world().record(300, 4, scene))
    assert pipeline.report['disc']['thermal_lag'] == world().lag_s


def test_outside_the_temperatures_of_the_fit_it_says_so() -> None:
    few = world().record(300, 4, WORLD.Scene(span=20.0))
    pipeline = SENSOR.pipeline(world().config).fit(few)
    states = pipeline.process_batch(world().record(300, 5, WORLD.Scene(span=60.0)))
    said = states.status & FrameStatus.OUT_OF_RANGE > 0
    assert 0.4 < said.mean() < 0.8
    sigma = np.sqrt(states.force_cov[:, 2, 2])
    touched = np.arange(len(said)) >= world().rest
    assert np.nanmedian(sigma[touched & said]) > 3 * np.nanmedian(sigma[touched & ~said])


def test_magnets_at_14_mm_are_told_and_covered() -> None:
    inside, told = [], []
    for k in range(10):
        near = world().record(60, 200 + k, WORLD.Scene(magnet=14e-3))
        error, sigma = errors(fitted(), near)
        inside.append((np.abs(error) < 2 * sigma).mean(axis=0))
        status = fitted().process_batch(near).status[world().rest :]
        told.append((status & FrameStatus.STRAY_FIELD > 0).mean())
    assert (np.mean(inside, axis=0) > 0.93).all()
    assert np.mean(told) > 0.95


def test_a_rest_in_known_fields_leaves_no_leak() -> None:
    turned = world().record(200, 9, WORLD.Scene(turned=True))
    pipeline = SENSOR.pipeline(world().config).fit(world().record(300, 1), turned)
    clean = pipeline.process_batch(world().record(300, 2))
    for stray in 2e-3 * np.eye(3):
        moved = pipeline.process_batch(world().record(300, 2, WORLD.Scene(stray=tuple(stray))))
        asked = clean.valid & moved.valid
        leak = rms((moved.force - clean.force)[asked])
        assert (leak < 5e-4 * world().config.full_scale).all()


def test_frames_at_rest_alone_tell_no_force_and_the_report_says_why() -> None:
    recording = world().record(50, 1)
    rest = recording.select(np.arange(len(recording)) < world().rest)
    pipeline = SENSOR.pipeline(world().config).fit(dataclasses.replace(rest, truth={}))
    states = pipeline.process_batch(recording)
    assert np.isnan(states.torque[:, 2]).all()
    assert 'no stiffness' in next(iter(pipeline.report['untold']))


def test_gradients_are_those_of_fields_without_sources() -> None:
    axes = np.tile(np.eye(3), (4, 1))
    pixels = world().config.positions
    kinds = gradient_patterns(pixels, axes)
    assert kinds.shape == (5, 12)
    assert np.abs(kinds.reshape(5, 4, 3).mean(axis=1)).max() < 1e-18


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
    warm = WORLD.Scene(span=40.0)
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
