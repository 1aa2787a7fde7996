# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Choice of an estimator by grouped cross-validation (Hastie et al., Statistical Learning, 7)."""

from __future__ import annotations

import copy
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.estimators.regression import TrainingRows, group_folds, training_rows
from tactile_ros.types import Array, Estimator, Integers

if TYPE_CHECKING:
    from collections.abc import Mapping


def spread_rows(rows: Integers, most: int) -> Integers:
    """At most so many of rows, evenly spread."""
    few = np.linspace(0, len(rows) - 1, min(len(rows), most))
    return np.asarray(rows[few.astype(int)])


@dataclass(frozen=True)
class Selection:
    """Outcome of a choice, with what the winner said about rows that it had not seen."""

    name: str  # of the winner
    errors: dict[str, float]  # root mean square length of each candidate's error (unit of y)
    x: Array  # (s, d) features of the held-out rows
    y: Array  # (s, k) their targets (unit of y)
    groups: Integers  # (s,) their groups
    predictions: Array  # (s, k) of the winner, trained with none of their group

    @property
    def residuals(self) -> Array:
        """Predictions minus targets, shape (s, k) (unit of y)."""
        return self.predictions - self.y


def select(
    candidates: Mapping[str, Estimator], x: Array, y: Array, groups: Integers | None = None, *,
    folds: int = 5, rounds: int | None = None, seed: int = 0,
) -> Selection:  # fmt: skip
    """Let candidates predict groups that they were not trained on, and name the best.

    Candidates are copied, not fitted; of equal errors the first wins. Features are (s, d), targets
    (s, k) of one unit. A split keeps groups (s,) together; None, or one for all: every row stands
    alone. They are dealt to `folds`, of which some `rounds` are held out in turn; None: all. The
    rows of the selection are the finite ones that were held out, in an order of their own.

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
    errors = {name: rms_length(answer - rows.y[held]) for name, answer in said.items()}
    name = min(errors, key=lambda key: errors[key])
    chosen = rows.take(held)
    return Selection(name, errors, chosen.x, chosen.y, chosen.groups, said[name])


def rms_length(residuals: Array) -> float:
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


def held_out_report(
    residuals: Array, sigma: Array, groups: Integers, rows: int, errors: Mapping[str, float]
) -> dict[str, float]:
    """Figures of residuals (s, k), NaN: none, and of their sigmas; errors of all candidates."""
    length = np.sqrt((residuals**2).sum(axis=1))
    known = np.isfinite(residuals)
    return {
        'held_out_mean': float(np.nanmean(length)),
        'held_out_rmse': float(np.sqrt(np.nanmean(length**2))),
        'inside_one_sigma': float((np.abs(residuals) <= sigma)[known].mean()),
        'groups': float(len(np.unique(groups))),
        'rows': float(rows),
        **{f'rmse_{name}': error for name, error in sorted(errors.items())},
    }
