"""Force on a piezoresistive skin by a power law whose coefficients vary smoothly over the sheet.

The film's resistance is R - Rx, that of the film alone, and falls as a power of the force. So the
logarithm of the force is linear in that of the film; what R - Rx lacks by a wrong Rx grows as the
inverse of the film's resistance, and what an air gap takes off the force, beside what it takes
everywhere, as the resistance itself.
The factors of these four shapes are smooth fields over the sheet, whose sizes and smoothness make
the calibration likeliest. The divider's noise weighs the rows; that of places is averaged.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np

from tactile_ros.estimators.evidence import Moments, peak
from tactile_ros.estimators.field_prior import (
    EXPECTED,
    MEAN,
    SERIES,
    SHAPES,
    likeliest,
    prior_spread,
    shape_table,
)
from tactile_ros.estimators.film_resistance import FilmResistance
from tactile_ros.estimators.power_curve import PowerCurve
from tactile_ros.estimators.repeated_places import by_places, steady_places
from tactile_ros.estimators.smooth_fields import MOST_WAVES, SmoothFields
from tactile_ros.estimators.spread_cells import LEVELS, SpreadCells, grid_places
from tactile_ros.estimators.training import fitted, predict_rows, training_rows
from tactile_ros.estimators.trials import at_corners, caution, left_out
from tactile_ros.physics.resistive import SeriesResistance
from tactile_ros.types import Array, Integers

WAVES = (MOST_WAVES, MOST_WAVES, 5, 7)  # at most, along an axis, of each field
GAPS = (0.0, 0.3, 0.6, 0.8, 0.9)  # of the lightest force
SHEETS, SHEET = (0.8, 0.9, 1.0, 1.1, 1.2), 0.1  # of the sheet resistance told; their spread
MOST_ROWS = 3000
ROUGHS = (0.0, 0.5, 2.0)  # spread of a force beside the divider's noise, over the noise's
UNKNOWN_NOISE = 0.01
FLATTEST = -0.2  # slope of the logarithm of force over that of the film
FEWEST = 12
MORE = 0.4  # logarithm of the largest answer over the largest force told
STEPS = 8  # of Rx, at most
LIKELIER = 1.0  # that a step has to make the forces (a factor of e)


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
    series : SeriesResistance or None
        Nominal Rx, in units of the divider's; None: 0.

    Attributes
    ----------
    film_ : FilmResistance
        What Rx leaves of R.
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
    wobble_ : ndarray, shape (2,)
        Noise of places, in units of the edges.
    rough_ : float
        Relative spread of a force beside what the divider's noise makes.
    steep_ : float
        Slope of the logarithm of force over that of the film, all over the sheet.
    gap_ : float
        Force that the air gap takes everywhere (N); the rest follows the law.
    most_ : float
        Logarithm of the largest answer.
    caution_ : float
        Factor on the spread by calibration, from groups that were left out.
    calm_ : float
        Factor on the spread about the curve of a place.
    doubt_ : ndarray, shape (g, 3)
        Logarithm of the variance by calibration, a square in the level, on a grid of places.
    """

    film_: FilmResistance
    fields_: tuple[SmoothFields, ...]
    prior_: Array
    weights_: Array
    root_: Array
    noise_: float
    wobble_: Array
    rough_: float
    steep_: float
    gap_: float
    most_: float
    doubt_: Array
    caution_: float
    calm_: float

    def __init__(
        self, noise: float = 0.0, size: Array | None = None, series: SeriesResistance | None = None
    ) -> None:
        self.noise = noise
        self.size = np.ones(2) if size is None else np.asarray(size, np.float64)
        self.series = SeriesResistance(self.size, 1.0, 0.0) if series is None else series

    def fit(self, x: Array, y: Array, groups: Integers | None = None) -> PowerForce:
        """Learn from features (s, 3..) and forces (s, 1) (N); rows without force are left out."""
        rows = training_rows(x, y, groups)
        there = np.flatnonzero((rows.y[:, 0] > 0) | (rows.y[:, 0] <= 0).all())
        some = np.linspace(0, len(there) - 1, min(len(there), MOST_ROWS)).astype(np.int64)
        rows = rows.take(there[some])
        # noise of places would look like a rough film
        rows.x[:, :2], self.wobble_ = steady_places(rows.x[:, :2], rows.groups)
        x, force, number = rows.x, rows.y[:, 0], len(np.unique(rows.groups))
        self.fields_ = tuple(
            SmoothFields.for_places(x[:, :2], number, self.size, most) for most in WAVES
        )
        self.film_ = FilmResistance.seen(self.series, x)
        self.rough_, self.prior_ = 0.0, EXPECTED
        self._choose_gap(x, force)
        target = self._net(force)[:, None]
        self._choose_sheet(x, target)
        self._choose(x, target)
        self.most_ = float(target.max()) + MORE
        self._settle(self._mend_series(x, target))
        self.calm_ = 1.0
        vars(self).pop('_curve', None)
        self.caution_ = self._careful(x, target[:, 0], rows.groups)
        self.doubt_ = self._tell_doubt()
        return self

    def _settle(self, moments: Moments) -> None:
        """Weights, their covariance and the noise, by the prior."""
        weights, root, noise = moments.solve(prior_spread(self.fields_, self.prior_)[0])
        self.noise_ = max(noise, moments.left(weights, root), 1e-9)
        self.weights_, self.root_ = weights[:, 0], root * self.noise_

    def _mend_series(self, x: Array, target: Array) -> Moments:
        """Take what the recording says of Rx into it, as long as that makes the forces likelier.

        The logarithm of R - Rx is bent in Rx: a step of Gauss and Newton takes the film about the
        Rx that was found, and what the prior says is still said of all that it lacked at first.
        """
        spread = prior_spread(self.fields_, self.prior_)[0]
        moments, volume = self._weighed(x, target)
        best = moments.evidence(spread) + volume
        share = 1.0
        for _ in range(STEPS):
            self._settle(moments)
            known, slope = self.film_, min(float(self.weights_[1]), FLATTEST)
            wrong = shape_table(self.fields_, self.weights_, SERIES) * known.range[0]
            self.film_ = known.mend(x, known.mended + share * (wrong - known.mended), slope)
            more, volume = self._weighed(x, target)
            level = more.evidence(spread) + volume
            if level > best + LIKELIER:
                moments, best = more, level
            else:
                self.film_, share = known, share / 3
        return moments

    def _weighed(self, x: Array, target: Array) -> tuple[Moments, float]:
        """Moments of forces, and what their weights add to the evidence."""
        weight = 1.0 / self._scatter(x[:, 2], self.film_.at(x), 1.0)
        whole = target + self.film_.told(x)[:, None]
        return Moments.of(self._terms(x), whole, weight), 0.5 * float(np.log(weight).sum())

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
        return self._curve.at(places, resistance)

    def held_out(self, x: Array, y: Array, groups: Integers) -> tuple[Array, Array]:
        """What a fit without the group of each row says of it, and the spread that it states.

        The prior is that of the fit on all rows. Features (s, 3..) and forces (s, 1) must be those
        of the fit; answers (s, 1) in N.
        """
        x, force, spread = x.copy(), np.empty(len(x)), np.empty(len(x))
        x[:, :2], _ = steady_places(x[:, :2], groups)  # as in the fit
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
        terms, film = self._terms(x), self.film_.at(x)
        scale = 1.0 / np.sqrt(self._scatter(x[:, 2], film, 1.0))
        half = (terms * scale[:, None]) @ self.root_.T / self.noise_
        error = scale * (target - self._level(x))
        said, doubt = np.empty(len(x)), np.empty(len(x))
        for group in np.unique(groups):
            rows = np.flatnonzero(groups == group)
            off, hat = left_out(half[rows], error[rows])
            said[rows] = target[rows] - off / scale[rows]
            doubt[rows] = self.noise_**2 * hat / scale[rows] ** 2
        force = np.exp(np.minimum(said, self.most_))
        return force, doubt, self._scatter(x[:, 2], film)

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

    def _choose_gap(self, x: Array, force: Array) -> None:
        """Force that the gap takes everywhere, as likely as it makes the forces; and the slope."""
        level, least = np.log(self.film_.at(x)), float(force.min())
        spread, _ = prior_spread(self.fields_, EXPECTED)
        found = []
        for share in GAPS if len(force) >= FEWEST else (0.0,):
            self.gap_, self.steep_ = share * least, -1.0
            target = self._net(force)[:, None]
            if len(force) >= FEWEST and np.ptp(level) > 1e-6:
                self.steep_ = min(float(np.polyfit(level, target[:, 0], 1)[0]), FLATTEST)
            moments, volume = self._weighed(x, target)
            likely = moments.evidence(spread) + volume - float(target.sum())
            found.append((likely, self.gap_, self.steep_))
        _, self.gap_, self.steep_ = max(found)

    def _choose_sheet(self, x: Array, target: Array) -> None:
        """Resistance of the sheet, as likely as it makes the forces."""
        spread, nominal, found = prior_spread(self.fields_, EXPECTED)[0], self.series, []
        for share in SHEETS if len(target) >= FEWEST else ():
            self.film_ = FilmResistance.seen(nominal.scaled(share), x)
            moments, volume = self._weighed(x, target)
            found.append(moments.evidence(spread) + volume - ((share - 1.0) / SHEET) ** 2 / 2)
        share = peak(SHEETS, np.array(found)) if found else 1.0
        self.film_ = FilmResistance.seen(nominal.scaled(share), x)

    def _choose(self, x: Array, target: Array) -> None:
        """Sizes and length of the fields, and what spreads a force beside the divider's noise."""
        if len(target) < FEWEST:
            return
        own = float(np.median(np.sqrt(self._scatter(x[:, 2], self.film_.at(x), 1.0))))
        best, self.prior_ = self._likeliest(x, target)
        for share in ROUGHS[1:] if self.noise > 0 else ():
            before, self.rough_ = self.rough_, share * own
            level, prior = self._likeliest(x, target)
            if level <= best:
                self.rough_ = before
                break
            best, self.prior_ = level, prior

    def _likeliest(self, x: Array, target: Array) -> tuple[float, Array]:
        """Evidence and prior that make the targets likeliest."""
        moments, volume = self._weighed(x, target)
        level, prior = likeliest(moments, self.fields_, self.prior_)
        return level + volume, prior

    def _level(self, x: Array) -> Array:
        """Logarithm of forces (s,) over the gap."""
        return np.asarray(self._terms(x) @ self.weights_ - self.film_.told(x))

    def _scatter(self, resistance: Array, film: Array, noise: float | None = None) -> Array:
        """Variance (s,) of the logarithm of a force about the curve of its place."""
        noise = self.noise_**2 if noise is None else noise
        if self.noise <= 0:
            return np.full(len(film), noise * UNKNOWN_NOISE**2)
        above = 1.0 + resistance
        ratio = above * above / film
        steep = noise * (self.noise * self.steep_) ** 2
        return np.asarray(steep * ratio * ratio + noise * self.rough_**2)

    def _terms(self, x: Array) -> Array:
        """Terms (s, p)."""
        shapes = self.film_.shapes(x)
        own = [known.terms(x[:, :2]) for known in self.fields_]
        parts = [shapes[:, shape, None] * terms for shape, terms in enumerate(own)]
        return np.concatenate([shapes, *parts], axis=1)

    @cached_property
    def _curve(self) -> PowerCurve:
        """What a frame is answered by."""
        law = self.film_.nominal, self.film_.range, float(self.weights_[len(MEAN) - 1])
        return PowerCurve(self._table, *law, self.most_, self.gap_, self._spreads())

    @property
    def _table(self) -> Array:
        """Factors of cosines (n, n, 5) of the four shapes, and of what mending adds to Rx."""
        shapes = [shape_table(self.fields_, self.weights_, shape) for shape in range(SHAPES)]
        table = np.stack([*shapes, self.film_.series], axis=-1)
        table[:, :, SERIES] = table[:, :, SERIES] * self.film_.range[0] - self.film_.mended
        table[:, :, SERIES + 1] /= self.film_.range[1]
        return table

    def scale_scatter(self, factor: float) -> None:
        """Multiply the spread about the curve of a place."""
        self.calm_ *= factor
        vars(self).pop('_curve', None)

    def _spreads(self) -> SpreadCells:
        """Relative spreads of a force, by calibration and noise."""
        low, high = self.film_.levels
        film = np.exp(np.linspace(low, high, LEVELS) + self.film_.range[2])
        scatter = self._scatter(film + self.film_.middle, film)
        return SpreadCells.of(self.doubt_, self.calm_**2 * scatter, low, high)

    def _tell_doubt(self) -> Array:
        """Logarithm of the variance by calibration on a grid of places: squares in the level."""
        places, found, levels = grid_places(), [], np.linspace(*self.film_.levels, 3)
        for film in np.exp(levels + self.film_.range[2]):
            x = np.column_stack([places, film + self.film_.series_at(places)])
            half = self._terms(x) @ self.root_.T
            variance = self.caution_**2 * np.einsum('sp,sp->s', half, half)
            found.append(np.log(variance + by_places(self._level, x, self.wobble_) + 1e-300))
        return np.asarray(np.linalg.solve(levels[:, None] ** np.arange(3), np.array(found)).T)
