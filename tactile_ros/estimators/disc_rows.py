"""Places of a disc row by row, for a compiler: the loops that `disc_inversion` has as arrays.

The same steps in the same order as there, to rounding: field from the table, slopes against place
and tilt, damped least squares. Scratch arrays are made once for all rows.
"""

from __future__ import annotations

import math

import numpy as np

from tactile_ros.physics.compiled import compiled
from tactile_ros.types import Array

CALMER, WILDER, DAMPING, LONGEST = 0.2, 8.0, 1e-3, 0.25
# both ways often end in one minimum: rounding must not choose between them
CLEARLY = 1 - 1e-6


@compiled
def lagrange(u: float) -> tuple[float, ...]:
    """Weights of four nodes at -1, 0, 1, 2, and their slopes."""
    a, b, c = u + 1, u - 1, u - 2
    return (
        -u * b * c / 6,
        a * b * c / 2,
        -a * u * c / 2,
        a * u * b / 6,
        -(b * c + u * c + u * b) / 6,
        (b * c + a * c + a * b) / 2,
        -(u * c + a * c + a * u) / 2,
        (u * b + a * b + a * u) / 6,
    )


@compiled
def table_point(
    x: float, y: float, z: float, table: Array, grid: Array
) -> tuple[float, float, float, float, float, float]:
    """Radial field over distance and axial field; their slopes over the distance, and depth."""
    p, q = (x * x + y * y) / grid[0] + 1, (-z - grid[1]) / grid[2]
    i = min(max(math.floor(p) - 1, 0), table.shape[0] - 4)
    j = min(max(math.floor(q) - 1, 0), table.shape[1] - 4)
    wi, wj = lagrange(p - i - 1), lagrange(q - j - 1)
    f = g = fs = gs = fz = gz = 0.0
    for a in range(4):
        rf = rg = tf = tg = 0.0
        for b in range(4):
            near, far = table[i + a, j + b, 0], table[i + a, j + b, 1]
            rf += near * wj[b]
            rg += far * wj[b]
            tf += near * wj[b + 4]
            tg += far * wj[b + 4]
        f += rf * wi[a]
        g += rg * wi[a]
        fs += rf * wi[a + 4]
        gs += rg * wi[a + 4]
        fz += tf * wi[a]
        gz += tg * wi[a]
    fs, gs = fs * (2 / grid[0]), gs * (2 / grid[0])
    return f, g, fs, gs, fz / -grid[2], gz / -grid[2]


@compiled
def turned(a: float, b: float, turn: Array) -> None:
    """Rotation (3, 3) by turns about x and y (rad)."""
    angle = math.hypot(a, b)
    half = 0.5 * angle
    sine = math.sin(angle) / angle if angle > 0 else 1.0
    share = math.sin(half) / half if angle > 0 else 1.0
    versine = 0.5 * share * share
    turn[0, 0], turn[1, 1] = 1 - versine * b * b, 1 - versine * a * a
    turn[2, 2] = math.cos(angle)
    turn[0, 1] = turn[1, 0] = versine * a * b
    turn[0, 2], turn[2, 0] = sine * b, -sine * b
    turn[1, 2], turn[2, 1] = -sine * a, sine * a


@compiled
def pixel_field(
    apart: Array, turn: Array, table: Array, grid: Array, work: Array, slope: Array
) -> tuple[float, float, float]:
    """Field of a turned disc at a point apart (3,) of it, and its slopes (3, 5)."""
    x = turn[0, 0] * apart[0] + turn[1, 0] * apart[1] + turn[2, 0] * apart[2]
    y = turn[0, 1] * apart[0] + turn[1, 1] * apart[1] + turn[2, 1] * apart[2]
    z = turn[0, 2] * apart[0] + turn[1, 2] * apart[1] + turn[2, 2] * apart[2]
    f, g, fs, gs, fz, gz = table_point(x, y, z, table, grid)
    own, half = work[:3], work[3:6]
    own[0, 0], own[1, 1], own[0, 1], own[1, 0] = (
        f + x * x * fs,
        f + y * y * fs,
        x * y * fs,
        x * y * fs,
    )
    own[0, 2], own[1, 2], own[2, 0], own[2, 1], own[2, 2] = x * fz, y * fz, x * gs, y * gs, gz
    bx = turn[0, 0] * f * x + turn[0, 1] * f * y + turn[0, 2] * g
    by = turn[1, 0] * f * x + turn[1, 1] * f * y + turn[1, 2] * g
    bz = turn[2, 0] * f * x + turn[2, 1] * f * y + turn[2, 2] * g
    for i in range(3):
        for k in range(3):
            half[i, k] = turn[i, 0] * own[0, k] + turn[i, 1] * own[1, k] + turn[i, 2] * own[2, k]
    for i in range(3):
        for k in range(3):
            slope[i, k] = -(
                half[i, 0] * turn[k, 0] + half[i, 1] * turn[k, 1] + half[i, 2] * turn[k, 2]
            )
    slope[0, 3], slope[1, 3], slope[2, 3] = 0.0, -bz, by
    slope[0, 4], slope[1, 4], slope[2, 4] = bz, 0.0, -bx
    for i in range(3):
        slope[i, 3] += slope[i, 2] * apart[1] - slope[i, 1] * apart[2]
        slope[i, 4] += slope[i, 0] * apart[2] - slope[i, 2] * apart[0]
    return bx, by, bz


