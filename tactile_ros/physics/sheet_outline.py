"""Potential of a weakly conducting sheet of any outline, by finite elements.

A curved panel that can be unrolled is a flat sheet with the outline of its development: what
conducts along the surface does not feel the bend. Linear triangles carry the sheet, straight
links its border; the equations are solved directly, because iteration stalls at border ratios of
thousands.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.linalg import spsolve
from scipy.spatial import Delaunay

from tactile_ros.types import Array, Bools, Integers

CLEAR = 0.6  # of the step: grid points that near to the border are left out
THIN = 1e-6  # area of a triangle, over the step squared, below which it is none


@dataclass(frozen=True)
class OutlineMesh:
    """Triangles inside an outline; the first points lie along it.

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
        inner = grid[within(grid, outline) & (apart > CLEAR * step)]
        points = np.concatenate([border, inner])
        triangles = np.asarray(Delaunay(points).simplices, np.int64)
        a, b, c = points[triangles].transpose(1, 0, 2)
        area = 0.5 * np.abs(_cross(b - a, c - a))
        kept = within((a + b + c) / 3, outline) & (area > THIN * step**2)
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
        first, second, weight = self._links(border)
        ends = np.concatenate([first, second, first, second])
        others = np.concatenate([second, first, first, second])
        value = np.concatenate([-weight, -weight, weight, weight])
        count = len(self.points)
        matrix = coo_matrix((value, (ends, others)), shape=(count, count)).tocsc()
        found = np.zeros(count)
        found[held] = level
        free = np.setdiff1d(np.arange(count), held)
        found[free] = spsolve(matrix[free][:, free], -(matrix[free][:, held] @ found[held]))
        return found

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


def within(places: Array, outline: Array) -> Bools:
    """Whether places (s, 2) lie inside a loop (k, 2): an odd number of edges to their right.

    Examples
    --------
    >>> square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    >>> within(np.array([[0.5, 0.5], [1.5, 0.5]]), square).tolist()
    [True, False]
    """
    x, y = places.T[:, :, None]
    (ax, ay), (bx, by) = outline.T, np.roll(outline, -1, axis=0).T
    spans = (ay > y) != (by > y)
    rise = np.where(by == ay, 1.0, by - ay)
    crossing = ax + (y - ay) / rise * (bx - ax)
    return np.asarray((spans & (x < crossing)).sum(axis=1) % 2 == 1)


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
