"""The drives of a grip: each approaches until it touches, then it is regulated on force.

Fingers that press from two sides are regulated together: only errors that leave their sum alone.
"""

from __future__ import annotations

from math import isfinite, isnan, nan
from typing import TYPE_CHECKING

from tactile_ros.control.drive_law import DriveLaw, bounded
from tactile_ros.control.fingers import mean_of
from tactile_ros.control.free_drive import FreeDrive
from tactile_ros.control.grip_targets import balanced
from tactile_ros.control.stiffness import Stiffness

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tactile_ros.control.fingers import Fingers
    from tactile_ros.control.grip_config import GripConfig
    from tactile_ros.control.grip_targets import GripTargets

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
