"""Which head pressed, where, how turned and how deep: templates first, then least squares.

A press is compared with templates of unit length, after what a uniform field could have added is
taken out of both. The likeliest places are found by what all heads have in common there; then
the best nodes of each head are refined, and misfits decide.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.estimators.few_shot import SupportSet, share_of
from tactile_ros.estimators.press_templates import cleared_rows, descend_rows, solved_rows
from tactile_ros.physics.compiled import compiled

if TYPE_CHECKING:
    import numpy.typing as npt

    from tactile_ros.estimators.few_shot import Presses
    from tactile_ros.estimators.press_templates import PressBank
    from tactile_ros.types import Array, Integers

    Singles = npt.NDArray[np.float32]

LONGEST = np.array([2e-3, 2e-3, 0.35])  # m, m, rad: steps
RATIO = (0.4, 2.5)  # of depths from step to step
FAINTEST = 0.02  # of the usual depth, where a descent begins
ROUNDS = 8
CLOSE = 0.5  # of a misfit, which one step may leave to its straight line
BEHIND = 0.1  # of how far a head is behind
SHRUNK = 0.3
DAMPING = 1e-4
STOP = np.array([CLOSE, BEHIND, FAINTEST, DAMPING, SHRUNK])  # as loops take them


def limits(shallowest: float, deepest: float) -> Array:
    """Of steps of a descent, and of depths (m)."""
    return np.array([*LONGEST, *RATIO, shallowest, deepest])


MIXTURE_DAMPING = 1e-4  # of slopes of unit length
TINY = 1e-30
FEWEST = 1e-3  # degrees of freedom


@compiled
def products_rows(rows: Array, own: Array, right: Array, low: Array) -> None:
    """Products (r, r) of rows (r, d) and with the right side (d,) in a column more; filled."""
    low[:] = 0.0
    for k in range(rows.shape[1]):
        for i in range(len(rows)):
            low[i, -1] += rows[i, k] * right[k]
            for j in range(i + 1):
                low[i, j] += rows[i, k] * rows[j, k]
    for i in range(len(rows)):
        low[i, i] += own[i]


@compiled
def factor_rows(low: Array) -> None:
    """Lower triangle of a positive matrix (r, r) becomes its Cholesky factor."""
    for i in range(len(low)):
        for j in range(i + 1):
            total = low[i, j]
            for k in range(j):
                total -= low[i, k] * low[j, k]
            low[i, j] = np.sqrt(total) if i == j else total / low[j, j]


@compiled
def solve_rows(low: Array, first: int, right: Array) -> float:
    """Squares of the solution (r,) with a lower triangle, from one row on; it is filled."""
    total = 0.0
    for i in range(first, len(right)):
        for k in range(first, i):
            right[i] -= low[i, k] * right[k]
        right[i] /= low[i, i]
        total += right[i] * right[i]
    return total


@compiled
def shape_rows(miss: Array, slopes: Array, away: Array, found: Array) -> None:
    """What mixtures of other heads explain of misfits, over what chance would let them.

    Parameters
    ----------
    miss : ndarray, shape (n, d)
        What the best head leaves of each press, over the deviations of readings and less what a
        uniform field could have added.
    slopes : ndarray, shape (n, 4, d)
        Of its pattern with the pose, alike.
    away : ndarray, shape (n, h, d)
        From its pattern to those of all heads, of which it is one, alike.
    found : ndarray, shape (n,)
        Filled: about 1 where it is that head; 1 where there is no other.

    Notes
    -----
    Weights of a mixture have a deviation of 1 about 0: 1 is the whole way to another head.
    """
    if away.shape[1] == 1:
        found[:] = 1.0
        return
    free, heads = slopes.shape[1], away.shape[1]
    rows, low = np.empty((free + heads, miss.shape[1])), np.empty((free + heads, free + heads + 1))
    own, unit = np.ones(free + heads), np.empty(free + heads)
    own[:free] = MIXTURE_DAMPING
    for n in range(len(miss)):
        for i in range(free):
            rows[i] = slopes[n, i] / (np.sqrt((slopes[n, i] * slopes[n, i]).sum()) + TINY)
        rows[free:] = away[n]
        products_rows(rows, own, miss[n], low)
        factor_rows(low)
        solve_rows(low, 0, low[:, -1])
        gain, left = 0.0, 0.0
        for i in range(free, free + heads):
            gain += low[i, -1] * low[i, -1]
            unit[:] = 0.0
            unit[i] = 1.0
            left += solve_rows(low, i, unit)
        found[n] = gain / max(heads - left, FEWEST)


@compiled
def places_rows(seen: Singles, rank: int, best: Integers) -> None:
    """Numbers of the places whose spans (rank x places,) see most of a press: `best` is filled."""
    count, most = len(seen) // rank, np.full(len(best), np.float32(-1.0))
    for place in range(count):
        total = np.float32(0.0)
        for i in range(rank):
            total += seen[i * count + place] * seen[i * count + place]
        i = len(best) - 1
        if total <= most[i]:
            continue
        while i > 0 and total > most[i - 1]:
            most[i], best[i] = most[i - 1], best[i - 1]
            i -= 1
        most[i], best[i] = total, place


@compiled
def starts_rows(
    score: Singles, first: Integers, turns: Integers, step: Array, place: Array, pose: Array
) -> None:
    """Where each head looks most like a press: `pose` (heads x starts, 4) is filled.

    Parameters
    ----------
    score : ndarray, shape (places, turns)
        Likeness at places, of heads at their turns.
    first, turns, step : ndarray, shape (heads,)
        First column of each head, how many it has, and how far apart they are (rad).
    place : ndarray, shape (places, 2)
        Places (m).
    """
    starts = len(pose) // len(first)
    most = np.empty(starts, np.float32)
    for head in range(len(first)):
        own = pose[head * starts : (head + 1) * starts]
        most[:] = -np.inf
        for turn in range(turns[head]):
            for where in range(len(place)):
                likely = score[where, first[head] + turn]
                i = starts - 1
                if likely <= most[i]:
                    continue
                while i > 0 and likely > most[i - 1]:
                    most[i], own[i] = most[i - 1], own[i - 1]
                    i -= 1
                most[i], own[i, 2] = likely, turn * step[head]
                own[i, 0], own[i, 1] = place[where, 0], place[where, 1]


@compiled
def variance_rows(pattern: Array, noise: Array, error: float, variance: Array) -> float:
    """Noise (d,) and error of the model as one variance (d,), which is filled; its logarithm."""
    here, most, level = np.empty(len(pattern) // 3), 0.0, 0.0
    for i in range(len(here)):
        x, y, z = pattern[3 * i], pattern[3 * i + 1], pattern[3 * i + 2]
        here[i] = (x * x + y * y + z * z) / 3.0
        most = max(most, here[i])
    for k in range(len(pattern)):
        variance[k] = noise[k] + error * error * (here[k // 3] + 0.05 * most)
        level += np.log(variance[k])
    return level


@compiled
def orthonormal_rows(span: Array) -> None:
    """Rows of a matrix (3, d) become orthonormal, one after the other."""
    for i in range(3):
        for round_ in range(2 * i):  # twice each, for what rounding left
            j = round_ % i
            span[i] -= (span[i] * span[j]).sum() * span[j]
        span[i] /= np.sqrt((span[i] * span[i]).sum())


@compiled
def weigh_rows(
    pattern: Array, variance: Array, common: Array, weight: Array, wanted: Array, span: Array
) -> None:
    """A press as of `Weighed`: `weight`, `wanted` (1, d) and `span` (3, d) are filled."""
    for k in range(len(pattern)):
        weight[k] = 1.0 / np.sqrt(variance[k])
        wanted[0, k] = pattern[k] * weight[k]
        for j in range(3):
            span[j, k] = common[k, j] * weight[k]
    orthonormal_rows(span)
    cleared_rows(wanted, span)


@compiled
def inverse_rows(normal: Array, scale: Array, cov: Array) -> None:
    """Inverse of a matrix of steps (4, 4) in their units; `cov` is filled."""
    unit = np.zeros(4)
    for i in range(4):
        unit[i] = 1.0
        solved_rows(normal, unit, cov[i])
        unit[i] = 0.0
        for j in range(4):
            cov[i, j] /= scale[i] * scale[j]


@compiled
def misfit_row(
    cost: Array, plain: Array, weight: Array, span: Array, wanted: Array, found: Array
) -> None:
    """Misfit of the likeliest head's shape from patterns (heads, 5, d); `found` (1,) is filled."""
    best, d = np.argmin(cost), plain.shape[2]
    rows = np.empty((5 + len(cost), d))
    for k in range(d):
        for i in range(5):
            rows[i, k] = plain[best, i, k] * weight[k]
        for i in range(len(cost)):
            rows[5 + i, k] = (plain[i, 0, k] - plain[best, 0, k]) * weight[k]
    cleared_rows(rows, span)
    miss = wanted - rows[:1]
    shape_rows(miss, rows[1:5].reshape(1, 4, d), rows[5:].reshape(1, -1, d), found)


