"""Places, forces and stray fields by the fitted response, in a world that it does not know."""

from __future__ import annotations

import dataclasses
from functools import lru_cache
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

from tactile_ros.evaluation.metrics import WITHIN, Coverage, coverage_by_thirds
from tactile_ros.pipeline import Pipeline
from tactile_ros.sensors import load_sensor
from tactile_ros.sensors.magnet_pad.covariance import KIND, LEANS
from tactile_ros.sensors.magnet_pad.nominal_estimator import NominalEstimator
from tactile_ros.types import ContactStates, FrameStatus, Recording

pytest.importorskip('magpylib')
reference = import_module('reference.magnet_pad_world')
SPEC = load_sensor('magnet_pad')
CONFIG = SPEC.config()
LAYOUT = SPEC.layout(CONFIG)
GRID, REST = (5, 3), 60
TABLE = 'table_gauss_newton'
SURE = 3.0  # standard errors that none of eighty shares is beyond


def record(
    seed: int, count: int, *, spread: float = 1.0, config: object = CONFIG, **more: float
) -> tuple[object, Recording]:
    """Touches and their recording; `more` goes to the touches or to the recording."""
    cone = more.pop('cone', 0.0)
    touches = reference.Touches.in_cells(config, GRID, count, spread, seed, cone=cone)
    pad = reference.PadWorld(config, seed=3)
    return touches, pad.record(touches, seed + 100, layout=SPEC.layout(config), **more)


@lru_cache
def known() -> Pipeline:
    """Learned from 400 touches anywhere."""
    return SPEC.pipeline().fit(record(1, 400)[1])


def bound(touches: object) -> float:
    """Mean error of a place by the world's own slopes, place and load unknown (m)."""
    pad = reference.PadWorld(CONFIG, seed=3)
    level, steps = pad.change(touches, 3e-3), ((1e-5, 0, 0), (0, 1e-5, 0), (0, 0, 1e-3))
    slopes = np.stack(
        [(pad.change(touches.shifted(*s), 3e-3) - level) / max(s) for s in steps], axis=-1
    ).reshape(len(level), -1, 3)
    cov = np.linalg.inv(np.matmul(slopes.transpose(0, 2, 1), slopes)) * pad.noise**2
    draws = np.random.default_rng(0).normal(size=(100, 2))
    away = [np.linalg.norm(draws @ np.linalg.cholesky(one[:2, :2]).T, axis=1) for one in cov]
    return float(np.mean(away))


def test_the_world_is_a_half_space_where_it_is_asked_to_be() -> None:
    """Written otherwise, the same physics gives the same readings as the nominal model."""
    from tactile_ros.sensors.magnet_pad.body_model import Presses, change_of_field

    plain = {'poisson': 0.5, 'stiffening': 1e12, 'height': 0.0, 'base': 1e-6, 'gains': 0.0}
    pad = reference.PadWorld(CONFIG, seed=3, **plain)
    pad.magnets, pad.strength, pad.shear = CONFIG.magnet_positions, [1.4] * 3, CONFIG.shear_modulus
    touches = reference.Touches.in_cells(CONFIG, GRID, 60, 1.0, 5)
    around = np.arctan2(touches.place[:, 2], touches.place[:, 1])
    one = np.ones(60)
    nominal = change_of_field(
        CONFIG, Presses(touches.place[:, 0], around, touches.force, 1e-4 * one, 0 * one)
    )
    seen = pad.change(touches, 1e-4)
    assert np.abs(seen - nominal).max() < 0.03 * np.abs(nominal).max()


def test_places_are_as_good_as_noise_allows() -> None:
    pipeline = known()
    assert pipeline.estimators == {'position': TABLE, 'force': TABLE, 'cell': TABLE}
    report = pipeline.report
    assert report['position_xyz'][f'rmse_{TABLE}'] < report['position_xyz']['rmse_pattern_ridge']
    assert 0.9 < report['pad']['height'] < 1.1
    touches, fresh = record(2, 300)
    states = pipeline.process_batch(fresh)
    error = np.linalg.norm(states.position[REST:] - touches.place, axis=1)
    assert error.mean() < 1.2 * bound(touches)
    assert (states.cell[REST:] == touches.cell).mean() > 0.93
    force = np.linalg.norm(states.force[REST:] - touches.force, axis=1)
    assert np.median(force) < 0.05 * np.median(np.linalg.norm(touches.force, axis=1))


