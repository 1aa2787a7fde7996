"""Fields of block and disc magnets in closed form, and of stray fields.

Blocks: the charge of two faces for each component of the polarisation (Furlani, Permanent Magnet
and Electromechanical Devices, 2001, sec. 4.4), written with asinh so that nothing cancels. Discs
along their axis: Derby and Olbert, Am. J. Phys. 78, 2010, by Bulirsch's elliptic integral.
On edges and corners, where the field is infinite, it is that of a billionth of the size away; far
away, where closed forms cancel, that of a dipole.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.physics.fidelity import DIPOLE_COST, DISC_COST, Model
from tactile_ros.types import Array

if TYPE_CHECKING:
    from collections.abc import Callable

VACUUM_PERMEABILITY = 4e-7 * np.pi  # T m / A
SCALE = VACUUM_PERMEABILITY / (4 * np.pi)


def magnet_moment(remanence: float, volume: float) -> float:
    """Moment of a magnet (A m2) from its remanence (T) and volume (m3).

    Examples
    --------
    >>> round(1e3 * magnet_moment(1.4, 4e-9), 2)
    4.46
    """
    return remanence * volume / VACUUM_PERMEABILITY


def dipole_field(points: Array, places: Array, moments: Array) -> Array:
    """Sum of the fields of dipoles.

    Parameters
    ----------
    points : ndarray, shape (..., t, 3)
        Where the field is wanted (m).
    places : ndarray, shape (..., m, 3)
        Where the dipoles are (m); not at a point.
    moments : ndarray, shape (..., m, 3)
        Their moments (A m2).

    Returns
    -------
    ndarray, shape (..., t, 3)
        Flux density (T).

    Examples
    --------
    >>> up = np.array([[0.0, 0.0, 1.0]])
    >>> near, far = (dipole_field(x * up, 0 * up, up)[0, 2] for x in (0.1, 0.2))
    >>> round(float(near / far), 9)
    8.0
    """
    r = points[..., :, None, :] - places[..., None, :, :]
    moment = moments[..., None, :, :]
    near = 1 / np.einsum('...i,...i->...', r, r)
    along = 3 * near * np.einsum('...i,...i->...', moment, r)
    weight = SCALE * near * np.sqrt(near)
    field: Array = np.einsum('...mi,...m->...i', along[..., None] * r - moment, weight)
    return field


def field_of_many(points: Array, places: Array, moments: Array) -> Array:
    """The same as `dipole_field` for points (t, 3) and dipoles (m, 3) that fill a cache.

    Examples
    --------
    >>> points, places = np.eye(3), -np.eye(3)
    >>> found = field_of_many(points, places, points)
    >>> bool(np.allclose(found, dipole_field(points, places, points), rtol=1e-12))
    True
    """
    at, along = np.ascontiguousarray(places.T), np.ascontiguousarray(moments.T)
    field = np.empty(points.shape)
    for row, point in enumerate(points):
        x, y, z = (point[i] - at[i] for i in range(3))
        squared = x * x + y * y + z * z
        near = 1 / (squared * np.sqrt(squared))
        far = 3 * near * (along[0] * x + along[1] * y + along[2] * z) / squared
        field[row] = [far @ r - near @ m for r, m in zip((x, y, z), along, strict=True)]
    return SCALE * field


def dipole_gradients(points: Array, places: Array, moments: Array) -> Array:
    """Change of the field at each point with the place of each dipole.

    Parameters
    ----------
    points : ndarray, shape (t, 3)
        Where the field is wanted (m).
    places, moments : ndarray, shape (m, 3)
        Dipoles (m, A m2).

    Returns
    -------
    ndarray, shape (t, 3, m, 3)
        d B[t, i] / d place[m, j] (T / m).

    Examples
    --------
    >>> up = np.array([[0.0, 0.0, 1.0]])
    >>> moved = dipole_field(up, 1e-6 * up, up) - dipole_field(up, 0 * up, up)
    >>> slope = dipole_gradients(up, 0 * up, up)[0, 2, 0, 2]
    >>> bool(np.isclose(slope, 1e6 * moved[0, 2], rtol=1e-4))
    True
    """
    r = points[:, None, :] - places[None]
    near = 1 / np.linalg.norm(r, axis=-1)[..., None, None]
    along = np.sum(moments[None] * r, axis=-1)[..., None, None]
    m, ri, rj = moments[None, :, :, None], r[..., :, None], r[..., None, :]
    mj = moments[None, :, None, :]
    by_point = (
        SCALE
        * 3
        * ((m * rj + mj * ri + along * np.eye(3)) * near**5 - 5 * along * ri * rj * near**7)
    )
    return np.moveaxis(-by_point, 1, 2)


def in_chip_axes(field: Array, rotations: Array | None) -> Array:
    """Fields (..., t, 3) in sensor axes as chips turned by `rotations` (t, 3, 3) read them."""
    if rotations is None:
        return field
    turned: Array = np.einsum('tji,...tj->...ti', rotations, field)
    return turned


FAR = 100.0  # sizes from which a magnet is a dipole
EDGE = 1e-9  # sizes: how near to an edge the field still rises
ROUNDS = 12
CONVERGED = 1e-9  # of a mean that converges quadratically


def cuboid_field(points: Array, size: Array, polarisation: Array) -> Array:
    """Field of a block whose polarisation is the same throughout.

    Parameters
    ----------
    points : ndarray, shape (..., 3)
        From its centre, along its edges (m).
    size : ndarray, shape (3,)
        Its edges (m).
    polarisation : ndarray, shape (3,)
        Remanence times direction (T).

    Returns
    -------
    ndarray, shape (..., 3)
        Flux density (T); inside the block that of its inside.

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
        part = _charged_faces(points[..., turn], half[turn])
        field[..., turn] += polarisation[axis] * part
    inside = np.asarray(np.abs(points) < half).all(axis=-1, keepdims=True)
    field += inside * polarisation
    moment = polarisation * magnet_moment(1.0, float(8 * half.prod()))
    return _beyond(points, field, float(2 * half.max()), moment)


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


