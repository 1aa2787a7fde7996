# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Tables, progress and refusals on the terminal; configs from yaml."""

from __future__ import annotations

import argparse
import json
import os
import resource
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import fields, replace
from multiprocessing import get_context
from pathlib import Path
from typing import TextIO

import numpy as np

from tactile_ros.errors import TactileError, plain
from tactile_ros.evaluation.figures import check_png
from tactile_ros.files import read_yaml, refuse_misfit, refuse_special
from tactile_ros.sensors import SensorSpec
from tactile_ros.types import Closing, SensorConfig, Table
from tactile_ros.types.contracts import Cell

PATIENCE_S, STEP_S = 2.0, 0.5  # without a word; between two
SHARE, BESIDE, LONGEST_S = 8, 10, 60  # work over the part of an estimate; its niceness, its time
BUSY = 0.75  # programs that run, over processors
LOAD = os.getloadavg()[0]  # of the minute before this command


def show(
    columns: Sequence[str], rows: Sequence[Sequence[Cell]], title: str = '', as_json: bool = False,
    notes: Iterable[str] = (),
) -> None:  # fmt: skip
    """Print a table, numbers to the right, and notes; or JSON, a list of objects."""
    if as_json:
        print(json.dumps(as_objects(columns, rows), indent=2))
    else:
        if title:
            print()
        print(Table(title, tuple(columns), tuple(map(tuple, rows))))
        if any(name.startswith('us') for name in columns):
            note_if_busy()
    note(notes, sys.stderr if as_json else sys.stdout)


def note(sentences: Iterable[str], file: TextIO | None = None) -> None:
    """Print sentences that stand below a table, or on stderr."""
    for sentence in sentences:
        print(plain(f'  {sentence}'), file=file or sys.stderr)


def as_objects(columns: Sequence[str], rows: Sequence[Sequence[Cell]]) -> list[dict[str, Cell]]:
    """The same table as a list of objects; what is not finite becomes null."""

    def value_of(cell: Cell) -> Cell:
        value: Cell = cell.item() if isinstance(cell, np.generic) else cell
        return None if isinstance(value, float) and not np.isfinite(value) else value

    return [dict(zip(columns, map(value_of, row), strict=True)) for row in rows]


class Progress(Closing):
    """Progress of a number of steps on stderr: a bar on a terminal, a line for each elsewhere."""

    def __init__(self, steps: int) -> None:
        self.steps, self.made = steps, 0
        self._bar = None
        if steps > 1 and sys.stderr.isatty():
            with suppress(ImportError):
                from rich.console import Console
                from rich.progress import Progress as Bar

                self._bar = Bar(console=Console(stderr=True))
                self._bar.add_task('recordings', total=steps)
                self._bar.start()

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


class TimeEstimate(Closing):
    """One part in `SHARE` of some work in a process beside, whose time tells that of the whole."""

    def __init__(self, work: Callable[[], object]) -> None:
        context = get_context('fork')
        self._spent = context.Value('d', 0.0)  # s of a processor; 0: not known yet
        self._beside = context.Process(target=self._run, args=(work,), daemon=True)
        self._beside.start()

    def _run(self, work: Callable[[], object]) -> None:
        resource.setrlimit(resource.RLIMIT_CPU, (LONGEST_S, LONGEST_S))  # also if we are killed
        os.nice(BESIDE)
        began = time.process_time()
        with suppress(Exception):  # the whole work may well do what a part cannot
            work()
            self._spent.value = time.process_time() - began

    @property
    def expected_s(self) -> float:
        """Time that the whole may take (s); 0: not known yet, or not at all."""
        return float(SHARE * self._spent.value)

    def close(self) -> None:
        """End the process."""
        self._beside.kill()
        self._beside.join()


