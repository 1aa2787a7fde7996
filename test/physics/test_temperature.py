# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Effects of temperature: typical values, limits, and lag."""

import numpy as np
import pytest

from tactile_ros.physics.temperature import following, hall_sensitivity, remanence_at

CURVE = np.array([1.0, -0.005, 2e-5])


def test_hall_sensitivity_is_the_polynomial_of_the_paper_and_stands_still_beyond() -> None:
    """Hard case 15: outside of 0 to 50 degrees the parabola is not followed."""
    warm = np.array([0.0, 20.0, 35.0, 50.0, 150.0, -40.0])
    wanted = np.polynomial.polynomial.polyval(np.clip(warm, 0.0, 50.0) - 35.0, CURVE)
    np.testing.assert_allclose(hall_sensitivity(warm, CURVE), wanted)
    assert hall_sensitivity(np.array([np.nan]), CURVE)[0] == 1
    assert hall_sensitivity(np.array([50.0]), np.zeros(3))[0] == 1


def test_magnets_weaken() -> None:
    change = np.diff(remanence_at(np.array([20.0, 30.0]), 1.4))
    assert change == pytest.approx(-1.4 * 0.012)


def test_following_is_exact_over_any_gap() -> None:
    chip = np.array([20.0, 40.0, 40.0, 40.0])
    fine = following(np.full(3001, 40.0) - 20.0 * (np.arange(3001) == 0), np.full(3001, 0.1), 60.0)
    coarse = following(chip, np.array([0.0, 100.0, 50.0, 150.0]), 60.0)
    np.testing.assert_allclose(coarse[1:], fine[[1000, 1500, 3000]])
    with pytest.raises(ValueError, match='must not be negative'):
        following(chip, np.array([0.0, 1.0, -1.0, 1.0]), 60.0)
