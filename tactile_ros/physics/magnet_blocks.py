"""Block magnets that are carried and turned by a soft body, each as some dipoles, or exact.

Eight dipoles at the Gauss points of a block have its octupole: with blocks of 2 x 2 x 1 mm at 6 mm
they differ from the exact field by a thousandth, and a turned block costs no more than a straight
one. Centre and turn of a block follow from the displacements at the middles of its six faces.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.physics.dipoles import dipole_field, magnet_moment
from tactile_ros.physics.magnetics import cuboid_field
from tactile_ros.types import Array

if TYPE_CHECKING:
    from collections.abc import Callable

EXACT = 0  # edge nodes: the closed form of a block


@dataclass(frozen=True)
class Blocks:
    """Magnets of one size.

    Attributes
    ----------
    centres : ndarray, shape (m, 3)
        At rest (m).
    frames : ndarray, shape (m, 3, 3)
        Columns are a magnet's own axes; the third is that of its magnetisation.
    size : ndarray, shape (3,)
        Edges along the own axes (m).
    remanence : float
        Of all (T).
    edge_nodes : int
        Dipoles along an edge of a block: 1, 2 (eight dipoles) or more; `EXACT`: its closed form.
    """

    centres: Array
    frames: Array
    size: Array
    remanence: float
    edge_nodes: int = 2

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
        """Flux density of the blocks where a body has carried them.

        Parameters
        ----------
        points : ndarray, shape (t, 3)
            Where it is wanted (m).
        moved : ndarray, shape (s, m, 3)
            Displacements of the centres (m).
        turned : ndarray, shape (s, m, 3)
            Rotation vectors (rad).

        Returns
        -------
        ndarray, shape (s, t, 3)
            Flux density (T).
        """
        spin = rotations(turned)
        places = self.centres + moved
        if self.edge_nodes == EXACT:
            return self._exact(points, places, spin)
        nodes, shares = gauss_points(self.edge_nodes)
        offsets = np.einsum('mij,nj->mni', self.frames, nodes * self.size)
        at = places[:, :, None] + np.einsum('smij,mnj->smni', spin, offsets)
        moment = magnet_moment(self.remanence, float(np.prod(self.size)))
        axes = np.einsum('smij,mj->smi', spin, moment * self.frames[:, :, 2])
        moments = axes[:, :, None] * shares[:, None]
        flat = (len(moved), -1, 3)
        return dipole_field(points, at.reshape(flat), moments.reshape(flat))

    def _exact(self, points: Array, places: Array, spin: Array) -> Array:
        """Field (s, t, 3) (T) at points (t, 3) of blocks at (s, m, 3) with spins (s, m, 3, 3)."""
        field = np.zeros((len(places), len(points), 3))
        polarisation = np.array([0.0, 0.0, self.remanence])
        for m, frame in enumerate(self.frames):
            turn = spin[:, m] @ frame
            own = np.einsum('sji,stj->sti', turn, points - places[:, m, None])
            field += np.einsum('sij,stj->sti', turn, cuboid_field(own, self.size, polarisation))
        return field

    def carried(self, displacement: Callable[[Array], Array]) -> tuple[Array, Array]:
        """Displacement and turn (rad) of every block in a body.

        Parameters
        ----------
        displacement : callable
            Of points (n, 3): shape (s, n, 3) (m).

        Returns
        -------
        moved, turned : ndarray, shape (s, m, 3)
            Means over the faces (m), and half the curl from face to face (rad).
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


def gauss_points(edge_nodes: int) -> tuple[Array, Array]:
    """Gauss points (n, 3) of a block of edges 1, and their shares (n,) of its volume.

    Examples
    --------
    >>> points, shares = gauss_points(2)
    >>> len(points), round(float(points.max()), 4), round(float(shares.sum()), 9)
    (8, 0.2887, 1.0)
    """
    node, weight = np.polynomial.legendre.leggauss(edge_nodes)
    grid = np.stack(np.meshgrid(*[0.5 * node] * 3, indexing='ij'), axis=-1).reshape(-1, 3)
    shares = np.einsum('i,j,k->ijk', *[0.5 * weight] * 3).reshape(-1)
    return grid, shares


def rotations(vectors: Array) -> Array:
    """Rotation matrices (..., 3, 3) of rotation vectors (..., 3) (rad), by Rodrigues.

    Examples
    --------
    >>> rotations(np.array([0.0, 0.0, np.pi / 2])).round(9)[:, 0] + 0.0
    array([0., 1., 0.])
    """
    angle = np.linalg.norm(vectors, axis=-1)[..., None, None]
    x, y, z = np.moveaxis(vectors, -1, 0)
    zero = np.zeros_like(x)
    rows = [[zero, -z, y], [z, zero, -x], [-y, x, zero]]
    cross = np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
    once, twice = np.sinc(angle / np.pi), 0.5 * np.sinc(angle / (2 * np.pi)) ** 2
    turned: Array = np.eye(3) + once * cross + twice * (cross @ cross)
    return turned
