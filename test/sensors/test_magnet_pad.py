# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""The magnet pad on a body, magnets and chips that the package does not know."""

import dataclasses
from collections.abc import Iterator
from functools import lru_cache
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

from tactile_ros.nodes.contact_loop import ContactLoop
from tactile_ros.physics.temperature import REMANENCE_SLOPE
from tactile_ros.pipeline import Pipeline
from tactile_ros.sensors import load_sensor
from tactile_ros.sensors.magnet_pad import inversion
from tactile_ros.sensors.magnet_pad.body_model import Specimens, change_of_field, touches_at
from tactile_ros.sensors.magnet_pad.estimation import SLOPE_SIGMA, ThermalDrift
from tactile_ros.types import ContactStates, Frame, FrameStatus, Recording

pytest.importorskip('magpylib')
reference = import_module('reference.magnet_pad_world')
SPEC = load_sensor('magnet_pad')
CONFIG = SPEC.config()
LAYOUT = SPEC.layout(CONFIG)
GRID, REST = (5, 3), 60
TABLE = 'table_gauss_newton'
AXES = {'position': (0, 1), 'force': (1, 2)}


@pytest.fixture(scope='module', autouse=True)
def hasty() -> Iterator[None]:
    """Two folds, each learned from half of the touches: fits take half the time."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(inversion, 'FOLDS', 2)
        yield


@lru_cache
def world(seed: int = 3) -> object:
    return reference.PadWorld(CONFIG, seed=seed)


def record(
    seed: int, count: int, *, spread: float = 1.0, config: object = CONFIG, cone: float = 0.0,
    loads: tuple = (1.5, 10.0), pad: object = None, **more: float,
) -> tuple[object, Recording]:  # fmt: skip
    """Touches and their recording; `more` goes to the recording."""
    touches = reference.Touches.in_cells(config, GRID, count, spread, seed, loads, cone)
    if pad is None:
        pad = world() if config is CONFIG else reference.PadWorld(config, seed=3)
    return touches, pad.record(touches, seed + 100, layout=SPEC.layout(config), **more)


@lru_cache
def known() -> Pipeline:
    return SPEC.pipeline().fit(record(1, 300)[1])


@lru_cache
def nominal() -> Pipeline:
    return SPEC.pipeline().fit(record(1, 60)[1].select(slice(REST)))


def away(states: ContactStates, touches: object) -> np.ndarray:
    return np.linalg.norm(states.position[REST:] - touches.place, axis=1)


def inside(states: ContactStates, touches: object, sigmas: float, rows: object = None) -> dict:
    """Shares of errors inside so many sigma, of the components that vary."""
    rows = np.arange(len(touches.place)) if rows is None else rows
    shares = {}
    for name, true in (('position', touches.place), ('force', touches.force)):
        for k in AXES[name]:
            error = np.abs(getattr(states, name)[REST:, k] - true[:, k])[rows]
            sigma = np.sqrt(getattr(states, f'{name}_cov')[REST:, k, k])[rows]
            measured = np.isfinite(error)
            if measured.any():
                shares[name, k] = float((error <= sigmas * sigma)[measured].mean())
    return shares


def flagged(states: ContactStates, bit: FrameStatus) -> float:
    return float((states.status[REST:] & bit > 0).mean())


# -- model -----------------------------------------------------------------------------------


def test_change_of_field_is_that_of_another_hand() -> None:
    """Written otherwise, the same physics gives the same readings."""
    plain = {'poisson': 0.5, 'stiffening': 1e12, 'height': 0.0, 'base': 1e-6, 'gains': 0.0}
    pad = reference.PadWorld(CONFIG, seed=3, **plain)
    pad.magnets, pad.strength, pad.shear = CONFIG.magnet_positions, [1.4] * 3, CONFIG.shear_modulus
    touches = record(5, 15)[0]
    rows = touches_at(touches.place, touches.force)
    seen, ours = pad.change(touches, 1e-4), change_of_field(CONFIG, rows, 1e-2, 0.0)
    assert np.abs(seen - ours).max() < 0.03 * np.abs(ours).max()


def test_specimen_without_parameters_is_the_config() -> None:
    touches = record(5, 12, cone=0.5)[0]
    rows, pad = touches_at(touches.place, touches.force), Specimens(CONFIG, 10.0)
    still = np.zeros(pad.count)
    np.testing.assert_allclose(
        pad(rows, still), change_of_field(CONFIG, rows).reshape(12, -1), atol=1e-15
    )


# -- accuracy --------------------------------------------------------------------------------


def bound(touches: object) -> float:
    """Mean error of a place by the world's own slopes, place and load unknown (m)."""
    pad = world()
    level, steps = pad.change(touches, 3e-3), ((1e-5, 0, 0), (0, 1e-5, 0), (0, 0, 1e-3))
    slopes = np.stack(
        [(pad.change(touches.shifted(*s), 3e-3) - level) / max(s) for s in steps], axis=-1
    ).reshape(len(level), -1, 3)
    cov = np.linalg.inv(np.matmul(slopes.transpose(0, 2, 1), slopes)) * pad.noise**2
    draws = np.random.default_rng(0).normal(size=(100, 2))
    return float(np.mean([
        np.linalg.norm(draws @ np.linalg.cholesky(one[:2, :2]).T, axis=1) for one in cov
    ]))  # fmt: skip


