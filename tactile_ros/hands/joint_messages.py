"""Commands and joint states in the messages of hands, by attribute (duck-typed)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol, cast

import numpy as np

from tactile_ros.hands.driver import JOINT_STATE, TRAJECTORY, in_order
from tactile_ros.messages import fill_header, packed

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tactile_ros.messages import HeaderMessage
    from tactile_ros.types import Array, GripCommand


class JointStateMessage(Protocol):
    """sensor_msgs/JointState."""

    header: HeaderMessage
    name: Sequence[str]
    position: Sequence[float]
    velocity: Sequence[float]
    effort: Sequence[float]


class NumbersMessage(Protocol):
    """std_msgs/Float64MultiArray."""

    data: Sequence[float]


class DurationMessage(Protocol):
    """builtin_interfaces/Duration."""

    sec: int
    nanosec: int


class PointMessage(Protocol):
    """trajectory_msgs/JointTrajectoryPoint."""

    positions: Sequence[float]
    time_from_start: DurationMessage


class TrajectoryMessage(Protocol):
    """trajectory_msgs/JointTrajectory with the one point that is filled."""

    header: HeaderMessage
    joint_names: Sequence[str]
    points: Sequence[PointMessage]


def fill_joint_state(
    message: JointStateMessage, joints: tuple[str, ...], command: GripCommand
) -> None:
    """Positions of all joints with their names, stamped; velocity and effort stay empty."""
    fill_header(message.header, command.stamp_ns, '')
    message.name = list(joints)
    message.position = packed(command.position)


def fill_numbers(message: NumbersMessage, values: Array) -> None:
    """Numbers in the order of the controller; their layout stays empty."""
    message.data = packed(values)


def fill_trajectory(
    message: TrajectoryMessage, joints: tuple[str, ...], horizon_s: float, command: GripCommand
) -> None:
    """One point that is to be reached `horizon_s` after it arrives.

    The stamp stays zero, which means now: a past one would cut the beginning off.
    """
    message.joint_names = list(joints)
    point = message.points[0]
    point.positions = packed(command.position)
    duration = point.time_from_start
    duration.sec, duration.nanosec = divmod(round(horizon_s * 1e9), 1_000_000_000)


def read_joint_states(message: JointStateMessage, joints: tuple[str, ...]) -> Array | None:
    """Positions of a hand's joints in a JointState.

    Parameters
    ----------
    message : JointState
        Perhaps of other parts of the robot too.
    joints : tuple of str
        Of the hand, in the wanted order.

    Returns
    -------
    ndarray, shape (j,), or None
        Positions (rad); None: the message is about other joints alone.

    Raises
    ------
    ValueError
        If it is about some of the joints only, or a position is missing or not finite.
    """
    names = list(message.name)
    found = [names.index(name) if name in names else -1 for name in joints]
    if max(found) < 0:
        return None
    if min(found) < 0:
        msg = (
            f'joint states must be of all joints of the hand; {joints[found.index(-1)]} is missing'
        )
        raise ValueError(msg)
    if len(message.position) != len(names):
        msg = (
            f'joint states must have one position for each of {len(names)} names; '
            f'received {len(message.position)}'
        )
        raise ValueError(msg)
    position = np.array([message.position[place] for place in found], np.float64)
    if not np.isfinite(position).all():
        msg = f'positions of joint states must be finite; received {position.tolist()}'
        raise ValueError(msg[:300])
    return position


def read_command(kind: str, message: object, joints: tuple[str, ...]) -> tuple[Array, float]:
    """What a hand's driver takes from a command: by index, in a trajectory by name.

    Parameters
    ----------
    kind : str
        Type of the message.
    message : JointState, Float64MultiArray or JointTrajectory
        The command.
    joints : tuple of str
        In the driver's order.

    Returns
    -------
    values : ndarray, shape (j,)
        In the driver's order.
    horizon_s : float
        Time to reach them (s); 0: at once.

    Raises
    ------
    ValueError
        If their count or names are not the driver's, or one is not finite.
    """
    horizon_s = 0.0
    if kind == TRAJECTORY:
        trajectory = cast('TrajectoryMessage', message)
        place = in_order(tuple(trajectory.joint_names), joints)
        point = trajectory.points[-1]
        horizon_s = point.time_from_start.sec + 1e-9 * point.time_from_start.nanosec
        values = np.asarray(point.positions, np.float64)
        fits = len(values) == len(trajectory.joint_names)
        values = values[place] if fits else values
    elif kind == JOINT_STATE:
        values = np.asarray(cast('JointStateMessage', message).position, np.float64)
    else:
        values = np.asarray(cast('NumbersMessage', message).data, np.float64)
    if values.shape != (len(joints),) or not np.isfinite(values).all():
        msg = f'a command must be {len(joints)} finite numbers; received {values.tolist()}'
        raise ValueError(msg[:300])
    return values, horizon_s