def parts_of(states: ContactStates, touches: object) -> list[tuple[str, Coverage]]:
    """Coverage of every component that varies, overall and within thirds of its sigma."""
    found, groups = [], np.arange(len(touches.place))
    for name, true in (('position', touches.place), ('force', touches.force)):
        error = getattr(states, name)[REST:] - true
        variance = np.diagonal(getattr(states, f'{name}_cov'), axis1=1, axis2=2)[REST:]
        for k in np.flatnonzero(np.ptp(true, axis=0)):
            parts = coverage_by_thirds(error[:, k], variance[:, k], groups)
            found += [(f'{name} {k} {part} {n}', one) for (part, n), one in parts.items()]
    return found


def test_stated_errors_are_the_errors_in_every_third_of_them() -> None:
    """Of each of two pads of other bodies, judged on touches that its fit has not seen."""
    bodies = ({}, {'poisson': 0.4, 'stiffening': 30.0, 'base': 0.4, 'gains': 0.02})
    taught, shares = 500, []
    for seed, body in enumerate(bodies):
        pad = reference.PadWorld(CONFIG, seed=3 + seed, **body)
        counts = (taught, 1500)
        sets = [reference.Touches.in_cells(CONFIG, GRID, n, 1.0, 2 * seed + n) for n in counts]
        train, fresh = (pad.record(t, 50 + i, layout=LAYOUT) for i, t in enumerate(sets))
        states = SPEC.pipeline(estimator=TABLE).fit(train).process_batch(fresh)
        shares.append(parts_of(states, sets[1]))
    for (name, one), (_, other) in zip(*shares, strict=True):
        aimed = WITHIN[int(name[-1])]
        # as many groups as a fit has for a third, or for all
        groups = taught if 'overall' in name else taught / 3
        room = max(0.05, SURE * np.sqrt(aimed * (1 - aimed) / groups))
        assert abs(one.share - aimed) < room, name
        assert abs(other.share - aimed) < room, name


def test_forces_that_never_leaned_are_not_said_to_be_sure() -> None:
    _, fresh = record(2, 100)
    states = known().process_batch(fresh)
    load = np.linalg.norm(states.force[REST:], axis=1)
    sigma = np.sqrt(states.force_cov[REST:, 0, 0])
    np.testing.assert_allclose(sigma / load, LEANS, rtol=0.05)
    assert f'{KIND}forces along the surface' in known().report
    assert (states.force_cov[:REST, 0, 0] < sigma.min() ** 2).all()
    leaning = SPEC.pipeline(estimator=TABLE).fit(record(8, 300, cone=0.78)[1])
    assert f'{KIND}forces along the surface' not in leaning.report


def test_what_a_recording_leaves_open_is_told() -> None:
    _, half = record(16, 120)
    west = half.tare | (half.truth['position'][:, 0] < 0)
    report = SPEC.pipeline(estimator=TABLE).fit(half.select(west)).report
    assert report[f'{KIND}places half a radius from the next touch']['share of the pad'] > 0.3
    loads = report[f'{KIND}loads beyond those recorded (N)']
    assert 1.5 <= loads['least'] < 2.5
    assert 9.0 < loads['most'] <= 10.0


