# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Closures to joints: no jump at the start, the synergy's line, the pad's own normal."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactile_ros.hands import Finger
from tactile_ros.hands.kinematics import FingerPath, RobotDescription
from tactile_ros.types import JointLimits

LINKS = '<link name="palm"/><link name="p"/><link name="d"/><link name="tip"/>'
PLANAR = f"""<?xml version="1.0"?>
<robot name="planar">{LINKS}
  <joint name="j0" type="revolute"><parent link="palm"/><child link="p"/>
    <axis xyz="0 0 2"/><limit lower="-1" upper="1.5" velocity="3" effort="0"/></joint>
  <joint name="j1" type="revolute"><parent link="p"/><child link="d"/>
    <origin xyz="0.05 0 0"/><axis xyz="0 0 1"/></joint>
  <joint name="pad" type="fixed"><parent link="d"/><child link="tip"/>
    <origin xyz="0.03 0 0" rpy="0 1.5707963267948966 0"/></joint>
</robot>"""
SPATIAL = """<robot name="spatial">
  <joint name="base" type="fixed"><parent link="world"/><child link="palm"/>
    <origin xyz="1 2 3" rpy="0.3 0.2 0.1"/></joint>
  <joint name="j0" type="revolute"><parent link="palm"/><child link="a"/>
    <origin xyz="0 0 0.1" rpy="0.1 0.2 0.3"/><axis xyz="0 1 0"/></joint>
  <joint name="j1" type="prismatic"><parent link="a"/><child link="b"/>
    <origin xyz="0.05 0 0"/><axis xyz="1 0 0"/></joint>
  <joint name="j2" type="continuous"><parent link="b"/><child link="c"/>
    <axis xyz="0 1 1"/><mimic joint="j0" multiplier="0.5" offset="0.1"/></joint>
  <joint name="f" type="fixed"><parent link="c"/><child link="tip"/>
    <origin xyz="0.03 0 0.01"/></joint>
</robot>"""
OTHERWISE = JointLimits(np.full(2, -9.0), np.full(2, 9.0), np.full(2, 8.0), np.full(2, 7.0))


@given(st.floats(-3, 3), st.floats(-3, 3))
def test_chain_of_a_planar_finger_is_the_textbook_one(a: float, b: float) -> None:
    chain = RobotDescription(PLANAR).chain('tip', ('j0', 'j1'))
    pose, jacobian = chain.pose_and_jacobian(np.array([a, b]))
    c1, s1, c12, s12 = np.cos(a), np.sin(a), np.cos(a + b), np.sin(a + b)
    np.testing.assert_allclose(
        pose[:3, 3], [0.05 * c1 + 0.03 * c12, 0.05 * s1 + 0.03 * s12, 0], atol=1e-12
    )
    np.testing.assert_allclose(pose[:3, 2], [c12, s12, 0], atol=1e-12)
    wanted = [[-0.05 * s1 - 0.03 * s12, -0.03 * s12], [0.05 * c1 + 0.03 * c12, 0.03 * c12], [0, 0]]
    np.testing.assert_allclose(jacobian, wanted, atol=1e-12)


@given(st.floats(-0.1, 0.1), st.floats(-3, 3))
def test_chain_jacobian_is_the_derivative_also_of_sliding_and_mimic_joints(
    slide: float, angle: float
) -> None:
    chain = RobotDescription(SPATIAL).chain('tip', ('j1', 'j0'))
    assert [joint.name for joint in chain.path] == ['j0', 'j1', 'j2', 'f']  # not from the world
    at, step = np.array([slide, angle]), 1e-6
    _, jacobian = chain.pose_and_jacobian(at)
    for i, change in enumerate(step * np.eye(2)):
        ahead, behind = (chain.pose_and_jacobian(at + sign * change)[0] for sign in (1, -1))
        slope = (ahead[:3, 3] - behind[:3, 3]) / (2 * step)
        np.testing.assert_allclose(jacobian[:, i], slope, atol=1e-8)


def test_chain_tip_offset_lies_along_the_last_link() -> None:
    robot, at = RobotDescription(PLANAR), np.array([0.2, 0.7])
    pose, jacobian = robot.chain('tip', ('j0', 'j1'), 0.01).pose_and_jacobian(at)
    longer = RobotDescription(PLANAR.replace('0.03 0 0', '0.04 0 0'))
    wanted, slopes = longer.chain('tip', ('j0', 'j1')).pose_and_jacobian(at)
    np.testing.assert_allclose(pose, wanted, atol=1e-12)
    np.testing.assert_allclose(jacobian, slopes, atol=1e-12)
    np.testing.assert_allclose(longer.fingertip(('j0', 'j1'), at), wanted[:3, 3], atol=1e-12)
    assert np.isnan(longer.fingertip(('j1', 'j0'), at)).all()  # nothing of j1 lies above j0


def test_robot_description_limits_fall_back_where_silent_or_zero() -> None:
    limits = RobotDescription(PLANAR).limits(('j1', 'j0'), OTHERWISE)
    np.testing.assert_array_equal(limits.lower, [-9, -1])
    np.testing.assert_array_equal(limits.upper, [9, 1.5])
    np.testing.assert_array_equal(limits.velocity, [8, 3])
    np.testing.assert_array_equal(limits.effort, [7, 7])
    # 3 is a placeholder where the driver moves at 2
    slow = dataclasses.replace(OTHERWISE, velocity=np.full(2, 2.0))
    np.testing.assert_array_equal(RobotDescription(PLANAR).limits(('j1', 'j0'), slow).velocity, 2)


