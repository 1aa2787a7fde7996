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


def force_scatter(dataset: Dataset, name: str, colour: str) -> Figure | None:
    """Estimate against truth with the stated one-sigma band about the diagonal."""
    target = dataset.answers[0].target(name)
    if target is None or not target.spread.count:
        return None
    truth, guess = target.truth[:, 0], target.estimate[:, 0]
    known = np.isfinite(guess)
    words = title_of(target)
    some = _some(np.flatnonzero(known), MOST_DOTS)
    span = _span(np.concatenate([truth[known], guess[known]]))
    plot = Plot(span, span, '', 'estimated (N)', (360, 250),
                told=f'Estimated against measured {words}')  # fmt: skip
    plot.line(np.array(span), np.array(span), 'rule')
    plot.dots(truth[some], guess[some], colour)
    below = _residual(target, span, some, words, colour)
    share = target.coverage
    caption = f'RMSE {target.spread.rms:.2f} N over {target.spread.count} frames.'
    if share.count:
        verdict = 'as it should' if share.honest else f'accepted {accepted(target)}'
        caption += (
            f' The band is the stated sigma: {100 * share.share:.0f} % of errors lie inside '
            f'({verdict}; {share.groups} groups).'
        )
    return Figure(f'{words[0].upper()}{words[1:]} against the scale', caption, str(plot) + below)


def _residual(
    target: TargetErrors, span: tuple[float, float], some: Integers, words: str, colour: str
) -> str:
    """Error along the truth with the stated one-sigma band about zero."""
    truth, error = target.truth[:, 0], target.error[:, 0]
    known = np.isfinite(error)
    top = 1.15 * float(np.percentile(np.abs(error[known]), 99.5)) or 1.0
    plot = Plot(span, (-top, top), f'measured {words} (N)', 'error (N)', (360, 170),
                told=f'Error of {words} against its size')  # fmt: skip
    centre, sigma = binned_sigma(truth[known], target.variance[known, 0])
    plot.band(centre, -sigma, sigma, f'band {colour}')
    plot.line(np.array(span), np.zeros(2), 'rule')
    plot.dots(truth[some], error[some], colour)
    return str(plot)


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


def force_trace(dataset: Dataset, name: str, colour: str) -> Figure | None:
    """Estimate and truth over time, and the error under them."""
    target = dataset.answers[0].target(name)
    if target is None or not target.spread.count:
        return None
    time = target.time_s
    if not np.isfinite(time).any():
        return None
    words = title_of(target)
    wide = _trace(target, time, (1080, 220), 1.0, colour)
    narrow = _trace(target, time, (360, 200), 0.3, colour)
    worst = target.spread.largest
    caption = (
        f'At worst {worst:.2f} N off. The band is the stated sigma about zero: honest errors '
        'leave it a third of the time.'
    )
    key = ((colour, f'estimated ({dataset.answers[0].name})'), ('ink', 'measured'))
    return Figure(f'{words[0].upper()}{words[1:]} over time', caption, wide, key, narrow)


def _trace(
    target: TargetErrors, time: Array, size: tuple[int, int], part: float, colour: str
) -> str:
    """Trace of the first part of the time, and the error with its band under it."""
    begin, end = float(np.nanmin(time)), float(np.nanmax(time))
    end = begin + part * (end - begin) or begin + 1.0
    rows = _some(np.flatnonzero((time >= begin) & (time <= end)), MOST_POINTS)
    along = _broken(time[rows] - begin)
    truth, guess = target.truth[rows, 0], target.estimate[rows, 0]
    error, sigma = target.error[rows, 0], np.sqrt(target.variance[rows, 0])
    frame = (0.0, end - begin)
    upper = Plot(frame, _span(np.concatenate([truth, guess])), '', 'force (N)', size,
                 told='Estimated and measured force over time')  # fmt: skip
    upper.band(along, guess - sigma, guess + sigma, f'band {colour}')
    upper.line(along, truth, 'line ink')
    upper.line(along, guess, f'line {colour}')
    top = 1.15 * float(np.nanpercentile(np.abs(error), 99.5)) or 1.0
    lower = Plot(frame, (-top, top), 'time (s)', 'error (N)', (size[0], 150),
                 told='Error of the force over time')  # fmt: skip
    lower.band(time[rows] - begin, -sigma, sigma, f'band {colour}')
    lower.line(np.array(frame), np.zeros(2), 'rule')
    lower.line(along, error, f'line {colour}')
    return str(upper) + str(lower)


def _broken(time: Array) -> Array:
    """Times with NaN after long pauses, so that a line does not bridge them."""
    step = np.diff(time, prepend=time[:1])
    usual = np.median(step[step > 0]) if (step > 0).any() else 1.0
    return np.where(step > 20 * usual, np.nan, time)
