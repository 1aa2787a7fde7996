"""Touches as a mixture of Gaussians: what a reading says of place and load, by Bayes.

Each row of a table is a touch with its reading, how the reading changes with the touch, and how
far touches of its kind reach. Around every row the reading is linear in the touch, so that one
Gauss-Newton step with the row's own gain gives the touch, its covariance and the likelihood of
the row (Gaussian sum filter: Sorenson and Alspach, Automatica 7, 1971). The gains are computed
once. What an outside cause adds to many channels at once enters the metric as a covariance.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from tactile_ros.estimators.mixture_rows import mixture_rows, share_rows
from tactile_ros.physics.compiled import available
from tactile_ros.types import Array, Integers

SOME = 1024  # rows of the table that answer readings which are like none of it
BLOCK = 512


@dataclass(frozen=True)
class Linearised:
    """Touches with their readings, and both in a neighbourhood.

    Attributes
    ----------
    readings : ndarray, shape (n, d)
        Of the touches (unit of the features).
    slopes : ndarray, shape (n, d, q)
        How readings change with the q freedoms of a touch, each in units of its reach.
    answers : ndarray, shape (n, k)
        What is told of a touch.
    leads : ndarray, shape (n, k, q)
        How answers change with the freedoms.
    sigma : ndarray, shape (n,)
        What a channel's reading may be wrong by (unit of the features).
    share : ndarray, shape (n,)
        How common such touches are; sums to 1.
    """

    readings: Array
    slopes: Array
    answers: Array
    leads: Array
    sigma: Array
    share: Array

    def of(self, count: int) -> Linearised:
        """With the first answers alone."""
        return replace(self, answers=self.answers[:, :count], leads=self.leads[:, :count])


@dataclass(frozen=True)
class Posterior:
    """What readings say.

    Attributes
    ----------
    mean, cov : ndarray, shape (s, k) and (s, c, c)
        Of the answers; the covariance is of the first c.
    evidence : ndarray, shape (s,)
        Logarithm of the likelihood of the reading.
    misfit : ndarray, shape (s,)
        Least sum of squares, over sigma, that a touch leaves unexplained.
    parts, weight : ndarray, shape (s, m, k) and (s, m)
        Answers of the nearest rows of the table, and their share; sums to 1.
    """

    mean: Array
    cov: Array
    evidence: Array
    misfit: Array
    parts: Array
    weight: Array


class TouchMixture:
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
    >>> TouchMixture(rows, neighbours=2)(np.array([[0.6]])).mean.round(3)
    array([[0.3]])
    """

    def __init__(
        self,
        touches: Linearised,
        common: Array | None = None,
        strength: float = 0.0,
        neighbours: int = 16,
        told: int | None = None,
        slack: float = 0.0,
    ) -> None:
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
        return self._loops(z, index) if available() else self._arrays(z, index)

    def _loops(self, z: Array, index: Integers) -> Posterior:
        """By compiled loops over rows."""
        rows, near, count = len(z), index.shape[1], self.count
        outcome = np.empty((rows, count + 2))
        cov = np.zeros((rows, self.told, self.told))
        parts, weight = np.empty((rows, near, count)), np.empty((rows, near))
        mixture_rows(z, index, self.table, self.freedoms, outcome, cov, parts, weight)
        return Posterior(
            outcome[:, :count], cov, outcome[:, count], outcome[:, count + 1], parts, weight
        )

    def _arrays(self, z: Array, index: Integers) -> Posterior:
        """By whole arrays; the same numbers to rounding."""
        rows, channels, freedoms, count = *z.shape, self.freedoms, self.count
        near = index.shape[1]
        piece = self.table.take(index, axis=0)
        ends = np.cumsum([channels, freedoms * channels, count * freedoms, count])
        away = z[:, None] - piece[:, :, :channels]
        gains = piece[:, :, ends[0] : ends[1]].reshape(rows, near, freedoms, channels)
        leads = piece[:, :, ends[1] : ends[2]].reshape(rows, near, count, freedoms)
        # in the order of the loops: what a touch explains cancels most of what is away
        inside = np.cumsum(gains * away[:, :, None], axis=3)[..., -1:]
        squares = np.concatenate([away * away, -inside[..., 0] * inside[..., 0]], axis=2)
        misfit = np.cumsum(squares, axis=2)[..., -1] * piece[:, :, -2]
        likely = piece[:, :, -1] - 0.5 * misfit
        best = likely.max(axis=1)
        weight = np.exp(likely - best[:, None])
        total = weight.sum(axis=1)
        weight /= total[:, None]
        parts = piece[:, :, ends[2] : ends[3]] + np.matmul(leads, inside)[..., 0]
        mean = np.matmul(weight[:, None], parts)[:, 0]
        own = leads * np.sqrt(weight / piece[:, :, -2])[..., None, None]
        cov = self._covariance(own, weight, parts - mean[:, None])
        return Posterior(mean, cov, best + np.log(total), misfit.min(axis=1), parts, weight)

    def _nearest(self, z: Array) -> Integers:
        index = self.tree.query(z, k=self.neighbours, eps=self.slack)[1]
        return np.asarray(index.reshape(len(z), self.neighbours))

    def _covariance(self, leads: Array, weight: Array, apart: Array) -> Array:
        """Within the rows of the table and between them, shape (s, c, c)."""
        told, (rows, near, _, freedoms) = self.told, leads.shape
        wide = np.empty((rows, told, near * (freedoms + 1)))
        split = near * freedoms
        wide[:, :, :split] = leads[:, :, :told].transpose(0, 2, 1, 3).reshape(rows, told, split)
        wide[:, :, split:] = (apart[:, :, :told] * np.sqrt(weight)[..., None]).transpose(0, 2, 1)
        return np.asarray(np.matmul(wide, wide.transpose(0, 2, 1)))

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
        if available():
            share_rows(seen.parts, seen.weight, centres, shares)
            return shares
        near = seen.parts[:, :, :3] @ centres.T - 0.5 * (centres**2).sum(axis=1)
        named = near.argmax(axis=2) + np.arange(rows)[:, None] * len(centres)
        total = np.bincount(named.ravel(), seen.weight.ravel(), shares.size)
        return np.asarray(total.reshape(shares.shape), np.float64)


def _metric(channels: int, common: Array | None, strength: float) -> tuple[Array, float]:
    """What turns features into ones of equal worth (d, d), and the logarithm of its volume."""
    metric = np.eye(channels)
    if common is None or not strength > 0:
        return metric, 0.0
    left, size, _ = np.linalg.svd(common, full_matrices=False)
    wide = np.hypot(1.0, strength * size)
    metric -= (left * (1 - 1 / wide)) @ left.T
    return metric, -float(np.log(wide).sum())
