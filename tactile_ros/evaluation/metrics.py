"""Errors against truth, and how far the covariances tell the truth about them. Pure; SI units."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from scipy import stats

from tactile_ros.types import Array, Bools, Integers, groups_of

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from tactile_ros.types import ContactStates, Recording

ONE_SIGMA, TWO_SIGMA = 0.6826894921370859, 0.9544997361036416
WITHIN = {1: ONE_SIGMA, 2: TWO_SIGMA}
THIRDS = ('least third', 'middle third', 'largest third')
TOLERANCE = 0.05


@dataclass(frozen=True)
class Coverage:
    """Share of errors inside one or two standard deviations of their own estimate.

    Attributes
    ----------
    share : float
        0..1; 0.683 or 0.954 where covariances tell the truth; NaN without covariances.
    low, high : float
        What is accepted: the same to within 5 points, or the 95 % binomial interval over the
        groups where that is wider.
    count, groups : int
        Errors, and the groups that they come from.
    """

    share: float
    low: float
    high: float
    count: int
    groups: int

    @property
    def honest(self) -> bool:
        """Whether the share is one that is accepted."""
        return self.low <= self.share <= self.high


def coverage(error: Array, variance: Array, groups: Integers, sigmas: int = 1) -> Coverage:
    """Compare errors with the variances that were stated for them.

    Parameters
    ----------
    error, variance : ndarray, shape (n,)
        Of one component (unit, unit squared); NaN is left out.
    groups : ndarray, shape (n,)
        What errors have in common: place, press cycle, recording.
    sigmas : int
        Standard deviations, inside which errors are counted: 1 or 2.

    Returns
    -------
    Coverage
        With the interval that as many independent groups allow.
    """
    known = np.isfinite(error) & np.isfinite(variance)
    count, aimed = int(known.sum()), WITHIN[sigmas]
    if not count:
        return Coverage(float('nan'), aimed - TOLERANCE, aimed + TOLERANCE, 0, 0)
    inside = np.abs(error[known]) <= sigmas * np.sqrt(variance[known])
    number = len(np.unique(groups[known]))
    low, high = stats.binom.interval(0.95, number, aimed)
    return Coverage(
        float(inside.mean()),
        min(float(low) / number, aimed - TOLERANCE),
        max(float(high) / number, aimed + TOLERANCE),
        count,
        number,
    )


def coverage_by_thirds(
    error: Array, variance: Array, groups: Integers
) -> dict[tuple[str, int], Coverage]:
    """Coverage overall and within each third of the stated variance, at one and two sigma.

    Parameters
    ----------
    error, variance : ndarray, shape (n,)
        Of one component (unit, unit squared); NaN is left out.
    groups : ndarray, shape (n,)
        As for `coverage`.

    Returns
    -------
    dict of (part, sigmas) to Coverage
        Parts are 'overall' and the `THIRDS`.
    """
    known = np.flatnonzero(np.isfinite(error) & np.isfinite(variance))
    order = known[np.argsort(variance[known], kind='stable')]
    parts = {
        'overall': order,
        **dict(zip(THIRDS, np.array_split(order, len(THIRDS)), strict=True)),
    }
    return {
        (part, sigmas): coverage(error[rows], variance[rows], groups[rows], sigmas)
        for part, rows in parts.items()
        for sigmas in WITHIN
    }


def accuracy(said: Integers, true: Integers) -> float:
    """Share of touches (s,) whose cell is named rightly (%).

    Examples
    --------
    >>> accuracy(np.array([0, 1, 1, -1]), np.array([0, 1, 2, 2]))
    50.0
    """
    return 100 * float((said == true).mean())


def confusion(said: Integers, true: Integers, count: int) -> Array:
    """Share (n, n) of the touches of each true cell (row) that was named so (column) (%).

    Rows of cells that were never touched are NaN; touches without a name lack from the sum.

    Examples
    --------
    >>> confusion(np.array([0, 1, 1, -1]), np.array([0, 0, 1, 1]), 2).tolist()
    [[50.0, 50.0], [0.0, 50.0]]
    """
    table = np.zeros((count, count + 1))
    np.add.at(table, (true, np.where(said < 0, count, said)), 1.0)
    touched = table.sum(axis=1, keepdims=True)
    return np.asarray(100 * table[:, :count] / np.where(touched > 0, touched, np.nan))


def average_euclidean_error(said: Integers, true: Integers, centres: Array) -> float:
    """Mean distance of the named cell's centre from the true one's, seen from above (mm).

    Examples
    --------
    >>> centres = np.array([[0.0, 0.0, 0.0], [3e-3, 4e-3, 9.0]])
    >>> average_euclidean_error(np.array([0, 0]), np.array([0, 1]), centres)
    2.5
    """
    apart = centres[said, :2] - centres[true, :2]
    return 1e3 * float(np.hypot(apart[:, 0], apart[:, 1]).mean())


KINDS = ('cell', 'label')


@dataclass(frozen=True)
class Named:
    """What one estimator named on the rows whose truth is known.

    Attributes
    ----------
    name : str
        'cell' or 'label'.
    true, said : ndarray of int, shape (n,)
        Indices; -1 said: none or abstained, or not valid.
    """

    name: str
    true: Integers
    said: Integers

    @property
    def right(self) -> float:
        """Share that is named rightly (%); none counts as wrong."""
        return accuracy(self.said, self.true)

    @property
    def abstained(self) -> float:
        """Share without a name (%)."""
        return 100 * float((self.said < 0).mean())

    @property
    def count(self) -> int:
        """Rows whose truth is known."""
        return len(self.true)

    @property
    def table(self) -> Array:
        """Share (n, n) (%) of each true class (row) that was named so (column)."""
        count = int(max(self.true.max(), self.said.max())) + 1
        return confusion(self.said, self.true, count)


def named_rows(
    truth: Mapping[str, npt.NDArray[np.generic]], states: ContactStates
) -> Iterator[tuple[str, Integers, Integers]]:
    """Kind, true and said classes (n,) of the rows (s) that truth knows; -1 said: none."""
    for name in KINDS:
        if name not in truth:
            continue
        true = np.asarray(truth[name], np.int64)
        said = np.where(states.valid, getattr(states, name), -1).astype(np.int64)
        rows = true >= 0
        if rows.any():
            yield name, true[rows], said[rows]


def named(recording: Recording, states: ContactStates) -> tuple[Named, ...]:
    """Classes that are both known and named in at least one row."""
    return tuple(
        Named(name, true, said)
        for name, true, said in named_rows(recording.truth, states)
        if (said >= 0).any()
    )


PLACE = 1e-5
MOST_SINGLE = 0.9  # places per touch above which touches, not places, are what repeats
MOST_AHEAD = 0.01  # of contacts that may be heard before the stamps of their frames
AXES = 'xyz'
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
    """How large a magnitude is.

    Attributes
    ----------
    count : int
        Values that are known.
    mean, rms, p50, p95, p99, largest : float
        Of the values (their unit); NaN where there are none.
    """

    count: int
    mean: float
    rms: float
    p50: float
    p95: float
    p99: float
    largest: float


def spread(values: npt.ArrayLike) -> Spread:
    """Summarise magnitudes.

    Parameters
    ----------
    values : array_like, shape (n,)
        NaN is left out; signs are dropped.

    Returns
    -------
    Spread
        In the unit of the values.
    """
    known = np.abs(np.asarray(values, np.float64))
    known = known[np.isfinite(known)]
    if not len(known):
        return Spread(0, *[float('nan')] * 6)
    p50, p95, p99 = (float(p) for p in np.percentile(known, [50, 95, 99]))
    rms = float(np.sqrt(np.mean(known**2)))
    return Spread(len(known), float(known.mean()), rms, p50, p95, p99, float(known.max()))


@dataclass(frozen=True)
class TargetErrors:
    """Errors of one target: the place in the plane, or one component of force or torque.

    Attributes
    ----------
    name, unit : str
        'position', 'force_x'...; 'm', 'N', 'N m'.
    truth, estimate, error, variance : ndarray, shape (n, d)
        Rows where the truth is known; d is 2 for position, else 1. NaN: not estimated.
    rows : ndarray, shape (n,)
        Rows of the recording.
    time_s : ndarray, shape (n,)
        Of each row, from the first of the recording (s); NaN: independent frames.
    groups : ndarray, shape (n,)
        What errors have in common.
    missed, invalid : int
        Rows without an estimate; rows not to be used for control. Neither is in the spread.
    spread : Spread
        Of the norm of the error.
    coverage : Coverage
        Components pooled.
    """

    name: str
    unit: str
    truth: Array
    estimate: Array
    error: Array
    variance: Array
    rows: Integers
    time_s: Array
    groups: Integers
    missed: int
    invalid: int
    spread: Spread
    coverage: Coverage

    @property
    def varies(self) -> bool:
        """Whether the truth is more than one value: of a constant there is nothing to draw."""
        return bool(len(self.truth)) and bool(np.ptp(self.truth, axis=0).any())

    @property
    def size(self) -> Array:
        """Norm of the error, shape (n,); NaN where nothing was estimated."""
        return np.asarray(np.sqrt((self.error**2).sum(axis=1)))

    @property
    def known(self) -> int:
        """Rows with known truth."""
        return self.spread.count + self.missed + self.invalid


@dataclass(frozen=True)
class Judged:
    """Answers beside the truth that is known of one target.

    Attributes
    ----------
    rows : ndarray, shape (n,)
        Where the truth is known.
    truth, estimate, error, variance : ndarray, shape (n, d)
        NaN: not estimated, or not to be used.
    missed, invalid : int
        Rows without an estimate; rows not to be used for control.
    """

    rows: Integers
    truth: Array
    estimate: Array
    error: Array
    variance: Array
    missed: int
    invalid: int


def judge(
    name: str, truth: Mapping[str, npt.NDArray[np.generic]], states: ContactStates
) -> Judged:
    """Compare the answers to one of `TARGETS` with its truth; no row where none is told.

    Parameters
    ----------
    name : str
        Of the target.
    truth : mapping
        Of a recording of s frames.
    states : ContactStates
        For the same s frames.
    """
    _, key, axes = TARGETS[name]
    count = len(states.valid)
    told = np.asarray(truth.get(key, np.full((count, 3), np.nan)), np.float64)[:, axes]
    rows = np.flatnonzero(np.isfinite(told).all(axis=1))
    estimate = getattr(states, key)[rows][:, axes]
    variance = np.diagonal(getattr(states, f'{key}_cov')[rows], axis1=1, axis2=2)[:, axes]
    usable = states.valid[rows]
    there = np.isfinite(estimate).all(axis=1)
    estimate = np.where((usable & there)[:, None], estimate, np.nan)
    missed, invalid = int((usable & ~there).sum()), int((~usable).sum())
    told = told[rows]
    return Judged(rows, told, estimate, estimate - told, variance, missed, invalid)


def given_targets(states: ContactStates) -> tuple[str, ...]:
    """Those of `TARGETS` that are estimated in some row."""
    return tuple(
        name
        for name, (_, key, axes) in TARGETS.items()
        if np.isfinite(getattr(states, key)[:, axes]).all(axis=1).any()
    )


def target_errors(recording: Recording, states: ContactStates) -> tuple[TargetErrors, ...]:
    """Errors of everything that is both known and estimated by components.

    Parameters
    ----------
    recording : Recording
        With truth for s frames.
    states : ContactStates
        For the same s frames.

    Returns
    -------
    tuple of TargetErrors
        Position (in the plane) first, then components of force and torque with known truth.
    """
    found = []
    groups = np.asarray(groups_of(recording)['group'], np.int64)
    time_s = times_of(recording)
    for name, (_, key, axes) in TARGETS.items():
        seen = judge(name, recording.truth, states)
        if not len(seen.rows):
            continue
        own = groups
        if name == 'position':
            own = place_groups(np.asarray(recording.truth[key], np.float64)[:, axes], groups)
        found.append(summarised(name, seen, own[seen.rows], time_s[seen.rows]))
    return tuple(found)


def times_of(recording: Recording) -> Array:
    """Time of each row since the first (s), shape (s,); NaN: independent frames."""
    stamps = recording.stamp_ns
    if stamps is None:
        return np.full(len(recording), np.nan)
    return np.asarray((stamps - stamps[:1]) * 1e-9, np.float64)


def place_groups(plane: Array, otherwise: Integers) -> Integers:
    """Number of the touched place where places repeat, else other groups; shape (s,)."""
    rows = np.flatnonzero(np.isfinite(plane).all(axis=1))
    if not len(rows):
        return otherwise
    _, place = np.unique(np.round(plane[rows] / PLACE), axis=0, return_inverse=True)
    place = np.asarray(place).reshape(-1)
    if place.max() + 1 > MOST_SINGLE * len(rows):
        return otherwise
    groups = np.full(len(plane), -1, np.int64)
    groups[rows] = place
    return groups


def summarised(name: str, seen: Judged, groups: Integers, time_s: Array) -> TargetErrors:
    """Errors of one target (rows n) with their summary; groups and times (s) of its rows."""
    width = seen.error.shape[1]
    return TargetErrors(
        name,
        TARGETS[name][0],
        seen.truth,
        seen.estimate,
        seen.error,
        seen.variance,
        seen.rows,
        time_s,
        groups,
        missed=seen.missed,
        invalid=seen.invalid,
        spread=spread(np.sqrt((seen.error**2).sum(axis=1))),
        coverage=coverage(seen.error.ravel(), seen.variance.ravel(), np.repeat(groups, width)),
    )


def frames_dropped(sequence: Integers | None, restarts: Bools) -> int:
    """Frames lost on the way: gaps of the counter inside streams.

    Parameters
    ----------
    sequence : ndarray, shape (s,), or None
        Frame counter; None: nothing is known, 0.
    restarts : ndarray, shape (s,)
        Rows at which a new stream begins.

    Returns
    -------
    int
        Sum of the gaps.
    """
    if sequence is None or len(sequence) < 2:
        return 0
    gaps = np.diff(sequence) - 1
    return int(np.maximum(gaps[~restarts[1:]], 0).sum())


def clocks_apart(count: int, ahead: int) -> tuple[str, ...]:
    """A sentence where contacts were heard before their frames, so that no latency is known.

    Parameters
    ----------
    count, ahead : int
        Contacts; those of them that were heard before the stamp of their frame.

    Returns
    -------
    tuple of str
        Empty where the clock of the frames is that of the recorder.
    """
    if ahead <= MOST_AHEAD * count:
        return ()
    return (
        f'no latency: {ahead} of {count} contacts were heard before the stamps of their frames, '
        'whose clock is not the recorder’s',
    )


def latency(log_ns: Integers, stamp_ns: Integers) -> Spread:
    """Time from acquisition to the contact's arrival in the bag (s).

    Parameters
    ----------
    log_ns, stamp_ns : ndarray, shape (n,)
        When contacts were heard; when their frames were acquired (ns), of one clock.
    """
    return spread((log_ns - stamp_ns) * 1e-9)
