# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Pipeline of one sensor: condition frames, estimate, assemble states; fit, tare, save and load.

The pipeline is the same for every sensor: faults, baseline, contact, streams and files. What is
peculiar to a sensor, its features and estimators, is an `Estimation` that its folder brings. One
frame, a stretch of frames and a whole recording go the same way and agree.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import deepcopy
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from tactile_ros import calibration
from tactile_ros.conditioning import faults
from tactile_ros.conditioning.baseline import (
    PERIOD_NS,
    Baselines,
    BaselineTracker,
    Rest,
    Stream,
    stream_baselines,
)
from tactile_ros.errors import CalibrationError
from tactile_ros.physics.temperature import plausible_temperature
from tactile_ros.types import (
    STATE_FIELDS,
    Array,
    Bools,
    Bytes,
    Columns,
    ContactState,
    ContactStates,
    Estimation,
    Frame,
    Integers,
    Layout,
    Recording,
    Report,
    SensorConfig,
    Signals,
    TaxelStatus,
    groups_of,
    join,
)
from tactile_ros.types.contact import stack_columns
from tactile_ros.types.recording import (
    are_ordered,
    calm_rows,
    firm_rows,
    resting_rows,
    touched_rows,
)

ERROR = np.uint8(TaxelStatus.ERROR)
ZERO_UNTOUCHED = frozenset({'force', 'torque', 'taxel_force', 'deformation'})
KEPT_UNTOUCHED = frozenset({'stray_field', 'force_cov', 'torque_cov', 'slip', 'slip_probability'})
STATUS = frozenset({'status', 'taxel_status', 'valid', 'in_contact'})
PARTS = ('config', 'layout', 'rest_', 'estimation', 'left_out_', 'reference_')
TARED = ('rest_/baseline.', 'rest_/temperature_c.')  # what a tare changes
# as no other dimension is likely to be: an array of a wrong shape must not fit by chance
REFERENCES = 13
UP = np.array([[[0.0, 0.0, 1.0]]])  # normal of a patch
SAME = 1e-9  # of the largest entry of a column
WARM_C, HOT_C = 30.0, 200.0  # the second beyond those of any fit
CHIPS_C = -40.0, 125.0  # range of chips
NEAR = np.array([0.97, 1.03])  # of the threshold of contact
VARIED = 0.001  # of the changes of reference frames
FAR = np.array([1.5, -1.0])  # of the largest change: limits of a fit show beyond it