@contextmanager
def working(
    what: str, stream: TextIO | None = None, patience_s: float = PATIENCE_S,
    part: Callable[[], object] | None = None, expected: Callable[[], float] = lambda: 0.0,
) -> Iterator[None]:  # fmt: skip
    """Say on stderr what is being done once it takes long: a line, on a terminal the seconds.

    `part` does one part in `SHARE` of it, from which a second processor tells the time of all;
    else `expected` does (s), 0 as long as nobody knows.
    """
    done, began = threading.Event(), time.monotonic()
    file = stream or sys.stderr
    estimate = TimeEstimate(part) if part and len(os.sched_getaffinity(0)) > 1 else None

    def show_progress() -> None:
        if done.wait(patience_s):
            return
        terminal = file.isatty()
        begin, end = ('\r', '') if terminal else ('', '\n')
        about = ''
        if not terminal:
            print(f'{what} ...', file=file, flush=True)
        while not done.wait(STEP_S) and (terminal or not about):
            seconds = time.monotonic() - began
            expected_s = estimate.expected_s if estimate else expected()
            about = f' of about {max(expected_s, seconds):.0f} s' if expected_s else ''
            if terminal or about:
                line = f'{begin}{what} ... {seconds:.0f} s{about}'
                print(line, end=end, file=file, flush=True)
        if terminal:
            print('\r\033[K', end='', file=file, flush=True)

    teller = threading.Thread(target=show_progress, daemon=True)
    teller.start()
    try:
        yield
    finally:
        done.set()
        teller.join()
        if estimate:
            estimate.close()


def note_if_busy(load: float = LOAD) -> None:
    """Say on stderr that times mean little where other programs had the processors before."""
    processors = len(os.sched_getaffinity(0))
    if load > BUSY * processors:
        many = f'{load:.1f} programs on {processors} processors'
        print(f'this machine was busy before ({many}): times mean little', file=sys.stderr)


def refuse_unwritable(path: Path, mark: bytes = b'', *, overwrite: bool = True) -> None:
    """Refuse a file or new folder that could not be written at the end; nothing is made or left.

    A file without `mark`, which every file of the command holds, is replaced on request alone.
    Raises TactileError with the system's reason, or for a folder or a file of something else.
    """
    try:
        refuse_special(path)
        if not overwrite:
            refuse_misfit(path, mark)
        folder = next(place for place in path.absolute().parents if place.exists())
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        msg = f'{path} cannot be written: {error.strerror}; name another place'
        raise TactileError(msg) from error


def refuse_no_new_folder(target: Path, inputs: Iterable[Path] = ()) -> None:
    """Refuse an output that exists already, or would lie inside a bag that is read."""
    if os.path.lexists(target):
        raise TactileError(f'{target} exists already; name a folder that does not')
    for folder in inputs:
        if target.resolve().is_relative_to(folder.resolve()):
            raise TactileError(f'{target} is inside {folder}; name a folder outside it')


def add_overwrite(parser: argparse.ArgumentParser) -> None:
    """Option that lets a command replace files of others."""
    parser.add_argument(
        '--overwrite', action='store_true', help='replace a file that this command did not write'
    )


def refuse_no_pictures(folder: Path) -> None:
    """Refuse a folder of pictures that could not be drawn (no resvg, no font) or written."""
    check_png()
    refuse_unwritable(folder / 'picture.png')


def read_config(spec: SensorSpec, path: Path | None) -> SensorConfig:
    """Config of a sensor with the fields that a yaml file changes.

    Raises ValueError if the file is missing, too large, no mapping, or names a field that the
    config does not have or a value that it cannot have.
    """
    config = spec.config()
    if path is None:
        return config
    if not path.is_file():
        raise ValueError(f'config {path} must be a yaml file; there is none')
    try:
        given = read_yaml(path.read_bytes())
    except ValueError as error:
        raise ValueError(f'config {path} is {error}') from error
    names = {f.name for f in fields(config)}  # type: ignore[arg-type]
    stray = sorted(map(str, set(given) - names)) if isinstance(given, dict) else given
    if not isinstance(given, dict) or stray:
        raise ValueError(f'config {path} must map {", ".join(sorted(names))}; received {stray}')
    try:
        values = {name: _value(value, getattr(config, name)) for name, value in given.items()}
        return replace(config, **values)  # type: ignore[type-var]
    except (TypeError, ValueError) as error:
        raise ValueError(f'config {path}: {str(error).splitlines()[0]}') from error


def _value(given: object, default: object) -> object:
    """A value of yaml as the config takes it: lists are arrays, and 4e4 is a number."""
    if isinstance(given, list):
        return np.asarray(given, float)
    if isinstance(given, str) and isinstance(default, float):  # yaml wants 4.0e+4
        with suppress(ValueError):
            return float(given)
    return given
