"""What a hand is told: targets of its joints, and how far, fast and hard they may go."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from tactile_ros.types.arrays import Array, as_shape


@dataclass(frozen=True)
class GripCommand:
    """Targets for every joint of a hand, in the order of the hand's own topic.

    Attributes
    ----------
    stamp_ns : int
        Stamp of the newest force that it answers (ns); when it was decided, where there is none.
    position : ndarray, shape (j,)
        Joint positions (rad; 0 open to 1 closed for a synergy). They hold where nothing follows.
    effort : ndarray, shape (j,)
        Torque that each joint may take at most (N m); NaN: the hand's own limit.
    """

    stamp_ns: int
    position: Array
    effort: Array


@dataclass(frozen=True)
class JointLimits:
    """Limits of the joints of a hand.

    Attributes
    ----------
    lower, upper : ndarray, shape (j,)
        Positions (rad, or 1 for a synergy).
    velocity : ndarray, shape (j,)
        Fastest motion (position per s).
    effort : ndarray, shape (j,)
        Largest torque (N m); inf: not known.

    Raises
    ------
    ValueError
        If shapes differ, bounds are not finite or cross, or a speed or torque is not positive.
    """

    lower: Array
    upper: Array
    velocity: Array
    effort: Array

    def __post_init__(self) -> None:
        """Check once."""
        count = np.size(self.lower)
        for entry in fields(self):
            name = f'{entry.name} of JointLimits'
            object.__setattr__(
                self, entry.name, as_shape(name, getattr(self, entry.name), (count,))
            )
        if not (np.isfinite(self.lower) & np.isfinite(self.upper)).all():
            msg = (
                'lower and upper of JointLimits must be finite; '
                f'received {self.lower}, {self.upper}'
            )
            raise ValueError(msg)
        if not (self.lower < self.upper).all():
            worst = int(np.flatnonzero(~(self.lower < self.upper))[0])
            msg = (
                f'lower of JointLimits must be below upper; received {self.lower[worst]} and '
                f'{self.upper[worst]} for joint {worst}'
            )
            raise ValueError(msg)
        if not (np.isfinite(self.velocity) & (self.velocity > 0)).all():
            msg = f'velocity of JointLimits must be above 0 and finite; received {self.velocity}'
            raise ValueError(msg)
        if not (self.effort > 0).all():
            msg = f'effort of JointLimits must be above 0; received {self.effort}'
            raise ValueError(msg)
