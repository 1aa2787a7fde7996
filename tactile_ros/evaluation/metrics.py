# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Errors against truth (SI), the share that stated covariances cover, and errors of classes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import astuple, dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt
from scipy.special import bdtr

from tactile_ros.sensors.regression import places_of
from tactile_ros.types import Array, Bools, Columns, ContactStates, Integers, Recording, groups_of
from tactile_ros.types.recording import calm_rows, touched_rows

ONE_SIGMA = 0.6826894921370859
WITHIN = {1: ONE_SIGMA, 2: 0.9544997361036416}
TOLERANCE = 0.05  # of a coverage
MOST_AHEAD = 0.01  # of contacts that may be heard before the stamps of their frames
CLASSES = ('cell', 'label', 'in_contact', 'slip')
ROWS = ('truth', 'estimate', 'error', 'variance', 'rows', 'time_s', 'since_s', 'groups')
LEAST_TOUCH = 0.1  # N, of a force that must be reported as contact
AXES = 'xyz'
SAME = 1e-9  # largest difference of a replay that repeats its live run
# what truth can judge: unit, state attribute and components; the place counts in the plane
TARGETS = {
    'position': ('m', 'position', [0, 1]),
    **{
        f'{key}_{axis}': (unit, key, [i])
        for key, unit in (('force', 'N'), ('torque', 'N m'))
        for i, axis in enumerate(AXES)
    },
}


@dataclass(frozen=True)
class Spread:
    """Summary of magnitudes, in their unit; NaN where there are none."""

    count: int
    mean: float
    rms: float
    p50: float
    p95: float
    p99: float
    largest: float


NOTHING = Spread(0, *[float('nan')] * 6)


def spread(values: npt.ArrayLike) -> Spread:
    """Summarise magnitudes (n,); NaN is left out, signs are dropped."""
    sizes = np.abs(np.asarray(values, np.float64))
    sizes = sizes[np.isfinite(sizes)]
    if not len(sizes):
        return NOTHING
    p50, p95, p99 = (float(p) for p in np.percentile(sizes, [50, 95, 99]))
    rms = float(np.sqrt(np.mean(sizes**2)))
    return Spread(len(sizes), float(sizes.mean()), rms, p50, p95, p99, float(sizes.max()))


@dataclass(frozen=True)
class Coverage:
    """Share of errors inside one or two standard deviations of their own estimate."""

    share: float  # 0.683 or 0.954 where covariances are right; NaN without covariances
    low: float  # accepted: to within 5 points, or the 95 % binomial interval over the groups
    high: float
    count: int  # errors
    groups: int

    @property
    def honest(self) -> bool:
        """The share is accepted."""
        return self.low <= self.share <= self.high


def coverage_range(share: float, groups: int) -> tuple[float, float]:
    """Range of a share that is accepted: 5 points, or the 95 % binomial interval if wider."""
    below = bdtr(np.arange(groups + 1), groups, share)  # of a binomial distribution
    low, high = (float(end) / groups for end in np.searchsorted(below, (0.025, 0.975)))
    return min(low, share - TOLERANCE), max(high, share + TOLERANCE)


def coverage(error: Array, variance: Array, groups: Integers, sigmas: int = 1) -> Coverage:
    """Compare errors (n,) with the variances that were stated for them (unit squared).

    NaN is left out; groups (n,) are what errors have in common: a place, press cycle or
    recording; errors are counted inside 1 or 2 sigmas.
    """
    kept = np.isfinite(error) & np.isfinite(variance)
    count, aimed = int(kept.sum()), WITHIN[sigmas]
    if not count:
        return Coverage(float('nan'), aimed - TOLERANCE, aimed + TOLERANCE, 0, 0)
    inside = np.abs(error[kept]) <= sigmas * np.sqrt(variance[kept])
    number = len(np.unique(groups[kept]))
    return Coverage(float(inside.mean()), *coverage_range(aimed, number), count, number)


def accuracy(said: Integers, true: Integers) -> float:
    """Share of touches (s,) whose class is named rightly (%)."""
    return 100 * float((said == true).mean())


def confusion(said: Integers, true: Integers, count: int) -> Array:
    """Share (n, n) of the touches of each true class (row) that was named so (column) (%).

    Rows of classes without touches are NaN; touches without a name (-1) lack from the sum.
    """
    table = np.zeros((count, count + 1))
    np.add.at(table, (true, np.where(said < 0, count, said)), 1.0)
    touched = table.sum(axis=1, keepdims=True)
    return np.asarray(100 * table[:, :count] / np.where(touched > 0, touched, np.nan))


