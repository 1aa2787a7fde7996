# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Fields of dipoles, and of block and disc magnets in closed form, on a rigid or a soft body.

Dipoles: Jackson, Classical Electrodynamics, 3rd ed., Eq. (5.56); [2] Eq. (1) with its denominator
mended: the distance enters with the third power. Blocks: the charge of two faces for each
component of the polarisation (Furlani, Permanent Magnet and Electromechanical Devices, 2001, sec.
4.4), written with asinh so that nothing cancels. Discs along their axis: Derby and Olbert, Am. J.
Phys. 78, 2010, by Carlson's elliptic integrals. On edges and corners, where the field is infinite,
it is that of a billionth of the size away; far away, where closed forms cancel, that of a dipole.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.special import elliprf, elliprj

from tactile_ros.physics.fidelity import DISC_COST, Model
from tactile_ros.types import Array

VACUUM_PERMEABILITY = 4e-7 * np.pi  # T m / A
SCALE = VACUUM_PERMEABILITY / (4 * np.pi)
FAR = 100.0  # sizes from which a magnet is a dipole
EDGE = 1e-9  # sizes: how near to an edge the field still rises
IN_CACHE = 8192  # pairs of a point and a dipole that are computed at once
EXACT = 0  # edge nodes: the closed form of a block
Disc = tuple[float, float, float]  # diameter and height (m), remanence (T)


def magnet_moment(remanence: float, volume: float) -> float:
    """Moment of a magnet (A m2), B V / mu_0, from its remanence (T) and volume (m3)."""
    return remanence * volume / VACUUM_PERMEABILITY


def each_dipole_field(points: Array, places: Array, moments: Array) -> list[Array]:
    """Three components (..., t, m) (T) of the field of each dipole; as `dipole_field` takes it."""
    r = [points[..., :, None, i] - places[..., None, :, i] for i in range(3)]
    moment = [moments[..., None, :, i] for i in range(3)]
    squared = r[0] * r[0] + r[1] * r[1] + r[2] * r[2]
    near = SCALE / (squared * np.sqrt(squared))
    along = 3 * (r[0] * moment[0] + r[1] * moment[1] + r[2] * moment[2]) / squared
    return [near * (along * r[i] - moment[i]) for i in range(3)]


