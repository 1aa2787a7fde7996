"""Drawings about force: against truth and over time, with the stated uncertainty."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.evaluation.figure import Figure, accepted, title_of
from tactile_ros.evaluation.svg import Plot
from tactile_ros.types import Array, Integers

if TYPE_CHECKING:
    from tactile_ros.evaluation.metrics import TargetErrors
    from tactile_ros.evaluation.result import Dataset

MOST_DOTS = 2500
MOST_POINTS = 1200


def force_scatter(dataset: Dataset, name: str) -> Figure | None:
    """Estimate against truth with the stated one-sigma band about the diagonal."""
    target = dataset.answers[0].target(name)
    if target is None or not target.spread.count:
        return None
    truth, guess = target.truth[:, 0], target.estimate[:, 0]
    known = np.isfinite(guess)
    span = _span(np.concatenate([truth, guess[known]]))
    words = title_of(target)
    plot = Plot(span, span, f'measured {words} (N)', 'estimated (N)', (420, 340),
                told=f'Estimated against measured {words}')  # fmt: skip
    centre, sigma = binned_sigma(truth[known], target.variance[known, 0])
    plot.band(centre, centre - sigma, centre + sigma, 'band c0')
    plot.line(np.array(span), np.array(span), 'rule')
    some = _some(np.flatnonzero(known), MOST_DOTS)
    plot.dots(truth[some], guess[some], 'c0')
    share = target.coverage
    caption = f'RMSE {target.spread.rms:.2f} N over {target.spread.count} frames.'
    if share.count:
        verdict = 'as it should' if share.honest else f'accepted {accepted(target)}'
        caption += (
            f' The band is the stated sigma: {100 * share.share:.0f} % of errors lie inside '
            f'({verdict}; {share.groups} groups).'
        )
    return Figure(f'{words[0].upper()}{words[1:]} against the scale', caption, str(plot))


def binned_sigma(truth: Array, variance: Array, bins: int = 24) -> tuple[Array, Array]:
    """Root mean stated variance along the truth."""
    known = np.isfinite(truth) & np.isfinite(variance)
    if known.sum() < 2:
        return np.zeros(0), np.zeros(0)
    edges = np.unique(np.percentile(truth[known], np.linspace(0, 100, bins + 1)))
    if len(edges) < 2:
        return np.zeros(0), np.zeros(0)
    cell = np.clip(np.searchsorted(edges, truth[known], side='right') - 1, 0, len(edges) - 2)
    count = np.bincount(cell, minlength=len(edges) - 1)
    filled = count > 0
    total = np.bincount(cell, variance[known], minlength=len(edges) - 1)[filled]
    along = np.bincount(cell, truth[known], minlength=len(edges) - 1)[filled]
    return np.asarray(along / count[filled]), np.asarray(np.sqrt(total / count[filled]))


def _span(values: Array) -> tuple[float, float]:
    """Range of values with some air."""
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    air = 0.04 * (high - low) or 1.0
    return low - air, high + air


def _some(rows: Integers, most: int) -> Integers:
    """At most so many rows, evenly taken."""
    return rows[np.linspace(0, len(rows) - 1, most).astype(int)] if len(rows) > most else rows


def force_trace(dataset: Dataset, name: str) -> Figure | None:
    """Estimate and truth over time, and the error under them."""
    target = dataset.answers[0].target(name)
    if target is None or not target.spread.count:
        return None
    time = dataset.time_s[target.rows]
    if not np.isfinite(time).any():
        return None
    words = title_of(target)
    wide = _trace(target, time, (900, 280), 1.0)
    narrow = _trace(target, time, (420, 260), 0.3)
    worst = float(np.nanmax(target.size))
    caption = (
        f'Estimated {words} with its one-sigma band over the measured one; at worst {worst:.2f} N '
        f'off. Of the narrow drawing the first third only.'
    )
    key = (('c0', f'estimated ({dataset.answers[0].name})'), ('ink', 'measured'))
    return Figure(f'{words[0].upper()}{words[1:]} over time', caption, wide, key, narrow)


def _trace(target: TargetErrors, time: Array, size: tuple[int, int], part: float) -> str:
    """Trace of the first part of the time."""
    begin, end = float(np.nanmin(time)), float(np.nanmax(time))
    end = begin + part * (end - begin) or begin + 1.0
    rows = np.flatnonzero((time >= begin) & (time <= end))
    rows = _some(rows, MOST_POINTS)
    truth, guess = target.truth[rows, 0], target.estimate[rows, 0]
    sigma = np.sqrt(target.variance[rows, 0])
    span = _span(np.concatenate([truth, guess]))
    plot = Plot((0.0, end - begin), span, 'time (s)', 'force (N)', size,
                told='Estimated and measured force over time')  # fmt: skip
    along = _broken(time[rows] - begin)
    plot.band(time[rows] - begin, guess - sigma, guess + sigma, 'band c0')
    plot.line(along, truth, 'line ink')
    plot.line(along, guess, 'line c0')
    return str(plot)


def _broken(time: Array) -> Array:
    """Times with NaN after long pauses, so that a line does not bridge them."""
    step = np.diff(time, prepend=time[:1])
    usual = np.median(step[step > 0]) if (step > 0).any() else 1.0
    return np.where(step > 20 * usual, np.nan, time)
