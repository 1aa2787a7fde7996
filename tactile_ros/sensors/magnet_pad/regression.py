"""Cell, place and force of a touch by regressors and neighbours.

The cell is voted by neighbours as in [2] or follows from the place, whichever is right more often
on held-out presses. Where a stray field is met, known touches are compared by what the chips
differ in.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.conditioning.baseline import training_baseline_variance
from tactile_ros.estimators.covariance import CalibratedCovariance
from tactile_ros.estimators.gaussian_sum_table import LikelihoodWeights, TouchTable
from tactile_ros.estimators.kernel_ridge import PatternRidge
from tactile_ros.estimators.regression import group_folds
from tactile_ros.sensors.magnet_pad.body_model import uniform_response
from tactile_ros.sensors.magnet_pad.config import MagnetPadConfig
from tactile_ros.sensors.magnet_pad.temperature import Warmth, noise_of_rest
from tactile_ros.sensors.regression import CLASSES as REGRESSION_CLASSES
from tactile_ros.sensors.regression import Head, Recognition, known_columns, places_of
from tactile_ros.types import Array, Integers

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from tactile_ros.sensors.regression import Head
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

PLAN, SPACE = (0, 1), (0, 1, 2)
AGREES = 0.97
BLOCK = 512
DRAWS = 64


def _draws(width: int) -> Array:
    """Points of a unit Gaussian, shape (64, width), whose mean is 0 and covariance 1."""
    half = np.random.default_rng(5).normal(size=(DRAWS // 2, width))
    points = np.concatenate([half, -half])
    spread = np.linalg.cholesky(points.T @ points / len(points))
    return np.asarray(np.linalg.solve(spread, points.T).T)


POINTS = {len(columns): _draws(len(columns)) for columns in (PLAN, SPACE)}


def nearest(places: Array, cells: Array, columns: tuple[int, ...]) -> Integers:
    """Number (s,) of the cell (n, 3) nearest to places (s, 3), by some coordinates.

    Examples
    --------
    >>> nearest(np.array([[0.1, 0, 9.0]]), np.array([[1.0, 0, 0], [0, 0, 0]]), (0, 1)).tolist()
    [1]
    """
    index = list(columns)
    centre = cells[:, index] - cells[:, index].mean(axis=0)
    at = places[:, index] - cells[:, index].mean(axis=0)
    return np.asarray((at @ centre.T - 0.5 * (centre**2).sum(axis=1)).argmax(axis=1))


def extent(cells: Array) -> Array:
    """Variance (3,) of places inside a cell along each axis (m2), by the gaps of centres (n, 3).

    Examples
    --------
    >>> (1e6 * extent(np.array([[0.0, 0, 0], [6e-3, 0, 0]]))).round(3)
    array([3., 0., 0.])
    """
    steps = [max(len(np.unique(np.round(axis, 6))) - 1, 1) for axis in cells.T]
    return np.asarray((np.ptp(cells, axis=0) / steps) ** 2 / 12)


def partition(places: Array, told: Integers, cells: Array) -> tuple[int, ...]:
    """Coordinates by which the nearest centre is the cell that truth told; () if by none.

    Parameters
    ----------
    places : ndarray, shape (s, 3)
        True places (m); the height may be NaN.
    told : ndarray of int, shape (s,)
        True cells.
    cells : ndarray, shape (n, 3)
        Centres (m).
    """
    share = {}
    for columns in (SPACE, PLAN):
        known = np.isfinite(places[:, list(columns)]).all(axis=1)
        if known.any():
            right = nearest(places[known], cells, columns) == told[known]
            share[columns] = float(right.mean())
    best = max(share, key=lambda c: share[c], default=())
    return best if best and share[best] >= AGREES else ()


def shares_of_cells(places: Array, cov: Array, cells: Array, columns: tuple[int, ...]) -> Array:
    """Probability (s, n) of each cell, for Gaussian places.

    Parameters
    ----------
    places, cov : ndarray, shape (s, 3) and (s, 3, 3)
        Mean (m) and covariance (m2); finite in `columns`.
    cells : ndarray, shape (n, 3)
        Centres (m).
    columns : tuple of int
        Coordinates by which the nearest centre counts.

    Returns
    -------
    ndarray, shape (s, n)
        Shares of 64 points spread like the place, and half a point for the cell of its mean.
    """
    index = np.array(columns)
    inner = cov[:, index[:, None], index]
    size = np.trace(inner, axis1=1, axis2=2)[:, None, None]
    root = np.linalg.cholesky(inner + (1e-9 * size + 1e-18) * np.eye(len(index)))
    shares = np.empty((len(places), len(cells)))
    for i in range(0, len(places), BLOCK):
        part = slice(i, i + BLOCK)
        spread = np.einsum('sij,pj->spi', root[part], POINTS[len(index)])
        at = np.full((*spread.shape[:2], 3), np.nan)
        at[..., index] = places[part][:, None, index] + spread
        hit = nearest(at.reshape(-1, 3), cells, columns).reshape(-1, DRAWS)
        row = np.arange(len(hit))[:, None] * len(cells)
        count = np.bincount((row + hit).ravel(), minlength=len(hit) * len(cells))
        shares[part] = count.reshape(len(hit), len(cells))
        own = nearest(places[part], cells, columns)
        shares[part][np.arange(len(hit)), own] += 0.5
    return shares / (DRAWS + 0.5)


TARES_MANY = 30  # frames of a tare whose noise regressors need not mind


class TareNoise:
    """Of the tares of a fit, beside those in use.

    Attributes
    ----------
    noise_, doubt_ : float
        Of a channel (T); variance that baselines left in what was learned, over that of a frame.
    warmth_ : Warmth
        How they change with the temperature.
    """

    noise_ = 0.0
    doubt_ = 0.0

    def __init__(self) -> None:
        self.warmth_ = Warmth()

    def fit(self, signals: Signals) -> TareNoise:
        """Learn from conditioned frames."""
        good = signals.good
        self.noise_ = noise_of_rest(signals)
        doubt = None if signals.baseline_variance is None else signals.baseline_variance[good]
        self.doubt_ = training_baseline_variance(signals.baseline[good], doubt)
        return self

    def doubt(self, signals: Signals) -> Array:
        """Variance (s,) of the baseline over a frame's: in use and in the fit; 0 for its own."""
        own = signals.baseline_variance
        own = np.zeros(len(signals.good)) if own is None else own
        return np.asarray(np.where(own > 0, own + self.doubt_, 0.0))

    def shake(self, known: Columns, signals: Signals, heads: Sequence[Head], width: int) -> None:
        """Add to covariances what errors of the baseline do to regressors, in place.

        By differences of their answers to readings (s, width) that are wrong by the noise of few
        frames, a channel after the other, and by a temperature that is not well known.
        """
        if not heads:
            return
        doubt, (warm, by) = self.doubt(signals), self.warmth_.unsure(signals, self.noise_)
        rows = np.flatnonzero(doubt > 1 / TARES_MANY) if self.noise_ else np.zeros(0, np.int64)
        x, rest = (part.reshape(-1, width) for part in (signals.delta, signals.baseline))
        steps = self.noise_ * np.eye(width)
        for head in heads:
            if len(rows):
                few = [_moved(head, x[rows], rest[rows], step) for step in steps]
                _add(known, head, rows, np.sqrt(doubt[rows])[:, None] * np.stack(few))
            if len(warm):
                _add(known, head, warm, _moved(head, x[warm], rest[warm], by)[None])

    def warm(
        self, known: Columns, signals: Signals, x: Array,
        answer: Callable[[Array, Integers], Columns],
    ) -> None:  # fmt: skip
        """Add to covariances what a temperature that is not well known does to models, in place.

        `answer` gives places and forces, those that the models tell, of readings (r, d) like those
        of some rows (r,) of x (s, d).
        """
        rows, by = self.warmth_.unsure(signals, self.noise_)
        other = answer(x[rows] + by, rows) if len(rows) else {}
        for target in ('position', 'force'):
            if target in other:
                level = np.asarray(known[target], np.float64)[rows]
                moved = np.nan_to_num(np.asarray(other[target], np.float64) - level)
                cov = np.array(known[f'{target}_cov'], np.float64)
                cov[rows] += moved[:, :, None] * moved[:, None]
                known[f'{target}_cov'] = cov


