"""Polynomials of a few features; degree and penalty of each component by held-out groups.

Where a model has already turned readings into a place, force is a smooth function of few
variables, and a polynomial of low degree learns it from a few hundred presses.
"""

from __future__ import annotations

from functools import cached_property, lru_cache
from itertools import combinations_with_replacement

import numpy as np

from tactile_ros.estimators.folds import group_folds
from tactile_ros.estimators.polynomial_rows import polynomial_rows, summed
from tactile_ros.estimators.ridge_path import held_out_each, ridge_weights
from tactile_ros.estimators.standardisation import Standardisation
from tactile_ros.estimators.training import fitted, predict_rows, training_rows
from tactile_ros.physics.compiled import available
from tactile_ros.types import Array, Integers, as_shape

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

    Attributes
    ----------
    scale_ : Standardisation
        Of the features.
    limit_ : ndarray, shape (d,)
        Standardised size of a feature that was seen, and half as much again.
    terms_ : Standardisation
        Of the terms of the highest degree.
    weights_ : ndarray, shape (p, k)
        Of the terms; 0 above the degree of a component.
    level_ : ndarray, shape (k,)
        Mean of y.
    degree_ : ndarray, shape (k,)
        Degree of each component.

    Examples
    --------
    >>> x = np.linspace(-1, 1, 50)[:, None]
    >>> PolynomialRidge((1, 2, 3)).fit(x, x**3).predict(np.array([[0.5]])).round(3)
    array([[0.125]])
    """

    scale_: Standardisation
    limit_: Array
    terms_: Standardisation
    weights_: Array
    level_: Array
    degree_: Integers

    def __init__(
        self,
        degrees: tuple[int, ...] = (1, 2, 3),
        slow: int = 0,
        folds: int = 5,
        seed: int = 0,
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
        if not available():
            return predict_rows(x, len(self.limit_), self._answer)
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

    def _answer(self, x: Array) -> Array:
        z = np.minimum(np.maximum(self.scale_(x), -self.limit_), self.limit_)
        (lower, last), weights, level = self._folded
        terms = np.empty((len(z), len(lower)))
        width = z.shape[1]
        terms[:, :width] = z
        first = width
        while first < len(lower):  # all terms whose lower factors are known
            known = lower[first:] >= first
            end = first + int(np.argmax(known)) if known.any() else len(lower)
            terms[:, first:end] = terms[:, lower[first:end]] * z[:, last[first:end]]
            first = end
        return summed(terms, weights, level)


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
