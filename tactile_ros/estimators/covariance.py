# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Covariances of estimates: learned from what drives errors, scaled on held-out groups."""

from __future__ import annotations

import math

import numpy as np
from scipy.special import stdtrit

from tactile_ros.estimators.regression import fitted
from tactile_ros.physics.compiled import compiled
from tactile_ros.types import Array, Bools, Integers, as_shape

ONE_SIGMA = 0.6827
GROWTHS = 0.03 * 2.0 ** np.arange(9)  # of the variance, per squared distance
USUAL_GROWTH = 0.1
FEWEST_GROUPS = 5  # by which variances are scaled
MARGIN = 1.2  # times the largest distance of a training reading: from there on out of range


class CovarianceModel:
    """Scale of stated covariances by held-out errors, growing with the distance of the readings.

    The scale of each component is the quantile of held-out errors over their stated sigma that
    holds 68.27 % of them. Rows of a group share their error to the extent that they lie inside
    one sigma together (intraclass correlation, Fisher 1925): a group counts as the effective
    number of independent rows in it (Kish, Survey Sampling, 1965), and few of these widen the
    answer as Student's distribution does. The distance is that of Mahalanobis to the training
    readings, shrunk, with a mean square of one.

    Examples
    --------
    >>> rng = np.random.default_rng(0)
    >>> errors, readings = rng.normal(0, 2, (4000, 1)), rng.normal(size=(4000, 2))
    >>> model = CovarianceModel().fit(errors, None, np.arange(4000), readings)
    >>> covariance, out_of_range = model.predict(None, np.array([[0.0, 0.0], [9.0, 9.0]]))
    >>> bool(1.9 < covariance[0, 0, 0] ** 0.5 < 2.1), out_of_range.tolist()
    (True, [False, True])
    """

    scale_: Array  # (l,) of sigma; where nothing was measured 1, or NaN if nothing is stated
    growth_: Array  # (l,) of the variance with the squared distance
    mean_: Array  # (m,) and (m, m), of the distance
    whitening_: Array
    limit_: float  # distance from which readings are out of range; sigma then grows with it
    correlation_: Array  # (l, l) of the errors; used where no covariance is stated

    def fit(
        self, errors: Array, stated: Array | None, groups: Integers, readings: Array
    ) -> CovarianceModel:
        """Learn from errors (s, l) of rows that the estimator had not been fitted to.

        `stated` are covariances (s, l, l) or standard deviations (s, l), `groups` (s,) what a
        split keeps together, where independent rows stand alone, `readings` (s, m) the features of
        the estimator. NaN: not measured.
        """
        errors = as_shape('errors', errors, (-1, -1))
        readings = as_shape('readings', readings, (len(errors), -1))
        square = self._fit_distance(readings)
        sigma = _sigmas(stated, errors.shape)
        unit, count = errors / sigma, errors.shape[1]
        unit[~(np.isfinite(unit) & (sigma > 0))] = np.nan
        self.scale_ = np.full(count, np.nan if stated is None else 1.0)
        self.growth_ = np.full(count, USUAL_GROWTH)
        rows = np.zeros(count)
        for k in range(count):
            own = np.isfinite(unit[:, k])
            if own.any():
                size = np.abs(unit[own, k])
                weight = _weights(size <= np.quantile(size, ONE_SIGMA), groups[own])
                rows[k] = weight.sum()
                self.growth_[k] = _growth(size, weight, square[own])
                unit[own, k] /= np.sqrt(1 + self.growth_[k] * square[own])
                self.scale_[k] = _scale(np.abs(unit[own, k]), weight)
        unit = np.clip(np.nan_to_num(unit / np.where(self.scale_ > 0, self.scale_, 1)), -3, 3)
        size = np.sqrt((unit * unit).sum(axis=0))
        unit /= np.where(size > 0, size, 1.0)
        self.correlation_ = 0.999 * (unit.T @ unit) * rows.min() / (rows.min() + 5.0)
        np.fill_diagonal(self.correlation_, 1.0)
        return self

    def predict(self, stated: Array | None, readings: Array) -> tuple[Array, Bools]:
        """Covariances (s, l, l) of errors, and whether readings are out of range (s,).

        What is stated, and readings, are as in the fit; NaN where what is stated is NaN. Out of
        range is farther from the readings of the fit than any of them.
        """
        fitted(self, 'correlation_')
        readings = np.ascontiguousarray(readings, np.float64)
        if readings.shape[1:] != self.mean_.shape:
            readings = as_shape('readings of predict', readings, (-1, len(self.mean_)))
        count, width = len(readings), len(self.scale_)
        covariance, beyond = np.empty((count, width, width)), np.empty(count, bool)
        unit = self.correlation_[None] if stated is None or stated.ndim == 2 else stated
        _widened_rows(
            readings, self.mean_, self.whitening_, self.limit_, self.scale_, self.growth_, unit,
            covariance, beyond,
        )  # fmt: skip
        if stated is not None and stated.ndim == 2:
            covariance = scaled(covariance, stated)
        return covariance, beyond

    def _fit_distance(self, readings: Array) -> Array:
        """Learn the distance; return its square for each row (s,)."""
        known = np.isfinite(readings)
        count = np.maximum(known.sum(axis=0), 1)
        self.mean_ = np.where(known, readings, 0.0).sum(axis=0) / count
        step = np.where(known, readings - self.mean_, 0.0)
        spread = np.sqrt((step * step).sum(axis=0) / count)
        moves = spread > 1e-9 * np.abs(self.mean_)
        gain = np.where(moves, 1 / np.where(moves, spread, 1.0), 0.0)
        unit, width = step * gain, readings.shape[1]
        shrink = 0.01 + width / (width + 10.0 * len(unit))
        shape = (1 - shrink) * (unit.T @ unit) / len(unit) + shrink * np.eye(width)
        self.whitening_ = np.linalg.inv(np.linalg.cholesky(shape)) * gain
        square = np.empty(len(readings))
        _distances(np.ascontiguousarray(readings), self.mean_, self.whitening_, square)
        norm = max(float(square.mean()), 1e-12)
        self.whitening_ /= math.sqrt(norm)
        self.limit_ = MARGIN * math.sqrt(max(float(square.max()) / norm, 1.0))
        return np.asarray(square / norm)


