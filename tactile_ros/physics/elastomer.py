# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Soft bodies under loads on their surface: half-spaces, and a layer bonded to a rigid base.

Half-space: a load on the free surface of an incompressible body moves a point at r by (F / r +
(F . r) r / r^3) / (4 pi G) (Boussinesq and Cerruti with a Poisson ratio of one half; Johnson,
Contact Mechanics, 1985, secs. 3.2 and 3.6). A bonded base holds it by the images of Blake (Proc.
Camb. Phil. Soc. 70, 1971). The truth of a layer on a base lies between the two.

Layer: the exact solution, wave by wave: for a wave vector of length q displacements and tractions
on a plane z = const obey four linear equations whose eigenvalues are +-q, each twice (Johnson,
secs. 2.1 and 5.8; Thomson, J. Appl. Phys. 21, 1950). In a nearly incompressible layer the squeeze
moves a magnet more than the dent does, which neither a half-space nor springs can show.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import fft

from tactile_ros.physics.compiled import compiled
from tactile_ros.physics.coverage import inside
from tactile_ros.physics.magnet_sheet import Sheet
from tactile_ros.types import Array, Bools, Outline

Waves = npt.NDArray[np.complex128]
# Hexagon and centre: integrates polynomials up to the fifth degree over a disc
# (Abramowitz and Stegun, 25.4.61).
RING = np.arange(6) * np.pi / 3
DISC = np.vstack([np.zeros(2), np.sqrt(2 / 3) * np.column_stack([np.cos(RING), np.sin(RING)])])
SHARES = np.array([0.25] + [0.125] * 6)
NEAREST = 1e-5  # m, inside which a load counts as spread out
LEAST = 1e-4  # thickness times wave number, below which a wave is even
STEEP = 40.0  # beyond which a wave does not come to the base
ROUNDS, CLOSE = 200, 1e-7
STEP = 1e-3  # of the layer, over which movements are differentiated
ALONG = (28, 96)  # cells of a punch along its longer side, at least and at most
FINE = 8  # cells in the height of the layer
WIDE = 5.0  # layers of room around a punch
ROOM = 1.6  # of a sheet: a period on which dents do not meet themselves
EVEN = 6  # cells of the periodic grid are a multiple of it
FINER = 2  # times as many cells of a punch for a carpet, where its rim decides
PITCHES = 128  # of the shortest wave of a carpet, in the period


def disc_press(
    points: Array, contacts: Array, normals: Array, forces: Array, radius: Array,
    shear_modulus: float, bond: Array,
) -> Array:  # fmt: skip
    """Displacement (m) of points (s, m, 3) (m) under even pressure on discs (Johnson, ch. 3).

    Parameters
    ----------
    contacts, normals, forces : ndarray, shape (s, 3)
        Centres of the discs (m), what they are normal to, and forces on the body (N).
    radius, bond : ndarray, shape (s,)
        Of the discs (m); share of the base's image, 0 (half-space) to 1 (bonded at z = 0).
    shear_modulus : float
        Of the body (Pa).
    """
    moved = np.zeros_like(points)
    first = np.cross(normals, np.array([1.0, 0.0, 0.0]))
    flat = np.linalg.norm(first, axis=1, keepdims=True)
    first = np.where(flat > 1e-6, first / np.maximum(flat, 1e-6), np.array([0.0, 1.0, 0.0]))
    second = np.cross(normals, first)
    _add_discs(
        np.ascontiguousarray(points), np.ascontiguousarray(contacts), first * radius[:, None],
        second * radius[:, None], np.ascontiguousarray(forces), np.array(bond, np.float64), moved,
    )  # fmt: skip
    return np.asarray(moved / (4 * np.pi * shear_modulus))


