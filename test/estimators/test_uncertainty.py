"""Stated covariances hold on groups that they were not calibrated on."""

from __future__ import annotations

import numpy as np
import pytest

from tactile_ros.errors import NotCalibratedError
from tactile_ros.estimators.covariance import CalibratedCovariance, SigmaCalibration


def noisy(rows: int, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Residuals whose spread follows exp(-driver), heavy-tailed and correlated."""
    rng = np.random.default_rng(seed)
    drivers = rng.uniform(-1, 2, (rows, 2))
    mix = np.linalg.cholesky([[1.0, 0.6], [0.6, 1.0]])
    noise = rng.standard_t(5, (rows, 2)) @ mix.T
    return drivers, 1e-3 * np.exp(-drivers[:, :1]) * noise, np.arange(rows) // 5


def inside(residuals: np.ndarray, sigma: np.ndarray) -> np.ndarray:
    return (np.abs(residuals) < sigma).mean(axis=0)


@pytest.mark.parametrize('seed', [0, 1, 2])
def test_68_percent_lie_inside_one_sigma_at_every_level(seed: int) -> None:
    model = CalibratedCovariance().fit(*noisy(6000, seed))
    drivers, residuals, _ = noisy(4000, seed + 10)
    sigma = model.sigma(drivers)
    np.testing.assert_allclose(inside(residuals, sigma), 0.6827, atol=0.04)
    for k in range(2):
        thirds = np.array_split(np.argsort(sigma[:, k]), 3)
        shares = [inside(residuals[rows], sigma[rows])[k] for rows in thirds]
        np.testing.assert_allclose(shares, 0.6827, atol=0.05)
    assert np.percentile(sigma, 95) > 4 * np.percentile(sigma, 5)


def test_what_a_model_states_is_scaled_at_every_level_of_the_sigma() -> None:
    drawn = [np.random.default_rng(seed) for seed in (5, 6)]
    # what is stated is right but for an error that it does not know of
    stated = [np.exp(rng.normal(size=(3000, 2))) for rng in drawn]
    error = [
        np.hypot(s, 1.0) * rng.normal(size=s.shape) for s, rng in zip(stated, drawn, strict=True)
    ]
    drivers = [rng.uniform(size=(3000, 1)) for rng in drawn]
    model = CalibratedCovariance((5.0, 320.0)).fit(drivers[0], error[0], stated=stated[0])
    sigma = model.sigma(drivers[1], stated[1])
    for k in range(2):
        thirds = np.array_split(np.argsort(sigma[:, k]), 3)
        shares = [inside(error[1][rows], sigma[rows])[k] for rows in thirds]
        np.testing.assert_allclose(shares, 0.6827, atol=0.05)


def test_the_penalty_is_what_held_out_groups_prefer() -> None:
    drivers, residuals, groups = noisy(200, 0)
    few, strong = (CalibratedCovariance(strength).fit(drivers, residuals, groups)
                   for strength in (1.0, 1e6))  # fmt: skip
    chosen = CalibratedCovariance((1.0, 1e6)).fit(drivers, residuals, groups)
    np.testing.assert_array_equal(chosen.weights_, few.weights_)  # the spread does follow
    alike = CalibratedCovariance((1.0, 1e6)).fit(drivers, residuals * np.exp(drivers[:, :1]))
    assert np.abs(alike.weights_[1:]).max() < 1e-3 < np.abs(few.weights_[1:]).max()
    assert np.abs(strong.weights_[1:]).max() < 1e-3


def test_covariances_are_definite_and_correlated() -> None:
    model = CalibratedCovariance().fit(*noisy(2000, 0))
    cov = model.predict(noisy(50, 9)[0])
    assert (np.linalg.eigvalsh(cov) > 0).all()
    sigma = np.sqrt(np.einsum('sii->si', cov))
    rho = cov[:, 0, 1] / sigma.prod(axis=1)
    np.testing.assert_allclose(rho, 0.6, atol=0.06)


def test_drivers_beyond_what_was_seen_count_as_the_nearest_seen() -> None:
    model = CalibratedCovariance().fit(*noisy(1000, 0))
    far = model.sigma(np.array([[50.0, 50.0], [-50.0, -50.0]]))
    near = model.sigma(np.array([[2.0, 2.0], [-1.0, -1.0]]))
    np.testing.assert_allclose(far, near, rtol=0.05)


@pytest.mark.parametrize('offset', [1e3, 1e7])
def test_drivers_that_vary_little_about_a_large_mean_tell_as_much(offset: float) -> None:
    drivers, residuals, groups = noisy(1000, 0)
    plain = CalibratedCovariance().fit(drivers, residuals, groups).sigma(drivers)
    far = CalibratedCovariance().fit(drivers + offset, residuals, groups)
    np.testing.assert_allclose(far.sigma(drivers + offset), plain, rtol=1e-5)


def test_a_driver_that_is_not_known_leaves_its_row_unknown_alone() -> None:
    model = CalibratedCovariance().fit(*noisy(1000, 0))
    drivers = np.array([[0.5, 0.5], [np.nan, 0.5], [np.inf, 0.5]])
    sigma = model.sigma(drivers)
    assert np.isnan(sigma).all(axis=1).tolist() == [False, True, False]
    np.testing.assert_allclose(sigma[2], model.sigma(np.array([[1e9, 0.5]]))[0])
    assert model.sigma(np.zeros((0, 2))).shape == (0, 2)


@pytest.mark.parametrize('rows', [1, 3, 20, 70])
def test_few_rows_give_one_definite_covariance(rows: int) -> None:
    drivers, residuals, groups = noisy(rows, 0)
    cov = CalibratedCovariance().fit(drivers, residuals, groups).predict(drivers)
    assert np.isfinite(cov).all()
    assert (np.linalg.eigvalsh(cov) > 0).all()


def test_perfect_predictions_and_nan_rows() -> None:
    drivers, residuals, groups = noisy(200, 0)
    model = CalibratedCovariance().fit(drivers, 0 * residuals, groups)
    assert (model.sigma(drivers) < 1e-100).all()
    residuals[3] = np.nan
    model = CalibratedCovariance().fit(drivers, residuals, groups)
    drivers[5] = np.nan
    cov = model.predict(drivers)
    assert np.isnan(cov[5]).all()
    assert np.isfinite(np.delete(cov, 5, axis=0)).all()


def test_order_does_not_matter_and_a_fit_comes_first() -> None:
    drivers, residuals, groups = noisy(300, 0)
    order = np.random.default_rng(0).permutation(300)
    a = CalibratedCovariance().fit(drivers, residuals, groups).predict(drivers)
    b = CalibratedCovariance().fit(drivers[order], residuals[order], groups[order])
    np.testing.assert_allclose(b.predict(drivers), a, rtol=1e-9)
    with pytest.raises(NotCalibratedError):
        CalibratedCovariance().predict(drivers)


def test_one_group_that_is_far_off_makes_no_other_unsure() -> None:
    drivers, residuals, _ = noisy(2000, 3)
    groups = np.arange(2000) // 20
    spoilt = residuals.copy()
    spoilt[groups == 7] *= 1e7
    one, other = (CalibratedCovariance().fit(drivers, each, groups).sigma(drivers)
                  for each in (residuals, spoilt))  # fmt: skip
    assert np.median(other / one) < 1.5


@pytest.mark.parametrize('tails', [np.inf, 3.0])
def test_a_stated_spread_holds_both_shares_as_well_as_tails_allow(tails: float) -> None:
    rng, stated = np.random.default_rng(1), np.full((4000, 2), 0.1)
    error = rng.normal(size=(4000, 2)) if np.isinf(tails) else rng.standard_t(tails, (4000, 2))
    sigma = SigmaCalibration().fit(stated[:2000], error[:2000])(stated[2000:])
    inside = [(np.abs(error[2000:]) < k * sigma).mean() for k in (1, 2)]
    assert inside[0] == pytest.approx(0.683, abs=0.04)
    assert inside[1] == pytest.approx(0.954, abs=0.02 if np.isinf(tails) else 0.045)
    plain = np.quantile(np.abs(error[:2000]), 0.6827)
    assert np.isinf(tails) or sigma.mean() > plain