@compiled
def match_rows(
    flat: Singles, grid: Array, about: Array, head: Integers, limit: Array, stop: Array,
    rounds: int, pattern: Array, noise: Array, error: float, common: Array,
    start: Array, cost: Array, pose: Array, cov: Array, plain: Array, misfit: Array,
) -> float:  # fmt: skip
    """Descend from starts (s, 4), keep the best of each head: all from `cost` on is filled.

    Returns the logarithm of the variance of the pattern.
    """
    s, d, heads = len(head), len(pattern), len(cost)
    weight, wanted, span, variance = np.empty(d), np.empty((1, d)), np.empty((3, d)), np.empty(d)
    level = variance_rows(pattern, noise, error, variance)
    weigh_rows(pattern, variance, common, weight, wanted, span)
    costs, normal, scale, rows = (
        np.empty(s),
        np.empty((s, 4, 4)),
        np.empty((s, 4)),
        np.empty((s, 5, d)),
    )
    descend_rows(
        flat, grid, about, head, limit, stop, rounds, weight, span, wanted[0], start,
        costs, normal, scale, rows,
    )  # fmt: skip
    starts = s // heads
    for i in range(heads):
        best = i * starts + np.argmin(costs[i * starts : (i + 1) * starts])
        cost[i], pose[i], plain[i] = costs[best], start[best], rows[best]
        inverse_rows(normal[best], scale[best], cov[i])
    if heads > 1:
        misfit_row(cost, plain, weight, span, wanted, misfit)
    else:
        misfit[0] = 1.0
    return level


