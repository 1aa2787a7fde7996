"""MCAP records: how a file of stamped messages is framed, chunked and indexed.

Notes
-----
MCAP file format specification, version 0: little-endian; every record is an opcode (1 byte), a
length (8 bytes) and the content; strings and maps carry a length of 4 bytes in front.
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass
from typing import TYPE_CHECKING

from tactile_ros.errors import RecordingError

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from mmap import mmap

MAGIC = b'\x89MCAP0\r\n'
HEADER, FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK = 1, 2, 3, 4, 5, 6
MESSAGE_INDEX, CHUNK_INDEX, STATISTICS, METADATA, METADATA_INDEX = 7, 8, 11, 12, 13
SUMMARY_OFFSET, DATA_END = 14, 15
LARGEST_CHUNK = 1 << 28  # bytes; a longer length is damage, not data
_FRONT = struct.Struct('<BQ')
_MESSAGE = struct.Struct('<HIQQ')
FRONT_BYTES = _FRONT.size
MESSAGE_FRONT = struct.Struct('<BQHIQQ')  # code and length of a record, then what _MESSAGE holds
_CHUNK = struct.Struct('<QQQI')


@dataclass(frozen=True)
class Schema:
    """A message type and its text."""

    number: int
    name: str
    encoding: str
    text: str


@dataclass(frozen=True)
class Channel:
    """A topic."""

    number: int
    schema: int
    topic: str
    encoding: str


@dataclass(frozen=True)
class ChunkEntry:
    """What the summary says about one chunk: times (ns), place and index."""

    start_ns: int
    end_ns: int
    offset: int
    length: int
    size: int
    indexes: dict[int, int]
    index_length: int


def record(code: int, content: bytes) -> bytes:
    """Frame one record."""
    return _FRONT.pack(code, len(content)) + content


def text(value: str) -> bytes:
    """A string with its length in front."""
    data = value.encode()
    return struct.pack('<I', len(data)) + data


def table(items: bytes) -> bytes:
    """Packed pairs with their length in bytes in front."""
    return struct.pack('<I', len(items)) + items


def string_map(values: Mapping[str, str]) -> bytes:
    """Pairs of strings."""
    return table(b''.join(text(key) + text(value) for key, value in values.items()))


def pairs(values: Mapping[int, int]) -> bytes:
    """Pairs of a channel number and a 64-bit number."""
    return table(b''.join(struct.pack('<HQ', *item) for item in values.items()))


def footer_record(summary: int, offsets: int) -> bytes:
    """Last record of a file: where its summary and the offsets of the summary start; 0: none."""
    return record(FOOTER, struct.pack('<QQI', summary, offsets, 0))


DATA_END_RECORD = record(DATA_END, struct.pack('<I', 0))
TAIL = DATA_END_RECORD + footer_record(0, 0) + MAGIC  # ends a file that has no summary yet


def header_record(library: str) -> bytes:
    """First record of a file with the ROS 2 profile."""
    return record(HEADER, text('ros2') + text(library))


def schema_record(schema: Schema) -> bytes:
    """Record of a message type."""
    body = text(schema.name) + text(schema.encoding) + text(schema.text)
    return record(SCHEMA, struct.pack('<H', schema.number) + body)


def channel_record(channel: Channel, metadata: Mapping[str, str]) -> bytes:
    """Record of a topic."""
    head = struct.pack('<HH', channel.number, channel.schema)
    return record(CHANNEL, head + text(channel.topic) + text('cdr') + string_map(metadata))


def message_record(channel: int, count: int, stamp_ns: int, data: bytes) -> bytes:
    """Record of one message, logged and published at one time (ns)."""
    body = _MESSAGE.pack(channel, count & 0xFFFFFFFF, stamp_ns, stamp_ns)
    return record(MESSAGE, body + data)


def chunk_record(start_ns: int, end_ns: int, records: bytes) -> bytes:
    """Record of an uncompressed chunk with its checksum."""
    head = _CHUNK.pack(start_ns, end_ns, len(records), zlib.crc32(records))
    return record(CHUNK, head + text('') + struct.pack('<Q', len(records)) + records)


def message_index_record(channel: int, entries: list[tuple[int, int]]) -> bytes:
    """Record of the stamps (ns) and places of one channel's messages in the chunk before it."""
    body = table(b''.join(struct.pack('<QQ', *entry) for entry in entries))
    return record(MESSAGE_INDEX, struct.pack('<H', channel) + body)


