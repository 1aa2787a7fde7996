# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""The whole package on one page: every bench's figures, aims held and missed, speed and error."""

import os
from collections.abc import Iterable, Sequence
from html import escape
from itertools import groupby
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmarks.harness.rows import BenchFile, Row
from tactile_ros import __version__
from tactile_ros.calibration import write_atomically
from tactile_ros.evaluation.figures import (
    LEFT,
    LETTER,
    TOP,
    Figure,
    Plot,
    file_name,
    rounded,
    write_figures,
    write_png,
)
from tactile_ros.evaluation.report import render_page

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
    'hands': 'Hands: Allegro by their shipped files',
    'latency': 'Delay and cost of a grip',
    'fidelity': 'Fidelity of the models',
    'roads': 'Live, in one process, offline: one result',
    'replay': 'Replay of bags',
}  # in this order; others follow by name
COLUMNS = ('published', 'peer', 'ours', 'bound', 'aim', '', 'µs, one', 'µs, of a batch')
MARKS = {None: '', True: '✓ held', False: '✗ missed'}
SUMMARY_COLUMNS = ('figure', 'ours', 'unit', 'simple method', 'published', 'aim', 'command')
# bench on real recordings, how its row begins there, and the words of the README's table
HEADLINES = (
    ('reskin', 'place, held-out grid points:', 'position, unseen grid points'),
    ('reskin', 'place, held-out grid points, last pass:',
     'position, unseen points in an unseen pass'),
    ('reskin', 'shear force, chronological', 'shear force, chronological 80/20'),
    ('reskin', 'shear force, unseen half', 'shear force, other half of the run'),
    ('reskin', 'normal force, unseen run:', 'normal force, unseen run, fit on one other'),
    ('grasp', 'slip, contiguous folds: balanced', 'slip or hold, balanced accuracy'),
)  # fmt: skip
LOG_RATIO = 20.0  # ratio of errors from which their axis is logarithmic
HEIGHT = 14.0  # pixels of a line of a label
SHIFTS = (-16.0, 18.0, -30.0, 32.0, -44.0, 46.0)  # pixels, of labels from their marks
WIDTH, STRIP_HEIGHT, EDGE = 96.0, 12.0, 4.0  # pixels, of the values by seed
Box = tuple[float, float, float, float]  # middle and size (pixels)


def number(value: float | None, beside: float | None = None) -> str:
    """Write a value with three digits, or as many as distinguish it from another."""
    if value is None:
        return '–'
    for digits in range(3, 12):
        text = rounded(value, digits)
        if beside in (None, value) or text != rounded(beside or 0.0, digits):
            break
    return text


def unit_of(unit: str) -> str:
    """A unit as a page writes it; empty: a plain number."""
    return {'1': '', 'us': 'µs', 'uT': 'µT'}.get(unit, unit)


def deviation(value: float | None) -> str:
    """A standard deviation behind its figure, with one digit; empty: none, or 0."""
    return f' ± {rounded(value, 1)}' if value else ''


def title_of(bench: str) -> str:
    """Headline of a bench."""
    return TITLES.get(bench, bench.replace('_', ' '))


def aim_of(row: Row) -> str:
    """Aim of a row with its sign."""
    return f'{"≤" if row.better == "low" else "≥"} {number(row.aim)}'


class Method(NamedTuple):
    """A method on data: its name, time (us), error or score, and its deviation over seeds."""

    name: str
    us: float
    error: float
    spread: float


class Contest(NamedTuple):
    """Methods on the same data, in one unit; `high`: not errors, but what should be large."""

    title: str
    unit: str
    methods: tuple[Method, ...]
    high: bool = False
    aim: float | None = None


def contests(rows: Iterable[Row]) -> list[Contest]:
    """What can be drawn: at least two methods whose time is known on the same data."""
    groups: dict[tuple[str, str, bool], list[Method]] = {}
    aims: dict[str, float] = {}
    for row in rows:
        if row.compared and row.ours is not None and row.us_single:
            method = Method(row.method, row.us_single, row.ours, row.spread or 0.0)
            groups.setdefault((row.compared, row.unit, row.better == 'high'), []).append(method)
            if row.aim is not None:
                aims[row.compared] = row.aim
    return [
        Contest(title, unit_of(unit), tuple(found), high, aims.get(title))
        for (title, unit, high), found in groups.items()
        if len(found) > 1
    ]


