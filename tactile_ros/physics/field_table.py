# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Field of a disc from a table over its half plane: a thousandth of the exact field's price.

Near the disc a dipole errs by milliteslas; a table of the exact field with cubic interpolation
errs by less than a hundredth of a microtesla. Its rows are squares of the distance from the axis,
in which the field is smooth at the axis, and its columns heights.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from tactile_ros.physics.fidelity import CUBIC_COST, LINEAR_COST, Model
from tactile_ros.physics.magnetics import Disc, axial_cylinder, on_pixels, tilt_rotation
from tactile_ros.types import Array, Integers

ROWS, COLUMNS = 128, 96
SHAPES = (
    (13, 9), (25, 17), (37, 25), (49, 33), (73, 49), (97, 65), (128, 96), (161, 113), (193, 129),
    (257, 193),
)  # fmt: skip


def cubic_weights(position: Array, count: int) -> tuple[Integers, Array, Array]:
    """First of four nodes (...), Lagrange's weights (4, ...) and their slopes over a step.

    `position` (...) is in steps from the first of `count` nodes, four at least; polynomials of
    the third degree come back exactly, and near an edge the last four nodes are taken.
    """
    first = np.clip(np.floor(position).astype(np.int64) - 1, 0, count - 4)
    u = position - first - 1
    a, b, c = u + 1, u - 1, u - 2
    weights = np.stack([-u * b * c / 6, a * b * c / 2, -a * u * c / 2, a * u * b / 6])
    slopes = np.stack([
        -(b * c + u * c + u * b) / 6, (b * c + a * c + a * b) / 2,
        -(u * c + a * c + a * u) / 2, (u * b + a * b + a * u) / 6,
    ])  # fmt: skip
    return first, weights, slopes


def linear_weights(position: Array, count: int) -> tuple[Integers, Array, Array]:
    """First of two nodes, their weights and slopes (2, ...); see `cubic_weights`."""
    first = np.clip(np.floor(position).astype(np.int64), 0, count - 2)
    u = position - first
    one = np.ones_like(u)
    return first, np.stack([1 - u, u]), np.stack([-one, one])


def reach_under(pixels: Array, gap: float, height: float) -> tuple[float, float, float]:
    """Reach of a table for an inversion: 0.1 to 1.8 gaps over pixels (t, 3), 1.2 to any side.

    `gap` is from the pixels to the near face of the disc at rest, `height` that of the disc (m).
    """
    wide = float(np.hypot(*np.abs(pixels[:, :2]).max(axis=0)) + 1.2 * gap)
    low = float(pixels[:, 2].max())
    return wide, 0.1 * gap - low + height / 2, 1.8 * gap - low + height / 2


def table_reach(pixels: Array, states: Array) -> tuple[float, float, float]:
    """Reach of a table that holds discs at states (s, 5) over pixels (t, 3), with some room."""
    turn = tilt_rotation(states[:, 3:])
    own = np.einsum('sji,stj->sti', turn, pixels[None] - states[:, None, :3])
    depth = -own[..., 2]
    room = 0.05 * float(np.ptp(depth))
    far = 1.05 * float(np.hypot(own[..., 0], own[..., 1]).max())
    return far, float(depth.min()) - room, float(depth.max()) + room


def disc_table(
    diameter: float,
    height: float,
    reach: tuple[float, float, float],
    shape: tuple[int, int] = (ROWS, COLUMNS),
) -> tuple[Array, Array]:
    """Tabulate the field below a disc of remanence 1 T.

    Parameters
    ----------
    diameter, height : float
        Of the disc (m).
    reach : tuple of float
        Largest distance from the axis, least and largest depth under the disc's centre (m).
    shape : tuple of int
        Rows (5 at least) and columns (4 at least).

    Returns
    -------
    table : ndarray, shape (rows, columns, 2)
        Radial field over the distance (T / m), and axial field (T).
    grid : ndarray, shape (4,)
        Step of the squares (m2), first depth, step of depths (m); the last is their number.
    """
    farthest, least, most = reach
    rows, columns = shape
    step, rise = farthest**2 / (rows - 3), (most - least) / (columns - 1)
    # squares begin one step below 0, where the field is that of the mirrored side
    squares = step * np.arange(-1.0, rows - 1)
    depth = least + rise * np.arange(columns)
    rho = np.sqrt(np.maximum(squares, 1e-6 * step))[:, None] * np.ones(columns)
    radial, axial = axial_cylinder(rho, -depth * np.ones_like(rho), diameter, height)
    table = np.stack([radial / rho, axial], axis=-1)
    # even in the distance is smooth in its square: the row below 0 continues the next three
    table[0] = 4 * table[1] - 6 * table[2] + 4 * table[3] - table[4]
    return table, np.array([step, least, rise, float(columns)])


def table_field(own: Array, table: Array, grid: Array, degree: int = 3) -> tuple[Array, Array]:
    """Field of a disc of 1 T in its own axes, and how it changes with the place.

    Parameters
    ----------
    own : ndarray, shape (n, 3)
        Points under the disc, from its centre (m).
    table, grid : ndarray
        Of `disc_table`.
    degree : int
        Of the interpolation: 3, or 1 for the rule of four nodes, which is coarser.

    Returns
    -------
    field : ndarray, shape (n, 3)
        (T).
    slope : ndarray, shape (n, 3, 3)
        d field[i] / d own[j] (T / m).
    """
    step, least, rise, _ = grid
    x, y = own[:, 0], own[:, 1]
    weigh = cubic_weights if degree == 3 else linear_weights
    i, wi, si = weigh((x * x + y * y) / step + 1, table.shape[0])
    j, wj, sj = weigh((-own[:, 2] - least) / rise, table.shape[1])
    nodes = np.arange(len(wi))
    near = table[i[:, None, None] + nodes[:, None], j[:, None, None] + nodes]
    rows = np.einsum('nabk,bn->ank', near, wj)
    f, g = np.einsum('ank,an->kn', rows, wi)
    fs, gs = np.einsum('ank,an->kn', rows, si) * (2 / step)
    fz, gz = np.einsum('nabk,bn,an->kn', near, sj, wi) / -rise
    field = np.stack([f * x, f * y, g], axis=1)
    slope = np.empty((len(own), 3, 3))
    slope[:, 0, 0], slope[:, 1, 1] = f + x * x * fs, f + y * y * fs
    slope[:, 0, 1] = slope[:, 1, 0] = x * y * fs
    slope[:, 0, 2], slope[:, 1, 2] = x * fz, y * fz
    slope[:, 2, 0], slope[:, 2, 1], slope[:, 2, 2] = x * gs, y * gs, gz
    return field, slope


def table_disc_model(
    pixels: Array,
    disc: Disc,
    reach: tuple[float, float, float],
    shape: tuple[int, int],
    degree: int = 3,
) -> Model:
    """Table of a shape, linear or cubic (degree 3), at pixels (t, 3); built when first needed."""
    diameter, height, remanence = disc
    kind, cost = ('cubic', CUBIC_COST) if degree == 3 else ('linear', LINEAR_COST)

    @cache
    def built() -> tuple[Array, Array]:
        return disc_table(diameter, height, reach, shape)

    def field(own: Array) -> Array:
        return remanence * table_field(own, *built(), degree)[0]

    name = f'{kind} table {shape[0]} x {shape[1]}'
    numbers = 2 * shape[0] * shape[1]
    return Model(name, on_pixels(pixels, field), cost * len(pixels), numbers, shape)
