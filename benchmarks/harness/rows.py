# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Rows that benches print and write, read back with drawings beside them; times of work."""

from __future__ import annotations

import base64
import json
import math
import re
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass, field
from html import unescape
from pathlib import Path
from typing import Literal, TypeVar

import numpy as np

from tactile_ros.calibration import write_atomically
from tactile_ros.errors import TactileError
from tactile_ros.evaluation.report import environment
from tactile_ros.pipeline import Pipeline
from tactile_ros.types import Array, Recording

T = TypeVar('T')
COLUMNS = (
    'what', 'unit', 'paper', 'peer', 'ours', 'bound', 'aim', 'held', 'us_single', 'us_batch',
)  # fmt: skip
MOST_BYTES = 20_000_000
WORDS = ('what', 'unit', 'compared', 'method')
NUMBERS = ('ours', 'paper', 'peer', 'bound', 'aim', 'us_single', 'us_batch')
LABEL = re.compile(r'aria-label="([^"]*)"')
SIZE = re.compile(r'viewBox="0 0 ([\d.]+) ([\d.]+)"')


@dataclass(frozen=True)
class Row:
    """One figure: ours beside the paper's, a peer's, what no method can beat, and the aim.

    Times are microseconds of a frame alone and of one of a batch. `by_seed` are values of `ours`
    by seed, world, held-out run, place or block of seeds. Rows with the same `compared` are
    methods, so named, on the same data: a report draws their errors against their times.
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

    @classmethod
    def mean(
        cls, what: str, unit: str, by_seed: Sequence[float],
        better: Literal['low', 'high'] = 'low', **more: object,
    ) -> Row:  # fmt: skip
        """Mean over seeds."""
        return cls(what, unit, float(np.mean(by_seed)), better, by_seed=tuple(by_seed), **more)

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
        cells = {**asdict(self), 'held': {None: '', True: 'held', False: 'MISSED'}[self.held]}
        return tuple(cells[name] for name in COLUMNS)


@dataclass(frozen=True)
class BenchResult:
    """All figures of a bench, seeds, notes that a reader needs, and drawings (SVG) by name."""

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
        rows = [{**asdict(row), 'spread': row.spread} for row in self.rows]
        document = {
            'bench': self.bench, 'environment': environment(), 'seed': self.seed,
            'command': self.command, 'notes': self.notes,
            'rows': [{key: _plain(value) for key, value in row.items()} for row in rows],
        }  # fmt: skip
        text = json.dumps(document, indent=1, allow_nan=False) + '\n'
        return write_atomically(folder / f'{self.bench}.json', text.encode())


def _plain(value: object) -> object:
    """A value as json has it: numbers of numpy as numbers, what is not finite as null."""
    if isinstance(value, (float, np.floating)):
        return float(value) if np.isfinite(value) else None
    if isinstance(value, tuple):
        return [_plain(one) for one in value]
    return value.item() if isinstance(value, np.generic) else value


def within(
    seconds: float, ones: Iterable[T], clock: Callable[[], float] = time.monotonic
) -> Iterator[T]:
    """Seeds, worlds or tasks that the caller works on, as many as fit into some seconds.

    Yields the first in any case; another only if it would end in time, should it take as long as
    the mean of those before.
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


def frame_us(
    pipeline: Pipeline, test: Recording, rows: Iterable[int], repetitions: int = 10
) -> tuple[float, float]:
    """Microseconds of a frame: some rows one at a time, and the whole recording as a batch."""
    frames = [test.frame(row) for row in rows]
    single = shortest(lambda: [pipeline.process(frame) for frame in frames], repetitions)
    batch = shortest(lambda: pipeline.process_batch(test), repetitions)
    return 1e6 * single / len(frames), 1e6 * batch / len(test)


def inside(error: Array, sigma: Array, sigmas: float = 1.0) -> list[float]:
    """Per cent of finite errors (s,) inside some sigmas: of all, of thirds by the sigma (s,)."""
    finite = np.isfinite(error)
    error, sigma = error[finite], sigma[finite]
    order = np.argsort(sigma, kind='stable')
    right = np.abs(error) < sigmas * sigma
    return [100 * float(right[rows].mean()) for rows in (order, *np.array_split(order, 3))]


