"""Regulation of contact force: PI on the closure of each drive, with back-calculation.

Fingers that press from two sides are regulated together: only errors that leave their sum alone.

The plant is a position-controlled drive against a spring: after a dead time L the force follows
the command with time constant T and gain K, the stiffness. Gains are the SIMC rules of that plant:
Kc = T / (K (Tc + L)) and Ti = min(T, 4 (Tc + L)), so that one setting serves every stiffness and
the speed follows from the dead time: slow hands get slow loops.

Sources: S. Skogestad, Simple analytic rules for model reduction and PID controller tuning,
J. Process Control 13 (2003) 291, Table 1. Back-calculation: K. J. Astrom and T. Hagglund, Advanced
PID Control (2006), sec. 3.5, with the tracking time equal to Ti.

Free drive: Force grows with this closure at the rate that a force loop meets. The measured closure
tells that rate of stiff drives alone: a soft one stands still at a hard object, however its target
moves.
"""

from __future__ import annotations

from collections import deque
from math import exp, inf, isfinite, isnan, nan
from typing import TYPE_CHECKING

from tactile_ros.control.slip_margin import mean_of
from tactile_ros.control.stiffness import Stiffness
from tactile_ros.control.targets import balanced

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tactile_ros.control.config import GripConfig
    from tactile_ros.control.slip_margin import Fingers
    from tactile_ros.control.targets import GripTargets

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
    >>> from tactile_ros.control.config import GripConfig
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
    >>> from tactile_ros.control.config import GripConfig
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


IMPACT = 2.0  # asked forces that an approach may meet in the time to react
SLOWEST = 0.5  # share of its speed that an approach keeps, however far its drive is behind
KNOWN = 0.5  # error of a stiffness that is known, of its value
BOTH = 3  # bits of two sides
SAME = 1e-9  # closure within which a command was admitted as it was