def _beyond(points: Array, field: Array, size: float, moment: Array) -> Array:
    """Field (..., 3), of a dipole where points are far away."""
    far = np.linalg.norm(points, axis=-1) > FAR * size
    if far.any():
        away = points[far][:, None]
        field[far] = dipole_field(away, np.zeros((1, 3)), moment[None])[:, 0]
    return field


def cylinder_field(points: Array, diameter: float, height: float, remanence: float) -> Array:
    """Field of a disc magnetised along its axis z.

    Parameters
    ----------
    points : ndarray, shape (..., 3)
        From its centre (m).
    diameter, height : float
        Of the disc (m).
    remanence : float
        Along z (T).

    Returns
    -------
    ndarray, shape (..., 3)
        Flux density (T); inside the disc that of its inside.

    Examples
    --------
    >>> field = cylinder_field(np.array([0.0, 0.0, 3e-3]), 2e-3, 1e-3, 1.4)
    >>> (1e3 * field).round(3).tolist()
    [0.0, 0.0, 23.133]
    """
    points = np.asarray(points, float)
    rho = np.hypot(points[..., 0], points[..., 1])
    radial, axial = axial_cylinder(rho, points[..., 2], diameter, height, remanence)
    outward = points[..., :2] / np.maximum(rho, np.finfo(float).tiny)[..., None]
    field = np.concatenate([radial[..., None] * outward, axial[..., None]], axis=-1)
    moment = magnet_moment(remanence, float(np.pi / 4 * diameter**2 * height))
    return _beyond(points, field, max(diameter, height), np.array([0.0, 0.0, moment]))