def test_untrained_sigmas_hold_over_pads_that_differ() -> None:
    """Of specimens of the nominal body and of two others, about whom nothing is told."""
    pad, bodies = NominalEstimator(CONFIG), ({'poisson': 0.5, 'base': 1e-6}, {}, {'poisson': 0.42})
    inside = []
    for seed in range(6):
        touches = reference.Touches.in_cells(CONFIG, GRID, 150, 1.0, 60 + seed)
        body = reference.PadWorld(CONFIG, seed=seed, **bodies[seed % 3])
        readings = body.change(touches, 3e-3).reshape(150, -1)
        known = pad.estimate(readings + 4e-6 * np.random.default_rng(seed).normal(size=(150, 6)),
                             np.zeros(150, bool))  # fmt: skip
        for name, true in (('position', touches.place), ('force', touches.force)):
            sigma = np.sqrt(np.diagonal(known[f'{name}_cov'], axis1=1, axis2=2))
            away = np.abs(known[name] - true) / sigma
            inside.append([(away[:, 1:] < k).mean(axis=0) for k in (1, 2)])
    one, two = np.array(inside).mean(axis=0)
    assert (one > 0.6).all()
    assert (two > 0.9).all()


def test_live_is_batch_bit_for_bit() -> None:
    _, fresh = record(5, 30, stray=3e-4)
    pipeline = known()
    batch = pipeline.process_batch(fresh)
    pipeline.tare([fresh.frame(i) for i in range(REST)])
    pipeline.reset()
    names = ('position', 'position_cov', 'force', 'force_cov', 'stray_field', 'cell_probability')
    for row in range(REST, len(fresh)):
        state = pipeline.process(fresh.frame(row))
        for name in names:
            np.testing.assert_array_equal(getattr(state, name), getattr(batch, name)[row])


def test_saved_it_says_the_same(tmp_path: Path) -> None:
    _, fresh = record(6, 20, stray=3e-4)
    path = tmp_path / 'pad.npz'
    known().save(path)
    one, other = known().process_batch(fresh), SPEC.load(path).process_batch(fresh)
    np.testing.assert_array_equal(one.position, other.position)
    np.testing.assert_array_equal(one.force_cov, other.force_cov)


def test_a_stray_field_is_told_from_touches_and_is_no_contact() -> None:
    touches, stray = record(7, 200, stray=5e-4)
    states = known().process_batch(stray)
    away = np.linalg.norm(states.position[REST:] - touches.place, axis=1)
    plain = SPEC.pipeline(estimator='grid_knn').fit(record(1, 400)[1]).process_batch(stray)
    lost = np.linalg.norm(plain.position[REST:] - touches.place, axis=1)
    assert np.isnan(away).mean() < 0.05  # the lightest at the edges drown
    assert np.nanmean(away) < 0.3 * np.nanmean(lost)
    field = stray.truth['stray_field'][REST:]
    off = np.linalg.norm(states.stray_field[REST:] - field, axis=1)
    assert np.median(off) < 0.1 * 5e-4
    # nothing but a field that came after the tare
    rng = np.random.default_rng(0)
    outside = 5e-4 * rng.normal(size=(100, 3))
    values = np.concatenate([stray.values[:REST], stray.values[:REST].mean(axis=0) +
                             outside[:, None] + 4e-6 * rng.normal(size=(100, 2, 3))])  # fmt: skip
    tare = np.arange(len(values)) < REST
    rest = known().process_batch(Recording.from_arrays(stray.layout, values, tare=tare))
    assert (rest.in_contact[REST:] == 0).mean() > 0.95
    assert np.nanmax(np.abs(rest.force[rest.in_contact == 0])) == 0
    np.testing.assert_allclose(rest.stray_field[REST:], outside, atol=3e-5)


def test_touches_that_lean_are_placed() -> None:
    _, train = record(8, 300, cone=0.78)
    fresh_touches, fresh = record(9, 200, cone=0.78)
    pipeline = SPEC.pipeline(estimator=TABLE).fit(train)
    states = pipeline.process_batch(fresh)
    away = np.linalg.norm(states.position[REST:] - fresh_touches.place, axis=1)
    assert np.isnan(away).mean() < 0.03
    assert np.nanmean(away) < 2e-3
    sideways = states.force[REST:, 0] - fresh_touches.force[:, 0]
    assert np.nanstd(sideways) < 0.4 * fresh_touches.force[:, 0].std()


