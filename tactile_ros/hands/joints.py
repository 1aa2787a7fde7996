# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Joints of a hand: closures to guarded commands, force by the drives, watch of joint states."""

from __future__ import annotations

from collections import deque
from math import exp, inf, isfinite, isnan, nan
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from tactile_ros.control.config import Drive
from tactile_ros.hands.kinematics import FingerPath

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tactile_ros.control import GripConfig, GripStep
    from tactile_ros.hands.description import HandDescription
    from tactile_ros.hands.kinematics import RobotDescription
    from tactile_ros.types import Array, Integers, JointLimits

SLACK = 0.05  # of a joint's range: encoders are offset, and a hand sags against its stops
EASE_S = 0.5  # time constant in which a finger that is beside its path joins it
SUPPORT_S = 0.1  # in which a command follows joints that give way under a load
STIFFEST = 1.3  # of a drive's own stiffness: its gain and levers are not exact
LEADING = 0.03  # rad, lead of a command that tells a gain
LEARNING = 0.1  # share of a larger gain that one sample teaches: none is believed alone
STEADY = 0.1  # of a lead, by which its command may have moved
FULL_RATIO = 0.8  # of that gain below which a drive gives all its torque
SOFTEST = 0.1  # stiffness of a soft object and its drive, of the drive's own


