# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Place and force of the five-wire skin from its readings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from tactile_ros.conditioning.fading_memory import FadingMemory
from tactile_ros.estimators.covariance import CovarianceModel
from tactile_ros.estimators.model_selection import held_out_report, select
from tactile_ros.estimators.potential_map import PotentialMap
from tactile_ros.estimators.power_law_force import PowerLawForce
from tactile_ros.estimators.rbf_force import RbfForce
from tactile_ros.estimators.regression import Ridge
from tactile_ros.physics.resistive_sheet import SeriesResistance, linear_place
from tactile_ros.sensors.five_wire_skin.config import FiveWireSkinConfig
from tactile_ros.sensors.five_wire_skin.film import (
    DIVIDER,
    TIME_CONSTANTS,
    ContactGate,
    FilmCreep,
    implausible_taxels,
)
from tactile_ros.sensors.regression import CLASSES as REGRESSION_CLASSES
from tactile_ros.sensors.regression import ESTIMATORS as REGRESSORS
from tactile_ros.sensors.regression import (
    FEWEST_ROWS,
    KIND,
    Regression,
    longest_hold,
    missing_history,
    missing_loads,
)
from tactile_ros.types.contracts import Estimation, Estimator, Report, Signals
from tactile_ros.types.frame import Array, Bools, Columns, FrameStatus, Integers

ESTIMATORS = (*REGRESSORS, 'printed')
NOMINAL_ERROR = 0.06  # of the sheet: an uneven border bends the linear formula that much
CONSTANT = 1e-6  # of the supply: readings that move less are one constant, in 16 bits too
LEAST_EXTENT = 0.02  # of the sheet: deviation of places in every direction
LEAST_RANGE = 0.1  # of the largest force
LEAST_DIVIDER = 1e-4
SAME_PLACE, MOST_SINGLE = 1e-5, 0.3  # m; places per touch above which touches are the groups
CONTINUES, ENDS = 1.1, 1.4  # times the largest force: curve is continued, sigma is the force
USEFUL = 0.9  # of the standard deviation of shear; a regression that leaves more is none
LONGEST = 4.0  # times the longest hold: slowest creep that it shows
WORTH = 0.97  # of the static error; creep that takes off less is none
FOR_PLACE, FOR_FORCE, CELL = 25, 49, 0.05  # places for a map and a film; of the sheet: one place
FAR, GAP, NODES = 0.2, 0.02, 41  # of the sheet to the next touch; share of it; grid


class LinearPlace:
    """The formula of [5] for an even border of a sheet of `size` (2,) (m); no fit changes it."""

    def __init__(self, size: Array) -> None:
        self.size = np.asarray(size, np.float64)

    def fit(self, x: Array, y: Array, groups: Integers | None = None) -> LinearPlace:
        """Return itself."""
        return self

    def predict(self, x: Array) -> Array:
        """Places (s, 2) (m) for potentials (s, 2..)."""
        return linear_place(np.asarray(x)[:, :2], self.size)


class Choice:
    """Estimator in use for one quantity, with the covariance of its error.

    A model states its own covariance and errors on held-out groups in closed form; that of any
    other estimator follows from its out-of-fold errors.
    """

    name: str  # of the estimator in use
    report_: dict[str, float]  # errors on held-out groups

    def __init__(self, name: str, estimator: Estimator, covariance: Array | None = None) -> None:
        self.name, self.estimator_ = name, estimator
        self.nominal_ = covariance
        self.covariance_ = CovarianceModel()
        self.report_ = {}

    def fit(self, x: Array, y: Array, groups: Integers) -> Choice:
        """Learn from features (s, d) and targets (s, k)."""
        if isinstance(self.estimator_, PotentialMap | PowerLawForce):
            off, stated = self.estimator_.fit_held_out(x, y, groups)
            off = off.reshape(len(x), -1)
            variance = stated if stated.ndim == 1 else np.einsum('sii->si', stated)
        else:
            trial = select({self.name: self.estimator_}, x, y, groups)
            self.estimator_.fit(x, y, groups)
            off = trial.residuals
            self.covariance_.fit(off, None, trial.groups, trial.x)
            variance = np.einsum('sii->si', self.covariance_.predict(None, trial.x)[0])
        self.report_ = held_out_report(
            off, np.sqrt(variance).reshape(off.shape), groups, len(x), {}
        )
        return self

    def predict(self, x: Array) -> tuple[Array, Array]:
        """Estimates (s, k), and covariances of their errors (s, k, k)."""
        if isinstance(self.estimator_, PotentialMap):
            return self.estimator_.place(x)
        mean = self.estimator_.predict(x)
        if self.nominal_ is not None:
            return mean, np.broadcast_to(self.nominal_, (*mean.shape, mean.shape[1]))
        return mean, self.covariance_.predict(None, x)[0]


