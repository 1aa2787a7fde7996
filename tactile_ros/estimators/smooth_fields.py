"""Smooth fields over a sheet as sums of cosines, with a prior on their size and smoothness.

A Gaussian process of reduced rank (Solin and Sarkka, Statistics and Computing 30, 2020): cosines
over a box wider than the sheet, whose prior spreads follow the spectrum of a Matern kernel. How
many cosines serve is told by how densely the sheet was touched.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import cho_solve, cholesky, solve_triangular
from scipy.optimize import minimize

from tactile_ros.physics.compiled import compiled
from tactile_ros.physics.resistive_sheet import LEAST_LOG, NEAREST
from tactile_ros.types import Array, Integers

if TYPE_CHECKING:
    from collections.abc import Callable


@compiled
def held(value: float, low: float, high: float) -> float:
    """A number between two others; the lower one for NaN."""
    if value > high:
        return high
    return value if value > low else low


@compiled
def square_of(root: Array, square: Array) -> None:
    """Fill a matrix (2, 2) with a root (2, 2) times its transpose."""
    for i in range(2):
        for j in range(2):
            square[i, j] = root[i, 0] * root[j, 0] + root[i, 1] * root[j, 1]


@compiled
def shift_row(place: Array, size: Array, table: Array, shift: Array) -> None:
    """Fill the shift (2,) of a place (2,) on a sheet of a size (2,) from a table (n, n, 2)."""
    weight, node = np.empty((2, 4)), np.empty(2, np.int64)
    for i in range(2):
        deep = place[i] / size[i] * (table.shape[0] - 3)
        node[i] = min(int(deep), table.shape[0] - 4)
        t = deep - node[i]
        square = t * t
        cube = square * t
        weight[i, 0] = square - 0.5 * (t + cube)
        weight[i, 1] = 1.0 - 2.5 * square + 1.5 * cube
        weight[i, 2] = 0.5 * t + 2.0 * square - 1.5 * cube
        weight[i, 3] = 0.5 * (cube - square)
    shift[:] = 0.0
    for i in range(4):
        for j in range(4):
            both = weight[0, i] * weight[1, j]
            for k in range(2):
                shift[k] += both * table[node[0] + i, node[1] + j, k]


@compiled
def place_rows(
    x: Array, scale: Array, outside: float, table: Array, size: Array, shift: Array, roots: Array,
    place: Array, cov: Array,
) -> None:  # fmt: skip
    """Fill places (s, 2) and covariances (s, 2, 2) of potentials (s, 2..).

    Parameters
    ----------
    x : ndarray, shape (s, 2..)
        Potentials; NaN where there is none.
    scale : ndarray, shape (2, 2)
        Their middle and half width.
    outside : float
        Half widths that count.
    table : ndarray, shape (n, n, 2)
        Factors of products of powers, of degree below n in all.
    size : ndarray, shape (2,)
        Of the sheet (m).
    shift : ndarray, shape (n, n, 2)
        See `shift_table`.
    roots : ndarray, shape (m, m, 2, 2)
        Of the covariance, in cells over the sheet.
    place, cov : ndarray, shape (s, 2) and (s, 2, 2)
        Overwritten.
    """
    count, far = table.shape[0], roots.shape[0] - 1
    power, total, cell = np.ones((2, count)), np.empty(2), np.empty(2, np.int64)
    for s in range(len(x)):
        if not (math.isfinite(x[s, 0]) and math.isfinite(x[s, 1])):
            place[s], cov[s] = np.nan, np.nan
            continue
        for i in range(2):
            u = held((x[s, i] - scale[0, i]) / scale[1, i], -outside, outside)
            for n in range(1, count):
                power[i, n] = power[i, n - 1] * u
        total[:] = 0.0
        for i in range(count):
            for j in range(count - i):
                both = power[0, i] * power[1, j]
                for k in range(2):
                    total[k] += both * table[i, j, k]
        for i in range(2):
            total[i] = held(total[i], 0.0, size[i])
        shift_row(total, size, shift, place[s])
        for i in range(2):
            place[s, i] = held(total[i] + place[s, i], 0.0, size[i])
            cell[i] = int(place[s, i] / size[i] * far + 0.5)
        square_of(roots[cell[0], cell[1]], cov[s])


@compiled
def wave_rows(places: Array, angle: float, count: int, waves: Array) -> None:
    """Fill cosines (2, n) of a place (2,) on the unit square, of multiples of an angle."""
    for i in range(2):
        first = math.cos(held(places[i], 0.0, 1.0) * angle)
        waves[i, 0], waves[i, 1] = 1.0, first
        for n in range(2, count):
            waves[i, n] = 2.0 * first * waves[i, n - 1] - waves[i, n - 2]


@compiled
def series_row(place: Array, law: Array) -> float:
    """Nominal Rx of a place (2,) in units of the edges, by the law (4,) of `SeriesResistance`."""
    long, far = int(law[0]), law[1]
    across = math.sin(math.pi * held(place[1 - long], NEAREST, 1.0 - NEAREST)) ** 2
    near = far * held(place[long], NEAREST, 1.0 - NEAREST)
    square = across * (1.0 + across / math.sinh(far) ** 2) ** 2
    for away in (near, far - near, far + near, 2.0 * far - near):
        square /= 1.0 + across / math.sinh(away) ** 2
    return float(max(law[2] + 0.5 * math.log(square), LEAST_LOG) * law[3])


@compiled
def force_rows(
    places: Array, resistance: Array, table: Array, law: Array, series: Array, spreads: Array,
    force: Array, spread: Array,
) -> None:  # fmt: skip
    """Fill forces (s,) and their spreads (s,) (N).

    Parameters
    ----------
    places : ndarray, shape (s, 2)
        In units of the sheet's edges.
    resistance : ndarray, shape (s,)
        R, in units of the divider's.
    table : ndarray, shape (n, n, 5)
        Factors of cosines: of the four shapes and of what is added to Rx.
    law : ndarray, shape (9,)
        Phase of the slowest cosine at the far edge; least and largest film, the middle of its
        logarithm, the bend, the logarithm of the largest answer, the gap's force; least of the
        levels at which spreads are told, and one over their step.
    series : ndarray, shape (4,)
        Law of the nominal Rx, see `SeriesResistance`.
    spreads : ndarray, shape (m, m, l)
        Relative ones in cells of places and levels.
    force, spread : ndarray, shape (s,)
        Overwritten.
    """
    count, shapes = table.shape[0], table.shape[2]
    waves, total = np.empty((2, count)), np.empty(shapes)
    far = spreads.shape[0] - 1
    for s in range(len(places)):
        wave_rows(places[s], law[0], count, waves)
        total[:] = 0.0
        for i in range(count):
            for j in range(count):
                both = waves[0, i] * waves[1, j]
                for k in range(shapes):
                    total[k] += both * table[i, j, k]
        nominal = series_row(places[s], series)
        film = held(resistance[s] - total[4] - nominal, law[1], law[2])
        level = math.log(film) - law[3]
        power = total[0] + level * (total[1] + level * law[4])
        power += total[2] / film
        power += total[3] * film
        net = math.exp(min(power, law[5]))
        a = int(held(places[s, 0], 0.0, 1.0) * far + 0.5)
        b = int(held(places[s, 1], 0.0, 1.0) * far + 0.5)
        spread[s] = net * spreads[a, b, int((level - law[7]) * law[8] + 0.5)]
        force[s] = net + law[6]


ROUNDING = 1e-15
LEAST = 1e-24  # sum of squares left, of targets of order one


@dataclass(frozen=True)
class Moments:
    """What a regression needs of its rows, however many there are."""

    gram: Array  # (p, p) sum of weighted products of terms
    cross: Array  # (p, k) sum of weighted products of terms and targets
    square: float  # sum of weighted squares of targets
    rows: int  # numbers that were told, s k

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
class SigmaGrid:
    """Spreads at the middle of each cell."""

    spreads: Array  # (GRID * GRID * l,) by x, y and level
    levels: int  # number of levels (l)
    # least and largest level
    low: float
    high: float

    @classmethod
    def of(cls, doubt: Array, scatter: Array, low: float, high: float) -> SigmaGrid:
        """From logarithms of variances (g, 3), squares in the level, and others of levels (l,)."""
        level = np.linspace(low, high, len(scatter))
        variance = np.exp(doubt @ level ** np.arange(3)[:, None])
        return cls(np.sqrt(variance + scatter).ravel(), len(scatter), low, high)

    @property
    def slope(self) -> float:
        """Cells a unit of level."""
        return (self.levels - 1) / (self.high - self.low)


def grid_places() -> Array:
    """Middles of the cells, shape (GRID * GRID, 2), in the order of `SigmaGrid`."""
    line = np.linspace(0.0, 1.0, GRID)
    return np.stack(np.meshgrid(line, line, indexing='ij'), axis=-1).reshape(-1, 2)


SAME = 1e-5
STEP = 1e-3  # of the sheet
ONE_PLACE = 0.01  # of the sheet: spread of places in a group that is of one place


@dataclass(frozen=True)
class Replicates:
    """Means at places that were touched more than once."""

    # (n, 2) and (n, k) one row a place (m), and what it told
    places: Array
    told: Array
    within: float  # standard deviation of a row from its place's mean
    least: float  # what it makes of a mean
    index: Integers  # (s,) row of the place of each touch
    repeats: bool  # false: places hardly repeat, and there is one row a touch


def at_places(places: Array, told: Array) -> Replicates:
    """Means of what touches at places (s, 2) (m) told (s, k)."""
    _, index, count = np.unique(
        np.round(places / SAME), axis=0, return_inverse=True, return_counts=True
    )
    index = np.asarray(index).reshape(-1)
    if len(count) > 0.5 * len(places):
        return Replicates(places, told, 0.0, 0.0, np.arange(len(places)), repeats=False)

    def mean(values: Array) -> Array:
        columns = [np.bincount(index, column) / count for column in values.T]
        return np.stack(columns, axis=1)

    means = mean(told)
    free = (len(told) - len(count)) * told.shape[1]
    within = float(np.sqrt(((told - means[index]) ** 2).sum() / free))
    least = within * float(np.sqrt((1.0 / count).mean()))
    return Replicates(mean(places), means, within, least, index, repeats=True)


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
    """

    angles: Array
    entry: Integers  # (m,) products in use, n i + j
    speed: Array  # (m,) phase of a product per length of the longer edge

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
