"""Place and force on a resistive sheet row by row, for a compiler.

The loops that `harmonic_map` and `power_force` have as arrays; cosines and powers come from their
recurrences.
"""

from __future__ import annotations

import math

import numpy as np

from tactile_ros.physics.compiled import compiled
from tactile_ros.physics.resistive_sheet import LEAST_LOG, NEAREST
from tactile_ros.types import Array


@compiled
def held(value: float, low: float, high: float) -> float:
    """A number between two others; the lower one for NaN."""
    if value > high:
        return high
    return value if value > low else low


@compiled
def square_of(root: Array, square: Array) -> None:
    """Fill a matrix (2, 2) with a root (2, 2) times its transpose."""
    for i in range(2):
        for j in range(2):
            square[i, j] = root[i, 0] * root[j, 0] + root[i, 1] * root[j, 1]


@compiled
def shift_row(place: Array, size: Array, table: Array, shift: Array) -> None:
    """Fill the shift (2,) of a place (2,) on a sheet of a size (2,) from a table (n, n, 2)."""
    weight, node = np.empty((2, 4)), np.empty(2, np.int64)
    for i in range(2):
        deep = place[i] / size[i] * (table.shape[0] - 3)
        node[i] = min(int(deep), table.shape[0] - 4)
        t = deep - node[i]
        square = t * t
        cube = square * t
        weight[i, 0] = square - 0.5 * (t + cube)
        weight[i, 1] = 1.0 - 2.5 * square + 1.5 * cube
        weight[i, 2] = 0.5 * t + 2.0 * square - 1.5 * cube
        weight[i, 3] = 0.5 * (cube - square)
    shift[:] = 0.0
    for i in range(4):
        for j in range(4):
            both = weight[0, i] * weight[1, j]
            for k in range(2):
                shift[k] += both * table[node[0] + i, node[1] + j, k]


@compiled
def place_rows(
    x: Array,
    scale: Array,
    outside: float,
    table: Array,
    size: Array,
    shift: Array,
    roots: Array,
    place: Array,
    cov: Array,
) -> None:
    """Fill places (s, 2) and covariances (s, 2, 2) of potentials (s, 2..).

    Parameters
    ----------
    x : ndarray, shape (s, 2..)
        Potentials; NaN where there is none.
    scale : ndarray, shape (2, 2)
        Their middle and half width.
    outside : float
        Half widths that count.
    table : ndarray, shape (n, n, 2)
        Factors of products of powers, of degree below n in all.
    size : ndarray, shape (2,)
        Of the sheet (m).
    shift : ndarray, shape (n, n, 2)
        See `shift_table`.
    roots : ndarray, shape (m, m, 2, 2)
        Of the covariance, in cells over the sheet.
    place, cov : ndarray, shape (s, 2) and (s, 2, 2)
        Overwritten.
    """
    count, far = table.shape[0], roots.shape[0] - 1
    power, total, cell = np.ones((2, count)), np.empty(2), np.empty(2, np.int64)
    for s in range(len(x)):
        if not (math.isfinite(x[s, 0]) and math.isfinite(x[s, 1])):
            place[s], cov[s] = np.nan, np.nan
            continue
        for i in range(2):
            u = held((x[s, i] - scale[0, i]) / scale[1, i], -outside, outside)
            for n in range(1, count):
                power[i, n] = power[i, n - 1] * u
        total[:] = 0.0
        for i in range(count):
            for j in range(count - i):
                both = power[0, i] * power[1, j]
                for k in range(2):
                    total[k] += both * table[i, j, k]
        for i in range(2):
            total[i] = held(total[i], 0.0, size[i])
        shift_row(total, size, shift, place[s])
        for i in range(2):
            place[s, i] = held(total[i] + place[s, i], 0.0, size[i])
            cell[i] = int(place[s, i] / size[i] * far + 0.5)
        square_of(roots[cell[0], cell[1]], cov[s])


@compiled
def wave_rows(places: Array, angle: float, count: int, waves: Array) -> None:
    """Fill cosines (2, n) of a place (2,) on the unit square, of multiples of an angle."""
    for i in range(2):
        first = math.cos(held(places[i], 0.0, 1.0) * angle)
        waves[i, 0], waves[i, 1] = 1.0, first
        for n in range(2, count):
            waves[i, n] = 2.0 * first * waves[i, n - 1] - waves[i, n - 2]


@compiled
def series_row(place: Array, law: Array) -> float:
    """Nominal Rx of a place (2,) in units of the edges, by the law (4,) of `SeriesResistance`."""
    long, far = int(law[0]), law[1]
    across = math.sin(math.pi * held(place[1 - long], NEAREST, 1.0 - NEAREST)) ** 2
    near = far * held(place[long], NEAREST, 1.0 - NEAREST)
    square = across * (1.0 + across / math.sinh(far) ** 2) ** 2
    for away in (near, far - near, far + near, 2.0 * far - near):
        square /= 1.0 + across / math.sinh(away) ** 2
    return float(max(law[2] + 0.5 * math.log(square), LEAST_LOG) * law[3])


@compiled
def force_rows(
    places: Array,
    resistance: Array,
    table: Array,
    law: Array,
    series: Array,
    spreads: Array,
    force: Array,
    spread: Array,
) -> None:
    """Fill forces (s,) and their spreads (s,) (N).

    Parameters
    ----------
    places : ndarray, shape (s, 2)
        In units of the sheet's edges.
    resistance : ndarray, shape (s,)
        R, in units of the divider's.
    table : ndarray, shape (n, n, 5)
        Factors of cosines: of the four shapes and of what is added to Rx.
    law : ndarray, shape (9,)
        Phase of the slowest cosine at the far edge; least and largest film, the middle of its
        logarithm, the bend, the logarithm of the largest answer, the gap's force; least of the
        levels at which spreads are told, and one over their step.
    series : ndarray, shape (4,)
        Law of the nominal Rx, see `SeriesResistance`.
    spreads : ndarray, shape (m, m, l)
        Relative ones in cells of places and levels.
    force, spread : ndarray, shape (s,)
        Overwritten.
    """
    count, shapes = table.shape[0], table.shape[2]
    waves, total = np.empty((2, count)), np.empty(shapes)
    far = spreads.shape[0] - 1
    for s in range(len(places)):
        wave_rows(places[s], law[0], count, waves)
        total[:] = 0.0
        for i in range(count):
            for j in range(count):
                both = waves[0, i] * waves[1, j]
                for k in range(shapes):
                    total[k] += both * table[i, j, k]
        nominal = series_row(places[s], series)
        film = held(resistance[s] - total[4] - nominal, law[1], law[2])
        level = math.log(film) - law[3]
        power = total[0] + level * (total[1] + level * law[4])
        power += total[2] / film
        power += total[3] * film
        net = math.exp(min(power, law[5]))
        a = int(held(places[s, 0], 0.0, 1.0) * far + 0.5)
        b = int(held(places[s, 1], 0.0, 1.0) * far + 0.5)
        spread[s] = net * spreads[a, b, int((level - law[7]) * law[8] + 0.5)]
        force[s] = net + law[6]
