"""Friction, margin and slip of one finger."""

from __future__ import annotations

import numpy as np
import pytest

from tactile_ros.control.config import GripConfig
from tactile_ros.control.slip_margin import Fingers, SlipMargin, mean_of

TEST_FINGERS_CONFIG = GripConfig(contact_on=0.2, contact_off=0.1)


BOTH = (True, True)


def feel(
    fingers: Fingers,
    *forces: float,
    good: tuple[bool, ...] = BOTH,
    new: tuple[bool, ...] = BOTH,
    across: float = 0.0,
) -> list[int]:
    return fingers.feel(forces, [across] * 2, [-1] * 2, good, new, 0.01)


def test_contact_has_hysteresis() -> None:
    fingers = Fingers(TEST_FINGERS_CONFIG, (0, 1))
    assert feel(fingers, 0.15, 0.3) == [1]
    assert feel(fingers, 0.15, 0.15) == []
    assert fingers.touching == [False, True]
    feel(fingers, 0.15, 0.05)
    assert fingers.touching == [False, False]
    assert feel(fingers, 0.3, 0.3) == [0, 1]


def test_a_finger_without_a_force_keeps_its_answer_and_regulates_nothing() -> None:
    fingers = Fingers(TEST_FINGERS_CONFIG, (0, 1))
    feel(fingers, 0.3, 0.3)
    feel(fingers, 0.3, 0.0, good=(True, False))
    assert fingers.touching == [True, True]
    assert fingers.on == [[0], []]
    assert fingers.feeling == [True, False]


def test_fingers_of_one_drive_touch_together() -> None:
    fingers = Fingers(TEST_FINGERS_CONFIG, (0, 0))
    assert feel(fingers, 0.3, 0.0) == [0]
    assert feel(fingers, 0.3, 0.3) == []
    assert fingers.on == [[0, 1]]


def test_a_force_counts_once_and_its_absence_is_late_after_a_period_and_a_half() -> None:
    fingers = Fingers(TEST_FINGERS_CONFIG, (0, 1))
    feel(fingers, 0.3, 0.3)
    assert fingers.complete
    fingers.spend()
    feel(fingers, 0.3, 0.3, new=(True, False))
    assert (fingers.complete, fingers.late) == (False, False)
    feel(fingers, 0.3, 0.3, new=(True, False))
    assert (fingers.complete, fingers.late) == (False, True)
    feel(fingers, 0.3, 0.3)
    assert (fingers.complete, fingers.late) == (True, False)


def test_a_finger_of_no_use_is_not_waited_for() -> None:
    fingers = Fingers(TEST_FINGERS_CONFIG, (0, 1))
    feel(fingers, 0.3, 0.3)
    for _ in range(5):
        fingers.spend()
        feel(fingers, 0.3, 0.3, good=(True, False), new=(True, False))
        assert (fingers.complete, fingers.late) == (True, False)


def test_an_old_force_moves_neither_contact_nor_slip() -> None:
    fingers = Fingers(TEST_FINGERS_CONFIG, (0, 1))
    feel(fingers, 0.6, 0.6, across=0.3)
    slip = fingers.slips[0]
    margin, load = slip.margin, slip.load
    assert feel(fingers, 0.0, 9.0, new=(False, False), across=0.9) == []
    assert fingers.touching == [True, True]
    assert (slip.margin, slip.load) == (margin, load)
    assert load == 0.3


@pytest.mark.parametrize(('chosen', 'mean'), [([1], 2.0), ([0, 1, 2], 3.0)])
def test_means(chosen: list[int], mean: float) -> None:
    assert mean_of([1.0, 2.0, 6.0], chosen) == mean


CONFIG = GripConfig(friction_low=0.3)
NOISE = CONFIG.force_noise


def loaded(seed: int = 0, top: float = 0.8, steps: int = 100) -> SlipMargin:
    """A finger at 2 N whose load has grown slowly, without a slip."""
    rng, slip = np.random.default_rng(seed), SlipMargin(CONFIG)
    for ft in np.linspace(0.0, top, steps):
        slip.step(2.0 + NOISE * rng.normal(), ft + NOISE * rng.normal(), -1, 0.01)
        assert not slip.slipping
    return slip


