# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Grip-force law: close, touch, load, hold, release; safe when an input cannot be trusted.

Each drive moves until a finger touches and is regulated on force from then on (`ForcePi`); targets
of the fingers grow together (`GripTargets`). An approach goes no further in the time that the hand
needs to react than the stiffest object yields under `IMPACT` asked forces.

Fingers that oppose each other on a free object would push it to the weaker sensor: the part of
their errors that pushes counts by `NET` until a load comes, or the object still walks after
`NET_TIME`. Afterwards the squeeze alone is regulated, and each finger closes by its share of it: a
difference between fingers of one side is what holds the object against turning. From the first
load on, soft drives that have settled keep their commands, which hold it as springs do
(`HandJoints` makes them stiffer), and raise them by their gains alone: to answer what a load does
to single forces moves what it leans on. A further goal answers no more than a lacking squeeze.
"""

from __future__ import annotations

from math import inf, isfinite, nan
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.control.config import Drive
from tactile_ros.control.finger import ON_SIGMAS, Finger
from tactile_ros.control.force_pi import CLOSED, ForcePi, bounded
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
NET, NET_TIME = 0.5, 3.0  # share of errors that push an object; s of a load until it must stand
WATCHED, WALKS = 0.5, 0.005  # s, closures that what stands does not go in them
AGREED = 0.5  # least force of a side, of that of the other: else one reads wrongly
STRONGEST = 1.2  # targets that the strongest reading may have while sides disagree
LATE = 1.5  # periods without a new force: one may be missed or cross with a step
SAME = 1e-9  # closure within which a command was admitted as it was

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
        self._order = order = [int(drive) for drive in drives]
        placed = [0] * len(order) if sides is None else [int(side) for side in sides]
        refuse_order(order, placed)
        called = [f'finger {i}' for i in range(len(order))] if names is None else names
        plain = [Drive(config.stiffness_low, config.stiffness_high)] * (max(order) + 1)
        self.config = config
        self.laws = [ForcePi(config, plant) for plant in plants or plain]
        self.fingers = [
            Finger(config, self.laws[drive], name, side)
            for drive, name, side in zip(order, called, placed, strict=True)
        ]
        self._groups = [(law, [f for f in self.fingers if f.law is law]) for law in self.laws]
        self._targets = GripTargets(config, self.fingers)
        self._opposed = {-1, 1} <= set(placed)
        self._active = self._started = False
        self._age = inf
        self._forget()

    def _forget(self) -> None:
        """Nothing is held: another object may come."""
        self.phase = GripPhase.IDLE
        self._waited = self._calm = self._unseen = 0.0
        self._held = self._has_begun = self._loaded = False
        self._begin_load()
        self._trusted = True
        self._idle, self._opens, self.fault = NOT_ASKED, '', ''
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
        if not held:
            self._forget()
        self.phase, self._idle, self._held = GripPhase.IDLE, why, held

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

        `target_force`, () or (f,), is along the normal of each finger (N), shared over the sides;
        slip and load may raise it if `adapt`. `fingers` (f,) take part (None: all); `held` says
        that the hand holds something already, though this law does not know. ValueError if the law
        is not active, no finger takes part, or a force is out of its range.
        """
        count = len(self.fingers)
        used = [True] * count if fingers is None else [bool(use) for use in fingers]
        targets = np.broadcast_to(np.asarray(target_force, np.float64), (count,)).tolist()
        if not self._active:
            msg = 'grasp must follow enable; the law is not active'
            raise ValueError(msg)
        refuse_goal(self.config, targets, used)
        self._loaded |= held and not self.holds  # elsewhere: with what load is not known
        held = held or self.holds
        if self.phase == GripPhase.IDLE and not self._held:
            self._started = False
        if not held:
            self._forget()
        for finger, use in zip(self.fingers, used, strict=True):
            finger.used = use
        self._targets.begin(targets, adapt)
        self.phase = GripPhase.LOAD if held else GripPhase.CLOSE
        self._held, self._calm, self.fault = held, 0.0, ''
        self._begin_load()

    def _begin_load(self) -> None:
        """Let errors push the object until fingers have settled, or it walks."""
        self._since, self._due, self._place = 0.0, NET_TIME, nan
        self._has_settled = self._pushed = False

    def release(self, why: str = '') -> None:
        """Open; `refusal` says `why` from now until the next grasp, where something went wrong."""
        if self._active:
            if self.phase == GripPhase.IDLE and not self._held:
                self._started = False
            self.phase, self._opens, self.fault = GripPhase.RELEASE, why, ''

    def step(self, given: GripInput, dt: float) -> GripStep:
        """Command inside limits and rate, or why there is none, a time dt (s) after the last.

        ValueError if a shape differs from the fingers and drives.
        """
        given.refuse_misfit(len(self.fingers), len(self.laws))
        for finger, row in zip(self.fingers, given.by_finger(), strict=True):
            finger.given = row
        refusal = self._refusal(given, dt)
        if not self._active or self.phase == GripPhase.IDLE:
            if not refuse_step(dt, self.config.stale_age):
                self._judge(given)
                for finger in self.fingers:
                    finger.rest(dt)
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
            ends = far < law.command - SAME  # a joint at its limit may leave its way to others
            law.full = is_full or ends
            if ends and made < law.command - SAME:
                law.stop = 'its joints are at the end of their stroke'
            if abs(made - law.command) > SAME:
                law.yield_to(made, dt)

    def tare(self, finger: int) -> None:
        """Stop where the hand is if a finger that holds was tared: its force is none now."""
        one = self.fingers[finger]
        if self.phase in HOLDING and one.used:
            self.fault = f'{one.name} was tared while it holds: its sensor cannot be trusted'

    def shortfalls(self) -> list[str]:
        """Fingers that take part and do not press what they are asked for, each with why."""
        found = []
        for finger in self.fingers:
            name, law = finger.name, finger.law
            if not finger.used:
                continue
            if not finger.good:
                found.append(f'{name} {finger.why.split(" (")[0]}')
            elif not finger.touching:
                found.append(f'{name} touches nothing')
            else:
                error = _mean([f.error for f in self.fingers if f.law is law and f.pressing])
                if abs(error) > MOST_ERROR * finger.target + finger.sigma:
                    why = f': {law.stop}' if law.stop and finger.normal < finger.target else ''
                    pressed = f'{finger.normal:.2f} of {finger.target:.2f} N'
                    found.append(f'{name} presses {pressed}{why}')
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
        for finger in self.fingers:
            finger.judge()
        self._age = max((f.given.age for f in self.fingers if f.good), default=0.0)
        used = [finger for finger in self.fingers if finger.used]
        bad = [finger for finger in used if not finger.good]
        good = len(used) - len(bad)
        if good and (good >= self.config.fewest_fingers or not bad):
            return ''
        self._age = self._age if good else inf
        return given.blocked or f'{bad[0].name} {bad[0].why}'

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
        rows = zip(self.laws, given.closure.tolist(), given.by_drive(), strict=True)
        for law, closure, force in rows:
            if self._held and law.plant.is_soft and force > 0.0:
                law.reset(closure + force / law.plant.own, closure)
            else:
                law.reset(closure, closure if self._held else nan)
        self._started = True

    def _sense(self, given: GripInput, dt: float) -> None:
        """Take in the forces; an approach ends where a finger touches."""
        before = [bool(_pressing(fingers)) for _, fingers in self._groups]
        for finger in self.fingers:
            finger.sense(dt)
        closures = given.closure.tolist()
        if given.pressed is not None:
            self._contradict(closures, given.by_drive(), dt)
        for (law, fingers), had, closure in zip(self._groups, before, closures, strict=True):
            law.let_time_pass(dt)
            closes = self.phase in (GripPhase.CLOSE, GripPhase.TOUCH)
            if closes and not had and _pressing(fingers):
                law.meet(closure)

    def _contradict(self, closures: list[float], pressed: list[float], dt: float) -> None:
        """Ask the drives of the fingers that take part, each of which has one of its own."""
        for finger, drive in zip(self.fingers, self._order, strict=True):
            if finger.used and finger.good and self._order.count(drive) == 1:
                why = finger.contradiction(pressed[drive], closures[drive], dt)
                if why and not self.fault:
                    self.fault = f'{finger.name} {why}: its sensor cannot be trusted'

    def _has_zero(self, given: GripInput) -> bool:
        """Judge the zeros of fingers at rest; one that reads a force is named."""
        if self._has_begun:
            return True
        asked, pressed = self._targets.strongest, given.by_drive()
        for finger, drive in zip(self.fingers, self._order, strict=True):
            if not (finger.used and finger.good):
                continue
            if not finger.has_zero():
                return False
            if finger.biased(asked, pressed[drive]):
                self.fault = (
                    f'{finger.name} reads {finger.zero:.2f} N before closing: tare it while '
                    'nothing touches it'
                )
                return False
        self._has_begun = True
        return True

    # decisions ---------------------------------------------------------------------------------

    def _decide(self, given: GripInput, dt: float) -> None:
        """Phase, targets and commands; all stay while a finger is late."""
        longest = LATE * self.config.slowest_period
        if any(finger.good and finger.waited > longest for finger in self.fingers):
            for law in self.laws:
                law.stay()
            return
        if self.phase == GripPhase.LOAD and not any(f.target for f in self.fingers):
            self._targets.adopt()
        self._advance(dt)
        self._drive(given.closure.tolist(), dt)

    def _advance(self, dt: float) -> None:
        """Phase and targets."""
        if self.phase == GripPhase.CLOSE and _pressing(self.fingers):
            self.phase, self._waited = GripPhase.TOUCH, 0.0
        if self.phase == GripPhase.TOUCH:
            for finger in self.fingers:
                level = min(WAITING * finger.on, WAITING_SHARE * finger.asked)
                finger.target = min(max(level, finger.on), finger.asked)
            self._waited += dt
            if self._gathered():
                self.phase = GripPhase.LOAD
        if self.phase in HOLDING:
            self._since += dt
            self._has_settled |= self._calm >= SETTLED_TIME
            for finger in self.fingers:
                if not (self._has_settled and finger.slip.load >= finger.carried):
                    finger.carried = finger.slip.load  # what relaxes is no load
            self._loaded |= self._has_settled and any(f.loaded for f in _pressing(self.fingers))
            if self._targets.share() and not self._has_settled:
                self._begin_load()  # a finger that joins has its force to find
            reached = self._targets.grow(self._has_settled or self._loaded, dt)
            if self.phase == GripPhase.LOAD and reached:
                self.phase = GripPhase.HOLD

    def _gathered(self) -> bool:
        """Judge whether all fingers touch, or were waited for and both sides do."""
        felt = [finger for finger in self.fingers if finger.used and finger.good]
        touching = [finger for finger in felt if finger.touching]
        if len(touching) == len(felt):
            return True
        both = {finger.side for finger in touching} == {finger.side for finger in felt}
        return self._waited > TOUCH_TIME and both

    def _drive(self, closures: list[float], dt: float) -> None:
        """Commands: approach what nothing touches, regulate what touches."""
        touching = _pressing(self.fingers)
        complete = all(finger.unspent for finger in touching)
        rows = [
            (law, fingers, _pressing(fingers), closure)
            for (law, fingers), closure in zip(self._groups, closures, strict=True)
        ]
        for law, fingers, on, closure in rows:
            if not on:
                law.move(self._approach(law, fingers, closure), dt)
            elif not complete:
                law.follow(dt)
        if not complete:
            self._unseen += dt
            return
        self._share_errors(closures)
        # an object that one side pushes away feels soft: that is not its stiffness
        gripped = not self._opposed or {-1, 1} <= {finger.side for finger in touching}
        calm = self.phase == GripPhase.HOLD and bool(touching)
        for law, fingers, on, closure in rows:
            if on:
                self._regulate(law, on, closure, gripped, dt)
                calm = calm and _is_settled(law, on, dt, self._loaded)
            else:
                calm = calm and _is_shut(law, fingers)
        self._calm = self._calm + dt + self._unseen if calm else 0.0
        self._unseen = 0.0
        for finger in self.fingers:
            finger.unspent = False

    def _regulate(
        self, law: ForcePi, on: list[Finger], closure: float, gripped: bool, dt: float
    ) -> None:
        """Command of a drive by the mean force of its fingers, whose stiffness is learned."""
        error = _mean([finger.regulated for finger in on])
        force = _mean([finger.normal for finger in on])
        target = _mean([finger.target for finger in on])
        law.touched += dt + self._unseen
        if law.plant.is_soft:
            closure = law.free if law.touched > law.reaction else nan
        if gripped and isfinite(closure):
            law.stiffness.step(closure, force, on[0].sigma)
        keeps = self._loaded and law.plant.is_soft and (self._has_settled or error <= 0.0)
        law.regulate(target, target - error, dt, self._unseen, keeps)

    def _share_errors(self, closures: list[float]) -> None:
        """Errors of touching fingers (N), without what would push a free object further."""
        for finger in self.fingers:
            soft = self._loaded and finger.law.plant.is_soft
            wanted = min(finger.asked, finger.target) if soft else finger.target
            finger.regulated = wanted - finger.normal if finger.pressing else 0.0
        sided = [finger for finger in _pressing(self.fingers) if finger.side]
        if len({finger.side for finger in sided}) < 2:
            return
        if self._since >= self._due:
            self._watch(closures)
        pushes = not (self._loaded or self._pushed)
        if pushes:
            net = sum(finger.side * finger.regulated for finger in sided) / len(sided)
            for finger in sided:
                finger.regulated -= (1.0 - NET) * finger.side * net
        else:
            squeeze = 0.5 * sum(finger.regulated for finger in sided)
            for finger in sided:
                total = sum(f.target for f in sided if f.side == finger.side)
                finger.regulated = squeeze * finger.target / max(total, SAME)
        over = STRONGEST - max((f.normal - f.sigma) / max(f.target, SAME) for f in sided)
        if over < 0.0 and self.phase in HOLDING:  # weaker readings may be wrong
            for finger in sided:
                finger.regulated = min(finger.regulated, over * finger.target)

    def _watch(self, closures: list[float]) -> None:
        """Judge whether fingers push an object on and on: it walks, or one side reads wrongly."""
        pressing = [
            (f.side, closures[drive], f.normal)
            for f, drive in zip(self.fingers, self._order, strict=True)
            if f.pressing
        ]
        near, far = (_mean([at for side, at, _ in pressing if side == own]) for own in (1, -1))
        forces = [sum(force for side, _, force in pressing if side == own) for own in (1, -1)]
        place = 0.5 * (near - far)
        walks = abs(place - self._place) > WALKS
        self._pushed |= walks or min(forces) < AGREED * max(forces)
        self._place, self._due = place, self._due + WATCHED

    def _approach(self, law: ForcePi, fingers: list[Finger], closure: float) -> float:
        """Speed (1/s) of a drive that nothing touches; one that feels nothing stays.

        A hand that is opened beyond its open posture comes to that as fast as it opens. A drive
        that is measured behind its model reacts later than was stated, or moves slower: the way
        that it lacks counts as part of that of a reaction.
        """
        if not any(finger.good and finger.used for finger in fingers):
            return 0.0
        if law.command < 0.0:
            return OPENING
        way = IMPACT * self._targets.lightest / law.plant.stiffness_high
        speed = min(self.config.closing_rate, way / law.reaction)
        behind = 0.0 if law.plant.is_soft else law.free - closure
        return bounded((way - behind) / law.reaction, SLOWEST * speed, speed)

    def _safe(self, given: GripInput, refusal: str, dt: float) -> GripStep:
        """Hold what was sent last, or open a hand that can be trusted slowly."""
        self._trusted = False
        opens = self.config.safe_action == 'open' and self.phase in GRASPING and self._started
        wrong = self.fault or self._hand_refusal(given) or refuse_step(dt, self.config.stale_age)
        send = opens and not wrong
        if send:
            for law in self.laws:
                law.move(-SAFE_OPENING, dt)
        return self._made(send, refusal, safe=True)

    def _trust(self) -> None:
        """After a fault: go on from the last command, or finish opening."""
        self._trusted, self._unseen = True, 0.0
        if self.config.safe_action == 'open' and self.phase in GRASPING:
            self.phase = GripPhase.RELEASE
        for law in self.laws:
            law.reset(law.command, law.contact)
        for finger in self.fingers:
            finger.invalidate()

    def _open(self, dt: float) -> GripStep:
        """One step of a release; idle when all drives are open."""
        for law in self.laws:
            law.move(-OPENING, dt)
            law.let_time_pass(dt)
        made = self._made(True, self._opens)
        if all(law.command <= 0.0 for law in self.laws):
            why = self._opens
            self.move_away()
            self._idle = f'{why}; a new grasp is needed' if why else NOT_ASKED
        return made

    def _made(self, send: bool, refusal: str, safe: bool = False) -> GripStep:
        """Record of this step; `safe` where the safe action is taken."""
        laws, fingers = self.laws, self.fingers
        feeling = [group for group in self._groups if any(f.good for f in group[1])]
        silent = [
            f'{finger.name} {finger.why.split(" (")[0]}: it keeps its place'
            for finger in fingers
            if finger.used and finger.why and self.phase in HOLDING
        ]
        return GripStep(
            phase=GripPhase.FAULT if self.fault or safe else self.phase,
            closure=np.array([law.command for law in laws]),
            contact=np.array([law.contact for law in laws]),
            send=send,
            limited=send and any(law.limited for law in laws),
            refusal=refusal,
            warning='; '.join(silent),
            fault=self.fault,
            target_force=np.array([finger.target for finger in fingers]),
            force=np.array([finger.normal if finger.good else nan for finger in fingers]),
            friction=np.array([finger.slip.friction for finger in fingers]),
            slip_margin=np.array([finger.slip.margin for finger in fingers]),
            slipping=np.array([finger.slip.slipping for finger in fingers]),
            touching=np.array([finger.pressing for finger in fingers]),
            stiffness=np.array([law.stiffness.value for law in laws]),
            settled=self._calm >= SETTLED_TIME and not safe and not self.fault,
            input_age=self._age if self._age < inf else nan,
            shut=bool(feeling) and all(_is_shut(*group) for group in feeling),
            loaded=self._loaded and self.phase in HOLDING and not safe,
        )


def _pressing(fingers: Sequence[Finger]) -> list[Finger]:
    """Touching fingers whose force is known."""
    return [finger for finger in fingers if finger.pressing]


def _mean(values: list[float]) -> float:
    """Mean of numbers, of which there is one at least."""
    return sum(values) / len(values)


def _is_settled(law: ForcePi, on: list[Finger], dt: float, loaded: bool) -> bool:
    """Judge whether the mean error of a drive is small, and no limit holds it back.

    What carries a load presses no less than was asked for: loads change single forces.
    """
    wanted = _mean([finger.asked if loaded else finger.target for finger in on])
    error = wanted - _mean([finger.average(AVERAGED, dt) for finger in on])
    limited = law.stop != '' and error > 0.5 * SETTLED * wanted
    most = SETTLED * wanted + SETTLED_SIGMAS * max(finger.sigma for finger in on)
    return not limited and error <= most and (loaded or error >= -most)


def _is_shut(law: ForcePi, fingers: Sequence[Finger]) -> bool:
    """Judge whether a drive can close no further, also where nothing is felt of it."""
    feels = any(finger.good and finger.used for finger in fingers)
    return not feels or law.stop != '' or law.command >= CLOSED


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