def chunk_index_record(entry: ChunkEntry) -> bytes:
    """Record of the summary about one chunk."""
    head = struct.pack('<QQQQ', entry.start_ns, entry.end_ns, entry.offset, entry.length)
    tail = struct.pack('<Q', entry.index_length) + text('')
    sizes = struct.pack('<QQ', entry.size, entry.size)
    return record(CHUNK_INDEX, head + pairs(entry.indexes) + tail + sizes)


def statistics_record(counts: Mapping[int, int], schemas: int, chunks: list[ChunkEntry]) -> bytes:
    """Record of the summary with the counts of messages."""
    start = min((chunk.start_ns for chunk in chunks), default=0)
    end = max((chunk.end_ns for chunk in chunks), default=0)
    numbers = (sum(counts.values()), schemas, len(counts), 0, 1, len(chunks), start, end)
    return record(STATISTICS, struct.pack('<QHIIIIQQ', *numbers) + pairs(counts))


class Cursor:
    """Reads fields of one record's content; a field beyond its end is a RecordingError."""

    def __init__(self, data: bytes) -> None:
        """Start at the first byte."""
        self.data = data
        self.at = 0

    def numbers(self, form: str) -> tuple[int, ...]:
        """Integers of a struct format."""
        return struct.unpack(form, self.take(struct.calcsize(form)))

    def take(self, count: int) -> bytes:
        """The next bytes."""
        if count > len(self.data) - self.at:
            msg = 'a field reaches beyond its record'
            raise RecordingError(msg)
        self.at += count
        return self.data[self.at - count : self.at]

    def text(self) -> str:
        """A string."""
        return self.take(self.numbers('<I')[0]).decode('utf-8', 'replace')


def read_schema(content: bytes) -> Schema:
    """Schema of a record's content."""
    cursor = Cursor(content)
    (number,) = cursor.numbers('<H')
    return Schema(number, cursor.text(), cursor.text(), cursor.text())


def read_channel(content: bytes) -> Channel:
    """Channel of a record's content."""
    cursor = Cursor(content)
    number, schema = cursor.numbers('<HH')
    return Channel(number, schema, cursor.text(), cursor.text())


def read_message(content: bytes) -> tuple[int, int, bytes]:
    """Channel, log time (ns) and data of a record's content."""
    if len(content) < _MESSAGE.size:
        msg = 'a message record is too short'
        raise RecordingError(msg)
    channel, _, stamp_ns, _ = _MESSAGE.unpack_from(content)
    return channel, stamp_ns, content[_MESSAGE.size :]


def walk(data: bytes | mmap, start: int = 0) -> Iterator[tuple[int, int, bytes, bool]]:
    """Records in a buffer: place, opcode, content, and whether the content is whole.

    A record cut by the end of the buffer comes last with what is left of it; damage (an unknown
    opcode) ends the walk with opcode 0.
    """
    at = start
    while at < len(data):
        if len(data) - at < _FRONT.size:
            yield at, 0, b'', False
            return
        code, length = _FRONT.unpack_from(data, at)
        body = at + _FRONT.size
        if not 0 < code <= DATA_END and code < 0x80:  # 0x80 and above are private records
            yield at, 0, b'', False
            return
        yield at, code, data[body : body + length], length <= len(data) - body
        if length > len(data) - body:
            return
        at = body + length
