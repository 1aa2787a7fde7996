# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Bayesian linear regression by evidence, against direct formulas and refits."""

import numpy as np

from tactile_ros.estimators.evidence_regression import HyperPrior, Moments, leave_groups_out

RNG = np.random.default_rng(0)
TERMS, SPREAD = RNG.normal(size=(60, 5)), np.array([2.0, 1.0, 0.5, 0.2, 3.0])
TARGET = TERMS @ np.array([1.0, -0.5, 0.2, 0.0, 2.0]) + 0.1 * RNG.normal(size=60)


def test_solve_is_the_posterior() -> None:
    weights, root, noise = Moments.of(TERMS, TARGET[:, None]).solve(SPREAD)
    precision = TERMS.T @ TERMS + np.diag(SPREAD**-2)
    np.testing.assert_allclose(weights[:, 0], np.linalg.solve(precision, TERMS.T @ TARGET))
    np.testing.assert_allclose(root.T @ root, np.linalg.inv(precision), atol=1e-12)
    assert 0.05 < noise < 0.2


def test_evidence_is_that_of_the_marginal_distribution() -> None:
    moments, levels = Moments.of(TERMS, TARGET[:, None]), []
    for spread in (SPREAD, 0.3 * SPREAD):
        shape = np.eye(60) + (TERMS * spread**2) @ TERMS.T
        square = TARGET @ np.linalg.solve(shape, TARGET) / 60
        levels.append(-0.5 * (60 * np.log(square) + np.linalg.slogdet(shape)[1]))
    found = [moments.evidence(spread)[0] for spread in (SPREAD, 0.3 * SPREAD)]
    np.testing.assert_allclose(np.diff(found), np.diff(levels), atol=1e-8)


def test_slope_is_the_derivative() -> None:
    moments = Moments.of(TERMS, TARGET[:, None])
    for least in (0.0, 0.5):
        slope = moments.evidence(SPREAD, least)[1]
        for i in range(5):
            step = np.exp(1e-5 * np.eye(5)[i])
            high, low = (
                moments.evidence(SPREAD * step, least)[0],
                moments.evidence(SPREAD / step, least)[0],
            )
            np.testing.assert_allclose(slope[i], (high - low) / 2e-5, rtol=1e-4, atol=1e-6)


def test_maximise_finds_the_size_of_the_weights() -> None:
    terms = RNG.normal(size=(400, 40))
    y = terms @ (0.5 * RNG.normal(size=40)) + 0.1 * RNG.normal(size=400)
    hyper = HyperPrior(np.zeros(1), np.full(1, 3.0))
    one = np.ones((1, 40))
    found = hyper.maximise(Moments.of(terms, y[:, None]), lambda theta: (theta * one[0], one))
    assert 3.0 < np.exp(found[0]) < 8.0  # over the noise


def test_leave_groups_out_is_a_refit_for_small_and_large_groups() -> None:
    weights, root, _ = Moments.of(TERMS, TARGET[:, None]).solve(SPREAD)
    groups = np.repeat([0, 1, 2], [3, 7, 50])
    error, variance = leave_groups_out(TERMS @ root.T, TARGET - TERMS @ weights[:, 0], groups)
    for group in range(3):
        rows = groups == group
        other, alone, _ = Moments.of(TERMS[~rows], TARGET[~rows, None]).solve(SPREAD)
        off = TARGET[rows] - TERMS[rows] @ other[:, 0]
        np.testing.assert_allclose(error[rows], off, atol=1e-6)
        half = TERMS[rows] @ alone.T
        np.testing.assert_allclose(variance[rows], (half**2).sum(axis=1), rtol=1e-5)
