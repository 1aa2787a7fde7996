"""Many recordings judged by many pipelines: in turn, in processes, or on a Dask cluster.

A recording is one job. What a job finds does not depend on where it runs, and results are put in
the order of the jobs, so that one process, several and a cluster give the same numbers. A job that
fails, or whose process dies, is an outcome like any other.
"""

from __future__ import annotations

import json
import math
import multiprocessing
from collections import Counter
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from threading import get_ident
from time import perf_counter_ns
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros import calibration as files
from tactile_ros.errors import MissingPackageError, RecordingError, TactileError
from tactile_ros.evaluation.metrics import (
    TARGETS,
    Agreement,
    ClassErrors,
    Judged,
    class_rows,
    clocks_apart,
    frames_dropped,
    given_targets,
    judge,
    place_groups,
    summarised,
    times_of,
    unjudged,
)
from tactile_ros.evaluation.recording_files import (
    Bag,
    ClassesChangedError,
    LoadedRecording,
    load,
    save_arrays,
)
from tactile_ros.evaluation.replay import Follower, compare, single_cost
from tactile_ros.evaluation.report import Answer, Dataset
from tactile_ros.evaluation.truth import DEFAULT_TRUTH, Association, associate
from tactile_ros.files import write_beside
from tactile_ros.sensors import load_sensor
from tactile_ros.types import Integers, Recording, groups_of

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    import numpy.typing as npt

    from tactile_ros.evaluation.cdr_columns import Columns
    from tactile_ros.evaluation.metrics import Spread, TargetErrors
    from tactile_ros.pipeline import Pipeline
    from tactile_ros.types import Array, ContactStates, Layout

    Cell = str | float | int | None

IN_MEMORY = ('.npz', '.csv')
CLASSES = ('cell', 'label', 'in_contact', 'slip')
PROBED = 100  # frames that are timed one by one
MOST_DRAWN = 1 << 16  # rows of a target
DRAWN = ('truth', 'estimate', 'error', 'variance', 'rows', 'time_s', 'groups')
MILLI = 1e3
COLUMNS = (
    'recording', 'estimator', 'calibration', 'place mean (mm)', 'p50', 'p95', 'normal RMSE (N)',
    'shear RMSE (N)', 'place in 1 sigma (%)', 'force in 1 sigma (%)', 'contact right (%)',
    'cell right (%)', 'label right (%)', 'slip right (%)', 'latency p50 (ms)', 'p99 (ms)',
    'dropped', 'frames', 'us/frame', 'us/frame batch',
)  # fmt: skip
SCHEMA = 1
BIN_EDGES = 1e-12 * 1.01 ** np.arange(5556)  # of histograms of errors: steps of 1 % up to 1e12


@dataclass(frozen=True)
class Job:
    """One recording to be judged.

    Attributes
    ----------
    recording : str
        Path, or name of a shipped recording of the first calibration's sensor.
    calibrations : tuple of str
        Paths of calibration files.
    truth_topics : tuple of str
        As of `recording_files.load`.
    tolerance_ns : int or None
        As of `Association`.
    delay_ns : int or None
        By how much truth on topics of its own is late (ns); None: estimated.
    """

    recording: str
    calibrations: tuple[str, ...]
    truth_topics: tuple[str, ...] = DEFAULT_TRUTH
    tolerance_ns: int | None = None
    delay_ns: int | None = None


@dataclass(frozen=True)
class PipelineAnswer(Answer):
    """One pipeline on one sensor, or on several together.

    Attributes
    ----------
    calibration : str
        Name of the calibration file.
    hits : dict of str to Counter
        Rows that are 'right', 'wrong' or 'abstained', for each kind of class with known truth.
    frames : int
        That were processed.
    agreement : Agreement or None
        With the live run; None: there was none.
    problems : tuple of str
        What must be known about it, as sentences.
    """

    calibration: str = ''
    hits: Mapping[str, Counter[str]] = field(default_factory=dict)
    frames: int = 0
    agreement: Agreement | None = None
    problems: tuple[str, ...] = ()


