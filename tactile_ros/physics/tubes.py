"""Contact of an angle tube: two half-axes from one origin, and the pressure beside them.

A cylinder that sinks into a bed of springs presses as deep as it lies under the surface, into an
elastic half-space like the root of 1 - q^2 (Hertz, q = distance / half width); a strip is even.
"""

from __future__ import annotations

import numpy as np

from tactile_ros.types import Array

PROFILES = ('strip', 'half-space', 'springs')
STRIP, HALF_SPACE, SPRINGS = range(3)


def nearest_axis(u: Array, v: Array, bend: float) -> tuple[Array, Array, Array]:
    """Distance of points from the nearer half-axis, and the direction away from it.

    Parameters
    ----------
    u, v : ndarray, shape (...)
        Points in the tube's frame, one axis along +u (m).
    bend : float
        Of the other axis (rad).

    Returns
    -------
    distance, across_u, across_v : ndarray, shape (...)
        Distance (m), and the unit vector from the axis to the point.

    Examples
    --------
    >>> distance, _, across = nearest_axis(np.array([2.0]), np.array([-0.5]), np.pi / 2)
    >>> float(distance[0]), float(across[0])
    (0.5, -1.0)
    """
    cos, sin = np.cos(bend), np.sin(bend)
    along = np.maximum(cos * u + sin * v, 0.0)
    first_u = u - np.maximum(u, 0.0)
    other_u, other_v = u - cos * along, v - sin * along
    first = first_u**2 + v**2
    other = other_u**2 + other_v**2
    nearer = first <= other
    across_u, across_v = np.where(nearer, first_u, other_u), np.where(nearer, v, other_v)
    distance = np.sqrt(np.minimum(first, other)) + 1e-12
    return distance, across_u / distance, across_v / distance


def contact_profile(
    distance: Array, half_width: Array, blur: float, profile: int, radius: float
) -> tuple[Array, Array, Array]:
    """Mean pressure, 1 at most without blur, across a line of contact.

    Parameters
    ----------
    distance : ndarray, shape (...)
        From the axis (m).
    half_width : ndarray, shape (...)
        Of the contact, below the radius (m).
    blur : float
        Half the way across the axis that the mean is taken over (m).
    profile : int
        Index into `PROFILES`.
    radius : float
        Of the cylinder (m).

    Returns
    -------
    value, by_distance, by_width : ndarray, shape (...)
        Mean, and its slopes (1/m).

    Examples
    --------
    >>> contact_profile(np.array([0.0, 3.0]), np.array([2.0]), 0.5, 0, 4.0)[0].tolist()
    [1.0, 0.0]
    """
    whole = _springs if profile == SPRINGS else _strip if profile == STRIP else _half_space
    above, here, rise = whole(distance + blur, half_width, radius)
    below, there, fall = whole(distance - blur, half_width, radius)
    per = 0.5 / blur
    return per * (above - below), per * (here - there), per * (rise - fall)


def _strip(z: Array, w: Array, radius: float) -> tuple[Array, Array, Array]:
    """Integral of the profile from 0 to z, the profile, and the integral's slope with w."""
    inner = np.minimum(np.maximum(z, -w), w)
    inside = inner == z
    return inner, inside * 1.0, np.where(inside, 0.0, np.sign(inner))


def _half_space(z: Array, w: Array, radius: float) -> tuple[Array, Array, Array]:
    """As of `_strip`: the square root of 1 - z^2 / w^2."""
    q = np.minimum(np.maximum(z / w, -1.0), 1.0)
    root = np.sqrt(1.0 - q * q)
    arc = np.arcsin(q)
    return 0.5 * w * (q * root + arc), root, 0.5 * (arc - q * root)


def _springs(z: Array, w: Array, radius: float) -> tuple[Array, Array, Array]:
    """As of `_strip`: how deep a circle lies under its chord, in parts of the deepest."""
    inner = np.minimum(np.maximum(z, -w), w)
    chord = np.sqrt(radius**2 - w * w)
    root = np.sqrt(radius**2 - inner * inner)
    deepest = radius - chord
    area = 0.5 * (inner * root + radius**2 * np.arcsin(inner / radius)) - inner * chord
    rise = w / chord
    return area / deepest, (root - chord) / deepest, (inner - area / deepest) * rise / deepest
