"""Presses that were seen, as classes: distances that discount what may differ.

Two presses of one head at about one place differ by depth, a little by place and turn, and by
any uniform field. What these do to the pattern is known, from a model: the terms that grow with
the square and the cube of the depth, and the slopes with place and turn. A distance in which
movements along them cost little leaves what the shape does.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from tactile_ros.types import Array

if TYPE_CHECKING:
    from tactile_ros.types import Array, Integers

QUIET, QUIETS = 0.15, 0.1891  # this part of readings is nearer to 0 than so many deviations
LATE = 0.34  # of a window: frames that tell the pattern first
TINY = np.finfo(np.float64).tiny


@dataclass(frozen=True)
class PressVectors:
    """Presses (n) of one skin.

    Attributes
    ----------
    powers : ndarray, shape (n, 3)
        Of the course, by which powers 1, 2, 3 of the largest depth enter the pattern.
    """

    pattern: Array  # (n, d) change of field at the deepest frame (T), from all frames
    powers: Array
    frames: Array  # (n,) as many frames at full depth have as little noise

    def variance(self, noise: Array, still: float) -> Array:
        """Variance of patterns (n, d) from noise (d,) of frames and errors that do not average.

        Baselines have noise of their own and drift: `still` (T) is the deviation of all that.
        """
        frames = np.maximum(self.frames, TINY)[:, None]
        return np.asarray(np.square(noise) / frames + still**2)

    def still(self, noise: Array) -> float:
        """Deviation that does not average (T), from the quietest readings of presses.

        Readings far from a press show nothing but this and noise (d,); two deviations of a frame
        are the most that it may be.
        """
        quiet = np.quantile(np.abs(self.pattern), QUIET, axis=1) / QUIETS
        usual = np.square(noise).mean() / np.maximum(self.frames, TINY)
        found = np.quantile(np.square(quiet) - usual, QUIET)
        return float(np.sqrt(np.clip(found, 0.0, 4 * np.square(noise).mean())))

    def rows(self, rows: npt.NDArray[np.intp]) -> PressVectors:
        """Some of the presses."""
        return PressVectors(self.pattern[rows], self.powers[rows], self.frames[rows])


def press_vector(window: Array, common: Array) -> tuple[Array, Array, float]:
    """Pattern, powers and count of frames of one press.

    Parameters
    ----------
    window : ndarray, shape (w, d)
        Changes of field in its frames; rows with NaN are left out.
    common : ndarray, shape (d, 3)
        Orthonormal patterns of a uniform field, which tell nothing of the course.

    Returns
    -------
    pattern, powers, frames
        Rows of `PressVectors`; NaN where no frame is whole.
    """
    whole = window[np.isfinite(window).all(axis=1)]
    if not len(whole):
        return np.full(window.shape[1], np.nan), np.full(3, np.nan), 0.0
    count = max(1, int(np.ceil(LATE * len(whole))))
    late = whole[-count:].sum(axis=0) / count
    late -= common @ (late @ common)  # frames are measured along it: no need to clear them too
    course = np.maximum(whole @ late, 0.0)
    course /= max(float(course.max()), TINY)
    if not course.any():
        course[:] = 1.0
    square = course * course
    squared = float(square.sum())
    powers = np.array([1.0, square @ course / squared, square @ square / squared])
    return course @ whole / squared, powers, squared


def press_vectors(windows: list[Array], common: Array) -> PressVectors:
    """Of several presses, each of frames (w, d)."""
    parts = [press_vector(window, common) for window in windows]
    d = len(common)
    return PressVectors(
        np.array([part[0] for part in parts]).reshape(-1, d),
        np.array([part[1] for part in parts]).reshape(-1, 3),
        np.array([part[2] for part in parts]),
    )


USUAL_SPREAD = np.array([0.2e-3, 0.2e-3, 0.02])  # how far presses of one kind differ: m, m, rad
BEND = 0.2  # of what the square and the cube of the depth do, that may be wrong
DEEPER = (0.1, 10.0)  # depth of a press over that of a support
ANY_DEPTH = 2.0  # one over the deviation of that ratio's change in a fit
ROUNDS = 4
REPEATS = 0.008  # error of a repeated press, as a share of what a chip sees
CLOSEST = 24  # supports that are compared in full
SHAPE_RANK = 12  # patterns by which shapes differ at one place
ALIKE = 0.97  # cosine of presses that are averaged


@dataclass(frozen=True)
class SupportSet:
    """Presses (m) that classes are known by.

    Attributes
    ----------
    bends : ndarray, shape (m, 2, d)
        What the square and the cube of the depth do at full depth (T); 0 where unknown.
    middle, factors : ndarray, shape (m, d) and (m, r, d)
        What such a press is like (T) before it is seen: its mean, and factors of a covariance
        of what shapes can do there; NaN and 0 where unknown.
    number : ndarray, shape (m,)
        Of the press that each is a window of: windows of one press are no evidence of their own.
    """

    label: Integers  # (m,) class of each
    # (m, d), (m, 3) and (m,) as in `PressVectors`
    pattern: Array
    powers: Array
    frames: Array
    presses: Array  # (m,) how many presses each is the mean of
    slopes: Array  # (m, 3, d) what a usual difference of place and turn does (T); 0 where unknown
    bends: Array
    middle: Array
    factors: Array
    number: Integers

    @classmethod
    def empty(cls, d: int) -> SupportSet:
        """None yet, of patterns of length d."""
        none = np.zeros(0)
        return cls(
            np.zeros(0, np.int64), np.zeros((0, d)), np.zeros((0, 3)), none, none,
            np.zeros((0, 3, d)), np.zeros((0, 2, d)), np.zeros((0, d)),
            np.zeros((0, SHAPE_RANK, d)),
            np.zeros(0, np.int64),
        )  # fmt: skip

    def where(self, rows: npt.NDArray[np.intp]) -> SupportSet:
        """Some of them."""
        return SupportSet(*(getattr(self, one.name)[rows] for one in fields(self)))

    def without(self, label: int) -> SupportSet:
        """All but those of a class; classes above it move down by one."""
        left = self.where(np.flatnonzero(self.label != label))
        lower = left.label - (left.label > label)
        rest = (getattr(left, one.name) for one in fields(self)[1:])
        return SupportSet(lower, *rest)

    def joined(self, other: SupportSet) -> SupportSet:
        """These and others."""
        return SupportSet(
            *(
                np.concatenate([getattr(self, one.name), getattr(other, one.name)])
                for one in fields(self)
            )
        )

    def at_depth(self, ratio: Array, powers: Array) -> Array:
        """Patterns (m, d) at depths over their own (m,), of a press with some powers (3,)."""
        bent = ratio[:, None] ** [2, 3] * powers[1:] - ratio[:, None] * self.powers[:, 1:]
        return np.asarray(
            ratio[:, None] * self.pattern + np.einsum('mp,mpd->md', bent, self.bends)
        )

    def with_depth(self, ratio: Array, powers: Array) -> Array:
        """Slopes (m, d) of those patterns with the ratio (m,)."""
        bent = [2, 3] * ratio[:, None] ** [1, 2] * powers[1:] - self.powers[:, 1:]
        return np.asarray(self.pattern + np.einsum('mp,mpd->md', bent, self.bends))

    def depths(self, pattern: Array, powers: Array) -> Array:
        """Depth of a press (d,) over that of each of them, shape (m,)."""
        ratio = (self.pattern @ pattern) / np.maximum(np.square(self.pattern).sum(axis=1), 1e-30)
        ratio = np.clip(ratio, *DEEPER)
        for _ in range(ROUNDS):
            slope = self.with_depth(ratio, powers)
            miss = pattern - self.at_depth(ratio, powers)
            step = (slope * miss).sum(axis=1) / np.maximum(np.square(slope).sum(axis=1), 1e-30)
            ratio = np.clip(ratio + np.clip(step, -0.5 * ratio, ratio), *DEEPER)
        return np.asarray(ratio)

    def cleared(self, basis: Array) -> SupportSet:
        """These without what a uniform field (d, 3) can add."""

        def own(rows: Array) -> Array:
            return np.asarray(rows - (rows @ basis) @ basis.T)

        return SupportSet(
            self.label, own(self.pattern), self.powers, self.frames, self.presses,
            own(self.slopes), own(self.bends), own(self.middle), own(self.factors), self.number,
        )  # fmt: skip

    def told(self, noise: Array, still: float, error: float) -> tuple[SupportSet, Array]:
        """These with the patterns that are likeliest, and factors and variance (m, d) of them.

        Noise (d,) hides what a press is like; where shapes do nothing, nothing is to be seen.
        """
        theirs = noise**2 / self.frames[:, None] + still**2 / self.presses[:, None]
        share = np.array([share_of(one, error) for one in self.pattern]).reshape(theirs.shape)
        unknown = np.isnan(self.middle).any(axis=1, keepdims=True)
        gain = np.where(unknown, 1.0, share / (share + theirs))
        whole = share + theirs
        off = self.pattern - np.where(unknown, 0.0, self.middle)
        rows = self.factors / np.sqrt(whole)[:, None]
        inner = np.eye(rows.shape[1]) + np.matmul(rows, np.swapaxes(rows, 1, 2))
        right = np.matmul(rows, (off / np.sqrt(whole))[..., None])
        found = np.linalg.solve(inner, right)[..., 0]
        drawn = self.pattern - off + np.einsum('mr,mrd->md', found, self.factors)
        pattern = drawn + gain * (self.pattern - drawn)
        low = np.linalg.cholesky(np.linalg.inv(inner))
        left = np.matmul(np.swapaxes(low, 1, 2), self.factors) * (1 - gain)[:, None]
        return replace(self, pattern=pattern, factors=left), gain * theirs


@dataclass(frozen=True)
class SeenClasses:
    """SupportSet (m) as presses are compared with them.

    Attributes
    ----------
    supports : SupportSet
        Without a uniform field; patterns that are likeliest, and factors of what they leave open.
    """

    supports: SupportSet
    # (m, d) of the patterns beside these factors (T2); patterns of unit length
    variance: Array
    unit: Array


def seen_classes(
    supports: SupportSet, noise: Array, still: float, error: float, basis: Array
) -> SeenClasses:
    """Classes as their presses tell them, alike ones together.

    Parameters
    ----------
    supports : SupportSet
        Presses.
    noise : ndarray, shape (d,)
        Of a reading (T).
    still : float
        Error of a pattern that frames do not average (T).
    error : float
        Of what a press is expected to be like, as a share of what a chip sees.
    basis : ndarray, shape (d, 3)
        Orthonormal patterns of a uniform field.
    """
    found, variance = averaged(supports, basis).cleared(basis).told(noise, still, error)
    size = np.linalg.norm(found.pattern, axis=1, keepdims=True)
    return SeenClasses(found, variance, found.pattern / (size + 1e-30))


def averaged(supports: SupportSet, basis: Array) -> SupportSet:
    """Means of presses of one class that are alike, and the presses that are not.

    All are first brought to the depth of the strongest one; a uniform field is left out (d, 3).
    """
    found, plain = SupportSet.empty(supports.pattern.shape[1]), supports.cleared(basis)
    for label in np.unique(supports.label):
        left = np.flatnonzero(supports.label == label)
        while len(left):
            size = np.linalg.norm(plain.pattern[left], axis=1)
            first = left[size.argmax()]
            cosine = (plain.pattern[left] @ plain.pattern[first]) / (size * size.max())
            alike = (cosine > ALIKE) | (left == first)
            ratio = plain.where(left[alike]).depths(plain.pattern[first], plain.powers[first])
            one = supports.where(np.array([first]))
            found = found.joined(_mean(supports.where(left[alike]), one, ratio))
            left = left[~alike]
    return found


def _mean(some: SupportSet, first: SupportSet, ratio: Array) -> SupportSet:
    """Mean of supports (m) at the depth of the first, over which theirs are 1 / ratio (m,)."""
    weight = some.frames / np.square(ratio)
    share = weight / weight.sum()
    bends = (share * ratio ** [[2], [3]]).T[..., None] * some.bends
    slopes = (share * ratio)[:, None, None] * some.slopes
    return replace(
        first,
        pattern=(share @ some.at_depth(ratio, first.powers[0]))[None],
        frames=np.array([weight.sum()]),
        presses=np.array([1 / np.square(share * ratio).sum()]),
        slopes=slopes.sum(axis=0)[None],
        bends=bends.sum(axis=0)[None],
    )


def support_scores(
    seen: SeenClasses, presses: PressVectors, noise: Array, common: Array, still: float,
    repeats: float = REPEATS,
) -> Array:  # fmt: skip
    """Twice the negative log-likelihood of every press under every support.

    Parameters
    ----------
    seen : SeenClasses
        m supports.
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
    n, m = len(presses.pattern), len(seen.unit)
    found = np.full((n, m), np.inf)
    basis = np.linalg.qr(common)[0]
    quiet = presses.variance(noise, still)
    for i in range(n):
        y = presses.pattern[i]
        own = y - basis @ (basis.T @ y)
        near = np.argsort(-(seen.unit @ own), kind='stable')[:CLOSEST]
        near = near[seen.unit[near] @ own > 0]
        if len(near):
            some, theirs = seen.supports.where(near), seen.variance[near]
            ratio = some.depths(own, presses.powers[i])
            variance = quiet[i] + share_of(y, repeats) + np.square(ratio)[:, None] * theirs
            found[i, near] = _scores(some, ratio, own, presses.powers[i], variance, common)
    return found


