"""Trials of estimators on groups that they had not seen, and a choice that needs a reason.

Few groups tell little: the one that is expected to serve is left only for one that errs less on
held-out groups by more than chance makes (after the one-standard-error rule of Breiman et al.,
Classification and Regression Trees, 1984, sec. 3.4.3, with two), and by enough to matter.
"""

from __future__ import annotations

import copy
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Protocol, runtime_checkable

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from tactile_ros.estimators.covariance import SigmaCalibration
from tactile_ros.estimators.regression import TrainingRows, group_folds, training_rows
from tactile_ros.types import Array, Bools, Estimator, Integers

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping


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
    """What a copy of the candidate says about held rows after a fit on the others."""
    seen = np.ones(len(rows.x), bool)
    # so does a single row: then the held row itself is used
    seen[held] = len(held) == len(seen)
    known = rows.take(seen)
    return copy.deepcopy(candidate).fit(known.x, known.y, known.groups).predict(rows.x[held])


FOLDS = 8
MOST_TRIED = 2000  # rows that candidates are compared on
ROUNDING = 1e-9
ALIKE = 0.02  # of what was touched
ONE_SIGMA = 0.6827
FEWEST_GROUPS = 5
SURE_GROUPS = 20.0  # the model's own doubt counts as much as so many groups
MOST_CAUTION = 4.0
BOLD = 0.5  # trust in errors that are less than stated: far from all touches, unlike those in use
WORTH = 0.5  # of an error: touches lie nearer to what was learned than groups left out do
SURE = 2.0  # standard errors
WORSE, MUCH = 2.0, 0.8


@runtime_checkable
class Spreading(Protocol):
    """An estimator that states the spread of its error."""

    def stated(self, x: Array) -> tuple[Array, Array]:
        """Targets (s, k) and spreads of their errors (s, k)."""
        ...


@runtime_checkable
class LeavingOut(Protocol):
    """An estimator that tells from one fit what it would say without some of the rows."""

    def fit(self, x: Array, y: Array, groups: Integers | None = None) -> Estimator:
        """Learn from rows."""
        ...

    def held_out(self, x: Array, y: Array, groups: Integers) -> tuple[Array, Array]:
        """Targets (s, k) that a fit without the group of each row says, and their spreads."""
        ...


@dataclass(frozen=True)
class Trial:
    """What a candidate said about rows whose group it had not seen.

    Attributes
    ----------
    said, spread : ndarray, shape (s, k)
        Predictions, and the spreads that it stated; its root mean square error where it states
        none.
    error : float
        Root mean square length of its error (unit of y); infinite where it said nothing.
    typical : ndarray, shape (g,)
        That of each group, none counted above the spread of the targets, so that a few groups
        that it cannot reach do not rule (unit of y).
    """

    said: Array
    spread: Array
    error: float
    typical: Array
    seen: float = 0.0  # root mean square length of its error on what it was trained on (unit of y)


def trials(
    candidates: Mapping[str, Estimator], x: Array, y: Array, groups: Integers,
    plane: Callable[[Array, Array], Array], folds: int = FOLDS,
) -> tuple[dict[str, Trial], Array]:  # fmt: skip
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
        said, spread = _trials_unseen(candidate, rows, fold)
        whole = copy.deepcopy(candidate).fit(rows.x, rows.y, rows.groups)
        off = (whole.predict(rows.x) - rows.y)[judged]
        seen = float(np.sqrt((off * off).sum(axis=1).mean()))
        trial = _judge(said[judged], spread[judged], rows.y[judged], rows.groups[judged])
        found[name] = replace(trial, seen=seen)
    return found, rows.y[judged]


def chosen(found: Mapping[str, Trial], expected: str) -> str:
    """Name of the candidate to use.

    Parameters
    ----------
    found : mapping of str to Trial
        Of the candidates, on the same groups.
    expected : str
        Used unless another errs less by more than two standard errors of the difference over
        groups, and by half of it; and it must err less than twice as much on what both were
        trained on, or by four fifths less on the groups.

    Returns
    -------
    str
        Of those that do, the one that errs least.
    """
    trust = found.get(expected)
    if trust is None or trust.error == np.inf:
        return min(found, key=lambda name: float(found[name].typical.mean()))
    known = trust.typical
    better = {expected: float(known.mean())}
    for name, one in found.items():
        gain = known - one.typical
        chance = float(gain.std()) / np.sqrt(max(len(gain) - 1, 1))
        part = float(gain.mean()) / max(float(known.mean()), 1e-300)
        at_home = one.seen < WORSE * trust.seen or part > MUCH
        if part > WORTH and float(gain.mean()) > SURE * chance and at_home:
            better[name] = float(one.typical.mean())
    return min(better, key=lambda name: better[name])


def some_rows(x: Array, y: Array, most: int = MOST_TRIED) -> Integers:
    """Rows to compare candidates on: all, or `most` of them evenly, in an order of their own."""
    some = np.linspace(0, len(x) - 1, min(len(x), most)).astype(np.int64)
    return np.lexsort(np.column_stack([x, y]).T)[some]


@dataclass(frozen=True)
class Verdict:
    """What the trial of an estimator says of its errors.

    Attributes
    ----------
    level : ndarray, shape (k,)
        Root mean square error of each component (unit of y): its spread, where it states none.
    """

    spread: SigmaCalibration  # scale of the spread that it states
    level: Array
    report: dict[str, float]  # errors on held-out groups (unit of y), also of the other candidates