@compiled
def _add_discs(
    points: Array, contacts: Array, first: Array, second: Array, forces: Array, bond: Array,
    moved: Array,
) -> None:  # fmt: skip
    """Add point loads and a share of their images over the nodes of discs, times 4 pi G."""
    load, r, q = np.empty(3), np.empty(3), np.empty(3)
    for s in range(points.shape[0]):
        for k in range(DISC.shape[0]):
            for i in range(3):
                load[i] = contacts[s, i] + DISC[k, 0] * first[s, i] + DISC[k, 1] * second[s, i]
            for m in range(points.shape[1]):
                square, mirrored, along, image = NEAREST * NEAREST, 0.0, 0.0, 0.0
                for i in range(3):
                    r[i] = points[s, m, i] - load[i]
                    q[i] = points[s, m, i] - (load[i] if i < 2 else -load[i])
                    square += r[i] * r[i]
                    mirrored += q[i] * q[i]
                    along += forces[s, i] * r[i]
                    image += forces[s, i] * q[i]
                near, far = 1 / math.sqrt(square), 1 / math.sqrt(mirrored)
                across = image - 2 * forces[s, 2] * q[2]  # the mirrored force's part
                cube, fifth = far**3, far**5
                for i in range(3):
                    part = forces[s, i] * near + along * r[i] * near**3
                    if bond[s] != 0.0:
                        own = forces[s, i] if i < 2 else -forces[s, i]
                        up = 1.0 if i == 2 else 0.0
                        dipoles = load[2] * (own * cube - 3 * q[i] * across * fifth)
                        dipoles += (up * across - own * q[2] + q[i] * forces[s, 2]) * cube
                        dipoles += 3 * q[i] * q[2] * across * fifth
                        held = -forces[s, i] * far - image * q[i] * cube + 2 * load[2] * dipoles
                        part += bond[s] * held
                    moved[s, m, i] += SHARES[k] * part


def wave_numbers(shape: tuple[int, ...], pitch: float) -> tuple[Array, Array]:
    """Wave numbers (m, 1) and (1, n // 2 + 1) (rad / m) of a periodic grid of squares (m, n)."""
    first = np.asarray(2 * np.pi * np.fft.fftfreq(shape[0], pitch))
    second = np.asarray(2 * np.pi * np.fft.rfftfreq(shape[1], pitch))
    return first[:, None], second[None]


@dataclass(frozen=True)
class Layer:
    """Soft layer on a rigid base at z = 0, its free surface at z = thickness (m).

    The shear modulus is in Pa, the Poisson ratio 0 to 0.5.
    """

    thickness: float
    shear_modulus: float
    poisson_ratio: float = 0.5

    def pressed(self, numbers: Array, heights: Array) -> tuple[Array, Array]:
        """Movement that a pressure wave of amplitude one on the surface causes.

        Parameters
        ----------
        numbers, heights : ndarray, shape (...) and (h,)
            Wave numbers k (rad / m); heights over the base, 0 to the thickness (m).

        Returns
        -------
        across, up : ndarray, shape (..., h)
            Amplitudes (m / Pa): the movement along k is i times `across`, that along z is `up`.

        Examples
        --------
        A long wave squeezes a column, a short one sees a half-space:

        >>> layer = Layer(4e-3, 1e5 / 2.6, 0.3)
        >>> up = layer.pressed(np.array([1.0, 1e5]), np.array([4e-3]))[1][:, 0]
        >>> column = 4e-3 * (1 + 0.3) * (1 - 0.6) / (0.7 * 1e5)
        >>> bool(np.isclose(up[0], -column, rtol=1e-4))
        True
        >>> bool(np.isclose(up[1], -2 * (1 - 0.3**2) / (1e5 * 1e5)))
        True
        """
        k = np.maximum(np.asarray(numbers, np.float64), LEAST / self.thickness)
        deep = np.minimum(k * self.thickness, STEEP)
        top = _propagated(deep, self.poisson_ratio)[..., 2:, 2:]
        a, b, c, d = (top[..., i, j] for i in (0, 1) for j in (0, 1))
        base = np.stack([-b, a], axis=-1) / (a * d - b * c)[..., None]  # its tractions
        moved = np.zeros((*k.shape, 2, len(heights)))
        for i, z in enumerate(heights):
            up = deep - k * (self.thickness - z)  # from the base, or from a depth without effect
            here = _propagated(np.maximum(up, 0.0), self.poisson_ratio)[..., :2, 2:]
            share = np.exp(np.maximum(up, 0.0) - deep) / (self.shear_modulus * k) * (up >= 0)
            moved[..., i] = -np.einsum('...ij,...j->...i', here, base) * share[..., None]
        return moved[..., 0, :], moved[..., 1, :]

    def waves(self, heights: Array, kx: Array, ky: Array) -> Waves:
        """Movement by a pressure wave of amplitude one, shape (5, h, m, n), at heights (h,) (m).

        They are ux, uy, uz (m / Pa), and turns about x and y (rad / Pa): half the curl, which has
        no part about z. Wave vectors are kx (m, 1) and ky (1, n) (rad / m).
        """
        k = np.hypot(kx, ky)
        step = STEP * self.thickness
        steps = np.concatenate([heights - step, heights, heights + step])
        moved = self.pressed(k, np.clip(steps, 0.0, self.thickness))
        across, up = (np.moveaxis(wave, -1, 0) for wave in moved)
        n = len(heights)
        slope = (across[2 * n :] - across[:n]) / (2 * step)
        along, lift = across[n : 2 * n], up[n : 2 * n]
        k = np.maximum(k, 1e-9)
        cx, cy = kx / k, ky / k
        turn = 0.5j * (k * lift - slope)
        return np.stack([1j * along * cx, 1j * along * cy, lift + 0j, turn * cy, -turn * cx])

    def punch(self, covered: Bools, pitch: float, depth: float | Array) -> Array:
        """Pressure (ny, nx) (Pa) on covered squares under a smooth punch of a depth (m).

        The depth is one number or a map (ny, nx). Conjugate gradients on the squares that are
        covered.
        """
        numbers = np.hypot(*wave_numbers(covered.shape, pitch))
        give = -self.pressed(numbers, np.array([self.thickness]))[1][..., 0]
        flat = covered.astype(np.float64)
        pressure, left = np.zeros(covered.shape), depth * flat
        step, size = left.copy(), float((left * left).sum())
        goal = CLOSE**2 * size
        for _ in range(ROUNDS):
            if size <= goal:
                break
            answer = np.fft.irfft2(np.fft.rfft2(step) * give, s=covered.shape) * flat
            length = size / float((step * answer).sum())
            pressure, left = pressure + length * step, left - length * answer
            former, size = size, float((left * left).sum())
            step = left + size / former * step
        return pressure


