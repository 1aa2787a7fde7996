# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""The no-contact reference that `pipeline.py` subtracts: taken at rest, followed, then frozen.

A block of frames counts as rest when every frame of it stays within the contact threshold of the
baseline, which then moves a step towards their mean; one frame in contact freezes the block.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from tactile_ros.conditioning.contact import ContactIds, calm_factor, contact_rows, contact_scale
from tactile_ros.physics.compiled import compiled, inlined
from tactile_ros.physics.temperature import plausible_temperature
from tactile_ros.types import Array, Bools, Integers, Recording

PERIOD_NS, GAIN = 1_000_000_000, 0.25  # of a block; step towards the mean of one at rest
FEWEST_PAIRS = 8
MAD_TO_SIGMA = 1.4826
MOST_APART_NS = 500_000_000


class BaselineTracker:
    """Follow the baseline over the frames of one stream, one by one or many at once.

    Attributes
    ----------
    baseline : ndarray, shape (t, c) or more channels
        As it is now; channels beyond those of `scale` (temperatures) follow their finite readings
        and do not count for rest.
    scale : ndarray, shape (t, c), or None
        Deviation that still counts as rest (unit of values); None: the baseline stays.
    variance : ndarray, shape (1,)
        Of the baseline as it is now, over that of a frame at rest.
    """

    def __init__(self, start: Array, scale: Array | None, variance: float = 0.0) -> None:
        self.baseline, self.scale, self.variance = start.copy(), scale, np.array([variance])
        judged = slice(None if scale is None else scale.shape[1])
        self._stays = scale is None or bool(np.isnan(start[:, judged]).any())
        # of the running block: sums, counts; its number of frames, begin, whether it was at rest
        self._total, self._finite = np.zeros(start.shape), np.zeros(start.shape, np.int64)
        self._block = np.zeros(3, np.int64)

    def follow(self, values: Array, stamp_ns: Integers | None) -> tuple[Array, Array]:
        """Baselines (s, t, c) and variances (s,) of frames in time order; fixed without stamps."""
        levels = self.baseline[None].repeat(len(values), axis=0)
        variance = self.variance.repeat(len(values))
        if self.scale is not None and stamp_ns is not None and not self._stays:
            _follow_rows(
                np.ascontiguousarray(values), stamp_ns, self.scale, self.baseline, self.variance,
                self._total, self._finite, self._block, levels, variance,
            )  # fmt: skip
        return levels, variance


@inlined
def _gather(values: Array, baseline: Array, scale: Array, total: Array, finite: Integers) -> bool:
    """Add a frame (t, c) to the sums and counts (t, c); False where it is not at rest."""
    for t in range(scale.shape[0]):
        for c in range(scale.shape[1]):
            if not abs(values[t, c] - baseline[t, c]) <= scale[t, c]:
                return False
    for t in range(total.shape[0]):
        for c in range(total.shape[1]):
            if np.isfinite(values[t, c]):
                total[t, c] += values[t, c]
                finite[t, c] += 1
    return True


@inlined
def _step(baseline: Array, total: Array, finite: Integers) -> None:
    """Move baselines (t, c) towards the means of a block, or there where none was known."""
    for t in range(total.shape[0]):
        for c in range(total.shape[1]):
            mean = total[t, c] / finite[t, c] if finite[t, c] > 0 else np.nan
            known = not np.isnan(baseline[t, c])
            baseline[t, c] = baseline[t, c] + GAIN * (mean - baseline[t, c]) if known else mean


@compiled
def _follow_rows(
    values: Array, stamp_ns: Integers, scale: Array, baseline: Array, variance: Array,
    total: Array, finite: Integers, block: Integers, levels: Array, variances: Array,
) -> None:  # fmt: skip
    """Write baselines (s, t, c) and variances (s,) of frames; both and their block move on."""
    for s in range(len(values)):
        if block[0] > 0 and stamp_ns[s] - block[1] >= PERIOD_NS:
            if block[2] > 0:  # at rest
                _step(baseline, total, finite)
                if variance[0] > 0.0:
                    variance[0] = (1 - GAIN) ** 2 * variance[0] + GAIN**2 / block[0]
            block[0] = 0
        if block[0] == 0:
            total[:], finite[:], block[1], block[2] = 0.0, 0, stamp_ns[s], 1
        levels[s], variances[s] = baseline, variance[0]
        block[0] += 1
        block[2] &= _gather(values[s], baseline, scale, total, finite)


