"""Models of a disc magnet over pixels, from one dipole to the closed form, with their costs.

Dipoles of a disc stand on rings at Gauss points: of the height, and of the square of the radius,
so that every ring stands for its share of the volume.
"""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.physics.dipoles import dipole_field, magnet_moment
from tactile_ros.physics.disc_table import disc_table, table_at
from tactile_ros.physics.fidelity import (
    CUBIC_COST,
    DIPOLE_COST,
    DISC_COST,
    LINEAR_COST,
    Model,
)
from tactile_ros.physics.magnetics import disc_on_pixels, tilt_rotation
from tactile_ros.types import Array

if TYPE_CHECKING:
    from collections.abc import Callable

Disc = tuple[float, float, float]
RINGS = ((1, 1, 1), (2, 1, 4), (2, 2, 5), (3, 2, 6), (3, 4, 8), (4, 5, 12))
SHAPES = (
    (13, 9), (25, 17), (37, 25), (49, 33), (73, 49), (97, 65), (128, 96), (161, 113), (193, 129),
    (257, 193),
)  # fmt: skip


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


def table_disc_model(
    pixels: Array,
    disc: Disc,
    reach: tuple[float, float, float],
    shape: tuple[int, int],
    degree: int = 3,
) -> Model:
    """Table of a shape, linear or cubic (degree 3), at pixels (t, 3); built when first needed."""
    diameter, height, remanence = disc
    kind, cost = ('cubic', CUBIC_COST) if degree == 3 else ('linear', LINEAR_COST)

    @cache
    def built() -> tuple[Array, Array]:
        return disc_table(diameter, height, reach, shape)

    def field(own: Array) -> Array:
        return remanence * table_at(own, *built(), degree)

    name = f'{kind} table {shape[0]} x {shape[1]}'
    numbers = 2 * shape[0] * shape[1]
    return Model(name, on_pixels(pixels, field), cost * len(pixels), numbers, shape)


def exact_disc(pixels: Array, disc: Disc) -> Model:
    """The closed form at pixels (t, 3)."""

    def readings(states: Array) -> Array:
        return disc_on_pixels(pixels, states[:, :3], states[:, 3:], disc)

    return Model('exact', readings, DISC_COST * len(pixels))


def table_reach(pixels: Array, states: Array) -> tuple[float, float, float]:
    """Reach of a table that holds discs at states (s, 5) over pixels (t, 3), with some room."""
    turn = tilt_rotation(states[:, 3:])
    own = np.einsum('sji,stj->sti', turn, pixels[None] - states[:, None, :3])
    depth = -own[..., 2]
    room = 0.05 * float(np.ptp(depth))
    far = 1.05 * float(np.hypot(own[..., 0], own[..., 1]).max())
    return far, float(depth.min()) - room, float(depth.max()) + room
