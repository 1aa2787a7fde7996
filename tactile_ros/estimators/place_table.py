"""Coverage of every taxel over places of an object that looks alike from all sides.

Such an object has a place and no turn, so that a table over places replaces points: sixteen rows
and their weights give the coverage of all taxels with its slopes.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.estimators.coverage_error import ModelError

if TYPE_CHECKING:
    from tactile_ros.estimators.coverage_model import TaxelPoints, Variant
    from tactile_ros.types import Array

FINENESS = 5.0  # nodes for the width of one of many taxels
FEW_FINENESS = 16.0  # of one of few, of which each must tell more
MOST_NODES = 120  # of a side
CUBIC = np.array([[0, -1, 2, -1], [2, 0, -5, 3], [0, 1, 4, -3], [0, 0, -1, 1]]) / 2.0
SLOPE = np.pad(CUBIC[:, 1:] * np.array([1.0, 2.0, 3.0]), ((0, 0), (0, 1)))
POWERS = np.stack([CUBIC, SLOPE])  # weights of four nodes, and their slopes, by powers


class PlaceTable:
    """Cubic interpolation between nodes of places.

    Parameters
    ----------
    points : TaxelPoints
        Of the taxels.
    variant : Variant
        The object.
    middle : ndarray, shape (2,)
        Of the array (m).
    reach, step : float
        Of the array, and width of a taxel (m).
    fineness : float
        Nodes for the width of a taxel.

    Attributes
    ----------
    error : ModelError
        How far it is from finer points; see `coverage_error`.
    """

    def __init__(
        self,
        points: TaxelPoints,
        variant: Variant,
        middle: Array,
        reach: float,
        step: float,
        fineness: float = FINENESS,
    ) -> None:
        side = min(int(np.ceil(2 * reach * fineness / step)) + 1, MOST_NODES)
        self.error = ModelError(0.0, 0.0, np.zeros(2))
        self.side = side
        self.low = middle - reach
        self.pitch = 2 * reach / (side - 1)
        line = self.pitch * np.arange(side)
        rows = [
            points.cover(variant, np.column_stack([self.low[0] + line, np.full(side, y)]))
            for y in self.low[1] + line
        ]
        self.rows: Array = np.concatenate(rows)
        self._offsets = (side * np.arange(-1, 3)[:, None] + np.arange(-1, 3)).reshape(-1)
        self.scale = variant.unit[0] / self.pitch

    def seen(self, x: float, y: float) -> Array:
        """Slopes and covered area (3, t) at a place (m), as of `TaxelPoints.seen`."""
        last = self.side - 3
        fx, fy = (x - self.low[0]) / self.pitch, (y - self.low[1]) / self.pitch
        i, j = min(max(int(fx), 1), last), min(max(int(fy), 1), last)
        tables = POWERS @ np.array([_powers(fx - i), _powers(fy - j)]).T
        (along, over), (up, rise) = tables[:, :, 0], tables[:, :, 1]
        weights = np.empty((3, 4, 4))
        np.multiply(up[:, None], over * self.scale, out=weights[0])
        np.multiply(rise[:, None] * self.scale, along, out=weights[1])
        np.multiply(up[:, None], along, out=weights[2])
        near = self.rows[self._offsets + (j * self.side + i)]
        return np.asarray(weights.reshape(3, 16) @ near)

    def all_seen(self, places: Array) -> Array:
        """The same of places (k, 2), shape (3, k, t)."""
        return np.stack([self.seen(float(x), float(y)) for x, y in places], axis=1)


def _powers(t: float) -> tuple[float, float, float, float]:
    """Of a place between the middle two of four nodes."""
    t = min(max(t, -1.0), 2.0)
    return 1.0, t, t * t, t * t * t
