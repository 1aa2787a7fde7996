"""Closures to guarded joints: where they start, what they are sent, how far they would come."""

from __future__ import annotations

import numpy as np
import pytest

from tactile_ros.hands import load_hand
from tactile_ros.hands.joints import HandJoints, taking_part

HAND = load_hand('joint_trajectory')
LIMITS = HAND.driver.limits
MEASURED = np.array([0.3, 0.5])


def joints() -> HandJoints:
    return HandJoints(HAND, ['left', 'right'])


def test_the_first_command_is_the_measured_posture_whatever_the_path() -> None:
    made = joints()
    closures = made.closures_of(MEASURED).tolist()
    sent = made.command(closures, [0.0, 0.0], MEASURED, 0.01, 0.01)
    np.testing.assert_allclose(sent.position, MEASURED, atol=1e-12)
    assert not sent.limited
    assert np.isnan(sent.effort).all()


def test_a_drive_that_only_lacks_time_is_not_stopped_and_one_at_its_offset_is() -> None:
    made = joints()
    start = made.closures_of(MEASURED)
    made.command(start.tolist(), [0.0, 0.0], MEASURED, 0.01, 0.01)
    near = made.command((start + 0.1).tolist(), [0.0, 0.0], MEASURED, 0.01, 0.01)
    assert near.limited
    np.testing.assert_allclose(near.position - MEASURED, LIMITS.velocity * 0.01)
    np.testing.assert_allclose(near.reach, start + 0.1)
    np.testing.assert_allclose(near.closure, made.closures_of(near.position), atol=1e-9)
    far = made.command((start + 2.0).tolist(), [0.0, 0.0], MEASURED, 0.01, 0.01)
    assert (far.reach < start + 1.0).all()


def test_speed_of_the_slowest_joint_is_that_of_the_hand() -> None:
    slopes = [np.abs(finger.slope).max() for finger in HAND.fingers.values()]
    assert joints().fastest == pytest.approx(1.0 / max(slopes), rel=0.2)


def test_sensors_that_take_part_are_those_of_the_fingers() -> None:
    assert taking_part(HAND, ()) == (['left', 'right'], ['left', 'right'])
    assert taking_part(HAND, ('right',)) == (['right'], ['right'])
    with pytest.raises(ValueError, match="fingers must be of left, right; received 'nose'"):
        taking_part(HAND, ('nose',))
