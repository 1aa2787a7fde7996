"""Presses that were seen, as classes: distances that discount what may differ.

Two presses of one head at about one place differ by depth, a little by place and turn, and by
any uniform field. What these do to the pattern is known, from a model, as slopes; a distance in
which movements along slopes cost little leaves what the shape does.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from tactile_ros.estimators.press_window import PressVectors
    from tactile_ros.types import Array, Integers

PLACE, TURN, BEND = 0.2e-3, 0.02, 0.2  # how far presses of one kind differ: m, rad, share
DEEPER = (0.1, 10.0)  # depth of a press over that of a support
ROUNDS = 3
REPEATS = 0.008  # error of a repeated press, as a share of what a chip sees
CLOSEST = 24  # supports that are compared in full
ALIKE = 0.97  # cosine of presses that are averaged


@dataclass(frozen=True)
class Supports:
    """Presses (m) that classes are known by.

    Attributes
    ----------
    label : ndarray, shape (m,)
        Class of each.
    pattern : ndarray, shape (m, d)
        Of `PressVectors` (T).
    frames : ndarray, shape (m,)
        Of `PressVectors`.
    presses : ndarray, shape (m,)
        How many presses each is the mean of.
    slopes : ndarray, shape (m, 4, d)
        What a usual difference of place and turn does, and what grows with the square of the
        depth (T); 0 where unknown.
    """

    label: Integers
    pattern: Array
    frames: Array
    presses: Array
    slopes: Array

    @classmethod
    def empty(cls, d: int) -> Supports:
        """None yet, of patterns of length d."""
        none = np.zeros(0)
        return cls(np.zeros(0, np.int64), np.zeros((0, d)), none, none, np.zeros((0, 4, d)))

    def where(self, rows: npt.NDArray[np.intp]) -> Supports:
        """Some of them."""
        return Supports(
            self.label[rows],
            self.pattern[rows],
            self.frames[rows],
            self.presses[rows],
            self.slopes[rows],
        )

    def without(self, label: int) -> Supports:
        """All but those of a class; classes above it move down by one."""
        left = self.where(np.flatnonzero(self.label != label))
        lower = left.label - (left.label > label)
        return Supports(lower, left.pattern, left.frames, left.presses, left.slopes)

    def joined(self, other: Supports) -> Supports:
        """These and others."""
        return Supports(
            *(
                np.concatenate([getattr(self, name), getattr(other, name)])
                for name in ('label', 'pattern', 'frames', 'presses', 'slopes')
            )
        )


def usual_slopes(pose_slopes: Array, pose: Array, fitted: Array) -> Array:
    """What usual differences do, from slopes (n, 4, d) at poses (n, 4) with patterns (n, d)."""
    found = pose_slopes * np.array([PLACE, PLACE, TURN, 1.0])[:, None]
    # what grows with the square of the depth
    found[:, 3] = pose_slopes[:, 3] * pose[:, 3:] - fitted
    return np.asarray(np.nan_to_num(found))


def averaged(supports: Supports) -> Supports:
    """Means of presses of one class that are alike, beside the presses themselves."""
    found = supports
    for label in np.unique(supports.label):
        rows = np.flatnonzero(supports.label == label)
        size = np.linalg.norm(supports.pattern[rows], axis=1)
        unit = supports.pattern[rows] / size[:, None]
        alike = unit @ unit[size.argmax()] > ALIKE
        if alike.sum() < 2:
            continue
        rows, size = rows[alike], size[alike]
        weight = size**2 * supports.frames[rows]
        weight = weight / weight.sum()
        scale = (weight / size * size.max())[:, None]
        found = found.joined(
            Supports(
                np.array([label]),
                (scale * supports.pattern[rows]).sum(axis=0)[None],
                np.array([supports.frames[rows].sum()]),
                np.array([float(len(rows))]),
                (scale[:, :, None] * supports.slopes[rows]).sum(axis=0)[None],
            )
        )
    return found


def support_scores(
    supports: Supports,
    presses: PressVectors,
    noise: Array,
    common: Array,
    still: float,
    repeats: float = REPEATS,
) -> Array:
    """Twice the negative log-likelihood of every press under every support.

    Parameters
    ----------
    supports : Supports
        m of them.
    presses : PressVectors
        n presses.
    noise : ndarray, shape (d,)
        Of a reading (T).
    common : ndarray, shape (d, 3)
        What a uniform field does.
    still : float
        Error of a pattern that frames do not average (T).
    repeats : float
        Error of a repeated press, as a share of what a chip sees.

    Returns
    -------
    ndarray, shape (n, m)
        Infinite for supports that are far away.
    """
    n, m = len(presses.pattern), len(supports.label)
    found = np.full((n, m), np.inf)
    basis = np.linalg.qr(common)[0]
    plain = supports.pattern - (supports.pattern @ basis) @ basis.T
    plain = plain / (np.linalg.norm(plain, axis=1, keepdims=True) + 1e-30)
    quiet = presses.variance(noise, still)
    for i in range(n):
        y = presses.pattern[i]
        own = y - basis @ (basis.T @ y)
        near = np.argsort(-(plain @ own), kind='stable')[:CLOSEST]
        near = near[plain[near] @ own > 0]
        if len(near):
            variance = quiet[i] + share_of(y, repeats)
            some = supports.where(near)
            theirs = noise**2 / some.frames[:, None] + still**2 / some.presses[:, None]
            found[i, near] = _scores(some, y, variance, theirs, common)
    return found


def share_of(pattern: Array, share: float) -> Array:
    """Variance (d,) of an error that is a share of what a chip sees."""
    here = np.square(pattern.reshape(-1, 3)).mean(axis=1)
    return np.repeat(share**2 * (here + 0.05 * here.max()), 3)


def _grown(supports: Supports, y: Array, common: Array) -> tuple[Array, Array]:
    """Depth of a press over that of supports (m,), and their patterns (m, d) there, over it."""
    basis = np.linalg.qr(common)[0]
    free = np.stack([supports.pattern, supports.slopes[:, 3]])
    free = free - (free @ basis) @ basis.T
    size = (free[0] @ y) / np.square(free[0]).sum(axis=1)
    for _ in range(ROUNDS):
        size = np.clip(size, *DEEPER)
        grown = free[0] + (size - 1)[:, None] * free[1]
        size = (grown @ y) / np.maximum(np.square(grown).sum(axis=1), 1e-30)
    size = np.clip(size, *DEEPER)
    return size, supports.pattern + (size - 1)[:, None] * supports.slopes[:, 3]


def _scores(supports: Supports, y: Array, variance: Array, theirs: Array, common: Array) -> Array:
    """Scores (m,) of one press (d,) with the variance of its readings."""
    size, pattern = _grown(supports, y, common)
    total = variance + np.square(size[:, None]) * theirs
    weight = 1 / np.sqrt(total)
    span = np.linalg.svd(weight[:, :, None] * common, full_matrices=False)[0]
    rows = np.concatenate([pattern[:, None], supports.slopes], axis=1)
    rows = size[:, None, None] * rows * weight[:, None]
    rows[:, 4] *= BEND
    rows = rows - np.matmul(np.matmul(rows, span), np.swapaxes(span, 1, 2))
    wanted = y * weight
    wanted = wanted - np.matmul(span, np.matmul(wanted[:, None], span).swapaxes(1, 2))[..., 0]
    # depth is free within a factor; slopes have their usual size
    prior = np.diag([4.0, 1.0, 1.0, 1.0, 1.0])
    normal = np.matmul(rows, np.swapaxes(rows, 1, 2)) + prior
    right = np.matmul(rows, wanted[..., None])[..., 0]
    right[:, 0] += prior[0, 0]
    best = np.linalg.solve(normal, right[..., None])[..., 0]
    miss = wanted - np.einsum('mk,mkd->md', best, rows)
    cost = np.square(miss).sum(axis=1) + np.square(best[:, 1:]).sum(axis=1)
    level = -2 * np.log(weight).sum(axis=1) + np.linalg.slogdet(normal[:, 1:, 1:])[1]
    return np.asarray(cost + level)
