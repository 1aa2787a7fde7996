# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Wire format of the ReSkin / AnySkin board: N x float32 (t, x, y, z), little-endian, then CR LF.

No header, checksum, counter or clock. A frame of N chips is 16 N + 2 bytes; t is in degrees
Celsius, x, y, z in microtesla. To lock on takes three frames in a row; after damage one is enough,
since its length is verified at both ends. Not detected are damage that keeps length, CR LF and
plausibility, and whole frames that never arrived.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from tactile_ros.types import Array, Bools, Bytes

Words = npt.NDArray[np.uint32]

TERMINATOR = b'\r\n'
TEXT = b'0123456789+-.,\t\r\n eEnaifNAIF'
CHIP_BYTES = 16
MOST_CHIPS = 64
MICROTESLA_PER_TESLA = 1e6
FIELD_LIMIT_MICROTESLA = 150_000.0
TEMPERATURE_LIMITS_C = (-40.0, 125.0)
# a chip's step is 0.1 uT or more; smaller fields are 0 on the wire
SMALLEST_MICROTESLA = 1e-6
GRID_TOLERANCE = 0.01

SLICE_BYTES = 4096
LOCK_FRAMES = 3
PATIENCE = 4  # frames after which a start with lost chips serves, without a better
KEPT = 8  # frames of bytes that are kept while none is found


def _bits(value: float) -> np.uint32:
    """Pattern of a positive float32; patterns order as the numbers do."""
    return np.uint32(np.array(value, '<f4').view('<u4'))


_MAGNITUDE = np.uint32(0x7FFFFFFF)
_NAN = np.uint32(0x7FC00000)
_HIGHEST = np.array([_bits(TEMPERATURE_LIMITS_C[1]), *[_bits(FIELD_LIMIT_MICROTESLA)] * 3])
_COLDEST = np.uint32(_bits(-TEMPERATURE_LIMITS_C[0]) | np.uint32(0x80000000))
_SMALLEST = _bits(SMALLEST_MICROTESLA)
_SPAN = _HIGHEST - _SMALLEST
_IS_TEXT = np.isin(np.arange(256), np.frombuffer(TEXT, np.uint8))


def frame_bytes(chips: int) -> int:
    """Length of a frame of `chips` chips, its CR LF included."""
    if not 1 <= chips <= MOST_CHIPS:
        msg = f'chips must be 1 to {MOST_CHIPS}; received {chips}'
        raise ValueError(msg)
    return CHIP_BYTES * chips + len(TERMINATOR)


def encode(values: npt.ArrayLike, temperature_c: npt.ArrayLike = 25.0) -> bytes:
    """Write frames as the board does, of values (t, 3) or (s, t, 3) (T).

    `temperature_c` (degrees Celsius) is broadcast to (s, t). A ValueError refuses another shape.
    """
    table = np.asarray(values, np.float64)
    if table.ndim not in (2, 3) or table.shape[-1] != 3:
        msg = f'values of encode must have shape (t, 3) or (s, t, 3); received {table.shape}'
        raise ValueError(msg)
    table = table.reshape(-1, *table.shape[-2:])
    samples, chips = table.shape[:2]
    fields = np.empty((samples, chips, 4), '<f4')
    fields[..., 0] = temperature_c
    fields[..., 1:] = table * MICROTESLA_PER_TESLA
    fields[..., 1:][np.abs(fields[..., 1:]) < SMALLEST_MICROTESLA] = 0.0
    rows = np.empty((samples, frame_bytes(chips)), np.uint8)
    rows[:, :-2] = fields.reshape(samples, -1).view(np.uint8)
    rows[:, -2:] = np.frombuffer(TERMINATOR, np.uint8)
    return rows.tobytes()


