# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""The gradiometer's disc as dipoles on rings: what tables of its field are compared with."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.physics.fidelity import DIPOLE_COST, Model
from tactile_ros.physics.magnetics import dipole_field, magnet_moment, on_pixels

if TYPE_CHECKING:
    from tactile_ros.physics.magnetics import Disc
    from tactile_ros.types import Array

RINGS = ((1, 1, 1), (2, 1, 4), (2, 2, 5), (3, 2, 6), (3, 4, 8), (4, 5, 12))


def disc_dipoles(
    diameter: float, height: float, rings: tuple[int, int, int]
) -> tuple[Array, Array]:
    """Dipoles on rings that stand for a disc: places (m, 3) (m) and shares (m,) of its moment.

    Rings stand at Gauss points of the height and of the square of the radius. `rings`: levels of
    the height, rings on each, dipoles on a ring; (1, 1, 1): one at the centre.
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


def dipole_disc(pixels: Array, disc: Disc, rings: tuple[int, int, int]) -> Model:
    """Disc as some dipoles at pixels (t, 3)."""
    diameter, height, remanence = disc
    places, shares = disc_dipoles(diameter, height, rings)
    moment = magnet_moment(remanence, float(np.pi / 4 * diameter**2 * height))
    moments = moment * shares[:, None] * np.array([0.0, 0.0, 1.0])
    readings = on_pixels(pixels, lambda own: dipole_field(own, places, moments))
    name = f'{len(places)} dipoles' if len(places) > 1 else 'dipole'
    return Model(name, readings, DIPOLE_COST * len(places) * len(pixels), size=rings)
