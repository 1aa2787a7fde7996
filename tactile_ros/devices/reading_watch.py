"""Flags of chips whose readings cannot be trusted: saturated, wrapped, stuck, repeated.

A chip's code wraps beyond its range instead of clipping, so that a reading far outside looks like
one inside; only the way there tells.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.devices.still_watch import StillWatch
from tactile_ros.types import Array, Bools, Bytes, TaxelStatus

if TYPE_CHECKING:
    from tactile_ros.devices.mlx90393 import Words

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
