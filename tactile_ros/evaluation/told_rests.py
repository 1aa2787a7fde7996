"""Rests of a bag: the frames that the tares of its run took the mean of."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.evaluation.live_baselines import baselines_by_row

if TYPE_CHECKING:
    from tactile_ros.evaluation.loaded import LoadedRecording
    from tactile_ros.types import Array, Integers, Recording

FEWEST = 4  # frames of a tare: fewer tell no noise
MOST = 10_000  # as contact_node allows
SAME = 1e-9  # of the largest reading: sums in another order


def with_rests(loaded: LoadedRecording) -> Recording:
    """A recording whose tare rows are the frames that its live run tared on.

    A baseline says the first frame that it holds for, not which ones it is the mean of: those are
    the frames just before, as many as have that mean.

    Parameters
    ----------
    loaded : LoadedRecording
        Of a bag, with the baselines of its run.

    Returns
    -------
    Recording
        The same where it has tare rows already, or no baseline is such a mean.
    """
    recording = loaded.recording
    if recording.tare is not None:
        return recording
    rows = np.arange(len(recording))
    tare = np.zeros(len(recording), bool)
    begins = np.flatnonzero(recording.restarts)
    for row, group in baselines_by_row(recording, rows, loaded.baselines).items():
        first = int(begins[np.searchsorted(begins, row, 'right') - 1])
        before = rows[max(first, row - MOST) : row]
        tare[_taken(recording, before, group[-1].values)] = True
    return replace(recording, tare=tare) if tare.any() else recording


def _taken(recording: Recording, before: Integers, level: Array) -> Integers:
    """Rows at the end of some that have this mean (t, c); none where none do."""
    values = recording.values[before]
    sound = np.asarray(np.isfinite(values).all(axis=2))
    if recording.status is not None:
        sound &= recording.status[before] == 0
    whole = np.count_nonzero(sound, axis=1)
    # a tare passes damaged frames over; a taxel that is never sound damages none
    kept = np.flatnonzero((whole > 0) & (whole == whole.max(initial=0)))[::-1]
    if len(kept) < FEWEST:
        return before[:0]
    told = sound[kept].all(axis=0) & np.isfinite(level).all(axis=1)
    newest = values[kept][:, told]
    mean = np.cumsum(newest, axis=0) / np.arange(1, len(kept) + 1)[:, None, None]
    apart = np.abs(mean - level[told]).max(axis=(1, 2), initial=0.0)
    count = np.flatnonzero(apart <= SAME * np.abs(newest).max(initial=0.0)) + 1
    if not told.any() or not len(count) or count[-1] < FEWEST:
        return before[:0]
    return before[kept[: count[-1]]]
