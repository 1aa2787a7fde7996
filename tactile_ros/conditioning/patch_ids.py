"""Which patch of the last frame a patch of this one is: ids that live as long as their patch.

The rule: a patch is the one of the last frame with which it shares most taxels, each of them
once; of what is left, the nearest within reach. When a patch splits, the part that shares most
keeps the id and the others are new; when patches merge, the whole keeps the id of the one it
shares most with and the others end. An id that ended never comes back in its stream. Frames that
cannot tell change nothing; a frame without contact ends all.
"""

from __future__ import annotations

import numpy as np

from tactile_ros.types import Array, Bools, Integers


class PatchIds:
    """Ids of the patches of one stream.

    Parameters
    ----------
    reach : float
        How far a patch may move from one frame to the next without sharing a taxel (m).
    """

    def __init__(self, reach: float) -> None:
        self.reach = reach
        self._count = 0
        self._forget()

    def _forget(self) -> None:
        self._label: Integers | None = None
        self._centre: Array = np.zeros((0, 3))
        self._ids: Integers = np.zeros(0, np.int64)

    def number(
        self,
        label: Integers,
        count: Integers,
        centre: Array,
        tells: Bools,
        restart: Bools,
        begins: Bools | None = None,
    ) -> Integers:
        """Ids of the patches of frames in time order.

        Parameters
        ----------
        label : ndarray of int, shape (s, t)
            Patch of each taxel, strongest 0; -1: none.
        count : ndarray of int, shape (s,)
            Patches of each frame.
        centre : ndarray, shape (s, k, 3)
            Of the patches (m).
        tells : ndarray, shape (s,)
            False: frames that cannot tell.
        restart, begins : ndarray, shape (s,)
            Rows before which a stream or a baseline begins; those where numbers begin with 0,
            None: nowhere.

        Returns
        -------
        ndarray of int, shape (s, k)
            -1: no patch.
        """
        ids = np.full(centre.shape[:2], -1, np.int64)
        for i in range(len(label)):
            if restart[i]:
                self._forget()
            if begins is not None and begins[i]:
                self._count = 0
            if not tells[i]:
                continue
            n = int(count[i])
            if n:
                ids[i, :n] = self._follow(label[i], centre[i, :n])
            else:
                self._forget()
        return ids

    def _follow(self, label: Integers, centre: Array) -> Integers:
        """Ids of the patches (n,) of one more frame."""
        ids = np.full(len(centre), -1, np.int64)
        if self._label is not None and len(ids) == len(self._ids) == 1:
            shared = np.count_nonzero((self._label >= 0) & (label >= 0))
            if shared or np.linalg.norm(self._centre[0] - centre[0]) <= self.reach:
                ids[0] = self._ids[0]
        elif self._label is not None:
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
        assert self._label is not None
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
