"""Stiffness of object and hand together, from how the force grows as a drive closes.

Least squares of force over measured closure, with a normal prior and its posterior variance. Old
points fade with the way that the drive has gone and not with time, so that a long hold neither
forgets nor winds up the estimate, and a stiffening object is followed.
"""

from __future__ import annotations

from math import exp, sqrt
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tactile_ros.control.config import GripConfig

FADE = 30.0  # moves of the closure noise after which a point counts 1 / e


class Stiffness:
    """Growth of force with closure on one drive.

    Parameters
    ----------
    config : GripConfig
        Range, and noise of force and closure.

    Attributes
    ----------
    value, std : float
        Estimate and its standard deviation (N per closure).
    cautious : float
        Estimate and one standard deviation, inside the range: for gains that must not ring.

    Examples
    --------
    >>> from tactile_ros.control.config import GripConfig
    >>> law = Stiffness(GripConfig())
    >>> for i in range(200):
    ...     law.step(0.3 + 0.0005 * i, 0.05 * i)
    >>> round(law.value), law.std < 3
    (100, True)
    """

    def __init__(self, config: GripConfig) -> None:
        self.config = config
        self.reset()

    def reset(self) -> None:
        """Forget the object: as stiff as can be, and anything down to the softest."""
        low, high = self.config.stiffness_low, self.config.stiffness_high
        self._prior = 0.5 * (low + high)
        self._spread = 0.5 * (high - low)
        self.value, self.std, self.cautious = self._prior, self._spread, high
        self._count = self._x = self._f = self._xx = self._xf = 0.0
        self._last = float('nan')
        self._origin = 0.0

    def step(self, closure: float, force: float) -> None:
        """Take in a point of the force that grows.

        Parameters
        ----------
        closure : float
            Measured; one within its noise of the last is passed over.
        force : float
            At the same time (N).
        """
        noise = self.config.closure_noise
        moved = abs(closure - self._last)
        if moved < noise:
            return
        if self._count == 0.0:
            self._origin, moved = closure, 0.0
        self._last = closure
        keep = exp(-moved / (FADE * noise))
        x = closure - self._origin
        self._count = keep * self._count + 1.0
        self._x = keep * self._x + x
        self._f = keep * self._f + force
        self._xx = keep * self._xx + x * x
        self._xf = keep * self._xf + x * force
        self._solve()

    def _solve(self) -> None:
        """Posterior of the slope; the noise of the closure adds to that of the force."""
        spread = max(self._xx - self._x * self._x / self._count, 0.0)
        along = self._xf - self._x * self._f / self._count
        error = self.config.force_noise**2 + (self.value * self.config.closure_noise) ** 2
        precision = 1.0 / self._spread**2 + spread / error
        self.value = (self._prior / self._spread**2 + along / error) / precision
        self.value = min(max(self.value, self.config.stiffness_low), self.config.stiffness_high)
        self.std = sqrt(1.0 / precision)
        self.cautious = min(self.value + self.std, self.config.stiffness_high)
