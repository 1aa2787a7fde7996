"""Rests of a bag: the frames that the tares of its run took the mean of."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from tactile_ros.conditioning.faults import DAMAGED, SAYS_NOTHING, UNUSABLE, taxel_faults
from tactile_ros.types import FrameStatus
from tactile_ros.types.recording import FIRM

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tactile_ros.evaluation.recording_files import LoadedRecording
    from tactile_ros.types import Array, Bools, Integers, Recording

FEWEST = 4  # frames of a tare: fewer tell no noise
MOST = 10_000  # as contact_node allows
SAME = 1e-9  # of the largest reading: sums in another order
TRIED = 20  # counts of frames with the same mean in one channel
BRIDGED = 2  # rows between two frames of a tare: damaged, or not heard
ENOUGH = 30  # frames of tares; fewer tell less than a truth that knows every rest
STILL = 0.1  # of the frames, at which a load cell tells least
CLEAR = 3.0  # standard errors of a mean force


class Heard(NamedTuple):
    """Rows (n,) that a tare may have taken, and taxels (n, t) at which it may not have."""

    rows: Integers
    unusable: Bools


def with_rests(loaded: LoadedRecording) -> tuple[Recording, str]:
    """A recording whose tare rows are the frames that its live run tared on.

    A baseline says which frame was the last that it is the mean of, not which was the first: the
    others are the undamaged frames before, as many as have that mean.

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
    if recording.tare is not None:
        return recording, ''
    heard = _heard(loaded)
    tares = _tares(loaded)
    windows = [_windows(recording, heard, row, level) for row, level in tares]
    counted = Counter(count for window in windows for count in window)
    usual = max(counted, key=lambda count: (counted[count], count), default=0)
    rests = [_ending(window[usual if usual in window else max(window)])
             for window in windows if window]  # fmt: skip
    rests = [rest for rest in rests if len(rest) >= FEWEST]
    kept = [rest for rest in rests if not _under_load(recording, rest)]
    told = _told(len(tares), len(rests), len(kept))
    tare = _marked(len(recording), kept)
    known = recording.truth.get('in_contact')
    if known is not None and (known == 0).any() and 0 < np.count_nonzero(tare) < ENOUGH:
        few = f'tares of fewer than {ENOUGH} frames in all are not heeded beside in_contact'
        return recording, f'{told}; {few}' if told else few
    return (replace(recording, tare=tare) if tare.any() else recording), told


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


def _told(count: int, found: int, kept: int) -> str:
    """Why tares tell no rest; empty if all do."""
    if kept == count:
        return ''
    why = [f'{found - kept} under load'] * (found > kept)
    lost = f'{count - found} of frames that were not found, or fewer than {FEWEST}'
    why += [lost] * (count > found)
    return f'{kept} of {count} tares tell when nothing touched; {" and ".join(why)}'


def _tares(loaded: LoadedRecording) -> list[tuple[int, Array]]:
    """Last row and baseline (t, c) of every tare, -1 where the row is not in the bag.

    The first baseline of a stream is none: it comes with the frame that it holds for.
    """
    recording = loaded.recording
    if recording.stamp_ns is None or recording.sequence is None:
        return []
    rows = {stamp: row for row, stamp in enumerate(recording.stamp_ns.tolist())}
    earliest = min(rows, default=0)
    found = []
    for one in loaded.baselines:
        row = rows.get(one.stamp_ns or 0, -1)
        older = row < 0 and (one.stamp_ns or 0) < earliest  # of a stream that is not in the bag
        if not older and (row < 0 or recording.sequence[row] != one.sequence):
            found.append((row, one.values))
    return found


