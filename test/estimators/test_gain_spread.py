"""The spread of gain between runs: found from unseen runs, carried into the covariance."""

from __future__ import annotations

import numpy as np
import pytest

from tactile_ros.errors import NotCalibratedError
from tactile_ros.estimators.covariance import GainVariance
from tactile_ros.types import Array, Integers


def unseen_runs(count: int, sigma: float, seed: int) -> tuple[Array, Array, Integers]:
    """What fits on all other runs say about each run: its gain against the mean of theirs."""
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
    said, told, runs = unseen_runs(2, sigma=0.3, seed=1)
    spread = GainVariance(prior=0.05).fit(said[runs == 0], told[runs == 0], runs[runs == 0])
    assert spread.spread_ == pytest.approx(0.05 * np.sqrt(2))


def test_few_runs_move_the_prior_part_of_the_way() -> None:
    said, told, runs = unseen_runs(2, sigma=0.0, seed=2)
    spread = GainVariance(prior=0.06, weight=1.0).fit(told, told, runs)
    assert spread.spread_ == pytest.approx(0.06 * np.sqrt(1 / 3 * 3 / 2))
    assert GainVariance(prior=0.06, weight=10.0).fit(said, told, runs).spread_ > spread.spread_


def test_presses_of_a_run_have_gains_of_their_own() -> None:
    told = np.tile(np.array([[1.0], [2.0]]), (4, 1))
    presses, runs = np.repeat(np.arange(4), 2), np.repeat(np.arange(2), 4)
    said = told * np.array([1.1, 0.9, 1.1, 0.9])[presses, None]
    whole = GainVariance(weight=0.0).fit(said, told, runs)
    each = GainVariance(weight=0.0).fit(said, told, runs, presses)
    assert whole.spread_ == pytest.approx(0.0, abs=1e-9)
    assert each.spread_ == pytest.approx(0.1 * np.sqrt(0.5 * 1.5))


def test_covariance_of_unseen_runs_covers() -> None:
    said, told, runs = unseen_runs(300, sigma=0.03, seed=3)
    spread = GainVariance().fit(said, told, runs)
    fresh, truth, _ = unseen_runs(400, sigma=0.03, seed=4)
    sigma = np.sqrt(spread.covariance(fresh)[:, 2, 2] + 0.05**2)
    inside = float((np.abs(fresh - truth)[:, 2] <= sigma).mean())
    assert inside == pytest.approx(0.6827, abs=0.05)


def test_a_share_of_the_variance_is_a_share_of_the_covariance() -> None:
    said, told, runs = unseen_runs(3, sigma=0.03, seed=5)
    spread = GainVariance().fit(said, told, runs)
    share = np.linspace(0.0, 1.0, len(said))
    whole, part = spread.covariance(said), spread.covariance(said, share)
    np.testing.assert_allclose(part, share[:, None, None] * whole)


@pytest.mark.parametrize('shared', [True, False])
def test_a_row_or_a_component_alone_has_the_same_bits(shared: bool) -> None:
    said, told, runs = unseen_runs(3, sigma=0.03, seed=6)
    spread = GainVariance().fit(said, told, runs)
    share = np.linspace(0.0, 1.0, len(said)) if shared else None
    many = spread.covariance(said, share)
    for i in (0, 70, 149):
        row = spread.covariance(said[[i]], None if share is None else share[[i]])
        np.testing.assert_array_equal(row[0], many[i])
    for k in range(3):
        one = spread.covariance(said[:, [k]], share)
        assert one.shape == (len(said), 1, 1)
        np.testing.assert_array_equal(one[:, 0, 0], many[:, k, k])


def test_rows_that_are_not_known_are_left_out() -> None:
    said, told, runs = unseen_runs(5, sigma=0.03, seed=5)
    full = GainVariance().fit(said, told, runs)
    holes = np.concatenate([told, np.full((7, 3), np.nan)])
    again = GainVariance().fit(
        np.concatenate([said, np.ones((7, 3))]), holes, np.concatenate([runs, np.arange(7)])
    )
    assert (again.spread_, again.runs_) == (full.spread_, full.runs_)


def test_untouched_runs_say_nothing() -> None:
    zeros, runs = np.zeros((6, 1)), np.repeat(np.arange(2), 3)
    assert np.isfinite(GainVariance().fit(zeros, zeros, runs).spread_)


def test_covariance_before_fit_raises() -> None:
    with pytest.raises(NotCalibratedError, match='must be fitted'):
        GainVariance().covariance(np.zeros((1, 1)))
