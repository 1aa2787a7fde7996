"""Soft bodies under loads: incompressible, held by their base, and the same far from any tip."""

from __future__ import annotations

import numpy as np
import pytest

from tactile_ros.physics.elastomer import base_image, disc_press, point_load

SHEAR = 0.2e6
LOAD = np.array([1e-3, -2e-3, 8e-3])
FORCE = np.array([0.4, -0.7, -2.0])


def held(points: np.ndarray) -> np.ndarray:
    return point_load(points, LOAD, FORCE, SHEAR) + base_image(points, LOAD, FORCE, SHEAR)


@pytest.mark.parametrize('law', ['half-space', 'held'])
def test_the_volume_stays(law: str) -> None:
    rng = np.random.default_rng(0)
    points = rng.uniform([-8e-3, -8e-3, 1e-3], [8e-3, 8e-3, 6e-3], (40, 3))
    step = 1e-6

    def moved(at: np.ndarray) -> np.ndarray:
        return held(at) if law == 'held' else point_load(at, LOAD, FORCE, SHEAR)

    slopes = np.stack(
        [(moved(points + e) - moved(points - e)) / (2 * step) for e in step * np.eye(3)], axis=1
    )
    divergence = np.trace(slopes, axis1=1, axis2=2)
    assert np.abs(divergence).max() < 1e-4 * np.abs(slopes).max()


def test_a_bonded_base_does_not_move() -> None:
    base = np.random.default_rng(1).uniform(-0.02, 0.02, (50, 3)) * [1, 1, 0]
    free = point_load(base, LOAD, FORCE, SHEAR)
    assert np.abs(held(base)).max() < 1e-4 * np.abs(free).max()


def test_the_sink_under_a_normal_load_is_that_of_boussinesq() -> None:
    # w = (1 + nu) P / (2 pi E r) (2 (1 - nu) + cos^2), nu = 1/2, E = 3 G
    depth = 5e-3
    down = point_load(np.array([0, 0, -depth]), np.zeros(3), np.array([0, 0, -3.0]), SHEAR)
    assert down[2] == pytest.approx(-1.5 * 3.0 * 2 / (2 * np.pi * 3 * SHEAR * depth), rel=1e-5)
    beside = point_load(np.array([depth, 0, 0]), np.zeros(3), np.array([0, 0, -3.0]), SHEAR)
    assert beside[2] == pytest.approx(-1.5 * 3.0 / (2 * np.pi * 3 * SHEAR * depth), rel=1e-5)


def test_an_even_disc_sinks_by_the_integral_below_its_centre() -> None:
    # on the axis of even pressure over a disc: w = P / (2 pi G a^2) * a^2 / sqrt(a^2 + z^2)
    radius, depth, force = 2e-3, 3e-3, 1.5
    at = np.array([[[0.0, 0.0, -depth]]])
    up, zero = np.array([[0.0, 0.0, 1.0]]), np.zeros((1, 3))
    moved = disc_press(at, zero, up, -force * up, np.array([radius]), SHEAR, np.zeros(1))
    rho = np.linspace(0, radius, 4001)
    sink = (1 / np.hypot(rho, depth) + depth**2 / np.hypot(rho, depth) ** 3) * rho
    mean = 2 / radius**2 * np.sum((sink[1:] + sink[:-1]) / 2 * np.diff(rho))
    assert moved[0, 0, 2] == pytest.approx(-force * mean / (4 * np.pi * SHEAR), rel=2e-3)


def test_far_away_the_tip_does_not_matter() -> None:
    at = np.array([[[0.05, 0.02, -0.03]]])
    up, zero, force = np.array([[0.0, 0.0, 1.0]]), np.zeros((1, 3)), np.array([[0.2, 0.1, -1.0]])
    press = disc_press(at, zero, up, force, np.array([1e-3]), SHEAR, np.zeros(1))
    np.testing.assert_allclose(
        press[0, 0], point_load(at[0, 0], zero[0], force[0], SHEAR), rtol=1e-3
    )
