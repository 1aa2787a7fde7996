# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Grip-force law: close, touch, load, hold, release; safe when an input cannot be trusted.

Plant: a position drive against an object. After a dead time L the force of a pad follows the
command of its drive with a time constant T and the gain K (N per closure). K of a drive that gives
way is at most its own, K = (lever . closing) / sum(lever^2 / kp), whatever the object; between the
limits of `Drive` it is learned from force over the command as the plant delays it.

Regulator: PI with the SIMC rules of that plant, Kc = T / (K (Tc + L)) and Ti = min(T, 4 (Tc + L)),
so that one setting serves every stiffness and slow hands get slow loops; back-calculation against
windup, also from what joints, torque clips and rates let through. An approach goes no further in
the time that the hand needs to react than the stiffest object yields under `IMPACT` asked forces.

Fingers that oppose each other on a free object would push it to the weaker sensor: the part of
their errors that pushes counts by `NET` until all are settled, for `NET_TIME` at most; afterwards
only errors that leave the object where it is are regulated.

Sources: S. Skogestad, Simple analytic rules for model reduction and PID controller tuning, J.
Process Control 13 (2003) 291, Table 1; K. J. Astrom and T. Hagglund, Advanced PID Control (2006),
sec. 3.5.
"""

from __future__ import annotations

from math import inf, isfinite, nan
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.control.config import Drive
from tactile_ros.control.finger import (
    CLOSED,
    ON_SIGMAS,
    SAME,
    ZERO_TIME,
    DriveLaw,
    Finger,
    bounded,
)
from tactile_ros.control.grasp_sequence import GRASPING, HOLDING, GripInput, GripPhase, GripStep
from tactile_ros.control.targets import GripTargets

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from tactile_ros.control.config import GripConfig
    from tactile_ros.types import Array

IMPACT = 2.0  # asked forces that an approach may meet in the time to react
SLOWEST = 0.5  # share of its speed that an approach keeps, however far its drive is behind
OPENING = 0.5  # 1/s, of a release
SAFE_OPENING = 0.1  # 1/s, as the safe action
WAITING, WAITING_SHARE = 2.0, 0.7  # levels of contact, of the target: force that waits
TOUCH_TIME = 1.0  # s, longest wait for the other fingers
SETTLED, SETTLED_SIGMAS, SETTLED_TIME, AVERAGED = 0.07, 0.5, 0.3, 0.08  # of a target; s
MOST_ERROR = 0.1  # of the target: a held finger has no more
NET, NET_TIME = 0.5, 3.0  # share of errors that push an object, s of a load
STRONGEST = 1.2  # targets that the strongest reading may have while sides disagree
RANGE = 3.0  # largest targets beyond which a reading is none
LATE = 1.5  # periods without a new force: one may be missed or cross with a step


NOT_ASKED = 'no grasp was asked for'


class GripForce:
    """Close f fingers on an object by a drives, and hold it at a force.

    Parameters
    ----------
    config : GripConfig
        Gains and limits.
    drives : sequence of int, length f
        Which drive, from 0 without gaps, moves each finger.
    sides : sequence of int, length f, or None
        +1 and -1 for fingers that oppose each other (thumb and others), 0 for those that oppose
        none; None: not known.
    plants : sequence of Drive, length a, or None
        Of the drives; None: as the config says.
    names : sequence of str, length f, or None
        Of the fingers, for sentences.

    Raises
    ------
    ValueError
        If there is no finger, drives have gaps, or sides are others than -1, 0, 1.

    Examples
    --------
    >>> from tactile_ros.control.config import GripConfig
    >>> law = GripForce(GripConfig(), drives=(0, 1), sides=(1, -1))
    >>> blank = np.zeros(2)
    >>> given = GripInput(blank, blank, blank == 0, blank.astype(np.int8), blank, blank, 0.0)
    >>> law.step(given, 0.01).refusal
    'not active'
    >>> law.enable()
    >>> law.grasp(2.0, held=True)
    >>> law.step(given, 0.01).phase.name
    'LOAD'
    """

    def __init__(
        self,
        config: GripConfig,
        drives: Sequence[int],
        sides: Sequence[int] | None = None,
        plants: Sequence[Drive] | None = None,
        names: Sequence[str] | None = None,
    ) -> None:
        self.config = config
        self._drives = [int(drive) for drive in drives]
        count = len(self._drives)
        self._sides = [0] * count if sides is None else [int(side) for side in sides]
        refuse_order(self._drives, self._sides)
        self.names = [f'finger {i}' for i in range(count)] if names is None else list(names)
        plain = Drive(config.stiffness_low, config.stiffness_high)
        each = [plain] * (max(self._drives) + 1) if plants is None else list(plants)
        self.laws = [DriveLaw(config, drive) for drive in each]
        self.fingers = [Finger(config, each[drive]) for drive in self._drives]
        self._of = [
            [i for i, drive in enumerate(self._drives) if drive == a] for a in range(len(each))
        ]
        self._targets = GripTargets(config, self._sides)
        self._opposed = {-1, 1} <= set(self._sides)
        self._used = [True] * count
        self._active = self._started = False
        self._age = inf
        self._forget()

    def _forget(self) -> None:
        """Nothing is held: another object may come."""
        self.phase = GripPhase.IDLE
        self._waited = self._calm = self._unseen = self._since = 0.0
        self._has_settled = False
        self._trusted, self._held = True, False
        self._idle, self._opens, self.fault = NOT_ASKED, '', ''
        self._has_begun = False
        self._targets.restart()
        for finger in self.fingers:
            finger.forget()
        for law in self.laws:
            law.stiffness.reset()

    @property
    def holds(self) -> bool:
        """Judge whether something is held, or was when the law was stopped."""
        return self.phase in HOLDING or (self.phase == GripPhase.IDLE and self._held)

    def enable(self) -> None:
        """Allow commands."""
        self._active = True

    def disable(self) -> None:
        """Forbid commands; what was sent last holds."""
        self._rest(NOT_ASKED)
        self._active = False

    def abandon(self, why: str) -> None:
        """Send nothing more until the next grasp, and say why: the hand cannot be trusted."""
        self._rest(f'{why}; a new grasp is needed')

    def _rest(self, why: str) -> None:
        """Stop where the hand is; what it holds is remembered, since posture holds it."""
        held = self.holds or (self.fault != '' and self.phase != GripPhase.IDLE)
        self.phase, self._idle, self._held = GripPhase.IDLE, why, held
        if not held:
            self._forget()
            self._idle = why

    def move_away(self) -> None:
        """Forget posture and object: the hand was moved by others."""
        self._forget()
        self._started = False

    def grasp(
        self,
        target_force: npt.ArrayLike,
        adapt: bool = True,
        fingers: Sequence[bool] | None = None,
        held: bool = False,
    ) -> None:
        """Ask for a force; an object that is held already is loaded or relieved to it.

        Parameters
        ----------
        target_force : array_like, shape () or (f,)
            Along the normal, of each finger (N); shared over the sides.
        adapt : bool
            Whether slip and load may raise it.
        fingers : sequence of bool, length f, or None
            Which take part; None: all.
        held : bool
            The hand holds something already, though this law does not know.

        Raises
        ------
        ValueError
            If the law is not active, no finger takes part, or a force is out of its range.
        """
        count = len(self._drives)
        used = [True] * count if fingers is None else [bool(use) for use in fingers]
        targets = np.broadcast_to(np.asarray(target_force, np.float64), (count,)).tolist()
        if not self._active:
            msg = 'grasp must follow enable; the law is not active'
            raise ValueError(msg)
        refuse_goal(self.config, targets, used)
        held = held or self.holds
        if self.phase == GripPhase.IDLE and not self._held:
            self._started = False
        if not held:
            self._forget()
        self._used = used
        self._targets.ask(targets, used, adapt)
        self.phase = GripPhase.LOAD if held else GripPhase.CLOSE
        self._held, self._calm, self.fault = held, 0.0, ''
        self._since, self._has_settled = 0.0, False

    def release(self, why: str = '') -> None:
        """Open; `refusal` says `why` from now until the next grasp, where something went wrong."""
        if self._active:
            if self.phase == GripPhase.IDLE and not self._held:
                self._started = False
            self.phase, self._opens, self.fault = GripPhase.RELEASE, why, ''

    def step(self, given: GripInput, dt: float) -> GripStep:
        """Decide the next command from the newest inputs, a time dt (s) after the last.

        Returns
        -------
        GripStep
            Command inside limits and rate, or why there is none.

        Raises
        ------
        ValueError
            If a shape differs from the fingers and drives.
        """
        given.refuse_misfit(len(self._drives), len(self.laws))
        refusal = self._refusal(given, dt)
        if not self._active or self.phase == GripPhase.IDLE:
            self._rest_fingers(given, dt)
            return self._made(False, refusal)
        if refusal:
            return self._safe(given, refusal, dt)
        if not self._trusted:
            self._trust()
        if self.phase == GripPhase.RELEASE:
            return self._open(dt)
        self._sense(given, dt)
        if self.phase != GripPhase.CLOSE or self._has_zero(given):
            self._decide(given, dt)
        return self._made(not self.fault, self.fault)

    def admit(self, sent: Array, dt: float, reach: Array, clipped: Sequence[bool]) -> None:
        """Go on from closures (a,) that were sent where they are not the last command.

        `dt` is that of the last step (s), `reach` (a,) as far as the drives would come in time;
        `clipped` are those whose torque is as large as they allow.
        """
        rows = zip(self.laws, sent.tolist(), reach.tolist(), clipped, strict=True)
        for law, made, far, is_full in rows:
            law.stop = 'its drive gives its largest torque' if is_full else ''
            if far < law.command - SAME:
                law.stop = 'its joints are at the end of their stroke'
            if abs(made - law.command) > SAME:
                law.yield_to(made, dt)

    def tare(self, finger: int) -> None:
        """Stop where the hand is if a finger that holds was tared: its force is none now."""
        if self.phase in HOLDING and self._used[finger]:
            self.fault = (
                f'{self.names[finger]} was tared while it holds: its sensor cannot be trusted'
            )

    def shortfalls(self) -> list[str]:
        """Fingers that take part and do not press what they are asked for, each with why."""
        found = []
        for i, (name, finger) in enumerate(zip(self.names, self.fingers, strict=True)):
            target, law = self._targets.now[i], self.laws[self._drives[i]]
            if not self._used[i]:
                continue
            if not finger.good:
                found.append(f'{name} {finger.why.split(" (")[0]}')
            elif not finger.touching:
                found.append(f'{name} touches nothing')
            elif abs(self._error(self._drives[i])) > MOST_ERROR * target + finger.sigma:
                why = f': {law.stop}' if law.stop and finger.normal < target else ''
                found.append(f'{name} presses {finger.normal:.2f} of {target:.2f} N{why}')
        return found

    # inputs ------------------------------------------------------------------------------------

    def _refusal(self, given: GripInput, dt: float) -> str:
        """Reason why nothing can be commanded in this step; empty if something can."""
        if not self._active:
            return 'not active'
        if self.phase == GripPhase.IDLE:
            return self._idle
        if self.fault:
            return self.fault
        why = refuse_step(dt, self.config.stale_age)
        if self.phase != GripPhase.RELEASE:
            why = why or self._judge(given)
        why = why or self._hand_refusal(given)
        if not why and not self._started:
            self._start(given)
        return why

    def _judge(self, given: GripInput) -> str:
        """Judge the forces; the reason why too few can be used, or empty."""
        limit, most = self.config.stale_age, RANGE * self.config.force_high
        rows = zip(given.normal.tolist(), given.age.tolist(), given.valid.tolist(), strict=True)
        self._age = 0.0
        for finger, (force, age, valid) in zip(self.fingers, rows, strict=True):
            finger.why = ''
            if not 0.0 <= age <= limit:
                finger.why = f'is stale ({age:.3f} s)' if age < inf else 'was never heard'
            elif not valid:
                finger.why = 'says that it is not valid'
            elif not isfinite(force):
                finger.why = 'gives a force that is not a number'
            elif abs(force) > most:
                finger.why = f'reads {force:.3g} N, which no finger can'
            else:
                self._age = max(self._age, age)
        pairs = zip(self.names, self.fingers, self._used, strict=True)
        used = [(name, finger) for name, finger, use in pairs if use]
        good = sum(finger.good for _, finger in used)
        if good and (good >= self.config.fewest_fingers or good == len(used)):
            return ''
        self._age = self._age if good else inf
        name, worst = next((name, finger) for name, finger in used if not finger.good)
        return given.blocked or f'{name} {worst.why}'

    def _hand_refusal(self, given: GripInput) -> str:
        """Reason why the hand itself cannot be trusted; empty if it can."""
        if given.blocked:
            return given.blocked
        if not 0.0 <= given.closure_age <= self.config.stale_age:
            return f'joint states are stale ({given.closure_age:.3f} s)'
        for i, closure in enumerate(given.closure.tolist()):
            if not isfinite(closure):
                return f'closure of drive {i} is not a number'
        self._age = max(self._age, given.closure_age) if isfinite(self._age) else given.closure_age
        return ''

    def _start(self, given: GripInput) -> None:
        """Begin where the drives are, pressing with what they press now."""
        pressed = np.full(len(self.laws), nan) if given.pressed is None else given.pressed
        for law, closure, force in zip(
            self.laws, given.closure.tolist(), pressed.tolist(), strict=True
        ):
            if self._held and law.drive.is_soft and force > 0.0:
                law.seat(closure + force / law.drive.own, closure)
            else:
                law.seat(closure, closure if self._held else nan)
        self._started = True

    def _new(self, given: GripInput) -> list[bool]:
        """Fingers whose usable force is new."""
        new = [True] * len(self.fingers) if given.new is None else given.new.tolist()
        return [is_new and finger.good for is_new, finger in zip(new, self.fingers, strict=True)]

    def _rest_fingers(self, given: GripInput, dt: float) -> None:
        """Learn the zero of fingers at rest."""
        if refuse_step(dt, self.config.stale_age):
            return
        self._judge(given)
        for finger, force, new in zip(
            self.fingers, given.normal.tolist(), self._new(given), strict=True
        ):
            finger.waited += dt
            if new:
                finger.witness.rest(force, min(finger.waited, self.config.stale_age))
            elif not finger.good:
                finger.witness.forget_zero()
            if new:
                finger.waited = 0.0

    def _sense(self, given: GripInput, dt: float) -> None:
        """Take in the forces; an approach ends where a finger touches."""
        before = [bool(self._on(drive)) for drive in range(len(self.laws))]
        noise = [nan] * len(self.fingers) if given.sigma is None else given.sigma.tolist()
        rows = zip(
            self.fingers, self._new(given), given.normal.tolist(), given.tangential.tolist(),
            given.slip.tolist(), noise, self._targets.asked, strict=True,
        )  # fmt: skip
        for finger, new, normal, across, said, sigma, asked in rows:
            finger.waited += dt
            if new:
                finger.take(normal, across, said, sigma, asked, finger.waited)
                finger.waited = 0.0
            elif not finger.good:
                finger.slip.blind()
        if given.pressed is not None:
            self._contradict(given, dt)
        for drive, law in enumerate(self.laws):
            law.let_time_pass(dt)
            touches = self._on(drive) and not before[drive]
            if touches and self.phase in (GripPhase.CLOSE, GripPhase.TOUCH):
                law.meet(float(given.closure[drive]))

    def _on(self, drive: int) -> list[int]:
        """Touching fingers of a drive whose force is known."""
        return [i for i in self._of[drive] if self.fingers[i].touching and self.fingers[i].good]

    def _is_late(self, finger: Finger) -> bool:
        """Judge whether a finger that is known has given no force for longer than its period."""
        return finger.good and finger.waited > LATE * self.config.slowest_period

    def _has_zero(self, given: GripInput) -> bool:
        """Judge the zeros of fingers at rest; one that reads a force is named."""
        asked = max(self._targets.asked)
        noise = [nan] * len(self.fingers) if given.sigma is None else given.sigma.tolist()
        if self._has_begun:
            return True
        for i, finger in enumerate(self.fingers):
            witness = finger.witness
            if not (self._used[i] and finger.good):
                continue
            if witness.zero_time < ZERO_TIME:
                witness.rest(float(given.normal[i]), self.config.slowest_period)
                return False
            sigma = noise[i] if noise[i] > 0.0 else self.config.force_noise
            pressed = nan if given.pressed is None else float(given.pressed[self._drives[i]])
            if witness.biased(sigma, asked) and not witness.supports(pressed):
                self.fault = (
                    f'{self.names[i]} reads {witness.zero:.2f} N before closing: tare it while '
                    'nothing touches it'
                )
                return False
        self._has_begun = True
        return True

    def _contradict(self, given: GripInput, dt: float) -> None:
        """Ask the witnesses of the fingers that take part."""
        new = self._new(given)
        for i, finger in enumerate(self.fingers):
            law = self.laws[self._drives[i]]
            if not (self._used[i] and finger.good) or len(self._of[self._drives[i]]) > 1:
                continue
            told = float(given.pressed[self._drives[i]])  # type: ignore[index]
            pressed = told - law.trailing * law.drive.own
            if finger.touching:
                target, raw = self._targets.now[i], float(given.normal[i])
                why = finger.witness.press(raw, new[i], pressed, target, law.command, dt)
            else:
                asked, moved = self._targets.asked[i], float(given.closure[self._drives[i]])
                ways = law.command, moved
                why = finger.witness.approach(finger.normal, pressed, asked, ways, dt)
            if why and not self.fault:
                self.fault = f'{self.names[i]} {why}: its sensor cannot be trusted'

    # decisions ---------------------------------------------------------------------------------

    def _decide(self, given: GripInput, dt: float) -> None:
        """Phase, targets and commands; all stay while a finger is late."""
        if any(self._is_late(finger) for finger in self.fingers):
            for law in self.laws:
                law.stay()
            return
        if self.phase == GripPhase.LOAD and not any(self._targets.now):  # held from elsewhere
            self._targets.now = [f.normal if f.touching else 0.0 for f in self.fingers]
        self._advance(given, dt)
        self._drive(given, dt)

    def _advance(self, given: GripInput, dt: float) -> None:
        """Phase and targets."""
        touching = [finger.touching for finger in self.fingers]
        if self.phase == GripPhase.CLOSE and any(map(self._on, range(len(self.laws)))):
            self.phase, self._waited = GripPhase.TOUCH, 0.0
        if self.phase == GripPhase.TOUCH:
            pairs = zip(self.fingers, self._targets.asked, strict=True)
            levels = [max(min(WAITING * f.on, WAITING_SHARE * t), f.on) for f, t in pairs]
            self._targets.touch(levels)
            self._waited += dt
            if self._gathered():
                self.phase = GripPhase.LOAD
        if self.phase in HOLDING:
            self._since += dt
            self._has_settled |= self._calm >= SETTLED_TIME
            self._targets.share(touching)
            framed = [True] * len(touching) if given.framed is None else given.framed.tolist()
            forces = [f.normal if f.touching and f.good else nan for f in self.fingers]
            full = any(law.stop for law in self.laws)
            slips = [finger.slip for finger in self.fingers]
            reached = self._targets.grow(slips, framed, forces, full, dt)
            if self.phase == GripPhase.LOAD and reached:
                self.phase = GripPhase.HOLD

    def _gathered(self) -> bool:
        """Judge whether all fingers touch, or were waited for and both sides do."""
        felt = [i for i, use in enumerate(self._used) if use and self.fingers[i].good]
        if all(self.fingers[i].touching for i in felt):
            return True
        sides = {self._sides[i] for i in felt}
        both = all(
            any(self.fingers[i].touching for i in felt if self._sides[i] == side) for side in sides
        )
        return self._waited > TOUCH_TIME and both

    def _drive(self, given: GripInput, dt: float) -> None:
        """Commands: approach what nothing touches, regulate what touches."""
        closures = given.closure.tolist()
        on = [self._on(drive) for drive in range(len(self.laws))]
        complete = all(self.fingers[i].unspent for fingers in on for i in fingers)
        for drive, touching in enumerate(on):
            law = self.laws[drive]
            if not touching:
                law.move(self._approach(drive, closures[drive]), dt)
            elif not complete:
                law.follow(dt)
        if not complete:
            self._unseen += dt
            return
        errors = self._errors()
        calm = self.phase == GripPhase.HOLD and any(on)
        # an object that one side pushes away feels soft: that is not its stiffness
        sides = {self._sides[i] for fingers in on for i in fingers}
        gripped = sides >= ({-1, 1} if self._opposed else set())
        for drive, touching in enumerate(on):
            law = self.laws[drive]
            if not touching:
                calm = calm and self._is_shut(drive)
                continue
            error = sum(errors[i] for i in touching) / len(touching)
            force = sum(self.fingers[i].normal for i in touching) / len(touching)
            target = sum(self._targets.now[i] for i in touching) / len(touching)
            law.touched += dt + self._unseen
            if law.drive.is_soft and law.touched > law.reaction and gripped:
                law.stiffness.step(law.free, force, self.fingers[touching[0]].sigma)
            elif not law.drive.is_soft and gripped and isfinite(closures[drive]):
                law.stiffness.step(closures[drive], force, self.fingers[touching[0]].sigma)
            law.regulate(target, target - error, dt, self._unseen)
            calm = calm and self._is_settled(drive, touching, dt)
        self._calm = self._calm + dt + self._unseen if calm else 0.0
        self._unseen = 0.0
        for finger in self.fingers:
            finger.unspent = False

    def _is_shut(self, drive: int) -> bool:
        """Judge whether a drive can close no further, also where nothing is felt of it."""
        law = self.laws[drive]
        feels = any(self.fingers[i].good and self._used[i] for i in self._of[drive])
        return not feels or law.stop != '' or law.command >= CLOSED

    def _is_settled(self, drive: int, touching: list[int], dt: float) -> bool:
        """Judge whether the mean error of a drive is small, and no limit holds it back."""
        error = 0.0
        for i in touching:
            finger, target = self.fingers[i], self._targets.now[i]
            last = finger.error if isfinite(finger.error) else target - finger.normal
            finger.error = last + min(dt / AVERAGED, 1.0) * (target - finger.normal - last)
            error += finger.error / len(touching)
        target = sum(self._targets.now[i] for i in touching) / len(touching)
        sigma = max(self.fingers[i].sigma for i in touching)
        limited = self.laws[drive].stop != '' and error > 0.5 * SETTLED * target
        return not limited and abs(error) <= SETTLED * target + SETTLED_SIGMAS * sigma

    def _error(self, drive: int) -> float:
        """Mean error of force of a drive's touching fingers (N)."""
        on = self._on(drive)
        pairs = [(self._targets.now[i], self.fingers[i].normal) for i in on]
        return sum(target - force for target, force in pairs) / max(len(on), 1)

    def _errors(self) -> list[float]:
        """Errors of touching fingers (N), without what would push a free object further."""
        on = [f.touching and f.good for f in self.fingers]
        targets = self._targets.now
        errors = [
            target - finger.normal if touching else 0.0
            for target, finger, touching in zip(targets, self.fingers, on, strict=True)
        ]
        sided = [i for i, touching in enumerate(on) if touching and self._sides[i]]
        if len({self._sides[i] for i in sided}) < 2:
            return errors
        net = sum(self._sides[i] * errors[i] for i in sided) / len(sided)
        pushes, own = self._since < NET_TIME and not self._has_settled, list(errors)
        for i in sided:
            errors[i] -= (1.0 - NET if pushes else 1.0) * self._sides[i] * net
        ratios = {
            i: (self.fingers[i].normal - self.fingers[i].sigma) / max(targets[i], SAME)
            for i in sided
        }
        strong = max(sided, key=lambda i: ratios[i])
        over = STRONGEST - ratios[strong]
        if over < 0.0 and self.phase in HOLDING:  # weaker readings may be wrong
            for i in sided:
                errors[i] = min(errors[i], over * targets[i])
                if pushes and self._sides[i] == self._sides[strong]:
                    errors[i] = min(errors[i], own[i])
        return errors

    def _approach(self, drive: int, closure: float) -> float:
        """Speed (1/s) of a drive that nothing touches; one that feels nothing stays.

        A hand that is opened beyond its open posture comes to that as fast as it opens. A drive
        that is measured behind its model reacts later than was told, or moves slower: the way
        that it lacks counts as part of that of a reaction.
        """
        law = self.laws[drive]
        if not any(self.fingers[i].good and self._used[i] for i in self._of[drive]):
            return 0.0
        if law.command < 0.0:
            return OPENING
        way = IMPACT * self._targets.lightest / law.drive.stiffness_high
        speed = min(self.config.closing_rate, way / law.reaction)
        behind = 0.0 if law.drive.is_soft else law.free - closure
        return bounded((way - behind) / law.reaction, SLOWEST * speed, speed)

    def _safe(self, given: GripInput, refusal: str, dt: float) -> GripStep:
        """Hold what was sent last, or open a hand that can be trusted slowly."""
        self._trusted = False
        opens = self.config.safe_action == 'open' and self.phase in GRASPING and self._started
        wrong = self.fault or self._hand_refusal(given) or refuse_step(dt, self.config.stale_age)
        if opens and not wrong:
            for law in self.laws:
                law.move(-SAFE_OPENING, dt)
            return self._made(True, refusal, GripPhase.FAULT)
        return self._made(False, refusal, GripPhase.FAULT)

    def _trust(self) -> None:
        """After a fault: go on from the last command, or finish opening."""
        self._trusted, self._unseen = True, 0.0
        if self.config.safe_action == 'open' and self.phase in GRASPING:
            self.phase = GripPhase.RELEASE
        for law in self.laws:
            law.seat(law.command, law.contact)
        for finger in self.fingers:
            finger.blind()

    def _open(self, dt: float) -> GripStep:
        """One step of a release; idle when all drives are open."""
        for law in self.laws:
            law.move(-OPENING, dt)
            law.let_time_pass(dt)
        made = self._made(True, self._opens)
        if all(law.command <= 0.0 for law in self.laws):
            why = self._opens
            self._forget()
            self._started = False
            self._idle = f'{why}; a new grasp is needed' if why else NOT_ASKED
        return made

    def _made(self, send: bool, refusal: str, phase: GripPhase | None = None) -> GripStep:
        """Record of this step."""
        phase = GripPhase.FAULT if self.fault else phase
        fingers = self.fingers
        by_finger = np.array(
            [
                [*self._targets.now],
                [finger.normal if finger.good else nan for finger in fingers],
                [finger.slip.friction for finger in fingers],
                [finger.slip.margin for finger in fingers],
            ]
        )
        by_drive = np.array(
            [(law.command, law.contact, law.stiffness.value) for law in self.laws]
        ).T
        feeling = [
            drive for drive, of in enumerate(self._of) if any(fingers[i].good for i in of)
        ]
        silent = [
            f'{name} {finger.why.split(" (")[0]}: it keeps its place'
            for name, finger, use in zip(self.names, fingers, self._used, strict=True)
            if use and finger.why and self.phase in HOLDING
        ]
        return GripStep(
            phase=self.phase if phase is None else phase,
            closure=by_drive[0],
            contact=by_drive[1],
            send=send,
            limited=send and any(law.limited for law in self.laws),
            refusal=refusal,
            warning='; '.join(silent),
            fault=self.fault,
            target_force=by_finger[0],
            force=by_finger[1],
            friction=by_finger[2],
            slip_margin=by_finger[3],
            slipping=np.array([finger.slip.slipping for finger in fingers]),
            touching=np.array([finger.touching and finger.good for finger in fingers]),
            stiffness=by_drive[2],
            settled=self._calm >= SETTLED_TIME and phase is None,
            input_age=self._age if self._age < inf else nan,
            shut=bool(feeling) and all(map(self._is_shut, feeling)),
        )


