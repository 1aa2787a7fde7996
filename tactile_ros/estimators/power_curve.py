"""A power law whose factors vary over a sheet, as it is evaluated: one product a frame."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tactile_ros.estimators.sheet_rows import force_rows
from tactile_ros.estimators.smooth_fields import WIDEST
from tactile_ros.estimators.spread_cells import GRID, SpreadCells
from tactile_ros.physics import compiled
from tactile_ros.physics.resistive import SeriesResistance
from tactile_ros.types import Array


@dataclass(frozen=True)
class PowerCurve:
    """Force and its spread by place and resistance.

    Attributes
    ----------
    table : ndarray, shape (n, n, 5)
        Factors of cosines: of a constant, the film's logarithm, one over the film and the film;
        and of what is added to Rx, in units of the divider's.
    series : SeriesResistance
        Nominal Rx.
    range : ndarray, shape (3,)
        Least and largest film resistance that count, and the middle of its logarithm.
    bend : float
        Factor of the square of the logarithm.
    most : float
        Logarithm of the largest answer.
    gap : float
        Force that is added (N).
    cells : SpreadCells
        Spreads of a force over the gap, relative to it.
    """

    table: Array
    series: SeriesResistance
    range: Array
    bend: float
    most: float
    gap: float
    cells: SpreadCells

    def at(self, places: Array, resistance: Array) -> tuple[Array, Array]:
        """Forces (s,) and their spreads (s,) (N).

        Parameters
        ----------
        places : ndarray, shape (s, 2)
            In units of the sheet's edges; beyond the sheet its border counts.
        resistance : ndarray, shape (s,)
            R, in units of the divider's.
        """
        if compiled.available():
            force, spread = np.empty(len(places)), np.empty(len(places))
            force_rows(places, resistance, self.table, *self._law, force, spread)
            return force, spread
        low, high, middle = self.range
        inside = np.fmin(np.fmax(places, 0.0), 1.0)
        waves = np.cos(inside[:, :, None] * WIDEST)
        # no product of matrices: its sums run otherwise for one frame than for many
        known = np.einsum('si,sj,ijk->sk', waves[:, 0], waves[:, 1], self.table)
        film = np.fmin(np.fmax(resistance - known[:, 4] - self.series.at(inside), low), high)
        level = np.log(film) - middle
        power = known[:, 0] + level * (known[:, 1] + level * self.bend)
        power += known[:, 2] / film
        power += known[:, 3] * film
        force = np.exp(np.minimum(power, self.most))
        spread = force * self.cells.at(inside, level)
        return force + self.gap, spread

    @cached_property
    def _law(self) -> tuple[Array, Array, Array]:
        """Numbers and spreads as `force_rows` takes them."""
        own = self.cells
        law = [WIDEST[0, 1], *self.range, self.bend, self.most, self.gap, own.low, own.slope]
        return np.array(law), self.series.law, own.spreads.reshape(GRID, GRID, own.levels)
