# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Magnetised sheet on a soft layer: its field at rest, and how the field changes when dented.

A sheet is magnetised as in [1]: M1 along z; M2 along y; M3 and M4 along y in bands of changing
sign. At rest it has a closed form. A sheet that gives way is a carpet of dipoles that its body
carries and turns; what a movement u does to the field is a Taylor series in u, of which each term
is a product of a tensor of the chip and dipole with a power of u: as both depend on places alone,
one Fourier transform gives the answers to one dent at all places.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise, product
from math import factorial

import numpy as np

from tactile_ros.physics.magnetics import (
    SCALE,
    cuboid_field,
    dipole_field,
    each_dipole_field,
    magnet_moment,
)
from tactile_ros.types import Array, Integers

CELLS = 60  # of the sheet along its longer edge
LEVELS = 0.5 + np.array([-0.5, 0.5]) / np.sqrt(3)  # Gauss points of the sheet's thickness
NEAR_EDGE = 4  # rows of cells that have a weight of their own around an edge of a band
SLIVER = 1e-9  # m, narrower than which a band is none
ROUNDING = 1e-9
Exponents = tuple[int, int, int]


@dataclass(frozen=True)
class Sheet:
    """Magnetised sheet above chips, and its dipoles on a grid of cells on two levels."""

    size: Array  # (2,) along x and y (m); the centre is the origin
    low: float  # height of the lower face (m)
    thickness: float
    pole_pitch: float  # width of a band (m)
    magnetisation: str  # 'M1' to 'M4'
    strengths: Array  # (b,) remanence (T) of bands from -y to +y; the last holds for further ones
    shift: float = 0.0  # of the bands along y (m)
    uneven: Array | None = None  # (x, y) relative deviation of the remanence at the cells

    @property
    def pitch(self) -> float:
        """Edge of a cell (m)."""
        return float(np.max(self.size)) / CELLS

    @property
    def axis(self) -> int:
        """Axis of magnetisation."""
        return 2 if self.magnetisation == 'M1' else 1

    @property
    def levels(self) -> Array:
        """Heights of the dipoles (m), shape (2,)."""
        return np.asarray(self.low + self.thickness * LEVELS)

    @cached_property
    def lines(self) -> tuple[Array, Array]:
        """Centres of cells along x and y (m), on one grid that has its middle at the origin."""
        counts = np.maximum(np.rint(np.asarray(self.size) / self.pitch), 1).astype(int)
        x, y = (self.pitch * (np.arange(n) - (n - 1) / 2) for n in counts)
        return x, y

    @cached_property
    def bands(self) -> list[tuple[int, float, float, float]]:
        """Number, edges along y (m) and sign of each band."""
        half = self.size[1] / 2
        if self.magnetisation in ('M1', 'M2'):
            return [(0, -half, half, 1.0)]
        if self.magnetisation == 'M3':
            return [(0, -half, self.shift, -1.0), (1, self.shift, half, 1.0)]
        edges = np.arange(0.0, self.size[1] + 2 * self.pole_pitch, self.pole_pitch)
        edges = np.clip(edges - half + self.shift, -half, half)
        edges[0] = -half
        return [
            (min(i, len(self.strengths) - 1), low, high, 1.0 - 2.0 * (i % 2))
            for i, (low, high) in enumerate(pairwise(edges))
            if high - low > SLIVER
        ]

    @cached_property
    def shares(self) -> Array:
        """Weight of each row of cells in an integral over each band, with its sign (y, b)."""
        weights = np.zeros((len(self.lines[1]), len(self.strengths)))
        for band, low, high, sign in self.bands:
            weights[:, band] += sign * (self._up_to(high) - self._up_to(low))
        return weights

    def _up_to(self, edge: float) -> Array:
        """Weight of each row of cells in an integral from the sheet's end to an edge (m).

        Midpoints, but around the edge as integrates cubics: there what midpoints leave out does
        not cancel (Euler and Maclaurin).
        """
        line = self.lines[1]
        order = min(NEAR_EDGE, len(line))
        away = (edge - line[0]) / self.pitch
        first = int(np.clip(np.floor(away) - 1, 0, len(line) - order))
        weight = np.where(np.arange(len(line)) < first, 1.0, 0.0)
        weight[first : first + order] = _edge_weights(away - first, order)
        return weight

    @cached_property
    def band_moments(self) -> Array:
        """Moments of the dipoles (A m2), for a remanence of one in each band, (x y 2, b)."""
        even = np.ones(len(self.lines[0])) if self.uneven is None else 1 + self.uneven
        volume = self.pitch**2 * self.thickness / len(LEVELS)
        share = magnet_moment(1.0, volume) * self.shares
        wide = even[..., None] * share if even.ndim > 1 else even[:, None, None] * share
        return np.repeat(wide.reshape(-1, wide.shape[-1]), len(LEVELS), axis=0)

    @cached_property
    def each_moment(self) -> Array:
        """Moment of each dipole (A m2), shape (x y 2,)."""
        return np.asarray(self.band_moments @ self.strengths)

    @property
    def moments(self) -> Array:
        """Moment of a dipole in each cell (A m2), shape (x, y)."""
        x, y = self.lines
        return self.each_moment[:: len(LEVELS)].reshape(len(x), len(y))

    @cached_property
    def dipoles(self) -> tuple[Array, Array]:
        """Places (m) and moments (A m2), shape (x y 2, 3) each."""
        x, y = self.lines
        places = np.stack(np.meshgrid(x, y, self.levels, indexing='ij'), axis=-1).reshape(-1, 3)
        moments = np.zeros_like(places)
        moments[:, self.axis] = self.each_moment
        return places, moments

    def field(self, points: Array) -> Array:
        """Flux density at rest (T), shape (..., 3), at points (..., 3) (m)."""
        even = np.tensordot(self.strengths, self.band_fields(points), axes=1)
        if self.uneven is None:
            return np.asarray(even)
        # blocks are exact where a carpet is coarse; what is uneven along them is small
        more = np.zeros((*self.uneven.shape, len(LEVELS), 3))
        more[..., self.axis] = (self.moments * self.uneven / (1 + self.uneven))[..., None]
        flat = points.reshape(-1, 3)
        change = dipole_field(flat, self.dipoles[0], more.reshape(-1, 3))
        return np.asarray(even + change.reshape(points.shape))

    def band_fields(self, points: Array) -> Array:
        """Flux density at rest (1) for a remanence of one in each band, shape (b, ..., 3)."""
        fields = np.zeros((len(self.strengths), *points.shape))
        for band, low, high, sign in self.bands:
            centre = np.array([0.0, (low + high) / 2, self.low + self.thickness / 2])
            edges = np.array([self.size[0], high - low, self.thickness])
            fields[band] += cuboid_field(points - centre, edges, sign * np.eye(3)[self.axis])
        return fields

    def cell_fields(self, points: Array, rows: Integers) -> Array:
        """Flux density (t, 3, n) at points (t, 3) of some dipoles at rest, of moments of one."""
        unit = np.tile(np.eye(3)[self.axis], (len(rows), 1))
        field = each_dipole_field(points, self.dipoles[0][rows], unit)
        return np.stack(field, axis=1)

    def cell_changes(self, points: Array, rows: Integers, moved: Array, turned: Array) -> Array:
        """Change (t, 3, n) of the field at points by a dent, for dipoles of a moment of one.

        Movements (m) and small turns (rad) are of all dipoles, shape (x y 2, 3).
        """
        unit = np.eye(3)[self.axis]
        spun = unit + np.cross(turned[rows], unit)
        spun = spun + 0.5 * np.cross(turned[rows], spun - unit)
        after = each_dipole_field(points, self.dipoles[0][rows] + moved[rows], spun)
        return np.stack(after, axis=1) - self.cell_fields(points, rows)


