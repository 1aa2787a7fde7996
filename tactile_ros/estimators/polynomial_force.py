# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Force by all second-order products of pixels without their mean [3].

[3], appendix, as corrected: the means over the pixels carry a factor of one over their number and
the Bz line removes the mean of Bz; with a norm for each pixel and a constant, products of any two
make 91 features of four pixels. They have rank 61, so that weights come from singular values, of
which those that carry nothing are left out.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy.optimize import minimize_scalar

from tactile_ros.estimators.regression import fitted, training_rows
from tactile_ros.types import Array, Integers, as_shape

LEAST_SHARE = 1e-10


class PolynomialForce:
    """The method of [3], appendix: mean removal, norms, 91 products, one matrix of weights."""

    size_: float  # root mean square of the gradient field (T), in which features are expressed
    # (p,) of the features
    mean_: Array
    spread_: Array
    weights_: Array  # (p, k) of standardised features (unit of y)
    level_: Array  # (k,) mean of y

    def fit(self, x: Array, y: Array, groups: Integers | None = None) -> PolynomialForce:
        """Learn weights from Bx and Bz of every pixel x (s, 2 t) (T) and targets y (s, k)."""
        rows = training_rows(x, y, groups)
        size = float(np.sqrt((gradient_field(rows.x) ** 2).mean()))
        self.size_ = size if size > 0 else 1.0
        raw = products(gradient_field(rows.x) / self.size_)
        self.mean_, spread = raw.mean(axis=0), raw.std(axis=0)
        self.spread_ = np.where(spread > 0, spread, 1.0)
        self.level_ = rows.y.mean(axis=0)
        self.weights_ = self._solved((raw - self.mean_) / self.spread_, rows.y - self.level_)
        return self

    def _solved(self, terms: Array, target: Array) -> Array:
        """Weights (p, k) of standardised features (s, p)."""
        return np.asarray(np.linalg.lstsq(terms, target, rcond=LEAST_SHARE)[0], float)

    def predict(self, x: Array) -> Array:
        """Evaluate the chain, shape (s, k), of fields (s, 2 t) (T)."""
        fitted(self, 'weights_')
        width = int(np.sqrt(2 * len(self.mean_))) // 3 * 2
        x = as_shape('x of predict', x, (-1, width))
        terms = products(gradient_field(x) / self.size_)
        return np.asarray((terms - self.mean_) / self.spread_ @ self.weights_ + self.level_)


def gradient_field(x: Array) -> Array:
    """Fields (s, t, 2) of pixels (s, 2 t) less their mean over the pixels ([3], appendix)."""
    pixels = x.reshape(len(x), -1, 2)
    return np.asarray(pixels - pixels.mean(axis=1, keepdims=True))


def products(field: Array) -> Array:
    """Constant, fields and norms, and products of any two: (s, (3 t + 1)(3 t + 2) / 2)."""
    norm = np.sqrt((field**2).sum(axis=2))
    flat = field.reshape(len(field), -1)
    wide = np.concatenate([np.ones((len(field), 1)), flat, norm], axis=1)
    first, second = _pairs(wide.shape[1])
    return np.asarray(wide[:, first] * wide[:, second])


@lru_cache(maxsize=8)
def _pairs(width: int) -> tuple[Integers, Integers]:
    """Every pair of features."""
    first, second = np.triu_indices(width)
    return first, second


MOST_ROWS = 1500  # by which alpha is found
WIDEST, FINE = 0.4, 1e-3  # of alpha: largest size, and error


class ThermalPolynomial:
    """Chain of fields whose strength follows a temperature, the last feature.

    A beta that is the same for all pixels is removed with the mean, so that alpha alone is found;
    [3] tuned both by hand.
    """

    alpha_: float  # change of strength for a unit of the temperature
    chain_: PolynomialForce  # of corrected fields

    def fit(self, x: Array, y: Array, groups: Integers | None = None) -> ThermalPolynomial:
        """Learn from fields and temperatures x (s, d + 1), targets y (s, k)."""
        rows = training_rows(x, y, groups)
        few = slice(None, None, -(-len(rows.x) // MOST_ROWS))
        part, target = rows.x[few], rows.y[few] / np.maximum(rows.y.std(axis=0), 1e-300)

        def left(alpha: float) -> float:
            field = gradient_field(_corrected(part, alpha))
            terms = products(field / np.sqrt((field**2).mean()))
            weights = np.linalg.lstsq(terms, target, rcond=LEAST_SHARE)[0]
            return float(((target - terms @ weights) ** 2).sum())

        self.alpha_ = float(minimize_scalar(
            left, bounds=(-WIDEST, WIDEST), method='bounded', options={'xatol': FINE}
        ).x)  # fmt: skip
        self.chain_ = PolynomialForce().fit(_corrected(rows.x, self.alpha_), rows.y, rows.groups)
        return self

    def predict(self, x: Array) -> Array:
        """Targets (s, k) of fields and temperatures; NotCalibratedError before a fit."""
        fitted(self, 'chain_')
        return self.chain_.predict(_corrected(x, self.alpha_))


def _corrected(x: Array, alpha: float) -> Array:
    """Fields (s, d) of a strength that follows the last of x (s, d + 1)."""
    return np.asarray(x[:, :-1] * (1 + alpha * x[:, -1:]))
