# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Regressions against their plain definitions, and the methods of the papers."""

import numpy as np
import pytest

from tactile_ros.estimators import regression
from tactile_ros.estimators.grid_knn import GridKnn
from tactile_ros.estimators.polynomial_force import (
    PolynomialForce,
    ThermalPolynomial,
    gradient_field,
    products,
)
from tactile_ros.estimators.rbf_force import RbfForce, k_means
from tactile_ros.estimators.regression import (
    KernelRidge,
    Perceptron,
    best_strength,
    gaussian,
    ridge_weights,
    spread_out,
)
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
    z = x * model.gain_
    bumps, plane = gaussian(z, model.samples_), z * model.length * np.sqrt(0.3)
    terms = np.column_stack([bumps, plane, np.ones(len(x))])
    penalty = np.zeros((terms.shape[1],) * 2)
    penalty[:12, :12] = gaussian(model.samples_, model.samples_)
    penalty[12:-1, 12:-1] = np.eye(4)
    weights = np.linalg.solve(terms.T @ terms + 1e-3 * len(x) * penalty, terms.T @ y)
    np.testing.assert_allclose(model.predict(x), terms @ weights, rtol=0, atol=1e-7)


def test_a_channel_without_signal_is_not_raised() -> None:
    x, y, groups = presses(400, seed=4)
    noise = 1e-7 * np.random.default_rng(4).normal(size=(400, 20))
    model = KernelRidge().fit(np.column_stack([x, noise]), y, groups)
    moved = model.predict(np.column_stack([x, -noise])) - model.predict(
        np.column_stack([x, noise])
    )
    assert np.abs(moved).max() < 0.05


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


def test_penalty_is_the_best_of_refits() -> None:
    rng = np.random.default_rng(6)
    terms, target, fold = rng.normal(size=(60, 5)), rng.normal(size=(60, 2)), np.arange(60) % 3
    target += terms[:, :2]
    strengths, errors = 10.0 ** np.arange(-3, 3), np.zeros(6)
    for row, strength in enumerate(strengths):
        for part in range(3):
            out = fold == part
            weights = ridge_weights(terms[~out], target[~out], strength)
            errors[row] += ((terms[out] @ weights - target[out]) ** 2).sum()
    assert best_strength(terms, target, fold, strengths) == strengths[errors.argmin()]
    assert best_strength(terms, target, np.zeros(60, np.int64), strengths) == strengths[3]


def test_anchor_follows_a_skin_that_goes_on_softening() -> None:
    rng = np.random.default_rng(1)
    rows, presses = 60, 12
    load = np.tile(np.sin(np.linspace(0, np.pi, rows)), presses)[:, None]
    press = np.repeat(np.arange(presses), rows)
    soft = 0.02 * press[:, None]
    # a disturbance within each press hides that the second channel shows how soft the skin is
    wander = 0.1 * rng.normal(size=load.shape)
    x = np.concatenate([load * (1 + soft) + wander, load * (1 - soft) + 2 * wander], axis=1)
    x += 0.01 * rng.normal(size=x.shape)
    first = press < 6
    errors = []
    for weight in (1.0, 100.0):
        terms, target = x[first].copy(), load[first].copy()
        regression._anchor(terms, target, press[first], load[first, 0], weight)
        error = (x @ ridge_weights(terms, target, 1e-9) - load) * load
        errors.append(np.mean([abs(error[press == p].sum()) for p in range(6, 12)]))
    assert errors[1] < 0.5 * errors[0]


def test_mean_of_members_written_out() -> None:
    rng = np.random.default_rng(0)
    x, y = rng.normal(size=(80, 3)), rng.normal(size=(80, 2))
    net = Perceptron(members=3, width=5, epochs=5).fit(x, y)
    answers = []
    for m in range(3):
        hidden = np.tanh(x @ net.first_[m] + net.first_level_[m])
        deeper = np.tanh(hidden @ net.second_[m] + net.second_level_[m])
        answers.append(3 * deeper @ net.last_[m] + net.last_level_)
    assert np.allclose(net.predict(x), np.mean(answers, axis=0), rtol=0, atol=1e-12)


