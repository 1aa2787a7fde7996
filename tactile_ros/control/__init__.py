# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Laws of a grip: pure, with the time step as an argument; no clock, no node, no hand.

`GripForce` closes on an object and holds it at a force, `SlipMargin` raises the force before the
object is lost, `GraspSequence` says when a grasp is over and how it ended.
"""

from __future__ import annotations

from tactile_ros.control.config import Drive, GripConfig, qb_softhand
from tactile_ros.control.grasp_sequence import (
    GraspOutcome,
    GraspProgress,
    GraspSequence,
    GripInput,
    GripPhase,
    GripStep,
)
from tactile_ros.control.grip_force import GripForce

__all__ = [
    'Drive',
    'GraspOutcome',
    'GraspProgress',
    'GraspSequence',
    'GripConfig',
    'GripForce',
    'GripInput',
    'GripPhase',
    'GripStep',
    'qb_softhand',
]
