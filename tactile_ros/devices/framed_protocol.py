# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Our framed serial protocol: sync, kind, length, sequence, device time, payload, CRC-32.

docs/serial_protocol.md describes the bytes. A decoder waits for one payload, so the first eight
bytes of its frames are given and no damaged length makes it wait.
"""

from __future__ import annotations

import struct
import zlib
from collections import deque
from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from tactile_ros.types import Array, Bytes, TaxelStatus

SYNC = b'\xa5\x5a'
VERSION = 1
HEADER_BYTES = 16
TRAILER_BYTES = 4
MOST_BYTES = 4096
SEQUENCES = 2**32
HEAD = struct.Struct('<2sBBHH')  # sync, version, kind, count, length of the payload
# CRC-32 of any bytes followed by their own CRC-32, lowest byte first
RESIDUE = 0x2144DF1C

TAXEL_BITS = 10
GRADIOMETER_PIXELS = 4
NO_TEMPERATURE = -32768
DEGREES_PER_COUNT = 0.01

MOST_LOST = 1_000_000  # a longer gap is a board that started anew
REMEMBERED = 64  # frames that are recognised when they come once more

_STATE_SHIFTS = np.array([0, 2, 4, 6], np.uint8)
_STATE_BITS = np.array([0, TaxelStatus.STALE, TaxelStatus.ERROR, TaxelStatus.ERROR], np.uint8)
_FAILED = 2


class Kind(IntEnum):
    """Numbers of the payloads on the wire."""

    GRADIOMETER = 1
    TAXELS = 2
    WIRES = 3
    CHIPS = 4


@dataclass(frozen=True)
class Payload:
    """One kind of readings, as integer counts.

    `kind` is its number on the wire; pixels, taxels or chips are its `count` (t), counts of each
    its `channels` (c); at `full_count` the converter clips.
    """

    kind: Kind
    count: int
    channels: int
    full_count: int

    def __post_init__(self) -> None:
        """Refuse what no frame can hold."""
        most = {Kind.TAXELS: 2**TAXEL_BITS - 1, Kind.WIRES: 0xFFFF}.get(self.kind, 0x7FFF)
        msg = f'full_count must be 1 to {most}; received {self.full_count}'
        if self.count < 1 or self.size > MOST_BYTES:
            msg = (
                f'count of a payload must be at least 1 and fill at most {MOST_BYTES} bytes; '
                f'received {self.count}'
            )
        elif 1 <= self.full_count <= most:
            return
        raise ValueError(msg)

    @property
    def one_converter(self) -> bool:
        """True where one converter reads all taxels in turn; its counts are never negative."""
        return self.kind in (Kind.TAXELS, Kind.WIRES)

    @property
    def size(self) -> int:
        """Length (bytes)."""
        return self.frame['body'].itemsize

    @cached_property
    def frame(self) -> np.dtype[np.void]:
        """A whole frame's fields as they lie on the wire, without gaps."""
        groups_of_four = -(-self.count // 4)
        shape = (self.count, self.channels)
        body: dict[Kind, list[tuple[str, str, tuple[int, ...]]]] = {
            Kind.GRADIOMETER: [('counts', '<i2', shape), ('temperature', '<i2', ())],
            Kind.TAXELS: [('packed', 'u1', (groups_of_four * 5,))],
            Kind.WIRES: [('counts', '<u2', shape)],
            Kind.CHIPS: [('chips', '<i2', (self.count, 4)), ('states', 'u1', (groups_of_four,))],
        }
        head = [('head', 'u1', (HEAD.size,)), ('sequence', '<u4'), ('time_us', '<u4')]
        return np.dtype([*head, ('body', body[self.kind]), ('crc', '<u4')])

    @property
    def head(self) -> bytes:
        """First eight bytes of a frame."""
        return HEAD.pack(SYNC, VERSION, self.kind, self.count, self.size)

    def __str__(self) -> str:
        """As sentences name it."""
        return _describe(self.kind, self.count, self.size)


def _describe(kind: int, count: int, size: int) -> str:
    name = Kind(kind).name.lower() if kind in Kind.__members__.values() else 'unknown'
    return f'{name} (kind {kind}) of {count} in {size} bytes'


def gradiometer() -> Payload:
    """Payload of four pixels (Bx, Bz) and one chip temperature; int16 counts."""
    return Payload(Kind.GRADIOMETER, GRADIOMETER_PIXELS, 2, 0x7FFF)


def taxel_matrix(count: int, full_count: int = 2**TAXEL_BITS - 1) -> Payload:
    """Payload of `count` taxels, 10 bit counts packed."""
    return Payload(Kind.TAXELS, count, 1, full_count)


def five_wires(full_count: int = 0xFFFF, channels: int = 3) -> Payload:
    """Payload of u_AC, u_BD and the divider, uint16 counts of a converter that ends at that.

    A fourth channel is the foil's potential under a third excitation.
    """
    return Payload(Kind.WIRES, 1, channels, full_count)


def three_axis_chips(count: int) -> Payload:
    """Payload of `count` chips: temperature, x, y, z, and the state of the reading."""
    return Payload(Kind.CHIPS, count, 3, 0x7FFF)


def frame_bytes(payload: Payload) -> int:
    """Length of a whole frame."""
    return HEADER_BYTES + payload.size + TRAILER_BYTES


def encode(
    payload: Payload, counts: npt.ArrayLike, sequence: int, time_us: npt.ArrayLike,
    temperature_c: npt.ArrayLike = np.nan, states: npt.ArrayLike = 0,
) -> bytes:  # fmt: skip
    """Write frames as a board does; a ValueError refuses another shape.

    Parameters
    ----------
    counts : array_like of int, shape (t, c) or (s, t, c)
        Clipped to the converter's range.
    sequence, time_us : int, array_like of int, broadcast to (s,)
        Of the first frame; the board's clock (microseconds). Both wrap at 2^32.
    temperature_c, states : array_like, broadcast to (s, t)
        Of chips (degrees Celsius), NaN: not measured; 0 new reading, 1 the same as before, 2 none.
    """
    table = np.asarray(counts, np.int64)
    if table.ndim not in (2, 3) or table.shape[-2:] != (payload.count, payload.channels):
        want = f'({payload.count}, {payload.channels})'
        msg = f'counts of encode must have shape {want} or (s, {want[1:]}; received {table.shape}'
        raise ValueError(msg)
    table = table.reshape(-1, *table.shape[-2:])
    table = np.clip(table, 0 if payload.one_converter else -payload.full_count, payload.full_count)
    shape = table.shape[:2]
    degrees = np.broadcast_to(np.asarray(temperature_c, np.float64), shape)
    temperature = np.where(np.isnan(degrees), NO_TEMPERATURE, np.rint(degrees * 100))
    rows = np.zeros(len(table), payload.frame)
    rows['head'] = np.frombuffer(payload.head, np.uint8)
    rows['sequence'] = (sequence + np.arange(len(table))) % SEQUENCES
    rows['time_us'] = np.asarray(time_us, np.int64) % SEQUENCES
    body = rows['body']
    if payload.kind == Kind.TAXELS:
        body['packed'] = pack_bits(table[..., 0].astype(np.uint16))
    elif payload.kind == Kind.CHIPS:
        body['chips'][..., 0] = temperature
        body['chips'][..., 1:] = table
        fours = _groups_of_four(np.broadcast_to(states, shape)).astype(np.uint8)
        body['states'] = (fours << _STATE_SHIFTS).sum(axis=-1, dtype=np.uint8)
    else:
        body['counts'] = table
        if payload.kind == Kind.GRADIOMETER:
            body['temperature'] = temperature[:, 0]
    data = bytearray(rows.tobytes())
    for start in range(0, len(data), rows.itemsize):
        end = start + rows.itemsize - TRAILER_BYTES
        struct.pack_into('<I', data, end, zlib.crc32(data[start:end]))
    return bytes(data)


def _groups_of_four(table: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    """Columns (s, t) in groups (s, g, 4), the last one filled with 0."""
    groups = -(-table.shape[1] // 4)
    padded = np.pad(table, ((0, 0), (0, 4 * groups - table.shape[1])))
    return padded.reshape(len(table), groups, 4)


def pack_bits(counts: npt.NDArray[np.uint16]) -> Bytes:
    """Counts (s, t) as bytes (s, 5 n), the last group filled with 0."""
    four = _groups_of_four(counts.astype(np.int64))
    bits = four[..., None] >> np.arange(TAXEL_BITS) & 1
    return np.packbits(bits.reshape(len(counts), -1).astype(bool), axis=1, bitorder='little')


def unpack_bits(packed: Bytes, count: int) -> npt.NDArray[np.uint16]:
    """First `count` 10 bit counts (s, t) of bytes (s, 5 n), lowest bit first."""
    samples, groups = len(packed), packed.shape[1] // 5
    five = packed.reshape(samples, groups, 5).astype(np.uint16)
    shifts = np.arange(0, 8, 2, dtype=np.uint16)
    counts = (five[..., :4] >> shifts) | (five[..., 1:] << 8 - shifts)
    counts &= 2**TAXEL_BITS - 1
    return counts.reshape(samples, 4 * groups)[:, :count]


class Decoded(NamedTuple):
    """Frames of one `feed`, in order.

    Attributes
    ----------
    counts : ndarray, shape (s, t, c)
        Integers as float64; NaN for chips that did not answer.
    temperature_c : ndarray, shape (s, t), or None
        Of the chips (degrees Celsius), NaN: not measured; None: none in this payload.
    status : ndarray, shape (s, t)
        SATURATED at the converter's own limit, STALE and ERROR as the board says.
    time_us, lost : list of int
        The board's clock (microseconds), which wraps at 2^32; frames known lost before each.
    """

    counts: Array
    temperature_c: Array | None
    status: Bytes
    time_us: list[int]
    lost: list[int]


@dataclass
class FramedCounts:
    """Counts of a decoder since it was made."""

    frames: int = 0  # delivered
    dropped: int = 0  # lost by the board's own sequence, damaged ones too; one for a restart
    missing: int = 0  # those of `dropped` of which no byte came
    lost_bytes: int = 0  # outside of frames
    crc_errors: int = 0  # frames with a good head whose CRC failed
    framing_errors: int = 0  # runs of bytes between frames that hold no frame's head
    other_version: int = 0  # whole frames with a good CRC of another version, kind or length
    other_kind: int = 0
    other_length: int = 0
    repeated: int = 0  # came before, as the last or one of the 64 before it; not delivered
    restarts: int = 0  # of the sequence while the port stayed open


class FramedDecoder:
    """Bytes in, frames of `payload` out; the same frames however the bytes are cut.

    `foreign` is the foreign frame that came last since `reset`, in words; `foreign_frames` came
    since the last good frame. Every place where the head of `payload` stands is tried, also inside
    a frame whose CRC failed, so that damage costs no good frame; foreign frames are searched apart
    from that and never delay one.
    """

    def __init__(self, payload: Payload) -> None:
        self.payload = payload
        self.content = str(payload)
        self.size = frame_bytes(payload)
        self.counts = FramedCounts()
        self.foreign = ''
        self.foreign_frames = 0
        self._head = payload.head
        self._buffer = b''
        self._last: int | None = None
        self._recent: deque[bytes] = deque(maxlen=REMEMBERED)
        self._between = b''  # may still become a foreign frame
        self._noise = 0  # bytes since the last good frame
        self._crc_failed = False  # since the last good frame: that damage is counted already

    def reset(self) -> None:
        """Forget the stream, as after a reconnection; the counts stay."""
        self.counts.lost_bytes += self.pending
        self._buffer = self._between = b''
        self._last = None
        self._recent.clear()
        self.foreign, self.foreign_frames = '', 0
        self._noise, self._crc_failed = 0, False

    @property
    def synchronised(self) -> bool:
        """True once a frame came since the last `reset`."""
        return self._last is not None

    @property
    def pending(self) -> int:
        """Bytes that are held back."""
        return len(self._buffer) + len(self._between)

    def feed(self, data: bytes) -> Decoded:
        """Take the next bytes of the stream, cut anywhere; the frames that ended in them."""
        buffer = self._buffer + data if self._buffer else data
        view, size = memoryview(buffer), self.size
        places: list[int] = []
        lost: list[int] = []
        place = 0
        while place < len(buffer):
            start = buffer.find(self._head, place)
            if start != place:
                end = start if start >= 0 else self._end_without_head(buffer, place)
                self._skip(buffer[place:end])
                place = end
                if start < 0:
                    break
            if place + size > len(buffer):
                break
            if zlib.crc32(view[place : place + size]) == RESIDUE:
                gap = self._accept(view[place : place + size])
                if gap is not None:
                    places.append(place)
                    lost.append(gap)
                place += size
            else:
                self.counts.crc_errors += 1
                self._crc_failed = True
                self._skip(buffer[place : place + 1])
                place += 1
        self._buffer = buffer[place:]
        self.counts.frames += len(places)
        if places and places[-1] - places[0] == (len(places) - 1) * size:
            rows = np.frombuffer(buffer, self.payload.frame, len(places), places[0])
        else:
            good = b''.join(buffer[i : i + size] for i in places)
            rows = np.frombuffer(good, self.payload.frame)
        return self._decode(rows, lost)

    def _end_without_head(self, buffer: bytes, place: int) -> int:
        """End of bytes in which no head stands; the beginning of one at their end is kept."""
        most = min(len(self._head) - 1, len(buffer) - place)
        kept = (count for count in range(most, 0, -1) if buffer.endswith(self._head[:count]))
        return len(buffer) - next(kept, 0)

    def _accept(self, frame: memoryview) -> int | None:
        """Frames lost before a good frame, by its sequence; None for one that came before."""
        intact = self._end_gap()
        sequence = int.from_bytes(frame[8:12], 'little')
        signature = bytes(frame[8:16]) + bytes(frame[-TRAILER_BYTES:])
        gap = 0 if self._last is None else (sequence - self._last) % SEQUENCES - 1
        # a board that started anew may count the same, but not at the same time and with this CRC
        if gap < 0 or (gap > MOST_LOST and signature in self._recent):
            self.counts.repeated += 1
            return None
        self._last = sequence
        self._recent.append(signature)
        if gap > MOST_LOST:
            self.counts.restarts += 1
            gap = 1
        self.counts.dropped += gap
        self.counts.missing += gap if intact else 0
        return gap

    def _end_gap(self) -> bool:
        """Close the bytes between two good frames; whether none were lost in them."""
        self._lose(len(self._between))
        intact = not (self._noise or self._crc_failed)
        # before the first frame there may be the tail of one
        if self._noise and not self._crc_failed and self._last is not None:
            self.counts.framing_errors += 1
        self._between, self._noise, self._crc_failed, self.foreign_frames = b'', 0, False, 0
        return intact

    def _skip(self, data: bytes) -> None:
        """Count the next bytes that are in no frame of ours: foreign frames, or noise."""
        held = self._between + data
        place = 0
        while (start := held.find(SYNC, place)) >= 0:
            self._lose(start - place)
            place = start
            length = self._foreign_bytes(held, place)
            if length is None:
                self._between = held[place:]
                return
            if not length:
                self._lose(len(SYNC))
            place += length or len(SYNC)
        kept = len(held) - 1 if held.endswith(SYNC[:1]) and len(held) > place else len(held)
        self._lose(kept - place)
        self._between = held[kept:]

    def _lose(self, count: int) -> None:
        self._noise += count
        self.counts.lost_bytes += count

    def _foreign_bytes(self, held: bytes, place: int) -> int | None:
        """Length of the whole foreign frame at `place`; 0 if there is none, None if unknown."""
        if len(held) - place < HEAD.size:
            return None
        _, version, kind, count, size = HEAD.unpack_from(held, place)
        total: int = HEADER_BYTES + size + TRAILER_BYTES
        if held.startswith(self._head, place) or size > MOST_BYTES:
            return 0
        if len(held) - place < total:
            return None
        if zlib.crc32(memoryview(held)[place : place + total]) != RESIDUE:
            return 0
        other_version, other_kind = version != VERSION, kind != self.payload.kind
        self.counts.other_version += other_version
        self.counts.other_kind += other_kind and not other_version
        self.counts.other_length += not (other_version or other_kind)
        self.foreign_frames += 1
        self.foreign = f'version {version}, {_describe(kind, count, size)}'
        return total

    def _decode(self, rows: npt.NDArray[np.void], lost: list[int]) -> Decoded:
        payload, body = self.payload, rows['body']
        temperature_c = None
        if payload.kind == Kind.TAXELS:
            counts = unpack_bits(body['packed'], payload.count).astype(np.float64)[..., None]
        elif payload.kind == Kind.CHIPS:
            chips = body['chips'].astype(np.float64)
            counts, temperature_c = chips[..., 1:], _degrees(chips[..., 0])
        else:
            counts = body['counts'].astype(np.float64)
        if payload.kind == Kind.GRADIOMETER:
            temperature = _degrees(body['temperature'].astype(np.float64))
            temperature_c = np.repeat(temperature[:, None], payload.count, axis=1)
        status = np.zeros(counts.shape[:2], np.uint8)
        clipped = np.abs(counts) >= payload.full_count
        if np.count_nonzero(clipped):
            status[clipped.any(axis=-1)] = TaxelStatus.SATURATED
        if payload.kind == Kind.CHIPS and np.count_nonzero(body['states']):
            states = (body['states'][..., None] >> _STATE_SHIFTS & 3).reshape(len(rows), -1)
            states = states[:, : payload.count]
            failed = states >= _FAILED
            counts[failed] = np.nan
            temperature_c[failed] = np.nan  # type: ignore[index]
            status = np.where(failed, _STATE_BITS[_FAILED], status | _STATE_BITS[states])
        return Decoded(counts, temperature_c, status, rows['time_us'].tolist(), lost)


def _degrees(counts: Array) -> Array:
    """Hundredths of a degree as degrees; NaN where none was measured."""
    degrees = counts * DEGREES_PER_COUNT
    missing = counts == NO_TEMPERATURE
    if np.count_nonzero(missing):
        degrees[missing] = np.nan
    return degrees
