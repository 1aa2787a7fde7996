"""Which row of a recording is each frame that comes back: by order and content, never by time."""

from __future__ import annotations

import threading
from collections import deque
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable

    from tactile_ros.types import Array, Frame


class Ledger:
    """Rows on their way through a graph; safe to use from the sender and the listener.

    Attributes
    ----------
    sent : int
        Rows sent so far; the position of a row is its place among them.
    lost : int
        Rows that were overtaken by a later one, or given up.
    """

    def __init__(self) -> None:
        self.sent = 0
        self.lost = 0
        self._waiting: deque[tuple[int, int, Array]] = deque()
        self._sequences: dict[int, int] = {}
        self._settled = -1
        self._acknowledged = -1
        self._changed = threading.Condition()

    def send(self, row: int, values: Array) -> None:
        """Note that a row goes out; `values`, shape (t, c), as the receiver will read them."""
        with self._changed:
            self._waiting.append((self.sent, row, values))
            self.sent += 1

    def match(self, frame: Frame) -> int | None:
        """Row of a frame that came back; rows before it are lost, a stranger is None."""
        with self._changed:
            for steps, (position, row, values) in enumerate(self._waiting):
                if np.array_equal(values, frame.values, equal_nan=True):
                    for _ in range(steps + 1):
                        self._waiting.popleft()
                    self.lost += steps
                    self._settled = position
                    self._sequences[position] = frame.sequence
                    self._changed.notify_all()
                    return row
        return None

    def acknowledge(self, sequence: int) -> None:
        """All frames up to a sequence have gone through."""
        with self._changed:
            self._acknowledged = max(self._acknowledged, sequence)
            self._changed.notify_all()

    def is_through(self, position: int) -> bool:
        """Whether the row at a position, and so all before it, went through or is lost."""
        reached = self._sequences.get(position, -1)
        return self._settled >= position and self._acknowledged >= reached

    def wait(self, position: int, timeout: float, stopped: Callable[[], bool]) -> bool:
        """Wait until a row is through; False when `timeout` (s) is over or work was stopped."""
        with self._changed:
            return (
                self._changed.wait_for(lambda: stopped() or self.is_through(position), timeout)
                and not stopped()
            )

    def give_up(self) -> int:
        """Count all rows on their way as lost; return how many they were."""
        with self._changed:
            count = len(self._waiting)
            self.lost += count
            self._waiting.clear()
            self._settled = self.sent - 1
            self._acknowledged = max([self._acknowledged, *self._sequences.values()])
            return count

    def wake(self) -> None:
        """Let whoever waits look whether it shall stop."""
        with self._changed:
            self._changed.notify_all()