@compiled
def disc_row(
    place: Array, warm: float, disc: Array, pixels: Array, axes: Array, table: Array, grid: Array,
    work: Array, slope: Array, seen: Array, steep: Array,
) -> None:  # fmt: skip
    """Readings (n,) of a disc at a place (u,), and their slopes (n, u)."""
    unknowns = len(place)
    gap, coupling = disc[0], disc[4]
    x, y = gap * place[0] + disc[1], gap * place[1] + disc[2]
    z = gap * place[2] + disc[3]
    lean = coupling * (1 - disc[8] * place[2])
    a, b = -lean * place[1] + disc[5], lean * place[0] + disc[6]
    if unknowns == 5:
        a, b = a + place[3], b + place[4]
    turn, apart = work[6:9], work[9]
    turned(a, b, turn)
    strength = 1 + disc[7] * warm
    channels = len(axes) // len(pixels)
    for p in range(len(pixels)):
        apart[0], apart[1], apart[2] = pixels[p, 0] - x, pixels[p, 1] - y, pixels[p, 2] - z
        bx, by, bz = pixel_field(apart, turn, table, grid, work, slope)
        for i in range(3):
            for k in range(3):
                slope[i, k] *= gap
            slope[i, 0] += lean * slope[i, 4]
            slope[i, 1] -= lean * slope[i, 3]
            sideways = place[0] * slope[i, 4] - place[1] * slope[i, 3]
            slope[i, 2] -= coupling * disc[8] * sideways
        for n in range(p * channels, (p + 1) * channels):
            ax, ay, az = axes[n, 0] * strength, axes[n, 1] * strength, axes[n, 2] * strength
            seen[n] = ax * bx + ay * by + az * bz
            for k in range(unknowns):
                steep[n, k] = ax * slope[0, k] + ay * slope[1, k] + az * slope[2, k]


@compiled
def solved(normal: Array, pull: Array, damping: float, matrix: Array, move: Array) -> None:
    """Solve (normal + damping of its diagonal) move = pull by Cholesky."""
    size = len(pull)
    for i in range(size):
        for k in range(i + 1):
            total = normal[i, k]
            if i == k:
                total *= 1 + damping
            for j in range(k):
                total -= matrix[i, j] * matrix[k, j]
            matrix[i, k] = math.sqrt(total) if i == k else total / matrix[k, k]
    for i in range(size):
        total = pull[i]
        for j in range(i):
            total -= matrix[i, j] * move[j]
        move[i] = total / matrix[i, i]
    for i in range(size - 1, -1, -1):
        total = move[i]
        for j in range(i + 1, size):
            total -= matrix[j, i] * move[j]
        move[i] = total / matrix[i, i]


@compiled
def missed(
    row: Array, seen: Array, rest: Array, projection: Array, sigma: float, error: Array
) -> float:
    """Differences (m,) that readings do not explain, over sigma; the sum of their squares."""
    total = 0.0
    for m in range(projection.shape[1]):
        left = 0.0
        for n in range(len(row)):
            left += (row[n] - (seen[n] - rest[n])) * projection[n, m]
        error[m] = left / sigma
        total += error[m] * error[m]
    return total


@compiled
def normals(
    place: Array, steep: Array, projection: Array, sigma: float, prior: Array, error: Array,
    normal: Array, pull: Array,
) -> None:  # fmt: skip
    """Normal equations (u, u) and their right side (u,) at a place."""
    unknowns = len(place)
    normal[:] = 0.0
    for k in range(unknowns):
        normal[k, k], pull[k] = prior[k], -prior[k] * place[k]
    inner = np.empty(unknowns)
    for m in range(projection.shape[1]):
        for k in range(unknowns):
            inner[k] = 0.0
            for n in range(len(steep)):
                inner[k] += projection[n, m] * steep[n, k]
            inner[k] /= sigma
        for i in range(unknowns):
            pull[i] += inner[i] * error[m]
            for k in range(i + 1):
                normal[i, k] += inner[i] * inner[k]


