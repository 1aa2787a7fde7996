# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""What temperature changes: typical values, limits, and what lags behind."""

from __future__ import annotations

import numpy as np
import pytest

from tactile_ros.physics.temperature import (
    following,
    hall_sensitivity,
    remanence_at,
)

CURVE = np.array([1.0, -0.005, 2e-5])


def test_the_hall_polynomial_is_that_of_the_paper_between_0_and_50() -> None:
    warm = np.array([0.0, 20.0, 35.0, 50.0])
    wanted = np.polynomial.polynomial.polyval(warm - 35.0, CURVE)
    np.testing.assert_allclose(hall_sensitivity(warm, CURVE), wanted)


def test_case_15_outside_of_0_to_50_a_parabola_is_not_followed() -> None:
    outside = np.array([150.0, 125.0, -40.0])
    found = hall_sensitivity(outside, CURVE)
    np.testing.assert_array_equal(found, hall_sensitivity(np.array([50.0, 50.0, 0.0]), CURVE))


def test_what_is_unknown_changes_nothing_and_nonsense_is_refused() -> None:
    assert hall_sensitivity(np.array([np.nan]), CURVE)[0] == 1
    assert hall_sensitivity(np.array([50.0]), np.array([0.0, 0.0, 0.0]))[0] == 1


def test_magnets_weaken() -> None:
    change = np.diff(remanence_at(np.array([20.0, 30.0]), 1.4))
    assert change == pytest.approx(-1.4 * 0.012)


def test_a_magnet_follows_the_chip_exactly_over_any_gap() -> None:
    chip = np.array([20.0, 40.0, 40.0, 40.0])
    fine = following(np.full(3001, 40.0) - 20.0 * (np.arange(3001) == 0), np.full(3001, 0.1), 60.0)
    coarse = following(chip, np.array([0.0, 100.0, 50.0, 150.0]), 60.0)
    np.testing.assert_allclose(coarse[1:], fine[[1000, 1500, 3000]])
    assert coarse[-1] == pytest.approx(40.0 - 20.0 * np.exp(-5.0))
    with pytest.raises(ValueError, match='must not be negative'):
        following(chip, np.array([0.0, 1.0, -1.0, 1.0]), 60.0)
