"""Allegro Hand V5 and V5 Sense: JointState of always 16 positions, index first.

The callback of the driver switches to position control at once, so that the first command must be
the measured posture. The driver shuts down after an emergency stop and falls silent where the CAN
bus or the handedness is wrong: joint states that stop are the only sign. Topic names differ from
version to version. At least a second must pass between its named poses (lib_cmd) and commands.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from tactile_ros.hands.driver import JOINT_STATE, HandDriver, Topic
from tactile_ros.hands.joint_messages import JointStateMessage, fill_joint_state
from tactile_ros.types import Array, GripCommand
from tactile_ros.types.config_fields import array, whole

FINGER = ((-0.47, 0.47), (-0.196, 1.8), (-0.174, 1.709), (-0.227, 1.618))
THUMB = ((0.0, 1.78), (-0.26, 1.78), (-0.05, 1.85), (-0.09, 1.80))
LIMITS = (*FINGER, *FINGER, *FINGER, *THUMB)  # rad, right hand of type A


@dataclass(frozen=True)
class AllegroV5(HandDriver):
    """Allegro Hand V5 or V5 Sense, the vendor's node."""

    fastest_hz = 333.0

    lower: Array = array([low for low, _ in LIMITS], 'lowest position of each joint', 'rad', (16,))
    upper: Array = array(
        [high for _, high in LIMITS], 'highest position of each joint', 'rad', (16,)
    )
    velocity: Array = array([2.0] * 16, 'fastest motion of each joint', 'rad/s', (16,), 1e-6, 20.0)
    number: int = whole(0, 'number in allegroHand_<number>', 0, 99)

    @cached_property
    def joints(self) -> tuple[str, ...]:
        """Index, middle, ring, thumb."""
        return tuple(f'joint_{i}_0' for i in range(16))

    @property
    def topics(self) -> tuple[Topic, ...]:
        """JointState of 16 positions."""
        name = self.command_topic or f'/allegroHand_{self.number}/joint_cmd'
        return (Topic(name, JOINT_STATE, self.fill),)

    @property
    def states(self) -> str:
        """Joint states of the vendor's node; effort is what it commands."""
        return self.state_topic or f'/allegroHand_{self.number}/joint_states'

    def fill(self, message: JointStateMessage, command: GripCommand) -> None:
        """Write all 16 names and positions."""
        fill_joint_state(message, self.joints, command)


HAND = AllegroV5
