"""How an incompressible soft body on a rigid base gives way to a load on its surface.

A load on the free surface of an incompressible half-space moves a point at r by
(F / r + (F . r) r / r^3) / (4 pi G), whatever its direction (Boussinesq and Cerruti with a
Poisson ratio of one half; Johnson, Contact Mechanics, 1985, secs. 3.2 and 3.6). A base to which
the body is bonded holds it: the images of Blake (Proc. Camb. Phil. Soc. 70, 1971) make the
displacement vanish there. The truth of a layer on a base lies between the two.
"""

from __future__ import annotations

import numpy as np

from tactile_ros.types import Array

# Hexagon and centre: integrates polynomials up to the fifth degree over a disc
# (Abramowitz and Stegun, 25.4.61).
RING = np.arange(6) * np.pi / 3
DISC = np.vstack([np.zeros(2), np.sqrt(2 / 3) * np.column_stack([np.cos(RING), np.sin(RING)])])
SHARES = np.array([0.25] + [0.125] * 6)
NEAREST = 1e-5  # m, inside which a load counts as spread out


def point_load(points: Array, loads: Array, forces: Array, shear_modulus: float) -> Array:
    """Displacement of a half-space under point loads on its surface.

    Parameters
    ----------
    points : ndarray, shape (..., 3)
        Where it is wanted (m).
    loads : ndarray, shape (..., 3)
        Where the loads act (m).
    forces : ndarray, shape (..., 3)
        On the body (N).
    shear_modulus : float
        Of the body (Pa).

    Returns
    -------
    ndarray, shape (..., 3)
        Displacements (m).

    Examples
    --------
    >>> down = np.array([0.0, 0.0, -1.0])
    >>> 1e6 * point_load(5e-3 * down, 0 * down, down, 1e5).round(9)
    array([   0.   ,    0.   , -318.309])
    """
    r = points - loads
    near = 1 / np.sqrt((r * r).sum(axis=-1, keepdims=True) + NEAREST**2)
    along = (forces * r).sum(axis=-1, keepdims=True)
    moved: Array = (forces * near + along * r * near**3) / (4 * np.pi * shear_modulus)
    return moved


def base_image(points: Array, loads: Array, forces: Array, shear_modulus: float) -> Array:
    """Displacement that a rigid base at z = 0 adds to `point_load`, which takes the same.

    Notes
    -----
    Blake (1971), Eq. (2.3), doubled as the free surface doubles the load's own field.

    Examples
    --------
    >>> base, load = np.array([3e-3, 0.0, 0.0]), np.array([0.0, 0.0, 4e-3])
    >>> force = np.array([1.0, 2.0, -3.0])
    >>> held = [f(base, load, force, 1e5) for f in (point_load, base_image)]
    >>> bool(np.abs(sum(held)).max() < 1e-5 * np.abs(held[0]).max())
    True
    """
    height = loads[..., 2:]
    mirrored = forces * np.array([1.0, 1.0, -1.0])
    r = points - loads * np.array([1.0, 1.0, -1.0])
    near = 1 / np.linalg.norm(r, axis=-1, keepdims=True)
    z, up = r[..., 2:], np.array([0.0, 0.0, 1.0])
    along = (forces * r).sum(axis=-1, keepdims=True)
    across = (mirrored * r).sum(axis=-1, keepdims=True)
    lift = mirrored[..., 2:]
    dipoles = height * (mirrored * near**3 - 3 * r * across * near**5)
    dipoles += (up * across - mirrored * z - r * lift) * near**3 + 3 * r * z * across * near**5
    moved: Array = -forces * near - along * r * near**3 + 2 * height * dipoles
    return moved / (4 * np.pi * shear_modulus)


def disc_press(
    points: Array,
    contacts: Array,
    normals: Array,
    forces: Array,
    radius: Array,
    shear_modulus: float,
    bond: Array,
) -> Array:
    """Displacement under even pressure on discs of the surface.

    Parameters
    ----------
    points : ndarray, shape (s, m, 3)
        Where it is wanted (m).
    contacts, normals : ndarray, shape (s, 3)
        Centres of the discs (m), and what they are normal to.
    forces : ndarray, shape (s, 3)
        On the body (N).
    radius : ndarray, shape (s,)
        Of the discs (m).
    shear_modulus : float
        Of the body (Pa).
    bond : ndarray, shape (s,)
        Share of the base's image, 0 (half-space) to 1 (bonded at z = 0).

    Returns
    -------
    ndarray, shape (s, m, 3)
        Displacements (m).
    """
    first = np.cross(normals, np.array([1.0, 0.0, 0.0]))
    flat = np.linalg.norm(first, axis=1, keepdims=True)
    first = np.where(flat > 1e-6, first / np.maximum(flat, 1e-6), np.array([0.0, 1.0, 0.0]))
    second = np.cross(normals, first)
    moved = np.zeros_like(points)
    held = bool(np.any(bond))
    for (u, v), share in zip(DISC, SHARES, strict=True):
        load = (contacts + radius[:, None] * (u * first + v * second))[:, None]
        part = share * forces[:, None]
        moved += point_load(points, load, part, shear_modulus)
        if held:
            moved += bond[:, None, None] * base_image(points, load, part, shear_modulus)
    return moved
