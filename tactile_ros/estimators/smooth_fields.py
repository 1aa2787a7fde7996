"""Smooth fields over a sheet as sums of cosines, with a prior on their size and smoothness.

A Gaussian process of reduced rank (Solin and Sarkka, Statistics and Computing 30, 2020): cosines
over a box wider than the sheet, whose prior spreads follow the spectrum of a Matern kernel. How
many cosines serve is told by how densely the sheet was touched.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactile_ros.types import Array, Integers

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
