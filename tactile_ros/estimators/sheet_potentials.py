"""Potentials of a resistive sheet with a silver border as sums of known functions of place.

The potential of a homogeneous sheet is harmonic ([5] Eq. (1)): it is told by harmonic polynomials
(Re and Im of z^n), or by what its border holds, as sines along each side that fade inwards. The
silver carries nearly all of the current, so that along a side every excitation falls off alike,
from one corner's potential to the next one's: what is uneven in it is the same for all. A sheet
that is not quite homogeneous adds terms |z|^2 z^n (Almansi's expansion), or products of sines that
are 0 on the border.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import Literal

import numpy as np
import numpy.typing as npt

from tactile_ros.types import Array

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

    Attributes
    ----------
    size : ndarray, shape (2,)
        Of the sheet, with corner A at the origin (m).
    kind : str
        'polynomials'; 'sides': each potential has its own sines along the sides; 'border': the
        sines of both are those of one silver border.
    corners : ndarray, shape (2, 4)
        Potentials of the corners A, B, C, D, from which 'border' knows how far a side falls.
    """

    size: Array
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