def share_of(pattern: Array, share: float) -> Array:
    """Variance (d,) of an error that is a share of what a chip sees."""
    here = np.square(pattern.reshape(-1, 3)).mean(axis=1)
    return np.repeat(share**2 * (here + 0.05 * here.max()), 3)


def orthonormal(columns: Array) -> Array:
    """Bases (n, d, k) of what columns (n, d, k) span."""
    rows = np.swapaxes(columns, 1, 2)
    low = np.linalg.cholesky(np.matmul(rows, columns))
    return np.asarray(np.swapaxes(np.linalg.solve(low, rows), 1, 2))


def _scores(
    supports: SupportSet, ratio: Array, y: Array, powers: Array, variance: Array, common: Array
) -> Array:
    """Scores (m,) of one press (d,) with variances (m, d) of its readings."""
    pattern, scale = supports.at_depth(ratio, powers), ratio[:, None]
    deeper, bent = scale * supports.with_depth(ratio, powers), pattern - scale * supports.pattern
    free = np.concatenate([supports.slopes, supports.factors], axis=1)
    rows = np.stack([y - pattern, deeper, BEND * bent], axis=1)
    rows = np.concatenate([rows, scale[:, None] * free], axis=1)
    rows = rows / np.sqrt(variance)[:, None]
    span = orthonormal(common / np.sqrt(variance)[..., None])
    rows = rows - np.matmul(np.matmul(rows, span), np.swapaxes(span, 1, 2))
    miss, rows = rows[:, 0], rows[:, 1:]
    # depth is free within a factor; the rest has its usual size
    prior = np.eye(rows.shape[1])
    prior[0, 0] = ANY_DEPTH**2
    normal = np.matmul(rows, np.swapaxes(rows, 1, 2)) + prior
    right = np.matmul(rows, miss[..., None])
    best = np.linalg.solve(normal, right)
    cost = np.square(miss).sum(axis=1) - (best * right).sum(axis=(1, 2))
    level = np.log(variance).sum(axis=1) + np.linalg.slogdet(normal[:, 1:, 1:])[1]
    return np.asarray(cost + level)
