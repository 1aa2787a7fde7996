# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""What a bench prints and writes: figures beside the paper's, a peer's, the bound and the aim."""

from __future__ import annotations

import base64
import json
import math
import re
import time
from dataclasses import asdict, dataclass, field, fields, replace
from html import unescape
from typing import TYPE_CHECKING, Literal, TypedDict, TypeVar, cast

import numpy as np

from tactile_ros.calibration import write_atomically
from tactile_ros.errors import TactileError
from tactile_ros.evaluation.report import environment

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator
    from pathlib import Path

T = TypeVar('T')
COLUMNS = (
    'what', 'unit', 'paper', 'peer', 'ours', 'bound', 'aim', 'held', 'us_single', 'us_batch',
)  # fmt: skip


@dataclass(frozen=True)
class Row:
    """One figure of a bench.

    Attributes
    ----------
    what, unit : str
        What was measured, and in which unit.
    ours : float or None
        The figure of this run.
    better : str
        'low' or 'high'.
    paper, peer, bound, aim : float or None
        Published; of another method in the same run; what no method can beat; what is aimed at.
    us_single, us_batch : float or None
        Time per frame, one at a time and in a batch (microseconds).
    by_seed : tuple of float
        Values of `ours` by seed, world, held-out run, place or block of seeds, where there are
        several.
    compared, method : str
        Rows with the same `compared` are methods, so named, on the same data: a report draws
        their errors against their times.
    """

    what: str
    unit: str
    ours: float | None
    better: Literal['low', 'high'] = 'low'
    paper: float | None = None
    peer: float | None = None
    bound: float | None = None
    aim: float | None = None
    us_single: float | None = None
    us_batch: float | None = None
    by_seed: tuple[float, ...] = ()
    compared: str = ''
    method: str = ''

    @property
    def spread(self) -> float | None:
        """Standard deviation of `ours` over the seeds; None of a single one."""
        return float(np.std(self.by_seed, ddof=1)) if len(self.by_seed) > 1 else None

    @property
    def held(self) -> bool | None:
        """Whether the aim is held; None where there is none or nothing was measured."""
        return self.reaches(self.aim)

    def reaches(self, other: float | None) -> bool | None:
        """Whether `ours` is at least as good as another figure; None without one of them."""
        if other is None or self.ours is None:
            return None
        return self.ours <= other if self.better == 'low' else self.ours >= other

    def cells(self) -> tuple[str | float | None, ...]:
        """Cells of the printed table, in the order of `COLUMNS`."""
        held = {None: '', True: 'held', False: 'MISSED'}[self.held]
        return (
            self.what, self.unit, self.paper, self.peer, self.ours, self.bound, self.aim, held,
            self.us_single, self.us_batch,
        )  # fmt: skip


@dataclass(frozen=True)
class BenchResult:
    """All figures of one bench.

    Attributes
    ----------
    bench, command : str
        Name, and the command that repeats it.
    seed : list of int
        Seeds that were run.
    rows : list of Row
        Figures.
    notes : list of str
        What a reader must know to trust the figures.
    drawings : dict of str to str
        SVG of plots by name, for `--figures`; see `evaluation.drawing`.
    """

    bench: str
    command: str
    seed: list[int]
    rows: list[Row]
    notes: list[str] = field(default_factory=list)
    drawings: dict[str, str] = field(default_factory=dict)

    def draw(self, folder: Path) -> list[Path]:
        """Write every drawing as `<bench>_<name>.svg` into `folder`; return their paths."""
        return [
            write_atomically(folder / f'{self.bench}_{name}.svg', drawing.encode())
            for name, drawing in self.drawings.items()
        ]

    def write(self, folder: Path) -> Path:
        """Write `<bench>.json` into `folder`, NaN as null; return its path."""
        document = {
            'bench': self.bench,
            'environment': environment(),
            'seed': self.seed,
            'command': self.command,
            'rows': [
                {k: _plain(v) for k, v in {**asdict(row), 'spread': row.spread}.items()}
                for row in self.rows
            ],
            'notes': self.notes,
        }
        text = json.dumps(document, indent=1, allow_nan=False) + '\n'
        return write_atomically(folder / f'{self.bench}.json', text.encode())


def within(
    seconds: float, ones: Iterable[T], clock: Callable[[], float] = time.monotonic
) -> Iterator[T]:
    """Seeds, worlds or tasks one after another, as many as fit.

    Parameters
    ----------
    seconds : float
        Time for all of them; infinite where none shall be left out.
    ones : iterable
        What the caller works on before it asks for the next.
    clock : callable
        Seconds of a steady clock.

    Yields
    ------
    object
        The first in any case; another only if it would end in time, should it take as long as the
        mean of those before.
    """
    began = clock()
    for done, one in enumerate(ones):
        if done and (clock() - began) * (done + 1) / done > seconds:
            return
        yield one


