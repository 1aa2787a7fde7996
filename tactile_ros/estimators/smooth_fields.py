"""Smooth fields over a sheet as sums of cosines, with a prior on their size and smoothness.

A Gaussian process of reduced rank (Solin and Sarkka, Statistics and Computing 30, 2020): cosines
over a box wider than the sheet, whose prior spreads follow the spectrum of a Matern kernel. How
many cosines serve is told by how densely the sheet was touched.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import cho_solve, cholesky, solve_triangular
from scipy.optimize import minimize

from tactile_ros.types import Array, Integers

if TYPE_CHECKING:
    from collections.abc import Callable

ROUNDING = 1e-15
LEAST = 1e-24  # sum of squares left, of targets of order one


@dataclass(frozen=True)
class Moments:
    """What a regression needs of its rows, however many there are.

    Attributes
    ----------
    gram : ndarray, shape (p, p)
        Sum of weighted products of terms.
    cross : ndarray, shape (p, k)
        Sum of weighted products of terms and targets.
    square : float
        Sum of weighted squares of targets.
    rows : int
        Numbers that were told, s k.
    """

    gram: Array
    cross: Array
    square: float
    rows: int

    @classmethod
    def of(cls, terms: Array, y: Array, weight: Array | None = None) -> Moments:
        """Of terms (s, p), targets (s, k) and weights (s,)."""
        scaled = terms if weight is None else terms * weight[:, None]
        square = float((y * y).sum() if weight is None else (y * y * weight[:, None]).sum())
        return cls(scaled.T @ terms, scaled.T @ y, square, y.size)

    def evidence(self, spread: Array, least: float = 0.0) -> float:
        """Logarithm of the evidence, up to a constant, for prior spreads (p,) over the noise.

        The noise is what is likeliest, but not below `least`.
        """
        factor, misfit = self._factor(spread)
        outputs = self.cross.shape[1]
        volume = 2 * outputs * np.log(np.diagonal(factor)).sum()
        noise = max(misfit / self.rows, least * least)
        excess = misfit / noise - self.rows
        return float(-0.5 * (self.rows * np.log(noise) + excess + volume))

    def slope(self, spread: Array) -> tuple[float, Array]:
        """Evidence, and its slope (p,) along the logarithms of the prior spreads."""
        factor, misfit = self._factor(spread)
        outputs = self.cross.shape[1]
        volume = 2 * outputs * np.log(np.diagonal(factor)).sum()
        level = float(-0.5 * (self.rows * np.log(misfit / self.rows) + volume))
        weights = cho_solve((factor, True), self.cross * spread[:, None])
        root = solve_triangular(factor, np.eye(len(factor)), lower=True)
        doubt = outputs * (1.0 - np.einsum('ij,ij->j', root, root))
        gain = self.rows / misfit * (weights * weights).sum(axis=1)
        return level, np.asarray(gain - doubt)

    def solve(self, spread: Array) -> tuple[Array, Array, float]:
        """Weights (p, k), square root (p, p) of their covariance over the noise's, and noise."""
        factor, misfit = self._factor(spread)
        scaled = self.cross * spread[:, None]
        weights = spread[:, None] * cho_solve((factor, True), scaled)
        root = solve_triangular(factor, np.diag(spread), lower=True)
        return weights, np.asarray(root), float(np.sqrt(misfit / self.rows))

    def left(self, weights: Array, root: Array) -> float:
        """Spread of what weights (p, k) leave, less the freedom that they used.

        `root` (p, p) is the square root of their covariance over the noise's.
        """
        square = self.square - 2 * float((weights * self.cross).sum())
        square += float((weights * (self.gram @ weights)).sum())
        used = self.cross.shape[1] * float(np.einsum('ij,ij->', root @ self.gram, root))
        return float(np.sqrt(max(square, 0.0) / max(self.rows - used, 1.0)))

    def _factor(self, spread: Array) -> tuple[Array, float]:
        """Cholesky factor of the scaled posterior precision, and the sum of squares left."""
        matrix = self.gram * spread * spread[:, None]
        # rounding of what many rows add up to must not make the factor fail
        matrix[np.diag_indices_from(matrix)] += 1.0 + ROUNDING * float(matrix.max())
        factor = cholesky(matrix, lower=True, check_finite=False)
        half = solve_triangular(factor, self.cross * spread[:, None], lower=True)
        left = self.square - float((half * half).sum())
        least = 1e-12 * self.square + LEAST
        return np.asarray(factor), max(left, least)


