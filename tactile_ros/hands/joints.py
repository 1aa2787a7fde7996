"""Joints of a hand: closures to guarded commands, watch of joint states, and a fake hand."""

from __future__ import annotations

from collections import deque
from math import inf, isnan, nan
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from tactile_ros.hands.kinematics import PadNormal, Synergy

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tactile_ros.hands.description import HandDescription
    from tactile_ros.hands.kinematics import RobotDescription
    from tactile_ros.types import Array, Integers, JointLimits

SLACK = 0.05  # of a joint's range: encoders are offset, and a hand sags against its stops


class JointGuard:
    """Positions of a hand, clamped and rate limited, from the measured posture on.

    Limits, speed and distance to the measured joint hold at once, always: where they leave
    nothing between them, nothing may be sent.

    Parameters
    ----------
    joints : sequence of str, length j
        Names, for sentences.
    limits : JointLimits
        Of the j joints.
    most_offset : float
        How far a target may lie from the measured joint: with the driver's gain it bounds the
        torque (rad).
    """

    def __init__(self, joints: Sequence[str], limits: JointLimits, most_offset: float) -> None:
        self._joints, self._limits, self._most_offset = list(joints), limits, most_offset
        self.slack = np.minimum(SLACK * (limits.upper - limits.lower), most_offset)
        self.last: Array | None = None

    def start(self, measured: Array) -> None:
        """Begin at measured positions (j,), of which `refusal` said nothing: nothing moves."""
        self.last = _between(measured, self._limits.lower, self._limits.upper)

    def stop(self) -> None:
        """Forget the posture: the hand may be moved by others."""
        self.last = None

    def refusal(self, measured: Array, dt: float) -> str:
        """Why nothing may be sent, in a sentence; empty: something may.

        Parameters
        ----------
        measured : ndarray, shape (j,)
            Where the joints are.
        dt : float
            Time since the last command (s).
        """
        if self.last is None:
            low, high = measured - self.slack, measured + self.slack
        else:
            low, high = self._window(self.last, measured, dt)
        astray = ~((low <= high) & (low <= self._limits.upper) & (high >= self._limits.lower))
        if not astray.any():
            return ''
        return self._sentence(int(np.flatnonzero(astray)[0]), measured)

    def _window(self, last: Array, measured: Array, dt: float) -> tuple[Array, Array]:
        """What may be sent lies between these (j,); where they cross, nothing may."""
        limits, most = self._limits, self._limits.velocity * dt
        low = np.maximum(last - most, measured - self._most_offset)
        high = np.minimum(last + most, measured + self._most_offset)
        return np.maximum(low, limits.lower), np.minimum(high, limits.upper)

    def _sentence(self, worst: int, measured: Array) -> str:
        """What is wrong with a joint."""
        name, at = self._joints[worst], float(measured[worst])
        low, high = float(self._limits.lower[worst]), float(self._limits.upper[worst])
        last = self.last
        if last is None or not low - self._most_offset <= at <= high + self._most_offset:
            return f'{name} was measured at {at:.3f}, beyond its limits {low:g} and {high:g}'
        apart = abs(at - float(last[worst]))
        return (
            f'{name} was measured {apart:.3f} from its last command; at most '
            f'{self._most_offset:g} may lie between them'
        )

    def reachable(self, wanted: Array, measured: Array) -> Array:
        """Nearest targets (j,) that time alone will let through: speed is no stop."""
        low = np.maximum(measured - self._most_offset, self._limits.lower)
        return _between(wanted, low, np.minimum(measured + self._most_offset, self._limits.upper))

    def step(self, wanted: Array, measured: Array, dt: float) -> tuple[Array, bool]:
        """Admit a command.

        Parameters
        ----------
        wanted, measured : ndarray, shape (j,)
            Targets, and where the joints are.
        dt : float
            Time since the last command (s), 0 or more.

        Returns
        -------
        position : ndarray, shape (j,)
            What may be sent; the last command where a target is NaN.
        limited : bool
            It is not what was wanted.

        Raises
        ------
        ValueError
            If it was not started, dt is below 0, or nothing may be sent (`refusal`).
        """
        if self.last is None or not dt >= 0:
            msg = f'a command needs a measured start and dt of 0 or more; received dt {dt}'
            raise ValueError(msg)
        low, high = self._window(self.last, measured, dt)
        if not (low <= high).all():
            raise ValueError(self.refusal(measured, dt))
        position = _between(np.where(np.isfinite(wanted), wanted, self.last), low, high)
        self.last = position
        as_wanted = np.abs(position - wanted) <= 1e-12  # false of NaN
        return position, not bool(as_wanted.all())


