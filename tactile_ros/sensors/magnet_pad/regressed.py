"""Cell, place and force of a touch by regressors and neighbours.

The cell is voted by neighbours as in [2] or follows from the place, whichever is right more often
on held-out presses. Where a stray field is met, known touches are compared by what the chips
differ in.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.estimators.pattern_ridge import PatternRidge
from tactile_ros.estimators.touch_table import TouchTable
from tactile_ros.estimators.uncertainty import CalibratedCovariance
from tactile_ros.regression import CLASSES as REGRESSION_CLASSES
from tactile_ros.regression import Recognition
from tactile_ros.regression.estimation import places_of
from tactile_ros.regression.head import Head, known_columns
from tactile_ros.sensors.magnet_pad.cells import (
    PLAN,
    SPACE,
    extent,
    nearest,
    partition,
    shares_of_cells,
)
from tactile_ros.sensors.magnet_pad.config import MagnetPadConfig
from tactile_ros.sensors.magnet_pad.nominal import uniform_response
from tactile_ros.sensors.magnet_pad.tares import Tared, TareNoise
from tactile_ros.sensors.magnet_pad.touches import KnownTouches
from tactile_ros.sensors.magnet_pad.warmth import noise_of_rest

if TYPE_CHECKING:
    from collections.abc import Mapping

    from tactile_ros.types import (
        Array,
        Bools,
        Columns,
        Estimator,
        Integers,
        Report,
        SensorConfig,
        Signals,
    )

BY_PLACE = 'nearest_centre'
FEWEST, MANY = 50, 5000
FEWEST_SESSIONS = 3
SURE = 0.8  # of another's error: what errs less needs no rival that takes long


class PadHead(Head):
    """Regressor of a target, with kernel ridge on patterns to choose from.

    Attributes
    ----------
    by_runs : bool
        Whether whole sessions are held out: then all of them are, by regressors that are quick.
    slow : bool
        Whether those that take long are tried.
    """

    by_runs = False
    slow = True

    def candidates(self) -> dict[str, Estimator]:
        """Those of `Head` for a place; for a force the one that `Head` does not try."""
        known: dict[str, Estimator] = {'pattern_ridge': PatternRidge()}
        if self.target == 'position':
            known.update(super().candidates())
        if self.by_runs or not self.slow:
            known.pop('perceptron', None)
        return known

    def rounds(self, known: Mapping[str, Estimator], rows: int) -> int | None:
        """One fold of thousands of touches is enough to judge by."""
        return 1 if 'perceptron' in known and rows > MANY else super().rounds(known, rows)


class Regressed(Tared, Recognition):
    """Regressors and neighbours of the magnet pad.

    Parameters
    ----------
    config : MagnetPadConfig
        Of the sensor.
    estimator : str or None
        Of `Recognition`.

    Attributes
    ----------
    touches_ : KnownTouches or None
        Recorded touches, for readings with a stray field.
    columns_ : tuple of int
        Coordinates by which a place belongs to the nearest cell; (): none.
    coarse_ : ndarray, shape (3,)
        Variance of places inside a cell (m2), where only cells were told.
    bar_ : float
        Error of places (m) that another method has on held-out groups.
    cell_report_ : dict of str to float
        How often the place names the right cell, as its covariance says.
    tares_ : TareNoise
        Of the fit.
    """

    touches_: KnownTouches | None

    def __init__(self, config: SensorConfig, estimator: str | None = None) -> None:
        assert isinstance(config, MagnetPadConfig)
        super().__init__(config, estimator)
        self.config = config
        self.touches_ = None
        self.bar_ = np.inf
        self.columns_: tuple[int, ...] = ()
        self.coarse_ = np.zeros(3)
        self.cell_report_: dict[str, float] = {}
        self.tares_ = TareNoise()

    @property
    def estimators(self) -> dict[str, str]:
        """Name of the estimator in use for each target."""
        names = super().estimators
        if self._cell_by_place:
            names['cell'] = BY_PLACE
        return names

    @property
    def report(self) -> Report:
        """Errors on held-out groups for each target, and how often cells are right."""
        place = {'cell_by_place': self.cell_report_} if self.cell_report_ else {}
        return {**super().report, **place, **self.tares_.warmth_.report}

    @property
    def _cell_by_place(self) -> bool:
        """Whether the cell follows from the place."""
        voted = [v.report_['held_out_accuracy'] for v in self._useful if v.target == 'cell']
        return self.cell_report_.get('expected_accuracy', -1.0) > max(voted, default=-0.5)

    def fit(self, signals: Signals, truth: Columns, groups: Columns) -> None:
        """Learn every target of which truth knows a component; see `Regression`."""
        self.forget_all()
        self.tares_.fit(signals)
        if self.estimator is not None:
            super().fit(signals, truth, groups)
            return
        super().fit(signals, {k: v for k, v in truth.items() if k != 'position'}, groups)
        placed = self._by_centres(truth, signals.good)
        if placed is not None:
            truth, self.coarse_ = {**truth, 'position': placed}, extent(self.config.cells)
        self._own_heads(signals, truth, groups)
        self._learn_touches(signals, truth, groups)
        if placed is None:
            self._learn_cells(signals, truth)

    def forget_all(self) -> None:
        """As before any fit."""
        self.heads_, self.remembering_, self.votes_, self.turn_ = (), (), (), None
        self.touches_, self.columns_, self.cell_report_ = None, (), {}
        self.coarse_ = np.zeros(3)
        vars(self).pop('_best', None)

    def answer_without(self, beaten: tuple[Head, ...]) -> None:
        """Go on without some of the regressors."""
        gone = {head.title for head in beaten}
        self.heads_ = tuple(head for head in self.heads_ if head.title not in gone)
        self.remembering_ = tuple(h for h in self.remembering_ if h.title not in gone)
        vars(self).pop('_best', None)

    def _by_centres(self, truth: Columns, good: Bools) -> Array | None:
        """Centres of the cells (s, 3) where truth told cells, and never a place."""
        cells = np.asarray(truth.get('cell', np.full(len(good), -1)), np.int64)
        told = 'position' in truth and bool(
            np.isfinite(np.asarray(truth['position'], float)).any()
        )
        voted = any(vote.target == 'cell' for vote in self._useful)
        if told or not voted or cells.max(initial=-1) >= len(self.config.cells):
            return None
        return np.where((cells >= 0)[:, None], self.config.cells[cells], np.nan)

    def _own_heads(self, signals: Signals, truth: Columns, groups: Columns) -> None:
        """Regressors of the place, and of the force where kernel ridge on patterns errs less."""
        x = signals.delta.reshape(len(signals.good), self.width)
        rests = signals.baseline.reshape(x.shape)
        session = np.asarray(groups['session'], np.int64)
        better: list[Head] = []
        y = np.asarray(truth.get('position', np.full((len(x), 3), np.nan)), np.float64)
        for columns, rows in known_columns(y, signals.good):
            told = y[rows][:, columns]
            group = apart(told, truth, groups, rows)
            place = PadHead('position', columns, None, self.width)
            place.by_runs = len(np.unique(session[rows])) >= FEWEST_SESSIONS
            place.slow = False
            better.append(place.fit(x[rows], told, group, session[rows], rests[rows]))
            if self.bar_ > SURE * place.report_['held_out_rmse'] and not place.by_runs:
                place = PadHead('position', columns, None, self.width)
                better[-1] = place.fit(x[rows], told, group, session[rows], rests[rows])
        for head in self.heads_:
            y = np.asarray(truth[head.target], np.float64)[:, list(head.columns)]
            rows = signals.good & np.isfinite(y).all(axis=1)
            rival = PadHead(head.target, head.columns, None, self.width)
            group = np.asarray(groups['group'], np.int64)[rows]
            rival.fit(x[rows], y[rows], group, session[rows], rests[rows])
            pair: tuple[Head, Head] = (head, rival)
            better.append(min(pair, key=lambda one: one.report_['held_out_rmse']))
        self.heads_ = tuple(better)
        vars(self).pop('_best', None)

    def _learn_touches(self, signals: Signals, truth: Columns, groups: Columns) -> None:
        """Remember touches, for readings with a stray field."""
        common = self.common(signals)
        heads = [h for h in self.heads_ if h.target in ('position', 'force')]
        if common is None or not heads:
            return
        count = len(signals.good)
        cells = np.asarray(truth.get('cell', np.full(count, -1)), np.int64)
        answers = np.full((count, 6), np.nan)
        rows = signals.good.copy()
        for head in heads:
            columns = np.array(head.columns) + (3 if head.target == 'force' else 0)
            answers[:, columns] = np.asarray(truth[head.target], np.float64)[:, head.columns]
            rows &= np.isfinite(answers[:, columns]).all(axis=1)
        if rows.sum() < FEWEST:
            return
        noise = noise_of_rest(signals)
        x = signals.delta.reshape(count, self.width)[rows]
        group = np.asarray(groups['group'], np.int64)[rows]
        known = KnownTouches(common, int(cells[rows].max(initial=-1)) + 1)
        self.touches_ = known.fit(x, np.nan_to_num(answers[rows]), cells[rows], group, noise)

    def _learn_cells(self, signals: Signals, truth: Columns) -> None:
        """Whether cells are the surroundings of their centres, and how often places hit them."""
        places = np.asarray(truth.get('position', np.empty((0, 3))), np.float64)
        columns = self.cell_columns(signals, truth)
        known = {i for h in self.heads_ if h.target == 'position' for i in h.columns}
        if not columns or not {*columns} <= known:
            return
        self.columns_ = columns
        rows = signals.good & np.isfinite(places[:, list(PLAN)]).all(axis=1)
        cells = np.asarray(truth.get('cell', np.full(len(places), -1)), np.int64)
        named = rows & (cells >= 0)
        cov = super().estimate(signals, self.start())['position_cov'][rows].astype(np.float64)
        at = nearest(places[rows], self.config.cells, columns)
        shares = shares_of_cells(places[rows], cov, self.config.cells, columns)
        hit = float(shares[np.arange(len(at)), at].mean())
        agrees = float((at == cells[rows])[named[rows]].mean()) if named.any() else 1.0
        self.cell_report_ = {'expected_accuracy': hit * agrees}

    def cell_columns(self, signals: Signals, truth: Columns) -> tuple[int, ...]:
        """Coordinates by which cells are the surroundings of their centres; () if by none."""
        places = np.asarray(truth.get('position', np.empty((0, 3))), np.float64)
        if not places.size:
            return ()
        rows = signals.good & np.isfinite(places[:, list(PLAN)]).all(axis=1)
        cells = np.asarray(truth.get('cell', np.full(len(places), -1)), np.int64)
        named = rows & (cells >= 0)
        if named.any():
            return partition(places[named], cells[named], self.config.cells)
        whole = rows & np.isfinite(places).all(axis=1)
        return SPACE if whole.any() else PLAN if rows.any() else ()

    def common(self, signals: Signals) -> Array | None:
        """What a uniform field adds to the features (d, 3); None: one live chip, or unasked."""
        common = uniform_response(self.config)
        live = np.nan_to_num(signals.delta[signals.good]).any(axis=(0, 2))
        common[~np.repeat(live, 3)] = 0.0
        return common if live.sum() > 1 and self.config.stray_term else None

    def estimate(self, signals: Signals, memory: object) -> Columns:
        """Targets of every row; see `Regression`."""
        known = super().estimate(signals, memory)
        self.tares_.shake(known, signals, self.heads_, self.width)
        if self.coarse_.any():
            known['position_cov'] = known['position_cov'] + np.diag(self.coarse_)
        x = signals.delta.reshape(len(signals.good), self.width)
        there = np.flatnonzero(np.isfinite(x).all(axis=1))
        if self._cell_by_place:
            self._name_cells(known)
        if self.touches_ is not None and len(there):
            self._mind_stray(known, x, there, self.touches_)
        return known

    def _name_cells(self, known: Columns) -> None:
        """Cells by place, in rows whose place is known."""
        place, cov = (np.asarray(known[k], np.float64) for k in ('position', 'position_cov'))
        rows = np.isfinite(place[:, list(self.columns_)]).all(axis=1)
        names, shares = np.full(len(place), -1), np.full(len(place), np.nan)
        if rows.any():
            each = shares_of_cells(place[rows], cov[rows], self.config.cells, self.columns_)
            names[rows] = each.argmax(axis=1)
            shares[rows] = each.max(axis=1)
        known['cell'], known['cell_probability'] = names, shares

    def _mind_stray(
        self, known: Columns, x: Array, there: Integers, touches: KnownTouches
    ) -> None:
        """Lean on what the chips differ in, where a reading is unlike any known touch."""
        strange = touches.strangeness(x[there], touches.plain_.blame(x[there]))
        stray = np.full((len(x), 3), np.nan)
        stray[there] = 0.0
        known['stray_field'] = stray
        lean, rows = strange[strange > 0], there[strange > 0]
        if not len(rows):
            return
        answer = touches.without_common(x[rows])
        stray[rows] = lean[:, None] * answer.stray
        for i, target in enumerate(('position', 'force')):
            if target in known:
                part = slice(3 * i, 3 * i + 3)
                told = np.isfinite(known[target][rows])
                _blend(known, target, rows, lean, answer.mean[:, part], answer.cov[:, part, part])
                known[target][rows] = np.where(told, known[target][rows], np.nan)
        if 'cell' in known and touches.cells:
            firm = lean >= 0.5
            chosen, shares = rows[firm], answer.shares[firm]
            known['cell'][chosen] = shares.argmax(axis=1)
            known['cell_probability'][chosen] = shares.max(axis=1)


def _blend(
    known: Columns, target: str, rows: Integers, lean: Array, mean: Array, cov: Array
) -> None:
    """Mean and covariance of a mixture, in place; `lean` (s,) is the share of the new part."""
    old, spread = (np.asarray(known[k], np.float64)[rows] for k in (target, f'{target}_cov'))
    share, apart = lean[:, None], mean - old
    known[target][rows] = old + share * apart
    between = (share * (1 - share))[:, :, None] * apart[:, :, None] * apart[:, None]
    known[f'{target}_cov'][rows] = (
        (1 - share)[:, :, None] * spread + share[:, :, None] * cov + between
    )


def apart(y: Array, truth: Columns, groups: Columns, rows: Bools) -> Integers:
    """What a split keeps together: sessions where there are several, presses, or places."""
    session = np.asarray(groups['session'], np.int64)[rows]
    if len(np.unique(session)) >= FEWEST_SESSIONS:
        return session
    places = None if 'repetition' in truth else places_of(y)
    return np.asarray(groups['group'], np.int64)[rows] if places is None else places


CLASSES = (
    *REGRESSION_CLASSES,
    PadHead,
    PatternRidge,
    KnownTouches,
    TareNoise,
    TouchTable,
    CalibratedCovariance,
    MagnetPadConfig,
)
