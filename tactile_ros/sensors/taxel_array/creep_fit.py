"""Laws and creep of the taxels together.

A law without memory gives the crept load: h(u) = F + sum_i c_i x_i, with x_i the strains that the
told loads F leave. Any law h is a sum of hinges; what they cannot tell of F must be strains.
"""

from __future__ import annotations

from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.conditioning.equilibration import Equilibration
from tactile_ros.conditioning.viscoelastic import Creep, strains
from tactile_ros.types import Array

if TYPE_CHECKING:
    from tactile_ros.types import Bools, Integers

TAUS: Array = np.asarray(0.1 * 1.3 ** np.arange(28.0))  # up to two minutes
HINGES = np.array([0.02, 0.05, 0.1, 0.2, 0.35, 0.5, 0.7, 0.85])  # of the largest output
FEWEST_ROWS = 60
MOST_TAXELS = 12  # that choose the time constants
MOST_ROWS = 4000
BETTER = 0.9  # of the error without creep
MORE = 0.9  # of the error of two branches: what a third must be worth
LIGHT = 0.1  # of the largest load: lighter ones count by their error, heavier in parts
TOGETHER = 0.5  # trust in shares that all taxels have in common, in taxels
RIDGE = 1e-6
FADED = 0.002  # of the largest strain: less is none
FEWEST_LEFT = 5  # resting rows that say how a skin is that was never pressed
CLEAR = 3.0  # of its standard error: more is a level
MOST_SHARE = 3.0


