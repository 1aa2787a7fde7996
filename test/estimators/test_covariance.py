# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Covariances hold what they state on groups of which nothing was seen."""

import numpy as np
import pytest

from tactile_ros.estimators.covariance import CovarianceModel
from tactile_ros.types import Array, Integers

ONE_SIGMA = 0.6827


def shares(model: CovarianceModel, errors: Array, stated: Array | None, readings: Array) -> Array:
    """Shares (l,) of errors inside one sigma."""
    sigma = np.sqrt(np.einsum('sll->sl', model.predict(stated, readings)[0]))
    return np.asarray((np.abs(errors) < sigma).mean(axis=0))


def world(seed: int, sizes: Integers, common: float = 1.0) -> tuple[Array, Array, Integers]:
    """Errors (s, 2) with a part of their own for each group, readings (s, 3), groups (s,)."""
    rng = np.random.default_rng(seed)
    groups = np.repeat(np.arange(len(sizes)), sizes)
    offset = rng.standard_normal((len(sizes), 2))[groups]
    errors = common * offset + rng.standard_normal((len(groups), 2))
    errors[:, 1] = 3 * (0.8 * errors[:, 0] + 0.6 * errors[:, 1])
    return errors, rng.standard_normal((len(groups), 3)) * [1, 1e-3, 50], groups


@pytest.mark.parametrize('form', ['none', 'sigma', 'covariance'])
def test_covariance_holds_68_percent_of_each_component_on_unseen_groups(form: str) -> None:
    rng = np.random.default_rng(4)

    def given(errors: Array) -> tuple[Array, Array | None]:
        if form == 'none':
            return errors, None
        sigma = np.exp(rng.normal(size=(len(errors), 1))) * [0.2, 5.0]
        full = sigma[:, :, None] * sigma[:, None] * np.array([[1, 0.5], [0.5, 1]])
        return errors * sigma, sigma if form == 'sigma' else full

    errors, readings, groups = world(0, np.full(150, 8))
    errors, stated = given(errors)
    model = CovarianceModel().fit(errors, stated, groups, readings)
    errors, readings, _ = world(1, np.full(400, 8))
    errors, stated = given(errors)
    np.testing.assert_allclose(shares(model, errors, stated, readings), ONE_SIGMA, atol=0.04)
    cov = model.predict(stated, readings)[0]
    assert (np.linalg.eigvalsh(cov / np.einsum('sll->s', cov)[:, None, None]) > 0).all()
    rho = cov[:, 0, 1] / np.sqrt(cov[:, 0, 0] * cov[:, 1, 1])
    truth = np.corrcoef(world(1, np.full(400, 8))[0].T)[0, 1]
    np.testing.assert_allclose(rho, 0.5 if form == 'covariance' else truth, atol=0.1)


def test_covariance_weighs_groups_by_their_independent_rows() -> None:
    covered = []
    for seed in range(10):  # one group holds nine tenths of the rows
        errors, readings, groups = world(seed, np.array([3600] + [10] * 40), common=3.0)
        model = CovarianceModel().fit(errors, None, groups, readings)
        errors, readings, _ = world(seed + 100, np.full(400, 10), common=3.0)
        covered.append(shares(model, errors, None, readings))
    np.testing.assert_allclose(np.mean(covered, axis=0), ONE_SIGMA, atol=0.04)
    assert np.std(covered) < 0.08
    # rows that share nothing count alike: a large group is worth its rows
    errors, readings, groups = world(0, np.array([3600] + [10] * 40), common=0.0)
    alone = CovarianceModel().fit(errors, None, np.arange(4000), readings)
    grouped = CovarianceModel().fit(errors, None, groups, readings)
    np.testing.assert_allclose(grouped.scale_, alone.scale_, rtol=0.05)


@pytest.mark.parametrize('count', [1, 4])
def test_covariance_of_few_groups_is_wide_enough_and_finite(count: int) -> None:
    covered = []
    for seed in range(60):
        errors, readings, groups = world(seed, np.full(count, 20), common=5.0)
        model = CovarianceModel().fit(errors, None, groups, readings)
        errors, readings, _ = world(seed + 1000, np.full(20, 20), common=5.0)
        covered.append(shares(model, errors, None, readings))
    assert 0.62 < np.mean(covered) < 0.80


def test_covariance_grows_with_distance_as_errors_do() -> None:
    def drawn(rows: int, seed: int) -> tuple[Array, Array, Array]:
        rng = np.random.default_rng(seed)
        whitened = rng.standard_normal((rows, 2))
        square = (whitened**2).sum(axis=1)
        errors = rng.standard_normal((rows, 2))
        errors[:, 0] *= np.sqrt(1 + square)
        return whitened @ np.array([[1.0, 0.9], [0.0, 0.1]]), errors, square

    readings, errors, _ = drawn(3000, 0)
    model = CovarianceModel().fit(errors, None, np.arange(3000), readings)
    others, truth, square = drawn(20000, 1)
    for rows in (square < 0.5, square > 5):
        held = shares(model, truth[rows], None, others[rows])
        np.testing.assert_allclose(held, ONE_SIGMA, atol=0.06)
    assert model.growth_[0] > 10 * model.growth_[1] > 0
    line = np.linspace(0, 40, 50)[:, None] * readings[:1]
    cov, out_of_range = model.predict(None, line)
    assert (np.diff(cov[:, 1, 1]) > 0).all()  # also where the training errors did not grow
    assert not out_of_range[0]
    assert out_of_range[-1]


def test_covariance_leaves_out_what_was_not_measured() -> None:
    errors, readings, groups = world(0, np.full(100, 5))
    model = CovarianceModel().fit(errors, None, groups, readings)
    holes = errors.copy()
    holes[::7, 0] = np.nan
    readings[3, 1] = np.nan
    some = CovarianceModel().fit(holes, None, groups, readings)
    np.testing.assert_allclose(some.scale_, model.scale_, rtol=0.1)
    holes[:, 0] = np.nan
    none = CovarianceModel().fit(holes, None, groups, readings)
    assert np.isnan(none.predict(None, readings)[0][:, 0, 0]).all()
    stated = np.ones_like(errors)
    stated[5] = np.nan
    cov, _ = CovarianceModel().fit(holes, stated, groups, readings).predict(stated, readings)
    assert np.isnan(cov[5]).all()
    assert 0.9 < cov[6, 0, 0] < 2.0  # nothing was learned: as stated, and growing
    dead = readings[:1].copy()
    dead[0, 0] = np.nan
    assert np.isfinite(model.predict(None, dead)[0]).all()
    constant = CovarianceModel().fit(errors, None, groups, np.ones_like(readings))
    assert np.isfinite(constant.predict(None, np.ones((1, 3)))[0]).all()
