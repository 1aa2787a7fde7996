"""Which head pressed, where, how turned and how deep: templates first, then least squares.

A press is compared with templates of unit length, after what a uniform field could have added is
taken out of both. The likeliest places are found by what all heads have in common there; then
the best nodes of each head are refined, and misfits decide.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from tactile_ros.estimators.press_bank import PressBank
    from tactile_ros.estimators.press_window import PressVectors
    from tactile_ros.types import Array, Integers

USUAL = 0.12  # of the body: depth of the templates that are searched
RANK = 6  # patterns that heads have in common at a place
PLACES = 10  # looked at closely
STARTS = 2  # of each head
ROUNDS = 4
KEPT = 2.0  # starts for each head after the first round, all together no more than this share
DEEPEST, SHALLOWEST = 0.5, 0.005  # of the body
TOGETHER = 64  # presses


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
    """

    cost: Array
    pose: Array
    cov: Array
    slopes: Array
    fitted: Array


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
    """

    def __init__(
        self,
        bank: PressBank,
        noise: Array,
        common: Array,
        body: float,
        error: float,
        still: float = 0.0,
    ) -> None:
        self.still = still
        self.bank, self.noise, self.body, self.error = bank, noise, body, error
        self.common = common
        self.basis = np.linalg.qr(common)[0]
        nodes = bank.at_nodes()
        usual = USUAL * body
        found = nodes[..., 0, :] + usual * nodes[..., 1, :] + usual**2 * nodes[..., 2, :]
        found -= (found @ self.basis.astype(np.float32)) @ self.basis.T.astype(np.float32)
        found /= np.linalg.norm(found, axis=-1, keepdims=True) + np.float32(1e-30)
        turns, nx, ny, d = found.shape
        self.units = np.ascontiguousarray(np.moveaxis(found, 0, 2).reshape(nx * ny, turns, d))
        gram = np.matmul(np.swapaxes(self.units, 1, 2), self.units)
        rank = min(RANK, turns, d)
        spans = np.linalg.eigh(gram)[1][:, :, -rank:]
        self.spans = np.ascontiguousarray(np.swapaxes(spans, 1, 2)).reshape(-1, d)
        self.rank = rank
        x, y = bank.nodes
        self.places = np.stack(np.meshgrid(x, y, indexing='ij'), axis=-1).reshape(-1, 2)
        self.rows = [(head.first, head.first + head.turns) for head in bank.heads]

    def find(self, presses: PressVectors) -> Matches:
        """The best press of every head."""
        count = len(presses.pattern)
        parts = [
            self._find(presses.rows(np.arange(i, min(i + TOGETHER, count))))
            for i in range(0, count, TOGETHER)
        ]
        names = ('cost', 'pose', 'cov', 'slopes', 'fitted')
        return Matches(*(np.concatenate([getattr(p, name) for p in parts]) for name in names))

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
        press, head, pose = self._starts(presses)
        weight = 1 / np.sqrt(self.variance(presses))
        # what a uniform field could have added is taken out of weighted patterns
        shared = weight[:, :, None] * self.common
        span = np.linalg.svd(shared, full_matrices=False)[0]
        wanted = presses.pattern * weight
        wanted = wanted - np.einsum('ndk,nk->nd', span, np.einsum('ndk,nd->nk', span, wanted))
        data = (weight, span, wanted, presses.powers)
        depth = np.full((len(pose), 1), USUAL * self.body)
        pose = np.concatenate([pose, depth], axis=1)
        cost, step, _, _, _ = self._misfit(press, head, pose, data, first=True)
        for i in range(ROUNDS):
            tried = self._moved(pose, step)
            new, new_step, _, _, _ = self._misfit(press, head, tried, data)
            better = new < cost
            pose = np.where(better[:, None], tried, pose)
            step = np.where(better[:, None], new_step, 0.3 * step)
            cost = np.minimum(cost, new)
            if i == 0:
                keep = self._promising(press, cost)
                press, head, cost = press[keep], head[keep], cost[keep]
                pose, step = pose[keep], step[keep]
        return self._best(press, head, pose, data, len(wanted))

    def _promising(self, press: Integers, cost: Array) -> Integers:
        """The better part of the starts of every press."""
        order = np.lexsort([cost, press])
        rank = np.arange(len(press)) - np.searchsorted(press[order], press[order])
        most = max(6, int(KEPT * len(self.rows) / 2) + 2)
        return np.sort(order[rank < most])

    def _moved(self, pose: Array, step: Array) -> Array:
        """Poses after steps, each no longer than a template reaches."""
        limit = np.array([2e-3, 2e-3, 0.35, np.inf])
        moved = pose + np.clip(step, -limit, limit)
        ratio = np.clip(1 + step[:, 3] / pose[:, 3], 0.4, 2.5)
        moved[:, 3] = np.clip(pose[:, 3] * ratio, SHALLOWEST * self.body, DEEPEST * self.body)
        return np.asarray(moved)

    def _misfit(
        self, press: Integers, head: Integers, pose: Array, data: tuple[Array, ...],
        first: bool = False,
    ) -> tuple[Array, Array, Array, Array, Array]:  # fmt: skip
        """Cost, Newton step, normal matrix, slopes and pattern of each start."""
        weight, span, wanted, powers = data
        parts = self.bank.at(head, pose[:, :3])
        a = pose[:, 3:]
        p = powers[press]
        if first:
            a = self._first_depth(parts, press, data, a)
            pose[:, 3:] = a
        raised = p * np.concatenate([a, a**2, a**3], axis=1)
        slope = p * np.concatenate([np.ones_like(a), 2 * a, 3 * a**2], axis=1)
        values = np.matmul(raised[:, None, None], parts)[:, :, 0]
        by_depth = np.matmul(slope[:, None], parts[:, 0])
        slopes = np.concatenate([values[:, 1:], by_depth], axis=1)
        rows = np.concatenate([values[:, :1], slopes], axis=1) * weight[press][:, None]
        rows = rows - np.matmul(np.matmul(rows, span[press]), np.swapaxes(span[press], 1, 2))
        miss = wanted[press] - rows[:, 0]
        j = rows[:, 1:]
        normal = np.matmul(j, np.swapaxes(j, 1, 2))
        scale = np.sqrt(np.einsum('nii->ni', normal)) + 1e-30
        normal = normal / scale[:, :, None] / scale[:, None] + 1e-4 * np.eye(4)
        gradient = np.matmul(j, miss[..., None]) / scale[..., None]
        step = np.linalg.solve(normal, gradient)[..., 0] / scale
        return np.einsum('nd,nd->n', miss, miss), step, normal, slopes, values[:, 0]

    def _first_depth(
        self, parts: Array, press: Integers, data: tuple[Array, ...], usual: Array
    ) -> Array:
        """Depth (n, 1) at which a template is as strong as the press."""
        weight, span, wanted, powers = data
        p = powers[press] * np.concatenate([usual, usual**2, usual**3], axis=1)
        row = np.matmul(p[:, None], parts[:, 0])[:, 0] * weight[press]
        row = row - np.einsum('ndk,nk->nd', span[press], np.einsum('ndk,nd->nk', span[press], row))
        share = np.einsum('nd,nd->n', row, wanted[press]) / np.einsum('nd,nd->n', row, row)
        low, high = SHALLOWEST * self.body, DEEPEST * self.body
        return np.asarray(np.clip(usual * np.clip(share, 0.02, None)[:, None], low, high))

    def _starts(self, presses: PressVectors) -> tuple[Integers, Integers, Array]:
        """Press, head and pose of each start."""
        own = presses.pattern - (presses.pattern @ self.basis) @ self.basis.T
        own = (own / (np.linalg.norm(own, axis=1, keepdims=True) + 1e-30)).astype(np.float32)
        spread = np.square(self.spans @ own.T).reshape(-1, self.rank, len(own)).sum(axis=1)
        places = np.argpartition(-spread, PLACES, axis=0)[:PLACES].T  # n, places
        score = np.matmul(self.units[places], own[:, None, :, None])[..., 0]  # n, places, turns
        press, head, pose = [], [], []
        for label, (low, high) in enumerate(self.rows):
            part = score[:, :, low:high].reshape(len(own), -1)
            count = min(STARTS, part.shape[1])
            best = np.argpartition(-part, count - 1, axis=1)[:, :count]
            where, turn = np.divmod(best, high - low)
            about = self.bank.heads[label]
            at = self.places[np.take_along_axis(places, where, axis=1)]
            yaw = turn * about.sector / about.turns
            press.append(np.repeat(np.arange(len(own)), count))
            head.append(np.full(best.size, label))
            pose.append(np.concatenate([at, yaw[..., None]], axis=2).reshape(-1, 3))
        return np.concatenate(press), np.concatenate(head), np.concatenate(pose)

    def _best(
        self, press: Integers, head: Integers, pose: Array, data: tuple[Array, ...], count: int
    ) -> Matches:
        """The best start of every head for every press."""
        cost, _, normal, slopes, fitted = self._misfit(press, head, pose, data)
        heads, d = len(self.rows), fitted.shape[1]
        found = Matches(
            np.full((count, heads), np.inf), np.full((count, heads, 4), np.nan),
            np.full((count, heads, 4, 4), np.nan), np.zeros((count, heads, 4, d)),
            np.zeros((count, heads, d)),
        )  # fmt: skip
        order = np.argsort(-cost, kind='stable')  # the best is written last
        at = press[order], head[order]
        j = slopes * data[0][press][:, None]
        j = j - np.matmul(np.matmul(j, data[1][press]), np.swapaxes(data[1][press], 1, 2))
        scale = np.sqrt(np.einsum('nij,nij->ni', j, j)) + 1e-30
        cov = np.linalg.inv(normal) / scale[:, :, None] / scale[:, None]
        for name, value in zip(
            ('cost', 'pose', 'cov', 'slopes', 'fitted'), (cost, pose, cov, slopes, fitted),
            strict=True,
        ):  # fmt: skip
            getattr(found, name)[at] = value[order]
        return found
