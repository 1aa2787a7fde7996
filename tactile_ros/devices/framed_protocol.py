"""Our framed serial protocol: sync, kind, length, sequence, device time, payload, CRC-32.

docs/serial_protocol.md describes the bytes. `encode` writes frames, `FramedDecoder` finds them in
a stream and counts what else is in it. A decoder waits for one payload, so the first eight bytes
of its frames are given and no damaged length makes it wait.
"""

from __future__ import annotations

import struct
import zlib
from collections import deque
from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property, lru_cache
from typing import NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

from tactile_ros.types import Array, Bytes, Integers, TaxelStatus

TAXEL_BITS = 10
MOST_BYTES = 4096
GRADIOMETER_CHANNELS = 8


class Kind(IntEnum):
    """Numbers of the payloads on the wire."""

    GRADIOMETER = 1
    TAXELS = 2
    WIRES = 3
    CHIPS = 4


@dataclass(frozen=True)
class Payload:
    """One kind of readings: how many, and which bytes they are.

    Attributes
    ----------
    kind : Kind
        Its number on the wire.
    count : int
        Pixels, taxels or chips (t).
    channels : int
        Counts of each (c).
    full_count : int
        Magnitude at which the converter clips.
    """

    kind: Kind
    count: int
    channels: int
    full_count: int

    def __post_init__(self) -> None:
        """Refuse what no frame can hold."""
        if self.count < 1 or self.size > MOST_BYTES:
            msg = (
                f'count of a payload must be at least 1 and fill at most {MOST_BYTES} bytes; '
                f'received {self.count}'
            )
            raise ValueError(msg)
        most = {Kind.TAXELS: 2**TAXEL_BITS - 1, Kind.WIRES: 0xFFFF}.get(self.kind, 0x7FFF)
        if not 1 <= self.full_count <= most:
            msg = f'full_count must be 1 to {most}; received {self.full_count}'
            raise ValueError(msg)

    @property
    def signed(self) -> bool:
        """Whether counts may be negative."""
        return self.kind in (Kind.GRADIOMETER, Kind.CHIPS)

    @property
    def size(self) -> int:
        """Length (bytes)."""
        return self.dtype.itemsize

    @cached_property
    def dtype(self) -> np.dtype[np.void]:
        """The fields as they lie on the wire, without gaps."""
        if self.kind == Kind.TAXELS:
            return np.dtype([('packed', 'u1', (-(-self.count // 4) * 5,))])
        if self.kind == Kind.WIRES:
            return np.dtype([('counts', '<u2', (self.count, self.channels))])
        if self.kind == Kind.CHIPS:
            states = -(-self.count // 4)
            return np.dtype([('chips', '<i2', (self.count, 4)), ('states', 'u1', (states,))])
        shape = (self.count, self.channels)
        return np.dtype([('counts', '<i2', shape), ('temperature', '<i2')])

    def __str__(self) -> str:
        """As sentences name it."""
        return describe(self.kind, self.count, self.size)


def describe(kind: int, count: int, size: int) -> str:
    """Name of a payload in a sentence, known or not."""
    name = Kind(kind).name.lower() if kind in Kind.__members__.values() else 'unknown'
    return f'{name} (kind {kind}) of {count} in {size} bytes'


def gradiometer(full_count: int = 0x7FFF) -> Payload:
    """Payload of four pixels (Bx, Bz) and one chip temperature; int16 counts."""
    return Payload(Kind.GRADIOMETER, GRADIOMETER_CHANNELS // 2, 2, full_count)


def taxel_matrix(count: int, full_count: int = 2**TAXEL_BITS - 1) -> Payload:
    """Payload of `count` taxels, 10 bit counts packed."""
    return Payload(Kind.TAXELS, count, 1, full_count)


def five_wires(full_count: int = 0xFFFF, channels: int = 3) -> Payload:
    """Payload of u_AC, u_BD and the divider, uint16 counts of a converter that ends at that.

    A fourth channel is the foil's potential under a third excitation.
    """
    return Payload(Kind.WIRES, 1, channels, full_count)


def three_axis_chips(count: int, full_count: int = 0x7FFF) -> Payload:
    """Payload of `count` chips: temperature, x, y, z, and whether the reading is new."""
    return Payload(Kind.CHIPS, count, 3, full_count)


NO_TEMPERATURE = -32768
DEGREES_PER_COUNT = 0.01

_SHIFTS = np.array([0, 2, 4, 6], np.uint8)
_STATES = np.array([0, TaxelStatus.STALE, TaxelStatus.ERROR, TaxelStatus.ERROR], np.uint8)
_FAILED = 2


class Readings(NamedTuple):
    """Counts of frames.

    Attributes
    ----------
    counts : ndarray, shape (s, t, c)
        Integers as float64; NaN for chips that did not answer.
    temperature_c : ndarray, shape (s, t), or None
        Chip temperature (degrees Celsius), NaN where not measured; None: none in this payload.
    status : ndarray, shape (s, t)
        Bits of `TaxelStatus`: SATURATED at the converter's own limit, STALE and ERROR as the board
        says.
    """

    counts: Array
    temperature_c: Array | None
    status: Bytes


def unpack(payload: Payload, body: npt.NDArray[np.void]) -> Readings:
    """Take counts out of payloads.

    Parameters
    ----------
    payload : Payload
        Kind and count.
    body : ndarray of `payload.dtype`, shape (s,)
        The bytes.

    Returns
    -------
    Readings
        s frames.
    """
    if payload.kind == Kind.CHIPS:
        return _chips(payload, body)
    if payload.kind == Kind.TAXELS:
        counts = unpack_bits(body['packed'], payload.count).astype(np.float64)[..., None]
    else:
        counts = body['counts'].astype(np.float64)
    temperature_c = None
    if payload.kind == Kind.GRADIOMETER:
        one = _degrees(body['temperature'].astype(np.float64))
        temperature_c = np.repeat(one[:, None], payload.count, axis=1)
    return Readings(counts, temperature_c, _saturated(payload, counts))


def _chips(payload: Payload, body: npt.NDArray[np.void]) -> Readings:
    """Temperature, field and state of every chip."""
    chips = body['chips'].astype(np.float64)
    counts, temperature_c = chips[..., 1:], _degrees(chips[..., 0])
    status = _saturated(payload, counts)
    packed = body['states']
    if np.count_nonzero(packed):
        states = (packed[..., None] >> _SHIFTS & 3).reshape(len(packed), 4 * packed.shape[1])
        states = states[:, : payload.count]
        failed = states >= _FAILED
        counts[failed] = np.nan
        temperature_c[failed] = np.nan
        status = np.where(failed, _STATES[_FAILED], status | _STATES[states])
    return Readings(counts, temperature_c, status)


def _saturated(payload: Payload, counts: Array) -> Bytes:
    """SATURATED where a channel is at the converter's limit."""
    clipped = np.abs(counts) >= payload.full_count
    if not np.count_nonzero(clipped):
        return np.zeros(counts.shape[:2], np.uint8)
    status: Bytes = np.where(clipped.any(axis=-1), np.uint8(TaxelStatus.SATURATED), np.uint8(0))
    return status


def _degrees(counts: Array) -> Array:
    """Hundredths of a degree as degrees; NaN where none was measured."""
    degrees = counts * DEGREES_PER_COUNT
    missing = counts == NO_TEMPERATURE
    if np.count_nonzero(missing):
        degrees[missing] = np.nan
    return degrees


def unpack_bits(packed: Bytes, count: int) -> npt.NDArray[np.uint16]:
    """10 bit counts, lowest bit first: count i is bits 10 i to 10 i + 9 of the byte string.

    Parameters
    ----------
    packed : ndarray, shape (s, 5 n)
        Four counts in five bytes each.
    count : int
        Counts to take (t), at most 4 n.

    Returns
    -------
    ndarray, shape (s, t)
        Counts.
    """
    samples, groups = len(packed), packed.shape[1] // 5
    five = packed.reshape(samples, groups, 5).astype(np.uint16)
    counts = np.empty((samples, groups, 4), np.uint16)
    for i in range(4):
        counts[..., i] = (five[..., i] >> 2 * i) | (five[..., i + 1] << 8 - 2 * i)
    counts &= 2**TAXEL_BITS - 1
    return counts.reshape(samples, 4 * groups)[:, :count]


def pack_bits(counts: npt.NDArray[np.uint16]) -> Bytes:
    """Inverse of `unpack_bits`: counts (s, t) to bytes (s, 5 n), the last group filled with 0."""
    groups = -(-counts.shape[1] // 4)
    four = np.zeros((len(counts), groups * 4), np.uint16)
    four[:, : counts.shape[1]] = counts & 2**TAXEL_BITS - 1
    four = four.reshape(len(counts), groups, 4)
    five = np.zeros((len(counts), groups, 5), np.uint16)
    for i in range(4):
        five[..., i] |= four[..., i] << 2 * i
        five[..., i + 1] |= four[..., i] >> 8 - 2 * i
    return five.astype(np.uint8).reshape(len(counts), 5 * groups)


def pack(
    payload: Payload,
    counts: Integers,
    temperature_c: npt.ArrayLike = np.nan,
    states: npt.ArrayLike = 0,
) -> npt.NDArray[np.void]:
    """Write counts as a board does; what a kind does not carry is left out.

    Parameters
    ----------
    payload : Payload
        Kind and count.
    counts : ndarray of int, shape (s, t, c)
        Clipped to what the converter can give.
    temperature_c : array_like, broadcast to (s, t)
        Chip temperature (degrees Celsius); NaN: not measured.
    states : array_like of int, broadcast to (s, t)
        Of chips: 0 new reading, 1 the same reading as before, 2 no answer.

    Returns
    -------
    ndarray of `payload.dtype`, shape (s,)
        Payloads.
    """
    samples = len(counts)
    low = -payload.full_count if payload.signed else 0
    clipped = np.clip(counts, low, payload.full_count)
    degrees = np.broadcast_to(np.asarray(temperature_c, np.float64), (samples, payload.count))
    hundredths = np.where(np.isnan(degrees), NO_TEMPERATURE, np.rint(degrees * 100))
    body = np.zeros(samples, payload.dtype)
    if payload.kind == Kind.TAXELS:
        body['packed'] = pack_bits(clipped[..., 0].astype(np.uint16))
    elif payload.kind == Kind.CHIPS:
        body['chips'][..., 0] = hundredths
        body['chips'][..., 1:] = clipped
        body['states'] = _pack_states(np.broadcast_to(states, (samples, payload.count)))
    else:
        body['counts'] = clipped
        if payload.kind == Kind.GRADIOMETER:
            body['temperature'] = hundredths[:, 0]
    return body


def _pack_states(states: npt.NDArray[np.int64]) -> Bytes:
    """Two bits a chip, four chips a byte, the first in the lowest bits."""
    groups = -(-states.shape[1] // 4)
    four = np.zeros((len(states), groups * 4), np.uint8)
    four[:, : states.shape[1]] = states
    packed: Bytes = (four.reshape(len(states), groups, 4) << _SHIFTS).sum(axis=-1, dtype=np.uint8)
    return packed


SYNC = b'\xa5\x5a'
VERSION = 1
HEADER_BYTES = 16
TRAILER_BYTES = 4
SEQUENCES = 2**32
# CRC-32 of any bytes followed by their own CRC-32, lowest byte first
RESIDUE = 0x2144DF1C
HEAD = struct.Struct('<2sBBHH')


def frame_bytes(payload: Payload) -> int:
    """Length of a whole frame."""
    return HEADER_BYTES + payload.size + TRAILER_BYTES


def head(payload: Payload, version: int = VERSION) -> bytes:
    """First eight bytes of a frame: sync, version, kind, count, length."""
    return HEAD.pack(SYNC, version, payload.kind, payload.count, payload.size)


@lru_cache(maxsize=32)
def record(payload: Payload) -> np.dtype[np.void]:
    """A frame's fields as they lie on the wire."""
    return np.dtype(
        [
            ('head', 'u1', (HEAD.size,)),
            ('sequence', '<u4'),
            ('time_us', '<u4'),
            ('body', payload.dtype),
            ('crc', '<u4'),
        ]
    )


def encode(
    payload: Payload,
    counts: npt.ArrayLike,
    sequence: int,
    time_us: npt.ArrayLike,
    temperature_c: npt.ArrayLike = np.nan,
    states: npt.ArrayLike = 0,
) -> bytes:
    """Write frames as a board does.

    Parameters
    ----------
    payload : Payload
        Kind and count.
    counts : array_like of int, shape (t, c) or (s, t, c)
        Counts of the converter.
    sequence : int
        Of the first frame.
    time_us : array_like of int, broadcast to (s,)
        The board's clock (microseconds); both wrap at 2^32.
    temperature_c, states : array_like
        As in `pack`.

    Returns
    -------
    bytes
        s frames, one after the other.

    Raises
    ------
    ValueError
        If the shape is neither.
    """
    table = np.asarray(counts, np.int64)
    if table.ndim not in (2, 3) or table.shape[-2:] != (payload.count, payload.channels):
        want = f'({payload.count}, {payload.channels})'
        msg = f'counts of encode must have shape {want} or (s, {want[1:]}; received {table.shape}'
        raise ValueError(msg)
    table = table.reshape(-1, *table.shape[-2:])
    rows = np.zeros(len(table), record(payload))
    rows['head'] = np.frombuffer(head(payload), np.uint8)
    rows['sequence'] = (sequence + np.arange(len(table))) % SEQUENCES
    rows['time_us'] = np.asarray(time_us, np.int64) % SEQUENCES
    rows['body'] = pack(payload, table, temperature_c, states)
    size = rows.itemsize
    data = bytearray(rows.tobytes())
    for start in range(0, len(data), size):
        end = start + size - TRAILER_BYTES
        struct.pack_into('<I', data, end, zlib.crc32(data[start:end]))
    return bytes(data)


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
