"""Find frames of the framed protocol in a byte stream, and count what else is in it.

A decoder is told the one payload that it waits for, so the first eight bytes of a frame are known
and no damaged length can make it wait.
"""

from __future__ import annotations

import zlib
from collections import deque
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from tactile_ros.devices.framed import RESIDUE, SEQUENCES, head, record
from tactile_ros.devices.framed_payloads import Payload
from tactile_ros.devices.framed_readings import Readings, unpack
from tactile_ros.devices.framed_strays import Strays

SLICE_BYTES = 65536
# a longer gap is taken for a board that started anew
MOST_LOST = 1_000_000
# frames that are known again when they come once more
REMEMBERED = 64


@dataclass
class FramedCounts:
    """What a decoder has seen since it was made.

    Attributes
    ----------
    frames : int
        Delivered.
    dropped : int
        Lost by the board's own sequence, damaged ones included; one for a board that restarts.
    missing : int
        Those of `dropped` of which no byte came.
    lost_bytes : int
        Bytes outside of frames.
    crc_errors : int
        Frames with a good head whose CRC failed.
    framing_errors : int
        Runs of bytes between frames that hold no frame's head.
    other_version, other_kind, other_length : int
        Whole frames with a good CRC that are not the decoder's own.
    repeated : int
        Frames that had come before, the last or one of the 64 before it; not delivered.
    restarts : int
        Times the sequence started anew while the port stayed open.
    """

    frames: int = 0
    dropped: int = 0
    missing: int = 0
    lost_bytes: int = 0
    crc_errors: int = 0
    framing_errors: int = 0
    other_version: int = 0
    other_kind: int = 0
    other_length: int = 0
    repeated: int = 0
    restarts: int = 0


class Decoded(NamedTuple):
    """Frames of one `feed`, in order.

    Attributes
    ----------
    readings : Readings
        Counts, temperatures and status of s frames.
    time_us : list of int
        The board's clock at each (microseconds), which wraps at 2^32.
    lost : list of int
        Frames known lost directly before each.
    """

    readings: Readings
    time_us: list[int]
    lost: list[int]


class FramedDecoder:
    """Bytes in, frames out; the same frames however the bytes are cut.

    Parameters
    ----------
    payload : Payload
        What the frames carry.

    Notes
    -----
    Every place where the known head stands is tried, also inside a frame whose CRC failed, so that
    damage costs no good frame. At most one frame, and one foreign frame, is held back.
    """

    def __init__(self, payload: Payload) -> None:
        """See the class."""
        self.payload = payload
        self.counts = FramedCounts()
        self._head = head(payload)
        self._record = record(payload)
        self._strays = Strays(self._head, self.counts)
        self._buffer = b''
        self._last: int | None = None
        self._recent: deque[bytes] = deque(maxlen=REMEMBERED)
        self.reset()

    def reset(self) -> None:
        """Forget the stream, as after a reconnection; the counts stay."""
        self._strays.forget()
        self.counts.lost_bytes += len(self._buffer)
        self._buffer = b''
        self._last = None
        self._recent.clear()

    @property
    def synchronised(self) -> bool:
        """Whether a frame came since the last `reset`."""
        return self._last is not None

    @property
    def pending(self) -> int:
        """Bytes that are held back."""
        return len(self._buffer) + self._strays.pending

    @property
    def foreign(self) -> str:
        """The foreign frame that came last since the last `reset`, in words; empty: none."""
        return self._strays.foreign

    @property
    def strangers(self) -> int:
        """Foreign frames since the last good frame."""
        return self._strays.strangers

    def feed(self, data: bytes) -> Decoded:
        """Take the next bytes of the stream.

        Parameters
        ----------
        data : bytes
            Any count, cut anywhere.

        Returns
        -------
        Decoded
            The frames that ended in them.
        """
        if len(data) <= SLICE_BYTES:
            return self._drain(data)
        starts = range(0, len(data), SLICE_BYTES)
        return _joined([self._drain(data[i : i + SLICE_BYTES]) for i in starts])

    def _drain(self, data: bytes) -> Decoded:
        """Take all frames that are whole now."""
        buffer = self._buffer + data if self._buffer else data
        view, size = memoryview(buffer), self._record.itemsize
        places: list[int] = []
        lost: list[int] = []
        place = 0
        while True:
            found = buffer.find(self._head, place)
            if found != place:
                end = found if found >= 0 else self._kept(buffer, place)
                self._skip(buffer, place, end)
                place = end
                if found < 0:
                    break
            if place + size > len(buffer):
                break
            if zlib.crc32(view[place : place + size]) != RESIDUE:
                self.counts.crc_errors += 1
                self._strays.failed = True
                self._skip(buffer, place, place + 1)
                place += 1
                continue
            self._accept(view, place, places, lost)
            place += size
        self._buffer = buffer[place:]
        return self._decode(buffer, places, lost)

    def _kept(self, buffer: bytes, place: int) -> int:
        """Where the beginning of a head begins that ends the buffer; its end, if none does."""
        for count in range(min(len(self._head) - 1, len(buffer) - place), 0, -1):
            if buffer.endswith(self._head[:count]):
                return len(buffer) - count
        return len(buffer)

    def _skip(self, buffer: bytes, start: int, end: int) -> None:
        """Hand bytes on that belong to no frame of ours."""
        if end > start:
            self._strays.feed(buffer[start:end])

    def _accept(self, view: memoryview, place: int, places: list[int], lost: list[int]) -> None:
        """Count a good frame by its sequence; one that came before is left out."""
        sequence = int.from_bytes(view[place + 8 : place + 12], 'little')
        intact = self._strays.end()
        gap = 0 if self._last is None else (sequence - self._last) % SEQUENCES - 1
        told = self._told(view, place)
        # a board that started anew may count the same, but not at the same time and with this CRC
        if gap < 0 or (gap > MOST_LOST and told in self._recent):
            self.counts.repeated += 1
            return
        self._last = sequence
        self._recent.append(told)
        if gap > MOST_LOST:
            self.counts.restarts += 1
            gap = 1
        self.counts.dropped += gap
        self.counts.missing += gap if intact else 0
        places.append(place)
        lost.append(gap)

    def _told(self, view: memoryview, place: int) -> bytes:
        """Sequence, time and CRC of a frame, by which it is known again."""
        end = place + self._record.itemsize
        return bytes(view[place + 8 : place + 16]) + bytes(view[end - 4 : end])

    def _decode(self, buffer: bytes, places: list[int], lost: list[int]) -> Decoded:
        """Read all frames at once."""
        count, size = len(places), self._record.itemsize
        self.counts.frames += count
        if not count:
            rows = np.empty(0, self._record)
        elif places[-1] - places[0] == (count - 1) * size:
            rows = np.frombuffer(buffer, self._record, count, places[0])
        else:
            rows = np.frombuffer(b''.join(buffer[i : i + size] for i in places), self._record)
        readings = unpack(self.payload, rows['body'])
        return Decoded(readings, rows['time_us'].tolist(), lost)


def _joined(parts: list[Decoded]) -> Decoded:
    """Frames of several slices as one."""
    temperature_c = None
    if parts[0].readings.temperature_c is not None:
        warm = [part.readings.temperature_c for part in parts]
        temperature_c = np.concatenate([one for one in warm if one is not None])
    status = np.concatenate([part.readings.status for part in parts])
    counts = np.concatenate([part.readings.counts for part in parts])
    return Decoded(
        Readings(counts, temperature_c, status),
        [time_us for part in parts for time_us in part.time_us],
        [lost for part in parts for lost in part.lost],
    )
