"""Place, force, torque and slip from the change of readings.

Regressors of places and forces are chosen on held-out groups; slip is told by the patterns of
known pulls.
"""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.conditioning.history import History
from tactile_ros.estimators.matched_subspace import FEWEST, MatchedSubspace
from tactile_ros.regression.head import CLASSES as HEAD_CLASSES
from tactile_ros.regression.head import ESTIMATORS, Head, known_columns

if TYPE_CHECKING:
    from tactile_ros.types import Array, Bools, Columns, Integers, Report, SensorConfig, Signals

__all__ = ['CLASSES', 'ESTIMATORS', 'Regression']

TARGETS = ('position', 'force', 'torque')
REMEMBERING = ('force', 'torque')
TIME_CONSTANTS = (0.5, 2.0, 8.0, 32.0)
PAST_WEIGHT = 3.0  # relaxation is a small part of the change; its share of a distance
PLACE = 1e-5
ROUNDING = 1e-9  # of the largest reading: what moves less is a constant
EVEN_ODDS = 0.5
BLOCK = 1024  # rows whose history stays in the cache
MOST_SINGLE = 0.9  # places per touch above which touches, not places, are what repeats


class Regression:
    """Regressors of one sensor, each for the components of one target that truth tells.

    Parameters
    ----------
    config : dataclass
        Of the sensor.
    estimator : str or None
        One of `ESTIMATORS`; None: the best of them on held-out groups.
    channels : int
        Channels of a taxel.
    """

    def __init__(
        self, config: SensorConfig, estimator: str | None = None, channels: int = 3
    ) -> None:
        self.width = channels * len(config.positions)
        self.estimator = estimator
        self.heads_: tuple[Head, ...] = ()
        self.remembering_: tuple[Head, ...] = ()
        self.slip_: MatchedSubspace | None = None

    @property
    def estimators(self) -> dict[str, str]:
        """Name of the estimator in use for each target."""
        heads = self._best if self.remembering_ else self.heads_
        slip = {} if self.slip_ is None else {'slip': 'matched_subspace'}
        return {**{head.target: head.name for head in heads}, **slip}

    @property
    def report(self) -> Report:
        """Errors on held-out groups for each target."""
        plain = {head.title: head.report_ for head in self.heads_}
        past = {f'{head.title}_with_history': head.report_ for head in self.remembering_}
        slip = {} if self.slip_ is None else {'slip': self.slip_.report_}
        return {**plain, **past, **slip}

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
        now = signals.delta.reshape(-1, self.width)
        rest = signals.baseline.reshape(now.shape)
        past = None
        if signals.stamp_ns is not None:
            past = self._with_history(now, signals.stamp_ns, signals.restart, self.start())
        session = np.asarray(groups['session'], np.int64)
        heads: dict[str, tuple[Head, ...]] = {'now': (), 'past': ()}
        for target in TARGETS:
            y = np.asarray(truth.get(target, np.full((len(now), 3), np.nan)), np.float64)
            for columns, rows in known_columns(y, signals.good):
                if not _moves(signals.values[rows]):
                    continue
                told = y[rows][:, columns]
                kept = places_of(told) if target == 'position' else None
                kept = np.asarray(groups['group'][rows], np.int64) if kept is None else kept
                head = Head(target, columns, self.estimator, now.shape[1])
                heads['now'] += (head.fit(now[rows], told, kept, session[rows], rest[rows]),)
                if past is not None and target in REMEMBERING:
                    head = Head(target, columns, self.estimator, now.shape[1])
                    heads['past'] += (head.fit(past[rows], told, kept, session[rows], rest[rows]),)
        self.heads_, self.remembering_ = heads['now'], heads['past']
        self.slip_ = _slip(now, truth, groups, signals)
        vars(self).pop('_best', None)

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
        now = signals.delta.reshape(-1, self.width)
        rest = signals.baseline.reshape(now.shape)
        known: Columns = {}
        for head in self.heads_:
            if head.target not in known:
                known[head.target] = _unknown((len(now), 3))
                known[f'{head.target}_cov'] = _unknown((len(now), 3, 3))
        for i in range(0, len(now), BLOCK):
            block = slice(i, i + BLOCK)
            part = now[block]
            past = part
            if signals.stamp_ns is not None and self.remembering_:
                stamps, restart = signals.stamp_ns[block], signals.restart[block]
                past = self._with_history(part, stamps, restart, memory)
            for head in self._in_use(signals.stamp_ns is not None):
                x = past if head in self.remembering_ else part
                mean, cov = head.predict(x, rest[block])
                rows, columns = head.cells
                known[head.target][block, columns] = mean
                known[f'{head.target}_cov'][block, rows, columns] = cov
        if self.slip_ is not None:
            probability = self.slip_.predict(now)
            known['slip'] = np.where(np.isnan(probability), -1, probability > EVEN_ODDS).astype(
                np.int8
            )
            known['slip_probability'] = probability
        return known

    def _in_use(self, stamped: bool) -> tuple[Head, ...]:
        """Heads for frames; a history, which stamps give, is used where it helped."""
        return self._best if stamped else self.heads_

    @cached_property
    def _best(self) -> tuple[Head, ...]:
        """For each set of components the head whose held-out error is the smaller."""
        past = {head.title: head for head in self.remembering_}
        return tuple(
            min(head, past.get(head.title, head), key=lambda one: one.report_['held_out_rmse'])
            for head in self.heads_
        )

    @staticmethod
    def _with_history(now: Array, stamp_ns: Integers, restart: Bools, memory: History) -> Array:
        """Change of field, how far it is from its fading means, and room: (s, d + m d + 1)."""
        if len(now) == 1:
            if restart[0]:
                memory.reset()
            behind = memory.behind(now[0], int(stamp_ns[0]))[None]
        else:
            behind = now[:, None] - memory(now, stamp_ns, restart)
        shape = (len(now), 1 + behind.shape[1], now.shape[1])
        wide = np.empty((len(now), shape[1] * shape[2] + 1))
        seen = wide[:, :-1].reshape(shape)  # a view: the head fills the last column
        seen[:, 0] = now
        np.multiply(behind, PAST_WEIGHT, out=seen[:, 1:])
        return wide