def _propagated(height: Array, poisson_ratio: float) -> Array:
    """exp(A h) / exp(h), shape (..., 4, 4), of displacements and tractions over a height h (rad).

    Displacement along the wave (a quarter ahead) and z, tractions over shear modulus and wave
    number in the same order.
    """
    nu = poisson_ratio
    ratio = nu / (1 - nu)
    change = np.array([
        [0.0, -1.0, 1.0, 0.0],
        [ratio, 0.0, 0.0, (1 - 2 * nu) / (2 * (1 - nu))],
        [2 / (1 - nu), 0.0, 0.0, -ratio],
        [0.0, 0.0, 1.0, 0.0],
    ])  # fmt: skip
    cosh, sinh = 0.5 * (1 + np.exp(-2 * height)), -0.5 * np.expm1(-2 * height)
    third = 0.5 * (height * cosh - sinh)
    powers = np.stack([np.linalg.matrix_power(change, n) for n in range(4)])
    shares = np.stack([cosh - 0.5 * height * sinh, sinh - third, 0.5 * height * sinh, third])
    return np.asarray(np.einsum('n...,nij->...ij', shares, powers))


def punch_pressure(
    loops: Sequence[Array], layer: Layer, finer: int = 1, *, tilted: bool = False
) -> tuple[Array, Array]:
    """Loads under a punch without friction for one metre of depth and for tilts.

    Parameters
    ----------
    loops : sequence of ndarray, shape (n, 2)
        Its outline (m); ValueError is raised if it covers no cell.
    finer : int
        So many times as many cells along a side as are usual.
    tilted : bool
        With the loads of tilts.

    Returns
    -------
    points, loads : ndarray, shape (p, 2) and (1 or 3, p)     Centres of square cells inside the
    outline (m); force on each per depth (N / m), and per slope     of the face along x and y (N).
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
    depths = [1.0, places[..., 0], places[..., 1]] if tilted else [1.0]
    loads = [layer.punch(under, pitch, depth)[under] for depth in depths]
    return places[under], np.array(loads) * pitch**2


def at_pose(points: Array, pose: Array) -> Array:
    """Points (p, 2) of an outline's frame at a pose: place (m) and turn (rad), shape (2, p)."""
    c, s = np.cos(pose[2]), np.sin(pose[2])
    return np.asarray(np.array([[c, -s], [s, c]]) @ points.T + pose[:2, None])


