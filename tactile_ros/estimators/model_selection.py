# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Choice of an estimator by cross-validation on held-out groups."""

from __future__ import annotations

import copy
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.estimators.regression import TrainingRows, group_folds, training_rows
from tactile_ros.types import Array, Estimator, Integers

if TYPE_CHECKING:
    from collections.abc import Mapping


@dataclass(frozen=True)
class Selection:
    """Outcome of a choice, with what the winner said about rows that it had not seen.

    Attributes
    ----------
    errors : dict of str to float
        Root mean square length of the error of each candidate on held-out rows (unit of y).
    predictions : ndarray, shape (s, k)
        What the winner said about them when its training had none of their group.
    """

    name: str  # of the winner
    errors: dict[str, float]
    x: Array  # (s, d) features of the held-out rows
    y: Array  # (s, k) their targets (unit of y)
    groups: Integers  # (s,) their groups
    predictions: Array

    @property
    def residuals(self) -> Array:
        """Predictions minus targets, shape (s, k) (unit of y)."""
        return self.predictions - self.y


def select(
    candidates: Mapping[str, Estimator], x: Array, y: Array, groups: Integers | None = None, *,
    folds: int = 5, rounds: int | None = None, seed: int = 0,
) -> Selection:  # fmt: skip
    """Let candidates predict groups that they were not trained on, and name the best.

    Parameters
    ----------
    candidates : mapping of str to Estimator
        By name; they are copied, not fitted. Of equal errors the first wins.
    x : ndarray, shape (s, d)
        Features.
    y : ndarray, shape (s, k)
        Targets, all of one unit.
    groups : ndarray of int, shape (s,), or None
        What a split keeps together; None, or one for all: every row stands alone.
    folds : int
        Parts into which groups are dealt; fewer where there are fewer groups.
    rounds : int or None
        How many of the folds are held out in turn; None: all. Fewer cost less, and judge fewer
        rows.
    seed : int
        Of the deal.

    Returns
    -------
    Selection
        Its rows are the finite ones that were held out, in an order of their own.

    Raises
    ------
    ValueError
        If there is no candidate, shapes differ or no row is finite.
    """
    if not candidates:
        msg = 'candidates of select must hold at least one estimator; received none'
        raise ValueError(msg)
    rows = training_rows(x, y, groups)
    # a single group leaves nothing to learn from: rows are left out then, which tells less
    alone = rows.groups if rows.groups.any() else np.arange(len(rows.x))
    fold = group_folds(alone, folds, seed)
    parts = [np.flatnonzero(fold == part) for part in np.unique(fold)[:rounds]]
    held = np.concatenate(parts)
    said = {
        name: np.concatenate([_unseen(candidate, rows, part) for part in parts])
        for name, candidate in candidates.items()
    }
    errors = {name: _length(answer - rows.y[held]) for name, answer in said.items()}
    name = min(errors, key=lambda key: errors[key])
    chosen = rows.take(held)
    return Selection(name, errors, chosen.x, chosen.y, chosen.groups, said[name])


def _length(residuals: Array) -> float:
    """Root mean square length of residuals (s, k); infinite where a prediction is not finite."""
    length = float(np.sqrt((residuals**2).sum(axis=1).mean()))
    return length if np.isfinite(length) else np.inf


def _unseen(candidate: Estimator, rows: TrainingRows, held: Integers) -> Array:
    """Predictions of a copy of the candidate for held rows after a fit on the others."""
    seen = np.ones(len(rows.x), bool)
    # so does a single row: then the held row itself is used
    seen[held] = len(held) == len(seen)
    known = rows.take(seen)
    return copy.deepcopy(candidate).fit(known.x, known.y, known.groups).predict(rows.x[held])
