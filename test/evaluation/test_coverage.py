"""Coverage of covariances that are honest, that boast, and that are few."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats

from tactile_ros.evaluation.metrics import ONE_SIGMA, coverage, coverage_by_thirds


def test_coverage_of_true_covariances_is_accepted_and_of_boasting_ones_is_not() -> None:
    rng = np.random.default_rng(2)
    error, groups = rng.normal(0, 2, 4000), np.repeat(np.arange(400), 10)
    honest = coverage(error, np.full(4000, 4.0), groups)
    assert honest.share == pytest.approx(ONE_SIGMA, abs=0.03)
    assert honest.honest
    assert (honest.count, honest.groups) == (4000, 400)
    assert not coverage(error, np.full(4000, 1.0), groups).honest
    assert not coverage(error, np.full(4000, 16.0), groups).honest


def test_few_groups_widen_what_is_accepted_to_the_binomial_interval() -> None:
    found = coverage(np.zeros(30), np.ones(30), np.repeat(np.arange(10), 3))
    # by hand: the smallest counts whose cumulated probability reaches 2.5 % and 97.5 %
    chances = [math.comb(10, k) * ONE_SIGMA**k * (1 - ONE_SIGMA) ** (10 - k) for k in range(11)]
    low = next(k for k in range(11) if sum(chances[: k + 1]) >= 0.025)
    high = next(k for k in range(11) if sum(chances[: k + 1]) >= 0.975)
    assert (found.low, found.high) == (low / 10, high / 10)
    many = coverage(np.zeros(10_000), np.ones(10_000), np.arange(10_000))
    assert (many.low, many.high) == (ONE_SIGMA - 0.05, ONE_SIGMA + 0.05)


def test_coverage_leaves_out_what_has_no_covariance() -> None:
    error = np.array([0.5, 5.0, 0.5, np.nan])
    variance = np.array([1.0, 1.0, np.nan, 1.0])
    assert coverage(error, variance, np.arange(4)).share == 0.5
    assert math.isnan(coverage(error, np.full(4, np.nan), np.arange(4)).share)


def test_a_spread_that_is_wrong_in_opposite_ways_is_seen_in_its_thirds() -> None:
    rng, groups = np.random.default_rng(1), np.arange(6000)
    true = np.repeat([1.0, 2.0, 3.0], 2000)
    error = true * rng.normal(size=6000)
    honest = coverage_by_thirds(error, true**2, groups)
    assert len(honest) == 8
    assert all(one.honest for one in honest.values())
    steep = coverage_by_thirds(error, (0.5 * true**2) ** 2, groups)
    assert not steep['least third', 1].honest
    assert not steep['largest third', 1].honest
    assert steep['least third', 1].share < 0.5
    assert steep['largest third', 1].share > 0.8
    assert steep['middle third', 1].honest


@pytest.mark.parametrize('groups', [3, 20, 200])
def test_the_interval_holds_what_it_says(groups: int) -> None:
    """Independent groups of one error each: 95 in 100 honest draws are accepted, or more."""
    rng = np.random.default_rng(groups)
    accepted = [
        coverage(rng.normal(size=groups), np.ones(groups), np.arange(groups)).honest
        for _ in range(300)
    ]
    assert np.mean(accepted) >= stats.binom.ppf(1e-4, 300, 0.95) / 300
