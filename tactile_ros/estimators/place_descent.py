"""Robust least squares on a table of places: two numbers and a pressure, in few operations.

The same steps as of `Descent`, for one start and an object that looks alike from all sides.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.estimators.place_rows import descend_rows
from tactile_ros.estimators.readings import CLOSE, CUT, WEAK, Fits, first_pressure
from tactile_ros.physics import compiled

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tactile_ros.estimators.coverage_model import Variant
    from tactile_ros.estimators.readings import Readings
    from tactile_ros.types import Array

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
    if compiled.available():
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
