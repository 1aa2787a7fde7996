"""Covariances that mean what they say: calibrated on residuals of held-out groups.

The spread of a residual is regressed on what drives it (signal strength, place, load) by a gamma
regression with logarithmic link, as for any positive quantity whose spread grows with its mean
(McCullagh and Nelder, Generalized Linear Models, 1989, ch. 8), and then scaled so that 68.27 % of
the held-out residuals lie inside one sigma, at every level of the stated sigma: the conformal step
of Romano, Patterson and Candes, Conformalized Quantile Regression, NeurIPS 2019.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np

from tactile_ros.estimators.folds import group_folds
from tactile_ros.estimators.standardisation import Standardisation
from tactile_ros.estimators.training import fitted, training_rows
from tactile_ros.types import Array, Integers, as_shape

ONE_SIGMA = 0.6827
NEWTON_STEPS = 25
FEW_ROWS = 60
ROWS_PER_LEVEL = 80


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

    Attributes
    ----------
    drivers_ : Standardisation
        Of the drivers.
    low_, high_ : ndarray, shape (f,)
        Range of the standardised drivers that was seen; beyond it the nearest end counts.
    weights_ : ndarray, shape (p, k)
        Logarithm of the spread of each component.
    knots_, factors_ : ndarray, shape (l, k)
        Logarithm of the spread, and the logarithm of the scale at it.
    correlation_ : ndarray, shape (k, k)
        Of the residuals in units of their sigma.
    """

    drivers_: Standardisation
    low_: Array
    high_: Array
    weights_: Array
    knots_: Array
    factors_: Array
    correlation_: Array

    def __init__(
        self,
        strength: float | tuple[float, ...] = 5.0,
        levels: int = 5,
        folds: int = 5,
        seed: int = 0,
    ) -> None:
        self.strength = strength
        self.levels = levels
        self.folds = folds
        self.seed = seed

    def fit(
        self,
        drivers: Array,
        residuals: Array,
        groups: Integers | None = None,
        stated: Array | None = None,
    ) -> CalibratedCovariance:
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

        Returns
        -------
        CalibratedCovariance
            Itself.
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
        vars(self).pop('_unscaled', None)
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

        Raises
        ------
        NotCalibratedError
            Before a fit.
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
        if np.shape(drivers)[1:] != self.low_.shape:
            drivers = as_shape('drivers', drivers, (-1, len(self.low_)))
        low, high, weights = self._unscaled
        moved = drivers - self.drivers_.mean_
        spread = _squares(moved, low, high) @ weights  # NaN where a driver is
        sigma = self._sigma(spread if stated is None else spread + np.log(stated))
        return np.asarray(np.exp(sigma, out=sigma))

    @cached_property
    def _unscaled(self) -> tuple[Array, Array, Array]:
        """Range and weights for drivers less their mean: a frame has no time to scale them."""
        spread, scale = self.drivers_.spread_, np.concatenate([np.ones(1), self.drivers_.gain_])
        weights = np.outer(scale, scale).reshape(-1, 1) * self.weights_
        return self.low_ * spread, self.high_ * spread, weights

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
        vars(self).pop('_levels', None)

    def _sigma(self, spread: Array) -> Array:
        """Logarithm of sigma at a logarithm of the spread, shape (s, k) both."""
        sigma = np.empty_like(spread)
        for k, (knots, factors) in enumerate(self._levels):
            sigma[:, k] = np.interp(spread[:, k], knots, factors)
        sigma += spread
        return sigma

    @cached_property
    def _levels(self) -> list[tuple[Array, Array]]:
        """Knots and factors of each component, each in one piece."""
        pairs = zip(self.knots_.T, self.factors_.T, strict=True)
        return [(knots.copy(), factors.copy()) for knots, factors in pairs]


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
