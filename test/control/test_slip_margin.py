# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Friction, margin, load and slip of one finger."""

from __future__ import annotations

import numpy as np
import pytest

from tactile_ros.control.config import GripConfig
from tactile_ros.control.slip_margin import FLOOR, SlipMargin

CONFIG = GripConfig(friction_low=0.3)
NOISE = CONFIG.force_noise


def loaded(seed: int = 0, top: float = 0.8, steps: int = 100) -> SlipMargin:
    """A finger at 2 N whose load has grown slowly, without a slip."""
    rng, slip = np.random.default_rng(seed), SlipMargin(CONFIG)
    for ft in np.linspace(0.0, top, steps):
        slip.step(2.0 + NOISE * rng.normal(), ft + NOISE * rng.normal(), -1, NOISE, 0.01)
        assert not slip.slipping
    return slip


def test_friction_is_undefined_until_something_slips() -> None:
    slip = loaded()
    assert np.isnan(slip.friction)
    assert slip.design_friction == pytest.approx(0.4, abs=0.03)  # it has held so much
    assert slip.margin == pytest.approx(0.0, abs=0.05)


def test_friction_is_undefined_below_ten_sigma() -> None:
    slip = SlipMargin(CONFIG)
    for _ in range(5):
        slip.step(9 * NOISE, 8 * NOISE, 1, NOISE, 0.01)
    assert slip.slipping
    assert np.isnan(slip.friction)
    assert np.isnan(slip.margin)


def test_friction_is_never_taught_by_one_step_and_at_most_halved_by_one_slip() -> None:
    slip = SlipMargin(GripConfig(friction_low=1.0))
    slip.step(2.0, 0.26, 1, NOISE, 0.01)
    assert np.isnan(slip.friction)
    for _ in range(3):
        slip.step(2.0, 0.26, 1, NOISE, 0.01)
    assert slip.friction == pytest.approx(0.5)


def test_friction_has_a_floor_and_is_believed_less_as_nothing_slips_any_more() -> None:
    slip = SlipMargin(GripConfig(friction_low=0.15))
    for _ in range(4):
        slip.step(8.0, 0.3, 1, NOISE, 0.01)
    assert slip.friction == FLOOR
    assert slip.design_friction == pytest.approx(FLOOR, rel=0.01)
    for _ in range(6000):
        slip.step(8.0, 0.3, 0, NOISE, 0.01)
    assert slip.design_friction == pytest.approx(0.15, rel=0.01)


def test_load_behind_a_filter_has_no_noise_of_its_own() -> None:
    rng, slip, loads = np.random.default_rng(2), SlipMargin(CONFIG), []
    for _ in range(400):
        across = np.hypot(*(0.1 * rng.normal(size=2)))
        slip.step(2.0, across, -1, 0.1, 0.01, 0.1)
        loads.append(slip.load)
    assert max(loads[50:]) < 0.15


def test_a_fall_of_the_load_is_a_slip() -> None:
    slip = loaded()
    slip.step(2.0, 0.6, -1, NOISE, 0.01)
    assert slip.slipping


def test_a_fall_of_both_forces_is_none() -> None:
    slip = loaded()
    slip.step(1.5, 0.6, -1, NOISE, 0.01)
    assert not slip.slipping


def test_vibration_is_a_slip() -> None:
    slip = loaded()
    said = []
    for i in range(10):
        slip.step(2.0, 0.8 + 0.3 * (-1) ** i, -1, NOISE, 0.01)
        said.append(slip.slipping)
    assert said[-1]


def test_a_sensor_that_sees_no_slip_is_believed() -> None:
    slip = loaded()
    slip.step(2.0, 0.6, 0, NOISE, 0.01)
    assert not slip.slipping


def test_false_alarms_of_noise_alone() -> None:
    rng, slip = np.random.default_rng(5), SlipMargin(CONFIG)
    alarms = 0
    for _ in range(20_000):
        slip.step(2.0 + NOISE * rng.normal(), 0.8 + NOISE * rng.normal(), -1, NOISE, 0.01)
        alarms += slip.slipping
    assert alarms == 0


def test_what_is_needed_leaves_the_margin() -> None:
    slip = SlipMargin(CONFIG)
    for _ in range(3):
        slip.step(2.0, 1.0, 1, NOISE, 0.01)
    needed = slip.needed(0.3)
    slip.step(needed, 1.0, 0, NOISE, 0.01)
    assert slip.margin == pytest.approx(0.3, abs=0.001)


@pytest.mark.parametrize('bad', [np.nan, np.inf, -np.inf, 1e308])
def test_unknown_forces_are_no_slip_and_no_number(bad: float) -> None:
    slip = loaded()
    slip.step(2.0, bad, -1, NOISE, 0.01)
    assert not slip.slipping
    assert np.isnan(slip.margin)
    assert np.isnan(slip.load)
    slip.step(2.0, 0.2, -1, NOISE, 0.01)  # nothing to compare with
    assert not slip.slipping
