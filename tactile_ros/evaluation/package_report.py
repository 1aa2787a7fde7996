"""The whole package on one page: every bench's figures, aims held and missed, speed and error."""

from __future__ import annotations

from html import escape
from itertools import groupby
from typing import TYPE_CHECKING

from tactile_ros import __version__
from tactile_ros.calibration import write_beside
from tactile_ros.evaluation.page import (
    deviation,
    document,
    drawn,
    facts,
    image_of,
    listed,
    number,
    tiles,
    unit_of,
)
from tactile_ros.evaluation.pareto import contests, pareto
from tactile_ros.evaluation.seed_strip import strip

if TYPE_CHECKING:
    import os
    from collections.abc import Sequence
    from pathlib import Path

    from tactile_ros.evaluation.bench_files import BenchFile, Picture
    from tactile_ros.evaluation.benchmark import Row

TITLES = {
    'reskin': 'Real boards: ReSkin, AnySkin, eFlesh, on recordings',
    'multipole_skin': '[1] Multipole skin',
    'multipole_figures': '[1] Its figures, made again',
    'multipole_graph': '[1] Multipole skin through the graph',
    'pronet': '[1] Few-shot network and templates',
    'magnet_pad': '[2] Magnet pad',
    'gradiometer': '[3] Gradiometer',
    'taxel_array': '[4] Taxel arrays',
    'five_wire_skin': '[5] Five-wire skin',
    'devices': 'Devices: faults, hostile bytes, speed, memory',
    'grasp': 'Grasp: slip and grip force',
    'latency': 'Delay and cost of a grip',
    'fidelity': 'Fidelity of the models',
    'roads': 'Three roads, one number',
    'replay': 'Replay of bags',
}  # in this order; others follow by name
COLUMNS = ('published', 'peer', 'ours', 'bound', 'aim', '', 'µs, one', 'µs, of a batch')
WIDE = 700.0  # pixels, from which a drawing takes a row of its own
MARKS = {None: '', True: '✓ held', False: '✗ missed'}
READING = (
    'Published: the figure of the paper. Peer: the paper’s own method, or the best of the others, '
    'in the same run; the notes of a bench say which. Bound: what no method can beat there.',
    'An aim is held where ours is at most the aim, or at least where high is better. ± is one '
    'standard deviation over seeds or held-out runs; under it dots are their values, the bar that '
    'deviation to either side, the upright line the aim.',
    'µs, one: a frame alone, as it comes from a sensor; µs, of a batch: a frame among many.',
    'Benches that run side by side slow one another: take times from a bench that ran alone.',
)


def write_package_report(
    path: str | os.PathLike[str], files: Sequence[BenchFile], problems: Sequence[str], command: str
) -> Path:
    """Write the page.

    Parameters
    ----------
    path : path-like
        Of the .html file; its folder is made.
    files : sequence of BenchFile
        What benches found.
    problems : sequence of str
        What could not be read.
    command : str
        That makes this page again.

    Returns
    -------
    Path
        Of the file.
    """
    return write_beside(path, render_package(files, problems, command).encode())


def render_package(files: Sequence[BenchFile], problems: Sequence[str], command: str) -> str:
    """The whole document."""
    files = sorted(files, key=_place)
    title = f'tactile_ros {__version__}: what it reaches, and what it misses'
    rows = [row for file in files for row in file.result.rows]
    aims = [row.held for row in rows if row.held is not None]
    lead = (
        f'{len(rows):,} figures of {len(files)} benches; {sum(aims)} of {len(aims)} aims are '
        f'held, {len(aims) - sum(aims)} are missed.'
    )
    links = ' '.join(
        f'<a href="#{_anchor(file)}">{escape(title_of(file.result.bench))}</a>' for file in files
    )
    return document(title, [
        f'<header><h1>{escape(title)}</h1><p class="lead">{lead}</p></header>',
        tiles(headline(files)),
        f'<nav>{links}</nav>',
        listed(problems, 'problems'),
        _missed(files),
        _speed(files),
        *map(_bench, files),
        _repeat(files, command),
    ])  # fmt: skip


def _place(file: BenchFile) -> tuple[int, str]:
    """Where a bench stands on the page."""
    name = file.result.bench
    return ([*TITLES].index(name) if name in TITLES else len(TITLES), name)


def _anchor(file: BenchFile) -> str:
    return escape('bench-' + ''.join(c if c.isalnum() else '-' for c in file.result.bench))


def title_of(bench: str) -> str:
    """Headline of a bench."""
    return TITLES.get(bench, bench.replace('_', ' '))


def headline(files: Sequence[BenchFile]) -> list[tuple[str, str, str]]:
    """Key figures as (value, unit, words)."""
    rows = [row for file in files for row in file.result.rows]
    aims = [row.held for row in rows if row.held is not None]
    papers = [row for row in rows if row.paper is not None and row.ours is not None]
    better = sum(_beats(row, row.paper) for row in papers)
    peers = [row for row in rows if row.peer is not None and row.ours is not None]
    return [
        (f'{sum(aims)}', f'of {len(aims)}', 'aims held'),
        (f'{len(aims) - sum(aims)}', '', 'aims missed'),
        (f'{better}', f'of {len(papers)}', 'at least as good as published'),
        (f'{sum(_beats(row, row.peer) for row in peers)}', f'of {len(peers)}',
         'at least as good as the peer in the same run'),
    ]  # fmt: skip