class Tared:
    """What an estimation says of its baselines."""

    tares_: TareNoise  # of the fit

    uses_temperature = True

    def thermal_drift(
        self, baseline: Array, reference_c: Array, temperature_c: Array | None
    ) -> Array:
        """Change of baselines with the temperature of the chips."""
        return self.tares_.warmth_.change(baseline, reference_c, temperature_c)

    def begin_fit(self) -> None:
        """Before a fit: it begins with magnets of neodymium, whatever was learned before."""
        self.tares_.warmth_ = Warmth()


def _moved(head: Head, x: Array, rest: Array, by: Array) -> Array:
    """What answers (s, y) to readings (s, d) move by, where these are others by `by`."""
    return np.asarray(head.predict(x + by, rest)[0] - head.predict(x, rest)[0])


def _add(known: Columns, head: Head, rows: Integers, moved: Array) -> None:
    """Add to the covariances of some rows what answers move by, (k, r, y), in place."""
    first, second = head.cells
    cov = np.array(known[f'{head.target}_cov'], np.float64)
    added = np.zeros((len(rows), *cov.shape[1:]))
    added[:, first, second] = np.einsum('kri,krj->rij', moved, moved)
    cov[rows] += added
    known[f'{head.target}_cov'] = cov


STRAY = 0.3e-3  # T, of one component of stray fields that are met: earth turned, motors, magnets
UNLIKE = 0.995  # share of held-out touches that count as known
MARGIN, RISE = 1.2, 0.5
MISFIT = 0.12  # of its size, by which a touch may be unlike all others without a stray field
WEAK = 30e-6  # T, a tenth of such fields: below it a misfit is as likely
MOST = 12_000
TINY = 1e-12


@dataclass(frozen=True)
class Answer:
    """What known touches say about readings."""

    # (s, k) and (s, k, k) of the answers of the table
    mean: Array
    cov: Array
    shares: Array  # (s, n) of the cells
    stray: Array  # (s, q) common part that the touch does not explain (T)


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
    covariances_ : tuple of CalibratedCovariance
        Of the answers under a stray field, three components each.
    """

    # without and with a stray field
    plain_: TouchTable
    blind_: TouchTable
    # (n, d) and (n, k) changes of field (T) and what truth told of the touches
    x_: Array
    answers_: Array
    cells_: Integers  # (n,) their cells; -1 unknown
    limit_: float  # how strange known touches are, at most
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

    def strangeness(self, x: Array, blame: LikelihoodWeights) -> Array:
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
    def _drivers(blame: LikelihoodWeights, answers: Array, mean: Array) -> tuple[Array, Array]:
        """Covariance among the neighbours, and what the error depends on: (s, k / 3, 2)."""
        cov = blame.covariance(answers, mean)
        spread = np.diagonal(cov, axis1=1, axis2=2).reshape(len(cov), -1, 3).sum(axis=2)
        drivers = np.empty((*spread.shape, 2))
        drivers[..., 0] = 0.5 * np.log(spread + TINY)
        drivers[..., 1] = np.log(blame.distance + TINY)[:, None]
        return cov, drivers


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


class PadRegression(Tared, Recognition):
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
