"""Noise of a channel, from frames that are near in time, whatever drift and motion do."""

from __future__ import annotations

import numpy as np

from tactile_ros.types import Array, Bools, Integers

MAD_TO_SIGMA = 1.4826
MOST_APART_NS = 500_000_000


def rest_noise(rest: Array, groups: Integers) -> Array:
    """Standard deviation of a resting channel, from frames near in time, drift left out.

    Parameters
    ----------
    rest : ndarray, shape (s, t, c)
        Resting frames in time order (unit of values).
    groups : ndarray, shape (s,)
        Frames are compared with their successor in the same group only.

    Returns
    -------
    ndarray, shape (t, c)
        At least a quantum / sqrt(12); NaN where fewer than two frames were read.
    """
    if len(rest) < 2:
        return np.full(rest.shape[1:], np.nan)
    step = np.diff(rest, axis=0)
    same = groups[1:] == groups[:-1]
    size = np.abs(step[same] if same.any() else step)
    return np.asarray(np.maximum(MAD_TO_SIGMA * _middle(size) / np.sqrt(2), _floor(size)))


def spread_noise(rest: Array) -> Array:
    """Standard deviation of a resting channel from frames in any order, drift counted in.

    Parameters
    ----------
    rest : ndarray, shape (s, t, c)
        Resting frames (unit of values).

    Returns
    -------
    ndarray, shape (t, c)
        At least a quantum / sqrt(12); NaN where fewer than two frames were read.
    """
    if len(rest) < 2:
        return np.full(rest.shape[1:], np.nan)
    size = np.abs(rest - _middle(rest))
    return np.asarray(
        np.maximum(MAD_TO_SIGMA * _middle(size), _floor(np.diff(np.sort(rest, axis=0), axis=0)))
    )


def _floor(size: Array) -> Array:
    """Noise of a quantum: the smallest step (s, t, c) of every channel that is not 0, or 0."""
    quantum = np.where(size > 0, size, np.inf).min(axis=0)
    return np.asarray(np.where(np.isfinite(quantum), quantum, 0.0) / np.sqrt(12))


def motion_noise(values: Array, stamp_ns: Integers, restart: Bools) -> Array:
    """Standard deviation of a channel from second differences of frames near in time.

    Motion makes it too large, never too small by much, so that the smaller of this and
    `rest_noise` is the better one.

    Parameters
    ----------
    values : ndarray, shape (s, t, c)
        Frames in time order (unit of values).
    stamp_ns : ndarray, shape (s,)
        Acquisition times.
    restart : ndarray, shape (s,)
        Rows at which a stream or a baseline begins.

    Returns
    -------
    ndarray, shape (t, c)
        NaN where no three frames in a row were read.
    """
    apart = np.diff(stamp_ns) > MOST_APART_NS
    joined = ~(restart[2:] | restart[1:-1] | apart[1:] | apart[:-1])
    if not joined.any():
        return np.full(values.shape[1:], np.nan)
    bend = (values[2:] - 2 * values[1:-1] + values[:-2])[joined]
    return np.asarray(MAD_TO_SIGMA * _middle(np.abs(bend)) / np.sqrt(6))


def held_noise(values: Array, groups: Integers) -> Array:
    """Standard deviation of a channel inside groups of frames, whatever their order.

    As with `motion_noise`, motion makes it too large.

    Parameters
    ----------
    values : ndarray, shape (s, t, c)
        Frames (unit of values); those with NaN are passed over.
    groups : ndarray, shape (s,)
        Frames of one touch have one number.

    Returns
    -------
    ndarray, shape (t, c)
        NaN where no group has two frames.

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


def _middle(size: Array) -> Array:
    """Median over s of every channel (s, t, c), ignoring NaN; NaN where nothing was read."""
    read = ~np.isnan(size).all(axis=0)
    middle = np.full(size.shape[1:], np.nan)
    if read.any():
        middle[read] = np.nanmedian(size[:, read], axis=0)
    return middle
