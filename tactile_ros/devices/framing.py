"""Find the board's frames in a byte stream without header, checksum or counter.

Evidence that a window of bytes is a frame: CR LF at its end, plausible fields, and a start that is
verified by the CR LF of the frame before it. To lock on takes three in a row; after damage one is
enough, since its length is verified at both ends. What cannot be seen: damage that keeps length,
CR LF and plausibility, and whole frames that never arrived (see `damage`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from tactile_ros.devices.packets import (
    TERMINATOR,
    TEXT,
    frame_bytes,
    plausible,
    readings,
    words,
)
from tactile_ros.types import Array, Bools, Integers

SLICE_BYTES = 4096
LOCK_FRAMES = 3
# in frames: when a start that carries odd fields or lost chips is believed, unless a better one came
PATIENCE = 4

_IS_TEXT = np.isin(np.arange(256), np.frombuffer(TEXT, np.uint8))


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
        Chips found faulty: implausible over three frames in which the others were not.
    skipped : ndarray, shape (s,)
        Frames known lost directly before.
    """

    values: Array
    temperature_c: Array
    error: Bools
    skipped: Integers

    def __len__(self) -> int:
        """Count of frames s."""
        return len(self.skipped)


class _Start(NamedTuple):
    """Where frames begin again, and what has to be tolerated in them."""

    known_at: int
    offset: int
    odd: bool
    faulty: Bools | None


class FrameDecoder:
    """Bytes in, frames out; the same frames however the bytes are cut.

    Parameters
    ----------
    chips : int
        Chips of the board (t).
    quantum : ndarray, shape (3,), or None
        Step of the chips' readings (T), where it is known; makes most flipped bits visible.

    Raises
    ------
    ValueError
        If `chips` is not 1 to 64.

    Notes
    -----
    A frame with an implausible chip is not delivered, since the damage may reach further than
    what can be seen; a chip that is implausible in three frames in a row, while most others are
    not, is faulty: its frames are delivered with NaN and `error` there, the three included, and it
    is given credit again whenever it is plausible.
    """

    def __init__(self, chips: int, quantum: npt.ArrayLike | None = None) -> None:
        """See the class."""
        self.chips = chips
        self.counts = StreamCounts()
        self._size = frame_bytes(chips)
        self._quantum = None if quantum is None else np.asarray(quantum, np.float64)
        self.reset()

    def reset(self) -> None:
        """Forget the stream, as after a reconnection; the counts stay."""
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
        """What is held back: the tail of a frame, or what no frame was found in."""
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
        return Decoded(*(np.concatenate(column) for column in zip(*found)))

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
        good = ended
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
            believed = (possible if self._odd else natural) | self._faulty
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
        """Look for the next believable start; cut the buffer there, or to what may still be one."""
        start = self._next_start()
        if start is None:
            self._skip(max(0, len(self._buffer) - PATIENCE * self._size - len(TERMINATOR)))
            return False
        self._odd |= start.odd
        if start.faulty is not None:
            self._faulty |= start.faulty
        self._skip(start.offset)
        self._locked, self._verified_start = True, False
        return True

    def _skip(self, count: int) -> None:
        """Drop bytes from the head of the buffer and account for them."""
        if not count:
            return
        self.counts.framing_errors += self._fault == 'framing'
        self.counts.implausible += self._fault == 'implausible'
        self._fault = ''
        self._verified_start = False
        self._buffer = self._buffer[count:]
        self._skipped += count
        self.counts.lost_bytes += count

    def _next_start(self) -> _Start | None:
        """Earliest offset, in the order in which the bytes make them known, where frames go on."""
        stream = np.frombuffer(self._buffer, np.uint8)
        size, length = self._size, len(stream)
        led = np.zeros(length + 1 + 3 * size, bool)
        led[2 : length + 1] = (stream[:-1] == TERMINATOR[0]) & (stream[1:] == TERMINATOR[1])
        offsets = np.flatnonzero(led[size : length + 1])
        windows = stream[offsets[:, None] + np.arange(size)]
        binary = ~_IS_TEXT[windows].all(axis=1)
        offsets, windows = offsets[binary], windows[binary]
        if not len(offsets):
            return None
        led[0] = self._verified_start
        led[size] |= self._keeps_phase()
        possible, natural = plausible(words(windows), self._quantum)
        possible, natural = possible | self._faulty, natural | self._faulty
        at = np.full(length + 1 + 3 * size, -1)
        at[offsets] = np.arange(len(offsets))
        if self._synchronised:
            starts = self._resume(offsets, led, possible, natural)
        else:
            starts = self._lock_on(offsets, led, natural)
        starts += self._lock_on_odd(offsets, at, led, possible, natural)
        known = [start for start in starts if start.known_at <= length]
        return min(known, key=lambda start: start[:2]) if known else None

    def _keeps_phase(self) -> bool:
        """Whether a single byte of the bad frame's CR LF is wrong, its start being verified."""
        if not (self._verified_start and self._fault == 'framing'):
            return False
        end = self._buffer[self._size - 2 : self._size]
        return end[:1] == TERMINATOR[:1] or end[1:] == TERMINATOR[1:]

    def _resume(
        self, offsets: Integers, led: Bools, possible: Bools, natural: Bools
    ) -> list[_Start]:
        """After damage: one frame verified at both ends, or two where fields are odd."""
        size = self._size
        sure = offsets[led[offsets] & natural.all(axis=1)]
        starts = [_Start(int(q) + size, int(q), False, None) for q in sure[:1]]
        fits = _marks(offsets, possible.all(axis=1), len(led))
        odd = offsets[led[offsets] & fits[offsets] & fits[offsets + size]]
        return starts + [_Start(int(q) + 2 * size, int(q), True, None) for q in odd[:1]]

    def _lock_on(self, offsets: Integers, led: Bools, natural: Bools) -> list[_Start]:
        """At first: three frames in a row; the first counts if its start is verified."""
        size = self._size
        fits = _marks(offsets, natural.all(axis=1), len(led))
        run = offsets[fits[offsets] & fits[offsets + size] & fits[offsets + 2 * size]]
        return [
            _Start(int(q) + LOCK_FRAMES * size, int(q) + (0 if led[q] else size), False, None)
            for q in run[:1]
        ]

    def _lock_on_odd(
        self, offsets: Integers, at: Integers, led: Bools, possible: Bools, natural: Bools
    ) -> list[_Start]:
        """Three frames in a row in which the same few chips are implausible, or fields odd."""
        size = self._size
        run = np.stack([at[offsets], at[offsets + size], at[offsets + 2 * size]])
        run = run[:, (run >= 0).all(axis=0)]
        bad = ~possible[run]
        faulty = bad.all(axis=0)
        steady = (bad.any(axis=0) == faulty).all(axis=1)
        few = 2 * faulty.sum(axis=1) < self.chips
        for k in np.flatnonzero(steady & few)[:1]:
            q = int(offsets[run[0, k]])
            start = q if led[q] else q + size
            odd = bool((~natural[run[:, k]] & ~faulty[k]).any())
            return [_Start(q + PATIENCE * size, start, odd, faulty[k])]
        return []


def _marks(offsets: Integers, chosen: Bools, length: int) -> Bools:
    """Offsets that are chosen, as a mask over the stream."""
    marks = np.zeros(length, bool)
    marks[offsets[chosen]] = True
    return marks


def _nothing(chips: int) -> Decoded:
    """No frames."""
    return Decoded(
        np.empty((0, chips, 3)),
        np.empty((0, chips)),
        np.zeros((0, chips), bool),
        np.zeros(0, np.int64),
    )
