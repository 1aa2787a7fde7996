"""Forces by equilibration [4], their sum and centre, and the objects whose outlines config tells.

Place and total force are regressed as well; what does better on held-out groups answers.
"""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, cast

import numpy as np

from tactile_ros.conditioning.equilibration import LAWS, Equilibration, silent_taxels
from tactile_ros.conditioning.history import History
from tactile_ros.conditioning.viscoelastic import Creep, CreepState
from tactile_ros.estimators.object_pose import ObjectPose
from tactile_ros.regression import CLASSES as REGRESSION_CLASSES
from tactile_ros.regression import ESTIMATORS as REGRESSION_ESTIMATORS
from tactile_ros.regression import Regression
from tactile_ros.regression.estimation import TIME_CONSTANTS
from tactile_ros.sensors.taxel_array.creep_fit import fit_creep
from tactile_ros.sensors.taxel_array.patches import ArrayPatches, ids_of
from tactile_ros.sensors.taxel_array.placing import place_objects
from tactile_ros.sensors.taxel_array.readout import Unmixing, area_correction
from tactile_ros.sensors.taxel_array.summing import add_sum
from tactile_ros.sensors.taxel_array.surface import touched_surface
from tactile_ros.types import TaxelStatus

if TYPE_CHECKING:
    from tactile_ros.conditioning.patch_ids import PatchIds
    from tactile_ros.sensors.taxel_array.config import TaxelArrayConfig
    from tactile_ros.signals import Columns, Report, SensorConfig, Signals
    from tactile_ros.types import Array, Bools, ContactState, Integers

ESTIMATORS = (*LAWS, *REGRESSION_ESTIMATORS)
FEWEST_ROWS = 5
QUANTUM = 2.8e-4  # standard deviation of rounding to 10 bits (fraction)
TEMPLATES, SUM, CENTRE = 'coverage templates', 'sum of taxels', 'centre of force'
UNLEARNED = 0.25  # spread of gains that nothing equilibrates
AROUND, GUESSED = 4, 0.5  # taxels that stand for a silent one; error in parts of its force
NEAR_ENOUGH = 0.03  # of the total force


class Memory(History):
    """What a stream remembers: the past of regressors, and strains of the skin."""

    def __init__(self, creep: CreepState | None, ids: PatchIds) -> None:
        super().__init__(np.array(TIME_CONSTANTS))
        self.creep = creep
        self.ids = ids


