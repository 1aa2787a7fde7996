# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Force PI of one drive: SIMC gains, back-calculation, feed-forward, and the plant that it learns.

Plant: after a dead time L the force of a pad follows the command of its drive with a time constant
T and the gain K (N per closure). K of a drive that gives way is at most its own, K = (lever .
closing) / sum(lever^2 / kp), whatever the object; between the limits of `Drive` it is learned from
force over the command as the plant delays it.

Regulator: PI with the SIMC rules of that plant, Kc = T / (K (Tc + L)) and Ti = min(T, 4 (Tc + L)),
so that one setting serves every stiffness and slow hands get slow loops; back-calculation against
windup, also from what joints, torque clips and rates let through.

Sources: S. Skogestad, Simple analytic rules for model reduction and PID controller tuning, J.
Process Control 13 (2003) 291, Table 1; K. J. Astrom and T. Hagglund, Advanced PID Control (2006),
sec. 3.5.
"""

from __future__ import annotations

from collections import deque
from math import exp, inf, isfinite, nan, sqrt
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tactile_ros.control.config import Drive, GripConfig

CLOSED, PRESSED = 1.25, 3.0  # closure at which an approach ends, and largest command beyond
FARTHEST = 4.0  # closures that a hand may be opened beyond its open posture
STIFFER = 4.0  # times its own gain that a drive may turn out to have
FADE, MOVED = 30.0, 2e-4  # closure that a point of the stiffness lasts, in its noise
KNOWN = 0.5  # error of a stiffness that is known, of its value


def bounded(value: float, low: float, high: float) -> float:
    """Nearest number inside bounds, which cost less than min and max."""
    return low if value < low else high if value > high else value


class Stiffness:
    """Gain of a plant: least squares of force over closure with a prior.

    Old points fade with the way that the drive has gone and not with time, so that a long hold
    neither forgets nor winds up the estimate, and a stiffening object is followed.
    """

    def __init__(self, plant: Drive) -> None:
        self._plant = plant
        self.reset()

    def reset(self) -> None:
        """Forget the object: as stiff as can be, and anything down to the softest."""
        low, high = self._plant.stiffness_low, self._plant.stiffness_high
        self._prior, self._spread = 0.5 * (low + high), 0.5 * (high - low)
        self.value, self.cautious = self._prior, high
        self._count = self._x = self._f = self._xx = self._xf = 0.0
        self._last = self._origin = nan

    def step(self, closure: float, force: float, sigma: float) -> None:
        """Take in a force (N) at a closure; one within noise of the last is passed over."""
        moved = abs(closure - self._last)
        if moved < MOVED:
            return
        if self._count == 0.0:
            self._origin, moved = closure, 0.0
        self._last = closure
        keep, x = exp(-moved / (FADE * MOVED)), closure - self._origin
        self._count = keep * self._count + 1.0
        self._x, self._f = keep * self._x + x, keep * self._f + force
        self._xx, self._xf = keep * self._xx + x * x, keep * self._xf + x * force
        spread = max(self._xx - self._x * self._x / self._count, 0.0)
        along = self._xf - self._x * self._f / self._count
        error = sigma**2 + (self.value * MOVED) ** 2
        precision = 1.0 / self._spread**2 + spread / error
        value = (self._prior / self._spread**2 + along / error) / precision
        high = self._plant.stiffness_high
        most = STIFFER * high if self._plant.is_soft else high  # gains of a drive may be others
        self.value = bounded(value, self._plant.stiffness_low, most)
        std = sqrt(1.0 / precision)
        self.cautious = min(self.value + std, most) if std < KNOWN * self.value else high


class ForcePi:
    """Command of one drive: moved at a speed, or regulated on force.

    Examples
    --------
    >>> from tactile_ros.control.config import Drive, GripConfig
    >>> law = ForcePi(GripConfig(), Drive(5.0, 300.0))
    >>> law.reset(0.4)
    >>> law.regulate(1.0, 1.0, 0.01), law.regulate(2.0, 1.0, 0.01) > 0.4
    (0.4, True)
    """

    def __init__(self, config: GripConfig, plant: Drive) -> None:
        self.config, self.plant, self.stiffness = config, plant, Stiffness(plant)
        self._integral_time = min(config.lag, 4.0 * config.loop_time)
        self.reaction = config.delay + config.lag
        self._waiting: deque[tuple[float, float]] = deque()
        self._time = 0.0
        self.reset(nan)

    def reset(self, closure: float, contact: float = nan) -> None:
        """Begin at rest at a closure: the next command starts there, whatever the error is."""
        self.command = self._target = bounded(closure, -FARTHEST, PRESSED)  # last closure
        self.contact = contact  # closure at which it met the object; NaN: none yet
        self.free = self.command  # where the drive is by now if nothing is in its way
        self._waiting.clear()
        self._integral = self._gain = self._wanted = self._from = nan
        self._goal = self._follows = self._error = nan
        self.touched = 0.0  # time of regulation since it met the object (s)
        self.limited = False  # the last step was clamped or rate limited
        self.stop = ''  # limit of the hand that lets it close no further now; empty: none
        self.full = False  # a drive or a joint is at its limit

    def meet(self, closure: float) -> None:
        """End the approach where it is now: as measured, or by the model where that is further."""
        back = min(closure if closure > self.free else self.free, self.command)
        self._integral = self._wanted = nan
        self._from = self.contact = back

    def move(self, speed: float, dt: float) -> float:
        """Command after moving at a speed (1/s), positive closes; force is not looked at."""
        self._integral = self._wanted = nan
        self.touched = 0.0
        high = CLOSED if speed > 0.0 and not isfinite(self.contact) else PRESSED
        return self._admit(self.command + speed * dt, dt, max(high, self.command))

    @property
    def trailing(self) -> float:
        """Closure by which a drive that is free is behind its command, after the dead time."""
        return self._target - self.free

    def follow(self, dt: float) -> float:
        """Command on the way to what the last force asked for, and not beyond."""
        return self._admit(self._wanted if isfinite(self._wanted) else self.command, dt)

    def stay(self) -> None:
        """Leave the command where it is."""
        self._wanted, self.limited = nan, False

    def regulate(
        self, target: float, force: float, dt: float, unseen: float = 0.0, keeps: bool = False
    ) -> float:
        """Command that brings a force to a target (N); `unseen` (s) brought no new force.

        One that `keeps` its command moves by its target alone. Where the drive's own gain is
        known, a target that moves goes to the command at once, and to the error as the plant
        follows.
        """
        begins, soft = not isfinite(self._integral), self.plant.is_soft
        if begins:
            self._goal = self._follows = target
        near = 1.0 - exp(-(dt + unseen) / self.reaction) if soft else 1.0
        self._follows += near * (target - self._follows)
        most = self.config.force_high
        error = bounded(self._follows - force, -most, most)
        loop = self.stiffness.cautious * self.config.loop_time
        gain = 0.0 if keeps else self.config.lag / loop
        if begins:
            start = self._from if isfinite(self._from) else self.command
            self._integral, self._from = start - gain * error, nan
        else:  # the gain changes without a bump
            self._integral += (self._gain - gain) * (self._error if keeps else error)
            if soft:
                self._integral += (target - self._goal) / self.stiffness.cautious
        self._gain, self._goal, self._error = gain, target, error
        if not (self.stop and error > 0.0):
            self._integral += gain / self._integral_time * error * (dt + unseen)
        self._wanted = self._integral + gain * error
        made = self._admit(self._wanted, dt)
        if made != self._wanted:
            self._back_calculate(made - self._wanted, dt)
        return made

    def yield_to(self, closure: float, dt: float) -> None:
        """Go on from a closure that was sent instead of the command, without winding up."""
        if isfinite(self._integral):
            self._back_calculate(closure - self.command, dt)
        self.command, self.limited = closure, True

    def _back_calculate(self, lacking: float, dt: float) -> None:
        """Take from the integral by what a command was cut."""
        self._integral += min(dt / self._integral_time, 1.0) * lacking

    def let_time_pass(self, dt: float) -> None:
        """Move the model of the free drive by a time dt (s)."""
        self._waiting.append((self._time + self.config.dead_time, self.command))
        end = self._time + dt
        while self._time < end:
            due = self._waiting[0][0] if self._waiting else inf
            until = min(max(due, self._time), end)
            share = 1.0 - exp((self._time - until) / self.config.lag)
            self.free += (self._target - self.free) * share
            self._time = until
            if due <= until:
                self._target = self._waiting.popleft()[1]

    def _admit(self, wanted: float, dt: float, high: float = PRESSED) -> float:
        """Nearest command inside limits and rate."""
        step = self.plant.fastest * dt
        near = bounded(wanted, self.command - step, self.command + step)
        made = bounded(near, min(0.0, self.command), high)
        self.limited = made != wanted
        self.command = made
        return made
