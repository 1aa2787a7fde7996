"""Make a method's own spread mean what it says: scales measured on held-out groups."""

from __future__ import annotations

import numpy as np

from tactile_ros.types import Array

ONE_SIGMA = 0.6827
ROWS_PER_LEVEL = 60
LEVELS = 5
PRIOR_ROWS = 3.0


class StatedSpread:
    """Factors on a stated spread, so that 68.27 % of held-out errors lie inside it.

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
            share = min(ONE_SIGMA * (len(rows) + 1) / len(rows), 1.0)
            trust = len(rows) / (len(rows) + PRIOR_ROWS)
            self.factors_[level] = trust * np.quantile(ratio, share, axis=0)
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
