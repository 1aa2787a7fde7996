"""What commands read: recordings by path or by shipped name, configs from yaml."""

from __future__ import annotations

import json
import sys
import tempfile
import threading
import time
from contextlib import contextmanager, suppress
from dataclasses import fields, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.errors import RecordingError, TactileError
from tactile_ros.evaluation.figures import check_png
from tactile_ros.evaluation.recording_files import LoadedRecording, load
from tactile_ros.types import Closing

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from typing import TextIO

    from rich.progress import Progress as Bar

    from tactile_ros.sensors import SensorSpec
    from tactile_ros.types import Layout, SensorConfig
    from tactile_ros.types.contracts import Cell


def figure(value: Cell, digits: int = 3) -> str:
    """A cell as text: `-` where nothing is known, few digits otherwise."""
    if value is None or (isinstance(value, float) and value != value):  # noqa: PLR0124
        return '-'
    if isinstance(value, float):
        return f'{value:.{digits}g}' if abs(value) < 1000 else f'{value:.0f}'
    return str(value)


def show(columns: Sequence[str], rows: Sequence[Sequence[Cell]], title: str = '') -> None:
    """Print a table; numbers to the right."""
    texts = [[figure(cell) for cell in row] for row in rows]
    widths = [max(len(r[i]) for r in (list(columns), *texts)) for i in range(len(columns))]
    numeric = [all(not isinstance(row[i], str) for row in rows) for i in range(len(columns))]
    if title:
        print(f'\n{title}')
    for line in (list(columns), ['-' * w for w in widths], *texts):
        cells = [
            c.rjust(w) if n else c.ljust(w) for c, w, n in zip(line, widths, numeric, strict=True)
        ]
        print('  '.join(cells).rstrip())


def as_objects(columns: Sequence[str], rows: Sequence[Sequence[Cell]]) -> list[dict[str, Cell]]:
    """The same table as a list of objects; what is not finite becomes null."""
    return [dict(zip(columns, (_plain(cell) for cell in row), strict=True)) for row in rows]


def _plain(cell: Cell) -> Cell:
    """A cell as json has it, numbers of numpy as numbers."""
    value: Cell = cell.item() if isinstance(cell, np.generic) else cell
    return None if isinstance(value, float) and not np.isfinite(value) else value


def show_json(columns: Sequence[str], rows: Sequence[Sequence[Cell]]) -> None:
    """Print the same table as a list of objects; what is not finite becomes null."""
    print(json.dumps(as_objects(columns, rows), indent=2))


class Progress(Closing):
    """Progress of a number of steps, on standard error; a context manager.

    Parameters
    ----------
    steps : int
        Nothing is shown for a single one.
    """

    def __init__(self, steps: int) -> None:
        self.steps, self.made = steps, 0
        self._bar = _bar(steps) if steps > 1 and sys.stderr.isatty() else None

    def step(self, what: str, failure: str = '') -> None:
        """One more step is made; of a failed one why."""
        self.made += 1
        text = f'{what} failed: {failure}' if failure else what
        if self._bar is not None:
            if failure:
                self._bar.console.print(text, markup=False)
            self._bar.advance(self._bar.task_ids[0])
        elif self.steps > 1:
            print(f'[{self.made}/{self.steps}] {text}', file=sys.stderr, flush=True)

    def close(self) -> None:
        """End the bar."""
        if self._bar is not None:
            self._bar.stop()
            self._bar = None


def _bar(steps: int) -> Bar | None:
    """A running bar, where rich is installed."""
    try:
        from rich.console import Console
        from rich.progress import Progress as Bar
    except ImportError:
        return None
    bar = Bar(console=Console(stderr=True))
    bar.add_task('recordings', total=steps)
    bar.start()
    return bar


PATIENCE_S = 2.0  # without a word
STEP_S = 0.5


@contextmanager
def working(
    what: str, stream: TextIO | None = None, patience_s: float = PATIENCE_S
) -> Iterator[None]:
    """Say what is being done once it takes longer than two seconds.

    Parameters
    ----------
    what : str
        Such as 'fitting'.
    stream : file, optional
        Default: stderr, so that tables and json stay clean.
    patience_s : float
        Silence before the first word (s).
    """
    done = threading.Event()
    told = (what, stream or sys.stderr, patience_s, done)
    teller = threading.Thread(target=_tell, args=told, daemon=True)
    teller.start()
    try:
        yield
    finally:
        done.set()
        teller.join()


