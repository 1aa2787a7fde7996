"""How far the forces of taxels, and their sum, are from the truth that they were learned from."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from tactile_ros.conditioning.equilibration import FREEDOM
from tactile_ros.conditioning.turns import last_turns, presses
from tactile_ros.estimators.beyond_told import BEYOND, UNTOLD

if TYPE_CHECKING:
    from tactile_ros.conditioning.equilibration import Equilibration
    from tactile_ros.types import Array, Bools, Integers

HEAVY = 0.1  # of the largest force: heavier errors are parts of the force, lighter ones constant
LEAST = 1e-4  # of a force: no law is better
MOST_FREE = 0.5  # numbers of a law for each row
FEWEST = 5  # presses, loaded and unloaded, that tell hysteresis at a level
CLEAR = 2.0  # standard errors of it that are none
LEVELS = np.array([0.05, 0.1, 0.2, 0.4, 0.6, 0.8])  # of a taxel's largest force, between groups


class ForceErrors(NamedTuple):
    """Errors of forces; see `force_errors`.

    Attributes
    ----------
    floor, spread : float
        Of a taxel: a constant part (N), and a part of its force.
    own : ndarray, shape (l,)
        Part of its force by which a taxel errs, at each of `LEVELS`.
    alike : ndarray, shape (2, l)
        Part by which those that bear alike err alike, and by which all that are loaded, or all
        that are unloaded, do: hysteresis.
    idle : ndarray, shape (t,)
        Of a taxel that bears nothing (N).
    """

    floor: float
    spread: float
    own: Array
    alike: Array
    idle: Array


def force_errors(
    miss: Array,
    force: Array,
    law: Equilibration,
    unlearned: float,
    restart: Bools | None = None,
) -> ForceErrors:
    """Errors of the forces of taxels.

    Parameters
    ----------
    miss, force : ndarray, shape (s, t)
        Errors and told forces (N); NaN where unknown.
    law : Equilibration
        Learned from these rows.
    unlearned : float
        Part of a force that errs where no heavy force was told.
    restart : ndarray, shape (s,), or None
        Rows before which the past is forgotten; None: independent rows, of no order.

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
    borne = known & (force > 0)
    level = np.searchsorted(LEVELS, np.where(borne, force, 0.0) / largest_forces(law))
    own, alike = _by_level(miss, force, borne, level)
    play = np.zeros(len(own)) if restart is None else _hysteresis(
        np.where(borne, miss, 0.0), np.where(borne, force, 0.0), np.where(borne, level, -1),
        last_turns(force, restart), presses(force, restart),
    )  # fmt: skip
    both = np.stack([np.sqrt(np.maximum(alike**2 - play**2, 0.0)), play])
    own *= _unseen(borne, FREEDOM[law.name])
    # the few rows of rest of one taxel say little: half of it is what all say
    rest = np.sqrt(0.5 * (squared + squared.mean()))
    return ForceErrors(floor, spread, np.maximum(own, LEAST), both, rest)


def shared_part(load: Array, level: Integers, alike: Array) -> Array:
    """Part (s,) by which sums of loads (s, t) err beyond what taxels err each for itself.

    Groups of loads err independently: along its range what a law misses changes its sign. What
    hysteresis makes of them has one sign for all.
    """
    rows, groups = len(load), len(LEVELS) + 1
    part, play = alike[0][level] * load, alike[1][level] * load
    first = groups * np.arange(rows)[:, None]
    sums = np.bincount((level + first).ravel(), part.ravel(), rows * groups)
    excess = np.square(sums.reshape(rows, groups)).sum(axis=1) - np.square(part).sum(axis=1)
    excess += np.square(play.sum(axis=1)) - np.square(play).sum(axis=1)
    total = load.sum(axis=1)
    share = np.sqrt(np.maximum(excess, 0.0)) / np.where(total > 0, total, 1.0)
    return np.asarray(np.where(total > 0, share, 0.0))


