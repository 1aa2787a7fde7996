"""The no-contact reference: taken from resting frames, followed while at rest, frozen in contact.

A block of frames (a period of stream time) counts as rest when every frame of it stays within the
contact threshold of the baseline; then the baseline moves a step towards the block's mean. One
frame in contact freezes the whole block, so that a held contact never fades.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from tactile_ros.conditioning.contact import ContactIds, contact_scale, excursion
from tactile_ros.conditioning.noise import (
    MOST_APART_NS,
    held_noise,
    motion_noise,
    rest_noise,
    spread_noise,
)
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
        Its readings, NaN where unusable; as `Rest.with_temperature` gives them.
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


def training_baseline_variance(baseline: Array, doubt: Array | None) -> float:
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
    >>> round(training_baseline_variance(level, np.array([1 / 4, 1 / 4, 1 / 12, 1 / 12])), 3)
    0.083
    """
    if doubt is None or not len(doubt) or not doubt.any():
        return 0.0
    rows = baseline.reshape(len(baseline), -1)
    _, first, count = np.unique(rows, axis=0, return_index=True, return_counts=True)
    return float((np.square(count / len(rows)) * doubt[first]).sum())


FEWEST_PAIRS = 8

COLDEST, HOTTEST = -60.0, 200.0  # degrees Celsius


