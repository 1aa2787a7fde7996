# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Cell, place and force of a touch: inversion of the pad's response, regressors, neighbours.

Where truth has places and forces, the pad is fitted to the recording (`inversion`), unless the
neighbours of [2] err less on held-out groups. Without truth the config's pad answers. Everything
else is regressed. What the temperature of the magnets changes at rest is taken off first.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from tactile_ros.conditioning.baseline import training_baseline_variance
from tactile_ros.estimators.covariance import CovarianceModel, widened
from tactile_ros.estimators.grid_knn import GridKnn
from tactile_ros.physics.temperature import REMANENCE_SLOPE, plausible_temperature
from tactile_ros.sensors.magnet_pad.body_model import (
    NOISE,
    STRAY,
    PadResponse,
    terms,
    touches_at,
    uniform_response,
)
from tactile_ros.sensors.magnet_pad.config import MagnetPadConfig
from tactile_ros.sensors.magnet_pad.inversion import SIGMAS, TABLE, PadInversion
from tactile_ros.sensors.regression import CLASSES as REGRESSION_CLASSES
from tactile_ros.sensors.regression import ESTIMATORS as REGRESSORS
from tactile_ros.sensors.regression import Regression, places_of, scatter_rows
from tactile_ros.types import (
    Array,
    Bools,
    Columns,
    FrameStatus,
    Integers,
    Report,
    SensorConfig,
    Signals,
)

NOMINAL = 'nominal'
ESTIMATORS = (*REGRESSORS, TABLE, NOMINAL)
FEWEST, FEWEST_SESSIONS = 50, 3
UPRIGHT = 0.1  # sigma of a force along the axis, over the force, where none leaned
FAR = 1.5  # times the distance of known readings, from which a stray field is thought of
MARGIN = 1.1  # times the recorded forces: beyond them by chance
FIELDS = 3.0  # times the usual, of a component of a stray field
POINTS = np.random.default_rng(5).normal(size=(64, 2))
OUT_OF_RANGE, STRAY_FIELD = int(FrameStatus.OUT_OF_RANGE), int(FrameStatus.STRAY_FIELD)
NOTHING = 0.5  # of the spread of places over the pad: an uncertain place is not valid
# sigma of the slope: two of them hold magnets that stay cold beside warm chips, and ferrite
SLOPE_SIGMA, LEAST_SIGMA = 0.5, 0.05  # of the slope, before and after any recording
SMALL = 0.3  # of the noise of a channel, in all channels together
TINY = 1e-18  # T2, far below the noise of any chip
WARMER = 3.0  # degrees beyond those of the fit, from which frames are out of range


