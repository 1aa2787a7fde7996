"""The likeliest templates of a frame, one after the other, for a compiler."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.physics.compiled import compiled

if TYPE_CHECKING:
    from tactile_ros.types import Array, Integers, Singles


@compiled
def misfits(
    unit: Singles, close: Integers, shape: Singles,
    score: Singles, least: np.float32, misfit: Array,
) -> None:  # fmt: skip
    """Sums (n,) of misfits of templates that score so much at least, inf of others; filled."""
    for i in range(len(close)):
        misfit[i] = np.inf
        if score[i] < least:
            continue
        row, total = unit[close[i]], 0.0
        for k in range(len(shape)):
            total += abs(score[i] * row[k] - shape[k])
        misfit[i] = total


@compiled
def first_apart(
    misfit: Array, close: Integers, what: Array, most: float, turn: float, taken: Integers
) -> int:
    """How many templates (m,) differ in variant or in turn, the best first; `taken` is filled."""
    free, count = misfit.copy(), 0
    while count < len(taken):
        best = int(np.argmin(free))
        if not free[best] <= most:
            break
        free[best] = np.inf
        variant, yaw, apart = what[close[best], 0], what[close[best], 3], True
        for k in range(count):
            if what[taken[k], 0] == variant:
                apart = apart and abs(np.sin((what[taken[k], 3] - yaw) / 2)) > turn
        if apart:
            taken[count] = close[best]
            count += 1
    return count


@compiled
def likeliest(
    unit: Singles, close: Integers, score: Singles,
    what: Array, shape: Singles, closer: int, near: float, exact: float,
    turn: float, taken: Integers,
) -> int:  # fmt: skip
    """How many of the chosen templates are worth a closer look; `taken` is filled."""
    misfit, least = np.empty(len(close)), score.min()
    if len(close) > closer:
        least = np.sort(score)[len(close) - closer]
    misfits(unit, close, shape, score, least, misfit)
    best = misfit.min()
    return first_apart(misfit, close, what, best + near * (best + exact), turn, taken)
