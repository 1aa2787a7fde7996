"""Steps of least squares that are cut short, and what they are worth."""

from __future__ import annotations

import numpy as np

from tactile_ros.estimators.press_search import Descents, _finish, _kept
from tactile_ros.estimators.press_templates import kept_rows

LIMIT = np.array([2e-3, 2e-3, 0.35, 0.4, 2.5, 1e-5, 1e-3])
SCALE = np.array([1e3, 2e3, 5.0, 1e4])


def parabola(seed: int) -> np.ndarray:
    """A matrix of steps whose diagonal is about 1."""
    half = np.random.default_rng(seed).normal(size=(9, 4))
    normal = half.T @ half
    size = np.sqrt(np.diag(normal))
    return normal / np.outer(size, size)


def test_a_step_that_is_cut_short_costs_what_the_parabola_says() -> None:
    normal, step = parabola(1), np.array([5e-3, 1e-4, 0.1, 1e-5])
    whole = step * SCALE
    promised = whole @ normal @ whole
    pose = np.array([[0.0, 1e-3, 0.2, 3e-4]])
    found = Descents(pose.copy(), np.array([70.0]), normal[None], SCALE[None], np.zeros((1, 5, 6)))
    # promises are small where a descent ends: the same parabola in another unit
    unit = 0.25 / promised
    _finish(found, step[None], np.array([0.25]), LIMIT)
    part = (found.pose[0] - pose[0]) * SCALE
    assert part[0] == LIMIT[0] * SCALE[0]
    left = (whole - part) @ normal @ (whole - part)
    np.testing.assert_allclose(70.0 - found.cost[0], unit * (promised - left))


def test_compiled_rows_keep_the_same() -> None:
    rng = np.random.default_rng(2)
    for seed in range(5):
        normal, step, change = parabola(seed), rng.normal(size=4), rng.normal(size=4)
        slow = _kept(normal[None], SCALE[None], step[None], change[None], np.ones(1))[0]
        np.testing.assert_allclose(kept_rows(normal, SCALE, step, change), slow, rtol=1e-12)