@dataclass(frozen=True)
class SensorResult(Dataset):
    """One sensor of a recording and all that was answered to it.

    Attributes
    ----------
    source, sensor : str
        Names of the recording and of the sensor in it.
    seconds : float
        From the first frame to the last; NaN: independent frames.
    association : dict of str to str
        How truth was brought together with frames: a sentence for each topic.
    """

    answers: tuple[PipelineAnswer, ...]
    source: str = ''
    sensor: str = ''
    seconds: float = float('nan')
    association: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Outcome:
    """What one job came to: results by sensor, or why there are none."""

    job: Job
    results: tuple[SensorResult, ...] = ()
    failure: str = ''


class _Collected:
    """What one pipeline answered, beside the truth of the same rows."""

    def __init__(self, follower: Follower) -> None:
        self.follower = follower
        self.judged: dict[str, list[Judged]] = {}
        self.named: dict[str, list[tuple[Integers, Integers]]] = {}
        self.hits: dict[str, Counter[str]] = {}
        self.given: dict[str, None] = {}
        self.frames = self.spent_ns = 0
        self.us_single = float('nan')
        self.agreement: Agreement | None = None

    def add(self, truth: Columns, states: ContactStates, first: int) -> None:
        """Judge the next rows, the first of which has a number."""
        self.given.update(dict.fromkeys(given_targets(states)))
        for name in TARGETS:
            seen = judge(name, truth, states)
            if len(seen.rows):
                seen = replace(seen, rows=seen.rows + first)
                self.judged.setdefault(name, []).append(seen)
        for kind, true, said in class_rows(truth, states):
            self.named.setdefault(kind, []).append((true, said))
        for kind in (kind for kind in CLASSES if kind in truth):
            true = np.asarray(truth[kind])
            said = np.where(states.valid, getattr(states, kind), -1)[true >= 0]
            right, abstained = int((said == true[true >= 0]).sum()), int((said < 0).sum())
            if len(said):
                counts = {'right': right, 'wrong': len(said) - right - abstained}
                self.hits.setdefault(kind, Counter()).update({**counts, 'abstained': abstained})

    def answer(self, calibration: str, groups: Integers, times: Array) -> PipelineAnswer:
        """Errors and names of all rows, whose groups and times (s) are given."""
        targets = []
        for name in (name for name in TARGETS if name in self.judged):
            seen = _joined(self.judged[name])
            own = groups[seen.rows]
            own = place_groups(seen.truth, own) if name == 'position' else own
            targets.append(summarised(name, seen, own, times[seen.rows]))
        label = label_of(self.follower.began)
        named = (
            ClassErrors(kind, *(np.concatenate(column) for column in zip(*parts, strict=True)))
            for kind, parts in self.named.items()
        )
        problems = self.follower.problems
        problems += () if self.agreement is None else self.agreement.problems
        return PipelineAnswer(
            label, tuple(targets), self.us_single,
            self.spent_ns / self.frames / 1000 if self.frames else float('nan'),
            classes=tuple(one for one in named if (one.said >= 0).any()),
            calibration=calibration, hits=self.hits, frames=self.frames, agreement=self.agreement,
            problems=problems,
        )  # fmt: skip


def _joined(parts: Sequence[Judged | TargetErrors]) -> Judged:
    """Judged rows of all parts together."""
    arrays = {
        name: np.concatenate([getattr(part, name) for part in parts])
        for name in ('rows', 'truth', 'estimate', 'error', 'variance')
    }
    missed, invalid = (sum(getattr(part, n) for part in parts) for n in ('missed', 'invalid'))
    return Judged(**arrays, missed=missed, invalid=invalid)


