"""Ridge regression, standardised features, held-out groups: what all regressors share.

Anchor regression (Rothenhaeusler, Meinshausen, Buehlmann and Peters, J. R. Stat. Soc. B 83, 2021)
weighs what the residuals of a whole group have in common more than what varies within the group:
a fit that leaves nothing in common to the presses it has seen, such as a gain of each press, errs
less on presses of a skin whose state has moved on.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.errors import NotCalibratedError
from tactile_ros.physics.compiled import compiled
from tactile_ros.types import Array, Bools, Estimator, Integers, as_shape

if TYPE_CHECKING:
    from collections.abc import Callable


@dataclass(frozen=True)
class TrainingRows:
    """Finite rows in canonical order."""

    x: Array  # (s, d) features
    y: Array  # (s, k) targets
    groups: Integers  # (s,) what a split keeps together, numbered from 0 by first appearance

    def take(self, rows: Integers | Bools) -> TrainingRows:
        """Some of the rows."""
        return TrainingRows(self.x[rows], self.y[rows], self.groups[rows])


def training_rows(x: Array, y: Array, groups: Integers | None = None) -> TrainingRows:
    """Leave out rows that are not finite and sort the others by their own numbers.

    Parameters
    ----------
    x : ndarray, shape (s, d)
        Features.
    y : ndarray, shape (s, k)
        Targets.
    groups : ndarray of int, shape (s,), or None
        What a split keeps together; None: every row stands alone.

    Returns
    -------
    TrainingRows
        The same for every order of the given rows.

    Raises
    ------
    ValueError
        If shapes differ or no finite row is left.
    """
    x, y = as_shape('x of fit', x, (-1, -1)), as_shape('y of fit', y, (-1, -1))
    group = np.arange(len(x)) if groups is None else np.asarray(groups, np.int64)
    if len(x) != len(y) or group.shape != (len(x),):
        msg = (
            'x, y and groups of fit must have as many rows; '
            f'received {len(x)}, {len(y)} and {group.shape}'
        )
        raise ValueError(msg)
    keep = np.flatnonzero(np.isfinite(x).all(axis=1) & np.isfinite(y).all(axis=1))
    if not len(keep):
        msg = f'x and y of fit must hold at least one finite row; received {len(x)} rows, none so'
        raise ValueError(msg)
    order = keep[np.lexsort(np.column_stack([x, y])[keep].T[::-1])]
    return TrainingRows(x[order], y[order], _by_appearance(group[order]))


def _by_appearance(groups: Integers) -> Integers:
    """Number groups from 0 in the order in which they first appear."""
    _, first, index = np.unique(groups, return_index=True, return_inverse=True)
    rank = np.empty(len(first), np.int64)
    rank[np.argsort(first)] = np.arange(len(first))
    return np.asarray(rank[index.reshape(-1)])


def predict_rows(x: Array, width: int, answer: Callable[[Array], Array]) -> Array:
    """Answer for the finite rows, NaN for the others.

    Parameters
    ----------
    x : ndarray, shape (s, d)
        Features.
    width : int
        Number of features that the fit saw.
    answer : callable
        Targets (s, k) of finite features (s, d).

    Returns
    -------
    ndarray, shape (s, k)
        Targets.

    Raises
    ------
    ValueError
        If the number of features differs from the fit.
    """
    if np.shape(x)[1:] != (width,) or np.asarray(x).dtype != np.float64:
        x = as_shape('x of predict', x, (-1, width))
    rows = np.isfinite(x)
    if len(x) and np.count_nonzero(rows) == rows.size:
        return answer(x)
    finite = rows.all(axis=1)
    known = answer(x[finite]) if finite.any() else answer(np.zeros((1, width)))[:0]
    y = np.full((len(x), known.shape[1]), np.nan)
    y[finite] = known
    return y


def fitted(estimator: object, attribute: str) -> None:
    """Refuse to predict before a fit.

    Raises
    ------
    NotCalibratedError
        If the estimator lacks the attribute that its fit sets.
    """
    if not hasattr(estimator, attribute):
        msg = f'{type(estimator).__name__} must be fitted before it predicts; call fit(x, y) first'
        raise NotCalibratedError(msg)


SPREAD_FLOOR = 1e-9


@compiled
def standardised(x: Array, mean: Array, gain: Array, low: Array, high: Array, z: Array) -> bool:
    """Features (d,) over their spreads, held inside what was seen; False where one is missing."""
    for i in range(len(x)):
        if not math.isfinite(x[i]):
            return False
        z[i] = min(max((x[i] - mean[i]) * gain[i], low[i]), high[i])
    return True


class Standardisation:
    """Mean and spread of columns; a column that was constant in the fit counts for nothing.

    Attributes
    ----------
    gain_ : ndarray, shape (d,)
        One over the standard deviation (one over the unit); 0 for constant columns.

    Examples
    --------
    >>> Standardisation().fit(np.array([[1e-6, 5], [3e-6, 5]]))(np.array([[4e-6, 7]]))
    array([[2., 0.]])
    """

    mean_: Array  # (d,) mean of each column (unit of the column)
    gain_: Array
    spread_: Array  # (d,) standard deviation (unit of the column); 0 for constant columns

    def fit(self, x: Array) -> Standardisation:
        """Learn mean and spread of the columns of x, shape (s, d)."""
        self.mean_ = x.mean(axis=0)
        spread = x.std(axis=0)
        moves = spread > SPREAD_FLOOR * np.abs(x).max(axis=0)
        self.spread_ = np.where(moves, spread, 0.0)
        self.gain_ = np.where(moves, 1 / np.where(moves, spread, 1.0), 0.0)
        return self

    def share_spread(self) -> Standardisation:
        """Give all columns the root mean square of their spreads; return itself."""
        common = float(np.sqrt((self.spread_**2).mean()))
        self.spread_ = np.full_like(self.spread_, common)
        self.gain_ = np.full_like(self.spread_, 1 / common if common > 0 else 0.0)
        return self

    def __call__(self, x: Array) -> Array:
        """Standardise x, shape (s, d), to the same shape, without a unit."""
        return (x - self.mean_) * self.gain_

    def inverse(self, z: Array) -> Array:
        """Back from standard columns (s, d) to the units of the fit."""
        return z * self.spread_ + self.mean_


def group_folds(groups: Integers, folds: int, seed: int) -> Integers:
    """Deal groups to folds so that the folds hold about as many rows each.

    Parameters
    ----------
    groups : ndarray of int, shape (s,)
        What a split keeps together, numbered from 0.
    folds : int
        Number of folds; fewer where there are fewer groups.
    seed : int
        Of the deal.

    Returns
    -------
    ndarray of int, shape (s,)
        Fold of each row.

    Examples
    --------
    >>> fold = group_folds(np.array([0, 0, 1, 1, 2, 2]), 3, seed=0)
    >>> bool((fold[::2] == fold[1::2]).all()), sorted(set(fold.tolist()))
    (True, [0, 1, 2])
    """
    sizes = np.bincount(groups)
    order = np.random.default_rng(seed).permutation(len(sizes))
    order = order[np.argsort(-sizes[order], kind='stable')]
    folds = max(1, min(folds, len(sizes)))
    if sizes.min() == sizes.max():
        fold = np.empty(len(sizes), np.int64)
        fold[order] = np.arange(len(sizes)) % folds
        return np.asarray(fold[groups])
    load, fold = np.zeros(folds, np.int64), np.zeros(len(sizes), np.int64)
    for group in order:
        fold[group] = int(np.argmin(load))
        load[fold[group]] += sizes[group]
    return np.asarray(fold[groups])


class ColumnSelector:
    """Let an estimator see some columns only, so that estimators of unlike features compete.

    Parameters
    ----------
    estimator : Estimator
        Not fitted.
    columns : ndarray of int, shape (d,)
        Those that it sees.
    """

    fitted_: bool  # whether it was fitted

    def __init__(self, estimator: Estimator, columns: Integers) -> None:
        self.estimator = estimator
        self.columns = np.asarray(columns, np.int64)

    def fit(self, x: Array, y: Array, groups: Integers | None = None) -> ColumnSelector:
        """Fit the estimator on its columns of x (s, f), targets y (s, k), groups (s,)."""
        self.estimator.fit(x[:, self.columns], y, groups)
        self.fitted_ = True
        return self

    def predict(self, x: Array) -> Array:
        """Targets (s, k) of features (s, f); NotCalibratedError before a fit."""
        fitted(self, 'fitted_')
        return self.estimator.predict(x[:, self.columns])


STRENGTHS = 10.0 ** np.arange(-7, 3)


class Ridge:
    """Polynomial of first or second order with a penalty on the squares of its weights.

    [3] fits forces by all second-order products of its features; ridge (Hoerl and Kennard,
    Technometrics 12, 1970) keeps such a fit apart from collinear terms.

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

    Examples
    --------
    >>> x = np.linspace(-1, 1, 50)[:, None]
    >>> Ridge().fit(x, x**2).predict(np.array([[0.5]])).round(3)
    array([[0.25]])
    """

    scale_: Standardisation  # of the features
    terms_: Standardisation  # of the polynomial terms
    degree_: int  # order in use
    strength_: float  # penalty in use, per row, of standardised terms
    weights_: Array  # (p, k) of the terms (unit of y)
    level_: Array  # (k,) mean of y

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


def held_out_squares(
    terms: Array, target: Array, fold: Integers, strengths: Array,
    weighed: tuple[Array, Array] | None = None,
) -> Array:  # fmt: skip
    """Sum of squared errors on held-out folds for each penalty, as `held_out_each` has them.

    The eigenvectors of the normal matrix serve every penalty (Golub, Heath and Wahba,
    Technometrics 21, 1979), and the matrix without a fold is the whole one less that fold's.

    Returns
    -------
    ndarray, shape (n,)
        Sums over rows and components (unit of the target, squared).
    """
    return np.asarray(held_out_each(terms, target, fold, strengths, weighed).sum(axis=1))


def held_out_each(
    terms: Array, target: Array, fold: Integers, strengths: Array,
    weighed: tuple[Array, Array] | None = None,
) -> Array:  # fmt: skip
    """Sum of squared errors on held-out folds for each penalty and component.

    Parameters
    ----------
    terms : ndarray, shape (s, p)
        Centred terms.
    target : ndarray, shape (s, k)
        Centred targets.
    fold : ndarray of int, shape (s,)
        Fold of each row; with one fold only, the errors are those of the fit.
    strengths : ndarray, shape (n,)
        Penalties per row on the squares of the weights.
    weighed : tuple of ndarray, shapes (s, p) and (s, k), or None
        Terms and targets of the fit where they differ from those that are judged.

    Returns
    -------
    ndarray, shape (n, k)
        Sums over rows (unit of the target, squared).
    """
    learned, told = (terms, target) if weighed is None else weighed
    gram, moment = learned.T @ learned, learned.T @ told
    squares = np.zeros((len(strengths), target.shape[1]))
    names = np.unique(fold)
    for name in names:
        out = fold == name
        held, answer = terms[out], target[out]
        left = len(terms) - len(held) * (len(names) > 1)
        apart = (gram - learned[out].T @ learned[out], moment - learned[out].T @ told[out])
        value, vector, right = _spectrum(*(apart if len(names) > 1 else (gram, moment)))
        projected = held @ vector
        for i, strength in enumerate(strengths):
            damped = right / (value + strength * left)[:, None]
            squares[i] += ((projected @ damped - answer) ** 2).sum(axis=0)
    return squares


def ridge_weights(terms: Array, target: Array, strength: float) -> Array:
    """Weights (p, k) of centred terms (s, p) for centred targets (s, k) at a penalty per row."""
    value, vector, right = _spectrum(terms.T @ terms, terms.T @ target)
    return np.asarray(vector @ (right / (value + strength * len(terms))[:, None]))


def _spectrum(gram: Array, moment: Array) -> tuple[Array, Array, Array]:
    """Eigenvalues, eigenvectors, and the moments along them."""
    value, vector = np.linalg.eigh(gram)
    return np.maximum(value, 0.0), vector, vector.T @ moment


def center_by_group(
    terms: Array, target: Array, groups: Integers, load: Array, weight: float
) -> tuple[Array, Array]:
    """Scale what the rows of each group have in common: a level, and a slope along the load.

    Parameters
    ----------
    terms : ndarray, shape (s, p)
        Terms of a linear regression.
    target : ndarray, shape (s, k)
        Its targets.
    groups : ndarray of int, shape (s,)
        Groups, such as presses.
    load : ndarray, shape (s,)
        What a gain multiplies, of order one.
    weight : float
        Weight of the squares of the common part; 1 changes nothing.

    Returns
    -------
    terms, target : ndarray, shapes (s, p), (s, k)
        Rows whose plain least squares are those of the anchored regression.

    Examples
    --------
    >>> ones, group = np.ones((2, 1)), np.zeros(2, np.int64)
    >>> center_by_group(ones, np.array([[0.0], [2.0]]), group, np.zeros(2), 4.0)[1].tolist()
    [[1.0], [3.0]]
    """
    if weight == 1.0:
        return terms, target
    rows = np.concatenate([terms, target], axis=1)
    more = np.sqrt(weight) - 1
    for group in np.unique(groups):
        own = groups == group
        common, spread, _ = np.linalg.svd(
            np.stack([np.ones(int(own.sum())), load[own]], axis=1), full_matrices=False
        )
        common = common[:, spread > 1e-9 * spread[0]]
        rows[own] += more * common @ (common.T @ rows[own])
    return rows[:, : terms.shape[1]], rows[:, terms.shape[1] :]
