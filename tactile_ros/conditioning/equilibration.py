# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Equilibration: the force of every taxel by a law of its own, zero force at zero output.

[4] fits a polynomial of second order to each taxel; here its constant is 0, or it would report
0.1..0.2 N at rest. A power law bends like a skin whose resistance falls with a power of the load
in a divider; a monotone curve (PCHIP), common to all taxels, multiplies it by what it lacks.
"""

from __future__ import annotations

from functools import cached_property
from itertools import pairwise

import numpy as np
from scipy.interpolate import PchipInterpolator

from tactile_ros.types import Array, Bools, Integers

LAWS = ('polynomial', 'power', 'pchip')
FEWEST_ROWS = 5
PENALTY = 1e-9
BORDERS = np.append([0.0, 1 / 36], np.linspace(1 / 12, 1, 12))  # light loads bend laws most
TABLE = 65  # entries of a curve
LIGHT = 0.1  # of the largest force: lighter loads count by their error, heavier in parts
BENDS = np.linspace(0.0, 0.98, 15)  # of a power law, in parts of 1 over the largest output
BEYOND = 1.1  # times the largest output: so far a law that bends down is looked at
STEP = 1e-3  # of an output, in which a law's slope is taken
FOLDS = 4
RELATIVE = 0.3  # of the largest force: below it errors count as they are, above it in parts
MARGINS = {'polynomial': 1.0, 'power': 0.98, 'pchip': 0.96}  # what freedom must be worth


class Equilibration:
    """Laws of all taxels, of one kind: `law`, or None for the best of `LAWS` on held-out groups.

    Attributes
    ----------
    name : str
        Of the law in use.
    weights_ : ndarray, shape (t, 3)
        a (N), b (N) and 0 of the polynomial F = a u + b u^2, or a (N), p and c of the power law
        F = a (u / (1 - c u))^p; NaN: too few rows.
    curve_ : ndarray, shape (TABLE,), or None
        Factors of the law at outputs from 0 to `top_`, of a monotone curve.
    top_ : ndarray, shape (t,)
        Largest output that was learned from.
    errors_ : dict of str to float
        Held-out error of each law, in parts of the force.
    held_out_ : ndarray, shape (s, t)
        Errors (N) of the law in use on rows that it had not seen; NaN: not held out.

    Examples
    --------
    >>> u = np.linspace(0, 0.9, 40)[:, None]
    >>> law = Equilibration('power').fit(u, 20 * u / (1.25 - u), np.arange(40))
    >>> float(np.round(law.forces(np.array([[0.0], [0.5]]))[1, 0], 2))
    13.33
    """

    def __init__(self, law: str | None = None) -> None:
        self.law = law
        self.name = law or LAWS[0]
        self.weights_: Array = np.zeros((0, 3))
        self.curve_: Array | None = None
        self.top_: Array = np.zeros(0)
        self.errors_: dict[str, float] = {}
        self.held_out_: Array = np.zeros((0, 0))

    def fit(self, output: Array, force: Array, groups: Integers) -> Equilibration:
        """Learn from outputs above the baseline and loads (s, t) (N), NaN where unknown.

        Rows of one of `groups` (s,) stay together in a split.
        """
        known = np.isfinite(force) & np.isfinite(output)
        u, load = np.where(known, output, 0.0), np.where(known, force, 0.0)
        names = LAWS if self.law is None else (self.law,)
        misses = {name: self._held_out(name, u, load, known, groups) for name in names}
        scale = load + RELATIVE * load.max(axis=0, initial=0.0) + 1e-12
        self.errors_ = {}
        for name, miss in misses.items():
            good = np.isfinite(miss)
            wrong = float(np.sqrt(np.square(miss / scale)[good].mean())) if good.any() else np.inf
            self.errors_[name] = wrong
        best = min(names, key=lambda name: self.errors_[name] / MARGINS[name])
        self.held_out_ = misses[best]
        self._learn(best, u, load, known)
        return self

    def _held_out(self, name: str, u: Array, load: Array, known: Bools, groups: Integers) -> Array:
        """Errors (s, t) of a law on groups that it had not seen; NaN where there are none."""
        some = known.any(axis=1)
        split = groups[some]
        if len(np.unique(split)) < FOLDS:  # too few groups bear loads: rows are held out
            split = u[some].sum(axis=1)
        fold = np.zeros(len(u), np.int64)
        fold[some] = np.unique(split, return_inverse=True)[1].reshape(-1) % FOLDS
        miss = np.full(u.shape, np.nan)
        for i in range(FOLDS):
            held = fold == i
            if held.any() and not held.all():
                self._learn(name, u[~held], load[~held], known[~held])
                miss[held] = self.forces(u[held]) - load[held]
        return np.where(known, miss, np.nan)

    def _learn(self, name: str, u: Array, load: Array, known: Bools) -> None:
        """Set the law of every taxel (t,) from known rows (s, t), by one kind of law."""
        vars(self).pop('_reach', None)
        self.name, self.curve_ = name, None
        seen = (known.sum(axis=0) >= FEWEST_ROWS) & (np.square(u).sum(axis=0) > 0)
        self.top_ = np.where(seen, u.max(axis=0, initial=0.0), 1.0)
        self.top_ = np.where(self.top_ > 0, self.top_, 1.0)
        if name == 'polynomial':
            self.weights_ = _polynomials(u, load, known, seen)
        else:
            self.weights_ = _powers(u, load, known, seen, self.top_)
        if name == 'pchip':
            self.curve_ = _rising(_common_curve(u / self.top_, load, self.forces(u), known))
            vars(self).pop('_reach', None)

    def forces(self, output: Array) -> Array:
        """Forces (s, t) (N) of outputs (s, t) above the baseline; NaN without a law.

        Halfway from the largest output that was learned from to the one at which a law knows no
        end it goes on in a straight line: no reading turns into an endless or a negative force.
        """
        reach = self._reach
        if not np.count_nonzero(np.abs(output) > reach):
            return self._law(output)
        end = np.where(np.isfinite(reach), reach, self.top_)
        rise = self._law(np.stack([(1 - STEP) * end, end]))
        slope = np.maximum(rise[1] - rise[0], 0.0) / (STEP * end)
        near = np.clip(output, -reach, reach)
        return np.asarray(self._law(near) + slope * (output - near))

    @cached_property
    def _reach(self) -> Array:
        """Largest outputs (t,) at which laws are used as they are."""
        _, b, c = self.weights_.T
        if self.name == 'polynomial':
            return np.where(b < 0, BEYOND * self.top_, np.inf)
        return np.where(c > 0, (self.top_ + 1.0 / np.where(c > 0, c, np.nan)) / 2, np.inf)

    def _law(self, output: Array) -> Array:
        """Forces (s, t) (N) by the laws alone."""
        a, b, c = self.weights_.T
        if self.name == 'polynomial':
            return np.asarray((a + b * output) * output)
        size = np.abs(output)
        rise = np.copysign(a * (size / (1.0 - c * size)) ** b, output)
        if self.curve_ is None:
            return np.asarray(rise)
        at = np.clip(np.nan_to_num(output) * ((TABLE - 1) / self.top_), 0.0, TABLE - 1.0)
        cell = np.minimum(at.astype(np.int64), TABLE - 2)
        low = self.curve_[cell]
        return np.asarray(rise * (low + (at - cell) * (self.curve_[cell + 1] - low)))


def _polynomials(u: Array, load: Array, known: Bools, seen: Bools) -> Array:
    """Weights (t, 3) of u and u^2 by least squares, all taxels at once, and 0."""
    terms = np.stack([u, u**2], axis=-1)
    gram = np.einsum('sti,stj,st->tij', terms, terms, known)
    moment = np.einsum('sti,st,st->ti', terms, load, known)
    size = np.trace(gram, axis1=1, axis2=2)[:, None, None]
    penalty = np.where(seen[:, None, None], PENALTY * size, 1.0)
    weights = np.linalg.solve(gram + penalty * np.eye(2), moment[..., None])[..., 0]
    blank = np.where(seen, 0.0, np.nan)[:, None]
    return np.column_stack([weights + blank, blank])


def _powers(u: Array, load: Array, known: Bools, seen: Bools, top: Array) -> Array:
    """Weights (t, 3) of a power law: for each bend a straight line through logarithms."""
    used = known & (load > 0) & (u > 2e-3 * top)
    most = load.max(axis=0, initial=0.0) + 1e-12
    log_load = np.log(np.where(used, load, 1.0))
    share = np.where(used, np.square(load / (load + LIGHT * most)), 0.0)
    best = np.full(u.shape[1], np.inf)
    found = np.full((u.shape[1], 3), np.nan)
    bends, step = np.zeros(u.shape[1]) + BENDS[:, None], BENDS[1]
    for finer in (False, True):
        if finer:
            around = np.nan_to_num(found[:, 2] * top)
            bends = np.clip(around + step * np.linspace(-0.9, 0.9, 13)[:, None], 0.0, BENDS[-1])
        for bend in bends:
            c = bend / top
            x = np.where(used, np.log(np.where(used, u, 1.0)) - np.log1p(-c * u), 0.0)
            weight, wrong = _line(x, log_load, share)
            better = seen & (wrong < best) & (weight[:, 1] > 0.1)
            best = np.where(better, wrong, best)
            found[better] = np.column_stack([weight, c])[better]
    return found


def _line(x: Array, y: Array, share: Array) -> tuple[Array, Array]:
    """Exponential of the constant and slope (t, 2), and squared misfit (t,) of straight lines."""
    total = share.sum(axis=0) + 1e-30
    mean_x, mean_y = (share * x).sum(axis=0) / total, (share * y).sum(axis=0) / total
    away = share * (x - mean_x)
    slope = (away * y).sum(axis=0) / ((away * x).sum(axis=0) + 1e-30)
    constant = np.clip(mean_y - slope * mean_x, -50.0, 50.0)
    wrong = (share * np.square(y - constant - slope * x)).sum(axis=0)
    return np.column_stack([np.exp(constant), slope]), wrong


def _common_curve(part: Array, load: Array, found: Array, known: Bools) -> Array:
    """Factors (TABLE,) between loads and forces of a law, at bins of parts of the range."""
    inside = known & (part > 1e-3) & np.isfinite(found)
    if not inside.any():
        return np.ones(TABLE)
    x, y = [0.0], [1.0]
    share = np.where(inside, 1.0 / np.square(load + LIGHT * load.max(axis=0) + 1e-12), 0.0)
    edges = np.quantile(part[inside], BORDERS)
    for low, high in pairwise(edges):
        rows = inside & (part >= low) & (part <= high)
        scale = float((share * np.square(found))[rows].sum())
        if scale <= 0 or part[rows].mean() < x[-1] + 1e-3:
            continue
        x.append(float(part[rows].mean()))
        y.append(float(np.clip((share * load * found)[rows].sum() / scale, 0.3, 3.0)))
    if len(x) < 3:
        return np.ones(TABLE)
    y[0] = y[1]
    ends = x[-1] < 1.0
    curve = PchipInterpolator([*x, 1.0 + 1e-9] if ends else x, [*y, y[-1]] if ends else y)
    return np.asarray(curve(np.linspace(0, 1, TABLE)))


def _rising(curve: Array) -> Array:
    """The same factors, nowhere falling faster than output rises."""
    part = np.linspace(0, 1, TABLE)[1:]
    product = np.maximum.accumulate(curve[1:] * part)
    return np.concatenate([curve[:1], product / part])


def silent_taxels(output: Array, force: Array | None, noise: Array) -> Bools:
    """Taxels (t,) that answer nothing to outputs (s, t) above the baseline: dead, or stuck.

    With known loads `force` (N): loaded by a quarter of what the others bear at most, but moved by
    less than a twentieth of what they move; all, where none moved. Without: never moved, though
    three of four others were. `noise` (t,) is that of a taxel at rest; NaN: unknown.
    """
    from warnings import catch_warnings, simplefilter

    if not len(output):
        return np.zeros(output.shape[1], bool)
    with catch_warnings():
        simplefilter('ignore', RuntimeWarning)  # columns of nothing
        swing = np.nanmax(output, axis=0) - np.nanmin(output, axis=0)
        load = None if force is None else np.nanmax(force, axis=0)
    swing = np.nan_to_num(swing)
    typical = float(np.median(swing[swing > 0])) if (swing > 0).any() else 0.0
    still = swing <= np.maximum(0.05 * typical, 4 * np.nan_to_num(noise))
    if load is None or not (np.nan_to_num(load) > 0).any():
        moved = ~still
        return still if moved.mean() >= 0.75 and typical > 0 else np.zeros(len(still), bool)
    loaded = np.nan_to_num(load) > 0.25 * float(np.nanmedian(load[np.nan_to_num(load) > 0]))
    return np.asarray(still & (loaded | still.all()))
