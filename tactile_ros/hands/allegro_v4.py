"""Allegro Hand V4 under ros2_control: 16 positions for a ForwardCommandController, thumb first.

The driver refuses partial claims and takes the order of its controller's yaml; the reported effort
is the commanded torque, no measurement. Speeds are this package's own, well inside of the drives'.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from tactile_ros.hands.driver import NUMBERS, HandDriver, Topic
from tactile_ros.hands.joint_messages import NumbersMessage, fill_numbers
from tactile_ros.types import Array, GripCommand
from tactile_ros.types.config_fields import array, text_of

# rad, of thumb and of each finger, left and right alike
THUMB = ((0.263, 1.396), (-0.105, 1.163), (-0.189, 1.644), (-0.162, 1.719))
FINGER = ((-0.47, 0.47), (-0.196, 1.61), (-0.174, 1.709), (-0.227, 1.618))
LIMITS = (*THUMB, *FINGER, *FINGER, *FINGER)


def thumb_first(prefix: str) -> tuple[str, ...]:
    """Names of the 16 joints in the order of the shipped controllers."""
    return tuple(f'{prefix}joint{finger}{joint}' for finger in range(4) for joint in range(4))


@dataclass(frozen=True)
class AllegroV4(HandDriver):
    """Allegro Hand V4, ros2_control, position controller."""

    lower: Array = array([low for low, _ in LIMITS], 'lowest position of each joint', 'rad', (16,))
    upper: Array = array(
        [high for _, high in LIMITS], 'highest position of each joint', 'rad', (16,)
    )
    velocity: Array = array([2.0] * 16, 'fastest motion of each joint', 'rad/s', (16,), 1e-6, 20.0)
    prefix: str = text_of('ah_', 'of the joints: ah_, or ahl_ and ahr_ of a pair')
    controller: str = text_of(
        '/allegro_hand_position_controller',
        'controller whose parameter `joints` tells the order of the command; empty: as shipped',
    )

    @cached_property
    def joints(self) -> tuple[str, ...]:
        """Thumb, index, middle, ring."""
        return thumb_first(self.prefix)

    @property
    def topics(self) -> tuple[Topic, ...]:
        """Float64MultiArray of 16 positions."""
        name = self.command_topic or '/allegro_hand_position_controller/commands'
        return (Topic(name, NUMBERS, self.fill),)

    @property
    def states(self) -> str:
        """Joint states of the joint_state_broadcaster."""
        return self.state_topic or '/joint_states'

    def fill(self, message: NumbersMessage, command: GripCommand) -> None:
        """Write the 16 positions."""
        fill_numbers(message, command.position)


HAND = AllegroV4
