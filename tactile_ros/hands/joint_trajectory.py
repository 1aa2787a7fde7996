"""Any hand or gripper behind a JointTrajectoryController: one point of a short trajectory."""

from __future__ import annotations

from dataclasses import dataclass, replace

from tactile_ros.hands.driver import TRAJECTORY, HandDriver, Topic
from tactile_ros.hands.joint_messages import TrajectoryMessage, fill_trajectory
from tactile_ros.types import GripCommand
from tactile_ros.types.config_fields import number, texts

PERIODS = 2.0  # of commands, within which no point is reached: joints would wait for the next


@dataclass(frozen=True)
class JointTrajectoryHand(HandDriver):
    """A hand whose joints are named here; the trajectory carries the names, so order is free."""

    fastest_hz = 250.0

    names: tuple[str, ...] = texts(('finger_joint',), 'names of the joints')
    horizon_s: float = number(
        0.02, 'time to reach a point; never fewer than two periods of the commands', 's', 1e-3, 2.0
    )

    @property
    def joints(self) -> tuple[str, ...]:
        """As named."""
        return self.names

    @property
    def topics(self) -> tuple[Topic, ...]:
        """JointTrajectory of one point."""
        shipped = '/joint_trajectory_controller/joint_trajectory'
        return (Topic(self.command_topic or shipped, TRAJECTORY, self.fill),)

    @property
    def states(self) -> str:
        """Joint states of the joint_state_broadcaster."""
        return self.state_topic or '/joint_states'

    def paced(self, rate_hz: float) -> JointTrajectoryHand:
        """The same, with points at least two periods ahead."""
        return replace(self, horizon_s=max(self.horizon_s, PERIODS / rate_hz))

    def fill(self, message: TrajectoryMessage, command: GripCommand) -> None:
        """Write one point for all joints."""
        fill_trajectory(message, self.joints, self.horizon_s, command)


HAND = JointTrajectoryHand