def peak(places: tuple[float, ...], levels: Array) -> float:
    """Where a parabola through the largest of levels (n,) at even places and its neighbours peaks.

    Never beyond a neighbour; n is 3 or more.

    Examples
    --------
    >>> peak((0.0, 1.0, 2.0, 3.0), -((np.arange(4.0) - 1.2) ** 2))
    1.2
    """
    at = min(max(int(levels.argmax()), 1), len(levels) - 2)
    below, middle, above = levels[at - 1 : at + 2]
    bend = below - 2 * middle + above
    step = 0.5 * (below - above) / bend if bend < 0 else 0.0
    return float(places[at] + (places[1] - places[0]) * min(max(step, -1.0), 1.0))


GRID = 41  # cells along an edge of the sheet
LEVELS = 24  # in which a spread is told


@dataclass(frozen=True)
class SpreadCells:
    """Spreads at the middle of each cell.

    Attributes
    ----------
    spreads : ndarray, shape (GRID * GRID * l,)
        By x, y and level.
    levels : int
        Number of levels (l).
    low, high : float
        Least and largest level.
    """

    spreads: Array
    levels: int
    low: float
    high: float

    @classmethod
    def of(cls, doubt: Array, scatter: Array, low: float, high: float) -> SpreadCells:
        """From logarithms of variances (g, 3), squares in the level, and others of levels (l,)."""
        level = np.linspace(low, high, len(scatter))
        variance = np.exp(doubt @ level ** np.arange(3)[:, None])
        return cls(np.sqrt(variance + scatter).ravel(), len(scatter), low, high)

    @property
    def slope(self) -> float:
        """Cells a unit of level."""
        return (self.levels - 1) / (self.high - self.low)

    def at(self, places: Array, level: Array) -> Array:
        """Spreads (s,) at places (s, 2) on the unit square and levels (s,) within the range."""
        cell = (places * (GRID - 1) + 0.5).astype(np.int64)
        depth = ((level - self.low) * self.slope + 0.5).astype(np.int64)
        return self.spreads.take((cell[:, 0] * GRID + cell[:, 1]) * self.levels + depth)


def grid_places() -> Array:
    """Middles of the cells, shape (GRID * GRID, 2), in the order of `SpreadCells`."""
    line = np.linspace(0.0, 1.0, GRID)
    return np.stack(np.meshgrid(line, line, indexing='ij'), axis=-1).reshape(-1, 2)


SAME = 1e-5
STEP = 1e-3  # of the sheet
ONE_PLACE = 0.01  # of the sheet: spread of places in a group that is of one place


@dataclass(frozen=True)
class ToldPlaces:
    """Means at places that were touched more than once.

    Attributes
    ----------
    places, told : ndarray, shape (n, 2) and (n, k)
        One row a place (m), and what it told.
    within : float
        Standard deviation of a row from its place's mean.
    least : float
        What it makes of a mean.
    index : ndarray of int, shape (s,)
        Row of the place of each touch.
    repeats : bool
        False: places hardly repeat, and there is one row a touch.
    """

    places: Array
    told: Array
    within: float
    least: float
    index: Integers
    repeats: bool


def at_places(places: Array, told: Array) -> ToldPlaces:
    """Means of what touches at places (s, 2) (m) told (s, k)."""
    _, index, count = np.unique(
        np.round(places / SAME), axis=0, return_inverse=True, return_counts=True
    )
    index = np.asarray(index).reshape(-1)
    if len(count) > 0.5 * len(places):
        return ToldPlaces(places, told, 0.0, 0.0, np.arange(len(places)), repeats=False)

    def mean(values: Array) -> Array:
        columns = [np.bincount(index, column) / count for column in values.T]
        return np.stack(columns, axis=1)

    means = mean(told)
    free = (len(told) - len(count)) * told.shape[1]
    within = float(np.sqrt(((told - means[index]) ** 2).sum() / free))
    least = within * float(np.sqrt((1.0 / count).mean()))
    return ToldPlaces(mean(places), means, within, least, index, repeats=True)