def supports_of(
    presses: Presses, labels: Integers, number: Integers, matches: Matches | None,
    bank: PressBank | None,
) -> SupportSet:  # fmt: skip
    """Presses (n) as supports of classes, with what the most alike template of each changes by.

    Parameters
    ----------
    presses : Presses
        n presses.
    labels, number : ndarray, shape (n,)
        Their classes, and which press each is a window of.
    matches, bank : Matches and PressBank, or None
        Templates of the presses; None: there is no model.
    """
    n, d = presses.pattern.shape
    slopes, bends = np.zeros((n, 3, d)), np.zeros((n, d))
    if matches is not None and bank is not None and n:
        best = matches.cost.argmin(axis=1)
        pose, slopes = matches.pose[np.arange(n), best], matches.slopes[np.arange(n), best, :3]
        terms = bank.at(best, pose[:, :3])[:, 0]
        deep = pose[:, 3, None]
        bends = deep**2 * terms[:, 1] + 2 * deep**3 * terms[:, 2]
    return SupportSet(
        labels, number, presses.pattern, presses.frames, np.ones(n), slopes, bends
    )


USUAL = 0.12  # of the body: depth of the templates that are searched
RANK = 6  # patterns that heads have in common at a place
PLACES = 10  # looked at closely
STARTS = 2  # of each head
DEEPEST, SHALLOWEST = 0.5, 0.005  # of the body
TOGETHER = 64  # presses
TURNS, APART = 8, 1e-6  # of a search for patterns; of its matrices, added to their diagonal


@dataclass(frozen=True)
class Matches:
    """The best press of every head, for each of n presses."""

    cost: Array  # (n, heads) squared misfit over its variance
    pose: Array  # (n, heads, 4) place (m), turn (rad) and depth (m)
    cov: Array  # (n, heads, 4, 4) of the pose, as noise and error of the model have it
    slopes: Array  # (n, heads, 4, d) change of the pattern with the pose
    fitted: Array  # (n, heads, d) pattern of the best press
    level: Array  # (n,) logarithm of the variance of the pattern
    misfit: Array  # (n,) of the likeliest head's shape; see `shape_misfits`

    def rows(self, rows: npt.NDArray[np.intp]) -> Matches:
        """Those of some presses."""
        return Matches(*(getattr(self, one.name)[rows] for one in fields(self)))

    def or_better(self, other: Matches) -> Matches:
        """Of each press these or those of another skin, whichever fit better."""
        which = np.argmin([self.cost.min(axis=1), other.cost.min(axis=1)], axis=0)
        each = np.arange(len(which))
        parts = (
            np.stack([getattr(self, one.name), getattr(other, one.name)])[which, each]
            for one in fields(self)
        )
        return Matches(*parts)


