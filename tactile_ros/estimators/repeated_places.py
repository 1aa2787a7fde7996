"""Places that were touched more than once: their means, and how far single touches are off."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.types import Array, Integers

if TYPE_CHECKING:
    from collections.abc import Callable

SAME = 1e-5
STEP = 1e-3  # of the sheet
ONE_PLACE = 0.01  # of the sheet: spread of places in a group that is of one place


@dataclass(frozen=True)
class ToldPlaces:
    """Means at places that were touched more than once.

    Attributes
    ----------
    places, told : ndarray, shape (n, 2) and (n, k)
        One row a place (m), and what it told.
    within : float
        Standard deviation of a row from its place's mean.
    least : float
        What it makes of a mean.
    index : ndarray of int, shape (s,)
        Row of the place of each touch.
    repeats : bool
        False: places hardly repeat, and there is one row a touch.
    """

    places: Array
    told: Array
    within: float
    least: float
    index: Integers
    repeats: bool


def at_places(places: Array, told: Array) -> ToldPlaces:
    """Means of what touches at places (s, 2) (m) told (s, k)."""
    _, index, count = np.unique(
        np.round(places / SAME), axis=0, return_inverse=True, return_counts=True
    )
    index = np.asarray(index).reshape(-1)
    if len(count) > 0.5 * len(places):
        return ToldPlaces(places, told, 0.0, 0.0, np.arange(len(places)), repeats=False)

    def mean(values: Array) -> Array:
        columns = [np.bincount(index, column) / count for column in values.T]
        return np.stack(columns, axis=1)

    means = mean(told)
    free = (len(told) - len(count)) * told.shape[1]
    within = float(np.sqrt(((told - means[index]) ** 2).sum() / free))
    least = within * float(np.sqrt((1.0 / count).mean()))
    return ToldPlaces(mean(places), means, within, least, index, repeats=True)


def steady_places(places: Array, groups: Integers) -> tuple[Array, Array]:
    """Mean place of each group that is of one place.

    Parameters
    ----------
    places : ndarray, shape (s, 2)
        As readings tell them, in units of the sheet's edges.
    groups : ndarray of int, shape (s,)
        Of which many are of one place, or none.

    Returns
    -------
    places : ndarray, shape (s, 2)
        Means of the groups of one place; the others as they are.
    spread : ndarray, shape (2,)
        Of places about their means; 0 where no place was touched twice.
    """
    index = np.unique(groups, return_inverse=True)[1].reshape(-1)
    count = np.bincount(index)
    means = np.stack([np.bincount(index, column) / count for column in places.T], axis=1)
    off = places - means[index]
    spread = np.stack([np.bincount(index, column) / count for column in (off * off).T], axis=1)
    one = np.asarray((spread < ONE_PLACE**2).all(axis=1))
    rows, free = one[index], int((count - 1)[one].sum())
    square = (off[rows] ** 2).sum(axis=0)
    return np.where(rows[:, None], means[index], places), np.sqrt(square / max(free, 1))


def by_places(level: Callable[[Array], Array], x: Array, spread: Array) -> Array:
    """Variance (s,) of what is told of features by the noise of their places.

    Parameters
    ----------
    level : callable
        Features (s, d), of which the first two are the place -> what is told (s,).
    x : ndarray, shape (s, d)
        Features.
    spread : ndarray, shape (2,)
        Noise of a place.
    """
    variance = np.zeros(len(x))
    for axis in range(2):
        step = STEP * (np.arange(x.shape[1]) == axis)
        slope = (level(x + step) - level(x - step)) / (2 * STEP)
        variance += (slope * spread[axis]) ** 2
    return variance
