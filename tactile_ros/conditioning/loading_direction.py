"""Whether loads grow or fall: turning points, told apart from noise by a dead band.

Neighbouring rows say how fast a load moves, and at what rate it was read. That it turned is known
only after it has moved back from its extreme, by more than its noise makes of a load that is held.
"""

from __future__ import annotations

import warnings
from math import comb

import numpy as np

from tactile_ros.types import Array, Bools, Integers

MAD_TO_SIGMA = 1.4826
ORDERS = (1, 2, 4)  # of differences: holds, ramps and rounded presses leave noise alone in one
LOADED = 0.1  # of the largest load: rows that tell its noise
LEAST, MOST = 1e-3, 0.1  # of the largest load: bounds of a dead band
EXTREMES = 10.0  # sigmas between the extremes of a million rows of noise


class LoadingDirection:
    """Which way loads of one stream last went, one row at a time or many with the same signs.

    It knows no time and no rate: gaps, pauses and other rates leave it as it is.

    Parameters
    ----------
    band : ndarray, shape (c,)
        Dead band of each load: it turned when it is farther from its last extreme (unit of it).

    Examples
    --------
    >>> turns = LoadingDirection(np.array([0.5]))
    >>> load = np.array([[0.0, 1.0, 0.9, np.nan, 2.0, 1.2]]).T
    >>> turns(load, np.arange(6) == 0)[:, 0].tolist()
    [0.0, 1.0, 1.0, 1.0, 1.0, -1.0]
    """

    def __init__(self, band: Array) -> None:
        self.band = band
        self.reset()

    def reset(self) -> None:
        """Forget the past: which way loads go is unknown."""
        self._high = np.full(len(self.band), np.nan)
        self._low = self._high.copy()
        self._sign = np.zeros(len(self.band))

    def __call__(self, load: Array, restart: Bools) -> Array:
        """Signs (s, c) after each row: 1 grew, -1 fell, 0 unknown.

        Parameters
        ----------
        load : ndarray, shape (s, c)
            NaN: not measured, the sign stays.
        restart : ndarray, shape (s,)
            Rows before which the past is forgotten.
        """
        signs = np.empty(load.shape)
        for row, (now, begins) in enumerate(zip(load, restart.tolist(), strict=True)):
            if begins:
                self.reset()
            self._high, self._low = np.fmax(self._high, now), np.fmin(self._low, now)
            grew = (now - self._low > self.band) & (self._sign <= 0)
            fell = (self._high - now > self.band) & (self._sign >= 0)
            turned = grew | fell
            if turned.any():
                self._sign = np.where(turned, np.where(grew, 1.0, -1.0), self._sign)
                self._high = np.where(turned, now, self._high)
                self._low = np.where(turned, now, self._low)
            signs[row] = self._sign
        return signs


def dead_band(load: Array) -> Array:
    """Distances (c,) that noise of held loads (s, c) does not go, in the order of their rows.

    Noise is the least of what differences of several orders tell of rows that are loaded, since
    motion makes it too large, never too small.
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


def loading_signs(load: Array, restart: Bools) -> Array:
    """1 where loads (s, c) grew when they last moved, -1 where they fell, 0 unknown.

    Examples
    --------
    >>> load = np.array([[0.0, 1, 2, 2, 1, 1]]).T
    >>> loading_signs(load, np.arange(6) == 0)[:, 0].tolist()
    [0.0, 1.0, 1.0, 1.0, -1.0, -1.0]
    """
    return LoadingDirection(dead_band(load))(load, restart)


def presses(load: Array, restart: Bools) -> Integers:
    """Number of the press (s,) that each row of loads (s, c) is of: one begins when the sum grows.

    Examples
    --------
    >>> load = np.array([[0.0, 1, 2, 1, 0, 0, 3, 1]]).T
    >>> presses(load, np.arange(8) == 0).tolist()
    [1, 2, 2, 2, 2, 2, 3, 3]
    """
    known = np.isfinite(load)
    index = np.arange(len(load))[:, None]
    # a taxel that is not measured stands for what it was: it begins no press
    row = np.maximum.accumulate(np.where(known, index, -1), axis=0)
    since = np.maximum.accumulate(np.where(restart, index[:, 0], 0))[:, None]
    held = np.where(row >= since, np.take_along_axis(load, np.maximum(row, 0), 0), 0.0)
    total = np.where(known.any(axis=1), held.sum(axis=1), np.nan)[:, None]
    grows = loading_signs(total, restart)[:, 0] > 0
    first = grows & ~np.concatenate([[False], grows[:-1]])
    return np.asarray(np.cumsum(first | restart), np.int64)