def test_places_forces_and_cells_are_as_good_as_noise_allows() -> None:
    pipeline = known()
    assert pipeline.estimators == {'position': TABLE, 'force': TABLE, 'cell': TABLE}
    report = pipeline.report
    assert report['position'][f'rmse_{TABLE}'] < report['position']['rmse_grid_knn']
    assert 0.9 < report['pad']['height'] < 1.1
    loads = report['not learned: loads beyond those recorded (N)']
    assert 1.5 <= loads['least'] < 2.5
    assert 9.0 < loads['most'] <= 10.0
    touches, fresh = record(2, 300)
    states = pipeline.process_batch(fresh)
    assert away(states, touches).mean() < 1.2 * bound(touches)
    assert (states.cell[REST:] == touches.cell).mean() > 0.93
    force = np.linalg.norm(states.force[REST:] - touches.force, axis=1)
    assert np.median(force) < 0.05 * np.median(np.linalg.norm(touches.force, axis=1))
    assert not (states.status & FrameStatus.STRAY_FIELD).any()
    assert (np.linalg.norm(states.stray_field[REST:], axis=1) > 0).mean() < 0.02


def test_sigmas_hold_their_share_of_new_touches(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(inversion, 'FOLDS', 4)
    pad = reference.PadWorld(CONFIG, seed=8, poisson=0.4, stiffening=30.0, base=0.4, gains=0.02)
    pipeline = SPEC.pipeline(estimator=TABLE).fit(record(1, 300, pad=pad)[1])
    touches, fresh = record(2, 600, pad=pad)
    states = pipeline.process_batch(fresh)
    for sigmas, wanted, room in ((1, 0.683, 0.09), (2, 0.954, 0.04)):
        for name, share in inside(states, touches, sigmas).items():
            assert abs(share - wanted) < room, (name, sigmas)
    # nothing leaned: Fx is 0 with a sigma of a tenth of the force
    load = np.linalg.norm(states.force[REST:], axis=1)
    np.testing.assert_allclose(np.sqrt(states.force_cov[REST:, 0, 0]) / load, 0.1, rtol=0.05)


def test_nominal_pad_finds_touches_before_any_truth() -> None:
    assert set(nominal().estimators.values()) == {'nominal'}
    one, two, errors = [], [], []
    for seed, body in enumerate(({'poisson': 0.5, 'base': 1e-6}, {}, {'poisson': 0.42})):
        pad = reference.PadWorld(CONFIG, seed=seed, **body)
        touches, fresh = record(60 + seed, 80, pad=pad)
        states = nominal().process_batch(fresh)
        errors.append(np.nanmean(away(states, touches)))
        one.append(list(inside(states, touches, 1).values()))
        two.append(list(inside(states, touches, 2).values()))
    assert max(errors) < 2e-3
    assert np.mean(errors) < 1.2e-3
    assert (np.mean(one, axis=0) > 0.6).all()
    assert (np.mean(two, axis=0) > 0.88).all()
    # never fitted, but tared: the same answers, without a word on contact
    bare = SPEC.pipeline()
    bare.tare([fresh.frame(i) for i in range(REST)])
    live = bare.process(fresh.frame(REST + 3))
    assert live.in_contact == -1
    np.testing.assert_allclose(live.position, states.position[REST + 3], atol=1e-9)


def test_leaning_touches_are_placed() -> None:
    touches, fresh = record(9, 120, cone=0.78)
    pipeline = SPEC.pipeline(estimator=TABLE).fit(record(8, 120, cone=0.78)[1])
    states = pipeline.process_batch(fresh)
    assert np.isnan(away(states, touches)).mean() < 0.03
    assert np.nanmean(away(states, touches)) < 2e-3
    sideways = states.force[REST:, 0] - touches.force[:, 0]
    assert np.nanstd(sideways) < 0.4 * touches.force[:, 0].std()


def test_other_geometry_turned_chips_and_a_dead_one() -> None:
    turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    config = dataclasses.replace(
        CONFIG,
        positions=np.array([[-12e-3, 1e-3, 0], [1e-3, -2e-3, 0], [12e-3, 0, 0]]),
        rotations=np.stack([np.eye(3), turn, np.eye(3)]),
    )
    _, train = record(10, 100, config=config)
    touches, fresh = record(11, 100, config=config)
    train.values[:, 2] = fresh.values[:, 2] = np.nan
    pipeline = SPEC.pipeline(config).fit(train)
    assert pipeline.estimators['position'] == TABLE
    assert away(pipeline.process_batch(fresh), touches).mean() < 1.2e-3


# -- groups and subsets of truth ---------------------------------------------------------------


def test_fit_holds_out_whole_presses_and_sessions() -> None:
    _, train = record(14, 60)
    again = train.select(np.concatenate([np.arange(len(train)), np.arange(REST, len(train))]))
    held = SPEC.pipeline(estimator=TABLE).fit(again).report['position']
    assert held['rows'] == 120
    assert held['groups'] == 60


def mounts(count: int, known: tuple[str, ...]) -> list[Recording]:
    """Sessions of one pad that is mounted anew, with some columns of their truth."""
    recordings = []
    for number in range(count):
        pad = reference.PadWorld(CONFIG, seed=3, mount=1e-4, remounted=number + 1)
        _, one = record(30 + number, 150, spread=0.2, pad=pad, session=number)
        truth = {k: v for k, v in one.truth.items() if k in (*known, 'session', 'in_contact')}
        recordings.append(dataclasses.replace(one, truth=truth))
    return recordings


@pytest.mark.parametrize('named', [('cell',), ('cell', 'position', 'force')])
def test_sessions_name_the_cells_of_a_new_mount(named: tuple[str, ...]) -> None:
    *train, fresh = mounts(4, named)
    pipeline = SPEC.pipeline().fit(*train)
    states = pipeline.process_batch(fresh)
    assert (states.cell == fresh.truth['cell'])[REST:].mean() > 0.95
    assert {'position', 'cell'} <= pipeline.estimators.keys()
    if 'position' in named:
        assert pipeline.report['position']['groups'] == 3


def test_nearest_neighbours_are_the_floor() -> None:
    """Readings that no pad gives, of presses that come again: the neighbours of [2] answer."""
    _, train = record(1, 60)
    again = train.select(np.concatenate([np.arange(len(train)), np.arange(REST, len(train))]))
    truth = {**again.truth, 'repetition': np.arange(len(again))}
    pattern = 1e-3 + 5e-4 * np.random.default_rng(0).normal(size=(60, 2, 3))
    values = np.concatenate([train.values[:REST], pattern, pattern])
    values += 4e-6 * np.random.default_rng(1).normal(size=values.shape)
    pipeline = SPEC.pipeline().fit(dataclasses.replace(again, values=values, truth=truth))
    assert pipeline.estimators['position'] != TABLE


def rest_only(recording: Recording, rows: int) -> Recording:
    """Its first rows, of whose rest truth says that the force is 0."""
    truth = {name: np.array(column[:rows]) for name, column in recording.truth.items()}
    truth['force'][:REST], truth['in_contact'] = 0.0, (np.arange(rows) >= REST).astype(np.int8)
    tare = np.arange(rows) < REST
    return Recording.from_arrays(LAYOUT, recording.values[:rows], tare=tare, truth=truth)


def test_force_of_0_at_rest_is_no_touch() -> None:
    _, recording = record(41, 20)
    pipeline = SPEC.pipeline().fit(rest_only(recording, REST))
    assert set(pipeline.estimators.values()) == {'nominal'}


def test_touches_that_change_nothing_are_no_failure() -> None:
    _, recording = record(44, 40)
    same = np.broadcast_to(recording.values[:1], recording.values.shape)
    still = Recording.from_arrays(LAYOUT, same, tare=recording.tare, truth=recording.truth)
    states = SPEC.pipeline().fit(still).process_batch(recording)
    assert len(states.valid) == len(recording)


# -- stray fields and ranges -------------------------------------------------------------------


def test_stray_field_is_estimated_and_is_no_contact() -> None:
    touches, stray = record(7, 200, stray=5e-4)
    states = known().process_batch(stray)
    error = away(states, touches)
    neighbours = SPEC.pipeline(estimator='grid_knn').fit(record(1, 300)[1])
    assert np.isnan(error).mean() < 0.05  # the lightest at the edges drown
    assert np.nanmean(error) < 0.3 * np.nanmean(away(neighbours.process_batch(stray), touches))
    off = np.linalg.norm(states.stray_field - stray.truth['stray_field'], axis=1)[REST:]
    assert np.median(off) < 0.1 * 5e-4
    # nothing but a field that came after the tare
    rng = np.random.default_rng(0)
    outside = 5e-4 * rng.normal(size=(100, 3))
    level = stray.values[:REST].mean(axis=0)
    field = level + outside[:, None] + 4e-6 * rng.normal(size=(100, 2, 3))
    values = np.concatenate([stray.values[:REST], field])
    tare = np.arange(len(values)) < REST
    rest = known().process_batch(Recording.from_arrays(LAYOUT, values, tare=tare))
    assert (rest.in_contact[REST:] == 0).mean() > 0.95
    assert np.nanmax(np.abs(rest.force[rest.in_contact == 0])) == 0
    untouched = rest.in_contact[REST:] == 0
    np.testing.assert_allclose(rest.stray_field[REST:][untouched], outside[untouched], atol=3e-5)


def test_cells_alone_bear_a_stray_field() -> None:
    _, train = record(1, 300, spread=0.2)
    truth = {k: train.truth[k] for k in ('cell', 'in_contact')}
    pipeline = SPEC.pipeline().fit(dataclasses.replace(train, truth=truth))
    for stray, most in ((0.0, 0.9), (5e-4, 0.7)):
        touches, fresh = record(7, 200, spread=0.1, stray=stray)
        states = pipeline.process_batch(fresh)
        assert (states.cell[REST:] == touches.cell).mean() > most
        assert np.isfinite(states.position[REST:]).all()
        assert np.isnan(states.force).all()


def test_strong_fields_are_flagged_and_make_no_place_certain() -> None:
    shares, sigmas = [], []
    for field in (0.0, 0.5e-3, 5e-3):
        touches, seen = record(6, 150, stray=field)
        states = known().process_batch(seen)
        strong = flagged(states, FrameStatus.STRAY_FIELD)
        assert strong == 0 if field == 0 else field < 1e-3 or strong > 0.9
        shares.append(min(list(inside(states, touches, 2).values())[:2]))
        sigmas.append(np.nanmedian(np.sqrt(states.position_cov[REST:, 0, 0])))
    assert min(shares) > 0.8
    assert sigmas[2] > 2 * sigmas[1]


def test_without_the_stray_term_a_field_is_flagged() -> None:
    plain = dataclasses.replace(CONFIG, stray_term=False)
    pipeline = SPEC.pipeline(plain, TABLE).fit(record(1, 150, config=plain)[1])
    assert flagged(pipeline.process_batch(record(2, 200, config=plain)[1]),
                   FrameStatus.STRAY_FIELD) == 0  # fmt: skip
    for field in (0.5e-3, 5e-3):
        touches, seen = record(2, 200, config=plain, stray=field)
        states = pipeline.process_batch(seen)
        assert flagged(states, FrameStatus.STRAY_FIELD) > 0.9
        assert min(list(inside(states, touches, 2).values())[:2]) > 0.7
    assert states.valid[REST:].mean() < 0.5


def test_loads_beyond_those_recorded_are_flagged_and_uncertain() -> None:
    sigma = []
    for loads in ((2.0, 9.0), (12.0, 20.0)):
        touches, seen = record(8, 200, loads=loads)
        states = known().process_batch(seen)
        sigma.append(np.sqrt(states.force_cov[REST:, 2, 2]))
        share = flagged(states, FrameStatus.OUT_OF_RANGE)
        assert share > 0.9 if loads[0] > 10 else share < 0.05
        assert min(inside(states, touches, 2).values()) > 0.8
        assert not (states.status[:REST] & FrameStatus.OUT_OF_RANGE).any()
    assert np.median(sigma[1]) > 2 * np.median(sigma[0])


def test_force_of_0_states_what_is_too_light_to_be_felt() -> None:
    touches, seen = record(9, 300, loads=(0.02, 0.8))
    states = known().process_batch(seen)
    rest = np.flatnonzero(states.in_contact[REST:] == 0)
    assert 60 < len(rest) < 270
    assert (states.force[REST:][rest] == 0).all()
    assert inside(states, touches, 2, rest)['force', 2] > 0.88
    sigma = np.sqrt(states.force_cov[:, 2, 2])
    assert np.median(sigma[:REST]) < np.median(sigma[REST:][rest])


# -- baseline and temperature ------------------------------------------------------------------


def test_noise_of_a_tare_of_one_frame_is_stated() -> None:
    shares, sigma = [], []
    for seed in range(3):
        touches, seen = record(40 + seed, 40)
        keep = (np.arange(len(seen)) == 0) | ~seen.tare
        few = known().process_batch(seen.select(keep))
        error = np.abs(few.position[1:] - touches.place)[:, :2]
        variance = np.diagonal(few.position_cov[1:], axis1=1, axis2=2)[:, :2]
        shares.append((error <= 2 * np.sqrt(variance)).mean())
        more = known().process_batch(seen).position_cov[REST:, 0, 0]
        sigma.append(np.median(np.sqrt(variance[:, 0] / more)))
    assert np.mean(shares) > 0.88
    assert np.mean(sigma) > 1.2


def warm(rise: float, count: int = 200, seed: int = 8, **more: float) -> tuple[object, Recording]:
    """Presses by `rise` (degrees) above their tare."""
    touches, seen = record(seed, count)
    above = np.where(np.arange(len(seen)) < REST, 0.0, rise)
    return touches, world().warmed(seen, above, seed, layout=LAYOUT, **more)


@lru_cache
def known_warm() -> Pipeline:
    return SPEC.pipeline(estimator=TABLE).fit(warm(0.0, 200, 1)[1])


def judged(states: ContactStates, touches: object) -> tuple[float, float]:
    """Root mean square error of Fz (N), and its share inside two sigma."""
    error = states.force[REST:, 2] - touches.force[:, 2]
    return float(np.sqrt((error**2).mean())), inside(states, touches, 2)['force', 2]


@pytest.mark.parametrize('fitted', [True, False])
def test_forces_above_the_temperature_of_the_tare_are_as_good(fitted: bool) -> None:
    pipeline = known_warm() if fitted else SPEC.pipeline().fit(warm(0.0)[1].select(slice(REST)))
    usual, _ = judged(pipeline.process_batch(warm(0.0)[1]), warm(0.0)[0])
    for rise in (-5.0, 5.0):
        touches, seen = warm(rise)
        error, share = judged(pipeline.process_batch(seen), touches)
        assert error < 1.1 * usual
        assert share > 0.88
    blind = Recording.from_arrays(LAYOUT, seen.values, tare=seen.tare, truth=dict(seen.truth))
    assert not fitted or judged(pipeline.process_batch(blind), touches)[0] > 2 * error


def test_sigma_of_the_slope_grows_with_the_temperature() -> None:
    sigmas = []
    for rise in (0.0, 2.0, 5.0, 20.0):
        touches, seen = warm(rise, slope=(1 - SLOPE_SIGMA) * REMANENCE_SLOPE)
        states = known_warm().process_batch(seen)
        sigmas.append(np.median(np.sqrt(states.force_cov[REST:, 2, 2])))
        assert judged(states, touches)[1] > 0.85
        assert flagged(states, FrameStatus.OUT_OF_RANGE) < 0.1 or rise > 4
    assert sigmas[0] < sigmas[1] < sigmas[2] < 0.5 * sigmas[3]


def warm_rests(slope: float) -> list[Recording]:
    """Recordings that grow warm after their tares, at rest too."""
    parts = []
    for seed, rise in enumerate((-4.0, 3.0, 5.0)):
        _, seen = record(20 + seed, 60)
        rest = np.arange(REST)
        seen = seen.select(np.concatenate([rest, rest, np.arange(REST, len(seen))]))
        tare = np.arange(len(seen)) < REST
        seen = Recording.from_arrays(LAYOUT, seen.values, tare=tare, truth=dict(seen.truth))
        above = np.where(tare, 0.0, rise * np.arange(len(seen)) / len(seen))
        parts.append(world().warmed(seen, above, seed, slope=slope, layout=LAYOUT))
    return parts


def test_rests_at_other_temperatures_give_the_slope() -> None:
    pipeline = SPEC.pipeline(estimator='grid_knn').fit(*warm_rests(-2e-3))
    drift, digest = pipeline.estimation.drift_, pipeline.digest
    assert drift.slope_ == pytest.approx(-2e-3, rel=0.25)
    assert drift.sigma_ < 0.8 * ThermalDrift().sigma_
    assert pipeline.fit(*warm_rests(-2e-3)).digest == digest  # whatever was fitted before
    span = pipeline.report['not learned: temperatures beyond those recorded (C)']
    assert span['least'] == pytest.approx(21.0, abs=0.3)
    assert span['most'] == pytest.approx(30.0, abs=0.3)


def test_tare_brings_its_temperature_live_in_a_file_and_in_a_bag(tmp_path: Path) -> None:
    known_warm().save(tmp_path / 'pad.npz')
    pipeline = SPEC.load(tmp_path / 'pad.npz')
    _, seen = warm(4.0)
    batch = known_warm().process_batch(seen)
    digest, rest = pipeline.digest, [seen.frame(i) for i in range(REST)]
    pipeline.tare(rest)
    assert pipeline.digest == digest
    np.testing.assert_allclose(pipeline.baseline_temperature_c, 25.0, atol=0.02)
    for row in (REST, REST + 7):
        live = pipeline.process(seen.frame(row))
        np.testing.assert_allclose(live.force, batch.force[row], rtol=1e-9)
        np.testing.assert_allclose(live.force_cov, batch.force_cov[row], rtol=1e-9)
    pipeline.save(tmp_path / 'tared.npz')
    baselines: list[Frame] = []
    stage = ContactLoop(SPEC.load(tmp_path / 'tared.npz'), 10, False, baselines.append)
    state = stage.process([seen.frame(REST + 9)])[0]
    other = SPEC.load(tmp_path / 'pad.npz')
    other.tare(baselines)
    np.testing.assert_array_equal(other.process(seen.frame(REST + 9)).force, state.force)
    assert stage.tare()[0]
    state = stage.process([seen.frame(REST + 10)])[0]
    other.tare(baselines[-1:])
    replayed = other.process(seen.frame(REST + 10))
    assert baselines[-1].averaged == other.tare_frames == 1
    np.testing.assert_array_equal(replayed.force_cov, state.force_cov)
