# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""The chain of [3]: its rank, its common field, and where float and zero would spoil it."""

import numpy as np
import pytest

from benchmarks.gradiometer import HuberPolynomial
from tactile_ros.estimators.polynomial_force import (
    PolynomialForce,
    ThermalPolynomial,
    gradient_field,
    products,
)


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


def test_huber_bears_outliers_and_silence_gives_no_nan() -> None:
    x = fields(400)
    clean = 100 * (x[:, :1] - x[:, 2:3])
    spoilt = clean.copy()
    spoilt[::20] += 50.0
    error = [
        np.abs(chain.fit(x, spoilt).predict(x) - clean).mean()
        for chain in (PolynomialForce(), HuberPolynomial())
    ]
    assert error[1] < 0.2 * error[0]
    assert np.isfinite(PolynomialForce().fit(x, clean).predict(np.zeros((2, 8)))).all()


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
