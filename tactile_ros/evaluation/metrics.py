"""Errors against truth, and how far the covariances tell the truth about them. Pure; SI units."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from tactile_ros.evaluation.coverage import Coverage, coverage
from tactile_ros.types import Array, Bools, Integers, groups_of

if TYPE_CHECKING:
    from collections.abc import Mapping

    from tactile_ros.types import ContactStates, Recording

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
