"""qb SoftHand and SoftHand 2 Motors: one point of a short trajectory, at 25 Hz at most.

One synergy closes all fingers, 0 open to 1 closed; of two motors the second turns the grasp from
pinch to power (-1 to 1: give both limits). The loop of the hand runs at 25 Hz and moves about
0.1 s after a command. It starts its motion anew at every point, hence points of one to five
periods; its tolerances are placeholders, so that a reached goal says nothing.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from tactile_ros.control import GripConfig, qb_softhand
from tactile_ros.hands.driver import TRAJECTORY, HandDriver, Topic
from tactile_ros.hands.joint_messages import TrajectoryMessage, fill_trajectory
from tactile_ros.types import Array, GripCommand
from tactile_ros.types.config_fields import array, number, whole


@dataclass(frozen=True)
class QbSoftHand(HandDriver):
    """qb SoftHand, its ros2_control trajectory controller."""

    fastest_hz = 25.0

    lower: Array = array([0.0], 'lowest position of each synergy', '1', (-1,), -1.0, 1.0)
    upper: Array = array([1.0], 'highest position of each synergy', '1', (-1,), -1.0, 1.0)
    velocity: Array = array([1.0], 'fastest motion of each synergy', '1/s', (-1,), 1e-6, 5.0)
    most_offset: float = number(
        0.3, 'how far a target may lie from the measured synergy', '1', 1e-3, 2.0
    )
    device_id: int = whole(1, 'number in qbhand<number>', 1, 127)
    motors: int = whole(1, 'of the hand: 1, or 2 with a second synergy', 1, 2)
    horizon_s: float = number(0.1, 'time to reach a point', 's', 0.04, 0.2)

    @property
    def name(self) -> str:
        """Namespace and prefix of everything."""
        return f'qbhand{self.device_id}' if self.motors == 1 else f'qbhand2m{self.device_id}'

    @cached_property
    def joints(self) -> tuple[str, ...]:
        """The synergy, and of two motors the manipulation."""
        names = ('synergy',) if self.motors == 1 else ('synergy', 'manipulation')
        return tuple(f'{self.name}_{name}_joint' for name in names)

    @property
    def topics(self) -> tuple[Topic, ...]:
        """JointTrajectory of one point."""
        kind = 'synergy' if self.motors == 1 else 'synergies'
        shipped = f'/{self.name}/{self.name}_{kind}_trajectory_controller/joint_trajectory'
        return (Topic(self.command_topic or shipped, TRAJECTORY, self.fill),)

    @property
    def states(self) -> str:
        """Joint states of its joint_state_broadcaster."""
        return self.state_topic or f'/{self.name}/joint_states'

    @classmethod
    def grip(cls) -> GripConfig:
        """Gains of a hand of 25 Hz that moves late."""
        return qb_softhand()

    def fill(self, message: TrajectoryMessage, command: GripCommand) -> None:
        """Write one point for every synergy."""
        fill_trajectory(message, self.joints, self.horizon_s, command)


HAND = QbSoftHand
