"""A table of touches that share the blame for a reading: place, load and class by likelihood.

Every row of the table is a touch with the reading that it would give. Those nearest to a reading
in the metric of its errors are weighed by their likelihood, a Gaussian whose width is the noise
and the table's own spacing there (Nadaraya, Theor. Probab. Appl. 9, 1964; Loftsgaarden and
Quesenberry, Ann. Math. Stat. 36, 1965). What one outside cause adds to many channels, such as a
uniform stray field, enters the metric as a covariance: along it a difference says little. Where
two far touches give one reading, both stay, and the covariance is as wide as they are apart.
"""

from __future__ import annotations

from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np
from scipy.spatial import cKDTree

from tactile_ros.estimators.training import fitted
from tactile_ros.types import Array, Integers

# A tree is no array: it is grown again where a calibration was loaded.
_TREES: WeakKeyDictionary[TouchTable, cKDTree] = WeakKeyDictionary()
NEAREST = 4  # of the neighbours: their mean distance is the table's spacing


@dataclass(frozen=True)
class Blame:
    """Neighbours of readings, with their share of the likelihood.

    Attributes
    ----------
    index : ndarray of int, shape (s, n)
        Rows of the table.
    weight : ndarray, shape (s, n)
        Sum to 1 over the neighbours.
    distance : ndarray, shape (s,)
        To the table in the metric, mean over the nearest (unit of the features).
    """

    index: Integers
    weight: Array
    distance: Array

    def mean(self, answers: Array) -> Array:
        """Mean (s, k) of the answers (n, k) of the table."""
        return np.asarray(np.einsum('sn,snk->sk', self.weight, answers[self.index]))

    def covariance(self, answers: Array, mean: Array) -> Array:
        """Covariance (s, k, k) of the answers (n, k) about `mean` (s, k)."""
        away = answers[self.index] - mean[:, None]
        weighed = away * self.weight[:, :, None]
        return np.asarray(np.matmul(weighed.transpose(0, 2, 1), away))

    def shares(self, classes: Integers, count: int) -> Array:
        """Share (s, count) of each class, by the classes (n,) of the table; -1 has none."""
        named = classes[self.index]
        row = np.arange(len(named))[:, None] * (count + 1)
        place = row + np.where(named < 0, count, named)
        total = np.bincount(place.ravel(), self.weight.ravel(), len(named) * (count + 1))
        share = total.reshape(len(named), count + 1)[:, :count]
        whole = share.sum(axis=1, keepdims=True)
        return np.where(whole > 0, share / np.maximum(whole, 1e-12), 1 / max(count, 1))


class TouchTable:
    """Readings of known touches, in the metric of what may falsify a reading.

    Parameters
    ----------
    noise : float
        Standard deviation of a feature (unit of the features).
    common : ndarray, shape (d, q), or None
        What outside causes add to the features, a column for each of unit size.
    strength : float
        Standard deviation of the causes (unit of the features).
    neighbours : int
        Rows that share a reading (n).
    width : float
        Of the Gaussian, in spacings of the table.

    Attributes
    ----------
    metric_ : ndarray, shape (d, d)
        Turns differences of features into ones of equal worth.
    samples_ : ndarray, shape (n, d)
        Features of the table in the metric.
    floor_ : float
        Least spread across the table: the noise, or a thousandth of the features.

    Notes
    -----
    Ties: rows at one distance have one weight; which of them are among the neighbours is told by
    their own order.

    Examples
    --------
    >>> table = TouchTable(noise=1e-3, neighbours=2).fit(np.array([[0.0], [1.0], [5.0]]))
    >>> table.blame(np.array([[0.5]])).mean(np.array([[10.0], [20.0], [90.0]]))
    array([[15.]])
    """

    metric_: Array
    samples_: Array
    floor_: float

    def __init__(
        self,
        noise: float,
        common: Array | None = None,
        strength: float = 0.0,
        neighbours: int = 32,
        width: float = 0.7,
    ) -> None:
        self.noise = noise
        self.common = common
        self.strength = strength
        self.neighbours = neighbours
        self.width = width

    def fit(self, x: Array) -> TouchTable:
        """Remember the features x (n, d) of touches; returns itself."""
        scale = max(float(np.sqrt((x * x).mean())), 1e-12)
        self.metric_ = np.eye(x.shape[1])
        if self.common is not None and self.strength > 0:
            # relative to the noise a cause is so strong that only its size counts
            spread = np.linalg.svd(self.common, full_matrices=False)
            size = np.hypot(1.0, self.strength * spread[1] / max(self.noise, 1e-2 * scale))
            self.metric_ -= (spread[0] * (1 - 1 / size)) @ spread[0].T
        self.samples_ = x @ self.metric_
        self.floor_ = max(self.noise, 1e-3 * scale)
        _TREES.pop(self, None)
        return self

    def blame(self, x: Array) -> Blame:
        """Neighbours of finite features x (s, d).

        Raises
        ------
        NotCalibratedError
            Before a fit.
        """
        fitted(self, 'samples_')
        count = min(self.neighbours, len(self.samples_))
        distance, index = self._tree().query(x @ self.metric_, k=np.arange(1, count + 1))
        near = distance[:, :NEAREST].mean(axis=1)
        width = (self.width * near) ** 2 + self.noise**2
        squares = distance * distance - distance[:, :1] ** 2
        weight = np.exp(-0.5 * squares / np.maximum(width, 1e-300)[:, None])
        weight /= weight.sum(axis=1, keepdims=True)
        return Blame(index, weight, near)

    def strangeness(self, x: Array, blame: Blame) -> Array:
        """How far features (s, d) lie off the sheet of their neighbours.

        Returns
        -------
        ndarray, shape (s,)
            Mahalanobis distance to the neighbours: of order 1 inside and along the table, large
            across it, where neighbours differ by little more than noise.
        """
        near = self.samples_[blame.index]
        centre = near.mean(axis=1)
        away = near - centre[:, None]
        spread = np.matmul(away.transpose(0, 2, 1), away) / near.shape[1]
        spread += self.floor_**2 * np.eye(spread.shape[1])
        off = x @ self.metric_ - centre
        inside = np.linalg.solve(spread, off[:, :, None])[:, :, 0]
        return np.asarray(np.sqrt((off * inside).sum(axis=1)))

    def _tree(self) -> cKDTree:
        if self not in _TREES:
            _TREES[self] = cKDTree(self.samples_)
        return _TREES[self]