def refuse_order(drives: list[int], sides: list[int]) -> None:
    """Raise ValueError if drives or sides of fingers cannot be."""
    if not drives or sorted(set(drives)) != list(range(max(drives) + 1)):
        msg = f'drives of GripForce must be numbers from 0 without gaps; received {drives}'
        raise ValueError(msg)
    if len(sides) != len(drives) or not set(sides) <= {-1, 0, 1}:
        msg = f'sides of GripForce must be -1, 0 or 1 for each finger; received {sides}'
        raise ValueError(msg)


def refuse_goal(config: GripConfig, targets: list[float], used: list[bool]) -> None:
    """Raise ValueError if no finger takes part, or a target (N) is out of its range."""
    if len(used) != len(targets) or not any(used):
        msg = f'fingers of grasp must name at least one of {len(targets)}; received {used}'
        raise ValueError(msg)
    low, high = ON_SIGMAS * config.force_noise, config.force_high
    if not all(low < target <= high for target in targets):
        msg = f'target_force must be above {low:g} and at most {high:g} N; received {targets}'
        raise ValueError(msg)


def refuse_step(dt: float, longest: float) -> str:
    """Reason why a time step (s) cannot be taken, or empty: longer than inputs may be old."""
    if isfinite(dt) and 0.0 < dt <= longest:
        return ''
    return f'time step must be above 0 and at most {longest:.3f} s; received {dt}'
