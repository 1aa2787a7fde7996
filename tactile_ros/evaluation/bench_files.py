"""Results of benches and replays, read back from their json and the drawings beside it."""

from __future__ import annotations

import json
import math
import re
from dataclasses import asdict, dataclass, fields, replace
from html import unescape
from typing import TYPE_CHECKING, Literal, TypeVar, cast

from tactile_ros.errors import TactileError
from tactile_ros.evaluation.benchmark import BenchResult, Row
from tactile_ros.evaluation.replay_rows import replay_result

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

    from tactile_ros.evaluation.replay_rows import ReplayJson

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
    name, told : str
        Of the file; what it shows.
    svg : bytes
        Of the file.
    size : tuple of float
        Width and height (pixels).
    """

    name: str
    told: str
    svg: bytes
    size: tuple[float, float]


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
