"""How far the forces of taxels, and their sum, are from the truth that they were learned from."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from tactile_ros.types import Array, Bools

HEAVY = 0.1  # of the largest force: heavier errors are parts of the force, lighter ones constant
LEAST = 1e-4  # of a force: no law is better
LEVELS = np.array([0.05, 0.1, 0.2, 0.4, 0.6, 0.8])  # of a taxel's largest force, between groups


class ForceErrors(NamedTuple):
    """Errors of forces; see `force_errors`.

    Attributes
    ----------
    floor, spread : float
        Of a taxel: a constant part (N), and a part of its force.
    alike : ndarray, shape (l,)
        Part of their force by which taxels that bear alike err alike, at each of `LEVELS`.
    idle : ndarray, shape (t,)
        Of a taxel that bears nothing (N).
    """

    floor: float
    spread: float
    alike: Array
    idle: Array


def force_errors(miss: Array, force: Array, most: Array, unlearned: float) -> ForceErrors:
    """Errors of the forces of taxels.

    Parameters
    ----------
    miss, force : ndarray, shape (s, t)
        Errors and told forces (N); NaN where unknown.
    most : ndarray, shape (t,)
        Largest force of each taxel (N).
    unlearned : float
        Part of a force that errs where no heavy force was told.

    Returns
    -------
    ForceErrors
        Root mean squares. What taxels share is in the products of the errors of two: laws of one
        kind miss a skin's alike, little in the middle of the range and more at its ends.
    """
    known = np.isfinite(miss)
    top = float(np.nanmax(force))
    heavy = known & (force >= HEAVY * top) & (force > 0)
    light = known & (force < HEAVY * top)
    light = light & (force > 0) if (light & (force > 0)).any() else light
    floor, spread = _parts(miss, force, heavy, light, unlearned)
    idle = known & (force == 0)
    squared = np.where(idle, np.square(miss), 0.0).sum(axis=0) / np.maximum(idle.sum(axis=0), 1)
    return ForceErrors(floor, spread, _alike(miss, force, known, most), np.sqrt(squared))


def shared_part(load: Array, most: Array, alike: Array) -> Array:
    """Part (s,) by which sums of loads (s, t) err beyond what taxels err each for itself.

    Groups of loads err independently: along its range what a law misses changes its sign.
    """
    rows, groups = len(load), len(LEVELS) + 1
    level = np.searchsorted(LEVELS, load / most)
    part = alike[level] * load
    first = groups * np.arange(rows)[:, None]
    sums = np.bincount((level + first).ravel(), part.ravel(), rows * groups)
    excess = np.square(sums.reshape(rows, groups)).sum(axis=1) - np.square(part).sum(axis=1)
    total = load.sum(axis=1)
    share = np.sqrt(np.maximum(excess, 0.0)) / np.where(total > 0, total, 1.0)
    return np.asarray(np.where(total > 0, share, 0.0))


def _parts(
    miss: Array, force: Array, heavy: Bools, light: Bools, unlearned: float
) -> tuple[float, float]:
    """Constant part (N) and part of the force, such that both groups err as they do."""
    spread = unlearned**2
    small = float(np.square(miss[light]).mean()) if light.any() else 0.0
    weak = float(np.square(force[light]).mean()) if light.any() else 0.0
    if heavy.any():
        large, strong = (float(np.square(x[heavy]).mean()) for x in (miss, force))
        spread = max((large - small) / (strong - weak), LEAST**2)
    return float(np.sqrt(max(small - spread * weak, 0.0))), float(np.sqrt(spread))


def _alike(miss: Array, force: Array, known: Bools, most: Array) -> Array:
    """Part of their force (l,) by which taxels err alike, in groups of loads; see `LEVELS`.

    Of loads that were not told, that of the nearest group.
    """
    borne = known & (force > 0)
    level = np.searchsorted(LEVELS, np.where(borne, force, 0.0) / most)
    groups = [borne & (level == k) for k in range(len(LEVELS) + 1)]
    parts = np.array([_ratio(miss, force, group) for group in groups])
    told = np.flatnonzero(np.isfinite(parts))
    if not len(told):
        return np.zeros(len(groups))
    nearest = np.abs(np.arange(len(groups))[:, None] - told).argmin(axis=1)
    return np.asarray(parts[told[nearest]])


def _ratio(miss: Array, force: Array, group: Bools) -> float:
    """Part of the force that errors of two taxels of a group share; NaN: no row has two."""
    wrong, borne = (float(_pairs(np.where(group, x, 0.0)).sum()) for x in (miss, force))
    if not (group.sum(axis=1) > 1).any():
        return np.nan
    return float(np.sqrt(max(wrong / borne, 0.0)))


def _pairs(values: Array) -> Array:
    """Sums (s,) of the products of any two values of a row (s, t)."""
    return np.asarray(np.square(values.sum(axis=1)) - np.square(values).sum(axis=1))
