"""Fields of point dipoles, and how they change with the dipoles' places.

Jackson, Classical Electrodynamics, 3rd ed., Eq. (5.56). [2] Eq. (1) with its denominator mended:
the distance enters with the third power.
"""

from __future__ import annotations

import numpy as np

from tactile_ros.types import Array

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
