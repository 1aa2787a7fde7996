"""What a grip-force law is given at every step, and what it answers."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from math import nan
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.types import Array, Bools, as_shape

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from tactile_ros.types import ContactState

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