def verdict(found: Mapping[str, Trial], best: str, told: Array, groups: Integers) -> Verdict:
    """Judge the candidate that is used.

    Parameters
    ----------
    found : mapping of str to Trial
        Of the candidates.
    best : str
        Name of the one in use.
    told : ndarray, shape (s, k)
        Targets of the rows of the trials.
    groups : ndarray of int
        Of all rows that it was fitted on.
    """
    trial = found[best]
    residual = trial.said - told
    spread = SigmaCalibration().fit(trial.spread, residual)
    report = {
        'held_out_mean': float(np.linalg.norm(residual, axis=1).mean()),
        'held_out_rmse': trial.error,
        'inside_one_sigma': float((np.abs(residual) <= spread(trial.spread)).mean()),
        'groups': float(len(np.unique(groups))),
        'rows': float(len(groups)),
        **{f'rmse_{name}': one.error for name, one in found.items()},
    }
    return Verdict(spread, np.sqrt((residual**2).mean(axis=0)) + 1e-9, report)


def _trials_unseen(
    candidate: Estimator, rows: TrainingRows, fold: Integers
) -> tuple[Array, Array]:
    """What copies of a candidate say (s, k) about folds that they were not trained on."""
    if isinstance(candidate, LeavingOut) and (fold != fold[0]).any():
        whole = copy.deepcopy(candidate)
        whole.fit(rows.x, rows.y, rows.groups)
        return whole.held_out(rows.x, rows.y, rows.groups)  # nearest to use, and costs no more
    said, spread = np.full_like(rows.y, np.nan), np.full_like(rows.y, np.nan)
    for part in np.unique(fold):
        held = fold == part
        seen = rows.take(~held if not held.all() else held)
        trial = copy.deepcopy(candidate).fit(seen.x, seen.y, seen.groups)
        if isinstance(trial, Spreading):
            said[held], spread[held] = trial.stated(rows.x[held])
        else:
            said[held] = trial.predict(rows.x[held])
    return said, spread


def _judge(said: Array, spread: Array, told: Array, groups: Integers) -> Trial:
    """Trial of what was said about targets (s, k)."""
    square = (said - told) ** 2
    error = float(np.sqrt(square.sum(axis=1).mean()))
    error = error if np.isfinite(error) else np.inf
    level = np.sqrt(square.mean(axis=0)) if error < np.inf else 1.0
    spread = np.where(np.isfinite(spread), spread, np.maximum(level, 1e-12))
    index = np.unique(groups, return_inverse=True)[1].reshape(-1)
    means = np.bincount(index, square.sum(axis=1)) / np.bincount(index)
    typical = np.minimum(np.sqrt(means), np.sqrt(told.var(axis=0).sum()))
    return Trial(said, spread, error, np.asarray(np.where(error < np.inf, typical, np.inf)))


def left_out(half: Array, error: Array) -> tuple[Array, Array]:
    """Errors of rows by a linear regression without them, and their variances.

    Parameters
    ----------
    half : ndarray, shape (s, p)
        Terms times the root of the weights' covariance, over the noise.
    error : ndarray, shape (s,)
        Errors of the regression with them.

    Returns
    -------
    error, variance : ndarray, shape (s,)
        Errors without the rows, and the variance that the regression without them states, over
        the noise's.

    Notes
    -----
    (I - H)^-1 e, by whichever of H = half half^T and half^T half is smaller.
    """
    rows, terms = half.shape
    if rows <= terms:
        hat = half @ half.T
        apart = np.eye(rows) * (1.0 + ROUNDING) - hat
        alone = np.linalg.solve(apart, np.column_stack([error, hat]))
        return np.asarray(alone[:, 0]), np.maximum(np.diagonal(alone[:, 1:]), 0.0)
    apart = np.eye(terms) * (1.0 + ROUNDING) - half.T @ half
    alone = np.linalg.solve(apart, half.T)
    hat = np.einsum('sp,ps->s', half, alone)
    return np.asarray(error + half @ (alone @ error)), np.maximum(hat, 0.0)


def caution(asked: Array, weight: Array, groups: int) -> float:
    """Factor on a spread with which 68.27 % of held-out errors lie inside it.

    Parameters
    ----------
    asked : ndarray, shape (s,)
        Factor at which the error of each held-out row is one sigma.
    weight : ndarray, shape (s,)
        Weights of the rows.
    groups : int
        How many groups they are of; few do not tell much against the model's own spread.

    Returns
    -------
    float
        1 where nothing is known.

    Examples
    --------
    >>> round(caution(np.full(100, 4.0), np.ones(100), 20), 2)
    2.0
    """
    if groups < FEWEST_GROUPS:
        return 1.0
    order = np.argsort(asked, kind='stable')
    share = np.cumsum(weight[order]) / weight.sum()
    row = min(int(np.searchsorted(share, ONE_SIGMA)), len(share) - 1)
    factor = float(asked[order[row]])
    bounded = min(max(factor, 1 / MOST_CAUTION), MOST_CAUTION)
    trust = groups / (groups + SURE_GROUPS)
    return float(bounded ** (trust if bounded > 1 else BOLD * trust))


def at_corners(places: Array, groups: Integers) -> Bools:
    """Rows (s,) whose group is a corner of the convex hull of all groups' places (s, 2).

    Where that would leave less than half of the groups, none is.
    """
    index = np.unique(groups, return_inverse=True)[1].reshape(-1)
    count = np.bincount(index)
    means = np.stack([np.bincount(index, column) / count for column in places.T], axis=1)
    corner = np.zeros(len(means), bool)
    step = ALIKE * np.maximum(np.ptp(means, axis=0), 1e-12)
    try:
        # noise would make corners of places on a straight edge
        corner[ConvexHull(np.round(means / step)).vertices] = True
    except (QhullError, ValueError):  # too few places, or all on a line
        return np.zeros(len(places), bool)
    return corner[index] if 2 * corner.sum() < len(corner) else np.zeros(len(places), bool)
