# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Direction of loading: turning points of a load, separated from noise by a dead band."""

from __future__ import annotations

import math

import numpy as np

from tactile_ros.types import Array, Bools

BAND = 0.03  # of the largest load: as far from its last extreme a load has turned


def dead_band(load: Array) -> float:
    """Distance that noise of a load (s,) does not go."""
    return BAND * float(np.abs(np.nan_to_num(load)).max(initial=0.0))


def loading_signs(load: Array, restart: Bools, band: float) -> Array:
    """Signs (s,) after each row: 1 the load grew when it last moved, -1 it fell, 0 unknown.

    Loads (s,) turn `band` from their last extreme; NaN: not measured, the sign stays. Before rows
    of `restart` (s,) the past is forgotten.

    Examples
    --------
    >>> load = np.array([0.0, 1, 2, 2, 1, 1])
    >>> loading_signs(load, np.arange(6) == 0, 0.1).tolist()
    [0.0, 1.0, 1.0, 1.0, -1.0, -1.0]
    """
    high, low, sign = -math.inf, math.inf, 0.0
    signs = np.empty(len(load))
    for row, (now, begins) in enumerate(zip(load.tolist(), restart.tolist(), strict=True)):
        if begins:
            high, low, sign = -math.inf, math.inf, 0.0
        if not math.isnan(now):
            high, low = max(high, now), min(low, now)
            if now - low > band and sign <= 0:
                high, low, sign = now, now, 1.0
            elif high - now > band and sign >= 0:
                high, low, sign = now, now, -1.0
        signs[row] = sign
    return signs
