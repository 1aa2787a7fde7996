# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Hands in MJCF with pads and drives: two fingers, a soft hand of one synergy, an Allegro Hand.

Two fingers close towards each other on drives of 1500 N/m behind a lag, by a
JointTrajectoryController, as `config/hands/joint_trajectory.yaml` describes one.

The soft hand is driven as a qb SoftHand: one motor pulls two fingers against a thumb. Each digit
has two elastic joints and an elastic tendon, so that one that meets the object stops while the
others go on. 25 Hz, and 0.1 s until it moves. Lengths are those of an adult's hand.

The Allegro Hand has the places of joints (m) of its maker's description: fingers of 54, 38.4 and
26.7 mm, 45 mm apart, those at the sides turned by 5 degrees; a thumb of 51.4 and 42.3 mm that
turns across the palm. Drives are PD loops, as soft as those of the maker's node. Pads are crowned
like fingertips, as [2] did for this hand: ellipsoids as long and wide as the half cylinder.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import log
from types import ModuleType
from typing import cast

import numpy as np

from tactile_ros.control import GripConfig
from tactile_ros.errors import load_package
from tactile_ros.hands import HandDescription, load_hand
from tactile_ros.hands.description import Finger, parse
from tactile_ros.hands.drivers import JointTrajectoryHand
from tactile_ros.types import Array

TRAVEL = 0.03  # m, of each finger
OPEN = 0.045  # m, of a pad from the middle when open
GAIN, MOST, DAMPING = 1500.0, 60.0, 60.0
DEAD_TIME, LAG = 0.02, 0.05
PAD_RADIUS = 3e-3  # the gradiometer's elastomer has 6 mm of diameter [3]
FRICTION = 0.8
SIDES = {'left': -1, 'right': 1}


@dataclass(frozen=True)
class HandModel:
    """A hand and how it answers."""

    # driver, fingers and their sensors; joints and position actuators of the model have the
    # names of the driver's joints
    description: HandDescription
    bodies: str  # MJCF inside of `worldbody`, and beside it
    rest: str
    # for each sensor the pad's geom. A site of the same name is the sensor frame, z out of
    # the skin
    pads: Mapping[str, str]
    dead_time: float  # from a command's arrival until the drives follow it (s)
    lag: float  # time constant of the drives (s)
    centre: tuple[float, ...]  # where things are grasped (m), and along which direction
    across: tuple[float, ...]
    stiffness: float  # largest force over closure of a finger on a stiff object (N)


def load_engine() -> ModuleType:
    """MuJoCo's module, or a `MissingPackageError` that says how to install it."""
    return load_package('mujoco', 'simulated hands need MuJoCo')


def pad_friction(friction: float) -> str:
    """MJCF attributes of a soft pad: its coefficient, and what resists a turn about the normal."""
    return f'condim="4" priority="1" friction="{friction} 0.003 0.0001" solref="0.006 1"'


def servo(joint: str, gain: float, lag: float, most: float) -> str:
    """MJCF of a drive: a position loop behind a first-order lag.

    `gain` in N/m or N m/rad, `lag` of the target in s, at most a force or torque `most`.
    """
    return (
        f'<general name="{joint}" joint="{joint}" biastype="affine" gainprm="{gain}" '
        f'biasprm="0 -{gain} 0" dyntype="filterexact" dynprm="{lag}" '
        f'forcerange="-{most} {most}"/>'
    )


def parallel_hand(rate_hz: float = GripConfig.rate_hz) -> HandModel:
    """Two fingers, for commands at a rate (Hz)."""
    names = {side: f'{side}_finger_joint' for side in SIDES}
    document = {
        'driver': 'joint_trajectory',
        'options': {
            'names': [*names.values()],
            'lower': [0.0, 0.0],
            'upper': [TRAVEL, TRAVEL],
            'velocity': [0.2, 0.2],
            'most_offset': 0.02,
        },
        'fingers': {
            side: {
                'joints': [names[side]], 'open': [0.0], 'pre_grasp': [0.0], 'closing': [TRAVEL],
                'side': sign, 'sensors': [side],
            }
            for side, sign in SIDES.items()
        },
    }  # fmt: skip
    described = parse('parallel_hand', document).paced(rate_hz)
    horizon_s = cast('JointTrajectoryHand', described.driver).horizon_s
    drives = ''.join(servo(name, GAIN, LAG, MOST) for name in names.values())
    return HandModel(
        described,
        ''.join(_parallel_finger(side, sign) for side, sign in SIDES.items()),
        f'<actuator>{drives}</actuator>',
        {side: f'{side}_pad' for side in SIDES},
        DEAD_TIME,
        LAG + approach_s(horizon_s, 1.0 / rate_hz),
        centre=(0.0, 0.0, 0.0),
        across=(1.0, 0.0, 0.0),
        stiffness=GAIN * TRAVEL,
    )


