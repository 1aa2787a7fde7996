"""Target force of every finger: balanced over the sides of an object, raised by slip and load.

Fingers that press from two sides carry the same sum, whatever each is told. So the asked force is
shared out until both sides agree, and only that part of the errors is regulated which leaves the
sum balanced: otherwise two sensors that differ by a few percent would walk the object to one side.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from tactile_ros.control.slip_margin import faded

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tactile_ros.control.config import GripConfig
    from tactile_ros.control.slip_margin import SlipMargin


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


def balanced(
    errors: list[float], sides: Sequence[int], targets: Sequence[float], most: float
) -> list[float]:
    """Errors (N) of touching fingers without the part that would move the object.

    What that adds to a finger is bounded: a sensor that reads a tenth of the truth would let the
    others press as hard as it wants. Beyond the bound both sides are eased by the same sum, which
    leaves the balance as it is, and the strongest reading rules.

    Parameters
    ----------
    errors : list of float
        One for each finger; NaN: it does not touch, or its force is not known.
    sides : sequence of int
        +1, -1, or 0.
    targets : sequence of float
        Of the fingers (N).
    most : float
        That may be added to a finger, of its target.

    Returns
    -------
    list of float
        As they came where only one side touches.

    Examples
    --------
    >>> balanced([1.0, 0.5], [1, -1], [2.0, 2.0], 0.2)
    [0.75, 0.75]
    >>> balanced([-1.0, 1.0], [1, -1], [2.0, 2.0], 0.2)
    [-0.6, -0.6]
    """
    net, count = 0.0, 0
    first = second = 0.0
    for error, side, target in zip(errors, sides, targets, strict=True):
        if side and error == error:  # noqa: PLR0124 - false of NaN, at a third of isnan's price
            net += side * error
            count += 1
            if side > 0:
                first += target
            else:
                second += target
    if not (first > 0.0 and second > 0.0):
        return errors
    net /= count
    ease = 0.0
    for error, side, target in zip(errors, sides, targets, strict=True):
        beyond = -side * net - most * target
        if beyond > 0.0 and error == error and target > 0.0:  # noqa: PLR0124
            ease = max(ease, beyond / target * (first if side > 0 else second))
    made = [error - side * net for error, side in zip(errors, sides, strict=True)]
    if ease == 0.0:
        return made
    shares = {1: ease / first, -1: ease / second, 0: 0.0}
    return [e - shares[s] * t for e, s, t in zip(made, sides, targets, strict=True)]


class GripTargets:
    """Targets of f fingers in time: they grow at a rate, and with slip and load.

    Parameters
    ----------
    config : GripConfig
        Rates and limits.
    sides : sequence of int
        Of the fingers.

    Attributes
    ----------
    now : list of float
        Targets in force (N).
    """

    def __init__(self, config: GripConfig, sides: Sequence[int]) -> None:
        self.config = config
        self.sides = list(sides)
        self._each = [0.0] * len(self.sides)
        self._used = [False] * len(self.sides)
        self._asked = [0.0] * len(self.sides)
        self._shared: list[bool] = []
        self._adapt = False
        self.restart()

    def restart(self) -> None:
        """Begin a grasp: targets of touch."""
        self.now = [0.0] * len(self.sides)
        self._raise = 1.0
        self._since = 0.0
        self._slips = 0
        self._slipping = False

    def ask(self, targets: Sequence[float], used: Sequence[bool], adapt: bool) -> None:
        """Say what is wanted (N), of which fingers, and whether it may be raised."""
        self._each, self._used, self._shared = list(targets), list(used), []
        self._asked = shared(targets, self.sides, used)
        self._adapt = adapt
        self._raise = 1.0

    def share(self, touching: Sequence[bool]) -> None:
        """Share what was asked among the fingers that press, where both sides still do.

        Parameters
        ----------
        touching : sequence of bool
            Fingers on the object; one whose force is lost holds its place, and presses on.
        """
        if self._shared == touching:
            return
        self._shared = list(touching)
        press = [use and touch for use, touch in zip(self._used, touching, strict=True)]
        wanted = {side for side, use in zip(self.sides, self._used, strict=True) if use}
        if {side for side, one in zip(self.sides, press, strict=True) if one} == wanted:
            self._asked = shared(self._each, self.sides, press)

    def touch(self) -> None:
        """Targets of fingers that wait for the others."""
        self.now = [min(self.config.touch_force, asked) for asked in self._asked]

    @property
    def lightest(self) -> float:
        """Smallest force (N) that a finger is asked for."""
        return min((asked for asked in self._asked if asked > 0), default=0.0)

    def grow(self, slips: Sequence[SlipMargin], dt: float) -> bool:
        """Move towards what is wanted; return whether it is reached.

        Parameters
        ----------
        slips : sequence of SlipMargin
            Of the fingers.
        dt : float
            Since the last step (s).

        Returns
        -------
        bool
            Whether every target is where it should be.
        """
        if self._adapt:
            self._answer(slips, dt)
        factor = self._raise
        rate = self.config.raise_rate if factor > 1.0 else self.config.load_rate
        step = rate * dt
        reached = True
        for i, asked in enumerate(self._asked):
            ahead = factor * asked - self.now[i]
            if -step <= ahead <= step:
                self.now[i] = factor * asked
            else:
                self.now[i] += step if ahead > 0 else -step
                reached = False
        return reached

    def _answer(self, slips: Sequence[SlipMargin], dt: float) -> None:
        """Raise all fingers by one factor, so that they stay balanced; what is spare fades."""
        strongest = max(self._asked)
        if strongest <= 0.0:
            return
        most = max(min(self.config.raise_high, self.config.force_high / strongest), 1.0)
        self._since += dt
        needed, slipping = 1.0, False
        for slip, asked in zip(slips, self._asked, strict=True):
            if asked > 0.0:
                slipping = slipping or slip.slipping
                needed = max(needed, slip.needed(self.config.margin) / asked)  # NaN asks nothing
        if slipping and not self._slipping:
            self._slips += 1
        self._slipping = slipping
        wanted = needed
        if slipping and self._since >= self.config.slip_pause:
            wanted = max(needed, self._raise * self.config.slip_raise)
        if wanted > self._raise:
            self._raise = min(wanted, most)
            self._since = 0.0
        elif self._raise > 1.0 and not slipping:
            spare = self._raise - min(needed, self._raise)
            self._raise -= spare * faded(dt, self.config.relax_time, self._slips)