class Evaluation:
    """Answers of pipelines to one sensor, judged piece by piece.

    What is kept of a frame are its time, its groups and its errors.

    Parameters
    ----------
    first : LoadedRecording
        The first piece, or all of it.
    pipelines : mapping of str to Pipeline
        By the name of their calibrations; those of its shape answer.
    clock_ns : callable
        For the time per frame (ns).

    Raises
    ------
    RecordingError
        If no pipeline is of its shape.
    """

    def __init__(
        self,
        first: LoadedRecording,
        pipelines: Mapping[str, Pipeline],
        clock_ns: Callable[[], int] = perf_counter_ns,
    ) -> None:
        self.layout = first.recording.layout
        self._clock_ns = clock_ns
        self._answers = {
            name: _Collected(Follower(pipeline, first.calibrations, first.changes))
            for name, pipeline in pipelines.items()
            if pipeline.layout.shape == self.layout.shape
        }
        if not self._answers:
            shape = self.layout.shape
            msg = f'{first.name} has {shape} taxels and channels, which no calibration is for'
            raise RecordingError(msg)
        self._skeletons: list[Recording] = []
        self._count = 0
        self._latency: list[Array] = [np.zeros(0)]

    def add(self, piece: LoadedRecording) -> None:
        """Judge one more piece."""
        recording, live = piece.recording, piece.contacts
        for one in self._answers.values():
            if math.isnan(one.us_single):
                began = one.follower.began
                one.us_single = single_cost(recording, began, self._clock_ns, PROBED)
            begin = self._clock_ns()
            states = one.follower(piece)
            one.spent_ns += self._clock_ns() - begin
            one.frames += len(piece.seen)
            if live is not None:
                agreement = compare(live.states, live.rows, states, len(recording))
                earlier = one.agreement
                one.agreement = agreement if earlier is None else earlier + agreement
            one.add(as_answered(piece, one.follower.pipeline), states, self._count)
        if live is not None and recording.stamp_ns is not None:
            self._latency.append(np.asarray((live.log_ns - recording.stamp_ns[live.rows]) * 1e-9))
        self._count += len(recording)
        if recording.stream is not None and recording.stamp_ns is not None:
            empty = np.zeros((len(recording), 0, 0))
            keys = recording.truth.keys() & {'session', 'repetition'}
            recording = replace(
                recording, values=empty, temperature_c=None, status=None,
                truth={key: recording.truth[key] for key in keys},
            )  # fmt: skip
        self._skeletons.append(recording)

    def result(self, last: LoadedRecording, source: str = '') -> SensorResult:
        """Results of all pieces, with what is known at the last of them about the whole."""
        whole = _skeleton(self._skeletons)
        groups, times = np.asarray(groups_of(whole)['group'], np.int64), times_of(whole)
        delay = np.concatenate(self._latency)
        apart = clocks_apart(len(delay), int((delay < 0).sum()))
        answers = tuple(one.answer(name, groups, times) for name, one in self._answers.items())
        stamps = whole.stamp_ns
        alone = last.name in ('sensor', source, source.rpartition('.')[0])
        agreements = [one.agreement for one in answers if one.agreement is not None]
        blind = [
            text
            for one, seen in zip(answers, self._answers.values(), strict=True)
            for text in unjudged(
                one.name, {t.name: t.spread.count for t in one.targets}, tuple(seen.given)
            )
        ]
        return SensorResult(
            name=(source if alone else f'{source} {last.name}').strip() or last.name,
            summary='', answers=answers, frames=len(whole),
            dropped=frames_dropped(whole.sequence, whole.restarts),
            chips=self.layout.positions, latency_s=np.zeros(0) if apart else delay,
            agreement=min(agreements, key=lambda one: one.largest, default=None),
            problems=(*last.problems, *dict.fromkeys(blind), *apart),
            source=source, sensor=last.name,
            seconds=float('nan') if stamps is None else float(stamps[-1] - stamps[0]) * 1e-9,
        )  # fmt: skip


def _skeleton(parts: Sequence[Recording]) -> Recording:
    """Times, counters and groups of all pieces of a bag, without readings; a file as it is."""
    if len(parts) == 1:
        return parts[0]
    truth = {
        name: np.concatenate([p.truth.get(name, np.full(len(p), -1)) for p in parts])
        for name in ('session', 'repetition')
        if any(name in part.truth for part in parts)
    }
    columns = {
        name: np.concatenate([np.asarray(getattr(part, name)) for part in parts])
        for name in ('stamp_ns', 'sequence', 'stream', 'values')
    }
    return replace(parts[0], truth=truth, **columns)  # type: ignore[arg-type]


def label_of(pipeline: Pipeline) -> str:
    """Names of the estimators in use."""
    return ', '.join(dict.fromkeys(pipeline.estimators.values())) or 'not calibrated'


