"""The last word before a command leaves: inside the limits, no faster, not far from the joints."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from tactile_ros.types import Array, JointLimits


class JointGuard:
    """Positions of a hand, clamped and rate limited, from the measured posture on.

    Parameters
    ----------
    limits : JointLimits
        Of the j joints.
    most_offset : float
        How far a target may lie from the measured joint: with the driver's gain it bounds the
        torque (rad).
    """

    def __init__(self, limits: JointLimits, most_offset: float) -> None:
        self._limits, self._most_offset = limits, most_offset
        self.last: Array | None = None

    def start(self, measured: Array) -> None:
        """Begin at measured positions (j,): the first command moves nothing."""
        self.last = self._inside(measured)

    def stop(self) -> None:
        """Forget the posture: the hand may be moved by others."""
        self.last = None

    def _inside(self, position: Array) -> Array:
        """Positions within the limits."""
        return _between(position, self._limits.lower, self._limits.upper)

    def step(self, wanted: Array, measured: Array, dt: float) -> tuple[Array, bool]:
        """Admit a command.

        Parameters
        ----------
        wanted, measured : ndarray, shape (j,)
            Targets, and where the joints are.
        dt : float
            Time since the last command (s), positive.

        Returns
        -------
        position : ndarray, shape (j,)
            What may be sent; the last command where a target is NaN.
        limited : bool
            It is not what was wanted.

        Raises
        ------
        ValueError
            If it was not started, or dt is not positive.
        """
        if self.last is None or not dt > 0:
            msg = f'a command needs a measured start and dt > 0; received dt {dt}'
            raise ValueError(msg)
        known = np.where(np.isfinite(wanted), wanted, self.last)
        near = _between(known, measured - self._most_offset, measured + self._most_offset)
        near = np.where(np.isfinite(near), near, self.last)
        most = self._limits.velocity * dt
        position = self._inside(self.last + _between(near - self.last, -most, most))
        self.last = position
        as_wanted = np.abs(position - wanted) <= 1e-12  # false of NaN
        return position, not bool(as_wanted.all())


def _between(values: Array, low: Array, high: Array) -> Array:
    """Values inside bounds, at half the price of clip; NaN stays."""
    inside: Array = np.minimum(np.maximum(values, low), high)
    return inside
