# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Posterior of a touch by Gauss-Newton steps from a table of touches.

Around every row of the table the reading is linear in the touch, so that one Gauss-Newton step
with the row's own gain gives the touch, its covariance and the likelihood of the row (Gaussian sum
filter: Sorenson and Alspach, Automatica 7, 1971). The gains are computed once. Where two far
touches give one reading, both stay, and the covariance is as wide as they are apart. What an
outside cause adds to many channels, such as a uniform stray field, enters the metric as a
covariance: along it a difference says little.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from tactile_ros.physics.compiled import compiled
from tactile_ros.types import Array, Bools, Integers


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
    """Fill what features (s, d) in the metric say, by rows (s, m) of the table (n, w).

    `outcome` (s, k + 2) is mean, logarithm of the likelihood and least misfit; `cov` (s, c, c), of
    the first c answers, comes as zeros; `parts` (s, m, k) and `weight` (s, m) are of the rows.
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


@dataclass(frozen=True)
class Linearised:
    """Touches with their readings, and both in a neighbourhood."""

    readings: Array  # (n, d) of the touches (unit of the features)
    slopes: Array  # (n, d, q) of the readings with freedoms of a touch, in units of their reach
    answers: Array  # (n, k) what is told of a touch
    leads: Array  # (n, k, q) how answers change with the freedoms
    sigma: Array  # (n,) what a channel's reading may be wrong by (unit of the features)
    share: Array  # (n,) how common such touches are; sums to 1

    def of(self, count: int) -> Linearised:
        """With the first answers alone."""
        return replace(self, answers=self.answers[:, :count], leads=self.leads[:, :count])


@dataclass(frozen=True)
class Posterior:
    """Posterior of a touch."""

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
        """Posterior of finite features x (s, d)."""
        # a row at a time: the same bits alone and among others
        z = np.matmul(x[:, None], self.metric)[:, 0] if self.volume != 0.0 else x
        rows, near, count = len(z), self.neighbours, self.count
        index = self.tree.query(z, k=near, eps=self.slack)[1].reshape(rows, near)
        outcome = np.empty((rows, count + 2))
        cov = np.zeros((rows, self.told, self.told))
        parts, weight = np.empty((rows, near, count)), np.empty((rows, near))
        mixture_rows(z, index, self.table, self.freedoms, outcome, cov, parts, weight)
        return Posterior(
            outcome[:, :count], cov, outcome[:, count], outcome[:, count + 1], parts, weight
        )

    def of_causes(self, x: Array, sigma: float) -> Array:
        """Logarithm of the likelihood (s,) that outside causes alone made features x (s, d)."""
        z = np.matmul(x[:, None], self.metric)[:, 0] / sigma
        return np.asarray(self.volume - 0.5 * (z * z).sum(axis=1) - x.shape[1] * np.log(sigma))

    def shares(self, seen: Posterior, centres: Array) -> Array:
        """Share (s, n) of the parts that are nearest to each of some centres (n, 3)."""
        shares = np.zeros((len(seen.parts), len(centres)))
        share_rows(seen.parts, seen.weight, centres, shares)
        return shares


def _metric(channels: int, common: Array | None, strength: float) -> tuple[Array, float]:
    """Map of features to ones of equal variance (d, d), and the logarithm of its volume."""
    metric = np.eye(channels)
    if common is None or not strength > 0:
        return metric, 0.0
    left, size, _ = np.linalg.svd(common, full_matrices=False)
    wide = np.hypot(1.0, strength * size)
    metric -= (left * (1 - 1 / wide)) @ left.T
    return metric, -float(np.log(wide).sum())


@dataclass(frozen=True)
class TouchEstimate:
    """Touches of readings, and what a common cause added to them."""

    # (s, c) and (s, c, c) of the first c answers
    mean: Array
    cov: Array
    shares: Array  # (s, n) posterior probability of each of some places
    cause: Array  # (s, q) size of the common cause; 0 where none is likely
    misfit: Array  # (s,) least sum of squares, over sigma, that touch and cause leave unexplained


class TouchPosterior:
    """Posterior of a touch with and without a common cause, which is rare.

    Parameters
    ----------
    rows : Linearised
        Answers are c of the touch, then its reading.
    common : ndarray, shape (d, q), or None
        As in `GaussianSumTable`; None: there is no common cause.
    strength, entry : float
        Standard deviation of causes (unit of the features); share of them that channels differ by.
    noise, usual : float
        Of a channel; misfit that most touches leave.
    unlike : float
        Times the usual misfit, from which a common cause is thought of.
    """

    NEIGHBOURS, BESIDE = 16, 96
    SLACK = 1.0
    ODDS = -4.0  # logarithm, of a common cause against none

    def __init__(
        self, rows: Linearised, common: Array | None, strength: float, entry: float, noise: float,
        usual: float, unlike: float = 4.0,
    ) -> None:  # fmt: skip
        channels = rows.readings.shape[1]
        self.told = rows.answers.shape[1] - channels
        self.plain = GaussianSumTable(
            rows.of(self.told), neighbours=self.NEIGHBOURS, slack=self.SLACK
        )
        self.common, self.usual, self.unlike, self.entry = common, usual, unlike, entry
        self.blurred = float(np.hypot(noise, entry * strength))
        every = rows.answers[:, : self.told]
        self.prior = every.mean(axis=0), np.cov(every.T, ddof=0).reshape(self.told, -1)
        if common is not None:
            self.solve = np.linalg.pinv(common).T
            beside = replace(rows, sigma=np.hypot(rows.sigma, entry * strength))
            self.beside = GaussianSumTable(beside, common, strength, self.BESIDE, self.told)

    def __call__(self, x: Array, places: Array) -> TouchEstimate:
        """Touches of finite readings x (s, d), with centres (n, 3) of places to be named."""
        seen = self.plain(x)
        causes = 0 if self.common is None else self.common.shape[1]
        found = TouchEstimate(
            seen.mean, seen.cov, self.plain.shares(seen, places), np.zeros((len(x), causes)),
            seen.misfit,
        )  # fmt: skip
        # wider where a touch leaves more unexplained than is usual (Birge, Phys. Rev. 40, 1932)
        found.cov[:] *= np.maximum(seen.misfit / self.usual, 1.0)[:, None, None]
        rows = np.flatnonzero(seen.misfit > self.unlike * self.usual)
        if len(rows):
            if causes:
                self._blend(found, seen.evidence[rows], x, places, rows)
            # what nothing explains tells nothing
            share = np.maximum(1 - self.unlike * self.usual / found.misfit[rows], 0.0)[:, None]
            found.cov[rows] = _mixed(
                found.mean[rows], self.prior[0], found.cov[rows], self.prior[1], share
            )
            found.mean[rows] += share * (self.prior[0] - found.mean[rows])
        return found

    def _blend(
        self, found: TouchEstimate, evidence: Array, x: Array, places: Array, rows: Integers
    ) -> None:
        """Weigh what some rows say beside a common cause against none, in place."""
        other, told = self.beside(x[rows]), self.told
        share = other.evidence - evidence + self.ODDS
        share = 1 / (1 + np.exp(-np.clip(share, -50, 50)))[:, None]
        cause = np.matmul((x[rows] - other.mean[:, told:])[:, None], self.solve)[:, 0]
        # channels differ by a share of the cause, which may be stronger than usual
        wider = np.maximum(other.misfit / x.shape[1], 1.0)
        wider *= 1 + (self.entry / self.blurred) ** 2 * (cause * cause).sum(axis=1)
        mean, cov = other.mean[:, :told], other.cov * wider[:, None, None]
        found.cov[rows] = _mixed(found.mean[rows], mean, found.cov[rows], cov, share)
        found.mean[rows] += share * (mean - found.mean[rows])
        found.shares[rows] += share * (self.beside.shares(other, places) - found.shares[rows])
        found.cause[rows] = share * cause
        found.misfit[rows] = np.minimum(found.misfit[rows], other.misfit)

    def cause(self, x: Array) -> tuple[Array, Array]:
        """Cause alone (s, q) that readings (s, d) are nearest to, and what remains of them."""
        assert self.common is not None
        # a row at a time: the same bits alone and among others
        size = np.matmul(x[:, None], self.solve)[:, 0]
        return size, x - np.matmul(size[:, None], self.common.T)[:, 0]

    def touching(self, x: Array, threshold: float) -> Bools:
        """Decide whether readings (s, d) are those of a touch or of a common cause alone.

        They are of a touch where their norm less the cause exceeds a threshold.
        """
        touching = np.asarray((self.cause(x)[1] ** 2).sum(axis=1) > threshold**2)
        weak = np.flatnonzero(~touching)
        if len(weak):
            touch = np.maximum(self.plain(x[weak]).evidence, self.beside(x[weak]).evidence)
            touching[weak] = touch > self.beside.of_causes(x[weak], self.blurred)
        return touching


def _mixed(one: Array, other: Array, cov: Array, other_cov: Array, share: Array) -> Array:
    """Covariance (s, c, c) of two Gaussians of which the other has a share (s, 1)."""
    apart, part = other - one, share[:, :, None]
    between = (1 - part) * apart[:, :, None] * apart[:, None]
    return np.asarray(cov + part * (other_cov - cov + between))
