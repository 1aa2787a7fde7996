"""What one stream of the gradiometer remembers: how warm chips and disc are, and where it was."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.conditioning.history import History
from tactile_ros.sensors.gradiometer.thermal import ANY_LAG, ThermalMemory
from tactile_ros.sensors.gradiometer.untold import LastTold

if TYPE_CHECKING:
    from tactile_ros.types import Array, Signals

PAST = np.array([0.3, 3.0])  # s, of an elastomer that creeps


class StreamMemory:
    """Memory of one stream.

    Parameters
    ----------
    lag : float
        Time constant with which the disc follows the chip's temperature (s).
    wander : ndarray, shape (3, m), or None
        Of `wandering`; None: temperatures stay as they were while none is told.
    lag_is_told : bool
        Whether anything tells that time constant.
    """

    def __init__(
        self, lag: float, wander: Array | None = None, *, lag_is_told: bool = True
    ) -> None:
        self.thermal = ThermalMemory(lag, wander)
        self.slower = None if lag_is_told else ThermalMemory(ANY_LAG, wander)
        self.places = History(PAST)
        self._last = LastTold()

    def with_temperatures(self, signals: Signals) -> Signals:
        """The same, where chips told no temperature with the ones that they told last."""
        return self._last(signals)

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
