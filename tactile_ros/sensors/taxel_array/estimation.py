# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Forces by equilibration [4], their sum and centre, objects of the config, learned targets."""

from __future__ import annotations

from functools import cached_property, partial
from typing import cast

import numpy as np

from tactile_ros.conditioning.contact import PatchIds
from tactile_ros.conditioning.equilibration import LAWS, Equilibration, silent_taxels
from tactile_ros.conditioning.fading_memory import FadingMemory
from tactile_ros.conditioning.faults import UNUSABLE
from tactile_ros.conditioning.viscoelastic import Creep, CreepState, History, fit_creep
from tactile_ros.estimators.covariance import CovarianceModel
from tactile_ros.estimators.object_pose import ObjectPose
from tactile_ros.physics.coverage import LearnedFields
from tactile_ros.physics.crosstalk import Unmixing
from tactile_ros.sensors.regression import CLASSES as REGRESSION_CLASSES
from tactile_ros.sensors.regression import ESTIMATORS as REGRESSION_ESTIMATORS
from tactile_ros.sensors.regression import (
    KIND,
    TIME_CONSTANTS,
    Regression,
    missing_history,
    missing_loads,
)
from tactile_ros.sensors.taxel_array.config import TaxelArrayConfig
from tactile_ros.sensors.taxel_array.learned_object import FEWEST, LearnedObject
from tactile_ros.sensors.taxel_array.recognition import ArrayPatches, partly_pressed, place_objects
from tactile_ros.types import (
    Array,
    Bools,
    Bytes,
    Columns,
    ContactState,
    FrameStatus,
    Integers,
    Report,
    SensorConfig,
    Signals,
    TaxelStatus,
)

ESTIMATORS = (*LAWS, *REGRESSION_ESTIMATORS)
TEMPLATES, SUM, CENTRE = 'coverage templates', 'sum of taxels', 'centre of force'
LEARNED = 'learned fields of pressure'
QUANTUM = 2.8e-4  # standard deviation of rounding to 10 bits (fraction)
BELOW = -0.1  # of the range: a converter reads no less than ground, but for its offset
FEWEST_ROWS = 5  # of a taxel
UNLEARNED = 0.25  # spread of gains that nothing equilibrates
LEAST_SPREAD = 1e-3  # of a force: no law is better
MOST_LOST = 0.5  # of the taxels of a frame that still says something
UNDONE = 0.1  # error of what creep is undone, in parts of it
NEAR_ENOUGH = 0.03  # of the total force
HEAVY = 0.1  # of the largest force: heavier errors are parts of the force
SIGMAS, LIGHT = 6.0, 3.0  # of the noise, and errors of a taxel at rest: more is touched
BEYOND, UNTOLD = 1.1, 0.5  # times the largest reference load; error of what lies beyond
AROUND, GUESSED = 4, 0.5  # taxels that stand for a lost one; error of its force, in parts


class Memory(FadingMemory):
    """The past of regressors, strains of the skin, ids of patches, level of the last tare.

    A baseline that follows what rests would take a skin that creeps back for drift: where creep
    is undone, outputs are above the level at which the stream began. `rest` is the baseline of
    the fit and how far a skin that was never pressed is above it, each (t,).
    """

    def __init__(
        self, creep: CreepState | None, ids: PatchIds, rest: tuple[Array, Array] | None
    ) -> None:
        super().__init__(np.array(TIME_CONSTANTS))
        self.creep = creep
        self.ids = ids
        self.rest = rest
        self.level: Array | None = None

    def above_tare(self, signals: Signals) -> Array:
        """Outputs (s, t) above the baseline (t,) with which their stream began; NaN: unusable."""
        delta = signals.delta[..., 0]
        if signals.stamp_ns is None or not len(delta):
            return delta
        base = signals.baseline[..., 0]
        first = np.maximum.accumulate(np.where(signals.restart, np.arange(len(base)), -1))
        held = base[np.maximum(first, 0)]
        if self.rest is not None:
            baseline, above = self.rest
            untared = np.all((held == baseline) | np.isnan(baseline), axis=1)
            held = np.where(untared[:, None], held + above, held)
        if self.level is not None:
            held[first < 0] = self.level
        self.level = held[-1]
        return np.where(np.isnan(delta), np.nan, signals.values[..., 0] - held)


