"""Contact of tubes: profiles and their slopes against sums and differences."""

from __future__ import annotations

import numpy as np
import pytest

from tactile_ros.physics.coverage import (
    HALF_SPACE,
    PROFILES,
    SPRINGS,
    STRIP,
    contact_profile,
    nearest_axis,
)

RADIUS, WIDTH, BLUR = 10e-3, 4e-3, 0.4e-3


def sharp(z: np.ndarray, profile: int) -> np.ndarray:
    inside = np.abs(z) < WIDTH
    if profile == STRIP:
        return inside * 1.0
    if profile == HALF_SPACE:
        return np.sqrt(np.maximum(1 - (z / WIDTH) ** 2, 0))
    chord = np.sqrt(RADIUS**2 - WIDTH**2)
    return inside * (np.sqrt(np.maximum(RADIUS**2 - z**2, 0)) - chord) / (RADIUS - chord)


@pytest.mark.parametrize('profile', range(len(PROFILES)))
def test_the_mean_across_a_blur_is_that_of_many_points(profile: int) -> None:
    z = np.linspace(0, 6e-3, 25)
    off = BLUR * (np.linspace(-1, 1, 4001)[1:] - 1 / 4000)
    mean = sharp(z[:, None] + off, profile).mean(axis=1)
    value = contact_profile(z, np.array(WIDTH), BLUR, profile, RADIUS)[0]
    np.testing.assert_allclose(value, mean, atol=1e-3)


@pytest.mark.parametrize('profile', range(len(PROFILES)))
def test_slopes_are_differences(profile: int) -> None:
    z, w, step = np.linspace(0.1e-3, 5.3e-3, 17), np.full(17, WIDTH), 1e-8
    _, by_z, by_w = contact_profile(z, w, BLUR, profile, RADIUS)
    values = [
        contact_profile(z + a * step, w + b * step, BLUR, profile, RADIUS)[0]
        for a, b in ((1, 0), (-1, 0), (0, 1), (0, -1))
    ]
    np.testing.assert_allclose(by_z, (values[0] - values[1]) / (2 * step), atol=1.0)
    np.testing.assert_allclose(by_w, (values[2] - values[3]) / (2 * step), atol=1.0)


def test_springs_and_a_shallow_circle_are_a_parabola() -> None:
    z = np.linspace(0, 1e-3, 9)
    value = contact_profile(z, np.array(1e-3), 1e-7, SPRINGS, 100e-3)[0]
    np.testing.assert_allclose(value, 1 - (z / 1e-3) ** 2, atol=2e-4)


def test_the_nearer_of_two_axes_counts_and_behind_them_the_origin() -> None:
    u, v = np.array([3.0, 0.2, -1.0]), np.array([0.5, 3.0, -1.0])
    distance, across_u, across_v = nearest_axis(u, v, np.pi / 2)
    np.testing.assert_allclose(distance, [0.5, 0.2, np.sqrt(2)])
    np.testing.assert_allclose(np.hypot(across_u, across_v), 1.0)
    np.testing.assert_allclose(across_u[1], 1.0)
