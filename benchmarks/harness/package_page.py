# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""The whole package on one page: every bench's figures, aims held and missed, speed and error."""

from __future__ import annotations

from html import escape
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

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

if TYPE_CHECKING:
    import os
    from collections.abc import Iterable, Sequence

    from benchmarks.harness.rows import BenchFile, Row

HEIGHT = 14.0  # pixels of a line of a label
LOG_RATIO = 20.0  # ratio of errors from which their axis is logarithmic
Box = tuple[float, float, float, float]  # middle and size (pixels)
SHIFTS = (-16.0, 18.0, -30.0, 32.0, -44.0, 46.0)  # pixels, of labels from their marks


def number(value: float | None, beside: float | None = None) -> str:
    """Write a value with three digits, or as many as distinguish it from another."""
    if value is None:
        return '–'
    for digits in range(3, 12):
        text = rounded(value, digits)
        if beside in (None, value) or text != rounded(beside or 0.0, digits):
            break
    return text


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


def contests(rows: Iterable[Row]) -> list[Contest]:
    """What can be drawn: at least two methods whose time is known on the same data."""
    groups: dict[tuple[str, str, bool], list[Method]] = {}
    for row in rows:
        if row.compared and row.ours is not None and row.us_single:
            method = Method(row.method, row.us_single, row.ours, row.spread or 0.0)
            groups.setdefault((row.compared, row.unit, row.better == 'high'), []).append(method)
    return [
        Contest(title, unit_of(unit), tuple(found), high)
        for (title, unit, high), found in groups.items()
        if len(found) > 1
    ]


def front(methods: Iterable[Method], high: bool = False) -> list[Method]:
    """Methods than which none is both faster and better, fastest first.

    Examples
    --------
    >>> slow, fast, worse = Method('a', 9, 1, 0), Method('b', 1, 3, 0), Method('c', 2, 4, 0)
    >>> [method.name for method in front([slow, fast, worse])]
    ['b', 'a']
    """
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
    for method in shown:
        kind = 'c0' if method in best else 'c1'
        _bar(plot, method, kind)
        plot.mark(method.us, method.error, 0 if method in best else 2, f'fill {kind}')
    for row, method in enumerate(exact):
        plot.rule(method.us, method.name, row=row)
    ruled = [_rule_box(plot, method, row) for row, method in enumerate(exact)]
    named = _labels(plot, sorted(shown, key=lambda m: (m not in best, m.us)), ruled)
    for method, x, y in named:
        plot.text(float(x), float(y), method.name, 'middle')
    key = (('c0', 'nobody is faster and better'), ('c1', 'beaten in both'))
    text = _finding(contest, best)
    if any(method.spread for method in shown):
        text += ' Bars: one standard deviation over seeds.'
    if left := len(shown) - len(named):
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


def _bar(plot: Plot, method: Method, kind: str) -> None:
    """One standard deviation to either side."""
    if method.spread:
        ends = method.error + method.spread * np.array([-1.0, 1.0])
        ends = np.maximum(ends, plot.y.values[0])
        plot.line(np.full(2, method.us), ends, f'line {kind}')


def _rule_box(plot: Plot, method: Method, row: int) -> Box:
    """Where the name beside a rule stands."""
    wide, at = LETTER * len(method.name), float(plot.x(method.us))
    right = at + 11 + wide <= plot.size[0]
    return at + (5 + wide / 2) * (1 if right else -1), TOP + 7 + 15 * row, wide, HEIGHT


def _labels(
    plot: Plot, methods: list[Method], ruled: list[Box]
) -> list[tuple[Method, float, float]]:
    """Places of names (in values) of those for which there is room, the first ones first."""
    marks = [(float(plot.x(m.us)), float(plot.y(m.error)), 12.0, 10.0) for m in methods]
    taken = [*marks, *ruled]
    found = []
    for method in methods:
        wide = LETTER * len(method.name)
        at = float(plot.x(method.us))
        x = float(np.clip(at, LEFT + wide / 2, plot.size[0] - wide / 2))
        tries = [(x, float(plot.y(method.error)) + shift) for shift in SHIFTS]
        free = [
            (a, b) for a, b in tries
            if TOP + 6 < b < plot.y.pixels[0] - 4 and all(_apart((a, b, wide), t) for t in taken)
        ]  # fmt: skip
        if free:
            x, y = free[0]
            taken.append((x, y, wide, HEIGHT))
            found.append((method, plot.x.value(x), plot.y.value(y)))
    return found