def dipole_field(points: Array, places: Array, moments: Array) -> Array:
    """Sum of the fields (..., t, 3) (T) of dipoles (Jackson, Eq. (5.56); [2] Eq. (1)).

    Parameters
    ----------
    points : ndarray, shape (..., t, 3)
        Where the field is wanted (m).
    places, moments : ndarray, shape (..., m, 3)
        Dipoles, none of them at a point (m, A m2).

    Examples
    --------
    >>> up = np.array([[0.0, 0.0, 1.0]])
    >>> near, far = (dipole_field(x * up, 0 * up, up)[0, 2] for x in (0.1, 0.2))
    >>> round(float(near / far), 9)
    8.0
    """
    # components side by side in memory, once for all points
    places, moments = (
        np.moveaxis(np.ascontiguousarray(np.moveaxis(a, -1, 0)), 0, -1) for a in (places, moments)
    )
    some = max(1, IN_CACHE // places.shape[-2])
    parts = []
    for first in range(0, max(points.shape[-2], 1), some):
        each = each_dipole_field(points[..., first : first + some, :], places, moments)
        parts.append(np.stack([component.sum(axis=-1) for component in each], axis=-1))
    return np.concatenate(parts, axis=-2)


def in_chip_axes(field: Array, rotations: Array | None) -> Array:
    """Fields (..., t, 3) in sensor axes as chips turned by `rotations` (t, 3, 3) read them."""
    return field if rotations is None else np.einsum('tji,...tj->...ti', rotations, field)


def in_sensor_axes(readings: Array, rotations: Array | None) -> Array:
    """Readings (..., t, 3) of chips turned by `rotations` (t, 3, 3) in axes of their sensor."""
    return readings if rotations is None else np.einsum('tij,...tj->...ti', rotations, readings)


def rotations(vectors: Array) -> Array:
    """Rotation matrices (..., 3, 3) of rotation vectors (..., 3) (rad), by Rodrigues.

    Examples
    --------
    >>> rotations(np.array([0.0, 0.0, np.pi / 2])).round(9)[:, 0] + 0.0
    array([0., 1., 0.])
    """
    angle = np.linalg.norm(vectors, axis=-1)[..., None, None]
    cross = np.zeros((*vectors.shape, 3))
    cross[..., 2, 1], cross[..., 0, 2], cross[..., 1, 0] = np.moveaxis(vectors, -1, 0)
    cross = cross - np.swapaxes(cross, -1, -2)
    once, twice = np.sinc(angle / np.pi), 0.5 * np.sinc(angle / (2 * np.pi)) ** 2
    return np.asarray(np.eye(3) + once * cross + twice * (cross @ cross))


def cuboid_field(points: Array, size: Array, polarisation: Array) -> Array:
    """Field (..., 3) (T) of a block of the same polarisation throughout (Furlani, sec. 4.4).

    Parameters
    ----------
    points : ndarray, shape (..., 3)
        From its centre, along its edges (m).
    size, polarisation : ndarray, shape (3,)
        Its edges (m), and remanence times direction (T).

    Examples
    --------
    >>> top = np.array([0.0, 0.0, 1e-3])
    >>> field = cuboid_field(top, np.array([2e-3, 2e-3, 1e-3]), np.array([0.0, 0.0, 1.4]))
    >>> (1e3 * field).round(2).tolist()
    [0.0, 0.0, 273.85]
    """
    points, half = np.asarray(points, float), np.asarray(size, float) / 2
    polarisation = np.asarray(polarisation, float)
    field = np.zeros(points.shape)
    for axis in np.flatnonzero(polarisation):
        turn = np.roll(np.arange(3), 2 - axis)  # the polarised axis comes last
        field[..., turn] += polarisation[axis] * _charged_faces(points[..., turn], half[turn])
    field += np.asarray(np.abs(points) < half).all(axis=-1, keepdims=True) * polarisation
    moment = polarisation * magnet_moment(1.0, float(8 * half.prod()))
    return _dipole_if_far(points, field, float(2 * half.max()), moment)


def _charged_faces(points: Array, half: Array) -> Array:
    """Field (..., 3) of unit charge on the faces at +-z of a block; without its inside."""
    least = EDGE * half.max()
    field = np.zeros(points.shape)
    for signs in np.ndindex(2, 2, 2):
        sx, sy, sz = 1 - 2 * np.array(signs)
        x, y = points[..., 0] + sx * half[0], points[..., 1] + sy * half[1]
        z = points[..., 2] - sz * half[2]
        r = np.sqrt(x * x + y * y + z * z)
        sign = sx * sy * sz / (4 * np.pi)
        field[..., 0] -= sign * np.arcsinh(y / np.maximum(np.hypot(x, z), least))
        field[..., 1] -= sign * np.arcsinh(x / np.maximum(np.hypot(y, z), least))
        above = np.where(z == 0, sz, np.sign(z))  # a face belongs to its outside
        angle = np.arctan(x * y / np.maximum(np.abs(z) * r, least * least))
        field[..., 2] += sign * above * angle
    return field


def _dipole_if_far(points: Array, field: Array, size: float, moment: Array) -> Array:
    """Field (..., 3), that of a dipole where points are far away."""
    far = np.linalg.norm(points, axis=-1) > FAR * size
    if far.any():
        away = points[far][:, None]
        field[far] = dipole_field(away, np.zeros((1, 3)), moment[None])[:, 0]
    return field


def cylinder_field(points: Array, diameter: float, height: float, remanence: float) -> Array:
    """Field (..., 3) (T) at points from the centre (m) of a disc along z (Derby and Olbert).

    Examples
    --------
    >>> field = cylinder_field(np.array([0.0, 0.0, 3e-3]), 2e-3, 1e-3, 1.4)
    >>> (1e3 * field).round(3).tolist()
    [0.0, 0.0, 23.133]
    """
    points = np.asarray(points, float)
    rho = np.hypot(points[..., 0], points[..., 1])
    radial, axial = axial_cylinder(rho, points[..., 2], diameter, height)
    outward = points[..., :2] / np.maximum(rho, np.finfo(float).tiny)[..., None]
    field = remanence * np.concatenate([radial[..., None] * outward, axial[..., None]], axis=-1)
    moment = magnet_moment(remanence, float(np.pi / 4 * diameter**2 * height))
    return _dipole_if_far(points, field, max(diameter, height), np.array([0.0, 0.0, moment]))


def axial_cylinder(rho: Array, z: Array, diameter: float, height: float) -> tuple[Array, Array]:
    """Radial and axial field (...) (T) of a disc of 1 T, `rho` off its axis, `z` over its centre.

    Notes
    -----
    The integrals are (c cos^2 + s sin^2) / (cos^2 + p sin^2) / sqrt(cos^2 + k^2 sin^2) over a
    quarter turn: c R_F(0, k^2, 1) + (s - p c) / 3 R_J(0, k^2, 1, p) (DLMF 19.25).
    """
    a = diameter / 2
    radial, axial = np.zeros(np.shape(rho)), np.zeros(np.shape(rho))
    gap = a - rho
    gap = np.where(np.abs(gap) < EDGE * a, EDGE * a, gap)
    gamma = gap / (a + rho)
    for sign in (1.0, -1.0):
        end = z + sign * height / 2
        reach = np.hypot(end, rho + a)
        square = (end * end + gap * gap) / (reach * reach)
        first = elliprf(0, square, 1)
        radial += sign * a / reach * (first - 2 / 3 * elliprj(0, square, 1, 1))
        third = elliprj(0, square, 1, gamma * gamma)
        axial += sign * end / reach * (first + (gamma - gamma * gamma) / 3 * third)
    return radial / np.pi, a / (a + rho) * axial / np.pi


def on_pixels(pixels: Array, own_field: Callable[[Array], Array]) -> Callable[[Array], Array]:
    """Readings (s, t, 3) of discs at states (s, 5) from a field (n, 3) in their own axes.

    A state is the disc's centre (m) and its turn about x and y (rad).
    """

    def readings(states: Array) -> Array:
        turn = rotations(np.pad(states[:, 3:], ((0, 0), (0, 1))))
        own = np.einsum('sji,stj->sti', turn, pixels[None] - states[:, None, :3])
        field = own_field(own.reshape(-1, 3)).reshape(own.shape)
        return np.asarray(np.einsum('sij,stj->sti', turn, field))

    return readings


def exact_disc(pixels: Array, disc: Disc) -> Model:
    """Closed form of a disc at pixels (t, 3)."""
    readings = on_pixels(pixels, lambda own: cylinder_field(own, *disc))
    return Model('exact', readings, DISC_COST * len(pixels))


@dataclass(frozen=True)
class Blocks:
    """Block magnets of one size that a soft body carries and turns, each as some dipoles or exact.

    Eight dipoles at the Gauss points of a block have its octupole: with blocks of 2 x 2 x 1 mm at
    6 mm they differ from the exact field by a thousandth.
    """

    centres: Array  # (m, 3) at rest (m)
    frames: Array  # (m, 3, 3) columns are own axes, the third that of the magnetisation
    size: Array  # (3,) edges along the own axes (m)
    remanence: float
    edge_nodes: int = 2  # dipoles along an edge of a block; EXACT: its closed form

    @classmethod
    def along(
        cls, centres: Array, axes: Array, size: Array, remanence: float, edge_nodes: int = 2
    ) -> Blocks:
        """Magnets with directions of magnetisation `axes` (m, 3), x edges as near x as can be."""
        third = axes / np.linalg.norm(axes, axis=1, keepdims=True)
        lead = np.where(np.abs(third[:, :1]) < 0.9, np.eye(3)[0], np.eye(3)[1])
        first = lead - (lead * third).sum(axis=1, keepdims=True) * third
        first /= np.linalg.norm(first, axis=1, keepdims=True)
        frames = np.stack([first, np.cross(third, first), third], axis=2)
        return cls(np.asarray(centres), frames, np.asarray(size), remanence, edge_nodes)

    def field(self, points: Array, moved: Array, turned: Array) -> Array:
        """Flux density (s, t, 3) (T) at points (t, 3) of the blocks where a body carried them.

        `moved` and `turned` (s, m, 3) are displacements of the centres (m) and rotation vectors.
        """
        spin = rotations(turned)
        places = self.centres + moved
        if self.edge_nodes == EXACT:
            return self._exact(points, places, spin)
        node, weight = np.polynomial.legendre.leggauss(self.edge_nodes)
        nodes = np.stack(np.meshgrid(*[0.5 * node] * 3, indexing='ij'), axis=-1).reshape(-1, 3)
        shares = np.einsum('i,j,k->ijk', *[0.5 * weight] * 3).reshape(-1)
        offsets = np.einsum('mij,nj->mni', self.frames, nodes * self.size)
        at = places[:, :, None] + np.einsum('smij,mnj->smni', spin, offsets)
        moment = magnet_moment(self.remanence, float(np.prod(self.size)))
        axes = np.einsum('smij,mj->smi', spin, moment * self.frames[:, :, 2])
        moments = axes[:, :, None] * shares[:, None]
        flat = (len(moved), -1, 3)
        return dipole_field(points, at.reshape(flat), moments.reshape(flat))

    def _exact(self, points: Array, places: Array, spin: Array) -> Array:
        """Field of blocks at places (s, m, 3) with spins (s, m, 3, 3)."""
        field = np.zeros((len(places), len(points), 3))
        polarisation = np.array([0.0, 0.0, self.remanence])
        for m, frame in enumerate(self.frames):
            turn = spin[:, m] @ frame
            own = np.einsum('sji,stj->sti', turn, points - places[:, m, None])
            field += np.einsum('sij,stj->sti', turn, cuboid_field(own, self.size, polarisation))
        return field

    def carried(self, displacement: Callable[[Array], Array]) -> tuple[Array, Array]:
        """Displacement (m) and turn (rad), (s, m, 3) each, of every block in a body.

        They are the mean displacement, and half the curl, of the middles of its six faces;
        `displacement` gives that of points (n, 3), shape (s, n, 3).
        """
        half = 0.5 * self.size
        faces = np.concatenate([np.diag(half), -np.diag(half)])
        points = self.centres[:, None] + np.einsum('mij,nj->mni', self.frames, faces)
        u = displacement(points.reshape(-1, 3))
        u = u.reshape(len(u), len(self.centres), 2, 3, 3)
        slope = (u[:, :, 0] - u[:, :, 1]) / self.size[:, None]
        # slope[j] is the derivative along own axis j; the curl in sensor axes
        curl = np.cross(np.moveaxis(self.frames, 2, 1)[None], slope).sum(axis=2)
        return u.mean(axis=(2, 3)), 0.5 * curl