@dataclass(frozen=True)
class Rest:
    """The state of a sensor that nothing touches.

    Attributes
    ----------
    baseline : ndarray, shape (t, c)
        No-contact reference (unit of values); NaN: none yet.
    noise : ndarray, shape (t, c)
        Standard deviation of a channel; NaN: unknown.
    scale : ndarray, shape (t, c)
        Deviation beyond which something touches; NaN: unknown, inf: never, a dead taxel.
    tared : bool
        False: the estimators were fitted on readings without a baseline, and get such.
    drifts : bool
        True: rests were too short to tell noise from drift between them, and `noise` is at most
        this.
    temperature_c : ndarray, shape (t,), or None
        Of the chips when the baseline was read (degrees Celsius), NaN: not told; None: the
        estimators do not heed it.
    """

    baseline: Array
    noise: Array
    scale: Array
    tared: bool = True
    drifts: bool = False
    temperature_c: Array | None = None

    @classmethod
    def unknown(
        cls, shape: tuple[int, int], stated_noise: float | Array | None, warms: bool = False
    ) -> Rest:
        """Rest of a sensor that has not been recorded, with the noise its config states.

        `warms`: its estimators heed how warm the chips were then.
        """
        stated = np.nan if stated_noise is None else stated_noise
        noise = np.array(np.broadcast_to(np.asarray(stated, np.float64), shape))
        chips = np.full(shape[0], np.nan) if warms else None
        scale = contact_scale(noise, None)
        return cls(np.full(shape, np.nan), noise, scale, temperature_c=chips)

    @property
    def level(self) -> Array:
        """Baseline (t, c); with temperatures, where they are heeded, as one more channel."""
        if self.temperature_c is None:
            return self.baseline
        chips = self._of_living(self.temperature_c)
        return np.concatenate([self.baseline, chips[:, None]], axis=1)

    def with_temperature(self, values: Array, chips: Array | None) -> Array:
        """Readings (s, t, c) as `level` has them: chips tell temperatures (s, t), or None."""
        if self.temperature_c is None:
            return values
        told = np.full(values.shape[:2], np.nan) if chips is None else chips
        return np.concatenate([values, self._of_living(told)[:, :, None]], axis=2)

    def _of_living(self, chips: Array) -> Array:
        """Temperatures (..., t), NaN of what is none and of dead taxels, whose may stand still."""
        told = plausible_temperature(chips)
        return told if self.dead is None else np.where(self.dead, np.nan, told)

    def split(self, levels: Array) -> tuple[Array, Array | None]:
        """Baselines (s, t, c) and temperatures (s, t), or None, of levels as `level` has them."""
        if self.temperature_c is None:
            return levels, None
        return levels[..., :-1], levels[..., -1]

    def tared_by(self, frames: Array) -> Rest:
        """The same with the mean of resting frames (s, t, ...), as `with_temperature` gives them.

        Raises
        ------
        ValueError
            If no taxel was read.
        """
        values, chips = self.split(frames)
        return replace(
            self, baseline=tare_level(values, self.dead), temperature_c=_mean_temperature(chips)
        )

    def learn(
        self,
        values: Array,
        resting: Bools,
        stamp_ns: Integers | None,
        restarts: Bools,
        ordered: bool = True,
        chips: Array | None = None,
    ) -> Rest:
        """Baseline and noise from the resting rows of a recording.

        Parameters
        ----------
        values : ndarray, shape (s, t, c)
            Readings, NaN where unusable (unit of values).
        resting : ndarray, shape (s,)
            Rows that give the baseline; if there is none, readings are used without one.
        stamp_ns : ndarray, shape (s,), or None
            Acquisition times.
        restarts : ndarray, shape (s,)
            Rows at which a stream begins.
        ordered : bool
            False: independent frames, whose order says nothing; what they differ by is noise.
        chips : ndarray, shape (s, t), or None
            Temperatures that they told (degrees Celsius).

        Returns
        -------
        Rest
            With the threshold of contact still to be set by `threshold`.
        """
        if not resting.any():
            return replace(self, baseline=np.zeros(values.shape[1:]), tared=False)
        whole = np.zeros(int(resting.sum()), np.int64)
        baseline = tare_means(values[resting], whole)[0]
        told = self.split(self.with_temperature(values, chips)[resting])[1]
        learned = replace(self, baseline=baseline, temperature_c=_mean_temperature(told))
        if not ordered:
            seen = spread_noise(values[resting])
            noise = np.where(np.isnan(self.noise), seen, self.noise)
            return replace(learned, noise=noise)
        group = _rests(resting, stamp_ns, restarts)
        drifts = int((group[1:] == group[:-1]).sum()) < FEWEST_PAIRS
        if drifts:
            stream = np.cumsum(restarts)[resting]
            group = whole if stamp_ns is None else np.asarray(stream, np.int64)
        seen = rest_noise(values[resting], group)
        begins = restarts.copy()
        begins[1:] |= resting[1:] != resting[:-1]
        if stamp_ns is not None:
            moving = motion_noise(values, stamp_ns, begins)
            # a bound of 0 is of readings below a quantum, or repeated, and none
            seen = np.fmin(seen, np.where(moving > 0, moving, np.nan))
        elif drifts:
            touch = np.asarray(np.cumsum(begins), np.int64)[~resting]
            held = held_noise(values[~resting], touch)
            seen = np.where((held > 0) & (held < seen), held, seen)
        drifts = drifts and bool(np.isnan(self.noise).any())
        noise = np.where(np.isnan(self.noise), seen, self.noise)
        return replace(learned, noise=noise, drifts=drifts)

    @cached_property
    def dead(self) -> Bools | None:
        """Taxels (t,) that were dead in the fit and are left out since; None: there are none."""
        dead: Bools = np.all(np.isinf(self.scale), axis=1)
        return dead if dead.any() else None

    def threshold(
        self, touched: Array, firm: Array | None = None, dead: Bools | None = None
    ) -> Rest:
        """Set the threshold of contact, from the noise and from known touches.

        Parameters
        ----------
        touched, firm : ndarray, shape (s, t, c)
            Deviations of known touches, the lightest among them; of firm ones, which limit the
            threshold where drift passes for noise: where none is known, all touches do.
        dead : ndarray, shape (t,), or None
            Taxels that never touch.

        Returns
        -------
        Rest
            With the threshold.
        """
        known = _whole(touched)
        felt = None if firm is None else _whole(firm)
        felt = known if felt is None else felt
        scale = contact_scale(self.noise, known, felt if self.drifts else None)
        if dead is not None:
            scale[dead] = np.inf
        return replace(self, scale=scale)

    def contact(self, delta: Array, good: Bools, tare: Bools | None) -> npt.NDArray[np.int8]:
        """Say of each frame whether anything touches.

        Parameters
        ----------
        delta : ndarray, shape (s, t, c)
            Deviations from the baseline.
        good, tare : ndarray, shape (s,)
            Rows that may be judged; rows that are known to rest, or None.

        Returns
        -------
        ndarray, shape (s,)
            1 where a channel left the threshold, 0 where none did, -1 unknown.
        """
        if not self.tared:
            return np.full(len(delta), -1, np.int8)
        size = excursion(delta, self.scale)
        if len(size) == 1 and tare is None:
            return np.array([size[0] > 1.0 if good[0] and size[0] >= 0 else -1], np.int8)
        contact = (size > 1.0).astype(np.int8)
        if tare is not None:
            contact[tare] = 0
        judged = good & (size >= 0)  # false for NaN
        if np.count_nonzero(judged) < len(judged):
            contact[~judged] = -1
        return contact