def as_answered(piece: LoadedRecording, pipeline: Pipeline) -> Columns:
    """Truth whose labels came as text, numbered as the pipeline numbers its classes."""
    truth, names, classes = piece.recording.truth, piece.label_names, pipeline.label_names
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
    clock_ns: Callable[[], int] = perf_counter_ns,
) -> list[SensorResult]:
    """Judge every sensor of a bag, piece by piece.

    Parameters
    ----------
    path, layout, truth_topics, association
        As of `recording_files.Bag`.
    pipelines : mapping of str to Pipeline
        By name; each judges the sensors of its shape.
    clock_ns : callable
        For the time per frame (ns).

    Raises
    ------
    ClassesChangedError
        If classes came and went in the run: that is repeated in a bag that is held as a whole.
    RecordingError
        If there is no bag, no frame that could be read, or no pipeline for any sensor.
    """
    bag = Bag(path, layout, truth_topics, association)
    evaluations: dict[str, Evaluation] = {}
    last: dict[str, LoadedRecording] = {}
    for space, piece in bag:
        try:
            if space not in evaluations and space not in bag.left_out:
                evaluations[space] = Evaluation(piece, pipelines, clock_ns)
        except RecordingError as err:
            bag.left_out[space] = str(err)
        if space in evaluations:
            evaluations[space].add(piece)
            last[space] = piece
    if not evaluations:
        raise RecordingError('; '.join(bag.left_out.values()))
    results: list[SensorResult] = []
    for space in sorted(evaluations):
        sensor = bag.sensors[space]
        one = evaluations[space].result(sensor.described(last[space]), path.name)
        problems = (*(() if results else bag.problems), *one.problems)
        results.append(replace(one, problems=problems, association=sensor.truth.sentences))
    return results


def evaluate(
    loaded: LoadedRecording,
    pipelines: Mapping[str, Pipeline],
    source: str = '',
    clock_ns: Callable[[], int] = perf_counter_ns,
) -> SensorResult:
    """Judge a recording that is in memory as a whole; parameters as of `evaluate_bag`."""
    evaluation = Evaluation(loaded, pipelines, clock_ns)
    evaluation.add(loaded)
    return evaluation.result(loaded, source)


def open_calibration(path: str | Path) -> Pipeline:
    """Pipeline of whatever sensor the file is of."""
    sensor = str(files.read(Path(path)).get('sensor.scalar', ''))
    return load_sensor(sensor).load(Path(path))


@lru_cache(maxsize=64)
def _opened(path: str, changed_ns: int, thread: int) -> Pipeline:
    """A calibration, read once by a thread (of which a worker may have some) and not shared."""
    return open_calibration(path)


def run_job(job: Job) -> Outcome:
    """Do one job; a failure is an outcome and not raised."""
    try:
        return Outcome(job, tuple(_results(job)))
    except (TactileError, ValueError, OSError) as err:
        return Outcome(job, failure=str(err))
    except Exception as err:  # whatever a recording makes of the evaluation
        return Outcome(job, failure=f'{job.recording}: {type(err).__name__}: {err}')


def _results(job: Job) -> list[SensorResult]:
    stems = [Path(path).stem for path in job.calibrations]
    pipelines = {}
    for path, stem in zip(job.calibrations, stems, strict=True):
        name = stem if stems.count(stem) == 1 else path
        pipelines[name] = _opened(path, Path(path).stat().st_mtime_ns, get_ident())
    first = next(iter(pipelines.values()))
    file = Path(job.recording)
    shipped = load_sensor(first.sensor).recordings()
    if not file.exists() and job.recording in shipped:
        one = LoadedRecording(job.recording, shipped[job.recording])
        return [evaluate(one, pipelines, job.recording)]
    if not file.exists():
        names = ', '.join(shipped) or 'none'
        msg = f'{file} does not exist, and {first.sensor} ships only {names}'
        raise RecordingError(msg)
    if file.suffix not in IN_MEMORY:
        with suppress(ClassesChangedError):
            truth = associate(file, job.truth_topics, job.tolerance_ns, job.delay_ns)
            return evaluate_bag(file, pipelines, job.truth_topics, truth, first.layout)
    loaded = load(file, first.layout, job.truth_topics)
    return [evaluate(one, pipelines, file.name) for one in loaded.recordings]


