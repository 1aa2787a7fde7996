"""Table of touches weighed by the likelihood of a reading: place, load and class.

Every row of the table is a touch with the reading that it would give. Those nearest to a reading
in the metric of its errors are weighed by their likelihood, a Gaussian whose width is the noise
and the table's own spacing there (Nadaraya, Theor. Probab. Appl. 9, 1964; Loftsgaarden and
Quesenberry, Ann. Math. Stat. 36, 1965). What one outside cause adds to many channels, such as a
uniform stray field, enters the metric as a covariance: along it a difference says little. Where
two far touches give one reading, both stay, and the covariance is as wide as they are apart.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from weakref import WeakKeyDictionary

import numpy as np
from scipy.spatial import cKDTree

from tactile_ros.estimators.regression import fitted
from tactile_ros.physics.compiled import compiled
from tactile_ros.types import Array, Integers


@compiled
def one_row(z: Array, row: Array, inside: Array, part: Array) -> float:
    """Misfit of features (d,) to a row of the table; fills its answers (k,)."""
    channels, freedoms, count = len(z), len(inside), len(part)
    lead = channels * (1 + freedoms)
    own = lead + count * freedoms
    misfit = 0.0
    for i in range(channels):
        misfit += (z[i] - row[i]) ** 2
    for j in range(freedoms):
        total = 0.0
        for i in range(channels):
            total += row[channels * (1 + j) + i] * (z[i] - row[i])
        inside[j] = total
        misfit -= total * total
    for k in range(count):
        total = row[own + k]
        for j in range(freedoms):
            total += row[lead + k * freedoms + j] * inside[j]
        part[k] = total
    return float(misfit * row[own + count])


@compiled
def mixture_rows(
    z: Array, index: Integers, table: Array, freedoms: int, outcome: Array, cov: Array,
    parts: Array, weight: Array,
) -> None:  # fmt: skip
    """Fill what features say.

    Parameters
    ----------
    z : ndarray, shape (s, d)
        Features in the metric.
    index : ndarray of int, shape (s, m)
        Rows of the table.
    table : ndarray, shape (n, w)
        One piece for each row.
    freedoms : int
        Of a touch (q).
    outcome : ndarray, shape (s, k + 2)
        Mean, logarithm of the likelihood, least misfit; overwritten like the following.
    cov : ndarray, shape (s, c, c)
        Zeros; of the first c answers.
    parts, weight : ndarray, shape (s, m, k) and (s, m)
        Of the rows.
    """
    count = parts.shape[2]
    inside = np.empty(freedoms)
    for s in range(len(z)):
        best, least, whole = -math.inf, math.inf, 0.0
        for m in range(index.shape[1]):
            row = table[index[s, m]]
            misfit = one_row(z[s], row, inside, parts[s, m])
            least = min(least, misfit)
            weight[s, m] = row[-1] - 0.5 * misfit
            best = max(best, weight[s, m])
        outcome[s] = 0.0
        for m in range(index.shape[1]):
            weight[s, m] = math.exp(weight[s, m] - best)
            whole += weight[s, m]
        for m in range(index.shape[1]):
            weight[s, m] /= whole
            for k in range(count):
                outcome[s, k] += weight[s, m] * parts[s, m, k]
        outcome[s, count], outcome[s, count + 1] = best + math.log(whole), least
        for m in range(index.shape[1]):
            add_spread(table[index[s, m]], freedoms, weight[s, m], parts[s, m], outcome[s], cov[s])


@compiled
def add_spread(
    row: Array, freedoms: int, share: float, part: Array, mean: Array, cov: Array
) -> None:
    """Add the share of a row of the table to a covariance: within the row, and off the mean."""
    count = len(part)
    lead = len(row) - 2 - count - count * freedoms
    variance = 1 / row[-2]
    for a in range(len(cov)):
        for b in range(a + 1):
            total = 0.0
            for j in range(freedoms):
                total += row[lead + a * freedoms + j] * row[lead + b * freedoms + j]
            added = share * (variance * total + (part[a] - mean[a]) * (part[b] - mean[b]))
            cov[a, b] += added
            if a != b:
                cov[b, a] += added


@compiled
def share_rows(parts: Array, weight: Array, centres: Array, shares: Array) -> None:
    """Add the weight of parts (s, m, k) to the centre (n, 3) that their place is nearest to."""
    for s in range(len(parts)):
        for m in range(parts.shape[1]):
            best, least = 0, math.inf
            for n in range(len(centres)):
                far = 0.0
                for i in range(3):
                    far += centres[n, i] * (0.5 * centres[n, i] - parts[s, m, i])
                if far < least:
                    best, least = n, far
            shares[s, best] += weight[s, m]


SOME = 1024  # rows of the table that answer readings which are like none of it
BLOCK = 512


@dataclass(frozen=True)
class Linearised:
    """Touches with their readings, and both in a neighbourhood.

    Each row of a table is a touch with its reading, how the reading changes with the touch, and
    how far touches of its kind reach. Around every row the reading is linear in the touch, so that
    one Gauss-Newton step with the row's own gain gives the touch, its covariance and the
    likelihood of the row (Gaussian sum filter: Sorenson and Alspach, Automatica 7, 1971). The
    gains are computed once. What an outside cause adds to many channels at once enters the metric
    as a covariance.

    Attributes
    ----------
    slopes : ndarray, shape (n, d, q)
        How readings change with the q freedoms of a touch, each in units of its reach.
    """

    readings: Array  # (n, d) of the touches (unit of the features)
    slopes: Array
    answers: Array  # (n, k) what is told of a touch
    leads: Array  # (n, k, q) how answers change with the freedoms
    sigma: Array  # (n,) what a channel's reading may be wrong by (unit of the features)
    share: Array  # (n,) how common such touches are; sums to 1

    def of(self, count: int) -> Linearised:
        """With the first answers alone."""
        return replace(self, answers=self.answers[:, :count], leads=self.leads[:, :count])


@dataclass(frozen=True)
class Posterior:
    """What readings say."""

    # (s, k) and (s, c, c) of the answers; the covariance is of the first c
    mean: Array
    cov: Array
    evidence: Array  # (s,) logarithm of the likelihood of the reading
    misfit: Array  # (s,) least sum of squares, over sigma, that a touch leaves unexplained
    # (s, m, k) and (s, m) answers of the nearest rows of the table, and their share; sums to 1
    parts: Array
    weight: Array


class GaussianSumTable:
    """Table of touches that answers readings.

    Parameters
    ----------
    touches : Linearised
        Of the table.
    common : ndarray, shape (d, q), or None
        What outside causes add to the features, a column for each of unit size.
    strength : float
        Standard deviation of the causes (unit of the features).
    neighbours : int
        Rows that answer (m).
    told : int or None
        How many answers have a covariance (c); None: all.
    slack : float
        Share by which a neighbour may be farther than one that was passed over; readings that are
        like none of the table's are looked up sooner.

    Examples
    --------
    A reading that is twice the place, between two rows of the table:

    >>> place = np.array([[0.0], [1.0]])
    >>> rows = Linearised(
    ...     2 * place, np.full((2, 1, 1), 2.0), place, np.ones((2, 1, 1)),
    ...     np.full(2, 1e-3), np.full(2, 0.5))
    >>> GaussianSumTable(rows, neighbours=2)(np.array([[0.6]])).mean.round(3)
    array([[0.3]])
    """

    def __init__(
        self, touches: Linearised, common: Array | None = None, strength: float = 0.0,
        neighbours: int = 16, told: int | None = None, slack: float = 0.0,
    ) -> None:  # fmt: skip
        count, channels = touches.readings.shape
        self.neighbours = min(neighbours, count)
        self.slack = slack
        self.told = touches.answers.shape[1] if told is None else told
        typical = float(np.sqrt((touches.sigma**2).mean()))
        self.metric, self.volume = _metric(channels, common, strength / typical)
        self.turned = self.volume != 0.0
        samples = touches.readings @ self.metric
        self.tree = cKDTree(samples)
        slopes = np.matmul(self.metric, touches.slopes)
        variance = touches.sigma**2
        inner = np.matmul(slopes.transpose(0, 2, 1), slopes)
        inner += variance[:, None, None] * np.eye(slopes.shape[2])
        factor = np.linalg.cholesky(inner)
        turned = np.linalg.solve(factor, slopes.transpose(0, 2, 1))
        root = np.linalg.inv(factor).transpose(0, 2, 1)
        leads = np.matmul(touches.leads, root)
        own = np.log(np.maximum(touches.share, 1e-300)) + self.volume
        own -= np.log(np.diagonal(factor, axis1=1, axis2=2)).sum(axis=1)
        own -= 0.5 * (channels - slopes.shape[2]) * np.log(variance)
        self.freedoms, self.count = slopes.shape[2], touches.answers.shape[1]
        pieces = (samples, turned, leads, touches.answers, 1 / variance, own)
        # a row's numbers in one piece: looked up at once
        self.table = np.concatenate([part.reshape(count, -1) for part in pieces], axis=1)

    def __call__(self, x: Array) -> Posterior:
        """What finite features x (s, d) say."""
        z = x
        if self.turned:
            # a row at a time: the same bits alone and among others
            z = np.matmul(x[:, None], self.metric)[:, 0]
        index = self._nearest(z)
        rows, near, count = len(z), index.shape[1], self.count
        outcome = np.empty((rows, count + 2))
        cov = np.zeros((rows, self.told, self.told))
        parts, weight = np.empty((rows, near, count)), np.empty((rows, near))
        mixture_rows(z, index, self.table, self.freedoms, outcome, cov, parts, weight)
        return Posterior(
            outcome[:, :count], cov, outcome[:, count], outcome[:, count + 1], parts, weight
        )

    def _nearest(self, z: Array) -> Integers:
        index = self.tree.query(z, k=self.neighbours, eps=self.slack)[1]
        return np.asarray(index.reshape(len(z), self.neighbours))

    def at_large(self, x: Array, centres: Array) -> tuple[Array, Array, Array]:
        """Answers of features (s, d) that are wrong by an amount which nobody knows.

        With all sizes of the error as likely a priori (Jeffreys), a touch is as likely as its
        distance to the power -d (Student's t of no degrees of freedom).

        Returns
        -------
        mean, cov : ndarray, shape (s, c) and (s, c, c)
            Over some rows of the whole table.
        shares : ndarray, shape (s, n)
            Of the touches that are nearest to each of the centres (n, 3).
        """
        channels, rows = x.shape[1], self.table[:: -(-len(self.table) // SOME)]
        samples, answers = rows[:, :channels], rows[:, -2 - self.count : -2][:, : self.told]
        least = channels / rows[:, -2]
        near = answers[:, :3] @ centres.T - 0.5 * (centres**2).sum(axis=1)
        named = np.eye(len(centres))[near.argmax(axis=1)]
        mean, cov = np.empty((len(x), self.told)), np.empty((len(x), self.told, self.told))
        shares = np.empty((len(x), len(centres)))
        for i in range(0, len(x), BLOCK):
            block = slice(i, i + BLOCK)
            # a row at a time: the same bits alone and among others
            away = np.matmul(x[block, None], self.metric) - samples
            likely = ((away * away).sum(axis=2) + least) ** (-0.5 * channels)
            likely /= likely.sum(axis=1, keepdims=True)
            mean[block] = np.matmul(likely[:, None], answers)[:, 0]
            shares[block] = np.matmul(likely[:, None], named)[:, 0]
            apart = (answers - mean[block, None]) * np.sqrt(likely)[:, :, None]
            cov[block] = np.matmul(apart.transpose(0, 2, 1), apart)
        return mean, cov, shares

    def of_causes(self, x: Array, sigma: float) -> Array:
        """Logarithm of the likelihood (s,) that outside causes alone made features x (s, d)."""
        z = np.matmul(x[:, None], self.metric)[:, 0] / sigma
        return np.asarray(self.volume - 0.5 * (z * z).sum(axis=1) - x.shape[1] * np.log(sigma))

    def shares(self, seen: Posterior, centres: Array) -> Array:
        """Share (s, n) of the parts that are nearest to each of some centres (n, 3)."""
        rows = len(seen.parts)
        shares = np.zeros((rows, len(centres)))
        share_rows(seen.parts, seen.weight, centres, shares)
        return shares


def _metric(channels: int, common: Array | None, strength: float) -> tuple[Array, float]:
    """What turns features into ones of equal worth (d, d), and the logarithm of its volume."""
    metric = np.eye(channels)
    if common is None or not strength > 0:
        return metric, 0.0
    left, size, _ = np.linalg.svd(common, full_matrices=False)
    wide = np.hypot(1.0, strength * size)
    metric -= (left * (1 - 1 / wide)) @ left.T
    return metric, -float(np.log(wide).sum())


# A tree is no array: it is grown again where a calibration was loaded.
_TREES: WeakKeyDictionary[TouchTable, cKDTree] = WeakKeyDictionary()
NEAREST = 4  # of the neighbours: their mean distance is the table's spacing


@dataclass(frozen=True)
class LikelihoodWeights:
    """Neighbours of readings, with their share of the likelihood.

    Attributes
    ----------
    distance : ndarray, shape (s,)
        To the table in the metric, mean over the nearest (unit of the features).
    """

    index: Integers  # (s, n) rows of the table
    weight: Array  # (s, n) sum to 1 over the neighbours
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

    metric_: Array  # (d, d) turns differences of features into ones of equal worth
    samples_: Array  # (n, d) features of the table in the metric
    floor_: float  # least spread across the table: the noise, or a thousandth of the features

    def __init__(
        self, noise: float, common: Array | None = None, strength: float = 0.0,
        neighbours: int = 32, width: float = 0.7,
    ) -> None:  # fmt: skip
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

    def blame(self, x: Array) -> LikelihoodWeights:
        """Neighbours of finite features x (s, d)."""
        fitted(self, 'samples_')
        count = min(self.neighbours, len(self.samples_))
        distance, index = self._tree().query(x @ self.metric_, k=np.arange(1, count + 1))
        near = distance[:, :NEAREST].mean(axis=1)
        width = (self.width * near) ** 2 + self.noise**2
        squares = distance * distance - distance[:, :1] ** 2
        weight = np.exp(-0.5 * squares / np.maximum(width, 1e-300)[:, None])
        weight /= weight.sum(axis=1, keepdims=True)
        return LikelihoodWeights(index, weight, near)

    def strangeness(self, x: Array, blame: LikelihoodWeights) -> Array:
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
