# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Drivers of hands: topics, message types, orders of joints and limits; one class a driver."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar

import numpy as np

from tactile_ros.control import GripConfig, qb_softhand
from tactile_ros.messages import Message, fill_header, packed
from tactile_ros.types import Array, GripCommand, Integers, JointLimits, admit_name
from tactile_ros.types.config_fields import (
    admit,
    array,
    maybe_array,
    number,
    text_of,
    texts,
    whole,
)

# help of fields that several drivers have
LOWEST, HIGHEST = 'lowest position of each joint', 'highest position of each joint'
FASTEST = 'fastest motion of each joint'
CONTROLLER = 'controller whose parameter `joints` has the order of the command; empty: as shipped'
PER_EFFORT = 'torque per unit of `effort` in joint states; 0: it has none'
JOINT_STATE = 'sensor_msgs/msg/JointState'
NUMBERS = 'std_msgs/msg/Float64MultiArray'
TRAJECTORY = 'trajectory_msgs/msg/JointTrajectory'
PERIODS = 2.0  # of commands, within which no point is reached: joints would wait for the next


@dataclass(frozen=True)
class Topic:
    """A topic of commands, its message type, and what writes a GripCommand into a message."""

    name: str
    kind: str
    fill: Callable[..., None]


@dataclass(frozen=True)
class HandDriver:
    """Fields that all drivers have; each is a ROS parameter of grip_node.

    A driver adds its `joints`, and topics as shipped, in which {0} is the driver. ValueError if a
    value cannot be, or the limits do not fit the joints.
    """

    fastest_hz: ClassVar[float] = 100.0  # commands a second that the driver takes
    falls_silent: ClassVar[bool] = False  # after a command of the wrong size
    commands: ClassVar[tuple[str, str]] = ('', NUMBERS)  # topic, and type of its message
    joint_states: ClassVar[str] = '/joint_states'  # as joint_state_broadcaster ships it

    lower: Array = array([0.0], LOWEST, 'rad', (-1,))
    upper: Array = array([1.0], HIGHEST, 'rad', (-1,))
    velocity: Array = array([1.0], FASTEST, 'rad/s', (-1,), 1e-6, 1e3)
    effort: Array | None = maybe_array('largest torque of each joint', 'N m', (-1,), 1e-6, 1e3)
    most_offset: float = number(
        0.4, 'how far a target may lie from the measured joint: with the gain of the driver it '
        'bounds the torque', 'rad', 1e-3, 100.0,
    )  # fmt: skip
    support: float = number(
        1.0, 'of the way that joints give under a load, by which commands are shifted', '1', 0, 1
    )
    effort_scale: float = number(0.0, PER_EFFORT, 'N m', 0.0, 1e3)
    command_topic: str = text_of('', 'topic of commands; empty: the name that the driver ships')
    state_topic: str = text_of('', 'topic of joint states; empty: the name that the driver ships')
    description_topic: str = text_of('robot_description', 'topic of the URDF of the hand')
    controller: str = text_of('', CONTROLLER)
    tip_offset: float = number(
        0.0, 'by which the tips are longer than levers and robot_description say', 'm', -0.05, 0.05
    )

    def __post_init__(self) -> None:
        """Hold every value to its range, and the limits to the joints."""
        admit(self)
        for name in self.joints:
            admit_name(f'a joint of {type(self).__name__}', name)
        count = len(self.joints)
        for name in ('lower', 'upper', 'velocity', 'effort'):
            values = getattr(self, name)
            if values is not None and len(values) != count:
                msg = (
                    f'{name} of {type(self).__name__} must have one number for each of its '
                    f'{count} joints; received {len(values)}'
                )
                raise ValueError(msg)
        _ = self.limits  # which hold to each other

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of all joints, in the order of the command."""
        raise NotImplementedError

    @property
    def limits(self) -> JointLimits:
        """Limits of position, speed and torque of the joints."""
        effort = np.full(len(self.joints), np.inf) if self.effort is None else self.effort
        return JointLimits(self.lower, self.upper, self.velocity, effort)

    @property
    def topics(self) -> tuple[Topic, ...]:
        """Topics of commands, in the order in which they are published."""
        name, kind = self.commands
        return (Topic(self.command_topic or name.format(self), kind, self.fill),)

    def fill(self, message: Message, command: GripCommand) -> None:
        """Write the positions of a command into a message."""
        message.data = packed(command.position)

    @property
    def states(self) -> str:
        """Topic of joint states."""
        return self.state_topic or self.joint_states.format(self)

    @property
    def description(self) -> str:
        """Topic of the description."""
        return self.description_topic

    @property
    def remedy(self) -> str:
        """Advice where nothing takes the commands."""
        if not self.controller:
            return 'start the driver of the hand, or set its topic (command_topic)'
        name = self.controller.rsplit('/', 1)[-1]
        other = name.replace('_effort', '')  # which the launch of a Plexus activates
        instead = f' --deactivate {other}' if other != name else ''
        return f'ros2 control switch_controllers --activate {name}{instead}'

    def paced(self, rate_hz: float) -> HandDriver:
        """The same driver for commands at a rate (Hz)."""
        return self

    @classmethod
    def grip(cls) -> GripConfig:
        """Gains and limits of the grip law to begin with on this hand."""
        return GripConfig()


def in_order(names: tuple[str, ...], wanted: tuple[str, ...]) -> Integers:
    """Places (j,) of `wanted` names among `names`; ValueError if one is missing or twice there."""
    missing = [name for name in wanted if name not in names]
    if missing or len(set(wanted)) != len(wanted):
        what = f'do not have {", ".join(missing)}' if missing else 'name one twice'
        msg = f'joints must be those of the hand; {", ".join(names[:20])} {what}'
        raise ValueError(msg[:300])
    return np.array([names.index(name) for name in wanted], np.int64)


def fill_trajectory(
    message: Message, joints: tuple[str, ...], horizon_s: float, command: GripCommand
) -> None:
    """One point that is to be reached `horizon_s` after it arrives.

    The stamp stays zero, which means now: a past one would cut the beginning off.
    """
    message.joint_names = list(joints)
    point = message.points[0]
    point.positions = packed(command.position)
    duration = point.time_from_start
    duration.sec, duration.nanosec = divmod(round(horizon_s * 1e9), 1_000_000_000)


def read_joint_states(message: Message, joints: tuple[str, ...]) -> Array | None:
    """Positions (j,) of a hand's joints in a JointState; None: it is about other joints alone.

    ValueError if it is about some of the joints only, or a position is missing or not finite.
    """
    names = list(message.name)
    missing = [name for name in joints if name not in names]
    if len(missing) == len(joints):
        return None
    if missing:
        msg = f'joint states must be of all joints of the hand; {missing[0]} is missing'
        raise ValueError(msg)
    if len(message.position) != len(names):
        msg = (
            f'joint states must have one position for each of {len(names)} names; '
            f'received {len(message.position)}'
        )
        raise ValueError(msg)
    position = np.array([message.position[names.index(name)] for name in joints], np.float64)
    if not np.isfinite(position).all():
        msg = f'positions of joint states must be finite; received {position.tolist()}'
        raise ValueError(msg[:300])
    return position


def read_efforts(message: Message, joints: tuple[str, ...]) -> Array | None:
    """Efforts (j,) of joint states that hold all joints of a hand; None: they tell none."""
    if len(message.effort) != len(message.name):
        return None
    place = {name: i for i, name in enumerate(message.name)}
    effort = np.array([message.effort[place[name]] for name in joints], np.float64)
    return effort if np.isfinite(effort).all() else None


def read_command(kind: str, message: Message, joints: tuple[str, ...]) -> tuple[Array, float]:
    """Values (j,) in the order of a driver, and the time to reach them (s; 0: at once).

    `kind` is the type of the message; ValueError where count or names are not the driver's, or a
    number is not finite.
    """
    horizon_s = 0.0
    if kind == TRAJECTORY:
        place = in_order(tuple(message.joint_names), joints)
        point = message.points[-1]
        horizon_s = point.time_from_start.sec + 1e-9 * point.time_from_start.nanosec
        values = np.asarray(point.positions, np.float64)
        fits = len(values) == len(message.joint_names)
        values = values[place] if fits else values
    else:
        read = message.position if kind == JOINT_STATE else message.data
        values = np.asarray(read, np.float64)
    if values.shape != (len(joints),) or not np.isfinite(values).all():
        msg = f'a command must be {len(joints)} finite numbers; received {values.tolist()}'
        raise ValueError(msg[:300])
    return values, horizon_s


# rad; left and right hands of a V4 alike, right ones of the others, a V5 of type A
V4_LIMITS = np.array(
    [(0.263, 1.396), (-0.105, 1.163), (-0.189, 1.644), (-0.162, 1.719)]
    + 3 * [(-0.47, 0.47), (-0.196, 1.61), (-0.174, 1.709), (-0.227, 1.618)]
)
PLEXUS_LIMITS = np.array(
    [(0.0, 1.745), (-0.349, 1.169), (0.0, 1.169), (0.0, 1.571)]
    + 3 * [(-0.524, 0.524), (0.0, 1.169), (0.0, 1.169), (0.0, 1.169)]
)
V5_LIMITS = np.array(
    3 * [(-0.47, 0.47), (-0.196, 1.8), (-0.174, 1.709), (-0.227, 1.618)]
    + [(0.0, 1.78), (-0.26, 1.78), (-0.05, 1.85), (-0.09, 1.80)]
)
TORQUE = 0.345  # N m, what the driver of a Plexus allows where no cap came


@dataclass(frozen=True)
class AllegroV4(HandDriver):
    """Allegro Hand V4 under ros2_control: 16 positions, thumb first.

    The driver refuses partial claims and takes the order of its controller's yaml; the reported
    effort is the commanded torque, no measurement. Speeds are this package's own, well inside of
    the drives'.
    """

    commands = ('/allegro_hand_position_controller/commands', NUMBERS)

    lower: Array = array(V4_LIMITS[:, 0], LOWEST, 'rad', (16,))
    upper: Array = array(V4_LIMITS[:, 1], HIGHEST, 'rad', (16,))
    velocity: Array = array([2.0] * 16, FASTEST, 'rad/s', (16,), 1e-6, 20.0)
    effort_scale: float = number(1.0, PER_EFFORT, 'N m', 0.0, 1e3)
    prefix: str = text_of('ah_', 'of the joints: ah_, or ahl_ and ahr_ of a pair')
    controller: str = text_of('/allegro_hand_position_controller', CONTROLLER)

    @cached_property
    def joints(self) -> tuple[str, ...]:
        """Thumb, index, middle, ring: the order of the shipped controllers."""
        return tuple(f'{self.prefix}joint{i // 4}{i % 4}' for i in range(16))


@dataclass(frozen=True)
class AllegroPlexus(AllegroV4):
    """Allegro Hand Plexus under ros2_control: positions, and a torque cap for each joint.

    The readme of the driver names another topic of caps; its code listens to `efforts`. Without a
    cap it allows 0.345 N m (300 mA).
    """

    falls_silent = True
    commands = ('/allegro_hand_position_effort_controller/commands', NUMBERS)

    lower: Array = array(PLEXUS_LIMITS[:, 0], LOWEST, 'rad', (16,))
    upper: Array = array(PLEXUS_LIMITS[:, 1], HIGHEST, 'rad', (16,))
    effort_topic: str = text_of('', 'topic of torque caps; empty: the name that the driver ships')
    controller: str = text_of('/allegro_hand_position_effort_controller', CONTROLLER)

    @property
    def topics(self) -> tuple[Topic, ...]:
        """Caps before positions, so that no position is ever without its cap."""
        shipped = '/allegro_hand_position_effort_controller/efforts'
        caps = Topic(self.effort_topic or shipped, NUMBERS, self.fill_caps)
        return (caps, *super().topics)

    def fill_caps(self, message: Message, command: GripCommand) -> None:
        """Write the 16 largest torques; where the command names none, the limit."""
        most = np.minimum(self.limits.effort, TORQUE)
        asked = np.where(np.isfinite(command.effort), command.effort, most)
        message.data = packed(np.clip(asked, 0.0, most))


@dataclass(frozen=True)
class AllegroV5(HandDriver):
    """Allegro Hand V5 and V5 Sense: JointState of always 16 positions, index first.

    The callback of the driver switches to position control at once, so that the first command must
    be the measured posture. The driver shuts down after an emergency stop and falls silent where
    the CAN bus or the handedness is wrong: joint states that stop are the only sign. Topic names
    differ from version to version. At least a second must pass between its named poses (lib_cmd)
    and commands.
    """

    fastest_hz = 333.0
    commands = ('/allegroHand_{0.number}/joint_cmd', JOINT_STATE)
    joint_states = '/allegroHand_{0.number}/joint_states'

    lower: Array = array(V5_LIMITS[:, 0], LOWEST, 'rad', (16,))
    upper: Array = array(V5_LIMITS[:, 1], HIGHEST, 'rad', (16,))
    velocity: Array = array([2.0] * 16, FASTEST, 'rad/s', (16,), 1e-6, 20.0)
    effort_scale: float = number(1.0, PER_EFFORT, 'N m', 0.0, 1e3)
    number: int = whole(0, 'number in allegroHand_<number>', 0, 99)
    description_topic: str = text_of(
        '/allegro_hand_description', 'topic of the URDF; {number} stands for that of the hand'
    )

    @cached_property
    def joints(self) -> tuple[str, ...]:
        """Index, middle, ring, thumb."""
        return tuple(f'joint_{i}_0' for i in range(16))

    @property
    def description(self) -> str:
        """Topic of the vendor's robot_state_publisher."""
        return self.description_topic.replace('{number}', str(self.number))

    def fill(self, message: Message, command: GripCommand) -> None:
        """Write all 16 names and positions, stamped; velocity and effort stay empty."""
        fill_header(message.header, command.stamp_ns, '')
        message.name = list(self.joints)
        message.position = packed(command.position)


