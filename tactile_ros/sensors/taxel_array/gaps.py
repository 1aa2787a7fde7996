"""Loads of taxels that were not read, from the pressure around them."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.physics import compiled
from tactile_ros.sensors.taxel_array.force_errors import LEVELS, shared_part, untold_parts
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
        self, forces: Array, own: Array, alike: Array, most: Array, idle: Array
    ) -> tuple[Array, Array, Array]:
        """Forces without gaps, their variances, and what they share.

        Parameters
        ----------
        forces : ndarray, shape (s, t)
            Of the taxels (N); NaN: not read.
        own, alike : ndarray, shape (l,) and (2, l)
            Errors in parts of the force at each of some loads; see `ForceErrors`.
        most : ndarray, shape (t,)
            Largest force of each taxel (N).
        idle : ndarray, shape (t,)
            Error of a taxel that bears nothing (N).

        Returns
        -------
        load, variance : ndarray, shape (s, t)
            0 where no taxel of a frame was read.
        shared : ndarray, shape (s,)
            Part of their sum by which all loads of a frame err alike.
        """
        share = np.nan_to_num(forces) / most
        level = np.searchsorted(LEVELS, share)
        untold = untold_parts(share)
        parts = own[level] if untold is None else np.hypot(own[level], untold)
        if compiled.available():
            load, variance = np.empty(forces.shape), np.empty(forces.shape)
            if filled_rows(forces, *self.beside, parts, idle, GUESSED, load, variance):
                return load, variance, _shared(load, level, alike, untold)
        filled = self.filled(forces)
        unknown = np.isnan(filled)
        load = np.where(unknown, 0.0, filled) if np.count_nonzero(unknown) else filled
        known = idle**2 + (parts * load) ** 2
        variance = np.where(np.isnan(forces), GUESSED**2 * (load * load), known)
        return load, variance, _shared(load, level, alike, untold)

    @staticmethod
    def parts(forces: Array, own: Array, most: Array) -> Array:
        """Errors (s, t) in parts of the force, of forces (s, t); see `loads`."""
        share = np.nan_to_num(forces) / most
        parts, untold = own[np.searchsorted(LEVELS, share)], untold_parts(share)
        return np.asarray(parts if untold is None else np.hypot(parts, untold))

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


def _shared(load: Array, level: Integers, alike: Array, untold: Array | None) -> Array:
    """As `shared_part`; beyond what was told laws of one kind err alike as well."""
    shared = shared_part(load, level, alike)
    if untold is None:
        return shared
    total = load.sum(axis=1)
    beyond = (untold * load).sum(axis=1) / np.where(total > 0, total, 1.0)
    return np.asarray(np.hypot(shared, beyond))
