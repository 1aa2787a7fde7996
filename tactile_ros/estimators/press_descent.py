"""Least squares in place, turn and depth of heads that may have pressed.

Descents begin at templates. A step is taken while it promises to matter: more than nothing for the
likeliest head, a share of how far they are behind for others.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.estimators.few_shot import orthonormal

if TYPE_CHECKING:
    from tactile_ros.estimators.press_bank import PressBank
    from tactile_ros.types import Array, Bools, Integers

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