def _heard(loaded: LoadedRecording) -> list[Heard]:
    """Frames that the node had: by its contacts, and where that tells nothing by the readings."""
    recording, live = loaded.recording, loaded.contacts
    faults = taxel_faults(recording.values, recording.status, recording.layout) & UNUSABLE
    plain = Heard(np.arange(len(recording)), faults != 0)
    if live is None:
        return [plain]
    status, bits = live.states.status, live.states.taxel_status
    silent = ((bits & SAYS_NOTHING) != 0).all(axis=1)
    stale = (status & int(FrameStatus.STALE)) != 0
    damaged = ((status & DAMAGED) != 0) | (stale & silent)
    order = np.argsort(live.rows, kind='stable')
    unusable = np.repeat(damaged[order, None], bits.shape[1], axis=1)
    return [Heard(live.rows[order], unusable), plain]


def _windows(
    recording: Recording, heard: Sequence[Heard], last: int, level: Array
) -> dict[int, Integers]:
    """Rows up to one that have this mean (t, c), the newest first, by their number."""
    if last < 0:
        return {}
    taxels = np.flatnonzero(np.isfinite(level).all(axis=1))
    begins = np.flatnonzero(recording.restarts)
    first = int(begins[np.searchsorted(begins, last, 'right') - 1])
    for rows, unusable in heard:
        near = slice(*np.searchsorted(rows, [first, last + 1]).tolist())
        sound = ~unusable[near][:, taxels].any(axis=1)
        found = _with_mean(recording.values, rows[near][sound][-MOST:][::-1], taxels, level)
        if found:
            return found
    return {}


def _with_mean(
    values: Array, rows: Integers, taxels: Integers, level: Array
) -> dict[int, Integers]:
    """First rows of some whose mean over these taxels is a level (t, c), by their number."""
    if len(rows) < FEWEST or not len(taxels):
        return {}
    moves = np.nan_to_num(np.ptp(values[rows[:ENOUGH]][:, taxels], axis=0), nan=-1.0)
    taxel, channel = np.unravel_index(int(moves.argmax()), moves.shape)
    column = values[rows, taxels[taxel], channel]
    mean = np.cumsum(column) / np.arange(1, len(rows) + 1)
    apart = np.abs(mean - level[taxels[taxel], channel])
    counts = np.flatnonzero(apart <= SAME * np.maximum.accumulate(np.abs(column))) + 1
    found = {}
    for count in counts[counts >= FEWEST][:TRIED].tolist():
        window = values[rows[:count]][:, taxels]
        off = np.abs(window.mean(axis=0) - level[taxels]).max()
        if off <= SAME * np.abs(window).max():
            found[count] = rows[:count]
    return found


def _ending(rows: Integers) -> Integers:
    """The newest of a tare's rows, in order, that nothing long lies between."""
    rows = np.sort(rows)
    far = np.flatnonzero(np.diff(rows) > BRIDGED + 1)
    return np.asarray(rows[far[-1] + 1 :] if len(far) else rows)


def _under_load(recording: Recording, rows: Integers) -> bool:
    """Whether truth knows that something touched: it says so, or the force is clearly not 0."""
    touched = recording.truth.get('in_contact')
    if touched is not None and (touched[rows] == 1).any():
        return True
    force = recording.truth.get('force')
    if force is None:
        return False
    told = np.nan_to_num(force.astype(np.float64))
    size = np.linalg.norm(told, axis=1)
    # a load cell has an offset of its own
    told = told - np.median(told[size <= np.quantile(size, STILL)], axis=0)
    away = float(np.linalg.norm(told[rows].mean(axis=0)))
    unsure = float(np.linalg.norm(told[rows].std(axis=0))) / np.sqrt(len(rows))
    return bool(away > FIRM * np.linalg.norm(told, axis=1).max() + CLEAR * unsure)


def _marked(count: int, rests: Sequence[Integers]) -> Bools:
    """Rows (s,) of rests, what lies between their frames with them.

    Of rests that meet the newest alone, since runs of tare rows are told apart by what lies
    between; it serves all that follows.
    """
    tare, until = np.zeros(count, bool), count + 1
    for rest in sorted(rests, key=lambda rows: int(rows[-1]), reverse=True):
        if rest[-1] + 1 < until:
            until = int(rest[0])
            tare[until : rest[-1] + 1] = True
    return tare