class ThermalDrift:
    """Change of the field at rest with the temperature of the magnets since the tare.

    The resting field is hundreds of times what a light touch changes: a few degrees between tare
    and touch pass for a load. Chips measure their own temperature, which the magnets follow in
    part.
    """

    def __init__(self) -> None:
        # change of the resting field with a degree, over itself (1 / degree), and its sigma
        self.slope_, self.sigma_ = REMANENCE_SLOPE, SLOPE_SIGMA * abs(REMANENCE_SLOPE)
        self.span_ = np.full(2, np.nan)  # least and highest temperature of a chip in the fit
        self.fitted_ = False

    @property
    def report(self) -> Report:
        """Slope, and temperatures of the recording."""
        if not self.fitted_:
            return {}
        if not np.isfinite(self.span_).all():
            return {'not learned: temperature (no chip measured one)': {}}
        ends = {'least': float(self.span_[0]), 'most': float(self.span_[1])}
        return {
            'found: change of the field at rest': {
                'per degree': self.slope_, 'sigma': self.sigma_,
            },
            'not learned: temperatures beyond those recorded (C)': ends,
        }  # fmt: skip

    def fit(self, signals: Signals) -> ThermalDrift:
        """Learn from what rests at other temperatures than its tare.

        Ridge regression towards magnets of neodymium; however many frames, a tare counts once.
        """
        then_c, now_c, self.fitted_ = signals.rest_temperature_c, signals.temperature_c, True
        if then_c is None or now_c is None:
            return self
        measured = now_c[signals.good]
        if np.isfinite(measured).any():
            self.span_ = np.array([np.nanmin(measured), np.nanmax(measured)])
        rest = signals.good & (signals.in_contact == 0)
        base, change = signals.baseline[rest], (signals.values - signals.baseline)[rest]
        lever = base * self.rise(then_c[rest], now_c[rest])[:, None, None]
        known = np.isfinite(lever) & np.isfinite(change)
        lever, change = np.where(known, lever, 0.0), np.where(known, change, 0.0)
        size, along = float(np.square(lever).sum()), float((lever * change).sum())
        if size:
            left = max(float(np.square(change).sum()) - along**2 / size, 0.0) / known.sum()
            tares = len(np.unique(base.reshape(len(base), -1), axis=0))
            prior, weight = self.sigma_**-2, tares / (len(base) * (left + TINY))
            information = prior + weight * size
            self.slope_ = (prior * self.slope_ + weight * along) / information
            self.sigma_ = max(information**-0.5, LEAST_SIGMA * abs(REMANENCE_SLOPE))
        return self

    def corrected(self, signals: Signals) -> Signals:
        """Frames less the change of their baselines."""
        then_c, now_c = signals.rest_temperature_c, signals.temperature_c
        if then_c is None or now_c is None:
            return signals
        drift = self.change(signals.baseline, then_c, now_c)
        return replace(signals, delta=signals.values - signals.baseline - drift)

    def rise(self, then_c: Array, now_c: Array) -> Array:
        """Degrees (s,) by which chips (s, t) are warmer than at the tare; 0 where none measured.

        Implausible temperatures are left out.
        """
        apart = plausible_temperature(now_c) - then_c
        known = np.isfinite(apart)
        rise = np.where(known, apart, 0.0).sum(axis=1) / np.maximum(known.sum(axis=1), 1)
        return np.asarray(rise)

    def change(self, base: Array, then_c: Array, now_c: Array | None) -> Array:
        """Change (s, t, c) of baselines (s, t, c) (T) since chips measured `then_c` (s, t)."""
        if now_c is None:
            return np.zeros_like(base)
        return np.asarray(base * (self.slope_ * self.rise(then_c, now_c))[:, None, None])

    def uncertainty(self, signals: Signals, noise: float) -> tuple[Integers, Array]:
        """Finite rows (r,) that the slope's sigma moves by more than a part of `noise` (T).

        And by how much (r, c) (T), in all channels together.
        """
        then_c, now_c = signals.rest_temperature_c, signals.temperature_c
        level = signals.baseline.reshape(len(signals.good), -1)
        if then_c is None or now_c is None:
            return np.zeros(0, np.int64), level[:0]
        by = self.sigma_ * self.rise(then_c, now_c)
        rows = np.flatnonzero(by * by * (level * level).sum(axis=1) > (SMALL * noise) ** 2)
        rows = rows[np.isfinite(signals.delta[rows]).all(axis=(1, 2))]
        return rows, by[rows, None] * level[rows]

    def out_of_range(self, signals: Signals) -> Bools:
        """Rows (s,) of which a chip is clearly warmer or colder than in the fit."""
        chips = signals.temperature_c
        if chips is None or not np.isfinite(self.span_).all():
            return np.zeros(len(signals.good), bool)
        low, high = self.span_
        return np.asarray(((chips < low - WARMER) | (chips > high + WARMER)).any(axis=1))


