"""PI of contact force on the closure of one drive, with anti-windup by back-calculation.

The plant is a position-controlled drive against a spring: after a dead time L the force follows
the command with time constant T and gain K, the stiffness. Gains are the SIMC rules of that plant:
Kc = T / (K (Tc + L)) and Ti = min(T, 4 (Tc + L)), so that one setting serves every stiffness and
the speed follows from the dead time: slow hands get slow loops.

Sources: S. Skogestad, Simple analytic rules for model reduction and PID controller tuning,
J. Process Control 13 (2003) 291, Table 1. Back-calculation: K. J. Astrom and T. Hagglund, Advanced
PID Control (2006), sec. 3.5, with the tracking time equal to Ti.
"""

from __future__ import annotations

from math import isnan, nan
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tactile_ros.control.grip_config import GripConfig

HALF_HOLD, COMPUTING = 0.5, 1.0  # slowest periods that sampling adds to the dead time
FARTHEST = 4.0  # closures that a hand may be opened beyond its open posture


def bounded(value: float, low: float, high: float) -> float:
    """Nearest number inside bounds, which cost less than min and max."""
    return low if value < low else high if value > high else value


class DriveLaw:
    """Command of one drive: moved at a speed, or regulated on force.

    Parameters
    ----------
    config : GripConfig
        Plant and limits.

    Attributes
    ----------
    command : float
        Last closure; NaN before `seat`.
    limited : bool
        Whether the last step was clamped or rate limited.
    stopped : bool
        Whether less than the last command is within the hand's reach: it can close no further now.

    Examples
    --------
    >>> from tactile_ros.control.grip_config import GripConfig
    >>> law = DriveLaw(GripConfig())
    >>> law.seat(0.4)
    >>> law.regulate(0.0, 50.0, 0.01), law.regulate(1.0, 50.0, 0.01) > 0.4
    (0.4, True)
    """

    def __init__(self, config: GripConfig) -> None:
        self.config = config
        delay = config.dead_time + (HALF_HOLD + COMPUTING) * config.slowest_period
        self._closed_loop = (1.0 + config.response) * delay
        self._integral_time = min(config.lag, 4.0 * self._closed_loop)
        self.reaction = delay + config.lag
        self.command = nan
        self.limited = self.stopped = False
        self._integral = nan
        self._gain = nan
        self._from = nan
        self._wanted = nan

    def seat(self, closure: float) -> None:
        """Begin from a closure: the next command starts there, whatever the error is.

        One below the limits is no closure to be asked for, but where a hand that is opened further
        may be: from there it comes as carefully as from anywhere.
        """
        low, high = self.config.closure_low - FARTHEST, self.config.closure_high
        self.command = bounded(closure, low, high)
        self._integral = self._from = self._wanted = nan
        self.limited = self.stopped = False

    def retreat(self, closure: float) -> None:
        """Let the next regulated command start from a measured closure, as fast as it may."""
        back = min(closure, self.command)
        self._integral = self._wanted = nan
        self._from = back

    def move(self, speed: float, dt: float) -> float:
        """Command after moving at a speed (1/s), positive closes; force is not looked at."""
        self._integral = self._wanted = nan
        return self._admit(self.command + speed * dt, dt)

    def follow(self, dt: float) -> float:
        """Command on the way to what the last force asked for, and not beyond."""
        return self._admit(self.command if isnan(self._wanted) else self._wanted, dt)

    def stay(self) -> None:
        """Leave the command where it is."""
        self._wanted = nan
        self.limited = False

    def regulate(self, error: float, stiffness: float, dt: float, unseen: float = 0.0) -> float:
        """Command that takes an error of force (N) away.

        Parameters
        ----------
        error : float
            Target less force (N), finite.
        stiffness : float
            To schedule the gain by (N per closure).
        dt : float
            Since the last step (s).
        unseen : float
            Time of the steps before it in which no force was new (s): integrated here, once.

        Returns
        -------
        float
            Closure, inside the limits.
        """
        gain = self.config.lag / (stiffness * self._closed_loop)
        if isnan(self._integral):
            start = self.command if isnan(self._from) else self._from
            self._integral, self._from = start - gain * error, nan
        else:  # the gain changes without a bump
            self._integral += (self._gain - gain) * error
        self._gain = gain
        self._integral += gain / self._integral_time * error * (dt + unseen)
        wanted = self._integral + gain * error
        self._wanted = wanted
        made = self._admit(wanted, dt)
        if made != wanted:
            self._integral += min(dt / self._integral_time, 1.0) * (made - wanted)
        return made

    def yield_to(self, closure: float, dt: float) -> None:
        """Go on from a closure that was sent instead of the command, without winding up.

        Parameters
        ----------
        closure : float
            What a limit behind this law let through.
        dt : float
            Of the last step (s).
        """
        self._integral += min(dt / self._integral_time, 1.0) * (closure - self.command)
        self.command = closure
        self.limited = True

    def _admit(self, wanted: float, dt: float) -> float:
        """Nearest command inside limits and rate."""
        step = self.config.closure_rate * dt
        near = bounded(wanted, self.command - step, self.command + step)
        low = min(self.config.closure_low, self.command)
        made = bounded(near, low, self.config.closure_high)
        self.limited = made != wanted
        self.command = made
        return made
