"""Force from the mean curve of all places: what [5] compares its network with."""

from __future__ import annotations

import numpy as np

from tactile_ros.estimators.training import fitted, predict_rows, training_rows
from tactile_ros.types import Array, Integers


class MeanCurve:
    """Polynomial of one feature.

    Parameters
    ----------
    column : int
        Of the feature.
    degree : int
        Of the polynomial; less where there are few values.

    Attributes
    ----------
    width_ : int
        Number of features.
    range_ : ndarray, shape (2,)
        Middle and half width of the feature; beyond, the nearest end counts.
    weights_ : ndarray, shape (p, k)
        Of the powers (unit of y).
    """

    width_: int
    range_: Array
    weights_: Array

    def __init__(self, column: int, degree: int = 4) -> None:
        self.column = column
        self.degree = degree

    def fit(self, x: Array, y: Array, groups: Integers | None = None) -> MeanCurve:
        """Learn from features (s, d) and targets (s, k); groups do not matter."""
        rows = training_rows(x, y, groups)
        level = rows.x[:, self.column]
        half = max(float(np.ptp(level)) / 2, 1e-12)
        self.width_ = rows.x.shape[1]
        self.range_ = np.array([(level.min() + level.max()) / 2, half])
        self.degree_ = min(self.degree, len(np.unique(level)) - 1)
        weights, *_ = np.linalg.lstsq(self._terms(rows.x), rows.y, rcond=1e-10)
        self.weights_ = np.asarray(weights, np.float64)
        return self

    def predict(self, x: Array) -> Array:
        """Targets (s, k)."""
        fitted(self, 'weights_')
        return predict_rows(x, self.width_, lambda known: self._terms(known) @ self.weights_)

    def _terms(self, x: Array) -> Array:
        level = (x[:, self.column] - self.range_[0]) / self.range_[1]
        clipped = np.minimum(np.maximum(level, -1.1), 1.1)[:, None]
        return np.asarray(clipped ** np.arange(self.degree_ + 1))
