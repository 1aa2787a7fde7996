"""Frame -> conditioning -> features -> estimators -> ContactState; one frame and batch agree.

The pipeline is the same for every sensor: faults, baseline, contact, streams and files. What is
peculiar to a sensor, its features and estimators, is an `Estimation` that its folder brings.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.calibration import flatten, write
from tactile_ros.conditioning.baseline import (
    BaselineTracker,
    Tracking,
    stream_baselines,
    tare_means,
)
from tactile_ros.conditioning.faults import (
    frame_readings,
    taxel_faults,
    usable_rows,
    without_faults,
)
from tactile_ros.conditioning.rest import Rest
from tactile_ros.conditioning.stream import Stream
from tactile_ros.signals import Columns, Estimation, Report, SensorConfig, Signals
from tactile_ros.states import add_flags, add_patches, apply_contact
from tactile_ros.stored import identity, parts_to_arrays, read_parts, rehearse
from tactile_ros.truth import groups_of, join, resting_rows, touched_rows
from tactile_ros.types import (
    Array,
    Bools,
    Bytes,
    ContactState,
    ContactStates,
    Frame,
    FrameStatus,
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
        self.rest_ = Rest.unknown(layout.shape, config.noise)
        self.reset()

    def reset(self) -> None:
        """Forget the stream's state; the baseline of the last tare or fit stays."""
        self._stream = self._begin()

    def _begin(self) -> Stream:
        return Stream(self._tracker(), self.estimation.start())

    def _tracker(self) -> BaselineTracker:
        return BaselineTracker(self.rest_.baseline, self._tracking())

    def tare(self, frames: Sequence[Frame]) -> None:
        """Replace the baseline by the mean of resting frames.

        Parameters
        ----------
        frames : sequence of Frame
            At least one, of this sensor's shape; NaN and unusable taxels are left out.

        Raises
        ------
        ValueError
            If there is no frame, a shape differs, no taxel was read, or the pipeline was fitted
            without a baseline; the baseline in use stays.
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
            self._refuse_other_shape(np.shape(frame.values))
        usable = np.concatenate([frame_readings(frame, self._limit())[0] for frame in frames])
        level = tare_means(usable, np.zeros(len(usable), np.int64))[0]
        if np.isnan(level).any(axis=1).all():
            msg = (
                f'frames of tare must hold a usable reading; taxels {list(range(len(level)))} are '
                f'faulty or unread in each of the {len(frames)} received'
            )
            raise ValueError(msg)
        self.rest_ = replace(self.rest_, baseline=level)
        self._stream.rebase(self._tracker())

    @property
    def baseline(self) -> Array:
        """Baseline in use now, shape (t, c); NaN: none yet."""
        return self._stream.tracker.baseline

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

        Raises
        ------
        ValueError
            If the frame's shape differs from the layout.
        """
        self._refuse_other_shape(np.shape(frame.values))
        usable, bits, chips = frame_readings(frame, self._limit())
        if self._stream.is_over(frame.stamp_ns):
            self.reset()
        stamp_ns, restart = self._stream.admit(frame.stamp_ns)
        base = self._stream.tracker(usable, stamp_ns)
        signals = self._signals(usable, bits, base, chips, stamp_ns, restart)
        known = self._estimate(signals, bits, base, self._stream)
        return ContactState.assemble(bits.shape[1], known)

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

        Raises
        ------
        ValueError
            If the shape differs from the layout.
        """
        self._refuse_other_shape(recording.values.shape[1:])
        bits = taxel_faults(recording.values, recording.status, self._limit())
        usable = without_faults(recording.values, bits)
        base, signals = self._conditioned_rows(recording, usable, bits)
        known = self._estimate(signals, bits, base, self._begin(), recording.restarts)
        return ContactStates.assemble(len(recording), bits.shape[1], known)

    def _conditioned_rows(
        self, recording: Recording, usable: Array, bits: Bytes
    ) -> tuple[Array, Signals]:
        """Baseline of every row of a recording, and its conditioned frames."""
        tracking, level = self._tracking(), self.rest_.baseline
        base, restart, tare = stream_baselines(recording, usable, level, tracking)
        chips, stamp_ns = recording.temperature_c, recording.stamp_ns
        return base, self._signals(usable, bits, base, chips, stamp_ns, restart, tare)

    def _signals(
        self,
        usable: Array,
        bits: Bytes,
        base: Array,
        chips: Array | None,
        stamp_ns: Integers | None,
        restart: Bools,
        tare: Bools | None = None,
    ) -> Signals:
        """Frames less their baseline, with what they say about contact."""
        delta = usable - base if self.rest_.tared else usable
        good = usable_rows(bits)
        contact = self.rest_.contact(delta, good, tare)
        return Signals(usable, delta, chips, stamp_ns, restart, contact, good)

    def _estimate(
        self,
        signals: Signals,
        bits: Bytes,
        base: Array,
        stream: Stream,
        begins: Bools | None = None,
    ) -> Columns:
        """State attributes of conditioned frames; the one road for live and batch."""
        contact = signals.in_contact
        known = self.estimation.estimate(signals, stream.memory)
        apply_contact(known, contact, signals.good)
        add_flags(known, signals, bits, self._flags(base))
        in_time = signals.stamp_ns is not None and self.rest_.tared
        number = stream.ids.number(contact, signals.restart, in_time, begins)
        add_patches(known, number if in_time else np.where(signals.good, number, -1))
        return known

    def _flags(self, base: Array) -> Integers:
        """Bits of `FrameStatus` (s,) that the calibration and the baselines (s, t, c) set."""
        flags = np.zeros(len(base), np.int64)
        if not self.calibrated:
            flags |= FrameStatus.NOT_CALIBRATED
        unknown = np.isnan(base)
        if not self.rest_.tared:
            flags |= FrameStatus.NO_BASELINE
        elif np.count_nonzero(unknown):
            flags |= unknown.any(axis=(1, 2)) * np.int64(FrameStatus.NO_BASELINE)
        return flags

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

        Raises
        ------
        ValueError
            If there is no recording or a shape differs.
        """
        if not recordings:
            msg = 'recordings of fit must hold at least one Recording; received none'
            raise ValueError(msg)
        for recording in recordings:
            self._refuse_other_shape(recording.values.shape[1:])
        joined = join(recordings)
        bits = taxel_faults(joined.values, joined.status, self._limit())
        usable = without_faults(joined.values, bits)
        rest = Rest.unknown(self.layout.shape, self.config.noise)
        self.rest_ = rest.learn(usable, resting_rows(joined), joined.stamp_ns, joined.restarts)
        signals = self._whole_rows(joined, usable, bits)
        touched = signals.good & touched_rows(joined)
        if joined.tare is not None:
            touched &= ~joined.tare
        self.rest_ = self.rest_.threshold(signals.delta[touched])
        # once more with the threshold of contact: the baseline moves as it will in use
        signals = self._whole_rows(joined, usable, bits)
        self.estimation.fit(signals, joined.truth, groups_of(joined))
        self.reset()
        return self

    def _whole_rows(self, joined: Recording, usable: Array, bits: Bytes) -> Signals:
        """Conditioned frames, of which those without a baseline are not to be learned from."""
        _, signals = self._conditioned_rows(joined, usable, bits)
        whole = ~np.isnan(signals.delta).any(axis=(1, 2))
        return replace(signals, good=signals.good & whole)

    def _tracking(self) -> Tracking | None:
        follows = self.config.track_baseline and self.rest_.tared
        return Tracking(self.rest_.scale) if follows else None

    def _refuse_other_shape(self, shape: tuple[int, ...]) -> None:
        if shape != self.layout.shape:
            msg = (
                f'frames of {self.sensor} must have shape {self.layout.shape} (t, c) as its '
                f'config says; received {shape}'
            )
            raise ValueError(msg)

    def _limit(self) -> Array:
        """Magnitude at which each channel clips, shape (c,)."""
        limit = self.layout.saturation
        return np.full(self.layout.shape[1], np.inf) if limit is None else limit

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
        """Errors on held-out groups for each target, as the fit measured them."""
        return self.estimation.report

    @property
    def label_names(self) -> tuple[str, ...]:
        """Names of the classes that it can recognise."""
        return tuple(getattr(self.estimation, 'label_names', ()))

    def enrol(self, recording: Recording, label: str) -> None:
        """Learn a new class from presses; only sensors that recognise objects can."""
        enrol = getattr(self.estimation, 'enrol', None)
        if enrol is None:
            msg = f'{self.sensor} recognises no classes; received {label!r} to enrol'
            raise ValueError(msg)
        enrol(recording, label)

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

        Raises
        ------
        CalibrationError
            If the file is damaged, hostile, of another sensor, version or shape.
        """
        pipeline = cls.__new__(cls)
        pipeline.sensor = sensor
        for name, part in read_parts(path, sensor, classes).items():
            setattr(pipeline, name, part)
        rehearse(path, pipeline.layout, pipeline.rest_, pipeline._first_use)
        return pipeline

    def _first_use(self, recording: Recording) -> ContactStates:
        """States of a fresh pipeline, after a look at all else that it can be asked for."""
        self.reset()
        flatten([self.report, self.estimators, self.label_names], 'tables')
        return self.process_batch(recording)
