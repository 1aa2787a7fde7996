"""Many recordings judged by many pipelines: in turn, in processes, or on a Dask cluster.

A recording is one job. What a job finds does not depend on where it runs, and results are put in
the order of the jobs, so that one process, several and a cluster give the same numbers. A job that
fails, or whose process dies, is an outcome like any other.
"""

from __future__ import annotations

import json
import math
import multiprocessing
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from threading import get_ident
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros import calibration as files
from tactile_ros.calibration import write_beside
from tactile_ros.errors import MissingPackageError, RecordingError, TactileError
from tactile_ros.evaluation.recording_files import LoadedRecording, load, save_arrays
from tactile_ros.evaluation.sensor_pieces import ClassesChangedError
from tactile_ros.evaluation.sensor_tally import SensorTally, tally_bag, tally_recording
from tactile_ros.evaluation.survey import survey
from tactile_ros.evaluation.tally import BINS, LEAST, RATIO
from tactile_ros.evaluation.truth import DEFAULT_TRUTH, Association
from tactile_ros.sensors import load_sensor

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    import numpy.typing as npt

    from tactile_ros.evaluation.answer_tally import AnswerTally
    from tactile_ros.evaluation.metrics import Spread
    from tactile_ros.evaluation.sensor_tally import SensorTally
    from tactile_ros.evaluation.tally import Magnitudes, TargetTally
    from tactile_ros.pipeline import Pipeline

