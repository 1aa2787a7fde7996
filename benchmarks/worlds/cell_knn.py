# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Vote among the nearest training samples for a cell, as [2] localises touches."""

from __future__ import annotations

from weakref import WeakKeyDictionary

import numpy as np
from scipy.spatial import cKDTree

from tactile_ros.estimators.regression import fitted
from tactile_ros.types import Array, Integers

TREES: WeakKeyDictionary[CellKnn, cKDTree] = WeakKeyDictionary()
SAME = 1e-9  # of a distance, by which two count as equal


class CellKnn:
    """Majority vote among the nearest training samples.

    [2] keeps all training readings and lets the K = 1, 5 or 10 nearest vote for one of 6, 15 or 25
    cells. Readings are compared as they are, in one unit (Cover and Hart, IEEE Trans. IT 13,
    1967).

    Parameters
    ----------
    neighbours : int
        How many samples vote (K).
    power : float
        Of Minkowski's distance: 1 sums differences, 2 is Euclid's, infinity takes the largest.

    Notes
    -----
    Ties: of samples at one distance those of the lowest cell vote; of cells with as many votes
    the one whose voters are nearer in sum wins, then the lowest.

    Examples
    --------
    >>> knn = CellKnn(neighbours=2).fit(np.array([[0.0], [1.0], [3.0]]), np.array([7, 4, 4]))
    >>> knn.predict(np.array([[0.4], [0.5], [2.0]])).tolist()
    [7, 4, 4]
    """

    samples_: Array  # (n, d) features of the training samples
    cells_: Integers  # (n,) their cells

    def __init__(self, neighbours: int = 5, power: float = 2.0) -> None:
        if not power >= 1:
            msg = f'power of CellKnn must be 1 or more; received {power}'
            raise ValueError(msg)
        self.neighbours = neighbours
        self.power = power

    def fit(self, x: Array, cells: Integers) -> CellKnn:
        """Remember features x (n, d) of touches and their cells (n,); returns itself."""
        order = np.lexsort(np.column_stack([x, cells]).T[::-1])
        self.samples_, self.cells_ = x[order], np.asarray(cells, np.int64)[order]
        TREES.pop(self, None)
        return self

    def predict(self, x: Array) -> Integers:
        """Cell (s,) of each row of finite features x (s, d)."""
        fitted(self, 'cells_')
        count = min(self.neighbours, len(self.samples_))
        asked = min(count + 1, len(self.samples_))
        distance, index = self._tree().query(x, k=asked, p=self.power)
        shape = (len(x), asked)
        named = self.cells_.take(index).reshape(shape).tolist()
        far = distance.reshape(shape).tolist()
        cells = np.empty(len(x), np.int64)
        for s, (names, row) in enumerate(zip(named, far, strict=True)):
            if asked > count and row[count] <= row[count - 1] * (1 + SAME):
                cells[s] = self._among_equals(x[s], row[count - 1], count)
            else:
                cells[s] = _vote(names[:count], row)
        return cells

    def _among_equals(self, x: Array, reach: float, count: int) -> int:
        """Cell of a reading (d,) that has several samples at the distance of its last voter."""
        around = reach * (1 + 2 * SAME)
        near = np.array(self._tree().query_ball_point(x, around, p=self.power), np.int64)
        far = np.linalg.norm(self.samples_[near] - x, ord=self.power, axis=1)
        equal = np.where(far >= reach * (1 - SAME), reach, far)
        order = np.lexsort((self.cells_[near], equal))[:count]
        return _vote(self.cells_[near[order]].tolist(), equal[order].tolist())

    def _tree(self) -> cKDTree:
        tree = TREES.get(self)
        if tree is None:
            tree = TREES[self] = cKDTree(self.samples_)
        return tree


def _vote(names: list[int], far: list[float]) -> int:
    """Cell with most votes, then the nearest voters, then the lowest number."""
    first = names[0]
    if names.count(first) == len(names):
        return first
    reach: dict[int, float] = {}
    for name, one in zip(names, far[: len(names)], strict=True):
        reach[name] = reach.get(name, 0.0) + one
    return min(reach, key=lambda name: (-names.count(name), reach[name], name))