def reference(truth: Columns, name: str, good: Bools) -> Array | None:
    """Reference values of the taxels in usable rows (s,); None where there are too few."""
    if name not in truth:
        return None
    values = np.asarray(truth[name], np.float64)[good]
    return values if (np.isfinite(values).sum(axis=0) >= FEWEST_ROWS).any() else None


class TaxelRegression(Regression):
    """Laws of the taxels with their sum and centre, objects by their outline, and regressors.

    `estimator` is a law: the taxels' forces alone by it; a regressor: place and total force alone;
    None: everything, the best on held-out groups.
    """

    has_surface = True
    law_: Equilibration | None  # forces of the taxels
    shape_: Equilibration | None  # deformation of the taxels: the calibrated shape factor
    creep_: Creep | None  # memory of the skin, where that helped
    silent_: Bools  # (t,) taxels found dead or stuck in the fit, without labels
    noise_: Array  # (t,) of outputs at rest (fraction)
    idle_: Array  # (t,) error of the force of a taxel that bears nothing (N)
    light_: float  # error of the force of a lightly loaded taxel, where laws are least certain (N)
    spread_: float  # error of a taxel's force in parts of it
    total_: CovarianceModel | None  # of the sum of the taxels' forces
    learned_: LearnedObject | None  # whose yaw was labelled, where no outline is stated
    # (t,) baseline of the fit, and how far a skin that was never pressed is above it
    rest_: tuple[Array, Array] | None

    def __init__(self, config: SensorConfig, estimator: str | None = None) -> None:
        super().__init__(config, None if estimator in LAWS else estimator, channels=1)
        self.only = estimator or ''
        self.config = cast('TaxelArrayConfig', config)
        self._forget()
        taxels = len(config.positions)
        self.silent_, self.noise_ = np.zeros(taxels, bool), np.full(taxels, QUANTUM)
        self.idle_, self.light_, self.spread_ = np.zeros(taxels), 0.0, UNLEARNED
        self.errors_: dict[str, float] = {}
        self.open_: Report = {}

    @cached_property
    def objects(self) -> ObjectPose | None:
        """Objects of the config on this array; None: there are none, or they are not asked for."""
        config = self.config
        if self.only or not config.objects:
            return None
        return ObjectPose(config.positions, config.areas, config.taxel_outlines, config.objects)

    @cached_property
    def unmixing(self) -> Unmixing:
        """Signals as of taxels that stand alone."""
        config = self.config
        return Unmixing(config.crosstalk, config.positions, config.matrix_lines)

    @cached_property
    def patches(self) -> ArrayPatches:
        """Finder of patches on this array."""
        # a few frames of rest of one taxel say little: none is quieter than most
        least = SIGMAS * np.maximum(self.noise_, np.median(self.noise_))
        if self.law_ is not None:
            least = np.maximum(self.law_.forces(least[None])[0], LIGHT * np.median(self.idle_))
            least = np.where(np.isfinite(least), least, np.nanmedian(least))
        return ArrayPatches(self.config, least)

    @cached_property
    def largest(self) -> Array:
        """Largest force of each taxel (t,) (N) that was learned from; 1 without a law."""
        if self.law_ is None:
            return np.ones(len(self.noise_))
        most = np.nan_to_num(self.law_.forces(self.law_.top_[None])[0])
        return np.where(most > 0, most, max(float(most.max()), 1e-12))

    @cached_property
    def near(self) -> Integers:
        """Other taxels by their distance, the nearest few (t, n)."""
        from scipy.spatial import cKDTree

        places = self.config.positions
        count = min(4 * AROUND, len(places))
        if count < 2:
            return np.zeros((1, 0), np.int64)
        return np.asarray(cKDTree(places).query(places, [*range(2, count + 1)])[1].reshape(
            len(places), -1), np.int64)  # fmt: skip

    @property
    def estimators(self) -> dict[str, str]:
        """Name of the estimator in use for each target."""
        found = dict(super().estimators)
        if self.total_ is not None:
            found['force'] = SUM
            found.setdefault('position', CENTRE)
        if self.law_ is not None:
            found['taxel_force'] = self.law_.name + (' with creep' if self.creep_ else '')
        if self.shape_ is not None:
            found['deformation'] = self.shape_.name
        if self.config.objects and not self.only:
            found.update(label=TEMPLATES, yaw=TEMPLATES, object_pose=TEMPLATES, position=TEMPLATES)
        if self.learned_ is not None:
            found.update(yaw=LEARNED, position=LEARNED)
        return found

    @property
    def label_names(self) -> tuple[str, ...]:
        """Names of the objects of config, or the numbers of learned classes."""
        if self.only or not self.config.objects:
            return super().label_names
        return tuple(item.name for item in self.config.objects)

    @property
    def report(self) -> Report:
        """Errors on held-out groups, of forces also on the rows learned from; what is open."""
        own = {} if self.law_ is None else {'taxel_force': self.errors_}
        if self.learned_ is not None:
            own['yaw'] = self.learned_.report_
        return {**super().report, **own, **self.open_}

    def _forget(self) -> None:
        """Forget what was learned, and what follows from laws."""
        self.law_ = self.shape_ = self.creep_ = self.total_ = self.rest_ = self.learned_ = None
        self._renew()

    def _renew(self) -> None:
        """Forget what follows from laws."""
        for name in ('patches', 'largest'):
            vars(self).pop(name, None)

    def start(self) -> Memory:
        """Fresh memory of a stream."""
        creep = None if self.creep_ is None else self.creep_.start()
        return Memory(creep, ArrayPatches.ids(self.config), self.rest_)

    def fit(self, signals: Signals, truth: Columns, groups: Columns) -> None:
        """Learn every target of which truth knows a component; see `Regression`."""
        self._forget()
        signals = self.unmixing(signals)
        good, output = signals.good, signals.delta[..., 0]
        force = reference(truth, 'taxel_force', good)
        untouched = (signals.in_contact == 0)[good]
        if force is not None:  # a load too light to be seen as a contact is no rest
            untouched &= ~(np.nan_to_num(force) > 0).any(axis=1)
        rest = output[good][untouched]
        seen = rest.std(axis=0) if len(rest) > 2 else np.zeros(output.shape[1])
        self.noise_ = np.maximum(np.nan_to_num(seen), QUANTUM)
        self.silent_ = silent_taxels(output[good], force, self.noise_)
        _ = self.objects  # made now, not under the first frame
        if self.only not in LAWS:
            described = ('label', 'yaw') if self.objects is not None else ()
            learned = {name: x for name, x in truth.items() if name not in described}
            super().fit(signals, learned, groups)
        if self.only in ('', *LAWS) and not self.silent_.all():
            group = np.asarray(groups['group'], np.int64)[good]
            if force is not None:
                self._learn_laws(signals, truth, np.where(self.silent_, np.nan, force), group)
                if self.objects is None and not self.only:
                    self._learn_object(signals, truth)
            depth = reference(truth, 'deformation', good)
            if depth is not None and not self.only:
                self.shape_ = Equilibration().fit(output[good], depth, group)
        self.open_ = self._left_open(signals, truth)

    def _learn_laws(self, signals: Signals, truth: Columns, force: Array, group: Integers) -> None:
        """Laws of the taxels, creep where stamps tell the past, and their errors."""
        good = signals.good
        output = signals.delta[good, :, 0]
        if signals.stamp_ns is not None and not self.only:
            output = self.start().above_tare(signals)[good]
            # a row that is left out hands the beginning of a stream on to the next
            begins = np.diff(np.cumsum(signals.restart)[good], prepend=0) > 0
            live, tare = ~self.silent_, signals.tare
            past = History(
                output[:, live], force[:, live], signals.stamp_ns[good], begins,
                tare is not None and bool(tare.any()),
            )  # fmt: skip
            found = fit_creep(past)
            if found is not None:
                creep, constant = found
                share = np.zeros((len(creep.tau), len(self.silent_)))
                above = np.zeros(len(self.silent_))
                share[:, live], above[live] = creep.share, constant
                self.creep_ = Creep(creep.tau, share, creep.behind)
                if not past.tared:
                    self.rest_ = signals.baseline[good][0, :, 0], above
                output = self.start().above_tare(signals)[good]
                if creep.behind:
                    output = self.creep_.undo(output, past.stamp_ns, begins, self.creep_.start())
                else:
                    force = force + self.creep_.crept(force, past.stamp_ns, begins)
        self.law_ = Equilibration(self.only or None).fit(output, force, group)
        self._renew()
        self._measure(signals, truth, group)
        self.law_.held_out_ = np.zeros((0, 0))

    def _measure(self, signals: Signals, truth: Columns, group: Integers) -> None:
        """Errors of the taxels' forces and of their sum, of rows that the laws had not seen."""
        assert self.law_ is not None
        good = signals.good
        found = self._forces(signals, self.start())[good]
        force = np.asarray(truth['taxel_force'], np.float64)[good]
        fitted = np.where(self.silent_, np.nan, found - force)
        if not np.isfinite(fitted).any():
            return
        held = self.law_.held_out_
        # a split may hold out little: none errs less than on the rows learned from
        miss = np.where(np.abs(np.nan_to_num(held)) > np.abs(fitted), held, fitted)
        idle = np.isfinite(miss) & (force == 0)
        squared = np.where(idle, np.square(fitted), 0.0).sum(axis=0) / np.fmax(idle.sum(axis=0), 1)
        # the few rows of rest of one taxel say little: half of it is what all say
        noise = np.nan_to_num(self.law_.forces(np.full((1, len(force[0])), 0.1))[0]) * 10
        noise *= self.noise_
        self.idle_ = np.maximum(np.sqrt(0.5 * (squared + squared.mean())), noise)
        heavy = np.isfinite(miss) & (force > HEAVY * np.nanmax(force))
        parts = (miss / np.where(heavy, force, 1.0))[heavy]
        light = np.isfinite(miss) & (force > 0) & ~heavy
        self.light_ = float(np.sqrt(np.mean(miss[light] ** 2))) if light.any() else 0.0
        self.spread_ = UNLEARNED
        if len(parts):
            self.spread_ = max(float(np.sqrt(np.mean(parts**2))), LEAST_SPREAD)
        self.errors_ = {
            'fit_rmse': float(np.sqrt(np.nanmean(np.square(fitted)))),
            'relative': self.spread_,
            'silent': float(self.silent_.sum()),
            **{f'held_out_{name}': error for name, error in self.law_.errors_.items()},
        }
        whole = np.isfinite(found).any(axis=0) | self.silent_
        if self.only or not whole.all():
            return
        load, variance = self._loads(found)
        variance = self._of_sums(load, variance)
        wrong = np.nansum(miss, axis=1) * (force.any(axis=1))
        if 'force' in truth:
            total = np.asarray(truth['force'], np.float64)[good, 2]
            wrong = np.where(np.isfinite(total), load.sum(axis=1) - total, wrong)
            if not self._sum_is_best(wrong, total):
                return
        loaded = np.nan_to_num(force).any(axis=1)
        if signals.stamp_ns is not None:  # rows of a press err together, presses by themselves
            group = np.cumsum(np.diff(loaded, prepend=False) & loaded)
        self.total_ = CovarianceModel().fit(
            wrong[loaded, None], np.sqrt(variance.sum(axis=1))[loaded, None], group[loaded],
            self._features(load[loaded]),
        )  # fmt: skip

    def _learn_object(self, signals: Signals, truth: Columns) -> None:
        """Learn the object whose pose is labelled; use it where it beats a regressed yaw."""
        blank = np.full((len(signals.good), 3), np.nan)
        plane = np.asarray(truth.get('position', blank), np.float64)[:, :2]
        yaw = np.asarray(truth.get('yaw', blank[:, 0]), np.float64)
        poses = np.column_stack([plane, yaw])
        rows = signals.good & np.isfinite(poses).all(axis=1)
        if np.count_nonzero(rows) < FEWEST:
            return
        force = self._forces(signals, self.start())[rows]
        sigma = np.sqrt(self._loads(force)[1])
        learned = LearnedObject(self.config).fit(force, sigma, poses[rows], ~self.silent_)
        regressed = np.inf if self.turn_ is None else self.turn_.report_['held_out_rmse']
        if learned.report_['held_out_rmse_yaw'] < regressed:
            self.learned_ = learned

    def _sum_is_best(self, wrong: Array, total: Array) -> bool:
        """The sum of the taxels' forces is nearer the truth than the regressors."""
        learned = [head for head in self._best if head.target == 'force' and 2 in head.columns]
        own = float(np.sqrt(np.nanmean(np.square(wrong))))
        self.errors_['sum_rmse'] = own
        # a sum is physics: what is as good as this needs no regressor, which may not carry over
        near = own < NEAR_ENOUGH * float(np.sqrt(np.nanmean(np.square(total))))
        return near or own < min((h.report_['held_out_rmse'] for h in learned), default=np.inf)

    def _features(self, load: Array) -> Array:
        """Features (s, 1) of what an error of the sum depends on: the largest part of a range."""
        return np.asarray((load / self.largest).max(axis=1, keepdims=True))

    def _left_open(self, signals: Signals, truth: Columns) -> Report:
        """Quantities that frames with their truth leave open."""
        blank = np.full((len(signals.good), len(self.silent_)), np.nan)
        force = np.asarray(truth.get('taxel_force', blank), np.float64)[signals.good]
        crept = 0.0 if self.creep_ is None else float(self.creep_.share.sum(axis=0).max())
        found = {**missing_loads(force), **missing_history(signals, crept)}
        pressed = (np.nan_to_num(force) > 0).any(axis=0) | self.silent_
        if pressed.any() and not pressed.all():
            found[f'{KIND}taxels that were never pressed'] = {'taxels': float((~pressed).sum())}
        if not np.isfinite(np.asarray(truth.get('deformation', blank), np.float64)).any():
            found[f'{KIND}shape factor (no truth of deformation): the array counts as rigid'] = {}
        return found

    def implausible_taxels(self, values: Array) -> Bools:
        """Taxels (s, t) of readings (s, t, c) that no converter can read: below ground."""
        return np.asarray((values < BELOW).any(axis=-1))

    def estimable_rows(self, bits: Bytes) -> Bools:
        """Frames (s,) of which so many taxels (s, t) may be used that the rest tells enough."""
        faulty: Array = np.mean((bits & UNUSABLE) > 0, axis=1)
        regressed = self.only not in ('', *LAWS)  # regressors alone need every taxel
        return np.asarray(faulty <= (0.0 if regressed else MOST_LOST))

    def _forces(self, signals: Signals, memory: Memory) -> Array:
        """Forces (s, t) of outputs, the past of the skin undone (N)."""
        assert self.law_ is not None
        if self.creep_ is None or signals.stamp_ns is None:
            forces = self.law_.forces(signals.delta[..., 0])
        else:
            assert memory.creep is not None
            output = memory.above_tare(signals)
            undo = partial(
                self.creep_.undo, stamp_ns=signals.stamp_ns, restart=signals.restart,
                state=memory.creep,
            )  # fmt: skip
            crept = self.law_.forces(output)
            forces = self.law_.forces(undo(output)) if self.creep_.behind else undo(crept)
            # frames in which only the past is read are untouched
            least = self.patches.least + UNDONE * np.abs(crept - forces)
            pressed = (np.nan_to_num(forces) > least).any(axis=1)
            signals.in_contact[(signals.in_contact == 1) & ~pressed] = 0
        return np.asarray(np.where(self.silent_, np.nan, forces))

    def _parts(self, load: Array) -> Array:
        """Errors (s, t) of loads in parts of them."""
        beyond = np.maximum(1.0 - BEYOND * self.largest / np.maximum(load, 1e-300), 0.0)
        return np.hypot(self.spread_, UNTOLD * beyond)

    def _loads(self, forces: Array) -> tuple[Array, Array]:
        """Forces (s, t) without gaps, and their variances."""
        lost, areas = np.isnan(forces), self.config.areas
        load = np.where(lost, 0.0, forces)
        if lost.any():  # the pressure of the nearest taxels that have one
            row, taxel = np.nonzero(lost & ~lost.all(axis=1, keepdims=True))
            others = self.near[taxel]
            pressure = forces[row[:, None], others] / areas[others]
            near = np.isfinite(pressure)
            near &= np.cumsum(near, axis=1) <= AROUND
            total = np.where(near, pressure, 0.0).sum(axis=1)
            load[row, taxel] = areas[taxel] * total / np.maximum(near.sum(axis=1), 1)
        variance = np.square(self._parts(load) * load)
        if self.law_ is not None:
            variance += self.idle_**2
        variance[lost] = np.square(GUESSED * load[lost])
        return load, variance

    def _of_sums(self, load: Array, variance: Array) -> Array:
        """Variances (s, t) of loads where many are added: laws err alike at light loads."""
        return variance + np.where(load > LIGHT * self.idle_, self.light_**2, 0.0)

    def estimate(self, signals: Signals, memory: object) -> Columns:
        """Targets of every row; see `Regression`."""
        assert isinstance(memory, Memory)
        signals = self.unmixing(signals)
        columns = super().estimate(signals, memory)
        output = forces = signals.delta[..., 0]
        if self.law_ is not None:
            columns['taxel_force'] = forces = self._forces(signals, memory)
        load, alone = self._loads(forces)
        variance = self._of_sums(load, alone)
        shared = self._add_sum(columns, load, variance)
        if self.shape_ is not None:
            columns['deformation'] = self.shape_.forces(output)
        if self.silent_.any():
            dead = self.silent_ * np.uint8(TaxelStatus.DEAD)
            columns['taxel_status'] = np.repeat(dead[None].astype(np.uint8), len(output), axis=0)
        asked = signals.good & (signals.in_contact != 0)
        if self.objects is not None:
            self._add_objects(columns, forces, signals, asked)
        if self.learned_ is not None:
            self.learned_.add(columns, forces, np.sqrt(alone), asked, ~self.silent_)
        if self.law_ is not None:
            beyond = forces > BEYOND * self.largest
            if 'taxel_status' in columns:
                beyond &= columns['taxel_status'] == 0
            status = np.asarray(columns.get('status', np.zeros(len(forces))), np.int64)
            far = (asked & beyond.any(axis=1)) * np.int64(FrameStatus.OUT_OF_RANGE)
            columns['status'] = status | far
        if self.only in ('', *LAWS):
            centred = self.total_ is not None
            centred &= not any(head.target == 'position' for head in self.heads_)
            centred &= self.learned_ is None
            self.patches.add(columns, load, variance, signals, memory.ids, shared, centred)
        return columns

    def _add_sum(self, columns: Columns, load: Array, variance: Array) -> Array | None:
        """Add the total force; return the part (s,) by which forces of a row err alike."""
        if self.law_ is None:
            return None
        if self.total_ is None:
            return np.zeros(len(load))
        total, own = load.sum(axis=1), variance.sum(axis=1)
        cov = self.total_.predict(np.sqrt(own)[:, None], self._features(load))[0][:, 0, 0]
        if 'force' not in columns:
            columns['force'] = np.full((len(load), 3), np.nan)
            columns['force_cov'] = np.full((len(load), 3, 3), np.nan)
        columns['force'][:, 2], columns['force_cov'][:, 2, 2] = total, cov
        excess = np.sqrt(np.maximum(cov - own, 0.0))
        return np.asarray(excess / np.where(total > 0, total, np.inf))

    def _add_objects(
        self, columns: Columns, forces: Array, signals: Signals, asked: Bools
    ) -> None:
        """Add recognised objects."""
        assert self.objects is not None
        law, config = self.law_, self.config
        if law is None and np.isnan(forces).any():
            # at rest the taxels read nothing: without a baseline readings stand for themselves
            forces = np.where(np.isnan(forces), signals.values[..., 0], forces)
        corrected = None
        if law is not None and config.area_law is not None:
            plain, area_law, output = forces.copy(), config.area_law, signals.delta[..., 0]

            def corrected(i: int, cover: Array) -> Array:
                return partly_pressed(law, output[i], plain[i], cover, config.areas, area_law)

        noise = self.noise_ if law is None else self.idle_
        place_objects(
            columns, self.objects, forces, noise, self._parts(np.nan_to_num(forces)), asked,
            ~self.silent_, corrected,
        )  # fmt: skip

    def surface(self, state: ContactState) -> Array:
        """Points (t, 3) of the surface under a frame (m); NaN where nothing touches.

        [4] Eq. (3) divides the deformation by the output, which is 0/0 without touch: the shape
        factor is a calibrated function instead, and that of a rigid array is 0.
        """
        touched = state.taxel_force > self.patches.least
        depth = state.deformation
        if self.shape_ is not None and not np.isfinite(state.taxel_force).any():
            touched = depth > self.shape_.forces(self.patches.least[None])[0]
        points = self.config.positions.copy()
        points[:, 2] -= np.nan_to_num(depth)
        points[~touched] = np.nan
        return points


CLASSES = (
    *REGRESSION_CLASSES, TaxelRegression, Equilibration, Creep, LearnedObject, LearnedFields,
)  # fmt: skip
