"""Trials on groups left out, and the choice that needs a reason."""

from __future__ import annotations

import numpy as np
import pytest

from tactile_ros.estimators.model_selection import (
    Trial,
    at_corners,
    caution,
    chosen,
    left_out,
    trials,
)
from tactile_ros.estimators.power_law_force import MeanCurve, PowerLawForce


def trial(errors: np.ndarray, seen: float = 0.1) -> Trial:
    """Trial of a candidate with these errors over groups."""
    return Trial(np.zeros((1, 1)), np.zeros((1, 1)), float(errors.mean()), errors, seen)


def test_a_rival_needs_a_reason() -> None:
    rng = np.random.default_rng(0)
    model = rng.uniform(0.8, 1.2, 12)
    found = {'model': trial(model), 'little': trial(0.8 * model), 'much': trial(0.3 * model)}
    assert chosen({k: found[k] for k in ('model', 'little')}, 'model') == 'model'
    assert chosen(found, 'model') == 'much'
    lucky = model.copy()
    lucky[:2] = 0.01
    assert chosen({'model': trial(model), 'lucky': trial(lucky)}, 'model') == 'model'


def test_a_rival_that_is_worse_at_home_must_be_far_better_away() -> None:
    model = np.full(12, 1.0)
    poor, great = trial(0.4 * model, seen=1.0), trial(0.1 * model, seen=1.0)
    assert chosen({'model': trial(model), 'poor': poor}, 'model') == 'model'
    assert chosen({'model': trial(model), 'great': great}, 'model') == 'great'


def test_without_the_expected_one_the_least_error_wins() -> None:
    assert chosen({'a': trial(np.ones(5)), 'b': trial(0.9 * np.ones(5))}, 'none') == 'b'
    broken = Trial(np.zeros((1, 1)), np.zeros((1, 1)), np.inf, np.full(5, np.inf))
    assert chosen({'model': broken, 'b': trial(np.ones(5))}, 'model') == 'b'


@pytest.mark.parametrize(('rows', 'terms'), [(4, 9), (9, 4)])
def test_left_out_is_what_a_regression_without_the_rows_says(rows: int, terms: int) -> None:
    rng = np.random.default_rng(1)
    x, y = rng.normal(size=(30, terms)), rng.normal(size=30)
    held, precision = np.arange(rows), np.linalg.inv(x.T @ x + np.eye(terms))
    root = np.linalg.cholesky(precision)
    error = y - x @ (precision @ (x.T @ y))
    off, variance = left_out(x[held] @ root, error[held])
    other = np.linalg.inv(x[rows:].T @ x[rows:] + np.eye(terms))
    np.testing.assert_allclose(off, y[held] - x[held] @ (other @ (x[rows:].T @ y[rows:])), 1e-5)
    np.testing.assert_allclose(variance, np.einsum('sp,pq,sq->s', x[held], other, x[held]), 1e-5)


def test_an_estimator_that_leaves_out_says_what_refits_say() -> None:
    rng = np.random.default_rng(2)
    line = np.linspace(0.125, 0.875, 4)
    place = np.repeat(np.stack(np.meshgrid(line, line), -1).reshape(-1, 2), 8, axis=0)
    force = np.tile(np.linspace(1, 15, 8), 16)
    film = 2 * np.exp(0.2 * np.sin(4 * place[:, 0])) * force**-0.7
    x = np.column_stack([place, film * np.exp(1e-3 * rng.normal(size=128))])
    group = np.repeat(np.arange(16), 8)
    whole = PowerLawForce(2.5e-4).fit(x, force[:, None], group)
    said, _ = whole.held_out(x, force[:, None], group)
    for out in (5, 6, 9):
        rows = group != out
        other = PowerLawForce(2.5e-4).fit(x[rows], force[rows, None], group[rows])
        near = np.log(other.predict(x[~rows])[:, 0] / said[~rows, 0])
        assert np.abs(near).max() < 0.03


def test_caution_of_few_groups_stays_near_one() -> None:
    asked = np.full(60, 4.0)
    assert caution(asked, np.ones(60), 4) == 1.0
    assert 1.0 < caution(asked, np.ones(60), 6) < caution(asked, np.ones(60), 60) < 4.0


def test_corners_are_those_of_a_grid_though_places_are_noisy() -> None:
    line = np.arange(4.0)
    grid = np.stack(np.meshgrid(line, line), -1).reshape(-1, 2)
    noisy = grid + 1e-4 * np.random.default_rng(3).normal(size=grid.shape)
    corner = at_corners(noisy, np.arange(16))
    assert set(np.flatnonzero(corner)) == {0, 3, 12, 15}
    assert not at_corners(np.zeros((3, 2)), np.arange(3)).any()


def test_trials_tell_what_was_seen_and_unseen() -> None:
    rng = np.random.default_rng(4)
    x, group = rng.uniform(size=(80, 3)), np.repeat(np.arange(20), 4)
    found, told = trials({'curve': MeanCurve(0)}, x, x[:, :1], group, lambda u, _: u[:, :2])
    assert found['curve'].error < 1e-6
    assert found['curve'].seen < 1e-6
    assert len(told) == len(found['curve'].said)
