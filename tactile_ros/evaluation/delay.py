"""By how much one signal is later than another, with how well that is known. Pure.

The delay of truth on a clock or a bus of its own is told by the signals themselves: where the
skin feels, the load cell reads. Each stretch of the recording gives one estimate, the peak of the
normalised cross-correlation; their median is the answer, and their scatter its uncertainty, so
that a few stretches in which nothing or something else happened do no harm.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from tactile_ros.types import Array, Integers

MOST_NS = 500_000_000
STRETCH_NS = 4_000_000_000
LEAST_STEP_NS = 1_000_000
LEAST_CORRELATION = 0.5
FEWEST = 3
FINEST = 0.2  # steps: how far off a peak between two steps may be in every stretch alike
QUIET = 0.1  # of the usual scatter: a stretch in which nothing happens
MAD, MEDIAN = 1.4826, 1.2533  # scatter of a normal variable from its median; of a median


@dataclass(frozen=True)
class Delay:
    """How much later one signal is.

    Attributes
    ----------
    delay_ns, std_ns : float
        Of the median of the stretches.
    correlation : float
        Median of the peaks, 0..1.
    stretches : int
        That told it.
    """

    delay_ns: float
    std_ns: float
    correlation: float
    stretches: int

    @property
    def told(self) -> bool:
        """Whether there is a delay that stands out of its uncertainty."""
        return abs(self.delay_ns) > 3 * self.std_ns


def estimate_delay(
    times: Integers, signal: Array, late_times: Integers, late_signal: Array
) -> Delay | None:
    """Delay of a signal behind another, up to half a second either way.

    Parameters
    ----------
    times, late_times : ndarray, shape (n,), (m,)
        When each was read (ns), increasing.
    signal, late_signal : ndarray, shape (n,), (m,)
        Of any unit, and of either sign to one another.

    Returns
    -------
    Delay or None
        None where fewer than three stretches of four seconds tell it.

    Notes
    -----
    What the skin itself lags behind (its creep) is part of the answer.
    """
    if min(len(times), len(late_times)) < 2:
        return None
    steps = [float(np.median(np.diff(t))) for t in (times, late_times)]
    step = max(min(steps), LEAST_STEP_NS)
    begin = max(int(times[0]), int(late_times[0]) + MOST_NS)
    end = min(int(times[-1]), int(late_times[-1]) - MOST_NS)
    reach, length = round(MOST_NS / step), round(STRETCH_NS / step)
    count = int((end - begin) // step)
    if count < FEWEST * length:
        return None
    grid = np.arange(-reach, count + reach) * step
    one = np.interp(grid[reach:-reach], times - begin, signal)
    other = np.interp(grid, late_times - begin, late_signal)
    usual = float(np.std(one)), float(np.std(other))
    found = []
    for first in range(0, count - length + 1, length):
        part, late = one[first : first + length], other[first : first + length + 2 * reach]
        if part.std() > QUIET * usual[0] and late.std() > QUIET * usual[1]:
            found.append(_peak(part, late))
    good = np.array([(lag, top) for lag, top in found if top >= LEAST_CORRELATION])
    if len(good) < FEWEST:
        return None
    lag = float(np.median(good[:, 0]))
    scatter = MAD * float(np.median(np.abs(good[:, 0] - lag)))
    std = max(scatter, FINEST) * MEDIAN / np.sqrt(len(good))
    return Delay((lag - reach) * step, float(std) * step, float(np.median(good[:, 1])), len(good))


def _peak(part: Array, late: Array) -> tuple[float, float]:
    """Place (steps, by a parabola) and height of the largest correlation; height 0 at an edge."""
    windows = sliding_window_view(late, len(part))
    centred = part - part.mean()
    spread = windows.std(axis=1) * part.std() * len(part)
    with np.errstate(invalid='ignore', divide='ignore'):
        match = np.abs(windows @ centred) / spread
    match = np.where(np.isfinite(match), match, 0.0)
    top = int(match.argmax())
    if top in (0, len(match) - 1):
        return float(top), 0.0
    left, middle, right = match[top - 1 : top + 2]
    bend = left - 2 * middle + right
    return top + (0.5 * (left - right) / bend if bend < 0 else 0.0), float(middle)
