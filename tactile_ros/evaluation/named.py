"""Cells and labels that were named, beside the true ones."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.evaluation.cells import accuracy, confusion
from tactile_ros.types import Array, Integers

if TYPE_CHECKING:
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
    def table(self) -> Array:
        """Share (n, n) (%) of each true class (row) that was named so (column)."""
        count = int(max(self.true.max(), self.said.max())) + 1
        return confusion(self.said, self.true, count)


def named(recording: Recording, states: ContactStates) -> tuple[Named, ...]:
    """Classes that are both known and named in at least one row."""
    found = []
    for name in KINDS:
        if name not in recording.truth:
            continue
        true = np.asarray(recording.truth[name], np.int64)
        said = np.where(states.valid, getattr(states, name), -1).astype(np.int64)
        rows = true >= 0
        if rows.any() and (said[rows] >= 0).any():
            found.append(Named(name, true[rows], said[rows]))
    return tuple(found)
