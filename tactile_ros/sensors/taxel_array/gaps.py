"""Loads of taxels that were not read, from the pressure around them."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.physics import compiled
from tactile_ros.sensors.taxel_array.force_rows import filled_rows

if TYPE_CHECKING:
    from tactile_ros.types import Array, Bools, Integers

GUESSED = 0.5  # error of a silent taxel's force, in parts
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

    def loads(
        self, forces: Array, floor: float, spread: float, idle: Array
    ) -> tuple[Array, Array]:
        """Forces without gaps, and their variances.

        Parameters
        ----------
        forces : ndarray, shape (s, t)
            Of the taxels (N); NaN: not read.
        floor, spread : float
            Error of a force: a constant part (N), which is never more than the force itself, since
            laws are zero at zero output, and a part of the force.
        idle : ndarray, shape (t,)
            Error of a taxel that bears nothing (N).

        Returns
        -------
        load, variance : ndarray, shape (s, t)
            0 where no taxel of a frame was read.
        """
        if compiled.available():
            load, variance = np.empty(forces.shape), np.empty(forces.shape)
            told = (*self.beside, floor, spread, idle, GUESSED)
            if filled_rows(forces, *told, load, variance):
                return load, variance
        filled = self.filled(forces)
        unknown = np.isnan(filled)
        load = np.where(unknown, 0.0, filled) if np.count_nonzero(unknown) else filled
        squared = load * load
        own = np.minimum(np.abs(load), floor) ** 2 + idle**2 + spread**2 * squared
        return load, np.where(np.isnan(forces), GUESSED**2 * squared, own)

    def filled(self, forces: Array) -> Array:
        """Forces (s, t), those that are NaN as large as the pressure around tells."""
        lost = np.isnan(forces)
        if not np.count_nonzero(lost) or self.silent.all():
            return forces
        filled = forces.copy()
        if np.count_nonzero(self.silent):
            silent, near, share = self.beside
            filled[:, silent] = (np.where(lost, 0.0, forces)[:, near] * share).sum(axis=2)
        torn = lost & ~self.silent
        for i in np.flatnonzero(torn.any(axis=1)) if np.count_nonzero(torn) else ():
            if not lost[i].all():
                self._fill(filled[i], lost[i])
        return filled

    def _fill(self, row: Array, lost: Bools) -> None:
        """One row (t,) in which taxels are lost that others rows have; it is changed."""
        gaps, near = self._nearest(lost)
        row[gaps] = (row[near] / self.areas[near]).mean(axis=1) * self.areas[gaps]

    @cached_property
    def beside(self) -> tuple[Integers, Integers, Array]:
        """Silent taxels (n,), those nearest to each, and what each of them adds (n, k)."""
        silent, near = self._nearest(self.silent)
        share = self.areas[silent, None] / self.areas[near] / max(near.shape[1], 1)
        return silent, near, np.asarray(share)

    def _nearest(self, lost: Bools) -> tuple[Integers, Integers]:
        """Lost taxels (n,), and the read ones nearest to each (n, k)."""
        gaps, live = np.flatnonzero(lost), np.flatnonzero(~lost)
        away = np.linalg.norm(self.positions[gaps, None] - self.positions[None, live], axis=2)
        return gaps, live[np.argsort(away, axis=1, kind='stable')[:, :AROUND]]
