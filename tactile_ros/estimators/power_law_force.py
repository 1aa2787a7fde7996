"""Force of a touch on a resistive film by a power law whose factors vary smoothly [5]."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tactile_ros.estimators.model_selection import at_corners, caution, left_out
from tactile_ros.estimators.regression import fitted, predict_rows, training_rows
from tactile_ros.estimators.smooth_fields import (
    EXPECTED,
    GRID,
    LEVELS,
    MEAN,
    MOST_WAVES,
    SERIES,
    SHAPES,
    WIDEST,
    Moments,
    SigmaGrid,
    SmoothFields,
    by_places,
    cosines_at,
    force_rows,
    grid_places,
    likeliest,
    peak,
    prior_spread,
    shape_table,
    steady_places,
)
from tactile_ros.physics.resistive_sheet import SeriesResistance
from tactile_ros.types import Array, Integers

BEYOND = 0.15  # of the range of the logarithm, in which the curve goes on
LEAST_FILM = 0.02  # of R


@dataclass(frozen=True)
class FilmResistance:
    """Rx over the sheet, and the range of what it leaves of R; in units of the divider's R0.

    Attributes
    ----------
    mended : ndarray, shape (n, n)
        Factors of what mending has taken out of the logarithm of a force, times the film.
    """

    nominal: SeriesResistance  # rx before it is mended
    series: Array  # (n, n) factors of cosines of what mending adds to it
    mended: Array
    range: Array  # (3,) least and largest film that count, and the middle of its logarithm

    @classmethod
    def seen(cls, nominal: SeriesResistance, x: Array) -> FilmResistance:
        """With a nominal Rx, for features (s, 3..) that were seen."""
        none = np.zeros((MOST_WAVES, MOST_WAVES))
        return cls(nominal, none, none, _range_of(x, nominal.at(x[:, :2])))

    def mend(self, x: Array, wrong: Array, slope: float) -> FilmResistance:
        """With an Rx that a linear fit about the nominal one has found.

        Parameters
        ----------
        x : ndarray, shape (s, 3..)
            Features that were seen.
        wrong : ndarray, shape (n, n)
            Factors of cosines of what is over the film in the logarithm of force: the slope
            times what the nominal Rx has too much.
        slope : float
            Of the logarithm of force over that of the film.
        """
        series = self.series - (wrong - self.mended) / slope
        mended = self.nominal.at(x[:, :2]) + cosines_at(x[:, :2], series)
        return FilmResistance(self.nominal, series, wrong, _range_of(x, mended))

    def at(self, x: Array) -> Array:
        """The film (s,) of features (s, 3..), within what was seen."""
        film = x[:, 2] - self.series_at(x[:, :2])
        return np.asarray(np.minimum(np.maximum(film, self.range[0]), self.range[1]))

    def shapes(self, x: Array) -> Array:
        """The five shapes (s, 5) of a power law for features (s, 3..)."""
        film, (low, high, middle) = self.at(x), self.range
        level = np.log(film) - middle
        return np.stack([np.ones_like(level), level, low / film, film / high, level**2], axis=1)

    def series_at(self, places: Array) -> Array:
        """Rx (s,) at places (s, 2) in units of the edges."""
        return self.nominal.at(places) + cosines_at(places, self.series)

    @property
    def levels(self) -> tuple[float, float]:
        """Least and largest logarithm of the film, less its middle."""
        low, high, middle = self.range
        return float(np.log(low) - middle), float(np.log(high) - middle)

    @property
    def middle(self) -> float:
        """Rx in the middle of the sheet."""
        return float(self.series_at(np.full((1, 2), 0.5))[0])

    def told(self, x: Array) -> Array:
        """What mending has taken out of the logarithm of a force (s,)."""
        return np.asarray(cosines_at(x[:, :2], self.mended) / self.at(x))


def _range_of(x: Array, series: Array) -> Array:
    """Range of the film that was seen in features (s, 3..) with Rx (s,), and a little more."""
    film = x[:, 2] - series
    level = np.log(np.maximum(film, np.maximum(LEAST_FILM * x[:, 2], 1e-6)))
    low, high = float(level.min()), float(level.max())
    more = BEYOND * max((high - low) / 2, 1e-3)
    return np.array([np.exp(low - more), np.exp(high + more), (low + high) / 2])


@dataclass(frozen=True)
class PowerCurve:
    """Force and its spread by place and resistance.

    Attributes
    ----------
    table : ndarray, shape (n, n, 5)
        Factors of cosines: of a constant, the film's logarithm, one over the film and the film;
        and of what is added to Rx, in units of the divider's.
    range : ndarray, shape (3,)
        Least and largest film resistance that count, and the middle of its logarithm.
    """

    table: Array
    series: SeriesResistance  # nominal Rx
    range: Array
    bend: float  # factor of the square of the logarithm
    most: float  # logarithm of the largest answer
    gap: float  # force that is added (N)
    cells: SigmaGrid  # spreads of a force over the gap, relative to it

    def at(self, places: Array, resistance: Array) -> tuple[Array, Array]:
        """Forces (s,) and their spreads (s,) (N).

        Parameters
        ----------
        places : ndarray, shape (s, 2)
            In units of the sheet's edges; beyond the sheet its border counts.
        resistance : ndarray, shape (s,)
            R, in units of the divider's.
        """
        force, spread = np.empty(len(places)), np.empty(len(places))
        force_rows(places, resistance, self.table, *self._law, force, spread)
        return force, spread

    @cached_property
    def _law(self) -> tuple[Array, Array, Array]:
        """Numbers and spreads as `force_rows` takes them."""
        own = self.cells
        law = [WIDEST[0, 1], *self.range, self.bend, self.most, self.gap, own.low, own.slope]
        return np.array(law), self.series.law, own.spreads.reshape(GRID, GRID, own.levels)


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


class PowerLawForce:
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
    prior_ : ndarray, shape (6,)
        Logarithms of the sizes of the fields, their length over the sheet, and the share of
        their size that has no length.
    weights_ : ndarray, shape (p,)
        Of the terms: five that are the same everywhere, then those of the fields.
    doubt_ : ndarray, shape (g, 3)
        Logarithm of the variance by calibration, a square in the level, on a grid of places.
    """

    film_: FilmResistance  # what Rx leaves of R
    fields_: tuple[SmoothFields, ...]  # of the four shapes
    prior_: Array
    weights_: Array
    root_: Array  # (p, p) square root of their covariance
    noise_: float  # spread of a weighted row about the curve of its place
    wobble_: Array  # (2,) noise of places, in units of the edges
    rough_: float  # relative spread of a force beside what the divider's noise makes
    steep_: float  # slope of the logarithm of force over that of the film, all over the sheet
    gap_: float  # force that the air gap takes everywhere (N); the rest follows the law
    most_: float  # logarithm of the largest answer
    doubt_: Array
    caution_: float  # factor on the spread by calibration, from groups that were left out
    calm_: float  # factor on the spread about the curve of a place

    def __init__(
        self, noise: float = 0.0, size: Array | None = None, series: SeriesResistance | None = None
    ) -> None:
        self.noise = noise
        self.size = np.ones(2) if size is None else np.asarray(size, np.float64)
        self.series = SeriesResistance(self.size, 1.0, 0.0) if series is None else series

    def fit(self, x: Array, y: Array, groups: Integers | None = None) -> PowerLawForce:
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

    def _spreads(self) -> SigmaGrid:
        """Relative spreads of a force, by calibration and noise."""
        low, high = self.film_.levels
        film = np.exp(np.linspace(low, high, LEVELS) + self.film_.range[2])
        scatter = self._scatter(film + self.film_.middle, film)
        return SigmaGrid.of(self.doubt_, self.calm_**2 * scatter, low, high)

    def _tell_doubt(self) -> Array:
        """Logarithm of the variance by calibration on a grid of places: squares in the level."""
        places, found, levels = grid_places(), [], np.linspace(*self.film_.levels, 3)
        for film in np.exp(levels + self.film_.range[2]):
            x = np.column_stack([places, film + self.film_.series_at(places)])
            half = self._terms(x) @ self.root_.T
            variance = self.caution_**2 * np.einsum('sp,sp->s', half, half)
            found.append(np.log(variance + by_places(self._level, x, self.wobble_) + 1e-300))
        return np.asarray(np.linalg.solve(levels[:, None] ** np.arange(3), np.array(found)).T)


