"""Error against time of all methods on the same data: which of them nobody beats in both."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from tactile_ros.evaluation.figure import Figure
from tactile_ros.evaluation.page import number
from tactile_ros.evaluation.svg import LEFT, TOP, Plot

if TYPE_CHECKING:
    from collections.abc import Iterable

    from tactile_ros.evaluation.benchmark import Row

LETTER, HEIGHT = 6.4, 14.0  # pixels that a letter and a line of a label take
WIDE = 20.0  # ratio of errors from which their axis is logarithmic
SHIFTS = (-16.0, 18.0, -30.0, 32.0, -44.0, 46.0)  # pixels, of labels from their marks


class Method(NamedTuple):
    """A method on data: its name, time (us), error, and the error's deviation over seeds."""

    name: str
    us: float
    error: float
    spread: float


class Contest(NamedTuple):
    """Methods on the same data, in one unit."""

    title: str
    unit: str
    methods: tuple[Method, ...]


def contests(rows: Iterable[Row]) -> list[Contest]:
    """What can be drawn: at least two methods whose time is known on the same data."""
    groups: dict[tuple[str, str], list[Method]] = {}
    for row in rows:
        if row.compared and row.ours is not None and row.us_single and row.better == 'low':
            method = Method(row.method, row.us_single, row.ours, row.spread or 0.0)
            groups.setdefault((row.compared, row.unit), []).append(method)
    return [Contest(*key, tuple(found)) for key, found in groups.items() if len(found) > 1]


def front(methods: Iterable[Method]) -> list[Method]:
    """Methods than which none is both faster and better, fastest first.

    Examples
    --------
    >>> slow, fast, worse = Method('a', 9, 1, 0), Method('b', 1, 3, 0), Method('c', 2, 4, 0)
    >>> [method.name for method in front([slow, fast, worse])]
    ['b', 'a']
    """
    found: list[Method] = []
    for method in sorted(methods, key=lambda m: (m.us, m.error)):
        if not found or method.error < found[-1].error:
            found.append(method)
    return found


def pareto(contest: Contest) -> Figure:
    """Every method of a contest, with bars over seeds, and a line through those of the front."""
    shown = [m for m in contest.methods if m.error > 0]
    exact = [m for m in contest.methods if m.error <= 0]
    best = front(contest.methods)
    plot = _axes(contest, shown)
    kept = [m for m in best if m.error > 0]
    plot.line(np.array([m.us for m in kept]), np.array([m.error for m in kept]), 'line ink')
    for method in shown:
        kind = 'c0' if method in best else 'c1'
        _bar(plot, method, kind)
        plot.mark(method.us, method.error, 0 if method in best else 2, f'fill {kind}')
    for row, method in enumerate(exact):
        plot.rule(method.us, method.name, row=row)
    named = _labels(plot, sorted(shown, key=lambda m: (m not in best, m.us)))
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
    log = float(high.max()) > WIDE * float(low.min())
    tall = (0.4 * low.min(), 3 * high.max()) if log else (0.0, 1.3 * high.max())
    room = (us.max() / us.min()) ** 0.18 * 1.5
    return Plot(
        (us.min() / room, us.max() * room), (float(tall[0]), float(tall[1])),
        'time of a frame (µs)', f'error ({contest.unit})', (480, 330), log_x=True, log_y=log,
        told=f'Error against time: {contest.title}',
    )  # fmt: skip


def _bar(plot: Plot, method: Method, kind: str) -> None:
    """One standard deviation to either side."""
    if method.spread:
        ends = method.error + method.spread * np.array([-1.0, 1.0])
        ends = np.maximum(ends, plot.y.values[0])
        plot.line(np.full(2, method.us), ends, f'line {kind}')


def _labels(plot: Plot, methods: list[Method]) -> list[tuple[Method, float, float]]:
    """Places of names (in values) of those for which there is room, the first ones first."""
    taken = [
        (float(plot.x(m.us)), float(plot.y(m.error)), 12.0, 10.0) for m in methods
    ]  # the marks themselves: middle and size
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


def _apart(label: tuple[float, float, float], other: tuple[float, float, float, float]) -> bool:
    """Whether a label (middle, width) leaves another box (middle, size) free."""
    x, y, wide = label
    a, b, across, tall = other
    return abs(x - a) > (wide + across) / 2 or abs(y - b) > (HEIGHT + tall) / 2


def _finding(contest: Contest, best: list[Method]) -> str:
    """What the drawing shows, in a sentence."""
    least, fastest = best[-1], best[0]
    errs = [f'{number(method.error)} {contest.unit}' for method in (least, fastest)]
    text = f'{least.name} errs least ({errs[0]}) at {number(least.us)} µs'
    if fastest is not least:
        text += f'; {fastest.name} is fastest ({number(fastest.us)} µs) and errs {errs[1]}'
    return f'{text}. Down and left is better.'
