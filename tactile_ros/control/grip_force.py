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

from dataclasses import dataclass
from enum import IntEnum
from math import inf, isfinite, nan
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from tactile_ros.control.force_pi import GripDrives
from tactile_ros.control.slip_margin import Fingers
from tactile_ros.control.targets import GripTargets
from tactile_ros.types import Array, Bools, as_shape

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from tactile_ros.control.config import GripConfig
    from tactile_ros.types import Array, ContactState

BY_FINGER = ('normal', 'tangential', 'valid', 'slip', 'age')


class GripPhase(IntEnum):
    """Phases of a grip, numbered as in GripState."""

    IDLE = 0
    CLOSE = 1
    TOUCH = 2
    LOAD = 3
    HOLD = 4
    RELEASE = 5
    FAULT = 6


class GraspOutcome(IntEnum):
    """How a grasp ended, numbered as in Grasp.action."""

    HELD = 0
    NO_OBJECT = 1
    SLIPPED = 2
    TIMEOUT = 3
    FAULT = 4


@dataclass(frozen=True)
class GripInput:
    """What the fingers feel and where the drives are; NaN where it is not known.

    Attributes
    ----------
    normal, tangential : ndarray, shape (f,)
        Force of each finger along the normal and its size across it (N).
    valid : ndarray, shape (f,)
        Whether the force may be used for control.
    slip : ndarray, shape (f,)
        1 slipping, 0 holding, -1 unknown, as the sensor says.
    age : ndarray, shape (f,)
        Since the force was measured (s).
    closure : ndarray, shape (a,)
        Measured closure of each drive.
    closure_age : float
        Since it was measured (s).
    new : ndarray, shape (f,), or None
        Forces that came since the last step: nothing is integrated twice; None: all.
    blocked : str
        Why nothing can be sent, so that the law does not run ahead of the hand; empty: it can.
    """

    normal: Array
    tangential: Array
    valid: Bools
    slip: npt.NDArray[np.int8]
    age: Array
    closure: Array
    closure_age: float
    new: Bools | None = None
    blocked: str = ''

    @classmethod
    def of(
        cls,
        states: Sequence[ContactState | None],
        age: npt.ArrayLike,
        closure: npt.ArrayLike,
        closure_age: float,
    ) -> GripInput:
        """Input from one contact state for each finger.

        Parameters
        ----------
        states : sequence of ContactState or None
            Newest of each finger (f); None: none yet. An untouched one has force 0.
        age : array_like, shape (f,)
            Since each was measured (s).
        closure : array_like, shape (a,)
            Measured closure of each drive; NaN: not known.
        closure_age : float
            Since it was measured (s).

        Returns
        -------
        GripInput
            A tangential force that a sensor cannot see is NaN.

        Raises
        ------
        ValueError
            If the shapes differ.
        """
        count = len(states)
        blank = np.full(3, np.nan)
        force = np.array([blank if s is None else s.force for s in states]).reshape(count, 3)
        return cls(
            normal=force[:, 2],
            tangential=np.hypot(force[:, 0], force[:, 1]),
            valid=np.array([s is not None and bool(s.valid) for s in states], bool),
            slip=np.array([-1 if s is None else int(s.slip) for s in states], np.int8),
            age=as_shape('age of GripInput', age, (count,)),
            closure=as_shape('closure of GripInput', closure, (-1,)),
            closure_age=float(closure_age),
        )

    def refuse_misfit(self, fingers: int, drives: int) -> None:
        """Raise ValueError where an array has another shape than the fingers or drives."""
        wanted = (fingers,)
        fits = (
            wanted == self.normal.shape == self.tangential.shape == self.valid.shape
            == self.slip.shape == self.age.shape
        )  # fmt: skip
        if fits and self.closure.shape == (drives,) and (
            self.new is None or self.new.shape == wanted
        ):  # fmt: skip
            return
        for name in BY_FINGER:
            self._refuse(name, fingers)
        self._refuse('closure', drives)
        self._refuse('new', fingers)

    def _refuse(self, name: str, count: int) -> None:
        array = getattr(self, name)
        if array.shape != (count,):
            msg = f'{name} of GripInput must have shape ({count},); received {array.shape}'
            raise ValueError(msg)


