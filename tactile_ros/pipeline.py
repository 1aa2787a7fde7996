"""Frame -> conditioning -> features -> estimators -> ContactState; one frame and batch agree.

The pipeline is the same for every sensor: faults, baseline, contact, streams and files. What is
peculiar to a sensor, its features and estimators, is an `Estimation` that its folder brings.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros import states, truth
from tactile_ros.calibration import flatten, write
from tactile_ros.conditioning.baseline import (
    BaselineTracker,
    Tracking,
    stream_baselines,
)
from tactile_ros.conditioning.faults import (
    dead_throughout,
    frame_readings,
    set_aside,
    usable_readings,
    usable_rows,
)
from tactile_ros.conditioning.rest import Rest
from tactile_ros.conditioning.stream import Stream
from tactile_ros.errors import CalibrationError
from tactile_ros.signals import Columns, Estimation, Report, SensorConfig, Signals
from tactile_ros.stored import identity, parts_to_arrays, read_parts, rehearse
from tactile_ros.types import (
    Array,
    Bytes,
    ContactState,
    ContactStates,
    Frame,
    Integers,
    Layout,
    Recording,
)

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path


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
        self._doubt = 0.0
        self.reset()

    def reset(self) -> None:
        """Forget the stream's state; the baseline of the last tare or fit stays."""
        self.stream = Stream(self._tracker(), self.estimation.start())

    def _unknown_rest(self) -> Rest:
        warms = hasattr(self.estimation, 'warmed')
        return Rest.unknown(self.layout.shape, self.config.noise, warms)

    def _tracker(self) -> BaselineTracker:
        return BaselineTracker(self.rest_.level, self._tracking(), self._doubt)

    def tare(self, frames: Sequence[Frame], *, doubted: bool = True) -> None:
        """Replace the baseline by the mean of resting frames; an error leaves it as it was.

        Parameters
        ----------
        frames : sequence of Frame
            At least one, of this sensor's shape, with a taxel that was read; NaN and unusable
            taxels are left out. A pipeline fitted without a baseline takes none.
        doubted : bool
            Whether covariances hold its noise; a replay is not told of how many frames it was.

        Raises ValueError if there is no such frame, or the fit wanted no baseline.
        """
        truth.refuse_tare(self.sensor, self.layout, self.rest_.tared, frames)
        rows = [frame_readings(frame, self.layout, self.estimation) for frame in frames]
        beside = [self.rest_.beside(usable, chips) for usable, _, chips in rows]
        self.rest_ = self.rest_.tared_by(np.concatenate(beside))
        self._doubt = 1 / len(frames) if doubted else 0.0
        self.stream.rebase(self._tracker())

    @property
    def baseline(self) -> Array:
        """Baseline in use now, shape (t, c); NaN: none yet, or dead in the fit."""
        level, dead = self.rest_.parted(self.stream.tracker.baseline)[0], self.rest_.dead
        return level.copy() if dead is None else np.where(dead[:, None], np.nan, level)

    @property
    def baseline_temperature_c(self) -> Array | None:
        """What chips (t,) told with the baseline, NaN: nothing; None: it is not heeded."""
        return self.rest_.parted(self.stream.tracker.baseline.copy())[1]

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
        truth.refuse_other_shape(self.sensor, self.layout, np.shape(frame.values))
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
        truth.refuse_foreign(self.sensor, self.layout, recording)
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
        levels = self.stream.tracker.follow(self.rest_.beside(usable, chips), stamp_ns)
        read, when = (usable, bits, chips), (stamp_ns, restart)
        signals = states.conditioned(self.rest_, self.estimation, read, when, levels)
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
        truth.refuse_foreign(self.sensor, self.layout, recording)
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
        start = self.rest_.level, self._tracking(), self.rest_.dead, self._doubt
        read = usable, bits, recording.temperature_c
        beside = self.rest_.beside(usable, recording.temperature_c)
        base, doubt, restart, tare = stream_baselines(recording, beside, *start)
        known = read, (recording.stamp_ns, restart), (base, doubt), tare
        signals = states.conditioned(self.rest_, self.estimation, *known)
        return replace(signals, begins=recording.restarts, tare=recording.tare)

    def _estimate(self, signals: Signals, bits: Bytes, stream: Stream) -> Columns:
        """State attributes of conditioned frames; the one road for live and batch."""
        if not len(bits):
            return {}
        signals = states.told(self.estimation, signals)
        contact = signals.in_contact
        known = self.estimation.estimate(signals, stream.memory)
        states.apply_contact(known, contact, signals.good)
        lacks = states.lacking(calibrated=self.calibrated, tared=self.rest_.tared)
        states.add_flags(known, signals, bits, lacks)
        in_time = signals.stamp_ns is not None and self.rest_.tared
        number = stream.ids.number(contact, signals.restart, in_time, signals.begins)
        states.add_patches(known, number if in_time else np.where(signals.good, number, -1))
        if self.rest_.dead is not None:
            states.add_dead(known, bits, self.rest_.dead)
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
        truth.refuse_foreign(self.sensor, self.layout, *recordings)
        joined = truth.join(recordings)
        usable, bits = usable_readings(self.estimation, joined, self.layout)
        dead = dead_throughout(bits)
        usable, bits = set_aside(usable, bits, dead)
        rest = self._unknown_rest()
        if rest.temperature_c is not None:  # the threshold is learned before their slope
            self.estimation.forget_warmth()  # type: ignore[attr-defined]
        resting, ordered = truth.resting_rows(joined), truth.are_ordered(recordings)
        seen = joined.stamp_ns, joined.restarts, ordered, joined.temperature_c
        self.rest_ = rest.learn(usable, resting, *seen)
        self._doubt = 0.0
        signals = self._whole_rows(joined, usable, bits)
        touched = signals.delta[signals.good & truth.touched_rows(joined)]
        firm = signals.delta[signals.good & truth.firm_rows(joined)]
        self.rest_ = self.rest_.threshold(touched, firm, dead)
        # once more with the threshold of contact: the baseline moves as it will in use
        signals = self._whole_rows(joined, usable, bits)
        self.estimation.fit(signals, joined.truth, truth.groups_of(joined))
        counts = truth.left_out(
            recordings, joined, usable_rows(bits), signals.good, self.estimators
        )
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
        truth.refuse_foreign(self.sensor, self.layout, recording)
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
        pipeline.sensor, pipeline._doubt = sensor, 0.0
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
