# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Creep of a piezoresistive skin, and its inverse: the force behind a crept reading.

A held load makes the output creep up through a few Voigt elements (spring beside dashpot). The
inverse runs them on the force that it has just computed: it needs no derivative, its gain on noise
is at most 1 at any rate, and a gap of any length is one exponential.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy.interpolate import BSpline
from scipy.optimize import minimize

from tactile_ros.conditioning.fading_memory import SECONDS_PER_NS, FadingMemory, branch_weights
from tactile_ros.physics.compiled import compiled
from tactile_ros.types import Array, Bools, Integers

FEWEST_ROWS = 60
MOST_ROWS, FEW_ROWS, MANY = 700, 400, 200  # rows, those of many taxels
CHOSEN = 3  # taxels that choose the time constants
BETTER = 0.9  # of the error without creep
MORE = 0.95  # of the error of two branches: what a third must be worth
ROUNDS = 12
MOST_SHARE = 3.0
STILL = 0.02  # of the largest load: a smaller change ends no hold
SEARCH = {'maxiter': 45, 'xatol': 0.02, 'fatol': 1e-9}


@compiled
def undo_rows(
    v: Array, stamp_ns: Integers, restart: Bools, tau: Array, share: Array, begun: bool,
    newest: int, strain: Array, last: Array, forces: Array,
) -> tuple[bool, int]:  # fmt: skip
    """Fill forces (s, t) behind crept ones; true once a stream has begun, and its newest stamp."""
    weights = np.zeros((3, len(tau)))
    for i in range(len(v)):
        if restart[i]:
            strain[:] = 0.0
            last[:] = 0.0
            begun = False
        moves = not begun or stamp_ns[i] > newest
        weights[0], weights[1:] = 1.0, 0.0  # a frame that is not newer leaves strains as they are
        if begun and moves:
            branch_weights((stamp_ns[i] - newest) * SECONDS_PER_NS, tau, weights)
        for k in range(len(last)):
            bent, stiff = 0.0, 0.0
            for b in range(len(tau)):
                strain[b, k] = weights[0, b] * strain[b, k] + weights[1, b] * last[k]
                bent += share[b, k] * strain[b, k]
                stiff += share[b, k] * weights[2, b]
            # the new force moves the strain too: one linear equation for each taxel
            forces[i, k] = (v[i, k] - bent) / (1.0 + stiff)
            if moves and not math.isnan(forces[i, k]):
                last[k] = forces[i, k]
            for b in range(len(tau)):
                strain[b, k] += weights[2, b] * last[k]
        if moves:
            begun, newest = True, stamp_ns[i]
    return begun, newest


class Creep:
    """State-space inverse: v = F + sum_i c_i x_i with tau_i dx_i/dt = F - x_i.

    v is a crept load, or (`behind` the law of the taxel) a crept output and F the one that has not
    crept; `tau` (b,) (s) and `share` (b, t) are time constants and shares of the settled output.

    Examples
    --------
    >>> creep = Creep(np.array([1.0]), np.array([[0.5]]))
    >>> v = 1 + 0.5 * -np.expm1(-np.arange(3.0))[:, None]
    >>> stamps = np.arange(3) * 1_000_000_000
    >>> creep.undo(v, stamps, np.zeros(3, bool), creep.start()).round(2).ravel().tolist()
    [1.0, 1.0, 1.0]
    """

    def __init__(self, tau: Array, share: Array, behind: bool = False) -> None:
        self.behind = behind
        self.tau = np.asarray(tau, np.float64)
        self.share = np.asarray(share, np.float64)

    def start(self) -> CreepState:
        """State of a skin that was never pressed."""
        return CreepState(np.zeros(self.share.shape), np.zeros(self.share.shape[1]))

    def undo(self, v: Array, stamp_ns: Integers, restart: Bools, state: CreepState) -> Array:
        """Forces (s, t) (N) behind crept ones (s, t); NaN: not measured, the last is held inside.

        A frame whose stamp (s,) is not newer is answered from the `state` as it is, which moves on
        else; before those of `restart` (s,) the past is forgotten.
        """
        forces = np.empty(v.shape)
        begun, newest = undo_rows(
            np.ascontiguousarray(v), stamp_ns, restart, self.tau, self.share,
            state.stamp_ns is not None, state.stamp_ns or 0, state.strain, state.last, forces,
        )  # fmt: skip
        state.stamp_ns = int(newest) if begun else None
        return forces

    def crept(self, load: Array, stamp_ns: Integers, restart: Bools) -> Array:
        """Load (s, t) that creep adds to a load (s, t) (N); an unknown load adds none."""
        strain = FadingMemory(self.tau)(np.nan_to_num(load), stamp_ns, restart)
        return np.asarray(np.einsum('bt,sbt->st', self.share, strain))


class CreepState:
    """Strain of every branch (b, t), last force (t,) and its stamp; None: nothing yet."""

    def __init__(self, strain: Array, last: Array) -> None:
        self.strain, self.last = strain, last
        self.stamp_ns: int | None = None


class History(NamedTuple):
    """Outputs above the baseline and loads (N) of taxels (s, t), in time order.

    `tared`: the baseline is that of a skin that was never pressed.
    """

    output: Array
    load: Array
    stamp_ns: Integers
    restart: Bools
    tared: bool