def plausible_temperature(chips: Array) -> Array:
    """Temperatures, NaN of what no chip can have."""
    told = (chips >= COLDEST) & (chips <= HOTTEST)
    return chips if np.count_nonzero(told) == told.size else np.where(told, chips, np.nan)


def _mean_temperature(chips: Array | None) -> Array | None:
    """Mean temperatures (t,) of frames (s, t), each chip by what it told; NaN: it told nothing."""
    if chips is None:
        return None
    return np.asarray(tare_means(chips[:, :, None], np.zeros(len(chips), np.int64))[0, :, 0])


def _whole(touched: Array) -> Array | None:
    """Frames (s, t, c) of which all was read; None if there is none."""
    usable = touched[~np.isnan(touched).any(axis=(1, 2))]
    return usable if len(usable) else None


def _rests(resting: Bools, stamp_ns: Integers | None, restarts: Bools) -> Integers:
    """Number of the rest that each resting row is of: rows that follow near in time."""
    rows = np.flatnonzero(resting)
    ends = (np.diff(rows) > 1) | restarts[rows[1:]]
    if stamp_ns is not None:
        ends |= np.diff(stamp_ns[rows]) > MOST_APART_NS
    return np.concatenate([[0], np.cumsum(ends)])


@dataclass
class Stream:
    """State of one continuous stream of frames.

    Attributes
    ----------
    tracker : BaselineTracker
        Baseline in use.
    memory : object
        What the sensor's features remember.
    ids : ContactIds
        Numbers of touches.
    """

    tracker: BaselineTracker
    memory: object
    ids: ContactIds = field(default_factory=ContactIds)
    _fresh: bool = True
    _newest_ns: int | None = None

    def rebase(self, tracker: BaselineTracker) -> None:
        """Go on from another baseline: what was remembered relative to the old one is void."""
        self.tracker = tracker
        self._fresh = True

    def is_over(self, stamp_ns: Integers | None) -> bool:
        """Whether frames (s,) cannot belong to the stream, since time does not increase."""
        if stamp_ns is None or self._newest_ns is None or not len(stamp_ns):
            return False
        return bool(stamp_ns[0] <= self._newest_ns)

    def admit(self, stamp_ns: Integers | None, count: int) -> Bools:
        """Take in the stamps of the next frames.

        Parameters
        ----------
        stamp_ns : ndarray, shape (s,), or None
            Acquisition times, which increase; None: independent frames, which memory passes over.
        count : int
            Frames s.

        Returns
        -------
        ndarray, shape (s,)
            Rows before which memory is forgotten.
        """
        if stamp_ns is None:
            return np.ones(count, bool)
        restart = np.zeros(count, bool)
        if count:
            restart[0], self._fresh = self._fresh, False
            self._newest_ns = int(stamp_ns[-1])
        return restart
