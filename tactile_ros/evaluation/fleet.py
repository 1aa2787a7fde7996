# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Many recordings judged by many pipelines: in turn, in processes, or on a Dask cluster.

A recording is one job; one process, several and a cluster give the same numbers in the same order.
A job that fails, or whose process dies, is an outcome like any other.
"""

from __future__ import annotations

import json
import math
import multiprocessing
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from threading import get_ident
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros import calibration as files
from tactile_ros.conditioning.baseline import tare_runs
from tactile_ros.errors import CalibrationError, RecordingError, TactileError, load_package
from tactile_ros.evaluation import metrics
from tactile_ros.evaluation.recording_files import Bag, ClassesChangedError, LoadedRecording, find
from tactile_ros.evaluation.replay import Follower
from tactile_ros.evaluation.report import CELLS, Answer, Dataset, answer, inside_one_sigma, rows_of
from tactile_ros.evaluation.truth import DEFAULT_TRUTH, Association, is_unknown
from tactile_ros.files import write_atomically
from tactile_ros.sensors import list_sensors, load_sensor
from tactile_ros.types import ContactStates
from tactile_ros.types.contact import stack_columns

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from tactile_ros.evaluation.metrics import Spread
    from tactile_ros.pipeline import Pipeline
    from tactile_ros.types import Array, Columns, Layout
    from tactile_ros.types.contracts import Cell

IN_MEMORY = ('.npz', '.csv')
VECTORS = ('position', 'force', 'torque')
JUDGED = (*VECTORS, *metrics.CLASSES, 'session', 'repetition')  # keys of truth
IN_TABLE = [name for name in CELLS if name not in ('named rightly (%)', 'groups')]
SCHEMA = 1
MARKS = {'.json': b'"schema"', '.npz': b'bin_edges.npy'}  # in every file of `save`
BIN_EDGES = 1e-12 * 1.01 ** np.arange(5556)  # of histograms of errors: steps of 1 % up to 1e12


@dataclass(frozen=True)
class Job:
    """One recording to be judged."""

    recording: str  # path, or name of a shipped recording of the first calibration's sensor
    calibrations: tuple[str, ...]  # paths
    truth_topics: tuple[str, ...] = DEFAULT_TRUTH
    tolerance_ns: int | None = None  # as of `Association`
    delay_ns: int | None = None  # of truth on topics of its own; None: estimated
    untared: bool = False  # judged once more after the first tare alone


@dataclass(frozen=True)
class Outcome:
    """Results of one job by sensor, or why there are none."""

    job: Job
    results: tuple[Dataset, ...] = ()
    failure: str = ''


class _Collected:
    """Estimates of one pipeline that truth can judge."""

    def __init__(self, follower: Follower) -> None:
        self.follower = follower
        self._parts: list[Columns] = []

    def add(self, piece: LoadedRecording) -> None:
        """Estimate from the next piece."""
        states = self.follower(piece)
        columns = {name: getattr(states, name) for name in (*VECTORS, *metrics.CLASSES)}
        columns |= {  # their diagonals are all that is judged
            f'{name}_cov': np.diagonal(getattr(states, f'{name}_cov'), axis1=1, axis2=2)
            for name in VECTORS
        }
        said = {k: np.array(v) for k, v in columns.items() if not is_unknown(v).all()}
        self._parts.append({'valid': states.valid.copy(), **said})

    def states(self, lengths: Sequence[int], taxels: int) -> ContactStates:
        """Estimates of all pieces together."""
        columns = stack_columns(self._parts, lengths)
        for name in (f'{name}_cov' for name in VECTORS):
            if name in columns:
                shape = (len(columns[name]), 3, 3)
                columns[name] = np.broadcast_to(columns[name][:, None], shape)
        return ContactStates.assemble(sum(lengths), taxels, columns)

    def answer(self, calibration: str, whole: LoadedRecording, states: ContactStates) -> Answer:
        """Judge all estimates."""
        done = self.follower
        name = ', '.join(dict.fromkeys(done.began.estimators.values())) or 'not calibrated'
        recording = replace(whole.recording, truth=as_answered(whole, done.pipeline))
        return replace(
            answer(name, recording, states, done.us_single, done.us_batch),
            calibration=calibration, frames=done.frames, agreement=done.agreement,
            problems=done.problems,
        )  # fmt: skip


class Evaluation:
    """Pipelines that are judged on one sensor, piece by piece.

    `first` is the first piece, or all of it; pipelines are named by their calibrations, and judged
    once more as if the run had been tared at its beginning alone where `untared`. Raises
    RecordingError if no pipeline is of its shape.
    """

    def __init__(
        self, first: LoadedRecording, pipelines: Mapping[str, Pipeline], untared: bool = False
    ) -> None:
        self._layout = first.recording.layout
        shape = self._layout.shape
        self._answers = {
            name: _Collected(Follower(pipeline, first))
            for name, pipeline in pipelines.items()
            if pipeline.layout.shape == shape
        }
        if not self._answers:
            msg = f'{first.name} has {shape} taxels and channels, which no calibration is for'
            raise RecordingError(msg)
        self._untared = Evaluation(with_first_tare(first), pipelines) if untared else None
        self._lengths: list[int] = []
        self._tares_ns: list[int] = []  # of the live run
        self._latency: list[Array] = [np.zeros(0)]

    def add(self, piece: LoadedRecording) -> None:
        """Judge one more piece."""
        recording, live = piece.recording, piece.contacts
        if self._untared is not None:
            self._untared.add(with_first_tare(piece, first=not self._lengths))
        for one in self._answers.values():
            one.add(piece)
        self._tares_ns += [b.stamp_ns or 0 for b in piece.baselines if b.averaged]
        if live is not None and recording.stamp_ns is not None:
            self._latency.append(np.asarray((live.log_ns - recording.stamp_ns[live.rows]) * 1e-9))
        self._lengths.append(len(recording))

    def result(self, whole: LoadedRecording, source: str = '') -> Dataset:
        """Results of all pieces, whose times and truth are given."""
        stamps = whole.recording.stamp_ns
        if stamps is not None and whole.recording.tare is None and self._tares_ns:
            tare = np.isin(stamps, self._tares_ns)
            whole = replace(whole, recording=replace(whole.recording, tare=tare))
        recording = whole.recording
        delay = np.concatenate(self._latency)
        ahead = int((delay < 0).sum())
        apart = (
            f'no latency: {ahead} of {len(delay)} contacts were received before the stamps of '
            'their frames, whose clock is not the recorder’s',
        ) * (ahead > metrics.MOST_AHEAD * len(delay))
        answers: list[Answer] = []
        blind: list[str] = []
        for name, collected in self._answers.items():
            states = collected.states(self._lengths, self._layout.shape[0])
            one = collected.answer(name, whole, states)
            counts = {target.name: target.spread.count for target in one.targets}
            blind += metrics.unjudged(one.name, counts, metrics.given_targets(states))
            answers.append(one)
        if self._untared is not None:
            pairs = zip(answers, self._untared.result(with_first_tare(whole)).answers, strict=True)
            answers = [replace(one, untared=other) for one, other in pairs]
        alone = whole.name in ('sensor', source, source.rpartition('.')[0])
        agreements = [one.agreement for one in answers if one.agreement is not None]
        return Dataset(
            name=(source if alone else f'{source} {whole.name}').strip() or whole.name,
            summary='', answers=tuple(answers), frames=len(recording),
            dropped=metrics.frames_dropped(recording.sequence, recording.restarts),
            chips=self._layout.positions, latency_s=np.zeros(0) if apart else delay,
            agreement=min(agreements, key=lambda one: one.largest, default=None),
            problems=(*whole.problems, *dict.fromkeys(blind), *apart),
            source=source, sensor=whole.name,
            seconds=float('nan') if stamps is None else float(stamps[-1] - stamps[0]) * 1e-9,
        )  # fmt: skip


def with_first_tare(piece: LoadedRecording, *, first: bool = True) -> LoadedRecording:
    """Piece, the first one or a later, of a run as if it had been tared at its beginning alone."""
    recording = piece.recording
    if recording.tare is not None:
        run, _ = tare_runs(recording.tare, recording.restarts)
        recording = replace(recording, tare=run == 0)
    baselines = piece.baselines[:2] if first else ()
    return replace(piece, recording=recording, baselines=baselines, contacts=None, calibrations=())


def as_answered(whole: LoadedRecording, pipeline: Pipeline) -> Columns:
    """Truth whose labels came as text, numbered as the pipeline numbers its classes."""
    truth, names, classes = whole.recording.truth, whole.label_names, pipeline.label_names
    if not names or 'label' not in truth:
        return truth
    number = np.array([*(classes.index(n) if n in classes else -1 for n in names), -1])
    stated = np.asarray(truth['label'], np.int64)
    return {**truth, 'label': np.where(stated >= 0, number[stated], -1)}


def evaluate_bag(
    path: Path,
    pipelines: Mapping[str, Pipeline],
    truth_topics: Sequence[str] = DEFAULT_TRUTH,
    association: Association | None = None,
    layout: Layout | None = None,
    *,
    untared: bool = False,
) -> list[Dataset]:
    """Judge every sensor of a bag, piece by piece.

    Path, topics, association and layout are as of `recording_files.Bag`; each pipeline judges the
    sensors of its shape, with `untared` as of `Evaluation`.
    Raises ClassesChangedError if classes came and went in the run, which is repeated in a bag that
    is held as a whole, and RecordingError if there is no bag, no frame that could be read, or no
    pipeline for any sensor.
    """
    bag = Bag(path, layout, truth_topics, association, wanted=JUDGED)
    evaluations: dict[str, Evaluation] = {}
    for space, piece in bag:
        try:
            if space not in evaluations and space not in bag.left_out:
                evaluations[space] = Evaluation(piece, pipelines, untared)
        except RecordingError as err:
            bag.left_out[space] = str(err)
        if space in evaluations:
            evaluations[space].add(piece)
    if not evaluations:
        raise RecordingError('; '.join(bag.left_out.values()))
    results: list[Dataset] = []
    for space in sorted(evaluations):
        sensor = bag.sensors[space]
        one = evaluations[space].result(sensor.whole(), path.name)
        problems = (*(() if results else bag.problems), *one.problems)
        said = {name: t.sentence for name, t in sensor.truth.items() if t.sentence}
        results.append(replace(one, problems=problems, association=said))
    return results


def evaluate(
    loaded: LoadedRecording, pipelines: Mapping[str, Pipeline], source: str = '', *,
    untared: bool = False,
) -> Dataset:  # fmt: skip
    """Judge a recording that is in memory as a whole; parameters as of `evaluate_bag`."""
    evaluation = Evaluation(loaded, pipelines, untared)
    evaluation.add(loaded)
    return evaluation.result(loaded, source)


def open_calibration(path: str | Path) -> Pipeline:
    """Pipeline of whatever sensor the file is of."""
    key = str(files.read(Path(path)).get('sensor.scalar', ''))[:60]
    if key not in list_sensors():
        msg = f'{path} is of sensor {key!r}, which is not here; set TACTILE_SENSORS to its folder'
        raise CalibrationError(msg)
    return load_sensor(key).load(Path(path))


@lru_cache(maxsize=64)
def _opened(path: str, changed_ns: int, thread: int) -> Pipeline:
    """Read a calibration once by a thread (of which a worker may have some), not shared."""
    return open_calibration(path)


def run_job(job: Job) -> Outcome:
    """Do one job; a failure is an outcome and not raised."""
    try:
        return Outcome(job, tuple(_results(job)))
    except (TactileError, ValueError, OSError) as err:
        return Outcome(job, failure=str(err))
    except Exception as err:  # whatever a recording makes of the evaluation
        return Outcome(job, failure=f'{job.recording}: {type(err).__name__}: {err}')


def _results(job: Job) -> list[Dataset]:
    stems = [Path(path).stem for path in job.calibrations]
    pipelines = {}
    for path, stem in zip(job.calibrations, stems, strict=True):
        name = stem if stems.count(stem) == 1 else path
        pipelines[name] = _opened(path, Path(path).stat().st_mtime_ns, get_ident())
    first = next(iter(pipelines.values()))
    file, topics, layout = Path(job.recording), job.truth_topics, first.layout
    asked = '' if job.delay_ns is None else ' as was said'
    truth = Association(job.tolerance_ns, job.delay_ns, asked)
    if file.exists() and file.suffix not in IN_MEMORY:
        with suppress(ClassesChangedError):
            return evaluate_bag(file, pipelines, topics, truth, layout, untared=job.untared)
    found = find(job.recording, load_sensor(first.sensor), layout, topics, truth).recordings
    return [evaluate(one, pipelines, file.name, untared=job.untared) for one in found]


def run_jobs(
    jobs: Sequence[Job],
    workers: int = 1,
    scheduler: str = '',
    done: Callable[[Outcome], None] = lambda outcome: None,
) -> list[Outcome]:
    """Do many jobs, different from one another: outcomes are in their order.

    `workers` are processes on this machine, `scheduler` the address of a running Dask scheduler
    whose workers see the same files; `done` hears of every outcome as soon as it is there.
    """
    outcomes: dict[Job, Outcome] = {}

    def add(outcome: Outcome) -> None:
        outcomes[outcome.job] = outcome
        done(outcome)

    if scheduler:
        _on_dask(jobs, scheduler, add)
    elif workers > 1 and len(jobs) > 1:
        # where a process died, each job that was lost with it gets its own
        for job in _pool(jobs, min(workers, len(jobs)), add):
            if _pool([job], 1, add):
                add(Outcome(job, failure=f'{job.recording}: the process that read it died'))
    else:
        for job in jobs:
            add(run_job(job))
    return [outcomes[job] for job in jobs]


def _pool(
    jobs: Sequence[Job],
    workers: int,
    add: Callable[[Outcome], None],
    work: Callable[[Job], Outcome] = run_job,
) -> list[Job]:
    lost = []
    fresh = multiprocessing.get_context('spawn')
    with ProcessPoolExecutor(workers, mp_context=fresh) as pool:
        waiting = {pool.submit(work, job): job for job in jobs}
        for future in as_completed(waiting):
            try:
                add(future.result())
            except BrokenProcessPool:
                lost.append(waiting[future])
    return [job for job in jobs if job in lost]


def _on_dask(jobs: Sequence[Job], scheduler: str, add: Callable[[Outcome], None]) -> None:
    """Do jobs on a cluster: Dask gives those of a lost worker to another, a few times."""
    distributed = load_package('distributed', 'a Dask cluster needs distributed')
    try:
        client = distributed.Client(scheduler, timeout=10, set_as_default=False)
    except (OSError, ValueError) as err:
        msg = f'no Dask scheduler answers at {scheduler}: {err}'
        raise RecordingError(msg) from err
    with client:
        waiting = {client.submit(run_job, job, pure=False): job for job in jobs}
        for future in distributed.as_completed(waiting, loop=client.loop):
            try:
                add(future.result())
            except Exception as err:  # whatever ended it on the cluster
                why = f'{waiting[future].recording}: {type(err).__name__}: {err}'
                add(Outcome(waiting[future], failure=why))


def pooled(outcomes: Sequence[Outcome]) -> Dataset | None:
    """All sensors of all outcomes together, by calibration; None for fewer than two."""
    results = [one for outcome in outcomes for one in outcome.results]
    if len(results) < 2:
        return None
    by_name: dict[str, list[Answer]] = {}
    for found in (found for one in results for found in one.answers):
        by_name.setdefault(found.calibration, []).append(found)
    return replace(
        results[0], name='all', sensor='all', source='',
        answers=tuple(_pooled(answers) for answers in by_name.values()),
        frames=sum(one.frames for one in results), dropped=sum(one.dropped for one in results),
        seconds=sum(one.seconds for one in results),
        latency_s=np.concatenate([one.latency_s for one in results]),
        agreement=None, problems=(), association={},
    )  # fmt: skip


def _pooled(answers: Sequence[Answer]) -> Answer:
    """One answer of several: there is no median of medians, so the first measured time stays."""
    parts = {name: [t for one in answers if (t := one.target(name))] for name in metrics.TARGETS}
    judged = [classes for one in answers for classes in one.classes]
    by_kind = ([one for one in judged if one.name == kind] for kind in metrics.CLASSES)
    contacts = [one.contact for one in answers if one.contact is not None]
    agreements = [one.agreement for one in answers if one.agreement is not None]
    singles = (one.us_single for one in answers if not math.isnan(one.us_single))
    frames = sum(one.frames for one in answers)
    spent = sum(one.us_batch * one.frames for one in answers if one.frames)
    return Answer(
        answers[0].name, tuple(metrics.TargetErrors.pool(some) for some in parts.values() if some),
        next(singles, float('nan')), spent / frames if frames else float('nan'),
        classes=tuple(metrics.ClassErrors.pool(some) for some in by_kind if some),
        contact=metrics.ContactErrors.pool(contacts) if contacts else None,
        calibration=answers[0].calibration, frames=frames,
        agreement=sum(agreements[1:], agreements[0]) if agreements else None,
        problems=tuple(dict.fromkeys(text for one in answers for text in one.problems)),
    )  # fmt: skip


def table(outcomes: Sequence[Outcome]) -> tuple[list[str], list[list[Cell]]]:
    """Columns with units and a row per sensor and calibration, then all together."""
    results = [one for outcome in outcomes for one in outcome.results]
    whole = pooled(outcomes)
    alone = len({found.calibration for one in results for found in one.answers}) < 2
    names = [name for name in IN_TABLE if not (alone and name == 'calibration')]
    return rows_of(results if whole is None else [*results, whole], names)


def save(
    path: Path, outcomes: Sequence[Outcome], command: str, environment: Mapping[str, str]
) -> tuple[Path, Path]:
    """Write `<path>.json` with the command that repeats it, and `<path>.npz`; return both paths.

    The npz holds the histograms of all errors, `<i>/<j>/<target>` for recording i and answer j as
    the json lists them, and the edges of their bins.
    """
    whole = pooled(outcomes)
    results = [one for outcome in outcomes for one in outcome.results]
    document = {
        'schema': SCHEMA, 'command': command, 'environment': dict(environment),
        'recordings': [_sensor_json(one) for one in results],
        'all': None if whole is None else _sensor_json(whole),
        'failed': {o.job.recording: o.failure for o in outcomes if o.failure},
    }  # fmt: skip
    arrays: Columns = {'schema': np.array(SCHEMA), 'bin_edges': BIN_EDGES}
    for i, one in enumerate(results):
        for j, found in enumerate(one.answers):
            for target in found.targets:
                size = target.size[np.isfinite(target.size)]
                bins = np.searchsorted(BIN_EDGES, size, side='right')
                arrays[f'{i}/{j}/{target.name}'] = np.bincount(bins, minlength=len(BIN_EDGES) + 1)
    finite = json.loads(json.dumps(document), parse_constant=lambda _: None)
    text = json.dumps(finite, indent=1, allow_nan=False) + '\n'
    return (
        write_atomically(path.with_name(f'{path.name}.json'), text.encode()),
        files.save_arrays(path.with_name(f'{path.name}.npz'), arrays),
    )


def _sensor_json(one: Dataset) -> dict[str, object]:
    return {
        'recording': one.source, 'sensor': one.sensor, 'frames': one.frames,
        'dropped': one.dropped, 'seconds': one.seconds,
        'latency': _spread_json(one.latency, 's'), 'truth': dict(one.association),
        'problems': list(one.problems), 'answers': [_answer_json(found) for found in one.answers],
    }  # fmt: skip


def _answer_json(found: Answer) -> dict[str, object]:
    agreement = found.agreement
    return {
        'estimator': found.name, 'calibration': found.calibration,
        'us_single': found.us_single, 'us_batch': found.us_batch,
        'difference_to_live': None if agreement is None else agreement.largest,
        'frames_without_contacts': None if agreement is None else agreement.without_contacts,
        'problems': list(found.problems),
        'targets': {
            target.name: {
                **_spread_json(target.spread, target.unit),
                'inside_one_sigma': inside_one_sigma([target]),
                'judged': target.coverage.count, 'missed': target.missed,
                'invalid': target.invalid,
            }
            for target in found.targets
        },
        'classes': {name: dict(counts) for name, counts in found.hits.items()},
    }  # fmt: skip


def _spread_json(errors: Spread, unit: str) -> dict[str, object]:
    sums = (errors.mean * errors.count, errors.rms**2 * errors.count) if errors.count else (0, 0)
    return {
        'unit': unit, **vars(errors),
        'sum': float(sums[0]), 'sum_of_squares': float(sums[1]),
    }  # fmt: skip