def run_jobs(
    jobs: Sequence[Job],
    workers: int = 1,
    scheduler: str = '',
    done: Callable[[Outcome], None] = lambda outcome: None,
) -> list[Outcome]:
    """Do many jobs.

    Parameters
    ----------
    jobs : sequence of Job
        Different from one another.
    workers : int
        Processes on this machine.
    scheduler : str
        Address of a running Dask scheduler, whose workers see the same files; empty: none.
    done : callable
        Hears of every outcome as soon as it is there.

    Returns
    -------
    list of Outcome
        In the order of the jobs.
    """
    outcomes: dict[Job, Outcome] = {}

    def heard(outcome: Outcome) -> None:
        outcomes[outcome.job] = outcome
        done(outcome)

    if scheduler:
        _on_dask(jobs, scheduler, heard)
    elif workers > 1 and len(jobs) > 1:
        # where a process died, each job that was lost with it gets its own
        for job in _pool(jobs, min(workers, len(jobs)), heard):
            if _pool([job], 1, heard):
                heard(Outcome(job, failure=f'{job.recording}: the process that read it died'))
    else:
        for job in jobs:
            heard(run_job(job))
    return [outcomes[job] for job in jobs]


def _pool(
    jobs: Sequence[Job],
    workers: int,
    heard: Callable[[Outcome], None],
    work: Callable[[Job], Outcome] = run_job,
) -> list[Job]:
    """Do jobs in a pool of processes; those that no process finished."""
    lost = []
    fresh = multiprocessing.get_context('spawn')
    with ProcessPoolExecutor(workers, mp_context=fresh) as pool:
        waiting = {pool.submit(work, job): job for job in jobs}
        for future in as_completed(waiting):
            try:
                heard(future.result())
            except BrokenProcessPool:
                lost.append(waiting[future])
    return [job for job in jobs if job in lost]


def _on_dask(jobs: Sequence[Job], scheduler: str, heard: Callable[[Outcome], None]) -> None:
    """Do jobs on a cluster: Dask gives those of a lost worker to another, a few times."""
    try:
        import distributed
    except ImportError as err:
        msg = 'a Dask cluster needs distributed: pip install distributed'
        raise MissingPackageError(msg) from err
    try:
        client = distributed.Client(scheduler, timeout=10, set_as_default=False)
    except (OSError, ValueError) as err:
        msg = f'no Dask scheduler answers at {scheduler}: {err}'
        raise RecordingError(msg) from err
    with client:
        waiting = {client.submit(run_job, job, pure=False): job for job in jobs}
        for future in distributed.as_completed(waiting, loop=client.loop):
            try:
                heard(future.result())
            except Exception as err:  # whatever ended it on the cluster
                why = f'{waiting[future].recording}: {type(err).__name__}: {err}'
                heard(Outcome(waiting[future], failure=why))


def pooled(outcomes: Sequence[Outcome]) -> SensorResult | None:
    """All sensors of all outcomes together, by calibration; None for fewer than two."""
    results = [one for outcome in outcomes for one in outcome.results]
    if len(results) < 2:
        return None
    every = [answer for one in results for answer in one.answers]
    answers = [
        _pooled([answer for answer in every if answer.calibration == name])
        for name in dict.fromkeys(answer.calibration for answer in every)
    ]
    return replace(
        results[0], name='all', sensor='all', source='', answers=tuple(answers),
        frames=sum(one.frames for one in results), dropped=sum(one.dropped for one in results),
        seconds=sum(one.seconds for one in results),
        latency_s=np.concatenate([one.latency_s for one in results]),
        agreement=None, problems=(), association={},
    )  # fmt: skip