def best_of(choices: Sequence[Choice], x: Array, y: Array, groups: Integers) -> Choice:
    """Fitted choice that errs least on held-out groups: no model that loses to a plain one."""
    errors = [choice.fit(x, y, groups).report_['held_out_rmse'] for choice in choices]
    best = choices[int(np.nanargmin(errors))] if np.isfinite(errors).any() else choices[0]
    best.report_ |= {f'rmse_{c.name}': error for c, error in zip(choices, errors, strict=True)}
    return best


class FiveWireEstimation(Estimation):
    """Estimators of the five-wire skin.

    `estimator` is one of `ESTIMATORS`: a regressor of the readings; 'printed', the formula and
    the network of [5]; None: the models of sheet and film, unless these err less on held-out
    places.
    """

    def __init__(self, config: FiveWireSkinConfig, estimator: str | None = None) -> None:
        self.size = np.asarray(config.size, np.float64)
        self.touch_edge = float(config.touch_size)
        sheet = config.sheet_resistance / config.reference_resistance
        self.series = SeriesResistance(self.size, config.touch_size, sheet)
        noise = np.asarray(np.nan if config.noise is None else config.noise, np.float64)
        channels = len(config.channels)
        self.touch_ = ContactGate(float(np.broadcast_to(noise, channels)[DIVIDER]), channels)
        self.wanted = estimator
        self.potentials = np.delete(np.arange(channels), DIVIDER)
        self.others_: Regression | None = None
        if estimator in REGRESSORS:
            self.others_ = Regression(config, estimator, channels)
        nominal = np.diag((NOMINAL_ERROR * self.size) ** 2)
        self.place_ = Choice(estimator or 'linear', LinearPlace(self.size), nominal)
        self.height_ = np.zeros(2)
        self.force_: Choice | None = None
        self.most_ = np.inf  # largest force of the fit (N)
        self.creep_: FilmCreep | None = None
        self.shear_: Choice | None = None
        self.coverage_: Report = {}

    @property
    def estimators(self) -> dict[str, str]:
        """Name of the estimator in use for each target."""
        if self.others_ is not None:
            return self.others_.estimators
        force = {} if self.force_ is None else {'force': self.force_.name}
        return {'position': self.place_.name, **force}

    @property
    def report(self) -> Report:
        """Errors on held-out places, the threshold of contact, and what was not recorded."""
        if self.others_ is not None:
            return {**self.others_.report, **self.coverage_}
        heads = {'position_xy': self.place_, 'force_z': self.force_, 'force_xy': self.shear_}
        known = {title: head.report_ for title, head in heads.items() if head is not None}
        known['contact'] = self.touch_.report_
        if self.creep_ is not None:
            known['force_z_without_creep'] = self.creep_.report_
        return {**{title: table for title, table in known.items() if table}, **self.coverage_}

    def start(self) -> object:
        """Fresh memory of a stream."""
        return FadingMemory(TIME_CONSTANTS) if self.others_ is None else self.others_.start()

    def fit(self, signals: Signals, truth: Columns, groups: Columns) -> None:
        """Learn contact, place and force from frames with truth; see `Regression.fit`."""
        x = self.touch_.fit(signals, truth).readings(signals)
        contact = self.touch_.contact(signals, x)
        signals = replace(signals, in_contact=contact, good=signals.good & (contact != 0))
        blank = np.full((len(x), 3), np.nan)
        position = np.array(truth.get('position', blank), np.float64)
        # the middle of what of a touch lies on the sheet is no nearer to its border
        edge = np.minimum(self.touch_edge, self.size) / 2
        position[:, :2] = np.clip(position[:, :2], edge, self.size - edge)
        force = np.asarray(truth.get('force', blank), np.float64)
        if self.others_ is not None:
            self.others_.fit(_divider_less_rest(signals, x), truth, groups)
        else:
            group = _groups(position, signals.good, np.asarray(groups['group'], np.int64))
            self._fit_place(x, position, group, signals.good)
            self._fit_force(signals, x, position, force, group)
            self._fit_shear(x, force, group, signals.good)
        share = 0.0 if self.creep_ is None else -float(self.creep_.shares_.sum())
        self.coverage_ = _coverage(self.size, signals, position, force, share)

    def implausible_taxels(self, values: Array) -> Bools:
        """Taxels (s, t) of readings (s, t, c) that no wire can read: a short, a loose wire."""
        return implausible_taxels(values)

    def contact_from_sensor(self, signals: Signals) -> npt.NDArray[np.int8]:
        """Contact (s,) by the divider of conditioned frames: 1, 0, -1 unknown."""
        return self.touch_.contact(signals, self.touch_.readings(signals))

    def estimate(self, signals: Signals, memory: object) -> Columns:
        """Place and force of every row, with covariances; `in_contact` is the divider's."""
        x = self.touch_.readings(signals)
        if self.others_ is not None:
            return self.others_.estimate(_divider_less_rest(signals, x), memory)
        assert isinstance(memory, FadingMemory)
        place, covariance = self.place_.predict(x[:, self.potentials])
        position, position_cov = np.empty((len(x), 3)), np.zeros((len(x), 3, 3))
        position[:, :2], position[:, 2] = place, self.height_[0]
        position_cov[:, :2, :2], position_cov[:, 2, 2] = covariance, self.height_[1]
        if np.isnan(self.height_[0]):
            position_cov[:, 2] = position_cov[:, :, 2] = np.nan
        known: Columns = {'position': position, 'position_cov': position_cov}
        if self.force_ is not None:
            self._add_force(known, signals, x, place, memory)
        return known

    def _add_force(
        self, known: Columns, signals: Signals, x: Array, place: Array, memory: FadingMemory
    ) -> None:
        """Add forces, their covariances, and a flag where they exceed those of the fit."""
        assert self.force_ is not None
        value, variance = self._normal(signals, self._features(x, place), memory)
        force, covariance = np.full((len(x), 3), np.nan), np.full((len(x), 3, 3), np.nan)
        excess = np.maximum(value - CONTINUES * self.most_, 0.0)
        if np.count_nonzero(excess):
            known['status'] = (excess > 0) * np.int64(FrameStatus.OUT_OF_RANGE)
            variance = variance + np.where(value > ENDS * self.most_, value, 0.5 * excess) ** 2
        force[:, 2], covariance[:, 2, 2] = value, variance
        untouched = signals.in_contact == 0
        force[untouched, 2], covariance[untouched, 2, 2] = 0.0, self.touch_.subthreshold_
        if self.shear_ is not None:
            force[:, :2], covariance[:, :2, :2] = self.shear_.predict(x)
        known['force'], known['force_cov'] = force, covariance

    def _normal(
        self, signals: Signals, features: Array, memory: FadingMemory
    ) -> tuple[Array, Array]:
        """Normal forces (s,) (N) and their variances, without creep where stamps allow it."""
        assert self.force_ is not None
        model = self.force_.estimator_
        if not isinstance(model, PowerLawForce):
            mean, covariance = self.force_.predict(features)
            return mean[:, 0], covariance[:, 0, 0]
        if self.creep_ is None or signals.stamp_ns is None:
            force, relative = model.force(features)
            return force, relative * (force - model.gap_) ** 2
        force, relative = self.creep_.curve_.force(features)
        static = np.where(signals.in_contact == 0, 0.0, force)
        static = np.where(signals.good, static, np.nan)
        force, ratios = self.creep_.undo(static, signals.stamp_ns, signals.restart, memory)
        relative = relative + self.creep_.variance(ratios)
        return force, relative * (force - self.creep_.curve_.gap_) ** 2

    def _features(self, x: Array, place: Array) -> Array:
        """Features (s, 3) of a force: place over the sheet, R over R0."""
        ratio = 1 / np.maximum(x[:, DIVIDER], LEAST_DIVIDER) - 1
        return np.column_stack([place / self.size, np.maximum(ratio, LEAST_DIVIDER)])

    def _fit_place(self, x: Array, position: Array, group: Integers, good: Bools) -> None:
        """Fit the map from potentials to place."""
        rows = np.flatnonzero(good & np.isfinite(position[:, :2]).all(axis=1))
        rows = rows[np.lexsort(x[rows].T)]
        u, places = x[rows][:, self.potentials], position[rows, :2]
        if not _spans(u, places / self.size):
            return
        plain = Choice(self.wanted or 'linear', LinearPlace(self.size))
        models = [plain] if self.wanted else [Choice('harmonic', PotentialMap(self.size)), plain]
        self.place_ = best_of(models, u, places, group[rows])
        height = position[rows, 2]
        height = height[np.isfinite(height)]
        self.height_ = np.full(2, np.nan)
        if len(height):
            self.height_ = np.array([np.median(height), height.var() + 1e-12])

    def _fit_force(
        self, signals: Signals, x: Array, position: Array, force: Array, group: Integers
    ) -> None:
        """Fit the static curve, and the creep where stamps show the past."""
        self.force_ = self.creep_ = None
        rows = np.flatnonzero(signals.good & np.isfinite(force[:, 2]))
        rows = rows[np.lexsort(np.column_stack([x[rows], force[rows, 2]]).T)]
        load = force[rows, 2:]
        if len(rows) < FEWEST_ROWS or np.ptp(x[rows, DIVIDER]) <= CONSTANT:
            return
        self.most_ = float(load.max())
        if np.ptp(load) <= LEAST_RANGE * np.abs(load).max():
            return
        place = self.place_.predict(x[:, self.potentials])[0]
        measured = np.isfinite(position[:, :2]).all(axis=1, keepdims=True)
        if self.wanted is None:
            place = np.where(measured, position[:, :2], place)
        features = self._features(x, place)
        noise = 0.0 if np.isnan(self.touch_.noise) else self.touch_.noise
        power = PowerLawForce(noise, self.size, self.series)
        plain = Choice(self.wanted or 'rbf', RbfForce())
        models = [plain] if self.wanted else [Choice('power', power), plain]
        self.force_ = best_of(models, features[rows], load, group[rows])
        if signals.stamp_ns is not None and self.force_.estimator_ is power:
            self._fit_creep(signals, features, force[:, 2], group, rows)

    def _fit_creep(
        self, signals: Signals, features: Array, force: Array, group: Integers, rows: Integers
    ) -> None:
        """Fit shares of the past beside the static curve, kept where they help held-out places."""
        assert self.force_ is not None
        assert signals.stamp_ns is not None
        static = self.force_.estimator_
        assert isinstance(static, PowerLawForce)
        past = np.where(np.isfinite(force), force, static.force(features)[0])
        past = np.where(signals.in_contact == 0, 0.0, past)
        past = np.where(signals.good | (signals.in_contact == 0), past, np.nan)
        # nothing distinguishes slower ones from a wrong curve
        shown = np.flatnonzero(LONGEST * longest_hold(signals) >= TIME_CONSTANTS)
        creep, model = FilmCreep(static), PowerLawForce(static.noise, self.size, self.series)
        memory = FadingMemory(TIME_CONSTANTS)
        ratios = creep.undo(past, signals.stamp_ns, signals.restart, memory)[1]
        x = np.column_stack([features, ratios[:, shown]])[rows]
        error = model.fit_held_out(x, force[rows, None], group[rows], static)[0]
        size, before = float(np.sqrt(np.nanmean(error**2))), self.force_.report_['held_out_rmse']
        if size < WORTH * before:
            self.creep_, creep.curve_ = creep, model
            creep.shares_[shown] = model.linear_
            creep.covariance_[np.ix_(shown, shown)] = model.linear_covariance_
            creep.report_ = {'held_out_rmse': before}
            self.force_.report_['held_out_rmse'] = size

    def _fit_shear(self, x: Array, force: Array, group: Integers, good: Bools) -> None:
        """Fit shear, which the skin does not feel: only where truth and place determine it."""
        rows = np.flatnonzero(good & np.isfinite(force).all(axis=1))
        self.shear_ = None
        if self.force_ is None or len(rows) < FEWEST_ROWS or not np.ptp(force[rows, :2]):
            return
        shear = Choice('ridge', Ridge()).fit(x[rows], force[rows, :2], group[rows])
        spread = float(np.sqrt(force[rows, :2].var(axis=0).sum()))
        self.shear_ = shear if shear.report_['held_out_rmse'] < USEFUL * spread else None


