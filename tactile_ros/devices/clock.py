"""Time that is handed in: the same driver runs on the machine's clock and on a virtual one."""

from __future__ import annotations


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
