"""Drawings about place: where on the pad it errs, and how far. Millimetres here."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.evaluation.figure import MM, Colours, Figure
from tactile_ros.evaluation.svg import Plot
from tactile_ros.types import Array

if TYPE_CHECKING:
    from tactile_ros.evaluation.metrics import TargetErrors
    from tactile_ros.evaluation.result import Dataset

LEVELS = 6


def error_map(dataset: Dataset) -> Figure | None:
    """Mean error at every touched place, in plan view."""
    target = dataset.answers[0].target('position')
    if target is None or not target.spread.count:
        return None
    x, y, mean = place_means(target)
    pitch = _pitch(x, y)
    limits = _levels(mean)
    span = np.array([x.min(), x.max(), y.min(), y.max()]) + pitch * np.array([-1, 1, -1, 1])
    plot = Plot.plan(
        (float(span[0]), float(span[1])), (float(span[2]), float(span[3])), '(mm)',
        'Mean error at every touched place of the pad',
    )  # fmt: skip
    kinds = [f's{level}' for level in np.searchsorted(limits, mean)]
    plot.boxes(x, y, pitch * 0.94, kinds)
    for chip in dataset.chips[:, :2] * MM:
        if span[0] <= chip[0] <= span[1] and span[2] <= chip[1] <= span[3]:
            plot.text(float(chip[0]), float(chip[1]), '+', 'middle', 'chip')
    bounds = ['0', *(f'{limit:g}' for limit in limits)]
    words = [f'{a}–{b}' for a, b in pairwise(bounds)]
    key = tuple((f's{i}', word) for i, word in enumerate([*words, f'> {bounds[-1]} mm']))
    return Figure(
        'Where on the pad it errs',
        f'{len(x)} places{_rim_sentence(x, y, mean)} Crosses: chips.',
        str(plot),
        key,
    )


def place_means(target: TargetErrors) -> tuple[Array, Array, Array]:
    """Places (mm) and the mean error (mm) at each."""
    known = np.isfinite(target.size)
    plane, size = target.truth[known], target.size[known]
    _, first, place = np.unique(np.round(plane, 5), axis=0, return_index=True, return_inverse=True)
    place = np.asarray(place).reshape(-1)
    mean = np.bincount(place, size) / np.bincount(place)
    spots = plane[first] * MM
    return spots[:, 0], spots[:, 1], np.asarray(mean * MM)


def _pitch(x: Array, y: Array) -> float:
    """Usual distance of a place to the nearest other (mm)."""
    some = np.linspace(0, len(x) - 1, min(len(x), 400)).astype(int)
    apart = np.hypot(x[some, None] - x, y[some, None] - y)
    apart[apart == 0] = np.inf
    nearest = apart.min(axis=1)
    nearest = nearest[np.isfinite(nearest)]
    return float(np.median(nearest)) if len(nearest) else 1.0


def _levels(mean: Array) -> Array:
    """Five round limits between the classes of the map (mm)."""
    top = max(float(np.percentile(mean, 95)), 1e-3)
    power = 10.0 ** math.floor(math.log10(top / 5))
    step = next(f * power for f in (1, 2, 2.5, 5, 10) if f * power >= top / 5 * 0.999)
    return np.round(step * np.arange(1, LEVELS), 9)


def _rim_sentence(x: Array, y: Array, mean: Array) -> str:
    """Whether the rim is worse than the middle."""
    depth = np.minimum.reduce([x - x.min(), x.max() - x, y - y.min(), y.max() - y])
    rim = depth < 0.1 * max(float(np.ptp(x)), float(np.ptp(y)))
    if not rim.any() or rim.all():
        return '.'
    outer, inner = float(mean[rim].mean()), float(mean[~rim].mean())
    return (
        f': {inner:.2f} mm on average inside, {outer:.2f} mm in the outer tenth; '
        f'at worst {mean.max():.2f} mm.'
    )


def histogram(dataset: Dataset, colours: Colours) -> Figure | None:
    """Distribution of the place error, the other estimators as outlines."""
    told = [(a.name, a.target('position')) for a in dataset.competitors]
    found = [(name, target) for name, target in told if target is not None and target.spread.count]
    if not found:
        return None
    sizes = [t.size[np.isfinite(t.size)] * MM for _, t in found[:4]]
    top = max(float(np.percentile(size, 98)) for size in sizes)
    edges = np.linspace(0, top, 36)
    shares = [100 * np.histogram(size, edges)[0] / len(size) for size in sizes]
    plot = Plot(
        (0, top), (0, 1.12 * max(float(s.max()) for s in shares)), 'error in the plane (mm)',
        'share of frames (%)', told='Distribution of the place error',
    )  # fmt: skip
    kinds = [colours[name] for name, _ in found[:4]]
    plot.bars(edges, shares[0], f'fill {kinds[0]}')
    for kind, share in zip(kinds[1:], shares[1:], strict=True):
        plot.steps(edges, share, f'line {kind}')
    p50, p95 = MM * found[0][1].spread.p50, MM * found[0][1].spread.p95
    plot.rule(p50, f'half below {p50:.2f}')
    plot.rule(p95, f'95 % below {p95:.2f}', row=1)
    key = tuple((colours[name], name) for name, _ in found[:4])
    return Figure('How far off the place is', _histogram_caption(found), str(plot), key)


def _histogram_caption(found: list[tuple[str, TargetErrors]]) -> str:
    """The finding of the histogram."""
    name, first = found[0][0], found[0][1].spread
    text = f'{name}: {MM * first.mean:.2f} mm on average, worst {MM * first.largest:.1f} mm.'
    if len(found) > 1:
        other, target = min(found[1:], key=lambda item: item[1].spread.mean)
        text += f' {other}: {MM * target.spread.mean:.2f} mm.'
    return text