class PunchDents:
    """Dents of flat punches in one layer on a grid of a sheet's cells, for one metre of depth."""

    def __init__(self, sheet: Sheet, body: Layer) -> None:
        self.pitch = sheet.pitch
        longest = max(len(line) for line in sheet.lines)
        self.count = EVEN * int(np.ceil(ROOM * longest / EVEN))
        # in cells: by half of one where the sheet has an even number of them
        self.shift = np.array([0.5 if len(line) % 2 == 0 else 0.0 for line in sheet.lines])
        self.body = body
        self.kx, self.ky = wave_numbers((self.count, self.count), self.pitch)
        self.waves = body.waves(sheet.levels, self.kx, self.ky) / self.pitch**2

    def loads(self, outline: Outline) -> tuple[Array, Array]:
        """Points (p, 2) (m) in the outline's frame and loads (p,) per depth (N / m)."""
        points, loads = punch_pressure(outline.loops, self.body)
        return points, loads[0]

    def images(self, points: Array, loads: Array, pose: Array) -> Array:
        """Movements and turns (5, 2, n, n) for a unit of depth at a pose (3,) (m, m, rad).

        They are ux, uy, uz (m / m), turns about x and y (rad / m), on two levels, at cells whose
        centres are `shift` beyond multiples of the pitch.
        """
        x, y = at_pose(points, pose)
        x, y = x - self.shift[0] * self.pitch, y - self.shift[1] * self.pitch
        first = np.exp(-1j * self.kx * x) * loads
        spectrum = first @ np.exp(-1j * self.ky.T * y).T
        shape = (self.count, self.count)
        return np.asarray(fft.irfft2(self.waves * spectrum, shape, axes=(-2, -1)))

    def on_sheet(self, sheet: Sheet, images: Array) -> Array:
        """Movements and turns at a sheet's dipoles, shape (5, x y 2), from those at all cells."""
        rows = [self.index(line, axis) for axis, line in enumerate(sheet.lines)]
        cut = images[:, :, rows[0][:, None], rows[1][None]]
        return np.moveaxis(cut, 1, -1).reshape(len(images), -1)

    def index(self, line: Array, axis: int) -> Array:
        """Number of the cells on the periodic grid of centres (n,) along an axis (m)."""
        return np.asarray(np.rint(line / self.pitch - self.shift[axis]).astype(int) % self.count)


class PunchedCarpet:
    """Movements of nodes in one layer, bonded at z = 0, under flat punches of any outline.

    Nodes x (m,), y (n,), heights (h,) (m) stand in rows and columns, evenly or not: waves are
    summed along one axis and then along the other, without a grid of squares.
    """

    def __init__(self, layer: Layer, x: Array, y: Array, heights: Array) -> None:
        self.layer, self.shape = layer, (len(x), len(y), len(heights))
        period = ROOM * max(float(np.ptp(x)), float(np.ptp(y)))
        self.kx, self.ky = wave_numbers((PITCHES, PITCHES), period / PITCHES)
        self.waves = layer.waves(heights, self.kx, self.ky) / period**2
        # a real transform has half of the waves along y: those between its ends count twice
        twice = np.where(np.arange(self.ky.shape[1]) % (PITCHES // 2) == 0, 1.0, 2.0)
        self.along_x = np.exp(1j * self.kx * x)
        self.along_y = twice[:, None] * np.exp(1j * self.ky.T * y)

    def loads(self, outline: Outline) -> tuple[Array, Array]:
        """Points (p, 2) (m) in the outline's frame and loads (p,) per depth (N / m)."""
        points, loads = punch_pressure(outline.loops, self.layer, FINER)
        return points, loads[0]

    def under(self, points: Array, loads: Array, pose: Array) -> tuple[Array, Array]:
        """Movements (m / m) and turns (rad / m), (m n h, 3) each, height by height within a node.

        They are for one metre of depth under `loads` at a pose (3,) (m, m, rad).
        """
        x, y = at_pose(points, pose)
        # waves of a row are powers of the longest one; x has those of both signs
        rows = self._powers(x)
        rows = np.concatenate([rows[:-1], rows[:0:-1].conj()]) * loads
        spectrum = rows @ self._powers(y).T
        waves = np.matmul(self.waves * spectrum, self.along_y)
        nodes = np.matmul(self.along_x.T, waves).real
        flat = np.moveaxis(nodes, 1, -1).reshape(len(nodes), -1)
        turned = np.column_stack([flat[3], flat[4], np.zeros(flat.shape[1])])
        return np.ascontiguousarray(flat[:3].T), turned

    def _powers(self, at: Array) -> Array:
        """Waves of rising number (PITCHES / 2 + 1, p) at points (p,) along an axis (m)."""
        longest = np.exp(-1j * self.ky[0, 1] * at)
        waves = np.broadcast_to(longest, (PITCHES // 2, len(at)))
        return np.asarray(np.cumprod(np.concatenate([np.ones((1, len(at))), waves]), axis=0))
