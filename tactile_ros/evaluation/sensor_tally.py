"""A recording judged by its truth, in pieces: memory does not grow with its length."""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, field, replace
from pathlib import Path
from time import perf_counter_ns
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.errors import RecordingError
from tactile_ros.evaluation.answer_tally import AnswerTally
from tactile_ros.evaluation.bag_pieces import BagPieces
from tactile_ros.evaluation.kept_rows import AnswerRows, Rows, SensorRows
from tactile_ros.evaluation.metrics import clocks_apart, frames_dropped
from tactile_ros.evaluation.replay import (
    Follower,
    as_live,
    calibration_problems,
    compare,
    failure_problems,
    left_out,
    replay,
    single_cost,
)
from tactile_ros.evaluation.result import unjudged
from tactile_ros.evaluation.tally import Magnitudes
from tactile_ros.evaluation.truth import DEFAULT_TRUTH, Association

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    import numpy.typing as npt

    from tactile_ros.evaluation.recording_files import LoadedRecording
    from tactile_ros.evaluation.sensor_pieces import Piece, SensorPieces
    from tactile_ros.pipeline import Pipeline
    from tactile_ros.types import Layout

PROBED = 100  # frames that are timed one by one


@dataclass(frozen=True)
class SensorTally:
    """One sensor of a recording and all that was answered to it.

    Attributes
    ----------
    name, source : str
        Of the sensor; of the recording.
    answers : tuple of AnswerTally
        One for each pipeline of its shape.
    frames, dropped : int
        Recorded; lost on the way.
    seconds : float
        From the first frame to the last; NaN: independent frames.
    latency : Magnitudes
        From acquisition to contact (s).
    association : dict of str to str
        How truth was brought together with frames: a sentence for each topic.
    problems : tuple of str
        Sentences.
    rows : SensorRows or None
        What a report draws; None: not kept.
    """

    name: str
    source: str
    answers: tuple[AnswerTally, ...]
    frames: int
    dropped: int
    seconds: float
    latency: Magnitudes = field(default_factory=Magnitudes)
    association: Mapping[str, str] = field(default_factory=dict)
    problems: tuple[str, ...] = ()
    rows: SensorRows | None = None

    @property
    def title(self) -> str:
        """Recording, and the sensor where the recording does not tell it."""
        alone = self.name in ('sensor', self.source, self.source.rpartition('.')[0])
        return (self.source if alone else f'{self.source} {self.name}').strip() or self.name


def label_of(pipeline: Pipeline) -> str:
    """Names of the estimators in use."""
    return ', '.join(dict.fromkeys(pipeline.estimators.values())) or 'not calibrated'


class _Sensor:
    """Tallies of one sensor of a bag while it is read."""

    def __init__(
        self,
        pieces: SensorPieces,
        pipelines: Mapping[str, Pipeline],
        clock: Callable[[], int],
        drawn: bool,
    ) -> None:
        self.pieces, self.clock = pieces, clock
        digests = tuple(dict.fromkeys(pieces.digests))
        shape = pieces.layout.shape
        fitting = {name: p for name, p in pipelines.items() if p.layout.shape == shape}
        if not fitting:
            msg = f'{pieces.name} has {shape} taxels and channels, which no calibration is for'
            raise RecordingError(msg)
        self.followers = {n: Follower(as_live(digests, p)) for n, p in fitting.items()}
        self.answers = {name: AnswerTally(label_of(p), name) for name, p in fitting.items()}
        self.singles: dict[str, float] = {}
        self.latency, self.ahead = Magnitudes(), 0
        self.rows: SensorRows | None = None
        if drawn:
            self.rows = SensorRows(pieces.layout.positions)
            self.rows.answers = {name: AnswerRows() for name in fitting}

    def add(self, piece: Piece) -> None:
        """Judge one more piece."""
        recording, live = piece.recording, piece.live
        about = self.rows.about(recording) if self.rows else {}
        for name, follower in self.followers.items():
            if name not in self.singles:
                probe = Follower(follower.pipeline).pipeline
                self.singles[name] = single_cost(recording, probe, self.clock, PROBED)
            begin = self.clock()
            states = follower(piece)
            spent = self.clock() - begin
            agreement = None
            if live is not None:
                agreement = compare(live.states, live.rows, states, len(recording))
            truth = as_answered(recording.truth, self.pieces.truth.names, follower.pipeline)
            if self.rows:
                self.rows.answers[name].add(truth, states, about)
            found = AnswerTally.of(truth, states)
            self.answers[name] += replace(
                found, frames=len(piece.rows), nanoseconds=spent, agreement=agreement
            )
        if live is not None and recording.stamp_ns is not None:
            delay = (live.log_ns - recording.stamp_ns[live.rows]) * 1e-9
            self.latency += Magnitudes.of(delay)
            self.ahead += int((delay < 0).sum())
            if self.rows:
                self.rows.latency.add({'latency_s': delay})

    def finish(self, source: str, problems: Sequence[str]) -> SensorTally:
        """Tallies of the whole bag."""
        pieces = self.pieces
        digests = tuple(dict.fromkeys(pieces.digests))
        answers = []
        for name, answer in self.answers.items():
            said = calibration_problems(digests, self.followers[name].pipeline)
            answers.append(replace(
                answer, us_single=self.singles.get(name, float('nan')),
                problems=(*said, *failure_problems(self.followers[name].pipeline),
                          *left_out(answer.agreement), *unjudged_targets(answer)),
            ))  # fmt: skip
        return without_latency(SensorTally(
            pieces.name, source, tuple(answers), pieces.count, pieces.dropped,
            (pieces.end_ns - pieces.begin_ns) * 1e-9, self.latency, pieces.truth.sentences,
            (*problems, *pieces.problems), self.rows,
        ), self.ahead)  # fmt: skip


