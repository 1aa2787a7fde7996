"""Features of any unit brought to zero mean and unit spread."""

from __future__ import annotations

import numpy as np

from tactile_ros.types import Array

SPREAD_FLOOR = 1e-9


class Standardisation:
    """Mean and spread of columns; a column that was constant in the fit counts for nothing.

    Attributes
    ----------
    mean_ : ndarray, shape (d,)
        Mean of each column (unit of the column).
    gain_ : ndarray, shape (d,)
        One over the standard deviation (one over the unit); 0 for constant columns.
    spread_ : ndarray, shape (d,)
        Standard deviation (unit of the column); 0 for constant columns.

    Examples
    --------
    >>> Standardisation().fit(np.array([[1e-6, 5], [3e-6, 5]]))(np.array([[4e-6, 7]]))
    array([[2., 0.]])
    """

    mean_: Array
    gain_: Array
    spread_: Array

    def fit(self, x: Array) -> Standardisation:
        """Learn mean and spread of the columns of x, shape (s, d)."""
        self.mean_ = x.mean(axis=0)
        spread = x.std(axis=0)
        moves = spread > SPREAD_FLOOR * np.abs(x).max(axis=0)
        self.spread_ = np.where(moves, spread, 0.0)
        self.gain_ = np.where(moves, 1 / np.where(moves, spread, 1.0), 0.0)
        return self

    def share_spread(self) -> Standardisation:
        """Give all columns the root mean square of their spreads; return itself."""
        common = float(np.sqrt((self.spread_**2).mean()))
        self.spread_ = np.full_like(self.spread_, common)
        self.gain_ = np.full_like(self.spread_, 1 / common if common > 0 else 0.0)
        return self

    def __call__(self, x: Array) -> Array:
        """Standardise x, shape (s, d), to the same shape, without a unit."""
        return (x - self.mean_) * self.gain_

    def inverse(self, z: Array) -> Array:
        """Back from standard columns (s, d) to the units of the fit."""
        return z * self.spread_ + self.mean_