def axial_cylinder(
    rho: Array, z: Array, diameter: float, height: float, remanence: float
) -> tuple[Array, Array]:
    """Radial and axial field of a disc magnetised along its axis.

    Parameters
    ----------
    rho, z : ndarray, shape (...)
        Distance from the axis, and height over the disc's centre (m).
    diameter, height : float
        Of the disc (m).
    remanence : float
        Along z (T).

    Returns
    -------
    radial, axial : ndarray, shape (...)
        Flux density (T).
    """
    a, half = diameter / 2, height / 2
    radial, axial = np.zeros(np.shape(rho)), np.zeros(np.shape(rho))
    gap = a - rho
    gap = np.where(np.abs(gap) < EDGE * a, EDGE * a, gap)
    gamma = gap / (a + rho)
    for sign in (1.0, -1.0):
        end = z + sign * half
        reach = np.hypot(end, rho + a)
        root = np.hypot(end, gap) / reach
        one = np.ones_like(root)
        radial += sign * a / reach * complete_elliptic(root, one, one, -one)
        axial += sign * end / reach * complete_elliptic(root, gamma * gamma, one, gamma)
    return remanence / np.pi * radial, remanence / np.pi * a / (a + rho) * axial


def complete_elliptic(kc: Array, p: Array, c: Array, s: Array) -> Array:
    """Bulirsch's complete elliptic integral (Numer. Math. 13, 1969), p > 0, kc > 0.

    Parameters
    ----------
    kc, p, c, s : ndarray, shape (...)
        The integral over a quarter turn of (c cos^2 + s sin^2) / (cos^2 + p sin^2) /
        sqrt(cos^2 + kc^2 sin^2).

    Returns
    -------
    ndarray, shape (...)
        Its value.

    Examples
    --------
    >>> one = np.ones(1)
    >>> complete_elliptic(one, one, one, one).round(6).tolist()
    [1.570796]
    """
    k, kk, em = kc, kc, np.ones_like(kc)
    p = np.sqrt(p)
    s = s / p
    g = em
    for turn in range(ROUNDS):
        c, s, p = _landen(c, s, p, kk)
        g, em = em, k + em
        if turn and (np.abs(g - k) <= CONVERGED * g).all():
            break
        k = 2 * np.sqrt(kk)
        kk = k * em
    return np.asarray(np.pi / 2 * (s + c * em) / (em * (em + p)))


def _landen(c: Array, s: Array, p: Array, kk: Array) -> tuple[Array, Array, Array]:
    """One step of Bulirsch's iteration."""
    g = kk / p
    return c + s / p, 2 * (s + c * g), p + g


def disc_on_pixels(
    pixels: Array, places: Array, tilts: Array, disc: tuple[float, float, float]
) -> Array:
    """Field at pixels of a disc that may be tilted.

    Parameters
    ----------
    pixels : ndarray, shape (t, 3)
        Where the field is wanted (m).
    places : ndarray, shape (s, 3)
        Centres of the disc (m).
    tilts : ndarray, shape (s, 2)
        Its turn about x and y, as a rotation vector (rad).
    disc : tuple of float
        Diameter, height (m) and remanence (T).

    Returns
    -------
    ndarray, shape (s, t, 3)
        Flux density (T).
    """
    turn = tilt_rotation(tilts)
    apart = pixels[None] - places[:, None]
    own = np.einsum('sji,stj->sti', turn, apart)
    return np.asarray(np.einsum('sij,stj->sti', turn, cylinder_field(own, *disc)))


def tilt_rotation(tilts: Array) -> Array:
    """Rotation matrices (s, 3, 3) of turns (s, 2) about x and y (rad).

    Examples
    --------
    >>> tilt_rotation(np.array([[0.0, np.pi / 2]]))[0, :, 2].round(9).tolist()
    [1.0, 0.0, 0.0]
    """
    a, b = tilts[:, 0], tilts[:, 1]
    angle = np.hypot(a, b)
    sine = np.sinc(angle / np.pi)
    versine = 0.5 * np.sinc(angle / (2 * np.pi)) ** 2
    turn = np.empty((len(tilts), 3, 3))
    turn[:, 0, 0], turn[:, 1, 1] = 1 - versine * b * b, 1 - versine * a * a
    turn[:, 2, 2] = np.cos(angle)
    turn[:, 0, 1] = turn[:, 1, 0] = versine * a * b
    turn[:, 0, 2], turn[:, 2, 0] = sine * b, -sine * b
    turn[:, 1, 2], turn[:, 2, 1] = -sine * a, sine * a
    return turn


