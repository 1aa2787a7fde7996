# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Generic regressors: polynomial ridge, kernel ridge, perceptrons; rows and held-out groups.

What is fitted are plain arrays, evaluated by numpy. They are our own where a bench measures that
it pays: kernel ridge with anchored groups and a set penalty on loads of an unseen run (0.31 and
0.82 N, 0.88 N without the anchor), and perceptrons that minimise the length of the error rather
than its square on places between those that were touched (0.35 mm; kernel ridge 0.40 mm).

Sources: A. E. Hoerl and R. W. Kennard, Ridge regression, Technometrics 12 (1970). A. J. Smola and
P. Bartlett, Sparse greedy Gaussian process regression, NIPS 2001 (subset of regressors). D.
Rothenhaeusler et al., Anchor regression, J. R. Stat. Soc. B 83 (2021). L. K. Hansen and P.
Salamon, Neural network ensembles, IEEE TPAMI 12 (1990). D. P. Kingma and J. Ba, Adam, ICLR 2015.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.errors import NotCalibratedError
from tactile_ros.types import Array, Bools, Integers, as_shape

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    import numpy.typing as npt

    Single = npt.NDArray[np.float32]


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
    """Finite rows of features (s, d), targets (s, k) and groups (s,), sorted by their numbers.

    Groups None: every row stands alone. ValueError if shapes differ or no finite row is left.
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
    """Answers (s, k) for the finite rows of features (s, d), NaN for the others.

    ValueError if there are not as many features as in the fit (`width`).
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


def fitted(method: object, attribute: str) -> None:
    """Raise NotCalibratedError if the method has not the attribute that its fit sets."""
    if not hasattr(method, attribute):
        msg = f'{type(method).__name__} must be fitted before it predicts; call fit(x, y) first'
        raise NotCalibratedError(msg)


class Standardisation:
    """Mean and spread of columns; a column that was constant in the fit counts for nothing.

    Examples
    --------
    >>> Standardisation().fit(np.array([[1e-6, 5], [3e-6, 5]]))(np.array([[4e-6, 7]]))
    array([[2., 0.]])
    """

    mean_: Array  # (d,) mean of each column (unit of the column)
    gain_: Array  # (d,) one over the standard deviation; 0 for constant columns

    def fit(self, x: Array) -> Standardisation:
        """Learn mean and spread of the columns of x, shape (s, d)."""
        self.mean_ = x.mean(axis=0)
        spread = x.std(axis=0)
        moves = spread > 1e-9 * np.abs(x).max(axis=0)
        self.gain_ = np.where(moves, 1 / np.where(moves, spread, 1.0), 0.0)
        return self

    def __call__(self, x: Array) -> Array:
        """Standardise x, shape (s, d), to the same shape, without a unit."""
        return (x - self.mean_) * self.gain_


def group_folds(groups: Integers, folds: int, seed: int) -> Integers:
    """Fold (s,) of each row: groups (s,), numbered from 0, dealt so that folds are about equal.

    There are fewer folds where there are fewer groups.
    """
    sizes = np.bincount(groups)
    order = np.random.default_rng(seed).permutation(len(sizes))
    order = order[np.argsort(-sizes[order], kind='stable')]
    folds = max(1, min(folds, len(sizes)))
    load, fold = np.zeros(folds, np.int64), np.zeros(len(sizes), np.int64)
    for group in order:
        fold[group] = int(np.argmin(load))
        load[fold[group]] += sizes[group]
    return np.asarray(fold[groups])


STRENGTHS = tuple(10.0**power for power in range(-7, 3))
KERNEL_STRENGTHS = tuple(10.0**power for power in range(-7, -1))
MOST_TERMS = 600
FOLDS = 5
LEAST_SHARE = 1e-10  # of the largest eigenvalue
BLOCK = 256  # rows that stay in the cache


