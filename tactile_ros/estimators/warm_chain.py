"""The chain of [3] with its thermal correction: B (1 + alpha dT) + beta dT before the means go.

A beta that is the same for all pixels is removed with the mean, so that alpha alone is found; [3]
tuned both by hand on a single readout.
"""

from __future__ import annotations

import numpy as np

from tactile_ros.estimators.polynomial_force import PolynomialForce, gradient_field, products
from tactile_ros.estimators.training import fitted, training_rows
from tactile_ros.types import Array, Integers

MOST_ROWS, ROUNDS = 1500, 12
WIDEST, GOLDEN = 0.4, 0.618


class WarmChain:
    """Chain of fields whose strength follows temperatures.

    Parameters
    ----------
    slow : int
        Temperatures, the last features.

    Attributes
    ----------
    alpha_ : ndarray, shape (slow,)
        Change of strength for a unit of each temperature.
    chain_ : PolynomialForce
        Of corrected fields.
    """

    alpha_: Array
    chain_: PolynomialForce

    def __init__(self, slow: int = 1) -> None:
        self.slow = slow

    def fit(self, x: Array, y: Array, groups: Integers | None = None) -> WarmChain:
        """Learn from fields and temperatures x (s, d + slow), targets y (s, k)."""
        rows = training_rows(x, y, groups)
        few = slice(None, None, -(-len(rows.x) // MOST_ROWS))
        part, target = rows.x[few], rows.y[few] / np.maximum(rows.y.std(axis=0), 1e-300)
        self.alpha_ = np.zeros(self.slow)
        for i in range(self.slow):
            low, high = -WIDEST, WIDEST
            for _ in range(ROUNDS):
                first = high - GOLDEN * (high - low)
                second = low + GOLDEN * (high - low)
                costs = [self._left(part, target, i, alpha) for alpha in (first, second)]
                low, high = (low, second) if costs[0] < costs[1] else (first, high)
            self.alpha_[i] = (low + high) / 2
        self.chain_ = PolynomialForce().fit(self._corrected(rows.x), rows.y, rows.groups)
        return self

    def predict(self, x: Array) -> Array:
        """Targets (s, k) of fields and temperatures; NotCalibratedError before a fit."""
        fitted(self, 'chain_')
        return self.chain_.predict(self._corrected(x))

    def _corrected(self, x: Array) -> Array:
        strength = 1 + (x[:, -self.slow :] * self.alpha_).sum(axis=1)
        return np.asarray(x[:, : -self.slow] * strength[:, None])

    def _left(self, x: Array, y: Array, i: int, alpha: float) -> float:
        """Squares that the chain leaves of targets with one alpha changed."""
        self.alpha_[i] = alpha
        field = gradient_field(self._corrected(x))
        terms = products(field / np.sqrt((field**2).mean()))
        weights = np.linalg.lstsq(terms, y, rcond=1e-10)[0]
        return float(((y - terms @ weights) ** 2).sum())
