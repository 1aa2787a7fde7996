"""Movements and turns inside a bonded layer under flat punches, on a grid of a sheet's cells."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.physics.bonded_layer import at_pose, punch_pressure, wave_numbers

if TYPE_CHECKING:
    from tactile_ros.physics.layer_response import Layer
    from tactile_ros.physics.magnetic_sheet import Sheet
    from tactile_ros.types import Array, Outline

ROOM = 1.6  # of the sheet: a periodic grid on which dents do not meet themselves
EVEN = 6  # cells of the grid are a multiple of it
STEP = 1e-3  # of the layer, over which movements are differentiated
NEAR = 0.5  # shift of the grid, in cells, where the sheet has an even number of them


def punched_waves(body: Layer, heights: Array, kx: Array, ky: Array) -> Array:
    """What a wave of pressure does in a layer, whose wave vectors are a grid.

    Parameters
    ----------
    body : Layer
        The whole body.
    heights : ndarray, shape (h,)
        Over the base (m).
    kx, ky : ndarray, shape (m, 1) and (1, n)
        Wave vectors (rad / m).

    Returns
    -------
    ndarray, shape (5, h, m, n)
        ux, uy, uz (m / Pa), and turns about x and y (rad / Pa).
    """
    k = np.hypot(kx, ky)
    step = STEP * body.thickness
    steps = np.concatenate([heights - step, heights, heights + step])
    across, up = body.pressed(k, np.clip(steps, 0.0, body.thickness))
    n = len(heights)
    moved = [np.moveaxis(wave, -1, 0) for wave in (across, up)]
    slope = (moved[0][2 * n :] - moved[0][:n]) / (2 * step)
    along, lift = moved[0][n : 2 * n], moved[1][n : 2 * n]
    k = np.maximum(k, 1e-9)
    cx, cy = kx / k, ky / k
    # half the curl; lateral movement is a gradient, so that nothing turns about z
    turn = 0.5 * (k * lift - slope)
    return np.stack([1j * along * cx, 1j * along * cy, lift + 0j, 1j * turn * cy, -1j * turn * cx])


class PunchDents:
    """Dents of flat punches in one layer, for one metre of depth.

    Parameters
    ----------
    sheet : Sheet
        In the layer; gives cells and heights.
    base : float
        Height of the rigid base (m).
    body : Layer
        The whole body.
    """

    def __init__(self, sheet: Sheet, base: float, body: Layer) -> None:
        self.pitch = sheet.pitch
        longest = max(len(line) for line in sheet.lines)
        self.count = EVEN * int(np.ceil(ROOM * longest / EVEN))
        self.shift = np.array([(NEAR if len(line) % 2 == 0 else 0.0) for line in sheet.lines])
        self.body = body
        self.kx, self.ky = wave_numbers(self.count, self.pitch)
        self.waves = punched_waves(body, sheet.levels - base, self.kx, self.ky) / self.pitch**2

    def loads(self, outline: Outline) -> tuple[Array, Array]:
        """Points (p, 2) (m) in the outline's frame and loads (p,) per depth (N / m)."""
        return punch_pressure(outline.loops, self.body)

    def images(self, points: Array, loads: Array, pose: Array) -> Array:
        """Movements and turns for a unit of depth.

        Parameters
        ----------
        points, loads : ndarray, shape (p, 2) and (p,)
            Of `loads`.
        pose : ndarray, shape (3,)
            Place of the outline's origin (m), and its turn (rad).

        Returns
        -------
        ndarray, shape (5, 2, n, n)
            ux, uy, uz (m / m), turns about x and y (rad / m), on two levels, at cells whose
            centres are `shift` beyond multiples of the pitch.
        """
        x, y = at_pose(points, pose)
        x, y = x - self.shift[0] * self.pitch, y - self.shift[1] * self.pitch
        first = np.exp(-1j * self.kx * x) * loads
        spectrum = first @ np.exp(-1j * self.ky.T * y).T
        shape = (self.count, self.count)
        return np.asarray(np.fft.irfft2(self.waves * spectrum, shape, axes=(-2, -1)))

    def on_sheet(self, sheet: Sheet, images: Array) -> Array:
        """Movements and turns at a sheet's dipoles, shape (5, x y 2), from those at all cells."""
        rows = [self.index(line, axis) for axis, line in enumerate(sheet.lines)]
        cut = images[:, :, rows[0][:, None], rows[1][None]]
        return np.moveaxis(cut, 1, -1).reshape(len(images), -1)

    def index(self, line: Array, axis: int) -> Array:
        """Number of the cells on the periodic grid of centres (n,) along an axis (m)."""
        found = np.rint(line / self.pitch - self.shift[axis]).astype(int) % self.count
        return np.asarray(found)
