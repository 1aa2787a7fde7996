"""Flags of chips whose readings cannot be trusted: saturated, wrapped, stuck, repeated.

A chip's code wraps beyond its range instead of clipping, so that a reading far outside looks like
one inside; only the way there tells.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from tactile_ros.types import Array, Bools, Bytes, TaxelStatus

if TYPE_CHECKING:
    from tactile_ros.devices.mlx90393 import Words


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
        the repeats it had before the run. Runs that were judged stuck are not learnt.
    others : float
        A repeat counts only where at least this share of all taxels changed: a board that is
        still as a whole says nothing about one taxel.
    doubt : float
        The same probability from which on a repeat is doubted.
    changes : int
        A taxel that has not changed so often yet is not judged: it may rest since the start.

    Notes
    -----
    What counts as quiet is the larger of two shares: repeats among all readings, and repeats
    among those that follow a repeat, since a taxel that rests between touches has few long runs.
    """

    def __init__(
        self,
        taxels: int,
        stuck_after: int = 10,
        chance: float = 1e-6,
        others: float = 0.0,
        doubt: float = 1e-3,
        changes: int = 0,
    ) -> None:
        """See the class."""
        self._stuck_after = stuck_after
        self._log_chance = np.log(chance)
        self._log_doubt = np.log(doubt)
        self._others = others * taxels
        self._changes = changes
        self._readings: npt.NDArray[Any] | None = None
        self._run = np.zeros(taxels)
        self._runs = np.zeros(taxels)
        self._repeats = np.zeros(taxels)
        self._changed = np.zeros(taxels)

    def forget(self, taxels: Bools | slice = slice(None)) -> None:
        """Begin the runs of these taxels anew."""
        self._run[taxels] = 0

    def follow(
        self, readings: npt.NDArray[Any], good: Bools | None = None, telling: bool = True
    ) -> Bools:
        """Take the next readings.

        Parameters
        ----------
        readings : ndarray, shape (t, c)
            As the taxels sent them.
        good : ndarray, shape (t,), or None
            Taxels that were read; None: all.
        telling : bool
            Whether a repeat of these readings says anything; False at the ends of the range.

        Returns
        -------
        ndarray, shape (t,)
            Those that repeat their last reading.
        """
        if self._readings is None:
            self._readings = readings.copy()
            return np.zeros(len(readings), bool)
        same: Bools = (readings == self._readings).all(axis=1)
        if good is None and not np.count_nonzero(same) and not np.count_nonzero(self._run):
            self._changed += 1.0  # as usual
            self._readings[:] = readings
            return same
        changed = ~same
        if good is not None:
            same &= good
            changed &= good
        if self._run.any():
            self._learn(changed)
        self._changed += changed
        if telling and np.count_nonzero(changed) >= self._others:
            self._run += same
        self._readings[changed] = readings[changed]
        return same

    def _learn(self, ended: Bools) -> None:
        """Remember the runs of taxels that change now, those judged stuck apart."""
        honest = ended & ~self.stuck()
        self._repeats[honest] += self._run[honest]
        self._runs[honest] += self._run[honest] > 0
        self._run[ended] = 0

    def doubtful(self) -> Bools:
        """Taxels, shape (t,), that repeat themselves now and seldom did: perhaps stuck."""
        return self._unlikely(self._log_doubt)

    def marks(self) -> Bytes:
        """Bits of `TaxelStatus`, shape (t,): STALE where doubtful, STUCK where stuck."""
        stale = self.doubtful() * np.uint8(TaxelStatus.STALE)
        return np.asarray(stale | self.stuck() * np.uint8(TaxelStatus.STUCK), np.uint8)

    def stuck(self) -> Bools:
        """Taxels, shape (t,), whose run of repeats is longer than their own noise explains."""
        return self._unlikely(self._log_chance) & (self._run + 1 >= self._stuck_after)

    def _unlikely(self, log_chance: float) -> Bools:
        """Taxels whose run is less likely than that by what they did before."""
        share = (self._repeats + 0.5) / (self._repeats + self._changed + 1)
        again = (self._repeats - self._runs + share) / (self._repeats + 1)
        unlikely = self._run * np.log(np.maximum(share, again)) < log_chance
        return np.asarray(unlikely & (self._changed >= self._changes), np.bool_)


