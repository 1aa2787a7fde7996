"""How well cells are named: accuracy, confusion, average Euclidean error [2].

[2] weighs a wrong cell by the distance of its centre from the true one, in the plane of the base.
Its text divides the sum by the number of classes; divided by the number of touches, as here, it is
a mean.
"""

from __future__ import annotations

import numpy as np

from tactile_ros.types import Array, Integers


def accuracy(said: Integers, true: Integers) -> float:
    """Share of touches (s,) whose cell is named rightly (%).

    Examples
    --------
    >>> accuracy(np.array([0, 1, 1, -1]), np.array([0, 1, 2, 2]))
    50.0
    """
    return 100 * float((said == true).mean())


def confusion(said: Integers, true: Integers, count: int) -> Array:
    """Share (n, n) of the touches of each true cell (row) that was named so (column) (%).

    Rows of cells that were never touched are NaN; touches without a name lack from the sum.

    Examples
    --------
    >>> confusion(np.array([0, 1, 1, -1]), np.array([0, 0, 1, 1]), 2).tolist()
    [[50.0, 50.0], [0.0, 50.0]]
    """
    table = np.zeros((count, count + 1))
    np.add.at(table, (true, np.where(said < 0, count, said)), 1.0)
    touched = table.sum(axis=1, keepdims=True)
    return np.asarray(100 * table[:, :count] / np.where(touched > 0, touched, np.nan))


def average_euclidean_error(said: Integers, true: Integers, centres: Array) -> float:
    """Mean distance of the named cell's centre from the true one's, seen from above (mm).

    Examples
    --------
    >>> centres = np.array([[0.0, 0.0, 0.0], [3e-3, 4e-3, 9.0]])
    >>> average_euclidean_error(np.array([0, 0]), np.array([0, 1]), centres)
    2.5
    """
    apart = centres[said, :2] - centres[true, :2]
    return 1e3 * float(np.hypot(apart[:, 0], apart[:, 1]).mean())
