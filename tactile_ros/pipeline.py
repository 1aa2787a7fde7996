"""Frame -> conditioning -> features -> estimators -> ContactState; one frame and batch agree.

The pipeline is the same for every sensor: faults, baseline, contact, streams and files. What is
peculiar to a sensor, its features and estimators, is an `Estimation` that its folder brings.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from tactile_ros import calibration
from tactile_ros.calibration import flatten, write
from tactile_ros.conditioning.baseline import (
    BaselineTracker,
    Rest,
    Stream,
    Tracking,
    stream_baselines,
)
from tactile_ros.conditioning.faults import (
    dead_throughout,
    frame_faults,
    frame_readings,
    judged_rows,
    set_aside,
    usable_readings,
    usable_rows,
)
from tactile_ros.errors import CalibrationError
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
    FrameStatus,
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
from tactile_ros.types.recording import (
    are_ordered,
    firm_rows,
    left_out,
    refuse_foreign,
    refuse_other_shape,
    refuse_tare,
    resting_rows,
    touched_rows,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

MEASURES_OF_NOTHING = frozenset({'force', 'torque', 'taxel_force', 'deformation'})
ALWAYS = frozenset(
    {'stray_field', 'force_cov', 'torque_cov', 'slip', 'slip_probability', 'status'}
)
FORBIDS_USE = int(
    FrameStatus.NOT_CALIBRATED | FrameStatus.BAD_TAXELS | FrameStatus.SATURATED | FrameStatus.STALE
)
NOT_CALIBRATED, NO_BASELINE = int(FrameStatus.NOT_CALIBRATED), int(FrameStatus.NO_BASELINE)
FLAT_NORMAL = np.array([[[0.0, 0.0, 1.0]]])


def apply_contact(known: Columns, contact: npt.NDArray[np.int8], good: Bools) -> None:
    """Blank what unusable and untouched frames cannot tell; forces of the untouched are 0.

    Parameters
    ----------
    known : dict of str to ndarray, shape (s, ...)
        Estimates; changed in place.
    contact : ndarray, shape (s,)
        1, 0, -1 unknown.
    good : ndarray, shape (s,)
        Rows that may be estimated from.
    """
    untouched = contact == 0
    spoilt, free = np.count_nonzero(good) < len(good), np.count_nonzero(untouched) > 0
    if not (spoilt or free):
        return
    for name in known:
        if name in ('status', 'taxel_status', 'valid'):
            continue
        column, blank = known[name], STATE_FIELDS[name][2]
        if free and name in MEASURES_OF_NOTHING:
            column[untouched] = np.where(np.isnan(column[untouched]), np.nan, 0.0)
        elif free and name not in ALWAYS:
            column[untouched] = blank
        if spoilt:
            column[~good] = blank


def conditioned(
    rest: Rest,
    estimation: Estimation,
    read: tuple[Array, Bytes, Array | None],
    when: tuple[Integers | None, Bools],
    levels: tuple[Array, Array],
    tare: Bools | None = None,
) -> Signals:
    """Frames less their baseline, with what they say about contact.

    Parameters
    ----------
    rest : Rest
        Of the pipeline.
    estimation : Estimation
        Of its sensor.
    read : tuple of ndarray, shapes (s, t, c), (s, t) and (s, t), the last of them or None
        Readings, NaN where unusable (unit of values); bits of `TaxelStatus`; what the chips told
        (degrees Celsius).
    when : tuple of ndarray, shapes (s,), or None, and (s,)
        Stamps; rows before which memory is forgotten.
    levels : tuple of ndarray, shapes (s, t, ...) and (s,)
        Baselines as `Rest.level` has them, and their variance over that of a frame.
    tare : ndarray, shape (s,), or None
        Rows that are known to rest.

    Returns
    -------
    Signals
        Of all frames.
    """
    usable, bits, chips = read
    (base, warmth), doubt = rest.split(levels[0]), levels[1]
    delta = usable - base if rest.tared else usable
    if warmth is not None and rest.tared:
        delta = delta - estimation.warmed(base, warmth, chips)  # type: ignore[attr-defined]
    good, seen = judged_rows(estimation, bits, delta, base)
    contact = rest.contact(seen, good, tare)
    return Signals(
        usable, delta, base, chips, *when, contact, good,
        doubt=doubt, rest_temperature_c=warmth,
    )  # fmt: skip


def told(estimation: Estimation, signals: Signals) -> Signals:
    """Frames with what the sensor itself says of contact, if it does not show in every channel."""
    contact = getattr(estimation, 'contact', None)
    return signals if contact is None else replace(signals, in_contact=contact(signals))


def add_flags(known: Columns, signals: Signals, bits: Bytes, lacks: int) -> None:
    """Say of every frame what is wrong with it, and whether it may be used for control.

    Parameters
    ----------
    known : dict of str to ndarray, shape (s, ...)
        Estimates; changed in place. A `status`, `taxel_status` or `valid` of the estimators' own
        is kept beside the rest.
    signals : Signals
        Conditioned frames.
    bits : ndarray, shape (s, t)
        Of `TaxelStatus`.
    lacks : int
        Of `lacking`.
    """
    flags = np.array([lacks], np.int64).repeat(len(bits))
    if 'status' in known:
        flags = flags | known['status'].astype(np.int64)
    if np.count_nonzero(bits):
        flags = flags | frame_faults(bits)
    # good readings without the baseline that they need say nothing: their change is NaN
    seeing, missing = signals.good, np.isnan(signals.delta)
    if np.count_nonzero(missing):
        seeing = seeing & ~missing.any(axis=(1, 2))
        lost = np.isnan(signals.baseline).any(axis=(1, 2))
        flags = flags | lost * np.int64(NO_BASELINE)
    known['in_contact'] = signals.in_contact
    found = known.get('taxel_status')
    known['taxel_status'] = bits if found is None else bits | found.astype(np.uint8)
    known['status'] = flags
    usable = known.get('valid', True)
    known['valid'] = seeing & (flags & FORBIDS_USE == 0) & usable


def lacking(calibrated: bool, tared: bool) -> int:
    """Bits of `FrameStatus` for what a pipeline lacks in all frames."""
    return (0 if calibrated else NOT_CALIBRATED) | (0 if tared else NO_BASELINE)


def add_dead(known: Columns, bits: Bytes, dead: Bools) -> None:
    """Say which taxels (t,) are dead, and that nothing is measured there; `known` is changed."""
    found = known.get('taxel_status', bits).astype(np.uint8)
    known['taxel_status'] = np.asarray(found | dead * np.uint8(TaxelStatus.DEAD), np.uint8)
    for name in ('taxel_force', 'deformation'):
        if name in known:
            known[name][:, dead] = np.nan


def add_patches(known: Columns, number: Integers) -> None:
    """List the one patch that a position or a force speaks of; sensors may bring their own.

    Parameters
    ----------
    known : dict of str to ndarray, shape (s, ...)
        Estimates; changed in place.
    number : ndarray, shape (s,)
        Id of the patch, -1 where nothing touches.
    """
    if 'contacts_id' in known or not ('position' in known or 'force' in known):
        return
    there = number >= 0
    everywhere = np.count_nonzero(there) == len(there)
    known['contacts_id'] = number[:, None]
    normal = FLAT_NORMAL.repeat(len(number), axis=0)
    known['contacts_normal'] = normal if everywhere else _where(there, normal)
    for name in ('position', 'position_cov', 'force', 'force_cov'):
        if name in known:
            column = known[name][:, None]
            known[f'contacts_{name}'] = column if everywhere else _where(there, column)


def _where(there: Bools, column: npt.NDArray[np.generic]) -> npt.NDArray[np.generic]:
    """A column with NaN where nothing is there."""
    shape = (-1,) + (1,) * (column.ndim - 1)
    return np.where(there.reshape(shape), column, np.nan)


PARTS = ('config', 'layout', 'rest_', 'estimation', 'left_out_')
OWN_CLASSES = {'Layout': Layout, 'Rest': Rest}
TARED = ('rest_/baseline.', 'rest_/temperature_c.')  # what a tare changes
# As no other dimension is likely to be: an array of a wrong shape must not fit by chance.
REHEARSED = 13
WARM_C, HOT_C = 30.0, 200.0  # the second beyond those of any fit


def parts_to_arrays(sensor: str, parts: Mapping[str, object]) -> calibration.Arrays:
    """Flatten the parts of a pipeline of `sensor`."""
    arrays = calibration.flatten(sensor, 'sensor')
    for name in PARTS:
        arrays.update(calibration.flatten(parts[name], name))
    return arrays


def identity(arrays: calibration.Arrays) -> str:
    """SHA-256 of a calibration, its baseline left out: a tare does not change it (hex)."""
    return calibration.digest({k: v for k, v in arrays.items() if not k.startswith(TARED)})


def read_parts(path: str | Path, sensor: str, classes: Mapping[str, type]) -> dict[str, object]:
    """Parts of a pipeline from a file that is not trusted.

    Parameters
    ----------
    path : str or Path
        A calibration file.
    sensor : str
        Key of the sensor that it must be of.
    classes : mapping of str to type
        Classes of the sensor that may be built.

    Returns
    -------
    dict of str to object
        One entry for each of `PARTS`.

    Raises
    ------
    CalibrationError
        If the file is damaged, hostile, of another sensor, version or shape.
    """
    arrays = calibration.read(path)
    allowed = {**OWN_CLASSES, **classes}
    try:
        found = calibration.restore(arrays, 'sensor', {})
        if found != sensor:
            msg = f'calibration {path} must be of {sensor}; it is of {str(found)[:60]!r}'
            raise CalibrationError(msg)
        parts = {name: calibration.restore(arrays, name, allowed) for name in PARTS}
        _refuse_misfit(path, parts, classes)
    except (ValueError, TypeError, OverflowError, AttributeError, LookupError) as error:
        msg = f'calibration {path} is damaged ({error}); calibrate again'
        raise CalibrationError(msg) from error
    return parts


def rehearse(layout: Layout, rest: Rest, use: Callable[[Recording], ContactStates]) -> None:
    """Use a pipeline at rest and at a touch, with and without a tare, stamps and temperatures.

    Parameters
    ----------
    layout, rest : Layout, Rest
        Parts of the pipeline.
    use : callable
        Uses everything that the pipeline has, on a recording.

    Raises
    ------
    Exception
        Of any kind: whatever arrays of a wrong shape or kind run into.
    """
    touched = np.arange(REHEARSED) > 0
    touch = np.where(touched[:, None, None], 10 * rest.scale, 0.0)
    values = np.nan_to_num(rest.baseline + touch)
    stamps, warm = np.arange(REHEARSED), np.full(values.shape[:2], WARM_C)
    hot = np.full(values.shape[:2], HOT_C)
    for tare, stamp_ns, temperature_c in (
        (None, None, None), (None, stamps, warm),
        (~touched, None, warm), (~touched, stamps, None), (~touched, stamps, hot),
    ):  # fmt: skip
        told = Recording.from_arrays(
            layout, values, stamp_ns, temperature_c=temperature_c, tare=tare
        )
        use(told).refuse_misfit(layout.shape[0])


def _refuse_misfit(
    path: str | Path, parts: Mapping[str, object], classes: Mapping[str, type]
) -> None:
    """Refuse parts of other kinds or shapes than a pipeline's."""
    layout, rest = parts['layout'], parts['rest_']
    whole = isinstance(layout, Layout) and isinstance(rest, Rest)
    known = all(type(parts[name]) in classes.values() for name in ('config', 'estimation'))
    if not (whole and known):
        msg = f'calibration {path} lacks a layout, a rest level or estimators; calibrate again'
        raise CalibrationError(msg)
    counts = parts['left_out_']
    if not (isinstance(counts, dict) and all(isinstance(n, float) for n in counts.values())):
        msg = f'what the fit left out is no table of counts in calibration {path}; calibrate again'
        raise CalibrationError(msg)
    shapes = dict.fromkeys(('baseline', 'noise', 'scale'), layout.shape)  # type: ignore[attr-defined]
    if rest.temperature_c is not None:  # type: ignore[attr-defined]
        shapes['temperature_c'] = layout.shape[:1]  # type: ignore[attr-defined]
    for name, wanted in shapes.items():
        found = np.shape(getattr(rest, name))
        if found != wanted:
            msg = f'{name} of calibration {path} must have shape {wanted}; received {found}'
            raise CalibrationError(msg)


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
    """

    def __init__(
        self, sensor: str, config: SensorConfig, layout: Layout, estimation: Estimation
    ) -> None:
        self.sensor = sensor
        self.config = config
        self.layout = layout
        self.estimation = estimation
        self.rest_ = self._unknown_rest()
        self.left_out_: dict[str, float] = {}
        self.tare_frames = 0
        self.reset()

    def reset(self) -> None:
        """Forget the stream's state; the baseline of the last tare or fit stays."""
        self.stream = Stream(self._tracker(), self.estimation.start())

    def _unknown_rest(self) -> Rest:
        warms = hasattr(self.estimation, 'warmed')
        return Rest.unknown(self.layout.shape, self.config.noise, warms)

    def _tracker(self) -> BaselineTracker:
        return BaselineTracker(self.rest_.level, self._tracking(), self._tare_variance)

    @property
    def _tare_variance(self) -> float:
        """Variance of the last tare's baseline over that of a frame; 0: it is that of the fit."""
        return 1 / self.tare_frames if self.tare_frames else 0.0

    def tare(self, frames: Sequence[Frame]) -> None:
        """Replace the baseline by the mean of resting frames; an error leaves it as it was.

        Parameters
        ----------
        frames : sequence of Frame
            At least one, of this sensor's shape, with a taxel that was read; NaN and unusable
            taxels are left out; covariances hold the noise of so many frames, and of as many as
            each is the mean of. A pipeline fitted without a baseline takes none.

        Raises ValueError if there is no such frame, or the fit wanted no baseline.
        """
        refuse_tare(self.sensor, self.layout, self.rest_.tared, frames)
        rows = [frame_readings(frame, self.layout, self.estimation) for frame in frames]
        beside = [self.rest_.with_temperature(usable, chips) for usable, _, chips in rows]
        self.rest_ = self.rest_.tared_by(np.concatenate(beside))
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
        """What chips (t,) told with the baseline, NaN: nothing; None: it is not heeded."""
        return self.rest_.split(self.stream.tracker.baseline.copy())[1]

    def process(self, frame: Frame) -> ContactState:
        """Estimate from the next frame of the stream.

        Parameters
        ----------
        frame : Frame
            Of this sensor's shape; a stamp that is not newer than the last begins a new stream.

        Returns
        -------
        ContactState
            The same numbers as `process_batch` gives for the stream.

        Raises ValueError if the frame's shape differs from the layout.
        """
        refuse_other_shape(self.sensor, self.layout, np.shape(frame.values))
        usable, bits, chips = frame_readings(frame, self.layout, self.estimation)
        usable, bits = set_aside(usable, bits, self.rest_.dead)
        stamp_ns = None if frame.stamp_ns is None else np.array([frame.stamp_ns], np.int64)
        known = self._follow(usable, bits, chips, stamp_ns)
        return ContactState.assemble(bits.shape[1], known)

    def process_next(self, recording: Recording) -> ContactStates:
        """Estimate from the next frames of the stream, many at once.

        Parameters
        ----------
        recording : Recording
            One frame or more of one stream; what it tells of streams and tares is not heeded.

        Returns
        -------
        ContactStates
            The same numbers as `process` gives for them one by one, to rounding.

        Raises ValueError if the shape, the unit or a channel differs from the layout.
        """
        refuse_foreign(self.sensor, self.layout, recording)
        usable, bits = self._readings(recording)
        known = self._follow(usable, bits, recording.temperature_c, recording.stamp_ns)
        return ContactStates.assemble(len(recording), bits.shape[1], known)

    def _follow(
        self, usable: Array, bits: Bytes, chips: Array | None, stamp_ns: Integers | None
    ) -> Columns:
        """State attributes of the next frames of the stream, a new one if time went back."""
        if self.stream.is_over(stamp_ns):
            self.reset()
        restart = self.stream.admit(stamp_ns, len(bits))
        levels = self.stream.tracker.follow(self.rest_.with_temperature(usable, chips), stamp_ns)
        read, when = (usable, bits, chips), (stamp_ns, restart)
        signals = conditioned(self.rest_, self.estimation, read, when, levels)
        return self._estimate(signals, bits, self.stream)

    def process_batch(self, recording: Recording) -> ContactStates:
        """Estimate from every frame of a recording, starting from `reset()`.

        Parameters
        ----------
        recording : Recording
            Of this sensor's shape; its tare rows give the baseline inside their stream.

        Returns
        -------
        ContactStates
            One row per row of the recording.

        Raises ValueError if the shape, the unit or a channel differs from the layout.
        """
        refuse_foreign(self.sensor, self.layout, recording)
        usable, bits = self._readings(recording)
        signals = self._conditioned_rows(recording, usable, bits)
        stream = Stream(self._tracker(), self.estimation.start())
        known = self._estimate(signals, bits, stream)
        return ContactStates.assemble(len(recording), bits.shape[1], known)

    def _readings(self, recording: Recording) -> tuple[Array, Bytes]:
        """Readings of a recording, NaN where unusable, and why."""
        usable, bits = usable_readings(self.estimation, recording, self.layout)
        return set_aside(usable, bits, self.rest_.dead)

    def _conditioned_rows(self, recording: Recording, usable: Array, bits: Bytes) -> Signals:
        """Conditioned frames of a recording."""
        start = self.rest_.level, self._tracking(), self.rest_.dead, self._tare_variance
        read = usable, bits, recording.temperature_c
        beside = self.rest_.with_temperature(usable, recording.temperature_c)
        base, doubt, restart, tare = stream_baselines(recording, beside, *start)
        known = read, (recording.stamp_ns, restart), (base, doubt), tare
        signals = conditioned(self.rest_, self.estimation, *known)
        return replace(signals, begins=recording.restarts, tare=recording.tare)

    def _estimate(self, signals: Signals, bits: Bytes, stream: Stream) -> Columns:
        """State attributes of conditioned frames; the one road for live and batch."""
        if not len(bits):
            return {}
        signals = told(self.estimation, signals)
        contact = signals.in_contact
        known = self.estimation.estimate(signals, stream.memory)
        apply_contact(known, contact, signals.good)
        lacks = lacking(calibrated=self.calibrated, tared=self.rest_.tared)
        add_flags(known, signals, bits, lacks)
        in_time = signals.stamp_ns is not None and self.rest_.tared
        number = stream.ids.number(contact, signals.restart, in_time, signals.begins)
        add_patches(known, number if in_time else np.where(signals.good, number, -1))
        if self.rest_.dead is not None:
            add_dead(known, bits, self.rest_.dead)
        return known

    def fit(self, *recordings: Recording) -> Pipeline:
        """Learn baseline, noise, contact threshold and estimators from recordings.

        Parameters
        ----------
        *recordings : Recording
            One or more of this sensor's shape; what their truth knows is learned.

        Returns
        -------
        Pipeline
            Itself.

        Raises ValueError if there is no recording, or a shape, a unit or a channel differs.
        """
        refuse_foreign(self.sensor, self.layout, *recordings)
        joined = join(recordings)
        usable, bits = usable_readings(self.estimation, joined, self.layout)
        dead = dead_throughout(bits)
        usable, bits = set_aside(usable, bits, dead)
        rest = self._unknown_rest()
        if rest.temperature_c is not None:  # the threshold is learned before their slope
            self.estimation.forget_warmth()  # type: ignore[attr-defined]
        resting, ordered = resting_rows(joined), are_ordered(recordings)
        seen = joined.stamp_ns, joined.restarts, ordered, joined.temperature_c
        self.rest_ = rest.learn(usable, resting, *seen)
        self.tare_frames = 0
        signals = self._whole_rows(joined, usable, bits)
        touched = signals.delta[signals.good & touched_rows(joined)]
        firm = signals.delta[signals.good & firm_rows(joined)]
        self.rest_ = self.rest_.threshold(touched, firm, dead)
        # once more with the threshold of contact: the baseline moves as it will in use
        signals = self._whole_rows(joined, usable, bits)
        self.estimation.fit(signals, joined.truth, groups_of(joined))
        counts = left_out(recordings, joined, usable_rows(bits), signals.good, self.estimators)
        gone = {} if dead is None else {'taxels faulty in every row': float(dead.sum())}
        self.left_out_ = {**gone, **counts}
        self.warm_up()
        return self

    def _whole_rows(self, joined: Recording, usable: Array, bits: Bytes) -> Signals:
        """Conditioned frames; those without a baseline are not to be learned from."""
        signals = self._conditioned_rows(joined, usable, bits)
        whole = ~np.isnan(signals.delta).any(axis=(1, 2))
        return replace(signals, good=signals.good & whole)

    def _tracking(self) -> Tracking | None:
        follows = self.config.track_baseline and self.rest_.tared
        return Tracking(self.rest_.scale) if follows else None

    @property
    def calibrated(self) -> bool:
        """Whether anything can be estimated."""
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
        return tuple(getattr(self.estimation, 'label_names', ()))

    def enrol(self, recording: Recording, label: str) -> None:
        """Learn a class from presses; ValueError if they are too weak, clipped or none."""
        enrol = getattr(self.estimation, 'enrol', None)
        if enrol is None:
            msg = f'{self.sensor} recognises no classes; received {label!r} to enrol'
            raise ValueError(msg)
        refuse_foreign(self.sensor, self.layout, recording)
        enrol(self._conditioned_rows(recording, *self._readings(recording)), label)

    def forget(self, label: str) -> None:
        """Undo an enrolment by name."""
        forget = getattr(self.estimation, 'forget', None)
        if forget is None or label not in self.label_names:
            msg = f'label of forget must be one of {self.label_names}; received {label!r}'
            raise ValueError(msg)
        forget(label)

    @property
    def digest(self) -> str:
        """SHA-256 of the calibration (hex); a tare does not change it."""
        return identity(parts_to_arrays(self.sensor, vars(self)))

    def save(self, path: str | Path) -> None:
        """Write the calibration to one .npz, atomically."""
        write(path, parts_to_arrays(self.sensor, vars(self)))

    @classmethod
    def load(cls, path: str | Path, sensor: str, classes: Mapping[str, type]) -> Pipeline:
        """Read a calibration of `sensor`, building only objects of `classes`.

        Raises CalibrationError if it is damaged, hostile, of another sensor, version or shape.
        """
        pipeline = cls.__new__(cls)
        pipeline.sensor, pipeline.tare_frames = sensor, 0
        for name, part in read_parts(path, sensor, classes).items():
            setattr(pipeline, name, part)
        try:
            pipeline.warm_up()
        except Exception as error:
            msg = f'calibration {path} does not work ({error}); calibrate again'
            raise CalibrationError(msg) from error
        return pipeline

    def warm_up(self) -> None:
        """Use everything once, so that no frame waits for a table or a compiler.

        A fit and a load end with it; the stream is forgotten as by `reset`.
        """
        self.reset()
        flatten([self.report, self.estimators, self.label_names], 'tables')
        rehearse(self.layout, self.rest_, self.process_batch)