def words(rows: Bytes) -> Words:
    """Frames (s, 16 t + 2) as 32-bit patterns of t, x, y, z, shape (s, t, 4)."""
    payload = np.ascontiguousarray(rows[:, :-2])
    return payload.view('<u4').reshape(len(rows), rows.shape[1] // CHIP_BYTES, 4)


def readings(patterns: Words, error: Bools | None = None) -> tuple[Array, Array]:
    """Flux density (s, t, 3) (T) and temperature (s, t) (degrees Celsius) of patterns (s, t, 4).

    Readings of chips with `error` (s, t) are NaN.
    """
    if error is not None:
        patterns = np.where(error[..., None], _NAN, patterns)
    fields = patterns.view('<f4').astype(np.float64)
    return fields[..., 1:] / MICROTESLA_PER_TESLA, fields[..., 0]


def plausible(patterns: Words, quantum: Array | None = None) -> Bools:
    """Chips (s, t) whose readings, patterns (s, t, 4), can be.

    Finite, |B| < 150 mT, -40 < t < 125, 0 or at least 1e-6 uT, and on the grid of `quantum` (3,),
    the step of the chips' readings (T), where given. Patterns are compared as integers, which
    order as the numbers and are silent on NaN. Misaligned frames seldom pass: CR LF as the upper
    half of a float32 is 7e-33.
    """
    magnitude = patterns & _MAGNITUDE
    fits = (magnitude - _SMALLEST) < _SPAN
    fits |= magnitude == 0
    fits[..., 0] &= patterns[..., 0] < _COLDEST
    passed: Bools = np.logical_and.reduce(fits, axis=-1)
    if quantum is not None:
        fields = np.where(passed[..., None], patterns[..., 1:], np.uint32(0)).view('<f4')
        steps = fields / (quantum * MICROTESLA_PER_TESLA)
        passed &= (np.abs(steps - np.rint(steps)) <= GRID_TOLERANCE).all(axis=-1)
    return passed


def diagnose_stream(data: bytes, chips: int) -> str | None:
    """Sentence on what else a stream of no frames of `chips` chips is; None: not recognised."""
    if len(data) >= CHIP_BYTES and not data.translate(None, TEXT) and b'\n' in data:
        kind = 'ReSkin firmware, x y z t with tabs'
        if b'\t' not in data:
            kind = (
                'AnySkin firmware, t,x,y,z without a separator between chips, so that the numbers '
                'fuse and cannot be separated'
            )
        return f'the board prints text ({kind}): load its binary stream firmware'
    other = board_size(data)
    if other not in (None, chips):
        return f'the stream has frames of {other} chips, not of {chips}: give {other} `positions`'
    if other is None and board_size(data, temperatures=False) == chips:
        return 'every chip sends a temperature that none can have: mend its firmware, or send 0'
    return None


def board_size(data: bytes, *, temperatures: bool = True) -> int | None:
    """Count of chips whose frames fill `data`; None when no count fits three frames in a row."""
    stream = np.frombuffer(data, np.uint8)
    ends = _after_terminators(stream)
    for chips in range(1, MOST_CHIPS + 1):
        size = frame_bytes(chips)
        if len(ends) <= 3 * size:
            break
        runs = ends[: -2 * size] & ends[size:-size] & ends[2 * size :]
        for end in np.flatnonzero(runs[size:])[:8] + size:
            rows = stream[end - size : end + 2 * size].reshape(3, size)
            if plausible(words(rows) * np.array([temperatures, 1, 1, 1], np.uint32)).all():
                return chips
    return None


def _after_terminators(stream: Bytes, room: int = 0) -> Bools:
    """Mask of the places directly after a CR LF, to the end and `room` places on."""
    after = np.zeros(len(stream) + 1 + room, bool)
    after[2 : len(stream) + 1] = (stream[:-1] == TERMINATOR[0]) & (stream[1:] == TERMINATOR[1])
    return after


class _Start(NamedTuple):
    """Place where frames go on, and what has to be tolerated in them."""

    needed: int  # bytes of the stream that it takes to see it
    offset: int  # first byte of the first frame to deliver
    faulty: Bools | None = None  # (t,) chips that are implausible in frames that are good else


class _Windows:
    """Windows of a frame's length that end in CR LF: the evidence for where frames begin.

    Evidence is also plausible fields, and a start verified by the CR LF before it or by being one
    of the offsets `verified`. Chips that are `faulty` (t,) always pass. Starts are taken in the
    order in which the bytes show them, so that the outcome does not depend on how the bytes were
    cut.
    """

    def __init__(
        self, stream: bytes, verified: list[int], faulty: Bools, quantum: Array | None
    ) -> None:
        self._size = size = frame_bytes(len(faulty))
        data = np.frombuffer(stream, np.uint8)
        # room for two frames after the last window
        self._led = _after_terminators(data, LOCK_FRAMES * size)
        ends = np.flatnonzero(self._led[size : len(data) + 1])
        windows = data[ends[:, None] + np.arange(size)]
        binary = ~_IS_TEXT[windows].all(axis=1)
        self._offsets = ends[binary]
        self._passed = plausible(words(windows[binary]), quantum) | faulty  # (w, t)
        self._led[verified] = True

    def start(self, length: int, synchronised: bool) -> _Start | None:
        """Earliest start that `length` bytes show, or None; `synchronised`: one is enough."""
        if not len(self._offsets):
            return None
        starts = self._resume() if synchronised else self._lock_on()
        earliest = int(self._offsets[0]) + PATIENCE * self._size  # that lost chips may be seen
        if not any(start.needed < earliest for start in starts):
            starts += self._lock_on_others()
        seen = [start for start in starts if start.needed <= length]
        return min(seen, key=lambda start: start[:2]) if seen else None

    def _lock_on(self) -> list[_Start]:
        """Three good frames in a row; start at the first, shortly before, that is verified."""
        size, offsets = self._size, self._offsets
        fits = np.zeros(len(self._led), bool)
        fits[offsets] = self._passed.all(axis=1)
        run = offsets[fits[offsets] & fits[offsets + size] & fits[offsets + 2 * size]]
        if not len(run):
            return []
        needed = int(run[0]) + LOCK_FRAMES * size
        verified = offsets[self._led[offsets] & fits[offsets]]
        return [_Start(needed, int(verified[verified >= needed - KEPT * size][0]))]

    def _resume(self) -> list[_Start]:
        """One good frame verified at both ends."""
        sure = self._offsets[self._led[self._offsets] & self._passed.all(axis=1)]
        return [_Start(q + self._size, q) for q in sure[:1].tolist()]

    def _lock_on_others(self) -> list[_Start]:
        """Three frames in which the same few chips are implausible."""
        size, offsets = self._size, self._offsets
        index = np.full(len(self._led), -1)
        index[offsets] = np.arange(len(offsets))
        run = np.stack([index[offsets], index[offsets + size], index[offsets + 2 * size]])
        run = run[:, (run >= 0).all(axis=0)]
        bad = ~self._passed[run]
        faulty = bad.all(axis=0)
        steady = (bad.any(axis=0) == faulty).all(axis=1)
        few = 2 * faulty.sum(axis=1) < faulty.shape[1]
        for k in np.flatnonzero(steady & few)[:1].tolist():
            q = int(offsets[run[0, k]])
            return [_Start(q + PATIENCE * size, q if self._led[q] else q + size, faulty[k])]
        return []


@dataclass
class ReskinCounts:
    """Counts of a decoder since it was made."""

    frames: int = 0  # delivered
    dropped: int = 0  # known lost: bytes skipped since the last good frame over a frame's length
    lost_bytes: int = 0  # skipped, those before the first frame included
    framing_errors: int = 0  # frames that broke length or period
    implausible: int = 0  # frames that broke plausibility alone


class Decoded(NamedTuple):
    """Frames of one `feed`, in order."""

    values: Array  # flux density (s, t, 3) (T), NaN where `error`
    temperature_c: Array  # of the chips (s, t) (degrees Celsius), NaN where `error`
    error: Bools  # chips (s, t) that are faulty and implausible in this frame
    lost: list[int]  # frames known lost directly before each


class ReskinDecoder:
    """Bytes in, frames of 1 to 64 chips out; the same frames however the bytes are cut.

    `quantum` (3,) is the step of the chips' readings (T), where it is exact: it detects most
    flipped bits. A frame with an implausible chip is not delivered, since the damage may extend
    further. A chip that is implausible in three frames in a row, while most others are not, is
    faulty: those and all later frames are delivered, with NaN and `error` wherever it is
    implausible.
    """

    def __init__(self, chips: int, quantum: npt.ArrayLike | None = None) -> None:
        self.chips = chips
        self.content = f'{chips} chips'
        self.size = frame_bytes(chips)
        self.counts = ReskinCounts()
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
        self._faulty = np.zeros(self.chips, bool)

    @property
    def locked(self) -> bool:
        """True while the next frame follows the last one."""
        return self._locked

    @property
    def pending(self) -> bytes:
        """Bytes held back: the head of a frame, or bytes in which no frame was found."""
        return self._buffer

    def feed(self, data: bytes) -> Decoded:
        """Take the next bytes of the stream, cut anywhere; the frames that ended in them."""
        parts: list[Decoded] = []
        for i in range(0, len(data), SLICE_BYTES):
            self._buffer += data[i : i + SLICE_BYTES]
            while len(self._buffer) >= self.size and (self._locked or self._search()):
                self._take(parts)
                if self._locked:
                    break
        if len(parts) == 1:
            return parts[0]
        empty = np.empty((0, self.chips, 4))
        parts.insert(0, Decoded(empty[..., 1:], empty[..., 0], empty[..., 0] > 0, []))
        *arrays, lost = zip(*parts, strict=True)
        values, temperature_c, error = map(np.concatenate, arrays)
        return Decoded(values, temperature_c, error, [gap for gaps in lost for gap in gaps])

    def _take(self, parts: list[Decoded]) -> None:
        """Deliver frames from the head of the buffer up to the first bad one."""
        size = self.size
        whole = len(self._buffer) // size
        ended = 0
        while ended < whole and self._buffer.startswith(TERMINATOR, (ended + 1) * size - 2):
            ended += 1
        good = 0
        if ended:
            rows = np.frombuffer(self._buffer, np.uint8, ended * size).reshape(ended, size)
            good = self._deliver(rows, parts)
        self._buffer = self._buffer[good * size :]
        if good < whole:
            self._locked = False
            self._verified_start = True
            self._fault = 'framing' if good == ended else 'implausible'

    def _deliver(self, rows: Bytes, parts: list[Decoded]) -> int:
        """Decode the rows before the first implausible one; return their count."""
        patterns = words(rows)
        fits = plausible(patterns, self._quantum)
        error = None
        if not fits.all():
            good = int(np.append((fits | self._faulty).all(axis=1), False).argmin())
            if not good:
                return 0
            patterns, error = patterns[:good], ~fits[:good]
        count = len(patterns)
        lost = 0
        if self._skipped and self._synchronised:
            lost = max(1, round(self._skipped / self.size))
        self._synchronised, self._skipped = True, 0
        self.counts.frames += count
        self.counts.dropped += lost
        values, temperature_c = readings(patterns, error)
        if error is None:
            error = np.zeros((count, self.chips), bool)
        parts.append(Decoded(values, temperature_c, error, [lost] + [0] * (count - 1)))
        return count

    def _search(self) -> bool:
        """Cut the buffer at the next start of a frame, or to what may still become one."""
        first = KEPT * self.size  # what they show, the rest cannot change
        start = self._start(self._buffer[:first])
        if start is None and len(self._buffer) > first:
            start = self._start(self._buffer)
        if start is None:
            self._skip(len(self._buffer) - first - len(TERMINATOR))
            return False
        if start.faulty is not None:
            self._faulty |= start.faulty
        self._skip(start.offset)
        self._locked = True
        return True

    def _start(self, stream: bytes) -> _Start | None:
        windows = _Windows(stream, self._verified(), self._faulty, self._quantum)
        return windows.start(len(stream), self._synchronised)

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
        end = self._buffer[self.size - 2 : self.size]
        one_byte = end[:1] == TERMINATOR[:1] or end[1:] == TERMINATOR[1:]
        return [0, self.size] if one_byte else [0]
