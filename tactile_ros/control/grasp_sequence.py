# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Inputs, steps and phases of a grip; ends of a grasp: held, slipped, no object, fault."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from math import nan
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    import numpy.typing as npt

    from tactile_ros.control.config import GripConfig
    from tactile_ros.types import Array, Bools


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
    """Ends of a grasp, numbered as in Grasp.action."""

    HELD = 0
    NO_OBJECT = 1
    SLIPPED = 2
    TIMEOUT = 3
    FAULT = 4


class FingerInput(NamedTuple):
    """Row of a GripInput, with the defaults of what is not stated."""

    normal: float
    tangential: float
    valid: bool
    slip: int
    age: float
    new: bool = True
    sigma: float = nan
    framed: bool = True


@dataclass(frozen=True)
class GripInput:
    """Forces of the fingers and places of the drives; NaN where one is not known.

    Attributes
    ----------
    normal, tangential : ndarray, shape (f,)
        Force of each finger along the normal of its contact and its size across it (N).
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
    sigma : ndarray, shape (f,), or None
        Stated noise of the normal force (N); NaN or None: that of the config.
    framed : ndarray, shape (f,), or None
        Whether the normal is measured, and not taken to be that of the pad; None: all.
    pressed : ndarray, shape (a,), or None
        Force that each drive tells by its joints or torques (N); NaN or None: not known.
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
    sigma: Array | None = None
    framed: Bools | None = None
    pressed: Array | None = None

    def refuse_misfit(self, fingers: int, drives: int) -> None:
        """Raise ValueError where an array has another shape than the fingers or drives."""
        for count, names in ((fingers, FingerInput._fields), (drives, ('closure', 'pressed'))):
            for name in names:
                array = getattr(self, name)
                if array is not None and array.shape != (count,):
                    msg = f'{name} of GripInput must have shape ({count},); received {array.shape}'
                    raise ValueError(msg)

    def by_finger(self) -> list[FingerInput]:
        """Inputs of each finger."""
        missing = FingerInput._field_defaults
        columns = [
            [missing[name]] * len(self.normal) if column is None else column.tolist()
            for name, column in ((name, getattr(self, name)) for name in FingerInput._fields)
        ]
        return [FingerInput(*row) for row in zip(*columns, strict=True)]

    def by_drive(self) -> list[float]:
        """Force that each drive tells (N); NaN: not known."""
        return [nan] * len(self.closure) if self.pressed is None else self.pressed.tolist()


@dataclass(frozen=True)
class GripStep:
    """Decisions of the law in one step.

    Attributes
    ----------
    phase : GripPhase
        FAULT while the safe action is taken.
    closure, contact : ndarray, shape (a,)
        Command of each drive, and closure at which it met the object, beyond which the command
        presses; NaN: it did not.
    send : bool
        Whether it is to be sent; otherwise what was sent last holds.
    limited : bool
        Clamped or rate limited in this step.
    refusal : str
        Why the law's own command is not sent: nothing is, or the hand opens; empty: sent.
    warning : str
        Fingers that hold their place though their force is not known; empty: none.
    fault : str
        Why the grasp cannot go on: a sensor that is contradicted; empty: it can.
    target_force, force : ndarray, shape (f,)
        Along the normal (N); a force that cannot be used is NaN.
    friction, slip_margin : ndarray, shape (f,)
        Estimated coefficient, NaN undefined, and (mu fn - ft) / (mu fn).
    slipping, touching : ndarray, shape (f,)
        Fingers that slip now; that touch, and whose force can be used.
    stiffness : ndarray, shape (a,)
        Estimated, of object and hand together (N per closure).
    settled : bool
        In HOLD, with every finger's own error small for long enough.
    input_age : float
        Of the oldest input in use (s), NaN if none is.
    shut : bool
        Every drive that feels is as closed as it may be, and one at least feels.
    """

    phase: GripPhase
    closure: Array
    contact: Array
    send: bool
    limited: bool
    refusal: str
    warning: str
    fault: str
    target_force: Array
    force: Array
    friction: Array
    slip_margin: Array
    slipping: Bools
    touching: Bools
    stiffness: Array
    settled: bool
    input_age: float
    shut: bool


GRASPING = (GripPhase.CLOSE, GripPhase.TOUCH, GripPhase.LOAD, GripPhase.HOLD)
HOLDING = (GripPhase.LOAD, GripPhase.HOLD)
OPENED = (GripPhase.IDLE, GripPhase.RELEASE)
LOST = 'the object was lost'
NOTHING = 'closed without touching anything'
LOST_TIME = 0.2  # s untouched after which an object is lost
GRASP_TIME = 60.0  # s, of a goal that names no timeout


@dataclass(frozen=True)
class GraspProgress:
    """State of a grasp: its outcome, None while it goes on, and one sentence."""

    outcome: GraspOutcome | None
    message: str


class GraspSequence:
    """Judge the steps of one grasp, or of an opening where the hand `opens`.

    It ends at a timeout (s; 0: `GRASP_TIME`; ValueError where that is below 0 or not finite), or
    after a fault of `fault_time` of the config.
    """

    def __init__(self, config: GripConfig, timeout: float = 0.0, opens: bool = False) -> None:
        if not 0.0 <= timeout < float('inf'):
            msg = f'timeout of a grasp must be 0 or more seconds; received {timeout}'
            raise ValueError(msg)
        self.config, self._opens = config, opens
        self._timeout = timeout or GRASP_TIME
        self._elapsed = self._faulty = self._empty = self._closed = 0.0
        self._had = False
        self.progress = GraspProgress(None, 'opening' if opens else 'closing')

    def step(self, made: GripStep, dt: float) -> GraspProgress:
        """Take in a step of the law, dt (s) after the last; after the end nothing changes."""
        if self.progress.outcome is None:
            self._count(made, max(dt, 0.0))
            self.progress = self._judged(made)
        return self.progress

    def judge(self, made: GripStep, dt: float) -> str:
        """Take in a step after the end; why nothing is held any more, or empty.

        Touches that fingers had last count while their forces are not known.
        """
        self._count(made, dt)
        return LOST if self._empty > LOST_TIME else ''

    def _count(self, made: GripStep, dt: float) -> None:
        """Times of the conditions that end a grasp."""
        faulty = made.phase == GripPhase.FAULT
        self._elapsed += dt
        self._faulty = self._faulty + dt if faulty else 0.0
        if not faulty:
            touching = bool(made.touching.any())
            self._had = self._had or (touching and made.phase in HOLDING)
            self._empty = 0.0 if touching else self._empty + dt
            self._closed = self._closed + dt if made.shut and not touching else 0.0

    def _judged(self, made: GripStep) -> GraspProgress:
        """Outcome by the first condition that holds."""
        end, what = GraspOutcome, 'open' if self._opens else 'held'
        faulty = made.fault != '' or self._faulty > self.config.fault_time
        late = f'not {what} within {self._timeout:g} s'
        closes, empty = not self._opens, self._had and self._empty > LOST_TIME
        ends = (
            (faulty, end.FAULT, made.fault or made.refusal),
            (self._opens and made.phase == GripPhase.IDLE, end.NO_OBJECT, 'the hand is open'),
            (closes and made.phase in OPENED, end.FAULT, 'the grip was released'),
            (closes and empty, end.SLIPPED, LOST),
            (closes and self._closed > LOST_TIME, end.NO_OBJECT, NOTHING),
            (closes and made.settled, end.HELD, 'held at the asked force'),
            (self._elapsed >= self._timeout, end.TIMEOUT, late),
        )
        for holds, outcome, sentence in ends:
            if holds:
                return GraspProgress(outcome, sentence)
        return GraspProgress(None, 'opening' if self._opens else made.phase.name.lower())
