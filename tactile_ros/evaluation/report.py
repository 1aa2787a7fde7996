"""One self-contained HTML file about an evaluation: no script, no network, light and dark."""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.calibration import write_beside
from tactile_ros.evaluation.figures import colours_of, figures_of, headline
from tactile_ros.evaluation.page import document, drawn, facts, listed, tiles
from tactile_ros.evaluation.result import table

if TYPE_CHECKING:
    import os
    from pathlib import Path

    from tactile_ros.evaluation.figure import Colours
    from tactile_ros.evaluation.result import Cell, Dataset, Result

LOW_IS_BETTER = ('mean', 'p50', 'p95', 'RMSE', 'us/frame')
SAME = 1e-9
READING = (
    'Place error is the distance in the plane between estimated and true place; RMSE is the root '
    'mean square error of one component.',
    'Inside one sigma counts components separately: 68.3 % where the covariances are right. '
    'Accepted is that share to within 5 points, or the 95 % binomial interval over the groups '
    '(places, press cycles) where that is wider.',
    'Latency is from the frame’s acquisition stamp to the arrival of its contact in the bag. '
    'Frames lost are gaps of the counter.',
    'Frames that the pipeline called invalid, and those without an estimate, are in no error; '
    'they are counted where there are any.',
)


def write_report(path: str | os.PathLike[str], result: Result) -> Path:
    """Write the report.

    Parameters
    ----------
    path : path-like
        Of the .html file; its folder is made.
    result : Result
        What was found.

    Returns
    -------
    Path
        Of the file.
    """
    return write_beside(path, render(result).encode())


def render(result: Result) -> str:
    """The whole document."""
    body = [
        f'<header><h1>{escape(result.title)}</h1>'
        f'<p class="lead">{escape(_lead(result))}</p></header>',
        tiles(headline(result)),
        _table(result),
        *(_section(dataset, colours_of(result)) for dataset in result.datasets),
        _repeat(result),
    ]
    return document(result.title, body)


def _lead(result: Result) -> str:
    """What was evaluated, in a sentence."""
    frames = sum(dataset.frames for dataset in result.datasets)
    answers = [answer for dataset in result.datasets for answer in dataset.answers]
    names = [answer.name.split(',')[0] for answer in answers]
    count = len(result.datasets)
    recordings = 'one recording' if count == 1 else f'{count} recordings'
    distinct = ', '.join(dict.fromkeys(names))
    return f'{frames:,} frames of {recordings}; estimators: {distinct or "none"}.'


def figure_text(value: Cell, column: str) -> str:
    """A cell of the table: as many digits as it deserves."""
    if value is None or (isinstance(value, float) and not np.isfinite(value)):
        return '–'
    if isinstance(value, str):
        return value
    if isinstance(value, int):
        return f'{value:,}'
    digits = 0 if '%' in column else 1 if value >= 10 else 2
    return f'{value:.{digits}f}'


def _table(result: Result) -> str:
    """Every estimator on every recording."""
    columns, rows = table(result)
    if not rows:
        return ''
    words = [all(isinstance(row[i], str) for row in rows) for i in range(len(columns))]
    best = _best(columns, rows)
    head = ''.join(
        f'<th class="{"words" if w else ""}" scope="col">{escape(column)}</th>'
        for column, w in zip(columns, words, strict=True)
    )
    lines = []
    for number, row in enumerate(rows):
        cells = []
        for i, cell in enumerate(row):
            tag = 'th scope="row"' if i == 0 else 'td'
            kind = 'words' if words[i] else 'best' if (number, i) in best else ''
            text = escape(figure_text(cell, columns[i]))
            cells.append(f'<{tag} class="{kind}">{text}</{tag[:2]}>')
        lines.append(f'<tr>{"".join(cells)}</tr>')
    return (
        '<h2>Summary</h2><p class="lead">One row per recording and estimator; the best of a '
        f'recording is bold.</p><div class="scroll"><table><thead><tr>{head}</tr></thead>'
        f'<tbody>{"".join(lines)}</tbody></table></div>'
    )


def _best(columns: list[str], rows: list[list[Cell]]) -> set[tuple[int, int]]:
    """Cells that are the lowest of their recording, where several estimators compete."""
    found = set()
    for name in {row[0] for row in rows}:
        group = [n for n, row in enumerate(rows) if row[0] == name]
        for i, column in enumerate(columns):
            if 'latency' in column or not any(word in column for word in LOW_IS_BETTER):
                continue
            known = [(row[i], n) for n in group if isinstance((row := rows[n])[i], float)]
            if len(known) > 1:
                found.add((min(known, key=lambda pair: float(pair[0] or 0.0))[1], i))
    return found


def _section(dataset: Dataset, colours: Colours) -> str:
    """One recording: what it is, what went wrong, and its drawings."""
    figures = figures_of(dataset, colours) if dataset.answers else []
    return (
        f'<section><h2>{escape(dataset.name)}</h2>'
        f'<p class="lead">{escape(dataset.summary)}</p>{_agreement(dataset)}'
        f'{listed([*dataset.problems, *_left_out(dataset)], "problems")}'
        f'<div class="grid">{"".join(map(drawn, figures))}</div></section>'
    )


def _left_out(dataset: Dataset) -> list[str]:
    """Sentences on frames that are in no error."""
    return [
        f'{answer.name}, {target.name.replace("_", " ")}: {target.missed} frames without an '
        f'estimate, {target.invalid} invalid, of {target.known}'
        for answer in dataset.answers[:1]
        for target in answer.targets
        if target.missed or target.invalid
    ]


def _agreement(dataset: Dataset) -> str:
    """Whether the replay gave the numbers of the live run."""
    found = dataset.agreement
    if found is None:
        return ''
    same = found.largest <= SAME
    largest = f'{found.largest:.2g}'.replace('-', '−')
    verdict = (
        f'The replay gives the contacts of the live run in all {found.frames:,} frames: '
        f'largest difference {largest}'
        if same
        else f'The replay differs from the live run by up to {largest} ({found.worst})'
    )
    if found.without_contacts:
        verdict += f'; {found.without_contacts:,} frames had no contacts and were left out'
    return f'<p class="agreement {"good" if same else ""}">{escape(verdict)}.</p>'


def _repeat(result: Result) -> str:
    """How to repeat it, where it ran, and how to read it."""
    return (
        f'<section><h2>Repeat it</h2><pre>{escape(result.command)}</pre>'
        f'{facts(result.environment)}</section>'
        f'<section><h2>How to read this</h2>{listed([*READING, *result.notes], "notes")}</section>'
    )
