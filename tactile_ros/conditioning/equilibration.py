"""Equilibration: the force of every taxel by a law of its own, zero force at zero output.

[4] fits a polynomial of second order to each taxel. With a free constant it reports 0.1..0.2 N at
rest and may fall inside the converter's range; here the constant is 0. A rational law bends like
a resistance in a divider, a power law like a skin whose resistance falls with a power of the load,
and a monotone curve (PCHIP) multiplies the better of these by what it lacks.
"""

from __future__ import annotations

from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.types import Array, Bools, Integers

if TYPE_CHECKING:
    from collections.abc import Callable

LAWS = ('polynomial', 'rational', 'power', 'pchip')
FEWEST_ROWS = 5
PENALTY = 1e-9
BORDERS = np.append([0.0, 1 / 36], np.linspace(1 / 12, 1, 12))  # light loads bend laws most
KNOTS = len(BORDERS) - 1
FREEDOM = {'polynomial': 2, 'rational': 3, 'power': 3, 'pchip': KNOTS}  # numbers of each taxel
TABLE = 65  # entries of a curve
LIGHT = 0.1  # of the largest force: lighter loads count by their error, heavier in parts
BENDS = np.linspace(0.0, 0.98, 15)  # of a power law, in parts of 1 over the largest output
BEYOND = 1.1  # times the largest output: so far a law that bends down is looked at
STEP = 1e-3  # of an output, in which a law's slope is taken
FOLDS = 4
RELATIVE = 0.3  # of the largest force: below it errors count as they are, above it in parts
MARGINS = {
    'polynomial': 1.0,
    'rational': 0.98,
    'power': 0.98,
    'pchip': 0.85,
}  # what freedom must be worth


