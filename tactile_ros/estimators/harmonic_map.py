"""Place on a resistive sheet from two potentials that are harmonic functions of it.

`sheet_potentials` tells the potentials from few touches, by terms and priors that are the
likeliest. They are turned round once, as a polynomial of the potentials and what it lacks on a
grid of places: a frame costs one product and one look-up.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np

from tactile_ros.estimators.potential_fit import LEAST_NOISE, likeliest_of
from tactile_ros.estimators.repeated_places import ToldPlaces, at_places
from tactile_ros.estimators.sheet_potentials import KINDS, SheetPotentials
from tactile_ros.estimators.sheet_rows import place_rows
from tactile_ros.estimators.shift_table import NODES, shift_at
from tactile_ros.estimators.spread_cells import GRID as CELLS
from tactile_ros.estimators.spread_cells import grid_places
from tactile_ros.estimators.training import fitted, predict_rows, training_rows
from tactile_ros.estimators.trials import at_corners, caution, left_out
from tactile_ros.physics import compiled
from tactile_ros.types import Array, Integers

DEGREE = 11
GRID = 41
MARGIN = 0.15  # beyond what was touched, in halves of the longer edge
PENALTY = 1e-8
OUTSIDE = 1.1
LEAST_SLOPE = 1e-3
STEP = 1e-4  # of half the longer edge
TURNS = 4


class HarmonicMap:
    """Potentials as almost harmonic functions of place, turned round.

    Parameters
    ----------
    size : ndarray, shape (2,)
        Of the sheet, with a corner at the origin (m).

    Attributes
    ----------
    basis_ : SheetPotentials
        Terms of the potentials.
    weights_ : ndarray, shape (p,)
        Of the terms.
    root_ : ndarray, shape (p, p)
        Square root of the weights' covariance (unit of x).
    inverse_ : ndarray, shape (m, 2)
        Polynomials of the potentials that tell the place in halves of the longer edge.
    shift_ : ndarray, shape (n, n, 2)
        What is added to the polynomials' place (m), on a grid that goes one step beyond the sheet.
    roots_ : ndarray, shape (g, g, 2, 2)
        Roots of the covariance of the error (m) in cells over the sheet.
    range_ : ndarray, shape (2, 2)
        Middle and half width of the potentials on the sheet.
    noise_, least_ : float
        Of a potential within a place, and of the mean at a place.
    caution_ : float
        Factor on the spread by calibration, from places that were left out.
    """

    basis_: SheetPotentials
    weights_: Array
    root_: Array
    inverse_: Array
    shift_: Array
    roots_: Array
    range_: Array
    noise_: float
    least_: float
    caution_: float

    def __init__(self, size: Array) -> None:
        self.size = np.asarray(size, np.float64)

    @property
    def _radius(self) -> float:
        return float(self.size.max()) / 2

    def fit(self, x: Array, y: Array, groups: Integers | None = None) -> HarmonicMap:
        """Learn from potentials (s, 2) at places (s, 2) (m); further columns do not count."""
        rows = training_rows(x, y, groups)
        known = at_places(rows.y[:, :2], rows.x[:, :2])
        fits = [likeliest_of(kind, self.size, known) for kind in KINDS]
        best = max(fits, key=lambda one: float(one.levels.max()))
        self.basis_ = best.basis
        self.weights_, self.root_, self.least_ = best.average(known.least)
        self.noise_ = max(known.within, LEAST_NOISE) if known.repeats else self.least_
        self.caution_ = self._careful(known)
        self._turn_round(known.places)
        return self

    def predict(self, x: Array) -> Array:
        """Places (s, 2) (m) for potentials (s, 2)."""
        fitted(self, 'noise_')
        return predict_rows(x, x.shape[1], lambda u: self.place(u)[0])

    def place(self, x: Array) -> tuple[Array, Array]:
        """Places (s, 2) (m) for potentials (s, 2), and covariances (s, 2, 2) of their error (m2).

        The covariance is of noise and calibration together.
        """
        if compiled.available():
            place, covariance = np.empty((len(x), 2)), np.empty((len(x), 2, 2))
            known = (self.range_, OUTSIDE, self._table, self.size, self.shift_, self.roots_)
            place_rows(x, *known, place, covariance)
            return place, covariance
        rough = self._rough(x)
        place = np.minimum(
            np.maximum(rough + shift_at(rough / self.size, self.shift_), 0), self.size
        )
        cell = (np.fmax(place / self.size, 0.0) * (CELLS - 1) + 0.5).astype(np.int64)
        root = self.roots_[cell[:, 0], cell[:, 1]]
        covariance = np.einsum('sij,skj->sik', root, root)
        return place, covariance + 0.0 * place[:, :1, None]

    def stated(self, x: Array) -> tuple[Array, Array]:
        """Places (s, 2) and spreads of their errors (s, 2) (m)."""
        place, covariance = self.place(x)
        return place, np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))

    def _rough(self, x: Array) -> Array:
        """Places (s, 2) (m) by the polynomials alone."""
        u = (x[:, :2] - self.range_[0]) / self.range_[1]
        powers = np.minimum(np.maximum(u, -OUTSIDE), OUTSIDE)[:, :, None] ** _RISING
        # no product of matrices: its sums run otherwise for one frame than for many
        known = np.einsum('si,sj,ijk->sk', powers[:, 0], powers[:, 1], self._table)
        return np.asarray(np.minimum(np.maximum(known, 0.0), self.size))

    @cached_property
    def _table(self) -> Array:
        """Factors (n, n, 2) of products of powers of the potentials, for the place."""
        table = np.zeros((len(_RISING) ** 2, 2))
        table[_BELOW] = self._radius * self.inverse_
        table[0] += self.size / 2
        return table.reshape(len(_RISING), len(_RISING), 2)

    def _potentials(self, places: Array) -> Array:
        """Potentials (s, 2) at places (s, 2) (m)."""
        return np.asarray((self.basis_.terms(places) @ self.weights_).T)

    def held_out(self, x: Array, y: Array, groups: Integers) -> tuple[Array, Array]:
        """What a fit without the group of each row says of it, and the spread that it states.

        Terms and priors are those of the fit on all rows. Potentials (s, 2..) and places (s, 2)
        (m) must be those of the fit; answers are places and spreads (s, 2) (m).
        """
        known = at_places(y[:, :2], x[:, :2])
        first = np.zeros(len(known.places), np.int64)
        first[known.index] = groups
        error, doubt = self._alone(known, first)
        inverse = self._inverse_slopes(known.places)[known.index]
        off = np.einsum('sij,sj->si', inverse, x[:, :2] - (known.told - error.T)[known.index])
        variance = self.noise_**2 + self.caution_**2 * doubt.T[known.index]
        spread = np.sqrt(np.einsum('sij,sj->si', inverse**2, variance))
        return y[:, :2] + off, spread

    def _alone(self, known: ToldPlaces, groups: Integers) -> tuple[Array, Array]:
        """What potentials (2, n) are above a fit without each group; its variances."""
        terms = self.basis_.terms(known.places)
        half = terms @ self.root_.T / self.least_
        left = known.told.T - terms @ self.weights_
        error, doubt = np.empty_like(left), np.empty_like(left)
        for group in np.unique(groups):
            rows = np.flatnonzero(groups == group)
            off, hat = left_out(half[:, rows].reshape(2 * len(rows), -1), left[:, rows].ravel())
            error[:, rows], doubt[:, rows] = off.reshape(2, -1), hat.reshape(2, -1)
        return error, self.least_**2 * doubt

    def _careful(self, known: ToldPlaces) -> float:
        """Factor on the doubt of calibration with which held-out places lie inside as they should.

        Corners do not count.
        """
        each = np.arange(len(known.places))
        error, doubt = self._alone(known, each)
        judged = ~at_corners(known.places, each)
        square = np.maximum(error**2 - self.least_**2, 0.0)
        asked = np.sqrt(square / (doubt + 1e-300))[:, judged]
        return caution(asked.ravel(), np.ones(asked.size), int(judged.sum()))

    def _turn_round(self, places: Array) -> None:
        """Fit places to potentials over the sheet, or what of it was touched and a little more."""
        margin = MARGIN * self._radius
        low = np.maximum(places.min(axis=0) - margin, 0.0)
        high = np.minimum(places.max(axis=0) + margin, self.size)
        axes = [np.linspace(a, b, GRID) for a, b in zip(low, high, strict=True)]
        grid = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
        u = self._potentials(grid)
        least, most = u.min(axis=0), u.max(axis=0)
        half = np.maximum((most - least) / 2, 1e-9)
        self.range_ = np.stack([(least + most) / 2, half])
        terms = _powers((u - self.range_[0]) / half)
        penalty = PENALTY * np.eye(terms.shape[1])
        stacked = np.concatenate([terms, penalty])
        plane = (grid - self.size / 2) / self._radius
        wanted = np.concatenate([plane, np.zeros((len(penalty), 2))])
        vars(self).pop('_table', None)
        self.inverse_ = np.linalg.lstsq(stacked, wanted, rcond=None)[0]
        self.shift_ = self._shift(low, high)
        cells = np.minimum(np.maximum(grid_places() * self.size, low), high)
        self.roots_ = self._error_roots(cells).reshape(CELLS, CELLS, 2, 2)

    def _shift(self, low: Array, high: Array) -> Array:
        """What the polynomials' place lacks (n, n, 2) (m), between two corners of the sheet."""
        line = np.arange(-1, NODES + 1) / (NODES - 1)
        grid = np.stack(np.meshgrid(line, line, indexing='ij'), axis=-1).reshape(-1, 2)
        wanted = np.minimum(np.maximum(grid * self.size, low), high)
        place, kept, least = wanted, np.zeros_like(wanted), np.full(len(wanted), np.inf)
        for _ in range(TURNS):
            seen = (self._potentials(place) - self.range_[0]) / self.range_[1]
            rough = _powers(np.clip(seen, -OUTSIDE, OUTSIDE)) @ self.inverse_
            off = wanted - np.clip(self._radius * rough + self.size / 2, 0.0, self.size)
            miss = np.linalg.norm(off, axis=1)
            better = miss < least
            kept[better], least[better] = (place - wanted)[better], miss[better]
            place = np.minimum(np.maximum(place + off, low), high)
        return kept.reshape(len(line), len(line), 2)

    def _error_roots(self, places: Array) -> Array:
        """Roots (s, 2, 2) of the covariance of the error (m) at places (m).

        A polynomial would ring: the doubt of the calibration rises steeply where touches end.
        """
        half = self.caution_ * (self.basis_.terms(places) @ self.root_.T)
        covariance = np.einsum('asp,bsp->sab', half, half) + self.noise_**2 * np.eye(2)
        return np.asarray(self._inverse_slopes(places) @ np.linalg.cholesky(covariance))

    def _inverse_slopes(self, places: Array) -> Array:
        """Moves of a place (m) by the potentials, shape (s, 2, 2), at places (m)."""
        step = STEP * self._radius
        (a, c), (b, d) = (
            (self._potentials(places + off) - self._potentials(places - off)).T / (2 * step)
            for off in step * np.eye(2)
        )
        det, steep = a * d - b * c, LEAST_SLOPE / self._radius**2
        det = np.where(np.abs(det) > steep, det, steep)
        return np.asarray((np.stack([d, -b, -c, a]) / det).T.reshape(-1, 2, 2))


def _powers(u: Array) -> Array:
    """Products of powers of two columns, up to a degree in all, shape (s, m)."""
    steps = u[:, :, None] ** _RISING
    table = steps[:, 0, :, None] * steps[:, 1, None, :]
    return np.asarray(table.reshape(len(u), -1)[:, _BELOW])


_RISING = np.arange(DEGREE + 1)
_BELOW = np.flatnonzero((_RISING[:, None] + _RISING).ravel() <= DEGREE)
