# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Classes of presses from few presses, in a metric that discounts how they were placed.

A class is the mean of its presses at a place, [1] eq. (2). Two presses of one head differ by its
place, turn and depth, and by any uniform field; a model of the sheet gives what these do to the
pattern of a press, also of a head that nobody described: a described head of like pattern stands
in for it. Along them a distance costs little. Where that names fewer held-out presses, the
nearest mean of unit vectors decides.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, TypeVar

import numpy as np

if TYPE_CHECKING:
    import numpy.typing as npt

    from tactile_ros.types import Array, Integers

LATE = 0.34  # of a window: frames that show the pattern first
TINY = np.finfo(np.float64).tiny
ALIKE = 0.99  # cosine, but for noise, of presses of one class that are averaged
CLOSEST = 16  # prototypes that are compared in full
RATIOS = 0.05, 20.0  # size of a press over that of a prototype
ANY_SIZE = 0.5  # deviation of that ratio from the one that fits best
# deviations of presses of one class: place (m), turn (rad), logarithm of the depth
UNLIKE = np.array([2e-4, 2e-4, 0.02, 0.1])
DRAWS, MOST_ASKED = 2, 150  # of support presses, and queries, by which a way is chosen
SAME_PLACE = 0.7  # cosine of presses of one class at one place
UNIT_ERROR = 0.1  # of a unit vector
Some = TypeVar('Some', bound='Rows')


@dataclass(frozen=True)
class Rows:
    """Arrays with a row for each press."""

    def rows(self: Some, rows: npt.NDArray[np.intp]) -> Some:
        """Some of them."""
        return type(self)(*(getattr(self, one.name)[rows] for one in fields(self)))

    def joined(self: Some, other: Some) -> Some:
        """These and others."""
        pairs = ((getattr(self, one.name), getattr(other, one.name)) for one in fields(self))
        return type(self)(*(np.concatenate(pair) for pair in pairs))


@dataclass(frozen=True)
class Presses(Rows):
    """Presses (n) of one skin.

    Attributes
    ----------
    pattern : ndarray, shape (n, d)
        Change of field at a depth near the deepest of the window (T), from all of its frames.
    frames : ndarray, shape (n,)
        Frames whose mean has as little noise.
    """

    pattern: Array
    frames: Array

    def variance(self, noise: Array, still: float) -> Array:
        """Variance of patterns (n, d) by noise (d,) of frames and errors that do not average."""
        return np.asarray(np.square(noise) / np.maximum(self.frames, TINY)[:, None] + still**2)


def without_field(patterns: Array, basis: Array) -> Array:
    """Patterns (..., d) less their parts along a uniform field, whose patterns are (d, 3)."""
    return np.asarray(patterns - (patterns @ basis) @ basis.T)


def scaled_patterns(patterns: Array, basis: Array) -> Array:
    """Patterns (n, d) of length 1, without a uniform field."""
    own = without_field(patterns, basis)
    return np.asarray(own / (np.linalg.norm(own, axis=1, keepdims=True) + TINY))


def press_pattern(window: Array, common: Array) -> tuple[Array, float]:
    """Pattern (d,) and count of frames of one window (w, d); NaN where no frame is whole.

    Frames are weighted by the course c of the press: the weighted mean of all frames, over
    sum(c^2) and times sum(c^3) / sum(c^2), is the change at the depth of that share of the
    largest, to second order in the spread of c. Orthonormal patterns of a uniform field, `common`
    (d, 3), say nothing of the course.
    """
    whole = window[np.isfinite(window).all(axis=1)]
    if not len(whole):
        return np.full(window.shape[1], np.nan), 0.0
    count = max(1, int(np.ceil(LATE * len(whole))))
    late = whole[-count:].sum(axis=0) / count
    late -= common @ (late @ common)  # frames are measured along it: no need to clear them too
    course = np.maximum(whole @ late, 0.0)
    course /= max(float(course.max()), TINY)
    if not course.any():
        course[:] = 1.0
    square = float(course @ course)
    share = float(course @ course**2) / square
    return course @ whole * (share / square), square / share**2


