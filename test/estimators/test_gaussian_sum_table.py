# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Gaussian sum of touches against Bayes on a fine grid, with and without a common cause."""

from dataclasses import replace

import numpy as np

from tactile_ros.estimators.gaussian_sum_table import GaussianSumTable, Linearised, TouchPosterior

NOISE = 0.02


def bent(place: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Readings (n, 3) of places (n, 1), and their slopes (n, 3, 1)."""
    t = place[:, 0]
    readings = np.stack([np.sin(t), np.cos(t), 0.3 * t * t], axis=1)
    return readings, np.stack([np.cos(t), -np.sin(t), 0.6 * t], axis=1)[:, :, None]


def table(count: int = 60) -> Linearised:
    """Evenly spread over -1.5 .. 1.5."""
    place = np.linspace(-1.5, 1.5, count)[:, None]
    reach = 3.0 / count
    readings, slopes = bent(place)
    leads = np.full((count, 1, 1), reach)
    sigma, share = np.full(count, NOISE), np.full(count, 1 / count)
    return Linearised(readings, slopes * reach, place, leads, sigma, share)


def test_posterior_is_bayes_on_a_fine_grid() -> None:
    rng = np.random.default_rng(0)
    true = rng.uniform(-1.2, 1.2, (200, 1))
    x = bent(true)[0] + NOISE * rng.normal(size=(200, 3))
    seen = GaussianSumTable(table(), neighbours=12)(x)
    fine = np.linspace(-1.6, 1.6, 8001)
    away = x[:, None] - bent(fine[:, None])[0]
    likely = np.exp(-0.5 * (away**2).sum(axis=2) / NOISE**2)
    likely /= likely.sum(axis=1, keepdims=True)
    mean = likely @ fine
    spread = np.sqrt((likely * (fine - mean[:, None]) ** 2).sum(axis=1))
    np.testing.assert_allclose(seen.mean[:, 0], mean, atol=0.1 * NOISE)
    np.testing.assert_allclose(np.sqrt(seen.cov[:, 0, 0]), spread, rtol=0.12)
    error = seen.mean[:, 0] - true[:, 0]
    assert 0.6 < (np.abs(error) < np.sqrt(seen.cov[:, 0, 0])).mean() < 0.76


def test_posterior_weighs_a_common_cause() -> None:
    rng = np.random.default_rng(3)
    common, rows = np.array([[1.0], [1.0], [-1.0]]), table(400)
    both = replace(
        rows, answers=np.concatenate([rows.answers, rows.readings], axis=1),
        leads=np.concatenate([rows.leads, rows.slopes], axis=1),
    )  # fmt: skip
    posterior = TouchPosterior(both, common, 0.5, 0.0, NOISE, 8.0)
    true, size = rng.uniform(-1.2, 1.2, (300, 1)), 0.5 * rng.normal(size=(300, 1))
    size[::2] = 0.0
    x = bent(true)[0] + size @ common.T + NOISE * rng.normal(size=(300, 3))
    found = posterior(x, np.array([[-1.0, 0.0, 0.0], [0.5, 0.0, 0.0]])[:, :1])
    assert (found.cause[::2] == 0).mean() > 0.9
    assert np.median(np.abs(found.cause - size)[1::2]) < 2 * NOISE
    error = np.abs(found.mean - true)[:, 0]
    assert (error < 2 * np.sqrt(found.cov[:, 0, 0])).mean() > 0.85
    np.testing.assert_allclose(found.shares.sum(axis=1), 1.0, rtol=1e-12)
    only, left = posterior.cause(size @ common.T)
    np.testing.assert_allclose(only, size, atol=1e-12)
    np.testing.assert_allclose(left, 0.0, atol=1e-12)
    assert not posterior.touching(0.5 * common.T, 5 * NOISE).any()
    assert posterior.touching(bent(np.array([[0.9]]))[0], 5 * NOISE).all()