def fit_creep(
    output: Array,
    force: Array,
    stamp_ns: Integers,
    restart: Bools,
    groups: Integers,
    law: Equilibration,
) -> tuple[Equilibration, Creep] | None:
    """Branches of creep, and the laws that hold beside them.

    Parameters
    ----------
    output, force : ndarray, shape (s, t)
        Outputs above the baseline, and loads (N); NaN where unknown.
    stamp_ns : ndarray, shape (s,)
        Acquisition times.
    restart : ndarray, shape (s,)
        Rows before which the past is forgotten.
    groups : ndarray of int, shape (s,)
        What a split keeps together.
    law : Equilibration
        Without creep.

    Returns
    -------
    law, creep : Equilibration, Creep, or None
        None: creep does not help.
    """
    load = np.where(np.isfinite(force), force, 0.0)
    whole: Bools = np.all(np.isfinite(force[:, law.known]), axis=1)
    if not law.known.any() or whole.mean() < 0.5 or len(output) < FEWEST_ROWS or not load.any():
        return None
    loaded = np.flatnonzero(law.known & (load.max(axis=0) > 0.3 * load.max()))
    if not len(loaded):
        return None
    chosen = loaded[:: max(len(loaded) // MOST_TAXELS, 1)]
    past = strains(load[:, chosen], TAUS, stamp_ns, restart)
    rows = np.flatnonzero(whole)
    rows = rows[:: max(len(rows) // MOST_ROWS, 1)]
    products = np.array(
        [
            _unexplained(output[rows, taxel], load[rows, taxel], past[rows, :, k])
            for k, taxel in enumerate(chosen)
        ]
    )
    branches = _branches(products.sum(axis=0))
    if branches is None:
        return None
    tau = np.asarray(TAUS[list(branches)])
    share = _shares(products, branches, chosen, output.shape[1])
    every = past if len(chosen) == output.shape[1] else strains(load, tau, stamp_ns, restart)
    every = every[:, list(branches)] if len(chosen) == output.shape[1] else every
    crept = load + np.einsum('bt,sbt->st', share, every)
    crept = np.where(np.isfinite(force), crept, np.nan)
    return Equilibration(law.law).fit(output, crept, groups), Creep(tau, share)


def never_pressed(
    output: Array, load: Array, stamp_ns: Integers, restart: Bools, noise: Array
) -> Array | None:
    """Outputs of taxels in which no past load is left, above what rests on average.

    Parameters
    ----------
    output, load : ndarray, shape (s, t)
        Outputs above the baseline of the rests, and told loads (N); NaN where unknown.
    stamp_ns, restart : ndarray, shape (s,)
        Acquisition times; rows before which the past is forgotten.
    noise : ndarray, shape (t,)
        Of an output at rest.

    Returns
    -------
    ndarray, shape (t,), or None
        None: loads say nothing, or the rests are as if never pressed.
    """
    whole = np.nan_to_num(load).sum(axis=1, keepdims=True)
    resting = np.flatnonzero(whole[:, 0] == 0)
    if len(resting) < FEWEST_ROWS or not whole.any():
        return None
    left = strains(whole, TAUS, stamp_ns, restart)[..., 0].mean(axis=1)
    faded = int(np.count_nonzero(left[resting] <= FADED * left.max()))
    rows = resting[np.argsort(left[resting], kind='stable')[: max(faded, FEWEST_LEFT)]]
    with np.errstate(invalid='ignore'):
        level = np.nan_to_num(np.nanmean(output[rows], axis=0))
    clear = np.abs(level) > CLEAR * noise / np.sqrt(len(rows))
    return np.asarray(level) if clear.mean() > 0.5 else None


def _unexplained(u: Array, told: Array, past: Array) -> Array:
    """Products (m + 1, m + 1) of the load and its strains, less what hinges of u explain."""
    part = u / max(float(u.max()), 1e-12)
    terms = np.column_stack([part, np.maximum(part[:, None] - HINGES, 0.0)])
    weight = 1.0 / (told + LIGHT * float(told.max()) + 1e-12)
    basis, _ = np.linalg.qr(terms * weight[:, None])
    columns = np.column_stack([told, past]) * weight[:, None]
    rest = columns - basis @ (basis.T @ columns)
    return np.asarray(rest.T @ rest)


def _branches(products: Array) -> tuple[int, ...] | None:
    """Indices of the time constants that explain most: two, or three where that is worth it."""
    found: list[tuple[float, tuple[int, ...]]] = [(float(products[0, 0]), ())]
    for count in (1, 2, 3):
        sets = list(combinations(range(len(TAUS)), count))
        # of three, neighbours say nothing that two do not
        sets = [one for one in sets if count < 3 or min(np.diff(one)) > 2]
        found.append(min((_left(products, one), one) for one in sets))
    none, single, pair, triple = found
    if min(single[0], pair[0]) > BETTER**2 * none[0]:
        return None
    if triple[0] < MORE**2 * pair[0]:
        return triple[1]
    return pair[1] if pair[0] < 0.999 * single[0] else single[1]


def _left(products: Array, branches: tuple[int, ...]) -> float:
    """Squared error with some branches; inf where a share would be negative or too large."""
    share = _share(products, branches)
    if share.min() < 0 or share.sum() > MOST_SHARE:
        return np.inf
    at = [1 + i for i in branches]
    squared = share @ products[np.ix_(at, at)] @ share
    return float(products[0, 0] + 2 * share @ products[at, 0] + squared)


def _share(products: Array, branches: tuple[int, ...]) -> Array:
    """Shares (b,) by least squares."""
    at = [1 + i for i in branches]
    normal = products[np.ix_(at, at)] + RIDGE * np.eye(len(at)) * products[at, at].max()
    return np.asarray(np.linalg.solve(normal, -products[at, 0]))


def _shares(products: Array, branches: tuple[int, ...], chosen: Integers, taxels: int) -> Array:
    """Shares (b, t) of the taxels, those that were not looked at like the others together."""
    mean = products.mean(axis=0)
    common = np.maximum(_share(mean, branches), 0.0)
    shares = np.repeat(common[:, None], taxels, axis=1)
    for one, taxel in zip(products, chosen, strict=True):
        shares[:, taxel] = np.maximum(_share(one + TOGETHER * mean, branches), 0.0)
    return shares