def _apart(label: tuple[float, float, float], other: Box) -> bool:
    """Whether a label (middle, width) leaves another box (middle, size) free."""
    x, y, wide = label
    a, b, across, tall = other
    return abs(x - a) > (wide + across) / 2 or abs(y - b) > (HEIGHT + tall) / 2


def _finding(contest: Contest, best: list[Method]) -> str:
    """What the drawing shows, in a sentence."""
    top, fastest = best[-1], best[0]
    values = [f'{number(method.error)} {contest.unit}'.strip() for method in (top, fastest)]
    verb, other = ('is best', 'reaches') if contest.high else ('errs least', 'errs')
    text = f'{top.name} {verb} ({values[0]}) at {number(top.us)} µs'
    if fastest is not top:
        text += f'; {fastest.name} is fastest ({number(fastest.us)} µs) and {other} {values[1]}'
    return f'{text}. {"Up" if contest.high else "Down"} and left is better.'


WIDTH, STRIP_HEIGHT, EDGE = 96.0, 12.0, 4.0


def strip(row: Row) -> str:
    """Dots at the values, a bar of one deviation to either side, a line at the aim.

    Empty where there are not several values, or all are one.
    """
    if not row.spread or row.ours is None:
        return ''
    values = np.array(row.by_seed)
    bar = row.ours + row.spread * np.array([-1.0, 1.0])
    aim = [] if row.aim is None else [row.aim]
    shown = np.array([*values, *bar, *aim])
    low, size = float(shown.min()), float(np.ptp(shown))

    def x(value: float) -> float:
        return EDGE + (value - low) / size * (WIDTH - 2 * EDGE)

    middle = STRIP_HEIGHT / 2
    dots = ''.join(f'M{x(value):.1f} {middle}h0' for value in values.tolist())
    line = ''.join(f'<path class="rule" d="M{x(value):.1f} 0V{STRIP_HEIGHT:g}"/>' for value in aim)
    text = 'by seed: ' + ', '.join(number(value) for value in values.tolist())
    return (
        f'<svg class="strip" viewBox="0 0 {WIDTH:g} {STRIP_HEIGHT:g}" role="img" '
        f'aria-label="{escape(text)}"><title>{escape(text)}</title>'
        f'<path class="line c0" d="M{x(bar[0]):.1f} {middle}H{x(bar[1]):.1f}"/>'
        f'<path class="dots c0" d="{dots}"/>{line}</svg>'
    )


class Headline(NamedTuple):
    """A figure of the table: of what, whose bench, how its row begins there, and its words."""

    of: str
    bench: str
    begins: str
    words: str


