"""Messages of one topic in the order of the bag, until nothing can need them any more."""

from __future__ import annotations

from bisect import bisect_left, bisect_right


class Waiting:
    """Serialised messages with their log times (ns), and which of them were of use."""

    def __init__(self) -> None:
        self.type_name = ''
        self.logs: list[int] = []
        self.data: list[bytes] = []
        self.used: list[bool] = []

    def __len__(self) -> int:
        """Messages that wait."""
        return len(self.logs)

    def append(self, log_ns: int, data: bytes) -> None:
        """Take one more message in."""
        self.logs.append(log_ns)
        self.data.append(data)
        self.used.append(False)

    def heard_by(self, log_ns: int) -> int:
        """Count of the messages heard until then."""
        return bisect_right(self.logs, log_ns)

    def take(self, count: int) -> tuple[list[int], list[bytes]]:
        """Take the oldest messages out: their log times and data."""
        taken = self.logs[:count], self.data[:count]
        self._forget(count)
        return taken

    def forget_before(self, log_ns: int) -> int:
        """Drop what was heard earlier; how many of these were of no use."""
        count = bisect_left(self.logs, log_ns)
        useless = self.used[:count].count(False)
        self._forget(count)
        return useless

    def keep(self, kept: list[int], count: int) -> None:
        """Of the oldest `count` messages keep only some, by their places."""
        for column in (self.logs, self.data, self.used):
            column[:count] = [column[i] for i in kept]  # type: ignore[index]

    def _forget(self, count: int) -> None:
        del self.logs[:count], self.data[:count], self.used[:count]
