"""Loads of taxels that were not read, from the pressure around them."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from tactile_ros.types import Array, Bools, Integers

AROUND = 4  # taxels that stand for a lost one


class Gaps:
    """Neighbours of the taxels of one array.

    Parameters
    ----------
    positions, areas : ndarray, shape (t, 3) and (t,)
        Centres (m) and areas (m2).
    silent : ndarray, shape (t,)
        Taxels that are never read.

    Examples
    --------
    >>> places = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]])
    >>> gaps = Gaps(places, np.ones(3), np.zeros(3, bool))
    >>> gaps.filled(np.array([[1.0, np.nan, 3.0]])).tolist()
    [[1.0, 2.0, 3.0]]
    """

    def __init__(self, positions: Array, areas: Array, silent: Bools) -> None:
        self.positions, self.areas, self.silent = positions, areas, silent

    def filled(self, forces: Array) -> Array:
        """Forces (s, t), those that are NaN as large as the pressure around tells."""
        lost = np.isnan(forces)
        if not np.count_nonzero(lost) or self.silent.all():
            return forces
        filled = forces.copy()
        if np.count_nonzero(self.silent):
            silent, near = self._beside
            pressure = np.nan_to_num(forces)[:, near] / self.areas[near]
            filled[:, silent] = pressure.mean(axis=2) * self.areas[silent]
        for i in np.flatnonzero((lost & ~self.silent).any(axis=1)):
            if not lost[i].all():
                self._fill(filled[i], lost[i])
        return filled

    def _fill(self, row: Array, lost: Bools) -> None:
        """One row (t,) in which taxels are lost that others rows have; it is changed."""
        gaps, near = self._nearest(lost)
        row[gaps] = (row[near] / self.areas[near]).mean(axis=1) * self.areas[gaps]

    @cached_property
    def _beside(self) -> tuple[Integers, Integers]:
        """Silent taxels (n,), and those nearest to each (n, k)."""
        return self._nearest(self.silent)

    def _nearest(self, lost: Bools) -> tuple[Integers, Integers]:
        """Lost taxels (n,), and the read ones nearest to each (n, k)."""
        gaps, live = np.flatnonzero(lost), np.flatnonzero(~lost)
        away = np.linalg.norm(self.positions[gaps, None] - self.positions[None, live], axis=2)
        return gaps, live[np.argsort(away, axis=1, kind='stable')[:, :AROUND]]