def approach_s(horizon_s: float, period_s: float) -> float:
    """Time constant (s) of targets that every command sets anew, to be reached in a horizon.

    Each is a line from where the target is by then, of which a period (s) is gone.

    Examples
    --------
    >>> round(approach_s(0.05, 0.01), 3), approach_s(0.01, 0.01)
    (0.045, 0.0)
    """
    return -period_s / log(1.0 - period_s / horizon_s) if horizon_s > period_s else 0.0


def _parallel_finger(side: str, sign: int) -> str:
    """One finger: it comes from `sign` times x, its skin looks the other way."""
    return f"""
    <body name="{side}_finger" pos="{sign * OPEN} 0 0" gravcomp="1">
      <joint name="{side}_finger_joint" type="slide" axis="{-sign} 0 0" damping="{DAMPING}"
        range="0 {TRAVEL}"/>
      <geom type="box" size="0.006 0.008 0.03" pos="{sign * 0.012} 0 0.022" mass="0.15"
        rgba="0.35 0.37 0.42 1" contype="0" conaffinity="0"/>
      <geom name="{side}_pad" type="sphere" size="{PAD_RADIUS}" pos="{sign * PAD_RADIUS} 0 0"
        mass="0.01" rgba="0.8 0.35 0.2 1" {pad_friction(FRICTION)}/>
      <site name="{side}_pad" pos="{sign * 2 * PAD_RADIUS} 0 0" xyaxes="0 0 1 0 {sign} 0"
        size="0.001"/>
    </body>"""


SYNERGY = 'qbhand1_synergy_joint'
DIGITS = {'thumb': (-1, 0.0), 'index': (1, 0.012), 'middle': (1, -0.012)}  # side, height (m)
BASE, FIRST, LAST = 0.015, 0.06, 0.045  # m: from the middle, and lengths of both links
TURNED = np.deg2rad([35.0, 10.0])  # outwards when open
SOFT_PAD, PAD_IN = 4e-3, 8e-3  # m: radius, and from the link
SPRING, SOFT_DAMPING, SOFT_ARMATURE = 0.05, 0.03, 5e-4
# m of a tendon at the joints, in proportion to what they hold at the pad; m of the motor; N/m
ARMS, STROKE, TENDON = (0.01, 0.0037), 0.012, 12e3
MOTOR_GAIN, MOTOR_DAMPING, MOTOR_LAG, MOTOR_MOST = 2500.0, 100.0, 0.06, 500.0
MOTOR_DEAD_TIME = 0.05  # beside half of the 0.1 s in which a trajectory's point is reached
REACH = 0.092  # m, from the palm to where pads meet
STIFFNESS = 15.0  # N for a whole closure, of the stiffest digit


def soft_hand(friction: float = FRICTION) -> HandModel:
    """The soft hand, whose pads have a friction coefficient and meet in the plane x = 0."""
    document = {
        'driver': 'qb_softhand',
        'fingers': {
            'hand': {
                'joints': (SYNERGY,), 'open': [0.0], 'pre_grasp': [0.0], 'closing': [1.0],
                'sensors': tuple(DIGITS),
            },
        },
    }  # fmt: skip
    motor = f"""
    <body name="motor" pos="0 -0.05 0" gravcomp="1">
      <joint name="{SYNERGY}" type="slide" axis="0 1 0" range="0 1" damping="{MOTOR_DAMPING}"/>
      <geom type="sphere" size="0.001" mass="1" contype="0" conaffinity="0" rgba="0 0 0 0"/>
    </body>
    <geom name="palm" type="box" size="0.03 0.04 0.025" pos="0 -0.045 0" rgba="0.85 0.85 0.8 1"
      contype="0" conaffinity="0"/>"""
    tendons = ''.join(
        f'<fixed name="{name}" stiffness="{TENDON}" springlength="0 1">'
        f'<joint joint="{name}_1" coef="{ARMS[0]}"/><joint joint="{name}_2" coef="{ARMS[1]}"/>'
        f'<joint joint="{SYNERGY}" coef="-{STROKE}"/></fixed>'
        for name in DIGITS
    )
    drive = servo(SYNERGY, MOTOR_GAIN, MOTOR_LAG, MOTOR_MOST)
    return HandModel(
        parse('soft_hand', document),
        motor + ''.join(_digit(name, friction) for name in DIGITS),
        f'<tendon>{tendons}</tendon><actuator>{drive}</actuator>',
        {name: f'{name}_pad' for name in DIGITS},
        MOTOR_DEAD_TIME,
        MOTOR_LAG + MOTOR_DAMPING / MOTOR_GAIN,
        centre=(0.0, REACH, 0.0),
        across=(1.0, 0.0, 0.0),
        stiffness=STIFFNESS,
    )