class JointLimiter:
    """Positions of a hand, clamped and rate limited, from the measured posture on.

    Limits, speed and distance to the measured joint hold at once, always: where they leave
    nothing between them, nothing may be sent. A target lies at most `most_offset` (rad) from the
    measured joint: with the gain of the driver that bounds the torque.
    """

    def __init__(self, joints: Sequence[str], limits: JointLimits, most_offset: float) -> None:
        self._joints, self._limits, self._most_offset = list(joints), limits, most_offset
        self.slack = np.minimum(SLACK * (limits.upper - limits.lower), most_offset)
        self.last: Array | None = None

    def start(self, command: Array) -> None:
        """Begin at a command (j,) that moves nothing."""
        self.last = _between(command, self._limits.lower, self._limits.upper)

    def stop(self) -> None:
        """Forget the posture: the hand may be moved by others."""
        self.last = None

    def refusal(self, measured: Array, dt: float) -> str:
        """Reason why nothing may be sent from measured joints (j,); empty: something may.

        `dt` is the time since the last command (s).
        """
        lower, upper, last = self._limits.lower, self._limits.upper, self.last
        if last is None:
            low, high = measured - self.slack, measured + self.slack
        else:
            low, high = self._window(last, measured, dt)
        astray = ~((low <= high) & (low <= upper) & (high >= lower))
        if not astray.any():
            return ''
        worst, most = int(astray.argmax()), self._most_offset
        name, at = self._joints[worst], float(measured[worst])
        least, largest = float(lower[worst]), float(upper[worst])
        if last is None or not least - most <= at <= largest + most:
            return f'{name} was measured at {at:.3f}, beyond its limits {least:g} and {largest:g}'
        return (
            f'{name} was measured {abs(at - float(last[worst])):.3f} from its last command; at '
            f'most {most:g} may lie between them'
        )

    def _window(self, last: Array, measured: Array, dt: float) -> tuple[Array, Array]:
        """Bounds (j,) of what may be sent; where they cross, nothing may."""
        limits, most = self._limits, self._limits.velocity * dt
        low = np.maximum(last - most, measured - self._most_offset)
        high = np.minimum(last + most, measured + self._most_offset)
        return np.maximum(low, limits.lower), np.minimum(high, limits.upper)

    def reachable(self, wanted: Array, measured: Array) -> Array:
        """Nearest targets (j,) that time alone will let through: speed is no stop."""
        low = np.maximum(measured - self._most_offset, self._limits.lower)
        return _between(wanted, low, np.minimum(measured + self._most_offset, self._limits.upper))

    def step(self, wanted: Array, measured: Array, dt: float) -> tuple[Array, bool]:
        """Admit a command (j,), dt (s) after the last; False: it is as wanted.

        Where a target is NaN the last command stays. ValueError if it was not started, dt is below
        0, or nothing may be sent (`refusal`).
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
    """Admitted command of j joints and a drives."""

    position: Array  # (j,) targets (rad)
    effort: Array  # (j,) torque caps (N m); NaN: none
    limited: bool  # it is not what was wanted
    closure: Array  # (a,) that is sent in fact
    reach: Array  # (a,) to which the drives would come in time, each joint by itself
    clipped: list[bool]  # (a,) the drive gives all its torque


class HandJoints:
    """Joints of the fingers of a hand that sensors sit on, each moved by its closure.

    `carriers` has the finger of each sensor. With a `robot` a finger whose frame is one of its
    links moves its pad along its normal.
    """

    def __init__(
        self, hand: HandDescription, carriers: Sequence[str], robot: RobotDescription | None = None
    ) -> None:
        driver, drives = hand.driver, list(dict.fromkeys(carriers))
        self.drive_of = [drives.index(name) for name in carriers]
        self._limits, self._scale = driver.limits, driver.effort_scale
        self._drives = [(hand.fingers[name], _run_of(hand.places(name))) for name in drives]
        self._paths = [_path(hand, name, robot) for name in drives]
        self.limiter = JointLimiter(driver.joints, driver.limits, driver.most_offset)
        self._sent: deque[tuple[float, Array]] = deque(maxlen=16)
        count = len(driver.joints)
        self._beside, self._support = np.zeros(count), np.zeros(count)
        self._stood: Array | None = None  # (j,) of these while nothing gives way under a load
        self._gain = np.zeros(count)  # largest torque per lead that efforts showed
        self._full, self._last_lead = np.zeros(count, bool), np.full(count, nan)
        self._clipping, self._carries = np.full(count, inf), np.zeros(count, bool)
        for finger, place in self._drives:
            self._clipping[place], self._carries[place] = finger.clipping, finger.lever != 0
            self._support[place] = driver.support if finger.is_soft else 0.0

    def plants(self, config: GripConfig) -> list[Drive]:
        """Drives (a,) as the law has to know them."""
        made = []
        for finger, place in self._drives:
            low, high = config.stiffness_low, config.stiffness_high
            fastest, own = finger.fastest(self._limits.velocity[place]), finger.stiffness
            if isfinite(own):
                low, high = SOFTEST * own / finger.kp_factor, STIFFEST * own
            made.append(Drive(low, high, own, finger.kp_factor, fastest))
        return made

    def closures_of(self, position: Array) -> Array:
        """Closures (a,) whose postures lie nearest to joint positions (j,)."""
        return np.array([finger.closure_of(position[place]) for finger, place in self._drives])

    def lead(self, measured: Array, effort: Array | None, now_s: float, dead_time: float) -> Array:
        """Angles (j,) by which commands lead the joints, else torques over gains; NaN: unknown."""
        if self.limiter.last is not None and self._sent:
            due = [sent for at_s, sent in self._sent if at_s <= now_s - dead_time]
            return (due[-1] if due else self._sent[0][1]) - measured
        return self._torqued(effort, len(measured))

    def _torqued(self, effort: Array | None, count: int) -> Array:
        """Angles (j,) that efforts stand for; NaN where none are reported."""
        lead = np.full(count, nan)
        if effort is None or not effort.any() or not self._scale:
            return lead
        for finger, place in self._drives:
            if finger.kp.all():
                lead[place] = self._scale * effort[place] / finger.kp
        return lead

    def pressed(self, lead: Array, effort: Array | None = None) -> Array:
        """Force (a,) of each pad along its normal that drives tell (N); NaN: not known.

        The smaller of what leads and efforts tell: a command that has not come yet is no torque.
        """
        held = self._torqued(effort, len(lead))
        by_lead = np.array([finger.force_of(lead[place]) for finger, place in self._drives])
        by_effort = np.array([finger.force_of(held[place]) for finger, place in self._drives])
        return np.where(np.isnan(by_effort), by_lead, np.minimum(by_lead, by_effort))

    def take_effort(self, lead: Array, effort: Array | None, since_s: float) -> None:
        """Learn from efforts (j,) at leads (j,) where a drive gives no more torque.

        Commands that have moved since a time (s) tell nothing: when they came to the drive is not
        known.
        """
        if effort is None or not self._scale or not self._sent:
            return
        recent = [sent for at_s, sent in self._sent if at_s >= since_s]
        moved = np.ptp(recent or [lead], axis=0)
        moved = np.maximum(moved, np.abs(lead - self._last_lead))  # damping is no gain
        self._last_lead = lead
        firm = np.abs(lead) > np.maximum(LEADING, moved / STEADY)
        ratio = np.where(firm, np.abs(effort) / np.where(firm, np.abs(lead), 1.0), np.nan)
        self._gain += LEARNING * np.fmax(ratio - self._gain, 0.0)
        full = self._full & (np.abs(lead) > LEADING)  # a small lead asks for little
        self._full = np.where(firm, ratio < FULL_RATIO * self._gain, full)

    def stop(self) -> None:
        """The next command begins at the measured posture."""
        self.limiter.stop()
        self._sent.clear()
        self._stood = None

    def command(
        self, made: GripStep, measured: Array, lead: Array, dt: float, elapsed: float, now_s: float
    ) -> Guarded:
        """Joints of the closures of a step of the law; the first command moves nothing.

        While what is held is loaded, soft drives are made stiffer: commands are shifted by
        `support` times the way that their joints have given since the load came. Nyquist: with 1 a
        drive of a damping below 0.3, with 0.5 below 0.15 may ring (delay of 35 ms, 4 to 80 rad/s).
        Where less may be sent, this yields before the law does.
        Torque caps follow the target forces. `measured` (j,) is where the joints are, `lead` (j,)
        by how much their commands lead them where they hold what this process did not grip (NaN:
        not known). `dt` is that of the step, `elapsed` the time in which the joints may move:
        since the last command (s).
        """
        first = self.limiter.last is None
        if first:
            self.limiter.start(measured + np.where(np.isfinite(lead), lead, 0.0))
        meant = np.array(self.limiter.last)
        closures, contacts, effort = made.closure, made.contact, np.full(len(meant), nan)
        forces = np.zeros(len(closures))
        np.maximum.at(forces, self.drive_of, made.target_force)
        for a, (finger, place) in enumerate(self._drives):
            on_path = self._paths[a].joints(float(closures[a]), float(contacts[a]), dt)
            if first:
                self._beside[place] = meant[place] - on_path
            meant[place] = on_path
            effort[place] = finger.caps(forces[a])
        meant += self._led_beside(measured, made.loaded, dt)
        lower, upper, wanted = self._limits.lower, self._limits.upper, meant
        ends = bool(((meant < lower) | (meant > upper)).any())
        if ends:
            wanted = meant.copy()
            for a, (finger, place) in enumerate(self._drives):
                if closures[a] > contacts[a]:
                    wanted[place] = finger.pass_on(meant[place], lower[place], upper[place])
        position, limited = self.limiter.step(wanted, measured, elapsed)
        spare = self._yielded(wanted - position) if made.loaded else 0.0
        wanted, meant = wanted - spare, meant - spare
        self._sent.append((now_s, position))
        closure = reach = closures
        if limited:
            closure = closures - self._behind(closures, contacts, wanted, position)
        if limited or ends:
            near = self.limiter.reachable(meant, measured)
            reach = closures - self._behind(closures, contacts, meant, near)
        clips = (np.abs(position - measured) >= self._clipping) | self._full & self._carries
        clipped = [bool(clips[place].any()) for _, place in self._drives]
        return Guarded(position, effort, limited, closure, reach, clipped)

    def _led_beside(self, measured: Array, loaded: bool, dt: float) -> Array:
        """Angles (j,) beside the closures' postures: what was there fades, or carries a load."""
        given = self._support * measured
        if not loaded:
            self._stood = None
        elif self._stood is None:
            self._stood = self._beside + given
        sought, time_s = (0.0, EASE_S) if self._stood is None else (self._stood - given, SUPPORT_S)
        self._beside += (1.0 - exp(-dt / time_s)) * (sought - self._beside)
        return self._beside

    def _yielded(self, cut: Array) -> Array:
        """Share of what was cut from the commands (j,) that is taken from their support."""
        spare = _between(cut, np.minimum(self._beside, 0), np.maximum(self._beside, 0))
        self._beside -= spare
        return spare

    def _behind(self, closures: Array, contacts: Array, wanted: Array, sent: Array) -> Array:
        """Shortfall of closure that each drive was sent (a,)."""
        rows = zip(self._drives, closures, contacts, strict=True)
        return np.array([f.shortfall(c, k, wanted[p], sent[p]) for (f, p), c, k in rows])


