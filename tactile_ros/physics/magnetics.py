"""Fields of block and disc magnets in closed form, and of stray fields.

Blocks: the charge of two faces for each component of the polarisation (Furlani, Permanent Magnet
and Electromechanical Devices, 2001, sec. 4.4), written with asinh so that nothing cancels. Discs
along their axis: Derby and Olbert, Am. J. Phys. 78, 2010, by Bulirsch's elliptic integral.
On edges and corners, where the field is infinite, it is that of a billionth of the size away; far
away, where closed forms cancel, that of a dipole.
"""

from __future__ import annotations

import numpy as np

from tactile_ros.physics.dipoles import dipole_field, magnet_moment
from tactile_ros.types import Array

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
