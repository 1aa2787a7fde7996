"""Contact of fingers with hysteresis, drive by drive."""

from __future__ import annotations

import pytest

from tactile_ros.control.config import GripConfig
from tactile_ros.control.slip_margin import Fingers, mean_of

CONFIG = GripConfig(contact_on=0.2, contact_off=0.1)


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
    fingers = Fingers(CONFIG, (0, 1))
    assert feel(fingers, 0.15, 0.3) == [1]
    assert feel(fingers, 0.15, 0.15) == []
    assert fingers.touching == [False, True]
    feel(fingers, 0.15, 0.05)
    assert fingers.touching == [False, False]
    assert feel(fingers, 0.3, 0.3) == [0, 1]


def test_a_finger_without_a_force_keeps_its_answer_and_regulates_nothing() -> None:
    fingers = Fingers(CONFIG, (0, 1))
    feel(fingers, 0.3, 0.3)
    feel(fingers, 0.3, 0.0, good=(True, False))
    assert fingers.touching == [True, True]
    assert fingers.on == [[0], []]
    assert fingers.feeling == [True, False]


def test_fingers_of_one_drive_touch_together() -> None:
    fingers = Fingers(CONFIG, (0, 0))
    assert feel(fingers, 0.3, 0.0) == [0]
    assert feel(fingers, 0.3, 0.3) == []
    assert fingers.on == [[0, 1]]


def test_a_force_counts_once_and_its_absence_is_late_after_a_period_and_a_half() -> None:
    fingers = Fingers(CONFIG, (0, 1))
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
    fingers = Fingers(CONFIG, (0, 1))
    feel(fingers, 0.3, 0.3)
    for _ in range(5):
        fingers.spend()
        feel(fingers, 0.3, 0.3, good=(True, False), new=(True, False))
        assert (fingers.complete, fingers.late) == (True, False)


def test_an_old_force_moves_neither_contact_nor_slip() -> None:
    fingers = Fingers(CONFIG, (0, 1))
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
