# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Threshold of contact on the deviation from the baseline, and ids of contacts and patches."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from tactile_ros.physics.compiled import compiled
from tactile_ros.types import Array, Bools, Integers

SIGMAS = 5.0
LIGHTEST = 0.01
MOST_MISSED = 0.05
FALSE_ALARMS = 0.01
SHARE = 0.4


def contact_scale(noise: Array, touched: Array | None, felt: Array | None = None) -> Array:
    """Deviation (t, c) of a channel beyond which something touches; NaN: unknown.

    Five sigma of `noise` (t, c), lowered until at most one in twenty of the touches that must be
    `felt` is missed (where the noise has drift in it), raised to 0.4 of the lightest `touched`
    (both (s, t, c), whole frames).

    Examples
    --------
    >>> contact_scale(np.full((1, 2), 0.1), None)
    array([[0.5, 0.5]])
    """
    level, most = np.nan, np.inf
    if touched is not None:
        size = np.abs(touched).max(axis=(1, 2))
        level = SHARE * float(np.quantile(size, LIGHTEST)) or np.nan
    if felt is not None:
        most = float(np.quantile(np.abs(felt).max(axis=(1, 2)), MOST_MISSED)) or np.inf
    sigmas = np.where(noise > 0, np.minimum(SIGMAS * noise, most), np.nan)
    return np.asarray(np.fmax(sigmas, level))


def calm_factor(calm: Array | None, firm: Array, scale: Array) -> float:
    """Factor of the threshold (t, c), 1 at least, that leaves calm frames (s, t, c) below it.

    Of calm frames one in a hundred may stay above, of firm ones one in a hundred fall below.
    """
    if calm is None or not len(calm) or np.isnan(scale).all():
        return 1.0
    rest = float(np.nanquantile(excursion(calm, scale), 1 - FALSE_ALARMS))
    most = float(np.nanquantile(excursion(firm, scale), FALSE_ALARMS))
    return max(1.0, min(rest, most))


def excursion(delta: Array, scale: Array) -> Array:
    """Largest deviation (s,) of frames (s, t, c) over the threshold (t, c); NaN: unknown."""
    return np.asarray(np.abs(delta / scale).max(axis=(1, 2)))


@compiled
def contact_rows(
    delta: Array, scale: Array, good: Bools, size: Array, contact: npt.NDArray[np.int8]
) -> None:
    """Write excursions (s,), and contact (s,): 1, 0, or -1 in rows not `good` and unknown."""
    for s in range(len(delta)):
        size[s] = 0.0
        for t in range(scale.shape[0]):
            for c in range(scale.shape[1]):
                one = abs(delta[s, t, c] / scale[t, c])
                if not one <= size[s]:  # NaN stays
                    size[s] = one if size[s] >= 0.0 else size[s]
        contact[s] = np.int8(size[s] > 1.0) if good[s] and size[s] >= 0.0 else np.int8(-1)


class ContactIds:
    """Number touches: an id lives from touch to release, across frames of unknown contact."""

    def __init__(self) -> None:
        self._count = 0
        self._touching = False

    def number(
        self, contact: npt.NDArray[np.int8], restart: Bools, in_time: bool,
        begins: Bools | None = None,
    ) -> Integers:  # fmt: skip
        """Id (s,) of the patch in each frame; -1: none, or unknown with none before.

        `contact` (s,) is 1, 0, -1 unknown; independent frames are not `in_time`, each patch is
        number 0. `restart`, `begins` (s,): rows at which a stream or a baseline begins; at which
        ids begin with 0.
        """
        if not in_time:
            return np.where(contact == 0, -1, 0)
        ids = np.empty(len(contact), np.int64)
        for i, now in enumerate(contact.tolist()):
            if begins is not None and begins[i]:
                self._count = 0
            before = self._touching and not restart[i]
            self._touching = now == 1 or (now < 0 and before)
            self._count += self._touching and not before
            ids[i] = self._count - 1 if self._touching else -1
        return ids


class PatchIds:
    """Ids of the patches of one stream, which live as long as their patch.

    A patch is the one of the last frame with which it shares most taxels, each of them once; of
    what is left, the nearest within `reach` (m). A split leaves the id to the part that shares
    most, a merger keeps that of the one it shares most with. An id that ended never comes back.
    Frames of unknown contact change nothing; a frame without contact ends all.
    """

    def __init__(self, reach: float) -> None:
        self.reach = reach
        self._count = 0
        self._forget()

    def _forget(self) -> None:
        self._label: Integers = np.zeros(0, np.int64)
        self._centre: Array = np.zeros((0, 3))
        self._ids: Integers = np.zeros(0, np.int64)

    def number(
        self, label: Integers, count: Integers, centre: Array, usable: Bools, restart: Bools,
        begins: Bools | None = None,
    ) -> Integers:  # fmt: skip
        """Ids (s, k) of the patches of frames in time order; -1: no patch.

        `label` (s, t) is the patch of each taxel, strongest 0, -1 none; `count` (s,) and `centre`
        (s, k, 3) (m) are those of each frame; frames not `usable` (s,) tell no contact. `restart`
        and `begins` as in `ContactIds.number`.
        """
        ids = np.full(centre.shape[:2], -1, np.int64)
        for i in range(len(label)):
            if restart[i]:
                self._forget()
            if begins is not None and begins[i]:
                self._count = 0
            if usable[i] and count[i]:
                n = int(count[i])
                ids[i, :n] = self._follow(label[i], centre[i, :n])
            elif usable[i]:
                self._forget()
        return ids

    def _follow(self, label: Integers, centre: Array) -> Integers:
        """Ids of the patches (n,) of one more frame."""
        ids = np.full(len(centre), -1, np.int64)
        if len(self._ids):
            self._by_taxels(label, ids)
            if (ids < 0).any():
                self._by_distance(centre, ids)
        new = np.flatnonzero(ids < 0)
        ids[new] = self._count + np.arange(len(new))
        self._count += len(new)
        self._label, self._centre, self._ids = label, centre, ids
        return ids

    def _by_taxels(self, label: Integers, ids: Integers) -> None:
        """Give ids (n,) to patches that share taxels with old ones, most first."""
        shared = (self._label >= 0) & (label >= 0)
        pair = self._label[shared] * len(ids) + label[shared]
        overlap = np.bincount(pair, minlength=len(self._ids) * len(ids))
        for k in np.argsort(-overlap, kind='stable')[: np.count_nonzero(overlap)]:
            old, new = divmod(int(k), len(ids))
            if ids[new] < 0 and self._ids[old] not in ids:
                ids[new] = self._ids[old]

    def _by_distance(self, centre: Array, ids: Integers) -> None:
        """Give ids (n,) to patches near old ones that are left, nearest first."""
        left = np.flatnonzero(~np.isin(self._ids, ids))
        free = np.flatnonzero(ids < 0)
        away = np.linalg.norm(self._centre[left, None] - centre[None, free], axis=2)
        for k in np.argsort(away, axis=None, kind='stable'):
            old, new = divmod(int(k), len(free))
            if away[old, new] > self.reach:
                break
            if ids[free[new]] < 0 and self._ids[left[old]] not in ids:
                ids[free[new]] = self._ids[left[old]]