def best_strength(
    terms: Array, target: Array, fold: Integers, strengths: Sequence[float]
) -> float:
    """Penalty per row that errs least on held-out folds (s,); the middle one of a single fold.

    The eigenvectors of the normal matrix serve every penalty (Golub, Heath and Wahba,
    Technometrics 21, 1979), and the matrix without a fold is the whole one less that fold's.
    """
    if len(strengths) == 1 or (fold == fold[0]).all():
        return float(strengths[len(strengths) // 2])
    gram, moment = terms.T @ terms, terms.T @ target
    squares = np.zeros(len(strengths))
    for name in np.unique(fold):
        held, answer = terms[fold == name], target[fold == name]
        value, vector = np.linalg.eigh(gram - held.T @ held)
        right, projected = vector.T @ (moment - held.T @ answer), held @ vector
        for i, strength in enumerate(strengths):
            penalty = strength * (len(terms) - len(held))
            damped = right / (np.maximum(value, 0.0) + penalty)[:, None]
            squares[i] += ((projected @ damped - answer) ** 2).sum()
    return float(strengths[int(np.argmin(squares))])


def ridge_weights(terms: Array, target: Array, strength: float) -> Array:
    """Weights (p, k) of centred terms (s, p) for centred targets (s, k) at a penalty per row."""
    value, vector = np.linalg.eigh(terms.T @ terms)
    damped = np.maximum(value, 0.0) + strength * len(terms)
    return np.asarray(vector @ ((vector.T @ (terms.T @ target)) / damped[:, None]))


class Ridge:
    """Polynomial of second order with a penalty on the squares of its weights.

    It is of first order where it would need more than 600 terms or more terms than there are rows.

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

    def fit(self, x: Array, y: Array, groups: Integers | None = None) -> Ridge:
        """Learn from features (s, d), targets (s, k) and groups (s,); see `Estimator`."""
        rows = training_rows(x, y, groups)
        self.scale_ = Standardisation().fit(rows.x)
        width = rows.x.shape[1]
        affordable = width * (width + 3) // 2 <= min(MOST_TERMS, len(rows.x))
        self.degree_ = 2 if affordable else 1
        raw = polynomial(self.scale_(rows.x), self.degree_)
        self.terms_ = Standardisation().fit(raw)
        terms, self.level_ = self.terms_(raw), np.asarray(rows.y.mean(axis=0))
        fold = group_folds(rows.groups, FOLDS, 0)
        self.strength_ = best_strength(terms, rows.y - self.level_, fold, STRENGTHS)
        self.weights_ = ridge_weights(terms, rows.y - self.level_, self.strength_)
        return self

    def predict(self, x: Array) -> Array:
        """Evaluate the polynomial, shape (s, k), of features (s, d); see `Estimator`."""
        fitted(self, 'weights_')
        return predict_rows(x, len(self.scale_.mean_), self._answer)

    def _answer(self, x: Array) -> Array:
        return self.terms_(polynomial(self.scale_(x), self.degree_)) @ self.weights_ + self.level_


def polynomial(z: Array, degree: int) -> Array:
    """Terms of first and, for degree 2, second order of z, shape (s, d), without the constant.

    Examples
    --------
    >>> polynomial(np.array([[2.0, 3.0]]), 2)
    array([[2., 3., 4., 6., 9.]])
    """
    if degree < 2:
        return z
    first, second = np.triu_indices(z.shape[1])
    return np.concatenate([z, z[:, first] * z[:, second]], axis=1)


class KernelRidge:
    """Gaussian bumps at the training samples farthest apart, and a plane beyond them.

    Features are not standardised one by one: where they have one unit and much the same noise,
    that would raise the noise of those that carry no signal.

    Parameters
    ----------
    samples : int
        Largest number of inducing samples.
    length : float
        Width of the bumps, in root mean square lengths of the features.
    linear : float
        Variance of the plane, relative to that of the bumps.
    strengths : tuple of float
        Penalties per row to choose from on held-out groups.
    common : float
        Weight of what the errors of a whole group have in common, a level and a gain, against
        what varies within the group (anchor regression); above 1 for groups that a later one
        continues, whose gain differs.

    Examples
    --------
    >>> x = np.linspace(0, 1, 50)[:, None]
    >>> KernelRidge().fit(x, np.sin(6 * x)).predict(np.array([[0.5]])).round(2)
    array([[0.14]])
    """

    gain_: Array  # (d,) one over the width of the bumps; 0 for constant features
    strength_: float  # penalty in use, per row
    samples_: Array  # (n, d) inducing samples over their width
    bumps_: Array  # (n, k) weights of the bumps (unit of y)
    plane_: Array  # (d, k) weights of the scaled features (unit of y)
    level_: Array  # (k,) constant (unit of y)

    def __init__(
        self, samples: int = 100, length: float = 0.5, linear: float = 0.01,
        strengths: tuple[float, ...] = KERNEL_STRENGTHS, common: float = 1.0,
    ) -> None:  # fmt: skip
        self.samples = samples
        self.length = length
        self.linear = linear
        self.strengths = strengths
        self.common = common

    def fit(self, x: Array, y: Array, groups: Integers | None = None) -> KernelRidge:
        """Choose samples and penalty, and learn weights; see `Estimator`.

        Features x (s, d) are all of one unit and much the same noise; so are targets y (s, k).
        """
        rows = training_rows(x, y, groups)
        moves = Standardisation().fit(rows.x).gain_ > 0
        size = np.sqrt((rows.x[:, moves] ** 2).sum(axis=1).mean())
        self.gain_ = moves / (size * self.length) if moves.any() else np.zeros(len(moves))
        z = rows.x * self.gain_
        self.samples_ = z[spread_out(z, self.samples)]
        # The kernel among the samples is the penalty on the bumps; its inverse square root turns
        # it into the unit matrix, without the directions in which the bumps are all the same.
        value, vector = np.linalg.eigh(gaussian(self.samples_, self.samples_))
        kept = value > LEAST_SHARE * value[-1]
        mixing = vector[:, kept] / np.sqrt(value[kept])
        plane = np.sqrt(self.linear) * self.length
        terms = np.concatenate([gaussian(z, self.samples_) @ mixing, plane * z], axis=1)
        centre, level = terms.mean(axis=0), rows.y.mean(axis=0)
        terms, target = terms - centre, rows.y - level
        fold = group_folds(rows.groups, FOLDS, 0)
        self.strength_ = best_strength(terms, target, fold, self.strengths)
        if self.common != 1.0:
            _anchor(terms, target, rows.groups, np.sqrt((z * z).sum(axis=1)), self.common)
        weights = ridge_weights(terms, target, self.strength_)
        self.bumps_ = mixing @ weights[: mixing.shape[1]]
        self.plane_ = plane * weights[mixing.shape[1] :]
        self.level_ = level - centre @ weights
        return self

    def predict(self, x: Array) -> Array:
        """Evaluate bumps and plane, shape (s, k), of features (s, d); see `Estimator`."""
        fitted(self, 'level_')
        return predict_rows(x, self.samples_.shape[1], self._answer)

    def _answer(self, x: Array) -> Array:
        z = x * self.gain_
        return gaussian(z, self.samples_) @ self.bumps_ + z @ self.plane_ + self.level_


def gaussian(z: Array, samples: Array) -> Array:
    """Gaussian bumps of unit width, shape (s, n), of z (s, d) around samples (n, d).

    Examples
    --------
    >>> gaussian(np.array([[0.0], [1.0]]), np.array([[1.0]])).round(3)
    array([[0.607],
           [1.   ]])
    """
    exponent = z @ samples.T
    exponent -= 0.5 * np.einsum('nd,nd->n', samples, samples)
    exponent -= 0.5 * np.einsum('sd,sd->s', z, z)[:, None]
    return np.asarray(np.exp(np.minimum(exponent, 0.0, out=exponent), out=exponent))


def spread_out(z: Array, count: int) -> Integers:
    """Rows of z (s, d), each the farthest from all before it (Gonzalez 1985); no row twice.

    Examples
    --------
    >>> spread_out(np.array([[0.0], [1.0], [5.0], [4.9]]), 3).tolist()
    [0, 2, 1]
    """
    squares = (z**2).sum(axis=1)
    rows = [int(np.argmax(((z - z.mean(axis=0)) ** 2).sum(axis=1)))]
    gap = np.full(len(z), np.inf)
    while len(rows) < count:
        last = rows[-1]
        gap = np.minimum(gap, squares + squares[last] - 2 * (z @ z[last]))
        farthest = int(np.argmax(gap))
        if gap[farthest] <= LEAST_SHARE * squares.max(initial=0.0):
            break
        rows.append(farthest)
    return np.array(rows)


def _anchor(terms: Array, target: Array, groups: Integers, load: Array, weight: float) -> None:
    """Weigh, in place, what rows of a group have in common: a level, and a slope along a load."""
    for group in np.unique(groups):
        own = groups == group
        basis, spread, _ = np.linalg.svd(
            np.stack([np.ones(int(own.sum())), load[own]], axis=1), full_matrices=False
        )
        basis = basis[:, spread > 1e-9 * spread[0]]
        for rows in (terms, target):
            rows[own] += (np.sqrt(weight) - 1) * basis @ (basis.T @ rows[own])


MOST_STEPS, FEWEST_STEPS = 20_000, 1_500
RATE, WARM_UP = 1e-2, 0.05  # largest step; share of the steps over which it rises
MOMENTUM, INERTIA = 0.9, 0.99
FLOOR = 1e-3
SOFTNESS = 0.06  # share of the targets' spread below which errors count by their square
BATCH = 64


class Perceptron:
    """Mean of several perceptrons with two hidden layers of tanh units, trained at once.

    They minimise the length of the error rather than its square, since a few touches are far off.

    Parameters
    ----------
    members, width : int
        Perceptrons in the ensemble, and units in each of their hidden layers.
    epochs : int
        Passes over the samples, of at most 20 000 steps together.
    pattern : bool
        See the direction of the features and the logarithm of their length instead of the
        features: where a touch is shows in the pattern, how deep it is in the length.

    Examples
    --------
    >>> x = np.linspace(-1, 1, 200)[:, None]
    >>> net = Perceptron(members=2, width=8).fit(x, np.sin(3 * x))
    >>> bool(np.abs(net.predict(x) - np.sin(3 * x)).max() < 0.1)
    True
    """

    moving_: Array  # (d,) 1 for features that moved in the fit, else 0
    length_: float  # length below which the logarithm flattens (unit of the features)
    # weights of the layers, (m, p, w), (m, w, w) and (m, w, k), of features as they come
    first_: Array
    second_: Array
    last_: Array
    # constants; the last of all members together
    first_level_: Array
    second_level_: Array
    last_level_: Array

    def __init__(
        self, members: int = 8, width: int = 48, epochs: int = 300, pattern: bool = False
    ) -> None:
        self.members = members
        self.width = width
        self.epochs = epochs
        self.pattern = pattern

    def fit(self, x: Array, y: Array, groups: Integers | None = None) -> Perceptron:
        """Learn from x (s, d) and y (s, k) of one unit; groups are not used; see `Estimator`."""
        rows = training_rows(x, y, groups)
        # a column that never moved tells nothing, and must not drown the pattern of the others
        self.moving_ = (Standardisation().fit(rows.x).gain_ > 0).astype(np.float64)
        length = np.sqrt(((rows.x * self.moving_) ** 2).sum(axis=1))
        self.length_ = float(FLOOR * np.median(length) + np.finfo(np.float64).tiny)
        weight = np.ones(len(length))
        if self.pattern:  # noise turns the pattern of faint touches
            weight = length / np.hypot(length, np.median(length) + self.length_)
            weight += np.finfo(np.float64).tiny
        inputs = self._inputs(rows.x)
        scale, level = Standardisation().fit(inputs), rows.y.mean(axis=0)
        spread = float(np.sqrt(rows.y.var(axis=0).mean()))
        # Adam scales every input on its own, which helps where inputs are not correlated
        turn = np.linalg.eigh(scale(inputs).T @ scale(inputs))[1]
        target = (rows.y - level) * (1 / spread if spread > 0 else 0.0)
        layers = self._train(scale(inputs) @ turn, target, weight / weight.mean())
        # scales and the mean of the members are absorbed in the outer layers
        first = turn @ layers[0]
        self.first_ = scale.gain_[:, None] * first
        self.first_level_ = layers[3] - (scale.mean_ * scale.gain_)[None] @ first
        self.second_, self.second_level_ = layers[1], layers[4]
        self.last_ = layers[2] * (spread / self.members)
        self.last_level_ = layers[5].mean(axis=0)[0] * spread + level
        return self

    def predict(self, x: Array) -> Array:
        """Mean of the members, shape (s, k), at features (s, d); see `Estimator`."""
        fitted(self, 'last_level_')
        return predict_rows(x, self.first_.shape[1] - int(self.pattern), self._answer)

    def _answer(self, x: Array) -> Array:
        # blocks that stay in the cache: twice as fast as one sweep
        return np.concatenate([self._forward(x[i : i + BLOCK]) for i in range(0, len(x), BLOCK)])

    def _forward(self, x: Array) -> Array:
        hidden = self._inputs(x)
        for weights, level in (
            (self.first_, self.first_level_), (self.second_, self.second_level_)
        ):  # fmt: skip
            hidden = np.matmul(hidden, weights)
            hidden += level
            np.tanh(hidden, out=hidden)
        return np.asarray(np.matmul(hidden, self.last_).sum(axis=0) + self.last_level_)

    def _inputs(self, x: Array) -> Array:
        """Features, or their pattern and the logarithm of their length, shape (s, p)."""
        if not self.pattern:
            return x
        length = np.sqrt((x * x) @ self.moving_)[:, None] + self.length_
        inputs = np.empty((len(x), x.shape[1] + 1))
        np.divide(x * self.moving_, length, out=inputs[:, :-1])
        np.log(length, out=inputs[:, -1:])
        return inputs

    def _train(self, x: Array, y: Array, weight: Array) -> list[Array]:
        """Weights and levels of the three layers, members along the first axis, by Adam."""
        inputs, target = x.astype(np.float32), y.astype(np.float32)
        weights = weight.astype(np.float32)[:, None]
        rng = np.random.default_rng(0)
        sizes = (x.shape[1], self.width, self.width, y.shape[1])
        shapes = [(self.members, a, b) for a, b in pairwise(sizes)]
        shapes += [(self.members, 1, b) for b in sizes[1:]]
        ends = np.cumsum([int(np.prod(shape)) for shape in shapes])
        flat, slope, mean, square = np.zeros((4, ends[-1]), np.float32)
        layers, slopes = (
            [part.reshape(s) for part, s in zip(np.split(one, ends[:-1]), shapes, strict=True)]
            for one in (flat, slope)
        )
        for layer in layers[:3]:
            layer[:] = rng.normal(size=layer.shape) / np.sqrt(layer.shape[1])
        batch = min(BATCH, len(x))
        steps = int(np.clip(self.epochs * len(x) // batch, FEWEST_STEPS, MOST_STEPS))
        for count, rows in enumerate(_batches(len(x), batch, steps, self.members, rng), start=1):
            _backward(inputs[rows], target[rows], weights[rows], layers, slopes)
            share = count / steps
            rate = RATE * min(1.0, share / WARM_UP) * 0.5 * (1 + np.cos(np.pi * share))
            mean[:] = MOMENTUM * mean + (1 - MOMENTUM) * slope
            square[:] = INERTIA * square + (1 - INERTIA) * slope * slope
            unbiased = np.sqrt(1 - INERTIA**count) / (1 - MOMENTUM**count)
            flat -= np.float32(rate * unbiased) * mean / (np.sqrt(square) + np.float32(1e-8))
        return [layer.astype(np.float64) for layer in layers]


def _backward(
    x: Single, y: Single, weight: Single, layers: list[Single], slopes: list[Single]
) -> None:
    """Slopes of the mean weighted soft length of the error of every member, in place."""
    outputs = [x]
    for k in range(3):
        answer = outputs[-1] @ layers[k] + layers[3 + k]
        outputs.append(np.tanh(answer) if k < 2 else answer)
    error = outputs[-1] - y
    size = np.sqrt((error * error).sum(axis=-1, keepdims=True) + np.float32(SOFTNESS**2))
    back = error * weight / (size * np.float32(x.shape[1]))
    for k in (2, 1, 0):
        np.matmul(outputs[k].transpose(0, 2, 1), back, out=slopes[k])
        slopes[3 + k][:] = back.sum(axis=1, keepdims=True)
        if k:
            back = (back @ layers[k].transpose(0, 2, 1)) * (1 - outputs[k] * outputs[k])


def _batches(
    samples: int, batch: int, steps: int, members: int, rng: np.random.Generator
) -> Iterator[Integers]:
    """Rows (m, b) of every step: each member in its own order, again and again."""
    left = steps
    while True:
        order = np.stack([rng.permutation(samples) for _ in range(members)])
        for first in range(0, samples - batch + 1, batch):
            if left == 0:
                return
            left -= 1
            yield order[:, first : first + batch]
