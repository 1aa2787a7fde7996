"""Time that is handed in: the same driver runs on the machine's clock and on a virtual one."""

from __future__ import annotations

import time
from typing import Protocol


class Clock(Protocol):
    """What tells the time and lets it pass."""

    def now_ns(self) -> int:
        """Time now (ns)."""
        ...

    def sleep(self, seconds: float) -> None:
        """Let time pass; negative durations pass none."""
        ...


class SystemClock:
    """The machine's own monotonic clock."""

    def now_ns(self) -> int:
        """Time now (ns)."""
        return time.monotonic_ns()

    def sleep(self, seconds: float) -> None:
        """Let time pass; negative durations pass none."""
        time.sleep(max(0.0, seconds))


class VirtualClock:
    """A clock that moves when somebody sleeps or lets time pass.

    Parameters
    ----------
    start_ns : int
        Its first reading (ns).

    Examples
    --------
    >>> clock = VirtualClock()
    >>> clock.sleep(1.5e-3)
    >>> clock.now_ns()
    1500000
    """

    def __init__(self, start_ns: int = 0) -> None:
        self._now_ns = start_ns

    def now_ns(self) -> int:
        """Time now (ns)."""
        return self._now_ns

    def sleep(self, seconds: float) -> None:
        """Let time pass; negative durations pass none."""
        self._now_ns += max(0, round(seconds * 1e9))


class LeadingClock:
    """A clock that may run a little ahead of another, so that many short waits cost one.

    Parameters
    ----------
    clock : Clock
        The clock that is followed.
    lead_s : float
        How far ahead it may run (s); beyond that it waits for the other.

    Notes
    -----
    A machine wakes from a wait of 0.1 ms some 0.06 ms late; a simulated bus that waited for each
    of its bytes would be slower than the real one.
    """

    def __init__(self, clock: Clock, lead_s: float = 1e-3) -> None:
        """See the class."""
        self._clock = clock
        self._lead_ns = round(lead_s * 1e9)
        self._ahead_ns = clock.now_ns()

    def now_ns(self) -> int:
        """Time now (ns); never less than the other clock's."""
        return max(self._ahead_ns, self._clock.now_ns())

    def sleep(self, seconds: float) -> None:
        """Let time pass; negative durations pass none."""
        self._ahead_ns = self.now_ns() + max(0, round(seconds * 1e9))
        lead_ns = self._ahead_ns - self._clock.now_ns()
        if lead_ns > self._lead_ns:
            self._clock.sleep(lead_ns * 1e-9)
