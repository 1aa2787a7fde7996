"""Any smooth function of a few coordinates from a regular grid of its values, cubic between nodes.

Lagrange's polynomial through the four nearest nodes along every axis, so that polynomials of the
third degree come back exactly; near an edge the last four nodes are taken.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.types import Array

if TYPE_CHECKING:
    from collections.abc import Callable

    from tactile_ros.types import Integers


def cubic_weights(position: Array, count: int) -> tuple[Integers, Array, Array]:
    """First of four nodes, Lagrange's weights and their slopes.

    Parameters
    ----------
    position : ndarray, shape (...)
        In steps from the first of `count` nodes.
    count : int
        Nodes, four at least.

    Returns
    -------
    first : ndarray of int, shape (...)
        Index.
    weights, slopes : ndarray, shape (4, ...)
        Of the four nodes from there on; slopes over a step.
    """
    first = np.clip(np.floor(position).astype(np.int64) - 1, 0, count - 4)
    u = position - first - 1
    a, b, c = u + 1, u - 1, u - 2
    weights = np.stack([-u * b * c / 6, a * b * c / 2, -a * u * c / 2, a * u * b / 6])
    slopes = np.stack(
        [
            -(b * c + u * c + u * b) / 6,
            (b * c + a * c + a * b) / 2,
            -(u * c + a * c + a * u) / 2,
            (u * b + a * b + a * u) / 6,
        ]
    )
    return first, weights, slopes


def linear_weights(position: Array, count: int) -> tuple[Integers, Array, Array]:
    """First of two nodes, their weights and slopes (2, ...); see `cubic_weights`."""
    first = np.clip(np.floor(position).astype(np.int64), 0, count - 2)
    u = position - first
    one = np.ones_like(u)
    return first, np.stack([1 - u, u]), np.stack([-one, one])


@dataclass(frozen=True)
class GridTable:
    """Values on a regular grid of d axes.

    Attributes
    ----------
    low, high : ndarray, shape (d,)
        First and last node of every axis.
    values : ndarray, shape (n1, ..., nd, c)
        Four nodes at least along every axis.

    Examples
    --------
    >>> table = GridTable.of(lambda p: p**3, np.zeros(1), np.ones(1), (5,))
    >>> table.at(np.array([[0.3]])).round(12).tolist()
    [[0.027]]
    """

    low: Array
    high: Array
    values: Array

    @classmethod
    def of(
        cls,
        function: Callable[[Array], Array],
        low: Array,
        high: Array,
        shape: tuple[int, ...],
    ) -> GridTable:
        """Tabulate a function of points (s, d) with values (s, c) on a grid of `shape`."""
        axes = [np.linspace(a, b, n) for a, b, n in zip(low, high, shape, strict=True)]
        nodes = np.stack(np.meshgrid(*axes, indexing='ij'), axis=-1)
        found = function(nodes.reshape(-1, len(shape)))
        return cls(np.asarray(low), np.asarray(high), found.reshape(*shape, -1))

    @property
    def shape(self) -> tuple[int, ...]:
        """Nodes along every axis."""
        return self.values.shape[:-1]

    def _near(self, points: Array) -> tuple[Array, list[Array], list[Array]]:
        """Values (s, 4, ..., 4, c) of the nodes around points, their weights and slopes (4, s)."""
        index: list[Integers] = []
        weights, slopes = [], []
        dims = len(self.shape)
        for axis, count in enumerate(self.shape):
            step = (self.high[axis] - self.low[axis]) / (count - 1)
            first, weight, slope = cubic_weights((points[:, axis] - self.low[axis]) / step, count)
            weights.append(weight)
            slopes.append(slope / step)
            shape = [1] * (dims + 1)
            shape[0], shape[axis + 1] = len(points), 4
            index.append((first[:, None] + np.arange(4)).reshape(shape))
        return self.values[tuple(index)], weights, slopes

    def at(self, points: Array) -> Array:
        """Values (s, c) at points (s, d); beyond the grid the last cell's cubic goes on."""
        near, weights, _ = self._near(points)
        return _fold(near, weights)

    def with_slopes(self, points: Array) -> tuple[Array, Array]:
        """Values (s, c) at points (s, d), and their slopes (s, c, d) over the coordinates."""
        near, weights, slopes = self._near(points)
        steep = [
            _fold(near, [*weights[:i], slopes[i], *weights[i + 1 :]]) for i in range(len(weights))
        ]
        return _fold(near, weights), np.stack(steep, axis=-1)


def _fold(near: Array, weights: list[Array]) -> Array:
    """Weighed sum (s, c) of nodes (s, 4, ..., 4, c), axis after axis."""
    for weight in weights:
        near = np.einsum('sa...,as->s...', near, weight)
    return near