def _between(values: Array, low: Array, high: Array) -> Array:
    """Values inside bounds, at half the price of clip; NaN stays."""
    inside: Array = np.minimum(np.maximum(values, low), high)
    return inside


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


class HandWatch:
    """Compare joint states with commands.

    Parameters
    ----------
    joints : sequence of str, length j
        Names, for sentences.
    slack : ndarray, shape (j,)
        Motion that tells nothing.
    patience_s : float
        A hand has moved so long after a command (s), or never will.

    Notes
    -----
    Frozen are joints that are all the same to the last bit while a command went further than the
    slack: encoders of a hand that is blocked flicker, and of many joints one gives way.
    """

    def __init__(self, joints: Sequence[str], slack: Array, patience_s: float) -> None:
        self._joints, self._slack, self._patience_s = list(joints), slack, patience_s
        self._still = np.full(len(self._joints), nan)
        self.forget()

    def forget(self) -> None:
        """Nothing was sent to this hand."""
        self._sent = self._before = self._apart = np.full(len(self._joints), nan)
        self._led_s = inf

    def hear(self, measured: Array) -> None:
        """Take in joint positions (j,)."""
        if not np.array_equal(self._still, measured):
            self._still, self._before, self._led_s = measured.copy(), self._sent, inf

    def send(self, command: Array, now_s: float) -> None:
        """Take in a command (j,) that is sent at a time (s)."""
        if isnan(self._before[0]):
            self._before = command
        self._sent = command
        self._apart = np.abs(command - self._still)
        if self._led_s == inf and (np.abs(command - self._before) > self._slack).any():
            self._led_s = now_s

    def frozen(self, now_s: float) -> str:
        """Whether joint states stand still while commands move, in a sentence; empty: no."""
        since_s = now_s - self._led_s
        if not since_s > self._patience_s:
            return ''
        return f'joint states are frozen ({since_s:.3f} s) while commands move'

    def strayed(self) -> str:
        """Whether the hand was moved by others since the last command; empty: no.

        On its way to the last command, or held back from it as before, it was not.
        """
        apart = np.abs(self._sent - self._still)
        further = apart - self._apart - self._slack
        astray = np.flatnonzero(further > 0)  # none of NaN
        if not astray.size:
            return ''
        worst = astray[0]
        return (
            f'{self._joints[worst]} came back {apart[worst]:.3f} from its last command: it was '
            'moved by others'
        )


FAULTS = ('silent', 'frozen', 'partial', 'nan')


class MockHand:
    """Joints of a fake hand.

    Parameters
    ----------
    limits : JointLimits
        Of the j joints; they stop there and move no faster.
    position : ndarray, shape (j,)
        Where they begin.
    dead_time_s, lag_s : float
        Before a command acts, and time constant of the position loop (s).
    """

    def __init__(
        self, limits: JointLimits, position: Array, dead_time_s: float = 0.0, lag_s: float = 0.02
    ) -> None:
        self._limits = limits
        self._dead_time_s, self._lag_s = dead_time_s, lag_s
        self.position = np.clip(position, limits.lower, limits.upper)
        self._target = self.position
        self._arrival_s = 0.0  # until a trajectory's point is reached; 0: position loop
        self._waiting: deque[tuple[float, Array, float]] = deque()
        self._time_s = 0.0
        self.steps = 0

    def command(self, target: Array, horizon_s: float = 0.0) -> None:
        """Take targets (j,), to be reached in `horizon_s` (s); 0: as soon as the loop can."""
        at = self._time_s + self._dead_time_s
        self._waiting.append(
            (at, np.clip(target, self._limits.lower, self._limits.upper), horizon_s)
        )

    def step(self, dt: float) -> Array:
        """Positions (j,) after a time (s), positive."""
        self._time_s += dt
        self.steps += 1
        while self._waiting and self._waiting[0][0] <= self._time_s:
            _, self._target, self._arrival_s = self._waiting.popleft()
        if self._arrival_s > 0:
            share = min(1.0, dt / self._arrival_s)
            self._arrival_s = max(self._arrival_s - dt, 1e-9)
        else:
            share = 1.0 - np.exp(-dt / self._lag_s)
        most = self._limits.velocity * dt
        self.position = self.position + np.clip(
            share * (self._target - self.position), -most, most
        )
        return self.position
