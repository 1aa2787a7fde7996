# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Result of an evaluation as a table, as one self-contained HTML file and as pictures.

The page has no script, needs no network, and is light or dark as the reader prefers.
"""

from __future__ import annotations

import math
import os
import platform
import sys
import textwrap
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, fields, replace
from importlib import metadata
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros import __version__
from tactile_ros.errors import load_package
from tactile_ros.evaluation import figures, metrics
from tactile_ros.evaluation.compare import COLUMNS, NOTES, Comparison, paired_groups, row_of
from tactile_ros.evaluation.figures import MM, Drawing, Figure, quantity, rounded
from tactile_ros.evaluation.metrics import Agreement
from tactile_ros.files import write_atomically
from tactile_ros.pipeline import Pipeline
from tactile_ros.types import Array, Columns, ContactStates, Recording, Table
from tactile_ros.types.contracts import Cell

if TYPE_CHECKING:
    from pandas import DataFrame

LOW_IS_BETTER = ('mean', 'p50', 'p95', 'RMSE', 'us/frame')
PACKAGES = ('numpy', 'scipy', 'rosbags', 'ros-rclpy', 'numba', 'scikit-learn')
MOST_LETTERS = 90  # of a value of a configuration
PAGE_MARK = b'<meta name="generator" content="tactile_ros">'


@dataclass(frozen=True)
class Answer:
    """Errors of one pipeline, or of one way to use it, on one recording or several."""

    name: str
    targets: tuple[metrics.TargetErrors, ...]  # with truth
    us_single: float = float('nan')  # time of a frame alone (microseconds); NaN: not measured
    us_batch: float = float('nan')  # of one among many
    classes: tuple[metrics.ClassErrors, ...] = ()  # with truth
    contact: metrics.ContactErrors | None = None  # with truth and estimates
    untared: Answer | None = None  # of the same frames after the first tare alone
    calibration: str = ''
    frames: int = 0  # processed
    agreement: Agreement | None = None  # with the live run
    problems: tuple[str, ...] = ()  # sentences

    def target(self, name: str) -> metrics.TargetErrors | None:
        """Errors of one target; None where there are none."""
        return next((t for t in self.targets if t.name == name), None)

    @property
    def hits(self) -> dict[str, Counter[str]]:
        """Rows that are right, wrong and abstained, by kind of class."""
        return {one.name: one.hits for one in self.classes}

    @property
    def confusion_errors(self) -> list[metrics.ClassErrors]:
        """Errors of cells and labels that are estimated in some row."""
        return [c for c in self.classes if c.name in ('cell', 'label') and (c.said >= 0).any()]


def answer(
    name: str, recording: Recording, states: ContactStates, us_single: float, us_batch: float
) -> Answer:
    """Judge the states of a recording by its truth."""
    return Answer(
        name, metrics.target_errors(recording, states), us_single, us_batch,
        metrics.class_errors(recording.truth, states), metrics.contact_errors(recording, states),
    )  # fmt: skip


@dataclass(frozen=True)
class Dataset:
    """One recording of a sensor and all answers to it."""

    name: str
    summary: str  # content and held-out part, in a sentence
    answers: tuple[Answer, ...]  # the first is drawn alone, others are compared with it
    frames: int  # recorded
    dropped: int  # lost on the way
    chips: Array  # (t, 3) taxel positions (m)
    latency_s: Array = field(default_factory=lambda: np.zeros(0))  # (n,); empty: not live
    agreement: Agreement | None = None  # of the replay with the live run
    problems: tuple[str, ...] = ()  # sentences
    source: str = ''  # name of the recording
    sensor: str = ''  # and of the sensor in it
    seconds: float = float('nan')  # from the first frame to the last; NaN: independent frames
    association: Mapping[str, str] = field(default_factory=dict)  # of truth, by topic

    @property
    def competitors(self) -> dict[str, Answer]:
        """First answer of each name, as drawings compare them."""
        first: dict[str, Answer] = {}
        for answer in self.answers:
            first.setdefault(answer.name, answer)
        return first

    @property
    def latency(self) -> metrics.Spread:
        """Summary of the latency (s)."""
        return metrics.spread(self.latency_s)

    @property
    def all_problems(self) -> list[str]:
        """Problems of the recording and of all answers, and frames that are in no error."""
        left_out = [
            f'{answer.name}, {target.name.replace("_", " ")}: {target.missed} frames without an '
            f'estimate, {target.invalid} invalid, of {target.known}'
            for answer in self.answers[:1]
            for target in answer.targets
            if target.missed or target.invalid
        ]
        of_answers = (text for answer in self.answers for text in answer.problems)
        return [*dict.fromkeys((*of_answers, *self.problems, *left_out))]

    @property
    def sentences(self) -> list[str]:
        """Association of truth, agreement with the live run and warnings, under its name."""
        said = [f'{topic}: {how}' for topic, how in self.association.items()]
        several = sum(one.agreement is not None for one in self.answers) > 1
        for one in self.answers:
            which = f'{one.calibration}: ' if several else ''
            if one.agreement:
                said.append(f'{which}{one.agreement}')
        return [f'{self.name}: {text}' for text in (*said, *self.all_problems)]


def for_drawing(one: Dataset) -> Dataset:
    """Dataset as a report shows it: answers that truth can judge first, with different names."""
    names = Counter(answer.name for answer in one.answers)
    judged = sorted(one.answers, key=lambda a: not any(t.spread.count for t in a.targets))
    return replace(one, answers=tuple(
        replace(answer, name=f'{answer.name}, {answer.calibration}')
        if names[answer.name] > 1
        else answer
        for answer in judged
    ))  # fmt: skip


@dataclass(frozen=True)
class Result:
    """Everything that one evaluation measured."""

    title: str
    command: str  # that repeats it
    environment: dict[str, str]  # versions, machine, calibration
    datasets: tuple[Dataset, ...]
    notes: tuple[str, ...] = ()  # sentences for the end of the report

    def __repr__(self) -> str:
        """Recordings, frames and key figures in a line."""
        figures = '; '.join(  # the answer of a question holds its figure
            words if '?' in words else ' '.join(filter(None, (value, unit, words)))
            for value, unit, words in headline(self)
        )
        return f'Result({", ".join(one.name for one in self.datasets)}: {figures})'

    def __str__(self) -> str:
        """Table of errors with a row for each recording and estimator, and what to know of it."""
        columns, rows = table(self)
        return str(Table('', tuple(columns), tuple(map(tuple, rows)), tuple(self.sentences)))

    @property
    def sentences(self) -> list[str]:
        """Everything to know of the recordings beside the table."""
        return [text for one in self.datasets for text in one.sentences]

    def plot(self) -> Drawing:
        """Figures of every recording, as a report has them."""
        colours = colours_of(self)
        drawn = (figures_of(one, colours) for one in map(for_drawing, self.datasets))
        return Drawing(tuple(figure for figures in drawn for figure in figures))

    def to_dataframe(self) -> DataFrame:
        """Errors in a pandas table, a row for each frame and component with truth (SI units).

        Raises MissingPackageError where pandas is not installed.
        """
        pandas = load_package('pandas', 'a table of errors needs pandas')
        parts = [
            _error_columns(one.name, answer.name, target, axis)
            for one in self.datasets
            for answer in one.answers
            for target in answer.targets
            for axis in range(target.error.shape[1])
        ]
        names = parts[0] if parts else ()
        return pandas.DataFrame({n: np.concatenate([part[n] for part in parts]) for n in names})


def _error_columns(
    recording: str, estimator: str, target: metrics.TargetErrors, axis: int
) -> Columns:
    name = f'{target.name}_{"xy"[axis]}' if target.error.shape[1] > 1 else target.name
    words = {'recording': recording, 'estimator': estimator, 'target': name}
    return {
        **{key: np.full(len(target.rows), word, object) for key, word in words.items()},
        'row': target.rows, 'time_s': target.time_s, 'group': target.groups,
        'truth': target.truth[:, axis], 'estimate': target.estimate[:, axis],
        'error': target.error[:, axis], 'sigma': np.sqrt(target.variance[:, axis]),
    }  # fmt: skip


def environment() -> dict[str, str]:
    """Machine and versions that figures belong to."""
    versions = dict.fromkeys(PACKAGES, 'not installed')
    for package in PACKAGES:
        with suppress(metadata.PackageNotFoundError):
            versions[package] = metadata.version(package)
    return {
        'tactile_ros': __version__, 'python': sys.version.split()[0],
        'machine': platform.machine(), 'cores': str(os.cpu_count()),
        'system': f'{platform.system()} {platform.release()}', **versions,
    }  # fmt: skip


def provenance(recordings: Iterable[str], pipelines: Mapping[str, Pipeline]) -> dict[str, str]:
    """Name recordings, calibrations with their configuration, versions and machine."""
    facts = {'recordings': ', '.join(recordings)}
    for name, pipeline in pipelines.items():
        estimators = ', '.join(dict.fromkeys(pipeline.estimators.values())) or 'not fitted'
        facts[f'calibration {name}'] = f'{pipeline.digest}, {pipeline.sensor}: {estimators}'
        config = pipeline.config
        values = {item.name: getattr(config, item.name) for item in fields(config)}  # type: ignore[arg-type]
        facts[f'config of {name}'] = '; '.join(
            f'{key} {textwrap.shorten(str(value), MOST_LETTERS)}' for key, value in values.items()
        )
    return {**facts, **environment()}


def inside_one_sigma(targets: Sequence[metrics.TargetErrors]) -> int:
    """Components of errors within one standard deviation of their own."""
    shares = [target.coverage for target in targets if target.coverage.count]
    return round(sum(one.share * one.count for one in shares))


def _covered(answer: Answer, begin: str) -> Cell:
    targets = [target for target in answer.targets if target.name.startswith(begin)]
    judged = sum(target.coverage.count for target in targets)
    return 100 * inside_one_sigma(targets) / judged if judged else None


def _place(answer: Answer | None, name: str) -> Cell:
    target = answer and answer.target('position')
    return MM * float(getattr(target.spread, name)) if target else None


def _rms(answer: Answer | None, *names: str) -> Cell:
    if answer is None:
        return None
    parts = [t.spread for t in answer.targets if t.name in names and t.spread.count]
    squares = sum(part.count * part.rms**2 for part in parts)
    return math.sqrt(squares / sum(part.count for part in parts)) if parts else None


def _right(answer: Answer, kind: str) -> Cell:
    return next((c.right for c in answer.classes if c.name == kind), None)


def _latency(one: Dataset, answer: Answer, name: str) -> Cell:
    first = answer is one.answers[0]
    return MM * float(getattr(one.latency, name)) if first and one.latency.count else None


CELLS: dict[str, Callable[[Dataset, Answer], Cell]] = {
    'recording': lambda d, _: d.name,
    'estimator': lambda _, a: a.name,
    'calibration': lambda _, a: a.calibration,
    'false contacts (%)': lambda _, a: a.contact.contact_at_rest if a.contact else None,
    'contacts found (%)': lambda _, a: a.contact.found if a.contact else None,
    'place mean (mm)': lambda _, a: _place(a, 'mean'),
    'place, untared (mm)': lambda _, a: _place(a.untared, 'mean'),
    'p50': lambda _, a: _place(a, 'p50'),
    'p95': lambda _, a: _place(a, 'p95'),
    'place in 1 sigma (%)': lambda _, a: _covered(a, 'position'),
    'named rightly (%)': lambda _, a: next((c.right for c in a.confusion_errors), None),
    'normal RMSE (N)': lambda _, a: _rms(a, 'force_z'),
    'normal, untared (N)': lambda _, a: _rms(a.untared, 'force_z'),
    'shear RMSE (N)': lambda _, a: _rms(a, 'force_x', 'force_y'),
    'shear, untared (N)': lambda _, a: _rms(a.untared, 'force_x', 'force_y'),
    'force in 1 sigma (%)': lambda _, a: _covered(a, 'force'),
    'cell right (%)': lambda _, a: _right(a, 'cell'),
    'label right (%)': lambda _, a: _right(a, 'label'),
    'slip right (%)': lambda _, a: _right(a, 'slip'),
    'groups': lambda _, a: max((t.coverage.groups for t in a.targets), default=None),
    'latency p50 (ms)': lambda d, a: _latency(d, a, 'p50'),
    'p99 (ms)': lambda d, a: _latency(d, a, 'p99'),
    'dropped': lambda d, _: d.dropped,
    'frames': lambda d, _: d.frames,
    'us/frame': lambda _, a: a.us_single,
    'us/frame batch': lambda _, a: a.us_batch,
}
ON_PAGES = [name for name in CELLS if name not in (
    'calibration', 'cell right (%)', 'label right (%)', 'slip right (%)',
    'frames', 'us/frame batch',
)]  # fmt: skip
ACROSS = 8  # figures of a table that no page is too narrow for


def rows_of(
    datasets: Sequence[Dataset], names: Sequence[str]
) -> tuple[list[str], list[list[Cell]]]:
    """Columns of `CELLS` that have a value, and a row per recording and answer."""
    rows = [[CELLS[n](d, a) for n in names] for d in datasets for a in d.answers]
    kept = [i for i in range(len(names)) if any(_is_measured(row[i]) for row in rows)]
    return [names[i] for i in kept], [[row[i] for i in kept] for row in rows]


def table(result: Result) -> tuple[list[str], list[list[Cell]]]:
    """Summary of a report."""
    return rows_of(result.datasets, ON_PAGES)


def _is_measured(cell: Cell) -> bool:
    return cell is not None and (isinstance(cell, str) or math.isfinite(cell))


def figure_text(value: Cell) -> str:
    """Cell of the table with three digits."""
    if not _is_measured(value):
        return '–'
    if isinstance(value, float):
        return rounded(value)
    return value if isinstance(value, str) else f'{value:,}'


def _best(columns: list[str], rows: list[list[Cell]]) -> set[tuple[int, int]]:
    low = [i for i, c in enumerate(columns) if any(word in c for word in LOW_IS_BETTER)]
    best = set()
    for i, name in product((i for i in low if 'latency' not in columns[i]), {r[0] for r in rows}):
        group = (n for n, row in enumerate(rows) if row[0] == name)
        values = {n: v for n in group if isinstance(v := rows[n][i], float)}
        if len(values) > 1:
            best.add((min(values, key=lambda n: values[n]), i))
    return best


def colours_of(result: Result) -> dict[str, str]:
    """Colour of every estimator, the same throughout a report."""
    names = dict.fromkeys(a.name for d in result.datasets for a in d.answers)
    return {name: f'c{min(i, 4)}' for i, name in enumerate(names)}


def figures_of(dataset: Dataset, colours: dict[str, str]) -> list[Figure]:
    """Every figure that a recording has data for, each estimator in its colour."""
    if not dataset.answers:
        return []
    answer, colour = dataset.answers[0], colours[dataset.answers[0].name]
    forces = [t for n in ('force_z', 'force_x', 'force_y') if (t := answer.target(n)) and t.varies]
    estimated = [target for target in forces if target.spread.count]
    drawn: list[Figure | None] = [figures.contact(answer.contact)] if answer.contact else []
    if places := _compared(dataset, 'position'):
        if (place := places.get(answer.name)) is not None:
            drawn.append(figures.place_map(place, dataset.chips))
        drawn.append(figures.place_histogram(places, colours))
    drawn += [figures.force_scatter(target, colour) for target in estimated]
    if stated := [target for target in answer.targets if target.coverage.count]:
        drawn.append(figures.sigma_calibration(stated))
    drawn.append(_speed(dataset, colours))
    if dataset.latency.count:
        total = dataset.frames + dataset.dropped
        lost = f'{dataset.dropped} of {total} frames were lost on the way'
        drawn.append(figures.latency_histogram(dataset.latency_s, dataset.latency, lost))
    drawn += [figures.confusion_figure(errors) for errors in answer.confusion_errors]
    drawn += [figures.hysteresis(target) for target in forces]
    drawn += [figures.drift(target, colour) for target in forces]
    drawn += [figures.drift(target, colour, since_tare=True) for target in forces]
    drawn += [figures.force_trace(target, answer.name, colour) for target in estimated]
    return [figure for figure in drawn if figure is not None]


def _compared(dataset: Dataset, name: str) -> dict[str, metrics.TargetErrors]:
    found = {n: a.target(name) for n, a in dataset.competitors.items()}
    return {n: target for n, target in found.items() if target and target.spread.count}


def _speed(dataset: Dataset, colours: dict[str, str]) -> Figure | None:
    if not dataset.answers[0].targets:
        return None
    name = dataset.answers[0].targets[0].name
    unit = 'mean place error (mm)' if name == 'position' else 'RMSE (N)'
    scale = MM if name == 'position' else 1.0
    points = {
        estimator: (us, scale * figures.shown(target))
        for estimator, target in _compared(dataset, name).items()
        if (us := dataset.competitors[estimator].us_single) > 0
    }
    return figures.speed(points, unit, colours) if points else None


def headline(result: Result) -> list[tuple[str, str, str]]:
    """Key figures as (value, unit, words): the first answer of the first recording with each."""
    wanted = {
        'position': 'mean error of place',
        'force_z': 'RMSE of normal force',
        'force_x': 'RMSE of shear force',
        'force_y': 'RMSE of shear force y',
    }
    found, answers = [], [one.answers[0] for one in result.datasets if one.answers]
    if parts := [answer.contact for answer in answers if answer.contact]:
        touch = metrics.ContactErrors.pool(parts)
        words = f'Is something touching? {figures.contact_sentence(touch)}'
        found.append((figure_text(touch.found), '%', words))
    for name, words in wanted.items():
        targets = [(one.target(name), one.untared) for one in answers]
        if judged := [(t, u) for t, u in targets if t and t.spread.count and t.varies]:
            target, untared = judged[0]
            value, _, unit = quantity(figures.shown(target), target.unit).partition(' ')
            other = untared and untared.target(name)
            tared = f'; untared {quantity(figures.shown(other), other.unit)}' if other else ''
            found.append((value, unit, f'{words}{tared}'))
    if delay := next((d.latency for d in result.datasets if d.latency.count), None):
        value, _, unit = quantity(delay.p50, 's').partition(' ')
        found.append((value, unit, f'latency (p99 {quantity(delay.p99, "s")})'))
    lost = sum(d.dropped for d in result.datasets)
    frames = sum(d.frames for d in result.datasets)
    return [*found, (f'{lost}', '', f'of {lost + frames} frames lost')]


def render_page(template: Path, **values: object) -> str:
    """HTML of a jinja2 template, which may import `page.html`; everything is escaped."""
    import jinja2

    folders = [Path(__file__).parent, template.parent]
    pages = jinja2.Environment(
        loader=jinja2.FileSystemLoader(folders), autoescape=True, trim_blocks=True,
        lstrip_blocks=True, undefined=jinja2.StrictUndefined,
    )  # fmt: skip
    return pages.get_template(template.name).render(style=figures.STYLE, **values) + '\n'


def render(result: Result) -> str:
    """HTML of the whole report."""
    tables = []
    for first in range(2, len(ON_PAGES), ACROSS):
        names = ON_PAGES[:2] + ON_PAGES[first : first + ACROSS]
        columns, rows = rows_of(result.datasets, names)
        rows = [row for row in rows if any(map(_is_measured, row[2:]))]
        best = _best(columns, rows)
        cells = [
            [
                (figure_text(cell), 'words' if i < 2 else 'best' * ((n, i) in best))
                for i, cell in enumerate(row)
            ]
            for n, row in enumerate(rows)
        ]
        if rows:
            tables.append((columns, cells))
    colours = colours_of(result)
    sections = [
        {
            'dataset': dataset,
            'same': dataset.agreement is not None and dataset.agreement.largest <= metrics.SAME,
            'figures': figures_of(dataset, colours),
        }
        for dataset in result.datasets
    ]
    used = dict.fromkeys(a.name.split(',')[0] for d in result.datasets for a in d.answers)
    return render_page(
        Path(__file__).with_name('report.html'), result=result, headline=headline(result),
        tables=tables, sections=sections, estimators=', '.join(used) or 'none',
        frames=sum(d.frames for d in result.datasets),
        timed=any(d.latency.count for d in result.datasets),
    )  # fmt: skip


def write_report(path: str | os.PathLike[str], result: Result) -> Path:
    """Write the report (.html); return its path."""
    return write_atomically(path, render(result).encode())


def write_comparison(path: Path, found: Sequence[Comparison], command: str) -> Path:
    """Write comparisons as a drawing (.svg) or a page of their own (.html); return the path."""
    drawn = tuple(paired_groups(one) for one in found)
    if path.suffix == '.svg':
        return Drawing(drawn).save(path)
    page = render_page(
        Path(__file__).with_name('compare.html'), columns=COLUMNS, figures=drawn, notes=NOTES,
        rows=[[figure_text(cell) for cell in row_of(one)] for one in found], command=command,
        problems=[text for one in found for text in one.sentences], environment=environment(),
    )  # fmt: skip
    return write_atomically(path, page.encode())


def write_pictures(folder: Path, result: Result) -> Iterable[Path]:
    """Write the figures of an evaluation as PNG, named after their recordings."""
    colours = colours_of(result)
    for dataset in result.datasets:
        yield from figures.write_figures(folder, figures_of(dataset, colours), dataset.name)
