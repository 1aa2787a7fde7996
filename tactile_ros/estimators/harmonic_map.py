"""Place on a resistive sheet from two potentials, by harmonic polynomials with a prior.

The potential of a homogeneous sheet is harmonic whatever its border does ([5] Eq. (1)), so a few
harmonic polynomials (Re and Im of z^n) describe it from few touches. A sheet that is not quite
homogeneous adds terms |z|^2 z^n (Almansi's expansion). Prior spreads are chosen by the evidence.
The map is turned round once, as a polynomial of the potentials: a frame costs one product.
"""

from __future__ import annotations

from functools import cached_property
from itertools import product

import numpy as np
import numpy.typing as npt

from tactile_ros.estimators.evidence import Moments
from tactile_ros.estimators.repeated_places import at_places
from tactile_ros.estimators.sheet_rows import place_rows
from tactile_ros.estimators.spread_cells import GRID as CELLS
from tactile_ros.estimators.spread_cells import grid_places
from tactile_ros.estimators.training import fitted, predict_rows, training_rows
from tactile_ros.estimators.trials import at_corners, caution
from tactile_ros.physics import compiled
from tactile_ros.types import Array, Integers

ORDER = 9
UNEVEN = 4  # orders of the terms that a sheet of uneven resistance needs
DEGREE = 11
GRID = 41
MARGIN = 0.15  # beyond what was touched, in radii
PENALTY = 1e-8
OUTSIDE = 1.1
SPREADS = tuple(10.0**power for power in np.arange(0.0, 4.1, 0.5))
DECAYS = (0.4, 0.6, 0.8)
EXTRA = (1e-6, 1.0, 10.0, 100.0)
FREE = 1e5
UNLIKELY = 0.01  # share of the evidence of the likeliest prior
LEAST_NOISE = 1e-9
LEAST_SLOPE = 1e-3
Complexes = npt.NDArray[np.complex128]


