"""Place and force from the change of field: regressors chosen on held-out groups."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.conditioning.history import History
from tactile_ros.sensors.reskin_board.head import CLASSES as HEAD_CLASSES
from tactile_ros.sensors.reskin_board.head import ESTIMATORS, Head, known_columns

if TYPE_CHECKING:
    from tactile_ros.sensors.reskin_board.config import ReskinBoardConfig
    from tactile_ros.signals import Columns, Report, Signals
    from tactile_ros.types import Array, Integers

__all__ = ['CLASSES', 'ESTIMATORS', 'BoardEstimation']

TARGETS = ('position', 'force', 'torque')
REMEMBERING = ('force', 'torque')
TIME_CONSTANTS = (0.3, 1.0, 3.0, 10.0, 30.0)
PLACE = 1e-5


class BoardEstimation:
    """Regressors of one board, each for the components of one target that truth tells.

    Parameters
    ----------
    config : ReskinBoardConfig
        Of the board.
    estimator : str or None
        One of `ESTIMATORS`; None: the best of them on held-out groups.
    """

    def __init__(self, config: ReskinBoardConfig, estimator: str | None = None) -> None:
        self.taxels = len(config.positions)
        self.estimator = estimator
        self.heads_: tuple[Head, ...] = ()
        self.in_time_ = False

    @property
    def estimators(self) -> dict[str, str]:
        """Name of the estimator in use for each target."""
        return {head.target: head.name for head in self.heads_}

    @property
    def report(self) -> Report:
        """Errors on held-out groups for each target."""
        return {head.title: head.report_ for head in self.heads_}

    def start(self) -> History:
        """Fresh memory of a stream."""
        return History(np.array(TIME_CONSTANTS))

    def fit(self, signals: Signals, truth: Columns, groups: Columns) -> None:
        """Learn every target of which truth knows a component.

        Parameters
        ----------
        signals : Signals
            Conditioned frames.
        truth : dict of str to ndarray, shape (s, ...)
            As in a Recording.
        groups : dict of str to ndarray, shape (s,)
            'group' and 'session': what a split keeps together.
        """
        self.in_time_ = signals.stamp_ns is not None
        now, past = self._features(signals, self.start())
        heads = []
        for target in TARGETS:
            y = np.asarray(truth.get(target, np.full((len(now), 3), np.nan)), np.float64)
            for columns, rows in known_columns(y, signals.good):
                x = past if target in REMEMBERING else now
                kept = _places(y[rows][:, columns]) if target == 'position' else None
                head = Head(target, columns, self.estimator)
                heads.append(
                    head.fit(
                        x[rows],
                        y[rows][:, columns],
                        groups['group'][rows] if kept is None else kept,
                        groups['session'][rows],
                    )
                )
        self.heads_ = tuple(heads)

    def estimate(self, signals: Signals, memory: object) -> Columns:
        """Targets and covariances of every row, NaN for components that were never told.

        Parameters
        ----------
        signals : Signals
            Conditioned frames.
        memory : History
            Of the stream; moves on.

        Returns
        -------
        dict of str to ndarray, shape (s, 3) or (s, 3, 3)
            One entry and its covariance for each target.
        """
        assert isinstance(memory, History)
        now, past = self._features(signals, memory)
        known: Columns = {}
        for head in self.heads_:
            if head.target not in known:
                known[head.target] = np.full((len(now), 3), np.nan)
                known[f'{head.target}_cov'] = np.full((len(now), 3, 3), np.nan)
            x = past if head.target in REMEMBERING else now
            mean, cov = head.predict(x)
            known[head.target][:, head.columns] = mean
            known[f'{head.target}_cov'][:, np.array(head.columns)[:, None], head.columns] = cov
        return known

    def _features(self, signals: Signals, memory: History) -> tuple[Array, Array]:
        """Change of field (s, d), and with its fading means (s, d') where frames have stamps."""
        now = signals.delta.reshape(len(signals.delta), -1)
        remembers = any(head.target in REMEMBERING for head in self.heads_) or not self.heads_
        if not (self.in_time_ and remembers):
            return now, now
        if signals.stamp_ns is None:
            means = np.zeros((len(now), len(TIME_CONSTANTS), now.shape[1]))
        else:
            means = memory(now, signals.stamp_ns, signals.restart)
        return now, np.concatenate([now, means.reshape(len(now), -1)], axis=1)


def _places(plane: Array) -> Integers | None:
    """Number of the place of each row, if places were touched more than once; else None."""
    _, place = np.unique(np.round(plane / PLACE), axis=0, return_inverse=True)
    place = np.asarray(place).reshape(-1)
    return place if place.max(initial=0) + 1 <= 0.6 * len(place) else None


CLASSES = (BoardEstimation, *HEAD_CLASSES)