def front(methods: Iterable[Method], high: bool = False) -> list[Method]:
    """Methods than which none is both faster and better, fastest first."""
    sign = -1 if high else 1
    found: list[Method] = []
    for method in sorted(methods, key=lambda m: (m.us, sign * m.error)):
        if not found or sign * method.error < sign * found[-1].error:
            found.append(method)
    return found


def pareto(contest: Contest) -> Figure:
    """Every method of a contest, with bars over seeds, and a line through those of the front."""
    shown = [m for m in contest.methods if m.error > 0 or contest.high]
    exact = [m for m in contest.methods if m not in shown]
    best = front(contest.methods, contest.high)
    plot = _axes(contest, shown)
    kept = [m for m in best if m in shown]
    plot.line(np.array([m.us for m in kept]), np.array([m.error for m in kept]), 'line ink')
    if contest.aim is not None and plot.y.values[0] < contest.aim < plot.y.values[1]:
        plot.line(np.array(plot.x.values), np.full(2, contest.aim), 'rule')
        plot.text(plot.x.values[0], contest.aim, 'aim', shift=-8)
    for method in shown:
        kind = 'c0' if method in best else 'c1'
        if method.spread:
            ends = method.error + method.spread * np.array([-1.0, 1.0])
            plot.line(np.full(2, method.us), np.maximum(ends, plot.y.values[0]), f'line {kind}')
        plot.mark(method.us, method.error, 0 if method in best else 2, f'fill {kind}')
    for row, method in enumerate(exact):
        plot.rule(method.us, method.name, row=row)
    named = _name(plot, sorted(shown, key=lambda m: (m not in best, m.us)), exact)
    key = (('c0', 'nobody is faster and better'), ('c1', 'beaten in both'))
    text = _finding(contest, best)
    if any(method.spread for method in shown):
        text += ' Bars: one standard deviation over seeds.'
    if left := len(shown) - named:
        text += f' Marks without a name, since they lie close: {left}.'
    return Figure(contest.title, text, (plot,), key)


def _axes(contest: Contest, shown: list[Method]) -> Plot:
    """Axes with room for labels; errors over more than a decade or so are logarithmic."""
    us = np.array([m.us for m in contest.methods])
    high = np.array([m.error + m.spread for m in shown] or [1.0])
    low = np.array([m.error for m in shown] or [1.0])
    log = not contest.high and float(high.max()) > LOG_RATIO * float(low.min())
    tall = (0.4 * low.min(), 3 * high.max()) if log else (0.0, 1.3 * high.max())
    if contest.high:
        least = min(m.error - m.spread for m in shown)
        room = max(0.3 * (high.max() - least), 1e-3 * abs(high.max()), 1e-12)
        tall = (least - room, high.max() + room)
    room = (us.max() / us.min()) ** 0.18 * 1.5
    unit = f'({contest.unit})' if contest.unit else ''
    return Plot(
        (us.min() / room, us.max() * room), (float(tall[0]), float(tall[1])),
        'time of a frame (µs)', f'{"value" if contest.high else "error"} {unit}',
        (480, 330), log_x=True, log_y=log, description=f'Error against time: {contest.title}',
    )  # fmt: skip


def _name(plot: Plot, methods: list[Method], ruled: list[Method]) -> int:
    """Write names for which there is room, the first ones first; how many."""
    taken = [(float(plot.x(m.us)), float(plot.y(m.error)), 12.0, 10.0) for m in methods]
    for row, method in enumerate(ruled):
        wide, at = LETTER * len(method.name), float(plot.x(method.us))
        side = 1 if at + 11 + wide <= plot.size[0] else -1
        taken.append((at + (5 + wide / 2) * side, TOP + 7 + 15 * row, wide, HEIGHT))
    named = 0
    for method in methods:
        wide, at = LETTER * len(method.name), float(plot.x(method.us))
        x = float(np.clip(at, LEFT + wide / 2, plot.size[0] - wide / 2))
        for y in (float(plot.y(method.error)) + shift for shift in SHIFTS):
            inside = TOP + 6 < y < plot.y.pixels[0] - 4
            if inside and all(_apart((x, y, wide, HEIGHT), box) for box in taken):
                taken.append((x, y, wide, HEIGHT))
                plot.text(plot.x.value(x), plot.y.value(y), method.name, 'middle')
                named += 1
                break
    return named


