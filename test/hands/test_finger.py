"""A finger's path: open, pre-grasp, closed; what closure a posture is; torque caps."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactile_ros.hands import Finger

FINGER = Finger(
    joints=('a', 'b', 'c'), open=[0.0, 0.1, 0.0], pre_grasp=[0.3, 0.5, 0.0],
    closing=[0.0, 0.6, 0.8], lever=[0.0, 0.05, 0.02], free_effort=0.1, sensors=('tip',),
)  # fmt: skip


def test_path_goes_through_its_three_postures_at_even_speed() -> None:
    corner = FINGER.corner
    assert corner == pytest.approx(0.5 / 1.5)
    np.testing.assert_allclose(FINGER.posture(0.0), FINGER.open)
    np.testing.assert_allclose(FINGER.posture(corner), FINGER.pre_grasp)
    np.testing.assert_allclose(FINGER.posture(1.0), FINGER.pre_grasp + FINGER.closing)
    speeds = [np.linalg.norm(FINGER.posture(c + 0.1) - FINGER.posture(c)) for c in (0.0, 0.2, 0.8)]
    np.testing.assert_allclose(speeds, 0.15)


@given(st.floats(-0.2, 1.3))
def test_closure_of_a_posture_on_the_path_is_its_closure(closure: float) -> None:
    assert FINGER.closure_of(FINGER.posture(closure)) == pytest.approx(closure, abs=1e-12)


@given(st.lists(st.floats(-2, 2), min_size=3, max_size=3))
def test_no_posture_of_the_path_is_nearer(position: list[float]) -> None:
    wanted = np.array(position)
    nearest = np.linalg.norm(wanted - FINGER.posture(FINGER.closure_of(wanted)))
    others = [np.linalg.norm(wanted - FINGER.posture(c)) for c in np.linspace(-3, 4, 141)]
    assert nearest <= min(others) + 1e-9


def test_a_finger_that_is_open_at_its_pre_grasp_has_one_line() -> None:
    finger = Finger(joints=('a',), open=[0.0], pre_grasp=[0.0], closing=[0.8])
    assert finger.corner == 0
    assert finger.posture(0.5) == pytest.approx([0.4])
    assert finger.closure_of(np.array([-0.4])) == pytest.approx(-0.5)


def test_the_first_joint_that_reaches_its_speed_bounds_the_closure() -> None:
    rate = FINGER.fastest(np.array([1.0, 2.0, 0.3]))
    # the last joint moves 0.8 rad over two thirds of the closure
    assert rate == pytest.approx(0.3 / 1.2)


def test_caps_hold_a_force_where_a_lever_is_told() -> None:
    caps = FINGER.caps(4.0)
    assert np.isnan(caps[0])
    np.testing.assert_allclose(caps[1:], [0.3, 0.18])


@pytest.mark.parametrize(
    ('change', 'sentence'),
    [
        ({'open': [0.0]}, 'open of Finger must have one number for each of its 2 joints'),
        ({'closing': [0.0, 0.0]}, 'closing of Finger must move at least one joint'),
        ({'closing': [0.0, np.nan]}, 'closing of Finger must be finite'),
        ({'sensors': ('<b>',)}, 'sensors of Finger must be at most'),
        ({'side': 2}, 'side of Finger must be a whole number from -1 to 1'),
    ],
)
def test_what_cannot_be_is_one_sentence(change: dict[str, object], sentence: str) -> None:
    good = {
        'joints': ('a', 'b'), 'open': [0.0, 0.0], 'pre_grasp': [0.0, 0.0], 'closing': [1.0, 1.0],
    }  # fmt: skip
    with pytest.raises(ValueError, match='^' + sentence):
        Finger(**{**good, **change})


def test_a_shortfall_is_that_of_the_joint_that_comes_closest() -> None:
    finger = Finger(
        joints=('a', 'b', 'c'), open=np.zeros(3), pre_grasp=np.zeros(3),
        closing=np.array([1.0, -0.5, 0.0]),
    )  # fmt: skip
    wanted = finger.posture(0.8)
    assert finger.shortfall(0.8, wanted, wanted) == 0.0
    assert finger.shortfall(0.8, wanted, finger.posture(0.6)) == pytest.approx(0.2)
    sent = np.array([0.3, wanted[1], 0.0])
    assert finger.shortfall(0.8, wanted, sent) == 0.0
    assert finger.shortfall(0.8, wanted, finger.posture(0.9)) == pytest.approx(-0.1)
