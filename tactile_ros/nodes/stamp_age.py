"""When a message was measured, on a clock that never jumps."""

from __future__ import annotations

from math import nan

AHEAD_S = 2e-3  # a stamp may lie so far in the future: two clocks are read one after another
OLDEST_S = 1.0  # first message that may tell that clocks agree
STEP_S = 0.05  # change between wall and monotonic clock from one message to the next: a jump


class StampAge:
    """Ages of one stream, from its stamps where clocks agree and from its arrival otherwise.

    Clocks agree once a message comes with a stamp of the last second. From then on its stamps are
    believed, however old they say that it is: a queue that keeps messages back makes them stale. A
    stamp in the future or before the last one, or a wall clock that jumps, asks anew.

    Attributes
    ----------
    agrees : bool
        Whether the last message was dated by its stamp.
    back_s : float
        By how much its clock stepped back, while that makes its messages old (s); else 0.

    Examples
    --------
    >>> ages = StampAge()
    >>> ages.measured_s(10_000_000_000, 10_020_000_000, 5.0)  # a stamp of 20 ms ago
    4.98
    >>> ages.measured_s(10_010_000_000, 13_020_000_000, 8.0)  # believed: kept back for long
    4.99
    >>> StampAge().measured_s(0, 10_030_000_000, 5.01)  # of another clock
    5.01
    """

    def __init__(self) -> None:
        self.agrees = False
        self.back_s = 0.0
        self._ahead_s = nan
        self._last_ns = 0

    def measured_s(self, stamp_ns: int, now_ns: int, now_s: float) -> float:
        """When it was measured (s).

        Parameters
        ----------
        stamp_ns : int
            Of the message (ns); 0: it has none.
        now_ns : int
            Time of the clock that stamps are of (ns).
        now_s : float
            Time of the clock that never jumps (s).

        Returns
        -------
        float
            Of the clock that never jumps; never in the future.
        """
        delay = 1e-9 * (now_ns - stamp_ns)
        ahead = 1e-9 * now_ns - now_s
        jumped = abs(ahead - self._ahead_s) > STEP_S
        self._ahead_s = ahead
        back_s = 1e-9 * (self._last_ns - stamp_ns)
        self._last_ns = stamp_ns
        if min(back_s, delay) > STEP_S:
            self.back_s = back_s
        elif delay < self.back_s - STEP_S:
            self.back_s = 0.0
        if jumped or not self.agrees or delay < -AHEAD_S or back_s > STEP_S:
            self.agrees = -AHEAD_S <= delay <= OLDEST_S
        return now_s - max(delay, 0.0) if self.agrees else now_s
