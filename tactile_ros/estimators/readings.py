"""Forces of one frame as a descent reads them, and what it comes to."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.physics import compiled

if TYPE_CHECKING:
    from tactile_ros.estimators.coverage_model import Variant
    from tactile_ros.types import Array, Bools

CUT = 3.0  # sigma at which a taxel's misfit stops to count
CLOSE = 0.01  # of a step's limit: what is left to go needs no other round
SLACK = 1.0  # of a quarter of the taxels' least misfit: what the model may still err by
WEAK = 1e-4  # of a sigma per step: what nothing tells stays where it is
WELL = 0.5  # of the largest cover: taxels that tell the pressure
PRIOR = 2.0  # taxels' worth of trust in the stated errors


@dataclass
class Readings:
    """Forces of one frame and their errors.

    Attributes
    ----------
    force, variance : ndarray, shape (t,)
        Of each taxel (any unit); 0 force where not usable.
    usable : ndarray, shape (t,)
        False: dead or unknown.
    top : float
        The largest forces.
    count : int
        Taxels that are pressed.
    """

    force: Array
    variance: Array
    usable: Bools
    top: float
    count: int

    @cached_property
    def least(self) -> float:
        """Least standard deviation."""
        return float(np.sqrt(self.variance.min()))

    def excess(self, squared: Array) -> float:
        """By how much the misfit that a quarter of (t,) exceeds is above what is stated."""
        size = np.sort(squared * self.usable)[-(self.count // 4) - 1]
        return float(SLACK * max(size**0.5 - self.least, 0.0))


@dataclass
class Fits:
    """What k descents of one variant came to.

    Attributes
    ----------
    variant, profile : Variant, int
        Whose coverage was fitted.
    params : ndarray, shape (k, m)
        x, y (m), yaw (rad), width (m).
    pressure, cost : ndarray, shape (k,)
        Force of a covered area (N/m2); sum of squared misfits, none above the square of the cut.
    cover : ndarray, shape (k, t)
        Covered areas (m2).
    normal : ndarray, shape (k, m + 1, m + 1)
        Matrix of the last step, in units of the variant and parts of the pressure.
    slopes : ndarray, shape (m + 1, k, t)
        Of the forces.
    share : ndarray, shape (k, t)
        Weight of each taxel.
    """

    variant: Variant
    profile: int
    params: Array
    pressure: Array
    cost: Array
    cover: Array
    normal: Array
    slopes: Array
    share: Array


def first_pressure(readings: Readings, cover: Array) -> float:
    """Pressure by the median of taxels that are well covered; of few, by least squares."""
    well = np.flatnonzero(readings.usable & (cover > WELL * cover.max()))
    if len(well) > 4:
        some = np.sort(readings.force[well] / cover[well])
        if some[len(some) // 2] > 0:
            return float(some[len(some) // 2])
    w = cover * readings.usable / readings.variance
    return max(float(w @ readings.force), 1e-12) / max(float(w @ cover), 1e-300)


def misfit(
    y: Array, cover: Array, pressure: float, weight: Array, present: float
) -> tuple[int, int, float]:
    """Taxels that tell of a fit, those far off, and the sum of squared misfits, cut off.

    Parameters
    ----------
    y, cover : ndarray, shape (t,)
        Forces (any unit), and covered areas (m2) of a fit.
    pressure : float
        Of the fit (unit of force per m2).
    weight : ndarray, shape (t,)
        One over the variance of a force; 0: not usable.
    present : float
        Least force, read or expected, that tells.
    """
    if compiled.available():
        return misfit_row(y, cover, pressure, weight, present)
    expected = pressure * cover
    told = (weight > 0) & (np.maximum(y, expected) > present)
    wrong = (np.square(y - expected) * weight)[told]
    far = int(np.count_nonzero(wrong > (2 * CUT) ** 2))
    return len(wrong), far, float(np.minimum(wrong, CUT**2).sum())


@compiled.compiled
def misfit_row(
    y: Array, cover: Array, pressure: float, weight: Array, present: float
) -> tuple[int, int, float]:
    """As `misfit`, taxel by taxel."""
    count, far, total = 0, 0, 0.0
    for k in range(len(y)):
        expected = pressure * cover[k]
        if weight[k] > 0 and max(y[k], expected) > present:
            wrong = (y[k] - expected) ** 2 * weight[k]
            count += 1
            far += wrong > (2 * CUT) ** 2
            total += min(wrong, CUT**2)
    return count, far, total
