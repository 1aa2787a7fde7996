# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Target force of every finger: shared over the sides of an object, raised by slip and load.

Fingers that press from two sides carry the same sum, whatever each is asked for. So the asked
force is shared out until both sides agree.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from tactile_ros.control.slip_margin import faded

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tactile_ros.control.config import GripConfig
    from tactile_ros.control.finger import Finger

LOADING = 3.0  # growth of a target to load: forces of 1 N in loop times
RAISING = 5.0  # growth of one that slip or load raise, of that
MARGIN = 0.5  # least slip margin; half survives a halved friction
SLIP_RAISE = 2.0  # factor on the target at a slip
AHEAD = 0.75  # of what is asked, by which a raise may be ahead of the force
AHEAD_FULL = 0.1  # the same of a finger whose drive gives all it can
SLIP_PAUSE = 0.08  # s from one raise to the next
BOUNCE = 0.05  # s for which a finger may lift off, or must touch, to count
MOST = 5.0  # largest raised target, in asked targets
MOST_LOAD = 3.0  # the same without a slip: fingers that press askew load each other
MOST_UNFRAMED = 1.2  # the same where no normal of the contact is measured


def shared(targets: Sequence[float], sides: Sequence[int], used: Sequence[bool]) -> list[float]:
    """Targets of the fingers, of which the stronger side is drawn down to the weaker.

    `targets` are what each was asked for (N), `sides` +1, -1, or 0 where one opposes none, `used`
    the fingers that take part. None gets more than it was asked for, others get 0.

    Examples
    --------
    >>> shared([3.0, 3.0, 3.0, 3.0], [1, 1, 1, -1], [True] * 4)
    [1.0, 1.0, 1.0, 3.0]
    """
    kept = [target if use else 0.0 for target, use in zip(targets, used, strict=True)]
    sums = {1: 0.0, -1: 0.0, 0: 0.0}
    for target, side in zip(kept, sides, strict=True):
        sums[side] += target
    least = min(sums[1], sums[-1])
    if least <= 0.0:
        return kept
    return [t * least / sums[side] if side else t for t, side in zip(kept, sides, strict=True)]


class GripTargets:
    """Targets of fingers in time (`Finger.target`): they grow at a rate, and with slip and load.

    The config gives the time of the loop, the largest force, and the time in which a raise fades.
    """

    def __init__(self, config: GripConfig, fingers: Sequence[Finger]) -> None:
        self.config, self._fingers = config, list(fingers)
        self._rate = LOADING / config.loop_time
        self._each = [0.0] * len(self._fingers)
        self._adapt = False
        self.restart()

    def restart(self) -> None:
        """Begin a grasp."""
        self._raise, self._since, self._slips, self._slipping = 1.0, 0.0, 0, False
        self._most = MOST

    def begin(self, targets: Sequence[float], adapt: bool) -> None:
        """Begin to go to targets (N) of the fingers in use, which may be raised if `adapt`.

        What is held at a raised force stays so, until the raise fades.
        """
        raised = self._raise * self.strongest if adapt and self._raise > 1.0 else 0.0
        self._each, self._adapt, self._most = list(targets), adapt, MOST
        self._pressing = [finger.used for finger in self._fingers]
        self._share(self._pressing)
        self._raise = max(raised / self.strongest, 1.0) if raised else 1.0

    def adopt(self) -> None:
        """Begin with what is held already; if it is more than asked for, it was raised."""
        held = max((f.normal for f in self._fingers if f.touching), default=0.0) / self.strongest
        for finger in self._fingers:
            finger.target = held * finger.asked
        self._raise = max(held, 1.0) if self._adapt else 1.0

    def _share(self, pressing: Sequence[bool]) -> None:
        """Share what was asked for among fingers."""
        sides = [finger.side for finger in self._fingers]
        asked = shared(self._each, sides, pressing)
        for finger, force in zip(self._fingers, asked, strict=True):
            finger.asked = force

    def share(self) -> bool:
        """Share what was asked among the fingers that press, where both sides still do.

        Returns whether they are others than before.
        """
        press = [f.used and (f.touching or f.steady < BOUNCE) for f in self._fingers]
        wanted = {finger.side for finger in self._fingers if finger.used}
        sides = {f.side for f, one in zip(self._fingers, press, strict=True) if one}
        if sides != wanted or press == self._pressing:
            return False
        self._pressing = press
        self._share(press)
        return True

    @property
    def strongest(self) -> float:
        """Largest force (N) that a finger is asked for."""
        return max(finger.asked for finger in self._fingers)

    @property
    def lightest(self) -> float:
        """Smallest force (N) that a finger is asked for."""
        return min((f.asked for f in self._fingers if f.asked > 0), default=0.0)

    def grow(self, settled: bool, dt: float) -> bool:
        """Move towards what is wanted; return whether every target is where it should be.

        Until all have settled a raise waits for the slowest finger, so that drives that can give
        no more stop all. A finger that has just touched does not count: one that bounces would end
        the raise. Once settled each presses as hard as it can: a load waits for none.
        """
        self._most = MOST if settled else self._most
        if self._adapt:
            self._answer(dt)
        step = self._rate * dt * (RAISING if self._raise > 1.0 else 1.0)
        reached, factor = True, self._raise
        for finger in self._fingers:
            counts = not settled and finger.pressing and finger.steady >= BOUNCE
            if counts and finger.asked > 0.0 and factor > 1.0:
                ahead = AHEAD_FULL if finger.law.full else AHEAD
                bound = max(finger.normal / finger.asked + ahead, 1.0)
                factor = min(factor, bound)
                if finger.law.full and bound < self._raise:
                    self._raise = self._most = bound
        for finger in self._fingers:
            ahead = factor * finger.asked - finger.target
            if -step <= ahead <= step:
                finger.target = factor * finger.asked
            else:
                finger.target += step if ahead > 0 else -step
                reached = False
        return reached

    def _answer(self, dt: float) -> None:
        """Raise all fingers by one factor, so that they stay balanced; what is spare fades."""
        strongest = self.strongest
        if strongest <= 0.0:
            return
        most = max(min(self._most, self.config.force_high / strongest), 1.0)
        self._since += dt
        needed, slipping = 1.0, False
        for finger in self._fingers:
            if finger.asked > 0.0:
                slipping = slipping or finger.slip.slipping
                load = finger.slip.needed(MARGIN) / finger.asked
                # a tilt of a normal that is not measured looks like a load
                needed = max(
                    needed, min(load, MOST_LOAD if finger.given.framed else MOST_UNFRAMED)
                )
        self._slips += slipping and not self._slipping
        self._slipping = slipping
        wanted = needed
        if slipping and self._since >= SLIP_PAUSE:
            wanted = max(needed, self._raise * SLIP_RAISE)
        if wanted > self._raise:
            self._raise, self._since = min(wanted, most), 0.0
        elif self._raise > 1.0 and not slipping:
            spare = self._raise - min(needed, self._raise)
            self._raise -= spare * faded(dt, self.config.relax_time, self._slips)