class Equilibration:
    """Laws of all taxels, of one kind, chosen on held-out groups.

    Parameters
    ----------
    law : str or None
        One of `LAWS`; None: the best on held-out groups.

    Attributes
    ----------
    name : str
        Of the law in use.
    weights_ : ndarray, shape (t, 3)
        a, b (N) and c of F = (a u + b u^2) / (1 - c u), or a (N), p and c of the power law
        F = a (u / (1 - c u))^p; NaN: too few rows.
    curves_ : ndarray, shape (t, TABLE), or None
        Factors of the law at outputs from 0 to `top_`, of a monotone curve.
    kind : str
        Of `weights_`: 'power', or a polynomial or rational law.
    top_ : ndarray, shape (t,)
        Largest output that was learned from (unit of output).
    errors_ : dict of str to float
        Held-out error of each law, in parts of the force.

    Examples
    --------
    >>> u = np.linspace(0, 0.9, 40)[:, None]
    >>> law = Equilibration('rational').fit(u, 20 * u / (1.25 - u), np.arange(40))
    >>> float(np.round(law.forces(np.array([[0.0], [0.5]]))[1, 0], 3))
    13.333
    """

    def __init__(self, law: str | None = None) -> None:
        self.law = law
        self.name = self.kind = law or LAWS[0]
        self.weights_: Array = np.zeros((0, 3))
        self.curves_: Array | None = None
        self.top_: Array = np.zeros(0)
        self.errors_: dict[str, float] = {}

    def fit(self, output: Array, force: Array, groups: Integers) -> Equilibration:
        """Learn every taxel with enough rows.

        Parameters
        ----------
        output, force : ndarray, shape (s, t)
            Outputs above the baseline, and loads (N); NaN where unknown.
        groups : ndarray of int, shape (s,)
            What a split keeps together.

        Returns
        -------
        Equilibration
            Itself.
        """
        known = np.isfinite(force) & np.isfinite(output)
        u, load = np.where(known, output, 0.0), np.where(known, force, 0.0)
        names = LAWS if self.law is None else (self.law,)
        self.errors_ = {name: self._held_out(name, u, load, known, groups) for name in names}
        best = min(names, key=lambda name: self.errors_[name] / MARGINS[name])
        self.learn(best, u, load, known)
        return self

    def _held_out(self, name: str, u: Array, load: Array, known: Bools, groups: Integers) -> float:
        """Root mean square error of a law on groups that it had not seen."""
        fold = np.unique(groups, return_inverse=True)[1].reshape(-1) % FOLDS
        wrong, count = 0.0, 0
        for i in range(FOLDS):
            held = fold == i
            if not held.any() or held.all():
                continue
            self.learn(name, u[~held], load[~held], known[~held])
            miss = self.forces(u[held]) - load[held]
            scale = load[held] + RELATIVE * load.max(axis=0, initial=0.0) + 1e-12
            counted = known[held] & np.isfinite(miss)
            wrong += float(np.square(miss / scale)[counted].sum())
            count += int(counted.sum())
        return float(np.sqrt(wrong / count)) if count else np.inf

    def learn(self, name: str, u: Array, load: Array, known: Bools) -> None:
        """Set the law of every taxel (t,) from known rows (s, t), by one kind of law."""
        self.name, self.curves_, self.kind = name, None, name
        seen = (known.sum(axis=0) >= FEWEST_ROWS) & (np.square(u).sum(axis=0) > 0)
        self.top_ = np.where(seen, u.max(axis=0, initial=0.0), 1.0)
        self.top_ = np.where(self.top_ > 0, self.top_, 1.0)
        self.weights_ = _polynomials(u, load, known, seen)
        if name in ('rational', 'pchip'):
            self.weights_ = _rationals(u, load, known, seen, self.weights_, self.top_)
        if name == 'power':
            self.weights_ = _powers(u, load, known, seen, self.top_)
        if name == 'pchip':
            self._bend(u, load, known, seen)
        vars(self).pop('_reach', None)

    def _bend(self, u: Array, load: Array, known: Bools, seen: Bools) -> None:
        """Factors by which the better law is multiplied."""
        share = known / np.square(load + LIGHT * load.max(axis=0, initial=0.0) + 1e-12)
        vars(self).pop('_reach', None)  # of the law before
        rational, kept = self.forces(u), self.weights_
        self.weights_, self.kind = _powers(u, load, known, seen, self.top_), 'power'
        vars(self).pop('_reach', None)
        power = self.forces(u)
        worse = [np.nansum(share * np.square(one - load)) for one in (rational, power)]
        found = power
        if worse[0] <= worse[1]:
            self.weights_, self.kind, found = kept, 'rational', rational
        self.curves_ = _factors(u / self.top_, load, found, known)
        self.curves_ = _rising(self._law, self.curves_, self.top_)

    @property
    def known(self) -> Bools:
        """Taxels (t,) that have a law."""
        return np.asarray(np.isfinite(self.weights_[:, 0]))

    def forces(self, output: Array) -> Array:
        """Forces (s, t) (N) of outputs (s, t) above the baseline; NaN without a law.

        Halfway from the largest output that was learned from to the one at which a law knows no
        end it goes on in a straight line, so that no reading turns into an endless force or a
        negative one.
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
        pole = 1.0 / np.where(c > 0, c, np.nan)
        reach = np.where(c > 0, (self.top_ + pole) / 2, np.inf)
        falls = (b < 0) & (self.kind != 'power')
        return np.where(falls, np.minimum(reach, BEYOND * self.top_), reach)

    def _law(self, output: Array) -> Array:
        """Forces (s, t) (N) by the laws alone."""
        a, b, c = self.weights_.T
        if self.kind == 'power':
            size = np.abs(output)
            rise = np.copysign(a * (size / (1.0 - c * size)) ** b, output)
        else:
            rise = (a + b * output) * output
            if self.kind != LAWS[0]:
                rise /= 1.0 - c * output
        return rise if self.curves_ is None else np.asarray(rise * self._factor(output))

    def _factor(self, output: Array) -> Array:
        """What a curve multiplies the law by; beyond its ends as at them."""
        assert self.curves_ is not None
        at = np.nan_to_num(output * ((TABLE - 1) / self.top_))
        at = np.minimum(np.maximum(at, 0.0), TABLE - 1.0)
        cell = np.minimum(at.astype(np.int64), TABLE - 2)
        flat = cell + TABLE * np.arange(len(self.top_))
        low = self.curves_.reshape(-1)[flat]
        high = self.curves_.reshape(-1)[flat + 1]
        return np.asarray(low + (at - cell) * (high - low))


def _normal(terms: Array, load: Array, weight: Array, seen: Bools) -> Array:
    """Weights (t, n) of terms (s, t, n) by least squares, all taxels at once."""
    gram = np.einsum('sti,stj,st->tij', terms, terms, weight)
    moment = np.einsum('sti,st,st->ti', terms, load, weight)
    count = terms.shape[2]
    size = np.trace(gram, axis1=1, axis2=2)[:, None, None]
    penalty = np.where(seen[:, None, None], PENALTY * size, 1.0)
    weights = np.linalg.solve(gram + penalty * np.eye(count), moment[..., None])[..., 0]
    return np.asarray(np.where(seen[:, None], weights, np.nan))


def _polynomials(u: Array, load: Array, known: Bools, seen: Bools) -> Array:
    """Weights (t, 3) of u and u^2, and 0."""
    weights = _normal(np.stack([u, u**2], axis=-1), load, known.astype(np.float64), seen)
    return np.column_stack([weights, np.where(seen, 0.0, np.nan)])


def _rationals(
    u: Array, load: Array, known: Bools, seen: Bools, spare: Array, top: Array
) -> Array:
    """Weights (t, 3) of a rational law; those of the polynomial where it would not rise."""
    part = known / np.square(load + LIGHT * load.max(axis=0, initial=0.0) + 1e-12)
    weights, share = spare, part
    for _ in range(3):  # F (1 - c u) is linear in a, b, c; its error is divided by 1 - c u
        terms = np.stack([u, u**2, u * load], axis=-1)
        weights = _normal(terms, load, share, seen)
        room = 1.0 - weights[:, 2] * u
        share = np.asarray(part / np.square(np.where(np.abs(room) > 0.05, room, 0.05)))
    a, b, c = np.nan_to_num(weights).T[:, :, None]
    grid = top[:, None] * np.linspace(0, 1.1, 23)
    room = 1.0 - c * grid
    slope = (a + 2 * b * grid - b * c * grid**2) / np.square(np.where(room > 0, room, np.nan))
    rises = ((room > 0.02) & (slope > 0)).all(axis=1)
    return np.asarray(np.where(rises[:, None], weights, spare))


def _powers(u: Array, load: Array, known: Bools, seen: Bools, top: Array) -> Array:
    """Weights (t, 3) of a power law: for each bend a straight line through logarithms."""
    told = known & (load > 0) & (u > 2e-3 * top)
    most = load.max(axis=0, initial=0.0) + 1e-12
    log_load = np.log(np.where(told, load, 1.0))
    share = np.where(told, np.square(load / (load + LIGHT * most)), 0.0)
    best = np.full(u.shape[1], np.inf)
    found = np.full((u.shape[1], 3), np.nan)
    bends, step = np.zeros(u.shape[1]) + BENDS[:, None], BENDS[1]
    for finer in (False, True):
        if finer:
            around = np.nan_to_num(found[:, 2] * top)
            bends = np.clip(around + step * np.linspace(-0.9, 0.9, 13)[:, None], 0.0, BENDS[-1])
        for bend in bends:
            c = bend / top
            x = np.where(told, np.log(np.where(told, u, 1.0)) - np.log1p(-c * u), 0.0)
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


def _factors(part: Array, load: Array, found: Array, known: Bools) -> Array:
    """Factors (t, TABLE) between loads and what a law found, at bins of parts of the range."""
    from scipy.interpolate import PchipInterpolator

    inside = known & (part > 1e-3) & np.isfinite(found)
    edges = np.quantile(part[inside], BORDERS) if inside.any() else [0.0, 1]
    x, y = [0.0], []
    for low, high in pairwise(edges):
        rows = inside & (part >= low) & (part <= high)
        if not rows.any() or high - x[-1] < 1e-3:
            continue
        enough = rows.sum(axis=0) >= 3
        scale = np.square(np.where(rows, found, 0.0)).sum(axis=0)
        ratio = (np.where(rows, load * found, 0.0)).sum(axis=0) / np.where(scale > 0, scale, 1.0)
        x.append(float(part[rows].mean()))
        y.append(np.where(enough & (scale > 0), np.clip(ratio, 0.3, 3.0), 1.0))
    if not y:
        return np.ones((load.shape[1], TABLE))
    if x[-1] < 1.0:
        x, y = [*x, 1.0 + 1e-9], [*y, y[-1]]
    curve = PchipInterpolator(np.array(x), np.array([y[0], *y]))
    return np.asarray(curve(np.linspace(0, 1, TABLE)).T)


def _rising(forces: Callable[[Array], Array], curves: Array, top: Array) -> Array:
    """The same factors, drawn to 1 until no force falls; `curves` is changed."""
    grid = np.linspace(0, 1, 4 * TABLE)[:, None] * top
    for _ in range(5):
        falls = (np.diff(np.nan_to_num(forces(grid)), axis=0) < 0).any(axis=0)
        if not falls.any():
            return curves
        curves[falls] = 1.0 + 0.5 * (curves[falls] - 1.0)
    curves[falls] = 1.0
    return curves


def silent_taxels(output: Array, force: Array | None, noise: Array) -> Bools:
    """Taxels that answer nothing: dead, or stuck at whatever they say.

    Parameters
    ----------
    output : ndarray, shape (s, t)
        Outputs above the baseline, NaN where unknown.
    force : ndarray, shape (s, t), or None
        Loads where they are known (N).
    noise : ndarray, shape (t,)
        Of a taxel at rest (unit of output); NaN: unknown.

    Returns
    -------
    ndarray, shape (t,)
        With known loads: loaded by a quarter of what the others bear at most, but moved by less
        than a twentieth of what they move; all, where none moved. Without: never moved, though
        three of four others were.
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
