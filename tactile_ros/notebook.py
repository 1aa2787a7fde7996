# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Sensors, recordings and calibrations as one types them in a notebook.

`import tactile_ros as tr` offers what stands here. Nothing is computed in another way than by the
commands: a sensor, its pipeline and an evaluation are those of the package, held more handily.
"""

from __future__ import annotations

import os
import warnings
from dataclasses import fields, replace
from functools import partial
from pathlib import Path

from tactile_ros.calibration import MARK
from tactile_ros.errors import RecordingError, TactileError
from tactile_ros.evaluation import fleet, recording_files
from tactile_ros.evaluation.recording_files import LoadedRecording, places_outside
from tactile_ros.evaluation.replay import check_learned, replay, with_known_rests, with_tare_rows
from tactile_ros.evaluation.report import Result, provenance
from tactile_ros.files import has_mark, refuse_misfit
from tactile_ros.pipeline import Pipeline
from tactile_ros.sensors.registry import SensorSpec, fit_layout, load_sensor
from tactile_ros.types import Bools, ContactStates, Integers, Recording, SensorConfig

BAGS, FILES = ('.mcap', '.db3', '.zstd'), ('.npz', '.csv')


class BagRecording(Recording):
    """Recording out of a bag: the frames of its run's tares are tare rows."""

    run: LoadedRecording | None = None  # what the bag says of it; None: of a changed copy

    def select(self, rows: Bools | Integers | slice) -> Recording:
        """Recording of some of the rows: no longer that of a whole run."""
        return Recording(**{f.name: getattr(self, f.name) for f in fields(self)}).select(rows)


class Calibration(Pipeline):
    """Pipeline that judges itself, and that follows the tares of a bag's run."""

    @classmethod
    def of(cls, pipeline: Pipeline) -> Calibration:
        """The same pipeline; they share what they learned."""
        own = cls.__new__(cls)
        vars(own).update(vars(pipeline))
        return own

    def fit(self, *recordings: Recording) -> Calibration:
        """Learn from recordings with truth, as `tactile calibrate` does; returns itself.

        It warns of true places far outside of the taxels. Raises ValueError if there is none, or a
        shape, a unit or a channel differs, and RecordingError where nothing can be learned.
        """
        self.check_layout(*recordings)
        for recording in recordings:
            for sentence in places_outside(recording):
                _warn(sentence)
        super().fit(*with_known_rests(recordings))
        check_learned(self, recordings)
        return self

    def save(self, path: str | Path) -> None:
        """Write it to one .npz, atomically; TactileError where a file of another kind is."""
        refuse_misfit(Path(path), MARK)
        super().save(path)

    def process_batch(self, recording: Recording) -> ContactStates:
        """Estimate from every frame of a recording; in a bag on the baselines of its run.

        It warns where a bag has no baseline, or the fit has none. Raises ValueError if the
        shape, the unit or a channel differs from the layout.
        """
        run = _run_of(recording)
        if run is None:
            return super().process_batch(recording)
        if not run.baselines:
            _warn(f'{run.name} has no tare of its run: the baseline is that of the calibration')
        elif not self.rest_.tared:
            _warn(f'tares of {run.name} are left out: this calibration was fitted without rest')
            run = replace(run, baselines=())
        return replay(replace(run, contacts=None, changes=()), self).states

    def evaluate(self, *recordings: Recording) -> Result:
        """Errors against the truth of recordings, and differences to the live run of bags.

        Raises ValueError if there is no recording, or a shape, a unit or a channel differs.
        """
        self.check_layout(*recordings)
        datasets = []
        for number, one in enumerate(recordings, 1):
            run = _run_of(one) or LoadedRecording(f'recording {number}', one)
            datasets.append(fleet.evaluate(run, {self.sensor: self}))
        facts = provenance((one.name for one in datasets), {self.sensor: self})
        return Result('Evaluation', 'Calibration.evaluate in Python', facts, tuple(datasets))


