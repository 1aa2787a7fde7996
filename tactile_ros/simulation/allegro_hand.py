# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""A hand of 16 joints with the published dimensions of the Allegro Hand, pads on three tips.

Places of joints (m) are those of the hand's description by its maker: fingers of 54, 38.4 and 26.7
mm, 45 mm apart, those at the sides turned by 5 degrees; a thumb of 51.4 and 42.3 mm that turns
across the palm. Drives are PD loops, as soft as those of the maker's node. Pads are crowned like
fingertips, as [2] did for this hand: ellipsoids as long and wide as the half cylinder.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.hands import load_hand
from tactile_ros.simulation.mjcf import HandModel, pad_friction, servo

if TYPE_CHECKING:
    from tactile_ros.hands.description import Finger
    from tactile_ros.types import Array

GAIN, LAG, DEAD_TIME = 3.0, 0.01, 0.02
# N m, where the makers' nodes clip: V4 by a table of joints, which its node's live parameters
# (2_torque_limit) raise, V5 at 240 mA for each of them
TORQUE = {
    'v4': 3 * (0.312, 0.562, 0.375, 0.237) + (0.438, 0.338, 0.225, 0.225),
    'v4_raised': 16 * (0.4,),
    'v5': 16 * (0.168,),
}
DAMPING, ARMATURE = 0.2, 2e-3
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
GREY, SKIN = '0.3 0.32 0.36 1', '0.8 0.35 0.2 1'


def _joint(number: int, axis: str, low: float, high: float) -> str:
    return (
        f'<joint name="joint_{number}_0" axis="{axis}" range="{low} {high}" '
        f'damping="{DAMPING}" armature="{ARMATURE}"/>'
    )


def _link(length: float, mass: float, width: float = 0.0095) -> str:
    return (
        f'<geom type="box" size="{width} {width} {length / 2}" pos="0 0 {length / 2}" '
        f'mass="{mass}" rgba="{GREY}" contype="0" conaffinity="0"/>'
    )


def _tip(name: str, at: float, length: float, friction: float, capsule: bool) -> str:
    """Last link with its pad; x of the sensor runs along the finger, z out of the palm's side."""
    kind, size, out = 'ellipsoid', ' '.join(str(semi) for semi in PAD), PAD_OUT
    if capsule:  # the round tip that the maker ships, under a thin skin
        kind, size, out = 'capsule', f'{TIP_RADIUS} 0.01', 0.0
    axes = '' if capsule else 'xyaxes="0 0 1 0 -1 0"'
    site = TIP_RADIUS if capsule else PAD_OUT
    return f"""{_link(length, 0.03)}
      <geom name="{name}_pad" type="{kind}" size="{size}" pos="{out} 0 {at}" mass="0.01"
        {axes} rgba="{SKIN}" {pad_friction(friction)}/>
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


def allegro_bodies(friction: float, capsule: bool = False) -> str:
    """MJCF of palm, fingers and thumb, with pads or round tips; the palm looks along x."""
    fingers = ''.join(_finger(name, 4 * i, friction, capsule) for i, name in enumerate(FINGERS))
    return f"""
    <geom name="palm" type="box" size="0.0102 0.0565 0.0475" pos="-0.0093 0 -0.0475" mass="0.5"
      rgba="0.22 0.23 0.26 1" contype="0" conaffinity="0"/>{fingers}{_thumb(friction, capsule)}"""


def force_per_closure(finger: Finger) -> float:
    """Force of a finger's pad on a stiff object (N), for a whole closure."""
    return float(GAIN * np.dot(finger.closing, finger.closing) / CLOSING)


def allegro_hand(friction: float = 1.0, torque: str = 'v4') -> HandModel:
    """The hand of `config/hands/allegro_v5_pinch.yaml`; the grasp axis lies level.

    Index, middle and thumb carry pads of a friction coefficient; the ring finger stays open.
    Motors are as strong as those of a version, a key of `TORQUE`.
    """
    described = load_hand('allegro_v5_pinch')
    drives = ''.join(
        servo(f'joint_{i}_0', GAIN, LAG, most) for i, most in enumerate(TORQUE[torque])
    )
    return HandModel(
        described,
        f'<body name="hand" quat="0.7071068 0.7071068 0 0" gravcomp="1">'
        f'{allegro_bodies(friction)}</body>',
        f'<actuator>{drives}</actuator>',
        {name: f'{name}_pad' for name in described.fingers},
        DEAD_TIME,
        LAG,
        centre=tuple(turned(np.array(CENTRE))),
        across=tuple(turned(np.array(ACROSS))),
        stiffness=max(map(force_per_closure, described.fingers.values())),
    )


def on_half_cylinder(place: Array, radius: float, length: float) -> Array:
    """Place (3,) (m) on the pad's half cylinder that a point of the crowned pad stands for."""
    around = np.arctan2(place[2], place[1])
    along = np.clip(place[0], -length / 2, length / 2)
    return np.array([along, radius * np.cos(around), radius * np.sin(around)])


def turned(vector: Array) -> Array:
    """A direction or place (3,) of the hand in the world."""
    return np.array([vector[0], -vector[2], vector[1]])
