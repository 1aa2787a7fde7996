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
from tactile_ros.estimators.training import fitted, predict_rows, training_rows
from tactile_ros.estimators.trials import at_corners, caution
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
SAME = 1e-5
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
    inverse_ : ndarray, shape (m, 6)
        Polynomials of the potentials that tell the place in radii, and the root of the
        covariance of its error.
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
        moments, free = Moments.of(terms, potentials), np.abs(_orders()) < 2
        best = max(
            (_spread(*triple) for triple in product(SPREADS, DECAYS, EXTRA)),
            key=moments.evidence,
        )
        best = np.where(free, FREE, best)
        self.weights_, root, noise = moments.solve(best)
        vars(self).pop('_series', None)
        left = ((potentials - terms @ self.weights_) ** 2).sum()
        used = 2 * float(np.einsum('ij,ij->', root @ moments.gram, root))
        noise = max(noise, float(np.sqrt(left / max(potentials.size - used, 1.0))), LEAST_NOISE)
        self.root_ = root * noise
        self.noise_ = max(within, LEAST_NOISE) if repeats else noise
        self.caution_ = _careful(places, potentials - terms @ self.weights_, terms @ root.T, noise)
        self._turn_round(places)
        return self

    def predict(self, x: Array) -> Array:
        """Places (s, 2) (m) for potentials (s, 2)."""
        fitted(self, 'noise_')
        return predict_rows(x, x.shape[1], lambda u: self.place(u)[0])

    def place(self, x: Array) -> tuple[Array, Array]:
        """Places (s, 2) (m) for potentials (s, 2), and covariances (s, 2, 2) of their error (m2).

        The covariance is of noise and calibration together.
        """
        u = (x[:, :2] - self.range_[0]) / self.range_[1]
        powers = np.minimum(np.maximum(u, -OUTSIDE), OUTSIDE)[:, :, None] ** _RISING
        # no product of matrices: its sums run otherwise for one frame than for many
        known = np.einsum('si,sj,ijk->sk', powers[:, 0], powers[:, 1], self._table)
        place = np.minimum(np.maximum(known[:, :2], 0.0), self.size)
        root = known[:, 2:].reshape(-1, 2, 2)
        return place, np.einsum('sij,skj->sik', root, root)

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
        """Factors (n, n, 6) of products of powers: of the place and the root of its covariance."""
        table = np.zeros((len(_RISING) ** 2, 6))
        table[_BELOW] = self._radius * self.inverse_
        table[0, :2] += self.size / 2
        return table.reshape(len(_RISING), len(_RISING), 6)

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
        u, across, along = self._potentials(grid)
        least, most = u.min(axis=0), u.max(axis=0)
        half = np.maximum((most - least) / 2, 1e-9)
        self.range_ = np.stack([(least + most) / 2, half])
        calibration = self.caution_**2 * ((_terms(grid) @ self.root_.T) ** 2).sum(axis=1)
        sigma = np.sqrt(self.noise_**2 + calibration)
        det = across[:, 0] * along[:, 1] - along[:, 0] * across[:, 1]
        det = np.where(np.abs(det) > LEAST_SLOPE, det, LEAST_SLOPE)
        turned = np.stack([along[:, 1], -along[:, 0], -across[:, 1], across[:, 0]], axis=1)
        wanted = np.concatenate([grid, turned * (sigma / det)[:, None]], axis=1)
        terms = _powers((u - self.range_[0]) / half)
        penalty = PENALTY * np.eye(terms.shape[1])
        stacked = np.concatenate([terms, penalty])
        wanted = np.concatenate([wanted, np.zeros((len(penalty), 6))])
        vars(self).pop('_table', None)
        self.inverse_ = np.linalg.lstsq(stacked, wanted, rcond=None)[0]


def at_places(places: Array, told: Array) -> tuple[Array, Array, float, bool]:
    """Means at places that were touched more than once.

    Parameters
    ----------
    places : ndarray, shape (s, 2)
        Where rows were told (m).
    told : ndarray, shape (s, k)
        What they told.

    Returns
    -------
    places, means : ndarray, shape (n, 2) and (n, k)
        One row a place.
    within : float
        Standard deviation of a row from its place's mean.
    repeats : bool
        False: places hardly repeat, and the rows are given back.
    """
    _, index, count = np.unique(
        np.round(places / SAME), axis=0, return_inverse=True, return_counts=True
    )
    index = np.asarray(index).reshape(-1)
    if len(count) > 0.5 * len(places):
        return places, told, 0.0, False

    def mean(values: Array) -> Array:
        columns = [np.bincount(index, column) / count for column in values.T]
        return np.stack(columns, axis=1)

    means = mean(told)
    free = (len(told) - len(count)) * told.shape[1]
    within = float(np.sqrt(((told - means[index]) ** 2).sum() / free))
    return mean(places), means, within, True


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