class PressSearch:
    """Search among the templates of a bank.

    Parameters
    ----------
    bank : PressBank
        Templates.
    noise : ndarray, shape (d,)
        Of a reading (T).
    common : ndarray, shape (d, 3)
        What a uniform field does to readings.
    body : float
        Height of the soft body (m).
    error : float
        Of the model, as a share of what a chip sees.
    still : float
        Error of a pattern that frames do not average (T).
    other : PressSearch or None
        The same for another skin that it may be: each press is taken for one of the skin that
        explains it better.
    """

    def __init__(
        self, bank: PressBank, noise: Array, common: Array, body: float, error: float,
        still: float = 0.0, other: PressSearch | None = None,
    ) -> None:  # fmt: skip
        self.still, self.other = still, other
        self.bank, self.noise, self.body, self.error = bank, noise, body, error
        self.common = common
        self.basis = np.linalg.qr(common)[0]
        self.cleared = np.eye(len(common)) - self.basis @ self.basis.T
        self.limit = limits(SHALLOWEST * body, DEEPEST * body)
        nodes = bank.at_nodes()
        usual = USUAL * body
        found = nodes[..., 0, :] + usual * nodes[..., 1, :] + usual**2 * nodes[..., 2, :]
        found -= (found @ self.basis.astype(np.float32)) @ self.basis.T.astype(np.float32)
        found /= np.linalg.norm(found, axis=-1, keepdims=True) + np.float32(1e-30)
        turns, nx, ny, d = found.shape
        self.units = np.ascontiguousarray(np.moveaxis(found, 0, 2).reshape(nx * ny, turns, d))
        gram = np.matmul(np.swapaxes(self.units, 1, 2), self.units)
        rank = min(RANK, turns, d)
        spans = _leading(gram, rank).astype(np.float32)
        self.spans = np.ascontiguousarray(np.moveaxis(spans, 2, 0)).reshape(-1, d)
        self.rank = rank
        x, y = bank.nodes
        self.places = np.stack(np.meshgrid(x, y, indexing='ij'), axis=-1).reshape(-1, 2)
        self.first = np.array([head.first for head in bank.heads])
        self.turns = np.array([head.turns for head in bank.heads])
        self.turn = np.array([head.sector / head.turns for head in bank.heads])
        self.heads = np.repeat(np.arange(len(bank.heads)), STARTS)

    def find(self, presses: Presses) -> Matches:
        """The best press of every head."""
        count = len(presses.pattern)
        if count <= TOGETHER:
            return self._find(presses)
        each = np.split(np.arange(count), np.arange(TOGETHER, count, TOGETHER))
        return joined([self._find(presses.rows(rows)) for rows in each])

    def let_still(self, still: float) -> None:
        """Let patterns have another error that frames do not average (T)."""
        self.still = still
        if self.other is not None:
            self.other.let_still(still)

    def variance(self, presses: Presses) -> Array:
        """Variance of patterns (n, d): noise, and error of the model where chips see much."""
        return presses.variance(self.noise, self.still) + share_of(presses.pattern, self.error)

    def _find(self, presses: Presses) -> Matches:
        """Of a few presses, which fit in the memory together."""
        found = self._found(presses)
        return found if self.other is None else found.or_better(self.other._find(presses))

    def _found(self, presses: Presses) -> Matches:
        """The same on this skin."""
        # one by one, so that a press has the same starts alone and among others
        start = np.array([self._starts(own) for own in presses.pattern @ self.cleared])
        bank, (n, d), heads = self.bank, presses.pattern.shape, len(self.first)
        noise = presses.variance(self.noise, self.still)
        plain = np.empty((n, heads, 5, d))
        found = Matches(
            np.empty((n, heads)), np.empty((n, heads, 4)), np.empty((n, heads, 4, 4)),
            plain[:, :, 1:], plain[:, :, 0], np.empty(n), np.empty(n),
        )  # fmt: skip
        for i in range(n):
            found.level[i] = match_rows(
                bank.flat, bank.grid, bank.about, self.heads, self.limit, STOP, ROUNDS,
                presses.pattern[i], noise[i], self.error, self.common,
                start[i], found.cost[i], found.pose[i], found.cov[i], plain[i],
                found.misfit[i : i + 1],
            )  # fmt: skip
        return found

    def _starts(self, own: Array) -> Array:
        """Poses (s, 4) at which descents of one press (d,) start, head by head."""
        own = (own / (np.sqrt(own @ own) + 1e-30)).astype(np.float32)
        seen = np.asarray(self.spans @ own, np.float32)
        pose = np.full((len(self.heads), 4), USUAL * self.body)
        near = np.zeros(PLACES, np.int64)
        places_rows(seen, self.rank, near)
        score = np.asarray(self.units[near] @ own, np.float32)
        starts_rows(score, self.first, self.turns, self.turn, self.places[near], pose)
        return pose


def joined(parts: list[Matches]) -> Matches:
    """Matches of presses, one after the other."""
    return Matches(
        *(np.concatenate([getattr(part, one.name) for part in parts]) for one in fields(Matches))
    )


def _leading(gram: Array, rank: int) -> Array:
    """Bases (n, d, rank) of what matrices (n, d, d) enlarge most, closely enough for a search."""
    d = gram.shape[1]
    rows = gram + APART * np.trace(gram, axis1=1, axis2=2)[:, None, None] * np.eye(d)
    span = np.random.default_rng(0).normal(size=(d, rank))
    for _ in range(TURNS):
        span = np.linalg.qr(np.matmul(rows, span))[0]
    return np.asarray(span)
