# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Control loop of a grip: contacts and joint states to joint commands, without ROS.

Time is an argument everywhere: seconds of a clock that never jumps. The law decides closures, the
hand turns them into joints, the limiter has the last word. New forces of all fingers trigger a
step, the clock where they fail to come.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import hypot, inf, isfinite, nan, sqrt

import numpy as np

from tactile_ros.control import (
    GraspOutcome,
    GraspProgress,
    GraspSequence,
    GripConfig,
    GripForce,
    GripInput,
    GripPhase,
    GripStep,
)
from tactile_ros.control.finger import ON_SIGMAS
from tactile_ros.control.grasp_sequence import HOLDING
from tactile_ros.control.targets import shared
from tactile_ros.hands import HandDescription
from tactile_ros.hands.joints import HandJoints, HandWatch, taking_part
from tactile_ros.hands.kinematics import RobotDescription
from tactile_ros.types import Array, GripCommand

EMPTY = (GraspOutcome.SLIPPED, GraspOutcome.NO_OBJECT)
HELD_SIGMAS = 5.0  # of noise, that a finger reads at rest where it holds something
FORGIVING = 0.3  # time of a fault that is forgotten in a time without
MOST_PERIODS = 3.0  # a process that slept does not catch up by one large step
LEAST_SPACE = 0.5  # of the shortest time between two commands that a hand takes; frames jitter
LATE = 1.5  # periods after which nobody is waited for
# s: a loop that is a little late lacks no force, and a step of the clock would delay it further
LEAST_LATE_S = 7.5e-3
EARLY = 0.25  # of a period; frames jitter
LATEST = 2.5  # dead times after which a command has come to its drive, whatever was stated
BACK = 2.0  # periods by which a stamp lies before its time where its clock was set back
AHEAD_S = 2e-3  # a stamp may lie so far in the future: two clocks are read one after another
OLDEST_S = 1.0  # first message that may tell that clocks agree
UNTOUCHED = (-inf, nan, nan, False, -1, nan, True)
STEP_S = 0.05  # change between wall and monotonic clock from one message to the next: a jump


@dataclass  # frozen it costs a step 2 us
class Decision:
    """One step of the law, with the command that is sent (None: nothing).

    `limited`: the law or the limiter changed it; `refusal`: why its own was not sent; `ended`:
    the grasp that ended; `lost`: why what was held after its grasp is held no more.
    """

    made: GripStep
    command: GripCommand | None
    limited: bool
    refusal: str
    ended: GraspProgress | None
    lost: str


def along(values: Sequence[float], axis: Sequence[float]) -> float:
    """Component of values along an axis; what is not known across it (NaN) does not count.

    Examples
    --------
    >>> along((float('nan'), float('nan'), 2.0), (0.0, 0.0, 1.0))
    2.0
    """
    return sum(value * part for value, part in zip(values, axis, strict=True) if part != 0.0)