@dataclass(frozen=True)
class GripStep:
    """What the law decided in one step.

    Attributes
    ----------
    phase : GripPhase
        FAULT while the safe action is taken.
    closure : ndarray, shape (a,)
        Command of each drive, inside its limits; what holds, where nothing is to be sent.
    send : bool
        Whether it is to be sent.
    limited : bool
        Clamped or rate limited in this step.
    refusal : str
        Why the law's own command is not sent: nothing is, or the hand opens; empty: sent.
    target_force, force : ndarray, shape (f,)
        Along the normal (N); a force that cannot be used is NaN.
    friction, slip_margin : ndarray, shape (f,)
        Estimated coefficient, NaN undefined, and (mu fn - ft) / (mu fn).
    load : ndarray, shape (f,)
        Tangential load that each finger carries (N), NaN unknown.
    slipping, touching : ndarray, shape (f,)
        Fingers that slip now; that touch, and whose force can be used.
    stiffness, stiffness_std : ndarray, shape (a,)
        Estimated, of object and hand together (N per closure).
    settled : bool
        In HOLD, with the error small for long enough.
    input_age : float
        Of the oldest input in use (s), NaN if none is.
    shut : bool
        Every drive that feels is as closed as it may be, and one at least feels.
    disagreement : float
        How much less the weaker of two opposed sides feels than the stronger, as a share; NaN
        where no two sides touch.
    """

    phase: GripPhase
    closure: Array
    send: bool
    limited: bool
    refusal: str
    target_force: Array
    force: Array
    friction: Array
    slip_margin: Array
    load: Array
    slipping: Bools
    touching: Bools
    stiffness: Array
    stiffness_std: Array
    settled: bool
    input_age: float
    shut: bool
    disagreement: float = nan


class GripWatch:
    """Judge the inputs of one step.

    Parameters
    ----------
    config : GripConfig
        Ages, and how few fingers are enough.
    fingers : int
        Count f.

    Attributes
    ----------
    good : list of bool
        Fingers whose force may be used.
    age : float
        Of the oldest input in use (s); inf if there is none.
    """

    def __init__(self, config: GripConfig, fingers: int) -> None:
        self.config = config
        self._limit = config.stale_age
        self.good = [False] * fingers
        self.age = inf

    def judge(self, given: GripInput, normal: list[float], used: Sequence[bool]) -> str:
        """Look at the forces of the fingers that take part.

        Parameters
        ----------
        given : GripInput
            Of this step.
        normal : list of float
            Its normal forces (N).
        used : sequence of bool
            Fingers that take part.

        Returns
        -------
        str
            Why none can be regulated; empty if that is possible.
        """
        ages = given.age.tolist()
        valid = given.valid.tolist()
        self.good = [
            use and ok and isfinite(force) and 0.0 <= age <= self._limit
            for use, ok, force, age in zip(used, valid, normal, ages, strict=True)
        ]
        known = [age for age, ok in zip(ages, self.good, strict=True) if ok]
        self.age = max(known) if known else inf
        enough = self.config.fewest_fingers
        if known and (len(known) >= enough or len(known) == sum(used)):
            return self.drives(given)
        if given.blocked:
            return given.blocked
        worst = next(i for i, use in enumerate(used) if use and not self.good[i])
        return f'finger {worst} {self._why(ages[worst], valid[worst])}'

    def drives(self, given: GripInput) -> str:
        """Why the hand itself cannot be trusted; empty if it can."""
        if given.blocked or not self.config.closure_required:
            return given.blocked
        if not 0.0 <= given.closure_age <= self._limit:
            return f'joint states are stale ({given.closure_age:.3f} s)'
        for i, closure in enumerate(given.closure.tolist()):
            if not isfinite(closure):
                return f'closure of drive {i} is not a number'
        self.age = max(self.age, given.closure_age) if isfinite(self.age) else given.closure_age
        return ''

    def _why(self, age: float, valid: bool) -> str:
        """What is wrong with the input of a finger."""
        if not 0.0 <= age <= self._limit:
            return f'is stale ({age:.3f} s)'
        return 'gives a force that is not a number' if valid else 'says that it is not valid'


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
    low, high = config.contact_on, config.force_high
    if not all(low < target <= high for target in targets):
        msg = f'target_force must be above {low} and at most {high} N; received {targets}'
        raise ValueError(msg)


