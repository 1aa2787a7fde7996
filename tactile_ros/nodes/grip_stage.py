"""Contacts and joint states to joint commands: what grip_node and stack do, without ROS.

Time is an argument everywhere: seconds of a clock that never jumps. The law decides closures, the
hand turns them into joints, the guard has the last word.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import hypot, inf, isfinite, nan
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.control import (
    GraspOutcome,
    GraspProgress,
    GraspSequence,
    GripForce,
    GripInput,
    GripPhase,
    Opening,
)
from tactile_ros.hands.closing import PadNormal, Synergy
from tactile_ros.hands.joint_guard import JointGuard
from tactile_ros.types import GripCommand

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tactile_ros.control import GripConfig, GripStep
    from tactile_ros.hands import HandDescription
    from tactile_ros.hands.urdf import RobotDescription
    from tactile_ros.types import Array, Integers

HOLDING = (GripPhase.LOAD, GripPhase.HOLD)
EMPTY = (GraspOutcome.SLIPPED, GraspOutcome.NO_OBJECT)
MOST_PERIODS = 3.0  # a process that slept does not catch up by one large step


@dataclass(frozen=True)
class Decision:
    """What one step came to.

    Attributes
    ----------
    made : GripStep
        Of the law.
    command : GripCommand or None
        What is to be sent; None: nothing.
    limited : bool
        The law or the guard changed what was wanted.
    refusal : str
        Why the law's own command was not sent; empty: it was.
    ended : GraspProgress or None
        The grasp that ended in this step.
    """

    made: GripStep
    command: GripCommand | None
    limited: bool
    refusal: str
    ended: GraspProgress | None


class GripStage:
    """The loop of a hand, one step at a time.

    Parameters
    ----------
    hand : HandDescription
        Which hand.
    config : GripConfig
        Gains and limits.
    fingers : sequence of str
        Sensors that take part, of those that the hand carries; empty: all.
    robot : RobotDescription or None
        Where a finger's frame is one of its links, its pad moves along its normal.

    Raises
    ------
    ValueError
        If a sensor is not the hand's, or the hand is slower than `rate_hz`.
    """

    def __init__(
        self,
        hand: HandDescription,
        config: GripConfig,
        fingers: Sequence[str] = (),
        robot: RobotDescription | None = None,
    ) -> None:
        if config.rate_hz > hand.driver.fastest_hz:
            msg = (
                f'rate_hz must be at most {hand.driver.fastest_hz:g}, what this hand takes; '
                f'received {config.rate_hz:g}'
            )
            raise ValueError(msg)
        self.hand = hand
        self.fingers, names = taking_part(hand, fingers)
        self._drives = list(dict.fromkeys(names))
        self._drive_of = np.array([self._drives.index(name) for name in names])
        self._places = [_run_of(hand.places(name)) for name in self._drives]
        self._driven = [hand.fingers[name] for name in self._drives]
        limits = hand.driver.limits
        fastest = min(
            finger.fastest(limits.velocity[place])
            for finger, place in zip(self._driven, self._places, strict=True)
        )
        # so that the law knows what the guard would cut
        self.config = replace(config, closure_rate=min(config.closure_rate, fastest))
        self._closings = [_closing(hand, name, robot) for name in self._drives]
        sides = [hand.fingers[name].side for name in names]
        told = sides if {1, -1} <= set(sides) else None
        self._law = GripForce(self.config, self._drive_of.tolist(), told)
        self._guard = JointGuard(limits, hand.driver.most_offset)
        self._sequence: GraspSequence | Opening | None = None
        count = len(self.fingers)
        # lists: one entry of an array costs more than all else that a force brings
        self._normal, self._across = [nan] * count, [nan] * count
        self._valid, self._new, self._slip = [False] * count, [False] * count, [-1] * count
        self._touched_s = [-inf] * count
        self._closure = np.full(len(self._drives), np.nan)
        self._measured: Array | None = None
        self._measured_s = -np.inf
        self._stepped_s = -np.inf
        self.sent = np.full(len(hand.driver.joints), np.nan)

    def take_touch(
        self, finger: int, force: Sequence[float], valid: bool, slip: int, measured_s: float
    ) -> None:
        """Keep what a finger felt at a time (s): force (3,) in its sensor frame (N)."""
        self._normal[finger], self._across[finger] = force[2], hypot(force[0], force[1])
        self._valid[finger], self._slip[finger] = valid, slip
        self._touched_s[finger], self._new[finger] = measured_s, True

    def take_joints(self, position: Array, measured_s: float) -> None:
        """Keep joint positions (j,) that were measured at a time (s)."""
        self._measured, self._measured_s = position, measured_s
        pairs = zip(self._places, self._driven, strict=True)
        self._closure = np.array([finger.closure_of(position[place]) for place, finger in pairs])

    @property
    def unheard(self) -> list[str]:
        """Fingers, and joint states, of which nothing has come yet."""
        missing = ['joint states'] if self._measured is None else []
        pairs = zip(self.fingers, self._touched_s, strict=True)
        return missing + [finger for finger, touched_s in pairs if touched_s == -inf]

    def enable(self) -> None:
        """Commands may be sent; the first is where the joints are."""
        self._guard.stop()
        self._law.enable()

    def disable(self) -> None:
        """Nothing is sent from now on."""
        self._law.disable()
        self._guard.stop()
        self._sequence = None

    def grasp(
        self, target_force: float, fingers: Sequence[str], timeout: float, adapt: bool
    ) -> None:
        """Close until something is held; a target of 0 N opens.

        Raises
        ------
        ValueError
            If the force, the time or a finger cannot be.
        """
        self.admit(target_force, fingers, timeout)
        if target_force == 0:
            self._law.release()
            self._sequence = Opening(self.config, timeout)
            return
        chosen = [not fingers or name in fingers for name in self.fingers]
        self._law.grasp(target_force, adapt, chosen)
        self._sequence = GraspSequence(self.config, timeout)

    def admit(self, target_force: float, fingers: Sequence[str], timeout: float) -> None:
        """Refuse a grasp that cannot be by a ValueError of one sentence."""
        low, high = self.config.contact_on, self.config.force_high
        if not (target_force == 0 or low < target_force <= high):
            msg = (
                f'target_force must be 0, which opens, or above {low:g} and at most {high:g} N; '
                f'received {target_force:g}'
            )
            raise ValueError(msg)
        if not 0 <= timeout < np.inf:
            msg = f'timeout must be 0, for none, or positive; received {timeout:g}'
            raise ValueError(msg)
        unknown = [name for name in fingers if name not in self.fingers]
        if unknown:
            msg = f'fingers must be of {", ".join(self.fingers)}; received {unknown[0]!r}'
            raise ValueError(msg)

    def cancel(self) -> None:
        """Wait for no end any more: what is held stays held, otherwise the hand opens."""
        self._sequence = None
        if self._law.phase not in HOLDING:
            self._law.release()

    def step(
        self, now_s: float, stamp_ns: int, blocked: str = '', since: float | None = None
    ) -> Decision:
        """One control step.

        Parameters
        ----------
        now_s : float
            Time of a clock that never jumps (s).
        stamp_ns : int
            Time that a command carries (ns).
        blocked : str
            Why nothing may be sent whatever the law says; empty: nothing is in the way.
        since : float or None
            Time since the last step (s); None: by `now_s`.

        Returns
        -------
        Decision
            What is to be sent and published.
        """
        dt = self._within(now_s - self._stepped_s if since is None else since)
        self._stepped_s = now_s
        made = self._law.step(self._given(now_s, blocked), dt)
        refusal = made.refusal
        if blocked or self._measured is None:
            refusal = blocked or 'no joint states of the hand have come'
        command, limited = None, made.limited
        if made.send and not blocked and self._measured is not None:
            command, guarded = self._command(made, dt, stamp_ns)
            limited = limited or guarded
        return Decision(made, command, limited, refusal, self._progress(made, dt))

    def _within(self, since: float) -> float:
        """A time since the last step (s), between a tenth of and a few periods."""
        period = 1.0 / self.config.rate_hz
        most = MOST_PERIODS * period if isfinite(since) else period
        return min(max(since, 0.1 * period), most)

    def _given(self, now_s: float, blocked: str) -> GripInput:
        """Input of the law."""
        new, self._new = self._new, [False] * len(self._new)
        return GripInput(
            normal=np.array(self._normal),
            tangential=np.array(self._across),
            valid=np.array(self._valid),
            slip=np.array(self._slip, np.int8),
            age=now_s - np.array(self._touched_s),
            closure=self._closure,
            closure_age=now_s - self._measured_s,
            new=np.array(new),
            blocked=blocked,
        )

    def _command(self, made: GripStep, dt: float, stamp_ns: int) -> tuple[GripCommand, bool]:
        """Joints of the law's closures, and whether the guard changed them."""
        measured = self._measured
        if self._guard.last is None:
            self._guard.start(measured)
            for place, closing in zip(self._places, self._closings, strict=True):
                closing.start(measured[place])
        wanted = self._guard.last.copy()
        effort = np.full(len(wanted), np.nan)
        closures = made.closure.tolist()
        for a, (place, closing) in enumerate(zip(self._places, self._closings, strict=True)):
            wanted[place] = closing.joints(closures[a], dt)
            if closing.finger.is_capped:
                force = made.target_force[self._drive_of == a]
                effort[place] = closing.finger.caps(float(force.max()))
        position, limited = self._guard.step(wanted, measured, dt)
        # the law goes on from what is sent, and winds nothing up
        self._law.admit(made.closure - self._behind(closures, wanted, position, limited), dt)
        self.sent = position
        return GripCommand(stamp_ns, position, effort), limited

    def _behind(
        self, closures: list[float], wanted: Array, sent: Array, limited: bool
    ) -> Array | float:
        """How much less closure each drive was sent (a,)."""
        if not limited:
            return 0.0
        pairs = enumerate(zip(self._places, self._driven, strict=True))
        short = [f.shortfall(closures[a], wanted[p], sent[p]) for a, (p, f) in pairs]
        return np.array(short)

    def _progress(self, made: GripStep, dt: float) -> GraspProgress | None:
        """The end of the grasp, where this step ended it; the hand opens where nothing is held."""
        if self._sequence is None:
            return None
        progress = self._sequence.step(made, dt)
        if progress.outcome is None:
            return None
        self._sequence = None
        kept = self._law.phase in HOLDING and progress.outcome not in EMPTY
        if not kept and made.phase != GripPhase.IDLE:
            self._law.release()
        return progress


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
