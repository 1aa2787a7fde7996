"""Reader of rosbag2 bags that takes out what is whole and names what is not.

MCAP files are walked record by record, so a bag without its end reads like any other; after damage
the walk goes on at the next chunk that the file's own index names. sqlite3 files are read row by
row. Reading never raises for what a file holds, only for what is no bag at all.
"""

from __future__ import annotations

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
from tactile_ros.evaluation.compression import unpack
from tactile_ros.evaluation.container import Cursor

if TYPE_CHECKING:
    import os
    from collections.abc import Callable, Generator, Iterator

    Taker = Callable[[int, bytes], None]

_LISTED = re.compile(r'^\s*-\s+"?([^"\n]+\.(?:mcap|db3)(?:\.zstd)?)"?\s*$', re.MULTILINE)
_MOST_DAMAGES = 20
_ROWS = 512  # of a database, read at a time
_BEHIND = 1 << 22  # bytes read, after which their memory goes back to the system


class Message(NamedTuple):
    """One message as it lies in the bag: topic, type, log time (ns), CDR."""

    topic: str
    type_name: str
    log_ns: int
    data: bytes


@dataclass
class BagContent:
    """What was read: wanted messages in order, messages per topic, types and their text.

    `types` are of topics with messages, `announced` of all that were told. `problems` are
    sentences about everything that was damaged, cut off or left out.
    """

    messages: list[Message] = field(default_factory=list)
    counts: Counter[str] = field(default_factory=Counter)
    types: dict[str, str] = field(default_factory=dict)
    announced: dict[str, str] = field(default_factory=dict)
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

    def taker(topic: str, kind: str) -> Taker | None:
        if not wanted(topic, kind):
            return None
        return lambda log_ns, data: content.messages.append(Message(topic, kind, log_ns, data))

    for _ in read_parts(path, content, taker):
        pass
    return content


