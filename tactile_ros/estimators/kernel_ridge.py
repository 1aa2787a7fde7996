"""Kernel ridge regression on a few inducing samples, over all features in one common scale.

Ridge regression in the space of a Gaussian kernel plus a linear one (Saunders, Gammerman and
Vovk, Dual variables, ICML 1998), restricted to the kernel's columns at n training samples (subset
of regressors: Smola and Bartlett, Sparse greedy Gaussian process regression, NIPS 2001). The
samples are the ones farthest from each other (Gonzalez, Theor. Comp. Sci. 38, 1985). Between
samples the Gaussians bend the answer; beyond them the linear part continues it.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np

from tactile_ros.estimators.anchor import anchored
from tactile_ros.estimators.folds import group_folds
from tactile_ros.estimators.ridge_path import held_out_squares, ridge_weights
from tactile_ros.estimators.standardisation import Standardisation
from tactile_ros.estimators.training import fitted, predict_rows, training_rows
from tactile_ros.types import Array, Integers

STRENGTHS = tuple(10.0**power for power in range(-7, -1))
LEAST_SHARE = 1e-10
BLOCK = 256


class KernelRidge:
    """Gaussian bumps at a few training samples and a plane, with a penalty on both.

    The features are not standardised one by one: where they have one unit and much the same noise,
    as the channels of one sensor have, that would raise the noise of those that carry no signal.

    Parameters
    ----------
    samples : int
        Largest number of inducing samples.
    lengths : tuple of float
        Widths of the bumps to choose from, in root mean square lengths of the features.
    linear : float
        Variance of the plane, relative to that of the bumps.
    strengths : tuple of float
        Penalties per row to choose from.
    common : float
        Weight of what the errors of a whole group have in common, a level and a gain, against
        what varies within the group; above 1 for groups that a later one continues.
    folds : int
        Folds of held-out groups on which width and penalty are chosen.
    seed : int
        Of the folds.

    Attributes
    ----------
    gain_ : ndarray, shape (d,)
        One over the root mean square length of the features (one over their unit); 0 for features
        that were constant.
    length_ : float
        Width in use.
    strength_ : float
        Penalty in use, per row.
    samples_ : ndarray, shape (n, d)
        Inducing samples over their width.
    bumps_ : ndarray, shape (n, k)
        Weights of the bumps (unit of y).
    plane_ : ndarray, shape (d, k)
        Weights of the scaled features (unit of y).
    level_ : ndarray, shape (k,)
        Constant (unit of y).

    Examples
    --------
    >>> x = np.linspace(0, 1, 50)[:, None]
    >>> KernelRidge().fit(x, np.sin(6 * x)).predict(np.array([[0.5]])).round(2)
    array([[0.14]])
    """

    gain_: Array
    length_: float
    strength_: float
    samples_: Array
    bumps_: Array
    plane_: Array
    level_: Array

    def __init__(
        self,
        samples: int = 100,
        lengths: tuple[float, ...] = (0.5,),
        linear: float = 0.01,
        strengths: tuple[float, ...] = STRENGTHS,
        common: float = 1.0,
        folds: int = 5,
        seed: int = 0,
    ) -> None:
        self.samples = samples
        self.lengths = lengths
        self.linear = linear
        self.strengths = strengths
        self.common = common
        self.folds = folds
        self.seed = seed

    def fit(self, x: Array, y: Array, groups: Integers | None = None) -> KernelRidge:
        """Choose samples, width and penalty, and learn weights; see `Estimator`.

        Features x (s, d) are all of one unit and much the same noise; so are targets y (s, k).
        """
        rows = training_rows(x, y, groups)
        fold = group_folds(rows.groups, self.folds, self.seed)
        level = rows.y.mean(axis=0)
        moves = Standardisation().fit(rows.x).gain_ > 0
        size = np.sqrt((rows.x[:, moves] ** 2).sum(axis=1).mean())
        self.gain_ = moves / size if moves.any() else np.zeros(len(moves))
        z = rows.x * self.gain_
        picked = z[spread_out(z, self.samples)]
        strengths = np.array(self.strengths)
        load = np.sqrt((z * z).sum(axis=1))
        squares = []
        for length in self.lengths:
            terms = self._centred(z, picked / length, length)[0]
            weighed = anchored(terms, rows.y - level, rows.groups, load, self.common)
            squares.append(held_out_squares(terms, rows.y - level, fold, strengths, weighed))
        best, mildest = np.unravel_index(np.argmin(squares), np.shape(squares))
        self.length_, self.strength_ = float(self.lengths[best]), float(strengths[mildest])
        self.samples_ = picked / self.length_
        for name in ('_half_squares', '_scale'):
            vars(self).pop(name, None)
        terms, centre, mixing = self._centred(z, self.samples_, self.length_)
        weighed = anchored(terms, rows.y - level, rows.groups, load, self.common)
        weights = ridge_weights(*weighed, self.strength_)
        self.bumps_ = mixing @ weights[: mixing.shape[1]]
        self.plane_ = np.sqrt(self.linear) * weights[mixing.shape[1] :] * self.length_
        self.level_ = level - centre @ weights
        return self

    def predict(self, x: Array) -> Array:
        """Evaluate bumps and plane, shape (s, k), of features (s, d); see `Estimator`."""
        fitted(self, 'level_')
        return predict_rows(x, self.samples_.shape[1], self._answer)

    def _answer(self, x: Array) -> Array:
        z = x * self._scale
        if len(z) <= BLOCK:
            return self._evaluate(z)
        # blocks that stay in the cache
        return np.concatenate([self._evaluate(z[i : i + BLOCK]) for i in range(0, len(z), BLOCK)])

    def _evaluate(self, z: Array) -> Array:
        bumps = z @ self.samples_.T
        bumps -= self._half_squares
        if len(z) == 1:
            bumps -= 0.5 * np.vdot(z, z)
        else:
            bumps -= 0.5 * np.add.reduce(z * z, axis=1)[:, None]
        np.exp(np.minimum(bumps, 0.0, out=bumps), out=bumps)
        answer = bumps @ self.bumps_
        answer += z @ self.plane_
        answer += self.level_
        return answer

    @cached_property
    def _scale(self) -> Array:
        return self.gain_ / self.length_

    @cached_property
    def _half_squares(self) -> Array:
        """Of the samples, which do not change from frame to frame."""
        return np.asarray(0.5 * (self.samples_**2).sum(axis=1))

    def _centred(self, z: Array, samples: Array, length: float) -> tuple[Array, Array, Array]:
        """Terms whose penalty is the plain square of their weights, their mean, and their mixing.

        The kernel among the samples is the penalty on the bumps; its inverse square root turns it
        into the unit matrix, without the directions in which the bumps are all the same.
        """
        value, vector = np.linalg.eigh(gaussian(samples, samples))
        kept = value > LEAST_SHARE * value[-1]
        mixing = vector[:, kept] / np.sqrt(value[kept])
        bumps = gaussian(z / length, samples) @ mixing
        terms = np.concatenate([bumps, np.sqrt(self.linear) * z], axis=1)
        centre = terms.mean(axis=0)
        return terms - centre, centre, mixing


def gaussian(z: Array, samples: Array) -> Array:
    """Gaussian bumps of unit width, shape (s, n), of z (s, d) around samples (n, d).

    Examples
    --------
    >>> gaussian(np.array([[0.0], [1.0]]), np.array([[1.0]])).round(3)
    array([[0.607],
           [1.   ]])
    """
    exponent = z @ samples.T
    exponent -= 0.5 * (samples**2).sum(axis=1)
    exponent -= 0.5 * (z * z).sum(axis=1)[:, None]
    return np.asarray(np.exp(np.minimum(exponent, 0.0, out=exponent), out=exponent))


def spread_out(z: Array, count: int) -> Integers:
    """Rows of z (s, d), each the farthest from all before it; fewer where rows repeat.

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
