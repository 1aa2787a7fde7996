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
    from tactile_ros.control.slip_margin import SlipMargin

LOADING = 3.0  # growth of a target to load: forces of 1 N in loop times
RAISING = 5.0  # growth of one that slip or load raise, of that
MARGIN = 0.5  # least slip margin; half survives a halved friction
SLIP_RAISE = 2.0  # factor on the target at a slip
AHEAD = 0.75  # of what is asked, by which a raise may be ahead of the force
SLIP_PAUSE = 0.08  # s from one raise to the next
MOST = 5.0  # largest raised target, in asked targets
MOST_LOAD = 3.0  # the same without a slip: fingers that press askew load each other
MOST_UNFRAMED = 1.2  # the same where no normal of the contact is measured


def shared(targets: Sequence[float], sides: Sequence[int], used: Sequence[bool]) -> list[float]:
    """Targets of the fingers, of which the stronger side is drawn down to the weaker.

    Parameters
    ----------
    targets : sequence of float
        What each finger was asked for (N).
    sides : sequence of int
        +1, -1, or 0 where a finger opposes none.
    used : sequence of bool
        Fingers that take part.

    Returns
    -------
    list of float
        None above what was asked; 0 for fingers that take no part.

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
    """Targets of f fingers in time: they grow at a rate, and with slip and load.

    Parameters
    ----------
    config : GripConfig
        Time of the loop, largest force, and the time in which a raise fades.
    sides : sequence of int
        Of the fingers.

    Attributes
    ----------
    now, asked : list of float
        Targets in force, and without raises (N).
    """

    def __init__(self, config: GripConfig, sides: Sequence[int]) -> None:
        self.config = config
        self.sides = list(sides)
        self._rate = LOADING / config.loop_time
        self._each = [0.0] * len(self.sides)
        self._used = [False] * len(self.sides)
        self.asked = [0.0] * len(self.sides)
        self._adapt = False
        self.restart()

    def restart(self) -> None:
        """Begin a grasp."""
        self.now = [0.0] * len(self.sides)
        self._raise, self._since, self._slips, self._slipping = 1.0, 0.0, 0, False

    def ask(self, targets: Sequence[float], used: Sequence[bool], adapt: bool) -> None:
        """Say what is wanted (N), of which fingers, and whether it may be raised."""
        self._each, self._used = list(targets), list(used)
        self.asked = shared(targets, self.sides, used)
        self._adapt, self._raise = adapt, 1.0

    def share(self, pressing: Sequence[bool]) -> None:
        """Share what was asked among the fingers that press, where both sides still do."""
        press = [use and one for use, one in zip(self._used, pressing, strict=True)]
        wanted = {side for side, use in zip(self.sides, self._used, strict=True) if use}
        if {side for side, one in zip(self.sides, press, strict=True) if one} == wanted:
            self.asked = shared(self._each, self.sides, press)

    def touch(self, levels: Sequence[float]) -> None:
        """Targets of fingers that wait for the others: levels (N) of sure contact."""
        self.now = [min(level, ask) for level, ask in zip(levels, self.asked, strict=True)]

    @property
    def lightest(self) -> float:
        """Smallest force (N) that a finger is asked for."""
        return min((asked for asked in self.asked if asked > 0), default=0.0)

    def grow(
        self,
        slips: Sequence[SlipMargin],
        framed: Sequence[bool],
        forces: Sequence[float],
        full: bool,
        dt: float,
    ) -> bool:
        """Move towards what is wanted; return whether every target is where it should be.

        A raise waits for the slowest finger, so that drives that can give no more stop all.

        Parameters
        ----------
        slips : sequence of SlipMargin
            Of the fingers.
        framed : sequence of bool
            Fingers whose normal is measured: a tilt of others looks like a load.
        forces : sequence of float
            Of the fingers (N); NaN: not known.
        full : bool
            A drive gives all its torque: a raise would push the object to its side.
        dt : float
            Since the last step (s).
        """
        if self._adapt:
            self._answer(slips, framed, dt)
        step = self._rate * dt * (RAISING if self._raise > 1.0 else 1.0)
        reached, factor = True, self._raise
        for asked, force in zip(self.asked, forces, strict=True):
            if asked > 0.0 and factor > 1.0:
                factor = min(factor, max(force / asked + AHEAD, 1.0))  # as it is for NaN
        for i, asked in enumerate(self.asked):
            ahead = factor * asked - self.now[i]
            if full and ahead > 0.0 and self.now[i] >= asked:
                continue
            if -step <= ahead <= step:
                self.now[i] = factor * asked
            else:
                self.now[i] += step if ahead > 0 else -step
                reached = False
        return reached

    def _answer(self, slips: Sequence[SlipMargin], framed: Sequence[bool], dt: float) -> None:
        """Raise all fingers by one factor, so that they stay balanced; what is spare fades."""
        strongest = max(self.asked)
        if strongest <= 0.0:
            return
        most = max(min(MOST, self.config.force_high / strongest), 1.0)
        self._since += dt
        needed, slipping = 1.0, False
        for slip, asked, known in zip(slips, self.asked, framed, strict=True):
            if asked > 0.0:
                slipping = slipping or slip.slipping
                load = slip.needed(MARGIN) / asked
                needed = max(needed, min(load, MOST_LOAD if known else MOST_UNFRAMED))
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
