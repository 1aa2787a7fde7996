"""Covariances of estimates: learned from what drives errors, scaled on held-out groups."""

from __future__ import annotations

import math

import numpy as np
from scipy.special import stdtrit

from tactile_ros.estimators.regression import Standardisation, fitted, group_folds, training_rows
from tactile_ros.physics.compiled import compiled
from tactile_ros.types import Array, Bools, Integers, as_shape

ONE_SIGMA = 0.6827
NEWTON_STEPS = 25
FEW_ROWS = 60
ROWS_PER_LEVEL = 80


GROWTHS = 0.03 * 2.0 ** np.arange(9)  # of the variance, per squared distance
USUAL_GROWTH = 0.1
MARGIN = 1.2  # times the largest distance of a training reading: from there on out of range


@compiled
def scale_covariance(
    covariance: Array, readings: Array, mean: Array, whitening: Array, growth: Array, scale: Array,
    limit: float, out_of_range: Bools,
) -> None:  # fmt: skip
    """Scale stated covariances (s, l, l) of readings (s, m) in place; flag those out of range.

    The others are the attributes of `CovarianceModel` of these names; NaN counts as the mean.
    """
    for s in range(len(readings)):
        square = 0.0
        for i in range(len(mean)):
            total = 0.0
            for j in range(i + 1):
                step = readings[s, j] - mean[j]
                if math.isfinite(step):
                    total += whitening[i, j] * step
            square += total * total
        beyond = max(1.0, square / (limit * limit))
        out_of_range[s] = beyond > 1.0
        for a in range(len(scale)):
            for b in range(len(scale)):
                grown = math.sqrt((1.0 + growth[a] * square) * (1.0 + growth[b] * square))
                covariance[s, a, b] *= scale[a] * scale[b] * beyond * grown


class CovarianceModel:
    """Scale of stated covariances by held-out errors, growing with the distance of the readings.

    The scale of each component is the quantile of held-out errors over their stated sigma that
    holds 68.27 % of them. Rows of a group share their error to the extent that they lie inside
    one sigma together (intraclass correlation, Fisher 1925): a group counts as the effective
    number of independent rows in it (Kish, Survey Sampling, 1965), and few of these widen the
    answer as Student's distribution does. The distance is that of Mahalanobis to the training
    readings, shrunk, with a mean square of one.

    Attributes
    ----------
    scale_, growth_ : ndarray, shape (l,)
        Scale of sigma; growth of the variance with the squared distance. Without an error of a
        component the scale is 1, or NaN where nothing is stated.
    mean_, whitening_ : ndarray, shapes (m,) and (m, m)
        Of the distance.
    limit_ : float
        Distance from which readings are out of range; from there sigma grows with the distance.
    correlation_ : ndarray, shape (l, l)
        Of the errors; used where no covariance is stated.

    Examples
    --------
    >>> rng = np.random.default_rng(0)
    >>> errors, readings = rng.normal(0, 2, (4000, 1)), rng.normal(size=(4000, 2))
    >>> model = CovarianceModel().fit(errors, None, np.arange(4000), readings)
    >>> covariance, out_of_range = model.predict(None, np.array([[0.0, 0.0], [9.0, 9.0]]))
    >>> bool(1.9 < covariance[0, 0, 0] ** 0.5 < 2.1), out_of_range.tolist()
    (True, [False, True])
    """

    scale_: Array
    growth_: Array
    mean_: Array
    whitening_: Array
    limit_: float
    correlation_: Array

    def fit(
        self, errors: Array, stated: Array | None, groups: Integers, readings: Array
    ) -> CovarianceModel:
        """Learn from errors of rows that the estimator had not been fitted to.

        Parameters
        ----------
        errors : ndarray, shape (s, l)
            Out-of-fold estimates minus truth; NaN: not measured.
        stated : ndarray, shape (s, l, l) or (s, l), or None
            Stated covariance or standard deviation (unit of the errors); None: none.
        groups : ndarray of int, shape (s,)
            What a split keeps together; independent rows are groups of their own.
        readings : ndarray, shape (s, m)
            Readings or features of the estimator; NaN: not measured.
        """
        errors = as_shape('errors', errors, (-1, -1))
        readings = as_shape('readings', readings, (len(errors), -1))
        group = np.unique(groups, return_inverse=True)[1].reshape(-1)
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
                weight = _weights(size <= np.quantile(size, ONE_SIGMA), group[own])
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
        """Covariance of the error of each row, and whether its readings are out of range.

        Parameters
        ----------
        stated, readings : ndarray
            As in the fit.

        Returns
        -------
        covariance : ndarray, shape (s, l, l)
            Covariances (unit of the errors, squared); NaN where what is stated is NaN.
        out_of_range : ndarray of bool, shape (s,)
            Whether readings are farther from those of the fit than any of them.
        """
        fitted(self, 'correlation_')
        readings = np.ascontiguousarray(readings, np.float64)
        if readings.shape[1:] != self.mean_.shape:
            readings = as_shape('readings of predict', readings, (-1, len(self.mean_)))
        covariance = np.empty((len(readings), len(self.scale_), len(self.scale_)))
        if stated is None:
            covariance[:] = self.correlation_
        elif stated.ndim == 2:
            np.multiply(stated[:, :, None], stated[:, None, :], out=covariance)
            covariance *= self.correlation_
        else:
            covariance[:] = stated
        out_of_range = np.empty(len(readings), np.bool_)
        scale_covariance(
            covariance, readings, self.mean_, self.whitening_, self.growth_, self.scale_,
            self.limit_, out_of_range,
        )  # fmt: skip
        return covariance, out_of_range

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
        square = ((step @ self.whitening_.T) ** 2).sum(axis=1)
        norm = max(float(square.mean()), 1e-12)
        self.whitening_ /= math.sqrt(norm)
        self.limit_ = MARGIN * math.sqrt(max(float(square.max()) / norm, 1.0))
        return np.asarray(square / norm)


