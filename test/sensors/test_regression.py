# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""State and gain of a skin, votes and turns, and what recorded touches leave open."""

import dataclasses

import numpy as np
import pytest
from scipy.special import stdtrit

from tactile_ros.errors import NotCalibratedError
from tactile_ros.sensors import load_sensor
from tactile_ros.sensors.regression import (
    Regression,
    RestingState,
    Touch,
    Vote,
    gain_spread,
    longest_hold,
    missing_history,
    missing_loads,
)
from tactile_ros.types import Array, Integers, Recording, Signals

WAY = np.array([3.0, -4.0, 0.0]) / 5
ALONE = np.zeros(20, np.int64)  # one group


@pytest.mark.parametrize(
    ('runs', 'sigma', 'spread'), [(300, 0.04, 0.04), (2, 0.0, 0.025 / 2**0.5 * stdtrit(2, 0.8413))]
)
def test_gain_spread_of_many_runs_is_theirs_and_of_few_the_prior(
    runs: int, sigma: float, spread: float
) -> None:
    rng = np.random.default_rng(0)
    force = np.tile(np.linspace(0.0, 20.0, 50)[:, None] * [0.0, 0.6, 0.8], (runs, 1))
    gain = 1 + sigma * rng.normal(size=runs)
    others, run = (gain.sum() - gain) / (runs - 1), np.repeat(np.arange(runs), 50)
    predicted = force * (others / gain)[run, None]
    assert gain_spread(predicted, force, run) == pytest.approx(spread, rel=0.1)


def test_gain_spread_of_one_run_or_of_no_load_is_finite() -> None:
    force = np.ones((6, 1))
    assert gain_spread(force, force, np.zeros(6, int)) == pytest.approx(0.065, rel=1e-3)
    assert np.isfinite(gain_spread(0 * force, 0 * force, np.repeat(np.arange(2), 3)))


def setting_runs(shift: float = 0.0) -> tuple[Array, Array, Integers]:
    """Rests (T) that move along one way in two runs, the second shifted across it; states."""
    rng = np.random.default_rng(0)
    state = np.tile(100e-6 * (1 - np.exp(-np.arange(10) / 3)), 2)
    runs = np.repeat(np.arange(2), 10)
    rests = 5e-3 + state[:, None] * WAY + 1e-6 * rng.normal(size=(20, 3))
    rests[:, 2] += shift * runs
    return rests, state, runs


@pytest.mark.parametrize('shift', [0.0, 2e-3])
def test_resting_state_is_along_the_way_within_runs(shift: float) -> None:
    rests, state, runs = setting_runs(shift)
    found = RestingState().fit(rests, runs, ALONE)
    assert abs(found.direction_ @ WAY) == pytest.approx(1.0, abs=2e-3)
    alike = np.corrcoef(found.predict(rests)[0][runs == 0, 0], state[runs == 0])[0, 1]
    assert abs(alike) > 0.99


def test_resting_state_moves_by_no_more_than_the_slack() -> None:
    rests, _, runs = setting_runs()
    state = RestingState().fit(rests, runs, ALONE)
    seen = state.predict(rests)[0]
    far = state.predict(rests + 1e-3 * WAY)[0]
    assert np.ptp(far) == 0
    edge = min(abs(far[0, 0] - seen.min()), abs(far[0, 0] - seen.max()))
    assert edge == pytest.approx(0.25 * np.ptp(seen))