def uniform_stray(points: Array, field: Array) -> Array:
    """Stray field (..., t, 3) (T) at points (t, 3) of one that is the same everywhere: (..., 3).

    Examples
    --------
    >>> uniform_stray(np.zeros((4, 3)), np.array([[1e-3, 0.0, 0.0]])).shape
    (1, 4, 3)
    """
    field = np.asarray(field, float)
    return np.broadcast_to(field[..., None, :], (*field.shape[:-1], len(points), 3))


def dipole_stray(points: Array, place: Array, moment: Array) -> Array:
    """Stray field (t, 3) (T) at points (t, 3) of a magnet of a moment (3,) (A m2) at (3,) (m)."""
    return dipole_field(points, place[None], moment[None])


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


Disc = tuple[float, float, float]
RINGS = ((1, 1, 1), (2, 1, 4), (2, 2, 5), (3, 2, 6), (3, 4, 8), (4, 5, 12))


def disc_dipoles(
    diameter: float, height: float, rings: tuple[int, int, int]
) -> tuple[Array, Array]:
    """Dipoles that stand for a disc.

    Parameters
    ----------
    diameter, height : float
        Of the disc (m).
    rings : tuple of int
        Levels of the height, rings on each, dipoles on a ring; (1, 1, 1): one at the centre.

    Returns
    -------
    places : ndarray, shape (m, 3)
        From the centre (m).
    shares : ndarray, shape (m,)
        Of the moment.

    Examples
    --------
    >>> places, shares = disc_dipoles(2e-3, 1e-3, (2, 2, 5))
    >>> len(places), round(float(shares.sum()), 12)
    (20, 1.0)
    """
    levels, count, around = rings
    z, wz = np.polynomial.legendre.leggauss(levels)
    square, wr = np.polynomial.legendre.leggauss(count)
    radius = np.sqrt((square + 1) / 2) * (diameter / 2 if around > 1 else 0.0)
    # rings are turned against each other, lest they share their corners
    turn = 2 * np.pi * (np.arange(around) + 0.5 * np.arange(levels * count)[:, None]) / around
    tall, wide = np.repeat(z * height / 2, count)[:, None], np.tile(radius, levels)[:, None]
    places = np.stack([wide * np.cos(turn), wide * np.sin(turn), tall + 0 * turn], axis=-1)
    weight = np.repeat(wz, count) * np.tile(wr, levels) / 4
    return places.reshape(-1, 3), np.repeat(weight / around, around)


def on_pixels(pixels: Array, own_field: Callable[[Array], Array]) -> Callable[[Array], Array]:
    """Readings (s, t, 3) of discs at states (s, 5) from a field (n, 3) in their own axes."""

    def readings(states: Array) -> Array:
        turn = tilt_rotation(states[:, 3:])
        apart = pixels[None] - states[:, None, :3]
        own = np.einsum('sji,stj->sti', turn, apart)
        field = own_field(own.reshape(-1, 3)).reshape(own.shape)
        return np.asarray(np.einsum('sij,stj->sti', turn, field))

    return readings


def dipole_disc(pixels: Array, disc: Disc, rings: tuple[int, int, int]) -> Model:
    """Some dipoles at pixels (t, 3)."""
    diameter, height, remanence = disc
    places, shares = disc_dipoles(diameter, height, rings)
    moment = magnet_moment(remanence, float(np.pi / 4 * diameter**2 * height))
    moments = moment * shares[:, None] * np.array([0.0, 0.0, 1.0])
    name = f'{len(places)} dipoles' if len(places) > 1 else 'dipole'
    cost = DIPOLE_COST * len(places) * len(pixels)

    def field(own: Array) -> Array:
        return dipole_field(own, places, moments)

    return Model(name, on_pixels(pixels, field), cost, size=rings)


def exact_disc(pixels: Array, disc: Disc) -> Model:
    """The closed form at pixels (t, 3)."""

    def readings(states: Array) -> Array:
        return disc_on_pixels(pixels, states[:, :3], states[:, 3:], disc)

    return Model('exact', readings, DISC_COST * len(pixels))