ENTITIES = '<!DOCTYPE r [<!ENTITY a "bbbb"><!ENTITY c "&a;&a;&a;">]><robot name="&c;"/>'
OUTSIDE = '<!DOCTYPE r [<!ENTITY x SYSTEM "file:///etc/hostname">]><robot>&x;</robot>'
LAUGHS = '<!DOCTYPE r [<!ENTITY a0 "ha">{}]><robot>&a29;</robot>'.format(
    ''.join(f'<!ENTITY a{i + 1} "&a{i};&a{i};">' for i in range(29))
)
SENTENCES = {
    ENTITIES: 'no document type and no entities',
    OUTSIDE: 'no document type and no entities',
    LAUGHS: 'no document type and no entities',
    '<model/>': 'must be a <robot>; received <model>',
    '<robot>': 'is no XML',
    '': 'is no XML',
    '<robot>' + '<a>' * 200 + '</a>' * 200 + '</robot>': 'nested at most 100 deep',
    PLANAR.replace('0 0 2', '0 0 0'): 'axis of joint j0 of robot_description must not be zero',
    PLANAR.replace('0 0 2', '0 nan 1'): 'axis of joint j0 of robot_description must be 3 numbers',
    PLANAR.replace('"-1"', '"low"'): "lower of joint j0 .* received 'low'",
}


@pytest.mark.parametrize('text', SENTENCES)
def test_robot_description_refuses_hostile_documents(text: str) -> None:
    with pytest.raises(ValueError, match=SENTENCES[text]):
        RobotDescription(text)


def test_robot_description_names_the_missing_and_ends_a_loop_of_links() -> None:
    robot = RobotDescription(PLANAR)
    assert (robot.has_link('tip'), robot.has_link('palm')) == (True, False)
    with pytest.raises(ValueError, match='missing is j9'):
        robot.limits(('j0', 'j9'), OTHERWISE)
    with pytest.raises(ValueError, match="received 'nose'"):
        robot.chain('nose', ('j0',))
    loop = PLANAR.replace('<parent link="palm"/>', '<parent link="tip"/>')
    with pytest.raises(ValueError, match='must include'):
        RobotDescription(loop).chain('tip', ('j0', 'j1', 'j7'))


FINGER = Finger(
    joints=('j0', 'j1'), open=[0.0, 0.0], pre_grasp=[0.3, 0.4], closing=[0.6, 0.6],
    sensors=('tip',), frame='tip',
)  # fmt: skip
# the pad looks along +y of its link, which is where closing leads
ROBOT = PLANAR.replace('rpy="0 1.5707963267948966 0"', 'rpy="-1.5707963267948966 0 0"')
CHAIN = RobotDescription(ROBOT).chain('tip', FINGER.joints)
LOWER, UPPER = np.full(2, -0.5), np.full(2, 1.5)


def path(robot: str = ROBOT, upper: object = UPPER) -> FingerPath:
    chain = RobotDescription(robot).chain('tip', FINGER.joints)
    return FingerPath(FINGER, chain, LOWER, np.array(upper))


def test_finger_path_moves_the_pad_along_its_normal_at_the_speed_of_the_synergy() -> None:
    closing, closures = path(), np.linspace(FINGER.corner, 0.8, 200)
    joints = np.array([closing.joints(c, np.nan, 1e-9) for c in closures])
    steps = np.linalg.norm(np.diff(joints, axis=0), axis=1)
    np.testing.assert_allclose(steps, np.linalg.norm(FINGER.slope) * np.diff(closures), rtol=1e-6)
    poses = [CHAIN.pose_and_jacobian(q)[0] for q in joints]
    moved = np.diff([pose[:3, 3] for pose in poses], axis=0)
    along = np.einsum('ni,ni->n', moved, [pose[:3, 2] for pose in poses[:-1]])
    # the damping lets a little of the sideways motion through
    assert (along / np.linalg.norm(moved, axis=1) > 0.97).all()
    assert np.abs(joints[-1] - FINGER.posture(0.8)).max() > 0.05
    for closure in np.linspace(0.8, 0.0, 300):
        closing.joints(closure, np.nan, 0.01)
    for _ in range(1000):
        last = closing.joints(0.0, np.nan, 0.01)
    assert last == pytest.approx(FINGER.open, abs=1e-6)


def test_finger_path_stays_in_limits_and_presses_beyond_them_as_its_drives_do() -> None:
    closing = path(upper=[0.35, 1.5])
    for closure in np.linspace(FINGER.corner, 0.8, 50):
        at = closing.joints(closure, 0.8, 1e-9)
        assert at[0] <= 0.35
    np.testing.assert_allclose(closing.joints(0.9, 0.8, 1e-9), at + 0.1 * FINGER.press, atol=1e-9)


def test_finger_path_of_a_pad_that_looks_backwards_is_the_synergy() -> None:
    closing = path(ROBOT.replace('rpy="-1.57', 'rpy="1.57'))
    for closure in (0.0, 0.4, 0.6, 0.9):
        np.testing.assert_array_equal(
            closing.joints(closure, np.nan, 0.01), FINGER.posture(closure)
        )
