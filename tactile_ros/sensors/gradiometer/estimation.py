# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Force, torque and stray field of the gradiometer by inversion of its disc's model.

`fit` estimates pixels, gains, magnet, elastomer and the places of the disc together from presses
with reference forces (and rests in known fields, where there are any), with the noise of the
references by evidence. Each frame is then inverted by itself. The printed chain of [3] is the
floor on held-out groups. Frames that no disc in a uniform field explains are beside a magnet: they
are flagged and inverted once more with the patterns of one.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from functools import cached_property

import numpy as np
import numpy.typing as npt
from numpy.lib.stride_tricks import sliding_window_view
from scipy.optimize import minimize_scalar
from scipy.stats import chi2

import tactile_ros.sensors.gradiometer.disc_model as disc
from tactile_ros.conditioning.baseline import training_baseline_variance
from tactile_ros.estimators.covariance import CovarianceModel, scaled
from tactile_ros.estimators.evidence import Influence, learn_noise
from tactile_ros.estimators.model_inversion import (
    FIXED,
    Calibration,
    Frames,
    ModelPrior,
    Posterior,
    calibrate,
    invert,
    nearest,
)
from tactile_ros.estimators.model_selection import held_out_report, select, spread_rows
from tactile_ros.estimators.polynomial_force import PolynomialForce, ThermalPolynomial
from tactile_ros.estimators.regression import Ridge
from tactile_ros.physics.compiled import compiled
from tactile_ros.physics.field_table import SHAPE
from tactile_ros.physics.temperature import hall_sensitivity
from tactile_ros.sensors.gradiometer.config import GradiometerConfig
from tactile_ros.sensors.gradiometer.temperature import Thermometer, drift_rows, mean_of, mean_row
from tactile_ros.sensors.gradiometer.twin import LEAST_NOISE, field_model, terms
from tactile_ros.types.contracts import Estimation, Estimator, Report, Signals
from tactile_ros.types.frame import Array, Bools, Columns, FrameStatus, Integers

ESTIMATORS = ('inversion', 'polynomial', 'ridge')
TARGETS = ('force', 'torque', 'position')
NOISE = 3e-6  # T, where nothing states it: of [3] at room temperature
THIRD, FEWEST_RESTING, UNEVEN = 20.0, 10, 2  # noise of third differences of even steps
SIGMAS, MOST_MARGIN = 4.0, 0.01  # within which a clipped reading may lie below the range; of it
LEAST_RANGE = 3.0  # degrees that are one temperature
FOLLOWED = (-25.0, 95.0)  # degrees Celsius, beyond which the sensitivity's polynomial stands still
MOST_ROWS, FEW_ROWS = 1500, 200  # of a calibration; of one in which a lag is sought
ROUGH = 0.1  # mT: noise with which the descent begins
ROUNDS, STEPS = 8, 15  # of the evidence; of each, of which later rounds take up what is left
CLEARLY = 10.0  # cost by which a lag must explain more than none
RESTS = 5e-5  # mm, within which a resting disc rests
CHANCE = 1e-4  # of flagging a frame that is beside no magnet
SURELY, TOUCH = 5.7, 1e-3  # sigmas, and share of full scale, of a load that is one
NEAR_ROWS, NEAR_MOMENT = 300, (-3.0, -1.0)  # decades of A m2
TWO_SIGMA = 0.9545
FARTHEST = 2.0  # times the largest that can be
SCENES = 30  # states of the scene, over which terms are weighed
WHOLE = 0.9  # of full scale
TINY = 1e-12


