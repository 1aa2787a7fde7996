"""Cell, place and force of a touch: the fitted response of the pad, regressors and neighbours.

Where truth tells places and forces, they are found by Gauss-Newton on the tabulated response of
the pad (`inversion`) or by regressors (`regressed`), whichever errs less on held-out presses.
Before any truth is told, touches of the nominal model take the place of recorded ones.
"""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.conditioning.fading_memory import FadingMemory
from tactile_ros.estimators.covariance import SigmaCalibration
from tactile_ros.physics.fidelity import Choice, Rated, Worth
from tactile_ros.sensors.magnet_pad.body_model import PadResponse, nominal_choice, terms
from tactile_ros.sensors.magnet_pad.covariance import (
    CoverageCovariance,
    LoadExtrapolation,
    TrainingCoverage,
    flag,
    span_of,
    untold,
)
from tactile_ros.sensors.magnet_pad.inversion import PadInversion, Touched
from tactile_ros.sensors.magnet_pad.nominal_estimator import (
    NominalEstimator,
    SubthresholdForce,
    TouchPosterior,
    truth_of_touches,
)
from tactile_ros.sensors.magnet_pad.regression import CLASSES as REGRESSED_CLASSES
from tactile_ros.sensors.magnet_pad.regression import (
    FEWEST,
    SPACE,
    PadRegression,
    TareNoise,
    apart,
)
from tactile_ros.sensors.magnet_pad.temperature import Warmth, noise_of_rest
from tactile_ros.sensors.regression import ESTIMATORS as REGRESSORS
from tactile_ros.sensors.regression import VOTER

if TYPE_CHECKING:
    import numpy.typing as npt

    from tactile_ros.types import Array, Bools, Columns, Integers, Report, SensorConfig, Signals

NOMINAL = 'nominal'
TABLE = 'table_gauss_newton'
ESTIMATORS = (*REGRESSORS, TABLE, NOMINAL)
TOLD = ('position', 'force', 'cell', 'torque', 'label', 'yaw')
OFF_SURFACE = 0.1  # of the radius: contacts that lie farther off are of another body
MOST_OFF = 0.05