class GripDrives:
    """Commands of a drives.

    Parameters
    ----------
    config : GripConfig
        Gains and limits.
    count : int
        How many drives (a).
    sides : sequence of int
        Of the fingers: +1, -1, 0.
    fingers : Fingers
        What they feel.
    targets : GripTargets
        What they shall hold.

    Attributes
    ----------
    laws, stiffness : list
        `DriveLaw` and `Stiffness` of each drive.
    calm : float
        How long the errors of all that touch have been small (s).
    disagreement : float
        By which share the weaker of two sides feels less; NaN where no two sides touch.
    """

    def __init__(
        self,
        config: GripConfig,
        count: int,
        sides: Sequence[int],
        fingers: Fingers,
        targets: GripTargets,
    ) -> None:
        self.config = config
        self.laws = [DriveLaw(config) for _ in range(count)]
        self.stiffness = [Stiffness(config) for _ in range(count)]
        self._driven = [Stiffness(config) for _ in range(count)]
        self._free = [FreeDrive(config) for _ in range(count)]
        self._touched = [0.0] * count
        self._sides = sides
        self._opposed = {-1, 1} <= set(sides)
        self._fingers, self._targets = fingers, targets
        self.calm = self._unseen = 0.0
        self.disagreement = nan

    def restart(self) -> None:
        """Nothing is held: another object may come."""
        self.calm = self._unseen = 0.0
        self.disagreement = nan
        for one in (*self.stiffness, *self._driven):
            one.reset()

    def release(self) -> None:
        """Where the drives are has to be measured before the next command."""
        for law in self.laws:
            law.command = nan

    def start(self, closures: Sequence[float]) -> str:
        """Begin from where the drives are; why that is not possible, or empty."""
        for i, (law, closure) in enumerate(zip(self.laws, closures, strict=True)):
            if isfinite(law.command):
                continue
            if not isfinite(closure):
                return f'closure of drive {i} was never measured'
            law.seat(closure)
            self._free[i].seat(law.command)
        return ''

    def settle(self) -> None:
        """After a fault: go on from the last command."""
        self._unseen = 0.0
        for law in self.laws:
            law.seat(law.command)

    def move(self, speed: float, dt: float) -> None:
        """Move all drives at a speed (1/s), positive closes."""
        for law, free in zip(self.laws, self._free, strict=True):
            law.move(speed, dt)
            free.step(law.command, dt)

    def stay(self) -> None:
        """Leave all drives where they are."""
        for law in self.laws:
            law.stay()

    def admit(self, closures: Sequence[float], reached: Sequence[float], dt: float) -> None:
        """Go on from closures (a,) that were sent, where they are not the last commands."""
        for law, closure, reach in zip(self.laws, closures, reached, strict=True):
            law.stopped = reach < law.command - SAME
            if abs(closure - law.command) > SAME:
                law.yield_to(closure, dt)

    def meet(self, drive: int, closure: float) -> None:
        """End a drive's approach where it is now, measured at a closure.

        A soft drive presses by what its joints stand behind its motion: turned back to where they
        are measured, it would let go of what it has just touched. Where no closure is measured
        (NaN) its model alone tells where it is.
        """
        told = self._free[drive].closure
        self.laws[drive].retreat(closure if closure > told else told)

    def drive(self, normal: list[float], closures: list[float], dt: float, holding: bool) -> None:
        """Decide the commands of a step of `dt` (s) from forces (f,) and closures (a,)."""
        for law, free in zip(self.laws, self._free, strict=True):
            free.step(law.command, dt)
        regulates = self._fingers.complete
        for drive, touching in enumerate(self._fingers.on):
            self._touched[drive] = self._touched[drive] + dt if touching else 0.0
            if not touching:
                self.laws[drive].move(self._approach(drive, closures[drive]), dt)
            elif not regulates:
                self.laws[drive].follow(dt)
        if regulates:
            self._regulate(normal, closures, dt, holding)
            self._fingers.spend()
            self._unseen = 0.0
        else:
            self._unseen += dt

    def _regulate(
        self, normal: list[float], closures: list[float], dt: float, holding: bool
    ) -> None:
        """Commands of the drives that touch, from forces that are all new."""
        targets, most = self._targets.now, self.config.force_high
        errors = [nan] * len(targets)
        for touching in self._fingers.on:
            for i in touching:
                errors[i] = targets[i] - normal[i]
        if self._opposed:
            errors = balanced(errors, self._sides, targets, self.config.balance_high)
            self.disagreement = self._disagreement(normal)
        # an object that one side pushes away feels soft: that is not its stiffness
        gripped = not self._opposed or not isnan(self.disagreement)
        for drive, touching in enumerate(self._fingers.on):
            if not touching:
                continue
            if gripped:
                self._learn(drive, closures[drive], mean_of(normal, touching))
            error = bounded(mean_of(errors, touching), -most, most)
            self.laws[drive].regulate(error, self._stiff(drive), dt, self._unseen)
        small = holding and self._are_small(errors)
        self.calm = self.calm + dt + self._unseen if small else 0.0

    def _learn(self, drive: int, closure: float, force: float) -> None:
        """Learn from a force (N) at a measured closure how stiff a drive's contact is."""
        if isfinite(closure):
            self.stiffness[drive].step(closure, force)
        # an approach that has not come to rest yet tells no stiffness
        if self._touched[drive] > self.laws[drive].reaction:
            self._driven[drive].step(self._free[drive].closure, force)

    def _stiff(self, drive: int) -> float:
        """Stiffness (N per closure) to schedule the gain by.

        Measured closures of a soft drive tell nothing at a hard object; those of its model come
        early where it is slower than it was said to be. The larger is the calmer.
        """
        measured, driven = self.stiffness[drive], self._driven[drive]
        if driven.std < KNOWN * driven.value:
            return max(measured.cautious, driven.cautious)
        return measured.cautious

    def _disagreement(self, normal: list[float]) -> float:
        """By which share the forces (N) of the weaker side are less; NaN: one side is alone."""
        first = second = 0.0
        sides = 0
        for touching in self._fingers.on:
            for i in touching:
                side = self._sides[i]
                if side > 0:
                    first, sides = first + normal[i], sides | 1
                elif side < 0:
                    second, sides = second + normal[i], sides | 2
        most = first if first > second else second
        return abs(first - second) / most if sides == BOTH and most > 0.0 else nan

    def _are_small(self, errors: list[float]) -> bool:
        """Whether something touches, and no error (N) is more than settled."""
        share, noise = self.config.settled_share, self.config.force_noise
        if not any(self._fingers.on):
            return False
        for error, target in zip(errors, self._targets.now, strict=True):
            if abs(error) > share * target and abs(error) > noise:
                return False
        return True

    def _approach(self, drive: int, closure: float) -> float:
        """Speed (1/s) of a drive that nothing touches; one that feels nothing stays.

        A hand that is opened beyond its open posture comes to that as fast as it opens: a touch
        stops it there too. A drive that is measured behind its model reacts later than was told,
        or moves slower: the way that it lacks and that of a reaction together are to stay the one
        that was allowed. Joints that merely hang behind their targets look the same, hence no
        less than half.
        """
        if not self._fingers.feeling[drive]:
            return 0.0
        if self.laws[drive].command < self.config.closure_low:
            return self.config.opening_rate
        reaction = self.laws[drive].reaction
        way = IMPACT * self._targets.lightest / self.config.stiffness_high
        speed = min(self.config.closing_rate, way / reaction)
        behind = self._free[drive].closure - closure
        if isnan(behind):
            return speed
        return bounded((way - behind) / reaction, SLOWEST * speed, speed)
