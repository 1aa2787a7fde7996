"""Every drawing that a recording has data for: honesty, speed and delay here, the rest beside."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy import stats

from tactile_ros.evaluation.class_figures import confusions
from tactile_ros.evaluation.figure import MM, Colours, Figure, accepted, shown, title_of
from tactile_ros.evaluation.force_figures import force_scatter, force_trace
from tactile_ros.evaluation.memory_figures import drift, hysteresis
from tactile_ros.evaluation.page import number
from tactile_ros.evaluation.place_figures import error_map, histogram
from tactile_ros.evaluation.svg import Plot

if TYPE_CHECKING:
    from tactile_ros.evaluation.result import Dataset, Result

LABEL = (84.0, 15.0)  # pixels that the name of an estimator takes


def honesty(dataset: Dataset) -> Figure | None:
    """Share of errors within k sigma against what a normal distribution has there."""
    targets = [t for t in dataset.answers[0].targets if t.coverage.count]
    if not targets:
        return None
    expected = np.linspace(0, 1, 41)
    limits = stats.norm.ppf(0.5 + expected[:-1] / 2)
    plot = Plot((0, 100), (0, 100), 'stated (%)', 'found (%)', (360, 270),
                told='Found against stated share of errors within k sigma')  # fmt: skip
    ends = np.array([0.0, 100.0])
    plot.band(ends, ends - 5, ends + 5, 'band ink')
    for i, target in enumerate(targets[:4]):
        stated = target.variance > 0
        ratio = np.abs(target.error[stated] / np.sqrt(target.variance[stated]))
        ratio = np.sort(ratio[np.isfinite(ratio)])
        if not len(ratio):
            continue
        share = np.searchsorted(ratio, limits, side='right') / len(ratio)
        plot.line(100 * expected, 100 * np.append(share, 1.0), f'line c{i}')
    plot.rule(100 * 0.6827, '1 sigma', 'rule')
    told = '; '.join(
        f'{title_of(t)} {100 * t.coverage.share:.0f} % (accepted {accepted(t)}, '
        f'{t.coverage.groups} groups)'
        for t in targets
    )
    key = tuple((f'c{i}', title_of(t)) for i, t in enumerate(targets[:4]))
    return Figure(
        'Are the covariances honest?',
        f'Inside one sigma: {told}. On the diagonal the stated errors are the real ones; '
        'the grey band is 5 points wide on either side.',
        str(plot),
        key,
    )


def speed(dataset: Dataset, colours: Colours) -> Figure | None:
    """Error of every estimator against its time per frame."""
    name = dataset.answers[0].targets[0].name if dataset.answers[0].targets else ''
    found = [(a, a.target(name)) for a in dataset.competitors if a.us_single > 0]
    points = [
        (a.name, a.us_single, shown(t)) for a, t in found if t is not None and t.spread.count
    ]
    if not points:
        return None
    cost, error = [p[1] for p in points], [p[2] for p in points]
    unit = 'mean place error (mm)' if name == 'position' else 'RMSE (N)'
    plot = Plot((min(cost) / 2.5, max(cost) * 4), (0, 1.25 * max(error)), 'time per frame (µs)',
                unit, log_x=True, told='Error against time per frame')  # fmt: skip
    spots = [(float(plot.x(us)), float(plot.y(value)) - 17) for _, us, value in points]
    for (words, us, value), shift in zip(points, _apart(spots), strict=True):
        colour = colours[words]
        plot.mark(us, value, int(colour[1:]), f'fill {colour}')
        plot.text(us, value, words, 'middle', shift=shift - 17)
    best = min(points, key=lambda p: p[2])
    fastest = min(points, key=lambda p: p[1])
    caption = f'{best[0]} errs least ({best[2]:.2f}) at {best[1]:.0f} µs a frame'
    if fastest is not best:
        caption += f'; {fastest[0]} is fastest ({fastest[1]:.0f} µs) and errs {fastest[2]:.2f}'
    return Figure('Speed against error', f'{caption}. Down and left is better.', str(plot))


def _apart(spots: list[tuple[float, float]]) -> list[float]:
    """How far to move labels (pixels, up is negative) so that none lies on another."""
    placed: list[tuple[float, float]] = []
    shifts = [0.0] * len(spots)
    for i in sorted(range(len(spots)), key=lambda k: -spots[k][1]):
        x, y = spots[i]
        while any(abs(x - a) < LABEL[0] and abs(y - b) < LABEL[1] for a, b in placed):
            y -= 1.0
        placed.append((x, y))
        shifts[i] = y - spots[i][1]
    return shifts


def delays(dataset: Dataset) -> Figure | None:
    """Distribution of the time from acquisition to contact."""
    delay = dataset.latency
    if not delay.count:
        return None
    top = 1.3 * delay.p99 * MM
    edges = np.linspace(0, top, 46)
    share = 100 * np.histogram(dataset.latency_s * MM, edges)[0] / len(dataset.latency_s)
    plot = Plot((0, top), (0, 1.15 * float(share.max())), 'from acquisition to contact (ms)',
                'share of frames (%)', told='Distribution of the latency')  # fmt: skip
    plot.bars(edges, share, 'fill c2')
    plot.rule(delay.p50 * MM, f'half below {delay.p50 * MM:.2f} ms')
    plot.rule(delay.p99 * MM, f'99 % below {delay.p99 * MM:.2f} ms', row=1)
    return Figure(
        'How late a contact is',
        f'{delay.count} contacts, at worst {delay.largest * MM:.1f} ms; '
        f'{dataset.dropped} of {dataset.frames + dataset.dropped} frames were lost on the way.',
        str(plot),
    )


def figures_of(dataset: Dataset, colours: Colours) -> list[Figure]:
    """Every drawing that a recording has data for, each estimator in its colour."""
    first = colours[dataset.answers[0].name]
    varying = {t.name for t in dataset.answers[0].targets if t.varies}
    forces = [name for name in ('force_z', 'force_x', 'force_y') if name in varying]
    drawn = [
        error_map(dataset),
        histogram(dataset, colours),
        *(force_scatter(dataset, name, first) for name in forces),
        honesty(dataset),
        speed(dataset, colours),
        delays(dataset),
        *confusions(dataset),
        *(hysteresis(dataset, name) for name in forces),
        *(drift(dataset, name, first) for name in forces),
        *(force_trace(dataset, name, first) for name in forces),
    ]
    return [figure for figure in drawn if figure is not None]


def colours_of(result: Result) -> Colours:
    """A colour for every estimator, the same throughout a report."""
    names = dict.fromkeys(a.name for d in result.datasets for a in d.answers)
    return {name: f'c{min(i, 4)}' for i, name in enumerate(names)}


def headline(result: Result) -> list[tuple[str, str, str]]:
    """Key figures as (value, unit, words): the first answer of the first recording with each."""
    wanted = (
        ('position', 'mm', 'mean error of place'),
        ('force_z', 'N', 'RMSE of normal force'),
        ('force_x', 'N', 'RMSE of shear force'),
        ('force_y', 'N', 'RMSE of shear force y'),
    )
    found = []
    for name, unit, words in wanted:
        targets = [d.answers[0].target(name) for d in result.datasets if d.answers]
        known = [t for t in targets if t is not None and t.spread.count and t.varies]
        if known:
            found.append((f'{shown(known[0]):.2f}', unit, words))
    delay = next((d.latency for d in result.datasets if d.latency.count), None)
    if delay is not None:
        p50, p99 = number(delay.p50 * MM), number(delay.p99 * MM)
        found.append((p50, 'ms', f'latency (p99 {p99} ms)'))
    lost, frames = (sum(getattr(d, k) for d in result.datasets) for k in ('dropped', 'frames'))
    return [*found, (f'{lost}', '', f'of {lost + frames} frames lost')]
