# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Friction, slip margin and slip of a finger, by Coulomb's cone: it holds while ft <= mu fn.

At a slip ft / fn is mu itself; while nothing slips mu is at least the largest ft / fn that held. A
slip shows as vibration of the tangential force beyond its noise, as a fall of the tangential force
that the normal force does not explain, or as the sensor's own word. Any of them may be false: one
slip teaches no friction below half of the last, and what it taught fades.
"""

from __future__ import annotations

from math import isfinite, nan, sqrt
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tactile_ros.control.config import GripConfig

SIGMAS = 10.0  # below so many sigma a force tells no ratio
FALL_SIGMAS = 8.0
VIBRATION = 6.0  # tangential vibration that is a slip, in sigma
MEMORY = 0.05  # s, of vibration and of the peak that a fall is measured from
LEARNT = 3  # steps of a slip before it teaches: none counts alone
LEAST = 0.5  # of the design friction: one slip teaches no less
FLOOR = 0.1  # smallest design friction
DOUBLINGS = 3  # most doublings of the time in which a slip is forgotten
STEEPEST = 100.0  # ratio of forces: no skin holds more
NO_FORCE = 1e6  # N: nothing that a finger feels


def faded(dt: float, relax_time: float, slips: int) -> float:
    """Share of a raise that fades in a step dt (s); each slip after the first halves it."""
    return min(dt / (relax_time * 2.0 ** min(max(slips - 1, 0), DOUBLINGS)), 1.0)


class SlipMargin:
    """Friction, margin, load and slip of one finger.

    The config gives the assumed friction, and the time in which a slip is forgotten.

    Notes
    -----
    Vibration is the root mean square of second differences over sqrt(6), which is the standard
    deviation of white noise and passes over slow changes of load.

    Examples
    --------
    >>> from tactile_ros.control.config import GripConfig
    >>> slip = SlipMargin(GripConfig())
    >>> for says in (0, 0, 1, 1, 1):
    ...     slip.step(2.0, 1.0, says, 0.02, 0.01)
    >>> round(slip.friction, 3), abs(round(slip.margin, 3))
    (0.5, 0.001)
    """

    def __init__(self, config: GripConfig) -> None:
        self._assumed, self._relax_time = config.friction_low, config.relax_time
        self.reset()

    def reset(self) -> None:
        """Forget the object: another may have another friction."""
        self.friction = nan  # coefficient that the last slip taught; NaN until then
        self._held = self._faith = 0.0
        self._slips = 0
        self.invalidate()

    def invalidate(self) -> None:
        """Forget the last forces, after which others have gone unseen; friction stays."""
        self._newest = self._older = self._peak = self._press = self._power = nan
        self._square, self._steps, self._steepest = 0.0, 0, 0.0
        self.margin = nan  # (mu fn - ft) / (mu fn); NaN below ten sigma or not known
        self.load = nan  # tangential (N); NaN where it is not known
        self.slipping = False  # now

    def step(
        self,
        normal: float,
        tangential: float,
        said: int,
        sigma: float,
        dt: float,
        share: float = 1.0,
    ) -> None:
        """Take in the newest forces (N), of a noise sigma (N), dt (s) after the last.

        What is not finite, or no force at all, is not known. The sensor says of slip 1, 0, or -1
        unknown; `share` is that of this force in the load, filtered as the noise asks for.
        """
        if not (isfinite(normal) and abs(tangential) < NO_FORCE):
            self.invalidate()
            self.slipping = said == 1
            return
        memory, least = min(dt / MEMORY, 1.0), SIGMAS * sigma
        seen = self._vibrates(tangential, sigma, memory)
        seen |= self._falls(normal, tangential, sigma, memory)
        # noise across two axes adds its variance to the square of the load
        last = self._power if isfinite(self._power) else tangential**2
        self._power = last + share * (tangential**2 - last)
        self.load = sqrt(max(self._power - 2.0 * sigma**2, 0.0))
        before = self.slipping
        self.slipping = said == 1 or (seen and said != 0 and normal > least and tangential > least)
        self._slips += self.slipping and not before
        self._faith -= self._faith * faded(dt, self._relax_time, self._slips)
        self.margin = nan
        if normal > least:
            ratio = min(self.load / normal, STEEPEST)
            self._learn(ratio if self.load > least else 0.0)
            self.margin = 1.0 - ratio / self.design_friction

    @property
    def design_friction(self) -> float:
        """Coefficient to act on: the estimate, which fades to what is assumed or has held."""
        likely = max(self._held, self._assumed)
        if not isfinite(self.friction):
            return likely
        return self.friction + (1.0 - self._faith) * max(likely - self.friction, 0.0)

    def needed(self, spare: float) -> float:
        """Normal force (N) that leaves a slip margin of `spare`, below 1; NaN: load unknown."""
        return self.load / (self.design_friction * (1.0 - spare))

    def _learn(self, ratio: float) -> None:
        """Learn from a slip the steepest of its ratios; a ratio that holds is a lower bound."""
        if not self.slipping:
            self._held = max(self._held, ratio)
            self.friction = max(self.friction, ratio)  # NaN stays
            self._steps, self._steepest = 0, 0.0
            return
        self._steps += 1
        self._steepest = max(self._steepest, ratio)
        if self._steps == LEARNT and self._steepest > 0.0:
            self.friction = max(self._steepest, LEAST * self.design_friction, FLOOR)
            self._held, self._faith = 0.0, 1.0

    def _vibrates(self, tangential: float, sigma: float, share: float) -> bool:
        """Second differences exceed those of noise."""
        bend = tangential - 2 * self._newest + self._older
        self._older, self._newest = self._newest, tangential
        self._square += share * ((bend * bend if isfinite(bend) else 0.0) - self._square)
        return self._square > 6.0 * (VIBRATION * sigma) ** 2

    def _falls(self, normal: float, tangential: float, sigma: float, share: float) -> bool:
        """The tangential force fell below its last peak though the normal force did not.

        A load that grows hides a fall from any mean: the peak rises at once and fades slowly.
        """
        drop, eased = self._peak - tangential, self._press - normal
        if drop > 0.0:
            self._peak -= share * drop
        else:  # also after blindness
            self._peak = tangential
        if drop > FALL_SIGMAS * sigma and eased < 0.5 * drop:
            self._peak, self._press = tangential, normal
            return True
        self._press = self._press + share * (normal - self._press) if isfinite(drop) else normal
        return False