def read_parts(
    path: str | os.PathLike[str],
    content: BagContent,
    taker: Callable[[str, str], Taker | None],
) -> Iterator[None]:
    """Read a bag part by part: of an MCAP file a chunk at a time.

    Parameters
    ----------
    path : path-like
        Of the bag.
    content : BagContent
        Grows by everything but messages.
    taker : callable
        Gives for topic and type name who takes log time (ns) and CDR of each message; None:
        messages are counted only.
    """
    for file in _files(Path(path), content):
        try:
            if file.suffix == '.mcap':
                yield from _McapWalk(file, content, taker).run()
            elif file.suffix == '.db3':
                yield from _read_sqlite(file, content, taker)
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
        self, file: Path, content: BagContent, taker: Callable[[str, str], Taker | None]
    ) -> None:
        self.file, self.content, self.taker = file, content, taker
        self.schemas: dict[int, container.Schema] = {}
        self.channels: dict[int, container.Channel] = {}
        self.topics: dict[int, tuple[str, Taker | None] | None] = {}
        self.lost: Counter[str] = Counter()
        self.released = 0

    def run(self) -> Iterator[None]:
        """Read the file, a chunk at a time; damage ends up in the problems of the content."""
        if self.file.stat().st_size == 0:
            self._say('is empty')
            return
        with (
            self.file.open('rb') as opened,
            mmap.mmap(opened.fileno(), 0, access=mmap.ACCESS_READ) as data,
        ):
            if data[: len(container.MAGIC)] != container.MAGIC:
                self._say('does not begin like an MCAP file')
            yield from self._sections(data, self._summary(data))
        for what, count in self.lost.items():
            self._say(f'{what} ({count} records left out)')

    def _say(self, sentence: str) -> None:
        """Add a problem of this file."""
        said = sum(problem.startswith(self.file.name) for problem in self.content.problems)
        if said < _MOST_DAMAGES:
            self.content.problems.append(f'{self.file.name} {sentence}')

    def _summary(self, data: mmap.mmap) -> int:
        """Take types and topics from the summary at the end; where it starts, 0: there is none."""
        size = len(container.TAIL) - len(container.DATA_END_RECORD)
        ending = data[-size:] if len(data) > size else b''
        if ending[-len(container.MAGIC) :] != container.MAGIC or ending[:1] != b'\x02':
            return 0
        (start,) = Cursor(ending[9:]).numbers('<Q')
        if start == 0:
            self._say('was not closed: it has no index, and the last moments may be missing')
        for _, code, body, whole in container.walk(data, start) if start else ():
            if not whole:
                break
            if code in (container.SCHEMA, container.CHANNEL):
                self._take(code, body)
        return start

    def _sections(self, data: mmap.mmap, summary: int) -> Iterator[None]:
        """Walk from the start; after damage go on at the next chunk that the index names."""
        at: int | None = len(container.MAGIC)
        while at is not None:
            damaged = yield from self._walk(data, at)
            if damaged is None:
                if data[-len(container.MAGIC) :] != container.MAGIC:
                    self._say('has lost its index; every message of it was read')
                return
            at = next((place for place in _places(data, summary) if place > damaged), None)
            after = 'what follows was left out' if at is None else f'going on at byte {at}'
            cut = 'is cut off or damaged at byte' if at is None else 'is damaged at byte'
            self._say(f'{cut} {damaged}; {after}')

    def _walk(self, data: mmap.mmap, start: int) -> Generator[None, None, int | None]:
        """Take records up to the end of the data; the place of damage, or None."""
        at = start
        for at, code, body, whole in container.walk(data, start):
            if code == container.DATA_END and whole:
                return None
            if code == container.CHUNK:
                self._chunk(at, body, whole)
                self._release(data, at)
                yield
            elif code and whole:
                self._take(code, body)
            if not code or not whole:
                return at
        return max(at, len(data))

    def _release(self, data: mmap.mmap, at: int) -> None:
        """Give the memory of what was read back to the system, where it takes it."""
        behind = at - at % mmap.PAGESIZE
        if behind - self.released > _BEHIND and hasattr(data, 'madvise'):
            data.madvise(mmap.MADV_DONTNEED, self.released, behind - self.released)
            self.released = behind

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
        place = 0
        while place < len(records):
            place = self._messages(records, place)
            for _, code, content, complete in container.walk(records, place):
                if not (complete and code):
                    return
                self._take(code, content)
                place += container.FRONT_BYTES + len(content)
                break

    def _messages(self, records: bytes, at: int) -> int:
        """Take messages of known topics up to the first record that is none; its place."""
        counts = self.content.counts
        front, size = container.MESSAGE_FRONT, len(records)
        while size - at >= front.size:
            code, length, number, _, log_ns, _ = front.unpack_from(records, at)
            topic = self.topics.get(number)
            end = at + container.FRONT_BYTES + length
            if code != container.MESSAGE or topic is None or not at + front.size <= end <= size:
                break
            counts[topic[0]] += 1
            if topic[1] is not None:
                topic[1](log_ns, records[at + front.size : end])
            at = end
        return at

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
                if channel.schema in self.schemas:
                    name = self.schemas[channel.schema].name
                    self.content.announced[channel.topic] = name
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
        name, take = topic
        self.content.counts[name] += 1
        if take is not None:
            take(log_ns, data)

    def _topic(self, number: int) -> tuple[str, Taker | None] | None:
        """Name of a channel's topic, and who takes its messages."""
        channel = self.channels.get(number)
        schema = self.schemas.get(channel.schema) if channel else None
        if channel is None or schema is None:
            return None
        name, type_name = channel.topic, schema.name
        self.content.types[name] = type_name
        if channel.encoding != 'cdr':
            self.content.problems.append(f'{name} is encoded as {channel.encoding!r}; left out')
            return name, None
        if schema.encoding == 'ros2msg':
            self.content.texts[type_name] = schema.text
        return name, self.taker(name, type_name)


def _places(data: mmap.mmap, summary: int) -> list[int]:
    """Places of the chunks by the index in the summary."""
    places = []
    for _, code, body, whole in container.walk(data, summary) if summary else ():
        if not whole:
            break
        if code == container.CHUNK_INDEX and len(body) >= 24:
            places.append(Cursor(body).numbers('<QQQ')[2])
    return sorted(places)


def _read_sqlite(
    file: Path, content: BagContent, taker: Callable[[str, str], Taker | None]
) -> Iterator[None]:
    """Read a storage file of rosbag2 in sqlite3, as far as it is whole."""
    count = 0
    try:
        with closing(sqlite3.connect(f'{file.resolve().as_uri()}?mode=ro', uri=True)) as base:
            told = list(base.execute('SELECT id, name, type FROM topics'))
            content.types.update({str(name): str(kind) for _, name, kind in told})
            topics = {n: (str(name), taker(str(name), str(kind))) for n, name, kind in told}
            rows = base.execute('SELECT topic_id, timestamp, data FROM messages ORDER BY id')
            for number, log_ns, data in rows:
                count += 1
                name, take = topics.get(number, ('', None))
                content.counts[name] += 1
                if take and isinstance(data, bytes) and isinstance(log_ns, int):
                    take(log_ns, data)
                if count % _ROWS == 0:
                    yield
    except sqlite3.Error as err:
        content.problems.append(f'{file.name} is damaged after {count} messages: {err}')
