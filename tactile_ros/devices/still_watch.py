"""Taxels that repeat their last reading for longer than their own noise explains: stuck."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from tactile_ros.types import Bools


class StillWatch:
    """Counts runs of identical readings.

    Parameters
    ----------
    taxels : int
        Count of taxels t.
    stuck_after : int
        Identical readings in a row before a taxel counts as stuck.
    chance : float
        A run of repeats is believed to be the taxel's own quiet down to this probability, from
        the share of repeats it had before the run. Runs that were judged stuck are not learnt.
    others : float
        A repeat counts only where at least this share of all taxels changed: a board that is
        still as a whole says nothing about one taxel.
    """

    def __init__(
        self, taxels: int, stuck_after: int = 10, chance: float = 1e-6, others: float = 0.0
    ) -> None:
        """See the class."""
        self._stuck_after = stuck_after
        self._log_chance = np.log(chance)
        self._others = others * taxels
        self._readings: npt.NDArray[Any] | None = None
        self._run = np.zeros(taxels)
        self._repeats = np.ones(taxels)
        self._seen = np.full(taxels, 2.0)

    def forget(self, taxels: Bools | slice = slice(None)) -> None:
        """Begin the runs of these taxels anew."""
        self._run[taxels] = 0

    def follow(self, readings: npt.NDArray[Any], good: Bools | None = None) -> Bools:
        """Take the next readings.

        Parameters
        ----------
        readings : ndarray, shape (t, c)
            As the taxels sent them.
        good : ndarray, shape (t,), or None
            Taxels that were read; None: all.

        Returns
        -------
        ndarray, shape (t,)
            Those that repeat their last reading.
        """
        if self._readings is None:
            self._readings = readings.copy()
            return np.zeros(len(readings), bool)
        same: Bools = (readings == self._readings).all(axis=1)
        changed = ~same
        if good is not None:
            same &= good
            changed &= good
        learnt = self._run * ~self.stuck() if self._run.any() else self._run
        self._repeats[changed] += learnt[changed]
        self._seen[changed] += learnt[changed] + 1
        self._run[changed] = 0
        if np.count_nonzero(changed) >= self._others:
            self._run += same
        self._readings[changed] = readings[changed]
        return same

    def stuck(self) -> Bools:
        """Taxels, shape (t,), whose run of repeats is longer than their own noise explains."""
        share = self._repeats / self._seen
        likely = self._run * np.log(share) > self._log_chance
        return np.asarray((self._run + 1 >= self._stuck_after) & ~likely, np.bool_)
