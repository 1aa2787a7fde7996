"""Place on a resistive sheet from two potentials that are harmonic functions of it.

`sheet_potentials` tells the potentials from few touches, by terms and priors that are the
likeliest. They are turned round once, as a polynomial of the potentials and what it lacks on a
grid of places: a frame costs one product and one look-up.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import Literal

import numpy as np
import numpy.typing as npt

from tactile_ros.estimators.model_selection import at_corners, caution, left_out
from tactile_ros.estimators.regression import fitted, predict_rows, training_rows
from tactile_ros.estimators.smooth_fields import GRID as CELLS
from tactile_ros.estimators.smooth_fields import (
    Moments,
    Replicates,
    at_places,
    grid_places,
    place_rows,
)
from tactile_ros.types import Array, Integers

Kind = Literal['polynomials', 'sides', 'border']
KINDS: tuple[Kind, ...] = ('polynomials', 'sides', 'border')
ORDER = 9
UNEVEN = 4  # orders of the terms that a sheet of uneven resistance needs
SINES = 20  # along a side
ENDS = ((0, 1), (1, 2), (3, 2), (0, 3))  # corners A B C D at both ends of AB, BC, DC and AD
FREE = 1e5
SPREADS = tuple(10.0**power for power in np.arange(0.0, 4.1, 0.5))
DECAYS = (0.4, 0.6, 0.8)
ROUGHS = (1.0, 1.5, 2.0)  # powers by which sines get smaller: steps of silver have 1.5 to 2
EXTRA = (1e-6, 1.0, 10.0, 100.0)
WAVES = np.array(list(product((1.0, 2.0, 3.0), repeat=2)))  # over the sheet, 0 on its border
UNEVEN_FALL = 1.5
OUTPUTS = 2
EVEN = np.arange(1.0, SINES + 1) * (np.arange(1, SINES + 1) % 2 == 0)
# pads of silver in the corners shorten all sides at both ends: sine factors of a sawtooth, and of
# what rounds it
PADS = np.stack([np.where(EVEN > 0, 1 / np.maximum(EVEN, 1), 0.0), EVEN / SINES**2], axis=1)
Complexes = npt.NDArray[np.complex128]


@dataclass(frozen=True)
class SheetPotentials:
    """Terms of two potentials on a rectangular sheet.

    The potential of a homogeneous sheet is harmonic ([5] Eq. (1)): it is told by harmonic
    polynomials (Re and Im of z^n), or by what its border holds, as sines along each side that fade
    inwards. The silver carries nearly all of the current, so that along a side every excitation
    falls off alike, from one corner's potential to the next one's: what is uneven in it is the
    same for all. A sheet that is not quite homogeneous adds terms |z|^2 z^n (Almansi's expansion),
    or products of sines that are 0 on the border.

    Attributes
    ----------
    kind : str
        'polynomials'; 'sides': each potential has its own sines along the sides; 'border': the
        sines of both are those of one silver border.
    corners : ndarray, shape (2, 4)
        Potentials of the corners A, B, C, D, from which 'border' knows how far a side falls.
    """

    size: Array  # (2,) of the sheet, with corner A at the origin (m)
    kind: Kind
    corners: Array

    def terms(self, places: Array) -> Array:
        """Terms (2, s, p) of both potentials at places (s, 2) (m)."""
        own = self._own(places)
        shared = self._shared(places) if self.kind == 'border' else np.zeros((2, len(own), 0))
        count = own.shape[1]
        terms = np.zeros((OUTPUTS, len(own), OUTPUTS * count + shared.shape[2]))
        for output in range(OUTPUTS):
            terms[output, :, output * count : (output + 1) * count] = own
        terms[:, :, OUTPUTS * count :] = shared
        return terms

    def spreads(self) -> Array:
        """Prior spreads (m, p) of the terms, over the noise, to choose from."""
        return np.array([self._spread(*one) for one in product(SPREADS, self._falls, EXTRA)])

    def corners_of(self, weights: Array) -> Array:
        """Potentials (2, 4) of the corners by weights (p,) of 'border'."""
        own = (len(weights) - len(ENDS) * SINES - PADS.shape[1]) // OUTPUTS
        return _at_corners(np.stack([weights[:4], weights[own : own + 4]]), self.size)

    @property
    def _falls(self) -> tuple[float, ...]:
        return DECAYS if self.kind == 'polynomials' else ROUGHS

    def _spread(self, size: float, fall: float, extra: float) -> Array:
        """Prior spread (p,) of each term, over the noise."""
        if self.kind == 'polynomials':
            known = np.array([0.0, *range(1, ORDER + 1), *range(1, ORDER + 1)])
            smooth = np.where(known < 2, FREE, size * fall ** np.maximum(known - 2.0, 0.0))
            order = np.array([0.0, *range(1, UNEVEN), *range(1, UNEVEN)])
            return np.tile(np.concatenate([smooth, extra * fall**order]), OUTPUTS)
        sines = np.tile(size * np.arange(1.0, SINES + 1) ** -fall, len(ENDS))
        uneven = extra * (WAVES**2).sum(axis=1) ** -UNEVEN_FALL
        parts = [[FREE, FREE, FREE, size], uneven]
        if self.kind == 'sides':
            return np.tile(np.concatenate([*parts, sines]), OUTPUTS)
        pads = np.full(PADS.shape[1], size)
        return np.concatenate([np.tile(np.concatenate(parts), OUTPUTS), sines, pads])

    def _own(self, places: Array) -> Array:
        """Terms (s, q) that each potential has weights of its own for."""
        z = _plane(places, self.size)
        if self.kind == 'polynomials':
            powers = np.asarray((z[:, :1] + 1j * z[:, 1:]) ** np.arange(ORDER + 1), np.complex128)
            uneven = _parts((z * z).sum(axis=1)[:, None] * powers[:, :UNEVEN])
            return np.concatenate([_parts(powers), uneven], axis=1)
        share = np.pi * places / self.size
        uneven = np.sin(share[:, :1] * WAVES[:, 0]) * np.sin(share[:, 1:] * WAVES[:, 1])
        sines = self._sides(places) if self.kind == 'sides' else []
        return np.concatenate([_bilinear(z), uneven, *sines], axis=1)

    def _shared(self, places: Array) -> Array:
        """Terms (2, s, q) of one border for both potentials."""
        fall = [self.corners[:, end] - self.corners[:, start] for start, end in ENDS]
        sides = self._sides(places)
        known = [one[:, None, None] * side for one, side in zip(fall, sides, strict=True)]
        lengths = self.size.max() / self.size[[0, 1, 0, 1]]
        pads = sum(size * (side @ PADS) for size, side in zip(lengths, known, strict=True))
        return np.concatenate([*known, pads], axis=2)

    def _sides(self, places: Array) -> list[Array]:
        """Sines (s, n) along each side, fading inwards, at places (s, 2)."""
        x, y = (places / self.size).T
        long, wide = self.size
        n = np.pi * np.arange(1, SINES + 1)
        found = []
        for along, away, rate in (
            (x, y, n * wide / long),
            (y, 1 - x, n * long / wide),
            (x, 1 - y, n * wide / long),
            (y, x, n * long / wide),
        ):
            fade = np.exp(-rate * away[:, None]) - np.exp(-rate * (2 - away[:, None]))
            found.append(np.sin(np.outer(along, n)) * fade / -np.expm1(-2 * rate))
        return found


def bilinear_corners(places: Array, told: Array, size: Array) -> Array:
    """Potentials (2, 4) of the corners by a bilinear fit to potentials (s, 2) at places (s, 2)."""
    terms = _bilinear(_plane(places, size))
    bilinear = np.linalg.lstsq(terms, told, rcond=None)[0].T
    return _at_corners(np.asarray(bilinear, np.float64), size)


def _at_corners(bilinear: Array, size: Array) -> Array:
    """Bilinear fields (k, 4) at the corners A, B, C and D, shape (k, 4)."""
    corners = size * np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    return np.asarray(bilinear @ _bilinear(_plane(corners, size)).T)


def _plane(places: Array, size: Array) -> Array:
    """Places (s, 2) in halves of the longer edge from the middle."""
    return np.asarray((places - size / 2) / (size.max() / 2))


def _bilinear(z: Array) -> Array:
    """Terms (s, 4) of a bilinear field at places (s, 2)."""
    x, y = z.T
    return np.stack([np.ones_like(x), x, y, x * y], axis=1)


def _parts(terms: Complexes) -> Array:
    """Real and imaginary parts of complex terms; the imaginary one of the first is none."""
    return np.concatenate([terms.real, terms.imag[:, 1:]], axis=1)


UNLIKELY = 0.01  # share of the evidence of the likeliest prior
LEAST_NOISE = 1e-9
ROUNDS = 2  # in which the corners' potentials settle


@dataclass(frozen=True)
class PotentialFit:
    """Terms of one kind, and the evidence of each of their priors."""

    basis: SheetPotentials  # the terms
    moments: Moments  # of the terms and the potentials
    spreads: Array  # (m, p) priors
    levels: Array  # (m,) logarithms of their evidence

    @property
    def best(self) -> Array:
        """Weights (p,) by the likeliest prior."""
        return self.moments.solve(self.spreads[int(self.levels.argmax())])[0][:, 0]

    def average(self, least: float) -> tuple[Array, Array, float]:
        """Weights (p,), a square root (p, p) of their covariance, and the noise, over priors.

        They are averaged by the priors' evidence: few places do not tell one prior from another,
        and what the likely ones disagree in is doubt. The noise is not below `least`.
        """
        share = np.exp(self.levels - self.levels.max())
        likely = np.flatnonzero(share > UNLIKELY)
        share = share[likely] / share[likely].sum()
        found = [self.moments.solve(self.spreads[i]) for i in likely]
        floor = max(least, LEAST_NOISE)
        noises = [max(s, self.moments.left(w, root), floor) for w, root, s in found]
        weights = np.array([one[0][:, 0] for one in found])
        mean = share @ weights
        apart = (weights - mean) * np.sqrt(share)[:, None]
        sizes = np.sqrt(share) * noises
        roots = [size * one[1] for size, one in zip(sizes, found, strict=True)]
        root = np.linalg.qr(np.concatenate([*roots, apart]), mode='r')
        return np.asarray(mean), np.asarray(root), float(np.sqrt(share @ np.square(noises)))


def likeliest_of(kind: Kind, size: Array, known: Replicates) -> PotentialFit:
    """Fit terms of one kind to the potentials of places on a sheet of a size (2,) (m)."""
    corners = bilinear_corners(known.places, known.told, size)
    target = known.told.T.reshape(-1, 1)
    for _ in range(ROUNDS):
        basis = SheetPotentials(size, kind, corners)
        terms = basis.terms(known.places)
        moments = Moments.of(terms.reshape(len(target), -1), target)
        spreads = basis.spreads()
        levels = np.array([moments.evidence(spread, known.least) for spread in spreads])
        found = PotentialFit(basis, moments, spreads, levels)
        if kind != 'border':
            break
        corners = basis.corners_of(found.best)
    return found


NODES = 61  # along an edge of the sheet


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
    inverse_ : ndarray, shape (m, 2)
        Polynomials of the potentials that tell the place in halves of the longer edge.
    shift_ : ndarray, shape (n, n, 2)
        What is added to the polynomials' place (m), on a grid that goes one step beyond the sheet.
    """

    basis_: SheetPotentials  # terms of the potentials
    weights_: Array  # (p,) of the terms
    root_: Array  # (p, p) square root of the weights' covariance (unit of x)
    inverse_: Array
    shift_: Array
    roots_: Array  # (g, g, 2, 2) roots of the covariance of the error (m) in cells over the sheet
    range_: Array  # (2, 2) middle and half width of the potentials on the sheet
    # of a potential within a place, and of the mean at a place
    noise_: float
    least_: float
    caution_: float  # factor on the spread by calibration, from places that were left out

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
        place, covariance = np.empty((len(x), 2)), np.empty((len(x), 2, 2))
        known = (self.range_, OUTSIDE, self._table, self.size, self.shift_, self.roots_)
        place_rows(x, *known, place, covariance)
        return place, covariance

    def stated(self, x: Array) -> tuple[Array, Array]:
        """Places (s, 2) and spreads of their errors (s, 2) (m)."""
        place, covariance = self.place(x)
        return place, np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))

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

    def _alone(self, known: Replicates, groups: Integers) -> tuple[Array, Array]:
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

    def _careful(self, known: Replicates) -> float:
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