def _tell(what: str, stream: TextIO, patience_s: float, done: threading.Event) -> None:
    """Wait, then tell; leave the line empty at the end."""
    began = time.monotonic()
    if done.wait(patience_s):
        return
    if not stream.isatty():
        print(f'{what} ...', file=stream, flush=True)
        return
    while not done.wait(STEP_S):
        seconds = time.monotonic() - began
        print(f'\r{what} ... {seconds:.0f} s', end='', file=stream, flush=True)
    print('\r\033[K', end='', file=stream, flush=True)


def refuse_unwritable(path: Path) -> None:
    """Refuse a file or new folder that could not be written at the end; nothing is made or left.

    Raises
    ------
    TactileError
        With the system's reason, or where `path` is a folder.
    """
    try:
        if path.is_dir():
            msg = f'{path} is a folder; name a file in it'
            raise TactileError(msg)
        folder = next(place for place in path.absolute().parents if place.exists())
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        msg = f'{path} cannot be written: {error.strerror}; name another place'
        raise TactileError(msg) from error


def refuse_no_pictures(folder: Path) -> None:
    """Refuse a folder of pictures that could not be made or written, before the work.

    Raises
    ------
    TactileError
        With the system's reason, or where a font or resvg is missing.
    """
    check_png()
    refuse_unwritable(folder / 'picture.png')


MOST_YAML_BYTES = 1_000_000


def find(
    name: str, spec: SensorSpec, layout: Layout | None, truth: Sequence[str] = ()
) -> tuple[list[LoadedRecording], list[str]]:
    """Recordings under a path, or the shipped one of that name, and what could not be read.

    Raises
    ------
    RecordingError
        If there is neither.
    """
    shipped = spec.recordings()
    if name in shipped and not Path(name).exists():
        return [LoadedRecording(name, shipped[name])], []
    if not Path(name).exists():
        msg = f'{name} does not exist, and {spec.key} ships only {", ".join(shipped) or "none"}'
        raise RecordingError(msg)
    found = load(name, layout, truth) if truth else load(name, layout)
    return list(found.recordings), found.sentences


def read_config(spec: SensorSpec, path: Path | None) -> SensorConfig:
    """Config of a sensor with the fields that a yaml file changes.

    Raises
    ------
    ValueError
        If the file is missing, too large, no mapping, or names a field that the config does not
        have or a value that it cannot have.
    """
    config = spec.config()
    if path is None:
        return config
    import yaml

    if not path.is_file():
        msg = f'config {path} must be a yaml file; there is none'
        raise ValueError(msg)
    if path.stat().st_size > MOST_YAML_BYTES:
        msg = (
            f'config {path} must be at most {MOST_YAML_BYTES} bytes; it has {path.stat().st_size}'
        )
        raise ValueError(msg)
    try:
        given = yaml.safe_load(path.read_text())
    except (yaml.YAMLError, UnicodeDecodeError, RecursionError) as error:
        msg = f'config {path} is no plain yaml: {str(error).splitlines()[0]}'
        raise ValueError(msg) from error
    known = {f.name for f in fields(config)}  # type: ignore[arg-type]
    if not isinstance(given, dict) or not set(given) <= known:
        stray = sorted(map(str, set(given) - known)) if isinstance(given, dict) else given
        msg = f'config {path} must map {", ".join(sorted(known))}; received {stray}'
        raise ValueError(msg)
    try:
        values = {name: _value(told, getattr(config, name)) for name, told in given.items()}
        return replace(config, **values)  # type: ignore[type-var]
    except (TypeError, ValueError) as error:
        msg = f'config {path}: {str(error).splitlines()[0]}'
        raise ValueError(msg) from error


def _value(told: object, default: object) -> object:
    """A value of yaml as the config takes it: lists are arrays, and 4e4 is a number."""
    if isinstance(told, list):
        return np.asarray(told, float)
    if isinstance(told, str) and isinstance(default, float):  # yaml wants 4.0e+4
        with suppress(ValueError):
            return float(told)
    return told


def fit_layout(config: SensorConfig, layout: Layout) -> SensorConfig:
    """Config for a recording with another number of taxels: the recording's positions count."""
    if len(config.positions) == len(layout.positions):
        return config
    return replace(config, positions=layout.positions)  # type: ignore[type-var]
