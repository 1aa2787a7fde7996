"""What a bench prints and writes: figures beside the paper's, a peer's, the bound and the aim."""

from __future__ import annotations

import json
import os
import platform
import sys
import time
from dataclasses import asdict, dataclass, field
from importlib import metadata
from typing import TYPE_CHECKING, Literal, TypeVar

import numpy as np

from tactile_ros import __version__
from tactile_ros.calibration import write_beside

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator
    from pathlib import Path

T = TypeVar('T')
COLUMNS = (
    'what', 'unit', 'paper', 'peer', 'ours', 'bound', 'aim', 'held', 'us_single', 'us_batch',
)  # fmt: skip
PACKAGES = ('numpy', 'scipy', 'rosbags', 'ros-rclpy', 'numba', 'scikit-learn')


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
        if self.aim is None or self.ours is None:
            return None
        return self.ours <= self.aim if self.better == 'low' else self.ours >= self.aim

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
            write_beside(folder / f'{self.bench}_{name}.svg', drawing.encode())
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
        return write_beside(folder / f'{self.bench}.json', text.encode())


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


def environment() -> dict[str, str]:
    """Machine and versions that the figures belong to."""
    found = {
        'tactile_ros': __version__,
        'python': sys.version.split()[0],
        'machine': platform.machine(),
        'cores': str(os.cpu_count()),
        'system': f'{platform.system()} {platform.release()}',
    }
    for package in PACKAGES:
        try:
            found[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            found[package] = 'not installed'
    return found
