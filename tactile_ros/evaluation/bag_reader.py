"""Reader of rosbag2 bags that takes out what is whole and names what is not.

MCAP files are walked record by record, so a bag without its end reads like any other; after damage
the walk goes on at the next chunk that the file's own index names. sqlite3 files are read row by
row. Reading never raises for what a file holds, only for what is no bag at all.
"""

from __future__ import annotations

import io
import mmap
import re
import sqlite3
import zlib
from collections import Counter
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from tactile_ros.errors import MissingPackageError, RecordingError
from tactile_ros.evaluation import container
from tactile_ros.evaluation.container import Cursor
from tactile_ros.evaluation.definitions import missing

if TYPE_CHECKING:
    import os
    from collections.abc import Callable

_LISTED = re.compile(r'^\s*-\s+"?([^"\n]+\.(?:mcap|db3)(?:\.zstd)?)"?\s*$', re.MULTILINE)
_MOST_DAMAGES = 20


class Message(NamedTuple):
    """One message as it lies in the bag: topic, type, log time (ns), CDR."""

    topic: str
    type_name: str
    log_ns: int
    data: bytes


@dataclass
class BagContent:
    """What was read: wanted messages in order, messages per topic, types and their text.

    `problems` are sentences about everything that was damaged, cut off or left out.
    """

    messages: list[Message] = field(default_factory=list)
    counts: Counter[str] = field(default_factory=Counter)
    types: dict[str, str] = field(default_factory=dict)
    texts: dict[str, str] = field(default_factory=dict)
    problems: list[str] = field(default_factory=list)


def read_bag(
    path: str | os.PathLike[str], wanted: Callable[[str, str], bool] = lambda topic, kind: True
) -> BagContent:
    """Read every message whose topic and type are wanted.

    Parameters
    ----------
    path : path-like
        A rosbag2 folder, or one .mcap or .db3 file.
    wanted : callable
        Takes topic and type name; messages of other topics are counted only.

    Returns
    -------
    BagContent
        Files in the order of their names, messages in the order in which they were stored.

    Raises
    ------
    RecordingError
        If there is no bag at `path`.
    """
    content = BagContent()
    for file in _files(Path(path), content):
        try:
            if file.suffix == '.mcap':
                _McapWalk(file, content, wanted).run()
            elif file.suffix == '.db3':
                _read_sqlite(file, content, wanted)
            else:
                content.problems.append(f'{file.name} is compressed as a whole: unpack it first')
        except OSError as err:
            content.problems.append(f'{file.name} cannot be read: {err.strerror}')
    return content


def _files(path: Path, content: BagContent) -> list[Path]:
    """Storage files of a bag; those that its metadata names and that are gone are a problem."""
    if path.is_file():
        if path.suffix not in ('.mcap', '.db3'):
            msg = f'{path} is no bag: a folder, .mcap or .db3 is wanted'
            raise RecordingError(msg)
        return [path]
    found = [f for f in path.glob('*') if f.name.endswith(('.mcap', '.db3', '.zstd'))]
    if not found:
        msg = f'{path} holds no bag (no .mcap or .db3 file)'
        raise RecordingError(msg)
    metadata = path / 'metadata.yaml'
    if metadata.is_file():
        text = metadata.read_text(encoding='utf-8', errors='replace')
        named = {Path(name).name for name in _LISTED.findall(text)}
        gone = sorted(named - {file.name for file in found})
        content.problems += [f'{name} of the bag is missing' for name in gone]
    else:
        content.problems.append('metadata.yaml of the bag is missing; its files were read anyway')
    return sorted(found, key=lambda file: (len(file.name), file.name))