@dataclass(frozen=True)
class ClassErrors:
    """Classes of one kind that one estimator names in the rows whose truth is measured."""

    name: str  # one of `CLASSES`
    true: Integers  # (n,)
    said: Integers  # (n,); -1: none or abstained, or not valid

    @property
    def right(self) -> float:
        """Share that is named rightly (%); none counts as wrong."""
        return accuracy(self.said, self.true)

    @property
    def hits(self) -> Counter[str]:
        """Rows that are right, wrong and abstained."""
        right, abstained = int((self.said == self.true).sum()), int((self.said < 0).sum())
        wrong = len(self.true) - right - abstained
        return Counter(right=right, wrong=wrong, abstained=abstained)

    @property
    def table(self) -> Array:
        """Share (n, n) (%) of each true class (row) that was named so (column)."""
        return confusion(self.said, self.true, int(max(self.true.max(), self.said.max())) + 1)

    @classmethod
    def pool(cls, parts: Sequence[ClassErrors]) -> ClassErrors:
        """Rows of several recordings together."""
        true, said = (np.concatenate([getattr(p, n) for p in parts]) for n in ('true', 'said'))
        return cls(parts[0].name, true, said)


def class_errors(truth: Columns, states: ContactStates) -> tuple[ClassErrors, ...]:
    """True and estimated classes of each kind that has truth, in the rows with it."""
    found = []
    for name in CLASSES:
        true = np.asarray(truth.get(name, np.full(len(states), -1)), np.int64)
        said = np.where(states.valid, getattr(states, name), -1).astype(np.int64)
        if (rows := true >= 0).any():
            found.append(ClassErrors(name, true[rows], said[rows]))
    return tuple(found)


@dataclass(frozen=True)
class ContactErrors:
    """Contact as it is reported in n frames that are known as touched or at rest.

    A frame is at rest where truth says so, or a load cell along z tells nothing; it is touched
    where truth says so, places a contact, or tells `LEAST_TOUCH` or more. Tares are in neither.
    """

    touched: Bools  # (n,)
    reported: Integers  # (n,) 1 contact, 0 none, -1 not reported
    force: Array  # (n,) size of the true force (N); NaN: unknown
    estimate: Array  # (n,) size of the estimated force (N); NaN: none
    release_s: Array  # (m,) from unloading until no contact is reported (s)

    @property
    def contact_at_rest(self) -> float:
        """Share of frames at rest that are called contacts (%); NaN: there are none."""
        return _percent(self.reported[~self.touched] == 1)

    @property
    def found(self) -> float:
        """Share of firm frames that are called contacts (%); NaN: there are none."""
        return _percent(self.reported[self.firm] == 1)

    @property
    def firm(self) -> Bools:
        """Touched frames (n,) of `LEAST_TOUCH` or more where the force is known."""
        return self.touched & ~(self.force < LEAST_TOUCH)

    @property
    def table(self) -> Array:
        """Share (2, 2) (%) of frames at rest and touched (rows) reported as none and contact."""
        return confusion(self.reported, self.touched.astype(np.int64), 2)

    @classmethod
    def pool(cls, parts: Sequence[ContactErrors]) -> ContactErrors:
        """Frames of several recordings together."""
        return cls(*(np.concatenate(column) for column in zip(*map(astuple, parts), strict=True)))


def _percent(hits: Bools) -> float:
    return 100 * float(hits.mean()) if len(hits) else float('nan')


def contact_errors(recording: Recording, states: ContactStates) -> ContactErrors | None:
    """Contact of s states beside truth; None where either is unknown in every row."""
    truth, reported = recording.truth, np.asarray(states.in_contact, np.int64)
    known = np.asarray(truth.get('in_contact', np.full(len(reported), -1)), np.int64)
    force = np.asarray(truth.get('force', np.full((len(reported), 3), np.nan)), np.float64)
    size, estimate = (
        np.where(np.isfinite(one).any(axis=1), np.sqrt(np.nansum(one**2, axis=1)), np.nan)
        for one in (force, states.force)
    )
    tare = np.zeros(len(reported), bool) if recording.tare is None else recording.tare
    calm = calm_rows(recording) & np.isfinite(force[:, 2])
    rest = ((known == 0) | ((known < 0) & calm)) & ~tare
    touched = ~rest & ~tare & (touched_rows(recording) | (known == 1) | (size >= LEAST_TOUCH))
    rows = np.flatnonzero(rest | touched)
    if not len(rows) or (reported[rows] < 0).all():
        return None
    true = np.where(touched, 1, np.where(rest | tare, 0, -1))
    release = _release_times(recording, true, reported, tare)
    return ContactErrors(touched[rows], reported[rows], size[rows], estimate[rows], release)


