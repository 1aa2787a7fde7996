"""Which inputs may be used for control, and why not: stale, invalid, not a number, not there."""

from __future__ import annotations

from math import inf, isfinite
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tactile_ros.control.grip_config import GripConfig
    from tactile_ros.control.grip_state import GripInput


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