def _divider_less_rest(signals: Signals, x: Array) -> Signals:
    """Frames of which only the divider has a baseline."""
    wide = np.repeat(x[:, None], signals.values.shape[1], axis=1)
    return replace(signals, delta=wide, baseline=np.zeros_like(signals.values))


def _groups(position: Array, good: Bools, group: Integers) -> Integers:
    """Number of the place of each row, where places are repeated; else its group."""
    measured = good & np.isfinite(position[:, :2]).all(axis=1)
    plane = np.round(np.nan_to_num(position[:, :2]) / SAME_PLACE)
    place = np.unique(plane, axis=0, return_inverse=True)[1].reshape(-1)
    count = len(np.unique(place[measured]))
    return np.asarray(place) if 1 < count <= MOST_SINGLE * measured.sum() else group


def _spans(potentials: Array, places: Array) -> bool:
    """Test that two potentials (s, p) move, and places (s, 2) in every direction.

    Touches of few places, or along a line, determine no map. Places are in units of the edges.
    """
    if len(np.unique(np.round(places / CELL), axis=0)) < FEWEST_ROWS:
        return False
    least = np.linalg.svd(places - places.mean(axis=0), compute_uv=False)[-1]
    moving = (np.ptp(potentials, axis=0) > CONSTANT).sum()
    return bool(moving >= 2 and least > LEAST_EXTENT * np.sqrt(len(places)))


