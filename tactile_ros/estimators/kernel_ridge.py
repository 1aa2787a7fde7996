"""Kernel ridge on the pattern of the readings; that on readings stands in `regression`."""

from __future__ import annotations

import numpy as np

from tactile_ros.estimators.regression import (
    KernelRidge,
    Standardisation,
    fitted,
    gaussian,
    predict_rows,
    training_rows,
)
from tactile_ros.types import Array, Integers

__all__ = ['KernelRidge', 'PatternRidge', 'gaussian']

SHARE = 0.3  # of a factor e in size against a right angle between patterns
LEAST = 0.02  # quantile of sizes below which readings have no pattern
PATTERN_RIDGE_STRENGTHS = tuple(10.0**power for power in range(-10, -2))


class PatternRidge:
    """Kernel ridge on unit readings and the logarithm of their size.

    Parameters
    ----------
    samples : int
        Largest number of inducing samples.
    lengths : tuple of float
        Widths of the bumps to choose from, in root mean square lengths of the features.

    Attributes
    ----------
    least_ : float
        Size below which a reading fades into one without pattern (unit of the features).

    Examples
    --------
    >>> x = np.outer(np.linspace(1, 2, 40), [1.0, 2.0])
    >>> PatternRidge().fit(x, x[:, :1] ** 2).predict(np.array([[1.5, 3.0]])).round(2)
    array([[2.25]])
    """

    moves_: Array  # (d,) 1; 0 for features that were constant, which count for nothing
    least_: float
    kernel_: KernelRidge  # on pattern and size

    def __init__(self, samples: int = 400, lengths: tuple[float, ...] = (1.0,)) -> None:
        self.samples = samples
        self.lengths = lengths

    def fit(self, x: Array, y: Array, groups: Integers | None = None) -> PatternRidge:
        """Learn from features x (s, d) and targets y (s, k); groups (s,) are split as wholes."""
        rows = training_rows(x, y, groups)
        self.moves_ = (Standardisation().fit(rows.x).gain_ > 0).astype(np.float64)
        size = np.linalg.norm(rows.x * self.moves_, axis=1)
        self.least_ = max(float(np.quantile(size, LEAST)), 1e-9 * float(size.max())) or 1.0
        self.kernel_ = KernelRidge(
            self.samples, self.lengths[0], strengths=PATTERN_RIDGE_STRENGTHS
        )
        self.kernel_.fit(self._pattern(rows.x), rows.y, rows.groups)
        return self

    def predict(self, x: Array) -> Array:
        """Targets (s, k) of features x (s, d)."""
        fitted(self, 'kernel_')
        return predict_rows(x, len(self.kernel_.gain_) - 1, self._answer)

    def _answer(self, x: Array) -> Array:
        return self.kernel_.predict(self._pattern(x))

    def _pattern(self, x: Array) -> Array:
        """Readings of unit size, and the logarithm of their size, shape (s, d + 1)."""
        x = x * self.moves_
        size = np.sqrt((x * x).sum(axis=1) + (0.1 * self.least_) ** 2)
        return np.column_stack([x / size[:, None], SHARE * np.log(size / self.least_)])