def _release_times(recording: Recording, true: Integers, reported: Integers, tare: Bools) -> Array:
    """Times (m,) from unloading, a tare apart, until no contact or the next is reported (s)."""
    time_s, stream = times_of(recording), np.cumsum(recording.restarts)
    rows = np.flatnonzero(true >= 0)
    edges = (true[rows[1:]] != true[rows[:-1]]) & (stream[rows[1:]] == stream[rows[:-1]])
    begins = rows[1:][edges & (true[rows[1:]] == 0) & ~tare[rows[1:]]]
    over = np.append((reported == 0) | (true == 1) | recording.restarts, True)
    ends = [int(begin + np.argmax(over[begin:])) for begin in begins.tolist()]
    found = time_s[np.minimum(ends, len(time_s) - 1)] - time_s[begins] if ends else np.zeros(0)
    return np.asarray(found[np.isfinite(found)])


@dataclass(frozen=True)
class TargetErrors:
    """Estimates of one target beside its truth; NaN: not estimated, or not to be used.

    The place in the plane has d = 2 components, every other target one.
    """

    name: str  # 'position', 'force_x'...
    unit: str  # 'm', 'N', 'N m'
    rows: Integers  # (n,) of the recording, where the truth is measured
    truth: Array  # (n, d)
    estimate: Array
    error: Array
    variance: Array
    missed: int  # rows without an estimate
    invalid: int  # rows not to be used for control
    time_s: Array  # (n,) from the first row of the recording (s); NaN: independent frames
    since_s: Array  # (n,) from the latest tare (s); NaN: none before
    groups: Integers  # (n,) place, press cycle or recording, which errors have in common

    @cached_property
    def spread(self) -> Spread:
        """Summary of the norm of the error."""
        return spread(self.size)

    @cached_property
    def coverage(self) -> Coverage:
        """Coverage of all components together."""
        groups = np.repeat(self.groups, self.error.shape[1])
        return coverage(self.judged.ravel(), self.variance.ravel(), groups)

    @property
    def judged(self) -> Array:
        """Errors (n, d) a covariance answers for: NaN where nothing was and nothing was said."""
        nothing = (self.truth == 0) & (self.estimate == 0)
        return np.where(nothing, np.nan, self.error)

    @property
    def varies(self) -> bool:
        """True where the truth is more than one value: of a constant there is nothing to draw."""
        return bool(len(self.truth)) and bool(np.ptp(self.truth, axis=0).any())

    @property
    def size(self) -> Array:
        """Norm of the error, shape (n,); NaN where nothing was estimated."""
        return np.asarray(np.sqrt((self.error**2).sum(axis=1)))

    @property
    def known(self) -> int:
        """Rows with truth."""
        return self.spread.count + self.missed + self.invalid

    @classmethod
    def pool(cls, parts: Sequence[TargetErrors]) -> TargetErrors:
        """Errors of one target in several recordings, each of which is a group."""
        arrays = {name: np.concatenate([getattr(part, name) for part in parts]) for name in ROWS}
        arrays['groups'] = np.repeat(np.arange(len(parts)), [len(part.rows) for part in parts])
        missed, invalid = (sum(getattr(p, name) for p in parts) for name in ('missed', 'invalid'))
        rest = {'missed': missed, 'invalid': invalid, **arrays}
        return cls(parts[0].name, parts[0].unit, **rest)  # type: ignore[arg-type]


def given_targets(states: ContactStates) -> tuple[str, ...]:
    """Those of `TARGETS` that are estimated in some row."""
    return tuple(
        name
        for name, (_, key, axes) in TARGETS.items()
        if np.isfinite(getattr(states, key)[:, axes]).all(axis=1).any()
    )


