"""Frame -> conditioning -> features -> estimators -> ContactState; one frame and batch agree.

The pipeline is the same for every sensor: faults, baseline, contact, streams and files. What is
peculiar to a sensor, its features and estimators, is an `Estimation` that its folder brings.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.calibration import write
from tactile_ros.conditioning.baseline import (
    BaselineTracker,
    Tracking,
    stream_baselines,
    tare_means,
)
from tactile_ros.conditioning.contact import ContactIds
from tactile_ros.conditioning.faults import (
    frame_faults,
    taxel_faults,
    usable_rows,
    without_faults,
)
from tactile_ros.conditioning.rest import Rest
from tactile_ros.signals import Columns, Estimation, Report, SensorConfig, Signals
from tactile_ros.states import add_patches, apply_contact
from tactile_ros.stored import identity, parts_to_arrays, read_parts
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

FORBIDS_USE = int(
    FrameStatus.NOT_CALIBRATED | FrameStatus.BAD_TAXELS | FrameStatus.SATURATED | FrameStatus.STALE
)


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
        self._tracker = BaselineTracker(self.rest_.baseline, self._tracking())
        self._memory = self.estimation.start()
        self._ids = ContactIds()
        self._restart = True
        self._stamp_ns: int | None = None

    def tare(self, frames: Sequence[Frame]) -> None:
        """Replace the baseline by the mean of resting frames.

        Parameters
        ----------
        frames : sequence of Frame
            At least one, of this sensor's shape; NaN and unusable taxels are left out.

        Raises
        ------
        ValueError
            If there is no frame, a shape differs, or the pipeline was fitted without a baseline.
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
        values = np.stack([self._checked(frame)[0] for frame in frames])
        bits = taxel_faults(values, _stacked_status(frames), self._limit())
        usable = without_faults(values, bits)
        level = tare_means(usable, np.zeros(len(values), np.int64))[0]
        self.rest_ = replace(self.rest_, baseline=level)
        self._tracker = BaselineTracker(self.rest_.baseline, self._tracking())
        self._ids.release()
        self._restart = True

    @property
    def baseline(self) -> Array:
        """Baseline in use now, shape (t, c); NaN: none yet."""
        return self._tracker.baseline

    def process(self, frame: Frame) -> ContactState:
        """Estimate from the next frame of the stream.

        Parameters
        ----------
        frame : Frame
            Of this sensor's shape.

        Returns
        -------
        ContactState
            The same numbers as `process_batch` gives for the stream.

        Raises
        ------
        ValueError
            If the frame's shape differs from the layout.
        """
        values, chips = self._checked(frame)
        stamp_ns = None if frame.stamp_ns is None else self._advance(frame.stamp_ns)
        status = None if frame.status is None else np.asarray(frame.status, np.uint8)[None]
        bits = taxel_faults(values[None], status, self._limit())
        usable = without_faults(values[None], bits)
        base = self._tracker(usable, stamp_ns)
        restart = np.array([self._restart or stamp_ns is None])
        self._restart = False
        known = self._estimate(
            usable, bits, base, chips, stamp_ns, restart, self._memory, self._ids
        )
        return ContactStates.assemble(1, len(values), known)[0]

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
        samples, taxels = len(recording), len(self.layout.positions)
        bits = taxel_faults(recording.values, recording.status, self._limit())
        usable = without_faults(recording.values, bits)
        base, restart, tare = self._baselines(recording, usable)
        ids, memory = ContactIds(), self.estimation.start()
        known = self._estimate(
            usable, bits, base, recording.temperature_c, recording.stamp_ns, restart, memory, ids,
            tare,
        )  # fmt: skip
        return ContactStates.assemble(samples, taxels, known)

    def _estimate(
        self,
        usable: Array,
        bits: Bytes,
        base: Array,
        chips: Array | None,
        stamp_ns: Integers | None,
        restart: Bools,
        memory: object,
        ids: ContactIds,
        tare: Bools | None = None,
    ) -> Columns:
        """State attributes of conditioned frames; the one road for live and batch."""
        good = usable_rows(bits)
        delta = usable - base if self.rest_.tared else usable
        contact = self.rest_.contact(delta, good, tare)
        signals = Signals(usable, delta, chips, stamp_ns, restart, contact, good)
        known = self.estimation.estimate(signals, memory)
        apply_contact(known, contact, good)
        known['in_contact'] = contact
        known['taxel_status'] = bits
        known['status'] = self._status(known, bits, base)
        known['valid'] = good & (known['status'] & FORBIDS_USE == 0)
        in_time = stamp_ns is not None and self.rest_.tared
        add_patches(known, ids.number(contact, restart, in_time))
        return known

    def _status(self, known: Columns, bits: Bytes, base: Array) -> Integers:
        """Bits of `FrameStatus` for every frame."""
        status = known.pop('status', None)
        flags = np.zeros(len(bits), np.int64) if status is None else status.astype(np.int64)
        if not self.estimation.estimators:
            flags |= FrameStatus.NOT_CALIBRATED
        if not self.rest_.tared or np.isnan(base).any():
            flags |= FrameStatus.NO_BASELINE
        if bits.any():
            flags |= frame_faults(bits)
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
        base, restart, tare = self._baselines(joined, usable)
        delta = usable - base if self.rest_.tared else usable
        good = usable_rows(bits)
        self.rest_ = self.rest_.threshold(delta[good & ~tare & touched_rows(joined)])
        contact = self.rest_.contact(delta, good, tare)
        signals = Signals(
            usable, delta, joined.temperature_c, joined.stamp_ns, restart, contact, good
        )
        self.estimation.fit(signals, joined.truth, groups_of(joined))
        self.reset()
        return self

    def _baselines(self, recording: Recording, usable: Array) -> tuple[Array, Bools, Bools]:
        """Baseline of every row, rows at which memory restarts, and tare rows."""
        tracking = self._tracking() if self.rest_.tared else None
        return stream_baselines(recording, usable, self.rest_.baseline, tracking)

    def _tracking(self) -> Tracking | None:
        return Tracking(self.rest_.scale) if self.config.track_baseline else None

    def _checked(self, frame: Frame) -> tuple[Array, Array | None]:
        """Values and temperatures of a frame of the right shape."""
        values = np.asarray(frame.values, np.float64)
        self._refuse_other_shape(values.shape)
        chips = frame.temperature_c
        return values, None if chips is None else np.asarray(chips, np.float64)[None]

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

    def _advance(self, stamp_ns: int) -> Integers:
        """A stamp that never runs backwards: a stepped clock must not turn time around."""
        if self._stamp_ns is not None:
            stamp_ns = max(stamp_ns, self._stamp_ns + 1)
        self._stamp_ns = stamp_ns
        return np.array([stamp_ns])

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
        pipeline.reset()
        return pipeline


def _stacked_status(frames: Sequence[Frame]) -> Bytes | None:
    """Status bits of several frames, None if none has any."""
    if all(frame.status is None for frame in frames):
        return None
    none = np.zeros(len(frames[0].values), np.uint8)
    return np.stack([none if frame.status is None else frame.status for frame in frames])
