"""A magnetised sheet with bands of alternating poles: as a carpet of dipoles, or its harmonics.

A sheet that gives way is a carpet of dipoles that its body carries. Far from its edges an
alternating sheet is a sum of odd harmonics, each of which fades with the distance over its own
length (Halbach, Nucl. Instrum. Methods 169, 1980): one cosine soon is enough. At rest it has a
closed form, `magnetic_sheet`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise, product
from math import factorial
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from tactile_ros.physics.magnetics import SCALE, cuboid_field, dipole_field, magnet_moment

if TYPE_CHECKING:
    from tactile_ros.types import Array

CELLS = 60  # of the sheet along its longer edge
LEVELS = 0.5 + np.array([-0.5, 0.5]) / np.sqrt(3)  # Gauss points of the sheet's thickness
ORDERS = (1, 2, 3)
STILL = 0.001  # of the largest movement: dipoles that hardly move are left out
NEAR_EDGE = 4  # rows of cells that have a weight of their own around an edge of a band
SLIVER = 1e-9  # m, narrower than which a band is none


@dataclass(frozen=True)
class Sheet:
    """A magnetised sheet above chips.

    Attributes
    ----------
    size : ndarray, shape (2,)
        Along x and y (m); its centre is the origin.
    low, thickness : float
        Height of its lower face, and its thickness (m).
    pole_pitch : float
        Width of a band (m).
    magnetisation : str
        'M1' to 'M4'.
    strengths : ndarray, shape (b,)
        Remanence (T) of bands from -y to +y; the last one holds for those beyond.
    shift : float
        Of the bands along y (m).
    """

    size: Array
    low: float
    thickness: float
    pole_pitch: float
    magnetisation: str
    strengths: Array
    shift: float = 0.0

    @property
    def pitch(self) -> float:
        """Edge of a cell (m)."""
        return float(np.max(self.size)) / CELLS

    @cached_property
    def lines(self) -> tuple[Array, Array]:
        """Centres of cells along x and y (m), on one grid that has its middle at the origin."""
        counts = np.maximum(np.rint(np.asarray(self.size) / self.pitch), 1).astype(int)
        x, y = (self.pitch * (np.arange(n) - (n - 1) / 2) for n in counts)
        return x, y

    @property
    def levels(self) -> Array:
        """Heights of the dipoles (m), shape (2,)."""
        return np.asarray(self.low + self.thickness * LEVELS)

    @cached_property
    def remanence(self) -> Array:
        """Remanence along the direction of magnetisation in each row of cells (T), shape (y,)."""
        return np.asarray(self.shares @ self.strengths)

    @cached_property
    def shares(self) -> Array:
        """Weight of each row of cells in an integral over each band, with its sign (y, b)."""
        found = np.zeros((len(self.lines[1]), len(self.strengths)))
        for band, low, high, sign in self.bands:
            found[:, band] += sign * (self._up_to(high) - self._up_to(low))
        return found

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

    @property
    def axis(self) -> int:
        """Axis of magnetisation."""
        return 2 if self.magnetisation == 'M1' else 1

    @cached_property
    def moments(self) -> Array:
        """Moment of a dipole in each row of cells (A m2), shape (y,)."""
        volume = self.pitch**2 * self.thickness / len(LEVELS)
        return np.array([magnet_moment(r, volume) for r in self.remanence])

    @cached_property
    def dipoles(self) -> tuple[Array, Array]:
        """Places (m) and moments (A m2), shape (x y 2, 3) each."""
        x, y = self.lines
        places = np.stack(np.meshgrid(x, y, self.levels, indexing='ij'), axis=-1)
        moments = np.zeros_like(places)
        moments[..., self.axis] = self.moments[None, :, None]
        return places.reshape(-1, 3), moments.reshape(-1, 3)

    def field(self, points: Array) -> Array:
        """Flux density at rest (T), shape (..., 3), at points (..., 3) (m)."""
        return np.asarray(np.tensordot(self.strengths, self.band_fields(points), axes=1))

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

    def band_fields(self, points: Array) -> Array:
        """Flux density at rest (1) for a remanence of one in each band, shape (b, ..., 3)."""
        found = np.zeros((len(self.strengths), *points.shape))
        for band, low, high, sign in self.bands:
            centre = np.array([0.0, (low + high) / 2, self.low + self.thickness / 2])
            edges = np.array([self.size[0], high - low, self.thickness])
            found[band] += cuboid_field(points - centre, edges, sign * np.eye(3)[self.axis])
        return found

    def dented(self, points: Array, moved: Array, turned: Array) -> Array:
        """Flux density (T), shape (t, 3), where a body has carried the dipoles.

        Parameters
        ----------
        points : ndarray, shape (t, 3)
            Where it is wanted (m).
        moved, turned : ndarray, shape (x y 2, 3)
            Movements (m) and small turns (rad) of the dipoles.
        """
        places, moments = self.dipoles
        return dipole_field(points, places + moved, moments + np.cross(turned, moments))

    def band_changes(self, points: Array, moved: Array, turned: Array) -> Array:
        """Change of the field by a dent for a remanence of one in each band, shape (b, t, 3).

        Parameters
        ----------
        points : ndarray, shape (t, 3)
            Where it is wanted (m).
        moved, turned : ndarray, shape (x y 2, 3)
            Movements (m) and small turns (rad) of the dipoles.
        """
        size = np.abs(moved).max(axis=1)
        rows = np.flatnonzero(size > STILL * size.max())
        places = self.dipoles[0][rows]
        unit = np.eye(3)[self.axis]
        spun = unit + np.cross(turned[rows], unit)
        spun = spun + 0.5 * np.cross(turned[rows], spun - unit)
        volume = self.pitch**2 * self.thickness / len(LEVELS)
        y = rows // len(LEVELS) % len(self.lines[1])
        share = magnet_moment(1.0, volume) * self.shares[y]
        after = each_dipole_field(points, places + moved[rows], spun)
        change = after - each_dipole_field(points, places, np.broadcast_to(unit, places.shape))
        return np.moveaxis(np.tensordot(change, share, axes=(1, 0)), -1, 0)


def _edge_weights(edge: float, order: int) -> Array:
    """Weights (n,) of nodes 0, 1 ... of an integral to an edge, where midpoints count before."""
    m = np.arange(order)
    left = -0.5  # where the first node begins
    whole = (edge ** (m + 1) - left ** (m + 1)) / (m + 1)
    slope = m * left ** np.maximum(m - 1, 0)
    third = m * (m - 1) * (m - 2) * left ** np.maximum(m - 3, 0)
    wanted = whole + slope / 24 - 7 * third / 5760
    return np.asarray(
        np.linalg.solve(np.vander(m.astype(float), order, increasing=True).T, wanted)
    )


def each_dipole_field(points: Array, places: Array, moments: Array) -> Array:
    """Field of each dipole (m, 3) (A m2) at points (t, 3) (m), shape (t, m, 3) (T)."""
    x, y, z = (points[:, i, None] - places[:, i] for i in range(3))
    squared = x * x + y * y + z * z
    near = SCALE / (squared * np.sqrt(squared))
    along = 3 * (x * moments[:, 0] + y * moments[:, 1] + z * moments[:, 2]) / squared
    each = [near * (along * r - moments[:, i]) for i, r in enumerate((x, y, z))]
    return np.stack(each, axis=-1)


def powers(order: int) -> list[tuple[int, int, int]]:
    """Exponents of all products of `order` components of a movement."""
    some = range(order + 1)
    return [(i, j, k) for i, j, k in product(some, some, some) if i + j + k == order]


def inverse_distance_series(r: Array, order: int) -> dict[tuple[int, int, int], Array]:
    """Taylor coefficients of 1 / |r| by exponents, up to an order.

    Parameters
    ----------
    r : ndarray, shape (..., 3)
        Where the series is taken; not 0.
    order : int
        Highest sum of exponents.

    Returns
    -------
    dict of tuple to ndarray, shape (...)
        Derivatives over factorials.

    Notes
    -----
    Recurrence of Legendre's generating function in Cartesian form: n r^2 b_k + (2 n - 1) sum_i
    r_i b_(k - e_i) + (n - 1) sum_i b_(k - 2 e_i) = 0.

    Examples
    --------
    >>> found = inverse_distance_series(np.array([2.0, 0.0, 0.0]), 2)
    >>> [float(found[k]) for k in ((0, 0, 0), (1, 0, 0), (2, 0, 0), (0, 2, 0))]
    [0.5, -0.25, 0.125, -0.0625]
    """
    squared = (r * r).sum(axis=-1)
    found = {(0, 0, 0): 1 / np.sqrt(squared)}
    for n in range(1, order + 1):
        for k in powers(n):
            total = np.zeros_like(squared)
            for i in range(3):
                once = tuple(k[j] - (i == j) for j in range(3))
                twice = tuple(k[j] - 2 * (i == j) for j in range(3))
                if once in found:
                    total = total + (2 * n - 1) * r[..., i] * found[once]  # type: ignore[index]
                if twice in found:
                    total = total + (n - 1) * found[twice]  # type: ignore[index]
            found[k] = -total / (n * squared)
    return found


def moved_dipole_series(r: Array, moment: Array, axis: int, order: int) -> Array:
    """Terms of a dipole's field by powers of its movement.

    Parameters
    ----------
    r : ndarray, shape (..., 3)
        From the dipole to the point (m).
    moment : ndarray, broadcast over (...)
        Along `axis` (A m2).
    axis, order : int
        Direction of the moment; power of the movement.

    Returns
    -------
    ndarray, shape (len(powers(order)), 3, ...)
        Times the products of the movement's components: flux density (T).
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


