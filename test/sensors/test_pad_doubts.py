"""What the pad was never told is said, and sigmas there are those of what may be."""

from __future__ import annotations

import copy
import dataclasses
from functools import lru_cache
from importlib import import_module

import numpy as np
import pytest

from tactile_ros.pipeline import Pipeline
from tactile_ros.sensors import load_sensor
from tactile_ros.sensors.magnet_pad.covariance import KIND, LoadExtrapolation, growth
from tactile_ros.sensors.magnet_pad.nominal_estimator import SubthresholdForce
from tactile_ros.types import ContactStates, FrameStatus, Recording

pytest.importorskip('magpylib')
reference = import_module('reference.magnet_pad_world')
SPEC = load_sensor('magnet_pad')
CONFIG = SPEC.config()
REST, TABLE = 60, 'table_gauss_newton'


def record(
    seed: int, count: int, *, config: object = CONFIG, loads: tuple = (1.5, 10.0), **more: float
) -> tuple[object, Recording]:
    touches = reference.Touches.in_cells(config, (5, 3), count, 1.0, seed, loads=loads)
    pad = reference.PadWorld(config, seed=6)
    return touches, pad.record(touches, seed + 100, layout=SPEC.layout(config), **more)


@lru_cache
def known() -> Pipeline:
    return SPEC.pipeline(estimator=TABLE).fit(record(1, 300)[1])


def inside(states: ContactStates, touches: object, rows: object = slice(None)) -> np.ndarray:
    """Share of errors inside two sigma: along and around the axis; of Fy and Fz, where told."""
    shares = []
    names = ('position', 'force')[: 1 + bool(np.isfinite(states.force[-1]).all())]
    for name, true in zip(names, (touches.place, touches.force), strict=False):
        error = np.abs(getattr(states, name)[-len(true) :] - true)[rows]
        variance = np.diagonal(getattr(states, f'{name}_cov'), axis1=1, axis2=2)[-len(true) :]
        told = np.isfinite(error).all(axis=1)
        hit = error[told] <= 2 * np.sqrt(variance[rows][told])
        shares += [hit[:, 1].mean(), hit[:, 2 if name == 'force' else 0].mean()]
    return np.array(shares)


def flagged(states: ContactStates, bit: FrameStatus) -> float:
    return float((states.status[REST:] & bit > 0).mean())


def test_loads_beyond_those_recorded_are_flagged_and_unsure() -> None:
    reach = known().estimation.inversion_.loads_
    assert reach.told
    sigma = []
    for loads in ((2.0, 9.0), (12.0, 20.0)):
        touches, seen = record(8, 200, loads=loads)
        states = known().process_batch(seen)
        sigma.append(np.sqrt(states.force_cov[REST:, 2, 2]) / touches.force[:, 2])
        assert not (states.status[:REST] & FrameStatus.OUT_OF_RANGE).any()
        assert flagged(states, FrameStatus.OUT_OF_RANGE) > 0.9 or loads[0] < 10
        assert flagged(states, FrameStatus.OUT_OF_RANGE) < 0.05 or loads[0] > 10
        assert (inside(states, touches) > 0.85).all()
    assert np.median(sigma[1]) > 1.2 * np.median(sigma[0])


def test_growth_of_errors_is_what_normal_ones_need() -> None:
    rng = np.random.default_rng(0)
    away = rng.uniform(0.0, 1.0, 4000)
    error = rng.normal(size=(4000, 2)) * np.sqrt(1 + (3 * away[:, None]) ** 2)
    assert growth(away, error) == pytest.approx(3.0, rel=0.2)
    assert growth(away, rng.normal(size=(4000, 2))) < 0.5
    reach = LoadExtrapolation(2.0, 10.0, 1e-2)
    np.testing.assert_allclose(reach.beyond(np.array([1.0, 5.0, 15.0])), [0.1, 0.0, 0.5])


