"""The one patch of a frame, taxel by taxel, for a compiler; see `patches`."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.physics.compiled import compiled

if TYPE_CHECKING:
    from tactile_ros.types import Array, Bools, Integers

SECOND = np.array([[4, 5, 6], [5, 7, 8], [6, 8, 9]])  # places of second powers among powers


@compiled
def is_torn(links: Integers, first: Integers, among: Bools, count: int) -> bool:
    """Whether some of `count` taxels, marked in (t,), are not connected to the others."""
    left, front = among.copy(), np.empty(count, np.int64)
    reached, done = 0, 0
    for k in range(len(left)):
        if left[k]:
            front[0], left[k], reached = k, False, 1
            break
    while done < reached:
        here = front[done]
        done += 1
        for n in range(first[here], first[here + 1]):
            other = links[n]
            if left[other]:
                front[reached], left[other] = other, False
                reached += 1
    return reached < count


@compiled
def is_one(
    links: Integers, first: Integers, areas: Array, joined: float, least: float, load: Array,
    touched: Bools,
) -> int:  # fmt: skip
    """How many taxels the one patch of a frame has; 0: there are several, or none."""
    pressure, count, cores = np.maximum(load, least) / areas, 0, 0
    most = 0.0
    for k in range(len(load)):
        if touched[k]:
            count += 1
            most = max(most, pressure[k])
    core = touched & (pressure > joined * most)
    for k in range(len(load)):
        cores += core[k]
    if is_torn(links, first, touched, count):
        return 0
    return 0 if cores < count and is_torn(links, first, core, cores) else count


@compiled
def lone_patch(
    links: Integers, first: Integers, areas: Array, powers: Array, joined: float, least: float,
    load: Array, variance: Array, touched: Bools, centre: Array, cov: Array,
) -> tuple[int, float, float, float]:  # fmt: skip
    """Taxels, load, its variance and area of the one patch; 0 taxels: there are several or none.

    `centre` (3,) and `cov` (3, 3) are filled.
    """
    sums, total, area = np.zeros(10), 0.0, 0.0
    count = is_one(links, first, areas, joined, least, load, touched)
    if not count:
        return 0, total, total, area
    centre[:] = 0.0
    for k in range(len(load)):
        if touched[k]:
            weight = max(load[k], least)
            total += weight
            area += areas[k]
            centre += weight * powers[k, 1:4]
            sums += variance[k] * powers[k]
    centre /= total
    for m in range(3):
        for n in range(3):
            own = sums[0] * centre[m] * centre[n]
            rest = sums[SECOND[m, n]] - centre[m] * sums[1 + n] - centre[n] * sums[1 + m]
            cov[m, n] = (rest + own) / (total * total)
    return count, total, sums[0], area
