# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Friction, margin, load and slip of one finger."""

import numpy as np
import pytest

from tactile_ros.control.config import GripConfig
from tactile_ros.control.slip_margin import FLOOR, SlipMargin

CONFIG = GripConfig(friction_low=0.3)
NOISE = CONFIG.force_noise


def loaded() -> SlipMargin:
    """A finger at 2 N whose load has grown slowly to 0.8 N, without a slip."""
    rng, slip = np.random.default_rng(0), SlipMargin(CONFIG)
    for ft in np.linspace(0.0, 0.8, 100):
        slip.step(2.0 + NOISE * rng.normal(), ft + NOISE * rng.normal(), -1, NOISE, 0.01)
        assert not slip.slipping
    return slip


def slipped(friction_low: float, normal: float, load: float, steps: int) -> SlipMargin:
    """A finger that its sensor says is slipping."""
    slip = SlipMargin(GripConfig(friction_low=friction_low))
    for _ in range(steps):
        slip.step(normal, load, 1, NOISE, 0.01)
    return slip


def test_slip_margin_has_no_friction_until_something_slips() -> None:
    slip = loaded()
    assert np.isnan(slip.friction)
    assert slip.design_friction == pytest.approx(0.4, abs=0.03)  # it has held so much
    assert slip.margin == pytest.approx(0.0, abs=0.05)


def test_slip_margin_has_no_friction_below_ten_sigma() -> None:
    slip = slipped(0.3, 9 * NOISE, 8 * NOISE, 5)
    assert slip.slipping
    assert np.isnan([slip.friction, slip.margin]).all()


def test_slip_margin_learns_by_no_single_step_halves_at_most_and_has_a_floor() -> None:
    assert np.isnan(slipped(1.0, 2.0, 0.26, 1).friction)
    assert slipped(1.0, 2.0, 0.26, 4).friction == pytest.approx(0.5)
    slip = slipped(0.15, 8.0, 0.3, 4)
    assert slip.friction == FLOOR
    assert slip.design_friction == pytest.approx(FLOOR, rel=0.01)
    for _ in range(6000):  # nothing slips any more
        slip.step(8.0, 0.3, 0, NOISE, 0.01)
    assert slip.design_friction == pytest.approx(0.15, rel=0.01)


def test_slip_margin_needs_a_force_that_leaves_the_margin() -> None:
    slip = slipped(0.3, 2.0, 1.0, 3)
    slip.step(slip.needed(0.3), 1.0, 0, NOISE, 0.01)
    assert slip.margin == pytest.approx(0.3, abs=0.001)


def test_slip_margin_load_behind_a_filter_has_no_noise_of_its_own() -> None:
    rng, slip, loads = np.random.default_rng(2), SlipMargin(CONFIG), []
    for _ in range(400):
        across = np.hypot(*(0.1 * rng.normal(size=2)))
        slip.step(2.0, across, -1, 0.1, 0.01, 0.1)
        loads.append(slip.load)
    assert max(loads[50:]) < 0.15


@pytest.mark.parametrize(
    ('normal', 'loads', 'said', 'slips'),
    [
        (2.0, [0.6], -1, True),  # the load falls
        (2.0, [0.6], 0, False),  # a sensor that sees no slip counts more
        (1.5, [0.6], -1, False),  # both forces fall
        (2.0, [0.8 + 0.3 * (-1) ** i for i in range(10)], -1, True),  # vibration
    ],
)
def test_slip_margin_finds_slips(
    normal: float, loads: list[float], said: int, slips: bool
) -> None:
    slip = loaded()
    for load in loads:
        slip.step(normal, load, said, NOISE, 0.01)
    assert slip.slipping == slips


def test_slip_margin_raises_no_alarm_by_noise_alone() -> None:
    rng, slip = np.random.default_rng(5), SlipMargin(CONFIG)
    for normal, load in (2.0, 0.8) + NOISE * rng.normal(size=(20_000, 2)):
        slip.step(normal, load, -1, NOISE, 0.01)
        assert not slip.slipping


@pytest.mark.parametrize('bad', [np.nan, np.inf, -np.inf, 1e308])
def test_slip_margin_knows_nothing_by_a_force_that_is_none(bad: float) -> None:
    slip = loaded()
    slip.step(2.0, bad, -1, NOISE, 0.01)
    assert not slip.slipping
    assert np.isnan([slip.margin, slip.load]).all()
    slip.step(2.0, 0.2, -1, NOISE, 0.01)  # nothing to compare with
    assert not slip.slipping