class GradiometerEstimation(Estimation):
    """Estimators of one gradiometer; a fit starts at its config.

    `estimator` is one of `ESTIMATORS`; None: the inversion, or the chain of [3] where that errs
    less on held-out groups.
    """

    uses_temperature = True

    def __init__(self, config: GradiometerConfig, estimator: str | None = None) -> None:
        self.config = config
        self.estimator = estimator
        self.method_ = ''
        self.tared_ = True
        self.shape_ = SHAPE
        self.thermometer_ = Thermometer(config.thermal_lag)
        self.noise_ = NOISE if config.noise is None else float(np.max(config.noise))
        self.noise_ = self.noise_ if np.isfinite(self.noise_) and self.noise_ > 0 else NOISE
        self._forget()

    def _forget(self) -> None:
        """Be as before a fit."""
        self.answers_: list[list[str | int]] = []
        self.spread_ = self.largest_ = np.zeros(0)
        self.unit_ = 0.5 * self.config.gap / disc.MM
        self.covariance_: CovarianceModel | None = None
        self.threshold_ = np.inf
        self.regressor_: Estimator | None = None
        self.level_ = np.zeros(2 * len(self.config.positions))
        self.report_: Report = {}
        self.label_noise_ = self.near_scale_ = np.zeros(0)
        self.fields_known_ = False
        self.widths_: dict[str, Array] = {}
        self._take(None)

    def _take(self, fit: Calibration | None) -> None:
        """Keep a calibration, without the states of its frames; None: the prior's."""
        for name, found in vars(type(self)).items():
            if isinstance(found, cached_property):
                vars(self).pop(name, None)
        prior = self.model
        if fit is None:
            covariance = np.diag(prior.parameter_sigma**2)
            fit = Calibration(prior.parameters, covariance, np.zeros((0, 0)), 0.0, converged=True)
        self.fit_ = replace(fit, states=np.zeros((0, disc.STATES)))

    @property
    def estimators(self) -> dict[str, str]:
        """Name of the estimator in use for each target."""
        return dict.fromkeys(self._placed[0], self.method_)

    @property
    def report(self) -> Report:
        """Errors on held-out groups, what was estimated of the disc, and what was not measured."""
        return self.report_

    def start(self) -> Array:
        """Fresh memory of a stream: temperatures of chip and magnet."""
        return np.zeros(7)

    @cached_property
    def model(self) -> ModelPrior:
        """Model of the disc with its priors, as far as they are known."""
        model = disc.disc_prior(
            self.config, self.answers_, self.spread_, self.unit_, self.thermometer_.usual_,
            tared=self.tared_, shape=self.shape_,
        )  # fmt: skip
        sigma = self.widths_.get('state', model.state_sigma)
        return replace(
            model, noise=np.full(len(model.noise), self.noise_ / disc.MT), state_sigma=sigma,
            parameter_sigma=self.widths_.get('parameters', model.parameter_sigma),
        )  # fmt: skip

    # -- conditioning ------------------------------------------------------------------------

    def thermal_drift(
        self, baseline: Array, reference_c: Array, temperature_c: Array | None
    ) -> Array:
        """Change of baselines by sensitivity and remanence, since they were read."""
        drift = np.zeros(baseline.shape)
        if temperature_c is not None:
            count = len(drift)
            drift_rows(
                np.ascontiguousarray(baseline).reshape(count, -1),
                np.ascontiguousarray(reference_c), np.ascontiguousarray(temperature_c),
                self.config.sensitivity, *FOLLOWED, drift.reshape(count, -1),
            )  # fmt: skip
        return drift

    def _sensitivity(self, chips: Array | None) -> Array:
        """Sensitivity (s, 1) of Hall elements at temperatures (s, t); 1 where none is known."""
        usual = np.full((1, 1), np.nan) if chips is None else chips
        return hall_sensitivity(mean_of(usual), self.config.sensitivity, FOLLOWED)[:, None]

    @cached_property
    def _usual_information(self) -> Array:
        """Inverse variance (19,) of the state's prior, but for temperatures."""
        sigma = self.model.state_sigma.copy()
        hidden = disc.UNIFORM + np.flatnonzero(~self.measured)
        sigma[hidden] = disc.CROSSED_FIELD * self.fields_known_
        if not self.config.stray_term:
            sigma[disc.UNIFORM : disc.MAGNET] = 0.0
        return np.asarray(1 / np.maximum(sigma, FIXED) ** 2)

    def _frames(self, signals: Signals, memory: Array) -> Frames:
        """Changes of reading (mT) with the prior of each frame."""
        values, thermometer, usual = signals.values, self.thermometer_, self._usual_information
        base, then, variance, spread = np.zeros(values.shape), None, None, 0.0
        if self.tared_:
            base, spread = np.ascontiguousarray(signals.baseline), thermometer.spread_
            then, variance = signals.rest_temperature_c, signals.baseline_variance
        count = len(values)
        chips = np.full((count, 1), np.nan) if then is None else np.ascontiguousarray(then)
        prior, information = np.empty((2, count, disc.STATES))
        readings, noise = np.empty((2, count, len(self.model.noise)))
        free = usual < FIXED**-2
        disc.frame_rows(
            values, base, thermometer.follow(signals, memory), chips, thermometer.usual_,
            np.zeros(count) if variance is None else variance, usual, self.model.noise, spread,
            self.config.thermal_term, readings, prior, information, noise, free,
        )  # fmt: skip
        return Frames(readings, prior, information, noise, free.nonzero()[0])

    @cached_property
    def _starts(self) -> tuple[Array, Array, Array]:
        """Places (g, 3) where descents may start, their projected readings, the projection."""
        model, gap = self.model, self.config.gap / disc.MM
        side, depth = np.linspace(-0.5, 0.5, 9) * gap, np.linspace(-0.75, 0.05, 9) * gap
        places = np.stack(np.meshgrid(side, side, depth, indexing='ij'), axis=-1).reshape(-1, 3)
        states = np.zeros((len(places), disc.STATES))
        states[:, :3] = places
        read, slopes = disc.readings_of(model, self.fit_.parameters, states)
        ways = disc.difference_basis(slopes[0], self.measured)
        if not self.config.stray_term or ways.shape[1] < 3:
            ways = np.eye(len(model.noise))
        return places, read @ ways, ways

    @cached_property
    def measured(self) -> Bools:
        """Which of x, y, z channels measure, shape (3,)."""
        sensed = np.abs(disc.chip_axes(self.config)[:, :, [0, 2]]).max(axis=(0, 2))
        return np.asarray(sensed > 0.05)

    def invert(self, frames: Frames) -> Posterior:
        """States and answers, from the place of a table that reads most alike."""
        places, seen, ways = self._starts
        starts = frames.prior.copy()
        nearest(frames.readings, ways, seen, places, starts)
        return invert(self.model, self.fit_, frames, starts)

    def contact_from_sensor(self, signals: Signals) -> npt.NDArray[np.int8]:
        """Contact (s,); frames without times touch where the disc surely tells a load."""
        # streams are left as they are: there baselines drift, and elastomers creep after a press
        if signals.stamp_ns is not None or not self.answers_:
            return signals.in_contact
        contact = signals.in_contact.copy()
        rows = contact == 0
        if signals.tare is not None:
            rows &= ~signals.tare
        if not rows.any():
            return contact
        frames = self._frames(signals, self.start()).of(np.flatnonzero(rows))
        found = invert(self.model, self.fit_, frames, frames.prior)
        sigma = np.sqrt(np.einsum('sii->si', found.answer_covariance))
        loads = np.array([name != 'position' for name, _ in self.answers_])
        felt = np.abs(found.answers) > np.maximum(SURELY * sigma, TOUCH * self.largest_)
        contact[rows] = felt[:, loads].any(axis=1)
        return contact

    # -- fit ---------------------------------------------------------------------------------

    def fit(self, signals: Signals, truth: Columns, groups: Columns) -> None:
        """Learn every target of which truth has a component.

        `stray_field` at rest gives gains and crossed axes; groups hold 'group' and 'session' (s,).
        """
        self.thermometer_ = Thermometer(self.config.thermal_lag).fit(signals)
        self.tared_ = bool(np.nan_to_num(signals.baseline[signals.good]).any())
        rest = at_rest(signals, truth)
        tare = signals.tare if signals.tare is not None and signals.tare.any() else None
        resting = signals.good & (signals.in_contact == 0 if tare is None else tare)
        if self.config.noise is None and resting.sum() > FEWEST_RESTING:
            self.noise_ = rest_noise(signals, resting) or NOISE
        self._forget()
        if self.tared_ and signals.good.any():
            base = signals.baseline[signals.good].reshape(-1, len(self.level_))
            self.level_ = np.asarray(base.mean(axis=0))
        choice = field_model(self.config, self.noise_)
        self.shape_ = (int(choice.size[0]), int(choice.size[1]))
        f = self._references(truth, signals.good & ~rest)
        touched = spread_rows(np.flatnonzero(np.isfinite(f).any(axis=1)), MOST_ROWS)
        stray = np.asarray(truth.get('stray_field', np.full((len(rest), 3), np.nan)), float)
        still = np.flatnonzero(signals.good & rest & np.isfinite(stray).any(axis=1))
        if len(touched):
            size = np.nanstd(f[touched], axis=0)
            self.spread_ = np.where(size > 0, size, np.nanmax(np.abs(f[touched]), axis=0) + TINY)
            rows = np.concatenate([touched, spread_rows(still, MOST_ROWS // 3)])
            self.fields_known_ = bool(np.isfinite(stray[still]).all(axis=1).any())
            group = np.asarray(groups['group'], np.int64)[rows]
            if signals.stamp_ns is None and 'repetition' not in truth:  # independent frames
                same = np.nan_to_num(signals.values[rows].reshape(len(rows), -1))
                group = np.unique(same, axis=0, return_inverse=True)[1].reshape(-1)
            group[len(touched) :] = -1
            self._learn(signals, f, stray, rows, group)
        self._report_unsupported(f[touched], len(still))
        self.report_ |= choice.report
        for term in terms(self.config, max(self.noise_, LEAST_NOISE), SCENES):
            self.report_ |= term.report

    def _references(self, truth: Columns, use: Bools) -> Array:
        """Reference answers (s, l) of rows to use, NaN elsewhere; names `answers_`."""
        found = []
        for name in TARGETS:
            column = np.asarray(truth.get(name, np.full((len(use), 3), np.nan)), float)
            column = np.where(use[:, None], column, np.nan)
            for axis in np.flatnonzero(np.isfinite(column).any(axis=0)):
                self.answers_.append([name, int(axis)])
                found.append(column[:, axis])
        return np.stack(found, axis=1) if found else np.zeros((len(use), 0))

    def _learn(
        self, signals: Signals, references: Array, stray: Array, rows: Integers, group: Integers
    ) -> None:
        """Calibrate on rows, of which those of group -1 rest in known fields; judge the rest."""
        self._take(None)
        touched, f = int((group >= 0).sum()), references[rows]
        frames = self._calibration_frames(signals, stray, rows, touched)
        rough = replace(frames, noise=np.hypot(frames.noise, ROUGH))
        states = self.invert(rough).states
        begin, noise = disc.polynomial_fit(self.model, states[:touched], f[:touched])
        usual, tare = self.model.parameter_sigma, self._tare_noise(signals, rows[:touched])
        model = replace(self.model, answer_noise=noise, parameter_sigma=np.hypot(usual, tare))
        fit = calibrate(model, rough, f, states, begin=begin, gain=1e-3)
        asked = self.config.thermal_lag == 0 and self.config.thermal_term
        if asked and self.thermometer_.varies and len(self.thermometer_.lags_):
            self._learn_lag(signals, model, references, fit, rows[:touched])
            frames = self._calibration_frames(signals, stray, rows, touched)
        learned = np.array([disc.TILT, disc.TILT + 1, disc.LABEL])
        kinds = disc.width_groups(len(self.config.positions), self.answers_)
        for _ in range(ROUNDS):
            frames.information[:touched, learned] = 1 / model.state_sigma[learned] ** 2
            fit = calibrate(
                model, frames, f, fit.states, begin=fit.parameters, most_steps=STEPS, gain=1e-5
            )
            influence = Influence(model, fit, frames, f)
            model = learn_noise(model, fit, influence, learned, kinds)
            noise = np.maximum(model.answer_noise, disc.LEAST_NOISE * self.spread_)
            model = replace(model, answer_noise=noise)
        known = np.where(tare > 0, usual, model.parameter_sigma)
        self.widths_ = {'state': model.state_sigma.copy(), 'parameters': known}
        self.widths_['state'][disc.LABEL] = 0.0
        self.label_noise_ = model.answer_noise
        self._take(fit.shared(self.model, tare))
        errors, stated = (part[:touched] for part in influence.held_out(group))
        states = fit.states[:touched]
        self._judge(signals, f[:touched], rows[:touched], errors, stated, group[:touched], states)
        if self.method_ == 'inversion' and self.config.stray_term:
            self._judge_magnets(self._frames(signals, self.start()), rows[:touched])

    def _tare_noise(self, signals: Signals, rows: Integers) -> Array:
        """Noise (p,) of the calibration's tares in each parameter: offsets alone (mT)."""
        noise, variance = np.zeros(len(self.model.parameter_sigma)), signals.baseline_variance
        if self.tared_ and variance is not None:
            count = len(self.config.positions)
            share = training_baseline_variance(signals.baseline[rows], variance[rows])
            noise[9 * count : 11 * count] = self.noise_ / disc.MT * np.sqrt(share)
        return noise

    def _calibration_frames(
        self, signals: Signals, stray: Array, rows: Integers, touched: int
    ) -> Frames:
        """Frames of a calibration: resting ones do not move, stray fields that are known hold."""
        frames = self._frames(signals, self.start()).of(rows)
        frames.information[:, disc.LABEL] = disc.LABEL_OFF**-2
        frames.information[touched:, : disc.UNIFORM] = RESTS**-2
        field, uniform = stray[rows] / disc.MT, slice(disc.UNIFORM, disc.MAGNET)
        field[:touched] = np.where(self.measured, field[:touched], 0.0)
        known = np.isfinite(field)
        frames.prior[:, uniform] = np.where(known, field, frames.prior[:, uniform])
        tight = np.where(known, frames.noise.min(axis=1, keepdims=True) ** -2, 0.0)
        frames.information[:, uniform] = np.maximum(frames.information[:, uniform], tight)
        return replace(frames, free=np.union1d(frames.free, [disc.LABEL]))

    def _learn_lag(
        self, signals: Signals, model: ModelPrior, references: Array, fit: Calibration,
        rows: Integers,
    ) -> None:  # fmt: skip
        """Take the time constant with which a calibration explains its frames best."""
        few = spread_rows(np.arange(len(rows)), FEW_ROWS)
        nothing = np.full((len(signals.good), 3), np.nan)
        costs: dict[float, float] = {}

        def cost(lag: float) -> float:
            self.thermometer_.lag_ = lag
            frames = self._calibration_frames(signals, nothing, rows[few], len(few))
            found = calibrate(
                model, frames, references[rows[few]], fit.states[few], begin=fit.parameters,
                most_steps=20, gain=1e-4,
            )  # fmt: skip
            costs[lag] = found.cost
            return found.cost

        best = min([0.0, *map(float, self.thermometer_.lags_)], key=cost)
        if best > 0:
            minimize_scalar(
                lambda log: cost(float(np.exp(log))), bounds=np.log([best / 3, 3 * best]),
                method='bounded', options={'xatol': 0.02},
            )  # fmt: skip
            best = min(costs, key=lambda lag: costs[lag])
        self.thermometer_.lag_ = best if costs[best] < costs[0.0] - CLEARLY else 0.0

    def _judge(
        self, signals: Signals, f: Array, rows: Integers,
        errors: Array, stated: Array, group: Integers, states: Array,
    ) -> None:  # fmt: skip
        """Choose between the inversion and the floor by errors on groups held out; scale both."""
        drivers: Array = self._drivers(states)
        shares = {'inversion': relative(errors, self.spread_)}
        floor = self.estimator if self.estimator in ESTIMATORS[1:] else 'polynomial'
        x, self.method_ = self._features(signals)[rows], 'inversion'
        scale: Array | None = stated
        whole = np.isfinite(np.column_stack([x, f])).all(axis=1)
        if self.estimator == floor or whole.any():
            other = select({floor: self._regressor(floor)}, x, f, group)
            shares[floor] = relative(other.residuals, self.spread_)
            better = shares[floor] < shares['inversion'] and self.estimator is None
            if self.estimator == floor or better:
                self.method_, self.regressor_ = floor, self._regressor(floor).fit(x, f, group)
                errors, group, drivers, scale = other.residuals, other.groups, other.x, None
        self.covariance_ = CovarianceModel().fit(errors, scale, group, drivers)
        sigma = np.sqrt(np.einsum('sii->si', self.covariance_.predict(scale, drivers)[0]))
        self._report_errors(errors, sigma, group, shares)
        sizes: dict[str, float] = {}
        for (name, _), column in zip(self.answers_, f.T, strict=True):
            sizes[str(name)] = max(sizes.get(str(name), 0.0), float(np.nanmax(np.abs(column))))
        force = sizes.get('force', 0.0)
        more = max(1.0, self.config.full_scale / force) if force > 0 else 1.0
        most = [more * sizes[str(name)] for name, _ in self.answers_]
        self.largest_ = np.array([size if size > 0 else np.inf for size in most])

    def _drivers(self, states: Array) -> Array:
        """Places (s, 3), and the magnet's temperature where the fit saw several."""
        columns, sizes = self._driving
        return states.take(columns, axis=1) / sizes

    @cached_property
    def _driving(self) -> tuple[Integers, Array]:
        """States (m,) that drive errors, and their sizes (m,)."""
        columns = np.append(np.arange(disc.TILT), disc.MAGNET)
        sizes = np.append(np.full(disc.TILT, self.unit_), self.thermometer_.spread_)
        count = disc.TILT + self.thermometer_.varies
        return columns[:count], sizes[:count]

    def _features(self, signals: Signals) -> Array:
        """Features of regressors: fields (s, 2 t) (T), and the temperature where it varied."""
        count = len(signals.good)
        field = signals.values.reshape(count, -1) / self._sensitivity(signals.temperature_c)
        if self.tared_:
            usual = self._sensitivity(signals.rest_temperature_c)
            field = field - signals.baseline.reshape(count, -1) / usual + self.level_
        if not self.thermometer_.varies:
            return field
        warm = self.thermometer_.follow(signals, self.start())[:, 2:3] / 25.0
        return np.concatenate([field, warm], axis=1)

    def _regressor(self, name: str) -> Estimator:
        """A regressor of `_features`."""
        if name == 'polynomial':
            return ThermalPolynomial() if self.thermometer_.varies else PolynomialForce()
        return Ridge()

    # -- magnets nearby ----------------------------------------------------------------------

    def _judge_magnets(self, frames: Frames, rows: Integers) -> None:
        """Learn how far to trust what is answered beside magnets, on presses beside dipoles."""
        rng = np.random.default_rng(0)
        part = frames.of(rng.choice(rows, NEAR_ROWS))
        clean = self.invert(part)
        opened = 3 + int(self.measured.sum())
        limit = chi2.ppf(1 - CHANCE, max(len(self.level_) - opened, 1))
        self.threshold_ = max(float(limit), 2 * float(np.quantile(clean.chi_square, 0.99)))
        field = disc.near_fields(self.config.positions, NEAR_ROWS, rng)
        field *= 10 ** rng.uniform(*NEAR_MOMENT, (NEAR_ROWS, 1, 1))
        axes = disc.chip_axes(self.config)[:, :, [0, 2]]
        read = np.einsum('tik,sti->stk', axes, field) / disc.MT
        beside = replace(part, readings=part.readings + read.reshape(NEAR_ROWS, -1))
        found = self.invert(beside)
        near = np.flatnonzero(found.chi_square > self.threshold_)
        self.near_scale_ = np.ones(len(self.answers_))
        if len(near):
            said = self._invert_disturbed(beside.of(near), found.states[near])
            error = np.abs(said.answers - clean.answers[near])
            sigma = np.sqrt(np.einsum('sii->si', said.answer_covariance))
            self.near_scale_ = np.nanquantile(error / sigma, TWO_SIGMA, axis=0) / 2

    def _invert_disturbed(self, frames: Frames, states: Array) -> Posterior:
        """Answers with patterns of a magnet nearby, whose size follows from what is left over."""
        model, fit = self.model, self.fit_
        opened = np.append(np.arange(3), disc.UNIFORM + np.flatnonzero(self.measured))
        information = frames.information.copy()
        read, slopes = disc.readings_of(model, fit.parameters, states)
        for row, y in enumerate(frames.readings):
            use, noise = np.isfinite(y), frames.noise[row]
            slope, left = (slopes[row] / noise[:, None])[use], ((y - read[row]) / noise)[use]
            ways = np.linalg.svd(slope[:, opened])[0][:, len(opened) :]
            seen = ((ways.T @ slope[:, disc.NEAR :]) ** 2).sum()
            size = ((ways.T @ left) ** 2).sum() / max(seen, 1e-300)
            information[row, disc.NEAR :] = 1 / max(size, disc.FIELD_LEAST)
        free = np.union1d(frames.free, np.arange(disc.NEAR, disc.STATES))
        beside = replace(frames, information=information, free=free)
        return invert(model, fit, beside, states)

    # -- use ---------------------------------------------------------------------------------

    def estimate(self, signals: Signals, memory: object) -> Columns:
        """Targets, covariances, stray field and flags; NaN for what was never learned.

        The memory (7,) of the stream moves on.
        """
        if self.regressor_ is not None:
            answers, covariance, field, beyond = self._regress(signals)
            near = np.zeros(len(field), bool)
        else:
            answers, covariance, field, beyond, near = self._estimate(signals, np.asarray(memory))
        names, target, axis = self._placed
        count, chips = len(answers), signals.temperature_c
        mean, spread = np.empty((len(names), count, 3)), np.empty((len(names), count, 3, 3))
        valid, status = np.empty(count, bool), np.empty(count, np.int64)
        answer_rows(
            answers, covariance, signals.in_contact, self.largest_, target, axis, signals.values,
            self._clipping, near, beyond, np.empty((0, 0)) if chips is None else chips,
            self._usual_span, mean, spread, valid, status,
        )  # fmt: skip
        known: Columns = {'stray_field': field, 'status': status}
        for name, own, one in zip(names, mean, spread, strict=True):
            known[name], known[f'{name}_cov'] = own, one
        if names:
            known['valid'] = valid
        return known

    def _estimate(
        self, signals: Signals, memory: Array
    ) -> tuple[Array, Array, Array, Bools, Bools]:
        """Answers, covariances, stray field by inversion; rows out of range, beside a magnet."""
        frames = self._frames(signals, memory)
        found = self.invert(frames)
        answers, covariance, states = found.answers, found.answer_covariance, found.states
        near, beyond = found.chi_square > self.threshold_, np.zeros(len(states), bool)
        if np.count_nonzero(near):
            rows = np.flatnonzero(near)
            beside = self._invert_disturbed(frames.of(rows), states[rows])
            answers[rows], states[rows] = beside.answers, beside.states
            covariance[rows] = scaled(beside.answer_covariance, self.near_scale_)
        if self.covariance_ is not None:
            covariance = covariance + self._least_variance
            covariance, beyond = self.covariance_.predict(covariance, self._drivers(states))
        field = self._shown * states[:, disc.UNIFORM : disc.MAGNET]
        return answers, covariance, field, beyond, near

    @cached_property
    def _field_of_channels(self) -> Array:
        """Uniform field per reading of each channel (2 t, 3), where there is no magnet."""
        axes = disc.chip_axes(self.config)[:, :, [0, 2]].transpose(0, 2, 1).reshape(-1, 3)
        return np.asarray(np.linalg.pinv(axes).T, np.float64)

    @cached_property
    def _clipping(self) -> Array:
        """Size of a reading (2,) so near its limit that noise may hide that it is clipped."""
        if self.config.saturation is None:
            return np.full(2, np.inf)
        limit = np.broadcast_to(np.asarray(self.config.saturation, np.float64), 2)
        return limit - np.minimum(SIGMAS * self.noise_, MOST_MARGIN * limit)

    @cached_property
    def _shown(self) -> Array:
        """Tesla per mT of the components (3,) of a uniform field that are measured, or NaN."""
        return np.where(self.measured, disc.MT, np.nan)

    @cached_property
    def _least_variance(self) -> Array:
        """Covariance (l, l) of references, than which no function of the place is better."""
        return np.diag((disc.LEAST_NOISE * self.spread_) ** 2)

    def _regress(self, signals: Signals) -> tuple[Array, Array, Array, Bools]:
        """Answers, covariances and stray field by a regressor; rows out of range."""
        assert self.regressor_ is not None
        assert self.covariance_ is not None
        x = self._features(signals)
        covariance, beyond = self.covariance_.predict(None, x)
        change = (x[:, : len(self.level_)] - self.level_).reshape(len(x), -1, 2)
        field = change.reshape(len(x), -1) @ self._field_of_channels
        field = np.where(self.measured, field, np.nan)
        return self.regressor_.predict(x), covariance, field, beyond

    @cached_property
    def _usual_span(self) -> Array:
        """Least and highest temperature (degrees Celsius) that the fit saw; infinite: any."""
        known = self.answers_ and np.isfinite(self.thermometer_.span_[0])
        margin = LEAST_RANGE if known else np.inf
        return np.asarray(self.thermometer_.span_ + np.array([-margin, margin]))

    @cached_property
    def _placed(self) -> tuple[list[str], Integers, Integers]:
        """Names of targets (k,), and target and component (l,) of every answer."""
        names = list(dict.fromkeys(str(one) for one, _ in self.answers_))
        place = [(names.index(str(one)), int(axis)) for one, axis in self.answers_]
        target, axis = np.array(place, np.int64).reshape(-1, 2).T
        return names, np.ascontiguousarray(target), np.ascontiguousarray(axis)

    @property
    def _components(self) -> Iterator[tuple[str, Integers, Integers]]:
        """Targets with the numbers of their answers, and the components that these are."""
        names, target, axis = self._placed
        for number, name in enumerate(names):
            own = np.flatnonzero(target == number)
            yield name, own, axis[own]

    # -- report ------------------------------------------------------------------------------

    def _report_errors(
        self, errors: Array, sigma: Array, group: Integers, shares: dict[str, float]
    ) -> None:
        """Errors on held-out groups, by target."""
        for name, own, components in self._components:
            axes = ['xyz'[axis] for axis in components]
            rows = np.isfinite(errors[:, own]).all(axis=1)
            if not rows.any():
                continue
            part, spread = errors[rows][:, own], sigma[rows][:, own]
            self.report_[f'{name}_{"".join(axes)}'] = {
                **held_out_report(part, spread, group, len(part), {}),
                'held_out_p95': float(np.percentile(np.linalg.norm(part, axis=1), 95)),
                'inside_two_sigma': float((np.abs(part) <= 2 * spread).mean()),
                **{f'rmse_{axis}': float(np.sqrt((part[:, i] ** 2).mean()))
                   for i, axis in enumerate(axes)},
                **{f'reference_noise_{axis}': float(self.label_noise_[i])
                   for i, axis in zip(own, axes, strict=True)},
                **{f'share_{method}': share for method, share in shares.items()},
            }  # fmt: skip
        if self.method_ == 'inversion':
            found = disc.described(self.fit_.parameters, len(self.config.positions))
            self.report_['disc'] = {**found, 'thermal_lag': self.thermometer_.lag_}

    def _report_unsupported(self, f: Array, still: int) -> None:
        """Sentences on what the recordings of a fit did not show."""
        names = {str(name) for name, _ in self.answers_}
        missing = ' and '.join(name for name in TARGETS[:2] if name not in names)
        said = [f'{missing}: no truth had it, and the config has no stiffness'] if missing else []
        low, high = self.thermometer_.span_
        if len(f):
            full = self.config.full_scale
            loads = [
                f'{np.nanmin(column):.2g}..{np.nanmax(column):.2g} N along {"xyz"[int(axis)]}'
                for (name, axis), column in zip(self.answers_, f.T, strict=True)
                if name == 'force' and max(-np.nanmin(column), np.nanmax(column)) < WHOLE * full
            ]
            if loads:
                said.append(f'force beyond {", ".join(loads)}; full scale is {full:.2g} N')
            if not np.isfinite([low, high]).all():
                said.append('temperature: no chip measured one')
            elif self.thermometer_.varies:
                said.append(f'temperatures beyond {low:.0f}..{high:.0f} C')
                if self.thermometer_.lag_ == 0 and not len(self.thermometer_.lags_):
                    said.append(
                        'how the disc lags behind the chip: neither stamps nor thermal_lag show it'
                    )
            else:
                said.append(f'temperatures other than about {0.5 * (low + high):.0f} C')
        if not still:
            said.append('gains and crossed axes beside forces: no rest in known fields')
        self.report_ |= {f'not learned: {one}': {} for one in said}


SATURATED, STRAY_FIELD = int(FrameStatus.SATURATED), int(FrameStatus.STRAY_FIELD)
OUT_OF_RANGE, ABSTAINED = int(FrameStatus.OUT_OF_RANGE), int(FrameStatus.ABSTAINED)


@compiled
def answer_rows(
    answers: Array, covariance: Array, contact: npt.NDArray[np.int8], largest: Array,
    target: Integers, axis: Integers, values: Array, clipping: Array, near: Bools, beyond: Bools,
    chips: Array, usual_c: Array, mean: Array, spread: Array, valid: Bools, status: Integers,
) -> None:  # fmt: skip
    """Write answers (s, l) as components of targets (k, s, 3), their covariances, and the status.

    In touched rows no component of a target is written where one cannot be; those with an answer
    left are `valid` (s,). In untouched rows, contact 0, 0 will be answered: what was estimated is
    the error of that, and its square belongs to the covariance. The status says which rows are
    clipped, `near` a magnet, `beyond` the fit, or of `chips` (s, t) (degrees Celsius; no row: not
    measured) beyond its usual ones (2,).
    """
    wrong = np.empty(len(mean), np.bool_)
    mean[:], spread[:] = np.nan, np.nan
    for s in range(len(answers)):
        still = contact[s] == 0
        valid[s] = wrong[:] = False
        chip = mean_row(chips[s]) if len(chips) > 0 else np.inf
        unusual = chip < usual_c[0] or chip > usual_c[1] or (beyond[s] and not still)
        status[s] = (STRAY_FIELD if near[s] else 0) | (OUT_OF_RANGE if unusual else 0)
        for q in range(values.shape[1]):
            for c in range(len(clipping)):
                if abs(values[s, q, c]) >= clipping[c]:
                    status[s] |= SATURATED
        for i in range(len(target)):
            impossible = not abs(answers[s, i]) <= FARTHEST * largest[i]
            impossible |= covariance[s, i, i] > largest[i] ** 2
            wrong[target[i]] |= impossible and not still
        for i in range(len(target)):
            if wrong[target[i]]:
                status[s] |= ABSTAINED
                continue
            mean[target[i], s, axis[i]] = answers[s, i]
            valid[s] |= math.isfinite(answers[s, i])
            for j in range(len(target)):
                if target[i] == target[j]:
                    hidden = answers[s, i] * answers[s, j] if still else 0.0
                    spread[target[i], s, axis[i], axis[j]] = covariance[s, i, j] + hidden


def relative(errors: Array, spread: Array) -> float:
    """Root mean square of errors (s, l) over the spread (l,) of each answer; inf: no error."""
    known = np.isfinite(errors)
    if not known.any():
        return float('inf')
    return float(np.sqrt(((errors / spread)[known] ** 2).mean()))


def rest_noise(signals: Signals, resting: Bools) -> float:
    """Noise of a channel (T) by resting rows (s,); of streams, what changes slowly left aside."""
    size = float(np.sqrt(signals.delta[resting].var(axis=0).mean()))
    if signals.stamp_ns is None or len(resting) < FEWEST_RESTING:
        return size
    # every row of a tare begins a baseline: streams are separated by their times
    step = sliding_window_view(np.diff(signals.stamp_ns), 3)
    even = (step.min(axis=1) > 0) & (step.max(axis=1) <= UNEVEN * step.min(axis=1))
    even &= sliding_window_view(resting, 4).all(axis=1)
    third = np.diff(signals.values, 3, axis=0)[even]
    if len(third) < FEWEST_RESTING:
        return size
    return min(size, float(np.sqrt((third**2).mean() / THIRD)))


def at_rest(signals: Signals, truth: Columns) -> Bools:
    """Rows (s,) that truth, or the readings, call untouched."""
    force = np.asarray(truth.get('force', np.full((len(signals.good), 3), np.nan)), float)
    free = np.nan_to_num(np.abs(force), nan=0.0).max(axis=1) == 0
    if 'in_contact' in truth:
        return np.asarray(np.asarray(truth['in_contact']) == 0)
    return np.asarray(free | (signals.in_contact == 0))
