"""What an evaluation found, as tables and reports take it."""

from __future__ import annotations

import math
import os
import platform
import sys
from dataclasses import dataclass, field
from importlib import metadata
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros import __version__
from tactile_ros.evaluation.metrics import TARGETS, Named, Spread, named, spread, target_errors
from tactile_ros.types import Array

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from tactile_ros.evaluation.metrics import TargetErrors
    from tactile_ros.evaluation.recording_files import LoadedRecording
    from tactile_ros.evaluation.replay import Agreement, Replayed

PACKAGES = ('numpy', 'scipy', 'rosbags', 'ros-rclpy', 'numba', 'scikit-learn')
Cell = str | float | int | None

COLUMNS = (
    'recording',
    'estimator',
    'place mean (mm)',
    'p50',
    'p95',
    'normal RMSE (N)',
    'shear RMSE (N)',
    'place in 1 sigma (%)',
    'force in 1 sigma (%)',
    'named rightly (%)',
    'groups',
    'latency p50 (ms)',
    'p99 (ms)',
    'dropped',
    'us/frame',
)


@dataclass(frozen=True)
class Answer:
    """One estimator on one recording.

    Attributes
    ----------
    name : str
        Of the estimator, or of the way that it was used.
    targets : tuple of TargetErrors
        Whatever truth could judge.
    us_single, us_batch : float
        Time per frame (microseconds), one by one and in a batch; NaN: not measured.
    note : str
        What is special about it, in a few words.
    named : tuple of Named
        Cells and labels, where truth knows them.
    """

    name: str
    targets: tuple[TargetErrors, ...]
    us_single: float = float('nan')
    us_batch: float = float('nan')
    note: str = ''
    named: tuple[Named, ...] = ()

    def target(self, name: str) -> TargetErrors | None:
        """Errors of one target; None where there are none."""
        return next((t for t in self.targets if t.name == name), None)

    @property
    def shear_rms(self) -> float | None:
        """Of the errors of force along x and y, components pooled (N); None: not judged."""
        parts = [t.spread for name in ('force_x', 'force_y') if (t := self.target(name))]
        count = sum(part.count for part in parts)
        squares = sum(part.count * part.rms**2 for part in parts if part.count)
        return math.sqrt(squares / count) if count else None


@dataclass(frozen=True)
class Dataset:
    """One recording and all that was answered to it.

    Attributes
    ----------
    name, summary : str
        Short name; what it is and what was held out, in a sentence.
    answers : tuple of Answer
        The one to be shown first, then those that it is compared with.
    frames, dropped : int
        Recorded; lost on the way.
    chips : ndarray, shape (t, 3)
        Taxel positions (m).
    latency_s : ndarray, shape (n,)
        From acquisition to contact (s); empty: not a live recording.
    late : Spread or None
        Of all contacts, where `latency_s` holds some of them.
    agreement : Agreement or None
        Of the replay with the live run.
    problems : tuple of str
        Sentences.
    """

    name: str
    summary: str
    answers: tuple[Answer, ...]
    frames: int
    dropped: int
    chips: Array
    latency_s: Array = field(default_factory=lambda: np.zeros(0))
    late: Spread | None = None
    agreement: Agreement | None = None
    problems: tuple[str, ...] = ()

    @property
    def competitors(self) -> tuple[Answer, ...]:
        """Answers of different names: the first of each, as drawings compare them."""
        first: dict[str, Answer] = {}
        for found in self.answers:
            first.setdefault(found.name, found)
        return tuple(first.values())

    @property
    def latency(self) -> Spread:
        """Summary of the latency (s)."""
        return self.late or spread(self.latency_s)


@dataclass(frozen=True)
class Result:
    """Everything that one evaluation found.

    Attributes
    ----------
    title : str
        What was evaluated.
    command : str
        The exact command that repeats it.
    environment : dict of str to str
        Versions, machine, calibration.
    datasets : tuple of Dataset
        In the order of the report.
    notes : tuple of str
        Sentences for the end of the report.
    """

    title: str
    command: str
    environment: dict[str, str]
    datasets: tuple[Dataset, ...]
    notes: tuple[str, ...] = ()


def answer(name: str, loaded: LoadedRecording, replayed: Replayed, note: str = '') -> Answer:
    """Judge one replay by the truth of its recording."""
    targets = target_errors(loaded.recording, replayed.states)
    classes = named(loaded.recording, replayed.states)
    return Answer(name, targets, replayed.us_per_frame, replayed.us_batch, note, classes)


def unjudged(name: str, counts: Mapping[str, int], given: Sequence[str]) -> tuple[str, ...]:
    """A sentence where truth and estimates have nothing in common, so that no error is known.

    Parameters
    ----------
    name : str
        Of the estimators.
    counts : mapping of str to int
        Known errors of everything that truth tells.
    given : sequence of str
        What was estimated, as `metrics.given_targets` says.

    Returns
    -------
    tuple of str
        Empty where at least one error is known.
    """
    if any(counts.values()):
        return ()
    if both := [target for target in counts if target in given]:
        return (f'{name} has no error: no row with true {_listed(both)} has an estimate',)
    told = _listed(list(counts))
    return (f'{name} has no error: it estimates {_listed(given)}, truth has {told}',)


def _listed(names: Sequence[str]) -> str:
    return ', '.join(names) or f'none of {", ".join(TARGETS)}'


def table_row(dataset: Dataset, answer: Answer) -> list[Cell]:
    """Cells of `COLUMNS` for one estimator on one recording; None: not measured."""
    place, normal = answer.target('position'), answer.target('force_z')
    forces = [t for t in answer.targets if t.name.startswith('force')]
    millimetres = [None, None, None] if place is None else _millimetres(place.spread)
    delay = dataset.latency
    live = delay.count > 0 and answer is dataset.answers[0]
    return [
        dataset.name,
        answer.name,
        *millimetres,
        None if normal is None else normal.spread.rms,
        answer.shear_rms,
        None if place is None else 100 * place.coverage.share,
        _pooled_share(forces),
        answer.named[0].right if answer.named else None,
        max((t.coverage.groups for t in answer.targets), default=None),
        1e3 * delay.p50 if live else None,
        1e3 * delay.p99 if live else None,
        dataset.dropped,
        answer.us_single,
    ]


def _millimetres(found: Spread) -> list[Cell]:
    return [1e3 * found.mean, 1e3 * found.p50, 1e3 * found.p95]


def _pooled_share(targets: list[TargetErrors]) -> float | None:
    """Share of the errors of all components inside one sigma (%)."""
    count = sum(t.coverage.count for t in targets)
    if not count:
        return None
    inside = sum(t.coverage.share * t.coverage.count for t in targets if t.coverage.count)
    return 100 * inside / count


def table(result: Result) -> tuple[list[str], list[list[Cell]]]:
    """Columns and rows of the summary: one row per recording and estimator.

    Parameters
    ----------
    result : Result
        Of an evaluation.

    Returns
    -------
    columns : list of str
        Units in the names: millimetres, newton, microseconds.
    rows : list of list
        Columns that nobody has a value for are left out.
    """
    rows = [table_row(d, a) for d in result.datasets for a in d.answers]
    kept = [
        i
        for i in range(len(COLUMNS))
        if any(isinstance(row[i], str) or _known(row[i]) for row in rows)
    ]
    return [COLUMNS[i] for i in kept], [[row[i] for i in kept] for row in rows]


def _known(cell: Cell) -> bool:
    return cell is not None and not (isinstance(cell, float) and np.isnan(cell))


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