LEAST_DOUBT = 100


class ReadingWatch:
    """Remembers each chip's readings and judges the next ones by them.

    Parameters
    ----------
    taxels : int
        Count of chips t.
    full_scale : ndarray, shape (3,)
        Field at which the code wraps (T).
    margin : float
        Share of the range, at its ends, that counts as saturated.
    jump : float
        Largest change from one reading to the next that is believed, as a share of `full_scale`.
    stuck_after, chance : int, float
        See `StillWatch`.

    Notes
    -----
    A chip whose reading jumped stays WRAPPED until it reads near its last trusted value again, or
    has read elsewhere more often in a row than it was ever trusted (and 100 times at least), or
    `forget` is called: nothing else tells a wrap from a magnet that was put on.
    """

    def __init__(
        self,
        taxels: int,
        full_scale: Array,
        margin: float = 0.02,
        jump: float = 0.5,
        stuck_after: int = 10,
        chance: float = 1e-6,
    ) -> None:
        """See the class."""
        if not (0 <= margin < 1 and 0 < jump <= 1 and stuck_after > 1 and 0 < chance < 1):
            msg = (
                'margin, jump and chance of ReadingWatch must be shares and stuck_after 2 or '
                f'more; received {margin}, {jump}, {chance}, {stuck_after}'
            )
            raise ValueError(msg)
        self._limit = full_scale * (1 - margin)
        self._jump = full_scale * jump
        self._still = StillWatch(taxels, stuck_after, chance)
        self._trusted = np.full((taxels, 3), np.nan)
        self._trust = np.zeros(taxels, np.int64)
        self._doubt = np.zeros(taxels, np.int64)

    def forget(self, chips: Bools | slice = slice(None)) -> None:
        """Trust the next reading of these chips, whatever it is, as after a reset or at rest."""
        self._trusted[chips] = np.nan
        self._trust[chips] = self._doubt[chips] = 0
        self._still.forget(chips)

    def judge(self, codes: Words, values: Array, good: Bools, fresh: Bools) -> Bytes:
        """Judge one frame.

        Parameters
        ----------
        codes : ndarray, shape (t, 3) or (t, 4)
            As the chips sent them.
        values : ndarray, shape (t, 3)
            The same as fields (T).
        good : ndarray, shape (t,)
            Chips that were read.
        fresh : ndarray, shape (t,)
            Chips that had time for a new measurement since they were read last.

        Returns
        -------
        ndarray, shape (t,)
            Bits of `TaxelStatus`; 0 for chips that were not read.
        """
        saturated = (np.abs(values) >= self._limit).any(axis=1)
        jumped = self._jumped(values, good & ~saturated)
        repeated = self._still.follow(codes, good)
        status = saturated * np.uint8(TaxelStatus.SATURATED)
        status |= jumped * np.uint8(TaxelStatus.WRAPPED)
        if repeated.any():
            status |= (repeated & ~fresh) * np.uint8(TaxelStatus.STALE)
            status |= self._still.marks()
        return np.where(good, status, 0).astype(np.uint8)

    def _jumped(self, values: Array, usable: Bools) -> Bools:
        """Which chips are far from where they were trusted."""
        jumped: Bools = (np.abs(values - self._trusted) > self._jump).any(axis=1) & usable
        if jumped.any():
            self._doubt += jumped
            outvoted = jumped & (self._doubt > np.maximum(self._trust, LEAST_DOUBT))
            self._trust[outvoted] = self._doubt[outvoted]
            jumped &= ~outvoted
        trusted = usable & ~jumped
        self._trusted[trusted] = values[trusted]
        self._trust += trusted
        self._doubt[trusted] = 0
        return jumped