def _sigmas(stated: Array | None, shape: tuple[int, ...]) -> Array:
    """Stated standard deviations (s, l) of any of the three forms."""
    if stated is None:
        return np.ones(shape)
    if stated.ndim == 2:
        return as_shape('stated', stated, shape)
    stated = as_shape('stated', stated, (*shape, shape[1]))
    return np.asarray(np.sqrt(np.einsum('sll->sl', stated)))


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


@compiled
def spread_rows(
    x: Array, mean: Array, gain: Array, low: Array, high: Array, weights: Array, knots: Array,
    factors: Array, sigma: Array,
) -> None:  # fmt: skip
    """Multiply sigmas (s, k) by exponentials of squares of features (s, d), scaled by level."""
    width, outputs = x.shape[1], weights.shape[1]
    z = np.ones(1 + width)
    for s in range(len(x)):
        if np.isnan(x[s]).any():
            sigma[s, :] = np.nan
            continue
        for i in range(width):
            z[1 + i] = min(max((x[s, i] - mean[i]) * gain[i], low[i]), high[i])
        for k in range(outputs):
            total = 0.0
            for i in range(1 + width):
                for j in range(1 + width):
                    total += z[i] * z[j] * weights[i * (1 + width) + j, k]
            total += math.log(sigma[s, k])
            at = 0
            while at + 1 < len(knots) and total >= knots[at + 1, k]:
                at += 1
            factor = factors[at, k]
            if at + 1 < len(knots) and total > knots[0, k]:
                step = knots[at + 1, k] - knots[at, k]
                factor += (factors[at + 1, k] - factor) * (total - knots[at, k]) / step
            sigma[s, k] = math.exp(total + factor)


