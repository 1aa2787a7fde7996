"""Cells and labels that were named, beside the true ones."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.evaluation.cells import accuracy, confusion
from tactile_ros.types import Array, Integers

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    import numpy.typing as npt

    from tactile_ros.evaluation.tally import ClassTally
    from tactile_ros.types import ContactStates, Recording

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
    tally : ClassTally or None
        Of all rows, where `true` and `said` are some of them.
    """

    name: str
    true: Integers
    said: Integers
    tally: ClassTally | None = None

    @property
    def right(self) -> float:
        """Share that is named rightly (%); none counts as wrong."""
        return 100 * self.tally.share if self.tally else accuracy(self.said, self.true)

    @property
    def abstained(self) -> float:
        """Share without a name (%)."""
        if self.tally:
            return 100 * self.tally.abstained / self.count
        return 100 * float((self.said < 0).mean())

    @property
    def count(self) -> int:
        """Rows whose truth is known."""
        known = self.tally
        return known.right + known.wrong + known.abstained if known else len(self.true)

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
