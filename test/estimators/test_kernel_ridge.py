"""Kernel ridge regression against its plain definition, and how it bends and continues."""

from __future__ import annotations

import numpy as np
import pytest

from tactile_ros.estimators.kernel_ridge import KernelRidge, gaussian, spread_out
from tactile_ros.estimators.regression import held_out_squares, ridge_weights
from tactile_ros.types import Array, Integers


def presses(rows: int, seed: int) -> tuple[Array, Array, Integers]:
    """Changes of field (T) that saturate, two forces (N) and the press of each row."""
    rng = np.random.default_rng(seed)
    depth = rng.uniform(0, 1, rows)
    x = 1e-3 * np.column_stack([depth, depth**2, np.tanh(2 * depth), 0.1 * np.sin(5 * depth)])
    y = np.column_stack([20 * depth**1.5, np.sin(4 * depth)])
    return x + 1e-6 * rng.normal(size=x.shape), y, rng.integers(0, 8, rows)


def test_weights_solve_the_penalised_problem() -> None:
    x, y, groups = presses(150, seed=0)
    model = KernelRidge(samples=12, linear=0.3, strengths=(1e-3,)).fit(x, y, groups)
    z = x * model.gain_ / model.length_
    bumps, plane = gaussian(z, model.samples_), z * model.length_ * np.sqrt(0.3)
    terms = np.column_stack([bumps, plane, np.ones(len(x))])
    penalty = np.zeros((terms.shape[1],) * 2)
    penalty[:12, :12] = gaussian(model.samples_, model.samples_)
    penalty[12:-1, 12:-1] = np.eye(4)
    weights = np.linalg.solve(terms.T @ terms + 1e-3 * len(x) * penalty, terms.T @ y)
    np.testing.assert_allclose(model.predict(x), terms @ weights, rtol=0, atol=1e-7)


def test_a_bent_relation_is_learned() -> None:
    x, y, groups = presses(600, seed=1)
    fresh, truth, _ = presses(200, seed=2)
    error = KernelRidge().fit(x, y, groups).predict(fresh) - truth
    assert np.sqrt((error**2).mean()) < 0.02


def test_the_unit_of_the_features_does_not_matter() -> None:
    x, y, groups = presses(200, seed=3)
    one = KernelRidge().fit(x, y, groups).predict(x)
    other = KernelRidge().fit(1e6 * x, y, groups).predict(1e6 * x)
    np.testing.assert_allclose(other, one, rtol=0, atol=1e-6)


def test_a_channel_without_signal_is_not_raised() -> None:
    x, y, groups = presses(400, seed=4)
    noise = 1e-7 * np.random.default_rng(4).normal(size=(400, 20))
    model = KernelRidge().fit(np.column_stack([x, noise]), y, groups)
    moved = model.predict(np.column_stack([x, -noise])) - model.predict(
        np.column_stack([x, noise])
    )
    assert np.abs(moved).max() < 0.05


def test_a_row_alone_is_the_row_among_others_to_rounding() -> None:
    x, y, groups = presses(300, seed=7)
    model = KernelRidge().fit(x, y, groups)
    many = model.predict(x)  # in two blocks
    alone = np.concatenate([model.predict(row) for row in x[:, None]])
    # products of many rows are summed in another order; weights far above 1 cancel in the answer
    scale = np.abs(model.bumps_).sum(axis=0).max()
    assert scale > np.abs(many).max()
    np.testing.assert_allclose(alone, many, rtol=0, atol=1e-14 * scale)


def test_equal_rows_need_no_more_samples() -> None:
    model = KernelRidge().fit(np.ones((30, 3)), np.arange(30.0)[:, None], np.arange(30) % 5)
    assert model.samples_.shape == (1, 3)
    assert model.predict(np.ones((1, 3)))[0, 0] == pytest.approx(14.5)


def test_spread_samples_keep_apart() -> None:
    z = np.random.default_rng(5).normal(size=(300, 2))
    picked = z[spread_out(z, 20)]
    apart = np.linalg.norm(picked[:, None] - picked, axis=2)[np.triu_indices(20, 1)]
    reach = np.linalg.norm(z[:, None] - picked, axis=2).min(axis=1)
    assert reach.max() <= apart.min() + 1e-9


def test_errors_on_folds_are_those_of_refits() -> None:
    rng = np.random.default_rng(6)
    terms, target, fold = rng.normal(size=(60, 5)), rng.normal(size=(60, 2)), np.arange(60) % 3
    expected = []
    for strength in (1e-3, 10.0):
        total = 0.0
        for part in range(3):
            out = fold == part
            weights = ridge_weights(terms[~out], target[~out], strength)
            total += float(((terms[out] @ weights - target[out]) ** 2).sum())
        expected.append(total)
    squares = held_out_squares(terms, target, fold, np.array([1e-3, 10.0]))
    np.testing.assert_allclose(squares, expected, rtol=1e-9)


def test_one_fold_is_judged_on_itself() -> None:
    terms = np.eye(3)
    squares = held_out_squares(terms, terms, np.zeros(3, np.int64), np.array([1e-12]))
    assert squares[0] == pytest.approx(0.0, abs=1e-12)