ROUNDING = 1e-9


def carpet(sheet: Sheet, pitch: float, levels: int = 1, points: int = 1) -> tuple[Array, Array]:
    """Places (m) and moments (A m2), (g, 3) each, of a carpet of dipoles.

    Parameters
    ----------
    sheet : Sheet
        At rest.
    pitch : float
        Of the carpet, about: no dipole stands for parts of two bands (m).
    levels : int
        Of dipoles over the thickness, at Gauss points.
    points : int
        Gauss points along each side of a part of the pitch.
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


def harmonics(sheet: Sheet, points: Array, count: int) -> Array:
    """Field (..., 3) (T) of an M4 without edges, all bands of which are as strong as the first.

    Parameters
    ----------
    sheet : Sheet
        At rest.
    points : ndarray, shape (..., 3)
        Outside of the sheet (m).
    count : int
        Odd harmonics: 1, 3, 5 and so on.
    """
    half = sheet.thickness / 2
    phase = points[..., 1] + sheet.size[1] / 2
    above = points[..., 2] - sheet.low - half
    field = np.zeros(np.shape(points))
    for n in 2 * np.arange(count) + 1:
        k = n * np.pi / sheet.pole_pitch
        strength = 4 * sheet.strengths[0] / (n * np.pi) * np.sinh(k * half)
        strength = strength * np.exp(-k * np.abs(above))
        field[..., 1] -= strength * np.sin(k * phase)
        field[..., 2] -= np.sign(above) * strength * np.cos(k * phase)
    return field


def _middles(low: Array, high: Array, pitch: float) -> tuple[Array, npt.NDArray[np.int64]]:
    """Middles (n,) of equal parts, about `pitch` wide, of intervals (b,), and whose each is."""
    # bands of one width have as many parts, however their edges round
    counts = np.maximum(np.floor((high - low) / pitch + 0.5 + ROUNDING), 1).astype(np.int64)
    owner = np.repeat(np.arange(len(counts)), counts)
    part = np.arange(len(owner)) - np.repeat(np.cumsum(counts) - counts, counts)
    return low[owner] + (part + 0.5) * ((high - low) / counts)[owner], owner


def _nodes(
    low: Array, high: Array, pitch: float, points: int
) -> tuple[Array, Array, npt.NDArray[np.int64]]:
    """Gauss points (n,) of the parts of `_middles`, how wide each counts, and whose it is."""
    middle, owner = _middles(low, high, pitch)
    wide = (high - low)[owner] / np.bincount(owner)[owner]
    node, share = np.polynomial.legendre.leggauss(points)
    at = (middle[:, None] + 0.5 * wide[:, None] * node).reshape(-1)
    return at, (0.5 * wide[:, None] * share).reshape(-1), np.repeat(owner, points)


def carried_field(points: Array, places: Array, moments: Array, moved: Array) -> Array:
    """Field (t, 3) (T) at points (t, 3) of dipoles (g, 3) that a body has moved by (g, 3) (m)."""
    return dipole_field(points, places + moved, moments)