def test_resting_state_leaves_variance_by_distance_in_any_unit() -> None:
    rests, _, runs = setting_runs()
    state, micro = (RestingState().fit(unit * rests, runs, ALONE) for unit in (1, 1e6))
    np.testing.assert_allclose(state.predict(rests)[1], 0.0, atol=1e-9)
    steps = np.array([[0.1], [0.5], [1.0], [5.0]]) * state.width_
    fresh = rests[:1] + steps * np.array([0.0, 0.0, 1.0])
    along, share = state.predict(fresh)
    np.testing.assert_allclose(share, 1 - np.exp(-((steps[:, 0] / state.width_) ** 2)), atol=0.02)
    np.testing.assert_allclose(micro.predict(1e6 * fresh)[0], 1e6 * along, rtol=1e-6)
    np.testing.assert_allclose(state.predict(fresh[2:3])[1], share[2:3], rtol=1e-6)
    each = RestingState().fit(rests, runs, np.arange(20) % 10 // 3)
    assert 0.01 < each.usual_ < 0.5  # which errors of groups held out hold already
    np.testing.assert_allclose(each.predict(fresh)[1], np.maximum(share - each.usual_, 0.0))
    with pytest.raises(NotCalibratedError, match='RestingState'):
        RestingState().predict(rests)


def test_resting_state_of_one_or_of_shared_readings_leaves_all_or_nothing() -> None:
    rest = np.full((5, 3), 2e-3)
    state = RestingState().fit(rest, *np.zeros((2, 5), np.int64))
    assert not state.predict(rest + 1e-4)[0].any()
    assert not state.predict(rest)[1].any()
    np.testing.assert_allclose(state.predict(rest + 1e-4)[1], 1.0)
    rests = np.array([[0.0, 1], [2, 1], [2, 1], [5, 1]])
    own, shared = np.array([0, 0, 0, 1]), np.array([0, 0, 1, 1])
    state = RestingState().fit(rests, own, own)
    np.testing.assert_allclose(state.predict(rests)[1], 0.0, atol=1e-9)
    assert RestingState().fit(rests, shared, own).predict(rests)[1].tolist() == [1.0] * 4


SPEC = dataclasses.replace(load_sensor('multipole_skin'), estimation=Regression)
CONFIG = dataclasses.replace(SPEC.config(), positions=np.eye(3)[:2] * 0.01, track_baseline=False)


def turning(samples: int, seed: int, named: bool = True) -> Recording:
    """Readings that tell a turn and, if `named`, a label."""
    rng = np.random.default_rng(seed)
    yaw, label = rng.uniform(-np.pi, np.pi, samples), rng.integers(3, size=samples)
    values = np.zeros((samples, 2, 3))
    values[:, 0, 0], values[:, 0, 1] = 1e-3 * np.cos(yaw), 1e-3 * np.sin(yaw)
    values[:, 1, 2] = 1e-3 * (1 + label) * named + 1e-3
    values[:20] = 0.0
    values += 1e-6 * rng.normal(size=values.shape)
    rest = np.arange(samples) < 20
    truth = {
        'yaw': np.where(rest, np.nan, yaw),
        'label': np.where(rest, -1, label),
        'in_contact': (~rest).astype(np.int8),
    }
    return Recording.from_arrays(SPEC.layout(CONFIG), values, truth=truth)


def test_regression_finds_turns_without_a_seam_and_labels() -> None:
    pipeline = SPEC.pipeline(CONFIG).fit(turning(400, 1))
    fresh = turning(200, 2)
    states = pipeline.process_batch(fresh)
    touched = fresh.truth['in_contact'] == 1
    miss = np.angle(np.exp(1j * (states.yaw - fresh.truth['yaw'])))[touched]
    assert (np.abs(np.abs(fresh.truth['yaw'][touched]) - np.pi) < 0.2).any()
    assert np.abs(miss).max() < 0.1
    assert 0.5 < (np.abs(miss) <= states.yaw_std[touched]).mean() < 0.95
    assert (states.label == fresh.truth['label']).mean() > 0.95
    assert np.median(states.label_probability[touched]) > 0.9
    assert pipeline.label_names == ('0', '1', '2')
    assert pipeline.report['label']['held_out_accuracy'] > 0.9
    assert np.isnan(states.yaw[~touched]).all()


def test_regression_votes_neither_by_chance_nor_for_another_estimator() -> None:
    pipeline = SPEC.pipeline(CONFIG, 'grid_knn').fit(turning(400, 1, named=False))
    assert 'label' not in pipeline.estimators
    assert pipeline.report['label']['held_out_accuracy'] < 0.45
    assert (pipeline.process_batch(turning(100, 2, named=False)).label == -1).all()
    assert pipeline.label_names == ()
    assert SPEC.pipeline(CONFIG, 'ridge').fit(turning(200, 1)).estimators == {'yaw': 'ridge'}


def test_vote_of_one_class_always_names_it() -> None:
    x = np.random.default_rng(0).normal(size=(12, 3))
    names, shares = Vote('cell').fit(x, np.full(12, 7), np.arange(12)).predict(x)
    assert names.tolist() == [7] * 12
    np.testing.assert_allclose(shares, 1)


def signals(
    contact: list[int], seconds: list[float] | None, tare: list[int] | None = None,
    begins: list[int] | None = None,
) -> Signals:  # fmt: skip
    """Frames of one taxel; streams begin where told, and at the first row."""
    rows = len(contact)
    blank = np.zeros((rows, 1, 1))
    first = np.arange(rows) == 0 if begins is None else np.array(begins, bool)
    stamps = None if seconds is None else (1e9 * np.array(seconds)).astype(np.int64)
    return Signals(
        blank, blank, blank, None, stamps, first, np.array(contact, np.int8),
        np.ones(rows, bool), first, None if tare is None else np.array(tare, bool),
    )  # fmt: skip


@pytest.mark.parametrize(
    ('contact', 'seconds', 'begins', 'longest'),
    [
        ([0, 1, 1, 1, 0, 1, 1], [0, 1, 2, 4, 5, 6, 10], None, 4.0),
        ([1, 1, 0, 1], [0, 2, 3, 4], None, 2.0),
        ([0, 1, 1, 1, 1], [0, 1, 3, 5, 6], [1, 0, 0, 1, 0], 2.0),  # a new stream: another touch
        ([0, -1, 0], [0, 1, 2], None, 0.0),
    ],
)
def test_longest_hold_is_within_a_stream(
    contact: list[int], seconds: list[float], begins: list[int] | None, longest: float
) -> None:
    assert longest_hold(signals(contact, seconds, begins=begins)) == pytest.approx(longest)


@pytest.mark.parametrize(
    ('contact', 'tare', 'begins', 'open_'),
    [
        ([0, 1, 1, 0], None, [1, 0, 0, 0], True),
        ([0, 1, 0, 1], [1, 0, 0, 0], [1, 0, 0, 0], False),
        ([1, 0, 1, 1], [0, 1, 0, 0], [1, 0, 0, 0], True),  # tared after a touch
        ([0, 1, 0, 1], [1, 0, 0, 0], [1, 0, 1, 0], True),  # the second stream has none
        ([0, 1, 0, 1], [1, 0, 1, 0], [1, 0, 1, 0], False),
        ([0, 1, 0, 0], [1, 0, 0, 0], [1, 0, 1, 0], False),  # nor any touch
    ],
)
def test_missing_history_names_a_rest_that_is_not_before_the_first_load(
    contact: list[int], tare: list[int] | None, begins: list[int], open_: bool
) -> None:
    rest = 'not learned: rest before any load (no tare rows)'
    for crept, share in ((0.1, {'share of a load that rests may still hold': 0.1}), (0.0, {})):
        told = missing_history(signals(contact, [0, 1, 2, 3], tare, begins), crept)
        assert told.get(rest) == (share if open_ else None)
        assert 'longest' in told['not learned: holds beyond the longest (s)']
        free = missing_history(signals(contact, None, tare, begins), crept)
        assert 'not learned: creep (frames without stamps)' in free


def test_missing_loads_are_those_that_count() -> None:
    told = missing_loads(np.array([[np.nan, 0.0], [4.0, 1e-9], [-1.0, 0.5]]))
    assert told == {'not learned: loads beyond those recorded (N)': {'least': 0.5, 'most': 4.0}}
    assert missing_loads(np.full(3, np.nan)) == {'not learned: force (no truth of loads)': {}}


@pytest.mark.parametrize('informed', [True, False])
def test_touch_is_learned_only_where_it_beats_the_threshold(informed: bool) -> None:
    rng = np.random.default_rng(0)
    load = np.where(np.arange(300) % 2, rng.uniform(1.0, 2.0, 300), 0.0)
    shown = load if informed else rng.permutation(load)
    x = shown[:, None] + rng.normal(0, 0.05, (300, 2))
    touched = load > 0
    floor = rng.permutation(touched) if informed else touched
    found = Touch().fit(x, load, np.repeat(np.arange(10), 30), floor)
    assert (found is not None) == informed
    if found is not None:
        assert found.report_['held_out_found'] > 0.95 > found.report_['threshold_found']
        np.testing.assert_array_equal(found.predict(x), touched)
        found.refuse_damage()
        found.step_.bumps_[:] = 0.0
        with pytest.raises(ValueError, match='touch is not that of the fit'):
            found.refuse_damage()