def untold_parts(share: Array) -> Array | None:
    """Parts (s, t) of forces that may be wrong since they are larger than any that was told.

    Parameters
    ----------
    share : ndarray, shape (s, t)
        Forces in parts of the largest that was told of their taxel.

    Returns
    -------
    ndarray, shape (s, t), or None
        None: there is no such force.
    """
    if not np.count_nonzero(share > BEYOND):
        return None
    return np.asarray(UNTOLD * (1.0 - BEYOND / np.maximum(share, BEYOND)))


def _unseen(borne: Bools, freedom: int) -> float:
    """How much more laws miss new rows than those (s, t) that they were learned from."""
    taxels = max(int(np.count_nonzero(borne.any(axis=0))), 1)
    part = min(freedom * taxels / max(int(np.count_nonzero(borne)), 1), MOST_FREE)
    return float(np.sqrt((1 + part) / (1 - part)))


def largest_forces(law: Equilibration) -> Array:
    """Of each taxel (t,) (N) that a law was learned from; the largest of all where it has none."""
    most = np.nan_to_num(law.forces(law.top_[None])[0])
    return np.asarray(np.where(most > 0, most, max(float(most.max()), 1e-12)))


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


def _hysteresis(
    miss: Array, load: Array, level: Integers, turned: Array, press: Integers
) -> Array:
    """Part of their load (l,) by which taxels err to one side when loaded, and to the other.

    Rows and taxels of one press err together, however many they are: what chance makes of the
    part is told by presses that differ.
    """
    parts = np.full(len(LEVELS) + 1, np.nan)
    for k in range(len(parts)):
        at = (level == k) & (turned != 0)
        way, of = turned[at], press[np.nonzero(at)[0]]
        if min(len(np.unique(of[way == one])) for one in (-1, 1)) < FEWEST:
            continue
        of, number = np.unique(of, return_inverse=True)[1].reshape(-1), len(np.unique(of))
        terms, wrong = np.column_stack([load[at], way * load[at]]), miss[at]
        inverse = np.linalg.inv(terms.T @ terms)
        found = inverse @ (terms.T @ wrong)
        left = terms * (wrong - terms @ found)[:, None]
        apart = np.stack([np.bincount(of, one, number) for one in left.T])
        chance = (inverse @ (apart @ apart.T) @ inverse)[1, 1] * number / (number - 2)
        part = float(found[1])
        parts[k] = np.sqrt(max(part * part - CLEAR**2 * float(chance), 0.0))
    return _nearest(parts)


def _by_level(miss: Array, force: Array, borne: Bools, level: Integers) -> tuple[Array, Array]:
    """Parts of their force (l,) by which taxels err, and err alike; see `LEVELS`."""
    own, alike = np.full((2, len(LEVELS) + 1), np.nan)
    for k in range(len(LEVELS) + 1):
        wrong, load = (np.where(borne & (level == k), x, 0.0) for x in (miss, force))
        own[k] = _ratio(np.square(wrong), np.square(load))
        alike[k] = _ratio(_pairs(wrong), _pairs(load))
    return _nearest(own), _nearest(alike)


def _ratio(wrong: Array, load: Array) -> float:
    """Root of the ratio of sums of squares; NaN: nothing bears a load."""
    borne = float(load.sum())
    return float(np.sqrt(max(float(wrong.sum()) / borne, 0.0))) if borne > 0 else np.nan


def _nearest(parts: Array) -> Array:
    """The same (l,), of loads that were not told that of the nearest that was."""
    told = np.flatnonzero(np.isfinite(parts))
    if not len(told):
        return np.zeros(len(parts))
    away = np.abs(np.arange(len(parts))[:, None] - told)
    return np.asarray(parts[told[away.argmin(axis=1)]])


def _pairs(values: Array) -> Array:
    """Sums (s,) of the products of any two values of a row (s, t)."""
    return np.asarray(np.square(values.sum(axis=1)) - np.square(values).sum(axis=1))
