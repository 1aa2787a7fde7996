"""Touches that were recorded or computed, looked up with and without a stray field.

A uniform outside field, once the pad is tared, adds the same vector to all chips: 0.5 mT of it is
twice what most touches change. A reading that lies off all known touches, and far more so than
held-out ones do, is looked up by what the chips differ in, and by the rest only as far as stray
fields are rare beyond some tenths of a millitesla.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactile_ros.estimators.folds import group_folds
from tactile_ros.estimators.touch_table import Blame, TouchTable
from tactile_ros.estimators.uncertainty import CalibratedCovariance
from tactile_ros.types import Array, Integers

STRAY = 0.3e-3  # T, of one component of stray fields that are met: earth turned, motors, magnets
UNLIKE = 0.995  # share of held-out touches that count as known
MARGIN, RISE = 1.2, 0.5
MISFIT = 0.12  # of its size, by which a touch may be unlike all others without a stray field
WEAK = 30e-6  # T, a tenth of such fields: below it a misfit is as likely
MOST = 12_000
TINY = 1e-12


@dataclass(frozen=True)
class Answer:
    """What known touches say about readings.

    Attributes
    ----------
    mean, cov : ndarray, shape (s, k) and (s, k, k)
        Of the answers of the table.
    shares : ndarray, shape (s, n)
        Of the cells.
    stray : ndarray, shape (s, q)
        Common part that the touch does not explain (T).
    """

    mean: Array
    cov: Array
    shares: Array
    stray: Array


class KnownTouches:
    """A table of touches with their answers, in two metrics.

    Parameters
    ----------
    common : ndarray, shape (d, 3)
        What a uniform field adds to the features, in sensor axes.
    cells : int
        Number of cells.

    Attributes
    ----------
    plain_, blind_ : TouchTable
        Without and with a stray field.
    x_, answers_ : ndarray, shape (n, d) and (n, k)
        Changes of field (T) and what truth told of the touches.
    cells_ : ndarray of int, shape (n,)
        Their cells; -1 unknown.
    limit_ : float
        How strange known touches are, at most.
    covariances_ : tuple of CalibratedCovariance
        Of the answers under a stray field, three components each.
    """

    plain_: TouchTable
    blind_: TouchTable
    x_: Array
    answers_: Array
    cells_: Integers
    limit_: float
    covariances_: tuple[CalibratedCovariance, ...]

    def __init__(self, common: Array, cells: int) -> None:
        self.common = common
        self.cells = cells

    def fit(
        self, x: Array, answers: Array, cells: Integers, groups: Integers, noise: float
    ) -> KnownTouches:
        """Remember touches x (n, d) in canonical order, with answers (n, k); returns itself."""
        order = np.lexsort(np.column_stack([x, answers]).T[::-1])
        order = order[:: -(-len(order) // MOST)]
        self.x_, self.answers_, self.cells_ = x[order], answers[order], cells[order]
        group = np.unique(groups[order], return_inverse=True)[1].reshape(-1)
        self.plain_, self.blind_ = self._tables(self.x_, noise)
        self._calibrate(np.asarray(group), noise)
        return self

    def _tables(self, x: Array, noise: float) -> tuple[TouchTable, TouchTable]:
        plain = TouchTable(noise).fit(x)
        return plain, TouchTable(noise, self.common, STRAY).fit(x)

    def _calibrate(self, groups: Integers, noise: float) -> None:
        """Distances and errors of groups that the tables do not hold."""
        _, first = np.unique(groups, return_index=True)
        rank = np.empty(len(first), np.int64)
        rank[np.argsort(first)] = np.arange(len(first))
        fold = group_folds(rank[groups], 5, seed=0)
        rng = np.random.default_rng(0)
        stray = STRAY * rng.normal(size=(len(self.x_), self.common.shape[1])) @ self.common.T
        far, mean = np.empty(len(self.x_)), np.empty_like(self.answers_)
        drivers = np.empty((len(self.x_), self.answers_.shape[1] // 3, 2))
        for part in np.unique(fold):
            held = fold == part
            seen = ~held if not held.all() else held
            plain, blind = self._tables(self.x_[seen], noise)
            far[held] = plain.strangeness(self.x_[held], plain.blame(self.x_[held]))
            blame = blind.blame(self.x_[held] + stray[held])
            mean[held] = blame.mean(self.answers_[seen])
            drivers[held] = self._drivers(blame, self.answers_[seen], mean[held])[1]
        self.limit_ = max(MARGIN * float(np.quantile(far, UNLIKE)), TINY)
        error = mean - self.answers_
        self.covariances_ = tuple(
            CalibratedCovariance().fit(drivers[:, i], error[:, 3 * i : 3 * i + 3], groups)
            for i in range(drivers.shape[1])
        )

    def strangeness(self, x: Array, blame: Blame) -> Array:
        """0 for readings (s, d) like those of known touches, to 1 for those with a stray field."""
        size = np.sqrt((x * x).sum(axis=1))
        likely = np.minimum(blame.distance / np.maximum(MISFIT * size, WEAK), 2) - 1
        off = (self.plain_.strangeness(x, blame) / self.limit_ - 1) / RISE
        return np.asarray(np.clip(off, 0, 1) * np.maximum(likely, 0))

    def without_common(self, x: Array) -> Answer:
        """What known touches say of readings (s, d) with an unknown stray field."""
        blame = self.blind_.blame(x)
        mean = blame.mean(self.answers_)
        _, drivers = self._drivers(blame, self.answers_, mean)
        cov = np.zeros((len(x), mean.shape[1], mean.shape[1]))
        for i, known in enumerate(self.covariances_):
            part = slice(3 * i, 3 * i + 3)
            cov[:, part, part] = known.predict(drivers[:, i])
        shares = blame.shares(self.cells_, self.cells)
        stray = (x - blame.mean(self.x_)) @ np.linalg.pinv(self.common).T
        return Answer(mean, cov, shares, stray)

    @staticmethod
    def _drivers(blame: Blame, answers: Array, mean: Array) -> tuple[Array, Array]:
        """Covariance among the neighbours, and what the error depends on: (s, k / 3, 2)."""
        cov = blame.covariance(answers, mean)
        spread = np.diagonal(cov, axis1=1, axis2=2).reshape(len(cov), -1, 3).sum(axis=2)
        drivers = np.empty((*spread.shape, 2))
        drivers[..., 0] = 0.5 * np.log(spread + TINY)
        drivers[..., 1] = np.log(blame.distance + TINY)[:, None]
        return cov, drivers