class GripLoop:
    """Control loop of a hand; ValueError where sensors or rate do not fit it.

    `fingers` are the sensors that take part (empty: all). Where a finger's frame is a link of
    `robot`, its pad moves along its normal.
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
        self.hand = hand = hand.with_tips()
        self.config = config
        self.fingers, names = taking_part(hand, fingers)
        self._joints = HandJoints(hand, names, robot)
        sides = [hand.fingers[name].side for name in names]
        opposed = sides if {1, -1} <= set(sides) else None
        plants = self._joints.plants(config)
        self.law = GripForce(config, self._joints.drive_of, opposed, plants, self.fingers)
        self._sides = opposed or [0] * len(names)
        limits, places = hand.driver.limits, [hand.places(name) for name in names]
        self._reach = [
            hand.fingers[name].reach(limits.lower[p], limits.upper[p], hand.driver.most_offset)
            for name, p in zip(names, places, strict=True)
        ]
        self._limiter = self._joints.limiter
        reaction = config.stale_age + config.dead_time + config.lag
        self._watch = HandWatch(hand.driver.joints, limits.velocity, self._limiter.slack, reaction)
        self._sequence: GraspSequence | None = None
        self._kept = GraspSequence(config)  # the last one
        # of each finger: when (s), and the columns of a GripInput from `normal` to `framed`
        self._touches = [UNTOUCHED] * len(self.fingers)
        self._new = [False] * len(self.fingers)
        self._closure = np.full(len(plants), nan)
        self._measured: Array | None = None
        self._effort: Array | None = None
        self._measured_s = self._stepped_s = self._sent_s = -inf
        self._least_s = LEAST_SPACE / hand.driver.fastest_hz
        self._lost_s = self._unsent_s = 0.0
        self._held_ns = inf  # stamp of the step from which on something is held
        self._has_moved = False
        self.sent = np.full(len(hand.driver.joints), nan)

    def take_touch(
        self,
        fingers: Sequence[int],
        force: Sequence[float],
        valid: bool,
        slip: int,
        measured_s: float,
        normal: Sequence[float] | None = None,
        covariance: Sequence[float] = (),
    ) -> None:
        """Keep the force (3,) on fingers of one sensor at a time (s), in its frame (N).

        `normal` of the contact, unit or not; None and NaN: z of the pad. `covariance` (9,) of the
        force (N^2); empty or NaN: not stated. A sensor of normal force has NaN across it.
        """
        x, y, z = force
        n = normal if normal is not None else (0.0, 0.0, 1.0)
        length = hypot(*n)
        framed = 0.0 < length < inf
        n = [part / length for part in n] if framed else (0.0, 0.0, 1.0)
        pressed = along(force, n)
        across = hypot(x - pressed * n[0], y - pressed * n[1], z - pressed * n[2])
        variance = nan
        if len(covariance):
            rows = [covariance[3 * i : 3 * i + 3] for i in range(3)]
            variance = along([along(row, n) for row in rows], n)
        sigma = sqrt(variance) if 0.0 < variance < inf else nan
        for finger in fingers:
            self._touches[finger] = (measured_s, pressed, across, valid, slip, sigma, framed)
            self._new[finger] = True

    def take_tare(self, finger: int, stamp_ns: int) -> None:
        """Tell the law that a finger was tared at a stamp (ns), if that was during the hold."""
        if stamp_ns > self._held_ns:
            self.law.tare(finger)

    def take_joints(self, position: Array, measured_s: float, effort: Array | None = None) -> None:
        """Keep joint positions, and efforts where they are reported (j,), of a time (s)."""
        before = self._measured
        self._measured, self._measured_s, self._effort = position, measured_s, effort
        # joints that are the same to the last bit were not measured anew
        self._has_moved = before is None or not np.array_equal(before, position)
        self._closure = self._joints.closures_of(position)
        self._watch.take(position, measured_s)

    def missing(self, since_s: float = -inf) -> list[str]:
        """Fingers, and joint states, of which nothing has come since a time, or ever."""
        names = ['joint states', *self.fingers]
        came_s = [self._measured_s, *(touch[0] for touch in self._touches)]
        return [name for name, time_s in zip(names, came_s, strict=True) if time_s <= since_s]

    @property
    def is_free(self) -> bool:
        """Nothing is gripped, or nothing was sent yet."""
        over = self.law.phase == GripPhase.IDLE and self._sequence is None and not self.law.holds
        return over or bool(np.isnan(self.sent).all())

    def enable(self) -> None:
        """Commands may be sent."""
        self.law.enable()

    def disable(self) -> None:
        """Nothing is sent from now on."""
        self.law.disable()
        self._sequence = None

    def grasp(
        self,
        target_force: float,
        fingers: Sequence[str],
        timeout: float,
        adapt: bool,
        forces: Sequence[float] = (),
    ) -> str:
        """Close until something is held; a target of 0 N opens. ValueError: it cannot be.

        `forces` (N) are of `fingers` (empty: of all), instead of one target. Where drives cannot
        press that hard all press a share of it; the sentence says so.
        """
        targets, chosen, beyond = self.admit(target_force, fingers, timeout, forces)
        held = self.law.holds or self._is_holding()
        if self.law.phase == GripPhase.IDLE:
            at = self._measured
            if self._watch.strayed() or (at is not None and self._limiter.refusal(at, 0.0)):
                self.law.move_away()
                held = False
            self._watch.forget()
            if not self.law.holds:  # the next command begins at the measured posture
                self._joints.stop()
                self._unsent_s = 0.0
        self._lost_s = 0.0
        if not any(targets):
            self.law.release()
            self._sequence = GraspSequence(self.config, timeout, opens=True)
            return ''
        self.law.grasp(targets, adapt, chosen, held)
        self._sequence = GraspSequence(self.config, timeout, beyond=beyond)
        return beyond

    def _is_holding(self) -> bool:
        """Judge that fingers and torques both say that something is held, as after a restart."""
        if self._measured is None or self.law.phase != GripPhase.IDLE:
            return False
        pressed = self._joints.pressed(self._lead())
        supported = [
            finger.zero > HELD_SIGMAS * self.config.force_noise
            and finger.supported(float(pressed[drive]))
            for finger, drive in zip(self.law.fingers, self._joints.drive_of, strict=True)
        ]
        wanted = {side for side in self._sides if side} or {0}
        return {s for s, one in zip(self._sides, supported, strict=True) if one} >= wanted

    def admit(
        self,
        target_force: float,
        fingers: Sequence[str],
        timeout: float,
        forces: Sequence[float] = (),
    ) -> tuple[list[float], list[bool], str]:
        """Targets (f,) (N) that drives can press, who takes part (f,), and what is beyond them.

        Nothing is, where the sentence is empty. ValueError of one sentence: it cannot be.
        """
        low, high = ON_SIGMAS * self.config.force_noise, self.config.force_high
        wanted, named = list(forces) or [target_force], list(fingers) or self.fingers
        wrong = [force for force in wanted if not low < force <= high]
        if wrong and wanted != [0.0]:
            msg = (
                f'target_force must be 0, which opens, or above {low:g} and at most {high:g} N; '
                f'received {wrong[0]:g}'
            )
            raise ValueError(msg)
        if len(forces) not in (0, len(named)):
            msg = f'forces must be one for each of {", ".join(named)}; received {len(forces)}'
            raise ValueError(msg)
        GraspSequence(self.config, timeout)
        unknown = [name for name in fingers if name not in self.fingers]
        if unknown:
            msg = f'fingers must be of {", ".join(self.fingers)}; received {unknown[0]!r}'
            raise ValueError(msg)
        each = dict(zip(named, wanted, strict=True)) if len(forces) else {}
        targets = [each.get(name, max(wanted)) for name in self.fingers]
        used = [not fingers or name in fingers for name in self.fingers]
        asked = shared(targets, self._sides, used)
        short = [i for i, reach in enumerate(self._reach) if asked[i] > reach]
        if not short:
            return targets, used, ''
        share = min(self._reach[i] / asked[i] for i in short)
        weak = ', '.join(
            f'{self.fingers[i]} {self._reach[i]:.2f} of {asked[i]:.2f} N' for i in short
        )
        beyond = (
            f'the drives of this hand cannot press that hard ({weak}): it presses '
            f'{share * max(targets):.2f} N at most'
        )
        targets = [share * target for target in targets]
        if min(target for target, use in zip(targets, used, strict=True) if use) <= low:
            raise ValueError(beyond)
        return targets, used, beyond

    def cancel(self) -> None:
        """Wait for no end any more: what is held stays held, otherwise the hand opens."""
        self._kept, self._sequence = self._sequence or self._kept, None
        if self.law.phase not in (*HOLDING, GripPhase.IDLE):
            self.law.release()

    def step(
        self, now_s: float, stamp_ns: int, blocked: str = '', since: float | None = None
    ) -> Decision:
        """One control step at a time (s); a command carries `stamp_ns`.

        `blocked`: why nothing may be sent whatever the law says, or empty; `since`: the time since
        the last step (s; None: by `now_s`).
        """
        dt = self._within(now_s - self._stepped_s if since is None else since)
        # of the frames that a queue kept back many are stepped through at once: joints are not
        self._unsent_s = min(self._unsent_s + dt, MOST_PERIODS / self.config.rate_hz)
        elapsed = max(min(self._unsent_s, now_s - self._sent_s), 0.0)
        # what waited in a queue is no course of time for joints
        self._has_moved = self._has_moved and now_s - self._stepped_s > 0.5 * dt
        self._stepped_s = now_s
        hindered = blocked or self._hindered(now_s, elapsed)
        lead = self._lead()
        if self._sent_s > -inf:
            came_s = now_s - LATEST * self.config.dead_time
            self._joints.take_effort(lead, self._effort, came_s)
        made = self.law.step(self._given(now_s, hindered, lead), dt)
        self._held_ns = min(self._held_ns, stamp_ns) if self.law.phase in HOLDING else inf
        command, limited, refusal = None, made.limited, blocked or made.refusal
        if self._measured is None:
            refusal = refusal if blocked else 'no joint states of the hand have come'
        elif made.send and not hindered:
            if now_s - self._sent_s < self._least_s:
                refusal = f'the hand takes {self.hand.driver.fastest_hz:g} commands a second'
            else:
                command, guarded = self._command(made, lead, dt, elapsed, now_s, stamp_ns)
                limited = limited or guarded
        ended, lost = self._end(made, dt, self._gone(made, hindered, now_s, dt))
        return Decision(made, command, limited, refusal or made.warning, ended, lost)

    def _within(self, since: float) -> float:
        period = 1.0 / self.config.rate_hz
        most = MOST_PERIODS * period if isfinite(since) else period
        return min(max(since, 0.1 * period), most)

    def _lead(self) -> Array:
        """Angles (j,) by which the commands lead the joints; NaN: not known."""
        if self._measured is None:
            return np.full(len(self.sent), nan)
        return self._joints.lead(
            self._measured, self._effort, self._measured_s, self.config.dead_time
        )

    def _given(self, now_s: float, blocked: str, lead: Array) -> GripInput:
        new, self._new = self._new, [False] * len(self._new)
        pressed = np.full(len(self._closure), nan)
        if self._has_moved:  # old joints tell no force
            pressed = self._joints.pressed(lead, self._effort)
        self._has_moved = False
        columns = map(np.array, zip(*self._touches, strict=True))
        came_s, normal, across, valid, slip, sigma, framed = columns
        return GripInput(
            normal, across, valid, slip, now_s - came_s, self._closure, now_s - self._measured_s,
            np.array(new), blocked, sigma, framed, pressed,
        )  # fmt: skip

    def _hindered(self, now_s: float, elapsed: float) -> str:
        """Obstacle to commands, by the joint states of the hand; empty: there is none."""
        if self._measured is None or self.law.phase == GripPhase.IDLE:
            return ''
        conflict = self._watch.conflicts(now_s)
        if conflict:
            return conflict
        paused = now_s - self._sent_s > self.config.stale_age
        strayed = self._watch.strayed() if paused else ''
        if strayed:
            self._lost_s = inf
            return strayed
        frozen = '' if self._is_silent(now_s) else self._watch.frozen(now_s)
        return frozen or self._limiter.refusal(self._measured, elapsed)

    def _is_silent(self, now_s: float) -> bool:
        return now_s - self._measured_s > self.config.stale_age

    def _command(
        self, made: GripStep, lead: Array, dt: float, elapsed: float, now_s: float, stamp_ns: int
    ) -> tuple[GripCommand, bool]:
        """Joints of the law's closures, and whether the limiter changed them."""
        lead = lead if self.law.phase in HOLDING else np.full(len(lead), nan)
        sent = self._joints.command(made, self._measured, lead, dt, elapsed, now_s)
        # the law goes on from what is sent, and winds nothing up
        self.law.admit(sent.closure, dt, sent.reach, sent.clipped)
        self._watch.send(sent.position, now_s)
        self.sent, self._sent_s, self._unsent_s = sent.position, now_s, 0.0
        return GripCommand(stamp_ns, sent.position, sent.effort), sent.limited

    def _gone(self, made: GripStep, hindered: str, now_s: float, dt: float) -> str:
        """Reason why the hand is given up: it fails for long, or others moved it; else empty."""
        if made.phase != GripPhase.FAULT or not (hindered or self._is_silent(now_s)):
            self._lost_s = max(self._lost_s - FORGIVING * dt, 0.0)
            return ''
        self._lost_s += dt
        return made.refusal if self._lost_s > self.config.fault_time else ''

    def _end(self, made: GripStep, dt: float, gone: str) -> tuple[GraspProgress | None, str]:
        """The grasp that this step ended, and why what was held after one is held no more."""
        grasping = self._sequence is not None
        if gone:
            moved = self._lost_s == inf
            self.law.abandon(gone)
            if moved:
                self.law.move_away()
                self.law.abandon(gone)
            self._sequence = None
            return (GraspProgress(GraspOutcome.FAULT, gone), '') if grasping else (None, gone)
        if grasping:
            return self._progress(made, dt), ''
        lost = self._kept.judge(made, dt) if self.law.phase in HOLDING else ''
        if lost:
            self.law.release(lost)
        return None, lost

    def _progress(self, made: GripStep, dt: float) -> GraspProgress | None:
        progress = self._sequence.step(made, dt)
        if progress.outcome is None:
            return None
        self._kept, self._sequence = self._sequence, None
        short = self.law.shortfalls()
        if made.fault:
            self.law.abandon(made.fault)
            return progress
        kept = self.law.phase in HOLDING and progress.outcome not in EMPTY
        if not kept and self.law.phase != GripPhase.IDLE:
            lost = progress.outcome == GraspOutcome.SLIPPED
            self.law.release(progress.message if lost else '')
        if short and progress.outcome in (GraspOutcome.HELD, GraspOutcome.TIMEOUT):
            return replace(progress, message=f'{progress.message}: {"; ".join(short)}')
        return progress