class MeanCurve:
    """Polynomial of one feature.

    Parameters
    ----------
    column : int
        Of the feature.
    degree : int
        Of the polynomial; less where there are few values.
    """

    width_: int  # number of features
    range_: Array  # (2,) middle and half width of the feature; beyond, the nearest end counts
    weights_: Array  # (p, k) of the powers (unit of y)

    def __init__(self, column: int, degree: int = 4) -> None:
        self.column = column
        self.degree = degree

    def fit(self, x: Array, y: Array, groups: Integers | None = None) -> MeanCurve:
        """Learn from features (s, d) and targets (s, k); groups do not matter."""
        rows = training_rows(x, y, groups)
        level = rows.x[:, self.column]
        half = max(float(np.ptp(level)) / 2, 1e-12)
        self.width_ = rows.x.shape[1]
        self.range_ = np.array([(level.min() + level.max()) / 2, half])
        self.degree_ = min(self.degree, len(np.unique(level)) - 1)
        weights, *_ = np.linalg.lstsq(self._terms(rows.x), rows.y, rcond=1e-10)
        self.weights_ = np.asarray(weights, np.float64)
        return self

    def predict(self, x: Array) -> Array:
        """Targets (s, k)."""
        fitted(self, 'weights_')
        return predict_rows(x, self.width_, lambda known: self._terms(known) @ self.weights_)

    def _terms(self, x: Array) -> Array:
        level = (x[:, self.column] - self.range_[0]) / self.range_[1]
        clipped = np.minimum(np.maximum(level, -1.1), 1.1)[:, None]
        return np.asarray(clipped ** np.arange(self.degree_ + 1))
