"""Answers that are larger than any that a fit was told: from there on a curve is a guess."""

from __future__ import annotations

import numpy as np

from tactile_ros.types import Array

BEYOND = 1.1  # times the largest that was told: so far a curve may be gone on with
UNTOLD = 0.5  # error of what lies beyond, in parts of it


def guessed(values: Array, most: float) -> Array | None:
    """What values may err by, since they lie beyond what was told.

    Parameters
    ----------
    values : ndarray, shape (...)
        Answers, 0 or more, in any unit.
    most : float
        The largest that a fit was told, in the same unit.

    Returns
    -------
    ndarray, shape (...), or None
        In the same unit, half of what lies beyond, 0 where a value is known; None: all are.

    Examples
    --------
    >>> guessed(np.array([1.0, 2.2, 3.2]), 2.0).tolist()
    [0.0, 0.0, 0.5]
    """
    known = BEYOND * most
    if not np.count_nonzero(values > known):
        return None
    return np.asarray(UNTOLD * np.maximum(values - known, 0.0))
