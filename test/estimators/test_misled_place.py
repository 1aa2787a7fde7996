"""Errors of places that force tells."""

from __future__ import annotations

import numpy as np

from tactile_ros.estimators.polynomial_ridge import errors_in_variables


def test_sizes_of_errors_and_the_rise_are_found_beside_any_polynomial() -> None:
    rng = np.random.default_rng(0)
    place, heat = rng.uniform(-1, 1, (400, 3)), rng.uniform(-1, 1, 400)
    height = place[:, 2] - 0.03 * heat
    force = np.stack([place[:, 0] * (1 + height**2), 2 - height + height**3], axis=1)
    force = force * np.exp(-0.08 * heat)[:, None] + 1e-4 * rng.normal(size=(400, 2))
    moves = np.zeros((400, 3, 3))
    moves[:, 0, 0], moves[:, 1, 2] = 0.01 * heat, 0.01 * heat**2
    # the last one is a wrong temperature, which moves no place here
    later = 0.05 * np.sin(7 * heat)
    sizes = np.array([1.0, -0.5, 0.8])
    seen = place + np.einsum('spi,p->si', moves, sizes)
    found = errors_in_variables(seen, moves, heat + 0.8 * later, later, force, np.zeros(3))
    error = found.sizes - sizes
    assert np.abs(error).max() < 0.15
    assert error @ np.linalg.solve(found.cov, error) < 15
    assert abs(found.rise - 0.03) < 2e-3
    mended = seen - np.einsum('spi,p->si', moves, sizes)
    again = errors_in_variables(mended, moves, heat, later, force, sizes)
    np.testing.assert_allclose(again.sizes, found.sizes, atol=0.05)