def test_touches_too_light_to_be_felt_are_not_surely_0() -> None:
    touches, seen = record(9, 300, loads=(0.02, 0.8))
    states = known().process_batch(seen)
    rest = states.in_contact[REST:] == 0
    assert 0.2 < rest.mean() < 0.9
    assert (states.force[REST:][rest] == 0).all()
    assert (inside_forces(states, touches, rest) > 0.88).all()
    sigma = np.sqrt(states.force_cov[:, 2, 2])
    assert np.median(sigma[:REST]) < 0.5 * np.median(sigma[REST:][rest])  # of rest itself


def inside_forces(states: ContactStates, touches: object, rows: np.ndarray) -> np.ndarray:
    error = np.abs(states.force[REST:] - touches.force)[rows, 1:]
    sigma = np.sqrt(np.diagonal(states.force_cov[REST:], axis1=1, axis2=2))[rows, 1:]
    return np.asarray((error <= 2 * sigma).mean(axis=0))


def test_a_reading_hides_the_load_that_it_would_be() -> None:
    readings = np.array([[2.0, 0.0], [0.0, 1.0], [2.0, 0.0], [0.0, 1.0]]) * 1e-5
    forces = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0]] * 2)
    hidden = SubthresholdForce(readings, forces, 1e-7)(np.array([[1e-5, 0.0], [0.0, 1e-5]]))
    np.testing.assert_allclose(hidden[0], np.diag([0, 0, 0.25]), atol=1e-3)
    np.testing.assert_allclose(hidden[1], np.diag([0, 1.0, 0]), atol=1e-3)


def test_a_field_that_nothing_may_explain_is_flagged_and_no_place_is_sure() -> None:
    plain = dataclasses.replace(CONFIG, stray_term=False)
    pipeline = SPEC.pipeline(plain, estimator=TABLE).fit(record(1, 250, config=plain)[1])
    touches, clean = record(2, 200, config=plain)
    assert flagged(pipeline.process_batch(clean), FrameStatus.STRAY_FIELD) == 0
    for field in (0.1e-3, 0.5e-3, 5e-3):
        seen = record(2, 200, config=plain, stray=field)[1]
        states = pipeline.process_batch(seen)
        assert (inside(states, touches)[:2] > 0.78).all()
        assert flagged(states, FrameStatus.STRAY_FIELD) > (0.9 if field > 2e-4 else 0.5)
    assert states.valid[REST:].mean() < 0.2
    pipeline.tare([seen.frame(i) for i in range(REST)])
    live = pipeline.process(seen.frame(REST + 3))
    np.testing.assert_array_equal(live.position_cov, states.position_cov[REST + 3])
    one = dataclasses.replace(CONFIG, positions=CONFIG.positions[:1])
    assert any('one chip' in said for said in SPEC.pipeline(one).report)


def test_gains_that_differ_more_make_less_sure_beside_fields_alone() -> None:
    pipeline = copy.deepcopy(known())
    inversion = pipeline.estimation.inversion_
    (touches, clean), (_, seen) = record(2, 200), record(2, 200, stray=0.5e-3)
    usual, still = known().process_batch(seen), known().process_batch(clean)
    sizes = []
    for spread in (0.0, CONFIG.gain_spread, 0.08):
        inversion.config = dataclasses.replace(CONFIG, gain_spread=spread)
        vars(inversion).pop('telling', None)
        states = pipeline.process_batch(seen)
        assert (inside(states, touches) > 0.85).all()
        sizes.append(np.nanmedian(np.diagonal(states.position_cov[REST:], axis1=1, axis2=2)))
        if spread == CONFIG.gain_spread:
            np.testing.assert_array_equal(states.position_cov, usual.position_cov)
    assert sizes[0] < 0.8 * sizes[1]
    assert sizes[2] > 2 * sizes[1]
    said, clear = pipeline.process_batch(clean), still.status == 0
    np.testing.assert_allclose(said.position[clear], still.position[clear], atol=1e-4)
    with pytest.raises(ValueError, match='gain_spread'):
        dataclasses.replace(CONFIG, gain_spread=-0.01)