def target_errors(recording: Recording, states: ContactStates) -> tuple[TargetErrors, ...]:
    """Errors of every target with truth in the s rows: the place first, then components."""
    found = []
    others, time_s = np.asarray(groups_of(recording)['group'], np.int64), times_of(recording)
    since_s = tare_age(recording)
    for name, (unit, key, axes) in TARGETS.items():
        if key not in recording.truth:
            continue
        stated = np.asarray(recording.truth[key], np.float64)[:, axes]
        rows = np.flatnonzero(np.isfinite(stated).all(axis=1))
        if not len(rows):
            continue
        places = places_of(stated) if name == 'position' else None
        groups = others if places is None else places
        estimate = getattr(states, key)[rows][:, axes]
        variance = np.diagonal(getattr(states, f'{key}_cov')[rows], axis1=1, axis2=2)[:, axes]
        usable, there = states.valid[rows], np.isfinite(estimate).all(axis=1)
        estimate = np.where((usable & there)[:, None], estimate, np.nan)
        found.append(TargetErrors(
            name, unit, rows, stated[rows], estimate, estimate - stated[rows], variance,
            int((usable & ~there).sum()), int((~usable).sum()), time_s[rows], since_s[rows],
            groups[rows],
        ))  # fmt: skip
    return tuple(found)


def times_of(recording: Recording) -> Array:
    """Time of each row since the first (s), shape (s,); NaN: independent frames."""
    stamps = recording.stamp_ns
    if stamps is None:
        return np.full(len(recording), np.nan)
    return np.asarray((stamps - stamps[:1]) * 1e-9, np.float64)


def tare_age(recording: Recording) -> Array:
    """Time of each row since the latest tare row of its stream (s), shape (s,); NaN: none."""
    time_s, count = times_of(recording), len(recording)
    if recording.tare is None:
        return np.full(count, np.nan)
    row = np.arange(count)
    last = np.maximum.accumulate(np.where(recording.tare, row, -1))
    begin = np.maximum.accumulate(np.where(recording.restarts, row, 0))
    return np.where(last >= begin, time_s - time_s[last], np.nan)


def unjudged(name: str, counts: Mapping[str, int], given: Sequence[str]) -> tuple[str, ...]:
    """Sentence where truth and estimates have nothing in common; empty where an error is known.

    `counts` are the errors of every target with truth, `given` the estimated targets.
    """
    if any(counts.values()):
        return ()
    if both := [target for target in counts if target in given]:
        return (f'{name} has no error: no row with true {_listed(both)} has an estimate',)
    return (f'{name} has no error: it estimates {_listed(given)}, truth has {_listed([*counts])}',)


def _listed(names: Sequence[str]) -> str:
    return ', '.join(names) or f'none of {", ".join(TARGETS)}'


def frames_dropped(sequence: Integers | None, restarts: Bools) -> int:
    """Gaps of the frame counter (s,) inside streams, which begin at the restarts (s,)."""
    if sequence is None or len(sequence) < 2:
        return 0
    return int(np.maximum((np.diff(sequence) - 1)[~restarts[1:]], 0).sum())


@dataclass(frozen=True)
class Agreement:
    """Replay against the contacts of the live run."""

    frames: int  # compared
    without_contacts: int  # frames that the live node did not see, which are left out
    differences: dict[str, float]  # largest of each attribute, where both have it
    alone: int = 0  # frames in which only one has an attribute

    def __add__(self, other: Agreement) -> Agreement:
        worst = {
            name: max(self.differences.get(name, 0.0), other.differences.get(name, 0.0))
            for name in dict.fromkeys([*self.differences, *other.differences])
        }
        missing = self.without_contacts + other.without_contacts
        return Agreement(self.frames + other.frames, missing, worst, self.alone + other.alone)

    @property
    def largest(self) -> float:
        """Largest difference of all; 0 where nothing was compared, inf where one stands alone."""
        return float('inf') if self.alone else max(self.differences.values(), default=0.0)

    def __str__(self) -> str:
        """Largest differences (SI), in a sentence."""
        sizes = ((n, self.differences.get(n, 0.0)) for n in ('in_contact', 'position', 'force'))
        most = ', '.join(f'{name} {size:.2g}' for name, size in sizes if size > SAME)
        most = most or f'{max(self.differences.values(), default=0.0):.1g}'
        alone = f'; in {self.alone:,} of them one alone has an estimate' if self.alone else ''
        where = f'{self.frames:,} frames{alone}'
        return f'replay and live contacts differ by at most {most} in {where}'

    @property
    def problems(self) -> tuple[str, ...]:
        """A sentence where frames have no contacts."""
        count, reason = self.without_contacts, 'the live node did not see them'
        return (f'{count} frames without contacts were left out: {reason}',) if count else ()