IN_MEMORY = ('.npz', '.csv')


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
        As of `recording.load`.
    tolerance_ns : int or None
        As of `Association`.
    delay_ns : int or None
        By how much truth on topics of its own is late (ns); None: estimated.
    drawn : bool
        Keep the rows that a report draws.
    """

    recording: str
    calibrations: tuple[str, ...]
    truth_topics: tuple[str, ...] = DEFAULT_TRUTH
    tolerance_ns: int | None = None
    delay_ns: int | None = None
    drawn: bool = False


@dataclass(frozen=True)
class Outcome:
    """What one job came to: tallies by sensor, or why there are none."""

    job: Job
    tallies: tuple[SensorTally, ...] = ()
    failure: str = ''


def open_calibration(path: str | Path) -> Pipeline:
    """Pipeline of whatever sensor the file is of."""
    sensor = str(files.read(Path(path)).get('sensor.scalar', ''))
    return load_sensor(sensor).load(Path(path))


@lru_cache(maxsize=64)
def _opened(path: str, changed_ns: int, thread: int) -> Pipeline:
    """A calibration, read once by a thread (of which a worker may have some) and not shared."""
    return open_calibration(path)


def tally(job: Job) -> Outcome:
    """Do one job; a failure is told, not raised."""
    try:
        return Outcome(job, tuple(_tallies(job)))
    except (TactileError, ValueError, OSError) as err:
        return Outcome(job, failure=str(err))
    except Exception as err:
        return Outcome(job, failure=f'{job.recording}: {type(err).__name__}: {err}')


def _tallies(job: Job) -> list[SensorTally]:
    stems = [Path(path).stem for path in job.calibrations]
    pipelines = {}
    for path, stem in zip(job.calibrations, stems, strict=True):
        name = stem if stems.count(stem) == 1 else path
        pipelines[name] = _opened(path, Path(path).stat().st_mtime_ns, get_ident())
    first = next(iter(pipelines.values()))
    file = Path(job.recording)
    shipped = load_sensor(first.sensor).recordings()
    if not file.exists() and job.recording in shipped:
        loaded = LoadedRecording(job.recording, shipped[job.recording])
        return [tally_recording(loaded, pipelines, job.recording, drawn=job.drawn)]
    if not file.exists():
        names = ', '.join(shipped) or 'none'
        msg = f'{file} does not exist, and {first.sensor} ships only {names}'
        raise RecordingError(msg)
    if file.suffix not in IN_MEMORY:
        with suppress(ClassesChangedError):
            truth = associated(file, job)
            return tally_bag(
                file, pipelines, job.truth_topics, truth, first.layout, drawn=job.drawn
            )
    found = load(file, first.layout, job.truth_topics)
    return [
        tally_recording(one, pipelines, file.name, drawn=job.drawn) for one in found.recordings
    ]


def associated(path: Path, job: Job) -> Association:
    """How truth goes with frames: as the job says, with delays that the signals tell."""
    found = survey(path, job.truth_topics)
    delays, known = {}, {}
    for topic, delay in found.items():
        if job.delay_ns is not None:
            delays[topic], known[topic] = job.delay_ns, ' as was said'
        elif delay is None:
            known[topic] = ' (assumed: the signals do not tell)'
        else:
            delays[topic] = round(delay.delay_ns) if delay.told else 0
            known[topic] = (
                f' (estimated: {delay.delay_ns * 1e-6:.3g} +- {delay.std_ns * 1e-6:.2g} ms from '
                f'{delay.stretches} stretches, correlation {delay.correlation:.2f})'
            )
    return Association(job.tolerance_ns, delays, known)


def tally_all(
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
    found: dict[Job, Outcome] = {}

    def heard(outcome: Outcome) -> None:
        found[outcome.job] = outcome
        done(outcome)

    if scheduler:
        _on_dask(jobs, scheduler, heard)
    elif workers > 1 and len(jobs) > 1:
        _in_processes(jobs, min(workers, len(jobs)), heard)
    else:
        for job in jobs:
            heard(tally(job))
    return [found[job] for job in jobs]


def _in_processes(jobs: Sequence[Job], workers: int, heard: Callable[[Outcome], None]) -> None:
    """Do jobs in a pool; where a process died, each job that was lost with it gets its own."""
    for job in _pool(jobs, workers, heard):
        if _pool([job], 1, heard):
            heard(Outcome(job, failure=f'{job.recording}: the process that read it died'))


def _pool(
    jobs: Sequence[Job],
    workers: int,
    heard: Callable[[Outcome], None],
    work: Callable[[Job], Outcome] = tally,
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
        waiting = {client.submit(tally, job, pure=False): job for job in jobs}
        for future in distributed.as_completed(waiting, loop=client.loop):
            try:
                heard(future.result())
            except Exception as err:
                why = f'{waiting[future].recording}: {type(err).__name__}: {err}'
                heard(Outcome(waiting[future], failure=why))


def merged(outcomes: Sequence[Outcome]) -> SensorTally | None:
    """All sensors of all outcomes together, by calibration; None for fewer than two."""
    tallies = [one for outcome in outcomes for one in outcome.tallies]
    if len(tallies) < 2:
        return None
    answers: dict[str, AnswerTally] = {}
    for answer in (a for one in tallies for a in one.answers):
        name = answer.calibration
        answers[name] = answers[name] + answer if name in answers else answer
    whole = tallies[0].latency
    for one in tallies[1:]:
        whole = whole + one.latency
    return SensorTally(
        'all', '', tuple(answers.values()), sum(one.frames for one in tallies),
        sum(one.dropped for one in tallies), sum(one.seconds for one in tallies), whole,
    )  # fmt: skip


Cell = str | float | int | None
COLUMNS = (
    'recording', 'estimator', 'calibration', 'place mean (mm)', 'p50', 'p95', 'normal RMSE (N)',
    'shear RMSE (N)', 'place in 1 sigma (%)', 'force in 1 sigma (%)', 'contact right (%)',
    'cell right (%)', 'label right (%)', 'slip right (%)', 'latency p50 (ms)', 'p99 (ms)',
    'dropped', 'frames', 'us/frame', 'us/frame batch',
)  # fmt: skip
SCHEMA = 1


def table(outcomes: Sequence[Outcome]) -> tuple[list[str], list[list[Cell]]]:
    """Columns and rows: one row per sensor and calibration, then all together.

    Parameters
    ----------
    outcomes : sequence of Outcome
        Of `tally_all`.

    Returns
    -------
    columns : list of str
        Units in the names.
    rows : list of list
        Columns that nobody has a value for are left out.
    """
    tallies = [one for outcome in outcomes for one in outcome.tallies]
    whole = merged(outcomes)
    every = tallies if whole is None else [*tallies, whole]
    rows = [row_of(one, answer) for one in every for answer in one.answers]
    if len({row[2] for row in rows}) < 2:
        for row in rows:
            row[2] = None
    kept = [i for i in range(len(COLUMNS)) if any(_known(row[i]) for row in rows)]
    return [COLUMNS[i] for i in kept], [[row[i] for i in kept] for row in rows]


def row_of(one: SensorTally, answer: AnswerTally) -> list[Cell]:
    """Cells of `COLUMNS`; None: not measured."""
    place, normal = answer.targets.get('position'), answer.targets.get('force_z')
    seen = None if place is None else place.errors.spread
    forces = [t for name, t in answer.targets.items() if name.startswith('force')]
    delay = one.latency.spread
    shear = answer.shear
    return [
        one.title,
        answer.name,
        answer.calibration,
        *((None, None, None) if seen is None else [1e3 * x for x in _place(seen)]),
        None if normal is None else normal.errors.spread.rms,
        shear.spread.rms if shear.count else None,
        _share([] if place is None else [place]),
        _share(forces),
        *(_right(answer, name) for name in ('in_contact', 'cell', 'label', 'slip')),
        1e3 * delay.p50 if delay.count else None,
        1e3 * delay.p99 if delay.count else None,
        one.dropped,
        one.frames,
        answer.us_single,
        answer.us_batch,
    ]


def _place(seen: Spread) -> tuple[float, float, float]:
    return seen.mean, seen.p50, seen.p95


def _share(targets: Sequence[TargetTally]) -> float | None:
    """Share of all components inside one sigma (%)."""
    judged = sum(t.judged for t in targets)
    inside = sum(t.inside for t in targets)
    return 100 * inside / judged if judged else None


def _right(answer: AnswerTally, name: str) -> float | None:
    """Share of right answers (%)."""
    return 100 * answer.classes[name].share if name in answer.classes else None


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
        Of `tally_all`.
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
    whole = merged(outcomes)
    tallies = [one for outcome in outcomes for one in outcome.tallies]
    document = {
        'schema': SCHEMA,
        'command': command,
        'environment': dict(environment),
        'quantiles': 'from bins of 1 %: to within half a per cent; sums are exact',
        'recordings': [_sensor(one) for one in tallies],
        'all': None if whole is None else _sensor(whole),
        'failed': {o.job.recording: o.failure for o in outcomes if o.failure},
    }
    arrays: dict[str, npt.NDArray[np.generic]] = {
        'schema': np.array(SCHEMA), 'bin_edges': LEAST * RATIO ** np.arange(BINS + 1)
    }  # fmt: skip
    for i, one in enumerate(tallies):
        for j, answer in enumerate(one.answers):
            for name, target in answer.targets.items():
                arrays[f'{i}/{j}/{name}'] = target.errors.bins
    text = json.dumps(document, indent=1, allow_nan=False) + '\n'
    return (
        write_beside(path.with_name(f'{path.name}.json'), text.encode()),
        save_arrays(arrays, path.with_name(f'{path.name}.npz')),
    )


def _sensor(one: SensorTally) -> dict[str, object]:
    """A sensor as json has it."""
    return {
        'recording': one.source,
        'sensor': one.name,
        'frames': one.frames,
        'dropped': one.dropped,
        'seconds': _number(one.seconds),
        'latency': _magnitudes(one.latency, 's'),
        'truth': dict(one.association),
        'problems': list(one.problems),
        'answers': [_answer(answer) for answer in one.answers],
    }


def _answer(answer: AnswerTally) -> dict[str, object]:
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
            name: {
                **_magnitudes(target.errors, target.unit),
                'inside_one_sigma': target.inside,
                'judged': target.judged,
                'missed': target.missed,
                'invalid': target.invalid,
            }
            for name, target in answer.targets.items()
        },
        'classes': {
            name: {'right': c.right, 'wrong': c.wrong, 'abstained': c.abstained}
            for name, c in answer.classes.items()
        },
    }


def _magnitudes(found: Magnitudes, unit: str) -> dict[str, object]:
    """Summary, and the exact sums (2**-1200 of the unit, hexadecimal) that can be added up."""
    seen = found.spread
    return {
        'unit': unit,
        'count': found.count,
        **{n: _number(getattr(seen, n)) for n in ('mean', 'rms', 'p50', 'p95', 'p99', 'largest')},
        'sum': hex(found.total),
        'sum_of_squares': hex(found.squares),
    }


def _number(value: float) -> float | None:
    """A number as json has it."""
    return float(value) if math.isfinite(value) else None
