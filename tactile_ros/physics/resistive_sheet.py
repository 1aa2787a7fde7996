"""Potentials and resistances of a weakly conducting sheet with a well conducting border.

[5] Eq. (1): the potential of the sheet obeys Laplace's equation. Its missing equations are
R = Rx + Rv + RE and V = Vcc R0 / (R0 + R). The border is a line of its own conductance, as uneven
as silver paste is; the equations are solved directly, because iteration stalls at border ratios
of thousands. A curved panel that can be unrolled is a flat sheet with the outline of its
development: what conducts along the surface does not feel the bend.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.linalg import spsolve
from scipy.spatial import Delaunay

from tactile_ros.physics.coverage import inside
from tactile_ros.types import Array, Integers

EQUAL_AREA = 0.59  # radius of the disc of equal outer conductance, over the edge of a square
LEAST_LOG = float(np.log(1.05))
MOST_WIDTHS = 30.0  # beyond which the far side of a sheet does not count
NEAREST = 1e-3  # of the edge: no touch counts as nearer to the border
CLEAR = 0.6  # of the step: grid points that near to the border are left out
THIN = 1e-6  # area of a triangle, over the step squared, below which it is none


def linear_place(potentials: Array, size: Array) -> Array:
    """Place (..., 2) (m from electrode A) at which ideal linear potentials have given values.

    `potentials` (..., 2) are u_AC (1 at A) and u_BD (1 at B), fractions of the supply; `size` (2,)
    is that of the sheet (m). [5] section 2.2.

    Examples
    --------
    >>> linear_place(np.array([0.5, 0.75]), np.array([0.1, 0.1])).round(3).tolist()
    [0.075, 0.025]
    """
    mean, turn = 1.0 - potentials[..., 0], potentials[..., 1] - 0.5
    return np.asarray(np.stack([mean + turn, mean - turn], axis=-1) * size)


@dataclass(frozen=True)
class SeriesResistance:
    """Rx from a touch to the joined corners over a border that conducts perfectly, over R0.

    It falls so steeply near the border that no sum of a few cosines tells it.

    Attributes
    ----------
    size : ndarray, shape (2,)
        Of the sheet (m).
    touch : float
        Edge of a square touch (m).
    sheet : float
        Sheet resistance over R0 of the divider (1 per square); 0: no Rx.

    Notes
    -----
    Sheet / 2 pi times the logarithm of the conformal radius over the touch's own. The radius is
    that of a strip as wide as the sheet is short, times what the sources beyond the other two
    sides make of it that keep those at one potential; the six nearest count.
    """

    size: Array
    touch: float
    sheet: float

    def at(self, places: Array) -> Array:
        """Rx over R0 (s,) at places (s, 2) inside the sheet, in units of its edges."""
        share = np.fmin(np.fmax(places, NEAREST), 1.0 - NEAREST)
        along, far, strip, factor = self.law
        long = int(along)
        across = np.sin(np.pi * share[:, 1 - long])
        across *= across
        near = far * share[:, long]
        square = across * (1.0 + across / np.sinh(far) ** 2) ** 2
        for away in (near, far - near, far + near, 2.0 * far - near):
            square /= 1.0 + across / np.sinh(away) ** 2
        return np.asarray(np.fmax(strip + 0.5 * np.log(square), LEAST_LOG) * factor)

    def scaled(self, share: float) -> SeriesResistance:
        """Of a sheet with a share of the resistance."""
        return replace(self, sheet=share * self.sheet)

    @cached_property
    def law(self) -> Array:
        """Which axis is longer, pi times its length in widths, the strip's radius, factor (4,)."""
        long = int(self.size[1] > self.size[0])
        width = self.size[1 - long]
        far = np.pi * min(self.size[long] / width, MOST_WIDTHS)
        strip = np.log(2 * width / np.pi / (EQUAL_AREA * self.touch))
        return np.array([long, far, strip, self.sheet / (2 * np.pi)])


def touch_edge(film: Array, force: Array, edge: float, at_one: float, exponent: float) -> Array:
    """Edge (s,) (m) of a square touch whose force is known from elsewhere.

    Parameters
    ----------
    film : ndarray, shape (s,)
        Resistance of the film alone, R - Rx (ohm).
    force : ndarray, shape (s,)
        Normal force (N).
    edge : float
        Edge of the touches that the film was calibrated with (m).
    at_one, exponent : float
        Of their law: at_one force ** -exponent (ohm); NaN is returned for an exponent of 1, with
        which the size does not show.

    Notes
    -----
    The three readings alone do not give the size: two give the place, because the mean of a
    harmonic potential over a disc is its value in the middle ([5] Eq. (1)), and the third is of
    force and size at once. With pressure F / A under a film of resistivity ~ pressure ** -b the
    film has at_one F ** -b (A / A0) ** (b - 1).

    Examples
    --------
    >>> film = 2000 * 8.0**-0.7 * (0.01 / 0.015) ** (2 * (0.7 - 1))
    >>> touch_edge(np.array([film]), np.array([8.0]), 0.015, 2000.0, 0.7).round(6).tolist()
    [0.01]
    """
    if exponent == 1.0:
        return np.full(np.shape(film), np.nan)
    ratio = film / (at_one * force**-exponent)
    return np.asarray(edge * ratio ** (0.5 / (exponent - 1.0)))


