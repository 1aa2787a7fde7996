# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Classes of presses from few presses, in a metric that discounts how they were placed.

Two presses of one head differ by its place, turn and depth, and by any uniform field; a model of
the sheet gives what these do to the pattern of a press, also of a head that nobody described: a
described head of like pattern stands in for it. Along them a distance costs little (tangent
distance: Simard et al., NIPS 1992). Where that names fewer held-out presses, unit vectors decide.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, TypeVar

import numpy as np

if TYPE_CHECKING:
    import numpy.typing as npt

    from tactile_ros.types import Array, Integers

TINY = np.finfo(np.float64).tiny
CLOSEST = 16  # prototypes that are compared in full
RATIOS = 0.05, 20.0  # size of a press over that of a prototype
ANY_SIZE = 0.5  # deviation of that ratio from the one that fits best
# deviations of presses of one class: place (m), turn (rad), logarithm of the depth
UNLIKE = np.array([2e-4, 2e-4, 0.02, 0.1])
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
        Change of field in the later half of a window (T).
    frames : ndarray, shape (n,)
        Frames that it is the mean of.
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


def press_pattern(window: Array) -> tuple[Array, float]:
    """Mean (d,) and count of the later half of whole frames of a window (w, d); NaN: none."""
    whole = window[np.isfinite(window).all(axis=1)]
    if not len(whole):
        return np.full(window.shape[1], np.nan), 0.0
    late = whole[len(whole) // 2 :]
    return late.mean(axis=0), float(len(late))


def press_patterns(windows: list[Array], d: int) -> Presses:
    """Patterns of several presses, each of frames (w, d)."""
    parts = [press_pattern(window) for window in windows]
    patterns = np.array([part[0] for part in parts]).reshape(-1, d)
    return Presses(patterns, np.array([part[1] for part in parts]))


@dataclass(frozen=True)
class SupportSet(Presses):
    """Presses (m) by which classes are recognised.

    Attributes
    ----------
    label, number : ndarray, shape (m,)
        Class; press that each is a window of: windows of one press are one piece of evidence.
    slopes : ndarray, shape (m, 4, d)
        Change of the pattern with place (T / m), turn (T / rad), and with the logarithm of the
        depth beside its size (T); 0 where unknown.
    """

    label: Integers
    number: Integers
    slopes: Array

    @classmethod
    def empty(cls, d: int) -> SupportSet:
        """None yet, of patterns of length d."""
        whole = np.zeros(0, np.int64)
        return cls(np.zeros((0, d)), np.zeros(0), whole, whole, np.zeros((0, 4, d)))

    def without(self, label: int) -> SupportSet:
        """All but those of a class; classes above it move down by one."""
        left = self.rows(np.flatnonzero(self.label != label))
        return replace(left, label=left.label - (left.label > label))


def share_of(pattern: Array, share: float) -> Array:
    """Variance (..., d) of an error that is a share of what a chip sees of patterns (..., d)."""
    chips = pattern.reshape(*pattern.shape[:-1], -1, 3)
    here = np.square(chips).mean(axis=-1)
    here = share**2 * (here + 0.05 * here.max(axis=-1, keepdims=True))
    return np.asarray(np.repeat(here, 3, axis=-1))


def support_scores(
    supports: SupportSet, presses: Presses, noise: Array, common: Array, still: float
) -> Array:
    """Twice the negative log-likelihood (n, m) of presses by supports; inf: far away.

    `noise` (d,) is of a reading (T), `common` (d, 3) are readings of a uniform field, `still` is
    the error that frames do not average (T).
    """
    found = np.full((len(presses.pattern), len(supports.label)), np.inf)
    basis = np.linalg.qr(common)[0]
    size = np.linalg.norm(without_field(supports.pattern, basis), axis=1)
    unit = scaled_patterns(supports.pattern, basis)
    theirs, variance = supports.variance(noise, still), presses.variance(noise, still)
    for i, y in enumerate(presses.pattern):
        cosine = unit @ y
        near = np.argsort(-cosine, kind='stable')[:CLOSEST]
        near = near[cosine[near] > 0]
        if not len(near):
            continue
        ratio = np.clip(cosine[near] / size[near], *RATIOS)[:, None]
        made = ratio * (supports.pattern[near] + np.log(ratio) * supports.slopes[near, 3])
        free = np.sqrt(2) * ratio[..., None] * UNLIKE[:, None] * supports.slopes[near]
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


def prototype_scores(supports: SupportSet, presses: Presses, basis: Array) -> Array:
    """Squared distances (n, m) of unit vectors from supports ([1] Eq. (3)), over a usual one."""
    known, asked = (scaled_patterns(one.pattern, basis) for one in (supports, presses))
    return np.asarray(np.square(asked[:, None] - known).sum(axis=2) / UNIT_ERROR**2)