HEADLINES = tuple(
    Headline(of, bench, begins, words)
    for of, bench, rows in (
        ('boards', 'reskin', (
            ('place, held-out grid points:', 'place, unseen grid points'),
            ('place, held-out grid points, last pass:', 'place, unseen points, unseen last pass'),
            ('shear force, chronological', 'shear force, chronological 80/20'),
            ('shear force, unseen half', 'shear force, other half of the run, random rests'),
            ('normal force, unseen run:', 'normal force, unseen run (one to learn from)'),
        )),
        ('[1]', 'multipole_skin', (
            ('shape, new places, 9 heads: 20', 'shape of 9, unseen places, presses of one head'),
            ('new heads, nine old open, 1 shot', 'five new heads among the nine, 1 shot'),
            ('new heads, nine old open, 5 shots', 'five new heads among the nine, 5 shots'),
            ('pose of six, bar never pressed', 'pose of six, bar never pressed'),
        )),
        ('[1]', 'pronet', (
            ('network: 5 of 9 heads at held-out places, 5', 'network, unseen places, 5 shots'),
            ('network: five new heads, 1-shot', 'network, five new heads, 1 shot'),
        )),
        ('[2]', 'magnet_pad', (
            ('25 cells, near the centre: cells right', 'cell of 25, near its centre'),
            ('15 cells, anywhere: cells right', 'cell of 15, touched anywhere'),
            ('15 cells, anywhere: place', 'place, touched anywhere'),
            ('15 cells, near the centre: cells right, 0.5', 'cell of 15, 0.5 mT outside'),
        )),
        ('[3]', 'gradiometer', (
            ('Fz, 13000 points, rms', 'normal force, 13 000 points'),
            ('Fx, 300 points, rms', 'shear force, 300 points'),
            ('leak of 2 mT along x, no gains', 'leak of 2 mT, gains not known'),
            ('0..50 C over isothermal, disc lags', '0 to 50 °C over isothermal'),
        )),
        ('[4]', 'taxel_array', (
            ('washers of 5 types, 5 bad', 'washers of 5 types, 5 bad taxels'),
            ('pick and place: angle tubes', 'angle tubes, 16 taxels, picked'),
            ('spread of taxels', 'spread of taxels, equilibrated'),
            ('hold of 120 s: drift', 'drift in a hold of 120 s'),
        )),
        ('[5]', 'five_wire_skin', (
            ('place, 25 points, mean', 'place, 25 points'),
            ('force anywhere, 49 points, rms', 'force, anywhere'),
            ('force at 49 calibration squares, 8', 'force, at the squares of calibration'),
        )),
        ('grasp', 'grasp', (
            ('slip, contiguous folds: balanced', 'slip told from a hold (balanced accuracy)'),
            ('200 loads in hand, adaptive: held', 'share of 200 loads held'),
            ('allegro hand in MuJoCo: slowest', 'slowest grasp in MuJoCo, load to 5 %'),
        )),
        ('nodes', 'latency', (
            ('stack: delay p99', '1 kHz gradiometer in `stack`: p99'),
        )),
        ('nodes', 'multipole_graph', (
            ('two processes: sensor', '20 chips, two processes'),
        )),
        ('bags', 'replay', (
            ('replay against real time', 'replay, times real time'),
            ('largest difference to live', 'replay against live, largest difference'),
        )),
    )
    for begins, words in rows
)  # fmt: skip
SUMMARY_COLUMNS = (
    'of', 'figure', 'unit', 'published', 'paper’s method', 'ours', 'bound', 'aim', 'µs a frame',
)  # fmt: skip


def markdown(files: Sequence[BenchFile]) -> tuple[list[str], list[str]]:
    """The table from results of benches.

    Parameters
    ----------
    files : sequence of BenchFile
        As `bench_files.gather` gives them.

    Returns
    -------
    lines : list of str
        Of the table.
    missing : list of str
        Figures that no result has, which are left out of it.
    """
    rows = {file.result.bench: file.result.rows for file in files}
    lines = [_line(SUMMARY_COLUMNS), _line(['---'] * len(SUMMARY_COLUMNS))]
    missing = []
    for told in HEADLINES:
        row = _find(rows.get(told.bench, ()), told.begins)
        if row is None or row.ours is None:
            missing.append(f'{told.bench}: {told.begins}')
        else:
            lines.append(_line([told.of, told.words, *_summary_cells(row)]))
    return lines, missing


def _find(rows: Iterable[Row], begins: str) -> Row | None:
    return next((row for row in rows if row.what.strip().startswith(begins)), None)


def _summary_cells(row: Row) -> list[str]:
    """Cells from the unit on."""
    ours = f'**{number(row.ours, row.aim)}**{deviation(row.spread)}'
    sign = '≤' if row.better == 'low' else '≥'
    aim = '' if row.aim is None else f'{sign} {number(row.aim)}'
    missed = ', missed' if row.held is False else ''
    published, other, bound, us = (
        '' if value is None else number(value)
        for value in (row.paper, row.peer, row.bound, row.us_single)
    )
    unit = '' if row.unit in ('1', 'ratio') else row.unit
    return [unit, published, other, ours, bound, aim + missed, us]


def _line(cells: Iterable[str]) -> str:
    return f'| {" | ".join(cells)} |'


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
    'roads': 'Three roads, one number',
    'replay': 'Replay of bags',
}  # in this order; others follow by name
COLUMNS = ('published', 'peer', 'ours', 'bound', 'aim', '', 'µs, one', 'µs, of a batch')
MARKS = {None: '', True: '✓ held', False: '✗ missed'}


def unit_of(unit: str) -> str:
    """A unit as a page writes it; empty: a plain number."""
    return {'1': '', 'us': 'µs', 'uT': 'µT'}.get(unit, unit)


def deviation(value: float | None) -> str:
    """A standard deviation behind its figure, with one digit; empty: none, or 0.

    Examples
    --------
    >>> deviation(0.0123), deviation(11.8), deviation(None)
    (' ± 0.01', ' ± 12', '')
    """
    return f' ± {rounded(value, 1)}' if value else ''