class HarmonicMap:
    """Potentials as almost harmonic functions of place, turned round.

    Parameters
    ----------
    size : ndarray, shape (2,)
        Of the sheet, with a corner at the origin (m).

    Attributes
    ----------
    weights_ : ndarray, shape (p, 2)
        Of the terms, for both potentials.
    root_ : ndarray, shape (p, p)
        Square root of the weights' covariance (unit of x).
    inverse_ : ndarray, shape (m, 2)
        Polynomials of the potentials that tell the place in radii.
    roots_ : ndarray, shape (g, g, 2, 2)
        Roots of the covariance of the error (m) in cells over the sheet.
    range_ : ndarray, shape (2, 2)
        Middle and half width of the potentials on the sheet.
    noise_ : float
        Of a potential within a place.
    caution_ : float
        Factor on the spread by calibration, from places that were left out.
    """

    weights_: Array
    root_: Array
    inverse_: Array
    roots_: Array
    range_: Array
    noise_: float
    caution_: float

    def __init__(self, size: Array) -> None:
        self.size = np.asarray(size, np.float64)

    @property
    def _radius(self) -> float:
        return float(self.size.max()) / 2

    def fit(self, x: Array, y: Array, groups: Integers | None = None) -> HarmonicMap:
        """Learn from potentials (s, 2) at places (s, 2) (m); further columns do not count."""
        rows = training_rows(x, y, groups)
        places, potentials, within, repeats = at_places(rows.y[:, :2], rows.x[:, :2])
        terms = _terms(self._plane(places))
        vars(self).pop('_series', None)
        noise = self._average(Moments.of(terms, potentials))
        self.noise_ = max(within, LEAST_NOISE) if repeats else noise
        left, half = potentials - terms @ self.weights_, terms @ self.root_.T / noise
        self.caution_ = _careful(places, left, half, noise)
        self._turn_round(places)
        return self

    def _average(self, moments: Moments) -> float:
        """Weights and their covariance, averaged over priors by their evidence; and the noise.

        Few places do not tell one prior from another: what the likely ones disagree in is doubt.
        """
        free = np.abs(_orders()) < 2
        spreads = [np.where(free, FREE, _spread(*one)) for one in product(SPREADS, DECAYS, EXTRA)]
        level = np.array([moments.evidence(spread) for spread in spreads])
        share = np.exp(level - level.max())
        likely = np.flatnonzero(share > UNLIKELY)
        share = share[likely] / share[likely].sum()
        found = [moments.solve(spreads[i]) for i in likely]
        noises = [max(s, moments.left(w, root), LEAST_NOISE) for w, root, s in found]
        weights = np.array([one[0] for one in found])
        self.weights_ = np.asarray(np.einsum('i,ipk->pk', share, weights))
        apart = (weights - self.weights_) * np.sqrt(share / 2)[:, None, None]
        sizes = np.sqrt(share) * noises
        roots = [size * one[1] for size, one in zip(sizes, found, strict=True)]
        stacked = np.concatenate([*roots, *np.moveaxis(apart, 2, 1)])
        self.root_ = np.asarray(np.linalg.qr(stacked, mode='r'))
        return float(np.sqrt(share @ np.square(noises)))

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
            known = (self.range_, OUTSIDE, self._table, self.size, self.roots_)
            place_rows(x, *known, place, covariance)
            return place, covariance
        u = (x[:, :2] - self.range_[0]) / self.range_[1]
        powers = np.minimum(np.maximum(u, -OUTSIDE), OUTSIDE)[:, :, None] ** _RISING
        # no product of matrices: its sums run otherwise for one frame than for many
        known = np.einsum('si,sj,ijk->sk', powers[:, 0], powers[:, 1], self._table)
        place = np.minimum(np.maximum(known, 0.0), self.size)
        cell = (np.fmax(place / self.size, 0.0) * (CELLS - 1) + 0.5).astype(np.int64)
        root = self.roots_[cell[:, 0], cell[:, 1]]
        covariance = np.einsum('sij,skj->sik', root, root)
        return place, covariance + 0.0 * place[:, :1, None]

    def stated(self, x: Array) -> tuple[Array, Array]:
        """Places (s, 2) and spreads of their errors (s, 2) (m)."""
        place, covariance = self.place(x)
        return place, np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))

    def _potentials(self, z: Array) -> tuple[Array, Array, Array]:
        """Potentials (s, 2) at places in radii, and their slopes along x and along y."""
        powers = np.ones((len(z), ORDER + 1), np.complex128)
        point = z[:, 0] + 1j * z[:, 1]
        np.cumprod(np.broadcast_to(point[:, None], (len(z), ORDER)), axis=1, out=powers[:, 1:])
        values = powers @ self._series
        square = (z * z).sum(axis=1)[:, None]
        bend = values[:, 4:6].real
        slope = values[:, 2:4] + square * values[:, 6:8]
        bent = 2.0 * bend
        return (
            values[:, :2].real + square * bend,
            slope.real + z[:, :1] * bent,
            z[:, 1:] * bent - slope.imag,
        )

    @cached_property
    def _table(self) -> Array:
        """Factors (n, n, 2) of products of powers of the potentials, for the place."""
        table = np.zeros((len(_RISING) ** 2, 2))
        table[_BELOW] = self._radius * self.inverse_
        table[0] += self.size / 2
        return table.reshape(len(_RISING), len(_RISING), 2)

    @cached_property
    def _series(self) -> Complexes:
        """Coefficients (n, 8) of four analytic functions for both potentials.

        The harmonic part, its derivative, the factor of the squared radius, and its derivative.
        """
        series = np.zeros((ORDER + 1, 8), np.complex128)
        first = 0
        for column, order in ((0, ORDER + 1), (4, UNEVEN)):
            real = self.weights_[first : first + order]
            imaginary = self.weights_[first + order : first + 2 * order - 1]
            series[:order, column : column + 2] = real
            series[1:order, column : column + 2] -= 1j * imaginary
            rising = np.arange(1, ORDER + 1)[:, None]
            series[:-1, column + 2 : column + 4] = rising * series[1:, column : column + 2]
            first += 2 * order - 1
        return series

    def _plane(self, places: Array) -> Array:
        """Places in radii from the middle."""
        return np.asarray((places - self.size / 2) / self._radius)

    def _turn_round(self, places: Array) -> None:
        """Fit places to potentials over the sheet, or what of it was touched and a little more."""
        z = self._plane(places)
        edge = self.size / 2 / self._radius
        low = np.maximum(z.min(axis=0) - MARGIN, -edge)
        high = np.minimum(z.max(axis=0) + MARGIN, edge)
        axes = [np.linspace(a, b, GRID) for a, b in zip(low, high, strict=True)]
        grid = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
        u, _, _ = self._potentials(grid)
        least, most = u.min(axis=0), u.max(axis=0)
        half = np.maximum((most - least) / 2, 1e-9)
        self.range_ = np.stack([(least + most) / 2, half])
        terms = _powers((u - self.range_[0]) / half)
        penalty = PENALTY * np.eye(terms.shape[1])
        stacked = np.concatenate([terms, penalty])
        wanted = np.concatenate([grid, np.zeros((len(penalty), 2))])
        vars(self).pop('_table', None)
        self.inverse_ = np.linalg.lstsq(stacked, wanted, rcond=None)[0]
        cells = self._plane(grid_places() * self.size)
        roots = self._error_roots(np.minimum(np.maximum(cells, low), high))
        self.roots_ = roots.reshape(CELLS, CELLS, 2, 2)

    def _error_roots(self, z: Array) -> Array:
        """Roots (s, 2, 2) of the covariance of the error (m) at places in radii.

        A polynomial would ring: the doubt of the calibration rises steeply where touches end.
        """
        _, across, along = self._potentials(z)
        calibration = self.caution_**2 * ((_terms(z) @ self.root_.T) ** 2).sum(axis=1)
        sigma = self._radius * np.sqrt(self.noise_**2 + calibration)
        det = across[:, 0] * along[:, 1] - along[:, 0] * across[:, 1]
        det = np.where(np.abs(det) > LEAST_SLOPE, det, LEAST_SLOPE)
        turned = np.stack([along[:, 1], -along[:, 0], -across[:, 1], across[:, 0]], axis=1)
        return np.asarray((turned * (sigma / det)[:, None]).reshape(-1, 2, 2))


