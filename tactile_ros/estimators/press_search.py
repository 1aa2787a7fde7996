"""Which head pressed, where, how turned and how deep: templates first, then least squares.

A press is compared with templates of unit length, after what a uniform field could have added is
taken out of both. The likeliest places are found by what all heads have in common there; then
the best nodes of each head are refined, and misfits decide.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.estimators.few_shot import SHAPE_RANK, USUAL_SPREAD, Supports, orthonormal
from tactile_ros.estimators.press_templates import cleared_rows, descend_rows, solved_rows
from tactile_ros.physics.compiled import available, compiled

if TYPE_CHECKING:
    import numpy.typing as npt

    from tactile_ros.estimators.few_shot import PressVectors
    from tactile_ros.estimators.press_templates import PressBank
    from tactile_ros.types import Array, Bools, Integers

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


@dataclass(frozen=True)
class Weighed:
    """Presses (n), over the deviations of their readings.

    Attributes
    ----------
    weight, wanted : ndarray, shape (n, d)
        One over deviations, and weighted patterns less what a uniform field could have added.
    span : ndarray, shape (n, d, 3)
        Orthonormal weighted patterns of such a field.
    powers : ndarray, shape (n, 3)
        As in `PressVectors`.
    """

    weight: Array
    wanted: Array
    span: Array
    powers: Array

    def cleared(self, press: Integers, rows: Array) -> Array:
        """Rows (s, r, d) of some presses, less what a uniform field could have added."""
        span = self.span[press]
        return np.asarray(rows - np.matmul(np.matmul(rows, span), np.swapaxes(span, 1, 2)))


@dataclass
class Descents:
    """Where s descents are.

    Attributes
    ----------
    pose : ndarray, shape (s, 4)
        Place (m), turn (rad) and depth (m).
    cost : ndarray, shape (s,)
        Squared misfit over its variance.
    normal, scale : ndarray, shape (s, 4, 4) and (s, 4)
        Matrix of the steps in units in which its diagonal is about 1; what they are.
    plain : ndarray, shape (s, 5, d)
        Pattern (T), and its slopes with the pose.
    """

    pose: Array
    cost: Array
    normal: Array
    scale: Array
    plain: Array


def limits(shallowest: float, deepest: float) -> Array:
    """Of steps of a descent, and of depths (m)."""
    return np.array([*LONGEST, *RATIO, shallowest, deepest])


def weigh(pattern: Array, variance: Array, common: Array, powers: Array) -> Weighed:
    """Presses with patterns and variances (n, d); `common` (d, 3) is what a uniform field does."""
    weight = 1 / np.sqrt(variance)
    # what a uniform field could have added is taken out of weighted patterns
    span = orthonormal(weight[:, :, None] * common)
    wanted = pattern * weight
    wanted = wanted - np.einsum('ndk,nk->nd', span, np.einsum('ndk,nd->nk', span, wanted))
    return Weighed(weight, wanted, span, powers)


def descend(
    bank: PressBank, weighed: Weighed, press: Integers, head: Integers, pose: Array, limit: Array
) -> Descents:
    """Descend from some poses.

    Parameters
    ----------
    bank : PressBank
        Templates.
    weighed : Weighed
        Presses (n).
    press, head : ndarray, shape (s,)
        Press and head of each descent; presses in rising order.
    pose : ndarray, shape (s, 4)
        Where it begins; the depth is one that is usual.
    limit : ndarray, shape (7,)
        Of `limits`.
    """
    found, step, promised = _begun(bank, weighed, press, head, pose, limit)
    active = np.ones(len(press), bool)
    for _ in range(ROUNDS):
        active &= _worth(found.cost, promised, press, head)
        if not active.any():
            break
        rows = np.flatnonzero(active)
        tried = moved(found.pose[rows], step[rows], limit)
        parts = np.asarray(bank.at(head[rows], tried[:, :3]), np.float64)
        new, new_step, more = _misfit(weighed, press[rows], tried, parts)
        better = new.cost < found.cost[rows]
        step[rows[~better]] *= SHRUNK
        promised[rows[~better]] *= SHRUNK
        taken = rows[better]
        step[taken], promised[taken] = new_step[better], more[better]
        for name in ('pose', 'cost', 'normal', 'scale', 'plain'):
            getattr(found, name)[taken] = getattr(new, name)[better]
    _finish(found, step, promised, limit)
    return found


def moved(pose: Array, step: Array, limit: Array) -> Array:
    """Poses (s, 4) after steps, each no longer than a template reaches."""
    tried = pose + np.clip(step, [*-limit[:3], 0.0], [*limit[:3], 0.0])
    ratio = np.clip(1 + step[:, 3] / pose[:, 3], limit[3], limit[4])
    tried[:, 3] = np.clip(pose[:, 3] * ratio, limit[5], limit[6])
    return np.asarray(tried)


def _begun(
    bank: PressBank, weighed: Weighed, press: Integers, head: Integers, pose: Array, limit: Array
) -> tuple[Descents, Array, Array]:
    """Descents at their beginning, at depths that fit; their steps and what these promise."""
    parts = np.asarray(bank.at(head, pose[:, :3]), np.float64)
    a, p = pose[:, 3:], weighed.powers[press]
    row = np.matmul((p * np.concatenate([a, a**2, a**3], axis=1))[:, None], parts[:, 0])
    row = weighed.cleared(press, row * weighed.weight[press][:, None])[:, 0]
    share = np.einsum('nd,nd->n', row, weighed.wanted[press]) / np.einsum('nd,nd->n', row, row)
    depth = np.clip(a[:, 0] * np.maximum(share, FAINTEST), limit[5], limit[6])
    return _misfit(weighed, press, np.column_stack([pose[:, :3], depth]), parts)


def _worth(cost: Array, promised: Array, press: Integers, head: Integers) -> Bools:
    """Which descents may still change what is said."""
    best = np.full((press.max() + 1, head.max() + 1), np.inf)
    np.minimum.at(best, (press, head), cost)
    behind = cost - best.min(axis=1)[press]
    lively = promised > np.maximum(CLOSE, BEHIND * behind)
    return np.asarray(lively & (cost - 2 * promised <= best[press, head]))


def _misfit(
    weighed: Weighed, press: Integers, pose: Array, parts: Array
) -> tuple[Descents, Array, Array]:
    """Descents at poses with templates (s, 4, 3, d), their steps and what these promise."""
    a, p = pose[:, 3:], weighed.powers[press]
    raised = p * np.concatenate([a, a**2, a**3], axis=1)
    slope = p * np.concatenate([np.ones_like(a), 2 * a, 3 * a**2], axis=1)
    values = np.matmul(raised[:, None, None], parts)[:, :, 0]
    plain = np.concatenate([values, np.matmul(slope[:, None], parts[:, 0])], axis=1)
    rows = weighed.cleared(press, plain * weighed.weight[press][:, None])
    miss, j = weighed.wanted[press] - rows[:, 0], rows[:, 1:]
    normal = np.matmul(j, np.swapaxes(j, 1, 2))
    scale = np.sqrt(np.einsum('nii->ni', normal)) + 1e-30
    normal = normal / scale[:, :, None] / scale[:, None] + DAMPING * np.eye(4)
    right = np.matmul(j, miss[..., None]) / scale[..., None]
    step = np.linalg.solve(normal, right)
    promised = (right * step).sum(axis=(1, 2))
    found = Descents(pose, np.einsum('nd,nd->n', miss, miss), normal, scale, plain)
    return found, step[..., 0] / scale, promised


def _finish(found: Descents, step: Array, promised: Array, limit: Array) -> None:
    """Last steps, so short that a straight line tells what they do, clipped or whole."""
    rows = np.flatnonzero(promised <= CLOSE)
    tried = moved(found.pose[rows], step[rows], limit)
    change = tried - found.pose[rows]
    found.plain[rows, 0] += np.einsum('si,sid->sd', change, found.plain[rows, 1:])
    gain = _kept(found.normal[rows], found.scale[rows], step[rows], change, promised[rows])
    found.pose[rows], found.cost[rows] = tried, found.cost[rows] - gain


def _kept(normal: Array, scale: Array, step: Array, change: Array, promised: Array) -> Array:
    """What changes (s, 4) of a pose keep of what whole steps promise.

    Along a parabola whose top is the whole step, for each direction: 2 u N w - u N u.
    """
    whole, part = step * scale, change * scale
    pull = np.matmul(normal, whole[..., None])[..., 0]
    back = np.matmul(normal, part[..., None])[..., 0]
    gain = (part * (2 * pull - back)).sum(axis=1)
    top = (whole * pull).sum(axis=1)
    return np.asarray(promised * gain / np.maximum(top, 1e-300))


SHAPE_MISFIT_DAMPING = 1e-4  # of slopes of unit length
TINY = 1e-30
FEWEST = 1e-3  # degrees of freedom


def shape_misfits(miss: Array, slopes: Array, away: Array) -> Array:
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

    Returns
    -------
    ndarray, shape (n,)
        About 1 where it is that head; 1 where there is no other.

    Notes
    -----
    Weights of a mixture have a deviation of 1 about 0: 1 is the whole way to another head.
    """
    if away.shape[1] == 1:
        return np.ones(len(miss))
    if available():
        found = np.empty(len(miss))
        shape_rows(miss, slopes, away, found)
        return found
    free = slopes / (np.linalg.norm(slopes, axis=2, keepdims=True) + TINY)
    rows = np.concatenate([free, away], axis=1)
    own = np.repeat([SHAPE_MISFIT_DAMPING, 1.0], [slopes.shape[1], away.shape[1]])
    low = np.linalg.cholesky(np.matmul(rows, np.swapaxes(rows, 1, 2)) + np.diag(own))
    # what slopes explain comes first and does not count
    back = np.linalg.inv(low)[:, slopes.shape[1] :]
    gain = np.square(np.matmul(back, np.matmul(rows, miss[..., None]))).sum(axis=(1, 2))
    freedom = away.shape[1] - np.square(back[:, :, slopes.shape[1] :]).sum(axis=(1, 2))
    return np.asarray(gain / np.maximum(freedom, FEWEST))


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
    """The same press by press; `found` (n,) is filled."""
    free, heads = slopes.shape[1], away.shape[1]
    rows, low = np.empty((free + heads, miss.shape[1])), np.empty((free + heads, free + heads + 1))
    own, unit = np.ones(free + heads), np.empty(free + heads)
    own[:free] = SHAPE_MISFIT_DAMPING
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
    rounds: int, pattern: Array, powers: Array, noise: Array, error: float, common: Array,
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
        flat, grid, about, head, limit, stop, rounds, weight, span, wanted[0], powers, start,
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