def fit_creep(history: History) -> tuple[Creep, Array] | None:
    """Branches of creep and constants of the outputs (t,); None: creep explains too little.

    The law of a taxel is a spline over its load; creep adds to the load before the law, or to the
    output behind it, whichever leaves less. A constant takes what a baseline of rests without a
    tare holds that were still creeping back.
    """
    load = history.load
    whole = np.isfinite(load).all(axis=1) & np.isfinite(history.output).all(axis=1)
    if whole.sum() < FEWEST_ROWS or not np.nan_to_num(load).any():
        return None
    history = history._replace(load=np.nan_to_num(load))
    rows = np.flatnonzero(whole)
    taxels = load.shape[1]
    rows = rows[:: max(len(rows) // (MOST_ROWS if taxels <= MANY else FEW_ROWS), 1)]
    loaded = np.argsort(-history.load.max(axis=0), kind='stable')
    loaded = loaded[: max(int((history.load.max(axis=0) > 0).sum()), 1)]
    some = loaded[:: max(len(loaded) // CHOSEN, 1)][:CHOSEN]
    longest = _longest(history)
    plain = sum(_fit_taxel(history, np.zeros(0), rows, False, k)[2] for k in some)
    best: tuple[float, Array, bool] = (BETTER**2 * plain, np.zeros(0), False)
    for behind in (True, False):

        def left(log_tau: Array, behind: bool = behind) -> float:
            return sum(_fit_taxel(history, np.exp(log_tau), rows, behind, k)[2] for k in some)

        start = np.log(longest * np.array([0.03, 0.6]))
        found = minimize(left, start, method='Nelder-Mead', options=SEARCH)
        if found.fun < best[0]:
            best = float(found.fun), np.exp(np.sort(found.x)), behind
            chosen = left
    if len(best[1]):  # a third branch between them, where it is worth that
        start = np.log(np.insert(best[1], 1, np.sqrt(best[1].prod())))
        found = minimize(chosen, start, method='Nelder-Mead', options=SEARCH)
        if found.fun < MORE**2 * best[0]:
            best = float(found.fun), np.exp(np.sort(found.x)), best[2]
    if not len(best[1]):
        return None
    fits = [_fit_taxel(history, best[1], rows, best[2], k) for k in range(taxels)]
    share = np.maximum(np.array([one[0] for one in fits]).T, 0.0)
    return Creep(best[1], share, best[2]), np.array([one[1] for one in fits])


def _longest(history: History) -> float:
    """Longest time between two changes of the whole load (s)."""
    whole = history.load.sum(axis=1)
    change = np.abs(np.diff(whole)) > STILL * whole.max()
    edges = np.flatnonzero(np.concatenate([[True], change | history.restart[1:], [True]]))
    stamps = history.stamp_ns
    last = np.minimum(edges[1:] - 1, len(stamps) - 1)
    return max(float((stamps[last] - stamps[edges[:-1]]).max()) * SECONDS_PER_NS, 1.0)


def _fit_taxel(
    history: History, tau: Array, rows: Integers, behind: bool, k: int
) -> tuple[Array, float, float]:
    """Shares (b,), constant, and squared residual of a taxel in parts of its output."""
    u, load = history.output[rows, k], history.load[:, k]
    scale = max(float(np.abs(u).max()), 1e-12)
    share = np.full(len(tau), 0.05)
    top = max(float(load.max()), 1e-12)
    basis = _law_terms(load, top)
    past = history.stamp_ns, history.restart
    felt = FadingMemory(tau)(load[:, None], *past)[rows, :, 0]
    strained = FadingMemory(tau)(basis, *past)[rows] if behind else None
    for _ in range(ROUNDS):
        if strained is not None:
            terms, bent = basis[rows] + np.einsum('b,sbj->sj', share, strained), strained
        else:
            crept, end = load[rows] + felt @ share, top * (1.0 + share.sum())
            terms = _law_terms(crept, end)
            rise = (_law_terms(crept + 1e-4 * top, end) - terms) / (1e-4 * top)
            bent = felt[:, :, None] * rise[:, None]
        laws = terms.shape[1]
        if not history.tared:
            terms = np.column_stack([terms, np.ones(len(u))])
        weight = np.linalg.lstsq(terms, u, rcond=None)[0]
        miss = u - terms @ weight
        wide = np.column_stack([terms, bent @ weight[:laws]])
        change = np.linalg.lstsq(wide, miss, rcond=None)[0]
        move = np.clip(change[terms.shape[1] :], -0.2, 0.2)
        share = np.clip(share + move, -0.5, MOST_SHARE)
        if np.abs(move).max(initial=0.0) < 1e-5:
            break
    constant = 0.0 if history.tared else float(weight[-1])
    return share, constant, float(miss @ miss) / scale**2 / len(u)


def _law_terms(load: Array, top: float) -> Array:
    """Splines (s, j) of a load, zero at zero; knots are closer at light loads."""
    inner = top * np.linspace(0.0, 1.0, 7)[1:-1] ** 1.5
    knots = np.concatenate([[0.0] * 4, inner, [top] * 4])
    terms = BSpline(knots, np.eye(len(knots) - 4), 3, extrapolate=True)(load)
    return np.asarray(terms[:, 1:])