class StepTrigger:
    """Trigger of control steps by the forces of the fingers, else by the clock.

    A finger that has been silent for `silence_s` is not waited for. `newest_ns`: newest stamp of
    what came since the last step, if any.
    """

    def __init__(self, period_s: float, silence_s: float, fingers: int) -> None:
        self._period_s, self._silence_s = period_s, silence_s
        self._period_ns = round(1e9 * period_s)
        self._came_s = [-inf] * fingers
        self._new = [False] * fingers
        self.newest_ns: int | None = None
        self._stepped_ns: int | None = None
        self._stepped_s = -inf
        self._due_ns = 0

    def take(self, fingers: Sequence[int], stamp_ns: int | None, now_s: float) -> bool:
        """Note what came from fingers, with its stamp if it is of this clock; True: step now."""
        for finger in fingers:
            self._came_s[finger], self._new[finger] = now_s, True
        newest = self.newest_ns
        if stamp_ns is not None and (newest is None or stamp_ns > newest):
            self.newest_ns = stamp_ns
        return self._is_complete(now_s) and self._is_due(now_s)

    def _is_complete(self, now_s: float) -> bool:
        """Every finger that is not silent has brought a new force."""
        if all(self._new):
            return True
        pairs = zip(self._new, self._came_s, strict=True)
        return all(new or now_s - came_s > self._silence_s for new, came_s in pairs)

    def _is_due(self, now_s: float) -> bool:
        """A period has passed since the last step, but for the jitter of frames."""
        if self.newest_ns is None or self._stepped_ns is None:
            return now_s - self._stepped_s >= (1.0 - EARLY) * self._period_s
        ahead = (self.newest_ns - self._due_ns) / self._period_ns
        return ahead >= -EARLY or ahead < -BACK

    def is_late(self, now_s: float) -> bool:
        """A step is due although not all fingers have brought a new force."""
        return now_s - self._stepped_s >= max(LATE * self._period_s, LEAST_LATE_S)

    def step(self, now_s: float) -> float:
        """Begin a step; the time since the last (s), positive where the clocks are sound."""
        newest, last = self.newest_ns, self._stepped_ns
        by_stamp = newest is not None and last is not None and newest > last
        since = 1e-9 * (newest - last) if by_stamp else now_s - self._stepped_s
        if newest is not None:
            late = newest - self._due_ns
            self._due_ns = self._due_ns if abs(late) < self._period_ns else newest
            self._due_ns += self._period_ns
        self._stepped_ns, self.newest_ns = newest, None
        self._stepped_s = now_s
        self._new = [False] * len(self._new)
        return since if isfinite(since) else self._period_s


