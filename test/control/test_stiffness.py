"""Stiffness from force over closure."""

from __future__ import annotations

import numpy as np
import pytest

from tactile_ros.control.config import GripConfig
from tactile_ros.control.stiffness import Stiffness

CONFIG = GripConfig()


@pytest.mark.parametrize('true', [8.0, 60.0, 250.0])
def test_it_is_found_within_its_own_error(true: float) -> None:
    errors = []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        law = Stiffness(CONFIG)
        deep = np.linspace(0.0, 2.0 / true, 60)
        for x in deep:
            noisy = x + CONFIG.closure_noise * rng.normal()
            law.step(0.3 + noisy, true * x + CONFIG.force_noise * rng.normal())
        errors.append((law.value - true) / law.std)
    assert np.sqrt(np.mean(np.square(errors))) < 2.0
    assert np.sqrt(np.mean(np.square(errors))) > 0.3


def test_before_any_point_the_gain_is_for_the_stiffest() -> None:
    assert Stiffness(CONFIG).cautious == CONFIG.stiffness_high


def test_a_hold_neither_forgets_nor_winds_up() -> None:
    law = Stiffness(CONFIG)
    for i in range(100):
        law.step(0.3 + 1e-3 * i, 0.05 * i)
    held = law.value
    for _ in range(1000):
        law.step(0.4 - 1e-3, 4.95)
    assert law.value == held == pytest.approx(50.0, rel=0.02)


def test_a_stiffening_object_is_followed() -> None:
    law = Stiffness(CONFIG)
    for x in np.arange(0.0, 0.1, 5e-4):
        law.step(x, 300.0 * x**2)
    assert law.value == pytest.approx(600 * 0.1, rel=0.2)
