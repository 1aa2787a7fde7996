# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Text lines of numbers, as a microcontroller prints them: one line a frame.

Commas, semicolons, blanks or tabs stand between the numbers. One more column before them, a label
or a time, is skipped, and so is a label that ends in a colon. The format has no checksum, counter
or clock: only lines that cannot be read are known to be lost.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from tactile_ros.types import Array

COLUMN_BYTES = 5  # four digits and what separates them: a usual number
END = b'\r\n'
MOST_LINES = 16  # usual lines without an end, after which it is no text of numbers
SHOWN = 60  # bytes of a line in a sentence
_BLANKS = bytes.maketrans(b',;\t\r', b'    ')
_NUMERIC = b'0123456789+-.eE'


def encode(numbers: Array, decimals: int = 0) -> bytes:
    """Write numbers of any shape as one line, each with so many digits after its point."""
    rounded = np.round(np.ravel(numbers), decimals) + 0.0  # no -0
    printed = (f'{number:.{decimals}f}' for number in rounded)
    return ','.join(printed).encode() + END


class Decoded(NamedTuple):
    """Lines of one `feed`, in order."""

    numbers: Array  # (s, n)
    lost: list[int]  # lines known lost before each


@dataclass
class LineCounts:
    """Counts of a decoder since it was made."""

    frames: int = 0  # lines that were delivered
    malformed: int = 0  # lines that were no numbers, too few, too many, or never ended


class LineDecoder:
    """Bytes in, lines of `count` numbers out; the same lines however the bytes are cut.

    The first line after `reset` lacks its beginning, perhaps, and does not count. The lines after
    it tell whether there is a column before the numbers; another number of columns is believed
    when it comes twice. `last` is the last line that could not be read, in quotes.
    """

    def __init__(self, count: int) -> None:
        self.content = f'{count} numbers a line'
        self.size = COLUMN_BYTES * count + len(END)
        self.counts = LineCounts()
        self._count = count
        self.reset()

    def reset(self) -> None:
        """Forget the stream, as after a reconnection; the counts stay."""
        self.last = ''
        self._rest = b''  # a line without its end
        self._torn = True  # it lacks its beginning
        self._columns = self._before = 0  # in use, and of the line before; 0: not known yet
        self._lost_bytes = 0  # of malformed lines since the last good one
        self._synchronised = False  # a good one came

    def feed(self, data: bytes) -> Decoded:
        """Take the next bytes of the stream, cut anywhere; the lines that ended in them."""
        *lines, self._rest = (self._rest + data).split(b'\n')
        found: list[list[float]] = []
        lost: list[int] = []
        for line in lines:
            torn, self._torn = self._torn, False
            if torn or not line.strip():
                continue
            numbers = self._numbers(line)
            if numbers is None:
                self._refuse(line)
                continue
            found.append(numbers)
            lost.append(self._end_loss(len(line) + 1))
        if len(self._rest) > MOST_LINES * self.size:
            if not self._torn:
                self._refuse(self._rest)
            self._rest, self._torn = b'', True
        self.counts.frames += len(found)
        return Decoded(np.array(found, np.float64).reshape(-1, self._count), lost)

    def _numbers(self, line: bytes) -> list[float] | None:
        """Numbers of a line, None where it is none of ours."""
        if len(line) > MOST_LINES * self.size or not line.isascii():
            return None
        fields = line.rpartition(b':')[2].translate(_BLANKS).split()
        numbers = fields[len(fields) - self._count :]
        if len(fields) - self._count not in (0, 1) or b''.join(numbers).translate(None, _NUMERIC):
            return None
        try:
            found = [float(number) for number in numbers]
        except ValueError:
            return None
        before, self._before = self._before, len(fields)
        if not all(map(math.isfinite, found)) or (
            self._columns not in (0, len(fields)) and before != len(fields)
        ):
            return None
        self._columns = len(fields)
        return found

    def _refuse(self, line: bytes) -> None:
        """Count a line that cannot be read."""
        self.counts.malformed += 1
        self._lost_bytes += min(len(line) + 1, MOST_LINES * self.size)
        self.last = repr(line[:SHOWN].strip())[1:]

    def _end_loss(self, size: int) -> int:
        """Lines lost before a good one of so many bytes; none before the first."""
        lost, self._lost_bytes = self._lost_bytes, 0
        synchronised, self._synchronised = self._synchronised, True
        return max(1, round(lost / size)) if lost and synchronised else 0
