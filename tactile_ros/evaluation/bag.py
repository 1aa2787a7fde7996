# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Bags (rosbag2): written by mcap so that a kill costs a tenth of a second, read piece by piece.

The walk through a file is our own: it lists the three messages of a frame in 3 us, mcap's reader
in 20 us, which is all that a replay at 500 x real time has; and mcap's reader ends at any damage,
this one goes on at the next whole chunk that the index names.
"""

from __future__ import annotations

import io
import os
import re
import sqlite3
import struct
import sys
import zlib
from array import array
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass, field, replace
from functools import lru_cache, partial
from heapq import heappop, heappush
from pathlib import Path
from threading import RLock
from typing import TYPE_CHECKING, Any, BinaryIO, NamedTuple

import numpy as np
import yaml

from tactile_ros import __version__
from tactile_ros.conditioning.baseline import tare_means, tare_runs
from tactile_ros.errors import MissingPackageError, RecordingError, load_package
from tactile_ros.files import read_yaml
from tactile_ros.messages import fill_baseline, fill_contacts, fill_frame, fill_header, fill_layout
from tactile_ros.types import STATE_FIELDS, Closing, ContactState, Frame, Recording

if TYPE_CHECKING:
    from mcap.records import Channel, Chunk, Schema
    from rosbags.typesys.store import Typestore

Taker = Callable[[int, bytes], None]
Takers = Callable[[str, str], Taker | None]

PACKAGE, GEOMETRY = 'tactile_ros', 'geometry_msgs/msg'
BASE, NAME, SEQUENCE = 1, 2, 4  # kinds of a field in rosbags
CHUNK_BYTES = 1 << 16
CHUNK_NS = 100_000_000
METADATA_NS = 5_000_000_000
MAGIC = b'\x89MCAP0\r\n'
FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, CHUNK_INDEX, DATA_END = 2, 3, 4, 5, 6, 8, 15
TAKEN = (SCHEMA, CHANNEL, MESSAGE, CHUNK, CHUNK_INDEX)
MOST_TOPICS = 1 << 16  # as in an MCAP
LARGEST_CHUNK = 1 << 28  # bytes; a longer record is damage, not data
HEAD = struct.Struct('<BQ')  # of a record: code, length
MESSAGE_HEAD = struct.Struct('<BQHIQQ')  # and channel, sequence, log time, publish time
# end of a file without an index yet
TAIL = HEAD.pack(DATA_END, 4) + bytes(4) + HEAD.pack(FOOTER, 20) + bytes(20) + MAGIC
FOOTER_BYTES = HEAD.size + 20 + len(MAGIC)
MOST_DAMAGES = 20  # sentences about one file
ROWS = 512  # of a database, read at a time
LATCHED = re.compile(r'durability:\s*(?:1\b|transient_local)')  # in offered QoS
RULE = '=' * 80


def message_folder() -> Path:
    """Find the .msg files beside the source, else in the share of an installation."""
    above = Path(__file__).resolve().parents
    prefixes = [*above[2:8]]
    prefixes += [Path(p) for p in os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep) if p]
    places = [folder / 'msg' for folder in above[2:3]]
    places += [prefix / 'share' / PACKAGE / 'msg' for prefix in (*prefixes, Path(sys.prefix))]
    for place in places:
        if (place / 'TactileFrame.msg').is_file():
            return place
    msg = 'the message definitions of tactile_ros (TactileFrame.msg) were not found; reinstall it'
    raise RecordingError(msg)


@lru_cache(maxsize=1)
def all_types() -> Typestore:
    """Codec of rosbags for the standard types and those of msg/*.msg."""
    rosbags = load_package('rosbags.typesys', 'reading the messages of a bag needs rosbags')
    store: Typestore = rosbags.get_typestore(rosbags.Stores.LATEST)
    own = {}
    for file in sorted(message_folder().glob('*.msg')):
        name = f'{PACKAGE}/msg/{file.stem}'
        own.update(rosbags.get_types_from_msg(file.read_text('utf-8'), name))
    store.register({name: kind for name, kind in own.items() if name not in store.fielddefs})
    return store


@lru_cache(maxsize=256)
def schema_text(type_name: str) -> str:
    """Concatenate the ros2msg texts of a type ('tactile_ros/msg/TactileFrame') and its parts.

    Raises RecordingError if the type is neither ours nor a standard one.
    """
    if type_name not in all_types().fielddefs:
        msg = f'no definition of message type {type_name!r} was found'
        raise RecordingError(msg)
    text, _ = all_types().generate_msgdef(type_name, ros_version=2)
    plain, *needed = text.split(f'{RULE}\nMSG: ')
    parts = (section.partition('\n') for section in needed)
    named = (f'{RULE}\nMSG: {name}\n{_with_comments(name, text)}' for name, _, text in parts)
    return _with_comments(type_name, plain) + ''.join(named)


@lru_cache(maxsize=256)
def type_hash(type_name: str) -> str:
    """Hash of a type by REP-2016, as rosbag2 stores it; empty for an unknown type."""
    known = type_name in all_types().fielddefs
    return str(all_types().hash_rihs01(type_name)) if known else ''


def _with_comments(type_name: str, plain: str) -> str:
    """Definition of one type; ours as it is in its file, with units."""
    package, *_, name = type_name.split('/')
    if package != PACKAGE:
        return plain
    return (message_folder() / f'{name}.msg').read_text('utf-8').rstrip() + '\n'


@lru_cache(maxsize=64)
def same_fields(type_name: str, text: str) -> bool:
    """Compare the fields in a bag's own text of a type of ours with ours."""
    from rosbags.typesys import get_types_from_msg

    try:
        stored = get_types_from_msg(text.split(RULE, maxsplit=1)[0], type_name)
    except Exception:  # whatever a damaged text is
        return False
    return stored[type_name][1] == all_types().fielddefs[type_name][1]


@lru_cache(maxsize=64)
def _maker(type_name: str) -> Callable[[], Any]:
    """Function that makes messages of a type, every field empty or zero."""
    store = all_types()
    makers = {name: _field_maker(*what) for name, what in store.fielddefs[type_name][1]}
    return lambda: store.types[type_name](**{name: make() for name, make in makers.items()})


def _field_maker(kind: int, what: Any) -> Callable[[], Any]:  # noqa: ANN401
    if kind == NAME:
        return _maker(what)
    if kind == BASE:
        blank = '' if what[0] == 'string' else np.zeros((), what[0]).item()
        return lambda: blank
    (inner, name), count = what
    if inner == BASE and name[0] != 'string':
        return lambda: np.zeros(count, name[0])
    return list


def blank_message(type_name: str) -> Any:  # noqa: ANN401
    """Make a message of rosbags, every field empty or zero; of ours the short name is enough."""
    return _maker(type_name if '/' in type_name else f'{PACKAGE}/msg/{type_name}')()


def cdr_of(message: Any) -> bytes:  # noqa: ANN401
    """Serialise a message of rosbags (CDR), whose arrays may be those that rclpy takes."""
    for name, value in vars(message).items():
        if isinstance(value, array):
            setattr(message, name, np.array(value))
    return bytes(all_types().serialize_cdr(message, message.__msgtype__))


@lru_cache(maxsize=2)
def qos_text(latched: bool) -> str:
    """Offered QoS of a topic in the form of rosbag2 metadata versions 4 to 8."""

    def forever() -> dict[str, int]:
        return {'sec': 9223372036, 'nsec': 854775807}

    profile = {
        'history': 1, 'depth': 1 if latched else 1000, 'reliability': 1,
        'durability': 1 if latched else 2, 'deadline': forever(), 'lifespan': forever(),
        'liveliness': 1, 'liveliness_lease_duration': forever(),
        'avoid_ros_namespace_conventions': False,
    }  # fmt: skip
    return str(yaml.safe_dump([profile], sort_keys=False))


class _ChunkBuffer(io.BytesIO):
    """Bytes that mcap has written and the file does not hold yet, at the end of what it holds."""

    stored = 0

    def place(self) -> int:
        return self.stored + super().tell()

    tell = place


@dataclass
class _Topic:
    channel: int
    type_name: str
    latched: bool
    count: int = 0


class BagWriter(Closing):
    """Write serialised messages into a new rosbag2 folder; a context manager, safe in threads.

    Whole chunks reach the operating system within a tenth of a second of log time, each with an
    end of file that the next one overwrites: a killed process leaves a whole file without index.

    Raises RecordingError if the folder `path` holds something already or cannot be written.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        mcap = load_package('mcap.writer', 'recording a bag needs mcap')
        self.path = Path(path)
        self._topics: dict[str, _Topic] = {}
        self._schemas: dict[str, int] = {}
        self._bytes, self._chunk_ns = 0, tuple[int, ...]()  # of the chunk in the making
        self._span_ns: tuple[int, ...] = ()
        self._described_ns = 0
        self._lock = RLock()
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            if any(self.path.iterdir()):
                msg = f'{self.path} is not empty; choose a new folder for the bag'
                raise RecordingError(msg)
            # Unbuffered: what was written is with the operating system, not with this process.
            self._file = (self.path / f'{self.path.name}_0.mcap').open('xb', buffering=0)
        except OSError as err:
            msg = f'the bag {self.path} cannot be written: {err.strerror}'
            raise RecordingError(msg) from err
        self._pending = _ChunkBuffer()
        plain = mcap.CompressionType.NONE
        self._mcap = mcap.Writer(self._pending, 1 << 62, plain, enable_data_crcs=False)
        self._mcap.start('ros2', f'tactile_ros {__version__}')
        self._store()
        self._write_metadata()

    @property
    def counts(self) -> dict[str, int]:
        """Messages written per topic."""
        return {name: topic.count for name, topic in self._topics.items()}

    def add_topic(self, topic: str, type_name: str, latched: bool = False, text: str = '') -> None:
        """Announce a topic, latched as transient local, with the text of a foreign type."""
        with self._lock:
            if topic in self._topics:
                return
            if type_name not in self._schemas:
                data = (text or schema_text(type_name)).encode()
                self._schemas[type_name] = self._mcap.register_schema(type_name, 'ros2msg', data)
            offered = {
                'offered_qos_profiles': qos_text(latched), 'topic_type_hash': type_hash(type_name),
            }  # fmt: skip
            channel = self._mcap.register_channel(topic, 'cdr', self._schemas[type_name], offered)
            self._topics[topic] = _Topic(channel, type_name, latched)
            self._write_metadata()

    def write(
        self, topic: str, type_name: str, stamp_ns: int, data: bytes, latched: bool = False
    ) -> None:
        """Take one message (CDR) in that was received at a log time (ns).

        The type is such as 'tactile_ros/msg/TactileFrame'; `latched` is as in `add_topic`, and
        read in the first message of a topic. Raises RecordingError if the bag is closed or the
        disk is full.
        """
        with self._lock:
            if self._file.closed:
                msg = f'the bag {self.path} is closed'
                raise RecordingError(msg)
            self.add_topic(topic, type_name, latched)
            entry = self._topics[topic]
            stamp_ns = max(stamp_ns, 0)
            self._mcap.add_message(entry.channel, stamp_ns, data, stamp_ns, entry.count)
            entry.count += 1
            self._bytes += len(data) + MESSAGE_HEAD.size
            begin, end = self._chunk_ns or (stamp_ns, stamp_ns)
            self._chunk_ns = min(begin, stamp_ns), max(end, stamp_ns)
            if self._bytes >= CHUNK_BYTES or self._chunk_ns[1] - self._chunk_ns[0] >= CHUNK_NS:
                self.flush()

    def flush(self) -> None:
        """Hand everything taken in to the operating system."""
        with self._lock:
            if self._file.closed or not (self._bytes or self._pending.getvalue()):
                return
            self._mcap.flush()
            times = [*self._span_ns, *self._chunk_ns]
            self._span_ns = (min(times), max(times)) if times else ()
            self._bytes, self._chunk_ns = 0, ()
            self._store()
            if times and abs(max(times) - self._described_ns) > METADATA_NS:
                self._described_ns = max(times)
                self._write_metadata()

    def close(self) -> None:
        """Write the index and the final metadata; later calls do nothing."""
        with self._lock:
            if self._file.closed:
                return
            self.flush()
            self._write_metadata()
            self._mcap.add_metadata('rosbag2', {'serialized_metadata': self._metadata()})
            self._mcap.finish()
            self._store(tail=b'')
            self._file.close()

    def _store(self, tail: bytes = TAIL) -> None:
        pending = self._pending.getvalue()
        self._file.seek(self._pending.stored)
        view = memoryview(pending + tail)
        try:
            while view:
                view = view[self._file.write(view) :]
        except OSError as err:
            msg = f'the bag {self.path} cannot grow: {err.strerror}'
            raise RecordingError(msg) from err
        self._pending.stored += len(pending)
        self._pending.seek(0)
        self._pending.truncate()

    def _metadata(self) -> str:
        begin, end = self._span_ns or (0, 0)
        name, total = f'{self.path.name}_0.mcap', sum(self.counts.values())

        def span() -> dict[str, dict[str, int]]:
            return {
                'duration': {'nanoseconds': end - begin},
                'starting_time': {'nanoseconds_since_epoch': begin},
            }

        topics = [
            {
                'topic_metadata': {
                    'name': topic, 'type': entry.type_name, 'serialization_format': 'cdr',
                    'offered_qos_profiles': qos_text(entry.latched),
                    'type_description_hash': type_hash(entry.type_name),
                },
                'message_count': entry.count,
            }
            for topic, entry in self._topics.items()
        ]  # fmt: skip
        document = {'rosbag2_bagfile_information': {
            'version': 8, 'storage_identifier': 'mcap', **span(), 'message_count': total,
            'topics_with_message_count': topics, 'compression_format': '', 'compression_mode': '',
            'relative_file_paths': [name],
            'files': [{'path': name, **span(), 'message_count': total}],
            'custom_data': {}, 'ros_distro': os.environ.get('ROS_DISTRO', 'unknown'),
        }}  # fmt: skip
        return str(yaml.safe_dump(document, sort_keys=False))

    def _write_metadata(self) -> None:
        """Replace metadata.yaml in one step, so that a kill leaves the old or the new one."""
        fresh = self.path / '.metadata.yaml'
        fresh.write_text(self._metadata(), encoding='utf-8')
        fresh.replace(self.path / 'metadata.yaml')


def write_recording(recording: Recording, path: Path) -> None:
    """Write a recording as the bag of a run: layout, frames, baselines of its tares, truth."""
    layout, stamps = recording.layout, recording.stamp_ns
    if stamps is None:
        stamps = np.arange(1, len(recording) + 1) * 10_000_000
    tare = np.zeros(len(recording), bool) if recording.tare is None else recording.tare
    run, _ = tare_runs(tare, recording.restarts)
    levels = tare_means(recording.values, run)
    with BagWriter(path) as bag:

        def put(topic: str, message: Any, stamp_ns: int) -> None:  # noqa: ANN401
            data = cdr_of(message)
            bag.write(topic, message.__msgtype__, stamp_ns, data, topic == '/layout')

        message = blank_message('TactileLayout')
        parts = (partial(blank_message, f'{GEOMETRY}/{name}') for name in ('Point', 'Quaternion'))
        fill_layout(message, layout, *parts)
        put('/layout', message, int(stamps[0]))
        for row, stamp in enumerate(stamps.tolist()):
            message = blank_message('TactileFrame')
            fill_frame(message, replace(recording.frame(row), stamp_ns=stamp, sequence=row),
                       layout.frame_id)  # fmt: skip
            put('/frame', message, stamp)
            number = int(run[row])
            if number >= 0 and number not in run[row + 1 : row + 2]:
                message, count = blank_message('TactileFrame'), int((run == number).sum())
                baseline = Frame(stamp, row + 1, levels[number], averaged=count)
                fill_baseline(message, baseline, layout.frame_id)
                put('/baseline', message, stamp)
            known = {k: v[row][None] for k, v in recording.truth.items() if k in STATE_FIELDS}
            message = blank_message('TactileContacts')
            state = ContactState.assemble(layout.shape[0], known)
            fill_contacts(message, state, partial(blank_message, 'TactileContact'))
            fill_header(message.header, stamp, layout.frame_id)
            message.sequence = row
            message.repetition = int(recording.truth['repetition'][row])
            put('/truth/contacts', message, stamp)


@dataclass
class BagContent:
    """Counts, types and texts of a bag, as far as it was read, and sentences about its damage.

    `counts` are messages per topic; `types` are of topics with messages, `announced` of all that
    an index or a channel names; `texts` are definitions by type; `latched` are topics with
    transient local QoS.
    """

    counts: Counter[str] = field(default_factory=Counter)
    types: dict[str, str] = field(default_factory=dict)
    announced: dict[str, str] = field(default_factory=dict)
    texts: dict[str, str] = field(default_factory=dict)
    latched: set[str] = field(default_factory=set)
    problems: list[str] = field(default_factory=list)


def read_bag(path: str | os.PathLike[str], content: BagContent, takers: Takers) -> Iterator[None]:
    """Read a bag (rosbag2 folder, .mcap or .db3) part by part: of an MCAP file a chunk at a time.

    The content grows by everything but messages; `takers` gives for topic and type name the
    function that takes log time (ns) and CDR of each message, or None: they are counted only.
    Raises RecordingError if there is no bag at `path`, and nothing for what its files hold.
    """
    for file in _files(Path(path), content):
        try:
            if file.suffix == '.mcap':
                yield from _McapFile(file, content, takers).read()
            elif file.suffix == '.db3':
                yield from _read_sqlite(file, content, takers)
            else:
                content.problems.append(f'{file.name} is compressed as a whole: unpack it first')
        except OSError as err:
            content.problems.append(f'{file.name} cannot be read: {err.strerror}')


def _files(path: Path, content: BagContent) -> list[Path]:
    """Storage files of a bag; those that its metadata names and that are gone are a problem."""
    if path.is_file():
        if path.suffix not in ('.mcap', '.db3'):
            msg = f'{path} is no bag: a folder, .mcap or .db3 is wanted'
            raise RecordingError(msg)
        return [path]
    found = [f for f in path.glob('*') if f.name.endswith(('.mcap', '.db3', '.zstd'))]
    files = [f for f in found if f.is_file()]  # a pipe may never end
    content.problems += [f'{f.name} is no file' for f in found if f not in files]
    if not files:
        why = 'holds no bag (no .mcap or .db3 file)' if path.exists() else 'does not exist'
        msg = f'{path} {why}'
        raise RecordingError(msg)
    metadata = path / 'metadata.yaml'
    if metadata.is_file():
        try:
            about: Any = read_yaml(metadata.read_bytes())
            listed = map(str, about['rosbag2_bagfile_information']['relative_file_paths'])
            gone = {Path(name).name for name in listed} - {file.name for file in files}
            content.problems += [f'{name} of the bag is missing' for name in sorted(gone)]
        except (ValueError, LookupError, TypeError):
            content.problems.append('metadata.yaml of the bag names no files; all were read')
    else:
        content.problems.append('metadata.yaml of the bag is missing; its files were read anyway')
    return sorted(files, key=lambda file: (len(file.name), file.name))


class Record(NamedTuple):
    """One record of an MCAP file: its place, code (0: damage) and content, which may be cut."""

    at: int
    code: int
    body: bytes
    whole: bool


def records(file: BinaryIO, start: int, size: int) -> Iterator[Record]:
    """Walk the records of a file of so many bytes from a place on; damage or a cut comes last."""
    at = start
    while at < size:
        file.seek(at)
        head = file.read(HEAD.size)
        code, length = HEAD.unpack(head) if len(head) == HEAD.size else (0, 0)
        valid = 0 < code <= DATA_END or code >= 0x80  # 0x80 and above are private
        if not valid or (code in TAKEN and length > LARGEST_CHUNK):
            yield Record(at, 0, b'', False)
            return
        end = at + HEAD.size + length
        yield Record(at, code, file.read(length) if code in TAKEN else b'', end <= size)
        at = end


class _McapFile:
    """One pass over one MCAP file."""

    def __init__(self, path: Path, content: BagContent, takers: Takers) -> None:
        names = ('mcap.records', 'mcap.data_stream', 'mcap.exceptions')
        need = 'reading a bag needs mcap'
        self.kinds, self.stream, self.errors = (load_package(name, need) for name in names)
        self.path, self.content, self.takers = path, content, takers
        self.size = path.stat().st_size
        self.schemas: dict[int, Schema] = {}
        self.channels: dict[int, Channel] = {}
        self.topics: dict[int, tuple[str, Taker | None]] = {}
        self.chunks: list[int] = []  # places ahead, as a heap
        self.lost: Counter[str] = Counter()

    def read(self) -> Iterator[None]:
        """Read the file, a chunk at a time; damage ends up in the problems of the content."""
        if self.size == 0:
            self._say('is empty')
            return
        with self.path.open('rb') as file:
            if file.read(len(MAGIC)) != MAGIC:
                self._say('does not begin like an MCAP file')
            closed = self._read_summary(file)
            at: int | None = len(MAGIC)
            while at is not None:
                last = Record(self.size, 0, b'', False)
                for record in records(file, at, self.size):
                    if record.whole or record.code == CHUNK:  # of a cut chunk, what is whole
                        self._take(record)
                    if record.code == DATA_END or not record.whole:
                        last = record
                        break
                    if record.code == CHUNK:
                        yield
                at = None if last.whole else self._after_damage(last.at)
            if last.whole and not closed:
                self._say('has lost its index; every message of it was read')
        for what, count in self.lost.items():
            self._say(f'{what} ({count} records left out)')

    def _say(self, sentence: str) -> None:
        said = sum(problem.startswith(self.path.name) for problem in self.content.problems)
        if said < MOST_DAMAGES:
            self.content.problems.append(f'{self.path.name} {sentence}')

    def _after_damage(self, damaged: int) -> int | None:
        """Place of the next chunk that the index names; None: there is none."""
        while self.chunks and self.chunks[0] <= damaged:
            heappop(self.chunks)
        at = self.chunks[0] if self.chunks else None
        if at is None:
            self._say(f'is cut off or damaged at byte {damaged}; what follows was left out')
        else:
            self._say(f'is damaged at byte {damaged}; going on at byte {at}')
        return at

    def _read_summary(self, file: BinaryIO) -> bool:
        """Take types, topics and chunks from the summary; False: the file has no end."""
        file.seek(max(self.size - FOOTER_BYTES, 0))
        ending = file.read()
        if ending[-len(MAGIC) :] != MAGIC or ending[:1] != bytes([FOOTER]):
            return False
        (start,) = struct.unpack_from('<Q', ending, HEAD.size)
        if start == 0:
            self._say('was not closed: it has no index, and the last moments may be missing')
        for record in records(file, start, self.size) if start else ():
            if record.whole and record.code in (SCHEMA, CHANNEL, CHUNK_INDEX):
                self._take(record)
        return True

    def _take(self, record: Record) -> None:
        if record.code not in TAKEN:
            return
        kinds, body = self.kinds, self.stream.ReadDataStream(io.BytesIO(record.body))
        try:
            if record.code == CHUNK:
                self._take_chunk(kinds.Chunk.read(body), record)
            elif record.code == SCHEMA:
                schema = kinds.Schema.read(body)
                self.schemas[schema.id] = schema
            elif record.code == CHANNEL:
                channel = kinds.Channel.read(body)
                self.channels[channel.id] = channel
                self.topics.pop(channel.id, None)
                if channel.schema_id in self.schemas:
                    name = self.schemas[channel.schema_id].name
                    self.content.announced[channel.topic] = name
            elif record.code == CHUNK_INDEX:
                heappush(self.chunks, struct.unpack_from('<Q', record.body, 16)[0])
            elif record.code == MESSAGE:
                self._take_records(HEAD.pack(MESSAGE, len(record.body)) + record.body)
        except (self.errors.McapError, struct.error, UnicodeDecodeError):
            self.lost['holds records that make no sense'] += 1

    def _take_chunk(self, chunk: Chunk, record: Record) -> None:
        try:
            stored = unpack(chunk.compression, chunk.data, chunk.uncompressed_size)
        except (RecordingError, MissingPackageError) as err:
            self._say(f'chunk at byte {record.at} was left out: {err}')
            return
        stated = (chunk.uncompressed_crc or zlib.crc32(stored), chunk.uncompressed_size)
        if record.whole and stated != (zlib.crc32(stored), len(stored)):
            what = f'chunk at byte {record.at} is damaged (checksum)'
            self._say(f'{what}; its messages were left out')
        else:
            self._take_records(stored)

    def _take_records(self, stored: bytes) -> None:
        counts, topics, size, at = self.content.counts, self.topics, len(stored), 0
        while size - at >= HEAD.size:
            code, length = HEAD.unpack_from(stored, at)
            begin, end = at + HEAD.size, at + HEAD.size + length
            if end > size:
                return
            if code == MESSAGE and end - at >= MESSAGE_HEAD.size:
                _, _, number, _, log_ns, _ = MESSAGE_HEAD.unpack_from(stored, at)
                topic = topics.get(number) or self._topic(number)
                if topic is None:
                    self.lost['has messages whose topic or type is unknown'] += 1
                elif log_ns >> 63:
                    self.lost['has messages at times that no clock shows'] += 1
                else:
                    counts[topic[0]] += 1
                    if topic[1] is not None:
                        topic[1](log_ns, stored[at + MESSAGE_HEAD.size : end])
            elif code in (SCHEMA, CHANNEL):
                self._take(Record(at, code, stored[begin:end], True))
            at = end

    def _topic(self, number: int) -> tuple[str, Taker | None] | None:
        """Name of a channel's topic, and the function that takes its messages."""
        channel = self.channels.get(number)
        schema = self.schemas.get(channel.schema_id) if channel else None
        if channel is None or schema is None:
            return None
        self.content.types[channel.topic] = schema.name
        if LATCHED.search(channel.metadata.get('offered_qos_profiles', '')):
            self.content.latched.add(channel.topic)
        take: Taker | None = None
        if channel.message_encoding == 'cdr':
            if schema.encoding == 'ros2msg':
                self.content.texts[schema.name] = schema.data.decode('utf-8', 'replace')
            take = self.takers(channel.topic, schema.name)
        else:
            how = f'is encoded as {channel.message_encoding!r}; left out'
            self.content.problems.append(f'{channel.topic} {how}')
        self.topics[number] = channel.topic, take
        return channel.topic, take


def unpack(compression: str, data: bytes, size: int) -> bytes:
    """Unpack the records of a chunk, at most as long as it says, also of a cut one.

    Raises RecordingError if the length is absurd or the compression unknown or damaged,
    MissingPackageError if its package is not installed.
    """
    if size > LARGEST_CHUNK:
        msg = f'it claims {size} bytes'
        raise RecordingError(msg)
    if compression == '':
        return data[:size]
    need = f'reading a bag compressed with {compression} needs'
    if compression == 'zstd':
        decompressor = load_package('zstandard', f'{need} zstandard').ZstdDecompressor()
        read = decompressor.stream_reader(io.BytesIO(data)).read
    elif compression == 'lz4':
        read = partial(
            load_package('lz4.frame', f'{need} lz4').LZ4FrameDecompressor().decompress, data
        )
    else:
        msg = f'its compression {compression[:20]!r} is not known'
        raise RecordingError(msg)
    try:
        return bytes(read(size))
    except MemoryError:
        raise
    except Exception as err:  # whatever the library makes of it
        msg = f'its {compression} data are damaged'
        raise RecordingError(msg) from err


def _read_sqlite(file: Path, content: BagContent, takers: Takers) -> Iterator[None]:
    """Read a storage file of rosbag2 in sqlite3, as far as it is whole."""
    count = 0
    try:
        with closing(sqlite3.connect(f'{file.resolve().as_uri()}?mode=ro', uri=True)) as base:
            if made_up := _made_up(base):
                content.problems.append(f'{file.name} was left out: it holds {made_up}')
                return
            topics = dict(_sqlite_topics(base, content, takers))
            rows = base.execute(
                'SELECT topic_id, timestamp, data FROM messages WHERE length(data) <= ? '
                'ORDER BY id',
                (LARGEST_CHUNK,),
            )
            for number, log_ns, data in rows:
                count += 1
                name, take = topics.get(number, ('', None))
                content.counts[name] += 1
                if take and isinstance(data, bytes) and isinstance(log_ns, int):
                    take(log_ns, data)
                if count % ROWS == 0:
                    yield
    except sqlite3.Error as err:
        content.problems.append(f'{file.name} is damaged after {count} messages: {err}')


def _made_up(base: sqlite3.Connection) -> str:
    """Name what makes rows up instead of storing them: they may have no end; empty: nothing."""
    for name in ('topics', 'messages', 'message_definitions'):
        kinds = base.execute('SELECT type FROM sqlite_master WHERE lower(name) = ?', (name,))
        if any(kind != 'table' for (kind,) in kinds):
            return f'{name} that is no table'
        if any(column[-1] for column in base.execute(f'PRAGMA table_xinfo({name})')):
            return f'computed columns in {name}'
    return ''


def _sqlite_topics(
    base: sqlite3.Connection, content: BagContent, takers: Takers
) -> Iterator[tuple[int, tuple[str, Taker | None]]]:
    """Name and taker of every topic by its number; types, texts and QoS join the content."""
    tables = {name for (name,) in base.execute('SELECT name FROM sqlite_master')}
    if 'message_definitions' in tables:  # from Iron on
        wanted = 'topic_type, encoding, encoded_message_definition'
        for kind, encoding, text in base.execute(f'SELECT {wanted} FROM message_definitions'):
            if encoding == 'ros2msg':
                content.texts[str(kind)] = str(text)
    topics = base.execute('SELECT id, name, type, * FROM topics LIMIT ?', (MOST_TOPICS,))
    columns = [column for column, *_ in topics.description]
    for row in topics:
        number, name, kind = row[0], str(row[1]), str(row[2])
        content.types[name] = kind
        offered = dict(zip(columns, row, strict=True)).get('offered_qos_profiles')
        if LATCHED.search(str(offered)):
            content.latched.add(name)
        yield number, (name, takers(name, kind))
