"""An estimator that sees some of the features, and trials of estimators that state a spread."""

from __future__ import annotations

import copy
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol, runtime_checkable

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from tactile_ros.estimators.folds import group_folds
from tactile_ros.estimators.training import training_rows
from tactile_ros.types import Array, Bools, Estimator, Integers

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

FOLDS = 8


@runtime_checkable
class Spreading(Protocol):
    """An estimator that states the spread of its error."""

    def stated(self, x: Array) -> tuple[Array, Array]:
        """Targets (s, k) and spreads of their errors (s, k)."""
        ...


class OnColumns:
    """An estimator on some columns of the features.

    Parameters
    ----------
    estimator : Estimator
        Fitted in place.
    columns : tuple of int
        What it sees.
    """

    def __init__(self, estimator: Estimator, columns: tuple[int, ...]) -> None:
        self.estimator = estimator
        self.columns = columns

    def fit(self, x: Array, y: Array, groups: Integers | None = None) -> OnColumns:
        """Learn from features (s, d) and targets (s, k)."""
        self.estimator.fit(x[:, self.columns], y, groups)
        return self

    def predict(self, x: Array) -> Array:
        """Targets (s, k)."""
        return self.estimator.predict(x[:, self.columns])


@dataclass(frozen=True)
class Trial:
    """What a candidate said about rows whose group it had not seen.

    Attributes
    ----------
    said, spread : ndarray, shape (s, k)
        Predictions, and the spreads that it stated; its root mean square error where it states
        none.
    error, typical : float
        Root mean square length of its error, and the mean over groups of theirs, none counted
        above the spread of the targets, so that a few groups that it cannot reach do not rule
        (unit of y); infinite where it said nothing.
    """

    said: Array
    spread: Array
    error: float
    typical: float


def trials(
    candidates: Mapping[str, Estimator],
    x: Array,
    y: Array,
    groups: Integers,
    plane: Callable[[Array, Array], Array],
    folds: int = FOLDS,
) -> tuple[dict[str, Trial], Array]:
    """Let candidates predict groups that they were not trained on.

    Parameters
    ----------
    candidates : mapping of str to Estimator
        They are copied, not fitted.
    x, y : ndarray, shape (s, d) and (s, k)
        Features and targets.
    groups : ndarray of int, shape (s,)
        What a split keeps together.
    plane : callable
        Place (s, 2) of rows from features and targets. Corners of what was touched are not
        judged: left out, they would ask for what lies beyond all touches.
    folds : int
        Parts into which groups are dealt.

    Returns
    -------
    trials : dict of str to Trial
        One for each candidate.
    y : ndarray, shape (s, k)
        Targets of the rows in the order of the trials.
    """
    rows = training_rows(x, y, groups)
    fold = group_folds(rows.groups, folds, 0)
    judged = ~at_corners(plane(rows.x, rows.y), rows.groups)
    found = {}
    for name, candidate in candidates.items():
        said, spread = np.full_like(rows.y, np.nan), np.full_like(rows.y, np.nan)
        for part in np.unique(fold):
            held = fold == part
            seen = rows.take(~held if not held.all() else held)
            trial = copy.deepcopy(candidate).fit(seen.x, seen.y, seen.groups)
            if isinstance(trial, Spreading):
                said[held], spread[held] = trial.stated(rows.x[held])
            else:
                said[held] = trial.predict(rows.x[held])
        found[name] = _judge(said[judged], spread[judged], rows.y[judged], rows.groups[judged])
    return found, rows.y[judged]


def _judge(said: Array, spread: Array, told: Array, groups: Integers) -> Trial:
    """Trial of what was said about targets (s, k)."""
    square = (said - told) ** 2
    error = float(np.sqrt(square.sum(axis=1).mean()))
    error = error if np.isfinite(error) else np.inf
    level = np.sqrt(square.mean(axis=0)) if error < np.inf else 1.0
    spread = np.where(np.isfinite(spread), spread, np.maximum(level, 1e-12))
    index = np.unique(groups, return_inverse=True)[1].reshape(-1)
    means = np.bincount(index, square.sum(axis=1)) / np.bincount(index)
    typical = float(np.minimum(np.sqrt(means), np.sqrt(told.var(axis=0).sum())).mean())
    return Trial(said, spread, error, typical if error < np.inf else np.inf)


def at_corners(places: Array, groups: Integers) -> Bools:
    """Rows (s,) whose group is a corner of the convex hull of all groups' places (s, 2).

    Where that would leave less than half of the groups, none is.
    """
    index = np.unique(groups, return_inverse=True)[1].reshape(-1)
    count = np.bincount(index)
    means = np.stack([np.bincount(index, column) / count for column in places.T], axis=1)
    corner = np.zeros(len(means), bool)
    try:
        corner[ConvexHull(means).vertices] = True
    except (QhullError, ValueError):  # too few places, or all on a line
        return np.zeros(len(places), bool)
    return corner[index] if 2 * corner.sum() < len(corner) else np.zeros(len(places), bool)