def press_patterns(windows: list[Array], common: Array) -> Presses:
    """Patterns of several presses, each of frames (w, d)."""
    parts = [press_pattern(window, common) for window in windows]
    patterns = np.array([part[0] for part in parts]).reshape(-1, len(common))
    return Presses(patterns, np.array([part[1] for part in parts]))


@dataclass(frozen=True)
class SupportSet(Presses):
    """Presses (m) by which classes are recognised.

    Attributes
    ----------
    label, number : ndarray, shape (m,)
        Class; press that each is a window of: windows of one press are one piece of evidence.
    presses : ndarray, shape (m,)
        How many presses each is the mean of.
    slopes : ndarray, shape (m, 4, d)
        Change of the pattern with place (T / m), turn (T / rad), and with the logarithm of the
        depth beside its size (T); 0 where unknown.
    """

    label: Integers
    number: Integers
    presses: Array
    slopes: Array

    @classmethod
    def empty(cls, d: int) -> SupportSet:
        """None yet, of patterns of length d."""
        whole, none = np.zeros(0, np.int64), np.zeros(0)
        return cls(np.zeros((0, d)), none, whole, whole, none, np.zeros((0, 4, d)))

    def without(self, label: int) -> SupportSet:
        """All but those of a class; classes above it move down by one."""
        left = self.rows(np.flatnonzero(self.label != label))
        return replace(left, label=left.label - (left.label > label))

    def averaged(self, basis: Array, noise: Array, still: float) -> SupportSet:
        """Means of presses of one class that are alike but for noise, and those that are not.

        All are brought to the size of the strongest one; a uniform field is left out (d, 3).
        """
        found, own = [], without_field(self.pattern, basis)
        size = np.linalg.norm(own, axis=1)
        noisy = self.variance(noise, still).sum(axis=1) / np.maximum(np.square(size), TINY)
        for label in np.unique(self.label):
            left = np.flatnonzero(self.label == label)
            while len(left):
                first = left[size[left].argmax()]
                cosine = own[left] @ own[first] / np.maximum(size[left] * size[first], TINY)
                alike = (cosine > ALIKE - noisy[left] - noisy[first]) | (left == first)
                rows, left = left[alike], left[~alike]
                ratio = np.square(size[first]) / np.maximum(own[rows] @ own[first], TINY)
                found.append(self._mean(rows, first, np.maximum(ratio, 1.0)))
        return SupportSet(*(np.concatenate(column) for column in zip(*found, strict=True)))

    def _mean(self, rows: Integers, first: int, ratio: Array) -> list[npt.NDArray[np.generic]]:
        """Columns of the mean of some, each stronger by a ratio, beside the label of one."""
        weight = self.frames[rows] / np.square(ratio)
        share = weight / weight.sum() * ratio

        def mean(column: Array) -> Array:
            return np.tensordot(share, column[rows], axes=1)[None]

        return [
            mean(self.pattern), weight.sum(keepdims=True), self.label[[first]],
            self.number[[first]], 1 / np.square(share).sum(keepdims=True),
            mean(self.slopes),
        ]  # fmt: skip


def share_of(pattern: Array, share: float) -> Array:
    """Variance (..., d) of an error that is a share of what a chip sees of patterns (..., d)."""
    chips = pattern.reshape(*pattern.shape[:-1], -1, 3)
    here = np.square(chips).mean(axis=-1)
    here = share**2 * (here + 0.05 * here.max(axis=-1, keepdims=True))
    return np.asarray(np.repeat(here, 3, axis=-1))


