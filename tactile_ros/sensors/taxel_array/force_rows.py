"""Forces of taxels that fill gaps and agree with an object, taxel by taxel, for a compiler."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from tactile_ros.physics.compiled import compiled

if TYPE_CHECKING:
    from tactile_ros.types import Array, Bools, Integers


@compiled
def filled_rows(
    forces: Array, silent: Integers, near: Integers, share: Array, floor: float, spread: float,
    idle: Array, guessed: float, load: Array, variance: Array,
) -> bool:  # fmt: skip
    """Loads (s, t) without gaps and their variances; False: taxels are lost that are not silent.

    Those of silent taxels (n,) are sums over taxels near them (n, k).
    """
    whole = True
    for i in range(len(forces)):
        unread = 0
        for k in range(forces.shape[1]):
            lost = math.isnan(forces[i, k])
            unread += lost
            load[i, k] = 0.0 if lost else forces[i, k]
            light = min(abs(load[i, k]), floor)
            variance[i, k] = light**2 + idle[k] ** 2 + spread**2 * load[i, k] ** 2
        for n in range(len(silent)):
            total = 0.0
            for k in range(near.shape[1]):
                total += load[i, near[n, k]] * share[n, k]
            unread -= math.isnan(forces[i, silent[n]])
            variance[i, silent[n]] = guessed**2 * total**2
            load[i, silent[n]] = total
        whole = whole and unread == 0
    return whole


@compiled
def judged_row(
    row: Array, cover: Array, pressure: float, able: Bools, areas: Array, covered: float,
    mute: float, loud: float, floor: float, verdict: Integers,
) -> tuple[float, float, float, float, int]:  # fmt: skip
    """Forces that an object hides and that are seen, sums of squares, and the count of the seen.

    Squares are those of seen forces, and of such that are none above the floor.

    `verdict` (t,) becomes -1 at taxels that are mute under the object, 1 at loud ones beside it.
    """
    hidden, seen, squared, light, count = 0.0, 0.0, 0.0, 0.0, 0
    for k in range(len(row)):
        verdict[k] = 0
        if cover[k] > covered * areas[k] and row[k] < mute * pressure * cover[k]:
            verdict[k] = -1
        elif cover[k] < 1e-3 * areas[k] and row[k] > loud * pressure * areas[k]:
            verdict[k] = 1
        if verdict[k] < 0 or not able[k]:
            hidden += pressure * cover[k]
        elif verdict[k] == 0:
            seen += row[k]
            squared += row[k] ** 2
            light += min(abs(row[k]), floor) ** 2
            count += 1
    return hidden, seen, squared, light, count