def _edge_weights(edge: float, order: int) -> Array:
    """Weights (n,) of nodes 0, 1 ... of an integral to an edge, where midpoints count before."""
    m = np.arange(order)
    left = -0.5  # where the first node begins
    whole = (edge ** (m + 1) - left ** (m + 1)) / (m + 1)
    slope = m * left ** np.maximum(m - 1, 0)
    third = m * (m - 1) * (m - 2) * left ** np.maximum(m - 3, 0)
    wanted = whole + slope / 24 - 7 * third / 5760
    nodes = np.vander(m.astype(float), order, increasing=True)
    return np.asarray(np.linalg.solve(nodes.T, wanted))


def powers(order: int) -> list[Exponents]:
    """Exponents of all products of `order` components of a movement."""
    some = range(order + 1)
    return [(i, j, k) for i, j, k in product(some, some, some) if i + j + k == order]


def inverse_distance_series(r: Array, order: int) -> dict[Exponents, Array]:
    """Taylor coefficients (...) of 1 / |r| at r (..., 3) by exponents, up to an order.

    Notes
    -----
    Recurrence of Legendre's generating function in Cartesian form: n r^2 b_k + (2 n - 1) sum_i
    r_i b_(k - e_i) + (n - 1) sum_i b_(k - 2 e_i) = 0.

    Examples
    --------
    >>> series = inverse_distance_series(np.array([2.0, 0.0, 0.0]), 2)
    >>> [float(series[k]) for k in ((0, 0, 0), (1, 0, 0), (2, 0, 0), (0, 2, 0))]
    [0.5, -0.25, 0.125, -0.0625]
    """
    squared = (r * r).sum(axis=-1)
    series: dict[Exponents, Array] = {(0, 0, 0): 1 / np.sqrt(squared)}
    for n in range(1, order + 1):
        for k in powers(n):
            total = np.zeros_like(squared)
            for i in range(3):
                once = tuple(k[j] - (i == j) for j in range(3))
                twice = tuple(k[j] - 2 * (i == j) for j in range(3))
                if once in series:
                    total = total + (2 * n - 1) * r[..., i] * series[once]  # type: ignore[index]
                if twice in series:
                    total = total + (n - 1) * series[twice]  # type: ignore[index]
            series[k] = -total / (n * squared)
    return series


