"""Which head pressed, where, how turned and how deep: templates first, then least squares.

A press is compared with templates of unit length, after what a uniform field could have added is
taken out of both. The likeliest places are found by what all heads have in common there; then
the best nodes of each head are refined, and misfits decide.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.estimators.few_shot import orthonormal
from tactile_ros.estimators.match_rows import match_rows, places_rows, starts_rows
from tactile_ros.estimators.press_descent import ROUNDS, STOP, descend, limits, weigh
from tactile_ros.estimators.shape_misfit import shape_misfits
from tactile_ros.physics import compiled

if TYPE_CHECKING:
    import numpy.typing as npt

    from tactile_ros.estimators.press_bank import PressBank
    from tactile_ros.estimators.press_descent import Descents, Weighed
    from tactile_ros.estimators.press_window import PressVectors
    from tactile_ros.types import Array

USUAL = 0.12  # of the body: depth of the templates that are searched
RANK = 6  # patterns that heads have in common at a place
PLACES = 10  # looked at closely
STARTS = 2  # of each head
DEEPEST, SHALLOWEST = 0.5, 0.005  # of the body
TOGETHER = 64  # presses
TURNS, APART = 8, 1e-6  # of a search for patterns; of its matrices, added to their diagonal


@dataclass(frozen=True)
class Matches:
    """The best press of every head, for each of n presses.

    Attributes
    ----------
    cost : ndarray, shape (n, heads)
        Squared misfit over its variance.
    pose : ndarray, shape (n, heads, 4)
        Place (m), turn (rad) and depth (m).
    cov : ndarray, shape (n, heads, 4, 4)
        Of the pose, as noise and error of the model have it.
    slopes : ndarray, shape (n, heads, 4, d)
        Change of the pattern with the pose.
    fitted : ndarray, shape (n, heads, d)
        Pattern of the best press.
    level : ndarray, shape (n,)
        Logarithm of the variance of the pattern.
    misfit : ndarray, shape (n,)
        Of the likeliest head's shape; see `shape_misfits`.
    """

    cost: Array
    pose: Array
    cov: Array
    slopes: Array
    fitted: Array
    level: Array
    misfit: Array

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
        self,
        bank: PressBank,
        noise: Array,
        common: Array,
        body: float,
        error: float,
        still: float = 0.0,
        other: PressSearch | None = None,
    ) -> None:
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

    def find(self, presses: PressVectors) -> Matches:
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

    def variance(self, presses: PressVectors) -> Array:
        """Variance of patterns (n, d): noise, and error of the model where chips see much."""
        n = len(presses.pattern)
        chips = presses.pattern.reshape(n, -1, 3)
        here = np.square(chips).mean(axis=2, keepdims=True)
        most = 0.05 * here.max(axis=1, keepdims=True)
        share = np.square(self.error) * (here + most) * np.ones(3)
        noise = presses.variance(self.noise, self.still)
        return np.asarray(noise + share.reshape(n, -1))

    def _find(self, presses: PressVectors) -> Matches:
        """Of a few presses, which fit in the memory together."""
        found = self._found(presses)
        return found if self.other is None else found.or_better(self.other._find(presses))

    def _found(self, presses: PressVectors) -> Matches:
        """The same on this skin."""
        # one by one, so that a press has the same starts alone and among others
        start = np.array([self._starts(own) for own in presses.pattern @ self.cleared])
        if compiled.available():
            return self._looped(presses, start)
        press, head = np.divmod(np.arange(start.size // 4), len(self.heads))
        variance = self.variance(presses)
        weighed = weigh(presses.pattern, variance, self.common, presses.powers)
        start = start.reshape(-1, 4)
        found = descend(self.bank, weighed, press, self.heads[head], start, self.limit)
        return self._best(found, np.log(variance).sum(axis=1), weighed)

    def _looped(self, presses: PressVectors, start: Array) -> Matches:
        """The same by compiled loops, press by press."""
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
                presses.pattern[i], presses.powers[i], noise[i], self.error, self.common,
                start[i], found.cost[i], found.pose[i], found.cov[i], plain[i],
                found.misfit[i : i + 1],
            )  # fmt: skip
        return found

    def _starts(self, own: Array) -> Array:
        """Poses (s, 4) at which descents of one press (d,) start, head by head."""
        own = (own / (np.sqrt(own @ own) + 1e-30)).astype(np.float32)
        seen = np.asarray(self.spans @ own, np.float32)
        pose = np.full((len(self.heads), 4), USUAL * self.body)
        if compiled.available():
            near = np.zeros(PLACES, np.int64)
            places_rows(seen, self.rank, near)
            score = np.asarray(self.units[near] @ own, np.float32)
            starts_rows(score, self.first, self.turns, self.turn, self.places[near], pose)
            return pose
        spread = np.square(seen).reshape(self.rank, -1).sum(axis=0)
        near = np.argpartition(-spread, PLACES)[:PLACES]
        score = np.negative(self.units[near] @ own)
        for i, (first, turns) in enumerate(zip(self.first, self.turns, strict=True)):
            part = score[:, first : first + turns]
            best = np.argpartition(part, STARTS - 1, axis=None)[:STARTS]
            where, turn = np.divmod(best, turns)
            rows = slice(STARTS * i, STARTS * (i + 1))
            pose[rows, :2], pose[rows, 2] = self.places[near[where]], turn * self.turn[i]
        return pose

    def _best(self, found: Descents, level: Array, weighed: Weighed) -> Matches:
        """The best descent of every head, of `STARTS` each, for every press."""
        count = len(level)
        which = found.cost.reshape(-1, STARTS).argmin(axis=1)
        rows = STARTS * np.arange(len(which)) + which
        scale = found.scale[rows]
        cov = np.linalg.inv(found.normal[rows]) / scale[:, :, None] / scale[:, None]
        cost, pose, cov, plain = (
            one.reshape(count, -1, *one.shape[1:])
            for one in (found.cost[rows], found.pose[rows], cov, found.plain[rows])
        )
        slopes, fitted = plain[:, :, 1:], plain[:, :, 0]
        return Matches(cost, pose, cov, slopes, fitted, level, _misfits(cost, plain, weighed))


def joined(parts: list[Matches]) -> Matches:
    """Matches of presses, one after the other."""
    return Matches(
        *(np.concatenate([getattr(part, one.name) for part in parts]) for one in fields(Matches))
    )


def _misfits(cost: Array, plain: Array, weighed: Weighed) -> Array:
    """Misfit of the likeliest head's shape (n,), from patterns and slopes (n, heads, 5, d)."""
    each = np.arange(len(cost))
    best = plain[each, cost.argmin(axis=1)]
    rows = np.concatenate([best, plain[:, :, 0] - best[:, :1]], axis=1)
    rows = weighed.cleared(each, rows * weighed.weight[:, None])
    return shape_misfits(weighed.wanted - rows[:, 0], rows[:, 1:5], rows[:, 5:])


def _leading(gram: Array, rank: int) -> Array:
    """Bases (n, d, rank) of what matrices (n, d, d) enlarge most, closely enough for a search."""
    d = gram.shape[1]
    rows = gram + APART * np.trace(gram, axis1=1, axis2=2)[:, None, None] * np.eye(d)
    start = np.random.default_rng(0).normal(size=(d, rank))
    span = orthonormal(np.matmul(rows, start))
    for _ in range(TURNS):
        span = orthonormal(np.matmul(rows, span))
    return span