def _careful(places: Array, left: Array, half: Array, noise: float) -> float:
    """Factor on the doubt of calibration with which held-out places lie inside as they should.

    Residuals (n, k) of places (n, 2) and the root of their hat matrix give what a fit without
    each place would miss it by; corners do not count.
    """
    hat = np.minimum((half * half).sum(axis=1), 0.999)[:, None]
    judged = ~at_corners(places, np.arange(len(places)))
    error, doubt = left / (1 - hat), noise**2 * hat / (1 - hat)
    asked = np.sqrt(np.maximum(error**2 - noise**2, 0.0) / (doubt + 1e-300))[judged]
    return caution(asked.ravel(), np.ones(asked.size), int(judged.sum()))


def _terms(z: Array) -> Array:
    """Terms (s, p) at places in radii."""
    point = z[:, :1] + 1j * z[:, 1:]
    powers = np.asarray(point ** np.arange(ORDER + 1), np.complex128)
    return _parts(powers, (z * z).sum(axis=1)[:, None] * powers[:, :UNEVEN])


def _orders() -> Integers:
    """Order of each term; below 0: of an uneven sheet's."""
    even = [0, *range(1, ORDER + 1), *range(1, ORDER + 1)]
    uneven = [2, *range(3, UNEVEN + 2), *range(3, UNEVEN + 2)]
    return np.array(even + [-n for n in uneven])


def _spread(size: float, decay: float, extra: float) -> Array:
    """Prior spread (p,) of each term over the noise."""
    order = _orders()
    fading = decay ** np.maximum(np.abs(order) - 2.0, 0.0)
    return np.asarray(np.where(order < 0, extra * fading, size * fading))


def _parts(even: Complexes, uneven: Complexes) -> Array:
    """Real and imaginary parts of complex terms; the imaginary one of z^0 is none."""
    return np.concatenate([even.real, even.imag[:, 1:], uneven.real, uneven.imag[:, 1:]], axis=1)


def _powers(u: Array) -> Array:
    """Products of powers of two columns, up to a degree in all, shape (s, m)."""
    steps = u[:, :, None] ** _RISING
    table = steps[:, 0, :, None] * steps[:, 1, None, :]
    return np.asarray(table.reshape(len(u), -1)[:, _BELOW])


_RISING = np.arange(DEGREE + 1)
_BELOW = np.flatnonzero((_RISING[:, None] + _RISING).ravel() <= DEGREE)