class Localisation(Regression):
    """Estimation of the magnet pad by one of `ESTIMATORS`; None: chosen in `fit`."""

    uses_temperature = True

    def __init__(self, config: SensorConfig, estimator: str | None = None) -> None:
        assert isinstance(config, MagnetPadConfig)
        super().__init__(config, estimator if estimator in REGRESSORS else None)
        self.config, self.wanted = config, estimator
        # places are centres of cells, since truth has no others; cells are seen from above
        self.centred_ = self.flat_ = False
        self.drift_, self.tare_variance_, self.noise_ = ThermalDrift(), 0.0, 0.0
        self.inversion_: PadInversion | None
        self.inverted_: tuple[str, ...]
        self.terms_: Report
        self._begin()
        if estimator not in (None, NOMINAL):
            self.inversion_, self.inverted_ = None, ()

    def _begin(self) -> None:
        """Let the config's pad answer, and forget regressors."""
        self.heads_, self.remembering_, self.votes_, self.turn_ = (), (), (), None
        self.slip_, self.centred_, self.terms_ = None, False, {}
        self.known_, self.named_ = np.zeros((0, self.width)), np.zeros(0, np.int64)
        for name in ('_best', '_voters'):
            vars(self).pop(name, None)
        noise = NOISE if self.config.noise is None else float(np.max(self.config.noise))
        self.inversion_ = PadInversion(self.config, np.ones(self.width, bool), noise)
        self.inverted_ = ('position', 'force', 'cell')

    @property
    def nominal_(self) -> bool:
        """The config's pad answers."""
        return self.inversion_ is not None and self.inversion_.response_ is None

    @property
    def estimators(self) -> dict[str, str]:
        """Name of the estimator in use for each target."""
        name = NOMINAL if self.nominal_ else TABLE
        known = {**super().estimators, **dict.fromkeys(self.inverted_, name)}
        return {**known, 'cell': 'nearest_centre'} if self._names_cells(known) else known

    def _names_cells(self, known: Columns | dict[str, str]) -> bool:
        """Decide whether places name the cells, since nothing else does."""
        free = self.wanted is None and not self.centred_
        return free and 'position' in known and 'cell' not in known

    @property
    def report(self) -> Report:
        """Errors on held-out groups, the specimen, and terms of the scene."""
        found = {**super().report, **self.drift_.report}
        if self.inversion_ is None:
            return found
        response, span = self.inversion_.response_, self.inversion_.span_
        found |= self.inversion_.report_
        if response is None:
            return found
        found |= {'pad': response.report, **response.choice_}
        ends = {'least': float(span[0]), 'most': float(span[1])}
        found['not learned: loads beyond those recorded (N)'] = ends
        return found | self.terms_

    def begin_fit(self) -> None:
        """Begin with magnets of neodymium, whatever was learned before."""
        self.drift_ = ThermalDrift()

    def thermal_drift(
        self, baseline: Array, reference_c: Array, temperature_c: Array | None
    ) -> Array:
        """Change of baselines with the temperature of the chips."""
        return self.drift_.change(baseline, reference_c, temperature_c)

    def fit(self, signals: Signals, truth: Columns, groups: Columns) -> None:
        """Learn every target of which truth has a component; see `Regression`."""
        signals, truth = self.drift_.fit(signals).corrected(signals), _touched_only(truth)
        rest = signals.delta[signals.good & (signals.in_contact == 0)]
        self.noise_ = float(np.sqrt((rest**2).mean())) if len(rest) else 0.0
        good, variance = signals.good, signals.baseline_variance
        self.tare_variance_ = training_baseline_variance(
            signals.baseline[good], None if variance is None else variance[good]
        )
        named = [k for k in ('position', 'force', 'cell', 'torque', 'label', 'yaw') if k in truth]
        stated = any(_measured(truth[k])[good].any() for k in named)
        self._begin()
        if self.wanted == NOMINAL or (self.wanted is None and not stated):
            return
        inversion: PadInversion | None = None
        answered: tuple[str, ...] = ()
        if self.wanted in (None, TABLE):
            inversion = self._inverted(signals, truth, groups)
        if inversion is not None:
            report = inversion.report_
            answered = tuple(
                k
                for k in report
                if self.wanted == TABLE or report[k][f'rmse_{TABLE}'] < report[k]['rmse_grid_knn']
            )
            if 'position' in answered and self._cells_are_places(truth, signals.good):
                answered += ('cell',)
            for term in terms(self.config, inversion.noise):
                self.terms_ |= term.report
        self.inversion_, self.inverted_ = inversion if answered else None, answered
        if self.wanted != TABLE and not {'position', 'force'} <= {*answered}:
            self._regress(signals, {k: v for k, v in truth.items() if k not in answered}, groups)

    def _regress(self, signals: Signals, truth: Columns, groups: Columns) -> None:
        """Learn what the inversion does not answer; a cell alone is a place, its centre."""
        cells = np.asarray(truth.get('cell', np.full(len(signals.good), -1)), np.int64)
        place = np.asarray(truth.get('position', np.full((len(cells), 3), np.nan)), np.float64)
        known = signals.good & (cells >= 0)
        fits = known.any() and cells.max() < len(self.config.cells)
        self.centred_ = bool(fits and not np.isfinite(place[signals.good]).any())
        if self.centred_ and 'position' not in self.inverted_:
            place = np.where(known[:, None], self.config.cells[cells], np.nan)
            truth = {**truth, 'position': place}
            chips = signals.delta[signals.good].any(axis=(0, 2))
            if chips.sum() > 1 and self.config.stray_term:
                self.known_ = signals.delta.reshape(len(cells), -1)[known]
                self.named_ = cells[known]
        super().fit(signals, truth, groups)

    def _cells_are_places(self, truth: Columns, good: Bools) -> bool:
        """Decide whether the nearest centre is the cell of truth, in space or seen from above."""
        if 'cell' not in truth:
            return True
        cells, place = np.asarray(truth['cell'], np.int64), np.asarray(truth['position'], float)
        rows = good & (cells >= 0) & np.isfinite(place).all(axis=1)
        right = [
            float((nearest(place[rows, :k], self.config.cells[:, :k]) == cells[rows]).mean())
            for k in (3, 2)
        ] if rows.any() else [1.0, 0.0]  # fmt: skip
        self.flat_ = right[1] > right[0]
        return max(right) > 0.9

    def _inverted(self, signals: Signals, truth: Columns, groups: Columns) -> PadInversion | None:
        """Fit to the recording, where truth has places and forces on the surface."""
        blank = np.full((len(signals.good), 3), np.nan)
        place, force = (np.asarray(truth.get(k, blank), np.float64) for k in ('position', 'force'))
        rows = signals.good & np.isfinite(place).all(axis=1) & np.isfinite(force).all(axis=1)
        x = signals.delta.reshape(len(rows), self.width)[rows]
        place, force = place[rows], force[rows]
        live = np.asarray(np.abs(x).max(axis=0, initial=0.0) > 0)
        if len(x) < FEWEST or live.sum() < 3 or not _on_surface(self.config, place, force):
            return None
        session = np.asarray(groups['session'], np.int64)[rows]
        repeated = None if 'repetition' in truth else places_of(place)
        if len(np.unique(session)) >= FEWEST_SESSIONS:
            group = session
        else:
            group = np.asarray(groups['group'], np.int64)[rows] if repeated is None else repeated
        inversion = PadInversion(self.config, live, self.noise_)
        radius = float(np.median(np.hypot(place[:, 1], place[:, 2])))
        return inversion.fit(touches_at(place, force), x[:, live], group, radius)

    # -- use ------------------------------------------------------------------------------------

    def contact_from_sensor(self, signals: Signals) -> npt.NDArray[np.int8]:
        """Contact (s,): a uniform field that came after the tare does not touch."""
        contact, inversion = signals.in_contact, self.inversion_
        rows = np.flatnonzero(contact == 1)
        if inversion is None or inversion.common is None or not len(rows):
            return contact
        x = signals.delta.reshape(len(contact), self.width)[rows][:, inversion.live]
        touching = inversion.posterior.touching(x, inversion.contact_)
        changed = contact.copy()
        changed[rows] = touching
        return changed

    def estimate(self, signals: Signals, memory: object) -> Columns:
        """Targets of every row; see `Regression`."""
        known = super().estimate(signals, memory)
        status = self.drift_.out_of_range(signals) * OUT_OF_RANGE
        if self.inversion_ is not None:
            status |= self._add_inverted(known, signals, self.inversion_)
        if self.centred_:
            known['position_cov'] = known['position_cov'] + np.diag(extent(self.config.cells))
            if len(self.known_):
                self._vote_in_stray_field(known, signals)
        elif self._names_cells(known):
            place, cov = (np.asarray(known[k], float) for k in ('position', 'position_cov'))
            known['cell'], known['cell_probability'] = named_cells(place, cov, self.config.cells)
        if np.count_nonzero(status):
            known['status'] = status
        return known

    def _vote_in_stray_field(self, known: Columns, signals: Signals) -> None:
        """Name cells by what chips differ in, where a reading is unlike all known ones."""
        tree, limit, voters, free = self._voters
        x = signals.delta.reshape(len(signals.good), self.width)
        rows = np.flatnonzero(np.isfinite(x).all(axis=1) & (signals.in_contact != 0))
        rows = rows[tree.query(x[rows])[0] > limit]
        if len(rows):
            shares = voters.predict(np.matmul(x[rows, None], free)[:, 0])
            cells = np.unique(self.named_)[shares.argmax(axis=1)]
            known['cell'][rows], known['cell_probability'][rows] = cells, shares.max(axis=1)
            known['position'][rows] = self.config.cells[cells]

    @cached_property
    def _voters(self) -> tuple[cKDTree, float, GridKnn, Array]:
        """Known touches, how far apart they usually are, and neighbours without uniform fields."""
        tree, common = cKDTree(self.known_), uniform_response(self.config)
        usual = float(np.quantile(tree.query(self.known_, k=[2])[0], 0.995))
        free = np.eye(self.width) - common @ np.linalg.pinv(common)
        shares = (self.named_[:, None] == np.unique(self.named_)).astype(np.float64)
        return tree, FAR * usual, GridKnn().fit(self.known_ @ free, shares), free

    def _add_inverted(self, known: Columns, signals: Signals, inversion: PadInversion) -> Integers:
        """Add what the inversion answers; return the status (s,)."""
        every = signals.delta.reshape(len(signals.good), self.width)[:, inversion.live]
        rows = np.flatnonzero(np.isfinite(every).all(axis=1))
        x, status = every[rows], np.zeros(len(every), np.int64)
        found, cov, beyond = inversion.invert(x, self._centres)
        self._add_baseline_noise(cov, found.mean, signals, inversion, rows, x)
        force, rest = found.mean[:, 3:], signals.in_contact[rows] == 0
        square = np.add.reduce(force * force, axis=1)
        if np.count_nonzero(rest):
            # a load that is too light to be felt is reported as 0
            cov[rest, 3:, 3:] += force[rest, :, None] * force[rest, None, :]
            if inversion.common is not None:
                field = inversion.posterior.cause(x[rest])[0]
                felt = np.abs(field).max(axis=1, keepdims=True) > SIGMAS * inversion.noise
                found.cause[rest] = np.where(felt, field, 0.0)
        if inversion.response_ is not None and not inversion.response_.leaning:
            cov[:, 3, 3] += UPRIGHT**2 * square
        columns: Columns = {
            'position': found.mean[:, :3], 'position_cov': cov[:, :3, :3],
            'force': force, 'force_cov': cov[:, 3:, 3:],
            'cell': found.shares.argmax(axis=1), 'cell_probability': found.shares.max(axis=1),
        }  # fmt: skip
        answered = {k: v for k, v in columns.items() if k.split('_')[0] in self.inverted_}
        if inversion.common is not None:
            answered['stray_field'] = found.cause
        for name, column in answered.items():
            whole = len(rows) == len(every)
            known[name] = column if whole else scatter_rows(column, rows, len(every))
        odd = found.misfit > inversion.posterior.UNLIKE * inversion.misfit_
        strong = odd | (np.abs(found.cause) > FIELDS * STRAY).any(axis=1)
        least, most = (inversion.span_ * (1 / MARGIN, MARGIN)) ** 2
        beyond = ~rest & (beyond | (square < least) | (square > most))
        status[rows] = beyond * OUT_OF_RANGE | (strong & (odd <= ~rest)) * STRAY_FIELD
        if np.count_nonzero(odd):
            valid = np.ones(len(every), bool)
            wide = cov[:, 0, 0] > (NOTHING * self.config.length) ** 2 / 12
            valid[rows] = rest | ~(odd & wide)
            known['valid'] = valid
        return status

    def _add_baseline_noise(
        self, cov: Array, mean: Array, signals: Signals, inversion: PadInversion, rows: Integers,
        x: Array,
    ) -> None:  # fmt: skip
        """Add to covariances (r, 6, 6) the noise of tares and uncertain temperatures, in place."""
        own = signals.baseline_variance
        if own is not None and np.count_nonzero(own):
            tares = np.where(own > 0, own + self.tare_variance_, 0.0)[rows]
            share = inversion.noise**2 / inversion.variance(x)
            cov[:] = widened(cov, 1 + tares * share)
        warm, sigma = self.drift_.uncertainty(signals, inversion.noise)
        if len(warm):
            index = np.searchsorted(rows, warm)
            moved = inversion.posterior(x[index] + sigma[:, inversion.live], self._centres).mean
            moved -= mean[index]
            cov[index] += moved[:, :, None] * moved[:, None]

    @property
    def _centres(self) -> Array:
        """Centres of cells (n, 3) (m), seen from above where cells are stated so."""
        return self.config.cells * (np.array([1.0, 1.0, 0.0]) if self.flat_ else 1.0)