class _McapWalk:
    """One pass over one MCAP file."""

    def __init__(
        self, file: Path, content: BagContent, wanted: Callable[[str, str], bool]
    ) -> None:
        self.file, self.content, self.wanted = file, content, wanted
        self.schemas: dict[int, container.Schema] = {}
        self.channels: dict[int, container.Channel] = {}
        self.topics: dict[int, tuple[str, str, bool] | None] = {}
        self.lost: Counter[str] = Counter()

    def run(self) -> None:
        """Read the file; damage ends up in the problems of the content."""
        if self.file.stat().st_size == 0:
            self._say('is empty')
            return
        with (
            self.file.open('rb') as opened,
            mmap.mmap(opened.fileno(), 0, access=mmap.ACCESS_READ) as data,
        ):
            if data[: len(container.MAGIC)] != container.MAGIC:
                self._say('does not begin like an MCAP file')
            chunks = self._summary(data)
            self._sections(data, chunks)
        for what, count in self.lost.items():
            self._say(f'{what} ({count} records left out)')

    def _say(self, sentence: str) -> None:
        """Add a problem of this file."""
        said = sum(problem.startswith(self.file.name) for problem in self.content.problems)
        if said < _MOST_DAMAGES:
            self.content.problems.append(f'{self.file.name} {sentence}')

    def _summary(self, data: mmap.mmap) -> list[int]:
        """Places of the chunks by the index at the end; types and topics are taken from it too."""
        size = len(container.TAIL) - len(container.DATA_END_RECORD)
        ending = data[-size:] if len(data) > size else b''
        if ending[-len(container.MAGIC) :] != container.MAGIC or ending[:1] != b'\x02':
            return []
        (start,) = Cursor(ending[9:]).numbers('<Q')
        if start == 0:
            self._say('was not closed: it has no index, and the last moments may be missing')
        places = []
        for _, code, body, whole in container.walk(data, start) if start else ():
            if not whole:
                break
            if code == container.CHUNK_INDEX and len(body) >= 24:
                places.append(Cursor(body).numbers('<QQQ')[2])
            elif code in (container.SCHEMA, container.CHANNEL):
                self._take(code, body)
        return sorted(places)

    def _sections(self, data: mmap.mmap, chunks: list[int]) -> None:
        """Walk from the start; after damage go on at the next chunk that the index names."""
        at: int | None = len(container.MAGIC)
        while at is not None:
            damaged = self._walk(data, at)
            if damaged is None:
                if data[-len(container.MAGIC) :] != container.MAGIC:
                    self._say('has lost its index; every message of it was read')
                return
            at = next((place for place in chunks if place > damaged), None)
            after = 'what follows was left out' if at is None else f'going on at byte {at}'
            cut = 'is cut off or damaged at byte' if at is None else 'is damaged at byte'
            self._say(f'{cut} {damaged}; {after}')

    def _walk(self, data: mmap.mmap, start: int) -> int | None:
        """Take records up to the end of the data; the place of damage, or None."""
        at = start
        for at, code, body, whole in container.walk(data, start):
            if code == container.DATA_END and whole:
                return None
            if code == container.CHUNK:
                self._chunk(at, body, whole)
            elif code and whole:
                self._take(code, body)
            if not code or not whole:
                return at
        return max(at, len(data))

    def _chunk(self, at: int, body: bytes, whole: bool) -> None:
        """Take the records of one chunk; of a cut one those that are whole."""
        try:
            cursor = Cursor(body)
            _, _, size, checksum = cursor.numbers('<QQQI')
            records = unpack(cursor.text(), body[cursor.at + 8 :], size)
        except (RecordingError, MissingPackageError) as err:
            self._say(f'chunk at byte {at} was left out: {err}')
            return
        if whole and (len(records) != size or (checksum and zlib.crc32(records) != checksum)):
            self._say(f'chunk at byte {at} is damaged (checksum); its messages were left out')
            return
        for _, code, content, complete in container.walk(records):
            if complete and code:
                self._take(code, content)

    def _take(self, code: int, body: bytes) -> None:
        """Take one whole record in."""
        try:
            if code == container.SCHEMA:
                schema = container.read_schema(body)
                self.schemas[schema.number] = schema
            elif code == container.CHANNEL:
                channel = container.read_channel(body)
                self.channels[channel.number] = channel
                self.topics.pop(channel.number, None)
            elif code == container.MESSAGE:
                self._message(*container.read_message(body))
        except RecordingError as err:
            self.lost[f'holds records that make no sense: {err}'] += 1

    def _message(self, number: int, log_ns: int, data: bytes) -> None:
        """Keep a message whose topic is known and wanted; count every one."""
        if number not in self.topics:
            self.topics[number] = self._topic(number)
        topic = self.topics[number]
        if topic is None:
            self.lost['has messages whose topic or type is not told'] += 1
            return
        name, type_name, wanted = topic
        self.content.counts[name] += 1
        if wanted:
            self.content.messages.append(Message(name, type_name, log_ns, data))

    def _topic(self, number: int) -> tuple[str, str, bool] | None:
        """Name, type and whether it is wanted, of a channel."""
        channel = self.channels.get(number)
        schema = self.schemas.get(channel.schema) if channel else None
        if channel is None or schema is None:
            return None
        name, type_name = channel.topic, schema.name
        self.content.types[name] = type_name
        if channel.encoding != 'cdr':
            self.content.problems.append(f'{name} is encoded as {channel.encoding!r}; left out')
            return name, type_name, False
        if schema.encoding == 'ros2msg':
            self.content.texts[type_name] = schema.text
        return name, type_name, self.wanted(name, type_name)


