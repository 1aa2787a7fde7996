# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""The network of radial basis functions of [5]: place and resistance to force.

[5] section 3.1: centres by k-means, one width for all, s = d_max / sqrt(2 h) (Eq. (7)), weights by
least squares, and hidden nodes added until the mean square error is reached. As printed it bends
freely between the squares that it was calibrated on. Clusters that empty are left out, and so are
centres that coincide; the least squares are solved by singular values.
"""

from __future__ import annotations

import numpy as np
from scipy.cluster.vq import kmeans

from tactile_ros.estimators.regression import fitted, predict_rows, training_rows
from tactile_ros.types import Array, Integers

RCOND = 1e-6
MOST_ROWS = 2000  # k-means and least squares see no more


class RbfForce:
    """Gaussian nodes at k-means centres of the normalised features, [5] section 3.1.

    Growing numbers of `nodes` are tried until the mean square error, of targets normalised to
    0..1, is the `target`.
    """

    # (d,) normalisation of the features to 0..1 ([5] Eq. (8), over all squares together).
    low_: Array
    span_: Array
    centres_: Array  # (h, d) of the nodes
    width_: float  # of the nodes
    weights_: Array  # (h + 1, k) of the nodes and of a constant (unit of y)

    def __init__(
        self, target: float = 1e-3, nodes: tuple[int, ...] = (4, 8, 16, 24, 32, 48, 64, 96)
    ) -> None:
        self.target = target
        self.nodes = nodes

    def fit(self, x: Array, y: Array, groups: Integers | None = None) -> RbfForce:
        """Learn from features (s, d) and targets (s, k); groups do not matter."""
        rows = training_rows(x, y, groups)
        if len(rows.x) > MOST_ROWS:
            rows = rows.take(np.linspace(0, len(rows.x) - 1, MOST_ROWS).astype(np.int64))
        self.low_ = rows.x.min(axis=0)
        span = rows.x.max(axis=0) - self.low_
        self.span_ = np.where(span > 0, span, np.inf)
        scaled = (rows.x - self.low_) / self.span_
        size = np.ptp(rows.y, axis=0)
        size = np.where(size > 0, size, 1.0)
        for count in self.nodes:
            self.centres_ = k_means(scaled, min(count, len(scaled)), seed=0)
            self.width_ = _width(self.centres_)
            terms = self._terms(scaled)
            weights, *_ = np.linalg.lstsq(terms, rows.y, rcond=RCOND)
            self.weights_ = np.asarray(weights, np.float64)
            error = (((terms @ self.weights_ - rows.y) / size) ** 2).mean()
            if error <= self.target or count >= len(scaled) // 2:
                break
        return self

    def predict(self, x: Array) -> Array:
        """Targets (s, k)."""
        fitted(self, 'weights_')
        return predict_rows(x, len(self.low_), self._answer)

    def _answer(self, x: Array) -> Array:
        return np.asarray(self._terms((x - self.low_) / self.span_) @ self.weights_)

    def _terms(self, scaled: Array) -> Array:
        """Nodes of normalised features and a constant, shape (s, h + 1)."""
        terms = np.ones((len(scaled), len(self.centres_) + 1))
        apart = scaled[:, None] - self.centres_
        square = np.einsum('shd,shd->sh', apart, apart)
        np.exp(-square / (2 * self.width_**2), out=terms[:, :-1])
        return terms


def k_means(points: Array, count: int, seed: int) -> Array:
    """Centres (h, d), all different, of at most `count` clusters of points (s, d).

    The first centres are drawn from the points; empty clusters are left out.

    Examples
    --------
    >>> k_means(np.array([[0.0], [0.2], [1.0], [1.0]]), 3, seed=0).round(1).ravel().tolist()
    [0.0, 0.2, 1.0]
    """
    different = np.unique(points, axis=0)
    first = np.random.default_rng(seed).permutation(len(different))[:count]
    return np.unique(kmeans(points, different[first])[0], axis=0)


def _width(centres: Array) -> float:
    """Width of the nodes: d_max / sqrt(2 h)."""
    apart = centres[:, None] - centres
    largest = float(np.sqrt((apart**2).sum(axis=2).max()))
    return max(largest / float(np.sqrt(2 * len(centres))), 1e-3)
