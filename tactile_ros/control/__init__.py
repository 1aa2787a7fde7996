"""Laws of a grip: pure, with the time step as an argument; no clock, no node, no hand.

`GripForce` closes on an object and holds it at a force, `SlipMargin` raises the force before the
object is lost, `GraspSequence` says when a grasp is over and how it ended.
"""

from __future__ import annotations

from tactile_ros.control.config import GripConfig, qb_softhand
from tactile_ros.control.grasp_sequence import GraspProgress, GraspSequence, Keeping, Opening
from tactile_ros.control.grip_force import GraspOutcome, GripForce, GripInput, GripPhase, GripStep

__all__ = [
    'GraspOutcome',
    'GraspProgress',
    'GraspSequence',
    'GripConfig',
    'GripForce',
    'GripInput',
    'GripPhase',
    'GripStep',
    'Keeping',
    'Opening',
    'qb_softhand',
]
