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

from dataclasses import dataclass, fields, replace

import numpy as np
from scipy.spatial import cKDTree

from tactile_ros.estimators.covariance import widened
from tactile_ros.types import Array, Bools, Integers

BLOCK = 512  # rows at once


@dataclass(frozen=True)
class Linearised:
    """Touches with their readings, and both in a neighbourhood."""

    readings: Array  # (n, d) of the touches (unit of the features)
    slopes: Array  # (n, d, q) of the readings with freedoms of a touch, in units of their reach
    answers: Array  # (n, k) estimate of a touch
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
    """Table of touches, of which the nearest `neighbours` (m) answer readings.

    What outside causes add to the features is `common` (d, q), a column for each of unit size;
    `strength` is their standard deviation (unit of the features). The first `told` answers (c)
    have a covariance; None: all. A neighbour may be farther by the share `slack` than one that was
    passed over, so that odd readings are looked up sooner.

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
        self.neighbours, self.slack = min(neighbours, count), slack
        self.answers = touches.answers
        self.told = touches.answers.shape[1] if told is None else told
        self.variance = touches.sigma**2
        self.metric, self.volume = _metric(
            channels, common, strength / float(np.sqrt(self.variance.mean()))
        )
        self.samples = touches.readings @ self.metric
        self.tree = cKDTree(self.samples)
        slopes = np.matmul(self.metric, touches.slopes)
        inner = np.matmul(slopes.transpose(0, 2, 1), slopes)
        inner += self.variance[:, None, None] * np.eye(slopes.shape[2])
        factor = np.linalg.cholesky(inner)
        self.turned = np.linalg.solve(factor, slopes.transpose(0, 2, 1))
        self.leads = np.matmul(touches.leads, np.linalg.inv(factor).transpose(0, 2, 1))
        own = np.log(np.maximum(touches.share, 1e-300)) + self.volume
        own -= np.log(np.diagonal(factor, axis1=1, axis2=2)).sum(axis=1)
        self.own = own - 0.5 * (channels - slopes.shape[2]) * np.log(self.variance)

    def __call__(self, x: Array) -> Posterior:
        """Posterior of finite features x (s, d)."""
        blocks = [self._answer(x[i : i + BLOCK]) for i in range(0, max(len(x), 1), BLOCK)]
        if len(blocks) == 1:
            return blocks[0]
        columns = (
            np.concatenate([getattr(one, f.name) for one in blocks]) for f in fields(Posterior)
        )
        return Posterior(*columns)

    def _answer(self, x: Array) -> Posterior:
        z = x @ self.metric
        near = self.tree.query(z, k=np.arange(1, self.neighbours + 1), eps=self.slack)[1]
        miss = z[:, None] - self.samples[near]
        inside = np.matmul(self.turned[near], miss[..., None])[..., 0]
        variance, leads = self.variance[near], self.leads[near]
        misfit = (np.square(miss).sum(axis=2) - np.square(inside).sum(axis=2)) / variance
        parts = self.answers[near] + np.matmul(leads, inside[..., None])[..., 0]
        likely = self.own[near] - 0.5 * misfit
        best = likely.max(axis=1, keepdims=True)
        weight = np.exp(likely - best)
        whole = weight.sum(axis=1, keepdims=True)
        weight /= whole
        mean = np.matmul(weight[:, None], parts)[:, 0]
        # within the rows, and off the mean
        leads = leads[:, :, : self.told] * np.sqrt(variance)[..., None, None]
        off = (parts - mean[:, None])[..., : self.told, None]
        wide = np.concatenate([leads, off], axis=3) * np.sqrt(weight)[..., None, None]
        cov = np.einsum('smaq,smbq->sab', wide, wide)
        evidence = (best + np.log(whole))[:, 0]
        return Posterior(mean, cov, evidence, misfit.min(axis=1), parts, weight)

    def of_causes(self, x: Array, sigma: float) -> Array:
        """Logarithm of the likelihood (s,) that outside causes alone made features x (s, d)."""
        z = x @ self.metric / sigma
        return np.asarray(self.volume - 0.5 * (z * z).sum(axis=1) - x.shape[1] * np.log(sigma))

    @staticmethod
    def shares(seen: Posterior, centres: Array) -> Array:
        """Share (s, n) of the parts that are nearest to each of some centres (n, 3)."""
        far = (
            0.5 * np.square(centres).sum(axis=1) - seen.parts[..., : centres.shape[1]] @ centres.T
        )
        nearest = far.argmin(axis=2)[..., None] == np.arange(len(centres))
        return np.asarray(np.matmul(seen.weight[:, None], nearest)[:, 0])


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

    Answers of the rows are c of the touch, then its reading. `common` (d, q) and `strength` are
    as in `GaussianSumTable`, None: there is no such cause; `entry` is the share of causes that
    channels differ by, `noise` of a channel, `usual` the misfit that most touches leave.
    """

    NEIGHBOURS, BESIDE, SLACK = 16, 96, 1.0
    ODDS = -4.0  # logarithm, of a common cause against none
    UNLIKE = 4.0  # times the usual misfit, from which a common cause is thought of

    def __init__(
        self, rows: Linearised, common: Array | None, strength: float, entry: float, noise: float,
        usual: float,
    ) -> None:  # fmt: skip
        channels = rows.readings.shape[1]
        self.told = rows.answers.shape[1] - channels
        self.plain = GaussianSumTable(
            rows.of(self.told), neighbours=self.NEIGHBOURS, slack=self.SLACK
        )
        self.common, self.usual, self.entry = common, usual, entry
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
            seen.mean, widened(seen.cov, seen.misfit / self.usual),
            self.plain.shares(seen, places), np.zeros((len(x), causes)), seen.misfit,
        )  # fmt: skip
        rows = np.flatnonzero(seen.misfit > self.UNLIKE * self.usual)
        if len(rows):
            if causes:
                self._blend(found, seen.evidence[rows], x, places, rows)
            # what nothing explains tells nothing
            share = np.maximum(1 - self.UNLIKE * self.usual / found.misfit[rows], 0.0)[:, None]
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
        cause = (x[rows] - other.mean[:, told:]) @ self.solve
        # channels differ by a share of the cause, which may be stronger than usual
        wider = np.maximum(other.misfit / x.shape[1], 1.0)
        wider *= 1 + (self.entry / self.blurred) ** 2 * (cause * cause).sum(axis=1)
        mean, cov = other.mean[:, :told], widened(other.cov, wider)
        found.cov[rows] = _mixed(found.mean[rows], mean, found.cov[rows], cov, share)
        found.mean[rows] += share * (mean - found.mean[rows])
        found.shares[rows] += share * (self.beside.shares(other, places) - found.shares[rows])
        found.cause[rows] = share * cause
        found.misfit[rows] = np.minimum(found.misfit[rows], other.misfit)

    def cause(self, x: Array) -> tuple[Array, Array]:
        """Cause alone (s, q) that readings (s, d) are nearest to, and what remains of them."""
        assert self.common is not None
        size = x @ self.solve
        return size, x - size @ self.common.T

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
