"""Error, or score, against time of all methods on the same data: whom nobody beats in both."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from tactile_ros.evaluation.figure import Figure
from tactile_ros.evaluation.page import number, unit_of
from tactile_ros.evaluation.svg import LEFT, TOP, Plot

if TYPE_CHECKING:
    from collections.abc import Iterable

    from tactile_ros.evaluation.benchmark import Row

LETTER, HEIGHT = 6.4, 14.0  # pixels that a letter and a line of a label take
WIDE = 20.0  # ratio of errors from which their axis is logarithmic
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
    log = not contest.high and float(high.max()) > WIDE * float(low.min())
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