def _touched_only(truth: Columns) -> Columns:
    """Truth without the loads of untouched rows, which are 0 whatever is learned."""
    free = [np.asarray(truth['in_contact']) == 0] if 'in_contact' in truth else []
    if 'force' in truth:
        free.append((np.nan_to_num(np.asarray(truth['force'], float)) == 0).all(axis=1))
    if not free:
        return truth
    gone = np.any(free, axis=0)[:, None]
    loads: Columns = {
        k: np.where(gone, np.nan, truth[k]) for k in ('force', 'torque') if k in truth
    }
    return {**truth, **loads}


def _measured(column: npt.NDArray[np.generic]) -> Bools:
    """Rows in which truth has anything."""
    known = np.isfinite(column) if column.dtype.kind == 'f' else column != -1
    return np.asarray(known.any(axis=tuple(range(1, known.ndim))))


def _on_surface(config: MagnetPadConfig, place: Array, force: Array) -> bool:
    """True if contacts (s, 3) lie on a half cylinder about the axis, pressed inward."""
    distance = np.hypot(place[:, 1], place[:, 2])
    radius = max(float(np.median(distance)), 1e-9)
    off = np.abs(distance / radius - 1) > 0.1
    off |= np.abs(place[:, 0]) > 0.55 * config.length
    off |= (place[:, 1:] * force[:, 1:]).sum(axis=1) <= 0
    return 0.5 < radius / config.radius < 2.0 and float(off.mean()) <= 0.05


