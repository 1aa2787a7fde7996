"""Control loop of a grip: contacts and joint states to joint commands, without ROS.

Time is an argument everywhere: seconds of a clock that never jumps. The law decides closures, the
hand turns them into joints, the guard has the last word. New forces of all fingers trigger a step,
the clock where they fail to come; the time between two steps is that between their stamps.
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
    Keeping,
    Opening,
)
from tactile_ros.hands.joints import HandJoints, HandWatch, taking_part
from tactile_ros.types import GripCommand

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tactile_ros.control import GraspProgress, GripConfig, GripStep
    from tactile_ros.hands import HandDescription
    from tactile_ros.hands.kinematics import RobotDescription
    from tactile_ros.types import Array

HOLDING = (GripPhase.LOAD, GripPhase.HOLD)
EMPTY = (GraspOutcome.SLIPPED, GraspOutcome.NO_OBJECT)
MOST_PERIODS = 3.0  # a process that slept does not catch up by one large step
LEAST_SPACE = 0.5  # of the shortest time between two commands that a hand takes; frames jitter
LATE = 1.5  # periods after which nobody is waited for
# s: a loop that is a little late lacks no force, and a step of the clock would delay it further
LEAST_LATE_S = 7.5e-3
EARLY = 0.25  # of a period; frames jitter
BACK = 2.0  # periods by which a stamp lies before its time where its clock was set back
AHEAD_S = 2e-3  # a stamp may lie so far in the future: two clocks are read one after another
OLDEST_S = 1.0  # first message that may tell that clocks agree
STEP_S = 0.05  # change between wall and monotonic clock from one message to the next: a jump


@dataclass(frozen=True)
class Decision:
    """One step: the law's, the command that is sent (None: nothing), and why what was not.

    `limited`: the law or the guard changed the command. `refusal`: why the law's own was not sent.
    `ended`: the grasp that ended in this step. `lost`: why what was held after its grasp is held
    no more, in the step that finds it. Both texts are empty otherwise.
    """

    made: GripStep
    command: GripCommand | None
    limited: bool
    refusal: str
    ended: GraspProgress | None
    lost: str


class GripLoop:
    """Control loop of a hand, one step at a time; ValueError where sensors or rate do not fit it.

    `fingers` are the sensors that take part, of those that the hand carries (empty: all). Where a
    finger's frame is a link of `robot`, its pad moves along its normal.
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
        drives = list(dict.fromkeys(names))
        self._drive_of = [drives.index(name) for name in names]
        self._joints = HandJoints(hand, drives, robot)
        # so that the law knows what the guard would cut
        fastest = self._joints.fastest
        self.config = replace(config, closure_rate=min(config.closure_rate, fastest))
        sides = [hand.fingers[name].side for name in names]
        opposed = sides if {1, -1} <= set(sides) else None
        self._law = GripForce(self.config, self._drive_of, opposed)
        self._guard = self._joints.guard
        reaction = self.config.stale_age + config.dead_time + config.lag
        self._watch = HandWatch(hand.driver.joints, self._guard.slack, reaction)
        self._sequence: GraspSequence | Opening | None = None
        self._keeping = Keeping(self.config)
        self._chosen = [True] * len(self.fingers)
        count = len(self.fingers)
        # lists: one entry of an array costs more than all else that a force brings
        self._normal, self._across = [nan] * count, [nan] * count
        self._valid, self._new, self._slip = [False] * count, [False] * count, [-1] * count
        self._touched_s = [-inf] * count
        self._closure = np.full(len(drives), np.nan)
        self._measured: Array | None = None
        self._measured_s = self._stepped_s = self._sent_s = -inf
        self._least_s = LEAST_SPACE / hand.driver.fastest_hz
        self._lost_s = self._unsent_s = 0.0
        self.sent = np.full(len(hand.driver.joints), np.nan)

    def take_touch(
        self, finger: int, force: Sequence[float], valid: bool, slip: int, measured_s: float
    ) -> None:
        """Keep the force (3,) on a finger at a time (s), in its sensor frame (N)."""
        self._normal[finger], self._across[finger] = force[2], hypot(force[0], force[1])
        self._valid[finger], self._slip[finger] = valid, slip
        self._touched_s[finger], self._new[finger] = measured_s, True

    def take_joints(self, position: Array, measured_s: float) -> None:
        """Keep joint positions (j,) that were measured at a time (s)."""
        self._measured, self._measured_s = position, measured_s
        self._closure = self._joints.closures_of(position)
        self._watch.hear(position)

    @property
    def unheard(self) -> list[str]:
        """Fingers, and joint states, of which nothing has come yet."""
        missing = ['joint states'] if self._measured is None else []
        pairs = zip(self.fingers, self._touched_s, strict=True)
        return missing + [finger for finger, touched_s in pairs if touched_s == -inf]

    @property
    def is_free(self) -> bool:
        """Nothing is gripped, or nothing was sent yet."""
        over = self._law.phase == GripPhase.IDLE and self._sequence is None
        return over or bool(np.isnan(self.sent).all())

    def enable(self) -> None:
        """Commands may be sent; the first is where the joints are."""
        self._forget_hand()
        self._law.enable()

    def disable(self) -> None:
        """Nothing is sent from now on."""
        self._law.disable()
        self._forget_hand()
        self._sequence = None

    def _forget_hand(self) -> None:
        """The next command begins at the measured posture."""
        self._joints.stop()
        self._watch.forget()
        self._lost_s = self._unsent_s = 0.0

    def grasp(
        self, target_force: float, fingers: Sequence[str], timeout: float, adapt: bool
    ) -> None:
        """Close until something is held; a target of 0 N opens. ValueError: it cannot be."""
        self.admit(target_force, fingers, timeout)
        if self._law.phase == GripPhase.IDLE:
            self._forget_hand()
        if target_force == 0:
            self._law.release()
            self._sequence = Opening(self.config, timeout)
            return
        chosen = [not fingers or name in fingers for name in self.fingers]
        self._law.grasp(target_force, adapt, chosen)
        self._chosen = chosen
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
            msg = f'timeout must be 0, for grasp_time, or positive; received {timeout:g}'
            raise ValueError(msg)
        unknown = [name for name in fingers if name not in self.fingers]
        if unknown:
            msg = f'fingers must be of {", ".join(self.fingers)}; received {unknown[0]!r}'
            raise ValueError(msg)

    def cancel(self) -> None:
        """Wait for no end any more: what is held stays held, otherwise the hand opens."""
        self._sequence = None
        if self._law.phase not in (*HOLDING, GripPhase.IDLE):
            self._law.release()

    def step(
        self, now_s: float, stamp_ns: int, blocked: str = '', since: float | None = None
    ) -> Decision:
        """One control step at a time (s) of a clock that never jumps.

        `stamp_ns` is what a command carries; `blocked` says why nothing may be sent whatever the
        law says (empty: nothing is in the way); `since` is the time since the last step (s; None:
        by `now_s`).
        """
        dt = self._within(now_s - self._stepped_s if since is None else since)
        # of the frames that a queue kept back many are stepped through at once: joints are not
        self._unsent_s = min(self._unsent_s + dt, MOST_PERIODS / self.config.rate_hz)
        elapsed = max(min(self._unsent_s, now_s - self._sent_s), 0.0)
        self._stepped_s = now_s
        hindered = blocked or self._hindered(now_s, elapsed)
        made = self._law.step(self._given(now_s, hindered), dt)
        command, limited, refusal = None, made.limited, blocked or made.refusal
        if self._measured is None:
            refusal = refusal if blocked else 'no joint states of the hand have come'
        elif made.send and not hindered:
            if now_s - self._sent_s < self._least_s:
                refusal = f'the hand takes {self.hand.driver.fastest_hz:g} commands a second'
            else:
                command, guarded = self._command(made, dt, elapsed, now_s, stamp_ns)
                limited = limited or guarded
        ended, lost = self._end(made, dt, self._gone(made, hindered, now_s, dt))
        return Decision(made, command, limited, refusal or self._silent(made), ended, lost)

    def _silent(self, made: GripStep) -> str:
        """Fingers that keep their place in a hold since their force is not known; or empty."""
        if made.phase not in HOLDING:
            return ''
        forces = zip(self.fingers, self._chosen, made.force.tolist(), strict=True)
        names = [name for name, used, force in forces if used and not isfinite(force)]
        return f'the force of {", ".join(names)} is not known: it keeps its place' if names else ''

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

    def _hindered(self, now_s: float, elapsed: float) -> str:
        """Obstacle to commands, by the joint states of the hand; empty: there is none."""
        if self._measured is None or self._law.phase == GripPhase.IDLE:
            return ''
        paused = now_s - self._sent_s > self.config.stale_age
        strayed = self._watch.strayed() if paused else ''
        if strayed:
            self._lost_s = inf
            return strayed
        silent = self._is_silent(now_s) or not self.config.closure_required
        frozen = '' if silent else self._watch.frozen(now_s)
        return frozen or self._guard.refusal(self._measured, elapsed)

    def _is_silent(self, now_s: float) -> bool:
        """Joint states are missed: the law says so."""
        aged = now_s - self._measured_s > self.config.stale_age
        return aged and self.config.closure_required

    def _command(
        self, made: GripStep, dt: float, elapsed: float, now_s: float, stamp_ns: int
    ) -> tuple[GripCommand, bool]:
        """Joints of the law's closures, and whether the guard changed them."""
        forces = [0.0] * len(self._closure)
        for drive, force in zip(self._drive_of, made.target_force.tolist(), strict=True):
            forces[drive] = max(forces[drive], force)
        sent = self._joints.command(made.closure.tolist(), forces, self._measured, dt, elapsed)
        # the law goes on from what is sent, and winds nothing up
        self._law.admit(sent.closure, dt, sent.reach)
        self._watch.send(sent.position, now_s)
        self.sent, self._sent_s, self._unsent_s = sent.position, now_s, 0.0
        return GripCommand(stamp_ns, sent.position, sent.effort), sent.limited

    def _gone(self, made: GripStep, hindered: str, now_s: float, dt: float) -> str:
        """Why the hand is given up: it has failed for long, or others moved it; else empty."""
        if made.phase != GripPhase.FAULT or not (hindered or self._is_silent(now_s)):
            self._lost_s = 0.0
            return ''
        self._lost_s += dt
        return made.refusal if self._lost_s > self.config.fault_time else ''

    def _end(self, made: GripStep, dt: float, gone: str) -> tuple[GraspProgress | None, str]:
        """The grasp that this step ended, and why what was held after one is held no more."""
        grasping = self._sequence is not None
        if gone:
            self._law.abandon(gone)
            self._sequence = None
            return (GraspProgress(GraspOutcome.FAULT, gone), '') if grasping else (None, gone)
        if grasping:
            return self._progress(made, dt), ''
        lost = self._keeping.step(made, dt) if self._law.phase in HOLDING else ''
        if lost:
            self._law.release(lost)
        return None, lost

    def _progress(self, made: GripStep, dt: float) -> GraspProgress | None:
        """The end of the grasp, where this step ended it; the hand opens where nothing is held."""
        progress = self._sequence.step(made, dt)
        if progress.outcome is None:
            return None
        self._sequence = None
        self._keeping.restart()
        kept = self._law.phase in HOLDING and progress.outcome not in EMPTY
        if not kept and self._law.phase != GripPhase.IDLE:
            lost = progress.outcome == GraspOutcome.SLIPPED
            self._law.release(progress.message if lost else '')
        if progress.outcome != GraspOutcome.HELD:
            return progress
        return replace(progress, message=progress.message + self._caveats(made))

    def _caveats(self, made: GripStep) -> str:
        """Doubts about a grasp that is held: fingers without a usable force, unequal sides."""
        forces = zip(self.fingers, self._touched_s, self._chosen, made.force.tolist(), strict=True)
        blind = [(name, t_s) for name, t_s, used, x in forces if used and not isfinite(x)]
        unheard = [name for name, touched_s in blind if touched_s == -inf]
        unknown = [name for name, touched_s in blind if touched_s > -inf]
        text = f'; nothing was ever heard of {", ".join(unheard)}' if unheard else ''
        if unknown:
            text += f'; the force of {", ".join(unknown)} is not known'
        if made.disagreement > self.config.balance_high:  # false of NaN
            text += f'; the two sides disagree by {made.disagreement:.0%}: a sensor may be wrong'
        return text


