"""Answers of the gradiometer that say nothing: no disc could be where the readings put it.

Readings that no disc explains, of a magnet on the skin or of a broken wire, lead to places and
polynomials far from all that was learned. A force that is uncertain by more than the sensor can
bear, or twice as large, is no estimate.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterable

    from tactile_ros.sensors.gradiometer.target import Target
    from tactile_ros.types import Bools, Columns

FARTHEST = 2.0  # times the largest that can be
_AXES = np.arange(3)


def largest(targets: Iterable[Target], full_scale: float) -> dict[str, float]:
    """Largest size of each quantity that can be, by the names of targets.

    Parameters
    ----------
    targets : iterable of Target
        Fitted; their spans tell what truth knew.
    full_scale : float
        Of the sensor (N); other quantities grow to it as force does.

    Returns
    -------
    dict of str to float
        (Unit of the quantity.) Infinite where truth told nothing but 0.
    """
    told: dict[str, float] = {}
    for target in targets:
        told[target.name] = max(told.get(target.name, 0.0), float(np.abs(target.span_).max()))
    force = told.get('force', 0.0)
    more = max(1.0, full_scale / force) if force > 0 else 1.0
    return {name: more * size if size > 0 else np.inf for name, size in told.items()}


def unsay(known: Columns, most: dict[str, float], touched: Bools) -> Bools:
    """Make quantities NaN in touched rows where nobody should believe them.

    Parameters
    ----------
    known : dict of str to ndarray, shape (s, ...)
        Quantities and their covariances; changed in place. `valid` (s,) is added: False where
        none of them is told.
    most : dict of str to float
        Of `largest`.
    touched : ndarray of bool, shape (s,)
        Rows to look at.

    Returns
    -------
    ndarray of bool, shape (s,)
        Rows that lost something.
    """
    some, every = np.zeros_like(touched), np.array(touched)
    for name, size in most.items():
        mean, cov = (np.asarray(known[one], np.float64) for one in (name, f'{name}_cov'))
        variance = cov[:, _AXES, _AXES]
        farther = (variance > size * size) | (np.abs(mean) > FARTHEST * size)
        if not np.count_nonzero(farther):
            every = every & False
            continue
        lost = touched & farther.any(axis=1)
        mean[lost], cov[lost] = np.nan, np.nan
        some, every = some | lost, every & lost
    known['valid'] = ~every
    return some
