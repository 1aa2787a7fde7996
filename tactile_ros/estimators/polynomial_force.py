# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Force by all second-order products of pixels without their mean [3].

[3], appendix, as corrected: the means over the pixels carry a factor of one over their number and
the Bz line removes the mean of Bz; with a norm for each pixel and a constant, products of any two
make 91 features of four pixels. They have rank 61, so that weights come from singular values, of
which those that carry nothing are left out; Huber's loss with an L1 penalty is kept beside it.
"""

from __future__ import annotations

import math
from functools import cached_property, lru_cache

import numpy as np

from tactile_ros.estimators.regression import fitted, training_rows
from tactile_ros.physics.compiled import compiled
from tactile_ros.types import Array, Integers, as_shape

LEAST_SHARE = 1e-10
HUBER = 1.345  # of the residuals' scale (Huber, Robust Statistics, 1981)
ROUNDS = 300


class PolynomialForce:
    """The chain of [3]: mean removal, norms, 91 products, one matrix of weights.

    Parameters
    ----------
    loss : str
        'squares', solved by singular values; 'huber_l1', Huber's loss with an L1 penalty,
        iterated until it stands.
    penalty : float
        Of the L1 norm, per row, of weights of standardised features.

    Examples
    --------
    >>> x = np.random.default_rng(0).normal(size=(200, 8))
    >>> chain = PolynomialForce().fit(x, x[:, :1] - x[:, 2:3])
    >>> bool(np.allclose(chain.predict(x + np.tile([5.0, -3.0], 4)), chain.predict(x)))
    True
    """

    size_: float  # root mean square of the gradient field (T), in which features are expressed
    # (p,) of the features
    mean_: Array
    spread_: Array
    weights_: Array  # (p, k) of standardised features (unit of y)
    level_: Array  # (k,) mean of y

    def __init__(self, loss: str = 'squares', penalty: float = 1e-6) -> None:
        if loss not in ('squares', 'huber_l1'):
            msg = f"loss of PolynomialForce must be 'squares' or 'huber_l1'; received {loss!r}"
            raise ValueError(msg)
        self.loss = loss
        self.penalty = penalty

    def fit(self, x: Array, y: Array, groups: Integers | None = None) -> PolynomialForce:
        """Learn weights.

        Parameters
        ----------
        x : ndarray, shape (s, 2 t)
            Bx and Bz of every pixel (T).
        y : ndarray, shape (s, k)
            Targets.
        groups : ndarray of int, shape (s,), or None
            Not used: nothing is chosen.
        """
        rows = training_rows(x, y, groups)
        size = float(np.sqrt((gradient_field(rows.x) ** 2).mean()))
        self.size_ = size if size > 0 else 1.0
        vars(self).pop('_folded', None)
        raw = products(gradient_field(rows.x) / self.size_)
        self.mean_, spread = raw.mean(axis=0), raw.std(axis=0)
        self.spread_ = np.where(spread > 0, spread, 1.0)
        terms, self.level_ = (raw - self.mean_) / self.spread_, rows.y.mean(axis=0)
        target = rows.y - self.level_
        self.weights_ = np.asarray(np.linalg.lstsq(terms, target, rcond=LEAST_SHARE)[0], float)
        if self.loss == 'huber_l1':
            self.weights_, shift = _huber_l1(terms, target, self.weights_, self.penalty)
            self.level_ = self.level_ + shift
        return self

    def predict(self, x: Array) -> Array:
        """Evaluate the chain, shape (s, k), of fields (s, 2 t) (T)."""
        fitted(self, 'weights_')
        width = int(np.sqrt(2 * len(self.mean_))) // 3 * 2
        x = as_shape('x of predict', x, (-1, width))
        y = np.empty((len(x), len(self.level_)))
        weights, level = self._folded
        chain_rows(x, self.size_, weights, level, y)
        return y

    @cached_property
    def _folded(self) -> tuple[Array, Array]:
        """Weights (p, k) and level (k,) of features that are not standardised."""
        weights = np.ascontiguousarray(self.weights_ / self.spread_[:, None])
        return weights, np.asarray(self.level_ - self.mean_ @ weights)


def gradient_field(x: Array) -> Array:
    """Fields (s, t, 2) of pixels (s, 2 t) less their mean over the pixels.

    Examples
    --------
    >>> gradient_field(np.array([[1.0, 5.0, 3.0, 5.0]])).tolist()
    [[[-1.0, 0.0], [1.0, 0.0]]]
    """
    pixels = x.reshape(len(x), -1, 2)
    return np.asarray(pixels - pixels.mean(axis=1, keepdims=True))


def products(field: Array) -> Array:
    """Constant, fields and norms, and products of any two: (s, (3 t + 1)(3 t + 2) / 2).

    Examples
    --------
    >>> products(np.zeros((1, 4, 2))).shape
    (1, 91)
    """
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


@compiled
def chain_rows(x: Array, size: float, weights: Array, level: Array, y: Array) -> None:
    """The chain row by row, for a compiler: targets (s, k) of fields (s, 2 t)."""
    pixels, outputs = x.shape[1] // 2, weights.shape[1]
    wide, total = np.ones(1 + 3 * pixels), np.empty(outputs)
    for s in range(len(x)):
        mean = [0.0, 0.0]
        for i in range(2 * pixels):
            mean[i % 2] += x[s, i]
        for i in range(2 * pixels):
            wide[1 + i] = (x[s, i] - mean[i % 2] / pixels) / size
        for p in range(pixels):
            wide[1 + 2 * pixels + p] = math.sqrt(wide[1 + 2 * p] ** 2 + wide[2 + 2 * p] ** 2)
        for k in range(outputs):
            total[k] = level[k]
        feature = 0
        for i in range(len(wide)):
            for j in range(i, len(wide)):
                for k in range(outputs):
                    total[k] += wide[i] * wide[j] * weights[feature, k]
                feature += 1
        y[s, :] = total


def _huber_l1(terms: Array, target: Array, weights: Array, penalty: float) -> tuple[Array, Array]:
    """Weights (p, k) and level (k,) that minimise Huber's loss with an L1 penalty."""
    count = terms.shape[1]
    terms = np.concatenate([terms, np.ones((len(terms), 1))], axis=1)
    found = np.concatenate([weights, np.zeros((1, weights.shape[1]))])
    for k in range(target.shape[1]):
        w = found[:, k]
        for _ in range(ROUNDS):
            error = target[:, k] - terms @ w
            scale = 1.4826 * np.median(np.abs(error)) + np.finfo(float).tiny
            trust = np.minimum(1.0, HUBER * scale / np.maximum(np.abs(error), 1e-300))
            shrink = penalty * len(terms) * scale / np.maximum(np.abs(w), 1e-9 * np.abs(w).max())
            root = np.sqrt(trust)[:, None]
            shrink[count:] = 0.0  # the level is free
            left = np.concatenate([root * terms, np.diag(np.sqrt(shrink))])
            right = np.concatenate([root[:, 0] * target[:, k], np.zeros(len(w))])
            new = np.linalg.lstsq(left, right, rcond=LEAST_SHARE)[0]
            moved, w = float(np.abs(new - w).max()), new
            if moved <= 1e-6 * np.abs(w).max():
                break
        found[:, k] = w
    return found[:count], found[count]


MOST_ROWS, WARM_CHAIN_ROUNDS = 1500, 12
WIDEST, GOLDEN = 0.4, 0.618


class WarmChain:
    """Chain of fields whose strength follows temperatures.

    A beta that is the same for all pixels is removed with the mean, so that alpha alone is found;
    [3] tuned both by hand on a single readout.

    Parameters
    ----------
    slow : int
        Temperatures, the last features.
    """

    alpha_: Array  # (slow,) change of strength for a unit of each temperature
    chain_: PolynomialForce  # of corrected fields

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
            for _ in range(WARM_CHAIN_ROUNDS):
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
