"""Equilibration: the force of every taxel by a law of its own, zero force at zero output.

[4] fits a polynomial of second order to each taxel. With a free constant it reports 0.1..0.2 N at
rest and may fall inside the converter's range; here the constant is 0. A rational law bends like
a resistance in a divider, and a monotone curve through means of bins takes any other shape.
"""

from __future__ import annotations

import numpy as np

from tactile_ros.types import Array, Bools, Integers

LAWS = ('polynomial', 'rational', 'pchip')
FEWEST_ROWS = 5
PENALTY = 1e-9
KNOTS = 12
TABLE = 129  # entries of a monotone curve
FOLDS = 4
RELATIVE = 0.3  # of the largest force: below it errors count as they are, above it in parts
MARGINS = {'polynomial': 1.0, 'rational': 0.98, 'pchip': 0.85}  # what freedom must be worth


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
        a, b (N) and c of F = (a u + b u^2) / (1 - c u); NaN: too few rows.
    curves_ : ndarray, shape (t, TABLE), or None
        Forces (N) at outputs from 0 to `top_` of a monotone curve.
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
        self.name = law or LAWS[0]
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
        self.name, self.curves_ = name, None
        seen = (known.sum(axis=0) >= FEWEST_ROWS) & (np.square(u).sum(axis=0) > 0)
        self.top_ = np.where(seen, u.max(axis=0, initial=0.0), 1.0)
        self.top_ = np.where(self.top_ > 0, self.top_, 1.0)
        self.weights_ = _polynomials(u, load, known, seen)
        if name == 'rational':
            self.weights_ = _rationals(u, load, known, seen, self.weights_, self.top_)
        elif name == 'pchip':
            self.curves_ = _curves(u, load, known, seen, self.top_)

    @property
    def known(self) -> Bools:
        """Taxels (t,) that have a law."""
        return np.asarray(np.isfinite(self.weights_[:, 0]))

    def forces(self, output: Array) -> Array:
        """Forces (s, t) (N) of outputs (s, t) above the baseline; NaN without a law."""
        if self.curves_ is not None:
            return self._looked_up(output)
        a, b, c = self.weights_.T
        rise = (a + b * output) * output
        return rise if self.name == LAWS[0] else np.asarray(rise / (1.0 - c * output))

    def _looked_up(self, output: Array) -> Array:
        """Forces on the curves, straight on beyond their ends."""
        assert self.curves_ is not None
        at = np.nan_to_num(output * ((TABLE - 1) / self.top_))
        cell = np.clip(at.astype(np.int64), 0, TABLE - 2)
        flat = cell + TABLE * np.arange(len(self.top_))
        low = self.curves_.reshape(-1)[flat]
        high = self.curves_.reshape(-1)[flat + 1]
        return np.asarray(np.where(np.isnan(output), np.nan, low + (at - cell) * (high - low)))


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
    weights, share = spare, known.astype(np.float64)
    for _ in range(3):  # F (1 - c u) is linear in a, b, c; its error is divided by 1 - c u
        terms = np.stack([u, u**2, u * load], axis=-1)
        weights = _normal(terms, load, share, seen)
        room = 1.0 - weights[:, 2] * u
        share = np.asarray(known / np.square(np.where(np.abs(room) > 0.05, room, 0.05)))
    a, b, c = np.nan_to_num(weights).T[:, :, None]
    grid = top[:, None] * np.linspace(0, 1.1, 23)
    room = 1.0 - c * grid
    slope = (a + 2 * b * grid - b * c * grid**2) / np.square(np.where(room > 0, room, np.nan))
    rises = ((room > 0.02) & (slope > 0)).all(axis=1)
    return np.asarray(np.where(rises[:, None], weights, spare))


def _curves(u: Array, load: Array, known: Bools, seen: Bools, top: Array) -> Array:
    """Monotone curves (t, TABLE) through zero and means of bins."""
    from scipy.interpolate import PchipInterpolator

    curves = np.full((u.shape[1], TABLE), np.nan)
    for i in np.flatnonzero(seen):
        x, y = _knots(u[known[:, i], i], load[known[:, i], i], float(top[i]))
        curves[i] = PchipInterpolator(x, y)(np.linspace(0, top[i], TABLE))
    return curves


def _knots(u: Array, load: Array, top: float) -> tuple[Array, Array]:
    """Means of bins of about as many rows each, rising, from zero to the largest output."""
    above = u > 1e-3 * top
    u, load = u[above], load[above]
    order = np.argsort(u, kind='stable')
    bins = [b for b in np.array_split(order, min(KNOTS, max(len(order) // 3, 1))) if len(b)]
    x = np.array([0.0] + [u[b].mean() for b in bins])
    y = np.array([0.0] + [load[b].mean() for b in bins])
    keep = np.concatenate([[True], np.diff(x) > 1e-6 * top])
    x, y = x[keep], np.maximum.accumulate(np.maximum(y[keep], 0.0))
    if x[-1] < top:  # straight on to the largest output
        slope = (y[-1] - y[-2]) / (x[-1] - x[-2]) if len(x) > 1 else 0.0
        x, y = np.append(x, top), np.append(y, y[-1] + slope * (top - x[-1]))
    return x, y


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
        than a twentieth of what they move. Without: never moved, though three of four others were.
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
    return np.asarray(still & loaded & (typical > 0))