def _apart(one: Box, other: Box) -> bool:
    """Whether two boxes leave each other free."""
    return any(abs(one[k] - other[k]) > (one[k + 2] + other[k + 2]) / 2 for k in (0, 1))


def _finding(contest: Contest, best: list[Method]) -> str:
    """What the drawing shows, in a sentence."""
    top, fastest = best[-1], best[0]
    values = [f'{number(method.error)} {contest.unit}'.strip() for method in (top, fastest)]
    verb, other = ('is best', 'reaches') if contest.high else ('errs least', 'errs')
    text = f'{top.name} {verb} ({values[0]}) at {number(top.us)} µs'
    if fastest is not top:
        text += f'; {fastest.name} is fastest ({number(fastest.us)} µs) and {other} {values[1]}'
    return f'{text}. {"Up" if contest.high else "Down"} and left is better.'


def strip(row: Row) -> str:
    """Dots at the values by seed, a bar of one deviation to either side, a line at the aim.

    Empty where there are not several values, or all are one.
    """
    if not row.spread or row.ours is None:
        return ''
    bar = row.ours + row.spread * np.array([-1.0, 1.0])
    shown = np.array([*row.by_seed, *bar, *([] if row.aim is None else [row.aim])])
    x = EDGE + (shown - shown.min()) / np.ptp(shown) * (WIDTH - 2 * EDGE)
    count, middle = len(row.by_seed), STRIP_HEIGHT / 2
    dots = ''.join(f'M{at:.1f} {middle}h0' for at in x[:count])
    line = ''.join(
        f'<path class="rule" d="M{at:.1f} 0V{STRIP_HEIGHT:g}"/>' for at in x[count + 2 :]
    )
    text = escape('by seed: ' + ', '.join(map(number, row.by_seed)))
    return (
        f'<svg class="strip" viewBox="0 0 {WIDTH:g} {STRIP_HEIGHT:g}" role="img" '
        f'aria-label="{text}"><title>{text}</title>'
        f'<path class="line c0" d="M{x[count]:.1f} {middle}H{x[count + 1]:.1f}"/>'
        f'<path class="dots c0" d="{dots}"/>{line}</svg>'
    )


def markdown(files: Sequence[BenchFile]) -> tuple[list[str], list[str]]:
    """Lines of the README's table from results of benches, and figures that none of them has."""
    rows = {file.result.bench: file.result.rows for file in files}
    table, missing = [SUMMARY_COLUMNS, ['---'] * len(SUMMARY_COLUMNS)], []
    for bench, begins, words in HEADLINES:
        every = rows.get(bench, ())
        row = next((row for row in every if row.what.strip().startswith(begins)), None)
        if row is None or row.ours is None:
            missing.append(f'{bench}: {begins}')
            continue
        published, peer = ('' if x is None else number(x) for x in (row.paper, row.peer))
        ours = f'**{number(row.ours, row.aim)}**{deviation(row.spread)}'
        aim = '' if row.aim is None else aim_of(row) + ', missed' * (row.held is False)
        unit = '' if row.unit in ('1', 'ratio') else row.unit
        table.append([words, ours, unit, peer, published, aim, f'`tactile bench {bench}`'])
    return [f'| {" | ".join(line)} |' for line in table], missing


def write_package_report(
    path: str | os.PathLike[str], files: Sequence[BenchFile], problems: Sequence[str], command: str
) -> Path:
    """Write the page (.html), which `command` makes again, with what could not be read."""
    return write_atomically(path, render_package(files, problems, command).encode())


