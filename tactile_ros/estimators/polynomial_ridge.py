"""Polynomials of a few features; degree and penalty of each component by held-out groups.

Where a model has already turned readings into a place, force is a smooth function of few
variables, and a polynomial of low degree learns it from a few hundred presses.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import combinations_with_replacement

import numpy as np

from tactile_ros.estimators.regression import (
    Standardisation,
    fitted,
    group_folds,
    held_out_each,
    ridge_weights,
    training_rows,
)
from tactile_ros.physics.compiled import compiled
from tactile_ros.types import Array, Integers, as_shape


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
def product_rows(x: Array, matrix: Array, y: Array) -> None:
    """Products (s, m) of rows (s, n) and a matrix (n, m), added up in the order of n."""
    for s in range(len(x)):
        for m in range(matrix.shape[1]):
            total = 0.0
            for n in range(matrix.shape[0]):
                total += x[s, n] * matrix[n, m]
            y[s, m] = total


def times(x: Array, matrix: Array) -> Array:
    """Rows (s, n) times a matrix (n, m): the same bits for one row as for many."""
    y = np.empty((len(x), matrix.shape[1]))
    product_rows(np.ascontiguousarray(x), matrix, y)
    return y


STRENGTHS = 10.0 ** np.arange(-12.0, -1.0)
BEYOND = 1.5  # of the range seen: farther out the polynomial stands still


class PolynomialRidge:
    """Polynomial of all features up to a degree, with a penalty on standardised terms.

    Parameters
    ----------
    degrees : tuple of int
        To choose from, for each component of the target.
    slow : int
        How many of the last features, such as temperatures, only change what the others say a
        little: they enter up to their squares, and beside products of two others.
    folds, seed : int
        Of held-out groups.

    Examples
    --------
    >>> x = np.linspace(-1, 1, 50)[:, None]
    >>> PolynomialRidge((1, 2, 3)).fit(x, x**3).predict(np.array([[0.5]])).round(3)
    array([[0.125]])
    """

    scale_: Standardisation  # of the features
    limit_: Array  # (d,) standardised size of a feature that was seen, and half as much again
    terms_: Standardisation  # of the terms of the highest degree
    weights_: Array  # (p, k) of the terms; 0 above the degree of a component
    level_: Array  # (k,) mean of y
    degree_: Integers  # (k,) degree of each component

    def __init__(
        self, degrees: tuple[int, ...] = (1, 2, 3), slow: int = 0, folds: int = 5, seed: int = 0
    ) -> None:
        self.degrees = degrees
        self.slow = slow
        self.folds = folds
        self.seed = seed

    def fit(self, x: Array, y: Array, groups: Integers | None = None) -> PolynomialRidge:
        """Choose degrees and penalties, and learn from x (s, d), y (s, k); see `Estimator`."""
        rows = training_rows(x, y, groups)
        vars(self).pop('_folded', None)
        self.scale_ = Standardisation().fit(rows.x)
        z = self.scale_(rows.x)
        self.limit_ = BEYOND * np.abs(z).max(axis=0)
        width = z.shape[1]
        affordable = [d for d in self.degrees if count_terms(width, d, self.slow) < 0.8 * len(z)]
        degrees = affordable or [min(self.degrees)]
        raw = monomials(z, max(degrees), self.slow)
        self.terms_ = Standardisation().fit(raw)
        terms, self.level_ = self.terms_(raw), np.asarray(rows.y.mean(axis=0))
        target = rows.y - self.level_
        fold = group_folds(rows.groups, self.folds, self.seed)
        self.weights_ = np.zeros((terms.shape[1], target.shape[1]))
        self.degree_ = np.zeros(target.shape[1], np.int64)
        counts = {d: count_terms(width, d, self.slow) for d in degrees}
        squares = {
            d: held_out_each(terms[:, :n], target, fold, STRENGTHS) for d, n in counts.items()
        }
        for k in range(target.shape[1]):
            least = {d: float(squares[d][:, k].min()) for d in counts}
            degree = min(least, key=least.__getitem__)
            strength, n = float(STRENGTHS[int(np.argmin(squares[degree][:, k]))]), counts[degree]
            self.weights_[:n, k] = ridge_weights(terms[:, :n], target[:, k : k + 1], strength)[
                :, 0
            ]
            self.degree_[k] = degree
        return self

    def predict(self, x: Array) -> Array:
        """Evaluate the polynomials, shape (s, k), of features (s, d); see `Estimator`."""
        fitted(self, 'degree_')
        x = as_shape('x of predict', x, (-1, len(self.limit_)))
        y = np.empty((len(x), len(self.level_)))
        scale, (factors, weights, level) = self.scale_, self._folded
        lower, last = factors
        polynomial_rows(x, scale.mean_, scale.gain_, self.limit_, lower, last, weights, level, y)
        return y

    @cached_property
    def _folded(self) -> tuple[tuple[Integers, Integers], Array, Array]:
        """Factors of every term; weights (p, k) and level (k,) of terms that are not centred."""
        known = {count_terms(len(self.limit_), d, self.slow): d for d in self.degrees}
        degree = known[len(self.weights_)]
        pairs = np.array(_factors(len(self.limit_), degree, self.slow), np.int64)
        weights = np.ascontiguousarray(self.weights_ * self.terms_.gain_[:, None])
        factors = (np.ascontiguousarray(pairs[:, 0]), np.ascontiguousarray(pairs[:, 1]))
        return factors, weights, np.asarray(self.level_ - self.terms_.mean_ @ weights)


def count_terms(width: int, degree: int, slow: int = 0) -> int:
    """Number of monomials of a width up to a degree, the last few slow, without the constant.

    Examples
    --------
    >>> count_terms(2, 2)
    5
    """
    return len(_factors(width, degree, slow))


def monomials(z: Array, degree: int, slow: int = 0) -> Array:
    """Monomials of z (s, d) up to a degree, the last few slow, without the constant.

    Examples
    --------
    >>> monomials(np.array([[2.0, 3.0]]), 2).tolist()
    [[2.0, 3.0, 4.0, 6.0, 9.0]]
    """
    width = z.shape[1]
    factors = _factors(width, degree, slow)
    terms = np.empty((len(z), len(factors)))
    terms[:, :width] = z
    for column in range(width, len(factors)):
        lower, last = factors[column]
        np.multiply(terms[:, lower], z[:, last], out=terms[:, column])
    return terms


@lru_cache(maxsize=32)
def _factors(width: int, degree: int, slow: int) -> tuple[tuple[int, int], ...]:
    """For each monomial the column of its lower factor, and the variable that multiplies it."""
    names: list[tuple[int, ...]] = []
    for order in range(1, degree + 1):
        every = combinations_with_replacement(range(width), order)
        names += [name for name in every if _kept(name, width - slow)]
    column = {name: i for i, name in enumerate(names)}
    return tuple((column.get(name[:-1], 0), name[-1]) for name in names)


def _kept(name: tuple[int, ...], first_slow: int) -> bool:
    """Whether a product has few enough slow factors, and few others beside them."""
    slow = sum(i >= first_slow for i in name)
    return slow == 0 or (slow <= 2 and len(name) <= 3)


DEGREES, FEW = (3, 4, 5), 6  # of what is eliminated; rows for one of its terms
ROUNDS, STEP = 8, 1e-4
MOST_ROWS = 1500
MOST = 1.6  # of the logarithm of a stiffness
PRIOR = 1e-3  # of the squares: what temperatures must explain before they are believed


class WarmPolynomial:
    """Polynomial of a place less its rise with temperature, times a stiffness of temperature.

    [3] gives both causes of its thermal drift: the elastomer's height, which shifts the place, and
    its stiffness, which scales the force. Both are found from recordings, by elimination of what
    is linear (Golub and Pereyra, Inverse Problems 19, 2003); the rest is a polynomial that may
    still change a little with temperature.

    Parameters
    ----------
    degrees : tuple of int
        Of the polynomial, to choose from.
    slow : int
        Temperatures, the last features; the third feature is the height.

    Attributes
    ----------
    rise_, stiff_ : ndarray, shape (slow,)
        Of the height (its unit), and of the stiffness's logarithm (1), for a unit of each
        temperature.

    Examples
    --------
    >>> x = np.random.default_rng(0).uniform(-1, 1, (300, 4))
    >>> y = (1 - 0.1 * x[:, 3:]) * ((x[:, 2:3] - 0.05 * x[:, 3:]) ** 2 + x[:, :1])
    >>> found = WarmPolynomial((1, 2, 3), 1).fit(x, y)
    >>> found.rise_.round(3).tolist(), found.stiff_.round(3).tolist()
    ([0.05], [-0.1])
    """

    rise_: Array
    stiff_: Array
    curve_: Array  # (slow,) of that logarithm, for the square of a unit (1)
    rest_: PolynomialRidge  # of the corrected features

    def __init__(self, degrees: tuple[int, ...] = (1, 2, 3), slow: int = 1) -> None:
        self.degrees = degrees
        self.slow = slow

    def fit(self, x: Array, y: Array, groups: Integers | None = None) -> WarmPolynomial:
        """Learn from features x (s, d), targets y (s, k) and groups (s,) or None."""
        rows = training_rows(x, y, groups)
        self._find(rows.x, rows.y)
        known, stiff = self._corrected(rows.x, self.rise_, self.stiff_, self.curve_)
        self.rest_ = PolynomialRidge(self.degrees, self.slow).fit(
            known, rows.y / stiff, rows.groups
        )
        return self

    def leaves(self, x: Array, y: Array) -> float:
        """Squares (1) that the best rise and stiffness leave of targets over their spreads."""
        rows = training_rows(x, y)
        return self._find(rows.x, rows.y)

    def _find(self, x: Array, y: Array) -> float:
        """Find rise and stiffness; squares that they leave."""
        few = slice(None, None, -(-len(x) // MOST_ROWS))
        found, scale = np.zeros(3 * self.slow), np.ptp(x[:, 2]) + 1e-12
        spread = np.maximum(y.std(axis=0), 1e-300)
        part, target = x[few], y[few] / spread
        heat = np.abs(part[:, -self.slow :]).max(axis=0) + 1e-12
        unit = np.concatenate([0.05 * scale / heat, 0.05 / heat, 0.01 / heat**2])
        best, least = found, np.inf
        for _ in range(ROUNDS):
            left = self._left(part, target, found * unit)
            cost = float((left**2).sum() + PRIOR * found @ found)
            if cost > 0.9999 * least:
                break
            best, least = found, cost
            slopes = [self._left(part, target, (found + e) * unit) - left for e in _steps(found)]
            matrix = np.stack(slopes, axis=1) / STEP
            normal = matrix.T @ matrix + PRIOR * np.eye(len(found))
            found = found - np.linalg.solve(normal, matrix.T @ left + PRIOR * found)
            found = np.clip(found, -5, 5)
        self.rise_, self.stiff_, self.curve_ = np.split(best * unit, 3)
        return least

    def predict(self, x: Array) -> Array:
        """Targets (s, k) of features (s, d); NotCalibratedError before a fit."""
        fitted(self, 'rest_')
        known, stiff = self._corrected(x, self.rise_, self.stiff_, self.curve_)
        return np.asarray(self.rest_.predict(known) * stiff)

    def _left(self, x: Array, y: Array, found: Array) -> Array:
        """What the best polynomial leaves of targets, shape (s k,)."""
        known, stiff = self._corrected(x, *np.split(found, 3))
        place = known[:, : -self.slow]
        z = (place - place.mean(axis=0)) / np.maximum(place.std(axis=0), 1e-300)
        terms = stiff * np.column_stack([np.ones(len(z)), monomials(z, _degree(z))])
        basis, _ = np.linalg.qr(terms)
        return np.asarray(y - basis @ (basis.T @ y)).ravel()

    def _corrected(self, x: Array, rise: Array, stiff: Array, curve: Array) -> tuple[Array, Array]:
        """Features with the height less its rise, and the stiffness (s, 1)."""
        heat = x[:, -self.slow :]
        known = np.array(x, float)
        known[:, 2] -= (heat * rise).sum(axis=1)
        harder = (heat * stiff + heat**2 * curve).sum(axis=1)
        return known, np.exp(np.clip(harder, -MOST, MOST))[:, None]


def _degree(x: Array) -> int:
    """Highest degree of which x (s, d) has rows enough."""
    terms = {degree: math.comb(x.shape[1] + degree, degree) for degree in DEGREES}
    return max((n for n, count in terms.items() if FEW * count <= len(x)), default=DEGREES[0])


def _steps(found: Array) -> Array:
    """One small step along each parameter."""
    return np.asarray(STEP * np.eye(len(found)))


MISLED_PLACE_DEGREES, ROWS = {3: 20, 4: 35, 5: 56}, 6  # coefficients of each; rows for one of them
MISLED_PLACE_ROUNDS, MISLED_PLACE_STEP, CLOSER = 5, 1e-3, 1e-4
ELASTOMER = np.array([0.02, 0.1, 0.01])  # usual rise, softening and its curve over a unit


@dataclass(frozen=True)
class ErrorsInVariables:
    """What was found.

    Places that are wrong by what nobody measured (drifts of channels, a disc that weakens or warms
    otherwise than thought) make force scatter about any polynomial of the place. Sizes of such
    errors, and the elastomer's rise and softening, are found together by Gauss-Newton steps, the
    polynomial eliminated (Golub and Pereyra, Inverse Problems 19, 2003).
    """

    sizes: Array  # (p,) of each error, over its usual size
    cov: Array  # (p, p) their covariance
    rise: float  # of the height for a unit of temperature (its unit)


def errors_in_variables(
    place: Array, moves: Array, heat: Array, later: Array, force: Array, begun: Array
) -> ErrorsInVariables:
    """Find the sizes of errors of places.

    Parameters
    ----------
    place : ndarray, shape (s, 3)
        With the errors, less those of size `begun`; the third is the height.
    moves : ndarray, shape (s, p, 3)
        What each error of its usual size adds to places.
    heat, later : ndarray, shape (s,)
        Temperature of the elastomer, in a unit of the caller's, and what the last error of its
        usual size adds to it.
    force : ndarray, shape (s, k)
        That holds the places.
    begun : ndarray, shape (p,)
        Sizes that places and temperature are already free of.

    Returns
    -------
    ErrorsInVariables
        Sizes that leave least of force about a polynomial of the place.
    """
    degree = max((d for d, n in MISLED_PLACE_DEGREES.items() if len(place) > ROWS * n), default=3)
    target = force / np.maximum(force.std(axis=0), 1e-300)
    centre, scale = place.mean(axis=0), np.maximum(place.std(axis=0), 1e-300)
    count = len(begun)

    def left(found: Array) -> Array:
        more = found[:count] - begun
        warm = heat - later * more[-1]
        rise, stiff, curve = ELASTOMER * found[count:]
        there = place - (moves * more[:, None]).sum(axis=1)
        there[:, 2] -= rise * warm
        terms = monomials((there - centre) / scale, degree)
        terms = np.column_stack([np.ones(len(terms)), terms])
        terms *= np.exp(stiff * warm + curve * warm**2)[:, None]
        basis, _ = np.linalg.qr(terms)
        return np.asarray(target - basis @ (basis.T @ target)).ravel()

    found, prior = np.concatenate([begun, np.zeros(len(ELASTOMER))]), np.eye(count + 3)
    cov: Array = prior
    best, least = found, np.inf
    for _ in range(MISLED_PLACE_ROUNDS):
        miss = left(found)
        square = float(miss @ miss)
        if square >= (1 - CLOSER) * least:
            break
        best, least = found, square
        variance = square / max(len(miss) - len(found), 1) + 1e-300
        slopes = [
            (left(found + MISLED_PLACE_STEP * one) - miss) / MISLED_PLACE_STEP for one in prior
        ]
        matrix = np.stack(slopes, axis=1)
        cov = np.asarray(np.linalg.inv(matrix.T @ matrix / variance + prior))
        found = found - cov @ (matrix.T @ miss / variance + found)
    return ErrorsInVariables(best[:count], cov[:count, :count], float(ELASTOMER[0] * best[count]))