def test_friction_is_undefined_until_something_slips() -> None:
    slip = loaded()
    assert np.isnan(slip.friction)
    assert slip.believed == pytest.approx(0.4, abs=0.03)  # it has held so much
    assert slip.margin == pytest.approx(0.0, abs=0.05)


def test_friction_is_undefined_below_ten_sigma() -> None:
    slip = SlipMargin(CONFIG)
    slip.step(9 * NOISE, 8 * NOISE, 1, 0.01)
    assert slip.slipping
    assert np.isnan(slip.friction)
    assert np.isnan(slip.margin)
    slip.step(11 * NOISE, 10.5 * NOISE, 1, 0.01)
    noise = NOISE * np.hypot(1, 10.5 / 11) / (11 * NOISE)
    share = 0.15**2 / (0.15**2 + noise**2)  # what is assumed is known to a half
    assert slip.friction == pytest.approx(0.3 + share * (10.5 / 11 - 0.3))
    assert slip.friction_std == pytest.approx(np.sqrt(share) * noise)


def test_friction_has_a_floor_and_is_believed_less_as_nothing_slips_any_more() -> None:
    slip = SlipMargin(CONFIG)
    slip.step(8.0, 0.3, 1, 0.01)
    assert slip.friction == slip.believed == CONFIG.friction_floor
    for _ in range(6000):
        slip.step(8.0, 0.3, 0, 0.01)
    assert slip.friction == CONFIG.friction_floor
    assert slip.believed == pytest.approx(CONFIG.friction_low, rel=0.01)


def test_a_fall_of_the_load_is_a_slip() -> None:
    slip = loaded()
    slip.step(2.0, 0.6, -1, 0.01)
    assert slip.slipping


def test_a_fall_of_both_forces_is_none() -> None:
    slip = loaded()
    slip.step(1.5, 0.6, -1, 0.01)
    assert not slip.slipping


def test_vibration_is_a_slip() -> None:
    slip = loaded()
    said = []
    for i in range(10):
        slip.step(2.0, 0.8 + 0.3 * (-1) ** i, -1, 0.01)
        said.append(slip.slipping)
    assert said[-1]


def test_a_sensor_that_sees_no_slip_is_believed() -> None:
    slip = loaded()
    slip.step(2.0, 0.6, 0, 0.01)
    assert not slip.slipping


def test_false_alarms_of_noise_alone() -> None:
    rng, slip = np.random.default_rng(5), SlipMargin(CONFIG)
    alarms = 0
    for _ in range(20_000):
        slip.step(2.0 + NOISE * rng.normal(), 0.8 + NOISE * rng.normal(), -1, 0.01)
        alarms += slip.slipping
    assert alarms == 0


def test_what_is_needed_leaves_the_margin() -> None:
    slip = SlipMargin(CONFIG)
    slip.step(2.0, 1.0, 1, 0.01)
    needed = slip.needed(0.3)
    slip.step(needed, 1.0, 0, 0.01)
    assert slip.margin == pytest.approx(0.3)


@pytest.mark.parametrize('bad', [np.nan, np.inf, -np.inf])
def test_unknown_forces_are_no_slip_and_no_number(bad: float) -> None:
    slip = loaded()
    slip.step(2.0, bad, -1, 0.01)
    assert not slip.slipping
    assert np.isnan(slip.margin)
    assert np.isnan(slip.load)
    slip.step(2.0, 0.2, -1, 0.01)  # nothing to compare with
    assert not slip.slipping


def test_forces_beyond_all_measure_teach_a_finite_friction() -> None:
    slip = SlipMargin(CONFIG)
    for said in (0, 0, 1):
        slip.step(1.0, 1e200, said, 0.01)
    assert np.isfinite([slip.friction, slip.friction_std, slip.margin]).all()
