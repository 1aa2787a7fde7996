"""Whether stated variances hold: overall, and within each third of them. Pure."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import stats

from tactile_ros.types import Array, Integers

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
