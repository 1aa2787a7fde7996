"""Drawings about what a skin remembers: hysteresis between loading and unloading, slow drift."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.conditioning.loading_direction import dead_band, loading_signs
from tactile_ros.evaluation.figure import Figure, title_of
from tactile_ros.evaluation.svg import Plot
from tactile_ros.types import Array, Bools

if TYPE_CHECKING:
    from tactile_ros.evaluation.metrics import TargetErrors
    from tactile_ros.evaluation.result import Dataset

BINS, LEAST_ROWS, LEAST_BINS = 20, 5, 6
PAUSE = 5.0  # usual distances of rows, from which a pause lies between them
SPANS = 24


def hysteresis(dataset: Dataset, name: str) -> Figure | None:
    """Mean error along the force, while it rises and while it falls."""
    target = dataset.answers[0].target(name)
    if target is None or not np.isfinite(target.time_s).any():
        return None
    time = target.time_s
    truth, error = target.truth[:, 0], target.error[:, 0]
    low, high = (float(edge) for edge in np.nanpercentile(truth, [1, 99]))
    if not high > low or len(truth) < LEAST_BINS * LEAST_ROWS:
        return None
    edges = np.linspace(low, high, BINS + 1)
    centre = (edges[1:] + edges[:-1]) / 2
    rising, falling = _directions(target, time)
    up, down = (_binned(truth, error, rows, edges) for rows in (rising, falling))
    both = np.isfinite(up) & np.isfinite(down)
    if both.sum() < LEAST_BINS:
        return None
    words = title_of(target)
    top = 1.2 * float(np.nanmax(np.abs([up, down]))) or 1.0
    plot = Plot(
        (low, high), (-top, top), f'measured {words} (N)',
        'mean error (N)', (360, 250), told=f'Error of rising and falling {words}',
    )  # fmt: skip
    plot.line(edges[[0, -1]], np.zeros(2), 'rule')
    plot.line(centre, up, 'line c0')
    plot.line(centre, down, 'line c1')
    apart = np.abs(down - up)[both]
    percent = 100 * float(apart.max()) / (high - low)
    caption = (
        f'At the same load, rising and falling force are told {apart.mean():.2f} N apart on '
        f'average, at worst {apart.max():.2f} N: {percent:.1f} % of the range.'
    )
    key = (('c0', 'rising'), ('c1', 'falling'))
    return Figure(f'Hysteresis of {words}', caption, str(plot), key)


def _directions(target: TargetErrors, time: Array) -> tuple[Bools, Bools]:
    """Rows (n,) on the way up and down in true force, without turns, holds there and pauses."""
    force, step = target.truth[:, :1], np.diff(time)
    usual = float(np.nanmedian(step[step > 0])) if (step > 0).any() else 0.0
    anew = np.concatenate([[True], ~((step > 0) & (step < PAUSE * usual))])
    way, band = loading_signs(force, anew)[:, 0], dead_band(force)[0]
    begins = anew | (np.diff(way, prepend=0.0) != 0)
    run, first = np.cumsum(begins) - 1, np.flatnonzero(begins)
    high = np.fmax.reduceat(force[:, 0], first)[run]
    low = np.fmin.reduceat(force[:, 0], first)[run]
    rising = (way > 0) & (force[:, 0] < high - band)
    return rising, (way < 0) & (force[:, 0] > low + band)


def _binned(truth: Array, error: Array, rows: Bools, edges: Array) -> Array:
    """Mean error in each bin of the truth; NaN where there are too few rows."""
    known = rows & np.isfinite(error) & (truth >= edges[0]) & (truth < edges[-1])
    place = np.searchsorted(edges, truth[known], side='right') - 1
    count = np.bincount(place, minlength=len(edges) - 1)
    total = np.bincount(place, error[known], minlength=len(edges) - 1)
    return np.where(count >= LEAST_ROWS, total / np.maximum(count, 1), np.nan)


def drift(dataset: Dataset, name: str, colour: str) -> Figure | None:
    """Mean error over time with its deviation, and what a line through it says."""
    target = dataset.answers[0].target(name)
    if target is None:
        return None
    time = target.time_s
    error = target.error[:, 0]
    known = np.isfinite(time) & np.isfinite(error)
    if known.sum() < SPANS * LEAST_ROWS:
        return None
    time, error = time[known] - time[known].min(), error[known]
    if not time.max() > 0:
        return None
    edges = np.linspace(0, time.max(), SPANS + 1)
    centre = (edges[1:] + edges[:-1]) / 2
    everything = np.ones(len(time), bool)
    mean = _binned(time, error, everything, edges)
    spread = np.sqrt(np.maximum(_binned(time, error**2, everything, edges) - mean**2, 0))
    slope, start = np.polyfit(time, error, 1)
    words = title_of(target)
    top = 1.15 * float(np.nanmax(np.abs(mean) + spread)) or 1.0
    plot = Plot((0, float(time.max())), (-top, top), 'time (s)', 'mean error (N)', (360, 250),
                told=f'Mean error of {words} over time')  # fmt: skip
    plot.band(centre, mean - spread, mean + spread, f'band {colour}')
    plot.line(np.array([0.0, time.max()]), np.zeros(2), 'rule')
    plot.line(centre, mean, f'line {colour}')
    plot.line(time[[0, -1]], start + slope * time[[0, -1]], 'line ink')
    moved = f'{slope * time.max():+.2f}'.replace('-', '−')
    caption = (
        f'Over {time.max():,.0f} s the mean error moves by {moved} N (straight line); '
        'the band is one standard deviation of the errors of each span.'
    )
    return Figure(f'Drift of {words}', caption, str(plot))