def _beats(row: Row, other: float | None) -> bool:
    """Whether ours is at least as good."""
    if row.ours is None or other is None:
        return False
    return row.ours <= other if row.better == 'low' else row.ours >= other


def _missed(files: Sequence[BenchFile]) -> str:
    """Every aim that is missed, one under the other."""
    lines = [
        f'<tr><th class="what" scope="row">{escape(row.what.strip())}'
        f'<br><small>{escape(title_of(file.result.bench))}</small></th>'
        f'<td class="missed">{number(row.ours, row.aim)} {escape(unit_of(row.unit))}</td>'
        f'<td>{"≤" if row.better == "low" else "≥"} {number(row.aim)}</td></tr>'
        for file in files
        for row in file.result.rows
        if row.held is False
    ]
    if not lines:
        return ''
    return (
        '<section><h2>Aims missed</h2><p class="lead">What was aimed at and not reached in these '
        'runs; everything else that had an aim is held.</p>'
        '<div class="scroll"><table><thead><tr><th class="words">figure</th>'
        '<th>ours</th><th>aim</th></tr></thead>'
        f'<tbody>{"".join(lines)}</tbody></table></div></section>'
    )


def _speed(files: Sequence[BenchFile]) -> str:
    """All methods on the same data, against their time."""
    found = contests(row for file in files for row in file.result.rows)
    if not found:
        return ''
    drawings = ''.join(drawn(pareto(contest)) for contest in found)
    return (
        '<section><h2>Speed against error</h2><p class="lead">Every drawing has one set of data '
        f'and all methods that were tried on it.</p><div class="grid">{drawings}</div></section>'
    )


def _bench(file: BenchFile) -> str:
    """Table, drawings and notes of a bench."""
    result = file.result
    judged = [row for row in result.rows if row.paper is not None or row.aim is not None]
    others = [row for row in result.rows if row.paper is None and row.aim is None]
    seeds = ', '.join(map(str, result.seed)) or 'none'
    body = table(judged) if judged else ''
    if others:
        body += (
            f'<details{"" if judged else " open"}><summary>{len(others)} figures without an '
            f'aim</summary>{table(others)}</details>'
        )
    pictures = ''.join(map(_picture, file.pictures))
    return (
        f'<section id="{_anchor(file)}"><h2>{escape(title_of(result.bench))}</h2>'
        f'<p class="lead"><code>{escape(result.command)}</code>, seeds {escape(seeds)}</p>'
        f'{body}{f"<div class=grid>{pictures}</div>" if pictures else ""}'
        f'{listed(result.notes, "notes")}</section>'
    )


def table(rows: Sequence[Row]) -> str:
    """Figures side by side; columns that nobody fills are left out."""
    cells = [_cells(row) for row in rows]
    kept = [i for i in range(len(COLUMNS)) if any(line[i] not in ('', '–') for line in cells)]
    head = ''.join(f'<th scope="col">{COLUMNS[i]}</th>' for i in kept)
    lines = []
    for row, line in zip(rows, cells, strict=True):
        kinds = {2: 'ours', 5: {True: 'held', False: 'missed', None: ''}[row.held]}
        drawings = {2: strip(row)}
        told = ''.join(
            f'<td class="{kinds.get(i, "")}">{escape(line[i])}{drawings.get(i, "")}</td>'
            for i in kept
        )
        indent = ' under' if row.what.startswith(' ') else ''
        unit = f' <small>{escape(unit_of(row.unit))}</small>' if unit_of(row.unit) else ''
        lines.append(
            f'<tr><th class="what{indent}" scope="row">{escape(row.what.strip())}{unit}</th>'
            f'{told}</tr>'
        )
    return (
        '<div class="scroll"><table><thead><tr><th class="words" scope="col">figure</th>'
        f'{head}</tr></thead><tbody>{"".join(lines)}</tbody></table></div>'
    )


def _cells(row: Row) -> list[str]:
    """Cells of `COLUMNS`."""
    ours = f'{number(row.ours, row.aim)}{deviation(row.spread)}'
    numbers = [number(row.paper), number(row.peer), ours, number(row.bound), number(row.aim)]
    return [*numbers, MARKS[row.held], number(row.us_single), number(row.us_batch)]


def _picture(picture: Picture) -> str:
    """A bench's own drawing and what it shows."""
    wide = ' class="wide"' if picture.size[0] > WIDE else ''
    return (
        f'<figure{wide}><h3>{escape(picture.name)}</h3>{image_of(picture)}'
        f'<figcaption>{escape(picture.told)}</figcaption></figure>'
    )


def _repeat(files: Sequence[BenchFile], command: str) -> str:
    """How to repeat it, where it ran, and how to read it."""
    commands = '\n'.join([*(file.result.command for file in files), command])
    machines = groupby(
        sorted(files, key=lambda file: sorted(file.environment.items())),
        key=lambda file: file.environment,
    )
    told = ''.join(
        facts({'benches': ', '.join(file.result.bench for file in group), **environment})
        for environment, group in machines
    )
    return (
        f'<section><h2>Repeat it</h2><pre>{escape(commands)}</pre>{told}</section>'
        f'<section><h2>How to read this</h2>{listed(READING, "notes")}</section>'
    )
