"""Loads under a flat punch of any outline on a soft layer that is bonded to a rigid base.

A flat punch is the pressure inside its outline that makes the face flat there; the layer is that
of `layer_response`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.physics.layer_response import Layer, flat_pressure
from tactile_ros.physics.outlines import inside

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tactile_ros.types import Array

ALONG = (28, 96)  # cells of a punch along its longer side, at least and at most
FINE = 8  # cells in the height of the layer
WIDE = 5.0  # layers of room around a punch


def wave_numbers(count: int, pitch: float) -> tuple[Array, Array]:
    """Wave numbers kx (n, 1) and ky (1, n // 2 + 1) of a periodic square grid (rad / m)."""
    kx: Array = 2 * np.pi * np.fft.fftfreq(count, pitch)  # type: ignore[assignment]
    ky: Array = 2 * np.pi * np.fft.rfftfreq(count, pitch)  # type: ignore[assignment]
    return kx[:, None], ky[None]


def punch_pressure(loops: Sequence[Array], layer: Layer, finer: int = 1) -> tuple[Array, Array]:
    """Loads under a flat punch without friction, for one metre of depth.

    Parameters
    ----------
    loops : sequence of ndarray, shape (n, 2)
        Its outline (m).
    layer : Layer
        Under it.
    finer : int
        So many times as many cells along a side as are usual.

    Returns
    -------
    points : ndarray, shape (p, 2)
        Centres of the cells of a square grid inside the outline (m).
    loads : ndarray, shape (p,)
        Force on each of them per depth (N / m).

    Raises
    ------
    ValueError
        If the outline covers no cell.
    """
    corners = np.concatenate(list(loops))
    low, high = corners.min(axis=0), corners.max(axis=0)
    length = float((high - low).max())
    pitch = max(min(length / ALONG[0], layer.thickness / FINE), length / ALONG[1]) / finer
    count = int(2 ** np.ceil(np.log2((length + WIDE * layer.thickness) / pitch)))
    line = (np.arange(count) - (count - 1) / 2) * pitch
    places = np.stack(np.meshgrid(line, line, indexing='ij'), axis=-1) + (low + high) / 2
    under = inside(loops, places.reshape(-1, 2)).reshape(count, count)
    if not under.any():
        msg = f'outline of a punch must cover an area; received {len(corners)} corners that do not'
        raise ValueError(msg)
    kx, ky = wave_numbers(count, pitch)
    give = -layer.pressed(np.hypot(kx, ky), np.array([layer.thickness]))[1][..., 0]
    pressure = flat_pressure(give, under, 1.0)
    return places[under], pressure[under] * pitch**2


def at_pose(points: Array, pose: Array) -> Array:
    """Points (p, 2) of an outline's frame at a pose: place (m) and turn (rad), shape (2, p).

    Examples
    --------
    >>> at_pose(np.array([[1.0, 0.0]]), np.array([2.0, 3.0, np.pi / 2])).round(12).tolist()
    [[2.0], [4.0]]
    """
    c, s = np.cos(pose[2]), np.sin(pose[2])
    return np.asarray(np.array([[c, -s], [s, c]]) @ points.T + pose[:2, None])