def steady_places(places: Array, groups: Integers) -> tuple[Array, Array]:
    """Mean place of each group that is of one place.

    Parameters
    ----------
    places : ndarray, shape (s, 2)
        As readings tell them, in units of the sheet's edges.
    groups : ndarray of int, shape (s,)
        Of which many are of one place, or none.

    Returns
    -------
    places : ndarray, shape (s, 2)
        Means of the groups of one place; the others as they are.
    spread : ndarray, shape (2,)
        Of places about their means; 0 where no place was touched twice.
    """
    index = np.unique(groups, return_inverse=True)[1].reshape(-1)
    count = np.bincount(index)
    means = np.stack([np.bincount(index, column) / count for column in places.T], axis=1)
    off = places - means[index]
    spread = np.stack([np.bincount(index, column) / count for column in (off * off).T], axis=1)
    one = np.asarray((spread < ONE_PLACE**2).all(axis=1))
    rows, free = one[index], int((count - 1)[one].sum())
    square = (off[rows] ** 2).sum(axis=0)
    return np.where(rows[:, None], means[index], places), np.sqrt(square / max(free, 1))


def by_places(level: Callable[[Array], Array], x: Array, spread: Array) -> Array:
    """Variance (s,) of what is told of features by the noise of their places.

    Parameters
    ----------
    level : callable
        Features (s, d), of which the first two are the place -> what is told (s,).
    x : ndarray, shape (s, d)
        Features.
    spread : ndarray, shape (2,)
        Noise of a place.
    """
    variance = np.zeros(len(x))
    for axis in range(2):
        step = STEP * (np.arange(x.shape[1]) == axis)
        slope = (level(x + step) - level(x - step)) / (2 * STEP)
        variance += (slope * spread[axis]) ** 2
    return variance


GAP = 1.25  # half period of the slowest cosine over the sheet, so that its slope is free there
FEWEST_WAVES = 4
MOST_WAVES = 12
ORDER = 7  # of the Matern kernel
CORNER = 1.3  # products of two fast cosines are left out
WIDEST = np.pi / GAP * np.arange(MOST_WAVES) * np.ones((2, 1))  # phases of all fields


def cosines_at(places: Array, factors: Array) -> Array:
    """Field (s,) at places (s, 2) in units of the sheet's edges."""
    waves = np.cos(np.fmin(np.fmax(places, 0.0), 1.0)[:, :, None] * WIDEST)
    return np.asarray(np.einsum('si,sj,ij->s', waves[:, 0], waves[:, 1], factors))


@dataclass(frozen=True)
class SmoothFields:
    """Products of cosines over a sheet.

    Attributes
    ----------
    angles : ndarray, shape (2, n)
        Phases at the far ends of the sheet along x and y; those beyond an axis' own number
        repeat the first.
    entry : ndarray of int, shape (m,)
        Products in use, n i + j.
    speed : ndarray, shape (m,)
        Phase of a product per length of the longer edge.
    """

    angles: Array
    entry: Integers
    speed: Array

    @classmethod
    def for_places(cls, places: Array, count: int, size: Array, most: int) -> SmoothFields:
        """Fields that `count` touches at places (s, 2), in units of the sheet's edges, tell.

        `size` (2,) are the edges in any unit, `most` is the largest number along an axis.
        """
        extent = np.maximum(np.ptp(places, axis=0), 0.05) * size
        apart = float(np.sqrt(np.prod(extent) / max(count, 1)))
        wanted = np.round(GAP * size / apart).astype(np.int64) + 1
        number = np.clip(wanted, min(FEWEST_WAVES, most), most)
        wave = np.arange(number.max(), dtype=np.float64)
        angles = np.pi / GAP * wave * (wave < number[:, None])
        share = wave / number[:, None]
        used = (share[0][:, None] ** 2 + share[1] ** 2 < CORNER) & (share.max(axis=0) >= 0)
        used &= (wave < number[0])[:, None] & (wave < number[1])
        used[0, 0] = False  # the mean is told apart
        entry = np.flatnonzero(used.ravel())
        steps = angles * (size.max() / size)[:, None]
        return cls(angles, entry, np.hypot(steps[0][:, None], steps[1]).ravel()[entry])

    def waves(self, places: Array) -> Array:
        """Cosines (s, 2, n) at places (s, 2) in units of the sheet's edges."""
        inside = np.minimum(np.maximum(places, 0.0), 1.0)
        return np.cos(inside[:, :, None] * self.angles)

    def terms(self, places: Array) -> Array:
        """Products in use (s, m) at places (s, 2)."""
        waves = self.waves(places)
        table = waves[:, 0, :, None] * waves[:, 1, None, :]
        return np.asarray(table.reshape(len(waves), -1)[:, self.entry])

    def table(self, weights: Array) -> Array:
        """Weights (m, k) of products as a table (n, n, k) for `waves`."""
        count = self.angles.shape[1]
        table = np.zeros((count * count, weights.shape[1]))
        table[self.entry] = weights
        return table.reshape(count, count, -1)

    def spread(self, length: float, fine: float) -> tuple[Array, Array]:
        """Logarithm of the prior spread (m,) of a field of size one, and its slopes (2, m).

        Slopes are along the logarithms of `length`, that of the kernel over the longer edge, and
        of `fine`, the size of a part that has hardly any length.
        """
        square = (self.speed * length) ** 2
        bent = 1.0 + square / (2 * ORDER)
        smooth = bent ** -(ORDER + 1.0)
        slope = -(1 + 1 / ORDER) * square / bent
        total = float(smooth.sum()) + 1e-300
        slope -= float(smooth @ slope) / total
        rest = fine**2 / max(len(self.speed), 1)
        both = smooth / total + rest
        part = rest / both
        return 0.5 * np.log(both), np.stack([0.5 * (1 - part) * slope, part])


