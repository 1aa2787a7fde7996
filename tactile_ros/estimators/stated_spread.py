"""Make a method's own spread mean what it says: scales measured on held-out groups."""

from __future__ import annotations

import math

import numpy as np

from tactile_ros.physics.compiled import available, compiled
from tactile_ros.types import Array

Pieces = tuple[Array, Array, Array, Array]

ONE_SIGMA, TWO_SIGMA = 0.6827, 0.9545
TRIED = ONE_SIGMA + np.linspace(-0.08, 0.08, 17)
ROWS_PER_LEVEL = 60
LEVELS = 5
PRIOR_ROWS = 3.0


class StatedSpread:
    """Factors on a stated spread, so that it holds its share of held-out errors.

    Attributes
    ----------
    knots_, factors_ : ndarray, shape (l, k)
        Logarithm of the stated spread, and of the factor there.
    """

    knots_: Array
    factors_: Array

    def fit(self, spread: Array, residuals: Array) -> StatedSpread:
        """Learn from spreads and errors (s, k) of rows that the method had not seen."""
        stated = np.log(np.maximum(spread, np.finfo(np.float64).tiny))
        size = np.log(np.maximum(np.abs(residuals), 1e-12 + 1e-3 * np.abs(residuals).mean(axis=0)))
        count = int(np.clip(len(stated) // ROWS_PER_LEVEL, 1, LEVELS))
        self.knots_ = np.empty((count, stated.shape[1]))
        self.factors_ = np.empty_like(self.knots_)
        order = np.argsort(stated, axis=0, kind='stable')
        for level, rows in enumerate(np.array_split(order, count)):
            self.knots_[level] = np.take_along_axis(stated, rows, axis=0).mean(axis=0)
            ratio = np.take_along_axis(size - stated, rows, axis=0)
            trust = len(rows) / (len(rows) + PRIOR_ROWS)
            self.factors_[level] = trust * _fair(ratio)
        return self

    def __call__(self, spread: Array) -> Array:
        """Spreads (s, k) that hold what they say."""
        if len(self.knots_) == 1:
            return np.asarray(spread * np.exp(self.factors_[0]))
        stated = np.log(np.maximum(spread, np.finfo(np.float64).tiny))
        factor = np.empty_like(stated)
        for k in range(stated.shape[1]):
            factor[:, k] = np.interp(stated[:, k], self.knots_[:, k], self.factors_[:, k])
        return np.asarray(np.exp(stated + factor))


def _fair(ratio: Array) -> Array:
    """Factor (k,) at which shares inside one and two sigma are least off those of a normal.

    Of errors over what was stated (s, k); both are logarithms. Where tails are heavier than
    normal not both shares can hold.
    """
    count = len(ratio)
    # one more than the sample's own share: the finite-sample step of conformal methods
    shares = np.minimum(TRIED * (count + 1) / count, 1.0)
    factors = np.quantile(ratio, shares, axis=0)
    inside = (ratio[:, None] <= factors + np.log(2.0)).mean(axis=0)
    off = np.maximum(np.abs(TRIED - ONE_SIGMA)[:, None], np.abs(inside - TWO_SIGMA))
    return np.asarray(np.take_along_axis(factors, off.argmin(axis=0)[None], axis=0)[0])


def pieces(knots: Array, factors: Array) -> Pieces:
    """What `widen` takes of `StatedSpread`: first factor, knots, their distances and slopes."""
    widths = np.maximum(np.diff(knots, axis=0), 0.0)
    rise = np.diff(factors, axis=0)
    slopes = np.where(widths > 1e-9, rise / np.maximum(widths, 1e-9), 0.0)
    return factors[0], knots[:-1], widths, slopes


def widen(cov: Array, floor: Array, scale: Pieces) -> None:
    """Add a floor to covariances and scale them as `pieces` say, in place.

    Parameters
    ----------
    cov, floor : ndarray, shape (s, c, c) and (c, c)
        (Unit squared.)
    scale : tuple of ndarray
        Of `pieces`.

    Examples
    --------
    Sigmas of 1 are half of what they should be, those of 3 and more are right:

    >>> scale = pieces(np.log([[1.0], [3.0]]), np.log([[2.0], [1.0]]))
    >>> cov = np.array([[[1.0]], [[16.0]]])
    >>> widen(cov, np.zeros((1, 1)), scale)
    >>> cov.ravel().round(9).tolist()
    [4.0, 16.0]
    """
    first, knots, widths, slopes = scale
    if available():
        widen_rows(cov, floor, first, knots, widths, slopes)
        return
    cov += floor
    beyond = np.log(np.sqrt(np.diagonal(cov, axis1=1, axis2=2)))[:, None] - knots
    beyond = np.minimum(np.maximum(beyond, 0.0), widths)
    factor = np.exp(first + np.add.reduce(beyond * slopes, axis=1))
    cov *= factor[:, :, None] * factor[:, None, :]


@compiled
def widen_rows(
    cov: Array, floor: Array, first: Array, knots: Array, widths: Array, slopes: Array
) -> None:
    """`widen` by loops: first (c,) is the logarithm of the factor at small sigmas.

    Its pieces begin at knots, in the logarithm of the sigma, are as long as widths and as steep
    as slopes (l, c).
    """
    count = len(first)
    factor = np.empty(count)
    for s in range(len(cov)):
        for a in range(count):
            for b in range(count):
                cov[s, a, b] += floor[a, b]
        for a in range(count):
            sigma, total = math.log(math.sqrt(cov[s, a, a])), 0.0
            for piece in range(len(knots)):
                beyond = min(max(sigma - knots[piece, a], 0.0), widths[piece, a])
                total += beyond * slopes[piece, a]
            factor[a] = math.exp(first[a] + total)
        for a in range(count):
            for b in range(count):
                cov[s, a, b] *= factor[a] * factor[b]
