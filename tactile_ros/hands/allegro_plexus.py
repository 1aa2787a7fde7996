"""Allegro Hand Plexus under ros2_control: positions, and a torque cap for each joint.

The cap is the cleanest bound of grip force that any of these hands has. The readme of the driver
names another topic; its code listens to `efforts`. Without a cap it allows 0.345 N m (300 mA).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactile_ros.hands.allegro_v4 import AllegroV4
from tactile_ros.hands.driver import NUMBERS, Topic
from tactile_ros.hands.joint_messages import NumbersMessage, fill_numbers
from tactile_ros.types import Array, GripCommand
from tactile_ros.types.config_fields import array, text_of

THUMB = ((0.0, 1.745), (-0.349, 1.169), (0.0, 1.169), (0.0, 1.571))
FINGER = ((-0.524, 0.524), (0.0, 1.169), (0.0, 1.169), (0.0, 1.169))
LIMITS = (*THUMB, *FINGER, *FINGER, *FINGER)  # rad, right hand
TORQUE = 0.345  # N m, what the driver allows where no cap came


@dataclass(frozen=True)
class AllegroPlexus(AllegroV4):
    """Allegro Hand Plexus, ros2_control, position and effort controller; the joints of a V4."""

    falls_silent = True

    lower: Array = array([low for low, _ in LIMITS], 'lowest position of each joint', 'rad', (16,))
    upper: Array = array(
        [high for _, high in LIMITS], 'highest position of each joint', 'rad', (16,)
    )
    effort_topic: str = text_of('', 'topic of torque caps; empty: the name that the driver ships')
    controller: str = text_of(
        '/allegro_hand_position_effort_controller',
        'controller whose parameter `joints` tells the order of the command; empty: as shipped',
    )

    @property
    def topics(self) -> tuple[Topic, ...]:
        """Caps before positions, so that no position is ever without its cap."""
        place = '/allegro_hand_position_effort_controller'
        return (
            Topic(self.effort_topic or f'{place}/efforts', NUMBERS, self.fill_caps),
            Topic(self.command_topic or f'{place}/commands', NUMBERS, self.fill),
        )

    def fill_caps(self, message: NumbersMessage, command: GripCommand) -> None:
        """Write the 16 largest torques; where the command names none, the limit."""
        most = np.minimum(self.limits.effort, TORQUE)
        asked = np.where(np.isfinite(command.effort), command.effort, most)
        fill_numbers(message, np.clip(asked, 0.0, most))


HAND = AllegroPlexus
