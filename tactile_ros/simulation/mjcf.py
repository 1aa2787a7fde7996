# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Models in MJCF: hands with their pads and drives, things to grasp, their scene."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from tactile_ros.hands import HandDescription

TIME_STEP = 1e-3  # s
CUBE, SPHERE = 0.057, 0.06  # m: edge of a Rubik's cube, diameter of a printed sphere
MOUSE = (0.1, 0.06, 0.038)  # m: length, width and height of a wireless mouse
BALLOON = 0.07  # m
# holds an object named `object` where it is, until it is switched off
STILL = '<equality><weld body1="world" body2="object" solref="0.02 1"/></equality>'
SOLIDS = {  # shape, lengths (m), colour
    'cube': ('box', (CUBE,) * 3, '0.2 0.45 0.75 1'),
    'sphere': ('sphere', (SPHERE,), '0.85 0.75 0.3 1'),
    'mouse': ('ellipsoid', MOUSE, '0.3 0.6 0.45 1'),
}


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


def scene_text(bodies: str, rest: str) -> str:
    """MJCF of a scene: a light, `bodies` inside of `worldbody`, and what moves them beside it.

    Friction is Coulomb's cone (elliptic) and hardly creeps; a pad's own coefficient holds wherever
    it touches, since pads have priority.
    """
    return f"""<mujoco model="grasp">
  <compiler angle="radian" autolimits="true"/>
  <option timestep="{TIME_STEP}" integrator="implicitfast" cone="elliptic" impratio="20"
    noslip_iterations="3"/>
  <visual>
    <global offwidth="640" offheight="480"/>
    <headlight ambient="0.45 0.45 0.45" diffuse="0.5 0.5 0.5" specular="0.1 0.1 0.1"/>
  </visual>
  <asset>
    <texture type="skybox" builtin="flat" rgb1="0.93 0.94 0.96" rgb2="0.93 0.94 0.96"
      width="8" height="8"/>
  </asset>
  <worldbody>
    <light pos="0.3 -0.4 1" dir="-0.3 0.4 -1" diffuse="0.4 0.4 0.4" castshadow="false"/>
    {bodies}
  </worldbody>
  {rest}
</mujoco>"""


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


def solid(
    kind: str,
    mass: float,
    place: Iterable[float] = (0.0, 0.0, 0.0),
    turn: Iterable[float] = (1.0, 0.0, 0.0, 0.0),
) -> str:
    """MJCF of a stiff `object`, free to move: a 'cube', a 'sphere', or a 'mouse' on its side.

    It begins at `place` (m), turned by a quaternion (w, x, y, z); mass in kg.
    """
    shape, lengths, colour = SOLIDS[kind]
    size = _words(0.5 * length for length in lengths)
    return f"""
    <body name="object" pos="{_words(place)}" quat="{_words(turn)}">
      <freejoint name="object"/>
      <geom name="object" type="{shape}" size="{size}" mass="{mass}" rgba="{colour}"/>
    </body>"""


def balloon(stiffness: float, damping: float, place: Iterable[float]) -> str:
    """MJCF of a balloon named `object`, held at `place` (m), whose sides give way along x.

    Stiffness and damping are those of each side (N/m, N s/m); it weighs 5 g.
    """
    radius = BALLOON / 2
    sides = ''.join(
        f"""
      <body name="{name}_side" pos="{sign * 0.5 * radius} 0 0">
        <joint name="{name}_side" type="slide" axis="{-sign} 0 0" stiffness="{stiffness}"
          damping="{damping}"/>
        <geom name="{name}_side" type="ellipsoid" size="{0.5 * radius} {radius} {radius}"
          mass="0.002" rgba="0.9 0.3 0.35 0.8"/>
      </body>"""
        for name, sign in (('left', -1), ('right', 1))
    )
    return f"""
    <body name="object" pos="{_words(place)}" gravcomp="1">
      <joint name="object" type="slide" axis="1 0 0" damping="0.05"/>
      <geom name="object" type="ellipsoid" size="{0.72 * radius} {radius} {radius}"
        mass="0.001" rgba="0.9 0.3 0.35 0.8" contype="0" conaffinity="0"/>{sides}
    </body>"""


def _words(numbers: Iterable[float]) -> str:
    return ' '.join(f'{number:.9f}' for number in numbers)
