"""A magnetised sheet with bands of alternating poles: exact, as dipoles, or as its harmonics.

A sheet at rest is a row of blocks, each magnetised one way, whose fields have closed forms. One
that gives way is a carpet of dipoles that its body carries. Far from its edges an alternating
sheet is a sum of odd harmonics, each of which fades with the distance over its own length
(Halbach, Nucl. Instrum. Methods 169, 1980): one cosine soon is enough.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from tactile_ros.physics.dipoles import dipole_field, magnet_moment
from tactile_ros.physics.magnetics import cuboid_field
from tactile_ros.types import Array

ALONG = {'M1': 2, 'M2': 1, 'M3': 1, 'M4': 1}  # axis of the magnetisation


@dataclass(frozen=True)
class Sheet:
    """A magnetised sheet, centre at the origin, flat along x and y.

    Attributes
    ----------
    size : ndarray, shape (3,)
        Along x, y and z (m).
    remanence : float
        (T).
    magnetisation : str
        M1 +z, M2 +y, M3 +y where y > 0 and -y below, M4 +-y in bands along y, the first +.
    pole_pitch : float
        Width of a band of M4 (m).
    """

    size: Array
    remanence: float
    magnetisation: str = 'M4'
    pole_pitch: float = np.inf

    @property
    def bands(self) -> tuple[Array, Array]:
        """Edges (b + 1,) of the bands along y (m), and their signs (b,)."""
        half = float(self.size[1]) / 2
        if self.magnetisation == 'M3':
            return np.array([-half, 0.0, half]), np.array([-1.0, 1.0])
        if self.magnetisation != 'M4':
            return np.array([-half, half]), np.ones(1)
        edges = np.arange(-half, half - 1e-9 * half, self.pole_pitch)
        signs = 1.0 - 2.0 * (np.arange(len(edges)) % 2)
        return np.append(edges, half), signs.astype(np.float64)

    def field(self, points: Array) -> Array:
        """Field (..., 3) (T) of the sheet at rest at points (..., 3) (m), in closed form.

        Examples
        --------
        >>> even = Sheet(np.array([1.0, 1.0, 1e-3]), 0.1, 'M1')
        >>> bool(abs(even.field(np.array([0.0, 0.0, 5e-3]))[2]) < 1e-3)
        True
        """
        edges, signs = self.bands
        polarisation = self.remanence * np.eye(3)[ALONG[self.magnetisation]]
        field = np.zeros(np.shape(points))
        for low, high, sign in zip(edges[:-1], edges[1:], signs, strict=True):
            centre = np.array([0.0, (low + high) / 2, 0.0])
            block = np.array([self.size[0], high - low, self.size[2]])
            field += cuboid_field(points - centre, block, sign * polarisation)
        return field

    def dipoles(self, pitch: float, levels: int = 1) -> tuple[Array, Array]:
        """Places (m) and moments (A m2), (g, 3) each, of a carpet of dipoles.

        Parameters
        ----------
        pitch : float
            Of the carpet, about: no dipole stands for parts of two bands (m).
        levels : int
            Of dipoles over the thickness, at Gauss points.
        """
        edges, signs = self.bands
        x = _middles(np.array([-0.5, 0.5]) * self.size[0], pitch)[0]
        y, owner = _middles(edges, pitch)
        z, share = np.polynomial.legendre.leggauss(levels)
        places = np.stack(np.meshgrid(x, y, z * self.size[2] / 2, indexing='ij'), axis=-1)
        width = np.diff(edges)[owner] / np.bincount(owner)[owner]
        volume = (self.size[0] / len(x) * self.size[2]) * width[:, None] * share / 2
        moment = magnet_moment(self.remanence, 1.0) * signs[owner][:, None] * volume
        direction = np.eye(3)[ALONG[self.magnetisation]]
        moments = np.broadcast_to(moment[..., None] * direction, places.shape)
        return places.reshape(-1, 3), moments.reshape(-1, 3)

    def harmonics(self, points: Array, count: int) -> Array:
        """Field (..., 3) (T) of M4 without edges at points (..., 3) (m) outside of the sheet.

        Parameters
        ----------
        points : ndarray, shape (..., 3)
            (m).
        count : int
            Odd harmonics: 1, 3, 5 and so on.
        """
        half = float(self.size[2]) / 2
        phase = points[..., 1] + self.size[1] / 2
        height = np.abs(points[..., 2])
        field = np.zeros(np.shape(points))
        for n in 2 * np.arange(count) + 1:
            k = n * np.pi / self.pole_pitch
            strength = 4 * self.remanence / (n * np.pi) * np.sinh(k * half) * np.exp(-k * height)
            field[..., 1] -= strength * np.sin(k * phase)
            field[..., 2] -= np.sign(points[..., 2]) * strength * np.cos(k * phase)
        return field


def _middles(edges: Array, pitch: float) -> tuple[Array, npt.NDArray[np.int64]]:
    """Middles (n,) of equal parts, about `pitch` wide, of the bands, and whose part each is."""
    counts = np.maximum(np.round(np.diff(edges) / pitch), 1).astype(np.int64)
    owner = np.repeat(np.arange(len(counts)), counts)
    part = np.arange(len(owner)) - np.repeat(np.cumsum(counts) - counts, counts)
    return edges[owner] + (part + 0.5) * (np.diff(edges) / counts)[owner], owner


def carried_field(points: Array, places: Array, moments: Array, moved: Array) -> Array:
    """Field (t, 3) (T) at points (t, 3) of dipoles (g, 3) that a body has moved by (g, 3) (m)."""
    return dipole_field(points, places + moved, moments)