SHAPES = 4
SERIES, SERIES_LENGTH = 2, 0.4  # the field of a wrong series resistance, which is the sheet's
MEAN = (10.0, 2.0, 0.3, 0.3, 0.1)  # prior spreads of what is the same everywhere, and of a bend
EXPECTED = np.log([0.15, 0.05, 0.03, 0.05, 0.25, 0.03])  # four sizes, length, share without
SURE = np.array([1.2, 1.2, 1.5, 1.5, 0.5, 1.0])  # spreads of those logarithms
BOUNDS = ((-7.0, 1.5), (-7.0, 1.0), (-8.0, 0.0), (-8.0, 0.5), (-2.7, 0.5), (-7.0, -0.7))
ROUNDS = 40


def prior_spread(fields: tuple[SmoothFields, ...], prior: Array) -> tuple[Array, Array]:
    """Prior spreads of the terms of a curve whose factors vary.

    Parameters
    ----------
    fields : tuple of SmoothFields
        Of the four shapes.
    prior : ndarray, shape (6,)
        Logarithms of the sizes of the fields (1), of their length over the longer edge of the
        sheet, and of the share of their size that has no length.

    Returns
    -------
    spread : ndarray, shape (p,)
        Of five terms that are the same everywhere, then of those of the fields.
    along : ndarray, shape (6, p)
        Slopes of its logarithm along `prior`.
    """
    starts = np.cumsum([len(MEAN)] + [len(one.entry) for one in fields])
    level, along = np.log(np.resize(MEAN, starts[-1])), np.zeros((len(prior), starts[-1]))
    length, fine = np.exp(prior[SHAPES:])
    for shape, one in enumerate(fields):
        own, is_series = slice(starts[shape], starts[shape + 1]), shape == SERIES
        known, slopes = one.spread(SERIES_LENGTH if is_series else length, fine)
        level[own], along[shape, own] = prior[shape] + known, 1.0
        along[SHAPES, own] = 0.0 if is_series else slopes[0]
        along[SHAPES + 1, own] = slopes[1]
    return np.exp(level), along


def shape_table(fields: tuple[SmoothFields, ...], weights: Array, shape: int) -> Array:
    """Factors (n, n) of cosines of one shape, from the weights (p,) of all terms."""
    first = len(MEAN) + sum(len(one.entry) for one in fields[:shape])
    own, table = fields[shape], np.zeros((MOST_WAVES, MOST_WAVES))
    part = own.table(weights[first : first + len(own.entry), None])[:, :, 0]
    table[: len(part), : len(part)] = part
    table[0, 0] += weights[shape]
    return table


def likeliest(
    moments: Moments, fields: tuple[SmoothFields, ...], start: Array
) -> tuple[float, Array]:
    """Evidence, and the prior (6,) that makes the targets of a regression likeliest.

    Parameters
    ----------
    moments : Moments
        Of the terms that `prior_spread` speaks of.
    fields : tuple of SmoothFields
        Of the four shapes.
    start : ndarray, shape (6,)
        Where the search begins.
    """

    def cost(prior: Array) -> tuple[float, Array]:
        spread, along = prior_spread(fields, prior)
        level, slope = moments.slope(spread)
        off = (prior - EXPECTED) / SURE
        return 0.5 * float(off @ off) - level, off / SURE - along @ slope

    options = {'maxiter': ROUNDS, 'ftol': 1e-6}
    found = minimize(cost, start, jac=True, method='L-BFGS-B', bounds=BOUNDS, options=options)
    return -float(found.fun), np.asarray(found.x)