def refuse_step(dt: float, longest: float) -> str:
    """Why a time step (s) cannot be taken, or empty: longer than inputs may be old, or no time."""
    if isfinite(dt) and 0.0 < dt <= longest:
        return ''
    return f'time step must be above 0 and at most {longest:.3f} s; received {dt}'


class GripParts(NamedTuple):
    """What a law consists of."""

    moved: GripDrives
    fingers: Fingers
    targets: GripTargets
    watch: GripWatch


def told(
    parts: GripParts,
    normal: Sequence[float],
    phase: GripPhase,
    send: bool,
    refusal: str,
    settled: bool,
) -> GripStep:
    """Record of a step.

    Parameters
    ----------
    parts : GripParts
        After the step.
    normal : sequence of float, length f
        Forces that were given (N); those of no use become NaN.
    phase, send, refusal, settled
        As in GripStep.

    Returns
    -------
    GripStep
        With arrays of its own.
    """
    age = parts.watch.age
    by_finger, by_drive, bits = _tables(parts, normal)
    step = GripStep.__new__(GripStep)
    # all at once: a frozen __init__ sets them one by one
    vars(step).update(
        phase=phase,
        closure=by_drive[0],
        send=send,
        limited=send and any([law.limited for law in parts.moved.laws]),
        refusal=refusal,
        target_force=by_finger[0],
        force=by_finger[1],
        friction=by_finger[2],
        slip_margin=by_finger[3],
        load=by_finger[4],
        slipping=bits[0],
        touching=bits[1],
        stiffness=by_drive[1],
        stiffness_std=by_drive[2],
        settled=settled,
        input_age=age if age < inf else nan,
        shut=_shut(parts),
        disagreement=parts.moved.disagreement,
    )
    return step


def _shut(parts: GripParts) -> bool:
    """Whether every drive that feels, and one at least, can close no further."""
    feeling = parts.fingers.feeling
    for law, feels in zip(parts.moved.laws, feeling, strict=True):
        if feels and law.command < law.config.closure_high and not law.stopped:
            return False
    return any(feeling)


def _tables(
    parts: GripParts, normal: Sequence[float]
) -> tuple[Array, Array, npt.NDArray[np.bool_]]:
    """Numbers by finger (5, f) and by drive (3, a), and bits (2, f).

    One flat list for all numbers of a kind: arrays are what a report costs.
    """
    good, slips = parts.watch.good, parts.fingers.slips
    known = [force if ok else nan for force, ok in zip(normal, good, strict=True)]
    touches = [touch and ok for touch, ok in zip(parts.fingers.touching, good, strict=True)]
    by_finger = parts.targets.now + known
    by_finger += [slip.friction for slip in slips]
    by_finger += [slip.margin for slip in slips]
    by_finger += [slip.load for slip in slips]
    by_drive = [law.command for law in parts.moved.laws]
    by_drive += [one.value for one in parts.moved.stiffness]
    by_drive += [one.std for one in parts.moved.stiffness]
    bits = [slip.slipping for slip in slips] + touches
    return (
        np.array(by_finger).reshape(5, -1),
        np.array(by_drive).reshape(3, -1),
        np.array(bits).reshape(2, -1),
    )


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
    >>> from tactile_ros.control.config import GripConfig
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
