"""The drives of a hand: closures to guarded joint commands, and measured joints to closures."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from tactile_ros.hands.closing import PadNormal, Synergy
from tactile_ros.hands.joint_guard import JointGuard

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tactile_ros.hands.description import HandDescription
    from tactile_ros.hands.urdf import RobotDescription
    from tactile_ros.types import Array, Integers


class Guarded(NamedTuple):
    """What may be sent.

    Attributes
    ----------
    position, effort : ndarray, shape (j,)
        Targets (rad), and largest torques (N m), NaN where none is asked for.
    limited : bool
        It is not what was wanted.
    closure, reach : ndarray, shape (a,)
        What the drives are sent in fact, and how far they would come in time: less than was
        wanted where joints stop.
    """

    position: Array
    effort: Array
    limited: bool
    closure: Array
    reach: Array


class HandJoints:
    """Drives of the fingers that take part.

    Parameters
    ----------
    hand : HandDescription
        Which hand.
    drives : sequence of str, length a
        Its fingers that are moved.
    robot : RobotDescription or None
        Where a finger's frame is one of its links, its pad moves along its normal.
    """

    def __init__(
        self, hand: HandDescription, drives: Sequence[str], robot: RobotDescription | None = None
    ) -> None:
        driver = hand.driver
        self._places = [_run_of(hand.places(name)) for name in drives]
        self._driven = [hand.fingers[name] for name in drives]
        self._closings = [_closing(hand, name, robot) for name in drives]
        self._limits = driver.limits
        self.guard = JointGuard(driver.joints, driver.limits, driver.most_offset)

    @property
    def fastest(self) -> float:
        """Closure per second that the joints of every drive can follow."""
        pairs = zip(self._driven, self._places, strict=True)
        return min(finger.fastest(self._limits.velocity[place]) for finger, place in pairs)

    def closures_of(self, position: Array) -> Array:
        """Closures (a,) whose postures lie nearest to joint positions (j,)."""
        pairs = zip(self._places, self._driven, strict=True)
        return np.array([finger.closure_of(position[place]) for place, finger in pairs])

    def stop(self) -> None:
        """The next command begins at the measured posture."""
        self.guard.stop()

    def command(
        self,
        closures: list[float],
        forces: list[float],
        measured: Array,
        dt: float,
        elapsed: float,
    ) -> Guarded:
        """Joints of the drives' closures; the first command is the measured posture.

        Parameters
        ----------
        closures, forces : list of float
            Of each drive: closure, and target force (N), which torque caps follow.
        measured : ndarray, shape (j,)
            Where the joints are; `guard.refusal` said nothing of them.
        dt : float
            Of the step (s).
        elapsed : float
            In which the joints may move: since the last command (s).
        """
        if self.guard.last is None:
            for place, closing in zip(self._places, self._closings, strict=True):
                closing.start(measured[place])
            self.guard.start(measured)
        wanted = np.array(self.guard.last)
        effort = np.full(len(wanted), np.nan)
        for a, (place, closing) in enumerate(zip(self._places, self._closings, strict=True)):
            wanted[place] = closing.joints(closures[a], dt)
            if closing.finger.is_capped:
                effort[place] = closing.finger.caps(forces[a])
        position, limited = self.guard.step(wanted, measured, elapsed)
        closure = np.array(closures)
        if not limited:
            return Guarded(position, effort, limited, closure, closure)
        near = self.guard.reachable(wanted, measured)
        reach = closure - self._behind(closures, wanted, near)
        closure = closure - self._behind(closures, wanted, position)
        return Guarded(position, effort, limited, closure, reach)

    def _behind(self, closures: list[float], wanted: Array, sent: Array) -> Array:
        """How much less closure each drive was sent (a,)."""
        pairs = enumerate(zip(self._places, self._driven, strict=True))
        short = [f.shortfall(closures[a], wanted[p], sent[p]) for a, (p, f) in pairs]
        return np.array(short)


def taking_part(hand: HandDescription, wanted: Sequence[str]) -> tuple[list[str], list[str]]:
    """Sensors that take part, and for each the finger that carries it.

    Raises
    ------
    ValueError
        If the hand does not carry one of them.
    """
    carried = {s: name for name, finger in hand.fingers.items() for s in finger.sensors}
    unknown = [name for name in wanted if name not in carried]
    if unknown:
        msg = f'fingers must be of {", ".join(carried)}; received {unknown[0]!r}'
        raise ValueError(msg)
    sensors = list(wanted) or list(carried)
    return sensors, [carried[sensor] for sensor in sensors]


def _run_of(places: Integers) -> Integers | slice:
    """The same places, as a slice where they follow each other: it costs a fifth."""
    first = int(places[0])
    run = slice(first, first + len(places))
    return run if (places == np.arange(run.start, run.stop)).all() else places


def _closing(hand: HandDescription, name: str, robot: RobotDescription | None) -> Synergy:
    """How a finger's closure becomes joints."""
    finger, limits, place = hand.fingers[name], hand.driver.limits, hand.places(name)
    if robot is None or not robot.has_link(finger.frame):
        return Synergy(finger)
    chain = robot.chain(finger.frame, finger.joints)
    return PadNormal(finger, chain, limits.lower[place], limits.upper[place])
