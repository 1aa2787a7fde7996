"""Polynomials and spreads row by row, for a compiler: NaN where a feature is."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.physics.compiled import available, compiled

if TYPE_CHECKING:
    from tactile_ros.estimators.uncertainty import CalibratedCovariance
    from tactile_ros.types import Array, Integers

FEW = 32  # rows that are quicker in one piece


@compiled
def standardised(x: Array, mean: Array, gain: Array, low: Array, high: Array, z: Array) -> bool:
    """Features (d,) over their spreads, held inside what was seen; False where one is missing."""
    for i in range(len(x)):
        if not math.isfinite(x[i]):
            return False
        z[i] = min(max((x[i] - mean[i]) * gain[i], low[i]), high[i])
    return True


@compiled
def polynomial_rows(
    x: Array, mean: Array, gain: Array, limit: Array, lower: Integers, last: Integers,
    weights: Array, level: Array, y: Array,
) -> None:  # fmt: skip
    """Polynomials (s, k) of features (s, d); each term is a lower one times a feature."""
    width, count, outputs = x.shape[1], len(lower), weights.shape[1]
    z, terms, total = np.empty(width), np.empty(count), np.empty(outputs)
    for s in range(len(x)):
        if not standardised(x[s], mean, gain, -limit, limit, z):
            y[s, :] = np.nan
            continue
        for k in range(outputs):
            total[k] = level[k]
        for i in range(count):
            terms[i] = z[i] if i < width else terms[lower[i]] * z[last[i]]
            for k in range(outputs):
                total[k] += terms[i] * weights[i, k]
        y[s, :] = total


@compiled
def spread_rows(
    x: Array, mean: Array, gain: Array, low: Array, high: Array, weights: Array, knots: Array,
    factors: Array, sigma: Array,
) -> None:  # fmt: skip
    """Multiply sigmas (s, k) by exponentials of squares of features (s, d), scaled by level."""
    width, outputs = x.shape[1], weights.shape[1]
    z = np.ones(1 + width)
    for s in range(len(x)):
        if not standardised(x[s], mean, gain, low, high, z[1:]):
            sigma[s, :] = np.nan
            continue
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


@compiled
def product_rows(x: Array, matrix: Array, y: Array) -> None:
    """Products (s, m) of rows (s, n) and a matrix (n, m), added up in the order of n."""
    for s in range(len(x)):
        for m in range(matrix.shape[1]):
            total = 0.0
            for n in range(matrix.shape[0]):
                total += x[s, n] * matrix[n, m]
            y[s, m] = total


def summed(terms: Array, weights: Array, level: Array | float = 0.0) -> Array:
    """Level (k,) and terms (s, p) times weights (p, k), added up in the order of the loops.

    Where weights cancel, another order would be seen in the sum.

    Examples
    --------
    >>> summed(np.array([[1.0, 2.0]]), np.array([[3.0], [4.0]]), np.ones(1))
    array([[12.]])
    """
    answer = np.zeros((len(terms), weights.shape[1])) + level
    if len(terms) > FEW:
        for term, weight in zip(terms.T, weights, strict=True):
            answer += term[:, None] * weight
        return answer
    parts = np.concatenate([answer[None], terms.T[:, :, None] * weights[:, None]])
    return np.asarray(np.add.accumulate(parts, axis=0)[-1])


def times(x: Array, matrix: Array) -> Array:
    """Rows (s, n) times a matrix (n, m): the same bits for one row as for many."""
    if not available():
        return summed(x, matrix)
    y = np.empty((len(x), matrix.shape[1]))
    product_rows(np.ascontiguousarray(x), matrix, y)
    return y


def spread(covariance: CalibratedCovariance, drivers: Array, stated: Array | None = None) -> Array:
    """Standard deviations (s, k) that a fitted covariance states for drivers (s, f).

    With what was stated beforehand (s, k), where its fit had such.
    """
    if not available():
        return covariance.sigma(drivers, stated)
    sigma, scale = np.ones((len(drivers), covariance.weights_.shape[1])), covariance.drivers_
    if stated is not None:
        sigma[:] = stated
    spread_rows(
        drivers, scale.mean_, scale.gain_, covariance.low_, covariance.high_,
        covariance.weights_, covariance.knots_, covariance.factors_, sigma,
    )  # fmt: skip
    return sigma