def support_scores(
    supports: SupportSet, presses: Presses, noise: Array, common: Array, still: float
) -> Array:
    """Twice the negative log-likelihood (n, m) of presses under prototypes; inf: far away.

    Prototypes are as of `SupportSet.averaged`; `noise` (d,) is of a reading (T), `common` (d, 3)
    are readings of a uniform field, `still` is the error that frames do not average (T).
    """
    found = np.full((len(presses.pattern), len(supports.label)), np.inf)
    basis = np.linalg.qr(common)[0]
    size = np.linalg.norm(without_field(supports.pattern, basis), axis=1)
    unit = scaled_patterns(supports.pattern, basis)
    theirs = noise**2 / supports.frames[:, None] + still**2 / supports.presses[:, None]
    variance = presses.variance(noise, still)
    for i, y in enumerate(presses.pattern):
        cosine = unit @ y
        near = np.argsort(-cosine, kind='stable')[:CLOSEST]
        near = near[cosine[near] > 0]
        if not len(near):
            continue
        ratio = np.clip(cosine[near] / size[near], *RATIOS)[:, None]
        made = ratio * (supports.pattern[near] + np.log(ratio) * supports.slopes[near, 3])
        wide = ratio * np.sqrt(1 + 1 / supports.presses[near, None])
        free = wide[..., None] * UNLIKE[:, None] * supports.slopes[near]
        rows = np.concatenate([(y - made)[:, None], ANY_SIZE * made[:, None], free], axis=1)
        found[i, near] = _marginal_scores(rows, variance[i] + ratio**2 * theirs[near], common)
    return found


def _marginal_scores(rows: Array, variance: Array, common: Array) -> Array:
    """Scores (m,) of misfits and what may differ, one deviation of each (m, 1 + k, d).

    The size, the first of these, costs as little as the depth of templates: nothing.
    """
    sigma = np.sqrt(variance)[:, None]
    rows = rows / sigma
    span = common.T / sigma
    gram = np.matmul(span, np.swapaxes(span, 1, 2))
    along = np.linalg.solve(gram, np.matmul(span, np.swapaxes(rows, 1, 2)))
    rows = rows - np.matmul(np.swapaxes(along, 1, 2), span)
    miss, rows = rows[:, 0], rows[:, 1:]
    normal = np.matmul(rows, np.swapaxes(rows, 1, 2)) + np.eye(rows.shape[1])
    right = np.matmul(rows, miss[..., None])
    cost = np.square(miss).sum(axis=1)
    cost -= (np.linalg.solve(normal, right) * right).sum(axis=(1, 2))
    level = np.log(variance).sum(axis=1) + np.linalg.slogdet(normal[:, 1:, 1:])[1]
    return np.asarray(cost + level)


def one_shot_shares(
    supports: SupportSet, noise: Array, common: Array, still: float
) -> dict[str, float]:
    """Shares of held-out presses named rightly from one press of each class at each place.

    By likelihoods and by the nearest unit vector; empty: nothing repeats.
    """
    basis = np.linalg.qr(common)[0]
    unit = scaled_patterns(supports.pattern, basis)
    right = np.zeros((DRAWS, 2))
    for draw in range(DRAWS):
        known, asked = _one_shot(supports, unit, np.random.default_rng(draw))
        if not len(asked) or len(np.unique(supports.label)) == 1:
            return {}
        few, presses = supports.rows(known), supports.rows(asked)
        scores = (
            support_scores(few, presses, noise, common, still),
            prototype_scores(few, presses, basis),
        )
        right[draw] = [(few.label[one.argmin(axis=1)] == presses.label).mean() for one in scores]
    likely, nearest = right.mean(axis=0).tolist()
    return {'accuracy_whitened': likely, 'accuracy_prototypes': nearest}


def _one_shot(
    supports: SupportSet, unit: Array, rng: np.random.Generator
) -> tuple[Integers, Integers]:
    """Draw one press of each class at each place, and other presses of it there."""
    known: list[int] = []
    asked: list[int] = []
    for row in rng.permutation(len(unit)).tolist():
        same = [i for i in known if supports.label[i] == supports.label[row]]
        there = [i for i in same if unit[i] @ unit[row] > SAME_PLACE]
        if not there:
            known.append(row)
        elif all(supports.number[i] != supports.number[row] for i in there):
            asked.append(row)
    return np.array(known, np.int64), np.array(asked[:MOST_ASKED], np.int64)


def prototype_scores(supports: SupportSet, presses: Presses, basis: Array) -> Array:
    """Squared distances (n, m) of unit vectors from prototypes, over a usual one; [1] eq. (3)."""
    known, asked = (scaled_patterns(one.pattern, basis) for one in (supports, presses))
    return np.asarray(np.square(asked[:, None] - known).sum(axis=2) / UNIT_ERROR**2)