class StampAge:
    """Ages of one stream, from its stamps where clocks agree and from its arrival otherwise.

    Clocks agree once a message comes with a stamp of the last second; from then on its stamps are
    believed, however old: a queue that keeps messages back makes them stale. A stamp in the future
    or before the last one, or a wall clock that jumps, asks anew. `back_s`: by how much its clock
    stepped back, while that makes its messages old (s).
    """

    def __init__(self) -> None:
        self.agrees = False
        self.back_s = 0.0
        self._ahead_s = nan
        self._last_ns = 0

    def measured_s(self, stamp_ns: int, now_ns: int, now_s: float) -> float:
        """Time (s) of the measurement on the clock that never jumps, never in the future."""
        delay = 1e-9 * (now_ns - stamp_ns)
        ahead = 1e-9 * now_ns - now_s
        jumped = abs(ahead - self._ahead_s) > STEP_S
        self._ahead_s = ahead
        back_s = 1e-9 * (self._last_ns - stamp_ns)
        self._last_ns = stamp_ns
        if min(back_s, delay) > STEP_S:
            self.back_s = back_s
        elif delay < self.back_s - STEP_S:
            self.back_s = 0.0
        if jumped or not self.agrees or delay < -AHEAD_S or back_s > STEP_S:
            self.agrees = -AHEAD_S <= delay <= OLDEST_S
        return now_s - max(delay, 0.0) if self.agrees else now_s
