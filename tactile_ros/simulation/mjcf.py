# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Models in MJCF: what a hand says of itself, its pads and drives, and things to grasp."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from tactile_ros.hands import HandDescription


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


CUBE, SPHERE = 0.057, 0.06  # m: edge of a Rubik's cube, diameter of a printed sphere
MOUSE = (0.1, 0.06, 0.038)  # m: length, width and height of a wireless mouse
BALLOON = 0.07  # m
# holds an object named `object` where it is, until it is switched off
STILL = '<equality><weld body1="world" body2="object" solref="0.02 1"/></equality>'
COLOURS = {'cube': '0.2 0.45 0.75 1', 'sphere': '0.85 0.75 0.3 1', 'mouse': '0.3 0.6 0.45 1'}


def solid(
    kind: str,
    mass: float,
    place: tuple[float, ...] = (0.0, 0.0, 0.0),
    turn: tuple[float, ...] = (1.0, 0.0, 0.0, 0.0),
) -> str:
    """MJCF of a stiff `object`, free to move: a 'cube', a 'sphere', or a 'mouse' on its side.

    It begins at `place` (m), turned by a quaternion (w, x, y, z); mass in kg.
    """
    shapes = {
        'cube': ('box', (CUBE,) * 3),
        'sphere': ('sphere', (SPHERE,)),
        'mouse': ('ellipsoid', MOUSE),
    }
    if kind not in shapes:
        msg = f'kind of a solid must be one of {", ".join(shapes)}; received {kind!r}'
        raise ValueError(msg)
    shape, lengths = shapes[kind]
    size = _words([0.5 * length for length in lengths])
    return f"""
    <body name="object" pos="{_words(place)}" quat="{_words(turn)}">
      <freejoint name="object"/>
      <geom name="object" type="{shape}" size="{size}" mass="{mass}" rgba="{COLOURS[kind]}"/>
    </body>"""


def balloon(
    stiffness: float,
    damping: float,
    place: tuple[float, ...] = (0.0, 0.0, 0.0),
    mass: float = 0.005,
) -> str:
    """MJCF of a balloon named `object`, held at `place` (m), whose sides give way along x.

    Stiffness and damping are those of each side (N/m, N s/m); mass in kg.
    """
    radius = BALLOON / 2
    sides = ''.join(
        f"""
      <body name="{name}_side" pos="{sign * 0.5 * radius} 0 0">
        <joint name="{name}_side" type="slide" axis="{-sign} 0 0" stiffness="{stiffness}"
          damping="{damping}"/>
        <geom name="{name}_side" type="ellipsoid" size="{0.5 * radius} {radius} {radius}"
          mass="{0.4 * mass}" rgba="0.9 0.3 0.35 0.8"/>
      </body>"""
        for name, sign in (('left', -1), ('right', 1))
    )
    return f"""
    <body name="object" pos="{_words(place)}" gravcomp="1">
      <joint name="object" type="slide" axis="1 0 0" damping="0.05"/>
      <geom name="object" type="ellipsoid" size="{0.72 * radius} {radius} {radius}"
        mass="{0.2 * mass}" rgba="0.9 0.3 0.35 0.8" contype="0" conaffinity="0"/>{sides}
    </body>"""


def _words(numbers: Iterable[float]) -> str:
    return ' '.join(f'{number:.9f}' for number in numbers)