def _digit(name: str, friction: float) -> str:
    """One digit along y; its joints turn it towards the middle."""
    side, height = DIGITS[name]
    first, last = -side * TURNED[0], side * (TURNED[0] - TURNED[1])
    joint = (
        f'axis="0 0 {side}" damping="{SOFT_DAMPING}" stiffness="{SPRING}" '
        f'armature="{SOFT_ARMATURE}"'
    )
    return f"""
    <body name="{name}_first" pos="{side * BASE} 0 {height}" gravcomp="1"
      quat="{np.cos(first / 2)} 0 0 {np.sin(first / 2)}">
      <joint name="{name}_1" {joint} range="-0.05 1.2"/>
      <geom type="capsule" size="0.007" fromto="0 0 0 0 {FIRST} 0" mass="0.03"
        rgba="0.9 0.9 0.86 1" contype="0" conaffinity="0"/>
      <body name="{name}_last" pos="0 {FIRST} 0" gravcomp="1"
        quat="{np.cos(last / 2)} 0 0 {np.sin(last / 2)}">
        <joint name="{name}_2" {joint} range="-0.05 1.2"/>
        <geom type="capsule" size="0.007" fromto="0 0 0 0 {LAST} 0" mass="0.02"
          rgba="0.9 0.9 0.86 1" contype="0" conaffinity="0"/>
        <geom name="{name}_pad" type="sphere" size="{SOFT_PAD}" mass="0.005"
          pos="{-side * PAD_IN} {LAST - 0.008} 0" rgba="0.8 0.35 0.2 1" {pad_friction(friction)}/>
        <site name="{name}_pad" pos="{-side * (PAD_IN - SOFT_PAD)} {LAST - 0.008} 0"
          xyaxes="0 0 1 0 {side} 0" size="0.001"/>
      </body>
    </body>"""


ALLEGRO_GAIN, ALLEGRO_LAG, ALLEGRO_DEAD_TIME = 3.0, 0.01, 0.02
# N m, where the makers' nodes clip: V4 by a table of joints, which its node's live parameters
# (2_torque_limit) raise, V5 at 240 mA for each of them
TORQUE = {
    'v4': 3 * (0.312, 0.562, 0.375, 0.237) + (0.438, 0.338, 0.225, 0.225),
    'v4_raised': 16 * (0.4,),
    'v5': 16 * (0.168,),
}
ALLEGRO_DAMPING, ALLEGRO_ARMATURE = 0.2, 2e-3
LENGTHS = (0.0164, 0.054, 0.0384)
FINGERS = {
    'index': ((0.0, 0.0435, -0.001542), -5.0),
    'middle': ((0.0, 0.0, 0.0007), 0.0),
    'ring': ((0.0, -0.0435, -0.001542), 5.0),
}  # base (m), and how far it leans sideways (degrees)
PAD = (0.025, 0.01, 0.01)  # semi-axes (m)
PAD_AT, THUMB_PAD_AT, PAD_OUT = 0.024, 0.037, 0.004  # along the last link, and before it (m)
TIP_RADIUS = 0.012  # m, of round tips
CLOSING = 0.04  # m, of a pad in a whole closure
CENTRE, ACROSS = (0.112, 0.068, -0.024), (-0.133, -0.011, 0.991)  # of the grasp; thumb to fingers


def allegro_hand(torque: str = 'v4') -> HandModel:
    """The hand of `config/hands/allegro_v5_pinch.yaml`; the grasp axis lies level.

    Index, middle and thumb carry pads; the ring finger stays open. Motors are as strong as those
    of a version, a key of `TORQUE`.
    """
    described = load_hand('allegro_v5_pinch')
    drives = ''.join(
        servo(f'joint_{i}_0', ALLEGRO_GAIN, ALLEGRO_LAG, most)
        for i, most in enumerate(TORQUE[torque])
    )
    return HandModel(
        described,
        '<body name="hand" quat="0.7071068 0.7071068 0 0" gravcomp="1">'
        f'{allegro_bodies(1.0)}</body>',
        f'<actuator>{drives}</actuator>',
        {name: f'{name}_pad' for name in described.fingers},
        ALLEGRO_DEAD_TIME,
        ALLEGRO_LAG,
        centre=_in_world(CENTRE),
        across=_in_world(ACROSS),
        stiffness=max(map(force_per_closure, described.fingers.values())),
    )


def allegro_bodies(friction: float, capsule: bool = False) -> str:
    """MJCF of palm, fingers and thumb, with pads or round tips; the palm looks along x."""
    fingers = ''.join(_finger(name, 4 * i, friction, capsule) for i, name in enumerate(FINGERS))
    return f"""
    <geom name="palm" type="box" size="0.0102 0.0565 0.0475" pos="-0.0093 0 -0.0475" mass="0.5"
      rgba="0.22 0.23 0.26 1" contype="0" conaffinity="0"/>{fingers}{_thumb(friction, capsule)}"""


