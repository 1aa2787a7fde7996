# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Field of a disc from a table over its half plane: a thousandth of the exact field's price.

Near the disc a dipole errs by milliteslas; a table of the exact field with cubic interpolation
errs by less than a hundredth of a microtesla. Its rows are squares of the distance from the axis,
in which the field is smooth at the axis, and its columns heights.
"""

from __future__ import annotations

import math
from functools import cache

import numpy as np

from tactile_ros.physics.compiled import compiled, inlined
from tactile_ros.physics.fidelity import CUBIC_COST, Model
from tactile_ros.physics.magnetics import Disc, axial_cylinder, on_pixels
from tactile_ros.types import Array

SHAPE = (128, 96)  # rows and columns
SHAPES = (
    (13, 9), (25, 17), (37, 25), (49, 33), (73, 49), (97, 65), (128, 96), (161, 113), (193, 129),
    (257, 193),
)  # fmt: skip


def reach_under(pixels: Array, gap: float, height: float) -> tuple[float, float, float]:
    """Reach of a table for an inversion: 0.1 to 1.8 gaps over pixels (t, 3), 1.2 to any side.

    `gap` is from the pixels to the near face of the disc at rest, `height` that of the disc (m).
    """
    wide = float(np.hypot(*np.abs(pixels[:, :2]).max(axis=0)) + 1.2 * gap)
    low = float(pixels[:, 2].max())
    return wide, 0.1 * gap - low + height / 2, 1.8 * gap - low + height / 2


def disc_table(
    diameter: float,
    height: float,
    reach: tuple[float, float, float],
    shape: tuple[int, int] = SHAPE,
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


@inlined
def lagrange(u: float) -> tuple[float, ...]:
    """Weights of four nodes at -1, 0, 1, 2, and their slopes (Lagrange; DLMF 3.3)."""
    a, b, c = u + 1, u - 1, u - 2
    return (
        -u * b * c / 6,
        a * b * c / 2,
        -a * u * c / 2,
        a * u * b / 6,
        -(b * c + u * c + u * b) / 6,
        (b * c + a * c + a * b) / 2,
        -(u * c + a * c + a * u) / 2,
        (u * b + a * b + a * u) / 6,
    )


@inlined
def table_point(
    square: float, height: float, table: Array, grid: Array
) -> tuple[float, float, float, float, float, float]:
    """Radial field over distance and axial field; their slopes over the distance, and height.

    The point is at a squared distance from the axis of a disc, and a height over its centre.
    """
    p, q = square / grid[0] + 1, (-height - grid[1]) / grid[2]
    i = min(max(math.floor(p) - 1, 0), table.shape[0] - 4)
    j = min(max(math.floor(q) - 1, 0), table.shape[1] - 4)
    wi, wj = lagrange(p - i - 1), lagrange(q - j - 1)
    f = g = fs = gs = fz = gz = 0.0
    for a in range(4):
        rf = rg = tf = tg = 0.0
        for b in range(4):
            near, far = table[i + a, j + b, 0], table[i + a, j + b, 1]
            rf += near * wj[b]
            rg += far * wj[b]
            tf += near * wj[b + 4]
            tg += far * wj[b + 4]
        f += rf * wi[a]
        g += rg * wi[a]
        fs += rf * wi[a + 4]
        gs += rg * wi[a + 4]
        fz += tf * wi[a]
        gz += tg * wi[a]
    fs, gs = fs * (2 / grid[0]), gs * (2 / grid[0])
    return f, g, fs, gs, fz / -grid[2], gz / -grid[2]


@compiled
def table_field(own: Array, table: Array, grid: Array, field: Array) -> None:
    """Write the field (n, 3) of a disc of 1 T at points (n, 3) in its own axes (m)."""
    for n in range(len(own)):
        x, y = own[n, 0], own[n, 1]
        point = table_point(x * x + y * y, own[n, 2], table, grid)
        field[n, 0], field[n, 1], field[n, 2] = point[0] * x, point[0] * y, point[1]


def table_disc_model(
    pixels: Array, disc: Disc, reach: tuple[float, float, float], shape: tuple[int, int]
) -> Model:
    """Cubic table of a shape at pixels (t, 3); built when first needed."""
    diameter, height, remanence = disc

    @cache
    def built() -> tuple[Array, Array]:
        return disc_table(diameter, height, reach, shape)

    def field(own: Array) -> Array:
        found = np.empty_like(own)
        table_field(own, *built(), found)
        return remanence * found

    return Model(
        f'cubic table {shape[0]} x {shape[1]}', on_pixels(pixels, field),
        CUBIC_COST * len(pixels), 2 * shape[0] * shape[1], shape,
    )  # fmt: skip
