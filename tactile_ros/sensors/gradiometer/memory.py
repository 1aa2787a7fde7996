"""What one stream of the gradiometer remembers: how warm chips and disc are, and where it was."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.conditioning.history import History
from tactile_ros.sensors.gradiometer.thermal import ThermalMemory

if TYPE_CHECKING:
    from tactile_ros.signals import Signals
    from tactile_ros.types import Array, Integers

PAST = np.array([0.3, 3.0])  # s, of an elastomer that creeps
HELD_NS = 4_000_000_000  # in which the temperature that a chip told still stands


class StreamMemory:
    """Memory of one stream.

    Parameters
    ----------
    lag : float
        Time constant with which the disc follows the chip's temperature (s).
    """

    def __init__(self, lag: float) -> None:
        self.thermal = ThermalMemory(lag)
        self.places = History(PAST)
        self._chips: tuple[Array, Integers] | None = None

    def with_temperatures(self, signals: Signals) -> Signals:
        """The same, where a chip told none with the one that it told last, if that is not old."""
        chips, stamps = signals.temperature_c, signals.stamp_ns
        if chips is None or stamps is None or not len(stamps):
            return signals
        if np.count_nonzero(np.isfinite(chips)) == chips.size:  # as usual
            self._chips = chips[-1], np.full(chips.shape[1], stamps[-1])
            return signals
        first = (np.full(chips.shape[1], np.nan), np.full(chips.shape[1], stamps[0]))
        last, when = self._chips or first
        told = np.concatenate([last[None], chips])
        times = np.concatenate([when[None], np.tile(stamps[:, None], chips.shape[1])])
        row = np.where(np.isfinite(told), np.arange(len(told))[:, None], 0)
        row = np.maximum.accumulate(row, axis=0)
        told, times = np.take_along_axis(told, row, 0), np.take_along_axis(times, row, 0)
        self._chips = told[-1], times[-1]
        age = stamps[:, None] - times[1:]
        stands = (age >= 0) & (age <= HELD_NS)
        return replace(signals, temperature_c=np.where(stands, told[1:], np.nan))

    def past(self, signals: Signals, now: Array) -> Array:
        """Fading means (s, 2 d) of what is now (s, d), since the stream began at rest."""
        stamps, rows = signals.stamp_ns, len(now)
        if stamps is None:
            return np.tile(now, len(PAST))
        if rows == 1:
            if signals.restart[0]:
                self.places.reset()
            return self.places.step(now[0], int(stamps[0])).reshape(1, -1)
        return self.places(now, stamps, signals.restart).reshape(rows, len(PAST) * now.shape[1])