def _coverage(
    size: Array, signals: Signals, position: Array, force: Array, crept: float
) -> Report:
    """Contacts, loads, places and pasts that a recording lacks, with figures."""
    found = {**missing_loads(force[signals.good, 2]), **missing_history(signals, crept)}
    if (signals.in_contact != 0).all():
        found[f'{KIND}contact (no untouched rows)'] = {}
    places = position[signals.good, :2] / size
    places = places[np.isfinite(places).all(axis=1)]
    if not len(places):
        return {**found, f'{KIND}place (no truth): the formula of [5] serves': {}}
    count = len(np.unique(np.round(places / CELL), axis=0))
    for what, needed in (('place', FOR_PLACE), ('force', FOR_FORCE)):
        if count < needed:
            figures = {'places': float(count), 'wanted': float(needed)}
            found[f'{KIND}{what} between so few places'] = figures
    line = np.linspace(0.0, 1.0, NODES)
    grid = np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)
    share = float((cKDTree(places).query(grid)[0] > FAR).mean())
    if share > GAP:
        found[f'{KIND}places far from all touches'] = {'share of the sheet': share}
    return found


CLASSES = (
    *REGRESSION_CLASSES, FiveWireEstimation, ContactGate, Choice, LinearPlace, PotentialMap,
    PowerLawForce, SeriesResistance, FilmCreep, RbfForce,
)  # fmt: skip
