# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Potentials of resistive sheets with an uneven border, solved on a grid or on triangles.

The border is a line of its own conductance, as uneven as silver paste is; the equations are
solved directly, because iteration stalls at border ratios of thousands.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_matrix, csc_matrix
from scipy.sparse.linalg import spsolve
from scipy.spatial import Delaunay

from tactile_ros.physics.coverage import inside
from tactile_ros.types import Array, Integers

CLEAR = 0.6  # of the step: grid points that near to the border are left out
THIN = 1e-6  # area of a triangle, over the step squared, below which it is none


def sheet_potential(size: Array, shape: tuple[int, int], border: Array, corners: Array) -> Array:
    """Potential of the whole sheet with some corners held.

    Parameters
    ----------
    size : ndarray, shape (2,)
        Of the sheet (m).
    shape : tuple of int
        Nodes along x and along y.
    border : ndarray, shape (4, n)
        Conductance of the border lines times length over the sheet conductance (m), along AB, BC,
        DC and AD, evenly spaced; a border of width w and ratio q has q w.
    corners : ndarray, shape (4,)
        Potentials held at A, B, C, D (fractions of the supply); NaN: left free. Two opposite
        corners are one of [5]'s excitations, three make a third one.

    Returns
    -------
    ndarray, shape (nx, ny)
        Potential at the nodes (fraction of the supply).

    Raises
    ------
    ValueError
        If no corner is held.
    """
    held = np.isfinite(corners)
    if not held.any():
        msg = 'corners of sheet_potential must hold at least one potential; received none'
        raise ValueError(msg)
    ends = _grid_links(size, shape, border)
    number = np.arange(shape[0] * shape[1]).reshape(shape)
    fixed = np.array([number[0, 0], number[-1, 0], number[-1, -1], number[0, -1]])[held]
    return network_potential(*ends, number.size, fixed, corners[held]).reshape(shape)


def _grid_links(
    size: Array, shape: tuple[int, int], border: Array
) -> tuple[Integers, Integers, Array]:
    """Both ends of every link between neighbouring nodes, and its conductance over the sheet's."""
    nx, ny = shape
    step = size / (np.array(shape) - 1)
    number = np.arange(nx * ny).reshape(shape)
    along_x = np.full((nx - 1, ny), step[1] / step[0])
    along_y = np.full((nx, ny - 1), step[0] / step[1])
    # a link on the edge has sheet on one of its sides only
    along_x[:, [0, -1]] *= 0.5
    along_y[[0, -1]] *= 0.5
    knots = (np.arange(border.shape[1]) + 0.5) / border.shape[1]
    for side, column in ((0, 0), (2, -1)):
        middle = (np.arange(nx - 1) + 0.5) / (nx - 1)
        along_x[:, column] += np.interp(middle, knots, border[side]) / step[0]
    for side, row in ((3, 0), (1, -1)):
        middle = (np.arange(ny - 1) + 0.5) / (ny - 1)
        along_y[row] += np.interp(middle, knots, border[side]) / step[1]
    first = np.concatenate([number[:-1].ravel(), number[:, :-1].ravel()])
    second = np.concatenate([number[1:].ravel(), number[:, 1:].ravel()])
    return first, second, np.concatenate([along_x.ravel(), along_y.ravel()])


def network_potential(
    first: Integers, second: Integers, weight: Array, count: int, held: Integers, level: Array
) -> Array:
    """Potentials (n,) of nodes joined by links of a conductance, some of them held at a level."""
    matrix = network_matrix(first, second, weight, count)
    potential = np.zeros(count)
    potential[held] = level
    free = np.setdiff1d(np.arange(count), held)
    current = -(matrix[free][:, held] @ potential[held])
    potential[free] = spsolve(matrix[free][:, free], current)
    return potential


def network_matrix(first: Integers, second: Integers, weight: Array, count: int) -> csc_matrix:
    """Currents (n, n) into nodes joined by links of a conductance, by their potentials."""
    row = np.concatenate([first, second, first, second])
    column = np.concatenate([second, first, first, second])
    value = np.concatenate([-weight, -weight, weight, weight])
    return coo_matrix((value, (row, column)), shape=(count, count)).tocsc()


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


def _cross(a: Array, b: Array) -> Array:
    """Products (s,) of two sets of vectors in the plane."""
    return np.asarray(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