def moved_dipole_series(r: Array, moment: Array, axis: int, order: int) -> Array:
    """Terms (len(powers(order)), 3, ...) of a dipole's field by powers of its movement (T).

    From the dipole to the point is r (..., 3) (m); its moment, broadcast over (...), is along
    `axis` (A m2); `order` is the power of the movement.
    """
    series = inverse_distance_series(r, order + 2)
    unit = np.eye(3, dtype=int)
    rows = []
    for k in powers(order):
        row = []
        for i in range(3):
            beta = tuple(int(b) for b in np.array(k) + unit[i] + unit[axis])
            size = np.prod([factorial(b) / factorial(a) for a, b in zip(k, beta, strict=True)])
            row.append((-1) ** order * size * SCALE * moment * series[beta])  # type: ignore[index]
        rows.append(np.stack(row))
    return np.stack(rows)


def carpet(sheet: Sheet, pitch: float, levels: int = 1, points: int = 1) -> tuple[Array, Array]:
    """Places (m) and moments (A m2), (g, 3) each, of a carpet of dipoles of a sheet at rest.

    Parameters
    ----------
    pitch : float
        Of the carpet, about: no dipole stands for parts of two bands (m).
    levels, points : int
        Gauss points over the thickness, and along each side of a part of the pitch.
    """
    bands, low, high, signs = (np.array(part) for part in zip(*sheet.bands, strict=True))
    x, wide, _ = _nodes(-0.5 * sheet.size[:1], 0.5 * sheet.size[:1], pitch, points)
    y, width, owner = _nodes(low, high, pitch, points)
    z, share = np.polynomial.legendre.leggauss(levels)
    heights = sheet.low + sheet.thickness * (1 + z) / 2
    places = np.stack(np.meshgrid(x, y, heights, indexing='ij'), axis=-1)
    volume = (wide[:, None, None] * sheet.thickness) * width[:, None] * share / 2
    remanence = sheet.strengths[bands] * signs
    moment = magnet_moment(1.0, 1.0) * remanence[owner][:, None] * volume
    moments = np.broadcast_to(moment[..., None] * np.eye(3)[sheet.axis], places.shape)
    return places.reshape(-1, 3), moments.reshape(-1, 3)


def _nodes(low: Array, high: Array, pitch: float, points: int) -> tuple[Array, Array, Integers]:
    """Gauss points (n,) of parts about `pitch` wide of intervals (b,), their widths and owners."""
    # bands of one width have as many parts, however their edges round
    counts = np.maximum(np.floor((high - low) / pitch + 0.5 + ROUNDING), 1).astype(np.int64)
    owner = np.repeat(np.arange(len(counts)), counts)
    part = np.arange(len(owner)) - np.repeat(np.cumsum(counts) - counts, counts)
    wide = ((high - low) / counts)[owner]
    node, share = np.polynomial.legendre.leggauss(points)
    at = (low[owner] + (part + 0.5) * wide)[:, None] + 0.5 * wide[:, None] * node
    return at.reshape(-1), (0.5 * wide[:, None] * share).reshape(-1), np.repeat(owner, points)
