"""A magnetised sheet with bands of alternating poles: as a carpet of dipoles, or its harmonics.

A sheet that gives way is a carpet of dipoles that its body carries. Far from its edges an
alternating sheet is a sum of odd harmonics, each of which fades with the distance over its own
length (Halbach, Nucl. Instrum. Methods 169, 1980): one cosine soon is enough. At rest it has a
closed form, `magnetic_sheet`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from tactile_ros.physics.dipoles import dipole_field, magnet_moment

if TYPE_CHECKING:
    from tactile_ros.physics.magnetic_sheet import Sheet
    from tactile_ros.types import Array

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
