"""Force on a piezoresistive skin by a power law whose coefficients vary smoothly over the sheet.

The film's resistance is R - Rx, that of the film alone, and falls as a power of the force. So the
logarithm of the force is linear in that of the film; what R - Rx lacks by a wrong Rx grows as the
inverse of the film's resistance, and what an air gap takes off the force, beside what it takes
everywhere, as the resistance itself.
The factors of these four shapes are smooth fields over the sheet, whose sizes and smoothness are
those that make the calibration likeliest. The divider's noise weighs the rows.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np

from tactile_ros.estimators.evidence import Moments
from tactile_ros.estimators.field_prior import EXPECTED, MEAN, SHAPES, likeliest, prior_spread
from tactile_ros.estimators.smooth_fields import (
    MOST_WAVES,
    WIDEST,
    SmoothFields,
    as_cosines,
    cosines_at,
)
from tactile_ros.estimators.spread_cells import SpreadCells, grid_places
from tactile_ros.estimators.training import TrainingRows, fitted, predict_rows, training_rows
from tactile_ros.estimators.trials import at_corners, caution, left_out
from tactile_ros.types import Array, Integers

WAVES = (MOST_WAVES, MOST_WAVES, 5, 7)  # at most, along an axis, of each field
GAPS = (0.0, 0.3, 0.6, 0.8, 0.9)  # of the lightest force
MOST_ROWS = 3000
ROUGHS = (0.0, 0.5, 2.0)  # spread of a force beside the divider's noise, over the noise's
UNKNOWN_NOISE = 0.01
FLATTEST = -0.2  # slope of the logarithm of force over that of the film
FEWEST = 12
MORE = 0.4  # logarithm of the largest answer over the largest force told
BEYOND = 0.15  # of the range of the logarithm, in which the curve goes on
LEAST_FILM = 0.02  # of R
LEVELS = 24  # steps of the film's resistance in which a spread is told


class PowerForce:
    """Logarithm of force by that of the film's resistance, with smoothly varying factors.

    Features are x and y in units of the sheet's edges (0 to 1), the resistance R in units of the
    divider's, and further ones that do not count; targets are forces above 0.

    Parameters
    ----------
    noise : float
        Of the divider's reading, R0 / (R0 + R); 0: unknown.
    size : ndarray, shape (2,), or None
        Edges of the sheet; None: a square.
    series : ndarray, shape (g, g), or None
        Nominal Rx, in units of the divider's, at places spread evenly over the sheet, its border
        included, x first; None: 0.

    Attributes
    ----------
    range_ : ndarray, shape (3,)
        Least and largest film resistance that count, and the middle of its logarithm.
    fields_ : tuple of SmoothFields
        Of the four shapes.
    prior_ : ndarray, shape (6,)
        Logarithms of the sizes of the fields, their length over the sheet, and the share of
        their size that has no length.
    weights_ : ndarray, shape (p,)
        Of the terms: five that are the same everywhere, then those of the fields.
    root_ : ndarray, shape (p, p)
        Square root of their covariance.
    noise_ : float
        Spread of a weighted row about the curve of its place.
    rough_ : float
        Relative spread of a force beside what the divider's noise makes.
    steep_ : float
        Slope of the logarithm of force over that of the film, all over the sheet.
    gap_ : float
        Force that the air gap takes everywhere (N); the rest follows the law.
    most_ : float
        Logarithm of the largest answer.
    nominal_ : ndarray, shape (n, n)
        Factors of cosines that tell the nominal Rx.
    caution_ : float
        Factor on the spread by calibration, from groups that were left out.
    calm_ : float
        Factor on the spread about the curve of a place.
    doubt_ : ndarray, shape (g, 3)
        Logarithm of the variance by calibration, a square in the level, on a grid of places.
    """

    range_: Array
    fields_: tuple[SmoothFields, ...]
    prior_: Array
    weights_: Array
    root_: Array
    noise_: float
    rough_: float
    steep_: float
    gap_: float
    most_: float
    doubt_: Array
    caution_: float
    calm_: float
    nominal_: Array

    def __init__(
        self, noise: float = 0.0, size: Array | None = None, series: Array | None = None
    ) -> None:
        self.noise = noise
        self.size = np.ones(2) if size is None else np.asarray(size, np.float64)
        self.series = np.zeros((2, 2)) if series is None else np.asarray(series, np.float64)

    def fit(self, x: Array, y: Array, groups: Integers | None = None) -> PowerForce:
        """Learn from features (s, 3..) and forces (s, 1) (N); rows without force are left out."""
        rows = training_rows(x, y, groups)
        there = rows.y[:, 0] > 0
        rows = rows.take(there if there.any() else np.ones(len(there), bool))
        count = min(len(rows.x), MOST_ROWS)
        rows = rows.take(np.linspace(0, len(rows.x) - 1, count).astype(np.int64))
        self._prepare(rows)
        terms = self._terms(rows.x)
        self.rough_, self.prior_ = 0.0, EXPECTED
        self._choose_gap(rows.x, terms, rows.y[:, 0])
        target = self._net(rows.y[:, 0])[:, None]
        self._choose(rows.x, terms, target)
        self.most_ = float(target.max()) + MORE
        moments = Moments.of(terms, target, self._weight(rows.x))
        weights, root, noise = moments.solve(prior_spread(self.fields_, self.prior_)[0])
        left = moments.square - 2 * float((weights * moments.cross).sum())
        left += float((weights * (moments.gram @ weights)).sum())
        used = float(np.einsum('ij,ij->', root @ moments.gram, root))
        self.noise_ = max(noise, float(np.sqrt(max(left, 0) / max(len(target) - used, 1))), 1e-9)
        self.weights_, self.root_ = weights[:, 0], root * self.noise_
        for name in ('_table', '_spreads'):
            vars(self).pop(name, None)
        self.calm_ = 1.0
        self.caution_ = self._careful(rows.x, target[:, 0], rows.groups)
        self.doubt_ = self._tell_doubt()
        return self

    def predict(self, x: Array) -> Array:
        """Forces (s, 1) (N)."""
        return predict_rows(x, x.shape[1], lambda known: self.force(known)[0][:, None])

    def force(self, x: Array) -> tuple[Array, Array]:
        """Forces (s,) (N) and their spreads (s,), of calibration and noise together (N)."""
        return self.at(x[:, :2], x[:, 2])

    def at(self, places: Array, resistance: Array) -> tuple[Array, Array]:
        """Forces (s,) and their spreads (s,) (N) for the columns of features.

        Parameters
        ----------
        places : ndarray, shape (s, 2)
            In units of the sheet's edges; beyond the sheet its border counts.
        resistance : ndarray, shape (s,)
            R, in units of the divider's.
        """
        fitted(self, 'weights_')
        low, high, middle = self.range_
        inside = np.fmin(np.fmax(places, 0.0), 1.0)
        waves = np.cos(inside[:, :, None] * WIDEST)
        # no product of matrices: its sums run otherwise for one frame than for many
        known = np.einsum('si,sj,ijk->sk', waves[:, 0], waves[:, 1], self._table)
        film = np.fmin(np.fmax(resistance - known[:, 4], low), high)
        level = np.log(film) - middle
        power = known[:, 0] + level * (known[:, 1] + level * self.weights_[4])
        power += known[:, 2] / film
        power += known[:, 3] * film
        force = np.exp(np.minimum(power, self.most_))
        spread = force * self._spreads.at(inside, level)
        return force + self.gap_, spread

    def held_out(self, x: Array, y: Array, groups: Integers) -> tuple[Array, Array]:
        """What a fit without the group of each row says of it, and the spread that it states.

        The prior is that of the fit on all rows. Features (s, 3..) and forces (s, 1) must be those
        of the fit; answers (s, 1) in N.
        """
        force, spread = np.empty(len(x)), np.empty(len(x))
        there = y[:, 0] > self.gap_
        force[~there], spread[~there] = self.force(x[~there])
        net, doubt, scatter = self._alone(x[there], self._net(y[there, 0]), groups[there])
        force[there] = net + self.gap_
        spread[there] = net * np.sqrt(self.caution_**2 * doubt + scatter)
        return force[:, None], spread[:, None]

    def _alone(self, x: Array, target: Array, groups: Integers) -> tuple[Array, Array, Array]:
        """Forces (s,) over the gap that a fit without each group says, and two variances.

        Those of the logarithm: by calibration, without caution, and by noise.
        """
        terms, scale = self._terms(x), np.sqrt(self._weight(x))
        half = (terms * scale[:, None]) @ self.root_.T / self.noise_
        error = scale * (target - terms @ self.weights_)
        said, doubt = np.empty(len(x)), np.empty(len(x))
        for group in np.unique(groups):
            rows = np.flatnonzero(groups == group)
            off, hat = left_out(half[rows], error[rows])
            said[rows] = target[rows] - off / scale[rows]
            doubt[rows] = self.noise_**2 * hat / scale[rows] ** 2
        force = np.exp(np.minimum(said, self.most_))
        return force, doubt, self._scatter(x[:, 2], self._film(x))

    def _net(self, force: Array) -> Array:
        """Logarithm of forces (s,) over the gap."""
        return np.log(np.maximum(force - self.gap_, 1e-6))

    def _careful(self, x: Array, target: Array, groups: Integers) -> float:
        """Factor on the doubt of calibration with which held-out groups lie inside it."""
        judged = ~at_corners(x[:, :2], groups)
        index = np.unique(groups, return_inverse=True)[1].reshape(-1)
        force, doubt, scatter = self._alone(x, target, groups)
        error = np.minimum(np.abs(np.log(force) - target), MORE)
        asked = np.sqrt(np.maximum(error**2 - scatter, 0.0) / np.maximum(doubt, 1e-30))
        weight = judged / np.bincount(index)[index]
        return caution(asked, weight, len(np.unique(index[judged])))

    def _prepare(self, rows: TrainingRows) -> None:
        """Range and fields, before any choice."""
        count = len(np.unique(rows.groups))
        self.fields_ = tuple(
            SmoothFields.for_places(rows.x[:, :2], count, self.size, most) for most in WAVES
        )
        self.nominal_ = as_cosines(self.series)
        film = rows.x[:, 2] - self._rx(rows.x[:, :2])
        film = np.maximum(film, np.maximum(LEAST_FILM * rows.x[:, 2], 1e-6))
        level = np.log(film)
        low, high = float(level.min()), float(level.max())
        more = BEYOND * max((high - low) / 2, 1e-3)
        self.range_ = np.array([np.exp(low - more), np.exp(high + more), (low + high) / 2])

    def _choose_gap(self, x: Array, terms: Array, force: Array) -> None:
        """Force that the gap takes everywhere, as likely as it makes the forces; and the slope."""
        level, least = np.log(self._film(x)), float(force.min())
        spread, _ = prior_spread(self.fields_, EXPECTED)
        found = []
        for share in GAPS if len(force) >= FEWEST else (0.0,):
            self.gap_, self.steep_ = share * least, -1.0
            target = self._net(force)[:, None]
            if len(force) >= FEWEST and np.ptp(level) > 1e-6:
                self.steep_ = min(float(np.polyfit(level, target[:, 0], 1)[0]), FLATTEST)
            weight = self._weight(x)
            likely = Moments.of(terms, target, weight).evidence(spread)
            likely += 0.5 * float(np.log(weight).sum()) - float(target.sum())
            found.append((likely, self.gap_, self.steep_))
        _, self.gap_, self.steep_ = max(found)

    def _choose(self, x: Array, terms: Array, target: Array) -> None:
        """Sizes and length of the fields, and what spreads a force beside the divider's noise."""
        if len(target) < FEWEST:
            return
        own = float(np.median(np.sqrt(self._scatter(x[:, 2], self._film(x), 1.0))))
        best, self.prior_ = self._likeliest(x, terms, target)
        for share in ROUGHS[1:] if self.noise > 0 else ():
            before, self.rough_ = self.rough_, share * own
            level, prior = self._likeliest(x, terms, target)
            if level <= best:
                self.rough_ = before
                break
            best, self.prior_ = level, prior

    def _likeliest(self, x: Array, terms: Array, target: Array) -> tuple[float, Array]:
        """Evidence and prior that make the targets likeliest."""
        weight = self._weight(x)
        moments = Moments.of(terms, target, weight)
        level, prior = likeliest(moments, self.fields_, self.prior_)
        return level + 0.5 * float(np.log(weight).sum()), prior

    def _film(self, x: Array) -> Array:
        """The film's resistance (s,), over the divider's, within what was seen."""
        film = x[:, 2] - self._rx(x[:, :2])
        return np.asarray(np.minimum(np.maximum(film, self.range_[0]), self.range_[1]))

    def _rx(self, places: Array) -> Array:
        """Nominal Rx (s,) at places (s, 2) in units of the edges."""
        return cosines_at(places, self.nominal_)

    def _scatter(self, resistance: Array, film: Array, noise: float | None = None) -> Array:
        """Variance (s,) of the logarithm of a force about the curve of its place."""
        noise = self.noise_**2 if noise is None else noise
        if self.noise <= 0:
            return np.full(len(film), noise * UNKNOWN_NOISE**2)
        above = 1.0 + resistance
        ratio = above * above / film
        steep = noise * (self.noise * self.steep_) ** 2
        return np.asarray(steep * ratio * ratio + noise * self.rough_**2)

    def _weight(self, x: Array) -> Array:
        """Weights (s,) of rows: inverse variances, if the noise were all."""
        return 1.0 / self._scatter(x[:, 2], self._film(x), 1.0)

    def _shapes(self, film: Array) -> Array:
        """The five shapes (s, 5) of film resistances; the last has no field."""
        level = np.log(film) - self.range_[2]
        small, large = self.range_[0] / film, film / self.range_[1]
        return np.stack([np.ones_like(level), level, small, large, level * level], axis=1)

    def _terms(self, x: Array) -> Array:
        """Terms (s, p)."""
        shapes = self._shapes(self._film(x))
        parts = [shapes]
        for shape, fields in enumerate(self.fields_):
            parts.append(shapes[:, shape, None] * fields.terms(x[:, :2]))
        return np.concatenate(parts, axis=1)

    @cached_property
    def _table(self) -> Array:
        """Factors of cosines (n, n, 5) of the four shapes, and of the nominal Rx."""
        table = np.zeros((MOST_WAVES, MOST_WAVES, SHAPES + 1))
        first = len(MEAN)
        for shape, fields in enumerate(self.fields_):
            own = self.weights_[first : first + len(fields.entry), None]
            first += len(own)
            part = fields.table(own)[:, :, 0]
            table[: len(part), : len(part), shape] = part
            table[0, 0, shape] += self.weights_[shape]
        table[:, :, 2] *= self.range_[0]
        table[:, :, 3] /= self.range_[1]
        table[:, :, 4] = self.nominal_
        return table

    def scale_scatter(self, factor: float) -> None:
        """Let the spread about the curve of a place be that of the fit times a factor."""
        self.calm_ = factor
        vars(self).pop('_spreads', None)

    @cached_property
    def _spreads(self) -> SpreadCells:
        """Relative spreads of a force, by calibration and noise."""
        low, high = np.log(self.range_[:2]) - self.range_[2]
        level = np.linspace(low, high, LEVELS)
        film = np.exp(level + self.range_[2])
        scatter = self._scatter(film + float(np.median(self.series)), film)
        variance = np.exp(self.doubt_ @ level ** np.arange(3)[:, None])
        return SpreadCells(np.sqrt(variance + self.calm_**2 * scatter).ravel(), LEVELS, low, high)

    def _tell_doubt(self) -> Array:
        """Logarithm of the variance by calibration on a grid of places: squares in the level."""
        places = grid_places()
        low, high = np.log(self.range_[:2]) - self.range_[2]
        levels = np.array([low, 0.5 * (low + high), high])
        found = []
        for film in np.exp(levels + self.range_[2]):
            x = np.column_stack([places, film + self._rx(places)])
            half = self._terms(x) @ self.root_.T
            found.append(np.log(self.caution_**2 * np.einsum('sp,sp->s', half, half) + 1e-300))
        return np.asarray(np.linalg.solve(levels[:, None] ** np.arange(3), np.array(found)).T)