def nearest(places: Array, cells: Array) -> Integers:
    """Number (...) of the cell (n, k) nearest to places (..., k)."""
    return np.asarray((places @ cells.T - 0.5 * (cells**2).sum(axis=1)).argmax(axis=-1))


def extent(cells: Array) -> Array:
    """Variance (3,) (m2) of places inside a cell along each axis, by the gaps of centres."""
    steps = [max(len(np.unique(np.round(axis, 6))) - 1, 1) for axis in cells.T]
    return np.asarray((np.ptp(cells, axis=0) / steps) ** 2 / 12)


def named_cells(place: Array, cov: Array, cells: Array) -> tuple[Integers, Array]:
    """Cells (s,) nearest to places (s, 3), seen from above, and their share of the covariance."""
    known = np.isfinite(place[:, :2]).all(axis=1)
    named, share = np.full(len(place), -1), np.full(len(place), np.nan)
    root = np.linalg.cholesky(cov[known][:, :2, :2] + 1e-18 * np.eye(2))
    spread = place[known, None, :2] + np.einsum('sij,pj->spi', root, POINTS)
    named[known] = nearest(place[known, :2], cells[:, :2])
    share[known] = (nearest(spread, cells[:, :2]) == named[known, None]).mean(axis=1)
    return named, share


CLASSES = (
    *REGRESSION_CLASSES,
    Localisation,
    PadInversion,
    PadResponse,
    CovarianceModel,
    ThermalDrift,
    MagnetPadConfig,
)
