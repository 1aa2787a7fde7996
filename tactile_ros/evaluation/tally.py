"""Statistics that merge exactly: counts, exact sums, and histograms of fixed bins.

Whoever cuts a recording into pieces, or a fleet of recordings into workers, gets the same numbers
to the last bit in any order: sums are kept as whole numbers of the smallest float, and quantiles
come from bins that never move.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from tactile_ros.evaluation.metrics import Spread

if TYPE_CHECKING:
    from tactile_ros.types import Array, Integers

SCALE = 1200  # sums count 2**-SCALE, less than the last bit of the smallest float
MOST = 1e150
BITS, HALF = 53, 26
LEAST, LARGEST, RATIO = 1e-12, 1e12, 1.01  # of the bins (unit of the values)
BINS = math.ceil(math.log(LARGEST / LEAST) / math.log(RATIO))
QUANTILE_ERROR = math.sqrt(RATIO) - 1  # of a quantile, relative


def exact_sum(values: npt.ArrayLike) -> int:
    """Sum of finite floats as a whole number of 2**-1200, without any rounding.

    Examples
    --------
    >>> exact_sum([1e100, 1.0, -1e100]) == exact_sum([1.0])
    True
    """
    mantissa, exponent = np.frexp(np.asarray(values, np.float64).ravel())
    if not len(mantissa):
        return 0
    whole = (mantissa * 2.0**BITS).astype(np.int64)
    least = int(exponent.min())
    place = exponent - least
    # halves of 27 bits: their sums in float64 are exact up to 2**26 values
    high = np.bincount(place, (whole >> HALF).astype(np.float64))
    low = np.bincount(place, (whole & ((1 << HALF) - 1)).astype(np.float64))
    shift = least - BITS + SCALE
    parts = zip(high.tolist(), low.tolist(), strict=True)
    total = sum(((int(h) << HALF) + int(b)) << i for i, (h, b) in enumerate(parts))
    return total << shift


def as_float(total: int, count: int = 1) -> float:
    """An exact sum divided by a count, rounded once."""
    return total / (count << SCALE) if count else float('nan')


def bin_of(values: Array) -> Integers:
    """Number of the bin of each magnitude: 0 below the least, logarithmic steps of 1 %."""
    with np.errstate(divide='ignore'):
        step = np.floor(np.log(np.abs(values) / LEAST) / math.log(RATIO))
    return np.asarray(np.clip(step, -1, BINS) + 1, np.int64)


@dataclass(frozen=True)
class Magnitudes:
    """How large a quantity is, over any number of parts.

    Attributes
    ----------
    count : int
        Values that are known.
    total, squares : int
        Exact sums of the magnitudes and of their squares (2**-1200 of the unit).
    largest : float
        Of the magnitudes; 0 without any.
    bins : ndarray, shape (b,)
        Values in each bin.
    """

    count: int = 0
    total: int = 0
    squares: int = 0
    largest: float = 0.0
    bins: Integers = field(default_factory=lambda: np.zeros(BINS + 2, np.int64))

    @classmethod
    def of(cls, values: npt.ArrayLike) -> Magnitudes:
        """Of values, NaN left out."""
        known = np.abs(np.asarray(values, np.float64).ravel())
        known = np.minimum(known[np.isfinite(known)], MOST)  # squares stay finite
        if not len(known):
            return cls()
        bins = np.bincount(bin_of(known), minlength=BINS + 2)
        largest = float(known.max())
        return cls(len(known), exact_sum(known), exact_sum(known**2), largest, bins)

    def __add__(self, other: Magnitudes) -> Magnitudes:
        """Of both parts together."""
        return Magnitudes(
            self.count + other.count,
            self.total + other.total,
            self.squares + other.squares,
            max(self.largest, other.largest),
            self.bins + other.bins,
        )

    def quantile(self, share: float) -> float:
        """Value below which a share (0..1) lies, to within half a per cent; NaN without values."""
        if not self.count:
            return float('nan')
        rank = max(math.ceil(share * self.count), 1)
        number = int(np.searchsorted(np.cumsum(self.bins), rank))
        if number == 0:
            return 0.0
        return float(min(LEAST * RATIO ** (number - 0.5), self.largest))

    @property
    def spread(self) -> Spread:
        """The usual summary; quantiles come from the bins."""
        if not self.count:
            return Spread(0, *[float('nan')] * 6)
        mean = as_float(self.total, self.count)
        rms = math.sqrt(as_float(self.squares, self.count))
        p50, p95, p99 = (self.quantile(share) for share in (0.50, 0.95, 0.99))
        return Spread(self.count, mean, rms, p50, p95, p99, self.largest)


@dataclass(frozen=True)
class TargetTally:
    """Errors of one target over any number of parts.

    Attributes
    ----------
    name, unit : str
        As of `TargetErrors`.
    errors : Magnitudes
        Of the norm of the error.
    inside, judged : int
        Components within one standard deviation of their own; those with one.
    missed, invalid : int
        Rows without an estimate; rows not to be used for control.
    """

    name: str
    unit: str
    errors: Magnitudes = field(default_factory=Magnitudes)
    inside: int = 0
    judged: int = 0
    missed: int = 0
    invalid: int = 0

    def __add__(self, other: TargetTally) -> TargetTally:
        """Of both parts together."""
        return TargetTally(
            self.name,
            self.unit,
            self.errors + other.errors,
            self.inside + other.inside,
            self.judged + other.judged,
            self.missed + other.missed,
            self.invalid + other.invalid,
        )


@dataclass(frozen=True)
class ClassTally:
    """Answers of one kind that are right or wrong: cells, labels, contact, slip.

    Attributes
    ----------
    name : str
        Truth key.
    right, wrong, abstained : int
        Rows with known truth, by what was answered.
    """

    name: str
    right: int = 0
    wrong: int = 0
    abstained: int = 0

    def __add__(self, other: ClassTally) -> ClassTally:
        """Of both parts together."""
        return ClassTally(
            self.name,
            self.right + other.right,
            self.wrong + other.wrong,
            self.abstained + other.abstained,
        )

    @property
    def share(self) -> float:
        """Right answers among all known rows, 0..1; NaN without any."""
        count = self.right + self.wrong + self.abstained
        return self.right / count if count else float('nan')
