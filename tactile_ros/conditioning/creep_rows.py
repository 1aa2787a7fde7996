"""The inverse of creep, taxel by taxel, for a compiler; see `viscoelastic`."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.physics.compiled import compiled

if TYPE_CHECKING:
    from tactile_ros.types import Array, Bools, Integers

NS = 1e-9


@compiled
def fading(elapsed: float, tau: Array, weights: Array) -> None:
    """Weights (3, b) of old strain, last and new force after so many seconds; filled."""
    for b in range(len(tau)):
        part = elapsed / tau[b]
        decay, mean = math.exp(-part), -math.expm1(-part) / part
        weights[0, b], weights[1, b], weights[2, b] = decay, mean - decay, 1.0 - mean


@compiled
def answered(v: Array, share: Array, strain: Array, force: Array) -> None:
    """Forces (t,) behind crept ones, the strains as they are; filled."""
    for k in range(len(v)):
        bent = 0.0
        for b in range(len(share)):
            bent += share[b, k] * strain[b, k]
        force[k] = v[k] - bent


@compiled
def moved(
    v: Array, share: Array, weights: Array, strain: Array, last: Array, force: Array
) -> None:
    """Forces (t,) behind crept ones after a time; strains and last forces move on."""
    for k in range(len(v)):
        bent, stiff = 0.0, 0.0
        for b in range(len(share)):
            strain[b, k] = weights[0, b] * strain[b, k] + weights[1, b] * last[k]
            bent += share[b, k] * strain[b, k]
            stiff += share[b, k] * weights[2, b]
        force[k] = (v[k] - bent) / (1.0 + stiff)
        if not math.isnan(force[k]):
            last[k] = force[k]
        for b in range(len(share)):
            strain[b, k] += weights[2, b] * last[k]


@compiled
def undo_rows(
    v: Array, stamp_ns: Integers, restart: Bools, tau: Array, share: Array, begun: bool,
    newest: int, strain: Array, last: Array, forces: Array,
) -> tuple[bool, int]:  # fmt: skip
    """Forces (s, t) behind crept ones; whether the stream has begun, and its newest stamp."""
    weights = np.empty((3, len(tau)))
    for i in range(len(v)):
        if restart[i]:
            strain[:] = 0.0
            last[:] = 0.0
            begun = False
        if begun and stamp_ns[i] > newest:
            fading((stamp_ns[i] - newest) * NS, tau, weights)
            moved(v[i], share, weights, strain, last, forces[i])
            newest = stamp_ns[i]
            continue
        answered(v[i], share, strain, forces[i])
        if not begun:
            for k in range(len(last)):
                last[k] = 0.0 if math.isnan(forces[i, k]) else forces[i, k]
            begun, newest = True, stamp_ns[i]
    return begun, newest
