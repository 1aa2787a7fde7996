"""Columns of truth and of estimates at the rows on which a window ends."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from tactile_ros.types import Array, Columns, Integers

ONCE = ('label', 'label_probability', 'cell', 'cell_probability', 'position', 'position_cov',
        'yaw', 'yaw_std')  # fmt: skip


def column_of(truth: Columns, name: str, rows: Integers, width: int) -> Array:
    """A column of truth at some rows, shape (n, width); NaN where it is unknown."""
    found = truth.get(name)
    if found is None:
        return np.full((len(rows), width), np.nan)
    return np.asarray(found, np.float64).reshape(len(found), width)[rows]


def write_rows(known: Columns, rows: Integers, n: int, label: Integers, chance: Array) -> None:
    """Labels of some of n rows as those of all; `known` is changed."""
    known['label'], known['label_probability'] = np.full(n, -1), np.full(n, np.nan)
    known['label'][rows], known['label_probability'][rows] = label, chance


def only_rows(known: Columns, rows: Integers) -> None:
    """Blank what is answered once a window in all other rows; `known` is changed."""
    for name in ONCE:
        if name in known:
            column = known[name]
            blank = np.full_like(column, -1 if column.dtype.kind in 'iu' else np.nan)
            blank[rows] = column[rows]
            known[name] = blank