def _unknown(shape: tuple[int, ...]) -> Array:
    """NaN of a shape, at half the price of np.full."""
    array = np.empty(shape)
    array.fill(np.nan)
    return array


def _moves(values: Array) -> bool:
    """Whether readings (s, t, c) are more than one constant, from which nothing is learned."""
    read = np.nan_to_num(values)
    return bool((np.ptp(read, axis=0) > ROUNDING * np.abs(read).max(initial=0.0)).any())


def _slip(now: Array, truth: Columns, groups: Columns, signals: Signals) -> MatchedSubspace | None:
    """Detector of slip; None where too few sequences tell.

    A sequence is a stretch of one stream and repetition with one label.
    """
    told = np.asarray(truth.get('slip', np.full(len(now), -1)), np.int64)
    keys = np.column_stack([told, np.asarray(groups['group'], np.int64)])
    begins = np.ones(len(now), bool)
    begins[1:] = (keys[1:] != keys[:-1]).any(axis=1)
    sequence = np.cumsum(begins if signals.begins is None else begins | signals.begins)
    rows = signals.good & (told >= 0)
    counts = [len(np.unique(sequence[rows & (told == label)])) for label in (0, 1)]
    if min(counts) < FEWEST:
        return None
    return MatchedSubspace().fit(now[rows], told[rows], sequence[rows])


def places_of(plane: Array) -> Integers | None:
    """Number of the place of each row, if places were touched more than once; else None."""
    _, place = np.unique(np.round(plane / PLACE), axis=0, return_inverse=True)
    place = np.asarray(place).reshape(-1)
    return place if place.max(initial=0) + 1 <= MOST_SINGLE * len(place) else None


CLASSES = (Regression, MatchedSubspace, *HEAD_CLASSES)
