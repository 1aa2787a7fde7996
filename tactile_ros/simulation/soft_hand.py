# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""A soft hand of one synergy, as a qb SoftHand is driven: one motor pulls all digits by tendons.

Two fingers close against a thumb. Each digit has two elastic joints and an elastic tendon, so
that one that meets the object stops while the others go on. 25 Hz, and 0.1 s until it moves.
Lengths are those of an adult's hand; the mechanism inside is simpler than the real one.
"""

from __future__ import annotations

import numpy as np

from tactile_ros.hands.description import parse
from tactile_ros.simulation.mjcf import HandModel, pad_friction, servo

JOINT = 'qbhand1_synergy_joint'
DIGITS = {'thumb': (-1, 0.0), 'index': (1, 0.012), 'middle': (1, -0.012)}  # side, height (m)
BASE, FIRST, LAST = 0.015, 0.06, 0.045  # m: from the middle, and lengths of both links
OPEN = np.deg2rad([35.0, 10.0])  # turned outwards when open
PAD_RADIUS, PAD_IN = 4e-3, 8e-3  # m
SPRING, DAMPING, ARMATURE = 0.05, 0.03, 5e-4
# m of a tendon at the joints, in proportion to what they hold at the pad; m of the motor; N/m
ARMS, STROKE, TENDON = (0.01, 0.0037), 0.012, 12e3
GAIN, MOTOR_DAMPING, LAG, MOST = 2500.0, 100.0, 0.06, 500.0
DEAD_TIME = 0.05  # beside half of the 0.1 s in which a trajectory's point is reached
REACH = 0.092  # m, from the palm to where pads meet
STIFFNESS = 15.0  # N for a whole closure, of the stiffest digit


def soft_hand(friction: float = 0.8) -> HandModel:
    """The hand, whose pads have a friction coefficient; pads meet in the plane x = 0."""
    document = {
        'driver': 'qb_softhand',
        'fingers': {
            'hand': {
                'joints': (JOINT,), 'open': [0.0], 'pre_grasp': [0.0], 'closing': [1.0],
                'sensors': tuple(DIGITS),
            },
        },
    }  # fmt: skip
    motor = f"""
    <body name="motor" pos="0 -0.05 0" gravcomp="1">
      <joint name="{JOINT}" type="slide" axis="0 1 0" range="0 1" damping="{MOTOR_DAMPING}"/>
      <geom type="sphere" size="0.001" mass="1" contype="0" conaffinity="0" rgba="0 0 0 0"/>
    </body>
    <geom name="palm" type="box" size="0.03 0.04 0.025" pos="0 -0.045 0" rgba="0.85 0.85 0.8 1"
      contype="0" conaffinity="0"/>"""
    bodies = motor + ''.join(_digit(name, friction) for name in DIGITS)
    tendons = ''.join(
        f'<fixed name="{name}" stiffness="{TENDON}" springlength="0 1">'
        f'<joint joint="{name}_1" coef="{ARMS[0]}"/><joint joint="{name}_2" coef="{ARMS[1]}"/>'
        f'<joint joint="{JOINT}" coef="-{STROKE}"/></fixed>'
        for name in DIGITS
    )
    return HandModel(
        parse('soft_hand', document),
        bodies,
        f'<tendon>{tendons}</tendon><actuator>{servo(JOINT, GAIN, LAG, MOST)}</actuator>',
        {name: f'{name}_pad' for name in DIGITS},
        DEAD_TIME,
        LAG + MOTOR_DAMPING / GAIN,
        centre=(0.0, REACH, 0.0),
        across=(1.0, 0.0, 0.0),
        stiffness=STIFFNESS,
    )


def _digit(name: str, friction: float) -> str:
    """One digit along y; its joints turn it towards the middle."""
    side, height = DIGITS[name]
    first, last = -side * OPEN[0], side * (OPEN[0] - OPEN[1])
    joint = f'axis="0 0 {side}" damping="{DAMPING}" stiffness="{SPRING}" armature="{ARMATURE}"'
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
        <geom name="{name}_pad" type="sphere" size="{PAD_RADIUS}" mass="0.005"
          pos="{-side * PAD_IN} {LAST - 0.008} 0" rgba="0.8 0.35 0.2 1" {pad_friction(friction)}/>
        <site name="{name}_pad" pos="{-side * (PAD_IN - PAD_RADIUS)} {LAST - 0.008} 0"
          xyaxes="0 0 1 0 {side} 0" size="0.001"/>
      </body>
    </body>"""