class Localisation(PadRegression):
    """Estimation of the magnet pad.

    Parameters
    ----------
    config : MagnetPadConfig
        Of the sensor.
    estimator : str or None
        One of `ESTIMATORS`; None: chosen in `fit`.

    Attributes
    ----------
    inversion_ : PadInversion or None
        By the response of the pad.
    inverted_ : tuple of str
        Targets that it answers; 'force' alone where stamps give regressors no history.
    nominal_ : bool
        Whether the nominal model speaks.
    doubts_ : CoverageCovariance
        What recorded touches leave open.
    terms_ : tuple of Worth
        What terms of the scene cost and buy.
    """

    inversion_: PadInversion | None

    def __init__(self, config: SensorConfig, estimator: str | None = None) -> None:
        super().__init__(config, None if estimator == TABLE else estimator)
        self.wanted = estimator
        self.inversion_ = None
        self.inverted_: tuple[str, ...] = ()
        self.beaten_: dict[str, dict[str, float]] = {}
        self.nominal_ = estimator in (None, NOMINAL)
        self.doubts_ = CoverageCovariance(self.config)
        self.terms_: tuple[Worth, ...] = ()

    @property
    def estimators(self) -> dict[str, str]:
        """Name of the estimator in use for each target."""
        if self.nominal_:
            return dict.fromkeys(('position', 'force', 'cell'), NOMINAL)
        return {**super().estimators, **dict.fromkeys(self.inverted_, TABLE)}

    @property
    def report(self) -> Report:
        """Errors on held-out groups for each target, and what was found of the pad."""
        if self.nominal_:
            return {**super().report, **self._nominal_choice.report, **self.doubts_.scene}
        found = {**self.beaten_, **self.doubts_.report, **self.doubts_.scene}
        if self.inversion_ is None:
            return {**super().report, **found}
        response = self.inversion_.response_
        found |= {'pad': response.report, **response.choice_.report}
        found |= untold(self.config, self.inversion_.touches_)
        for term in self.terms_:
            found |= term.report
        return {**super().report, **found}

    def fit(self, signals: Signals, truth: Columns, groups: Columns) -> None:
        """Learn every target of which truth knows a component; see `Regression`."""
        self.inversion_, self.inverted_, self.beaten_ = None, (), {}
        self.tares_, truth = TareNoise(), truth_of_touches(truth)
        signals = self.tares_.warmth_.fit(signals)
        x = signals.delta.reshape(len(signals.good), self.width)
        noise = noise_of_rest(signals)
        self.doubts_ = CoverageCovariance(self.config).fit(signals, x, truth, noise)
        told = any(_told(truth[k])[signals.good].any() for k in TOLD if k in truth)
        self.nominal_ = self.wanted == NOMINAL or (self.wanted is None and not told)
        self.tares_.fit(signals)
        if self.nominal_:
            self.forget_all()
            _ = self._pad  # now, not when the first frame waits
            return
        if self.wanted in (None, TABLE):
            known = self.inversion_ = self._inverted(signals, truth, groups)
            place = np.inf if known is None else known.report_['position']['held_out_rmse']
            self.bar_ = place
        if self.wanted == TABLE:
            self.forget_all()
        else:
            super().fit(signals, truth, groups)
        for name in ('_centres', '_span'):
            vars(self).pop(name, None)
        if self.inversion_ is not None:
            self.terms_ = terms(self.config, self.inversion_.noise)
            self._choose(self.inversion_, self.cell_columns(signals, truth))

    def _inverted(self, signals: Signals, truth: Columns, groups: Columns) -> PadInversion | None:
        """By the response of the pad, where truth tells places and forces on its surface."""
        blank = np.full((len(signals.good), 3), np.nan)
        place, force = (np.asarray(truth.get(k, blank), np.float64) for k in ('position', 'force'))
        rows = signals.good & np.isfinite(place).all(axis=1) & np.isfinite(force).all(axis=1)
        x = signals.delta.reshape(len(rows), self.width)
        live = np.asarray(np.abs(x[rows]).max(axis=0, initial=0.0) > 0)
        if rows.sum() < FEWEST or live.sum() < 3 or not self._on_surface(place[rows], force[rows]):
            return None
        common = self.common(signals)
        common = None if common is None else common[live]
        known = PadInversion(self.config, live, common, noise_of_rest(signals))
        group = apart(place[rows], truth, groups, rows)
        columns = self.cell_columns(signals, truth)
        cells = np.asarray(truth.get('cell', np.full(len(rows), -1)), np.int64)[rows]
        touched = Touched(x[rows][:, live], place[rows], force[rows], group, cells)
        return known.fit(touched, self._centred(columns))

    def _on_surface(self, place: Array, force: Array) -> bool:
        """Whether contacts (s, 3) lie on a half cylinder about the axis, pressed inward."""
        radius = np.hypot(place[:, 1], place[:, 2])
        off = np.abs(radius / max(float(np.median(radius)), 1e-9) - 1) > OFF_SURFACE
        off |= np.abs(place[:, 0]) > 0.55 * self.config.length
        off |= (place[:, 1:] * force[:, 1:]).sum(axis=1) <= 0
        near = 0.5 < float(np.median(radius)) / self.config.radius < 2.0
        return near and float(off.mean()) <= MOST_OFF

    def _choose(self, inversion: PadInversion, columns: tuple[int, ...]) -> None:
        """Drop regressors that err more than the response of the pad; keep their errors."""
        held = inversion.report_
        for target in ('position', 'force'):
            rivals = tuple(head for head in self.heads_ if head.target == target)
            least = min((h.report_['held_out_rmse'] for h in rivals), default=np.inf)
            own = held[target]['held_out_rmse']
            if self.wanted != TABLE and own > least and self.doubts_.coverage_.enough:
                continue
            self.inverted_ += (target,)
            for head in rivals:
                lost = {k: v for k, v in head.report_.items() if k.startswith('rmse_')}
                self.beaten_[head.title] = {**lost, f'rmse_{TABLE}': own, **held[target]}
            past = [h.report_['held_out_rmse'] for h in self.remembering_ if h.target == target]
            if min(past, default=np.inf) >= own:
                self.answer_without(rivals)
        if 'position' in self.inverted_:
            self.touches_ = None
            self._choose_cells(held.get('cell', {}), columns)

    def _choose_cells(self, held: dict[str, float], columns: tuple[int, ...]) -> None:
        """Drop the vote for cells where places by the response name them as often."""
        votes = [vote for vote in self.votes_ if vote.target == 'cell']
        least = max((vote.report_['held_out_accuracy'] for vote in votes), default=0.0)
        own = held.get('held_out_accuracy', 1.0)
        if not columns or own < least:
            return
        self.columns_, self.cell_report_ = columns, {}
        self.inverted_ += ('cell',)
        self.votes_ = tuple(vote for vote in self.votes_ if vote.target != 'cell')
        lost = {f'accuracy_{VOTER}': least} if votes else {}
        self.beaten_['cell'] = {**lost, **held}

    def estimate(self, signals: Signals, memory: object) -> Columns:
        """Targets of every row; see `Regression`."""
        x = signals.delta.reshape(len(signals.good), self.width)
        if self.nominal_:
            assert isinstance(memory, FadingMemory)
            rest = signals.in_contact == 0
            known = self._pad.estimate(x, rest, self.tares_.doubt(signals))
            self.tares_.warm(known, signals, x, lambda y, rows: self._pad.estimate(y, rest[rows]))
            flag(known, signals.in_contact != 0, None, self.config.length)
            return self.doubts_.mark(known, signals)
        known = super().estimate(signals, memory)
        if self.inverted_:
            self._add_inverted(known, signals, x)
            self.tares_.warm(known, signals, x, lambda y, _: self._inverse(signals, y))
        self.doubts_.widen(known, signals.in_contact == 0, x, self.inverted_, self._hidden)
        flag(known, signals.in_contact != 0, self._span, self.config.length)
        return self.doubts_.mark(known, signals)

    def _hidden(self, x: Array) -> Array:
        """Covariance (s, 3, 3) (N2) of saying that nothing touches, of readings (s, c)."""
        if 'force' in self.inverted_ and self.inversion_ is not None:
            return self.inversion_.telling.hidden(self.inversion_.alive(x))
        assert self.doubts_.subthreshold_ is not None
        return self.doubts_.subthreshold_(x)

    def contact_from_sensor(self, signals: Signals) -> npt.NDArray[np.int8]:
        """What touches (s,): a uniform field that came after the tare does not."""
        known, telling = signals.in_contact, self._telling
        if telling is None or telling.part is None:
            return known
        rows = known == 1
        if not np.count_nonzero(rows):
            return known
        x = signals.delta.reshape(len(known), self.width)[rows]
        x = x if self.nominal_ or self.inversion_ is None else self.inversion_.alive(x)
        touching = telling.touching(x)
        if np.count_nonzero(touching) == len(x):
            return known
        changed = known.copy()
        changed[rows] = touching
        return changed

    @property
    def _telling(self) -> TouchPosterior | None:
        """What tells touches from an outside field; None where nothing can."""
        if self.nominal_:
            return self._pad.telling
        answers = self.inversion_ is not None and 'position' in self.inverted_
        return self.inversion_.telling if answers and self.inversion_ is not None else None

    def _add_inverted(self, known: Columns, signals: Signals, x: Array) -> None:
        """Targets by the response of the pad."""
        inversion = self.inversion_
        assert inversion is not None
        there = np.asarray(np.isfinite(x).all(axis=1))
        every = np.count_nonzero(there) == len(there)
        doubt = self.tares_.doubt(signals)
        told = inversion.invert(
            x if every else x[there], self._centres, doubt if every else doubt[there]
        )
        parts: dict[str, Array | Integers] = {
            'position': told.mean[:, :3], 'position_cov': told.cov[:, :3, :3],
            'force': told.mean[:, 3:], 'force_cov': told.cov[:, 3:, 3:],
        }  # fmt: skip
        if self._remembers(signals):
            del parts['force'], parts['force_cov']
        if 'position' in self.inverted_:
            parts['odd'] = told.odd.astype(np.int64)
        if 'cell' in self.inverted_:
            parts['cell'] = np.asarray(told.shares.argmax(axis=1), dtype=np.int64)
            parts['cell_probability'] = told.shares.max(axis=1)
        if 'position' in self.inverted_ and inversion.common is not None:
            rest = signals.in_contact == 0
            if np.count_nonzero(rest):
                rest = rest if every else rest[there]
                seen = inversion.alive(x if every else x[there])
                told.stray[rest] = inversion.telling.resting_field(seen[rest])
            parts['stray_field'] = told.stray
        for name, column in parts.items():
            if name.split('_')[0] in self.inverted_ or name in ('stray_field', 'odd'):
                known[name] = column if every else _filled(column, there)

    def _inverse(self, signals: Signals, x: Array) -> Columns:
        """What the response of the pad answers to readings x (s, c) as these signals are."""
        assert self.inversion_ is not None
        mean = self.inversion_.telling(self.inversion_.alive(x), self._centres).mean
        answers: Columns = {'position': mean[:, :3], 'force': mean[:, 3:]}
        gone = ('force',) if self._remembers(signals) else ()
        return {k: answers[k] for k in answers if k in self.inverted_ and k not in gone}

    def _remembers(self, signals: Signals) -> bool:
        """Whether a history, which stamps give, tells the force better."""
        timed = signals.stamp_ns is not None
        return timed and any(head.target == 'force' for head in self.remembering_)

    @cached_property
    def _span(self) -> tuple[float, float] | None:
        """Least and largest recorded force (N), where the response of the pad tells forces."""
        known = self.inversion_ if 'force' in self.inverted_ else None
        return None if known is None else span_of(known.touches_)

    @cached_property
    def _centres(self) -> Array:
        return self._centred(self.columns_)

    def _centred(self, columns: tuple[int, ...]) -> Array:
        """Centres of cells (n, 3) (m) in the coordinates that count, 0 in the others."""
        centres = np.zeros_like(self.config.cells)
        index = list(columns or SPACE)
        centres[:, index] = self.config.cells[:, index]
        return centres

    @cached_property
    def _nominal_choice(self) -> Choice:
        return nominal_choice(self.config)

    @cached_property
    def _pad(self) -> NominalEstimator:
        """Touches of the nominal model: computed once they are asked for."""
        return NominalEstimator(self.config)


def _filled(column: npt.NDArray[np.generic], there: Bools) -> npt.NDArray[np.generic]:
    """A column of some rows (s,) for all of them, NaN or -1 in the others."""
    blank = np.nan if column.dtype.kind == 'f' else -1
    wide = np.full((len(there), *column.shape[1:]), blank, column.dtype)
    wide[there] = column
    return wide


def _told(column: npt.NDArray[np.generic]) -> Bools:
    """Whether truth tells anything of each row."""
    known = np.isfinite(column) if column.dtype.kind == 'f' else column != -1
    return np.asarray(known.any(axis=tuple(range(1, known.ndim))))


CLASSES = (
    *REGRESSED_CLASSES,
    Localisation,
    PadInversion,
    PadResponse,
    LoadExtrapolation,
    CoverageCovariance,
    SubthresholdForce,
    TrainingCoverage,
    Warmth,
    SigmaCalibration,
    Choice,
    Rated,
    Worth,
)
