"""Messages of one topic in the order of the bag, until nothing can need them any more."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable


class Waiting:
    """Serialised messages with their log times (ns), and which of them were of use."""

    def __init__(self, type_name: str = '') -> None:
        self.type_name = type_name
        self.logs: list[int] = []
        self.data: list[bytes] = []
        self._used: set[int] = set()
        self._forgotten = 0
        self._last_ns = 0

    def __len__(self) -> int:
        """Messages that wait."""
        return len(self.logs)

    def append(self, log_ns: int, data: bytes) -> None:
        """Take one more message in."""
        self.logs.append(log_ns)
        self.data.append(data)

    @property
    def last_ns(self) -> int:
        """Log time of the newest message; 0: none was heard."""
        return self.logs[-1] if self.logs else self._last_ns

    def heard_by(self, log_ns: int) -> int:
        """Count of the messages heard until then."""
        return bisect_right(self.logs, log_ns)

    def take(self, count: int) -> tuple[list[int], list[bytes]]:
        """Take the oldest messages out: their log times and data."""
        taken = self.logs[:count], self.data[:count]
        self._forget(count)
        return taken

    def use(self, places: Iterable[int]) -> None:
        """Messages of these places were of use."""
        self._used.update(self._forgotten + place for place in places)

    def forget_before(self, log_ns: int) -> int:
        """Drop what was heard earlier; how many of these were of no use."""
        count = bisect_left(self.logs, log_ns)
        end = self._forgotten + count
        useful = {place for place in self._used if place < end}
        self._used -= useful
        self._forget(count)
        return count - len(useful)

    def keep(self, kept: list[int], count: int) -> None:
        """Of the oldest `count` messages keep only some, by their places; none was of use yet."""
        self._last_ns = self.last_ns
        self.logs[:count] = [self.logs[i] for i in kept]
        self.data[:count] = [self.data[i] for i in kept]

    def _forget(self, count: int) -> None:
        self._last_ns = self.last_ns
        del self.logs[:count], self.data[:count]
        self._forgotten += count