def render_package(files: Sequence[BenchFile], problems: Sequence[str], command: str) -> str:
    """HTML of the whole page."""
    place = {name: i for i, name in enumerate(TITLES)}
    files = sorted(files, key=lambda f: (place.get(f.result.bench, len(place)), f.result.bench))
    rows = [row for file in files for row in file.result.rows]
    aims = [row.held for row in rows if row.held is not None]
    machines = groupby(
        sorted(files, key=lambda file: sorted(file.environment.items())),
        key=lambda file: file.environment,
    )
    return render_page(
        Path(__file__).with_name('package.html'),
        title=f'tactile_ros {__version__}: what it reaches, and what it misses',
        headline=headline(files), count=len(rows), aims=len(aims), held=sum(aims),
        missed=[
            (row.what.strip(), title_of(file.result.bench),
             f'{number(row.ours, row.aim)} {unit_of(row.unit)}', aim_of(row))
            for file in files for row in file.result.rows if row.held is False
        ],
        contests=[pareto(contest) for contest in contests(rows)],
        benches=[_bench(file) for file in files], problems=problems, command=command,
        machines=[
            {'benches': ', '.join(file.result.bench for file in group), **environment}
            for environment, group in machines
        ],
    )  # fmt: skip


def headline(files: Sequence[BenchFile]) -> list[tuple[str, str, str]]:
    """Key figures as (value, unit, words)."""
    rows = [row for file in files for row in file.result.rows]
    aims, papers, peers = (
        [held for row in rows if (held := row.reaches(getattr(row, name))) is not None]
        for name in ('aim', 'paper', 'peer')
    )
    return [
        (f'{sum(aims)}', f'of {len(aims)}', 'aims held'),
        (f'{len(aims) - sum(aims)}', '', 'aims missed'),
        (f'{sum(papers)}', f'of {len(papers)}', 'at least as good as published'),
        (f'{sum(peers)}', f'of {len(peers)}', 'at least as good as the peer in the same run'),
    ]


def _bench(file: BenchFile) -> dict[str, object]:
    """Tables and drawings of a bench for the template."""
    rows = file.result.rows
    anchor = ''.join(c if c.isalnum() else '-' for c in file.result.bench)
    return {
        'title': title_of(file.result.bench), 'anchor': f'bench-{anchor}', 'result': file.result,
        'judged': _table([row for row in rows if not row.paper is row.aim is None]),
        'others': _table([row for row in rows if row.paper is row.aim is None]),
        'pictures': file.pictures,
    }  # fmt: skip


def _table(rows: Sequence[Row]) -> dict[str, object]:
    """Rows of figures for the template; columns that nobody fills are left out."""
    cells = [
        [
            number(row.paper), number(row.peer),
            f'{number(row.ours, row.aim)}{deviation(row.spread)}', number(row.bound),
            number(row.aim), MARKS[row.held], number(row.us_single), number(row.us_batch),
        ]
        for row in rows
    ]  # fmt: skip
    kept = [i for i in range(len(COLUMNS)) if any(line[i] not in ('', '–') for line in cells)]
    lines = []
    for row, line in zip(rows, cells, strict=True):
        kinds = {2: 'ours', 5: {True: 'held', False: 'missed', None: ''}[row.held]}
        lines.append({
            'under': row.what.startswith(' '), 'what': row.what.strip(),
            'unit': unit_of(row.unit),
            'cells': [(line[i], kinds.get(i, ''), strip(row) if i == 2 else '') for i in kept],
        })  # fmt: skip
    return {'columns': [COLUMNS[i] for i in kept], 'rows': lines}


def write_pictures(folder: Path, files: Sequence[BenchFile]) -> Iterable[Path]:
    """Write the drawings of all benches as PNG; yield each path when it is there."""
    rows = [row for file in files for row in file.result.rows]
    yield from write_figures(folder, map(pareto, contests(rows)))
    for file in files:
        for picture in file.pictures:
            name = f'{file.result.bench}_{file_name(picture.name)}.png'
            yield write_png(folder / name, picture.svg.decode(errors='replace'))
