# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Memory of a viscoelastic skin: exponentially fading means of the past change of field.

Stress in a linear viscoelastic body depends on its past strain through decaying exponentials (a
Prony series): means over several time constants tell loading from unloading and a fresh press from
a held one. Between frames the change is taken as linear, so that rate and gaps do not matter.
"""

from __future__ import annotations

import math

import numpy as np

from tactile_ros.physics.compiled import compiled
from tactile_ros.types import Array, Bools, Integers, as_shape

SECONDS_PER_NS = 1e-9


@compiled
def branch_weights(elapsed: float, tau: Array, weights: Array) -> None:
    """Fill weights (3, m) of the old mean, the last and the new value, linear in between."""
    for j in range(len(tau)):
        part = elapsed / tau[j]
        decay, share = math.exp(-part), -math.expm1(-part) / part
        weights[0, j], weights[1, j], weights[2, j] = decay, share - decay, 1.0 - share


@compiled
def fade_rows(
    change: Array, stamp_ns: Integers, restart: Bools, tau: Array, begun: bool, newest: int,
    last: Array, mean: Array, means: Array,
) -> tuple[bool, int]:  # fmt: skip
    """Fill means (s, m, d) of changes (s, d); last (d,) and mean (m, d) move on.

    Returns true once the stream has begun, and its newest stamp.
    """
    weights = np.empty((3, len(tau)))
    for i in range(len(change)):
        if restart[i]:
            last[:] = 0.0
            mean[:] = 0.0
            begun = False
        if begun and stamp_ns[i] > newest:
            branch_weights((stamp_ns[i] - newest) * SECONDS_PER_NS, tau, weights)
            for d in range(len(last)):
                now = last[d] if math.isnan(change[i, d]) else change[i, d]
                for j in range(len(tau)):
                    mean[j, d] = (
                        weights[0, j] * mean[j, d] + weights[1, j] * last[d] + weights[2, j] * now
                    )
                last[d] = now
            newest = stamp_ns[i]
        elif not begun:
            last[:] = np.where(np.isnan(change[i]), 0.0, change[i])
            begun, newest = True, stamp_ns[i]
        means[i] = mean
    return begun, newest


class FadingMemory:
    """Fading means of one stream over `time_constants` (m,) (s), frame by frame or many at once.

    Notes
    -----
    With the change x linear between two frames dt apart and a = exp(-dt / tau), the mean
    follows mean' = a mean + (g - a) x + (1 - g) x' exactly, g = (1 - a) tau / dt.

    Examples
    --------
    >>> stamps = np.array([0, 500_000_000, 1_000_000_000])
    >>> means = FadingMemory(np.array([0.5]))(np.ones((3, 1)), stamps, np.zeros(3, bool))
    >>> round(float(means[-1, 0, 0]), 3)
    0.865
    """

    def __init__(self, time_constants: Array) -> None:
        self.time_constants = as_shape('time_constants of FadingMemory', time_constants, (-1,))
        if not (self.time_constants > 0).all():
            msg = f'time_constants of FadingMemory must be positive; received {time_constants}'
            raise ValueError(msg)
        self._stamp_ns: int | None = None
        self._last = np.zeros(0)
        self._mean = np.zeros((len(self.time_constants), 0))

    def __call__(self, change: Array, stamp_ns: Integers, restart: Bools) -> Array:
        """Means (s, m, d) after each change (s, d) since the tare; NaN: the last one is held.

        A frame whose stamp (s,) is not newer than the last leaves the means as they are; before
        those of `restart` (s,), a new stream or a tare, the past is forgotten.
        """
        count, width = change.shape
        if len(self._last) != width:
            self._last, self._mean = np.zeros(width), np.zeros((len(self.time_constants), width))
        means = np.empty((count, *self._mean.shape))
        begun, newest = fade_rows(
            np.ascontiguousarray(change), stamp_ns, restart, self.time_constants,
            self._stamp_ns is not None, self._stamp_ns or 0, self._last, self._mean, means,
        )  # fmt: skip
        self._stamp_ns = int(newest) if begun else None
        return means
