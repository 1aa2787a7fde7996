# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Direction of loading: turning points of a load, told apart from noise by a dead band."""

from __future__ import annotations

import warnings
from math import comb

import numpy as np

from tactile_ros.types import Array, Bools

MAD_TO_SIGMA = 1.4826
ORDERS = (1, 2, 4)  # of differences: holds, ramps and rounded presses leave noise alone in one
LOADED = 0.1  # of the largest load: rows that tell its noise
LEAST, MOST = 1e-3, 0.1  # of the largest load: bounds of a dead band
EXTREMES = 10.0  # sigmas between the extremes of a million rows of noise


def dead_band(load: Array) -> Array:
    """Distances (c,) that noise of held loads (s, c) does not go.

    Noise is the least of what differences of several orders tell: motion makes it too large only.
    """
    size = np.abs(np.nan_to_num(load))
    top = float(size.max(initial=0.0))
    loaded = np.where(size > LOADED * top, load, np.nan)
    noise = np.full(load.shape[1], np.nan)
    with warnings.catch_warnings():
        warnings.filterwarnings('ignore', 'All-NaN slice|Mean of empty slice', RuntimeWarning)
        for order in ORDERS:
            step = np.nanmedian(np.abs(np.diff(loaded, order, axis=0)), axis=0)
            noise = np.fmin(noise, MAD_TO_SIGMA * step / np.sqrt(comb(2 * order, order)))
    band = np.clip(EXTREMES * np.nan_to_num(noise), LEAST * top, MOST * top)
    return np.asarray(band)


def loading_signs(load: Array, restart: Bools, band: Array | None = None) -> Array:
    """Signs (s, c) after each row: 1 loads grew when they last moved, -1 they fell, 0 unknown.

    Parameters
    ----------
    load : ndarray, shape (s, c)
        NaN: not measured, the sign stays.
    restart : ndarray, shape (s,)
        Rows before which the past is forgotten.
    band : ndarray, shape (c,), or None
        Distance from the last extreme that is a turn (unit of the load); None: that of the loads.

    Examples
    --------
    >>> load = np.array([[0.0, 1, 2, 2, 1, 1]]).T
    >>> loading_signs(load, np.arange(6) == 0)[:, 0].tolist()
    [0.0, 1.0, 1.0, 1.0, -1.0, -1.0]
    """
    band = dead_band(load) if band is None else band
    unknown = np.full(len(band), np.nan)
    high, low, sign = unknown, unknown, np.zeros(len(band))
    signs = np.empty(load.shape)
    for row, (now, begins) in enumerate(zip(load, restart.tolist(), strict=True)):
        if begins:
            high, low, sign = unknown, unknown, np.zeros(len(band))
        high, low = np.fmax(high, now), np.fmin(low, now)
        grew = (now - low > band) & (sign <= 0)
        turned = grew | ((high - now > band) & (sign >= 0))
        sign = np.where(turned, np.where(grew, 1.0, -1.0), sign)
        high, low = np.where(turned, now, high), np.where(turned, now, low)
        signs[row] = sign
    return signs
