"""Where a drive would be if nothing hindered it: its commands behind dead time and lag.

Force grows with this closure at the rate that a force loop meets. The measured closure tells that
rate of stiff drives alone: a soft one stands still at a hard object, however its target moves.
"""

from __future__ import annotations

from collections import deque
from math import exp, inf, nan
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tactile_ros.control.grip_config import GripConfig


class FreeDrive:
    """Dead time and first-order lag of one drive.

    Parameters
    ----------
    config : GripConfig
        Dead time and lag.

    Attributes
    ----------
    closure : float
        Now; NaN before `seat`.

    Examples
    --------
    >>> from tactile_ros.control.grip_config import GripConfig
    >>> drive = FreeDrive(GripConfig(dead_time=0.02, lag=0.05))
    >>> drive.seat(0.0)
    >>> for _ in range(7):
    ...     drive.step(1.0, 0.01)
    >>> round(drive.closure, 3)  # one lag after the dead time
    0.632
    """

    def __init__(self, config: GripConfig) -> None:
        self._dead_time, self._lag = config.dead_time, config.lag
        self.closure = self._target = nan
        self._waiting: deque[tuple[float, float]] = deque()
        self._time = 0.0

    def seat(self, closure: float) -> None:
        """Begin at rest at a closure."""
        self.closure = self._target = closure
        self._waiting.clear()

    def step(self, command: float, dt: float) -> None:
        """Let a time dt (s) pass since a command was sent."""
        self._waiting.append((self._time + self._dead_time, command))
        end = self._time + dt
        while self._time < end:
            due = self._waiting[0][0] if self._waiting else inf
            until = min(max(due, self._time), end)
            self.closure += (self._target - self.closure) * (
                1.0 - exp((self._time - until) / self._lag)
            )
            self._time = until
            if due <= until:
                self._target = self._waiting.popleft()[1]