def unpack(compression: str, data: bytes, size: int) -> bytes:
    """Records of a chunk, at most as long as it says.

    Raises
    ------
    RecordingError
        If the length is absurd or the compression unknown or damaged.
    MissingPackageError
        If the package for its compression is not installed.
    """
    if size > container.LARGEST_CHUNK:
        msg = f'it claims {size} bytes'
        raise RecordingError(msg)
    try:
        if compression == '':
            return data[:size]
        if compression == 'zstd':
            return _unzstd(data, size)
        if compression == 'lz4':
            return _unlz4(data, size)
    except (MissingPackageError, MemoryError):
        raise
    except Exception as err:
        msg = f'its {compression} data are damaged'
        raise RecordingError(msg) from err
    msg = f'its compression {compression[:20]!r} is not known'
    raise RecordingError(msg)


def _unzstd(data: bytes, size: int) -> bytes:
    """Unpack Zstandard data up to `size`, also of a cut frame."""
    try:
        import zstandard
    except ImportError as err:
        msg = 'zstandard'
        raise missing(msg, 'reading a bag compressed with zstd') from err
    unpacked: bytes = zstandard.ZstdDecompressor().stream_reader(io.BytesIO(data)).read(size)
    return unpacked


def _unlz4(data: bytes, size: int) -> bytes:
    """Unpack LZ4 data up to `size`, also of a cut frame."""
    try:
        from lz4.frame import LZ4FrameDecompressor
    except ImportError as err:
        msg = 'lz4'
        raise missing(msg, 'reading a bag compressed with lz4') from err
    unpacked: bytes = LZ4FrameDecompressor().decompress(data, max_length=size)
    return unpacked


def _read_sqlite(file: Path, content: BagContent, wanted: Callable[[str, str], bool]) -> None:
    """Read a storage file of rosbag2 in sqlite3, as far as it is whole."""
    count = 0
    try:
        with closing(sqlite3.connect(f'{file.resolve().as_uri()}?mode=ro', uri=True)) as base:
            topics = {}
            for number, name, kind in base.execute('SELECT id, name, type FROM topics'):
                topics[number] = (str(name), str(kind), wanted(str(name), str(kind)))
                content.types[str(name)] = str(kind)
            rows = base.execute('SELECT topic_id, timestamp, data FROM messages ORDER BY id')
            for number, log_ns, data in rows:
                count += 1
                name, kind, keep = topics.get(number, ('', '', False))
                content.counts[name] += 1
                if keep and isinstance(data, bytes) and isinstance(log_ns, int):
                    content.messages.append(Message(name, kind, log_ns, data))
    except sqlite3.Error as err:
        content.problems.append(f'{file.name} is damaged after {count} messages: {err}')
