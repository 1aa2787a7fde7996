"""Rests of a bag: the frames that the tares of its run took the mean of."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from tactile_ros import truth
from tactile_ros.conditioning.faults import DAMAGED, SAYS_NOTHING, UNUSABLE, taxel_faults
from tactile_ros.evaluation.live_baselines import baselines_by_row
from tactile_ros.types import FrameStatus

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tactile_ros.evaluation.loaded import LoadedRecording
    from tactile_ros.types import Array, Bools, Integers, Recording

FEWEST = 4  # frames of a tare: fewer tell no noise
MOST = 10_000  # as contact_node allows
SAME = 1e-9  # of the largest reading: sums in another order
TRIED = 200  # counts of frames with the same mean in one channel
ENOUGH = (
    30  # frames of tares that tell as much of the noise as a truth that says when nothing touches
)


class Heard(NamedTuple):
    """What a run heard: rows (n,) of the recording, and which of them no tare may take."""

    rows: Integers
    damaged: Bools


def with_rests(loaded: LoadedRecording) -> tuple[Recording, str]:
    """A recording whose tare rows are the frames that its live run tared on.

    A baseline says the first frame that it holds for, not which ones it is the mean of: those are
    the undamaged frames just before, as many as have that mean.

    Parameters
    ----------
    loaded : LoadedRecording
        Of a bag, with the baselines of its run.

    Returns
    -------
    recording : Recording
        The same where it has tare rows already, or no baseline tells a rest.
    told : str
        How many tares tell none, and why; empty if all do.
    """
    recording = loaded.recording
    if recording.tare is not None or recording.stamp_ns is None:
        return recording, ''
    heard = _heard(loaded)
    tares = {
        row: group[-1].values
        for row, group in baselines_by_row(recording, heard.rows, loaded.baselines).items()
        if group[-1].stamp_ns < recording.stamp_ns[row]  # the first of a stream is no tare
    }
    windows = [_windows(recording, heard, row, level) for row, level in tares.items()]
    usual = [count for count, _ in Counter(n for w in windows for n in w).most_common(1)]
    busy = truth.touched_rows(recording) | truth.firm_rows(recording)
    tare, found, loads = np.zeros(len(recording), bool), 0, 0
    for window in windows:
        if not window:
            continue
        rows = window[usual[0] if usual[0] in window else min(window)]
        span = slice(int(rows.min()), int(rows.max()) + 1)
        under_load = bool(busy[span].any())
        loads += under_load
        found += not under_load
        tare[span] |= not under_load
    told = '' if found == len(tares) else _told(found, len(tares), loads)
    few = 'in_contact' in recording.truth and np.count_nonzero(tare) < ENOUGH
    return (recording if few or not found else replace(recording, tare=tare)), told


def alike(recordings: Sequence[Recording]) -> list[Recording]:
    """Recordings of which all have tare rows if one has, where their truth knows the rests."""
    if all(r.tare is None for r in recordings):
        return [*recordings]
    return [
        replace(r, tare=np.asarray(r.truth['in_contact'] == 0))
        if r.tare is None and 'in_contact' in r.truth
        else r
        for r in recordings
    ]


def _told(found: int, count: int, loads: int) -> str:
    """Why tares tell no rest."""
    lost = count - found - loads
    why = [f'{loads} under load'] * bool(loads)
    why += [f'{lost} of frames that are not in it, or fewer than {FEWEST}'] * bool(lost)
    return f'{found} of {count} tares tell when nothing touched; {" and ".join(why)}'


def _heard(loaded: LoadedRecording) -> Heard:
    """Frames that the node had, by its contacts where they are in the bag."""
    recording, live = loaded.recording, loaded.contacts
    if live is None:
        bits = taxel_faults(recording.values, recording.status, recording.layout)
        return Heard(np.arange(len(recording)), ((bits & UNUSABLE) != 0).any(axis=1))
    status, bits = live.states.status, live.states.taxel_status
    silent = ((bits & SAYS_NOTHING) != 0).all(axis=1)
    stale = (status & int(FrameStatus.STALE)) != 0
    order = np.argsort(live.rows, kind='stable')
    damaged = ((status & DAMAGED) != 0) | (stale & silent)
    return Heard(live.rows[order], np.asarray(damaged[order]))


def _windows(recording: Recording, heard: Heard, row: int, level: Array) -> dict[int, Integers]:
    """Rows just before one that have this mean (t, c), by their number; all such numbers."""
    begins = np.flatnonzero(recording.restarts)
    first = int(begins[np.searchsorted(begins, row, 'right') - 1])
    before = (heard.rows >= first) & (heard.rows < row) & ~heard.damaged
    kept = heard.rows[before][-MOST:][::-1]
    taxels = np.flatnonzero(np.isfinite(level).all(axis=1))
    if len(kept) < FEWEST or not len(taxels):
        return {}
    newest = recording.values[kept[:TRIED]][:, taxels]
    moves = np.nan_to_num(np.ptp(newest, axis=0), nan=-1.0)
    taxel, channel = np.unravel_index(int(moves.argmax()), moves.shape)
    column = recording.values[kept, taxels[taxel], channel]
    mean = np.cumsum(column) / np.arange(1, len(kept) + 1)
    apart = np.abs(mean - level[taxels[taxel], channel])
    counts = np.flatnonzero(apart <= SAME * np.maximum.accumulate(np.abs(column))) + 1
    found = {}
    for count in counts[counts >= FEWEST][:TRIED].tolist():
        window = recording.values[kept[:count]][:, taxels]
        off = np.abs(window.mean(axis=0) - level[taxels])
        if (off <= SAME * np.abs(window).max()).all():
            found[count] = kept[:count]
    return found
