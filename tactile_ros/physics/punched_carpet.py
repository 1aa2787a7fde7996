"""Movements of a carpet's nodes under flat punches of any outline on a bonded layer.

Nodes stand in rows and columns, evenly or not (Gauss points): waves are summed along one axis and
then along the other, so that no grid of squares lies between the layer and the dipoles.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.physics.bonded_layer import at_pose, punch_pressure, wave_numbers
from tactile_ros.physics.punch_dents import punched_waves

if TYPE_CHECKING:
    from tactile_ros.physics.layer_response import Layer
    from tactile_ros.types import Array, Outline

FINER = 2  # cells of a punch, whose rim decides
PITCHES = 128  # of the shortest wave, in the period
ROOM = 1.6  # of the nodes' longer side: dents do not meet themselves within this period


class PunchedCarpet:
    """Nodes in one bonded layer.

    Parameters
    ----------
    layer : Layer
        Bonded to its base at z = 0.
    x, y, heights : ndarray, shape (m,), (n,) and (h,)
        Nodes (m).
    """

    def __init__(self, layer: Layer, x: Array, y: Array, heights: Array) -> None:
        self.layer, self.shape = layer, (len(x), len(y), len(heights))
        period = ROOM * max(float(np.ptp(x)), float(np.ptp(y)))
        self.kx, self.ky = wave_numbers(PITCHES, period / PITCHES)
        self.waves = punched_waves(layer, heights, self.kx, self.ky) / period**2
        # a real transform has half of the waves along y: those between its ends count twice
        twice = np.where(np.arange(self.ky.shape[1]) % (PITCHES // 2) == 0, 1.0, 2.0)
        self.along_x = np.exp(1j * self.kx * x)
        self.along_y = twice[:, None] * np.exp(1j * self.ky.T * y)

    def loads(self, outline: Outline) -> tuple[Array, Array]:
        """Points (p, 2) (m) in the outline's frame and loads (p,) per depth (N / m)."""
        return punch_pressure(outline.loops, self.layer, FINER)

    def under(self, points: Array, loads: Array, pose: Array) -> tuple[Array, Array]:
        """Movements and turns for one metre of depth.

        Parameters
        ----------
        points, loads : ndarray, shape (p, 2) and (p,)
            Of `loads`.
        pose : ndarray, shape (3,)
            Place of the outline's origin (m), and its turn (rad).

        Returns
        -------
        moved, turned : ndarray, shape (m n h, 3)
            (m / m) and (rad / m), height by height within a node.
        """
        x, y = at_pose(points, pose)
        # waves of a row are powers of the longest one; x has those of both signs
        rows = self._powers(x)
        rows = np.concatenate([rows[:-1], rows[:0:-1].conj()]) * loads
        spectrum = rows @ self._powers(y).T
        waves = np.matmul(self.waves * spectrum, self.along_y)
        found = np.matmul(self.along_x.T, waves).real
        flat = np.moveaxis(found, 1, -1).reshape(len(found), -1)
        turned = np.column_stack([flat[3], flat[4], np.zeros(flat.shape[1])])
        return np.ascontiguousarray(flat[:3].T), turned

    def _powers(self, at: Array) -> Array:
        """Waves of rising number (PITCHES / 2 + 1, p) at points (p,) along an axis (m)."""
        longest = np.exp(-1j * self.ky[0, 1] * at)
        waves = np.broadcast_to(longest, (PITCHES // 2, len(at)))
        return np.asarray(np.cumprod(np.concatenate([np.ones((1, len(at))), waves]), axis=0))