def write_package_report(
    path: str | os.PathLike[str], files: Sequence[BenchFile], problems: Sequence[str], command: str
) -> Path:
    """Write the page (.html) of bench files; return its path.

    Parameters
    ----------
    path : path-like
        Its folder is made.
    files : sequence of BenchFile
        Results of benches.
    problems : sequence of str
        Sentences on what could not be read.
    command : str
        That makes this page again.
    """
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
        headline=headline(files),
        count=len(rows),
        aims=len(aims),
        held=sum(aims),
        missed=[_missed(file, row) for file in files for row in file.result.rows
                if row.held is False],
        contests=[pareto(contest) for contest in contests(rows)],
        benches=[_bench(file) for file in files],
        problems=problems,
        command=command,
        machines=[
            {'benches': ', '.join(file.result.bench for file in group), **environment}
            for environment, group in machines
        ],
    )  # fmt: skip


def title_of(bench: str) -> str:
    """Headline of a bench."""
    return TITLES.get(bench, bench.replace('_', ' '))


def headline(files: Sequence[BenchFile]) -> list[tuple[str, str, str]]:
    """Key figures as (value, unit, words)."""
    rows = [row for file in files for row in file.result.rows]
    aims = [row.held for row in rows if row.held is not None]
    papers = [held for row in rows if (held := row.reaches(row.paper)) is not None]
    peers = [held for row in rows if (held := row.reaches(row.peer)) is not None]
    return [
        (f'{sum(aims)}', f'of {len(aims)}', 'aims held'),
        (f'{len(aims) - sum(aims)}', '', 'aims missed'),
        (f'{sum(papers)}', f'of {len(papers)}', 'at least as good as published'),
        (f'{sum(peers)}', f'of {len(peers)}', 'at least as good as the peer in the same run'),
    ]


def _missed(file: BenchFile, row: Row) -> tuple[str, str, str, str]:
    """Figure, bench, value and aim of an aim that is missed."""
    ours = f'{number(row.ours, row.aim)} {unit_of(row.unit)}'
    aim = f'{"≤" if row.better == "low" else "≥"} {number(row.aim)}'
    return row.what.strip(), title_of(file.result.bench), ours, aim


def _bench(file: BenchFile) -> dict[str, object]:
    """Tables and drawings of a bench for the template."""
    rows = file.result.rows
    anchor = ''.join(c if c.isalnum() else '-' for c in file.result.bench)
    return {
        'title': title_of(file.result.bench),
        'anchor': f'bench-{anchor}',
        'result': file.result,
        'judged': table([row for row in rows if not row.paper is row.aim is None]),
        'others': table([row for row in rows if row.paper is row.aim is None]),
        'pictures': file.pictures,
    }


def table(rows: Sequence[Row]) -> dict[str, object]:
    """Rows of figures for the template; columns that nobody fills are left out."""
    cells = [_cells(row) for row in rows]
    kept = [i for i in range(len(COLUMNS)) if any(line[i] not in ('', '–') for line in cells)]
    lines = []
    for row, line in zip(rows, cells, strict=True):
        kinds = {2: 'ours', 5: {True: 'held', False: 'missed', None: ''}[row.held]}
        lines.append({
            'under': row.what.startswith(' '),
            'what': row.what.strip(),
            'unit': unit_of(row.unit),
            'cells': [(line[i], kinds.get(i, ''), strip(row) if i == 2 else '') for i in kept],
        })  # fmt: skip
    return {'columns': [COLUMNS[i] for i in kept], 'rows': lines}


def _cells(row: Row) -> list[str]:
    """Cells of `COLUMNS`."""
    ours = f'{number(row.ours, row.aim)}{deviation(row.spread)}'
    numbers = [number(row.paper), number(row.peer), ours, number(row.bound), number(row.aim)]
    return [*numbers, MARKS[row.held], number(row.us_single), number(row.us_batch)]


def write_pictures(folder: Path, files: Sequence[BenchFile]) -> Iterable[Path]:
    """Write the drawings of all benches as PNG; yield each path when it is there."""
    rows = [row for file in files for row in file.result.rows]
    yield from write_figures(folder, map(pareto, contests(rows)))
    for file in files:
        for picture in file.pictures:
            name = f'{file.result.bench}_{file_name(picture.name)}.png'
            yield write_png(folder / name, picture.svg.decode(errors='replace'))