class Pipeline:
    """Estimate contacts from the frames of one sensor.

    Parameters
    ----------
    sensor : str
        Key of the sensor.
    config : SensorConfig
        Geometry, materials and ranges: where a fit starts.
    layout : Layout
        Of the same config.
    estimation : Estimation
        Features and estimators of the sensor.

    Attributes
    ----------
    tare_frames : int
        Frames that the baseline is the mean of; 0: it is that of the fit.
    failures : int
        Frames at which the estimation raised: each has the status ERROR at every taxel, and the
        estimation's memory begins anew after it.
    failure : str
        Why the last of them failed; empty: there is none.
    """

    def __init__(
        self, sensor: str, config: SensorConfig, layout: Layout, estimation: Estimation
    ) -> None:
        self.sensor, self.config, self.layout, self.estimation = sensor, config, layout, estimation
        self.rest_ = self._unknown_rest()
        self.left_out_: dict[str, float] = {}
        self.reference_: Array | None = None  # frames that a file must answer as the fit did
        self.tare_frames, self.failures, self.failure = 0, 0, ''
        self.reset()

    def __repr__(self) -> str:
        """Sensor, taxels and the estimator of each target in a line."""
        named = ', '.join(f'{target} by {name}' for target, name in self.estimators.items())
        size = ' x '.join(map(str, self.layout.shape))
        return f'{type(self).__name__}({self.sensor}, {size}; {named or "not calibrated"})'

    def reset(self) -> None:
        """Forget the stream's state; the baseline of the last tare or fit stays."""
        self.stream = self._new_stream()

    def _new_stream(self) -> Stream:
        return Stream(self._tracker(), self.estimation.start())

    def _unknown_rest(self) -> Rest:
        uses_temperature = self.estimation.uses_temperature
        return Rest.unknown(self.layout.shape, self.config.noise, uses_temperature)

    def _tracker(self) -> BaselineTracker:
        rest, frames = self.rest_, self.tare_frames
        follows = self.config.track_baseline and rest.tared
        scale = rest.scale if follows else None
        return BaselineTracker(rest.level, scale, 1 / frames if frames else 0.0)

    def tare(self, frames: Sequence[Frame]) -> None:
        """Replace the baseline by the mean of resting frames; an error leaves it as it was.

        NaN and unusable taxels are left out; covariances hold the noise of so many frames, and of
        as many as each is the mean of. Raises ValueError if no frame of this sensor's shape has a
        taxel that was read, or the fit wanted no baseline.
        """
        if not self.rest_.tared:
            msg = (
                'tare of a pipeline must follow a fit with tare rows or in_contact 0; '
                'this one was fitted on readings without a baseline'
            )
            raise ValueError(msg)
        if not frames:
            msg = 'frames of tare must hold at least one resting frame; received none'
            raise ValueError(msg)
        for frame in frames:
            self._check_shape(np.shape(frame.values))
        rows = [self._frame_readings(frame) for frame in frames]
        levels = [self.rest_.with_temperature(usable, chips) for usable, _, chips in rows]
        self.rest_ = self.rest_.tared_by(np.concatenate(levels))
        counts = [frame.averaged for frame in frames]
        self.tare_frames = sum(counts) if all(counts) else 0
        self.stream.rebase(self._tracker())

    @property
    def baseline(self) -> Array:
        """Baseline in use now, shape (t, c); NaN: none yet, or dead in the fit."""
        level, dead = self.rest_.split(self.stream.tracker.baseline)[0], self.rest_.dead
        return level.copy() if dead is None else np.where(dead[:, None], np.nan, level)

    @property
    def baseline_temperature_c(self) -> Array | None:
        """Chip temperatures (t,) of the baseline, NaN: unknown; None: the sensor uses none."""
        return self.rest_.split(self.stream.tracker.baseline.copy())[1]

    def process(self, frame: Frame, fails: bool = False) -> ContactState:
        """Estimate from the next frame of the stream: the numbers of `process_batch`.

        A stamp that is not newer than the last begins a new stream. With `fails`, a run is
        repeated in which the estimation raised at this frame, whatever it does now; a frame of
        which nothing was read cannot fail. Raises ValueError if the shape differs from the layout.
        """
        self._check_shape(np.shape(frame.values))
        usable, bits, chips = self._frame_readings(frame)
        stamp_ns = None if frame.stamp_ns is None else np.array([frame.stamp_ns], np.int64)
        fails = fails and not (bits & ERROR).all()
        known = self._follow(usable, bits, chips, stamp_ns, fails)
        return ContactState.assemble(bits.shape[1], known)

    def process_next(self, recording: Recording) -> ContactStates:
        """Estimate from the next frames of one stream at once: as `process` one by one.

        The columns `stream` and `tare` are not used. Raises ValueError if the shape, the unit or a
        channel differs from the layout.
        """
        self.check_layout(recording)
        usable, bits = self._readings(recording.values, recording.status, self.rest_.dead)
        known = self._follow(usable, bits, recording.temperature_c, recording.stamp_ns)
        return ContactStates.assemble(len(recording), bits.shape[1], known)

    def process_batch(self, recording: Recording) -> ContactStates:
        """Estimate from every frame of a recording, starting from `reset()`.

        Its tare rows give the baseline inside their stream. Raises ValueError if the shape, the
        unit or a channel differs from the layout.
        """
        self.check_layout(recording)
        return self._process_batch(recording, strict=False)

    def _process_batch(self, recording: Recording, strict: bool) -> ContactStates:
        usable, bits = self._readings(recording.values, recording.status, self.rest_.dead)
        signals = self._condition_rows(recording, usable, bits)
        known = self._estimate(signals, bits, self._new_stream(), strict=strict)
        return ContactStates.assemble(len(recording), bits.shape[1], known)

    # -- condition ---------------------------------------------------------------------------

    def _readings(
        self, values: Array, status: Bytes | None, dead: Bools | None
    ) -> tuple[Array, Bytes]:
        """Readings (s, t, c), NaN where they must not be used, and bits (s, t) that say why."""
        bits = faults.taxel_faults(values, status, self.layout)
        usable = faults.without_faults(values, bits)
        wrong = self.estimation.implausible_taxels(usable)
        if wrong is not None and np.count_nonzero(wrong):
            bits = np.asarray(bits | wrong * ERROR, np.uint8)
            usable = np.where(wrong[..., None], np.nan, usable)
        return faults.set_aside(usable, bits, dead)

    def _frame_readings(self, frame: Frame) -> tuple[Array, Bytes, Array | None]:
        """Readings, bits and chip temperatures of a frame, as a batch of one."""
        taxels, status, chips = self.layout.shape[:1], frame.status, frame.temperature_c
        for name, column in (('status', status), ('temperature_c', chips)):
            if column is not None and np.shape(column) != taxels:
                msg = f'{name} of Frame must have shape {taxels}; received {np.shape(column)}'
                raise ValueError(msg)
        values = np.array(frame.values, np.float64)[None]  # loops want writable ones
        status = None if status is None else np.array(status, np.uint8)[None]
        chips = None if chips is None else np.array(chips, np.float64)[None]
        return *self._readings(values, status, self.rest_.dead), chips

    def _follow(
        self, usable: Array, bits: Bytes, chips: Array | None, stamp_ns: Integers | None,
        fails: bool = False,
    ) -> Columns:  # fmt: skip
        """State attributes of the next frames of the stream, a new one if time went back."""
        if self.stream.is_over(stamp_ns):
            self.reset()
        beside = self.rest_.with_temperature(usable, chips)
        followed = self.stream.follow(beside, stamp_ns)
        signals = self._condition(usable, bits, chips, stamp_ns, followed)
        return self._estimate(signals, bits, self.stream, fails=fails)

    def _condition_rows(self, recording: Recording, usable: Array, bits: Bytes) -> Signals:
        """Conditioned frames of a recording."""
        chips, rest = recording.temperature_c, self.rest_
        beside = rest.with_temperature(usable, chips)
        followed = stream_baselines(recording, beside, self._tracker(), rest.dead)
        signals = self._condition(usable, bits, chips, recording.stamp_ns, followed)
        return replace(signals, begins=recording.restarts, tare=recording.tare)

    def _condition(
        self,
        usable: Array,
        bits: Bytes,
        chips: Array | None,
        stamp_ns: Integers | None,
        followed: Baselines,
    ) -> Signals:
        """Frames less their baseline, with what the readings say about contact."""
        rest = self.rest_
        chips = None if chips is None else plausible_temperature(chips)
        base, reference_c = rest.split(followed.levels)
        delta = usable - base if rest.tared else usable
        if reference_c is not None and rest.tared:
            delta = delta - self.estimation.thermal_drift(base, reference_c, chips)
        good, felt = faults.usable_rows(bits), delta
        some = self.estimation.estimable_rows(bits) if np.count_nonzero(bits) else None
        if some is not None:
            good, felt = some, np.where(np.isnan(delta) & np.isfinite(base), 0.0, delta)
        contact = rest.contact(felt, good, followed.tare)
        return Signals(
            usable, delta, base, chips, stamp_ns, followed.restart, contact, good,
            baseline_variance=followed.variance, rest_temperature_c=reference_c,
        )  # fmt: skip

    # -- estimate ----------------------------------------------------------------------------

    def _estimate(
        self,
        signals: Signals,
        bits: Bytes,
        stream: Stream,
        strict: bool = False,
        fails: bool = False,
    ) -> Columns:
        """State attributes of conditioned frames; the one way for live and batch."""
        if not len(bits):
            return {}
        known, failed = self._answers(signals, stream, strict, fails)
        contact, restart = known['in_contact'].astype(np.int8, copy=False), signals.restart
        if np.count_nonzero(failed):
            restart = restart | np.append(False, failed[:-1])
            if failed[-1]:
                stream.rebase(stream.tracker)
        in_time = signals.stamp_ns is not None and self.rest_.tared
        number = stream.ids.number(contact, restart, in_time, signals.begins)
        number[failed if in_time else failed | ~signals.good] = -1
        apply_contact(known, contact, signals.good)
        self._add_flags(known, signals, bits)
        add_patches(known, number)
        dead = self.rest_.dead
        if dead is not None:
            known['taxel_status'] = known['taxel_status'] | dead * np.uint8(TaxelStatus.DEAD)  # type: ignore[operator]
            for name in {'taxel_force', 'deformation'} & known.keys():
                known[name][:, dead] = np.nan
        return known

    def _answers(
        self, signals: Signals, stream: Stream, strict: bool, fails: bool
    ) -> tuple[Columns, Bools]:
        """Answers of the estimation, and the rows (s,) at which it raised.

        Whatever raises is halved until it is one frame, whatever succeeds is doubled.
        """
        count, taxels = signals.values.shape[:2]
        parts, lengths, failed = [], [], np.zeros(count, bool)
        first, size = 0, count
        while first < count:
            part = signals
            if first or size < count:
                after_failure = first > 0 and bool(failed[first - 1])
                part = signals.select(slice(first, first + size), after_failure)
            length = len(part.good)
            before = deepcopy(stream.memory) if length > 1 and not strict else None
            try:
                if fails:
                    msg = 'it failed in the live run'
                    raise ArithmeticError(msg)  # noqa: TRY301
                contact = self.estimation.contact_from_sensor(part)
                if contact is not part.in_contact:
                    part = replace(part, in_contact=contact)
                known = self.estimation.estimate(part, stream.memory)
                parts.append({'in_contact': contact, **known})
                size *= 2
            except Exception as error:
                if strict or isinstance(error, MemoryError):
                    raise
                if length > 1:
                    stream.memory, size = before, length // 2
                    continue
                self.failures += 1
                self.failure = f'{type(error).__name__}: {error}'
                stream.memory = self.estimation.start()
                failed[first] = True
                unknown = {
                    'in_contact': np.array([-1], np.int8),
                    'status': np.array([faults.DAMAGED]),
                }
                parts.append({**unknown, 'taxel_status': np.full((1, taxels), ERROR)})
            lengths.append(length)
            first += length
        return (parts[0] if len(parts) == 1 else stack_columns(parts, lengths)), failed

    # -- assemble ----------------------------------------------------------------------------

    def _add_flags(self, known: Columns, signals: Signals, bits: Bytes) -> None:
        """Say of every frame what is wrong with it, and whether it may be used for control.

        A `status`, `taxel_status` or `valid` of the estimation's own is kept beside the rest.
        """
        missing = faults.NOT_CALIBRATED * (not self.calibrated)
        missing |= faults.NO_BASELINE * (not self.rest_.tared)
        found, own, usable = known.get('taxel_status'), known.get('status'), known.get('valid')
        flags = np.zeros(len(bits), np.int64) if own is None else own.astype(np.int64)
        if missing:
            flags |= missing
        valid = signals.good.copy() if usable is None else signals.good & usable.astype(bool)
        faults.frame_status(bits, signals.delta, signals.baseline, flags, valid)
        known['taxel_status'] = bits if found is None else bits | found.astype(np.uint8)
        known['status'], known['valid'] = flags, valid

    # -- fit ---------------------------------------------------------------------------------

    def fit(self, *recordings: Recording) -> Pipeline:
        """Learn baseline, noise, contact threshold and estimators from one recording or more.

        Returns itself. Raises ValueError if there is no recording, or a shape, a unit or a channel
        differs.
        """
        self.check_layout(*recordings)
        joined = join(recordings)
        usable, bits = self._readings(joined.values, joined.status, None)
        dead = faults.dead_throughout(bits)
        usable, bits = faults.set_aside(usable, bits, dead)
        self.estimation.begin_fit()
        self.rest_ = self._unknown_rest().learn(
            usable, resting_rows(joined), joined.stamp_ns, joined.restarts,
            are_ordered(recordings), joined.temperature_c,
        )  # fmt: skip
        self.tare_frames = 0
        signals = self._whole_rows(joined, usable, bits)
        kinds = (touched_rows, firm_rows, calm_rows)
        touched, firm, calm = (signals.delta[signals.good & rows(joined)] for rows in kinds)
        if joined.tare is not None:  # what is left of a touch when the next tare comes is none
            again = np.flatnonzero(np.diff(joined.tare * 1) > 0) + 1
            left = usable[again] - signals.baseline[again - 1]
            calm = np.concatenate([calm, left[~joined.restarts[again]]])
        self.rest_ = self.rest_.threshold(touched, firm, dead, calm)
        # once more with the threshold of contact: the baseline moves as it will in use
        signals = self._whole_rows(joined, usable, bits)
        self.estimation.fit(signals, joined.truth, groups_of(joined))
        self.left_out_ = {} if dead is None else {'taxels faulty in every row': float(dead.sum())}
        self.left_out_ |= self._unused(recordings, joined, bits, signals.good)
        self.reference_ = self._references(usable, signals)
        self.warm_up()
        return self

    def _whole_rows(self, joined: Recording, usable: Array, bits: Bytes) -> Signals:
        """Conditioned frames; those without a baseline are not to be learned from."""
        signals = self._condition_rows(joined, usable, bits)
        whole = ~np.isnan(signals.delta).any(axis=(1, 2))
        return replace(signals, good=signals.good & whole)

    def _unused(
        self, recordings: Sequence[Recording], joined: Recording, bits: Bytes, good: Bools
    ) -> dict[str, float]:
        """Counts of what a fit did not learn from, and of truth that it did not learn."""
        whole, clipped = faults.usable_rows(bits), ((bits & faults.SATURATED) > 0).any(axis=1)
        counts = {
            f'rows at or above `saturation` {self.layout.saturation}': int(clipped.sum()),
            'rows with a faulty taxel': int((~whole & ~clipped).sum()),
            'rows without a baseline': int((whole & ~good).sum()),
        }
        if joined.stamp_ns is None:
            stamped = sum(len(r) for r in recordings if r.stamp_ns is not None)
            counts['stamps, since a recording has none'] = stamped
        counts = {name: count for name, count in counts.items() if count}
        for key in sorted((joined.truth.keys() & STATE_FIELDS.keys()) - {'in_contact'}):
            column = joined.truth[key]
            known = np.isfinite(column) if column.dtype.kind == 'f' else column != -1
            if key not in self.estimators and known.any():
                rows = known.reshape(len(known), -1).any(axis=1) & good
                counts[f'usable rows with {key}, which was not learned'] = int(rows.sum())
        return {name: float(count) for name, count in counts.items()}

    @property
    def calibrated(self) -> bool:
        """True once anything can be estimated."""
        return bool(self.estimation.estimators)

    @property
    def estimators(self) -> dict[str, str]:
        """Name of the estimator in use for each target."""
        return self.estimation.estimators

    @property
    def report(self) -> Report:
        """Errors on held-out groups for each target; `left_out`: counts of what was of no use."""
        rest = {'left_out': self.left_out_} if self.left_out_ else {}
        return {**self.estimation.report, **rest}

    @property
    def label_names(self) -> tuple[str, ...]:
        """Names of the classes that it can recognise."""
        return tuple(self.estimation.label_names)

    def enrol(self, recording: Recording, label: str) -> None:
        """Learn a class from presses; ValueError if they are too weak, clipped or none."""
        if not self.estimation.learns_classes:
            msg = f'{self.sensor} recognises no classes; received {label!r} to enrol'
            raise ValueError(msg)
        self.check_layout(recording)
        usable, bits = self._readings(recording.values, recording.status, self.rest_.dead)
        self.estimation.enrol(self._condition_rows(recording, usable, bits), label)

    def forget(self, label: str) -> None:
        """Undo an enrolment by name."""
        if not self.estimation.learns_classes or label not in self.label_names:
            msg = f'label of forget must be one of {self.label_names}; received {label!r}'
            raise ValueError(msg)
        self.estimation.forget(label)

    def _check_shape(self, shape: tuple[int, ...]) -> None:
        """Refuse frames of another shape than the layout's."""
        if shape != self.layout.shape:
            msg = (
                f'frames of {self.sensor} must have shape {self.layout.shape} (t, c) as its '
                f'config says; received {shape}'
            )
            raise ValueError(msg)

    def check_layout(self, *recordings: Recording) -> None:
        """Raise ValueError if there is no recording, or its shape, unit or channels differ."""
        others = [one for one in recordings if not isinstance(one, Recording)]
        if others or not recordings:
            msg = f'recordings must hold at least one Recording, none other; received {others[:1]}'
            raise ValueError(msg)
        for found in (recording.layout for recording in recordings):
            self._check_shape(found.shape)
            if (found.unit, found.channels) != (self.layout.unit, self.layout.channels):
                msg = (
                    f'frames of {self.sensor} must have channels '
                    f'{", ".join(self.layout.channels)} in {self.layout.unit}; received '
                    f'{", ".join(found.channels)} in {found.unit}'
                )
                raise ValueError(msg)

    # -- save and load -----------------------------------------------------------------------

    def _arrays(self) -> calibration.Arrays:
        arrays = calibration.flatten(self.sensor, 'sensor')
        for name in PARTS:
            arrays |= calibration.flatten(vars(self)[name], name)
        return arrays

    @property
    def digest(self) -> str:
        """SHA-256 of the calibration (hex); a tare does not change it."""
        arrays = {k: v for k, v in self._arrays().items() if not k.startswith(TARED)}
        return calibration.digest(arrays)

    def save(self, path: str | Path) -> None:
        """Write the calibration to one .npz, atomically, with its answers to a few frames."""
        again = deepcopy(self)
        again.tare_frames = 0  # as it will be read
        answers = calibration.flatten(again.warm_up(), 'answers')
        calibration.write(path, self._arrays() | answers)

    @classmethod
    def load(cls, path: str | Path, sensor: str, classes: Mapping[str, type]) -> Pipeline:
        """Read a calibration of `sensor`, building only objects of `classes`.

        Raises CalibrationError if it is damaged, hostile, of another sensor, version or shape.
        """
        arrays = calibration.read(path)
        pipeline = cls.__new__(cls)
        try:
            found = calibration.restore(arrays, 'sensor', {})
            if found != sensor:
                msg = f'calibration {path} must be of {sensor}; it is of {str(found)[:60]!r}'
                raise CalibrationError(msg)
            allowed = {'Layout': Layout, 'Rest': Rest, **classes}
            parts = {name: calibration.restore(arrays, name, allowed) for name in PARTS}
            _refuse_misfit(f'calibration {path}', parts, classes)
        except (ValueError, TypeError, OverflowError, AttributeError, LookupError) as error:
            msg = f'calibration {path} is damaged ({error}); calibrate again'
            raise CalibrationError(msg) from error
        vars(pipeline).update(parts, sensor=sensor, tare_frames=0, failures=0, failure='')
        try:
            pipeline.estimation.refuse_damage()
            now = pipeline.warm_up()
            stored = calibration.restore(arrays, 'answers', {})
            _refuse_other_answers(now, stored)
        except Exception as error:
            msg = f'calibration {path} does not work ({error}); calibrate again'
            raise CalibrationError(msg) from error
        return pipeline

    def _references(self, usable: Array, signals: Signals) -> Array | None:
        """Frames of a fit from rest to the largest change, two at the threshold, two beyond."""
        rows = np.flatnonzero(signals.good & np.isfinite(usable).all(axis=(1, 2)))
        if not len(rows):
            return None
        delta = signals.delta[rows]
        size = np.square(delta).sum(axis=(1, 2))
        count = REFERENCES - len(NEAR) - len(FAR)
        places = np.linspace(0, len(rows) - 1, count).round().astype(np.int64)
        few = usable[rows[np.argsort(size, kind='stable')[places]]]
        # the lightest touch, made just too light and just heavy enough to count
        ratio = np.abs(delta / np.maximum(self.rest_.scale, 1e-300)).max(axis=(1, 2))
        lightest = np.where(signals.in_contact[rows] == 1, ratio, np.inf).argmin()
        share = np.nan_to_num(NEAR / np.maximum(ratio[lightest], 1e-300))[:, None, None]
        rest = np.nan_to_num(self.rest_.baseline)
        far = rest + delta[size.argmax()] * FAR[:, None, None]
        return np.concatenate([few[:1], rest + delta[lightest] * share, few[1:], far])

    def warm_up(self) -> list[Columns]:
        """Answer the reference frames, so that no frame waits for a table or a compiler.

        A fit and a load end with it: at rest and at a touch, with and without a tare, stamps and
        temperatures. The stream is forgotten as by `reset`. Returns the frames and what was
        answered. The frames are varied by a seed of all that was learned: nothing of it changes
        without others.
        """
        self.reset()
        calibration.flatten([self.report, self.estimators, self.label_names], 'tables')
        seed = int(calibration.digest(self._arrays())[:13], 16) / 16**13
        touched = np.arange(REFERENCES) > 0
        touch = np.where(touched[:, None, None], 10 * self.rest_.scale, 0.0)
        values = self.reference_
        if values is None:  # a chip that reads 0 would be dead
            values = np.nan_to_num(self.rest_.baseline + touch, nan=SAME)
        share = (seed * np.arange(1, 1 + values.size).reshape(values.shape)) % 1.0
        values = values - VARIED * share * np.nan_to_num(values - self.rest_.baseline)
        # a baseline that only a tare gives is tracked over more than a block
        stamps = np.arange(REFERENCES) * (PERIOD_NS // 10 if self.reference_ is None else 1)
        warm = np.full(values.shape[:2], WARM_C)
        chips = np.repeat(np.linspace(*CHIPS_C, REFERENCES)[:, None], values.shape[1], axis=1)
        answers: list[Columns] = []
        for tare, stamp_ns, temperature_c in (
            (None, None, None), (None, stamps, warm), (~touched, None, chips),
            (~touched, stamps, None), (~touched, stamps, np.full(values.shape[:2], HOT_C)),
        ):  # fmt: skip
            recording = Recording.from_arrays(
                self.layout, values, stamp_ns, temperature_c=temperature_c, tare=tare
            )
            states = self._process_batch(recording, strict=True)
            states.refuse_misfit(self.layout.shape[0])
            answers.append({'values': values, **{n: getattr(states, n) for n in STATE_FIELDS}})
            for row in (0, REFERENCES - 1):  # arrays of one frame are laid out otherwise
                self.process(recording.frame(row))
            self.reset()
        return answers


def _refuse_other_answers(now: Sequence[Columns], stored: object) -> None:
    """Raise ValueError where reference frames are answered otherwise than when it was written."""
    if not isinstance(stored, list) or len(stored) != len(now):
        msg = 'its answers to reference frames are missing'
        raise ValueError(msg)
    for columns, before in zip(now, stored, strict=True):
        for name, column in columns.items():
            wanted = np.asarray(before[name], np.float64)
            found = np.asarray(column, np.float64)
            scale = np.abs(wanted[np.isfinite(wanted)]).max(initial=0.0)
            if wanted.shape != found.shape or not np.allclose(
                found, wanted, rtol=0, atol=SAME * scale, equal_nan=True
            ):
                msg = f'it answers reference frames with other {name} than when it was written'
                raise ValueError(msg)


def _refuse_misfit(name: str, parts: Mapping[str, object], classes: Mapping[str, type]) -> None:
    """Refuse parts of other kinds or shapes than a pipeline's."""
    layout, rest, counts = parts['layout'], parts['rest_'], parts['left_out_']
    fitted = all(type(parts[key]) in classes.values() for key in ('config', 'estimation'))
    if not (isinstance(layout, Layout) and isinstance(rest, Rest) and fitted):
        msg = f'{name} has no layout, rest level or estimators; calibrate again'
        raise CalibrationError(msg)
    if not (isinstance(counts, dict) and all(isinstance(n, float) for n in counts.values())):
        msg = f'what the fit left out is no table of counts in {name}; calibrate again'
        raise CalibrationError(msg)
    for key in ('baseline', 'noise', 'scale', 'temperature_c'):
        array, wanted = vars(rest)[key], layout.shape[: 1 if key == 'temperature_c' else 2]
        if np.shape(array) != wanted and not (key == 'temperature_c' and array is None):
            msg = f'{key} of {name} must have shape {wanted}; received {np.shape(array)}'
            raise CalibrationError(msg)


def apply_contact(known: Columns, contact: npt.NDArray[np.int8], good: Bools) -> None:
    """Blank what unusable and untouched rows (s,) do not measure; forces of the untouched are 0.

    `known` is changed in place; `contact` is 1, 0, -1 unknown, `good` rows to estimate from.
    """
    untouched = contact == 0
    spoilt, free = np.count_nonzero(good) < len(good), np.count_nonzero(untouched) > 0
    if not (spoilt or free):
        return
    for name in known.keys() - STATUS:
        column, blank = known[name], STATE_FIELDS[name][2]
        if free and name in ZERO_UNTOUCHED:
            estimated = untouched.reshape(-1, *[1] * (column.ndim - 1)) & ~np.isnan(column)
            column[estimated] = 0.0
        elif free and name not in KEPT_UNTOUCHED:
            column[untouched] = blank
        if spoilt:
            column[~good] = blank


def add_patches(known: Columns, number: Integers) -> None:
    """List the one patch (s,) that a position or a force speaks of, -1 where nothing touches.

    `known` is changed in place; sensors may bring patches of their own.
    """
    if 'contacts_id' in known or not ('position' in known or 'force' in known):
        return
    known['contacts_id'] = number[:, None]
    nowhere = number < 0
    count = np.count_nonzero(nowhere)
    if count == len(number):
        return
    columns = {'normal': UP.repeat(len(number), axis=0)}
    for name in ('position', 'position_cov', 'force', 'force_cov'):
        if name in known:
            columns[name] = known[name][:, None]
    for name, column in columns.items():
        known[f'contacts_{name}'] = patch = column.copy() if count else column
        if count:
            patch[nowhere] = np.nan
