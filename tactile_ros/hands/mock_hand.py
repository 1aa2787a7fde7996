"""A fake hand: joints that follow commands as late and as slowly as those of the real one.

It knows no object and no dynamics: a first-order lag for hands with a position loop, a straight
line to the last point for those behind a trajectory controller, and a dead time before either.
"""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from tactile_ros.types import Array, JointLimits

FAULTS = ('silent', 'frozen', 'partial', 'nan')


class MockHand:
    """Joints of a fake hand.

    Parameters
    ----------
    limits : JointLimits
        Of the j joints; they stop there and move no faster.
    position : ndarray, shape (j,)
        Where they begin.
    dead_time_s, lag_s : float
        Before a command acts, and time constant of the position loop (s).
    """

    def __init__(
        self, limits: JointLimits, position: Array, dead_time_s: float = 0.0, lag_s: float = 0.02
    ) -> None:
        self._limits = limits
        self._dead_time_s, self._lag_s = dead_time_s, lag_s
        self.position = np.clip(position, limits.lower, limits.upper)
        self._target = self.position
        self._arrival_s = 0.0  # until a trajectory's point is reached; 0: position loop
        self._waiting: deque[tuple[float, Array, float]] = deque()
        self._time_s = 0.0
        self.steps = 0

    def command(self, target: Array, horizon_s: float = 0.0) -> None:
        """Take targets (j,), to be reached in `horizon_s` (s); 0: as soon as the loop can."""
        at = self._time_s + self._dead_time_s
        self._waiting.append(
            (at, np.clip(target, self._limits.lower, self._limits.upper), horizon_s)
        )

    def step(self, dt: float) -> Array:
        """Positions (j,) after a time (s), positive."""
        self._time_s += dt
        self.steps += 1
        while self._waiting and self._waiting[0][0] <= self._time_s:
            _, self._target, self._arrival_s = self._waiting.popleft()
        if self._arrival_s > 0:
            share = min(1.0, dt / self._arrival_s)
            self._arrival_s = max(self._arrival_s - dt, 1e-9)
        else:
            share = 1.0 - np.exp(-dt / self._lag_s)
        most = self._limits.velocity * dt
        self.position = self.position + np.clip(
            share * (self._target - self.position), -most, most
        )
        return self.position