def network_potential(
    first: Integers, second: Integers, weight: Array, count: int, held: Integers, level: Array
) -> Array:
    """Potentials (n,) of nodes joined by links of a conductance, some of them held at a level."""
    row = np.concatenate([first, second, first, second])
    column = np.concatenate([second, first, first, second])
    value = np.concatenate([-weight, -weight, weight, weight])
    matrix = coo_matrix((value, (row, column)), shape=(count, count)).tocsc()
    potential = np.zeros(count)
    potential[held] = level
    free = np.setdiff1d(np.arange(count), held)
    current = -(matrix[free][:, held] @ potential[held])
    potential[free] = spsolve(matrix[free][:, free], current)
    return potential


@dataclass(frozen=True)
class OutlineMesh:
    """Triangles inside an outline, which carry a sheet; the first points lie along it.

    Attributes
    ----------
    points : ndarray, shape (n, 2)
        Places (m).
    triangles : ndarray of int, shape (m, 3)
        Corners.
    border : int
        Number of points along the outline.
    """

    points: Array
    triangles: Integers
    border: int

    @classmethod
    def of(cls, outline: Array, step: float) -> OutlineMesh:
        """Triangles about `step` (m) large inside a convex or gently bent loop (k, 2) (m).

        The outline's own corners are points of the mesh.
        """
        ahead = np.roll(outline, -1, axis=0)
        edges = []
        for a, b in zip(outline, ahead, strict=True):
            count = max(int(np.ceil(np.linalg.norm(b - a) / step)), 1)
            edges.append(a + (b - a) * (np.arange(count) / count)[:, None])
        border = np.concatenate(edges)
        low, high = outline.min(axis=0), outline.max(axis=0)
        axes = [np.arange(a + step / 2, b, step) for a, b in zip(low, high, strict=True)]
        grid = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
        apart = np.linalg.norm(grid[:, None] - border, axis=2).min(axis=1)
        inner = grid[inside([outline], grid) & (apart > CLEAR * step)]
        points = np.concatenate([border, inner])
        triangles = np.asarray(Delaunay(points).simplices, np.int64)
        a, b, c = points[triangles].transpose(1, 0, 2)
        area = 0.5 * np.abs(_cross(b - a, c - a))
        kept = inside([outline], (a + b + c) / 3) & (area > THIN * step**2)
        return cls(points, triangles[kept], len(border))

    def nearest(self, places: Array) -> Integers:
        """Points of the border (k,) that are nearest to places (k, 2)."""
        apart = np.linalg.norm(self.points[None, : self.border] - places[:, None], axis=2)
        return np.asarray(apart.argmin(axis=1), np.int64)

    def potential(self, border: Array, held: Integers, level: Array) -> Array:
        """Potential of the whole sheet with some points of its border held.

        Parameters
        ----------
        border : ndarray, shape (n,)
            Conductance of the border lines times length over the sheet conductance (m), of the
            link that leaves each border point.
        held : ndarray of int, shape (k,)
            Points that are held.
        level : ndarray, shape (k,)
            Their potentials (fractions of the supply). Two opposite corners are one of [5]'s
            excitations, three make a three-phase one.

        Returns
        -------
        ndarray, shape (n,)
            At the points (fraction of the supply).

        Raises
        ------
        ValueError
            If no point is held.
        """
        if not len(held):
            msg = 'held of potential must name at least one point; received none'
            raise ValueError(msg)
        return network_potential(*self._links(border), len(self.points), held, level)

    def _links(self, border: Array) -> tuple[Integers, Integers, Array]:
        """Both ends of every link, and its conductance over the sheet: cotangents, and silver."""
        first, second, weight = [], [], []
        for i in range(3):
            own, a, b = (self.triangles[:, (i + k) % 3] for k in range(3))
            to_a, to_b = self.points[a] - self.points[own], self.points[b] - self.points[own]
            first.append(a)
            second.append(b)
            weight.append(0.5 * (to_a * to_b).sum(axis=1) / np.abs(_cross(to_a, to_b)))
        along = np.arange(self.border)
        ahead = np.roll(along, -1)
        length = np.linalg.norm(self.points[ahead] - self.points[along], axis=1)
        return (
            np.concatenate([*first, along]),
            np.concatenate([*second, ahead]),
            np.concatenate([*weight, border / length]),
        )


def unrolled(places: Array, radius: float) -> Array:
    """Flat places (s, 2) of places (s, 3) on a cylinder of a radius (m) about the y axis.

    The top of the cylinder, at z = 0, is x = 0; z falls to both sides.

    Examples
    --------
    >>> unrolled(np.array([[0.2, 0.05, -0.2]]), 0.2).round(4).tolist()
    [[0.3142, 0.05]]
    """
    x, y, z = places.T
    return np.stack([radius * np.arctan2(x, radius + z), y], axis=1)


def rolled(places: Array, radius: float) -> Array:
    """Places (s, 3) on a cylinder of a radius (m) of flat places (s, 2); undoes `unrolled`."""
    x, y = places.T
    turn = x / radius
    return np.stack([radius * np.sin(turn), y, radius * (np.cos(turn) - 1)], axis=1)


def _cross(a: Array, b: Array) -> Array:
    """Products (s,) of two sets of vectors in the plane."""
    return np.asarray(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