class Sensor(SensorSpec):
    """Kind of sensor, whose pipelines are calibrations."""

    def pipeline(
        self, config: SensorConfig | None = None, estimator: str | None = None
    ) -> Calibration:
        """Calibration that is not fitted yet; as of SensorSpec."""
        return Calibration.of(super().pipeline(config, estimator))

    def load(self, path: str | Path) -> Calibration:
        """Calibration from a file of this sensor; CalibrationError if it is none."""
        return Calibration.of(super().load(path))

    def fit(
        self,
        *recordings: Recording,
        config: SensorConfig | None = None,
        estimator: str | None = None,
    ) -> Calibration:
        """Calibration that is fitted to recordings; see `pipeline` and `Calibration.fit`."""
        config = self.config() if config is None else config
        if recordings and isinstance(recordings[0], Recording):
            config = fit_layout(config, recordings[0].layout)
        return self.pipeline(config, estimator).fit(*recordings)


def sensor(key: str) -> Sensor:
    """Look a sensor up by its key; ValueError if there is none, with those that there are."""
    return Sensor(**vars(load_sensor(key)))


def load(
    path: str | os.PathLike[str], sensor: str = ''
) -> Calibration | Recording | dict[str, Recording]:
    """Load a calibration, a recording, a bag, or a folder of recordings: whatever is there.

    It warns of what could not be read. Raises RecordingError or CalibrationError if nothing could.

    Parameters
    ----------
    path : path-like
        A calibration (.npz) gives a Calibration; a recording (.npz, .csv) and a bag of one sensor
        (folder, .mcap, .db3) a Recording; a bag of several sensors and a folder of recordings
        give a dict of them by name.
    sensor : str
        Key of the sensor, for what has no layout: a .csv, or some bags.
    """
    place = Path(path)
    if _holds(place, MARK):
        return Calibration.of(fleet.open_calibration(place))
    if place.is_dir() and not _is_bag(place):
        return _folder(place, sensor)
    found = _recordings(place, sensor)
    return found if len(found) > 1 else next(iter(found.values()))


def _run_of(recording: Recording) -> LoadedRecording | None:
    """Live run that a recording is of, as far as it is known."""
    return recording.run if isinstance(recording, BagRecording) else None


def _holds(place: Path, mark: bytes) -> bool:
    """True for an .npz with a member of that name."""
    return place.suffix == '.npz' and place.is_file() and has_mark(place, mark)


def _is_bag(place: Path) -> bool:
    """True for a storage file, and for a folder of them."""
    files = place.iterdir() if place.is_dir() else [place]
    return any(file.suffix in BAGS for file in files)


def _recordings(place: Path, sensor: str) -> dict[str, Recording]:
    """Recordings of one file or bag by the name of their sensor; warns of problems."""
    spec = load_sensor(sensor) if sensor else None
    loaded = recording_files.load(place, None if spec is None else spec.layout(spec.config()))
    problems, found = loaded.sentences, {}
    for run in loaded.recordings:
        recording, problem = with_tare_rows(run)
        problems += [f'{run.name}: {problem}'] * bool(problem)
        if place.suffix not in FILES:
            recording = BagRecording(**vars(recording))
            name = place.stem if len(loaded.recordings) == 1 else f'{place.stem}/{run.name}'
            object.__setattr__(recording, 'run', replace(run, name=name))
        found[run.name] = recording
    if problems:
        _warn(f'{place}: {"; ".join(problems)}')
    return found


def _folder(folder: Path, sensor: str) -> dict[str, Recording]:
    """Recordings of the bags and files in a folder, by their names; calibrations are left out."""
    found: dict[str, Recording] = {}
    failed = []
    for place in sorted(folder.iterdir()):
        if not (place.suffix == '.csv' or _is_bag(place) or _holds(place, recording_files.MARK)):
            continue
        try:
            inside = _recordings(place, sensor)
        except TactileError as error:
            failed.append(str(error))
            continue
        alone = len(inside) == 1
        found |= {place.stem if alone else f'{place.stem}/{k}': r for k, r in inside.items()}
    if not found:
        msg = f'{folder} holds no recording (bag, .npz or .csv) that could be read'
        raise RecordingError('; '.join([msg, *failed]))
    if failed:
        _warn(f'left out: {"; ".join(failed)}')
    return found


_warn = partial(warnings.warn, stacklevel=2)  # the caller of this module