FREER = 5.0  # times the usual: how far the origin of an unknown shape may be aside


def plain_supports(presses: PressVectors, labels: Integers, number: Integers) -> Supports:
    """Supports (n), windows of presses by number, of which no model tells anything."""
    n, d = presses.pattern.shape
    return Supports(
        labels, presses.pattern, presses.powers, presses.frames, np.ones(n), np.zeros((n, 3, d)),
        np.zeros((n, 2, d)), np.full((n, d), np.nan), np.zeros((n, SHAPE_RANK, d)), number,
    )  # fmt: skip


def modelled_supports(
    presses: PressVectors, labels: Integers, number: Integers, matches: Matches, bank: PressBank,
    basis: Array,
) -> Supports:  # fmt: skip
    """Supports (n) with what the best template of each tells.

    Parameters
    ----------
    presses : PressVectors
        n presses.
    labels, number : ndarray, shape (n,)
        Their classes, and which press each is a window of.
    matches : Matches
        Of the presses.
    bank : PressBank
        Templates.
    basis : ndarray, shape (d, 3)
        Orthonormal patterns of a uniform field.
    """
    best = np.arange(len(labels)), matches.cost.argmin(axis=1)
    pose, middle = matches.pose[best], matches.fitted[best]
    slopes = matches.slopes[best][:, :3] * USUAL_SPREAD[:, None]
    terms = bank.at(best[1], pose[:, :3])[:, 0, 1:]
    grown = pose[:, 3, None] ** np.arange(1, 4)
    factors = [
        _shape_factors(bank, presses.pattern[i], pose[i, :2], raised, middle[i], slopes[i], basis)
        for i, raised in enumerate(presses.powers * grown)
    ]
    return Supports(
        labels, presses.pattern, presses.powers, presses.frames, np.ones(len(labels)), slopes,
        terms * grown[:, 1:, None], middle,
        np.array(factors).reshape(-1, SHAPE_RANK, middle.shape[1]),
        number,
    )  # fmt: skip


def _shape_factors(
    bank: PressBank, pattern: Array, place: Array, raised: Array, middle: Array, slopes: Array,
    basis: Array,
) -> Array:  # fmt: skip
    """Factors (r, d) of a covariance of what shapes can do at a place, from what heads do."""
    turns = [one.turns for one in bank.heads]
    head = np.repeat(np.arange(len(turns)), turns)
    turn = np.concatenate([np.arange(n) for n in turns])
    step = np.array([one.sector / one.turns for one in bank.heads])
    poses = np.column_stack([np.tile(place, (len(turn), 1)), turn * step[head]])
    other = np.einsum('p,npd->nd', raised, bank.at(head, poses)[:, 0])
    own = other - (other @ basis) @ basis.T
    size = (own @ pattern) / np.square(own).sum(axis=1)
    away = (size[:, None] * other - middle) / np.sqrt(len(other))
    rows, sizes, _ = np.linalg.svd(np.concatenate([away, FREER * slopes]).T, full_matrices=False)
    found = np.zeros((SHAPE_RANK, len(middle)))
    count = min(SHAPE_RANK, len(sizes))
    found[:count] = (rows * sizes).T[:count]
    return found


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
        if available():
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
        if available():
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
