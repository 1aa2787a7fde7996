"""Thin plates over two features: smooth surfaces through few calibration points.

Duchon's splines (Wahba, Spline Models for Observational Data, 1990, ch. 2): r^2 log r at each
point and a plane, with a penalty on bending chosen by leaving points out.
"""

from __future__ import annotations

import numpy as np

from tactile_ros.estimators.training import fitted, predict_rows, training_rows
from tactile_ros.types import Array, Integers

PENALTIES = (0.0, 1e-8, 1e-6, 1e-4, 1e-2)
MOST_POINTS = 120


class ThinPlate:
    """Surface over the first two features.

    Attributes
    ----------
    middle_ : ndarray, shape (2,)
        Of the features.
    scale_ : float
        Their root mean square distance from it.
    points_ : ndarray, shape (n, 2)
        Scaled features at the calibration points.
    weights_ : ndarray, shape (n + 3, k)
        Of the bumps, and of the plane.
    """

    middle_: Array
    scale_: float
    points_: Array
    weights_: Array

    def fit(self, x: Array, y: Array, groups: Integers | None = None) -> ThinPlate:
        """Learn from features (s, d) and targets (s, k); rows of equal targets are one point."""
        rows = training_rows(x, y, groups)
        _, index = np.unique(rows.y, axis=0, return_inverse=True)
        index = np.asarray(index).reshape(-1)
        count = np.bincount(index)
        table = np.column_stack([rows.x[:, :2], rows.y])
        means = np.stack([np.bincount(index, column) / count for column in table.T], axis=1)
        if len(means) > MOST_POINTS:
            means = means[np.linspace(0, len(means) - 1, MOST_POINTS).astype(np.int64)]
        self.middle_ = means[:, :2].mean(axis=0)
        self.scale_ = float(np.sqrt(((means[:, :2] - self.middle_) ** 2).sum(1).mean())) or 1.0
        self.points_ = (means[:, :2] - self.middle_) / self.scale_
        targets = np.concatenate([means[:, 2:], np.zeros((3, rows.y.shape[1]))])
        trials = [self._solve(penalty, targets) for penalty in PENALTIES]
        self.weights_ = min(trials, key=lambda one: one[1])[0]
        return self

    def predict(self, x: Array) -> Array:
        """Targets (s, k)."""
        fitted(self, 'weights_')
        return predict_rows(x, x.shape[1], self._answer)

    def _answer(self, x: Array) -> Array:
        u = (x[:, :2] - self.middle_) / self.scale_
        return np.asarray(_terms(np.clip(u, -3, 3), self.points_) @ self.weights_)

    def _solve(self, penalty: float, targets: Array) -> tuple[Array, float]:
        """Weights, and the mean square of errors at points left out one at a time."""
        n = len(self.points_)
        system = np.zeros((n + 3, n + 3))
        system[:n] = _terms(self.points_, self.points_)
        system[n:, :n] = system[:n, n:].T
        system[np.arange(n), np.arange(n)] += penalty
        inverse = np.linalg.pinv(system)
        weights = inverse @ targets
        alone = weights[:n] / np.maximum(np.diagonal(inverse)[:n, None], 1e-9)
        return weights, float((alone**2).mean()) if n > 3 else penalty


def _terms(u: Array, points: Array) -> Array:
    """Bumps and plane, shape (s, n + 3)."""
    apart = u[:, None] - points
    square = (apart * apart).sum(axis=2)
    bumps = 0.5 * square * np.log(np.maximum(square, 1e-300))
    return np.concatenate([bumps, np.ones((len(u), 1)), u], axis=1)