def test_other_geometry_turned_chips_and_a_dead_one() -> None:
    turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    config = dataclasses.replace(
        CONFIG,
        positions=np.array([[-12e-3, 1e-3, 0], [1e-3, -2e-3, 0], [12e-3, 0, 0]]),
        rotations=np.stack([np.eye(3), turn, np.eye(3)]),
    )
    _, train = record(10, 150, config=config)
    touches, fresh = record(11, 100, config=config)
    for dead in (False, True):
        if dead:
            for one in (train, fresh):
                one.values[:, 2] = np.nan
        pipeline = SPEC.pipeline(config).fit(train)
        assert pipeline.estimators['position'] == TABLE
        away = np.linalg.norm(
            pipeline.process_batch(fresh).position[REST:] - touches.place, axis=1
        )
        assert away.mean() < (1.2e-3 if dead else 0.7e-3)


def test_near_fields_are_those_of_blocks() -> None:
    """Hard case 4: a dipole is a third off at 2 mm; magnets low over the chips are still found."""
    low = dataclasses.replace(
        CONFIG, magnet_positions=CONFIG.magnet_positions * np.array([1, 1, 4.0 / 6.4])
    )
    touches, fresh = record(12, 100, config=low)
    pipeline = SPEC.pipeline(low).fit(record(13, 200, config=low)[1])
    away = np.linalg.norm(pipeline.process_batch(fresh).position[REST:] - touches.place, axis=1)
    assert away.mean() < 0.6e-3


def test_whole_presses_are_held_out() -> None:
    """Hard case 8: frames of one ramp never stand on both sides of a split."""
    _, train = record(14, 240)
    again = train.select(np.concatenate([np.arange(len(train)), np.arange(REST, len(train))]))
    pipeline = SPEC.pipeline(estimator=TABLE).fit(again)
    held = pipeline.estimation.inversion_.report_['position']
    assert held['rows'] == 480
    assert held['groups'] == 240


def test_depth_changes_the_pattern() -> None:
    """Hard case 18: loads from light to firm are told at one place, beyond a mere scale."""
    plan = np.tile([[7e-3, 3e-3]], (20, 1))
    load = np.linspace(1.6, 9.9, 20)
    pad = reference.PadWorld(CONFIG, seed=3)
    touches = reference.Touches(CONFIG, plan, load, np.zeros(20, int))
    fresh = pad.record(touches, 9, layout=SPEC.layout(CONFIG))
    states = known().process_batch(fresh)
    size = np.linalg.norm(states.force[REST:], axis=1)
    assert np.abs(size / load - 1).max() < 0.15
    assert np.linalg.norm(states.position[REST:] - touches.place, axis=1).max() < 1.5e-3


def test_the_level_at_rest_is_subtracted_first() -> None:
    """Hard case 19: another level at rest, tared, changes nothing."""
    _, fresh = record(15, 60)
    moved = dataclasses.replace(fresh, values=fresh.values + np.array([2e-3, -1e-3, 3e-3]))
    one, other = (known().process_batch(each) for each in (fresh, moved))
    np.testing.assert_allclose(one.position[REST:], other.position[REST:], atol=1e-9)


def test_a_field_far_beyond_the_usual_is_flagged_and_not_answered_with_confidence() -> None:
    errors, sigmas, status = [], [], []
    for field in (0.0, 0.5e-3, 5e-3):
        touches, seen = record(6, 150, stray=field)
        states = known().process_batch(seen)
        errors.append(np.abs(states.position[REST:] - touches.place)[:, :2])
        variance = np.diagonal(states.position_cov[REST:], axis1=1, axis2=2)[:, :2]
        sigmas.append(np.sqrt(variance))
        status.append((states.status[REST:] & FrameStatus.STRAY_FIELD > 0).mean())
    assert status[0] == 0
    assert status[2] > 0.9
    inside = [(e < 2 * s).mean() for e, s in zip(errors, sigmas, strict=True)]
    assert min(inside[:2]) > 0.88
    assert inside[2] > 0.88
    assert np.median(sigmas[2]) > 3 * np.median(sigmas[1])
