"""All that `PressSearch` finds of one press, channel by channel, for a compiler."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.estimators.press_rows import cleared_rows, descend_rows, solved_rows
from tactile_ros.estimators.shape_misfit import shape_rows
from tactile_ros.physics.compiled import compiled

if TYPE_CHECKING:
    import numpy.typing as npt

    from tactile_ros.types import Array, Integers

    Singles = npt.NDArray[np.float32]


@compiled
def places_rows(seen: Singles, rank: int, best: Integers) -> None:
    """Numbers of the places whose spans (rank x places,) see most of a press: `best` is filled."""
    count, most = len(seen) // rank, np.full(len(best), np.float32(-1.0))
    for place in range(count):
        total = np.float32(0.0)
        for i in range(rank):
            total += seen[i * count + place] * seen[i * count + place]
        i = len(best) - 1
        if total <= most[i]:
            continue
        while i > 0 and total > most[i - 1]:
            most[i], best[i] = most[i - 1], best[i - 1]
            i -= 1
        most[i], best[i] = total, place


@compiled
def starts_rows(
    score: Singles, first: Integers, turns: Integers, step: Array, place: Array, pose: Array
) -> None:
    """Where each head looks most like a press: `pose` (heads x starts, 4) is filled.

    Parameters
    ----------
    score : ndarray, shape (places, turns)
        Likeness at places, of heads at their turns.
    first, turns, step : ndarray, shape (heads,)
        First column of each head, how many it has, and how far apart they are (rad).
    place : ndarray, shape (places, 2)
        Places (m).
    """
    starts = len(pose) // len(first)
    most = np.empty(starts, np.float32)
    for head in range(len(first)):
        own = pose[head * starts : (head + 1) * starts]
        most[:] = -np.inf
        for turn in range(turns[head]):
            for where in range(len(place)):
                likely = score[where, first[head] + turn]
                i = starts - 1
                if likely <= most[i]:
                    continue
                while i > 0 and likely > most[i - 1]:
                    most[i], own[i] = most[i - 1], own[i - 1]
                    i -= 1
                most[i], own[i, 2] = likely, turn * step[head]
                own[i, 0], own[i, 1] = place[where, 0], place[where, 1]


@compiled
def variance_rows(pattern: Array, noise: Array, error: float, variance: Array) -> float:
    """Noise (d,) and error of the model as one variance (d,), which is filled; its logarithm."""
    here, most, level = np.empty(len(pattern) // 3), 0.0, 0.0
    for i in range(len(here)):
        x, y, z = pattern[3 * i], pattern[3 * i + 1], pattern[3 * i + 2]
        here[i] = (x * x + y * y + z * z) / 3.0
        most = max(most, here[i])
    for k in range(len(pattern)):
        variance[k] = noise[k] + error * error * (here[k // 3] + 0.05 * most)
        level += np.log(variance[k])
    return level


@compiled
def orthonormal_rows(span: Array) -> None:
    """Rows of a matrix (3, d) become orthonormal, one after the other."""
    for i in range(3):
        for round_ in range(2 * i):  # twice each, for what rounding left
            j = round_ % i
            span[i] -= (span[i] * span[j]).sum() * span[j]
        span[i] /= np.sqrt((span[i] * span[i]).sum())


@compiled
def weigh_rows(
    pattern: Array, variance: Array, common: Array, weight: Array, wanted: Array, span: Array
) -> None:
    """A press as of `Weighed`: `weight`, `wanted` (1, d) and `span` (3, d) are filled."""
    for k in range(len(pattern)):
        weight[k] = 1.0 / np.sqrt(variance[k])
        wanted[0, k] = pattern[k] * weight[k]
        for j in range(3):
            span[j, k] = common[k, j] * weight[k]
    orthonormal_rows(span)
    cleared_rows(wanted, span)


@compiled
def inverse_rows(normal: Array, scale: Array, cov: Array) -> None:
    """Inverse of a matrix of steps (4, 4) in their units; `cov` is filled."""
    unit = np.zeros(4)
    for i in range(4):
        unit[i] = 1.0
        solved_rows(normal, unit, cov[i])
        unit[i] = 0.0
        for j in range(4):
            cov[i, j] /= scale[i] * scale[j]


@compiled
def misfit_row(
    cost: Array, plain: Array, weight: Array, span: Array, wanted: Array, found: Array
) -> None:
    """Misfit of the likeliest head's shape from patterns (heads, 5, d); `found` (1,) is filled."""
    best, d = np.argmin(cost), plain.shape[2]
    rows = np.empty((5 + len(cost), d))
    for k in range(d):
        for i in range(5):
            rows[i, k] = plain[best, i, k] * weight[k]
        for i in range(len(cost)):
            rows[5 + i, k] = (plain[i, 0, k] - plain[best, 0, k]) * weight[k]
    cleared_rows(rows, span)
    miss = wanted - rows[:1]
    shape_rows(miss, rows[1:5].reshape(1, 4, d), rows[5:].reshape(1, -1, d), found)


@compiled
def match_rows(
    flat: Singles, grid: Array, about: Array, head: Integers, limit: Array, stop: Array,
    rounds: int, pattern: Array, powers: Array, noise: Array, error: float, common: Array,
    start: Array, cost: Array, pose: Array, cov: Array, plain: Array, misfit: Array,
) -> float:  # fmt: skip
    """Descend from starts (s, 4), keep the best of each head: all from `cost` on is filled.

    Returns the logarithm of the variance of the pattern.
    """
    s, d, heads = len(head), len(pattern), len(cost)
    weight, wanted, span, variance = np.empty(d), np.empty((1, d)), np.empty((3, d)), np.empty(d)
    level = variance_rows(pattern, noise, error, variance)
    weigh_rows(pattern, variance, common, weight, wanted, span)
    costs, normal, scale, rows = (
        np.empty(s),
        np.empty((s, 4, 4)),
        np.empty((s, 4)),
        np.empty((s, 5, d)),
    )
    descend_rows(
        flat, grid, about, head, limit, stop, rounds, weight, span, wanted[0], powers, start,
        costs, normal, scale, rows,
    )  # fmt: skip
    starts = s // heads
    for i in range(heads):
        best = i * starts + np.argmin(costs[i * starts : (i + 1) * starts])
        cost[i], pose[i], plain[i] = costs[best], start[best], rows[best]
        inverse_rows(normal[best], scale[best], cov[i])
    if heads > 1:
        misfit_row(cost, plain, weight, span, wanted, misfit)
    else:
        misfit[0] = 1.0
    return level