def test_the_noise_of_a_tare_of_one_frame_is_stated() -> None:
    shares, sigma = [], []
    for seed in range(8):
        touches, seen = record(40 + seed, 40)
        keep = (np.arange(len(seen)) == 0) | ~seen.tare
        states = known().process_batch(seen.select(keep))
        shares.append(inside(states, touches))
        more = known().process_batch(seen).position_cov[REST:, 0, 0]
        sigma.append(np.median(np.sqrt(states.position_cov[1:, 0, 0] / more)))
    assert (np.mean(shares, axis=0) > 0.9).all()
    assert np.mean(sigma) > 1.2
    few = seen.select((np.arange(len(seen)) < 2) | ~seen.tare)
    batch = known().process_batch(few)
    known().tare([few.frame(0), few.frame(1)])
    known().reset()
    state = known().process(few.frame(5))
    np.testing.assert_array_equal(state.force_cov, batch.force_cov[5])
    known().tare([dataclasses.replace(few.frame(0), averaged=0)])
    assert known().process(few.frame(5)).force_cov[2, 2] < state.force_cov[2, 2]


@pytest.mark.parametrize('told', ['one place', 'one load', 'one place, no force'])
def test_truth_at_one_place_or_load_makes_nothing_else_sure(told: str) -> None:
    pad, rng = reference.PadWorld(CONFIG, seed=6), np.random.default_rng(0)
    touches = reference.Touches.in_cells(CONFIG, (5, 3), 120, 1.0, 5, loads=(5.0, 5.0))
    if 'place' in told:
        plan = np.tile([[6e-3, 3e-3]], (120, 1))
        load = rng.uniform(1.5, 10, 120)
        touches = reference.Touches(CONFIG, plan, load, np.full(120, -1))
    lesson = pad.record(touches, 9, layout=SPEC.layout(CONFIG))
    if 'no force' in told:
        truth = {name: column for name, column in lesson.truth.items() if name != 'force'}
        lesson = dataclasses.replace(lesson, truth=truth)
    pipeline = SPEC.pipeline().fit(lesson)
    said = [one for one in pipeline.report if one.startswith(KIND)]
    assert any(('places' if 'place' in told else 'loads other') in one for one in said)
    fresh, seen = record(7, 200)
    shares = inside(pipeline.process_batch(seen), fresh)
    assert len(shares) == (2 if 'no force' in told else 4)
    assert (shares > 0.83).all()


def test_temperatures_beyond_those_recorded_are_told_and_flagged() -> None:
    _, seen = record(3, 40)
    warm = np.full((len(seen), 2), 22.0)
    warm[REST // 2 : REST, 1] = 24.0
    lesson = dataclasses.replace(seen, temperature_c=warm).select(seen.tare)
    pipeline = SPEC.pipeline().fit(lesson)
    found = pipeline.report[f'{KIND}temperatures beyond those recorded (C)']
    assert found == {'least': 22.0, 'most': 24.0}
    for chips, flags in (((20.0, 26.0), 0), ((18.0, 22.0), 1), ((22.0, 28.0), 1), (None, 0)):
        told = None if chips is None else np.tile(chips, (len(seen), 1))
        states = pipeline.process_batch(dataclasses.replace(seen, temperature_c=told))
        assert flagged(states, FrameStatus.OUT_OF_RANGE) == flags
        assert states.valid[REST:].all()
    silent = SPEC.pipeline().fit(seen.select(seen.tare))
    assert f'{KIND}temperature (no chip told one)' in silent.report
    hot = dataclasses.replace(seen, temperature_c=np.full((len(seen), 2), 60.0))
    assert flagged(silent.process_batch(hot), FrameStatus.OUT_OF_RANGE) == 0
    assert not any('temperature' in said for said in SPEC.pipeline().report if KIND in said)