def scaled(covariance: Array, factor: Array) -> Array:
    """Covariances (..., l, l) of components (..., l) times a factor each."""
    return covariance * (factor[..., :, None] * factor[..., None, :])


def widened(covariance: Array, ratio: Array) -> Array:
    """Covariances (s, l, l) times a ratio (s,), such as of misfits, where it is above 1.

    Readings that leave more unexplained than is usual tell less (Birge, Phys. Rev. 40, 1932).
    """
    return covariance * np.maximum(ratio, 1.0)[:, None, None]


def scale_by_groups(errors: Array, variance: Array, noise: Array, groups: Integers) -> float:
    """Scale of variances (s,) that rows of a group share, beside noise (s,), by groups left out.

    By the mean size of the errors (s,) of groups over their stated sigma, which is 0.8 where these
    are normal: few places far off count less than in a mean square. 1 of few groups.
    """
    _, index, count = np.unique(groups, return_inverse=True, return_counts=True)
    if len(count) < FEWEST_GROUPS:
        return 1.0
    each, stated, own = (np.bincount(index, v) / count for v in (errors, variance, noise))
    size = np.abs(each) / np.sqrt(stated + own / count)
    return max(math.pi / 2 * float(size.mean()) ** 2, 1e-6)


@compiled
def _distances(readings: Array, mean: Array, whitening: Array, square: Array) -> None:
    """Write squared distances (s,) of readings (s, m); NaN counts as the mean."""
    for s in range(len(square)):
        step = readings[s] - mean
        for j in range(len(step)):
            if not math.isfinite(step[j]):
                step[j] = 0.0
        unit = np.dot(whitening, step)
        square[s] = np.dot(unit, unit)


@compiled
def _widened_rows(
    readings: Array, mean: Array, whitening: Array, limit: float, scale: Array, growth: Array,
    unit: Array, covariance: Array, beyond: Bools,
) -> None:  # fmt: skip
    """Write covariances (s, l, l) of those of unit scale, one or (s, l, l), and what is beyond."""
    square, sigma = np.empty(len(readings)), np.empty(len(scale))
    _distances(readings, mean, whitening, square)
    for s in range(len(square)):
        far = square[s] / limit**2
        beyond[s] = far > 1.0
        for k in range(len(scale)):
            sigma[k] = scale[k] * math.sqrt(max(1.0, far) * (1.0 + growth[k] * square[s]))
            for j in range(k + 1):
                covariance[s, k, j] = unit[s % len(unit), k, j] * sigma[k] * sigma[j]
                covariance[s, j, k] = covariance[s, k, j]


def _sigmas(stated: Array | None, shape: tuple[int, ...]) -> Array:
    """Stated standard deviations (s, l) of any of the three forms."""
    if stated is None:
        return np.ones(shape)
    if stated.ndim == 2:
        return as_shape('stated', stated, shape)
    stated = as_shape('stated', stated, (*shape, shape[1]))
    variance = np.einsum('sll->sl', stated)
    return np.asarray(np.sqrt(np.where(variance > 0, variance, np.nan)))


def _weights(inside: Bools, group: Integers) -> Array:
    """Effective number of independent rows (s,) that each row of a group counts for."""
    index = np.unique(group, return_inverse=True)[1].reshape(-1)
    sizes = np.bincount(index).astype(np.float64)
    total, groups = len(index), len(sizes)
    if groups == total:
        return np.ones(total)
    shares = np.bincount(index, inside) / sizes
    within = float((shares * (1 - shares) * sizes).sum()) / (total - groups)
    common = 1.0
    if groups > 1:
        between = float((sizes * (shares - inside.mean()) ** 2).sum()) / (groups - 1)
        usual = (total - (sizes * sizes).sum() / total) / (groups - 1)
        spread = between + (usual - 1) * within
        common = min(max((between - within) / spread, 0.0), 1.0) if spread > 0 else 1.0
    return np.asarray((1 / (1 + (sizes - 1) * common))[index])


def _growth(size: Array, weight: Array, square: Array) -> float:
    """Most probable growth for sizes of errors (s,) at squared distances (s,), by Laplace's law.

    Its prior is one in logarithms about the usual growth.
    """
    costs = 0.5 * (np.log(GROWTHS / USUAL_GROWTH) / math.log(10.0)) ** 2
    for i, growth in enumerate(GROWTHS):
        factor = np.sqrt(1 + growth * square)
        mean = float((weight * size / factor).sum() / weight.sum()) + np.finfo(float).tiny
        costs[i] += weight.sum() * math.log(mean) + float((weight * np.log(factor)).sum())
    return float(GROWTHS[int(np.argmin(costs))])


def _scale(size: Array, weight: Array) -> float:
    """Weighted quantile that holds 68.27 % of sizes (s,), widened where few are independent."""
    order = np.argsort(size)
    below = np.cumsum(weight[order]) - 0.5 * weight[order]
    quantile = np.interp(ONE_SIGMA * weight.sum(), below, size[order])
    return float(quantile * stdtrit(weight.sum(), 0.5 + 0.5 * ONE_SIGMA))
