"""Writer of rosbag2 bags (MCAP) that survive a kill at any moment.

Whole chunks reach the operating system within a tenth of a second of log time, types and topics as
soon as they are known, each with an end of file that the next one overwrites; `metadata.yaml`
stands from the start. What a killed process leaves is a whole MCAP file without index that lacks
at most the last chunk. A closed bag has its index, for `ros2 bag info` and `ros2 bag play` alike.
"""

from __future__ import annotations

import os
import struct
from pathlib import Path
from threading import RLock

from tactile_ros import __version__
from tactile_ros.errors import RecordingError
from tactile_ros.evaluation import container
from tactile_ros.evaluation.container import Channel, ChunkEntry, Schema
from tactile_ros.evaluation.definitions import schema_text
from tactile_ros.types import Closing

CHUNK_BYTES = 1 << 16
CHUNK_NS = 100_000_000
METADATA_NS = 5_000_000_000
_FOREVER = '{sec: 9223372036, nsec: 854775807}'


def qos_text(latched: bool) -> str:
    """Offered QoS of a topic in the form of rosbag2 metadata versions 4 to 8."""
    depth, durability = (1, 1) if latched else (1000, 2)
    return (
        f'- history: 1\n  depth: {depth}\n  reliability: 1\n  durability: {durability}\n'
        f'  deadline: {_FOREVER}\n  lifespan: {_FOREVER}\n  liveliness: 1\n'
        f'  liveliness_lease_duration: {_FOREVER}\n  avoid_ros_namespace_conventions: false\n'
    )


class _Topic:
    """A channel with the count and the pending index of its messages."""

    def __init__(self, channel: Channel, type_name: str, latched: bool) -> None:
        self.channel = channel
        self.type_name = type_name
        self.latched = latched
        self.count = 0
        self.pending: list[tuple[int, int]] = []