def tare_runs(tare: Bools, restarts: Bools) -> tuple[Integers, Integers]:
    """Number the runs of resting frames (s,), and the latest in each row's stream; -1: none.

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
    """Mean (m, t, c) of every run (s,) (-1: none) of frames (s, t, c), ignoring NaN."""
    count = int(run.max(initial=-1)) + 1
    rows = run >= 0
    finite = np.isfinite(values[rows])
    total = np.zeros((count, *values.shape[1:]))
    hits = np.zeros_like(total)
    np.add.at(total, run[rows], np.where(finite, values[rows], 0.0))
    np.add.at(hits, run[rows], finite)
    return np.asarray(total / np.where(hits > 0, hits, np.nan))


@dataclass  # as Signals
class Baselines:
    """Baselines (s, t, c) of frames that follow one another, and variances (s,) over a frame's.

    Rows of `restart` (s,) forget memory; those of `tare` (s,) gave a baseline.
    """

    levels: Array
    variance: Array
    restart: Bools
    tare: Bools | None = None


def stream_baselines(
    recording: Recording, values: Array, start: BaselineTracker, dead: Bools | None = None
) -> Baselines:
    """Baseline of every row of a recording, whose tare rows give that of what follows.

    `values` (s, t, c) are its readings as `Rest.with_temperature` gives them, NaN where unusable;
    `start` serves rows that no tare run precedes and says how all follow; `dead` (t,) mean
    nothing.
    """
    restarts = recording.restarts
    tare = np.zeros(len(restarts), bool) if recording.tare is None else recording.tare
    run, serves = tare_runs(tare, restarts)
    means = tare_means(values, run)
    lost = np.isnan(means[..., : recording.values.shape[2]]).any(axis=2)
    unread = np.all(lost if dead is None else lost | dead, axis=1)
    if unread.any():  # such a run is no tare: the level before it holds on
        tare = tare & ~unread[run]
        run, serves = tare_runs(tare, restarts)
        means = tare_means(values, run)
    levels = np.concatenate([means, start.baseline[None]])[serves]
    count = np.bincount(run[run >= 0], minlength=len(means))
    variance = np.concatenate([1 / np.maximum(count, 1), start.variance])[serves]
    if recording.stamp_ns is None:
        return Baselines(levels, variance, np.ones(len(restarts), bool), tare)
    restart = restarts.copy()
    restart[1:] |= tare[:-1]
    if start.scale is not None:
        edges = np.append(np.flatnonzero(restart | tare), len(values))
        for a, b in pairwise(edges):
            stamps = recording.stamp_ns[a:b]
            if stamps[-1] - stamps[0] >= PERIOD_NS:
                tracker = BaselineTracker(levels[a], start.scale, float(variance[a]))
                levels[a:b], variance[a:b] = tracker.follow(values[a:b], stamps)
    return Baselines(levels, variance, restart, tare)


def training_baseline_variance(baseline: Array, variance: Array | None) -> float:
    """Variance that baselines (s, t, c) leave in what a fit learns, over that of a frame.

    `variance` (s,) is that of each row's baseline; None: 0.

    Examples
    --------
    Two tares, of 4 and of 12 frames, serve as many rows:

    >>> level = np.array([1.0, 1.0, 2.0, 2.0]).reshape(4, 1, 1)
    >>> round(training_baseline_variance(level, np.array([1 / 4, 1 / 4, 1 / 12, 1 / 12])), 3)
    0.083
    """
    if variance is None or not len(variance) or not variance.any():
        return 0.0
    rows = baseline.reshape(len(baseline), -1)
    _, first, count = np.unique(rows, axis=0, return_index=True, return_counts=True)
    return float((np.square(count / len(rows)) * variance[first]).sum())


@dataclass(frozen=True)
class Rest:
    """State of a sensor that nothing touches.

    Attributes
    ----------
    baseline, noise : ndarray, shape (t, c)
        No-contact reference, and standard deviation (unit of values); NaN: unknown.
    scale : ndarray, shape (t, c)
        Deviation beyond which something touches; NaN: unknown, inf: never, a dead taxel.
    tared : bool
        False: the estimators were fitted on readings without a baseline, and get such.
    drifts : bool
        True: rests were too short to separate noise from drift; `noise` is at most this.
    temperature_c : ndarray, shape (t,), or None
        Of the chips with the baseline, NaN: not measured; None: the estimators do not use it.
    """

    baseline: Array
    noise: Array
    scale: Array
    tared: bool = True
    drifts: bool = False
    temperature_c: Array | None = None

    @classmethod
    def unknown(
        cls, shape: tuple[int, int], stated_noise: float | Array | None,
        uses_temperature: bool = False,
    ) -> Rest:  # fmt: skip
        """Rest of a sensor that has not been recorded, with the noise its config states."""
        stated = np.nan if stated_noise is None else stated_noise
        noise = np.array(np.broadcast_to(np.asarray(stated, np.float64), shape))
        chips = np.full(shape[0], np.nan) if uses_temperature else None
        scale = contact_scale(noise, None)
        return cls(np.full(shape, np.nan), noise, scale, temperature_c=chips)

    @cached_property
    def dead(self) -> Bools | None:
        """Taxels (t,) that were dead in the fit and are left out since; None: there are none."""
        dead: Bools = np.all(np.isinf(self.scale), axis=1)
        return dead if dead.any() else None

    @property
    def level(self) -> Array:
        """Baseline (t, c); with temperatures, where they are used, as one more channel."""
        chips = None if self.temperature_c is None else self.temperature_c[None]
        level: Array = self.with_temperature(self.baseline[None], chips)[0]
        return level

    def with_temperature(self, values: Array, chips: Array | None) -> Array:
        """Readings (s, t, c) as `level` has them, with chip temperatures (s, t) where used."""
        if self.temperature_c is None:
            return values
        chips = np.full(values.shape[:2], np.nan) if chips is None else chips
        measured = plausible_temperature(chips)
        if self.dead is not None:
            measured = np.where(self.dead, np.nan, measured)
        return np.concatenate([values, measured[:, :, None]], axis=2)

    def split(self, levels: Array) -> tuple[Array, Array | None]:
        """Baselines (s, t, c), and temperatures (s, t) or None, of levels as `level` has them."""
        if self.temperature_c is None:
            return levels, None
        return levels[..., :-1], levels[..., -1]

    def tared_by(self, frames: Array) -> Rest:
        """Rest with the mean of resting frames (s, t, ...); ValueError where no taxel was read."""
        level, chips = self.split(tare_means(frames, np.zeros(len(frames), np.int64))[0])
        alive = np.ones(len(level), bool) if self.dead is None else ~self.dead
        if np.isnan(level[alive]).any(axis=1).all():
            msg = (
                f'frames of tare must hold a usable reading; taxels '
                f'{np.flatnonzero(alive).tolist()} are faulty or unread in each of the '
                f'{len(frames)} received'
            )
            raise ValueError(msg)
        return replace(self, baseline=np.where(alive[:, None], level, 0.0), temperature_c=chips)

    def learn(
        self, values: Array, resting: Bools, stamp_ns: Integers | None, restarts: Bools,
        ordered: bool = True, chips: Array | None = None,
    ) -> Rest:  # fmt: skip
        """Rest with baseline and noise of readings (s, t, c), NaN where unusable.

        Rows `resting` (s,) give the baseline; without one, readings are used without it. Streams
        begin at `restarts` (s,). `stamp_ns` (s,) and temperatures `chips` (s, t) (degrees Celsius)
        may be None. All that independent frames (not `ordered`) differ by is noise.
        """
        if not resting.any():
            return replace(self, baseline=np.zeros(values.shape[1:]), tared=False)
        rows = self.with_temperature(values, chips)[resting]
        level, warm = self.split(tare_means(rows, np.zeros(len(rows), np.int64))[0])
        if ordered:
            seen, drifts = _ordered_noise(values, resting, stamp_ns, restarts)
        else:
            seen, drifts = spread_noise(values[resting]), False
        unstated = np.isnan(self.noise)
        return replace(
            self,
            baseline=level,
            temperature_c=warm,
            noise=np.where(unstated, seen, self.noise),
            drifts=drifts and bool(unstated.any()),
        )

    def threshold(
        self, touched: Array, firm: Array | None = None, dead: Bools | None = None,
        calm: Array | None = None,
    ) -> Rest:  # fmt: skip
        """Rest with the threshold of contact, from the noise and from labelled touches (s, t, c).

        The lightest `touched` raise it, `firm` ones (all, where there are none) limit it where
        drift passes for noise; `calm` frames, in which a skin creeps back, raise it as far as firm
        ones allow.
        """
        labelled = _whole(touched)
        felt = None if firm is None else _whole(firm)
        felt = labelled if felt is None else felt
        scale = contact_scale(self.noise, labelled, felt if self.drifts else None)
        if calm is not None and felt is not None:
            scale = scale * calm_factor(_whole(calm), felt, scale)
        if dead is not None:
            scale[dead] = np.inf
        return replace(self, scale=scale)

    def contact(self, delta: Array, good: Bools, tare: Bools | None) -> npt.NDArray[np.int8]:
        """Contact (s,) of deviations (s, t, c): 1, 0, or -1 in rows not `good`; tare rows: 0."""
        if not self.tared:
            return np.full(len(delta), -1, np.int8)
        contact = np.empty(len(delta), np.int8)
        size, readings = np.empty(len(delta)), np.ascontiguousarray(delta)
        contact_rows(readings, self.scale, good, size, contact)
        if tare is not None:
            contact[tare & (contact > 0)] = 0
        return contact


def _whole(touched: Array) -> Array | None:
    """Frames (s, t, c) of which all was read; None if there is none."""
    usable = touched[~np.isnan(touched).any(axis=(1, 2))]
    return usable if len(usable) else None


def _ordered_noise(
    values: Array, resting: Bools, stamp_ns: Integers | None, restarts: Bools
) -> tuple[Array, bool]:
    """Noise (t, c) of rows in time order; True where rests are too short to tell it from drift."""
    rows = np.flatnonzero(resting)
    ends = (np.diff(rows) > 1) | restarts[rows[1:]]
    if stamp_ns is not None:
        ends |= np.diff(stamp_ns[rows]) > MOST_APART_NS
    group = np.concatenate([[0], np.cumsum(ends)])
    drifts = int((group[1:] == group[:-1]).sum()) < FEWEST_PAIRS
    if drifts:
        group = np.zeros(len(rows), np.int64) if stamp_ns is None else np.cumsum(restarts)[resting]
    seen = rest_noise(values[resting], group)
    begins = restarts.copy()
    begins[1:] |= resting[1:] != resting[:-1]
    if stamp_ns is not None:
        moving = motion_noise(values, stamp_ns, begins)
        # a bound of 0 is of readings below a quantum, or repeated, and none
        seen = np.fmin(seen, np.where(moving > 0, moving, np.nan))
    elif drifts:
        held = held_noise(values[~resting], np.cumsum(begins, dtype=np.int64)[~resting])
        seen = np.where((held > 0) & (held < seen), held, seen)
    return seen, drifts


@dataclass
class Stream:
    """State between two frames of a stream: baseline, memory of the features, ids of contacts."""

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
        """True if frames (s,) cannot belong to the stream, since time does not increase."""
        if stamp_ns is None or self._newest_ns is None or not len(stamp_ns):
            return False
        return bool(stamp_ns[0] <= self._newest_ns)

    def follow(self, values: Array, stamp_ns: Integers | None) -> Baselines:
        """Baselines of the next frames (s, t, c); without stamps memory passes over them."""
        levels, variance = self.tracker.follow(values, stamp_ns)
        restart = np.full(len(values), stamp_ns is None)
        if stamp_ns is not None and len(values):
            restart[0], self._fresh = self._fresh, False
            self._newest_ns = int(stamp_ns[-1])
        return Baselines(levels, variance, restart)


def rest_noise(rest: Array, groups: Integers) -> Array:
    """Noise (t, c) of resting frames in time order, drift left out; at least a quantum's.

    Frames are compared with their successor in the same group (s,).
    """
    if len(rest) < 2:
        return np.full(rest.shape[1:], np.nan)
    step = np.diff(rest, axis=0)
    same = groups[1:] == groups[:-1]
    size = np.abs(step[same] if same.any() else step)
    return np.asarray(np.maximum(MAD_TO_SIGMA * _median(size) / np.sqrt(2), _quantum(size)))


def spread_noise(rest: Array) -> Array:
    """Noise (t, c) of resting frames in any order, drift counted in; at least a quantum's."""
    if len(rest) < 2:
        return np.full(rest.shape[1:], np.nan)
    sigma = MAD_TO_SIGMA * _median(np.abs(rest - _median(rest)))
    return np.asarray(np.maximum(sigma, _quantum(np.diff(np.sort(rest, axis=0), axis=0))))


