"""The last word before a command leaves: inside the limits, no faster, not far from the joints."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tactile_ros.types import Array, JointLimits

SLACK = 0.05  # of a joint's range: encoders are offset, and a hand sags against its stops


class JointGuard:
    """Positions of a hand, clamped and rate limited, from the measured posture on.

    Limits, speed and distance to the measured joint hold at once, always: where they leave
    nothing between them, nothing may be sent.

    Parameters
    ----------
    joints : sequence of str, length j
        Names, for sentences.
    limits : JointLimits
        Of the j joints.
    most_offset : float
        How far a target may lie from the measured joint: with the driver's gain it bounds the
        torque (rad).
    """

    def __init__(self, joints: Sequence[str], limits: JointLimits, most_offset: float) -> None:
        self._joints, self._limits, self._most_offset = list(joints), limits, most_offset
        self.slack = np.minimum(SLACK * (limits.upper - limits.lower), most_offset)
        self.last: Array | None = None

    def start(self, measured: Array) -> None:
        """Begin at measured positions (j,), of which `refusal` said nothing: nothing moves."""
        self.last = _between(measured, self._limits.lower, self._limits.upper)

    def stop(self) -> None:
        """Forget the posture: the hand may be moved by others."""
        self.last = None

    def refusal(self, measured: Array, dt: float) -> str:
        """Why nothing may be sent, in a sentence; empty: something may.

        Parameters
        ----------
        measured : ndarray, shape (j,)
            Where the joints are.
        dt : float
            Time since the last command (s).
        """
        if self.last is None:
            low, high = measured - self.slack, measured + self.slack
        else:
            low, high = self._window(self.last, measured, dt)
        astray = ~((low <= high) & (low <= self._limits.upper) & (high >= self._limits.lower))
        if not astray.any():
            return ''
        return self._sentence(int(np.flatnonzero(astray)[0]), measured)

    def _window(self, last: Array, measured: Array, dt: float) -> tuple[Array, Array]:
        """What may be sent lies between these (j,); where they cross, nothing may."""
        limits, most = self._limits, self._limits.velocity * dt
        low = np.maximum(last - most, measured - self._most_offset)
        high = np.minimum(last + most, measured + self._most_offset)
        return np.maximum(low, limits.lower), np.minimum(high, limits.upper)

    def _sentence(self, worst: int, measured: Array) -> str:
        """What is wrong with a joint."""
        name, at = self._joints[worst], float(measured[worst])
        low, high = float(self._limits.lower[worst]), float(self._limits.upper[worst])
        last = self.last
        if last is None or not low - self._most_offset <= at <= high + self._most_offset:
            return f'{name} was measured at {at:.3f}, beyond its limits {low:g} and {high:g}'
        apart = abs(at - float(last[worst]))
        return (
            f'{name} was measured {apart:.3f} from its last command; at most '
            f'{self._most_offset:g} may lie between them'
        )

    def reachable(self, wanted: Array, measured: Array) -> Array:
        """Nearest targets (j,) that time alone will let through: speed is no stop."""
        low = np.maximum(measured - self._most_offset, self._limits.lower)
        return _between(wanted, low, np.minimum(measured + self._most_offset, self._limits.upper))

    def step(self, wanted: Array, measured: Array, dt: float) -> tuple[Array, bool]:
        """Admit a command.

        Parameters
        ----------
        wanted, measured : ndarray, shape (j,)
            Targets, and where the joints are.
        dt : float
            Time since the last command (s), 0 or more.

        Returns
        -------
        position : ndarray, shape (j,)
            What may be sent; the last command where a target is NaN.
        limited : bool
            It is not what was wanted.

        Raises
        ------
        ValueError
            If it was not started, dt is below 0, or nothing may be sent (`refusal`).
        """
        if self.last is None or not dt >= 0:
            msg = f'a command needs a measured start and dt of 0 or more; received dt {dt}'
            raise ValueError(msg)
        low, high = self._window(self.last, measured, dt)
        if not (low <= high).all():
            raise ValueError(self.refusal(measured, dt))
        position = _between(np.where(np.isfinite(wanted), wanted, self.last), low, high)
        self.last = position
        as_wanted = np.abs(position - wanted) <= 1e-12  # false of NaN
        return position, not bool(as_wanted.all())


def _between(values: Array, low: Array, high: Array) -> Array:
    """Values inside bounds, at half the price of clip; NaN stays."""
    inside: Array = np.minimum(np.maximum(values, low), high)
    return inside