def taking_part(hand: HandDescription, wanted: Sequence[str]) -> tuple[list[str], list[str]]:
    """Sensors that take part, and for each the finger that carries it; ValueError: none does."""
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


def _path(hand: HandDescription, name: str, robot: RobotDescription | None) -> FingerPath:
    """Path of a finger: along its pad's normal where its frame is a link of a description."""
    finger, limits, place = hand.fingers[name], hand.driver.limits, hand.places(name)
    chain = None
    if robot is not None and robot.has_link(finger.frame):
        chain = robot.chain(finger.frame, finger.joints, hand.driver.tip_offset)
    return FingerPath(finger, chain, limits.lower[place], limits.upper[place])


class HandWatch:
    """Compare joint states with commands: do they stand still, jump, or come from elsewhere.

    `velocity` and `slack` (j,) are fastest motion (1/s) and motion that tells nothing; a hand has
    moved `patience_s` (s) after a command, or never will.

    Frozen are joints that are all the same to the last bit while a command went further than the
    slack: encoders of a hand that is blocked flicker, and of many joints one gives way. Two
    sources of joint states make them jump there and back, faster than any joint moves.
    """

    def __init__(
        self, joints: Sequence[str], velocity: Array, slack: Array, patience_s: float
    ) -> None:
        self._joints, self._velocity, self._slack = list(joints), velocity, slack
        self._patience_s = patience_s
        self._still = self._jump = np.full(len(self._joints), nan)
        self._taken_s = self._jumped_s = self._torn_s = -inf
        self.forget()

    def forget(self) -> None:
        """Nothing was sent to this hand."""
        self._sent = self._before = self._apart = np.full(len(self._joints), nan)
        self._led_s = inf

    def take(self, measured: Array, now_s: float) -> None:
        """Take in joint positions (j,) of a time (s)."""
        moved, since_s = measured - self._still, max(now_s - self._taken_s, 0.0)
        self._taken_s = now_s
        if not moved.any():
            return
        self._still, self._before, self._led_s = measured.copy(), self._sent, inf
        if (np.abs(moved) > self._slack + self._velocity * since_s).any():
            if now_s - self._jumped_s <= self._patience_s and moved @ self._jump < 0.0:
                self._torn_s = now_s
            self._jump, self._jumped_s = moved, now_s

    def conflicts(self, now_s: float) -> str:
        """Judge whether joint states jump there and back, in a sentence; empty: no."""
        if now_s - self._torn_s > self._patience_s:
            return ''
        worst = int(np.abs(self._jump).argmax())
        return (
            f'{self._joints[worst]} jumps there and back by {abs(self._jump[worst]):.3f}: two '
            'sources publish its joint states'
        )

    def send(self, command: Array, now_s: float) -> None:
        """Take in a command (j,) that is sent at a time (s)."""
        if isnan(self._before[0]):
            self._before = command
        self._sent = command
        self._apart = np.abs(command - self._still)
        if self._led_s == inf and (np.abs(command - self._before) > self._slack).any():
            self._led_s = now_s

    def frozen(self, now_s: float) -> str:
        """Judge whether joint states stand still while commands move, in a sentence; empty: no."""
        since_s = now_s - self._led_s
        if not since_s > self._patience_s:
            return ''
        return f'joint states are frozen ({since_s:.3f} s) while commands move'

    def strayed(self) -> str:
        """Judge whether the hand was moved by others since the last command; empty: no.

        On its way to the last command, or held back from it as before, it was not.
        """
        apart = np.abs(self._sent - self._still)
        astray = np.flatnonzero(apart - self._apart - self._slack > 0)  # none of NaN
        if not astray.size:
            return ''
        worst = astray[0]
        return (
            f'{self._joints[worst]} came back {apart[worst]:.3f} from its last command: it was '
            'moved by others'
        )
