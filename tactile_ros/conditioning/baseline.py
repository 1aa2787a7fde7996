"""The no-contact reference: taken from resting frames, followed while at rest, frozen in contact.

A block of frames (a period of stream time) counts as rest when every frame of it stays within the
contact threshold of the baseline; then the baseline moves a step towards the block's mean. One
frame in contact freezes the whole block, so that a held contact never fades.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactile_ros.types import Array, Bools, Integers, Recording


@dataclass(frozen=True)
class Tracking:
    """How the baseline follows slow drift.

    Attributes
    ----------
    scale : ndarray, shape (t, c)
        Deviation from the baseline that still counts as rest (unit of values).
    period_ns : int
        Length of a block (ns).
    gain : float
        Step towards the mean of a resting block, 0 (fixed) .. 1.
    """

    scale: Array
    period_ns: int = 1_000_000_000
    gain: float = 0.25


class BaselineTracker:
    """Follow the baseline over the frames of one stream, one by one or many at once.

    Parameters
    ----------
    start : ndarray, shape (t, c) or more channels
        Baseline at the start of the stream (unit of values). What frames have beyond the channels
        of `tracking` is followed with them by what was told of it, and says nothing about rest.
    tracking : Tracking or None
        None: the baseline stays.
    doubt : float
        Variance of the baseline at the start over that of a frame at rest.

    Attributes
    ----------
    baseline, doubt : ndarray of shape (t, c), float
        As they are now.
    """

    def __init__(self, start: Array, tracking: Tracking | None, doubt: float = 0.0) -> None:
        self.baseline, self.doubt = start, doubt
        self.tracking = tracking
        self._felt = slice(None if tracking is None else tracking.scale.shape[1])
        self._unknown = bool(np.isnan(start[:, self._felt]).any())
        beside = tracking is not None and start.shape[1] > tracking.scale.shape[1]
        self._total = np.zeros_like(start)
        self._told = np.zeros(start.shape, np.int64) if beside else None
        self._count = 0
        self._begin_ns = 0
        self._quiet = True

    def __call__(self, values: Array, stamp_ns: Integers | None) -> Array:
        """Return the baseline that holds for each frame, and follow it.

        Parameters
        ----------
        values : ndarray, shape (s, t, c)
            Frames in time order (unit of values).
        stamp_ns : ndarray, shape (s,), or None
            Acquisition times; None: independent frames, nothing is followed.

        Returns
        -------
        ndarray, shape (s, t, c)
            Baselines; each depends on earlier frames alone.
        """
        return self.follow(values, stamp_ns)[0]

    def follow(self, values: Array, stamp_ns: Integers | None) -> tuple[Array, Array]:
        """Return what `__call__` does, and the doubt (s,) of the baseline of each frame."""
        if self.tracking is None or stamp_ns is None or self._unknown:
            held = np.repeat(self.baseline[None], len(values), axis=0)
            return held, np.full(len(values), self.doubt)
        if len(values) == 1:
            self._advance(int(stamp_ns[0]), self.tracking)
            held, doubt = self.baseline[None], np.array([self.doubt])
            self._gather(values, self.tracking.scale)
            return held, doubt
        held, doubt = np.empty_like(values), np.empty(len(values))
        first = 0
        while first < len(values):
            self._advance(int(stamp_ns[first]), self.tracking)
            limit = self._begin_ns + self.tracking.period_ns
            last = max(int(stamp_ns.searchsorted(limit)), first + 1)
            held[first:last], doubt[first:last] = self.baseline, self.doubt
            self._gather(values[first:last], self.tracking.scale)
            first = last
        return held, doubt

    def _advance(self, stamp_ns: int, tracking: Tracking) -> None:
        """Begin a block where none runs, or where the running one is over."""
        if self._count == 0:
            self._begin_ns = stamp_ns
        elif stamp_ns - self._begin_ns >= tracking.period_ns:
            self._close(stamp_ns, tracking)

    def _gather(self, block: Array, scale: Array) -> None:
        """Add frames of the running block."""
        self._count += len(block)
        if self._quiet:
            near = np.abs(block - self.baseline)[:, :, self._felt] <= scale
            self._quiet = np.count_nonzero(near) == near.size
        if self._quiet:
            if self._told is not None:
                told = np.isfinite(block)
                self._told = self._told + np.count_nonzero(told, axis=0)
                block = np.where(told, block, 0.0)
            # row by row onto the total, so that pieces of a stream sum as the whole does
            self._total = self._total + block[0]
            if len(block) > 1:
                onto = np.concatenate([self._total[None], block[1:]])
                self._total = np.add.reduce(onto, axis=0)

    def _close(self, stamp_ns: int, tracking: Tracking) -> None:
        """End the running block: follow if it was at rest, and begin the next."""
        if self._quiet:
            mean = self._mean()
            moved = self.baseline + tracking.gain * (mean - self.baseline)
            # what was untold begins anew where it is told: the readings were followed meanwhile
            known = self._told is None or not np.isnan(self.baseline).any()
            self.baseline = moved if known else np.where(np.isnan(self.baseline), mean, moved)
            kept, new = (1 - tracking.gain) ** 2, tracking.gain**2 / self._count
            self.doubt = kept * self.doubt + new if self.doubt else 0.0
        self._total = np.zeros(self.baseline.shape)
        self._told = None if self._told is None else np.zeros_like(self._told)
        self._count = 0
        self._begin_ns = stamp_ns
        self._quiet = True

    def _mean(self) -> Array:
        """Mean of the running block, which was at rest; NaN of what was untold."""
        if self._told is None:
            return self._total / self._count
        return self._total / np.where(self._told > 0, self._told, np.nan)


def tare_runs(tare: Bools, restarts: Bools) -> tuple[Integers, Integers]:
    """Number the runs of resting frames and say which run serves each row.

    Parameters
    ----------
    tare, restarts : ndarray, shape (s,)
        Resting frames; rows at which a new stream begins.

    Returns
    -------
    run : ndarray, shape (s,)
        Number of the run that a tare row belongs to, -1 elsewhere.
    serves : ndarray, shape (s,)
        Number of the latest run in the row's stream, -1 where there was none.

    Examples
    --------
    >>> tare = np.array([True, True, False, True, False, False])
    >>> restarts = np.array([True, False, False, False, False, True])
    >>> [x.tolist() for x in tare_runs(tare, restarts)]
    [[0, 0, -1, 1, -1, -1], [0, 0, 0, 1, 1, -1]]
    """
    begins = tare.copy()
    begins[1:] &= ~tare[:-1] | restarts[1:]
    number = np.cumsum(begins) - 1
    stream = np.cumsum(restarts)
    home = np.concatenate([stream[begins], [0]])
    serves = np.where((number >= 0) & (home[number] == stream), number, -1)
    return np.where(tare, number, -1), serves


def tare_means(values: Array, run: Integers) -> Array:
    """Mean of every run of resting frames, a taxel at a time, ignoring NaN.

    Parameters
    ----------
    values : ndarray, shape (s, t, c)
        Frames (unit of values).
    run : ndarray, shape (s,)
        Number of the run, -1 elsewhere.

    Returns
    -------
    ndarray, shape (m, t, c)
        NaN where a run has no good reading of a channel.
    """
    count = int(run.max(initial=-1)) + 1
    rows = run >= 0
    known = np.isfinite(values[rows])
    total = np.zeros((count, *values.shape[1:]))
    hits = np.zeros_like(total)
    np.add.at(total, run[rows], np.where(known, values[rows], 0.0))
    np.add.at(hits, run[rows], known)
    with np.errstate(invalid='ignore'):
        return np.asarray(np.where(hits > 0, total / hits, np.nan))


def tare_level(values: Array, dead: Bools | None) -> Array:
    """Mean of resting frames (s, t, c), shape (t, c), 0 at taxels (t,) that are dead.

    Raises
    ------
    ValueError
        If no taxel was read.
    """
    level: Array = tare_means(values, np.zeros(len(values), np.int64))[0]
    alive = np.ones(len(level), bool) if dead is None else ~dead
    if np.isnan(level[alive]).any(axis=1).all():
        msg = (
            f'frames of tare must hold a usable reading; taxels {np.flatnonzero(alive).tolist()} '
            f'are faulty or unread in each of the {len(values)} received'
        )
        raise ValueError(msg)
    return np.where(alive[:, None], level, 0.0)


def track_streams(
    base: Array,
    values: Array,
    stamp_ns: Integers,
    begins: Bools,
    tracking: Tracking,
    doubt: Array | None = None,
) -> None:
    """Follow the baseline in every stretch of a recording; `base`, `doubt` are changed in place.

    Parameters
    ----------
    base : ndarray, shape (s, t, c)
        Baseline that each stretch starts from.
    values : ndarray, shape (s, t, c)
        Frames (unit of values).
    stamp_ns : ndarray, shape (s,)
        Acquisition times.
    begins : ndarray, shape (s,)
        Rows at which a stretch begins.
    tracking : Tracking
        How it follows.
    doubt : ndarray, shape (s,), or None
        Of the baseline that each stretch starts from; None: nobody asks.
    """
    doubt = np.zeros(len(base)) if doubt is None else doubt
    edges = np.append(np.flatnonzero(begins), len(values))
    first, last = edges[:-1], edges[1:] - 1
    long = stamp_ns[last] - stamp_ns[first] >= tracking.period_ns
    for a, b in zip(first[long], last[long] + 1, strict=True):
        tracker = BaselineTracker(base[a], tracking, float(doubt[a]))
        base[a:b], doubt[a:b] = tracker.follow(values[a:b], stamp_ns[a:b])


def stream_baselines(
    recording: Recording,
    values: Array,
    start: Array,
    tracking: Tracking | None,
    dead: Bools | None = None,
    doubt: float = 0.0,
) -> tuple[Array, Array, Bools, Bools]:
    """Baseline of every row of a recording.

    Parameters
    ----------
    recording : Recording
        Its tare rows give the baseline of what follows in their stream.
    values : ndarray, shape (s, t, c)
        Its readings, NaN where unusable; as `Rest.beside` gives them.
    start : ndarray, shape (t, c)
        Baseline of rows that no tare run precedes; as `Rest.level` has it.
    tracking : Tracking or None
        How the baseline follows in stamped streams.
    dead : ndarray, shape (t,), or None
        Taxels whose readings mean nothing.
    doubt : float
        Variance of `start` over that of a frame.

    Returns
    -------
    base, doubt : ndarray, shape (s, t, c) and (s,)
        Baselines, and their variance over that of a frame at rest.
    restart, tare : ndarray, shape (s,)
        Rows before which memory is forgotten; resting rows that gave a baseline.
    """
    restarts = recording.restarts
    tare = np.zeros(len(restarts), bool) if recording.tare is None else recording.tare
    run, serves = tare_runs(tare, restarts)
    level = tare_means(values, run)
    lost = np.isnan(level[..., : recording.values.shape[2]]).any(axis=2)
    unread = np.all(lost if dead is None else lost | dead, axis=1)
    if unread.any():  # such a run is no tare: the level before it holds on
        tare = tare & ~unread[run]
        run, serves = tare_runs(tare, restarts)
        level = tare_means(values, run)
    base = np.concatenate([level, start[None]])[serves]
    count = np.bincount(run[run >= 0], minlength=len(level))
    doubts = np.concatenate([1 / np.maximum(count, 1), [doubt]])[serves]
    if recording.stamp_ns is None:
        return base, doubts, np.ones(len(restarts), bool), tare
    restart = restarts.copy()
    restart[1:] |= tare[:-1]
    if tracking is not None:
        track_streams(base, values, recording.stamp_ns, restart | tare, tracking, doubts)
    return base, doubts, restart, tare


def learned_doubt(baseline: Array, doubt: Array | None) -> float:
    """Variance that the baselines of a fit leave in what it learns, over that of a frame.

    Parameters
    ----------
    baseline : ndarray, shape (s, t, c)
        Of the rows that were learned from.
    doubt : ndarray, shape (s,), or None
        Variance of each over that of a frame; None: 0.

    Examples
    --------
    Two tares, of 4 and of 12 frames, serve as many rows:

    >>> level = np.array([1.0, 1.0, 2.0, 2.0]).reshape(4, 1, 1)
    >>> round(learned_doubt(level, np.array([1 / 4, 1 / 4, 1 / 12, 1 / 12])), 3)
    0.083
    """
    if doubt is None or not len(doubt) or not doubt.any():
        return 0.0
    rows = baseline.reshape(len(baseline), -1)
    _, first, count = np.unique(rows, axis=0, return_index=True, return_counts=True)
    return float((np.square(count / len(rows)) * doubt[first]).sum())
