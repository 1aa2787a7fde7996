"""Errors of places over what is stated of them."""

from __future__ import annotations

import numpy as np
import pytest

from tactile_ros.sensors.multipole_skin.recogniser import fitted_spread, scattered

RNG = np.random.default_rng(8)
SIGMA = np.exp(RNG.normal(np.log(1e-4), 0.8, (4000, 2)))  # m
NOTHING = np.zeros_like(SIGMA)


def away(deviation: np.ndarray) -> np.ndarray:
    """Errors (m) of some deviation."""
    return deviation * RNG.normal(size=deviation.shape)


def test_deviations_that_are_half_as_large_are_doubled() -> None:
    found = fitted_spread(away(2 * SIGMA), SIGMA, NOTHING)
    assert found.scale == pytest.approx(2, rel=0.05)
    assert found.floor == 0


def test_what_clear_presses_err_by_is_a_floor() -> None:
    found = fitted_spread(away(np.hypot(SIGMA, 1e-4)), SIGMA, NOTHING)
    assert found.scale == pytest.approx(1, abs=0.1)
    assert found.floor == pytest.approx(1e-4, rel=0.1)


def test_what_the_doubt_of_heads_explains_is_none_of_templates() -> None:
    doubt = np.full_like(SIGMA, 2e-4)
    found = fitted_spread(away(np.hypot(SIGMA, doubt)), SIGMA, doubt)
    assert found.scale == pytest.approx(1, abs=0.15)


def test_few_errors_leave_deviations_about_as_stated() -> None:
    found = fitted_spread(np.full((1, 2), 1e-3), np.full((1, 2), 1e-4), NOTHING[:1])
    assert found.scale < 2


def test_heads_that_are_as_likely_scatter_by_how_far_they_are_apart() -> None:
    places = np.array([[[0.0, 0.0], [2e-3, 0.0]]])
    found = scattered(np.array([[0.5, 0.5]]), places)
    np.testing.assert_allclose(found, [[[2e-6, 0.0], [0.0, 0.0]]])
