"""Spreads by place and level, told in small cells: one look-up a frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactile_ros.types import Array

GRID = 41  # cells along an edge of the sheet
LEVELS = 24  # in which a spread is told


@dataclass(frozen=True)
class SpreadCells:
    """Spreads at the middle of each cell.

    Attributes
    ----------
    spreads : ndarray, shape (GRID * GRID * l,)
        By x, y and level.
    levels : int
        Number of levels (l).
    low, high : float
        Least and largest level.
    """

    spreads: Array
    levels: int
    low: float
    high: float

    @classmethod
    def of(cls, doubt: Array, scatter: Array, low: float, high: float) -> SpreadCells:
        """From logarithms of variances (g, 3), squares in the level, and others of levels (l,)."""
        level = np.linspace(low, high, len(scatter))
        variance = np.exp(doubt @ level ** np.arange(3)[:, None])
        return cls(np.sqrt(variance + scatter).ravel(), len(scatter), low, high)

    @property
    def slope(self) -> float:
        """Cells a unit of level."""
        return (self.levels - 1) / (self.high - self.low)

    def at(self, places: Array, level: Array) -> Array:
        """Spreads (s,) at places (s, 2) on the unit square and levels (s,) within the range."""
        cell = (places * (GRID - 1) + 0.5).astype(np.int64)
        depth = ((level - self.low) * self.slope + 0.5).astype(np.int64)
        return self.spreads.take((cell[:, 0] * GRID + cell[:, 1]) * self.levels + depth)


def grid_places() -> Array:
    """Middles of the cells, shape (GRID * GRID, 2), in the order of `SpreadCells`."""
    line = np.linspace(0.0, 1.0, GRID)
    return np.stack(np.meshgrid(line, line, indexing='ij'), axis=-1).reshape(-1, 2)
