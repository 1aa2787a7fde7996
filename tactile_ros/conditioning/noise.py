# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Noise of a channel, from frames that are near in time, whatever drift and motion do.

Every function returns standard deviations (t, c) in the unit of values, NaN where too few frames
were read.
"""

from __future__ import annotations

import numpy as np

from tactile_ros.types import Array, Bools, Integers

MAD_TO_SIGMA = 1.4826
MOST_APART_NS = 500_000_000


def rest_noise(rest: Array, groups: Integers) -> Array:
    """Noise of resting frames (s, t, c) in time order, drift left out; at least a quantum's.

    Frames are compared with their successor in the same group (s,) only.
    """
    if len(rest) < 2:
        return np.full(rest.shape[1:], np.nan)
    step = np.diff(rest, axis=0)
    same = groups[1:] == groups[:-1]
    size = np.abs(step[same] if same.any() else step)
    return np.asarray(np.maximum(MAD_TO_SIGMA * _median(size) / np.sqrt(2), _quantum(size)))


def spread_noise(rest: Array) -> Array:
    """Noise of resting frames (s, t, c) in any order, drift counted in; at least a quantum's."""
    if len(rest) < 2:
        return np.full(rest.shape[1:], np.nan)
    sigma = MAD_TO_SIGMA * _median(np.abs(rest - _median(rest)))
    return np.asarray(np.maximum(sigma, _quantum(np.diff(np.sort(rest, axis=0), axis=0))))


def motion_noise(values: Array, stamp_ns: Integers, restart: Bools) -> Array:
    """Noise of frames (s, t, c) in time order, from second differences of those near in time.

    Motion makes it too large, never too small by much, so that the smaller of this and
    `rest_noise` is the better one. `restart` (s,): rows at which a stream or a baseline begins.
    """
    apart = np.diff(stamp_ns) > MOST_APART_NS
    joined = ~(restart[2:] | restart[1:-1] | apart[1:] | apart[:-1])
    if not joined.any():
        return np.full(values.shape[1:], np.nan)
    bend = (values[2:] - 2 * values[1:-1] + values[:-2])[joined]
    return np.asarray(MAD_TO_SIGMA * _median(np.abs(bend)) / np.sqrt(6))


def held_noise(values: Array, groups: Integers) -> Array:
    """Noise of frames (s, t, c) inside groups (s,), one of each touch, whatever their order.

    Frames with NaN are passed over; as with `motion_noise`, motion makes it too large.

    Notes
    -----
    The median of chi-squared of k degrees of freedom is near k (1 - 2 / (9 k))^3 (Wilson and
    Hilferty, 1931).
    """
    read = np.isfinite(values).all(axis=(1, 2))
    rows = values[read]
    _, group, count = np.unique(groups[read], return_inverse=True, return_counts=True)
    group = np.asarray(group).reshape(-1)
    mean, square = np.zeros((2, len(count), *values.shape[1:]))
    np.add.at(mean, group, rows / count[group, None, None])
    np.add.at(square, group, (rows - mean[group]) ** 2)
    free = (count[count > 1] - 1)[:, None, None]
    if not len(free):
        return np.full(values.shape[1:], np.nan)
    middle = free * (1 - 2 / (9 * free)) ** 3
    return np.asarray(np.sqrt(np.median(square[count > 1] / middle, axis=0)))


def _quantum(size: Array) -> Array:
    """Noise of a quantum: the smallest step (s, t, c) of every channel that is not 0, or 0."""
    quantum = np.where(size > 0, size, np.inf).min(axis=0)
    return np.asarray(np.where(np.isfinite(quantum), quantum, 0.0) / np.sqrt(12))


def _median(size: Array) -> Array:
    """Median over s of every channel (s, t, c), ignoring NaN; NaN where nothing was read."""
    read = ~np.isnan(size).all(axis=0)
    middle = np.full(size.shape[1:], np.nan)
    if read.any():
        middle[read] = np.nanmedian(size[:, read], axis=0)
    return middle
