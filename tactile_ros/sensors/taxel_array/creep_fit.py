"""Laws and creep of the taxels together: both are linear in what they need to know."""

from __future__ import annotations

from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.conditioning.equilibration import Equilibration
from tactile_ros.conditioning.viscoelastic import Creep, strains

if TYPE_CHECKING:
    from tactile_ros.types import Array, Bools, Integers

TAUS = np.array([0.2, 0.4, 0.8, 1.6, 3.2, 6.4, 13.0, 26.0, 60.0])
FEWEST_ROWS = 60
MOST_TAXELS = 12  # that choose the time constants
MOST_ROWS = 1500
BETTER = 0.9  # of the error without creep; a held-out half judges
RIDGE = 1e-7
TRIED = 4  # sets of time constants whose shares are refined


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
    chosen = loaded[:: max(len(loaded) // MOST_TAXELS, 1)]
    if not len(chosen):
        return None
    past = strains(load[:, chosen], TAUS, stamp_ns, restart)
    u, told = np.nan_to_num(output[:, chosen]), load[:, chosen]
    sets: list[tuple[int, ...]] = [(), *((i,) for i in range(len(TAUS)))]
    sets += list(combinations(range(len(TAUS)), 2))
    errors = [_trial_error(u, told, past[:, list(one)], whole) for one in sets]
    if np.min(errors) > BETTER * errors[0]:
        return None
    found = [
        (_refined(u[whole], told[whole], past[whole][:, list(sets[i])], law), sets[i])
        for i in np.argsort(errors, kind='stable')[:TRIED]
        if sets[i]
    ]
    (_, share), chosen_set = min(found, key=lambda one: one[0][0])
    tau = TAUS[list(chosen_set)]
    if not 0.003 < share.sum() < 3.0:
        return None
    every = strains(load, tau, stamp_ns, restart)
    crept = load + np.einsum('b,sbt->st', share, every)
    crept = np.where(np.isfinite(force), crept, np.nan)
    spread = np.repeat(share[:, None], output.shape[1], axis=1)
    creep = Creep(tau, spread)
    return Equilibration(law.law).fit(output, crept, groups), creep


def _terms(u: Array, told: Array, past: Array) -> Array:
    """Columns (s, t, n): a u + b u^2 + c u F + d u^3 - sum c_i x_i = F."""
    own = np.stack([u, u**2, u * told, u**3], axis=-1)
    return np.concatenate([own, -np.moveaxis(past, 1, 2)], axis=2)


def _solve(terms: Array, told: Array) -> Array:
    """Weights (t, n) by least squares, all taxels at once."""
    gram = np.einsum('sti,stj->tij', terms, terms)
    size = np.sqrt(np.einsum('tii->ti', gram)) + 1e-30
    scaled = gram / (size[:, :, None] * size[:, None, :])
    scaled += RIDGE * np.eye(terms.shape[2])
    moment = np.einsum('sti,st->ti', terms, told) / size
    return np.asarray(np.linalg.solve(scaled, moment[..., None])[..., 0] / size)


def _trial_error(u: Array, told: Array, past: Array, whole: Bools) -> float:
    """Error of blocks of rows that the weights were not learned from."""
    block = np.arange(len(u)) * 10 // len(u) % 2
    terms, wrong = _terms(u, told, past), 0.0
    for half in (0, 1):
        train, test = whole & (block != half), whole & (block == half)
        if not (train.any() and test.any()):
            return np.inf
        weights = _solve(terms[train], told[train])
        miss = np.einsum('sti,ti->st', terms[test], weights) - told[test]
        wrong += float(np.square(miss).sum())
    return wrong


def _refined(u: Array, told: Array, past: Array, law: Equilibration) -> tuple[float, Array]:
    """Error and shares (b,) of the branches with which the laws fit best."""
    from scipy.optimize import minimize

    own = Equilibration('polynomial' if law.name == 'polynomial' else 'rational')
    step = max(len(u) // MOST_ROWS, 1)
    u, told, past = u[::step], told[::step], past[::step]
    known = np.ones(u.shape, bool)
    size = float(np.square(told).mean()) + 1e-30

    def error(share: Array) -> float:
        positive = np.maximum(share, 0.0)
        crept = told + np.einsum('b,sbt->st', positive, past)
        own.learn(own.law or 'rational', u, crept, known)
        # in parts of the settled load: larger shares must not pay by a larger scale
        miss = (own.forces(u) - crept) / (1.0 + positive.sum())
        return float(np.nanmean(np.square(miss)) / size + np.square(share - positive).sum())

    start = np.full(past.shape[1], 0.05)
    done = minimize(error, start, method='Nelder-Mead', options={'maxfev': 50, 'xatol': 1e-3})
    return float(done.fun), np.maximum(np.asarray(done.x, np.float64), 0.0)
