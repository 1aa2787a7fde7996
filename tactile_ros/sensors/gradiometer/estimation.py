"""Force, torque and stray field of the gradiometer: a disc's model where it helps.

What a uniform field cannot change, six differences of four pixels, is turned into the disc's
place by the model and into force and torque by polynomials; the printed chain of [3] and plain
regressors compete on held-out groups. What is left over tells of fields that are not uniform.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.conditioning.baseline import training_baseline_variance
from tactile_ros.estimators.disc_model import ENTRY
from tactile_ros.estimators.disturbance_magnet import (
    DIRECTIONS,
    NearbyMagnets,
    Seen,
    StrayField,
    magnet_fields,
    magnet_shape,
)
from tactile_ros.estimators.polynomial_ridge import times
from tactile_ros.physics.temperature import EXPANSION, REMANENCE_SLOPE
from tactile_ros.sensors.gradiometer.field_change import Features, at_rest, margins
from tactile_ros.sensors.gradiometer.target import (
    MODELS,
    Target,
    candidates,
    ends,
    largest,
    reject_implausible,
)
from tactile_ros.sensors.gradiometer.temperature import (
    LEAST_RANGE,
    UNIT,
    StreamMemory,
    beyond,
    lately_told,
)
from tactile_ros.sensors.regression import known_columns
from tactile_ros.types import Array, Estimation, FrameStatus

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tactile_ros.estimators.disturbance_magnet import NearbyMagnets
    from tactile_ros.estimators.model_selection import Selection
    from tactile_ros.sensors.gradiometer.config import GradiometerConfig
    from tactile_ros.sensors.gradiometer.field_change import Features
    from tactile_ros.sensors.gradiometer.target import Target
    from tactile_ros.types import Array, Bools, Columns, Integers, Report, Signals

WHOLE = 0.9  # of full scale
FEW_GROUPS = 8
WANTED = ('force', 'torque')


def unsupported(
    config: GradiometerConfig, features: Features, targets: Sequence[Target],
    reach: CalibratedVolume | None,
) -> list[str]:  # fmt: skip
    """Sentences on what was not told by the recordings of a fit; none before one."""
    if not features.readings_.fitted_:
        return []
    told = {target.name for target in targets}
    missing = ' and '.join(name for name in WANTED if name not in told)
    said = [f'{missing}: no truth told it, and the config has no stiffness'] if missing else []
    if targets:
        said += _range(config, targets) + _places(reach) + _groups(targets)
        said += _temperature(features.readings_.span_) + _warmth(features)
    if features.uniform_.uncertainty >= ENTRY:
        said.append('gains and crossed axes: no rest in known fields')
    return said


def _range(config: GradiometerConfig, targets: Sequence[Target]) -> list[str]:
    """Forces that were pressed, where full scale is farther."""
    spans = [
        (float(low), float(high), f'{low:.2g}..{high:.2g} N along {"xyz"[axis]}')
        for target in targets
        if target.name == 'force'
        for axis, low, high in zip(target.columns, *target.span_, strict=True)
    ]
    full = WHOLE * config.full_scale
    named = ', '.join(name for low, high, name in spans if max(-low, high) < full)
    return [f'force beyond {named}; full scale is {config.full_scale:.2g} N'] if named else []


def _places(reach: CalibratedVolume | None) -> list[str]:
    if reach is None or reach.directions_ == 3:
        return []
    return [f'forces along other ways than the {reach.directions_} that presses moved the disc']


def _groups(targets: Sequence[Target]) -> list[str]:
    groups = int(min(target.report_['groups'] for target in targets))
    return [f'errors of presses unlike the {groups} told'] if groups < FEW_GROUPS else []


def _temperature(span: Array) -> list[str]:
    low, high = (float(end) for end in span)
    if not np.isfinite([low, high]).all():
        return ['temperature: no chip told one']
    if high - low > LEAST_RANGE:
        return [f'temperatures beyond {low:.0f}..{high:.0f} C']
    return [f'temperatures other than about {0.5 * (low + high):.0f} C']


def _warmth(features: Features) -> list[str]:
    """How the disc follows the chip, and rows without a temperature of their own."""
    said = []
    if not features.lag_is_told:
        said.append('how the disc lags behind the chip: no stamps tell it, nor thermal_lag')
    if features.silent_:
        said.append(f'temperatures in {features.silent_} rows, which were not learned from')
    return said


REACH_LEAST = 0.02  # gaps: places that differ by less are alike
MARGIN = 1.05  # of what was seen
UNSURE = 0.5  # of the steepest slope of an answer, beyond all that was seen
UNTOLD = 1e6  # spreads of an answer over gaps: presses at one place tell no slope


class CalibratedVolume:
    """Ellipsoid around the places of a fit, and how unsure answers are outside it.

    Attributes
    ----------
    slope_ : ndarray, shape (k,)
        Steepest change of each answer with the place (unit of the answer, over gaps).
    """

    # (3,) and (3, 3) places in the ellipsoid have |shape (place - centre)| <= 1
    centre_: Array
    shape_: Array
    directions_: int  # along how many the places differed
    rest_: Array  # (3,) place of the disc that nothing touches (gaps); NaN where none was seen
    slope_: Array

    def fit(self, place: Array, answers: Array, rest: Array) -> CalibratedVolume:
        """Learn from places (s, 3) (gaps), answers (s, k) there, and places (r, 3) at rest."""
        rest = rest[np.isfinite(rest).all(axis=1)]
        self.rest_ = rest.mean(axis=0) if len(rest) else np.full(3, np.nan)
        self.centre_ = place.mean(axis=0)
        apart = place - self.centre_
        size, axes = np.linalg.eigh(apart.T @ apart / len(place))
        size = np.sqrt(np.maximum(size, 0.0))
        whole = axes.T / np.hypot(size, REACH_LEAST)[:, None]
        farthest = float(np.linalg.norm(apart @ whole.T, axis=1).max())
        self.shape_ = whole / (MARGIN * max(farthest, 1.0))
        told = axes[:, size > REACH_LEAST]
        self.directions_ = told.shape[1]
        slopes = np.linalg.lstsq(apart @ told, answers - answers.mean(axis=0), rcond=None)[0]
        steep = np.sqrt((slopes**2).sum(axis=0))
        self.slope_ = steep if self.directions_ else np.full(len(steep), UNTOLD)
        return self

    def beyond(self, place: Array) -> Array:
        """Distances (s,) (gaps) of places (s, 3) from the ellipsoid; 0 inside."""
        apart = place - self.centre_
        size = np.sqrt(((apart @ self.shape_.T) ** 2).sum(axis=1))
        outside = np.maximum(1 - 1 / np.maximum(size, 1.0), 0.0)
        return np.asarray(outside * np.sqrt((apart * apart).sum(axis=1)))

    def unfelt(self, place: Array) -> Array:
        """Distances (s,) (gaps) of places (s, 3), told to be untouched, that count as beyond.

        A touch lighter than all that a fit saw stays below the threshold of contact. Its force,
        told as 0, is as large as the steepest slope makes it.
        """
        away = np.nan_to_num(place - self.rest_)
        return np.asarray(np.sqrt((away * away).sum(axis=1)) / UNSURE)

    def doubt(self, beyond: Array) -> Array:
        """Standard deviations (s, k) of answers at distances (s,)."""
        return np.asarray(UNSURE * beyond[:, None] * self.slope_)


MANY = 30  # frames of a tare whose noise needs no mention
SMALL = 0.3  # of the noise: drifts that need none
DOUBTS_WARMER, HIGHER = UNIT * REMANENCE_SLOPE, UNIT * EXPANSION  # of remanence, of the gap
FEEBLE = 1e-3  # units of temperature
FEW = 1e-3  # degrees
OUTSIDE = 0.01  # of a component's spread, for a degree beyond the temperatures of the fit


def tare_doubt(
    features: Features, magnets: NearbyMagnets, signals: Signals, place: Array, learned: float,
    wider: Array,
) -> None:  # fmt: skip
    """Add to covariances (s, k, k) what the noise of a tare of few frames does.

    Parameters
    ----------
    features, magnets : Features, NearbyMagnets
        Of the calibration.
    signals : Signals
        Frames.
    place : ndarray, shape (s, 3)
        Of the disc.
    learned : float
        Variance that tares left in the calibration, over that of a frame.
    wider : ndarray, shape (s, k, k)
        Changed in place.
    """
    doubt = signals.baseline_variance
    if doubt is None or not np.count_nonzero(doubt):
        return
    rows = np.flatnonzero((doubt > 0) & (doubt + learned > 1 / MANY))
    if len(rows):
        variance = (doubt[rows] + learned) * features.readings_.noise**2
        cov = variance[:, None, None] * np.eye(features.projection.shape[1])
        wider[rows] += magnets.shaken(place[rows], cov, wider.shape[1])


def drift_doubt(
    features: Features, magnets: NearbyMagnets, signals: Signals, place: Array, wider: Array
) -> None:
    """Add to covariances (s, k, k) what drifts with the chip do that no recording told.

    Parameters are those of `tare_doubt`.
    """
    if signals.temperature_c is None:
        return
    readings, count = features.readings_, features.projection.shape[1]
    drift, unsure = readings.unsure_drifts(signals), readings.unsure_drift(count)
    size = (drift**2) @ unsure.diagonal().reshape(2, count).max(axis=1)
    rows = np.flatnonzero(size > (SMALL * readings.noise) ** 2)
    if len(rows):
        cov = unsure.reshape(2, count, 2, count)
        cov = np.einsum('si,imjn,sj->smn', drift[rows], cov, drift[rows])
        wider[rows] += magnets.shaken(place[rows], cov, wider.shape[1])


def warmth_doubt(
    features: Features, magnets: NearbyMagnets, signals: Signals, place: Array, field: Array,
    slope: Array, wider: Array,
) -> None:  # fmt: skip
    """Add to covariances (s, k, k) what a warmer disc does, where a fit saw one temperature.

    Parameters are those of `tare_doubt`, the `field` (s, n) (T), and the steepest change of
    answers with the place, `slope` (k,) (over gaps).
    """
    if signals.temperature_c is None or features.readings_.warm_:
        return
    warm = features.readings_.unsure_drifts(signals)[:, 0]
    rows = np.flatnonzero(np.abs(warm) > FEEBLE)
    if len(rows):
        weaker = (DOUBTS_WARMER * warm[rows])[:, None] * times(field[rows], features.projection)
        cov = weaker[:, :, None] * weaker[:, None]
        wider[rows] += magnets.shaken(place[rows], cov, wider.shape[1])
        higher = (HIGHER * warm[rows])[:, None] * slope
        wider[rows] += higher[..., None] ** 2 * np.eye(len(slope))


def outside_doubt(features: Features, signals: Signals, wider: Array) -> tuple[Bools, Array]:
    """Add to covariances (s, k, k) what temperatures beyond those of an even fit do.

    Rows (s,) where they are clearly beyond, or may be, and how far temperatures are from the
    middle of those of an uneven fit (s,), at least 1.
    """
    readings = features.readings_
    outside = beyond(signals, readings.span_)
    clearly, far = np.maximum(outside - LEAST_RANGE, 0.0), np.ones(len(outside))
    if not readings.warm_ and np.count_nonzero(clearly):
        wider += (OUTSIDE * clearly)[:, None, None] ** 2 * np.eye(wider.shape[1])
    elif readings.warm_ and np.count_nonzero(outside):
        far = ends(outside, readings.span_)
    return np.asarray((clearly > 0) | readings.unknown(signals)), far


def untold_doubt(
    features: Features, magnets: NearbyMagnets, signals: Signals, place: Array, field: Array,
    disc: Array, wider: Array,
) -> None:  # fmt: skip
    """Add to covariances (s, k, k) what temperatures do that chips did not tell.

    Parameters are those of `tare_doubt`, the `field` (s, n) (T), and what the temperature of the
    disc (s,) is wrong by, in the direction in which those of the chips are (degrees).
    """
    chips = features.readings_.unsure_chips(signals)
    if chips is None:
        if not np.count_nonzero(disc):
            return
        chips = np.zeros(signals.values.shape[:2])
    rows = np.flatnonzero((chips.max(axis=1) > FEW) | (disc > FEW))
    if len(rows):
        read = features.readings_.warmer_chips(field[rows], chips[rows])
        moved, slopes = times(read, features.projection), magnets.slopes(place[rows])
        count = moved.shape[1]
        off = (slopes[:, : wider.shape[1], :count] * moved[:, None]).sum(axis=2)
        if slopes.shape[2] > count:
            warmer = disc[rows, None] / UNIT
            off = off + slopes[:, : wider.shape[1], count] * warmer
        wider[rows] += off[:, :, None] * off[:, None]


TARGETS = ('position', 'force', 'torque')
RESPONSES = 400
DISTURBED, WARMER = 2e-5, 0.02  # T, unit of temperatures: a small field in one difference, a rise
SIMULATED, DISTANCES, MOMENTS = 900, (10e-3, 20e-3), (-3.0, -1.0)  # m, decades of A m2
LEAST = 1e-6  # of a component's spread: what noise does at least


class GradiometerEstimation(Estimation):
    """Estimators of one gradiometer.

    Parameters
    ----------
    config : GradiometerConfig
        Geometry and materials: where a fit starts.
    estimator : str or None
        One of `ESTIMATORS`; None: the best of them on held-out groups.
    """

    def __init__(self, config: GradiometerConfig, estimator: str | None = None) -> None:
        self.config = config
        self.estimator = estimator
        self.targets_: tuple[Target, ...] = ()
        self.features_, self.doubt_ = Features(config), 0.0
        self.stray_: StrayField | None = None
        self.magnets_: NearbyMagnets | None = None
        self.reach_: CalibratedVolume | None = None
        self.largest_: dict[str, float] = {}

    @property
    def estimators(self) -> dict[str, str]:
        """Name of the estimator in use for each target."""
        return {target.name: target.estimator_name for target in self.targets_}

    @property
    def report(self) -> Report:
        """Errors on held-out groups, what was found of the disc, and what was not told."""
        found = {target.title: target.report_ for target in self.targets_}
        if self.targets_ and self.features_.place_ is not None:
            found['disc'] = self.features_.place_.report
            found['disc']['thermal_lag'] = self.features_.lag_
        if self.targets_ and self.stray_ is not None:
            found['stray_field'] = self.stray_.report_
        for said in unsupported(self.config, self.features_, self.targets_, self.reach_):
            found[f'not told: {said}'] = {}
        return {**found, **self.features_.report}

    def start(self) -> StreamMemory:
        """Fresh memory of a stream."""
        return self.features_.start()

    def fit(self, signals: Signals, truth: Columns, groups: Columns) -> None:
        """Learn every target of which truth knows a component.

        Parameters
        ----------
        signals : Signals
            Conditioned frames.
        truth : dict of str to ndarray, shape (s, ...)
            As in a Recording; `stray_field` at rest gives gains and crossed axes.
        groups : dict of str to ndarray, shape (s,)
            'group' and 'session'.
        """
        aged = StreamMemory(0.0).with_temperatures(signals)
        signals = replace(aged, good=aged.good & lately_told(aged))
        rest = at_rest(signals, truth)
        stray = np.asarray(truth.get('stray_field', np.full((len(rest), 3), np.nan)), float)
        features = self.features_ = Features(self.config, self.estimator == 'history')
        features.silent_ = int(np.count_nonzero(aged.good & ~signals.good))
        self.doubt_ = training_baseline_variance(signals.baseline, signals.baseline_variance)
        modelled = self.estimator in (None, 'history', *MODELS)
        force = np.asarray(truth.get('force', np.full((len(rest), 3), np.nan)), float)
        change = features.fit(signals, stray, rest, ~rest & modelled, force)
        self.targets_, self.stray_, self.magnets_, self.reach_ = (), None, None, None
        thermal = features.thermal(signals, self.start())
        x, parts = features.table(change, thermal, signals, self.start())
        # untouched rows are 0 in use whatever is learned; they would make light of the errors
        held = self._learn_targets(x, parts, signals.good & ~rest, truth, groups)
        features.use({*self.estimators.values()})
        if features.place_ is not None and self.targets_:
            use = signals.good & ~rest & np.isfinite(x[:, parts['place']]).all(axis=1)
            group = np.asarray(groups['group'], np.int64)[use]
            self._learn_stray(x[use], parts, stray[use], group)
            self._learn_magnets(change[use], thermal[use])
            self._calibrate_magnets(change[use], thermal[use])
            self.reach_ = self._reach(x[use], parts, x[signals.good & rest][:, parts['place']])
        for (target, part), choice in zip(self._answered(), held, strict=True):
            target.calibrate(choice, self._noise(choice.x, parts)[:, part])
        self.largest_ = largest(self.targets_, self.config.full_scale)

    def _answered(self) -> list[tuple[Target, slice]]:
        """Targets, and where their components are among those of all."""
        found, first = [], 0
        for target in self.targets_:
            end = first + len(target.columns)
            found.append((target, slice(first, end)))
            first = end
        return found

    def _learn_stray(
        self, x: Array, parts: dict[str, Integers], stray: Array, groups: Integers
    ) -> None:
        """Learn what the disc alone leaves over, from touched rows."""
        where, rest, uniform = (x[:, parts[name]] for name in ('where', 'rest', 'uniform'))
        known = stray[:, self.features_.uniform_.seen]
        field = StrayField(len(parts['thermal']))
        self.stray_ = field.fit(where, rest, uniform, known, groups)

    def _reach(self, x: Array, parts: dict[str, Integers], rest: Array) -> CalibratedVolume:
        """Places of the fit; every component of a target may be as steep as the steepest."""
        told = np.concatenate([target.estimator_.predict(x) for target in self.targets_], axis=1)
        reach = CalibratedVolume().fit(x[:, parts['place']], told, rest)
        for target, part in self._answered():
            steepest = (reach.slope_[part] * target.unit_).max()
            reach.slope_[part] = steepest / target.unit_
        return reach

    def _noise(self, x: Array, parts: dict[str, Integers]) -> Array:
        """What noise of pixels and thermometer does to answers (s, k) in their units; at least 1.

        1 where no model of the disc tells it.
        """
        readings, width = self.features_.readings_, sum(len(t.columns) for t in self.targets_)
        if self.magnets_ is None:
            return np.ones((len(x), width))
        slopes = self.magnets_.slopes(x[:, parts['place']])[:, :width]
        count = len(self.magnets_.shape)
        variance = (readings.noise * slopes[..., :count]) ** 2
        variance = variance.sum(axis=2) + LEAST**2
        if not readings.thermometer_ or slopes.shape[2] == count:
            return np.asarray(np.sqrt(variance))
        field = times(x[:, parts['field']], self.features_.projection)
        chip = readings.steepness * (slopes[..., :count] @ field[..., None])[..., 0]
        disc = slopes[..., count] * x[:, parts['doubt']] / UNIT
        known = chip * chip + disc * disc if self.features_.lag_ else (chip + disc) ** 2
        return np.asarray(np.sqrt(variance + readings.thermometer_**2 * known))

    def _learn_magnets(self, change: Array, thermal: Array) -> None:
        """Learn how answers follow fields that are not the disc's, from the disc's place."""
        rows = np.linspace(0, len(change) - 1, min(len(change), RESPONSES)).astype(int)
        change, thermal = change[rows], thermal[rows]
        features, memory = self.features_, self.start()
        x, parts = features.table(change, thermal, None, memory)
        moved = [
            features.table(change + DISTURBED * way, thermal, None, memory)[0]
            for way in features.projection.T
        ]
        told = [self._answers(one, parts) for one in (x, *moved)]
        slopes = [(one - told[0]) / DISTURBED for one in told[1:]]
        if thermal.shape[1]:
            warmer = features.table(change, thermal + np.array([WARMER, 0.0, 0.0]), None, memory)[
                0
            ]
            slopes.append((self._answers(warmer, parts) - told[0]) / WARMER)
        field = magnet_fields(self.config.positions, features.uniform_.response_)
        seen = features.uniform_.solve(field.reshape(-1, field.shape[2]))
        share = (field @ features.projection).std() / np.sqrt(np.nansum(seen**2) / len(seen))
        shape = magnet_shape(field, features.projection)
        magnets = NearbyMagnets(shape, float(share))
        self.magnets_ = magnets.fit(x[:, parts['place']], np.stack(slopes, axis=2))

    def _calibrate_magnets(self, change: Array, thermal: Array) -> None:
        """Learn how far to trust what is said beside magnets, on presses beside simulated ones."""
        assert self.magnets_ is not None
        features, rng = self.features_, np.random.default_rng(0)
        rows = rng.integers(len(change), size=SIMULATED)
        change, thermal = change[rows], thermal[rows]
        field, way = np.empty_like(change), rng.integers(DIRECTIONS, size=SIMULATED)
        for i, distance in enumerate(rng.uniform(*DISTANCES, SIMULATED)):
            pixels, response = self.config.positions, features.uniform_.response_
            one = magnet_fields(pixels, response, distance)[way[i]]
            field[i] = 10 ** rng.uniform(*MOMENTS) * rng.normal(size=3) @ one
        x, parts = features.table(change, thermal, None, self.start())
        moved, _ = features.table(change + field, thermal, None, self.start())
        error = (self._answers(moved, parts) - self._answers(x, parts))[:, : -len(parts['rest'])]
        uniform = features.uniform_.solve(field)[:, features.uniform_.seen]
        error[:, -uniform.shape[1] :] -= uniform
        seen = self._seen(moved, parts)
        told = self._beside(moved, parts, seen, np.arange(SIMULATED))
        self.magnets_.calibrate(error, *told, way)

    def _answers(self, x: Array, parts: dict[str, Integers]) -> Array:
        """What a field that is not the disc's falsifies, and what it leaves over, side by side."""
        told = [target.estimator_.predict(x) for target in self.targets_]
        return np.concatenate([*told, x[:, parts['uniform']], x[:, parts['rest']]], axis=1)

    def _learn_targets(
        self, x: Array, parts: dict[str, Integers], good: Bools, truth: Columns, groups: Columns
    ) -> list[Selection]:
        """Choose and fit the estimators of all targets; what they said of rows left out."""
        targets: list[Target] = []
        held: list[Selection] = []
        wanted = self.estimator
        if (wanted in MODELS and 'place' not in parts) or (
            wanted == 'history' and wanted not in parts
        ):
            wanted = 'differences'  # too few pixels for a model, or no time
        drivers = parts['where']
        good = good & np.isfinite(x).all(axis=1)
        for name in TARGETS:
            y = np.asarray(truth.get(name, np.full((len(x), 3), np.nan)), np.float64)
            for columns, rows in known_columns(y, good):
                group = np.asarray(groups['group'], np.int64)[rows]
                targets.append(Target(name, columns, drivers, parts['differences']))
                known = candidates(parts, wanted)
                held.append(targets[-1].fit(x[rows], y[rows][:, columns], group, known))
        self.targets_ = tuple(targets)
        return held

    def estimate(self, signals: Signals, memory: object) -> Columns:
        """Targets, covariances, stray field and flags of every row.

        Parameters
        ----------
        signals : Signals
            Conditioned frames.
        memory : StreamMemory
            Of the stream; moves on.

        Returns
        -------
        dict of str to ndarray, shape (s, ...)
            NaN for components that were never told.
        """
        assert isinstance(memory, StreamMemory)
        signals = memory.with_temperatures(signals)
        features, config = self.features_, self.config
        change = features.readings_.change(signals)
        thermal = features.thermal(signals, memory)
        x, parts = features.table(change, thermal, signals, memory)
        status = margins(signals, config, features.readings_.noise) * _SATURATED
        known: Columns = {}
        width = sum(len(target.columns) for target in self.targets_)
        shift, wider = np.zeros((len(x), width)), np.zeros((len(x), width, width))
        if self.stray_ is None:
            known['stray_field'] = features.uniform_.solve(change)
        else:
            status |= self._add_stray(known, x, parts, (shift, wider)) * _STRAY
        outside, far = outside_doubt(features, signals, wider)
        status |= outside * _OUTSIDE
        if self.reach_ is not None:
            place, rest = x[:, parts['place']], signals.in_contact == 0
            away = self.reach_.beyond(place) * ~rest
            status |= (away > 0) * _OUTSIDE
            if np.count_nonzero(rest):
                away = np.where(rest, self.reach_.unfelt(place), away)
            if np.count_nonzero(away):
                wider += self.reach_.doubt(away)[..., None] ** 2 * np.eye(width)
        if self.magnets_ is not None:
            known_by = features, self.magnets_, signals, x[:, parts['place']]
            tare_doubt(*known_by, self.doubt_, wider)
            drift_doubt(*known_by, wider)
            untold_doubt(*known_by, x[:, parts['field']], thermal[:, 2:].sum(axis=1), wider)
            if self.reach_ is not None:
                warmth_doubt(*known_by, x[:, parts['field']], self.reach_.slope_, wider)
        if self.targets_:
            self._add_targets(known, x, self._noise(x, parts), (shift, wider, far))
            rejected = reject_implausible(known, self.largest_, signals.in_contact != 0)
            status |= rejected * _ABSTAINED
        known['status'] = status
        return known

    def _seen(self, x: Array, parts: dict[str, Integers]) -> Seen:
        """What readings tell beside the disc."""
        assert self.stray_ is not None
        rest, uniform = x[:, parts['rest']], x[:, parts['uniform']]
        return self.stray_.predict(x[:, parts['where']], uniform, rest)

    def _beside(
        self, x: Array, parts: dict[str, Integers], seen: Seen, rows: Integers
    ) -> tuple[Array, Array]:
        """Errors of answers and their covariances in rows of a field that is not the disc's."""
        assert self.magnets_ is not None
        told = seen.left[rows], seen.noise[rows], seen.size[rows]
        gains = self.features_.uniform_.uncertainty
        return self.magnets_.error(x[rows][:, parts['place']], *told, gains)

    def _add_stray(
        self, known: Columns, x: Array, parts: dict[str, Integers], spoilt: tuple[Array, Array]
    ) -> Bools:
        """The stray field (s, 3), what it does to answers; rows (s,) where it is a magnet's."""
        shift, wider = spoilt
        seen, width = self._seen(x, parts), shift.shape[1]
        near = np.flatnonzero(seen.near)
        if len(near):
            mean, cov = self._beside(x, parts, seen, near)
            shift[near], wider[near] = mean[:, :width], cov[:, :width, :width]
            seen.field[near] -= mean[:, width:]
        known['stray_field'] = np.full((len(x), 3), np.nan)
        known['stray_field'][:, self.features_.uniform_.seen] = seen.field
        return seen.odd

    def _add_targets(
        self, known: Columns, x: Array, noise: Array, spoilt: tuple[Array, Array, Array]
    ) -> None:
        """Components of all targets (s, 3) and their covariances, NaN where never told."""
        (shift, wider, far), drivers = spoilt, self.targets_[0].drive(x)
        for target, part in self._answered():
            if target.name not in known:
                known[target.name] = np.full((len(x), 3), np.nan)
                known[f'{target.name}_cov'] = np.full((len(x), 3, 3), np.nan)
            mean, cov = target.predict(x, drivers, noise[:, part], shift[:, part], far)
            cov += wider[:, part, part] * (target.unit_[:, None] * target.unit_)
            index = target.places
            known[target.name][:, index] = mean
            known[f'{target.name}_cov'][:, index[:, None], index] = cov


_SATURATED, _STRAY = np.int64(FrameStatus.SATURATED), np.int64(FrameStatus.STRAY_FIELD)
_OUTSIDE, _ABSTAINED = np.int64(FrameStatus.OUT_OF_RANGE), np.int64(FrameStatus.ABSTAINED)