@dataclass(frozen=True)
class Picture:
    """A drawing that a bench wrote: name, what it shows, SVG, width and height (pixels)."""

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
    """Read files of results, or all in folders; a sentence for every one that is none."""
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
    """Read a result of a bench, or a saved replay, and the drawings beside it.

    Raises TactileError if it is neither, is damaged or larger than any result.
    """
    try:
        source = json.loads(_read(path))
        if isinstance(source, dict) and 'recordings' in source:
            source = _replayed(source, path.stem)
        result = BenchResult(
            rows=[_row(row) for row in _entry(source, 'rows', list)],
            bench=_entry(source, 'bench', str),
            command=_entry(source, 'command', str),
            seed=[int(seed) for seed in _entry(source, 'seed', list)],
            notes=[str(note) for note in _entry(source, 'notes', list, [])],
        )
        around = {str(k): str(v) for k, v in _entry(source, 'environment', dict).items()}
    except (ValueError, TypeError, LookupError, AttributeError, RecursionError) as error:
        msg = f'{path} is no result of a bench or replay: {str(error).splitlines()[0]}'
        raise TactileError(msg) from error
    return BenchFile(result, around, pictures(path.parent, result.bench))


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


def _replayed(source: dict[str, object], name: str) -> dict[str, object]:
    """A saved replay as a bench: mean error of places (mm), root mean square of all else."""
    rows = []
    for recording in source['recordings']:
        names = [answer['estimator'] for answer in recording['answers']]
        for answer in recording['answers']:
            method = answer['estimator']
            if names.count(method) > 1:
                method = f'{method}, {answer["calibration"]}'
            for target, found in answer['targets'].items():
                place = found['unit'] == 'm'
                error = found['mean' if place else 'rms']
                shown = recording['recording'] or recording['sensor']
                what = f'{shown}: {target.replace("_", " ")}'
                rows.append({
                    'what': f'{what}, {method}', 'unit': 'mm' if place else found['unit'],
                    'ours': 1e3 * error if place and error is not None else error,
                    'better': 'low', 'us_single': answer['us_single'],
                    'us_batch': answer['us_batch'], 'compared': what, 'method': method,
                })  # fmt: skip
    notes = [f'left out: {sentence}' for sentence in source['failed'].values()]
    return {
        **source, 'bench': f'replay {name}', 'seed': [], 'rows': rows, 'notes': notes,
    }  # fmt: skip


def _entry(source: object, name: str, kind: type[T], default: T | None = None) -> T:
    """An entry of the document, of the right kind."""
    found = source.get(name) if isinstance(source, dict) else None
    found = default if found is None else found
    if not isinstance(found, kind):
        msg = f'{name} must be {kind.__name__}; received {type(found).__name__}'
        raise TypeError(msg)
    return found


def _row(source: object) -> Row:
    """One figure; keys that are not known here are left out."""
    better = 'high' if _entry(source, 'better', str) == 'high' else 'low'
    words = {name: str(source.get(name, '')) for name in WORDS}
    numbers = {name: _number(name, source.get(name)) for name in NUMBERS}
    seeds = [_number('by_seed', one) for one in _entry(source, 'by_seed', list, [])]
    kept = tuple(one for one in seeds if one is not None)
    return Row(**words, **numbers, better=better, by_seed=kept)


def _number(name: str, value: object) -> float | None:
    """A number or nothing."""
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        msg = f'{name} must be a number or null; received {value!r}'
        raise TypeError(msg)
    return float(value)


def pictures(folder: Path, bench: str) -> tuple[Picture, ...]:
    """Drawings of a bench in a folder; what they show is read from themselves."""
    found = []
    for path in sorted(folder.glob('*.svg')):
        if not path.stem.startswith(f'{bench}_') or path.stat().st_size > MOST_BYTES:
            continue
        svg = path.read_bytes()
        head = svg[:2000].decode(errors='replace')
        label, size = LABEL.search(head), SIZE.search(head)
        name = path.stem[len(bench) + 1 :].replace('_', ' ')
        wide, high = (float(size[1]), float(size[2])) if size else (480.0, 320.0)
        found.append(Picture(name, unescape(label[1]) if label else '', svg, (wide, high)))
    return tuple(found)