@dataclass(frozen=True)
class JointTrajectoryHand(HandDriver):
    """A hand whose joints are named here; the trajectory carries the names, so order is free."""

    fastest_hz = 250.0
    commands = ('/joint_trajectory_controller/joint_trajectory', TRAJECTORY)

    names: tuple[str, ...] = texts(('finger_joint',), 'names of the joints')
    horizon_s: float = number(
        0.02, 'time to reach a point; never fewer than two periods of the commands', 's', 1e-3, 2.0
    )

    @property
    def joints(self) -> tuple[str, ...]:
        """As named."""
        return self.names

    def paced(self, rate_hz: float) -> JointTrajectoryHand:
        """The same, with points so far ahead that no joint waits for the next."""
        return replace(self, horizon_s=max(self.horizon_s, PERIODS / rate_hz))

    def fill(self, message: Message, command: GripCommand) -> None:
        """Write one point for all joints."""
        fill_trajectory(message, self.joints, self.horizon_s, command)


@dataclass(frozen=True)
class QbSoftHand(HandDriver):
    """qb SoftHand and SoftHand 2 Motors: one point of a short trajectory, at 25 Hz at most.

    One synergy closes all fingers, 0 open to 1 closed; of two motors the second turns the grasp
    from pinch to power (-1 to 1: give both limits). The loop of the hand runs at 25 Hz and moves
    about 0.1 s after a command. It starts its motion anew at every point, hence points of one to
    five periods; its tolerances are placeholders, so that a reached goal says nothing.
    """

    fastest_hz = 25.0
    joint_states = '/{0.name}/joint_states'

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

    @classmethod
    def grip(cls) -> GripConfig:
        """Gains of a hand of 25 Hz that moves late."""
        return qb_softhand()

    def fill(self, message: Message, command: GripCommand) -> None:
        """Write one point for every synergy."""
        fill_trajectory(message, self.joints, self.horizon_s, command)


DRIVERS: dict[str, type[HandDriver]] = {
    'allegro_plexus': AllegroPlexus,
    'allegro_v4': AllegroV4,
    'allegro_v5': AllegroV5,
    'joint_trajectory': JointTrajectoryHand,
    'qb_softhand': QbSoftHand,
}


def list_drivers() -> list[str]:
    """Names of all drivers, in alphabetical order."""
    return sorted(DRIVERS)


def load_driver(name: str) -> type[HandDriver]:
    """Dataclass of a driver; ValueError, which lists all, if there is none of that name."""
    if name not in DRIVERS:
        msg = f'driver of a hand must be one of {", ".join(list_drivers())}; received {name!r}'
        raise ValueError(msg)
    return DRIVERS[name]
