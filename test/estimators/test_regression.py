# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Kernel ridge and perceptrons against their plain definitions."""

import numpy as np
import pytest

from tactile_ros.estimators import regression
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