@compiled
def descend_row(
    row: Array, warm: float, place: Array, sigma: float, steps: int, disc: Array, pixels: Array,
    axes: Array, table: Array, grid: Array, rest: Array, projection: Array, prior: Array,
    least: Array, most: Array, error: Array, work: Array,
) -> float:  # fmt: skip
    """Move a place by damped steps; what is left over sigma, and the sum of its squares."""
    unknowns, channels = len(place), len(row)
    slope, seen, steep = np.empty((3, 5)), np.empty(channels), np.empty((channels, unknowns))
    steeper, trial, miss = np.empty((channels, unknowns)), np.empty(unknowns), np.empty(len(error))
    normal, matrix = np.empty((unknowns, unknowns)), np.empty((unknowns, unknowns))
    pull, move = np.empty(unknowns), np.empty(unknowns)
    damping = DAMPING
    disc_row(place, warm, disc, pixels, axes, table, grid, work, slope, seen, steep)
    square = missed(row, seen, rest, projection, sigma, error)
    cost = square
    for k in range(unknowns):
        cost += prior[k] * place[k] * place[k]
    normals(place, steep, projection, sigma, prior, error, normal, pull)
    for _ in range(steps):
        solved(normal, pull, damping, matrix, move)
        longest = np.abs(move).max()
        share = min(1.0, LONGEST / max(longest, 1e-12))
        for k in range(unknowns):
            trial[k] = min(max(place[k] + move[k] * share, least[k]), most[k])
        disc_row(trial, warm, disc, pixels, axes, table, grid, work, slope, seen, steeper)
        found = missed(row, seen, rest, projection, sigma, miss)
        price = found
        for k in range(unknowns):
            price += prior[k] * trial[k] * trial[k]
        if price <= cost * (1 + 1e-9):
            cost, square, damping = price, found, damping * CALMER
            place[:], error[:] = trial, miss
            normals(place, steeper, projection, sigma, prior, error, normal, pull)
        else:
            damping *= WILDER
    return square


@compiled
def find_rows(
    rows: Array, warm: Array, places: Array, noise: float, right: float, steps: int, many: int,
    doubt: float, disc: Array, pixels: Array, axes: Array, table: Array, grid: Array, rest: Array,
    projection: Array, prior: Array, least: Array, most: Array, errors: Array, lefts: Array,
) -> None:  # fmt: skip
    """Places (s, u) of readings (s, n) from where they begin; again from rest where in doubt.

    What they leave unexplained goes into differences (s, m) and readings (s, n).
    """
    work, slope, unknowns = np.empty((10, 3)), np.empty((3, 5)), places.shape[1]
    seen, steep = np.empty(rows.shape[1]), np.empty((rows.shape[1], unknowns))
    other, miss = np.empty(unknowns), np.empty(errors.shape[1])
    for s in range(len(rows)):
        square = 0.0
        for n in range(rows.shape[1]):
            square += rows[s, n] * rows[s, n]
        if not math.isfinite(square):
            places[s, :], errors[s, :], lefts[s, :] = np.nan, np.nan, np.nan
            continue
        sigma = math.hypot(noise, right * math.sqrt(square / rows.shape[1]))
        for k in range(unknowns):
            places[s, k] = min(max(places[s, k], least[k]), most[k])
        cost = descend_row(
            rows[s], warm[s], places[s], sigma, steps, disc, pixels, axes, table, grid, rest,
            projection, prior, least, most, errors[s], work,
        )  # fmt: skip
        if cost > doubt:
            other[:] = 0.0
            again = descend_row(
                rows[s], warm[s], other, sigma, many, disc, pixels, axes, table, grid, rest,
                projection, prior, least, most, miss, work,
            )  # fmt: skip
            if again < CLEARLY * cost:
                places[s, :], errors[s, :] = other, miss
        disc_row(places[s], warm[s], disc, pixels, axes, table, grid, work, slope, seen, steep)
        for n in range(len(seen)):
            lefts[s, n] = rows[s, n] - (seen[n] - rest[n])
        for m in range(errors.shape[1]):
            errors[s, m] *= sigma