class CalibratedCovariance:
    """Covariance of an estimate from what drives its error.

    Parameters
    ----------
    strength : float or tuple of float
        Penalty of the regression, in rows; of several the one with the least deviance on groups
        that were held out.
    levels : int
        Largest number of levels of the stated sigma that are scaled on their own.
    folds : int
        Folds of held-out groups on which the scale is measured.
    seed : int
        Of the folds.
    """

    drivers_: Standardisation  # of the drivers
    # (f,) range of the standardised drivers that was seen; beyond it the nearest end counts
    low_: Array
    high_: Array
    weights_: Array  # (p, k) logarithm of the spread of each component
    # (l, k) logarithm of the spread, and the logarithm of the scale at it
    knots_: Array
    factors_: Array
    correlation_: Array  # (k, k) of the residuals in units of their sigma

    def __init__(
        self, strength: float | tuple[float, ...] = 5.0, levels: int = 5, folds: int = 5,
        seed: int = 0,
    ) -> None:  # fmt: skip
        self.strength = strength
        self.levels = levels
        self.folds = folds
        self.seed = seed

    def fit(
        self, drivers: Array, residuals: Array, groups: Integers | None = None,
        stated: Array | None = None,
    ) -> CalibratedCovariance:  # fmt: skip
        """Learn from residuals of rows that the estimator had not seen.

        Parameters
        ----------
        drivers : ndarray, shape (s, f)
            What the error may depend on: a few columns, such as the logarithm of the signal.
        residuals : ndarray, shape (s, k)
            Out-of-fold predictions minus targets.
        groups : ndarray of int, shape (s,), or None
            What a split keeps together.
        stated : ndarray, shape (s, k), or None
            Spread that a model tells beforehand (unit of the residuals), to be given to `sigma`
            again; what is learned multiplies it. None: none does.
        """
        count = np.shape(residuals)[-1]
        both = residuals if stated is None else np.hstack([residuals, np.log(stated)])
        rows = training_rows(drivers, both, groups)
        error, told = rows.y[:, :count], rows.y[:, count:] if stated is not None else 0.0
        self.drivers_ = Standardisation().fit(rows.x)
        z = self.drivers_(rows.x)
        self.low_, self.high_ = np.percentile(z, [0.5, 99.5], axis=0)
        terms = _squares(z, self.low_, self.high_)
        size = np.abs(error) * np.exp(-told)
        size = np.maximum(size, _least(size))
        fold = group_folds(rows.groups, self.folds, self.seed)
        tried = self.strength if isinstance(self.strength, tuple) else (self.strength,)
        found = [_held_out(terms, size, fold, strength) for strength in tried]
        best = int(np.argmin([_deviance(size, spread) for spread in found]))
        spread = found[best]
        self.weights_ = _regress(terms, size, tried[best])
        spread += told
        self._scale(spread, np.log(size) + told)
        sigma = np.exp(self._sigma(spread))
        self.correlation_ = _correlation(np.clip(error / sigma, -3, 3))
        return self

    def predict(self, drivers: Array) -> Array:
        """Covariance of the error of each row.

        Parameters
        ----------
        drivers : ndarray, shape (s, f)
            As in the fit.

        Returns
        -------
        ndarray, shape (s, k, k)
            Covariances (unit of the residuals, squared).
        """
        sigma = self.sigma(drivers)
        if sigma.shape[1] == 1:
            return np.asarray((sigma * sigma)[:, :, None])
        return sigma[:, :, None] * sigma[:, None, :] * self.correlation_

    def sigma(self, drivers: Array, stated: Array | None = None) -> Array:
        """Standard deviation of each component, shape (s, k) (unit of the residuals).

        Parameters
        ----------
        drivers : ndarray, shape (s, f)
            As in the fit.
        stated : ndarray, shape (s, k), or None
            As in the fit.
        """
        fitted(self, 'correlation_')
        drivers = np.ascontiguousarray(as_shape('drivers', drivers, (-1, len(self.low_))))
        sigma = np.ones((len(drivers), self.weights_.shape[1]))
        if stated is not None:
            sigma[:] = stated
        spread_rows(
            drivers, self.drivers_.mean_, self.drivers_.gain_, self.low_, self.high_,
            self.weights_, self.knots_, self.factors_, sigma,
        )  # fmt: skip
        return sigma

    def _scale(self, spread: Array, size: Array) -> None:
        """Measure, at each level of the spread, the scale that holds 68.27 % of the sizes.

        Both are logarithms (s, k).
        """
        count = int(np.clip(len(spread) // ROWS_PER_LEVEL, 1, self.levels))
        order = np.argsort(spread, axis=0, kind='stable')
        ratio = size - spread
        self.knots_ = np.empty((count, size.shape[1]))
        self.factors_ = np.empty_like(self.knots_)
        for level, rows in enumerate(np.array_split(order, count)):
            self.knots_[level] = np.take_along_axis(spread, rows, axis=0).mean(axis=0)
            inside = np.take_along_axis(ratio, rows, axis=0)
            # One more than the sample's own share: the finite-sample step of conformal methods.
            share = min(ONE_SIGMA * (len(rows) + 1) / len(rows), 1.0)
            self.factors_[level] = np.quantile(inside, share, axis=0)

    def _sigma(self, spread: Array) -> Array:
        """Logarithm of sigma at a logarithm of the spread, shape (s, k) both."""
        sigma = np.empty_like(spread)
        for k in range(sigma.shape[1]):
            sigma[:, k] = np.interp(spread[:, k], self.knots_[:, k], self.factors_[:, k])
        sigma += spread
        return sigma


def _least(size: Array) -> Array:
    """What counts as an error at least (k,): a thousandth of the middle of those (s, k) not 0.

    Its mean would be that of one group which is far off.
    """
    some = [one[one > 0] for one in size.T]
    middle = [float(np.median(one)) if len(one) else 0.0 for one in some]
    return 1e-3 * np.array(middle) + np.finfo(float).tiny


def _held_out(terms: Array, size: Array, fold: Integers, strength: float) -> Array:
    """Logarithm of the mean size (s, k) as the other folds tell it."""
    spread = np.empty_like(size)
    for part in np.unique(fold):
        out = fold == part
        seen = ~out if (~out).any() else out
        spread[out] = terms[out] @ _regress(terms[seen], size[seen], strength)
    return spread


def _deviance(size: Array, spread: Array) -> float:
    """Of a gamma distribution with logarithms of its mean, both (s, k)."""
    return float((size * np.exp(-spread) + spread).sum())


def _regress(terms: Array, size: Array, strength: float) -> Array:
    """Weights (p, k) of the logarithm of the mean size, by penalised Newton steps."""
    weights = np.zeros((terms.shape[1], size.shape[1]))
    weights[0] = np.log(size.mean(axis=0))
    if len(terms) < FEW_ROWS:
        return weights
    penalty = strength * np.eye(terms.shape[1])
    penalty[0, 0] = 0.0
    for k in range(size.shape[1]):
        start = weights[:, k].copy()
        for _ in range(NEWTON_STEPS):
            # Fisher scoring: the expected curvature of the gamma deviance is constant.
            excess = np.minimum(size[:, k] * np.exp(-(terms @ weights[:, k])) - 1, 20.0)
            slope = terms.T @ excess - penalty @ (weights[:, k] - start)
            step = np.linalg.solve(terms.T @ terms + penalty, slope)
            weights[:, k] += step
            if np.abs(step).max() < 1e-12:
                break
    return weights


def _squares(drivers: Array, low: Array, high: Array) -> Array:
    """Products of any two of the constant and the drivers within their range, shape (s, p)."""
    z = np.empty((len(drivers), 1 + drivers.shape[1]))
    z[:, 0] = 1.0
    np.minimum(np.maximum(drivers, low), high, out=z[:, 1:])
    return np.asarray((z[:, :, None] * z[:, None, :]).reshape(len(z), z.shape[1] ** 2))


def _correlation(unit: Array) -> Array:
    """Correlation (k, k) of standardised residuals (s, k), shrunk so that it is definite."""
    size = np.sqrt((unit**2).mean(axis=0))
    unit = unit / np.where(size > 0, size, 1.0)
    count = len(unit)
    raw = unit.T @ unit / count
    shrunk = raw * count / (count + 5.0) * 0.999
    np.fill_diagonal(shrunk, 1.0)
    return np.asarray(shrunk)


class GainVariance:
    """Variance of the gain of an unseen run about that of the fit.

    Parameters
    ----------
    prior : float
        Standard deviation of the gain between runs before any was recorded; it counts as one run.

    Examples
    --------
    >>> force = np.array([[1.0], [2.0], [1.0], [2.0]])
    >>> predicted = force * np.array([[1.1], [1.1], [0.9], [0.9]])
    >>> gain = GainVariance(prior=0.1).fit(predicted, force, np.array([0, 0, 1, 1]))
    >>> round(gain.spread_, 3), gain.covariance(np.array([[10.0]]), None).round(3).tolist()
    (0.1, [[[1.0]]])
    """

    spread_: float  # standard deviation of the gain of an unseen run about that of the fit

    def __init__(self, prior: float = 0.025) -> None:
        self.prior = prior

    def fit(self, predictions: Array, y: Array, runs: Integers) -> GainVariance:
        """Learn from predictions (s, k) of targets of runs (s,) that the estimator had not seen.

        Of one run only the prior is known.
        """
        gains = []
        for run in np.unique(runs):
            load, own = y[runs == run], predictions[runs == run]
            gains.append(float((own * load).sum() / max((load * load).sum(), 1e-300)))
        variance, count = self.prior**2, len(gains)
        if count > 1:
            between = (np.array(gains) - 1) ** 2 / (1 + 1 / (count - 1))
            variance = float(variance + between.sum()) / (1 + count)
        self.spread_ = math.sqrt(variance * (1 + 1 / max(count, 1)))
        return self

    def covariance(self, mean: Array, share: Array | None) -> Array:
        """Covariance (s, k, k) that an unknown gain leaves in predictions (s, k).

        Of the variance of the gain a share (s,) is unknown; None: all of it.
        """
        fitted(self, 'spread_')
        size = self.spread_ * mean
        cells = size[:, :, None] * size[:, None, :]
        return cells if share is None else cells * share[:, None, None]


SIGMA_SHARE, TWO_SIGMA = 0.6827, 0.9545
TRIED = SIGMA_SHARE + np.linspace(-0.08, 0.08, 17)
SIGMA_ROWS_PER_LEVEL = 60
LEVELS = 5
PRIOR_ROWS = 3.0


class SigmaCalibration:
    """Factors on a stated spread, so that it holds its share of held-out errors."""

    # (l, k) logarithm of the stated spread, and of the factor there
    knots_: Array
    factors_: Array

    def fit(self, spread: Array, residuals: Array) -> SigmaCalibration:
        """Learn from spreads and errors (s, k) of rows that the method had not seen."""
        stated = np.log(np.maximum(spread, np.finfo(np.float64).tiny))
        size = np.log(np.maximum(np.abs(residuals), 1e-12 + 1e-3 * np.abs(residuals).mean(axis=0)))
        count = int(np.clip(len(stated) // SIGMA_ROWS_PER_LEVEL, 1, LEVELS))
        self.knots_ = np.empty((count, stated.shape[1]))
        self.factors_ = np.empty_like(self.knots_)
        order = np.argsort(stated, axis=0, kind='stable')
        for level, rows in enumerate(np.array_split(order, count)):
            self.knots_[level] = np.take_along_axis(stated, rows, axis=0).mean(axis=0)
            ratio = np.take_along_axis(size - stated, rows, axis=0)
            trust = len(rows) / (len(rows) + PRIOR_ROWS)
            self.factors_[level] = trust * _fair(ratio)
        return self

    def __call__(self, spread: Array) -> Array:
        """Spreads (s, k) that hold what they say."""
        if len(self.knots_) == 1:
            return np.asarray(spread * np.exp(self.factors_[0]))
        stated = np.log(np.maximum(spread, np.finfo(np.float64).tiny))
        factor = np.empty_like(stated)
        for k in range(stated.shape[1]):
            factor[:, k] = np.interp(stated[:, k], self.knots_[:, k], self.factors_[:, k])
        return np.asarray(np.exp(stated + factor))


def _fair(ratio: Array) -> Array:
    """Factor (k,) at which shares inside one and two sigma are least off those of a normal.

    Of errors over what was stated (s, k); both are logarithms. Where tails are heavier than
    normal not both shares can hold.
    """
    count = len(ratio)
    # one more than the sample's own share: the finite-sample step of conformal methods
    shares = np.minimum(TRIED * (count + 1) / count, 1.0)
    factors = np.quantile(ratio, shares, axis=0)
    inside = (ratio[:, None] <= factors + np.log(2.0)).mean(axis=0)
    off = np.maximum(np.abs(TRIED - SIGMA_SHARE)[:, None], np.abs(inside - TWO_SIGMA))
    return np.asarray(np.take_along_axis(factors, off.argmin(axis=0)[None], axis=0)[0])


BEYOND = 1.1  # times the largest that was told: so far a curve may be gone on with
UNTOLD = 0.5  # error of what lies beyond, in parts of it


def extrapolation_error(values: Array, most: float) -> Array | None:
    """What values may err by, since they lie beyond what was told.

    Parameters
    ----------
    values : ndarray, shape (...)
        Answers, 0 or more, in any unit.
    most : float
        The largest that a fit was told, in the same unit.

    Returns
    -------
    ndarray, shape (...), or None
        In the same unit, half of what lies beyond, 0 where a value is known; None: all are.

    Examples
    --------
    >>> extrapolation_error(np.array([1.0, 2.2, 3.2]), 2.0).tolist()
    [0.0, 0.0, 0.5]
    """
    known = BEYOND * most
    if not np.count_nonzero(values > known):
        return None
    return np.asarray(UNTOLD * np.maximum(values - known, 0.0))
