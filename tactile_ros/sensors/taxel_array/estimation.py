"""Forces by equilibration [4], their sum and centre, and the objects of the config.

Place and total force are regressed as well; what does better on held-out groups answers.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, cast

import numpy as np

from tactile_ros.conditioning.equilibration import LAWS, Equilibration, silent_taxels
from tactile_ros.conditioning.fading_memory import FadingMemory
from tactile_ros.conditioning.faults import UNUSABLE
from tactile_ros.conditioning.viscoelastic import Creep
from tactile_ros.estimators.covariance import BEYOND
from tactile_ros.estimators.object_pose import ObjectPose
from tactile_ros.physics.coverage import area_share
from tactile_ros.physics.crosstalk import alone, divided, without_floating, without_grounded
from tactile_ros.sensors.regression import CLASSES as REGRESSION_CLASSES
from tactile_ros.sensors.regression import ESTIMATORS as REGRESSION_ESTIMATORS
from tactile_ros.sensors.regression import (
    KIND,
    TIME_CONSTANTS,
    Regression,
    missing_history,
    missing_loads,
)
from tactile_ros.sensors.taxel_array.force_errors import (
    LEVELS,
    Gaps,
    fit_creep,
    force_errors,
    largest_forces,
    never_pressed,
)
from tactile_ros.sensors.taxel_array.object_recognition import (
    ArrayPatches,
    add_sum,
    ids_of,
    place_objects,
    touched_surface,
)
from tactile_ros.types import FrameStatus, TaxelStatus

if TYPE_CHECKING:
    from collections.abc import Callable

    from tactile_ros.conditioning.contact import PatchIds
    from tactile_ros.conditioning.equilibration import Equilibration
    from tactile_ros.conditioning.viscoelastic import CreepState
    from tactile_ros.sensors.taxel_array.config import TaxelArrayConfig
    from tactile_ros.types import (
        Array,
        Bools,
        Bytes,
        Columns,
        ContactState,
        Integers,
        Report,
        SensorConfig,
        Signals,
    )

SAME_LINE = 1e-6  # m
PRESSED = 0.05  # of a taxel: of less the area law says nothing
BELOW = -0.1  # of the range: a converter reads no less than ground, but for its offset


def below_ground(values: Array) -> Bools:
    """Taxels (s, t) of readings (s, t, c) that no converter can read.

    Examples
    --------
    >>> below_ground(np.array([[[0.4], [-0.4], [-0.001]]])).tolist()
    [[False, True, False]]
    """
    return np.asarray((values < BELOW).any(axis=-1))


def lines_of(positions: Array) -> Integers:
    """Row and column (t, 2) of taxels, by their y and x.

    Raises
    ------
    ValueError
        If two taxels would lie on the same crossing.
    """
    steps = np.rint(positions[:, 1::-1] / SAME_LINE).astype(np.int64)
    lines = np.stack([np.unique(s, return_inverse=True)[1].reshape(-1) for s in steps.T], axis=1)
    if len(np.unique(lines, axis=0)) < len(lines):
        msg = 'matrix_lines of TaxelArrayConfig must be given: two taxels have the same x and y'
        raise ValueError(msg)
    return lines


class Unmixing:
    """Outputs of a matrix as if every crossing stood alone.

    Parameters
    ----------
    config : TaxelArrayConfig
        Its `crosstalk` says what the other lines do; 'none' changes nothing.
    """

    def __init__(self, config: TaxelArrayConfig) -> None:
        self.kind = config.crosstalk
        if self.kind == 'none':
            return
        lines = config.matrix_lines
        known = lines_of(config.positions) if lines is None else lines.astype(np.int64)
        self.row, self.column = known.T
        self.shape = tuple(known.max(axis=0) + 1)

    def __call__(self, signals: Signals) -> Signals:
        """Signals whose values, baseline and their difference are without crosstalk."""
        if self.kind == 'none':
            return signals
        values = self.outputs(signals.values[..., 0])
        rest = self.outputs(signals.baseline[..., 0])
        delta = np.where(np.isnan(signals.delta[..., 0]), np.nan, values - rest)
        return replace(
            signals, values=values[..., None], baseline=rest[..., None], delta=delta[..., None]
        )

    def outputs(self, mixed: Array) -> Array:
        """Outputs (s, t) without crosstalk; a taxel that was not read conducts nothing."""
        told = np.nan_to_num(np.maximum(mixed, 0.0))
        matrix = np.zeros((len(mixed), *self.shape))
        matrix[:, self.row, self.column] = told
        if self.kind == 'grounded':
            clean = divided(without_grounded(matrix))
        else:
            seen, where = np.unique(matrix, axis=0, return_inverse=True)
            clean = np.stack([divided(without_floating(alone(one))) for one in seen])
            clean = clean[where.reshape(-1)]
        found = clean[:, self.row, self.column]
        # what reads less than nothing is noise, and stays
        found = found + np.minimum(np.nan_to_num(mixed), 0.0)
        return np.asarray(np.where(np.isnan(mixed), np.nan, found))


def area_correction(
    law: Equilibration, output: Array, forces: Array, areas: Array, area_law: Array
) -> Callable[[int, Array], Array]:
    """Forces of a frame once it is known how much of each taxel an object covers.

    Parameters
    ----------
    law : Equilibration
        Forces of outputs of taxels that are wholly pressed.
    output, forces : ndarray, shape (s, t)
        Outputs above the baseline, and forces by the law, creep undone (N).
    areas : ndarray, shape (t,)
        Of the taxels (m2).
    area_law : ndarray, shape (4,)
        p1..p4 of [4] Eq. (2).

    Returns
    -------
    callable
        Row and covered area (t,) (m2) -> forces (t,) (N).
    """
    forces = forces.copy()  # what is corrected is written where these came from

    def corrected(i: int, cover: Array) -> Array:
        row = output[i][None]
        share = area_share(cover, areas, area_law)
        plain = law.forces(row)[0]
        partly = (cover > PRESSED * areas) & (plain > 0)
        ratio = law.forces(row / share)[0] / np.where(partly, plain, 1.0)
        return np.asarray(np.where(partly, forces[i] * ratio, forces[i]))

    return corrected


class Memory(FadingMemory):
    """The past of regressors, strains of the skin, ids of patches, level of the last tare.

    A baseline that follows what rests would follow a skin that creeps back as well, and take it
    for drift: where creep is undone, outputs are above the level at which the stream began. A
    baseline that a fit made of rests between touches has some creep in it: `rest` is that baseline
    (t,), and how far a skin that was never pressed is above it.
    """

    def __init__(
        self, creep: CreepState | None, ids: PatchIds, rest: tuple[Array, Array] | None = None
    ) -> None:
        super().__init__(np.array(TIME_CONSTANTS))
        self.creep = creep
        self.ids = ids
        self.rest = rest
        self.level: Array | None = None

    def above_tare(self, signals: Signals) -> Array:
        """Outputs (s, t) above the baseline (t,) with which their stream began.

        Parameters
        ----------
        signals : Signals
            Conditioned frames; independent ones are as they are.

        Returns
        -------
        ndarray, shape (s, t)
            NaN where unusable.
        """
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


def beginnings(signals: Signals) -> Bools:
    """Good rows (n,) before which the past is forgotten."""
    # a row that is left out hands the beginning of a stream on to the next
    return np.asarray(np.diff(np.cumsum(signals.restart)[signals.good], prepend=0) > 0)


FEWEST_ROWS = 5  # of a taxel


def told(truth: Columns, name: str, good: Bools) -> Array | None:
    """Truth of the taxels in usable rows (s,); None where it is too little."""
    if name not in truth:
        return None
    known = np.asarray(truth[name], np.float64)[good]
    return known if (np.isfinite(known).sum(axis=0) >= FEWEST_ROWS).any() else None


def untold(signals: Signals, truth: Columns, silent: Bools, creep: Creep | None) -> Report:
    """What frames with their truth leave open.

    Parameters
    ----------
    signals : Signals
        Conditioned frames (s).
    truth : dict of str to ndarray, shape (s, ...)
        As in a Recording.
    silent : ndarray, shape (t,)
        Taxels that are dead or stuck.
    creep : Creep or None
        What was found of the skin's past.

    Returns
    -------
    dict of str to dict
        Names that begin with `KIND`, each with its figures.
    """
    blank = np.full((len(signals.good), len(silent)), np.nan)
    force = np.asarray(truth.get('taxel_force', blank), np.float64)[signals.good]
    crept = 0.0 if creep is None else float(creep.share.sum(axis=0).max())
    found = {**missing_loads(force), **missing_history(signals, crept)}
    pressed = (np.nan_to_num(force) > 0).any(axis=0) | silent
    if pressed.any() and not pressed.all():
        found[f'{KIND}taxels that were never pressed'] = {'taxels': float((~pressed).sum())}
    if not np.isfinite(np.asarray(truth.get('deformation', blank), np.float64)).any():
        found[f'{KIND}shape factor (no truth of deformation): the array counts as rigid'] = {}
    return found


def flag_beyond(known: Columns, forces: Array, most: Array, asked: Bools) -> None:
    """Say of rows where a taxel bears more than any load that was told of it.

    Taxels that have a status of their own do not count.

    Parameters
    ----------
    known : dict of str to ndarray, shape (s, ...)
        Estimates; `status` is added.
    forces : ndarray, shape (s, t)
        Of the taxels (N); NaN: not read.
    most : ndarray, shape (t,)
        Largest force of each taxel that was told (N).
    asked : ndarray, shape (s,)
        Rows that may be touched.
    """
    beyond = forces > BEYOND * most
    if not np.count_nonzero(beyond):
        return
    if 'taxel_status' in known:
        beyond &= np.asarray(known['taxel_status'], np.uint8) == 0
    status = np.asarray(known.get('status', np.zeros(len(forces))), np.int64)
    known['status'] = status | (asked & beyond.any(axis=1)) * np.int64(FrameStatus.OUT_OF_RANGE)


ESTIMATORS = (*LAWS, *REGRESSION_ESTIMATORS)
QUANTUM = 2.8e-4  # standard deviation of rounding to 10 bits (fraction)
TEMPLATES, SUM, CENTRE = 'coverage templates', 'sum of taxels', 'centre of force'
UNLEARNED = 0.25  # spread of gains that nothing equilibrates
MOST_LOST = 0.5  # of the taxels of a frame that still says something
UNDONE = 0.1  # error of what creep is undone, in parts of it
NEAR_ENOUGH = 0.03  # of the total force


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
    own_, alike_ : ndarray, shape (l,) and (2, l)
        Parts of its force by which a taxel errs, and all err alike; see `ForceErrors`.
    idle_ : ndarray, shape (t,)
        Error of the force of a taxel that bears nothing (N).
    rest_ : tuple of ndarray, shape (t,), or None
        Baseline of the fit, and how far a skin that was never pressed is above it.
    summed_ : bool
        Whether the total force is the sum of the taxels'.
    """

    has_surface = True

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
        self.own_: Array = np.full(len(LEVELS) + 1, UNLEARNED)
        self.alike_: Array = np.zeros((2, len(self.own_)))
        self.idle_: Array = np.zeros(taxels)
        self.summed_ = False
        self.rest_: tuple[Array, Array] | None = None
        self.errors_: dict[str, float] = {}
        self.untold_: Report = {}

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
        """Errors on held-out groups, of forces also on the rows learned from; what is open."""
        own = {} if self.law_ is None else {'taxel_force': self.errors_}
        return {**super().report, **own, **self.untold_}

    def start(self) -> Memory:
        """Fresh memory of a stream."""
        creep = None if self.creep_ is None else self.creep_.start()
        return Memory(creep, ids_of(self.config), self.rest_)

    def fit(self, signals: Signals, truth: Columns, groups: Columns) -> None:
        """Learn every target of which truth knows a component; see `Regression`."""
        self._learn(signals, truth, groups)
        self.untold_ = untold(signals, truth, self.silent_, self.creep_)

    def _learn(self, signals: Signals, truth: Columns, groups: Columns) -> None:
        """Rest, bad taxels, regressors, laws."""
        self.law_, self.shape_, self.creep_, self.summed_ = None, None, None, False
        self.rest_ = None
        signals = self._alone(signals)
        output = signals.delta[..., 0]
        self._learn_rest(output, signals)
        force = told(truth, 'taxel_force', signals.good)
        self.silent_ = silent_taxels(output[signals.good], force, self.noise_)
        _ = self.objects  # made now, not under the first frame
        for name in ('patches', '_gaps', '_rest_noise', '_most'):
            vars(self).pop(name, None)
        if self.only not in LAWS:
            super().fit(signals, truth, groups)
        if self.only not in ('', *LAWS):
            return
        group = np.asarray(groups['group'], np.int64)[signals.good]
        if force is not None and not self.silent_.all():
            clean = np.where(self.silent_, np.nan, force)
            self.law_ = Equilibration(self.only or None).fit(output[signals.good], clean, group)
            if not self.only:
                self._learn_creep(signals, truth, clean, group)
            self._measure(signals, truth)
        depth = told(truth, 'deformation', signals.good)
        if depth is not None and not (self.only or self.silent_.all()):
            self.shape_ = Equilibration().fit(output[signals.good], depth, group)

    def _learn_rest(self, output: Array, signals: Signals) -> None:
        """Noise of outputs (s, t) while nothing touches."""
        rest = output[(signals.in_contact == 0) & signals.good]
        seen = rest.std(axis=0) if len(rest) > 2 else np.zeros(output.shape[1])
        self.noise_ = np.maximum(np.nan_to_num(seen), QUANTUM)

    def _learn_creep(
        self, signals: Signals, truth: Columns, force: Array, group: Integers
    ) -> None:
        """Laws and branches together, where stamps tell the past and it helps."""
        assert self.law_ is not None
        if signals.stamp_ns is None:
            return
        good = np.flatnonzero(signals.good)
        output = self.start().above_tare(signals)[good]
        restart = beginnings(signals)
        stamps = signals.stamp_ns[good]
        above = never_pressed(output, force, stamps, restart, self.noise_)
        if above is not None:
            self.rest_ = signals.baseline[good[0], :, 0], above
            output = self.start().above_tare(signals)[good]
        found = fit_creep(output, force, stamps, restart, group, self.law_)
        if found is None:
            self.rest_ = None
            return
        self.law_, self.creep_ = found

    def _measure(self, signals: Signals, truth: Columns) -> None:
        """Errors of the taxels' forces and of their sum on the rows learned from."""
        assert self.law_ is not None
        found = self._forces(signals, self.start())[signals.good]
        force = np.asarray(truth['taxel_force'], np.float64)[signals.good]
        miss = np.where(self.silent_, np.nan, found - force)
        known = np.isfinite(miss)
        if not known.any():
            return
        begins = None if signals.stamp_ns is None else beginnings(signals)
        errors = force_errors(miss, force, self.law_, UNLEARNED, begins)
        self.floor_, self.spread_, self.own_, self.alike_, self.idle_ = errors
        self.errors_ = {
            'fit_rmse': float(np.sqrt(np.square(miss[known]).mean())),
            'relative': self.spread_,
            'relative of all alike': float(np.median(self.alike_[0])),
            'relative of hysteresis': float(np.median(self.alike_[1])),
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
        miss = np.nansum(self._gaps.filled(found), axis=1) - total
        own = float(np.sqrt(np.nanmean(np.square(miss))))
        self.errors_['sum_rmse'] = own
        # a sum is physics: what is as good as this needs no regressor, which may not carry over
        if own < NEAR_ENOUGH * float(np.sqrt(np.nanmean(np.square(total)))):
            return True
        return own < min(head.report_['held_out_rmse'] for head in learned)

    def implausible_taxels(self, values: Array) -> Bools:
        """Taxels (s, t) that read below ground."""
        return below_ground(values)

    def estimable_rows(self, bits: Bytes) -> Bools:
        """Frames (s,) of which so many taxels (s, t) may be used that the rest tells enough."""
        faulty: Array = np.mean((bits & UNUSABLE) > 0, axis=1)
        regressed = self.only not in ('', *LAWS)  # regressors alone need every taxel
        return np.asarray(faulty <= (0.0 if regressed else MOST_LOST))

    def _settle(self, signals: Signals, forces: Array, crept: Array) -> None:
        """Call frames untouched in which only the past is read; `in_contact` is changed."""
        least = self.patches.least + UNDONE * np.abs(crept - forces)
        pressed = (np.nan_to_num(forces) > least).any(axis=1)
        signals.in_contact[(signals.in_contact == 1) & ~pressed] = 0

    def _forces(self, signals: Signals, memory: Memory) -> Array:
        """Forces (s, t) of outputs, the past of the skin undone (N)."""
        assert self.law_ is not None
        if self.creep_ is None or signals.stamp_ns is None:
            forces = self.law_.forces(signals.delta[..., 0])
        else:
            assert memory.creep is not None
            crept = self.law_.forces(memory.above_tare(signals))
            forces = self.creep_.undo(crept, signals.stamp_ns, signals.restart, memory.creep)
            self._settle(signals, forces, crept)
        return np.asarray(np.where(self.silent_, np.nan, forces))

    def estimate(self, signals: Signals, memory: object) -> Columns:
        """Targets of every row; see `Regression`."""
        assert isinstance(memory, Memory)
        signals = self._alone(signals)
        known = super().estimate(signals, memory)
        output = forces = signals.delta[..., 0]
        if self.law_ is not None:
            forces = self._forces(signals, memory)
            known['taxel_force'] = forces
        idle = self.idle_ if self.idle_.any() else self._rest_noise
        loads = self._gaps.loads(forces, self.own_, self.alike_, self._most, idle)
        if self.summed_:
            add_sum(known, *loads)
        if self.shape_ is not None:
            known['deformation'] = self.shape_.forces(output)
        if self.silent_.any():
            dead = self.silent_ * np.uint8(TaxelStatus.DEAD)
            known['taxel_status'] = np.repeat(dead[None].astype(np.uint8), len(output), axis=0)
        if self.objects is not None:
            self._add_objects(known, forces, signals, loads[1:])
        if self.law_ is not None:
            flag_beyond(known, forces, self._most, signals.good & (signals.in_contact != 0))
        if self.only in ('', *LAWS):
            self._add_patches(known, loads, signals, memory)
        return known

    def _add_patches(
        self, known: Columns, loads: tuple[Array, Array, Array], signals: Signals, memory: Memory
    ) -> None:
        """Contacts of every row; `known` is changed."""
        load, variance, alike = loads
        shared = None if self.law_ is None else alike
        if shared is None:
            variance = np.square(UNLEARNED * load)
        centred = self.summed_ and not any(head.target == 'position' for head in self.heads_)
        self.patches.add(known, load, variance, signals, memory.ids, shared, centred)

    def surface(self, state: ContactState) -> Array:
        """Points (t, 3) of the surface under a frame (m); NaN where nothing touches."""
        return touched_surface(self.config.positions, state, self.patches.least, self.shape_)

    @cached_property
    def _gaps(self) -> Gaps:
        """Neighbours of taxels that were not read."""
        return Gaps(self.config.positions, self.config.areas, self.silent_)

    @cached_property
    def _rest_noise(self) -> Array:
        """Of each taxel's force at rest (t,) (N); of its output where no law is known."""
        if self.law_ is None:
            return self.noise_
        gain = self.law_.forces(np.full((1, len(self.noise_)), 0.1))[0] / 0.1
        return np.asarray(np.maximum(np.nan_to_num(gain) * self.noise_, self.idle_))

    @cached_property
    def _most(self) -> Array:
        """Largest force of each taxel (t,) (N) that was learned from; 1 where no law is known."""
        return np.ones(len(self.noise_)) if self.law_ is None else largest_forces(self.law_)

    def _add_objects(
        self, known: Columns, forces: Array, signals: Signals, shared: tuple[Array, Array]
    ) -> None:
        """Recognised objects; `known` is changed."""
        assert self.objects is not None
        learned = self.law_ is not None
        if not learned and np.isnan(forces).any():
            # at rest the taxels read nothing: without a baseline readings stand for themselves
            forces = np.where(np.isnan(forces), signals.values[..., 0], forces)
        asked = signals.good & (signals.in_contact != 0)
        summed = shared if self.summed_ else None
        corrected, area_law = None, self.config.area_law
        if self.law_ is not None and area_law is not None:
            corrected = area_correction(
                self.law_, signals.delta[..., 0], forces, self.config.areas, area_law
            )
        own = (self._rest_noise, self._gaps.parts(forces, self.own_, self._most))
        place_objects(known, self.objects, forces, *own, asked, ~self.silent_, summed, corrected)


CLASSES = (*REGRESSION_CLASSES, TaxelRegression, Equilibration, Creep)
