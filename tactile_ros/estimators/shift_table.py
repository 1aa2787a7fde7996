"""A smooth shift of places, told on a grid over a sheet and one step beyond it.

Between the nodes it is that of Catmull and Rom, cubic with continuous slopes.
"""

from __future__ import annotations

import numpy as np

from tactile_ros.types import Array

NODES = 61  # along an edge of the sheet


def shift_at(share: Array, table: Array) -> Array:
    """Shifts (s, 2) at places (s, 2) on the unit square, from a table (n + 2, n + 2, 2)."""
    deep = np.fmin(np.fmax(share, 0.0), 1.0) * (len(table) - 3)
    node = np.minimum(deep.astype(np.int64), len(table) - 4)
    t = deep - node
    square = t * t
    cube = square * t
    weights = np.stack(
        [
            square - 0.5 * (t + cube),
            1.0 - 2.5 * square + 1.5 * cube,
            0.5 * t + 2.0 * square - 1.5 * cube,
            0.5 * (cube - square),
        ],
        axis=2,
    )
    four = np.arange(4)
    near = table[node[:, 0, None, None] + four[:, None], node[:, 1, None, None] + four]
    # no product of matrices: its sums run otherwise for one frame than for many
    return np.asarray(np.einsum('si,sj,sijk->sk', weights[:, 0], weights[:, 1], near))
