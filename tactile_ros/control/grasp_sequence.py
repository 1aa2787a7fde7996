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


@dataclass  # frozen it costs a step 2 us
class GripInput:
    """Forces of f fingers and places of a drives; NaN where one is not known."""

    normal: Array  # (f,) along the normal of the contact (N)
    tangential: Array  # (f,) size across it (N)
    valid: Bools  # (f,) whether the force may be used for control
    slip: npt.NDArray[np.int8]  # (f,) 1 slipping, 0 holding, -1 unknown, as the sensor says
    age: Array  # (f,) since the force was measured (s)
    closure: Array  # (a,) measured
    closure_age: float  # since it was measured (s)
    new: Bools | None = None  # (f,) since the last step: none is integrated twice; None: all
    blocked: str = ''  # why nothing can be sent, so that the law does not run ahead; empty: it can
    sigma: Array | None = None  # (f,) stated noise of `normal` (N); NaN, None: as the config says
    framed: Bools | None = None  # (f,) the normal is measured, not the pad's own; None: all
    pressed: Array | None = None  # (a,) that joints or torques tell (N); NaN, None: not known

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


@dataclass  # frozen it costs a step 2 us
class GripStep:
    """Decisions of the law in one step, for f fingers and a drives."""

    phase: GripPhase  # FAULT while the safe action is taken
    closure: Array  # (a,) commands
    contact: Array  # (a,) where each met the object and presses beyond; NaN: it did not
    send: bool  # otherwise what was sent last holds
    limited: bool  # clamped or rate limited in this step
    refusal: str  # why the law's own command is not sent: nothing is, or the hand opens
    warning: str  # fingers that hold their place though their force is not known
    fault: str  # why the grasp cannot go on: a sensor that is contradicted
    target_force: Array  # (f,) along the normal (N)
    force: Array  # (f,) (N); NaN: it cannot be used
    friction: Array  # (f,) estimated coefficient; NaN: undefined
    slip_margin: Array  # (f,) (mu fn - ft) / (mu fn)
    slipping: Bools  # (f,) now
    touching: Bools  # (f,) and with a force that can be used
    stiffness: Array  # (a,) estimated, of object and hand together (N per closure)
    settled: bool  # in HOLD, with every finger's own error small for long enough
    input_age: float  # of the oldest input in use (s); NaN: none is
    shut: bool  # every drive that feels is as closed as it may be, and one at least feels
    loaded: bool = False  # a load came: soft drives keep their commands


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
    after a fault of `fault_time` of the config. `beyond` says that what was asked for is more than
    the drives can press: then nothing is held at it.
    """

    def __init__(
        self, config: GripConfig, timeout: float = 0.0, opens: bool = False, beyond: str = ''
    ) -> None:
        if not 0.0 <= timeout < float('inf'):
            msg = f'timeout of a grasp must be 0 or more seconds; received {timeout}'
            raise ValueError(msg)
        self.config, self._opens, self._beyond = config, opens, beyond
        self._timeout = timeout or GRASP_TIME
        self._late = f'not {"open" if opens else "held"} within {self._timeout:g} s'
        self._late += f': {beyond}' if beyond else ''
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
        """Take in a step after the end; why nothing is held any more, or empty."""
        self._count(made, dt)
        return LOST if self._empty > LOST_TIME else ''

    def _count(self, made: GripStep, dt: float) -> None:
        """Times of the conditions that end a grasp."""
        faulty = made.phase == GripPhase.FAULT
        self._elapsed += dt
        self._faulty = self._faulty + dt if faulty else 0.0
        if not faulty:  # touches that fingers had last count while forces are not known
            touching = bool(made.touching.any())
            self._had = self._had or (touching and made.phase in HOLDING)
            self._empty = 0.0 if touching else self._empty + dt
            self._closed = self._closed + dt if made.shut and not touching else 0.0

    def _judged(self, made: GripStep) -> GraspProgress:
        """Outcome by the first condition that holds."""
        end = GraspOutcome
        faulty = made.fault != '' or self._faulty > self.config.fault_time
        closes, empty = not self._opens, self._had and self._empty > LOST_TIME
        ends = (
            (faulty, end.FAULT, made.fault or made.refusal),
            (self._opens and made.phase == GripPhase.IDLE, end.NO_OBJECT, 'the hand is open'),
            (closes and made.phase in OPENED, end.FAULT, 'the grip was released'),
            (closes and empty, end.SLIPPED, LOST),
            (closes and self._closed > LOST_TIME, end.NO_OBJECT, NOTHING),
            (closes and made.settled and not self._beyond, end.HELD, 'held at the asked force'),
            (self._elapsed >= self._timeout, end.TIMEOUT, self._late),
        )
        for holds, outcome, sentence in ends:
            if holds:
                return GraspProgress(outcome, sentence)
        return GraspProgress(None, 'opening' if self._opens else made.phase.name.lower())