def motion_noise(values: Array, stamp_ns: Integers, restart: Bools) -> Array:
    """Noise (t, c) of frames in time order, from second differences of those near in time.

    Motion makes it too large, never much too small. `restart` (s,): a stream or baseline begins.
    """
    apart = np.diff(stamp_ns) > MOST_APART_NS
    joined = ~(restart[2:] | restart[1:-1] | apart[1:] | apart[:-1])
    if not joined.any():
        return np.full(values.shape[1:], np.nan)
    bend = (values[2:] - 2 * values[1:-1] + values[:-2])[joined]
    return np.asarray(MAD_TO_SIGMA * _median(np.abs(bend)) / np.sqrt(6))


def held_noise(values: Array, groups: Integers) -> Array:
    """Noise (t, c) of frames inside groups (s,), one of each touch, whatever their order.

    Notes
    -----
    The median of chi-squared of k degrees of freedom is near k (1 - 2 / (9 k))^3 (Wilson and
    Hilferty, 1931).
    """
    read = np.isfinite(values).all(axis=(1, 2))
    rows = values[read]
    _, group, count = np.unique(groups[read], return_inverse=True, return_counts=True)
    group = np.asarray(group).reshape(-1)
    mean, square = np.zeros((2, len(count), *values.shape[1:]))
    np.add.at(mean, group, rows / count[group, None, None])
    np.add.at(square, group, (rows - mean[group]) ** 2)
    free = (count[count > 1] - 1)[:, None, None]
    if not len(free):
        return np.full(values.shape[1:], np.nan)
    middle = free * (1 - 2 / (9 * free)) ** 3
    return np.asarray(np.sqrt(np.median(square[count > 1] / middle, axis=0)))


def _quantum(size: Array) -> Array:
    """Noise of a quantum: the smallest step (s, t, c) of every channel that is not 0, or 0."""
    quantum = np.where(size > 0, size, np.inf).min(axis=0)
    return np.asarray(np.where(np.isfinite(quantum), quantum, 0.0) / np.sqrt(12))


def _median(size: Array) -> Array:
    """Median over s of every channel (s, t, c), ignoring NaN; NaN where nothing was read."""
    read = ~np.isnan(size).all(axis=0)
    middle = np.full(size.shape[1:], np.nan)
    if read.any():
        middle[read] = np.nanmedian(size[:, read], axis=0)
    return middle
