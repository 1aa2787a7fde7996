"""Robust least squares on a table of places: two numbers and a pressure, in few operations.

The same steps as of `Descent`, for one start and an object that looks alike from all sides.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.estimators.coverage_model import (
    CLOSE,
    CUBIC,
    CUT,
    PRIOR,
    SLACK,
    WEAK,
    WELL,
    Fits,
    first_pressure,
)
from tactile_ros.physics.compiled import available, compiled

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tactile_ros.estimators.coverage_model import Readings, Variant
    from tactile_ros.types import Array, Bools


@compiled
def weights_of(t: float, value: Array, slope: Array) -> None:
    """Weights of four nodes at a place between the middle two, and their slopes."""
    t = min(max(t, -1.0), 2.0)
    for k in range(4):
        a, b, c, d = CUBIC[k, 0], CUBIC[k, 1], CUBIC[k, 2], CUBIC[k, 3]
        value[k] = a + b * t + c * t * t + d * t * t * t
        slope[k] = b + 2.0 * c * t + 3.0 * d * t * t


@compiled
def seen_at(
    rows: Array, side: int, low: Array, pitch: float, scale: float, x: float, y: float,
    stack: Array,
) -> None:  # fmt: skip
    """Slopes and covered area (3, t) at a place (m): `PlaceTable.seen`; `stack` is filled."""
    along, over, up, rise = np.empty(4), np.empty(4), np.empty(4), np.empty(4)
    fx, fy = (x - low[0]) / pitch, (y - low[1]) / pitch
    i = min(max(int(fx), 1), side - 3)
    j = min(max(int(fy), 1), side - 3)
    weights_of(fx - i, along, over)
    weights_of(fy - j, up, rise)
    stack[:] = 0.0
    for m in range(4):
        for n in range(4):
            node = rows[(j + m - 1) * side + i + n - 1]
            by_x, by_y, own = up[m] * over[n] * scale, rise[m] * scale * along[n], up[m] * along[n]
            for k in range(len(node)):
                stack[0, k] += by_x * node[k]
                stack[1, k] += by_y * node[k]
                stack[2, k] += own * node[k]


@compiled
def pressure_of(force: Array, variance: Array, usable: Bools, cover: Array) -> float:
    """Pressure at which a descent begins: `first_pressure`."""
    most, count = cover.max(), 0
    ratio = np.empty(len(cover))
    for k in range(len(cover)):
        if usable[k] and cover[k] > WELL * most:
            ratio[count] = force[k] / cover[k]
            count += 1
    if count > 4:
        middle = np.sort(ratio[:count])[count // 2]
        if middle > 0:
            return float(middle)
    told, area = 0.0, 0.0
    for k in range(len(cover)):
        weight = cover[k] * usable[k] / variance[k]
        told += weight * force[k]
        area += weight * cover[k]
    return max(told, 1e-12) / max(area, 1e-300)


@compiled
def excess_of(squared: Array, usable: Bools, count: int, least: float) -> float:
    """By how much a quarter of the misfits is above what is stated: `Readings.excess`."""
    size = float(np.sort(squared * usable)[len(squared) - count // 4 - 1])
    return float(SLACK * max(size**0.5 - least, 0.0))


@compiled
def added(stack: Array, share: Array, miss: Array, normal: Array, pull: Array) -> None:
    """Matrix (3, 3) and right side (3,) of least squares; both are filled."""
    normal[:] = 0.0
    pull[:] = 0.0
    for k in range(len(share)):
        for m in range(3):
            tall = stack[m, k] * share[k]
            pull[m] += tall * miss[k]
            for n in range(m + 1):
                normal[m, n] += tall * stack[n, k]
    for m in range(3):
        normal[m, m] += WEAK
        for n in range(m):
            normal[n, m] = normal[m, n]


@compiled
def inverse_of(a: Array, inverse: Array) -> None:
    """Inverse of a symmetric matrix (3, 3), by cofactors; it is filled."""
    p, q, r, s, t, u = a[0, 0], a[0, 1], a[0, 2], a[1, 1], a[1, 2], a[2, 2]
    inverse[0, 0], inverse[1, 1], inverse[2, 2] = s * u - t * t, p * u - r * r, p * s - q * q
    inverse[0, 1] = inverse[1, 0] = r * t - q * u
    inverse[0, 2] = inverse[2, 0] = q * t - r * s
    inverse[1, 2] = inverse[2, 1] = q * r - p * t
    inverse /= p * inverse[0, 0] + q * inverse[0, 1] + r * inverse[0, 2]


@compiled
def weighed(
    stack: Array, variance: Array, usable: Bools, squared: Array, edge: float, floor: float,
    rough: float, share: Array, weight: Array,
) -> None:  # fmt: skip
    """Weights (t,) of squared misfits, robust ones and such without what is rough; filled."""
    for k in range(len(share)):
        edges = edge * (stack[0, k] ** 2 + stack[1, k] ** 2) + floor
        near = usable[k] / (variance[k] + edges + rough**2)
        far = max(1.0 - squared[k] * near / (2 * CUT) ** 2, 0.0)
        share[k] = near * far * far
        weight[k] = usable[k] / (variance[k] + edges)


@compiled
def step_of(normal: Array, pull: Array, move: Array) -> None:
    """Step (3,) of least squares, none beyond 1; filled."""
    inverse = np.empty((3, 3))
    inverse_of(normal, inverse)
    for m in range(3):
        total = 0.0
        for n in range(3):
            total += inverse[m, n] * pull[n]
        move[m] = min(max(total, -1.0), 1.0)


@compiled
def descend_rows(
    rows: Array, side: int, low: Array, pitch: float, scale: float,
    force: Array, variance: Array, usable: Bools, top: float, count: int, least: float,
    found: Array, step: float, edge: float, floor: float, rounds: int, loose: Array, final: bool,
    stack: Array, share: Array, cover: Array, normal: Array,
) -> float:  # fmt: skip
    """Cost of a descent: `descend_places`; `found` (x, y, pressure) and what follows is filled."""
    miss, weight, pull, move = np.empty(len(force)), np.empty(len(force)), np.empty(3), np.empty(3)
    rough = 0.0
    for i in range(rounds):
        seen_at(rows, side, low, pitch, scale, found[0], found[1], stack)
        if i == 0:
            found[2] = pressure_of(force, variance, usable, stack[2])
        stack *= found[2]
        miss[:] = force - stack[2]
        squared = miss * miss
        rough = excess_of(squared, usable, count, least)
        if i < len(loose):
            rough = max(rough, loose[i] * top)
        weighed(stack, variance, usable, squared, edge, floor, rough, share, weight)
        added(stack, share, miss, normal, pull)
        step_of(normal, pull, move)
        found[0] += move[0] * step
        found[1] += move[1] * step
        found[2] *= max(1.0 + move[2], 0.3)
        if i >= len(loose) and max(abs(move[0]), abs(move[1])) < CLOSE:
            break
    cost = 0.0
    for k in range(len(force)):
        left = miss[k] - (move[0] * stack[0, k] + move[1] * stack[1, k] + move[2] * stack[2, k])
        near = weight[k] if final or not weight[k] else 1.0 / (1.0 / weight[k] + rough**2)
        cost += min(left * left * near, CUT**2)
        cover[k] = (force[k] - left) / found[2]
    return cost


@compiled
def outer_of(stack: Array, own: Array, factor: float, part: Array) -> None:
    """Sum of outer products (3, 3) of slopes (3, t), so weighted; filled."""
    part[:] = 0.0
    for k in range(len(own)):
        for m in range(3):
            for n in range(3):
                part[m, n] += stack[m, k] * own[k] * stack[n, k] * factor


@compiled
def product_of(a: Array, b: Array, c: Array) -> None:
    """Product of matrices (3, 3); `c` is filled."""
    for m in range(3):
        for n in range(3):
            c[m, n] = a[m, 0] * b[0, n] + a[m, 1] * b[1, n] + a[m, 2] * b[2, n]


@compiled
def covariance_of(
    normal: Array, stack: Array, share: Array, force: Array, cover: Array, pressure: float
) -> Array:
    """Of a place and its pressure (3, 3), in steps: `_covariance` of `object_pose`."""
    taxels, told, total = len(force), 0, 0.0
    size, own = np.empty(taxels), np.empty(taxels)
    for k in range(taxels):
        size[k] = max(abs(stack[0, k]), abs(stack[1, k]), abs(stack[2, k]))
        excess = share[k] * (force[k] - pressure * cover[k]) ** 2
        own[k] = share[k] * excess
        total += excess
    largest = size.max()
    for k in range(taxels):
        told += size[k] > 1e-3 * largest and share[k] > 0
    inverse, part, once = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    inverse_of(normal, inverse)
    spare = max(told - 3, 0)
    common = min(max((total + PRIOR) / (spare + PRIOR), 0.1), 9.0)
    if spare < 12:
        return inverse * common
    outer_of(stack, own, told / spare, part)
    product_of(inverse, part, once)
    product_of(once, inverse, part)
    return 0.5 * (inverse * common + part)


Matrix = list[list[float]]


def descend_places(
    variant: Variant,
    start: Array,
    readings: Readings,
    rounds: int,
    loose: Sequence[float],
    final: bool,
) -> Fits:
    """Descend with one variant from (x, y); see `Descent.run`."""
    assert variant.places is not None
    if available():
        return _looped(variant, start, readings, rounds, loose, final)
    x, y = float(start[0]), float(start[1])
    step, pressure = float(variant.unit[0]), 0.0
    error = variant.places.error
    edge, floor = error.edge, error.floor * readings.top**2
    for i in range(rounds):
        stack = variant.places.seen(x, y)
        if i == 0:
            pressure = first_pressure(readings, stack[2])
        stack *= pressure
        miss = readings.force - stack[2]
        squared = miss * miss
        edges = edge * (stack[0] ** 2 + stack[1] ** 2) + floor
        rough = readings.excess(squared)
        if i < len(loose):
            rough = max(rough, loose[i] * readings.top)
        weight = readings.usable / (readings.variance + edges + rough**2)
        share = weight * np.square(np.maximum(1.0 - squared * weight / (2 * CUT) ** 2, 0.0))
        tall = stack * share
        normal = tall @ stack.T
        normal.reshape(-1)[::4] += WEAK
        move = [min(max(m, -1.0), 1.0) for m in solved(normal.tolist(), (tall @ miss).tolist())]
        x, y = x + move[0] * step, y + move[1] * step
        pressure *= max(1.0 + move[2], 0.3)
        if i >= len(loose) and max(abs(move[0]), abs(move[1])) < CLOSE:
            break
    miss = miss - np.array(move) @ stack
    if final:
        weight = readings.usable / (readings.variance + edges)
    cost = float(np.minimum(miss * miss * weight, CUT**2).sum())
    cover = (readings.force - miss) / pressure
    return Fits(
        variant, 0, np.array([[x, y]]), np.array([pressure]), np.array([cost]), cover[None],
        normal[None], stack[:, None], share[None],
    )  # fmt: skip


def _looped(
    variant: Variant,
    start: Array,
    readings: Readings,
    rounds: int,
    loose: Sequence[float],
    final: bool,
) -> Fits:
    """The same by compiled loops."""
    places, step = variant.places, float(variant.unit[0])
    assert places is not None
    taxels = len(readings.force)
    stack, share, cover = np.empty((3, taxels)), np.empty(taxels), np.empty(taxels)
    found, normal = np.array([start[0], start[1], 0.0]), np.empty((3, 3))
    cost = descend_rows(
        places.rows, places.side, places.low, places.pitch, places.scale, readings.force,
        readings.variance, readings.usable, readings.top, readings.count, readings.least,
        found, step, places.error.edge, places.error.floor * readings.top**2, rounds,
        np.array(loose), final, stack, share, cover, normal,
    )  # fmt: skip
    return Fits(
        variant, 0, found[None, :2], found[2:], np.array([cost]), cover[None], normal[None],
        stack[:, None], share[None],
    )  # fmt: skip


def solved(a: Matrix, b: list[float]) -> list[float]:
    """Solution of three linear equations with a symmetric matrix, by cofactors.

    Examples
    --------
    >>> solved([[2.0, 0.0, 0.0], [0.0, 4.0, 0.0], [0.0, 0.0, 1.0]], [2.0, 2.0, 3.0])
    [1.0, 0.5, 3.0]
    """
    (p, q, r), (_, s, t), (_, _, u) = a
    c00, c01, c02 = s * u - t * t, r * t - q * u, q * t - r * s
    c11, c12, c22 = p * u - r * r, q * r - p * t, p * s - q * q
    whole = p * c00 + q * c01 + r * c02
    return [
        (c00 * b[0] + c01 * b[1] + c02 * b[2]) / whole,
        (c01 * b[0] + c11 * b[1] + c12 * b[2]) / whole,
        (c02 * b[0] + c12 * b[1] + c22 * b[2]) / whole,
    ]
