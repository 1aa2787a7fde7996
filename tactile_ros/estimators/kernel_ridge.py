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

from tactile_ros.estimators.regression import (
    Standardisation,
    center_by_group,
    fitted,
    group_folds,
    held_out_squares,
    predict_rows,
    ridge_weights,
    training_rows,
)
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

    Examples
    --------
    >>> x = np.linspace(0, 1, 50)[:, None]
    >>> KernelRidge().fit(x, np.sin(6 * x)).predict(np.array([[0.5]])).round(2)
    array([[0.14]])
    """

    gain_: Array
    length_: float  # width in use
    strength_: float  # penalty in use, per row
    samples_: Array  # (n, d) inducing samples over their width
    bumps_: Array  # (n, k) weights of the bumps (unit of y)
    plane_: Array  # (d, k) weights of the scaled features (unit of y)
    level_: Array  # (k,) constant (unit of y)

    def __init__(
        self, samples: int = 100, lengths: tuple[float, ...] = (0.5,), linear: float = 0.01,
        strengths: tuple[float, ...] = STRENGTHS, common: float = 1.0, folds: int = 5,
        seed: int = 0,
    ) -> None:  # fmt: skip
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
            weighed = center_by_group(terms, rows.y - level, rows.groups, load, self.common)
            squares.append(held_out_squares(terms, rows.y - level, fold, strengths, weighed))
        best, mildest = np.unravel_index(np.argmin(squares), np.shape(squares))
        self.length_, self.strength_ = float(self.lengths[best]), float(strengths[mildest])
        self.samples_ = picked / self.length_
        for name in ('_half_squares', '_scale'):
            vars(self).pop(name, None)
        terms, centre, mixing = self._centred(z, self.samples_, self.length_)
        weighed = center_by_group(terms, rows.y - level, rows.groups, load, self.common)
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


SHARE = 0.3  # of a factor e in size against a right angle between patterns
LEAST = 0.02  # quantile of sizes below which readings have no pattern
PATTERN_RIDGE_STRENGTHS = tuple(10.0**power for power in range(-10, -2))


class PatternRidge:
    """Kernel ridge on unit readings and the logarithm of their size.

    Parameters
    ----------
    samples : int
        Largest number of inducing samples.
    lengths : tuple of float
        Widths of the bumps to choose from, in root mean square lengths of the features.

    Attributes
    ----------
    least_ : float
        Size below which a reading fades into one without pattern (unit of the features).

    Examples
    --------
    >>> x = np.outer(np.linspace(1, 2, 40), [1.0, 2.0])
    >>> PatternRidge().fit(x, x[:, :1] ** 2).predict(np.array([[1.5, 3.0]])).round(2)
    array([[2.25]])
    """

    moves_: Array  # (d,) 1; 0 for features that were constant, which count for nothing
    least_: float
    kernel_: KernelRidge  # on pattern and size

    def __init__(self, samples: int = 400, lengths: tuple[float, ...] = (1.0,)) -> None:
        self.samples = samples
        self.lengths = lengths

    def fit(self, x: Array, y: Array, groups: Integers | None = None) -> PatternRidge:
        """Learn from features x (s, d) and targets y (s, k); groups (s,) are split as wholes."""
        rows = training_rows(x, y, groups)
        self.moves_ = (Standardisation().fit(rows.x).gain_ > 0).astype(np.float64)
        size = np.linalg.norm(rows.x * self.moves_, axis=1)
        self.least_ = max(float(np.quantile(size, LEAST)), 1e-9 * float(size.max())) or 1.0
        self.kernel_ = KernelRidge(self.samples, self.lengths, strengths=PATTERN_RIDGE_STRENGTHS)
        self.kernel_.fit(self._pattern(rows.x), rows.y, rows.groups)
        return self

    def predict(self, x: Array) -> Array:
        """Targets (s, k) of features x (s, d)."""
        fitted(self, 'kernel_')
        return predict_rows(x, len(self.kernel_.gain_) - 1, self._answer)

    def _answer(self, x: Array) -> Array:
        return self.kernel_.predict(self._pattern(x))

    def _pattern(self, x: Array) -> Array:
        """Readings of unit size, and the logarithm of their size, shape (s, d + 1)."""
        x = x * self.moves_
        size = np.sqrt((x * x).sum(axis=1) + (0.1 * self.least_) ** 2)
        return np.column_stack([x / size[:, None], SHARE * np.log(size / self.least_)])


LEAST_WIDTH = 1e-4
TINY = float(np.finfo(np.float64).tiny)


class RestingState:
    """The main way along which resting readings move within runs, and the readings seen.

    Presses leave a set that recovers slowly, in the resting reading and in the stiffness (the
    Mullins effect and stress relaxation of filled elastomers: Diani, Fayolle and Gilormini, Eur.
    Polym. J. 45, 2009). Where along that way a skin is shifts its gain. A resting reading that was
    never seen says how little is known about the gain: a Gaussian process over resting readings,
    conditioned on the nearest one seen, keeps the share 1 - exp(-(d / l)^2) of its variance at the
    distance d, l being the length over which it varies (Rasmussen and Williams, Gaussian
    Processes, 2006, eq. 2.26).

    Parameters
    ----------
    slack : float
        How far beyond the range that was seen the state is followed, in ranges: what another
        day shifts for other reasons counts for no more than that.
    most : int
        Largest number of resting readings kept.

    Attributes
    ----------
    centre_, direction_ : ndarray, shape (d,)
        Mean resting reading (unit of the rests), and unit vector of the way; 0 where rests never
        moved.

    Examples
    --------
    >>> state = RestingState().fit(np.array([[0.0, 5], [4, 5]]), np.zeros(2, np.int64))
    >>> state.along(np.array([[2.0, 5], [99, 5]])).tolist()
    [[0.0], [3.0]]
    >>> state.strangeness(np.array([[4.0, 5], [6, 5]])).round(3).tolist()
    [0.0, 0.632]
    """

    centre_: Array
    direction_: Array
    # range of the state that is followed (unit of the rests)
    low_: float
    high_: float
    known_: Array  # (n, d) resting readings seen, less the centre (unit of the rests)
    width_: float  # root mean square length of the deviation from a run's mean (unit of the rests)
    tells_: bool  # whether a reading tells its run: there are several, and no two runs share one

    def __init__(self, slack: float = 0.25, most: int = 32) -> None:
        self.slack = slack
        self.most = most

    def fit(self, rests: Array, runs: Integers) -> RestingState:
        """Learn from the resting reading under each row.

        Parameters
        ----------
        rests : ndarray, shape (s, d)
            Resting readings, finite.
        runs : ndarray of int, shape (s,)
            Run of each row.
        """
        self.centre_ = rests.mean(axis=0)
        moved = rests - self.centre_
        within = rests.copy()
        for run in np.unique(runs):
            within[runs == run] -= within[runs == run].mean(axis=0)
        value, vector = np.linalg.eigh(within.T @ within / len(within))
        floor = LEAST_WIDTH * float(np.sqrt((rests**2).sum(axis=1).mean())) + TINY**0.5
        self.width_ = max(float(np.sqrt(max(value.sum(), 0.0))), floor)
        # a sign of its own, so that equal rests give equal numbers on every machine
        way = vector[:, -1] * np.sign(vector[np.argmax(np.abs(vector[:, -1])), -1])
        self.direction_ = way if self.width_ > floor else np.zeros_like(way)
        state = moved @ self.direction_
        beyond = self.slack * float(np.ptp(state))
        self.low_, self.high_ = float(state.min()) - beyond, float(state.max()) + beyond
        seen = np.unique(moved, axis=0)
        self.known_ = seen[spread_out(seen, self.most)]
        each = sum(len(np.unique(moved[runs == run], axis=0)) for run in np.unique(runs))
        self.tells_ = 1 < len(seen) == each
        for name in ('_table', '_latest'):
            vars(self).pop(name, None)
        return self

    def along(self, rests: Array) -> Array:
        """State of rests (s, d) along the way, shape (s, 1) (unit of the rests)."""
        return self.read(rests)[0]

    def strangeness(self, rests: Array) -> Array:
        """Share, 0 to 1, of the variance between states left at rests (s, d), shape (s,)."""
        return self.read(rests)[1]

    def read(self, rests: Array) -> tuple[Array, Array]:
        """Both at once, which a frame has time for.

        Parameters
        ----------
        rests : ndarray, shape (s, d)
            Resting readings.

        Returns
        -------
        along, strangeness : ndarray, shapes (s, 1), (s,)
            State along the way (unit of the rests), and the share of the variance between states
            that is left.
        """
        fitted(self, 'width_')
        if len(rests) > 1:
            return self._read(rests)
        # the rest under successive frames is the same until the baseline moves
        name = rests.tobytes()
        answer = self._latest.get(name)
        if answer is None:
            answer = self._read(rests)
            self._latest.clear()
            self._latest[name] = answer
        return answer

    @cached_property
    def _latest(self) -> dict[bytes, tuple[Array, Array]]:
        """Answer for the rest that was asked for last."""
        return {}

    def _read(self, rests: Array) -> tuple[Array, Array]:
        ways, level, ends = self._table
        moved = rests - self.centre_
        table = moved @ ways
        table += level
        state = np.maximum(table[:, :1], ends[:1])
        np.minimum(state, ends[1:], out=state)
        # twice the product less the squares of both: less the squared distance, over the width
        near = np.maximum.reduce(table[:, 1:], axis=1)
        near -= (moved * moved).sum(axis=1) / self.width_**2
        np.minimum(near, 0.0, out=near)
        return state, -np.expm1(near, out=near) if self.tells_ else np.ones(len(rests))

    @cached_property
    def _table(self) -> tuple[Array, Array, Array]:
        """Way and readings that rests are multiplied by, what is added, ends of the range."""
        known, unit = self.known_, self.width_**2
        ways = np.concatenate([self.direction_[:, None], 2 * known.T / unit], axis=1)
        level = np.concatenate([np.zeros(1), -(known * known).sum(axis=1) / unit])
        return ways, level, np.array([self.low_, self.high_])
