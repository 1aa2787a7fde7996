"""When a grip steps: as soon as all fingers have told something new, otherwise by the clock.

A step that waits for a timer would add a period to every force, and two graphs whose timers differ
would not decide the same. So forces set the pace, and the time between two steps is that between
their stamps. The clock takes over where they fail to come.
"""

from __future__ import annotations

from math import inf, isfinite

LATE = 1.5  # periods after which nobody is waited for
# s: a loop that is a little late lacks no force, and a step of the clock would delay it further
LEAST_LATE_S = 7.5e-3
EARLY = 0.25  # of a period; frames jitter
BACK = 2.0  # periods by which a stamp lies before its time where its clock was set back


class GripPace:
    """Pace of one grip.

    Parameters
    ----------
    period_s : float
        Of commands (s).
    silence_s : float
        A finger that has been silent for longer is not waited for (s).
    fingers : int
        Count f.

    Attributes
    ----------
    newest_ns : int or None
        Newest stamp of what came since the last step (ns); None: there is none.

    Examples
    --------
    >>> pace = GripPace(0.01, 0.015, 2)
    >>> for finger in (0, 1):
    ...     _ = pace.take(finger, None, 5.000)
    >>> pace.step(5.000)
    0.01
    >>> pace.take(0, None, 5.010), pace.take(1, None, 5.011)  # when both are there
    (False, True)
    >>> pace.is_late(5.014), pace.is_late(5.016)
    (False, True)
    """

    def __init__(self, period_s: float, silence_s: float, fingers: int) -> None:
        self._period_s, self._silence_s = period_s, silence_s
        self._period_ns = round(1e9 * period_s)
        self._came_s = [-inf] * fingers
        self._new = [False] * fingers
        self.newest_ns: int | None = None
        self._stepped_ns: int | None = None
        self._stepped_s = -inf
        self._due_ns = 0

    def take(self, finger: int, stamp_ns: int | None, now_s: float) -> bool:
        """Note what came from a finger, and say whether a step is due.

        Parameters
        ----------
        finger : int
            Which.
        stamp_ns : int or None
            When it was measured (ns); None: its stamp is of another clock.
        now_s : float
            Time of the clock that never jumps (s).

        Returns
        -------
        bool
            Whether a step is due now.
        """
        self._came_s[finger], self._new[finger] = now_s, True
        newest = self.newest_ns
        if stamp_ns is not None and (newest is None or stamp_ns > newest):
            self.newest_ns = stamp_ns
        return self._is_complete(now_s) and self._is_due(now_s)

    def _is_complete(self, now_s: float) -> bool:
        """Every finger that is not silent has told something new."""
        if all(self._new):
            return True
        pairs = zip(self._new, self._came_s, strict=True)
        return all(new or now_s - came_s > self._silence_s for new, came_s in pairs)

    def _is_due(self, now_s: float) -> bool:
        """A period has passed since the last step, but for the jitter of frames."""
        if self.newest_ns is None or self._stepped_ns is None:
            return now_s - self._stepped_s >= (1.0 - EARLY) * self._period_s
        ahead = (self.newest_ns - self._due_ns) / self._period_ns
        return ahead >= -EARLY or ahead < -BACK

    def is_late(self, now_s: float) -> bool:
        """Whether a step is due although the fingers have not told enough."""
        return now_s - self._stepped_s >= max(LATE * self._period_s, LEAST_LATE_S)

    def step(self, now_s: float) -> float:
        """Begin a step; the time since the last (s), positive where the clocks are sound."""
        newest, last = self.newest_ns, self._stepped_ns
        by_stamp = newest is not None and last is not None and newest > last
        since = 1e-9 * (newest - last) if by_stamp else now_s - self._stepped_s
        if newest is not None:
            late = newest - self._due_ns
            self._due_ns = self._due_ns if abs(late) < self._period_ns else newest
            self._due_ns += self._period_ns
        self._stepped_ns, self.newest_ns = newest, None
        self._stepped_s = now_s
        self._new = [False] * len(self._new)
        return since if isfinite(since) else self._period_s
