"""Whether a press is one of the drawn heads: what the best one leaves, along what others would do.

Errors of a skin's model go every way; an undrawn shape goes towards the drawn ones that it lies
between. What the best head leaves is split: the part that mixtures of the other heads explain,
over its degrees of freedom, tells shapes apart where the sum over all readings hides them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.physics import compiled

if TYPE_CHECKING:
    from tactile_ros.types import Array

DAMPING = 1e-4  # of slopes of unit length
TINY = 1e-30
FEWEST = 1e-3  # degrees of freedom


def shape_misfits(miss: Array, slopes: Array, away: Array) -> Array:
    """What mixtures of other heads explain of misfits, over what chance would let them.

    Parameters
    ----------
    miss : ndarray, shape (n, d)
        What the best head leaves of each press, over the deviations of readings and less what a
        uniform field could have added.
    slopes : ndarray, shape (n, 4, d)
        Of its pattern with the pose, alike.
    away : ndarray, shape (n, h, d)
        From its pattern to those of all heads, of which it is one, alike.

    Returns
    -------
    ndarray, shape (n,)
        About 1 where it is that head; 1 where there is no other.

    Notes
    -----
    Weights of a mixture have a deviation of 1 about 0: 1 is the whole way to another head.
    """
    if away.shape[1] == 1:
        return np.ones(len(miss))
    if compiled.available():
        found = np.empty(len(miss))
        shape_rows(miss, slopes, away, found)
        return found
    free = slopes / (np.linalg.norm(slopes, axis=2, keepdims=True) + TINY)
    rows = np.concatenate([free, away], axis=1)
    own = np.repeat([DAMPING, 1.0], [slopes.shape[1], away.shape[1]])
    low = np.linalg.cholesky(np.matmul(rows, np.swapaxes(rows, 1, 2)) + np.diag(own))
    # what slopes explain comes first and does not count
    back = np.linalg.inv(low)[:, slopes.shape[1] :]
    gain = np.square(np.matmul(back, np.matmul(rows, miss[..., None]))).sum(axis=(1, 2))
    freedom = away.shape[1] - np.square(back[:, :, slopes.shape[1] :]).sum(axis=(1, 2))
    return np.asarray(gain / np.maximum(freedom, FEWEST))


@compiled.compiled
def products_rows(rows: Array, own: Array, right: Array, low: Array) -> None:
    """Products (r, r) of rows (r, d) and with the right side (d,) in a column more; filled."""
    low[:] = 0.0
    for k in range(rows.shape[1]):
        for i in range(len(rows)):
            low[i, -1] += rows[i, k] * right[k]
            for j in range(i + 1):
                low[i, j] += rows[i, k] * rows[j, k]
    for i in range(len(rows)):
        low[i, i] += own[i]


@compiled.compiled
def factor_rows(low: Array) -> None:
    """Lower triangle of a positive matrix (r, r) becomes its Cholesky factor."""
    for i in range(len(low)):
        for j in range(i + 1):
            total = low[i, j]
            for k in range(j):
                total -= low[i, k] * low[j, k]
            low[i, j] = np.sqrt(total) if i == j else total / low[j, j]


@compiled.compiled
def solve_rows(low: Array, first: int, right: Array) -> float:
    """Squares of the solution (r,) with a lower triangle, from one row on; it is filled."""
    total = 0.0
    for i in range(first, len(right)):
        for k in range(first, i):
            right[i] -= low[i, k] * right[k]
        right[i] /= low[i, i]
        total += right[i] * right[i]
    return total


@compiled.compiled
def shape_rows(miss: Array, slopes: Array, away: Array, found: Array) -> None:
    """The same press by press; `found` (n,) is filled."""
    free, heads = slopes.shape[1], away.shape[1]
    rows, low = np.empty((free + heads, miss.shape[1])), np.empty((free + heads, free + heads + 1))
    own, unit = np.ones(free + heads), np.empty(free + heads)
    own[:free] = DAMPING
    for n in range(len(miss)):
        for i in range(free):
            rows[i] = slopes[n, i] / (np.sqrt((slopes[n, i] * slopes[n, i]).sum()) + TINY)
        rows[free:] = away[n]
        products_rows(rows, own, miss[n], low)
        factor_rows(low)
        solve_rows(low, 0, low[:, -1])
        gain, left = 0.0, 0.0
        for i in range(free, free + heads):
            gain += low[i, -1] * low[i, -1]
            unit[:] = 0.0
            unit[i] = 1.0
            left += solve_rows(low, i, unit)
        found[n] = gain / max(heads - left, FEWEST)
