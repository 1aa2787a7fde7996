"""Rows for a regression that holds beyond the groups it was fitted on.

Anchor regression (Rothenhaeusler, Meinshausen, Buehlmann and Peters, J. R. Stat. Soc. B 83, 2021)
weighs what the residuals of a whole group have in common more than what varies within the group:
a fit that leaves nothing in common to the presses it has seen, such as a gain of each press, errs
less on presses of a skin whose state has moved on.
"""

from __future__ import annotations

import numpy as np

from tactile_ros.types import Array, Integers


def anchored(
    terms: Array, target: Array, groups: Integers, load: Array, weight: float
) -> tuple[Array, Array]:
    """Scale what the rows of each group have in common: a level, and a slope along the load.

    Parameters
    ----------
    terms : ndarray, shape (s, p)
        Terms of a linear regression.
    target : ndarray, shape (s, k)
        Its targets.
    groups : ndarray of int, shape (s,)
        Groups, such as presses.
    load : ndarray, shape (s,)
        What a gain multiplies, of order one.
    weight : float
        Weight of the squares of the common part; 1 changes nothing.

    Returns
    -------
    terms, target : ndarray, shapes (s, p), (s, k)
        Rows whose plain least squares are those of the anchored regression.

    Examples
    --------
    >>> ones, group = np.ones((2, 1)), np.zeros(2, np.int64)
    >>> anchored(ones, np.array([[0.0], [2.0]]), group, np.zeros(2), 4.0)[1].tolist()
    [[1.0], [3.0]]
    """
    if weight == 1.0:
        return terms, target
    rows = np.concatenate([terms, target], axis=1)
    more = np.sqrt(weight) - 1
    for group in np.unique(groups):
        own = groups == group
        common, spread, _ = np.linalg.svd(
            np.stack([np.ones(int(own.sum())), load[own]], axis=1), full_matrices=False
        )
        common = common[:, spread > 1e-9 * spread[0]]
        rows[own] += more * common @ (common.T @ rows[own])
    return rows[:, : terms.shape[1]], rows[:, terms.shape[1] :]
