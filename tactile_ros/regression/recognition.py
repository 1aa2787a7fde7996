"""Regression that also names cells and classes, and tells the turn of what touches.

Cells and classes are voted by nearest neighbours [2], weighted by one over the distance, where
such votes are better than chance on held-out groups; a turn is regressed as cosine and sine, so
that it has no seam.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.estimators.grid_knn import GridKnn
from tactile_ros.estimators.selection import select
from tactile_ros.regression.estimation import CLASSES as REGRESSION_CLASSES
from tactile_ros.regression.estimation import Regression
from tactile_ros.regression.head import FEWEST_ROWS, Head

if TYPE_CHECKING:
    from tactile_ros.types import Array, Bools, Columns, Integers, Report, SensorConfig, Signals

NAMED = ('cell', 'label')
VOTER = 'grid_knn'
BETTER = 1.5


class Vote:
    """Nearest neighbours that vote for one of several classes.

    Parameters
    ----------
    target : str
        'cell' or 'label'.

    Attributes
    ----------
    classes_ : ndarray, shape (k,)
        Those that were seen.
    voters_ : GridKnn
        Of the share of each class.
    report_ : dict of str to float
        Share of held-out rows that are named rightly, and that of the commonest class, which is
        chance; without at least two groups it is measured on the rows that were learned from.
    """

    classes_: Integers
    voters_: GridKnn
    report_: dict[str, float]

    def __init__(self, target: str) -> None:
        self.target = target

    def fit(self, x: Array, named: Integers, groups: Integers) -> Vote:
        """Remember features (s, d) and their classes (s,); groups (s,) are split as wholes."""
        self.classes_, index = np.unique(named, return_inverse=True)
        shares = np.eye(len(self.classes_))[np.ravel(index)]
        trial = select({VOTER: GridKnn()}, x, shares, groups)
        right = trial.predictions.argmax(axis=1) == trial.y.argmax(axis=1)
        commonest = float(shares.mean(axis=0).max())
        self.report_ = {'held_out_accuracy': float(right.mean()), 'chance': commonest}
        self.voters_ = GridKnn().fit(x, shares)
        return self

    @property
    def useful(self) -> bool:
        """Whether it is right by half as much again as the commonest class, or nearly always."""
        accuracy, chance = self.report_['held_out_accuracy'], self.report_['chance']
        return accuracy > min(BETTER * chance, 0.5 + chance / 2)

    def predict(self, x: Array) -> tuple[Integers, Array]:
        """Class and its share of the votes, shape (s,) each; of equal shares the lowest class."""
        shares = self.voters_.predict(x)
        best = shares.argmax(axis=1)
        return self.classes_[best], shares[np.arange(len(x)), best]


class Recognition(Regression):
    """Regressors of one sensor, with votes for cell and label and the turn.

    Parameters
    ----------
    config, estimator, channels
        As in `Regression`. Votes are taken where the estimator is None or 'grid_knn'.
    """

    def __init__(
        self, config: SensorConfig, estimator: str | None = None, channels: int = 3
    ) -> None:
        super().__init__(config, estimator, channels)
        self.votes_: tuple[Vote, ...] = ()
        self.turn_: Head | None = None

    @property
    def estimators(self) -> dict[str, str]:
        """Name of the estimator in use for each target."""
        turn = {} if self.turn_ is None else {'yaw': self.turn_.name}
        return {**super().estimators, **turn, **{vote.target: VOTER for vote in self._useful}}

    @property
    def report(self) -> Report:
        """Errors on held-out groups for each target, and how often votes are right."""
        turn = {} if self.turn_ is None else {'yaw': self.turn_.report_}
        return {**super().report, **turn, **{vote.target: vote.report_ for vote in self.votes_}}

    @property
    def _useful(self) -> tuple[Vote, ...]:
        """Votes that are better than chance."""
        return tuple(vote for vote in self.votes_ if vote.useful)

    @property
    def label_names(self) -> tuple[str, ...]:
        """Nothing but numbers is known of classes."""
        known = [vote.classes_ for vote in self._useful if vote.target == 'label']
        return tuple(str(name) for name in known[0]) if known else ()

    def fit(self, signals: Signals, truth: Columns, groups: Columns) -> None:
        """Learn every target of which truth knows a component; see `Regression`."""
        super().fit(signals, truth, groups)
        x = signals.delta.reshape(len(signals.good), self.width)
        unknown = np.full(len(x), -1)
        votes: list[Vote] = []
        for target in NAMED if self.estimator in (None, VOTER) else ():
            named = np.asarray(truth.get(target, unknown), np.int64)
            rows = signals.good & (named >= 0)
            if rows.sum() >= FEWEST_ROWS:
                group = np.asarray(groups['group'], np.int64)[rows]
                votes.append(Vote(target).fit(x[rows], named[rows], group))
        self.votes_ = tuple(votes)
        yaw = np.asarray(truth.get('yaw', np.full(len(x), np.nan)), np.float64)
        rests = signals.baseline.reshape(x.shape)
        self.turn_ = self._turn(x, rests, yaw, signals.good & np.isfinite(yaw), groups)

    def _turn(
        self, x: Array, rests: Array, yaw: Array, rows: Bools, groups: Columns
    ) -> Head | None:
        """Regressor of the turn's cosine and sine, where enough rows (s,) know it."""
        if rows.sum() < FEWEST_ROWS:
            return None
        y = np.column_stack([np.cos(yaw[rows]), np.sin(yaw[rows])])
        group = np.asarray(groups['group'], np.int64)[rows]
        session = np.asarray(groups['session'], np.int64)[rows]
        head = Head('yaw', (0, 1), self.estimator, self.width)
        return head.fit(x[rows], y, group, session, rests[rows])

    def estimate(self, signals: Signals, memory: object) -> Columns:
        """Targets of every row; see `Regression`."""
        known = super().estimate(signals, memory)
        x = signals.delta.reshape(len(signals.good), self.width)
        for vote in self._useful:
            # no class, and no neighbours, for readings that are not there
            there = np.isfinite(x).all(axis=1)
            names, shares = np.full(len(x), -1), np.full(len(x), np.nan)
            if there.any():
                names[there], shares[there] = vote.predict(x[there])
            known[vote.target], known[f'{vote.target}_probability'] = names, shares
        if self.turn_ is not None:
            mean, cov = self.turn_.predict(x, signals.baseline.reshape(x.shape))
            length = np.maximum(np.linalg.norm(mean, axis=1), 1e-9)
            across = np.column_stack([-mean[:, 1], mean[:, 0]]) / length[:, None]
            known['yaw'] = np.arctan2(mean[:, 1], mean[:, 0])
            variance = np.einsum('si,sij,sj->s', across, cov, across)
            known['yaw_std'] = np.sqrt(variance) / length
        return known


CLASSES = (*REGRESSION_CLASSES, Recognition, Vote)
