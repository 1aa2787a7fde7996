# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Which head pressed, where, how turned and how deep: templates first, then least squares.

A press is compared with templates of unit length, after what a uniform field could have added is
taken out of both. The likeliest places are found by what all heads have in common there; then
the best nodes of each head are refined, and misfits decide.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.estimators.few_shot import Rows, share_of, without_field
from tactile_ros.estimators.press_templates import DAMPING, TINY, descend_rows

if TYPE_CHECKING:
    from tactile_ros.estimators.few_shot import Presses
    from tactile_ros.estimators.press_templates import PressBank
    from tactile_ros.types import Array

LONGEST = np.array([2e-3, 2e-3, 0.35])  # m, m, rad: steps
RATIO = (0.4, 2.5)  # of depths from step to step
USUAL = 0.12  # of the body: depth of the templates that are searched
RANK = 6  # patterns that heads have in common at a place
PLACES = 20  # looked at closely
STARTS = 2  # of each head
DEEPEST, SHALLOWEST = 0.5, 0.005  # of the body
TURNS, APART = 8, 1e-6  # of a search for patterns; of its matrices, added to their diagonal


@dataclass(frozen=True)
class Matches(Rows):
    """The best press of every head, for each of n presses."""

    cost: Array  # (n, heads) squared misfit over its variance
    pose: Array  # (n, heads, 4) place (m), turn (rad) and depth (m)
    cov: Array  # (n, heads, 4, 4) of the pose, as noise and error of the model have it
    slopes: Array  # (n, heads, 4, d) change of the pattern with the pose
    fitted: Array  # (n, heads, d) pattern of the best press
    level: Array  # (n,) logarithm of the variance of the pattern

    def or_better(self, other: Matches) -> Matches:
        """Matches of each press on this or on another skin, whichever fit better."""
        better = other.cost.min(axis=1) < self.cost.min(axis=1)
        count = len(better)
        return self.joined(other).rows(np.arange(count) + count * better)


class PressSearch:
    """Search among the templates of a bank.

    Parameters
    ----------
    bank : PressBank
        Templates.
    noise, common : ndarray, shape (d,) and (d, 3)
        Of a reading (T); what a uniform field does to readings.
    body, error, still : float
        Height of the soft body (m); error of the model, as a share of what a chip sees; error of
        a pattern that frames do not average (T).
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
        self.limit = np.array([*LONGEST, *RATIO, SHALLOWEST * body, DEEPEST * body])
        nodes = bank.at_nodes()
        usual = USUAL * body
        found = nodes[..., 0, :] + usual * nodes[..., 1, :] + usual**2 * nodes[..., 2, :]
        found = without_field(found, self.basis.astype(np.float32))
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
        self.heads = np.repeat(np.arange(len(bank.heads)), STARTS)

    def variance(self, presses: Presses) -> Array:
        """Variance of patterns (n, d): noise, and error of the model where chips see much."""
        return presses.variance(self.noise, self.still) + share_of(presses.pattern, self.error)

    def find(self, presses: Presses) -> Matches:
        """The best press of every head."""
        bank, (n, d), heads = self.bank, presses.pattern.shape, len(self.bank.heads)
        variance = self.variance(presses)
        weight = 1 / np.sqrt(variance)
        span = np.swapaxes(np.linalg.qr(weight[..., None] * self.common)[0], 1, 2)
        span = np.ascontiguousarray(span)
        wanted = presses.pattern * weight
        wanted -= np.einsum('ni,nki,nkd->nd', wanted, span, span)
        pose, cost = np.empty((n, heads, 4)), np.empty((n, heads))
        normal, plain = np.empty((n, heads, 4, 4)), np.empty((n, heads, 5, d))
        starts = STARTS * heads
        all_cost, all_normal = np.empty(starts), np.empty((starts, 4, 4))
        all_plain = np.empty((starts, 5, d))
        # one by one, so that a press has the same starts alone and among others
        for i, own in enumerate(presses.pattern @ self.cleared):
            start = self._starts(own)
            descend_rows(
                bank.flat, bank.grid, bank.about, self.heads, self.limit, weight[i], span[i],
                wanted[i], start, all_cost, all_normal, all_plain,
            )  # fmt: skip
            best = all_cost.reshape(-1, STARTS).argmin(axis=1) + STARTS * np.arange(heads)
            pose[i], cost[i] = start[best], all_cost[best]
            normal[i], plain[i] = all_normal[best], all_plain[best]
        unit = np.sqrt(np.diagonal(normal, axis1=2, axis2=3)) + TINY
        size = unit[..., None] * unit[..., None, :]
        cov = np.linalg.inv(normal / size + DAMPING * np.eye(4)) / size
        found = Matches(
            cost, pose, cov, plain[:, :, 1:], plain[:, :, 0], np.log(variance).sum(axis=1)
        )
        return found if self.other is None else found.or_better(self.other.find(presses))

    def _starts(self, own: Array) -> Array:
        """Poses (s, 4) at which descents of one press (d,) start, head by head."""
        own = (own / (np.sqrt(own @ own) + TINY)).astype(np.float32)
        seen = np.square(self.spans @ own).reshape(self.rank, -1).sum(axis=0)
        near = np.argsort(-seen)[:PLACES]
        score = -(self.units[near] @ own)
        pose = np.full((len(self.first), STARTS, 4), USUAL * self.body)
        for i, head in enumerate(self.bank.heads):
            part = score[:, head.first : head.first + head.turns]
            # of unlike turns: two that are neighbours often lead to one minimum
            turn = np.resize(np.argsort(part.min(axis=0))[:STARTS], STARTS)
            pose[i, :, :2] = self.places[near[part.argmin(axis=0)[turn]]]
            pose[i, :, 2] = turn * head.sector / head.turns
        return pose.reshape(-1, 4)


def _leading(gram: Array, rank: int) -> Array:
    """Bases (n, d, rank) of what matrices (n, d, d) enlarge most, closely enough for a search."""
    d = gram.shape[1]
    rows = gram + APART * np.trace(gram, axis1=1, axis2=2)[:, None, None] * np.eye(d)
    span = np.random.default_rng(0).normal(size=(d, rank))
    for _ in range(TURNS):
        span = np.linalg.qr(np.matmul(rows, span))[0]
    return np.asarray(span)