def shortest(work: Callable[[], object], repetitions: int = 10) -> float:
    """Shortest of several durations of some work (s)."""
    times = []
    for _ in range(repetitions):
        began = time.perf_counter()
        work()
        times.append(time.perf_counter() - began)
    return min(times)


def _plain(value: object) -> object:
    """A value as json has it: numbers of numpy as numbers, what is not finite as null."""
    if isinstance(value, (float, np.floating)):
        return float(value) if np.isfinite(value) else None
    if isinstance(value, tuple):
        return [_plain(one) for one in value]
    return value.item() if isinstance(value, np.generic) else value


MILLI = 1e3


class TargetJson(TypedDict):
    """Errors of one target."""

    unit: str
    mean: float | None
    rms: float | None


class AnswerJson(TypedDict):
    """One calibration on one recording."""

    estimator: str
    calibration: str
    us_single: float | None
    us_batch: float | None
    targets: dict[str, TargetJson]


class RecordingJson(TypedDict):
    """One recording and all that was answered to it."""

    recording: str
    sensor: str
    answers: list[AnswerJson]


class ReplayJson(TypedDict):
    """What `tactile replay` saves."""

    command: str
    recordings: list[RecordingJson]
    failed: dict[str, str]


def replay_result(told: ReplayJson, name: str) -> BenchResult:
    """Every error of a replay, calibrations of one recording as methods on the same data.

    Parameters
    ----------
    told : dict
        Document of a saved replay.
    name : str
        Of its file.

    Returns
    -------
    BenchResult
        Mean error of places (mm), root mean square of all else; recordings that could not be read
        are its notes.

    Raises
    ------
    KeyError, TypeError, AttributeError
        If it is no such document.
    """
    rows = [row for recording in told['recordings'] for row in _rows(recording)]
    notes = [f'left out: {sentence}' for sentence in told['failed'].values()]
    return BenchResult(f'replay {name}', told['command'], [], rows, notes)


def _rows(recording: RecordingJson) -> Iterator[Row]:
    """Figures of one recording."""
    answers = recording['answers']
    names = [answer['estimator'] for answer in answers]
    for answer in answers:
        method = answer['estimator']
        if names.count(method) > 1:
            method = f'{method}, {answer["calibration"]}'
        for target, found in answer['targets'].items():
            place = found['unit'] == 'm'
            error = found['mean'] if place else found['rms']
            what = f'{recording["recording"] or recording["sensor"]}: {target.replace("_", " ")}'
            yield Row(
                f'{what}, {method}', 'mm' if place else found['unit'],
                MILLI * error if place and error is not None else error,
                us_single=answer['us_single'], us_batch=answer['us_batch'],
                compared=what, method=method,
            )  # fmt: skip


MOST_BYTES = 20_000_000
Kind = TypeVar('Kind')
WORDS = ('what', 'unit', 'compared', 'method')
NUMBERS = tuple(f.name for f in fields(Row) if f.name not in (*WORDS, 'better', 'by_seed'))
TOLD = re.compile(r'aria-label="([^"]*)"')
SIZE = re.compile(r'viewBox="0 0 ([\d.]+) ([\d.]+)"')


@dataclass(frozen=True)
class Picture:
    """A drawing that a bench wrote.

    Attributes
    ----------
    name, description : str
        Of the file; what it shows.
    svg : bytes
        Of the file.
    size : tuple of float
        Width and height (pixels).
    """

    name: str
    description: str
    svg: bytes
    size: tuple[float, float]

    @property
    def base64(self) -> str:
        """The drawing for the source of an image: nothing in it can run or fetch."""
        return base64.b64encode(self.svg).decode()


@dataclass(frozen=True)
class BenchFile:
    """What one bench found, where, and its drawings."""

    result: BenchResult
    environment: dict[str, str]
    pictures: tuple[Picture, ...]


def gather(paths: Iterable[Path]) -> tuple[list[BenchFile], list[str]]:
    """Read every json under folders, or files by name.

    Parameters
    ----------
    paths : iterable of path
        Folders of results, or single files.

    Returns
    -------
    found : list of BenchFile
        In the order of their names.
    problems : list of str
        A sentence for every file that is not a bench's, or is damaged.
    """
    found, problems = [], []
    for path in paths:
        if not path.exists():
            problems.append(f'{path} does not exist')
            continue
        files = sorted(path.glob('*.json')) if path.is_dir() else [path]
        if not files:
            problems.append(f'{path} holds no result of a bench')
        for file in files:
            try:
                found.append(read_bench(file))
            except TactileError as error:
                problems.append(str(error))
    return found, problems


