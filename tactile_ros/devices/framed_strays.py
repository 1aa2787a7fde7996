"""Bytes between the frames that a framed decoder waits for: foreign frames or damage."""

from __future__ import annotations

import zlib
from typing import Protocol

from tactile_ros.devices.framed import HEAD, HEADER_BYTES, RESIDUE, SYNC, TRAILER_BYTES
from tactile_ros.devices.framed_payloads import MOST_BYTES, describe


class StrayCounts(Protocol):
    """Counts that strays add to, as in `FramedCounts`."""

    lost_bytes: int
    framing_errors: int
    other_version: int
    other_kind: int
    other_length: int


class Strays:
    """Parser of what lies between good frames; it never delays those.

    Parameters
    ----------
    own : bytes
        First eight bytes of the decoder's own frames.
    counts : StrayCounts
        Where to count.

    Attributes
    ----------
    failed : bool
        Set when a frame of one's own failed its CRC in this run: the damage is counted already.
    foreign : str
        Foreign frame that came last, in words; empty: none.
    strangers : int
        Foreign frames since the last good frame.
    """

    def __init__(self, own: bytes, counts: StrayCounts) -> None:
        """See the class."""
        self.failed = False
        self.foreign = ''
        self.strangers = 0
        self._own = HEAD.unpack(own)
        self._counts = counts
        self._held = b''
        self._noise = 0
        self._first = True

    @property
    def pending(self) -> int:
        """Bytes that may still become a foreign frame."""
        return len(self._held)

    def forget(self) -> None:
        """End the run without a verdict, as when the port is gone."""
        self._counts.lost_bytes += len(self._held)
        self._held, self._noise, self.failed = b'', 0, False
        self.foreign, self.strangers = '', 0
        self._first = True

    def end(self) -> bool:
        """Close the run at a good frame.

        Returns
        -------
        bool
            Whether no bytes were lost in it.
        """
        if not (self._held or self._noise or self.failed or self._first or self.strangers):
            return True
        self._lose(len(self._held))
        self._held = b''
        intact = not (self._noise or self.failed)
        # before the first frame there may be the tail of one
        if self._noise and not (self.failed or self._first):
            self._counts.framing_errors += 1
        self._noise, self.failed, self._first, self.strangers = 0, False, False, 0
        return intact

    def feed(self, data: bytes) -> None:
        """Take the next stray bytes; whole foreign frames are counted, the rest is noise."""
        held = self._held + data
        place = 0
        while (found := held.find(SYNC, place)) >= 0:
            self._lose(found - place)
            place = found
            length = self._foreign_bytes(held, place)
            if length is None:
                self._held = held[place:]
                return
            if not length:
                self._lose(len(SYNC))
            place += length or len(SYNC)
        kept = len(held) - 1 if held.endswith(SYNC[:1]) and len(held) > place else len(held)
        self._lose(kept - place)
        self._held = held[kept:]

    def _lose(self, count: int) -> None:
        """Count bytes that belong to no frame."""
        self._noise += count
        self._counts.lost_bytes += count

    def _foreign_bytes(self, held: bytes, place: int) -> int | None:
        """Length of the whole foreign frame at `place`; 0 if there is none, None if unknown."""
        if len(held) - place < HEAD.size:
            return None
        fields = HEAD.unpack_from(held, place)
        total: int = HEADER_BYTES + fields[4] + TRAILER_BYTES
        if fields == self._own or fields[4] > MOST_BYTES:
            return 0
        if len(held) - place < total:
            return None
        if zlib.crc32(memoryview(held)[place : place + total]) != RESIDUE:
            return 0
        self._note(fields)
        return total

    def _note(self, fields: tuple[int, ...]) -> None:
        """Count a foreign frame by the first field that differs, and name it."""
        _, version, kind, count, size = fields
        if version != self._own[1]:
            self._counts.other_version += 1
        elif kind != self._own[2]:
            self._counts.other_kind += 1
        else:
            self._counts.other_length += 1
        self.strangers += 1
        self.foreign = f'version {version}, {describe(kind, count, size)}'
