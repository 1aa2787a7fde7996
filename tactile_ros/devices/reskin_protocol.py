"""Wire format of the ReSkin / AnySkin board: N x float32 (t, x, y, z), little-endian, then CR LF.

The format has no header, checksum, counter or clock. A frame of N chips is 16 N + 2 bytes; t is in
degrees Celsius, x, y, z in microtesla.

To lock on takes three frames in a row; after damage one is enough, since its length is verified at
both ends. What cannot be seen: damage that keeps length, CR LF and plausibility, and whole frames
that never arrived (`damage` measures the share).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from tactile_ros.types import Array, Bools, Integers

Words = npt.NDArray[np.uint32]

TERMINATOR = b'\r\n'
CHIP_BYTES = 16
MICROTESLA_PER_TESLA = 1e6
FIELD_LIMIT_MICROTESLA = 150_000.0
TEMPERATURE_LIMITS_C = (-40.0, 125.0)
# a chip's step is 0.1 uT or more; smaller fields are 0 on the wire
SMALLEST_MICROTESLA = 1e-6
GRID_TOLERANCE = 0.01
MOST_CHIPS = 64

_MAGNITUDE = np.uint32(0x7FFFFFFF)
_NAN = np.uint32(0x7FC00000)
TEXT = b'0123456789+-.,\t\r\n eEnaifNAIF'


def _bits(value: float) -> np.uint32:
    """Pattern of a positive float32; patterns order as the numbers do."""
    return np.uint32(np.array(value, '<f4').view('<u4'))


_HIGHEST = np.array([_bits(TEMPERATURE_LIMITS_C[1]), *[_bits(FIELD_LIMIT_MICROTESLA)] * 3])
_COLDEST = np.uint32(_bits(-TEMPERATURE_LIMITS_C[0]) | np.uint32(0x80000000))
_SMALLEST = _bits(SMALLEST_MICROTESLA)
_SPAN = _HIGHEST - _SMALLEST


def frame_bytes(chips: int) -> int:
    """Length of a frame of `chips` chips, its CR LF included."""
    if not 1 <= chips <= MOST_CHIPS:
        msg = f'chips must be 1 to {MOST_CHIPS}; received {chips}'
        raise ValueError(msg)
    return CHIP_BYTES * chips + len(TERMINATOR)


def encode(values: npt.ArrayLike, temperature_c: npt.ArrayLike = 25.0) -> bytes:
    """Write frames as the board does.

    Parameters
    ----------
    values : array_like, shape (t, 3) or (s, t, 3)
        Flux density of every chip (T).
    temperature_c : array_like, broadcast to (s, t)
        Chip temperature (degrees Celsius).

    Returns
    -------
    bytes
        s frames, one after the other.

    Raises
    ------
    ValueError
        If the shape is neither.
    """
    table = np.asarray(values, np.float64)
    if table.ndim not in (2, 3) or table.shape[-1] != 3:
        msg = f'values of encode must have shape (t, 3) or (s, t, 3); received {table.shape}'
        raise ValueError(msg)
    table = table.reshape(-1, *table.shape[-2:])
    samples, chips = table.shape[:2]
    size = frame_bytes(chips)
    fields = np.empty((samples, chips, 4), '<f4')
    fields[..., 0] = temperature_c
    fields[..., 1:] = table * MICROTESLA_PER_TESLA
    fields[..., 1:][np.abs(fields[..., 1:]) < SMALLEST_MICROTESLA] = 0.0
    rows = np.empty((samples, size), np.uint8)
    rows[:, :-2] = fields.reshape(samples, -1).view(np.uint8)
    rows[:, -2:] = np.frombuffer(TERMINATOR, np.uint8)
    return rows.tobytes()


def words(rows: npt.NDArray[np.uint8]) -> Words:
    """Fields of frames as the 32-bit patterns they are sent as.

    Parameters
    ----------
    rows : ndarray, shape (s, 16 t + 2)
        Bytes of whole frames.

    Returns
    -------
    ndarray, shape (s, t, 4)
        Little-endian patterns of t, x, y, z.
    """
    samples, size = rows.shape
    payload = np.ascontiguousarray(rows[:, :-2])
    return payload.view('<u4').reshape(samples, size // CHIP_BYTES, 4)


def plausible(patterns: Words, quantum: Array | None = None) -> tuple[Bools, Bools]:
    """Tell which chips carry readings that a chip can give.

    Parameters
    ----------
    patterns : ndarray, shape (s, t, 4)
        From `words`.
    quantum : ndarray, shape (3,), or None
        Step of the chips' readings (T), where it is known: readings off that grid are damage.

    Returns
    -------
    possible : ndarray, shape (s, t)
        Finite, |B| < 150 mT, -40 < t < 125 (0 or at least 1e-6), and on the grid.
    natural : ndarray, shape (s, t)
        Possible, and no field is nonzero below 1 pT.

    Notes
    -----
    The patterns are compared as integers, which orders them as the numbers and is silent on NaN.
    Misaligned frames are seldom natural: CR LF as the upper half of a float32 is 7e-33, and a
    field with CR or LF as its highest byte (7e-33 .. 4e-31) is not possible either.
    """
    magnitude = patterns & _MAGNITUDE
    usual = (magnitude - _SMALLEST) < _SPAN
    usual[..., 0] &= patterns[..., 0] < _COLDEST
    natural = _every(usual)
    if quantum is None and natural.all():
        return natural, natural
    fits = magnitude < _HIGHEST
    fits[..., 0] &= patterns[..., 0] < _COLDEST
    usual |= magnitude == 0
    natural = _every(fits & usual)
    # no chip is that near to zero degrees
    fits[..., 0] &= usual[..., 0]
    highest = patterns >> np.uint32(24)
    fits &= (highest != TERMINATOR[0]) & (highest != TERMINATOR[1])
    possible = _every(fits)
    if quantum is not None:
        possible &= _on_grid(patterns, possible, quantum)
    return possible, possible & natural


def _every(fields: Bools) -> Bools:
    """Whether all fields of a chip are so."""
    chips: Bools = np.logical_and.reduce(fields, axis=-1)
    return chips


def _on_grid(patterns: Words, possible: Bools, quantum: Array) -> Bools:
    """Whether all three fields of a chip are multiples of its step."""
    known = np.where(possible[..., None], patterns[..., 1:], np.uint32(0))
    steps = known.view('<f4') / (quantum * MICROTESLA_PER_TESLA)
    return _every(np.abs(steps - np.rint(steps)) <= GRID_TOLERANCE)


def readings(patterns: Words, error: Bools | None = None) -> tuple[Array, Array]:
    """Patterns as numbers.

    Parameters
    ----------
    patterns : ndarray, shape (s, t, 4)
        From `words`.
    error : ndarray, shape (s, t), or None
        Chips whose readings are replaced by NaN.

    Returns
    -------
    values : ndarray, shape (s, t, 3)
        Flux density (T).
    temperature_c : ndarray, shape (s, t)
        Chip temperature (degrees Celsius).
    """
    if error is not None:
        patterns = np.where(error[..., None], _NAN, patterns)
    fields = patterns.view('<f4').astype(np.float64)
    return fields[..., 1:] / MICROTESLA_PER_TESLA, fields[..., 0]


def foreign(data: bytes, chips: int) -> str | None:
    """Say what else a stream is, when it holds no frames of `chips` chips.

    Parameters
    ----------
    data : bytes
        A few hundred bytes of the stream.
    chips : int
        Expected count of chips.

    Returns
    -------
    str or None
        One sentence; None when nothing is recognised.
    """
    if len(data) >= CHIP_BYTES and not data.translate(None, TEXT) and b'\n' in data:
        return _foreign_text(data)
    other = board_size(data)
    if other not in (None, chips):
        return f'the stream has frames of {other} chips, not of {chips}: set chips to {other}'
    return None


def _foreign_text(data: bytes) -> str:
    """Say which firmware prints this text and why it is not read."""
    if b'\t' in data:
        return (
            'the board prints text (ReSkin firmware, x y z t with tabs): '
            'load its binary stream firmware'
        )
    return (
        'the board prints text (AnySkin firmware, t,x,y,z without a separator between chips, '
        'so that the numbers fuse and cannot be told apart): load its binary stream firmware'
    )


def board_size(data: bytes) -> int | None:
    """Count of chips whose frames fill `data`; None when no count fits three frames in a row."""
    stream = np.frombuffer(data, np.uint8)
    if len(stream) < 2:
        return None
    ends = np.zeros(len(stream) + 1, bool)
    ends[2:] = (stream[:-1] == TERMINATOR[0]) & (stream[1:] == TERMINATOR[1])
    for chips in range(1, MOST_CHIPS + 1):
        size = frame_bytes(chips)
        if len(ends) <= 3 * size:
            break
        runs = ends[: -2 * size] & ends[size:-size] & ends[2 * size :]
        for end in np.flatnonzero(runs[size:])[:8] + size:
            rows = stream[end - size : end + 2 * size].reshape(3, size)
            if plausible(words(rows))[1].all():
                return chips
    return None


LOCK_FRAMES = 3
# frames after which a start with odd fields or lost chips is believed, if no better one came
PATIENCE = 4
# frames of bytes that are kept while none is found
KEPT = 8

_IS_TEXT = np.isin(np.arange(256), np.frombuffer(TEXT, np.uint8))


class Start(NamedTuple):
    """Where frames go on, and what has to be tolerated in them.

    Attributes
    ----------
    known_at : int
        Bytes that are needed to know it.
    offset : int
        First byte of the first frame to deliver.
    odd : bool
        Fields that are possible but not natural are part of this stream.
    faulty : ndarray, shape (t,), or None
        Chips that are implausible in frames that are otherwise good.
    """

    known_at: int
    offset: int
    odd: bool
    faulty: Bools | None


@dataclass(frozen=True)
class Evidence:
    """Windows of a frame's length that end in CR LF, with what is known about each.

    Attributes
    ----------
    size : int
        Length of a frame.
    offsets : ndarray, shape (w,)
        First byte of every window, increasing.
    led : ndarray, shape (n,)
        Whether a byte of the stream is verified to follow a frame's end; n leaves room for two
        frames after the last window.
    possible, natural : ndarray, shape (w, t)
        As from `plausible`, per chip; chips known to be faulty pass.
    """

    size: int
    offsets: Integers
    led: Bools
    possible: Bools
    natural: Bools

    def marks(self, passed: Bools) -> Bools:
        """Mask over the stream, shape (n,), of the windows all of whose chips (w, t) pass."""
        marks = np.zeros(len(self.led), bool)
        marks[self.offsets[passed.all(axis=1)]] = True
        return marks


def gather(stream: bytes, verified: list[int], faulty: Bools, quantum: Array | None) -> Evidence:
    """Collect the windows of a stream that end in CR LF.

    Parameters
    ----------
    stream : bytes
        What is at hand.
    verified : list of int
        Offsets known to follow a frame's end although no CR LF shows it.
    faulty : ndarray, shape (t,)
        Chips known to be faulty.
    quantum : ndarray, shape (3,), or None
        As for `plausible`.

    Returns
    -------
    Evidence
        Of windows that are not text.
    """
    size = frame_bytes(len(faulty))
    data = np.frombuffer(stream, np.uint8)
    led = np.zeros(len(data) + 1 + LOCK_FRAMES * size, bool)
    led[2 : len(data) + 1] = (data[:-1] == TERMINATOR[0]) & (data[1:] == TERMINATOR[1])
    offsets = np.flatnonzero(led[size : len(data) + 1])
    windows = data[offsets[:, None] + np.arange(size)]
    binary = ~_IS_TEXT[windows].all(axis=1)
    possible, natural = plausible(words(windows[binary]), quantum)
    led[verified] = True
    return Evidence(
        size, offsets[binary], led, np.logical_or(possible, faulty), np.logical_or(natural, faulty)
    )


def lock_on(seen: Evidence) -> list[Start]:
    """Three natural frames in a row; start at the first, shortly before, that is verified."""
    size, offsets = seen.size, seen.offsets
    fits = seen.marks(seen.natural)
    run = offsets[fits[offsets] & fits[offsets + size] & fits[offsets + 2 * size]]
    verified = offsets[seen.led[offsets] & fits[offsets]]
    for q in run[:1].tolist():
        known_at = q + LOCK_FRAMES * size
        return [Start(known_at, int(verified[verified >= known_at - KEPT * size][0]), False, None)]
    return []


def resume(seen: Evidence, odd_before: bool) -> list[Start]:
    """Start at one natural frame verified at both ends.

    Two in a row do with odd fields, where the stream had such before, or where it only begins to
    have them and is in step.
    """
    size, offsets = seen.size, seen.offsets
    sure = offsets[seen.led[offsets] & seen.natural.all(axis=1)]
    fits = seen.marks(seen.possible)
    odd = offsets[seen.led[offsets] & fits[offsets] & fits[offsets + size]]
    if not odd_before:
        odd = odd[odd == 0]
    return [
        *(Start(q + size, q, False, None) for q in sure[:1].tolist()),
        *(Start(q + 2 * size, q, True, None) for q in odd[:1].tolist()),
    ]


def lock_on_odd(seen: Evidence) -> list[Start]:
    """Start at three frames in which the same few chips are implausible, or fields are odd."""
    size, offsets = seen.size, seen.offsets
    at = np.full(len(seen.led), -1)
    at[offsets] = np.arange(len(offsets))
    run = np.stack([at[offsets], at[offsets + size], at[offsets + 2 * size]])
    run = run[:, (run >= 0).all(axis=0)]
    bad = ~seen.possible[run]
    faulty = bad.all(axis=0)
    steady = (bad.any(axis=0) == faulty).all(axis=1)
    few = 2 * faulty.sum(axis=1) < faulty.shape[1]
    for k in np.flatnonzero(steady & few)[:1].tolist():
        q = int(offsets[run[0, k]])
        odd = bool((~seen.natural[run[:, k]] & ~faulty[k]).any())
        return [Start(q + PATIENCE * size, q if seen.led[q] else q + size, odd, faulty[k])]
    return []


def next_start(seen: Evidence, length: int, synchronised: bool, odd_before: bool) -> Start | None:
    """Earliest start that `length` bytes make known; None when there is none yet.

    Parameters
    ----------
    seen : Evidence
        Of the stream.
    length : int
        Bytes at hand.
    synchronised : bool
        Whether frames were delivered before: one is enough then to go on.
    odd_before : bool
        Whether some of them had odd fields.
    """
    if not len(seen.offsets):
        return None
    starts = resume(seen, odd_before) if synchronised else lock_on(seen)
    earliest = int(seen.offsets[0]) + PATIENCE * seen.size  # that odd fields may be known
    if not any(start.known_at < earliest for start in starts):
        starts += lock_on_odd(seen)
    known = [start for start in starts if start.known_at <= length]
    return min(known, key=lambda start: start[:2]) if known else None


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


class ReskinDecoder:
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