def test_pattern_sees_direction_and_length() -> None:
    rng = np.random.default_rng(2)
    direction = rng.normal(size=(600, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    depth = rng.uniform(0.5, 5.0, (600, 1))
    x, y = 1e-4 * depth * direction, direction[:, :2]
    errors = {}
    for pattern in (False, True):
        net = Perceptron(members=2, width=16, epochs=60, pattern=pattern).fit(x[:400], y[:400])
        errors[pattern] = np.linalg.norm(net.predict(x[400:]) - y[400:], axis=1).mean()
    assert errors[True] < 0.5 * errors[False]


def test_small_differences_of_large_fields_are_told() -> None:
    # |a|^2 - 2 a b + |b|^2 in singles gives -128 for 9 between vectors of 40 mT
    rng = np.random.default_rng(0)
    field = 40e-3 * np.sign(rng.normal(size=60))
    known = field + 3e-6 * rng.normal(size=(50, 60))
    named = np.eye(50)
    found = GridKnn(neighbours=1).fit(known, named).predict(known + 0.3e-6)
    np.testing.assert_array_equal(found.argmax(axis=1), np.arange(50))
    single = known.astype(np.float32)
    expanded = (single**2).sum(axis=1)[:, None] - 2 * single @ single.T + (single**2).sum(axis=1)
    assert (expanded < 0).any()


def test_of_samples_as_near_the_first_in_order_answers_and_one_that_is_met_is_not_nan() -> None:
    x = np.array([[-1.0, 0.0], [1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
    y = np.array([[10.0], [20.0], [30.0], [40.0]])
    for order in (np.arange(4), np.arange(4)[::-1]):
        model = GridKnn(neighbours=2).fit(x[order], y[order])
        middle = model.predict(np.zeros((1, 2)))
        first = GridKnn(neighbours=2).fit(x, y).predict(np.zeros((1, 2)))
        np.testing.assert_allclose(middle, first)
        np.testing.assert_allclose(model.predict(x), y, rtol=0.01)


def test_k_means_leaves_out_empty_and_equal_clusters() -> None:
    points = np.repeat(np.array([[0.0, 0.0], [1.0, 1.0]]), 20, axis=0)
    assert len(k_means(points, 8, seed=0)) == 2
    x = np.column_stack([points, points[:, :1]])
    found = RbfForce().fit(x, points[:, :1])
    np.testing.assert_allclose(found.predict(x), points[:, :1], atol=1e-6)


def test_more_nodes_until_the_target_is_met() -> None:
    x = np.random.default_rng(3).uniform(size=(300, 1))
    coarse = RbfForce(target=0.05).fit(x, np.sin(9 * x))
    fine = RbfForce(target=1e-5).fit(x, np.sin(9 * x))
    assert len(coarse.centres_) < len(fine.centres_)


def test_hard_case_5_duplicated_centres_leave_weights_small_and_widths_above_zero() -> None:
    rng = np.random.default_rng(5)
    few = rng.uniform(size=(20, 2))
    x = np.repeat(few, 15, axis=0) + 1e-9 * rng.normal(size=(300, 2))
    y = np.sin(3 * x[:, :1]) + x[:, 1:]
    found = RbfForce(target=0.0, nodes=(96,)).fit(x, y)
    assert np.abs(found.weights_).max() < 1e3
    assert np.abs(found.predict(x) - y).max() < 0.05
    one = RbfForce(nodes=(1,)).fit(x, y)
    same = RbfForce().fit(np.ones((12, 2)), y[:12])
    for network in (one, same):
        assert network.width_ > 0
        assert np.isfinite(network.predict(x)).all()


def test_the_width_is_that_of_equation_7() -> None:
    x = np.random.default_rng(6).uniform(size=(200, 3))
    found = RbfForce(nodes=(16,)).fit(x, x[:, :1])
    apart = np.linalg.norm(found.centres_[:, None] - found.centres_, axis=2).max()
    assert found.width_ == pytest.approx(apart / np.sqrt(2 * len(found.centres_)))


def fields(rows: int, seed: int = 0) -> np.ndarray:
    return 1e-2 * np.random.default_rng(seed).normal(size=(rows, 8))


def test_case_1_features_are_91_of_rank_61_beside_the_constant() -> None:
    raw = products(gradient_field(fields(600)) / 1e-2)
    assert raw.shape[1] == 91
    assert np.linalg.matrix_rank(raw[:, 1:] - raw[:, 1:].mean(axis=0), tol=1e-6) == 61


def test_case_1_a_standardised_constant_and_single_precision_spoil_plain_weights() -> None:
    x = fields(600)
    y = 100 * (x[:, :1] - x[:, 2:3])
    raw = products(gradient_field(x) / 1e-2)
    spread = raw.std(axis=0)
    terms = (raw - raw.mean(axis=0)) / np.where(spread > 0, spread, 1.0)
    assert not terms[:, 0].any()  # the constant: a column of zeros
    with pytest.raises(np.linalg.LinAlgError):
        np.linalg.solve(terms.T @ terms, terms.T @ y)
    coarse, told = terms[:, 1:].astype(np.float32), y.astype(np.float32)
    weights = np.linalg.solve(coarse.T @ coarse, coarse.T @ told)
    plain = np.abs(terms[:, 1:] @ weights - y).max()
    ours = np.abs(PolynomialForce().fit(x, y).predict(x) - y).max()
    assert ours < 1e-9
    assert np.abs(PolynomialForce().fit(x, y).weights_).max() < 10
    assert plain > 1e4 * ours


def test_chain_answers_silence_without_nan() -> None:
    x = fields(400)
    chain = PolynomialForce().fit(x, 100 * (x[:, :1] - x[:, 2:3]))
    assert np.isfinite(chain.predict(np.zeros((2, 8)))).all()


def test_alpha_of_the_chain_is_found_and_a_common_beta_changes_nothing() -> None:
    """Hard case 17: a beta that is equal for all pixels is removed with their mean."""
    rng = np.random.default_rng(1)
    field, heat = rng.normal(size=(400, 8)), rng.uniform(-1, 1, (400, 1))
    target = field[:, :1] - field[:, 2:3] + (field[:, 1:2] - field[:, 3:4]) ** 2
    read = field / (1 + 0.1 * heat)
    beta = 0.3 * heat * np.ones(8)
    chains = [ThermalPolynomial().fit(np.hstack([x, heat]), target) for x in (read, read + beta)]
    assert chains[0].alpha_ == pytest.approx(0.1, abs=5e-3)
    said = [
        c.predict(np.hstack([x, heat])) for c, x in zip(chains, (read, read + beta), strict=True)
    ]
    assert np.abs(said[0] - target).max() < 0.05 * target.std()
