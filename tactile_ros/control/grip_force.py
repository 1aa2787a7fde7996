"""The grip-force law: close, touch, load, hold, release; safe when an input cannot be trusted.

Fingers approach until they touch, wait for each other at a small force, load together and hold.
Each drive is regulated by `DriveLaw` with the stiffness of its own contact. An approach goes no
further in the time that the hand is told to react than the stiffest object in range yields under
twice the asked force; what its drive is measured behind its told dead time and lag counts as part
of that way, and slows it, down to half. At the touch the command goes back, as fast as it may, to
where the drive is by then: as measured, or as told where that is further. From there on the felt
force is regulated, which alone takes back what a drive slower than told has still to go. A finger
without a usable force holds its place while the others go on.

A force is regulated once: when every touching finger has given a new one. Between, drives finish
what the last asked for; where a finger is late all stay, until it is heard or counts as stale.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.control.fingers import Fingers
from tactile_ros.control.grip_drives import GripDrives
from tactile_ros.control.grip_report import GripParts, told
from tactile_ros.control.grip_state import GripInput, GripPhase, GripStep
from tactile_ros.control.grip_targets import GripTargets
from tactile_ros.control.grip_watch import GripWatch, refuse_goal, refuse_order, refuse_step

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from tactile_ros.control.grip_config import GripConfig

NOT_ASKED = 'no grasp was asked for'
GRASPING = (GripPhase.CLOSE, GripPhase.TOUCH, GripPhase.LOAD, GripPhase.HOLD)


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
        none; None: not known, and forces are not balanced.

    Raises
    ------
    ValueError
        If there is no finger, drives have gaps, or sides are others than -1, 0, 1.

    Examples
    --------
    >>> from tactile_ros.control.grip_config import GripConfig
    >>> law = GripForce(GripConfig(), drives=(0, 1), sides=(1, -1))
    >>> blank = np.zeros(2)
    >>> given = GripInput(blank, blank, blank == 0, blank.astype(np.int8), blank, blank, 0.0)
    >>> law.step(given, 0.01).refusal
    'not active'
    >>> law.enable()
    >>> law.grasp(2.0)
    >>> made = law.step(given, 0.01)
    >>> made.phase.name, made.send, bool((made.closure > 0).all())
    ('CLOSE', True, True)
    """

    def __init__(
        self, config: GripConfig, drives: Sequence[int], sides: Sequence[int] | None = None
    ) -> None:
        self.config = config
        self._drives = [int(drive) for drive in drives]
        self._sides = [0] * len(self._drives) if sides is None else [int(side) for side in sides]
        refuse_order(self._drives, self._sides)
        count = len(self._drives)
        self._fingers = Fingers(config, self._drives)
        self._targets = GripTargets(config, self._sides)
        self._watch = GripWatch(config, count)
        self._moved = GripDrives(
            config, max(self._drives) + 1, self._sides, self._fingers, self._targets
        )
        self._laws = self._moved.laws
        self._parts = GripParts(self._moved, self._fingers, self._targets, self._watch)
        self._used = self._all = [True] * count
        self._active = self._started = False
        self._longest = config.stale_age
        self._forget()

    def _forget(self) -> None:
        """Nothing is held: another object may come."""
        self.phase = GripPhase.IDLE
        self._waited = 0.0
        self._trusted = True
        self._idle, self._opens = NOT_ASKED, ''
        self._targets.restart()
        self._fingers.reset()
        self._moved.restart()

    @property
    def active(self) -> bool:
        """Whether commands may be sent at all."""
        return self._active

    def enable(self) -> None:
        """Allow commands; the first starts from the measured closure."""
        if not self._active:
            self._forget()
        self._active = True

    def _unseat(self) -> None:
        """A hand that was left alone may be anywhere: it starts from the measured closure."""
        if self.phase == GripPhase.IDLE:
            self._started = False
            self._moved.release()

    def disable(self) -> None:
        """Forbid commands; what was sent last holds."""
        self._active = False
        self._forget()

    def grasp(
        self,
        target_force: npt.ArrayLike,
        adapt: bool = True,
        fingers: Sequence[bool] | None = None,
    ) -> None:
        """Ask for a force; an object that is held already is loaded or relieved to it.

        Parameters
        ----------
        target_force : array_like, shape () or (f,)
            Along the normal, of each finger (N); balanced over the sides.
        adapt : bool
            Whether slip and load may raise it.
        fingers : sequence of bool, length f, or None
            Which take part; None: all.

        Raises
        ------
        ValueError
            If the law is not active, no finger takes part, or a force is out of its range.
        """
        count = len(self._drives)
        used = [True] * count if fingers is None else [bool(use) for use in fingers]
        targets = np.broadcast_to(np.asarray(target_force, np.float64), (count,))
        if not self._active:
            msg = 'grasp must follow enable; the law is not active'
            raise ValueError(msg)
        refuse_goal(self.config, targets.tolist(), used)
        self._unseat()
        self._used = used
        self._targets.ask(targets.tolist(), used, adapt)
        held = self.phase in (GripPhase.LOAD, GripPhase.HOLD)
        if not held:
            self._forget()
        self.phase = GripPhase.LOAD if held else GripPhase.CLOSE
        self._moved.calm = 0.0

    def release(self, why: str = '') -> None:
        """Open; nothing happens where the law is not active.

        Parameters
        ----------
        why : str
            What went wrong, which `refusal` says from now until the next grasp; empty: nothing.
        """
        if self._active:
            self._unseat()
            self.phase, self._opens = GripPhase.RELEASE, why

    def abandon(self, why: str) -> None:
        """Send nothing more until the next grasp, and say why: the hand cannot be trusted."""
        self._forget()
        self._idle = f'{why}; a new grasp is needed'

    def step(self, given: GripInput, dt: float) -> GripStep:
        """Decide the next command.

        Parameters
        ----------
        given : GripInput
            Newest of every finger and of the drives.
        dt : float
            Since the last step (s).

        Returns
        -------
        GripStep
            Command inside limits and rate, or why there is none.

        Raises
        ------
        ValueError
            If a shape differs from the fingers and drives.
        """
        given.refuse_misfit(len(self._drives), len(self._laws))
        normal = given.normal.tolist()
        refusal = self._refusal(given, normal, dt)
        if not self._active or self.phase == GripPhase.IDLE:
            return self._made(normal, False, refusal)
        if refusal:
            return self._safe(given, normal, refusal, dt)
        if not self._trusted:
            self._trust()
        if self.phase == GripPhase.RELEASE:
            return self._open(normal, dt)
        self._feel(given, normal, dt)
        if self._fingers.late:
            self._moved.stay()
        else:
            self._advance(dt)
            holding = self.phase == GripPhase.HOLD
            self._moved.drive(normal, given.closure.tolist(), dt, holding)
        return self._made(normal, True, '')

    def admit(self, closure: npt.ArrayLike, dt: float, reach: npt.ArrayLike | None = None) -> None:
        """Go on from what was sent where it is not the last command.

        Parameters
        ----------
        closure : array_like, shape (a,)
            That was sent.
        dt : float
            Of the last step (s).
        reach : array_like, shape (a,), or None
            As far as the drives would come in time; None: what was sent.
        """
        sent = np.asarray(closure, np.float64).tolist()
        reached = sent if reach is None else np.asarray(reach, np.float64).tolist()
        self._moved.admit(sent, reached, dt)

    def _refusal(self, given: GripInput, normal: list[float], dt: float) -> str:
        """Why nothing can be commanded in this step; empty if something can."""
        if not self._active:
            return 'not active'
        if self.phase == GripPhase.IDLE:
            return self._idle
        if self.phase == GripPhase.RELEASE:
            why = self._watch.drives(given)
        else:
            why = self._watch.judge(given, normal, self._used)
        why = refuse_step(dt, self._longest) or why
        if not why and not self._started:
            why = self._moved.start(given.closure.tolist())
            self._started = not why
        return why

    def _safe(self, given: GripInput, normal: list[float], refusal: str, dt: float) -> GripStep:
        """Hold what was sent last, or open a hand that can be trusted slowly."""
        self._trusted = False
        opens = self.config.safe_action == 'open' and self.phase in GRASPING and self._started
        opens = opens and not (self._watch.drives(given) or refuse_step(dt, self._longest))
        if opens:
            self._moved.move(-self.config.safe_rate, dt)
        return self._made(normal, opens, refusal, GripPhase.FAULT)

    def _trust(self) -> None:
        """After a fault: go on from the last command, or finish opening."""
        self._trusted = True
        if self.config.safe_action == 'open' and self.phase in GRASPING:
            self.phase = GripPhase.RELEASE
        self._moved.settle()
        self._fingers.blind()

    def _open(self, normal: list[float], dt: float) -> GripStep:
        """One step of a release; idle when all drives are open."""
        self._moved.move(-self.config.opening_rate, dt)
        made = self._made(normal, True, self._opens)
        if all(law.command <= self.config.closure_low for law in self._laws):
            if self._opens:
                self.abandon(self._opens)
            else:
                self._forget()
        return made

    def _feel(self, given: GripInput, normal: list[float], dt: float) -> None:
        """Contact of every finger, and its slip."""
        closures = given.closure.tolist()
        across, says = given.tangential.tolist(), given.slip.tolist()
        new = self._all if given.new is None else given.new.tolist()
        approaching = self.phase in (GripPhase.CLOSE, GripPhase.TOUCH)
        for drive in self._fingers.feel(normal, across, says, self._watch.good, new, dt):
            if approaching:
                self._moved.meet(drive, closures[drive])

    def _advance(self, dt: float) -> None:
        """Phase and targets."""
        if self.phase == GripPhase.CLOSE and any(self._fingers.on):
            self.phase, self._waited = GripPhase.TOUCH, 0.0
            self._targets.touch()
        elif self.phase == GripPhase.TOUCH:
            self._waited += dt
            if self._gathered():
                self.phase = GripPhase.LOAD
        if self.phase in (GripPhase.LOAD, GripPhase.HOLD):
            self._targets.share(self._fingers.touching)
            reached = self._targets.grow(self._fingers.slips, dt)
            if self.phase == GripPhase.LOAD and reached:
                self.phase = GripPhase.HOLD

    def _gathered(self) -> bool:
        """Whether all fingers that can be felt touch, or were waited for and both sides do."""
        touches = self._fingers.touching
        felt = [i for i, good in enumerate(self._watch.good) if good]
        if all(touches[i] for i in felt):
            return True
        sides = {self._sides[i] for i in felt}
        both = all(any(touches[i] for i in felt if self._sides[i] == side) for side in sides)
        return self._waited > self.config.touch_time and both

    def _made(
        self, normal: list[float], send: bool, refusal: str, phase: GripPhase | None = None
    ) -> GripStep:
        """What is told of this step."""
        calm = self._moved.calm >= self.config.settled_time > 0 and phase is None
        shown = self.phase if phase is None else phase
        return told(self._parts, normal, shown, send, refusal, calm)
