"""How far the forces of taxels, and their sum, are from the truth that they were learned from."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from tactile_ros.types import Array, Bools

HEAVY = 0.1  # of the largest force: heavier errors are parts of the force, lighter ones constant
LEAST = 1e-4  # of a force: no law is better


class ForceErrors(NamedTuple):
    """Errors of forces; see `force_errors`.

    Attributes
    ----------
    floor, spread, common : float
        Of a taxel: a constant part (N), a part of its force, and one that all taxels share.
    idle : ndarray, shape (t,)
        Of a taxel that bears nothing (N).
    """

    floor: float
    spread: float
    common: float
    idle: Array


def force_errors(miss: Array, force: Array, unlearned: float) -> ForceErrors:
    """Errors of the forces of taxels.

    Parameters
    ----------
    miss, force : ndarray, shape (s, t)
        Errors and told forces (N); NaN where unknown.
    unlearned : float
        Part of a force that errs where no heavy force was told.

    Returns
    -------
    ForceErrors
        Root mean squares. What the squared error of the sum is above the sum of squared errors
        is common to all taxels.
    """
    known = np.isfinite(miss)
    top = float(np.nanmax(force))
    heavy = known & (force >= HEAVY * top) & (force > 0)
    light = known & (force < HEAVY * top)
    light = light & (force > 0) if (light & (force > 0)).any() else light
    floor, spread = _parts(miss, force, heavy, light, unlearned)
    idle = known & (force == 0)
    squared = np.where(idle, np.square(miss), 0.0).sum(axis=0) / np.maximum(idle.sum(axis=0), 1)
    return ForceErrors(floor, spread, _common(miss, force, known, floor, spread), np.sqrt(squared))


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


def _common(miss: Array, force: Array, known: Bools, floor: float, spread: float) -> float:
    """Part of the force by which all taxels err alike."""
    total = np.where(known, force, 0.0).sum(axis=1)
    own = np.where(known, floor**2 + np.square(spread * force), 0.0).sum(axis=1)
    heavy = total > HEAVY * total.max(initial=0.0)
    if not heavy.any():
        return 0.0
    wrong = np.square(np.where(known, miss, 0.0).sum(axis=1)) - own
    return float(np.sqrt(max((wrong[heavy] / np.square(total[heavy])).mean(), 0.0)))