def _pooled(answers: Sequence[PipelineAnswer]) -> PipelineAnswer:
    """One answer of several: there is no median of medians, so the first that is known stays."""
    targets, hits = [], {}
    for name in TARGETS:
        parts = [target for one in answers if (target := one.target(name))]
        if parts:
            groups = np.repeat(np.arange(len(parts)), [len(part.rows) for part in parts])
            times = np.concatenate([part.time_s for part in parts])
            targets.append(summarised(name, _joined(parts), groups, times))
    for kind in CLASSES:
        counts = [one.hits[kind] for one in answers if kind in one.hits]
        if counts:
            hits[kind] = sum(counts, Counter())
    agreements = [one.agreement for one in answers if one.agreement is not None]
    singles = [one.us_single for one in answers if not math.isnan(one.us_single)]
    frames = sum(one.frames for one in answers)
    spent = [one.us_batch * one.frames for one in answers if one.frames]
    return PipelineAnswer(
        answers[0].name, tuple(targets), next(iter(singles), float('nan')),
        sum(spent) / frames if frames else float('nan'),
        calibration=answers[0].calibration, hits=hits, frames=frames,
        agreement=sum(agreements[1:], agreements[0]) if agreements else None,
        problems=tuple(dict.fromkeys(text for one in answers for text in one.problems)),
    )  # fmt: skip


def for_report(one: SensorResult) -> Dataset:
    """One sensor as a report shows it: what truth can judge first, drawings of some rows.

    Every figure is of all rows; of more than `MOST_DRAWN` drawings show every second, fourth...
    """
    names = Counter(answer.name for answer in one.answers)
    judged = sorted(one.answers, key=lambda a: not any(t.spread.count for t in a.targets))
    largest = max((len(t.rows) for a in judged for t in a.targets), default=0)
    step = 1 << max(0, math.ceil(math.log2(max(largest, 1) / MOST_DRAWN)))
    answers = tuple(
        replace(
            answer,
            name=f'{answer.name}, {answer.calibration}' if names[answer.name] > 1 else answer.name,
            targets=tuple(
                replace(target, **{name: getattr(target, name)[::step] for name in DRAWN})
                for target in answer.targets
            ),
        )
        for answer in judged
    )
    problems = [*one.problems, *(text for answer in one.answers for text in answer.problems)]
    if step > 1:
        problems.append(
            f'{one.frames:,} frames are more than drawings hold: they show every {step}th row '
            'with truth; figures are of all'
        )
    summary = '; '.join(f'{topic}: {how}' for topic, how in one.association.items())
    return replace(
        one, summary=summary, answers=answers, problems=tuple(dict.fromkeys(problems))
    )


def table(outcomes: Sequence[Outcome]) -> tuple[list[str], list[list[Cell]]]:
    """Columns and rows: one row per sensor and calibration, then all together.

    Parameters
    ----------
    outcomes : sequence of Outcome
        Of `run_jobs`.

    Returns
    -------
    columns : list of str
        Units in the names.
    rows : list of list
        Columns that nobody has a value for are left out.
    """
    results = [one for outcome in outcomes for one in outcome.results]
    whole = pooled(outcomes)
    every = results if whole is None else [*results, whole]
    rows = [row_of(one, answer) for one in every for answer in one.answers]
    if len({row[2] for row in rows}) < 2:
        for row in rows:
            row[2] = None
    kept = [i for i in range(len(COLUMNS)) if any(_known(row[i]) for row in rows)]
    return [COLUMNS[i] for i in kept], [[row[i] for i in kept] for row in rows]


def row_of(one: SensorResult, answer: PipelineAnswer) -> list[Cell]:
    """Cells of `COLUMNS`; None: not measured."""
    place, normal = answer.target('position'), answer.target('force_z')
    forces = [t for t in answer.targets if t.name.startswith('force')]
    delay = one.latency
    millimetres: list[Cell] = [None, None, None]
    if place is not None:
        seen = place.spread
        millimetres = [MILLI * seen.mean, MILLI * seen.p50, MILLI * seen.p95]
    return [
        one.name, answer.name, answer.calibration, *millimetres,
        None if normal is None else normal.spread.rms, answer.shear_rms,
        _share([] if place is None else [place]), _share(forces),
        *(_right(answer, name) for name in ('in_contact', 'cell', 'label', 'slip')),
        MILLI * delay.p50 if delay.count else None, MILLI * delay.p99 if delay.count else None,
        one.dropped, one.frames, answer.us_single, answer.us_batch,
    ]  # fmt: skip


def _inside(target: TargetErrors) -> int:
    """Components within one standard deviation of their own."""
    within = target.coverage
    return round(within.share * within.count) if within.count else 0


