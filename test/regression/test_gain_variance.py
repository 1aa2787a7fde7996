# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Spread of the gain of unseen runs."""

from __future__ import annotations

import numpy as np
import pytest

from tactile_ros.errors import NotCalibratedError
from tactile_ros.sensors.regression import GainVariance
from tactile_ros.types import Array, Integers


def unseen_runs(count: int, sigma: float, seed: int) -> tuple[Array, Array, Integers]:
    """Predictions (s, 3) of each run by fits on all others, with their mean gain; forces, runs."""
    rng = np.random.default_rng(seed)
    force = np.tile(np.linspace(0.0, 20.0, 50)[:, None] * [0.0, 0.6, 0.8], (count, 1))
    gain = 1 + sigma * rng.normal(size=count)
    others = (gain.sum() - gain) / (count - 1)
    runs = np.repeat(np.arange(count), 50)
    noise = 0.05 * rng.normal(size=force.shape)
    return force * (others / gain)[runs, None] + noise, force, runs


def test_the_spread_of_many_runs_is_found() -> None:
    spread = GainVariance().fit(*unseen_runs(300, sigma=0.04, seed=0))
    assert spread.spread_ == pytest.approx(0.04, rel=0.1)


def test_one_run_leaves_the_prior() -> None:
    predicted, force, runs = unseen_runs(2, sigma=0.3, seed=1)
    spread = GainVariance(prior=0.05).fit(predicted[runs == 0], force[runs == 0], runs[runs == 0])
    assert spread.spread_ == pytest.approx(0.05 * np.sqrt(2))


def test_few_runs_move_the_prior_part_of_the_way() -> None:
    _, force, runs = unseen_runs(2, sigma=0.0, seed=2)
    spread = GainVariance(prior=0.06).fit(force, force, runs)
    assert spread.spread_ == pytest.approx(0.06 * np.sqrt(1 / 3 * 3 / 2))


def test_covariance_of_unseen_runs_covers() -> None:
    predicted, force, runs = unseen_runs(300, sigma=0.03, seed=3)
    spread = GainVariance().fit(predicted, force, runs)
    fresh, truth, _ = unseen_runs(400, sigma=0.03, seed=4)
    sigma = np.sqrt(spread.covariance(fresh, None)[:, 2, 2] + 0.05**2)
    inside = float((np.abs(fresh - truth)[:, 2] <= sigma).mean())
    assert inside == pytest.approx(0.6827, abs=0.05)


def test_a_share_of_the_variance_is_a_share_of_the_covariance() -> None:
    predicted, force, runs = unseen_runs(3, sigma=0.03, seed=5)
    spread = GainVariance().fit(predicted, force, runs)
    share = np.linspace(0.0, 1.0, len(predicted))
    whole, part = spread.covariance(predicted, None), spread.covariance(predicted, share)
    np.testing.assert_allclose(part, share[:, None, None] * whole)


def test_untouched_runs_say_nothing() -> None:
    zeros, runs = np.zeros((6, 1)), np.repeat(np.arange(2), 3)
    assert np.isfinite(GainVariance().fit(zeros, zeros, runs).spread_)


def test_covariance_before_fit_raises() -> None:
    with pytest.raises(NotCalibratedError, match='must be fitted'):
        GainVariance().covariance(np.zeros((1, 1)), None)