def without_latency(one: SensorTally, ahead: int) -> SensorTally:
    """The same; without a latency where so many contacts came before their frames' stamps."""
    told = clocks_apart(one.latency.count, ahead)
    if not told:
        return one
    if one.rows:
        one.rows.latency = Rows()
    return replace(one, latency=Magnitudes(), problems=(*one.problems, *told))


def unjudged_targets(answer: AnswerTally) -> tuple[str, ...]:
    """A sentence where truth and estimates have nothing in common."""
    counts = {name: target.errors.count for name, target in answer.targets.items()}
    return unjudged(answer.name, counts, answer.given)


def as_answered(
    truth: Mapping[str, npt.NDArray[np.generic]], names: Sequence[str], pipeline: Pipeline
) -> Mapping[str, npt.NDArray[np.generic]]:
    """Truth whose labels came as text, numbered as the pipeline numbers its classes."""
    classes = pipeline.label_names
    if not names or 'label' not in truth:
        return truth
    number = [classes.index(name) if name in classes else -1 for name in names]
    told = np.asarray(truth['label'])
    return {**truth, 'label': np.where(told >= 0, np.array([*number, -1])[told], -1)}


def tally_bag(
    path: Path,
    pipelines: Mapping[str, Pipeline],
    truth_topics: Sequence[str] = DEFAULT_TRUTH,
    association: Association | None = None,
    layout: Layout | None = None,
    clock_ns: Callable[[], int] = perf_counter_ns,
    *,
    drawn: bool = False,
) -> list[SensorTally]:
    """Judge every sensor of a bag, piece by piece.

    Parameters
    ----------
    path : Path
        A rosbag2 folder, or one .mcap or .db3 file.
    pipelines : mapping of str to Pipeline
        By name; each judges the sensors of its shape.
    truth_topics : sequence of str
        As of `recording.load`.
    association : Association or None
        Of truth with frames.
    layout : Layout or None
        For a bag that does not tell it.
    clock_ns : callable
        For the time per frame (ns).
    drawn : bool
        Keep the rows that a report draws.

    Raises
    ------
    ClassesChangedError
        If classes came and went in the run: `tally_recording` repeats that.
    RecordingError
        If there is no bag, no frame that could be read, or no pipeline for any sensor.
    """
    bag = BagPieces(path, layout, truth_topics, association)
    sensors: dict[str, _Sensor] = {}
    for space, piece in bag:
        if space in bag.left_out:
            continue
        try:
            if space not in sensors:
                sensors[space] = _Sensor(bag.sensors[space], pipelines, clock_ns, drawn)
        except RecordingError as err:
            bag.left_out[space] = str(err)
            continue
        sensors[space].add(piece)
    if not sensors:
        raise RecordingError('; '.join(bag.left_out.values()))
    problems = bag.problems
    return [
        sensor.finish(path.name, problems if i == 0 else ())
        for i, sensor in enumerate(sensors[space] for space in sorted(sensors))
    ]


def tally_recording(
    loaded: LoadedRecording,
    pipelines: Mapping[str, Pipeline],
    source: str,
    clock_ns: Callable[[], int] = perf_counter_ns,
    *,
    drawn: bool = False,
) -> SensorTally:
    """Judge a recording that is in memory as a whole; parameters as of `tally_bag`."""
    recording = loaded.recording
    answers = []
    rows = SensorRows(recording.layout.positions) if drawn else None
    about = rows.about(recording, whole=True) if rows else {}
    for name, pipeline in pipelines.items():
        if pipeline.layout.shape != recording.layout.shape:
            continue
        found = replay(loaded, copy(pipeline), clock_ns)  # its tares are its own
        truth = as_answered(recording.truth, loaded.label_names, pipeline)
        spent = found.us_batch * 1000 * len(recording)
        if rows:
            rows.answers[name] = AnswerRows()
            rows.answers[name].add(truth, found.states, about)
        judged = replace(
            AnswerTally.of(truth, found.states),
            name=label_of(pipeline),
            calibration=name,
            frames=len(recording),
            nanoseconds=int(spent) if np.isfinite(spent) else 0,
            us_single=found.us_per_frame,
            agreement=found.agreement,
        )
        answers.append(replace(judged, problems=(*found.problems, *unjudged_targets(judged))))
    if not answers:
        shape = recording.layout.shape
        msg = f'{loaded.name} has {shape} taxels and channels, which no calibration is for'
        raise RecordingError(msg)
    stamps = recording.stamp_ns
    lasted = float('nan') if stamps is None else float(stamps[-1] - stamps[0]) * 1e-9
    dropped = frames_dropped(recording.sequence, recording.restarts)
    live, latency, ahead = loaded.contacts, Magnitudes(), 0
    if live is not None and stamps is not None:
        delay = (live.log_ns - stamps[live.rows]) * 1e-9
        latency, ahead = Magnitudes.of(delay), int((delay < 0).sum())
        if rows:
            rows.latency.add({'latency_s': delay})
    return without_latency(SensorTally(
        loaded.name, source, tuple(answers), len(recording), dropped, lasted, latency,
        problems=loaded.problems, rows=rows,
    ), ahead)  # fmt: skip