def _share(targets: Sequence[TargetErrors]) -> float | None:
    """Share of all components inside one sigma (%)."""
    judged = sum(t.coverage.count for t in targets)
    return 100 * sum(map(_inside, targets)) / judged if judged else None


def _right(answer: PipelineAnswer, name: str) -> float | None:
    """Share of right answers (%)."""
    counts = answer.hits.get(name)
    return 100 * counts['right'] / sum(counts.values()) if counts else None


def _known(cell: Cell) -> bool:
    return cell is not None and not (isinstance(cell, float) and math.isnan(cell))


def save(
    path: Path, outcomes: Sequence[Outcome], command: str, environment: Mapping[str, str]
) -> tuple[Path, Path]:
    """Write the result beside one another as `<path>.json` and `<path>.npz`.

    Parameters
    ----------
    path : Path
        Without a suffix.
    outcomes : sequence of Outcome
        Of `run_jobs`.
    command : str
        That repeats it.
    environment : mapping
        Of `benchmark.environment`.

    Returns
    -------
    tuple of Path
        Both files. The npz holds the histograms of all errors, `<i>/<j>/<target>` for recording i
        and answer j as the json lists them, and the edges of their bins.
    """
    whole = pooled(outcomes)
    results = [one for outcome in outcomes for one in outcome.results]
    document = {
        'schema': SCHEMA,
        'command': command,
        'environment': dict(environment),
        'recordings': [_sensor_json(one) for one in results],
        'all': None if whole is None else _sensor_json(whole),
        'failed': {o.job.recording: o.failure for o in outcomes if o.failure},
    }
    arrays: dict[str, npt.NDArray[np.generic]] = {
        'schema': np.array(SCHEMA), 'bin_edges': BIN_EDGES
    }  # fmt: skip
    for i, one in enumerate(results):
        for j, answer in enumerate(one.answers):
            for target in answer.targets:
                size = target.size[np.isfinite(target.size)]
                bins = np.searchsorted(BIN_EDGES, size, side='right')
                arrays[f'{i}/{j}/{target.name}'] = np.bincount(bins, minlength=len(BIN_EDGES) + 1)
    text = json.dumps(document, indent=1, allow_nan=False) + '\n'
    return (
        write_beside(path.with_name(f'{path.name}.json'), text.encode()),
        save_arrays(arrays, path.with_name(f'{path.name}.npz')),
    )


def _sensor_json(one: SensorResult) -> dict[str, object]:
    """A sensor as json has it."""
    return {
        'recording': one.source,
        'sensor': one.sensor,
        'frames': one.frames,
        'dropped': one.dropped,
        'seconds': _number(one.seconds),
        'latency': _spread_json(one.latency, 's'),
        'truth': dict(one.association),
        'problems': list(one.problems),
        'answers': [_answer_json(answer) for answer in one.answers],
    }


def _answer_json(answer: PipelineAnswer) -> dict[str, object]:
    agreement = answer.agreement
    return {
        'estimator': answer.name,
        'calibration': answer.calibration,
        'us_single': _number(answer.us_single),
        'us_batch': _number(answer.us_batch),
        'difference_to_live': None if agreement is None else _number(agreement.largest),
        'frames_without_contacts': None if agreement is None else agreement.without_contacts,
        'problems': list(answer.problems),
        'targets': {
            target.name: {
                **_spread_json(target.spread, target.unit),
                'inside_one_sigma': _inside(target),
                'judged': target.coverage.count,
                'missed': target.missed,
                'invalid': target.invalid,
            }
            for target in answer.targets
        },
        'classes': {name: dict(counts) for name, counts in answer.hits.items()},
    }


def _spread_json(errors: Spread, unit: str) -> dict[str, object]:
    """Summary, and the sums that can be added up."""
    names = ('mean', 'rms', 'p50', 'p95', 'p99', 'largest')
    return {
        'unit': unit,
        'count': errors.count,
        **{name: _number(getattr(errors, name)) for name in names},
        'sum': errors.mean * errors.count if errors.count else 0.0,
        'sum_of_squares': errors.rms**2 * errors.count if errors.count else 0.0,
    }


def _number(value: float) -> float | None:
    """A number as json has it."""
    return float(value) if math.isfinite(value) else None
