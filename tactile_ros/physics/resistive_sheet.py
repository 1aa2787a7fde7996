# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Resistances of a weakly conducting sheet with a well conducting border, flat or unrolled.

[5] Eq. (1): the potential of the sheet obeys Laplace's equation. Its missing equations are R = Rx
+ Rv + RE and V = Vcc R0 / (R0 + R). A curved panel that can be unrolled is a flat sheet with the
outline of its development: what conducts along the surface does not feel the bend.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tactile_ros.physics.compiled import compiled
from tactile_ros.types import Array

EQUAL_AREA = 0.59  # radius of the disc of equal outer conductance, over the edge of a square
LEAST_LOG = float(np.log(1.05))
MOST_WIDTHS = 30.0  # beyond which the far side of a sheet does not count
NEAREST = 1e-3  # of the edge: no touch counts as nearer to the border


def linear_place(potentials: Array, size: Array) -> Array:
    """Place (..., 2) (m from electrode A) at which ideal linear potentials have given values.

    `potentials` (..., 2) are u_AC (1 at A) and u_BD (1 at B); `size` (2,) is of the sheet (m).
    [5], section 2.2.

    Examples
    --------
    >>> linear_place(np.array([0.5, 0.75]), np.array([0.1, 0.1])).round(3).tolist()
    [0.075, 0.025]
    """
    mean, turn = 1.0 - potentials[..., 0], potentials[..., 1] - 0.5
    return np.asarray(np.stack([mean + turn, mean - turn], axis=-1) * size)


@compiled
def series_resistance(x: float, y: float, law: Array) -> float:
    """Rx over R0 at a place in units of the edges, by the law (4,) of `SeriesResistance`."""
    t, across = (y, x) if law[0] > 0.5 else (x, y)
    far, near = law[1], law[1] * min(1.0 - NEAREST, max(NEAREST, t))
    bump = math.sin(math.pi * min(1.0 - NEAREST, max(NEAREST, across))) ** 2
    square = bump * (1.0 + bump / math.sinh(far) ** 2) ** 2
    for away in (near, far - near, far + near, 2.0 * far - near):
        square /= 1.0 + bump / math.sinh(away) ** 2
    return float(max(law[2] + 0.5 * math.log(square), LEAST_LOG) * law[3])


@dataclass(frozen=True)
class SeriesResistance:
    """Rx from a touch to the joined corners over a border that conducts perfectly, over R0.

    Attributes
    ----------
    size : ndarray, shape (2,)
        Of the sheet (m).
    touch : float
        Edge of a square touch (m).
    sheet : float
        Sheet resistance over R0 of the divider (1 per square); 0: no Rx.

    Notes
    -----
    Sheet / 2 pi times the logarithm of the conformal radius over the touch's own. The radius is
    that of a strip as wide as the sheet is short, times what the six nearest sources beyond the
    other two sides make of it that keep those at one potential.
    """

    size: Array
    touch: float
    sheet: float

    def at(self, places: Array) -> Array:
        """Rx over R0 (s,) at places (s, 2) inside the sheet, in units of its edges."""
        return np.array([series_resistance(x, y, self.law) for x, y in places])

    @cached_property
    def law(self) -> Array:
        """Which axis is longer, pi times its length in widths, the strip's radius, factor (4,)."""
        long = int(self.size[1] > self.size[0])
        width = self.size[1 - long]
        far = np.pi * min(self.size[long] / width, MOST_WIDTHS)
        strip = np.log(2 * width / np.pi / (EQUAL_AREA * self.touch))
        return np.array([long, far, strip, self.sheet / (2 * np.pi)])


def unrolled(places: Array, radius: float) -> Array:
    """Flat places (s, 2) of places (s, 3) on a cylinder of a radius (m) about the y axis.

    The top of the cylinder, at z = 0, is x = 0; z falls to both sides.
    """
    x, y, z = places.T
    return np.stack([radius * np.arctan2(x, radius + z), y], axis=1)


def rolled(places: Array, radius: float) -> Array:
    """Places (s, 3) on a cylinder of a radius (m) of flat places (s, 2); undoes `unrolled`."""
    x, y = places.T
    turn = x / radius
    return np.stack([radius * np.sin(turn), y, radius * (np.cos(turn) - 1)], axis=1)
