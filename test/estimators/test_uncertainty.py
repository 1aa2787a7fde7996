"""Stated covariances hold on groups that they were not calibrated on."""

from __future__ import annotations

import numpy as np
import pytest

from tactile_ros.errors import NotCalibratedError
from tactile_ros.estimators.uncertainty import CalibratedCovariance


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