class StepTrigger:
    """Trigger of control steps by the forces of the fingers, else by the clock.

    Parameters
    ----------
    period_s, silence_s : float
        Of commands; a finger that has been silent for longer is not waited for (s).
    fingers : int
        Count f.

    Attributes
    ----------
    newest_ns : int or None
        Newest stamp of what came since the last step (ns); None: there is none.

    Examples
    --------
    >>> trigger = StepTrigger(0.01, 0.015, 2)
    >>> for finger in (0, 1):
    ...     _ = trigger.take(finger, None, 5.000)
    >>> trigger.step(5.000)
    0.01
    >>> trigger.take(0, None, 5.010), trigger.take(1, None, 5.011)  # when both are there
    (False, True)
    >>> trigger.is_late(5.014), trigger.is_late(5.016)
    (False, True)
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

    def take(self, finger: int, stamp_ns: int | None, now_s: float) -> bool:
        """Note what came from a finger at `now_s`, and say whether a step is due.

        Its stamp (ns) is None where it is of another clock.
        """
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

    Clocks agree once a message comes with a stamp of the last second. From then on its stamps are
    believed, however old they say that it is: a queue that keeps messages back makes them stale. A
    stamp in the future or before the last one, or a wall clock that jumps, asks anew.

    Attributes
    ----------
    agrees : bool
        Whether the last message was dated by its stamp.
    back_s : float
        By how much its clock stepped back, while that makes its messages old (s); else 0.

    Examples
    --------
    >>> ages = StampAge()
    >>> ages.measured_s(10_000_000_000, 10_020_000_000, 5.0)  # a stamp of 20 ms ago
    4.98
    >>> ages.measured_s(10_010_000_000, 13_020_000_000, 8.0)  # believed: kept back for long
    4.99
    >>> StampAge().measured_s(0, 10_030_000_000, 5.01)  # of another clock
    5.01
    """

    def __init__(self) -> None:
        self.agrees = False
        self.back_s = 0.0
        self._ahead_s = nan
        self._last_ns = 0

    def measured_s(self, stamp_ns: int, now_ns: int, now_s: float) -> float:
        """Time (s) of the measurement on the clock that never jumps, never in the future.

        Stamp of the message (0: it has none) and time of the clock of stamps (ns); time (s) now.
        """
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