def force_per_closure(finger: Finger) -> float:
    """Force of a finger's pad on a stiff object (N), for a whole closure."""
    return float(ALLEGRO_GAIN * np.dot(finger.closing, finger.closing) / CLOSING)


def on_half_cylinder(place: Array, radius: float, length: float) -> Array:
    """Place (3,) (m) on the pad's half cylinder that a point of the crowned pad stands for."""
    around = np.arctan2(place[2], place[1])
    along = np.clip(place[0], -length / 2, length / 2)
    return np.array([along, radius * np.cos(around), radius * np.sin(around)])


def _in_world(vector: tuple[float, float, float]) -> tuple[float, float, float]:
    """Direction or place of the Allegro Hand in the world."""
    x, y, z = vector
    return x, -z, y


def _joint(number: int, axis: str, low: float, high: float) -> str:
    return (
        f'<joint name="joint_{number}_0" axis="{axis}" range="{low} {high}" '
        f'damping="{ALLEGRO_DAMPING}" armature="{ALLEGRO_ARMATURE}"/>'
    )


def _link(length: float, mass: float) -> str:
    return (
        f'<geom type="box" size="0.0095 0.0095 {length / 2}" pos="0 0 {length / 2}" '
        f'mass="{mass}" rgba="0.3 0.32 0.36 1" contype="0" conaffinity="0"/>'
    )


def _tip(name: str, at: float, length: float, friction: float, capsule: bool) -> str:
    """Last link with its pad; x of the sensor runs along the finger, z out of the palm's side."""
    kind, size, out = 'ellipsoid', ' '.join(str(semi) for semi in PAD), PAD_OUT
    axes, site = 'xyaxes="0 0 1 0 -1 0"', PAD_OUT
    if capsule:  # the round tip that the maker ships, under a thin skin
        kind, size, out, axes, site = 'capsule', f'{TIP_RADIUS} 0.01', 0.0, '', TIP_RADIUS
    return f"""{_link(length, 0.03)}
      <geom name="{name}_pad" type="{kind}" size="{size}" pos="{out} 0 {at}" mass="0.01"
        {axes} rgba="0.8 0.35 0.2 1" {pad_friction(friction)}/>
      <site name="{name}_pad" pos="{site} 0 {at}" xyaxes="0 0 1 0 -1 0" size="0.001"/>"""


def _finger(name: str, first: int, friction: float, capsule: bool) -> str:
    """One of the three fingers: spread, then three joints that flex towards +x."""
    (x, y, z), lean = FINGERS[name]
    half = np.deg2rad(lean) / 2
    one, two, three = LENGTHS
    return f"""
    <body name="{name}_0" pos="{x} {y} {z}" quat="{np.cos(half)} {np.sin(half)} 0 0" gravcomp="1">
      {_joint(first, '0 0 1', -0.47, 0.47)}{_link(one, 0.02)}
      <body name="{name}_1" pos="0 0 {one}" gravcomp="1">
        {_joint(first + 1, '0 1 0', -0.196, 1.8)}{_link(two, 0.065)}
        <body name="{name}_2" pos="0 0 {two}" gravcomp="1">
          {_joint(first + 2, '0 1 0', -0.174, 1.709)}{_link(three, 0.035)}
          <body name="{name}_3" pos="0 0 {three}" gravcomp="1">
            {_joint(first + 3, '0 1 0', -0.227, 1.618)}
            {_tip(name, PAD_AT, 0.0267, friction, capsule)}
          </body>
        </body>
      </body>
    </body>"""


def _thumb(friction: float, capsule: bool) -> str:
    """Four joints: across the palm, about itself, and two that flex."""
    return f"""
    <body name="thumb_0" pos="-0.0182 0.019333 -0.045987"
      quat="0.477714 -0.521334 -0.521334 -0.477714" gravcomp="1">
      {_joint(12, '-1 0 0', 0.0, 1.78)}{_link(0.02, 0.02)}
      <body name="thumb_1" pos="-0.027 0.005 0.0399" gravcomp="1">
        {_joint(13, '0 0 1', -0.26, 1.78)}{_link(0.0177, 0.02)}
        <body name="thumb_2" pos="0 0 0.0177" gravcomp="1">
          {_joint(14, '0 1 0', -0.05, 1.85)}{_link(0.0514, 0.04)}
          <body name="thumb_3" pos="0 0 0.0514" gravcomp="1">
            {_joint(15, '0 1 0', -0.09, 1.80)}
            {_tip('thumb', THUMB_PAD_AT, 0.0423, friction, capsule)}
          </body>
        </body>
      </body>
    </body>"""
