"""The figures that stand for the whole package, as the Markdown table of the README."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from tactile_ros.evaluation.page import deviation, number

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from tactile_ros.evaluation.bench_files import BenchFile
    from tactile_ros.evaluation.benchmark import Row


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
COLUMNS = (
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
    lines = [_line(COLUMNS), _line(['---'] * len(COLUMNS))]
    missing = []
    for told in HEADLINES:
        row = _find(rows.get(told.bench, ()), told.begins)
        if row is None or row.ours is None:
            missing.append(f'{told.bench}: {told.begins}')
        else:
            lines.append(_line([told.of, told.words, *_cells(row)]))
    return lines, missing


def _find(rows: Iterable[Row], begins: str) -> Row | None:
    return next((row for row in rows if row.what.strip().startswith(begins)), None)


def _cells(row: Row) -> list[str]:
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
