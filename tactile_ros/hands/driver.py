"""What every driver of a hand says of itself, and the one list of drivers."""

from __future__ import annotations

import importlib
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, cast

import numpy as np

from tactile_ros.control import GripConfig
from tactile_ros.types import Array, JointLimits, admit_name
from tactile_ros.types.config_fields import admit, array, maybe_array, number, text_of

if TYPE_CHECKING:
    from collections.abc import Callable

    from tactile_ros.types import Integers

JOINT_STATE = 'sensor_msgs/msg/JointState'
NUMBERS = 'std_msgs/msg/Float64MultiArray'
TRAJECTORY = 'trajectory_msgs/msg/JointTrajectory'


@dataclass(frozen=True)
class Topic:
    """A topic on which a driver takes commands (see `CommandTopic`).

    Attributes
    ----------
    name, kind : str
        Of the topic and of its message.
    fill : callable
        Writes a GripCommand into a fresh message.
    """

    name: str
    kind: str
    fill: Callable[..., None]


@dataclass(frozen=True)
class HandDriver:
    """Fields that all drivers have; each is a ROS parameter of grip_node.

    Raises
    ------
    ValueError
        If a value cannot be, or the limits do not fit the joints.
    """

    fastest_hz: ClassVar[float] = 100.0  # commands a second that the driver takes
    falls_silent: ClassVar[bool] = False  # after a command of the wrong size

    lower: Array = array([0.0], 'lowest position of each joint', 'rad', (-1,))
    upper: Array = array([1.0], 'highest position of each joint', 'rad', (-1,))
    velocity: Array = array([1.0], 'fastest motion of each joint', 'rad/s', (-1,), 1e-6, 1e3)
    effort: Array | None = maybe_array('largest torque of each joint', 'N m', (-1,), 1e-6, 1e3)
    most_offset: float = number(
        0.4, 'how far a target may lie from the measured joint: with the gain of the driver it '
        'bounds the torque', 'rad', 1e-3, 100.0,
    )  # fmt: skip
    command_topic: str = text_of('', 'topic of commands; empty: the name that the driver ships')
    state_topic: str = text_of('', 'topic of joint states; empty: the name that the driver ships')
    controller: str = text_of(
        '', 'controller whose parameter `joints` tells the order of the command; empty: as shipped'
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
        _ = self.limits

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of all joints, in the order of the command."""
        raise NotImplementedError

    @property
    def limits(self) -> JointLimits:
        """How far, fast and hard the joints may go."""
        effort = np.full(len(self.joints), np.inf) if self.effort is None else self.effort
        return JointLimits(self.lower, self.upper, self.velocity, effort)

    @property
    def topics(self) -> tuple[Topic, ...]:
        """Where commands go, in the order in which they are published."""
        raise NotImplementedError

    @property
    def states(self) -> str:
        """Topic of joint states."""
        raise NotImplementedError

    def paced(self, rate_hz: float) -> HandDriver:
        """The same driver for commands at a rate (Hz)."""
        return self

    @classmethod
    def grip(cls) -> GripConfig:
        """Gains and limits of the grip law to begin with on this hand."""
        return GripConfig()


def in_order(names: tuple[str, ...], wanted: tuple[str, ...]) -> Integers:
    """Places of `wanted` names among `names`, shape (j,).

    Raises
    ------
    ValueError
        If one is missing, or two are the same.
    """
    missing = [name for name in wanted if name not in names]
    if missing or len(set(wanted)) != len(wanted):
        what = f'lack {", ".join(missing)}' if missing else 'name one twice'
        msg = f'joints must be those of the hand; {", ".join(names[:20])} {what}'
        raise ValueError(msg[:300])
    return np.array([names.index(name) for name in wanted], np.int64)


def list_drivers() -> list[str]:
    """Names of all drivers, in alphabetical order."""
    here = sorted(path.stem for path in Path(__file__).parent.glob('*.py') if path.stem[0] != '_')
    modules = {name: importlib.import_module(f'tactile_ros.hands.{name}') for name in here}
    return [name for name, module in modules.items() if hasattr(module, 'HAND')]


def load_driver(name: str) -> type[HandDriver]:
    """Dataclass of a driver.

    Raises
    ------
    ValueError
        If there is none of that name; lists those that are.
    """
    known = list_drivers()
    if name not in known:
        msg = f'driver of a hand must be one of {", ".join(known)}; received {name!r}'
        raise ValueError(msg)
    return cast('type[HandDriver]', importlib.import_module(f'tactile_ros.hands.{name}').HAND)
