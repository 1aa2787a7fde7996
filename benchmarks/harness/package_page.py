"""The whole package on one page: every bench's figures, aims held and missed, speed and error."""

from __future__ import annotations

import base64
from html import escape
from itertools import groupby
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from tactile_ros import __version__
from tactile_ros.calibration import write_beside
from tactile_ros.evaluation.browser import photograph
from tactile_ros.evaluation.figure import Figure
from tactile_ros.evaluation.page import (
    deviation,
    document,
    drawn,
    facts,
    listed,
    number,
    tiles,
    unit_of,
)
from tactile_ros.evaluation.pictures import MARGIN, file_name, light_page, write_figures
from tactile_ros.evaluation.svg import LEFT, TOP, Plot

if TYPE_CHECKING:
    import os
    from collections.abc import Iterable, Sequence
    from pathlib import Path

    from benchmarks.harness.rows import BenchFile, Picture, Row

LETTER, HEIGHT = 6.4, 14.0  # pixels that a letter and a line of a label take
LOG_RATIO = 20.0  # ratio of errors from which their axis is logarithmic
Box = tuple[float, float, float, float]  # middle and size (pixels)
SHIFTS = (-16.0, 18.0, -30.0, 32.0, -44.0, 46.0)  # pixels, of labels from their marks


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
    return Figure(contest.title, text, str(plot), key)


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
        (480, 330), log_x=True, log_y=log, told=f'Error against time: {contest.title}',
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
    line = ''.join(
        f'<path class="rule" d="M{x(value):.1f} 0V{STRIP_HEIGHT:g}"/>' for value in aim
    )
    told = 'by seed: ' + ', '.join(number(value) for value in values.tolist())
    return (
        f'<svg class="strip" viewBox="0 0 {WIDTH:g} {STRIP_HEIGHT:g}" role="img" '
        f'aria-label="{escape(told)}"><title>{escape(told)}</title>'
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


def image_of(picture: Picture) -> str:
    """A bench's own drawing as an image: nothing in it can run or fetch."""
    data = base64.b64encode(picture.svg).decode()
    return (
        f'<img alt="{escape(picture.told or picture.name)}" '
        f'width="{picture.size[0]:.0f}" height="{picture.size[1]:.0f}" '
        f'src="data:image/svg+xml;base64,{data}">'
    )


def write_pictures(folder: Path, files: Sequence[BenchFile]) -> Iterable[Path]:
    """Write the drawings of all benches as PNG; yield each path when it is there."""
    rows = [row for file in files for row in file.result.rows]
    yield from write_figures(folder, map(pareto, contests(rows)))
    for file in files:
        for picture in file.pictures:
            name = f'{file.result.bench}_{file_name(picture.name)}.png'
            size = round(picture.size[0]), round(picture.size[1])
            image = image_of(picture).replace('<img', '<img style="margin:0"')
            page = light_page(image).replace(f'padding: {MARGIN}px', 'padding: 0')
            yield photograph(page, folder / name, size)
