"""Touches that share the blame: ties, outside causes, and readings off the table."""

from __future__ import annotations

import numpy as np
import pytest

from tactile_ros.errors import NotCalibratedError
from tactile_ros.estimators.gaussian_sum_table import TouchTable

COMMON = np.vstack([np.eye(2), np.eye(2)])


def sheet(samples: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Features (s, 4) on a sheet of two parameters (s, 2)."""
    u = np.random.default_rng(seed).uniform(-1, 1, (samples, 2))
    x = np.column_stack([u[:, 0], u[:, 1], u[:, 0] * u[:, 1], u[:, 0] ** 2 - u[:, 1]])
    return x, u


def test_equal_distances_have_equal_weights() -> None:
    table = TouchTable(noise=0.1, neighbours=4).fit(np.array([[1.0], [-1.0], [1.0], [-1.0]]))
    blame = table.blame(np.array([[0.0]]))
    np.testing.assert_allclose(blame.weight, 0.25)
    np.testing.assert_allclose(blame.shares(np.array([0, 1, 0, 1]), 2), [[0.5, 0.5]])
    assert blame.shares(np.full(4, -1), 0).shape == (1, 0)


def test_it_interpolates_and_its_spread_holds_the_error() -> None:
    x, u = sheet(3000, 0)
    fresh, told = sheet(300, 1)
    blame = TouchTable(noise=1e-3).fit(x).blame(fresh)
    mean = blame.mean(u)
    error = np.linalg.norm(mean - told, axis=1)
    assert error.mean() < 0.02
    spread = np.sqrt(np.trace(blame.covariance(u, mean), axis1=1, axis2=2))
    assert (error < 3 * spread).mean() > 0.95


def test_a_common_cause_is_not_taken_for_a_touch() -> None:
    x, u = sheet(4000, 0)
    fresh, told = sheet(300, 1)
    cause = np.random.default_rng(2).normal(size=(300, 2)) @ COMMON.T
    error = [
        np.linalg.norm(table.fit(x).blame(fresh + cause).mean(u) - told, axis=1).mean()
        for table in (TouchTable(1e-3), TouchTable(1e-3, COMMON, 1.0))
    ]
    assert error[1] < 0.25 * error[0]


def test_strange_is_what_lies_off_the_sheet() -> None:
    x, _ = sheet(3000, 0)
    fresh, _ = sheet(200, 1)
    table = TouchTable(1e-3).fit(x)
    known = table.strangeness(fresh, table.blame(fresh))
    off = fresh + np.array([0.0, 0.0, 0.3, 0.0])
    assert np.quantile(known, 0.99) < np.quantile(table.strangeness(off, table.blame(off)), 0.05)


def test_unnamed_rows_vote_for_nobody() -> None:
    table = TouchTable(noise=1.0, neighbours=3).fit(np.zeros((3, 1)))
    shares = table.blame(np.zeros((1, 1))).shares(np.array([-1, 1, -1]), 2)
    np.testing.assert_allclose(shares, [[0.0, 1.0]])


def test_it_must_be_fitted() -> None:
    with pytest.raises(NotCalibratedError):
        TouchTable(1.0).blame(np.zeros((1, 1)))
