"""Rows to learn from, in an order of their own, and predictions row by row."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.errors import NotCalibratedError
from tactile_ros.types import Array, Bools, Integers, as_shape

if TYPE_CHECKING:
    from collections.abc import Callable


@dataclass(frozen=True)
class TrainingRows:
    """Finite rows in canonical order.

    Attributes
    ----------
    x : ndarray, shape (s, d)
        Features.
    y : ndarray, shape (s, k)
        Targets.
    groups : ndarray of int, shape (s,)
        What a split keeps together, numbered from 0 by first appearance.
    """

    x: Array
    y: Array
    groups: Integers

    def take(self, rows: Integers | Bools) -> TrainingRows:
        """Some of the rows."""
        return TrainingRows(self.x[rows], self.y[rows], self.groups[rows])


def training_rows(x: Array, y: Array, groups: Integers | None = None) -> TrainingRows:
    """Leave out rows that are not finite and sort the others by their own numbers.

    Parameters
    ----------
    x : ndarray, shape (s, d)
        Features.
    y : ndarray, shape (s, k)
        Targets.
    groups : ndarray of int, shape (s,), or None
        What a split keeps together; None: every row stands alone.

    Returns
    -------
    TrainingRows
        The same for every order of the given rows.

    Raises
    ------
    ValueError
        If shapes differ or no finite row is left.
    """
    x, y = as_shape('x of fit', x, (-1, -1)), as_shape('y of fit', y, (-1, -1))
    group = np.arange(len(x)) if groups is None else np.asarray(groups, np.int64)
    if len(x) != len(y) or group.shape != (len(x),):
        msg = (
            'x, y and groups of fit must have as many rows; '
            f'received {len(x)}, {len(y)} and {group.shape}'
        )
        raise ValueError(msg)
    keep = np.flatnonzero(np.isfinite(x).all(axis=1) & np.isfinite(y).all(axis=1))
    if not len(keep):
        msg = f'x and y of fit must hold at least one finite row; received {len(x)} rows, none so'
        raise ValueError(msg)
    order = keep[np.lexsort(np.column_stack([x, y])[keep].T[::-1])]
    return TrainingRows(x[order], y[order], _by_appearance(group[order]))


def _by_appearance(groups: Integers) -> Integers:
    """Number groups from 0 in the order in which they first appear."""
    _, first, index = np.unique(groups, return_index=True, return_inverse=True)
    rank = np.empty(len(first), np.int64)
    rank[np.argsort(first)] = np.arange(len(first))
    return np.asarray(rank[index.reshape(-1)])


def predict_rows(x: Array, width: int, answer: Callable[[Array], Array]) -> Array:
    """Answer for the finite rows, NaN for the others.

    Parameters
    ----------
    x : ndarray, shape (s, d)
        Features.
    width : int
        Number of features that the fit saw.
    answer : callable
        Targets (s, k) of finite features (s, d).

    Returns
    -------
    ndarray, shape (s, k)
        Targets.

    Raises
    ------
    ValueError
        If the number of features differs from the fit.
    """
    if np.shape(x)[1:] != (width,) or np.asarray(x).dtype != np.float64:
        x = as_shape('x of predict', x, (-1, width))
    rows = np.isfinite(x)
    if len(x) and np.count_nonzero(rows) == rows.size:
        return answer(x)
    finite = rows.all(axis=1)
    known = answer(x[finite]) if finite.any() else answer(np.zeros((1, width)))[:0]
    y = np.full((len(x), known.shape[1]), np.nan)
    y[finite] = known
    return y


def fitted(estimator: object, attribute: str) -> None:
    """Refuse to predict before a fit.

    Raises
    ------
    NotCalibratedError
        If the estimator lacks the attribute that its fit sets.
    """
    if not hasattr(estimator, attribute):
        msg = f'{type(estimator).__name__} must be fitted before it predicts; call fit(x, y) first'
        raise NotCalibratedError(msg)
