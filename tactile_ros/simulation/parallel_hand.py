# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Two fingers that close towards each other, each on its own drive: the simplest hand.

Behind a JointTrajectoryController, as `config/hands/joint_trajectory.yaml` describes one. Drives
have 1500 N/m behind a lag, so that a closure of the whole way would be 45 N.
"""

from __future__ import annotations

from math import log
from typing import TYPE_CHECKING, cast

from tactile_ros.control import GripConfig
from tactile_ros.hands.description import parse
from tactile_ros.simulation.mjcf import HandModel, pad_friction, servo

if TYPE_CHECKING:
    from tactile_ros.hands.drivers import JointTrajectoryHand

TRAVEL = 0.03  # m, of each finger
OPEN = 0.045  # m, of a pad from the middle when open
GAIN, MOST, DAMPING = 1500.0, 60.0, 60.0
DEAD_TIME, LAG = 0.02, 0.05
PAD_RADIUS = 3e-3  # the gradiometer's elastomer has 6 mm of diameter [3]
SIDES = {'left': -1, 'right': 1}


def parallel_hand(friction: float = 0.8, rate_hz: float = GripConfig.rate_hz) -> HandModel:
    """The hand, whose pads have a friction coefficient, for commands at a rate (Hz)."""
    document = {
        'driver': 'joint_trajectory',
        'options': {
            'names': [f'{side}_finger_joint' for side in SIDES],
            'lower': [0.0, 0.0],
            'upper': [TRAVEL, TRAVEL],
            'velocity': [0.2, 0.2],
            'most_offset': 0.02,
        },
        'fingers': {
            side: {
                'joints': [f'{side}_finger_joint'], 'open': [0.0], 'pre_grasp': [0.0],
                'closing': [TRAVEL], 'side': sign, 'sensors': [side],
            }
            for side, sign in SIDES.items()
        },
    }  # fmt: skip
    described = parse('parallel_hand', document).paced(rate_hz)
    horizon_s = cast('JointTrajectoryHand', described.driver).horizon_s
    bodies = ''.join(_finger(side, sign, friction) for side, sign in SIDES.items())
    drives = ''.join(servo(f'{side}_finger_joint', GAIN, LAG, MOST) for side in SIDES)
    return HandModel(
        described,
        bodies,
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


def _finger(side: str, sign: int, friction: float) -> str:
    """One finger: it comes from `sign` times x, its skin looks the other way."""
    return f"""
    <body name="{side}_finger" pos="{sign * OPEN} 0 0" gravcomp="1">
      <joint name="{side}_finger_joint" type="slide" axis="{-sign} 0 0" damping="{DAMPING}"
        range="0 {TRAVEL}"/>
      <geom type="box" size="0.006 0.008 0.03" pos="{sign * 0.012} 0 0.022" mass="0.15"
        rgba="0.35 0.37 0.42 1" contype="0" conaffinity="0"/>
      <geom name="{side}_pad" type="sphere" size="{PAD_RADIUS}" pos="{sign * PAD_RADIUS} 0 0"
        mass="0.01" rgba="0.8 0.35 0.2 1" {pad_friction(friction)}/>
      <site name="{side}_pad" pos="{sign * 2 * PAD_RADIUS} 0 0" xyaxes="0 0 1 0 {sign} 0"
        size="0.001"/>
    </body>"""
