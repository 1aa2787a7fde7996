"""Forces of taxels: gaps, errors and creep of their laws.

A law without memory gives the crept load: h(u) = F + sum_i c_i x_i, with x_i the strains that the
told loads F leave. Any law h is a sum of hinges; what they cannot tell of F must be strains.
"""

from __future__ import annotations

import math
from functools import cached_property
from itertools import combinations
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from tactile_ros.conditioning.equilibration import FREEDOM, Equilibration
from tactile_ros.conditioning.loading_direction import loading_signs, presses
from tactile_ros.conditioning.viscoelastic import Creep, strains
from tactile_ros.estimators.covariance import BEYOND, UNTOLD
from tactile_ros.physics.compiled import compiled
from tactile_ros.types import Array

if TYPE_CHECKING:
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
    alike : ndarray, shape (2, l)
        Part by which those that bear alike err alike, and by which all that are loaded, or all
        that are unloaded, do: hysteresis.
    """

    # of a taxel: a constant part (N), and a part of its force
    floor: float
    spread: float
    own: Array  # (l,) part of its force by which a taxel errs, at each of `LEVELS`
    alike: Array
    idle: Array  # (t,) of a taxel that bears nothing (N)


def force_errors(
    miss: Array, force: Array, law: Equilibration, unlearned: float, restart: Bools | None = None
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
        loading_signs(force, restart), presses(force, restart),
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


@compiled
def filled_rows(
    forces: Array, silent: Integers, near: Integers, share: Array, own: Array,
    idle: Array, guessed: float, load: Array, variance: Array,
) -> bool:  # fmt: skip
    """Loads (s, t) without gaps and their variances; False: taxels are lost that are not silent.

    Those of silent taxels (n,) are sums over taxels near them (n, k). `own` (s, t) is the error of
    a load in parts of it.
    """
    whole = True
    for i in range(len(forces)):
        unread = 0
        for k in range(forces.shape[1]):
            lost = math.isnan(forces[i, k])
            unread += lost
            load[i, k] = 0.0 if lost else forces[i, k]
            variance[i, k] = idle[k] ** 2 + (own[i, k] * load[i, k]) ** 2
        for n in range(len(silent)):
            total = 0.0
            for k in range(near.shape[1]):
                total += load[i, near[n, k]] * share[n, k]
            unread -= math.isnan(forces[i, silent[n]])
            variance[i, silent[n]] = guessed**2 * total**2
            load[i, silent[n]] = total
        whole = whole and unread == 0
    return whole


@compiled
def judged_row(
    row: Array, variance: Array, cover: Array, pressure: float, able: Bools, areas: Array,
    covered: float, mute: float, loud: float, verdict: Integers,
) -> tuple[float, float, float, int]:  # fmt: skip
    """Forces that an object hides and that are seen, the variance and the count of the seen.

    `verdict` (t,) becomes -1 at taxels that are mute under the object, 1 at loud ones beside it.
    """
    hidden, seen, unsure, count = 0.0, 0.0, 0.0, 0
    for k in range(len(row)):
        verdict[k] = 0
        if cover[k] > covered * areas[k] and row[k] < mute * pressure * cover[k]:
            verdict[k] = -1
        elif cover[k] < 1e-3 * areas[k] and row[k] > loud * pressure * areas[k]:
            verdict[k] = 1
        if verdict[k] < 0 or not able[k]:
            hidden += pressure * cover[k]
        elif verdict[k] == 0:
            seen += row[k]
            unsure += variance[k]
            count += 1
    return hidden, seen, unsure, count


GUESSED = 0.5  # error of a silent taxel's force, in parts
AROUND = 4  # taxels that stand for a lost one


class Gaps:
    """Neighbours of the taxels of one array.

    Parameters
    ----------
    positions, areas : ndarray, shape (t, 3) and (t,)
        Centres (m) and areas (m2).
    silent : ndarray, shape (t,)
        Taxels that are never read.

    Examples
    --------
    >>> places = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]])
    >>> gaps = Gaps(places, np.ones(3), np.zeros(3, bool))
    >>> gaps.filled(np.array([[1.0, np.nan, 3.0]])).tolist()
    [[1.0, 2.0, 3.0]]
    """

    def __init__(self, positions: Array, areas: Array, silent: Bools) -> None:
        self.positions, self.areas, self.silent = positions, areas, silent

    def loads(
        self, forces: Array, own: Array, alike: Array, most: Array, idle: Array
    ) -> tuple[Array, Array, Array]:
        """Forces without gaps, their variances, and what they share.

        Parameters
        ----------
        forces : ndarray, shape (s, t)
            Of the taxels (N); NaN: not read.
        own, alike : ndarray, shape (l,) and (2, l)
            Errors in parts of the force at each of some loads; see `ForceErrors`.
        most : ndarray, shape (t,)
            Largest force of each taxel (N).
        idle : ndarray, shape (t,)
            Error of a taxel that bears nothing (N).

        Returns
        -------
        load, variance : ndarray, shape (s, t)
            0 where no taxel of a frame was read.
        shared : ndarray, shape (s,)
            Part of their sum by which all loads of a frame err alike.
        """
        share = np.nan_to_num(forces) / most
        level = np.searchsorted(LEVELS, share)
        untold = untold_parts(share)
        parts = own[level] if untold is None else np.hypot(own[level], untold)
        load, variance = np.empty(forces.shape), np.empty(forces.shape)
        if filled_rows(forces, *self.beside, parts, idle, GUESSED, load, variance):
            return load, variance, _shared(load, level, alike, untold)
        filled = self.filled(forces)
        unknown = np.isnan(filled)
        load = np.where(unknown, 0.0, filled) if np.count_nonzero(unknown) else filled
        known = idle**2 + (parts * load) ** 2
        variance = np.where(np.isnan(forces), GUESSED**2 * (load * load), known)
        return load, variance, _shared(load, level, alike, untold)

    @staticmethod
    def parts(forces: Array, own: Array, most: Array) -> Array:
        """Errors (s, t) in parts of the force, of forces (s, t); see `loads`."""
        share = np.nan_to_num(forces) / most
        parts, untold = own[np.searchsorted(LEVELS, share)], untold_parts(share)
        return np.asarray(parts if untold is None else np.hypot(parts, untold))

    def filled(self, forces: Array) -> Array:
        """Forces (s, t), those that are NaN as large as the pressure around tells."""
        lost = np.isnan(forces)
        if not np.count_nonzero(lost) or self.silent.all():
            return forces
        filled = forces.copy()
        if np.count_nonzero(self.silent):
            silent, near, share = self.beside
            filled[:, silent] = (np.where(lost, 0.0, forces)[:, near] * share).sum(axis=2)
        torn = lost & ~self.silent
        for i in np.flatnonzero(torn.any(axis=1)) if np.count_nonzero(torn) else ():
            if not lost[i].all():
                self._fill(filled[i], lost[i])
        return filled

    def _fill(self, row: Array, lost: Bools) -> None:
        """One row (t,) in which taxels are lost that others rows have; it is changed."""
        gaps, near = self._nearest(lost)
        row[gaps] = (row[near] / self.areas[near]).mean(axis=1) * self.areas[gaps]

    @cached_property
    def beside(self) -> tuple[Integers, Integers, Array]:
        """Silent taxels (n,), those nearest to each, and what each of them adds (n, k)."""
        silent, near = self._nearest(self.silent)
        share = self.areas[silent, None] / self.areas[near] / max(near.shape[1], 1)
        return silent, near, np.asarray(share)

    def _nearest(self, lost: Bools) -> tuple[Integers, Integers]:
        """Lost taxels (n,), and the read ones nearest to each (n, k)."""
        gaps, live = np.flatnonzero(lost), np.flatnonzero(~lost)
        away = np.linalg.norm(self.positions[gaps, None] - self.positions[None, live], axis=2)
        return gaps, live[np.argsort(away, axis=1, kind='stable')[:, :AROUND]]


def _shared(load: Array, level: Integers, alike: Array, untold: Array | None) -> Array:
    """As `shared_part`; beyond what was told laws of one kind err alike as well."""
    shared = shared_part(load, level, alike)
    if untold is None:
        return shared
    total = load.sum(axis=1)
    beyond = (untold * load).sum(axis=1) / np.where(total > 0, total, 1.0)
    return np.asarray(np.hypot(shared, beyond))


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
CREEP_FIT_CLEAR = 3.0  # of its standard error: more is a level
MOST_SHARE = 3.0


def fit_creep(
    output: Array, force: Array, stamp_ns: Integers, restart: Bools, groups: Integers,
    law: Equilibration,
) -> tuple[Equilibration, Creep] | None:  # fmt: skip
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
    clear = np.abs(level) > CREEP_FIT_CLEAR * noise / np.sqrt(len(rows))
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