def read_bench(path: Path) -> BenchFile:
    """Read one result and the drawings beside it.

    Raises
    ------
    TactileError
        If it is no result of a bench, is damaged or larger than any result.
    """
    try:
        told = json.loads(_read(path))
        if isinstance(told, dict) and 'recordings' in told:
            result = checked(replay_result(cast('ReplayJson', told), path.stem))
        else:
            result = _bench(told)
        environment = {str(k): str(v) for k, v in _entry(told, 'environment', dict).items()}
    except (ValueError, TypeError, LookupError, AttributeError, RecursionError) as error:
        msg = f'{path} is no result of a bench or replay: {str(error).splitlines()[0]}'
        raise TactileError(msg) from error
    return BenchFile(result, environment, pictures(path.parent, result.bench))


def _bench(told: object) -> BenchResult:
    """Result of a bench from its document."""
    notes = told.get('notes', []) if isinstance(told, dict) else []
    return BenchResult(
        rows=[_row(row) for row in _entry(told, 'rows', list)],
        bench=_entry(told, 'bench', str),
        command=_entry(told, 'command', str),
        seed=[int(seed) for seed in _entry(told, 'seed', list)],
        notes=[str(note) for note in notes],
    )


def checked(result: BenchResult) -> BenchResult:
    """The same, if all of its words and numbers are such."""
    rows = [_row(asdict(row)) for row in result.rows]
    return replace(result, command=str(result.command), rows=rows)


def _read(path: Path) -> bytes:
    """The bytes of a file that is not too large to be a result."""
    try:
        if path.stat().st_size <= MOST_BYTES:
            return path.read_bytes()
    except OSError as error:
        msg = f'{path} cannot be read: {error.strerror}'
        raise TactileError(msg) from error
    msg = f'{path} must have at most {MOST_BYTES} bytes; it has {path.stat().st_size}'
    raise TactileError(msg)


def _entry(told: object, name: str, kind: type[Kind]) -> Kind:
    """An entry of the document, of the right kind."""
    found = told.get(name) if isinstance(told, dict) else None
    if not isinstance(found, kind):
        msg = f'{name} must be {kind.__name__}; received {type(found).__name__}'
        raise TypeError(msg)
    return found


def _row(told: object) -> Row:
    """One figure; keys that are not known here are left out."""
    better: Literal['low', 'high'] = 'high' if _entry(told, 'better', str) == 'high' else 'low'
    assert isinstance(told, dict)
    words = {name: str(told.get(name, '')) for name in WORDS}
    number = {name: _number(name, told.get(name)) for name in NUMBERS}
    return Row(
        words['what'], words['unit'], number['ours'], better, number['paper'], number['peer'],
        number['bound'], number['aim'], number['us_single'], number['us_batch'],
        _by_seed(told.get('by_seed')), words['compared'], words['method'],
    )  # fmt: skip


def _by_seed(told: object) -> tuple[float, ...]:
    """Values of a figure by seed; seeds without one are left out."""
    if told is None:
        return ()
    if not isinstance(told, (list, tuple)):
        msg = f'by_seed must be a list; received {type(told).__name__}'
        raise TypeError(msg)
    found = [_number('by_seed', value) for value in told]
    return tuple(value for value in found if value is not None)


def _number(name: str, told: object) -> float | None:
    """A number or nothing."""
    if told is None:
        return None
    if isinstance(told, bool) or not isinstance(told, (int, float)) or not math.isfinite(told):
        msg = f'{name} must be a number or null; received {told!r}'
        raise TypeError(msg)
    return float(told)


def pictures(folder: Path, bench: str) -> tuple[Picture, ...]:
    """Drawings of a bench in a folder; what they show is read from themselves."""
    found = []
    for path in sorted(folder.glob('*.svg')):
        if not path.stem.startswith(f'{bench}_') or path.stat().st_size > MOST_BYTES:
            continue
        svg = path.read_bytes()
        head = svg[:2000].decode(errors='replace')
        told, size = TOLD.search(head), SIZE.search(head)
        name = path.stem[len(bench) + 1 :].replace('_', ' ')
        wide, high = (float(size[1]), float(size[2])) if size else (480.0, 320.0)
        found.append(Picture(name, unescape(told[1]) if told else '', svg, (wide, high)))
    return tuple(found)
