"""Find the board's frames in a byte stream without header, checksum or counter.

To lock on takes three frames in a row; after damage one is enough, since its length is verified at
both ends. What cannot be seen: damage that keeps length, CR LF and plausibility, and whole frames
that never arrived (`damage` measures the share).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from tactile_ros.devices.alignment import KEPT, Start, gather, next_start
from tactile_ros.devices.packets import TERMINATOR, frame_bytes, plausible, readings, words
from tactile_ros.types import Array, Bools, Integers

SLICE_BYTES = 4096


@dataclass
class StreamCounts:
    """What a decoder has seen since it was made.

    Attributes
    ----------
    frames : int
        Delivered.
    dropped : int
        Known lost: bytes skipped since the last good frame over the length of a frame.
    lost_bytes : int
        Skipped, those before the first frame included.
    framing_errors, implausible : int
        Frames that broke length or period; frames that broke plausibility alone.
    """

    frames: int = 0
    dropped: int = 0
    lost_bytes: int = 0
    framing_errors: int = 0
    implausible: int = 0


class Decoded(NamedTuple):
    """Frames of one `feed`, in order.

    Attributes
    ----------
    values : ndarray, shape (s, t, 3)
        Flux density (T); NaN where `error`.
    temperature_c : ndarray, shape (s, t)
        Chip temperature (degrees Celsius); NaN where `error`.
    error : ndarray, shape (s, t)
        Chips that are faulty and implausible in this frame.
    skipped : ndarray, shape (s,)
        Frames known lost directly before.
    """

    values: Array
    temperature_c: Array
    error: Bools
    skipped: Integers


class FrameDecoder:
    """Bytes in, frames out; the same frames however the bytes are cut.

    Parameters
    ----------
    chips : int
        Chips of the board (t).
    quantum : array_like, shape (3,), or None
        Step of the chips' readings (T), where it is known exactly; shows most flipped bits.

    Raises
    ------
    ValueError
        If `chips` is not 1 to 64.

    Notes
    -----
    A frame with an implausible chip is not delivered, since the damage may reach further than
    what can be seen. A chip that is implausible in three frames in a row, while most others are
    not, is faulty: those and all later frames are delivered, with NaN and `error` wherever it is
    implausible.
    """

    def __init__(self, chips: int, quantum: npt.ArrayLike | None = None) -> None:
        """See the class."""
        self.chips = chips
        self.counts = StreamCounts()
        self._size = frame_bytes(chips)
        self._quantum = None if quantum is None else np.asarray(quantum, np.float64)
        self._buffer = b''
        self.reset()

    def reset(self) -> None:
        """Forget the stream, as after a reconnection; the counts stay."""
        self.counts.lost_bytes += len(self._buffer)
        self._buffer = b''
        self._locked = False
        self._synchronised = False
        self._verified_start = True
        self._fault = ''
        self._skipped = 0
        self._odd = False
        self._faulty = np.zeros(self.chips, bool)

    @property
    def locked(self) -> bool:
        """Whether the next frame is expected at a known place."""
        return self._locked

    @property
    def pending(self) -> bytes:
        """What is held back: the head of a frame, or bytes in which no frame was found."""
        return self._buffer

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
        found: list[Decoded] = []
        for i in range(0, len(data), SLICE_BYTES):
            self._buffer += data[i : i + SLICE_BYTES]
            self._drain(found)
        if len(found) == 1:
            return found[0]
        if not found:
            return _nothing(self.chips)
        return Decoded(*(np.concatenate(column) for column in zip(*found, strict=True)))

    def _drain(self, found: list[Decoded]) -> None:
        """Take frames, and search whenever one is bad, until bytes run out."""
        while len(self._buffer) >= self._size:
            if self._locked:
                self._take(found)
                if self._locked:
                    return
            elif not self._search():
                return

    def _take(self, found: list[Decoded]) -> None:
        """Deliver frames from the head of the buffer up to the first bad one."""
        size = self._size
        whole = len(self._buffer) // size
        ended = 0
        while ended < whole and self._buffer.startswith(TERMINATOR, (ended + 1) * size - 2):
            ended += 1
        good = 0
        if ended:
            rows = np.frombuffer(self._buffer, np.uint8, ended * size).reshape(ended, size)
            good = self._deliver(rows, found)
        self._buffer = self._buffer[good * size :]
        if good < whole:
            self._locked = False
            self._verified_start = True
            self._fault = 'framing' if good == ended else 'implausible'

    def _deliver(self, rows: npt.NDArray[np.uint8], found: list[Decoded]) -> int:
        """Decode the rows before the first that is not believed; return their count."""
        patterns = words(rows)
        possible, natural = plausible(patterns, self._quantum)
        error = None
        if not natural.all():
            believed = np.logical_or(possible if self._odd else natural, self._faulty)
            good = int(np.append(believed.all(axis=1), False).argmin())
            if not good:
                return 0
            patterns, error = patterns[:good], ~possible[:good]
        count = len(patterns)
        skipped = np.zeros(count, np.int64)
        skipped[0], self._skipped = self._lost_frames(), 0
        self.counts.frames += count
        self.counts.dropped += int(skipped[0])
        values, temperature_c = readings(patterns, error)
        if error is None:
            error = np.zeros((count, self.chips), bool)
        found.append(Decoded(values, temperature_c, error, skipped))
        return count

    def _lost_frames(self) -> int:
        """Estimate the frames in the bytes skipped since the last good one."""
        if not (self._skipped and self._synchronised):
            self._synchronised = True
            return 0
        return max(1, round(self._skipped / self._size))

    def _search(self) -> bool:
        """Cut the buffer at the next believable start, or to what may still become one."""
        first = KEPT * self._size  # what they make known, the rest cannot change
        start = self._start(self._buffer[:first])
        if start is None and len(self._buffer) > first:
            start = self._start(self._buffer)
        if start is None:
            self._skip(len(self._buffer) - KEPT * self._size - len(TERMINATOR))
            return False
        self._odd |= start.odd
        if start.faulty is not None:
            self._faulty |= start.faulty
        self._skip(start.offset)
        self._locked = True
        return True

    def _start(self, stream: bytes) -> Start | None:
        """Believable start in what is at hand."""
        seen = gather(stream, self._verified(), self._faulty, self._quantum)
        return next_start(seen, len(stream), self._synchronised, self._odd)

    def _skip(self, count: int) -> None:
        """Drop bytes from the head of the buffer, if any, and account for them."""
        if count <= 0:
            return
        self.counts.framing_errors += self._fault == 'framing'
        self.counts.implausible += self._fault == 'implausible'
        self._fault = ''
        self._verified_start = False
        self._buffer = self._buffer[count:]
        self._skipped += count
        self.counts.lost_bytes += count

    def _verified(self) -> list[int]:
        """Offsets that follow a frame's end although the buffer holds no CR LF before them."""
        if not self._verified_start:
            return []
        if not self._synchronised:
            # a stream may begin with the second half of a CR LF
            return [0, 1] if self._buffer.startswith(TERMINATOR[1:]) else [0]
        end = self._buffer[self._size - 2 : self._size]
        one_byte = end[:1] == TERMINATOR[:1] or end[1:] == TERMINATOR[1:]
        return [0, self._size] if one_byte else [0]


def _nothing(chips: int) -> Decoded:
    """No frames."""
    return Decoded(
        np.empty((0, chips, 3)),
        np.empty((0, chips)),
        np.zeros((0, chips), bool),
        np.zeros(0, np.int64),
    )
