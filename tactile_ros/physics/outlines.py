"""Flat outlines: which points lie inside, and how large they are."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.types import Array, Bools

if TYPE_CHECKING:
    from collections.abc import Sequence


def inside(loops: Sequence[Array], points: Array) -> Bools:
    """Points (n, 2) that an odd number of edges of the loops lies to the right of.

    Examples
    --------
    >>> square = np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]])
    >>> inside([square], np.array([[0.5, 0.5], [1.5, 0.5]])).tolist()
    [True, False]
    """
    odd = np.zeros(len(points), bool)
    x, y = points[:, :1], points[:, 1:]
    for loop in loops:
        (x0, y0), (x1, y1) = loop.T, np.roll(loop, -1, axis=0).T
        spans = (y0 > y) != (y1 > y)
        rise = np.where(y1 == y0, 1.0, y1 - y0)
        crossing = spans & (x < x0 + (y - y0) * (x1 - x0) / rise)
        odd ^= crossing.sum(axis=1) % 2 == 1
    return odd


def grid_inside(loops: Sequence[Array], pitch: float) -> Array:
    """Points (n, 2) of a square grid that lie inside; n times pitch squared is the area.

    Examples
    --------
    >>> square = np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]])
    >>> len(grid_inside([square], 0.1))
    100
    """
    corners = np.concatenate(list(loops))
    low, high = corners.min(axis=0), corners.max(axis=0)
    x, y = (np.arange(low[i] + pitch / 2, high[i], pitch) for i in (0, 1))
    grid = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    return grid[inside(loops, grid)]
