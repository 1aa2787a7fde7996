"""Closures to joints: no jump at the start, the synergy's line, the pad's own normal."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactile_ros.hands import Finger
from tactile_ros.hands.kinematics import PadNormal, RobotDescription, Synergy

FINGER = Finger(
    joints=('j0', 'j1'), open=[0.0, 0.0], pre_grasp=[0.3, 0.4], closing=[0.6, 0.6],
    sensors=('tip',), frame='tip',
)  # fmt: skip
# two links in the plane; the pad looks along +y of its link, which is where closing leads
ROBOT = """<robot name="planar">
  <joint name="j0" type="revolute"><parent link="palm"/><child link="p"/>
    <axis xyz="0 0 1"/></joint>
  <joint name="j1" type="revolute"><parent link="p"/><child link="d"/>
    <origin xyz="0.05 0 0"/><axis xyz="0 0 1"/></joint>
  <joint name="pad" type="fixed"><parent link="d"/><child link="tip"/>
    <origin xyz="0.03 0 0" rpy="-1.5707963267948966 0 0"/></joint>
</robot>"""
CHAIN = RobotDescription(ROBOT).chain('tip', FINGER.joints)
LOWER, UPPER = np.full(2, -0.5), np.full(2, 1.5)
POSTURES = st.lists(st.floats(-0.4, 1.4), min_size=2, max_size=2)


def closings() -> list[Synergy]:
    return [Synergy(FINGER), PadNormal(FINGER, CHAIN, LOWER, UPPER)]


@given(POSTURES, st.integers(0, 1))
def test_the_first_target_is_where_the_joints_are(position: list[float], kind: int) -> None:
    closing = closings()[kind]
    closure = closing.start(np.array(position))
    np.testing.assert_allclose(closing.joints(closure, 1e-6), position, atol=1e-5)


def test_a_finger_that_began_beside_its_path_joins_it() -> None:
    closing = Synergy(FINGER)
    closing.start(np.array([1.0, 0.0]))
    far = [np.abs(closing.joints(0.7, 0.1) - FINGER.posture(0.7)).max() for _ in range(60)]
    assert far[0] > 0.1
    assert far[-1] < 1e-4
    assert (np.diff(far) < 0).all()


def test_the_pad_moves_along_its_normal_and_as_far_in_joints_as_the_synergy() -> None:
    closing = PadNormal(FINGER, CHAIN, LOWER, UPPER)
    closing.start(FINGER.pre_grasp)
    closures = np.linspace(FINGER.corner, 0.8, 200)
    joints = np.array([closing.joints(c, 1e-9) for c in closures])
    steps = np.linalg.norm(np.diff(joints, axis=0), axis=1)
    np.testing.assert_allclose(steps, np.linalg.norm(FINGER.slope) * np.diff(closures), rtol=1e-6)
    poses = [CHAIN.pose_and_jacobian(q)[0] for q in joints]
    places = np.array([pose[:3, 3] for pose in poses])
    moved = np.diff(places, axis=0)
    along = np.einsum('ni,ni->n', moved, [pose[:3, 2] for pose in poses[:-1]])
    # the damping lets a little of the sideways motion through
    assert (along / np.linalg.norm(moved, axis=1) > 0.97).all()
    line = np.array([FINGER.posture(c) for c in closures])
    assert np.abs(joints[-1] - line[-1]).max() > 0.05


def test_limits_hold_and_a_pad_that_looks_backwards_follows_the_synergy() -> None:
    closing = PadNormal(FINGER, CHAIN, LOWER, np.array([0.35, 1.5]))
    closing.start(FINGER.pre_grasp)
    for closure in np.linspace(FINGER.corner, 1.0, 50):
        assert closing.joints(closure, 1e-9)[0] <= 0.35
    backwards = RobotDescription(ROBOT.replace('rpy="-1.57', 'rpy="1.57')).chain(
        'tip', FINGER.joints
    )
    opposite = PadNormal(FINGER, backwards, LOWER, UPPER)
    np.testing.assert_array_equal(opposite.direction(FINGER.pre_grasp), FINGER.slope)


def test_opening_again_ends_at_the_open_posture() -> None:
    closing = PadNormal(FINGER, CHAIN, LOWER, UPPER)
    closing.start(FINGER.pre_grasp)
    for closure in np.linspace(FINGER.corner, 0.9, 30):
        closing.joints(closure, 0.01)
    for closure in np.linspace(0.9, 0.0, 300):
        last = closing.joints(closure, 0.01)
    for _ in range(1000):
        last = closing.joints(0.0, 0.01)
    assert last == pytest.approx([0.0, 0.0], abs=1e-6)