class BagWriter(Closing):
    """Writes serialised messages into a new rosbag2 folder; a context manager.

    Parameters
    ----------
    path : path-like
        Folder of the bag; it must not exist or be empty.

    Raises
    ------
    RecordingError
        If the folder holds something already or cannot be written.

    Notes
    -----
    MCAP version 0, rosbag2 metadata version 5 (readable from Humble on). Safe to call from several
    threads.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)
        self._topics: dict[str, _Topic] = {}
        self._schemas: dict[str, Schema] = {}
        self._chunks: list[ChunkEntry] = []
        self._records = bytearray()
        self._span = (0, 0)
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
        self._end = 0
        self._written_ns = 0
        library = f'tactile_ros {__version__}'
        self._append(container.MAGIC + container.header_record(library))
        self._write_metadata()

    @property
    def counts(self) -> dict[str, int]:
        """Messages written per topic."""
        return {name: topic.count for name, topic in self._topics.items()}

    def add_topic(self, topic: str, type_name: str, latched: bool = False) -> None:
        """Announce a topic; `write` does it by itself.

        Parameters
        ----------
        topic, type_name : str
            Such as '/finger/frame', 'tactile_ros/msg/TactileFrame'.
        latched : bool
            Offered as transient local, so that `ros2 bag play` repeats it to late subscribers.
        """
        with self._lock:
            if topic in self._topics:
                return
            if type_name not in self._schemas:
                number = len(self._schemas) + 1
                schema = Schema(number, type_name, 'ros2msg', schema_text(type_name))
                self._append(container.schema_record(schema))
                self._schemas[type_name] = schema
            schema_number = self._schemas[type_name].number
            channel = Channel(len(self._topics) + 1, schema_number, topic, 'cdr')
            added = {'offered_qos_profiles': qos_text(latched)}
            self._append(container.channel_record(channel, added))
            self._topics[topic] = _Topic(channel, type_name, latched)
            self._write_metadata()

    def write(
        self, topic: str, type_name: str, stamp_ns: int, data: bytes, latched: bool = False
    ) -> None:
        """Take one message in.

        Parameters
        ----------
        topic, type_name : str
            Where it was heard and what it is.
        stamp_ns : int
            Log time: when it was received (ns); latency is this minus the frame's stamp.
        data : bytes
            CDR, as the middleware serialises it.
        latched : bool
            As in `add_topic`; heeded at the first message of a topic.

        Raises
        ------
        RecordingError
            If the bag is closed or the disk is full.
        """
        with self._lock:
            if self._file.closed:
                msg = f'the bag {self.path} is closed'
                raise RecordingError(msg)
            if topic not in self._topics:
                self.add_topic(topic, type_name, latched)
            kept = self._topics[topic]
            stamp_ns = max(stamp_ns, 0)
            place = len(self._records)
            start, end = self._span if place else (stamp_ns, stamp_ns)
            self._span = (min(start, stamp_ns), max(end, stamp_ns))
            kept.pending.append((stamp_ns, place))
            self._records += container.message_record(
                kept.channel.number, kept.count, stamp_ns, data
            )
            kept.count += 1
            if len(self._records) >= CHUNK_BYTES or self._span[1] - self._span[0] >= CHUNK_NS:
                self.flush()

    def flush(self) -> None:
        """Hand everything taken in to the operating system."""
        with self._lock:
            if not self._records or self._file.closed:
                return
            chunk = container.chunk_record(*self._span, bytes(self._records))
            place = self._end
            data, indexes = chunk, {}
            for topic in self._topics.values():
                if topic.pending:
                    number = topic.channel.number
                    indexes[number] = place + len(data)
                    data += container.message_index_record(number, topic.pending)
            entry = ChunkEntry(
                *self._span, place, len(chunk), len(self._records), indexes, len(data) - len(chunk)
            )
            self._append(data)
            self._chunks.append(entry)
            self._records = bytearray()
            for topic in self._topics.values():
                topic.pending = []
            if abs(entry.end_ns - self._written_ns) > METADATA_NS:
                self._written_ns = entry.end_ns
                self._write_metadata()

    def close(self) -> None:
        """Write the index and the final metadata; later calls do nothing."""
        with self._lock:
            if self._file.closed:
                return
            self.flush()
            self._write_metadata()
            self._append(self._summary(), tail=b'')
            self._file.close()

    def _append(self, data: bytes, tail: bytes = container.TAIL) -> None:
        """Write at the end of what is whole, over the last tail or an interrupted write."""
        self._file.seek(self._end)
        view = memoryview(data + tail)
        try:
            while view:
                view = view[self._file.write(view) :]
        except OSError as err:
            msg = f'the bag {self.path} cannot grow: {err.strerror}'
            raise RecordingError(msg) from err
        self._end += len(data)

    def _summary(self) -> bytes:
        """Metadata record, end of the data, repeated types and topics, indexes and footer."""
        document = {'serialized_metadata': self._metadata()}
        body = container.text('rosbag2') + container.string_map(document)
        metadata = container.record(container.METADATA, body)
        start = self._end + len(metadata) + len(container.DATA_END_RECORD)
        counts = {topic.channel.number: topic.count for topic in self._topics.values()}
        place = struct.pack('<QQ', self._end, len(metadata)) + container.text('rosbag2')
        groups = [
            [container.schema_record(schema) for schema in self._schemas.values()],
            [
                container.channel_record(t.channel, {'offered_qos_profiles': qos_text(t.latched)})
                for t in self._topics.values()
            ],
            [container.statistics_record(counts, len(self._schemas), self._chunks)],
            [container.chunk_index_record(entry) for entry in self._chunks],
            [container.record(container.METADATA_INDEX, place)],
        ]
        return metadata + container.DATA_END_RECORD + _indexed(groups, start)

    def _metadata(self) -> str:
        """Text of metadata.yaml with what is known now."""
        start = min((chunk.start_ns for chunk in self._chunks), default=0)
        end = max((chunk.end_ns for chunk in self._chunks), default=start)
        total = sum(topic.count for topic in self._topics.values())
        name = f'{self.path.name}_0.mcap'
        topics = ''.join(_topic_text(name, topic) for name, topic in self._topics.items())
        listed = f'\n{topics}' if topics else ' []\n'
        return (
            'rosbag2_bagfile_information:\n  version: 5\n  storage_identifier: mcap\n'
            f'  duration:\n    nanoseconds: {end - start}\n'
            f'  starting_time:\n    nanoseconds_since_epoch: {start}\n'
            f'  message_count: {total}\n  topics_with_message_count:{listed}'
            '  compression_format: ""\n  compression_mode: ""\n'
            f'  relative_file_paths:\n    - {_quoted(name)}\n'
            f'  files:\n    - path: {_quoted(name)}\n'
            f'      starting_time:\n        nanoseconds_since_epoch: {start}\n'
            f'      duration:\n        nanoseconds: {end - start}\n'
            f'      message_count: {total}\n'
        )

    def _write_metadata(self) -> None:
        """Replace metadata.yaml in one step, so that a kill leaves the old or the new one."""
        fresh = self.path / '.metadata.yaml'
        fresh.write_text(self._metadata(), encoding='utf-8')
        fresh.replace(self.path / 'metadata.yaml')


def _quoted(name: str) -> str:
    """Double-quoted YAML scalar."""
    return '"' + name.replace('\\', '\\\\').replace('"', '\\"').replace('\n', '\\n') + '"'


def _topic_text(name: str, topic: _Topic) -> str:
    """One topic in metadata.yaml."""
    qos = _quoted(qos_text(topic.latched))
    return (
        f'    - topic_metadata:\n        name: {_quoted(name)}\n'
        f'        type: {_quoted(topic.type_name)}\n        serialization_format: cdr\n'
        f'        offered_qos_profiles: {qos}\n      message_count: {topic.count}\n'
    )


def _indexed(groups: list[list[bytes]], start: int) -> bytes:
    """Groups of records of the summary, the offsets of the groups, and the footer."""
    data, offsets = b'', b''
    for group in groups:
        if group:
            body = b''.join(group)
            place = struct.pack('<BQQ', group[0][0], start + len(data), len(body))
            offsets += container.record(container.SUMMARY_OFFSET, place)
            data += body
    return data + offsets + container.footer_record(start, start + len(data)) + container.MAGIC
