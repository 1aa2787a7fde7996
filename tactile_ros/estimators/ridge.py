"""Ridge regression on polynomial terms, its strength chosen on held-out groups.

[3] fits forces by all second-order products of its features; ridge (Hoerl and Kennard,
Technometrics 12, 1970) keeps such a fit apart from collinear terms.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from tactile_ros.estimators.folds import group_folds
from tactile_ros.estimators.standardisation import Standardisation
from tactile_ros.estimators.training import fitted, predict_rows, training_rows
from tactile_ros.types import Array, Integers

STRENGTHS = 10.0 ** np.arange(-7, 3)


class Ridge:
    """Polynomial of first or second order with a penalty on the squares of its weights.

    Parameters
    ----------
    degree : int
        1 or 2. The second order is left out where it would need more than `most_terms` terms
        or more terms than there are rows.
    most_terms : int
        Largest number of terms.
    folds : int
        Folds of held-out groups on which the strength is chosen.
    seed : int
        Of the folds.

    Attributes
    ----------
    scale_ : Standardisation
        Of the features.
    terms_ : Standardisation
        Of the polynomial terms.
    degree_ : int
        Order in use.
    strength_ : float
        Penalty in use, per row, of standardised terms.
    weights_ : ndarray, shape (p, k)
        Of the terms (unit of y).
    level_ : ndarray, shape (k,)
        Mean of y.

    Examples
    --------
    >>> x = np.linspace(-1, 1, 50)[:, None]
    >>> Ridge().fit(x, x**2).predict(np.array([[0.5]])).round(3)
    array([[0.25]])
    """

    scale_: Standardisation
    terms_: Standardisation
    degree_: int
    strength_: float
    weights_: Array
    level_: Array

    def __init__(
        self, degree: int = 2, most_terms: int = 600, folds: int = 5, seed: int = 0
    ) -> None:
        self.degree = degree
        self.most_terms = most_terms
        self.folds = folds
        self.seed = seed

    def fit(self, x: Array, y: Array, groups: Integers | None = None) -> Ridge:
        """Learn from features (s, d), targets (s, k) and groups (s,); see `Estimator`."""
        rows = training_rows(x, y, groups)
        self.scale_ = Standardisation().fit(rows.x)
        width = rows.x.shape[1]
        second = width * (width + 3) // 2
        affordable = second <= min(self.most_terms, len(rows.x))
        self.degree_ = self.degree if affordable else 1
        raw = polynomial(self.scale_(rows.x), self.degree_)
        self.terms_ = Standardisation().fit(raw)
        terms, self.level_ = self.terms_(raw), np.asarray(rows.y.mean(axis=0))
        target = rows.y - self.level_
        fold = group_folds(rows.groups, self.folds, self.seed)
        self.strength_ = best_strength(terms, target, fold)
        penalty = self.strength_ * len(terms) * np.eye(terms.shape[1])
        self.weights_ = np.asarray(np.linalg.solve(terms.T @ terms + penalty, terms.T @ target))
        return self

    def predict(self, x: Array) -> Array:
        """Evaluate the polynomial, shape (s, k), of features (s, d); see `Estimator`."""
        fitted(self, 'weights_')
        return predict_rows(x, len(self.scale_.mean_), self._answer)

    def _answer(self, x: Array) -> Array:
        terms = self.terms_(polynomial(self.scale_(x), self.degree_))
        return terms @ self.weights_ + self.level_


def polynomial(z: Array, degree: int) -> Array:
    """Terms of first and, for degree 2, second order of z, shape (s, d), without the constant.

    Examples
    --------
    >>> polynomial(np.array([[2.0, 3.0]]), 2)
    array([[2., 3., 4., 6., 9.]])
    """
    if degree < 2:
        return z
    first, second = _pairs(z.shape[1])
    return np.concatenate([z, z[:, first] * z[:, second]], axis=1)


@lru_cache(maxsize=32)
def _pairs(width: int) -> tuple[Integers, Integers]:
    """Columns of every product of two, each once."""
    return np.triu_indices(width)


def best_strength(terms: Array, target: Array, fold: Integers) -> float:
    """Penalty per row with the least squared error on held-out folds.

    Parameters
    ----------
    terms : ndarray, shape (s, p)
        Standardised terms.
    target : ndarray, shape (s, k)
        Centred targets.
    fold : ndarray of int, shape (s,)
        Fold of each row.

    Returns
    -------
    float
        One of `STRENGTHS`; the middle of them where there is one fold only.
    """
    names = np.unique(fold)
    if len(names) < 2:
        return float(STRENGTHS[len(STRENGTHS) // 2])
    gram, moment = terms.T @ terms, terms.T @ target
    squares = np.zeros(len(STRENGTHS))
    for name in names:
        out = fold == name
        held, answer = terms[out], target[out]
        value, vector = np.linalg.eigh(gram - held.T @ held)
        right = vector.T @ (moment - held.T @ answer)
        projected = held @ vector
        for i, strength in enumerate(STRENGTHS):
            damped = np.maximum(value, 0)[:, None] + strength * (len(terms) - len(held))
            squares[i] += float(((projected @ (right / damped) - answer) ** 2).sum())
    return float(STRENGTHS[int(np.argmin(squares))])
