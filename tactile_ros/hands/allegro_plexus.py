"""Allegro Hand Plexus under ros2_control: positions, and a torque cap for each joint.

The cap is the cleanest bound of grip force that any of these hands has. The readme of the driver
names another topic; its code listens to `efforts`. Without a cap it allows 0.345 N m (300 mA).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tactile_ros.hands.allegro_v4 import thumb_first
from tactile_ros.hands.driver import NUMBERS, HandDriver, Topic
from tactile_ros.hands.joint_messages import NumbersMessage, fill_numbers
from tactile_ros.types import Array, GripCommand
from tactile_ros.types.fields import array, text_of

THUMB = ((0.0, 1.745), (-0.349, 1.169), (0.0, 1.169), (0.0, 1.571))
FINGER = ((-0.524, 0.524), (0.0, 1.169), (0.0, 1.169), (0.0, 1.169))
LIMITS = (*THUMB, *FINGER, *FINGER, *FINGER)  # rad, right hand
TORQUE = 0.345  # N m, what the driver allows where no cap came


@dataclass(frozen=True)
class AllegroPlexus(HandDriver):
    """Allegro Hand Plexus, ros2_control, position and effort controller."""

    falls_silent = True

    lower: Array = array([low for low, _ in LIMITS], 'lowest position of each joint', 'rad', (16,))
    upper: Array = array(
        [high for _, high in LIMITS], 'highest position of each joint', 'rad', (16,)
    )
    velocity: Array = array([2.0] * 16, 'fastest motion of each joint', 'rad/s', (16,), 1e-6, 20.0)
    prefix: str = text_of('ah_', 'of the joints: ah_, or ahl_ and ahr_ of a pair')
    effort_topic: str = text_of('', 'topic of torque caps; empty: the name that the driver ships')
    controller: str = text_of(
        '/allegro_hand_position_effort_controller',
        'controller whose parameter `joints` tells the order of the command; empty: as shipped',
    )

    @cached_property
    def joints(self) -> tuple[str, ...]:
        """Thumb, index, middle, ring."""
        return thumb_first(self.prefix)

    @property
    def topics(self) -> tuple[Topic, ...]:
        """Caps before positions, so that no position is ever without its cap."""
        place = '/allegro_hand_position_effort_controller'
        return (
            Topic(self.effort_topic or f'{place}/efforts', NUMBERS, self.fill_caps),
            Topic(self.command_topic or f'{place}/commands', NUMBERS, self.fill),
        )

    @property
    def states(self) -> str:
        """Joint states of the joint_state_broadcaster; effort is measured on this hand."""
        return self.state_topic or '/joint_states'

    def fill(self, message: NumbersMessage, command: GripCommand) -> None:
        """Write the 16 positions."""
        fill_numbers(message, command.position)

    def fill_caps(self, message: NumbersMessage, command: GripCommand) -> None:
        """Write the 16 largest torques; where the command names none, the limit."""
        most = np.minimum(self.limits.effort, TORQUE)
        asked = np.where(np.isfinite(command.effort), command.effort, most)
        fill_numbers(message, np.clip(asked, 0.0, most))


HAND = AllegroPlexus