class TaxelRegression(Regression):
    """Laws of the taxels with their sum and centre, objects by their outline, and regressors.

    Parameters
    ----------
    config : TaxelArrayConfig
        Of the sensor.
    estimator : str or None
        A law: the taxels' forces alone by it; a regressor: place and total force alone; None:
        everything, the best on held-out groups.

    Attributes
    ----------
    law_ : Equilibration or None
        Forces of the taxels.
    shape_ : Equilibration or None
        Deformation of the taxels: the calibrated shape factor.
    creep_ : Creep or None
        What follows the laws in time, where that helped.
    silent_ : ndarray, shape (t,)
        Taxels found dead or stuck in the fit, without labels.
    noise_ : ndarray, shape (t,)
        Of outputs at rest (fraction).
    floor_, spread_ : float
        Error of a taxel's force: a constant part (N), and a part of the force.
    summed_ : bool
        Whether the total force is the sum of the taxels'.
    """

    def __init__(self, config: SensorConfig, estimator: str | None = None) -> None:
        super().__init__(config, None if estimator in LAWS else estimator, channels=1)
        self.only = estimator or ''
        self.config = cast('TaxelArrayConfig', config)
        self.law_: Equilibration | None = None
        self.shape_: Equilibration | None = None
        self.creep_: Creep | None = None
        taxels = len(config.positions)
        self.silent_: Bools = np.zeros(taxels, bool)
        self.noise_: Array = np.full(taxels, QUANTUM)
        self.floor_, self.spread_ = 0.0, UNLEARNED
        self.summed_ = False
        self.errors_: dict[str, float] = {}

    @cached_property
    def objects(self) -> ObjectPose | None:
        """Templates of config's objects; None: there are none, or they are not asked for."""
        known = self.config
        if self.only or not known.objects:
            return None
        return ObjectPose(known.positions, known.areas, known.taxel_outlines, known.objects)

    @cached_property
    def _alone(self) -> Unmixing:
        """Signals as of taxels that stand alone."""
        return Unmixing(self.config)

    @cached_property
    def patches(self) -> ArrayPatches:
        """Finder of patches on this array."""
        return ArrayPatches(self.config, self.noise_, self.law_, self.floor_)

    @property
    def estimators(self) -> dict[str, str]:
        """Name of the estimator in use for each target."""
        own = {}
        if self.law_ is not None:
            own['taxel_force'] = self.law_.name + (' with creep' if self.creep_ else '')
        if self.shape_ is not None:
            own['deformation'] = self.shape_.name
        learned = super().estimators
        if self.summed_:
            own['force'] = SUM
            if 'position' not in learned:
                own['position'] = CENTRE
        if self.config.objects and not self.only:
            own.update(label=TEMPLATES, yaw=TEMPLATES, object_pose=TEMPLATES, position=TEMPLATES)
        return {**learned, **own}

    @property
    def label_names(self) -> tuple[str, ...]:
        """Names of the objects of config."""
        return () if self.only else tuple(item.name for item in self.config.objects)

    @property
    def report(self) -> Report:
        """Errors on held-out groups; of the taxels' forces also on the rows learned from."""
        own = {} if self.law_ is None else {'taxel_force': self.errors_}
        return {**super().report, **own}

    def start(self) -> Memory:
        """Fresh memory of a stream."""
        return Memory(None if self.creep_ is None else self.creep_.start(), ids_of(self.config))

    def fit(self, signals: Signals, truth: Columns, groups: Columns) -> None:
        """Learn every target of which truth knows a component; see `Regression`."""
        self.law_, self.shape_, self.creep_, self.summed_ = None, None, None, False
        signals = self._alone(signals)
        output = signals.delta[..., 0]
        self._learn_rest(output, signals)
        force = self._told(truth, 'taxel_force', signals)
        self.silent_ = silent_taxels(output[signals.good], force, self.noise_)
        templates = self.objects  # made now, not under the first frame
        del templates
        for name in ('patches', '_around', '_rest_noise'):
            vars(self).pop(name, None)
        if self.only not in LAWS:
            super().fit(signals, truth, groups)
        if self.only not in ('', *LAWS):
            return
        wanted = self.only or None
        group = np.asarray(groups['group'], np.int64)[signals.good]
        if force is not None:
            clean = np.where(self.silent_, np.nan, force)
            self.law_ = Equilibration(wanted).fit(output[signals.good], clean, group)
            if not self.only:
                self._learn_creep(signals, truth, clean, group)
            self._measure(signals, truth)
        depth = self._told(truth, 'deformation', signals)
        if depth is not None and not self.only:
            self.shape_ = Equilibration().fit(output[signals.good], depth, group)

    def _learn_rest(self, output: Array, signals: Signals) -> None:
        """Noise of outputs (s, t) while nothing touches."""
        rest = output[(signals.in_contact == 0) & signals.good]
        seen = rest.std(axis=0) if len(rest) > 2 else np.zeros(output.shape[1])
        self.noise_ = np.maximum(np.nan_to_num(seen), QUANTUM)

    @staticmethod
    def _told(truth: Columns, name: str, signals: Signals) -> Array | None:
        """Truth of the taxels in usable rows; None where it is too little."""
        if name not in truth:
            return None
        told = np.asarray(truth[name], np.float64)[signals.good]
        return told if (np.isfinite(told).sum(axis=0) >= FEWEST_ROWS).any() else None

    def _learn_creep(
        self, signals: Signals, truth: Columns, force: Array, group: Integers
    ) -> None:
        """Laws and branches together, where stamps tell the past and it helps."""
        assert self.law_ is not None
        if signals.stamp_ns is None or not signals.good.all():
            return
        found = fit_creep(
            signals.delta[..., 0], force, signals.stamp_ns, signals.restart, group, self.law_
        )
        if found is not None:
            self.law_, self.creep_ = found

    def _measure(self, signals: Signals, truth: Columns) -> None:
        """Errors of the taxels' forces and of their sum on the rows learned from."""
        found = self._forces(signals, self.start())[signals.good]
        force = np.asarray(truth['taxel_force'], np.float64)[signals.good]
        miss = np.where(self.silent_, np.nan, found - force)
        known = np.isfinite(miss)
        if not known.any():
            return
        top = float(np.nanmax(force))
        light = known & (force < 0.03 * top)
        heavy = known & (force >= 0.1 * top)
        self.floor_ = float(1.4826 * np.median(np.abs(miss[light]))) if light.any() else 0.0
        part = (np.square(miss[heavy]) - self.floor_**2) / np.square(force[heavy])
        self.spread_ = float(np.sqrt(max(part.mean(), 1e-8))) if heavy.any() else UNLEARNED
        assert self.law_ is not None
        self.errors_ = {
            'fit_rmse': float(np.sqrt(np.square(miss[known]).mean())),
            'relative': self.spread_,
            'silent': float(self.silent_.sum()),
            **{f'held_out_{name}': error for name, error in self.law_.errors_.items()},
        }
        self.summed_ = not self.only and self._sum_is_best(found, truth, signals.good)

    def _sum_is_best(self, found: Array, truth: Columns, good: Bools) -> bool:
        """Whether the sum of the taxels' forces is nearer the truth than the regressors."""
        learned = [head for head in self._best if head.target == 'force' and 2 in head.columns]
        if not learned:
            return bool((np.isfinite(found).any(axis=0) | self.silent_).all())
        total = np.asarray(truth['force'], np.float64)[good, 2]
        miss = np.nansum(self._filled(found), axis=1) - total
        own = float(np.sqrt(np.nanmean(np.square(miss))))
        self.errors_['sum_rmse'] = own
        # a sum is physics: what is as good as this needs no regressor, which may not carry over
        if own < NEAR_ENOUGH * float(np.sqrt(np.nanmean(np.square(total)))):
            return True
        return own < min(head.report_['held_out_rmse'] for head in learned)

    def _forces(self, signals: Signals, memory: Memory) -> Array:
        """Forces (s, t) of outputs, the past of the skin undone (N)."""
        assert self.law_ is not None
        forces = self.law_.forces(signals.delta[..., 0])
        if self.creep_ is not None and signals.stamp_ns is not None:
            assert memory.creep is not None
            forces = self.creep_.undo(forces, signals.stamp_ns, signals.restart, memory.creep)
        forces = np.where(self.silent_, np.nan, forces)
        return np.asarray(forces)

    def estimate(self, signals: Signals, memory: object) -> Columns:
        """Targets of every row; see `Regression`."""
        assert isinstance(memory, Memory)
        signals = self._alone(signals)
        known = super().estimate(signals, memory)
        output = signals.delta[..., 0]
        forces = output
        if self.law_ is not None:
            forces = self._forces(signals, memory)
            known['taxel_force'] = forces
            if self.summed_:
                self._add_sum(known, forces)
        if self.shape_ is not None:
            known['deformation'] = self.shape_.forces(output)
        if self.silent_.any():
            dead = self.silent_ * np.uint8(TaxelStatus.DEAD)
            known['taxel_status'] = np.repeat(dead[None].astype(np.uint8), len(output), axis=0)
        if self.objects is not None:
            self._add_objects(known, forces, signals)
        if self.only in ('', *LAWS):
            self._add_patches(known, forces, signals, memory)
        return known

    def _add_patches(
        self, known: Columns, forces: Array, signals: Signals, memory: Memory
    ) -> None:
        """Contacts of every row; `known` is changed."""
        load, law = self._filled(forces), self.law_ is not None
        variance = self._variance(load) if law else np.square(UNLEARNED * np.nan_to_num(load))
        centred = 'position' not in super().estimators
        self.patches.add(known, load, variance, signals, memory.ids, (law, centred))

    def surface(self, state: ContactState) -> Array:
        """Points (t, 3) of the surface under a frame (m); NaN where nothing touches."""
        return touched_surface(self.config.positions, state, self.patches.least, self.shape_)

    def _filled(self, forces: Array) -> Array:
        """Forces (s, t) with those of silent taxels from the pressure around them."""
        if not self.silent_.any() or self.silent_.all():
            return forces
        areas, (silent, near) = self.config.areas, self._around
        filled = forces.copy()
        pressure = np.nan_to_num(forces)[:, near] / areas[near]
        filled[:, silent] = pressure.mean(axis=2) * areas[silent]
        return filled

    @cached_property
    def _around(self) -> tuple[Integers, Integers]:
        """Silent taxels (n,), and those nearest to each (n, AROUND)."""
        places = self.config.positions
        silent, live = np.flatnonzero(self.silent_), np.flatnonzero(~self.silent_)
        away = np.linalg.norm(places[silent, None] - places[None, live], axis=2)
        return silent, live[np.argsort(away, axis=1, kind='stable')[:, :AROUND]]

    @cached_property
    def _rest_noise(self) -> Array:
        """Of each taxel's force at rest (t,) (N); of its output where no law is known."""
        if self.law_ is None:
            return self.noise_
        gain = self.law_.forces(np.full((1, len(self.noise_)), 0.1))[0] / 0.1
        return np.asarray(np.nan_to_num(gain) * self.noise_)

    def _variance(self, forces: Array) -> Array:
        """Of each taxel's force (s, t) (N2)."""
        return np.asarray(self.floor_**2 + np.square(self.spread_ * np.nan_to_num(forces)))

    def _add_sum(self, known: Columns, forces: Array) -> None:
        """Total force and its place, with covariances; `known` is changed."""
        lost = np.isnan(forces)
        filled = self._filled(forces)
        load = np.where(np.isnan(filled), 0.0, filled)
        guessed = np.square(GUESSED * load)
        variance = np.where(lost, guessed, self.floor_**2 + np.square(self.spread_ * load))
        add_sum(known, load, variance, self.config)

    def _add_objects(self, known: Columns, forces: Array, signals: Signals) -> None:
        """Recognised objects; `known` is changed."""
        assert self.objects is not None
        learned = self.law_ is not None
        if not learned and np.isnan(forces).any():
            # at rest the taxels read nothing: without a baseline readings stand for themselves
            forces = np.where(np.isnan(forces), signals.values[..., 0], forces)
        spread = UNLEARNED if self.law_ is None else self.spread_
        asked = signals.good & (signals.in_contact != 0)
        errors = (self.floor_, self.spread_) if self.summed_ else None
        corrected, area_law = None, self.config.area_law
        if self.law_ is not None and area_law is not None:
            corrected = area_correction(
                self.law_, signals.delta[..., 0], forces, self.config.areas, area_law
            )
        place_objects(
            known,
            self.objects,
            forces,
            self._rest_noise,
            spread,
            asked,
            ~self.silent_,
            errors,
            corrected,
        )


CLASSES = (*REGRESSION_CLASSES, TaxelRegression, Equilibration, Creep)
