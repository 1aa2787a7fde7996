# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Nearest neighbours among the touches of a grid, the localisation of [2].

The targets of the K nearest training samples are averaged with weights of one over the distance
(Dudani, IEEE Trans. SMC 6, 1976).
"""

from __future__ import annotations

from weakref import WeakKeyDictionary

import numpy as np
from scipy.spatial import cKDTree

from tactile_ros.estimators.regression import Standardisation, fitted, predict_rows, training_rows
from tactile_ros.types import Array, Integers

# A tree is no array: it is grown again where a calibration was loaded.
_TREES: WeakKeyDictionary[GridKnn, cKDTree] = WeakKeyDictionary()
NEARNESS = 1e-3


class GridKnn:
    """Mean of the nearest training samples, weighted by one over the distance ([2]; Dudani).

    Samples nearer than `NEARNESS`, in standard deviations of the features, count as equally near:
    one that is met exactly does not silence the others' noise. Of samples at the same distance the
    first in the order of their own numbers is nearest: the order of the training rows does not
    matter.

    Examples
    --------
    >>> x = np.arange(5.0)[:, None]
    >>> GridKnn(neighbours=2).fit(x, 10 * x).predict(np.array([[1.5]]))
    array([[15.]])
    """

    scale_: Standardisation  # of the features
    samples_: Array  # (n, d) standardised features of the training samples
    answers_: Array  # (n, k) their targets (unit of y)

    def __init__(self, neighbours: int = 5) -> None:
        self.neighbours = neighbours

    def fit(self, x: Array, y: Array, groups: Integers | None = None) -> GridKnn:
        """Remember samples x (s, d) and targets y (s, k); groups are not used; see `Estimator`."""
        rows = training_rows(x, y, groups)
        self.scale_ = Standardisation().fit(rows.x)
        self.samples_, self.answers_ = self.scale_(rows.x), rows.y
        _TREES.pop(self, None)
        return self

    def predict(self, x: Array) -> Array:
        """Average the targets (s, k) of the neighbours of features (s, d); see `Estimator`."""
        fitted(self, 'answers_')
        return predict_rows(x, self.samples_.shape[1], self._answer)

    def _answer(self, x: Array) -> Array:
        count = min(self.neighbours, len(self.samples_))
        asked = min(count + 8, len(self.samples_))
        distance, index = self._tree().query(self.scale_(x), k=np.arange(1, asked + 1))
        # Stable order by distance, then by number: rounding keeps equal distances equal.
        order = np.lexsort((index, np.round(distance, 12)), axis=1)[:, :count]
        distance = np.take_along_axis(distance, order, axis=1)
        index = np.take_along_axis(index, order, axis=1)
        weight = 1 / np.maximum(distance, NEARNESS)
        weight /= weight.sum(axis=1, keepdims=True)
        return np.asarray(np.einsum('sn,snk->sk', weight, self.answers_[index]))

    def _tree(self) -> cKDTree:
        if self not in _TREES:
            _TREES[self] = cKDTree(self.samples_)
        return _TREES[self]
