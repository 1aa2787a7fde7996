from __future__ import annotations

import os
import signal
import sqlite3
import subprocess
import sys
import textwrap
import zlib
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

from tactile_ros.errors import RecordingError
from tactile_ros.evaluation import container
from tactile_ros.evaluation.bag import BagWriter
from tactile_ros.evaluation.bag_reader import Message, read_bag
from tactile_ros.evaluation.definitions import definition, message_folder, schema_text

if TYPE_CHECKING:
    from collections.abc import Callable
    from types import SimpleNamespace

    WriteBag = Callable[..., Path]

STRING = 'std_msgs/msg/String'


def open_by_rosbags(path: Path) -> object:
    highlevel = pytest.importorskip('rosbags.highlevel')
    from rosbags.typesys import Stores, get_typestore

    return highlevel.AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE))


def test_rosbags_reads_every_message_type_and_latched_topic_of_a_closed_bag(
    write_bag: WriteBag, tmp_path: Path
) -> None:
    path = write_bag(tmp_path / 'bag')
    with open_by_rosbags(path) as reader:
        kinds = {c.topic: c for c in reader.connections}
        assert reader.message_count == 153
        sequences = [
            reader.deserialize(raw, c.msgtype).sequence
            for c, _, raw in reader.messages([kinds['/frame']])
        ]
        durability = {t: c.ext.offered_qos_profiles[0].durability.value for t, c in kinds.items()}
    assert sequences == list(range(50))
    assert {t for t, d in durability.items() if d == 1} == {'/layout', '/baseline', '/calibration'}


def test_the_reference_library_agrees_with_index_checksums_and_statistics(
    write_bag: WriteBag, tmp_path: Path
) -> None:
    reference = pytest.importorskip('mcap.reader')
    path = write_bag(tmp_path / 'bag')
    with (path / 'bag_0.mcap').open('rb') as file:
        reader = reference.make_reader(file, validate_crcs=True)
        summary = reader.get_summary()
        found = [(c.topic, m.log_time, m.data) for _, c, m in reader.iter_messages()]
        names = [m.name for m in reader.iter_metadata()]
    ours = read_bag(path)
    assert names == ['rosbag2']
    assert summary.statistics.message_count == len(found) == len(ours.messages) == 153
    assert sorted(found) == sorted((t, ns, data) for t, _, ns, data in ours.messages)
    assert all(schema.encoding == 'ros2msg' for schema in summary.schemas.values())
    assert ours.problems == []


def test_metadata_names_counts_duration_and_qos_for_ros2_bag(
    write_bag: WriteBag, tmp_path: Path
) -> None:
    yaml = pytest.importorskip('yaml')
    path = write_bag(tmp_path / 'bag')
    info = yaml.safe_load((path / 'metadata.yaml').read_text())['rosbag2_bagfile_information']
    topics = {t['topic_metadata']['name']: t for t in info['topics_with_message_count']}
    assert info['message_count'] == 153
    assert info['duration']['nanoseconds'] == 493_000_000
    assert topics['/frame']['message_count'] == 50
    qos = yaml.safe_load(topics['/layout']['topic_metadata']['offered_qos_profiles'])[0]
    assert (qos['durability'], qos['depth'], qos['reliability']) == (1, 1, 1)


def test_a_killed_process_leaves_a_bag_that_others_read(tmp_path: Path) -> None:
    code = """
        import sys
        from tactile_ros.evaluation.bag import BagWriter
        bag = BagWriter(sys.argv[1])
        for k in range(10_000_000):
            bag.write('/text', 'std_msgs/msg/String', 10**9 + k * 10**6,
                      bytes([0, 1, 0, 0, 2, 0, 0, 0, 65, 0]))
            if k == 1000:
                print('ready', flush=True)
    """
    root = str(Path(__file__).resolve().parents[2])
    with subprocess.Popen(
        [sys.executable, '-c', textwrap.dedent(code), str(tmp_path / 'bag')],
        stdout=subprocess.PIPE,
        env={**os.environ, 'PYTHONPATH': root},
    ) as process:
        assert process.stdout.readline() == b'ready\n'
        process.send_signal(signal.SIGKILL)
        process.wait()
    content = read_bag(tmp_path / 'bag')
    assert content.counts['/text'] >= 900
    assert 'was not closed' in content.problems[0]
    with open_by_rosbags(tmp_path / 'bag') as reader:
        assert sum(1 for _ in reader.messages()) == content.counts['/text']


def test_an_interrupted_write_is_written_over(
    tmp_path: Path, make: SimpleNamespace, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = make.cdr(make.String(data='x' * 1000))
    bag = BagWriter(tmp_path / 'bag')
    bag.write('/text', STRING, 1, text)
    bag.flush()

    class Torn:
        """A file whose next write ends halfway in an interrupt."""

        closed = False

        def __init__(self, file: object) -> None:
            self.file = file

        def seek(self, place: int) -> int:
            return self.file.seek(place)

        def write(self, data: memoryview) -> int:
            self.file.write(data[: len(data) // 2])
            raise KeyboardInterrupt

    whole, bag._file = bag._file, Torn(bag._file)
    bag.write('/text', STRING, 2, text)
    with pytest.raises(KeyboardInterrupt):
        bag.flush()
    bag._file = whole
    bag.close()
    content = read_bag(tmp_path / 'bag')
    assert [m.log_ns for m in content.messages] == [1, 2]
    assert content.problems == []


def test_reading_a_bag_cut_at_any_byte_gives_a_prefix_and_names_the_cut(
    write_bag: WriteBag, tmp_path: Path
) -> None:
    path = write_bag(tmp_path / 'bag', n=30)
    data = (path / 'bag_0.mcap').read_bytes()
    whole = read_bag(path).messages
    cut = tmp_path / 'cut.mcap'
    longest = 0
    for size in [*range(0, 200, 7), *range(200, len(data), 311)]:
        cut.write_bytes(data[:size])
        content = read_bag(cut)
        assert content.messages == whole[: len(content.messages)]
        assert content.problems
        assert len(content.messages) >= longest
        longest = len(content.messages)
    assert longest == len(whole)


def test_bytes_hit_anywhere_never_raise_and_never_change_what_comes_out(
    write_bag: WriteBag, tmp_path: Path
) -> None:
    path = write_bag(tmp_path / 'bag', n=30)
    data = (path / 'bag_0.mcap').read_bytes()
    whole = set(read_bag(path).messages)
    hit = tmp_path / 'hit.mcap'
    rng = np.random.default_rng(3)
    chunk = data.index(b'\x06', 9)
    for place in rng.integers(chunk, len(data), 150):
        damaged = bytearray(data)
        damaged[place] ^= 1 << int(rng.integers(8))
        hit.write_bytes(damaged)
        content = read_bag(hit)
        told = {m for m in content.messages if (m.topic, m.type_name) in _topics(whole)}
        assert {m.data for m in told} <= {m.data for m in whole}


def _topics(messages: set[Message]) -> set[tuple[str, str]]:
    return {(m.topic, m.type_name) for m in messages}


def test_a_damaged_chunk_is_left_out_and_the_rest_is_read(
    tmp_path: Path, make: SimpleNamespace
) -> None:
    text = make.cdr(make.String(data='x'))
    with BagWriter(tmp_path / 'bag') as bag:
        for k in range(30):
            bag.write('/text', STRING, k, text)
            if k % 10 == 9:
                bag.flush()
    file = tmp_path / 'bag' / 'bag_0.mcap'
    data = bytearray(file.read_bytes())
    chunks = [at for at, code, _, _ in container.walk(bytes(data), 8) if code == container.CHUNK]
    data[chunks[1] + 80] ^= 0xFF
    file.write_bytes(data)
    content = read_bag(tmp_path / 'bag')
    assert [m.log_ns for m in content.messages] == [*range(10), *range(20, 30)]
    assert 'checksum' in content.problems[0]
    data[chunks[1]] = 0x7F  # now the framing itself is broken: the index leads on
    file.write_bytes(data)
    content = read_bag(tmp_path / 'bag')
    assert [m.log_ns for m in content.messages] == [*range(10), *range(20, 30)]
    assert f'going on at byte {chunks[2]}' in content.problems[0]


@pytest.mark.parametrize('compression', ['zstd', 'lz4'])
def test_compressed_chunks_are_read_also_when_cut(
    tmp_path: Path, make: SimpleNamespace, compression: str
) -> None:
    records = b''.join(
        container.message_record(1, k, k, make.cdr(make.String(data=f'{k}' * 40)))
        for k in range(100)
    )
    packed = _packed(compression, records)
    body = container.text(compression) + len(packed).to_bytes(8, 'little') + packed
    head = container._CHUNK.pack(0, 99, len(records), zlib.crc32(records))
    data = (
        container.MAGIC
        + container.header_record('test')
        + container.schema_record(container.Schema(1, STRING, 'ros2msg', 'string data'))
        + container.channel_record(container.Channel(1, 1, '/text', 'cdr'), {})
        + container.record(container.CHUNK, head + body)
    )
    file = tmp_path / 'bag.mcap'
    file.write_bytes(data + container.TAIL)
    assert len(read_bag(file).messages) == 100
    file.write_bytes(data[:-20])
    cut = read_bag(file)
    assert cut.problems
    assert all(len(m.data) > 8 for m in cut.messages)


def _packed(compression: str, records: bytes) -> bytes:
    if compression == 'zstd':
        return pytest.importorskip('zstandard').ZstdCompressor().compress(records)
    return pytest.importorskip('lz4.frame').compress(records)


def test_a_chunk_that_claims_too_much_is_named_and_skipped(tmp_path: Path) -> None:
    bomb = container._CHUNK.pack(0, 1, 1 << 40, 0) + container.text('zstd') + bytes(8) + b'junk'
    file = tmp_path / 'bomb.mcap'
    file.write_bytes(container.MAGIC + container.record(container.CHUNK, bomb) + container.TAIL)
    content = read_bag(file)
    assert content.messages == []
    assert any('claims 1099511627776 bytes' in problem for problem in content.problems)


def test_sqlite3_bags_are_read_and_a_damaged_one_as_far_as_it_goes(
    tmp_path: Path, make: SimpleNamespace
) -> None:
    text = make.cdr(make.String(data='x' * 300))
    file = tmp_path / 'bag' / 'bag_0.db3'
    file.parent.mkdir()
    with sqlite3.connect(file) as base:
        base.execute('CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT)')
        base.execute(
            'CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER,'
            ' data BLOB)'
        )
        base.execute('INSERT INTO topics VALUES (1, "/text", ?)', (STRING,))
        rows = [(k, 1, 1000 + k, text) for k in range(200)]
        base.executemany('INSERT INTO messages VALUES (?, ?, ?, ?)', rows)
    base.close()
    content = read_bag(file.parent)
    assert [m.log_ns for m in content.messages] == list(range(1000, 1200))
    assert content.problems == ['metadata.yaml of the bag is missing; its files were read anyway']
    data = bytearray(file.read_bytes())
    data[40_000:44_096] = bytes(4096)
    file.write_bytes(data)
    damaged = read_bag(file)
    assert len(damaged.messages) < 200
    assert 'is damaged after' in damaged.problems[0]


def test_a_bag_that_rosbags_wrote_is_read(tmp_path: Path, make: SimpleNamespace) -> None:
    rosbag2 = pytest.importorskip('rosbags.rosbag2')
    text = make.cdr(make.String(data='x'))
    for plugin in (rosbag2.StoragePlugin.MCAP, rosbag2.StoragePlugin.SQLITE3):
        path = tmp_path / plugin.name
        with rosbag2.Writer(path, version=9, storage_plugin=plugin) as writer:
            connection = writer.add_connection('/text', STRING, typestore=make.store)
            for k in range(5):
                writer.write(connection, k, text)
        content = read_bag(path)
        assert [m.log_ns for m in content.messages] == list(range(5))
        assert content.problems == []


def test_missing_files_and_folders_without_a_bag_are_named(
    tmp_path: Path, write_bag: WriteBag
) -> None:
    with pytest.raises(RecordingError, match='holds no bag'):
        read_bag(tmp_path)
    other = tmp_path / 'notes.txt'
    other.write_text('hello')
    with pytest.raises(RecordingError, match='is no bag'):
        read_bag(other)
    path = write_bag(tmp_path / 'bag', n=3)
    (path / 'bag_0.mcap').rename(path / 'other.mcap')
    assert 'bag_0.mcap of the bag is missing' in read_bag(path).problems


def test_a_bag_never_writes_over_another(tmp_path: Path, write_bag: WriteBag) -> None:
    write_bag(tmp_path / 'bag', n=3)
    with pytest.raises(RecordingError, match='not empty'):
        BagWriter(tmp_path / 'bag')
    closed = BagWriter(tmp_path / 'new')
    closed.close()
    with pytest.raises(RecordingError, match='is closed'):
        closed.write('/text', STRING, 0, b'')


def test_schema_texts_hold_every_needed_type_once() -> None:
    text = schema_text('tactile_ros/msg/TactileContacts')
    assert text.startswith(definition('tactile_ros/msg/TactileContacts').rstrip())
    needed = [line[5:] for line in text.splitlines() if line.startswith('MSG: ')]
    assert sorted(needed) == [
        'builtin_interfaces/Time',
        'geometry_msgs/Point',
        'geometry_msgs/Vector3',
        'geometry_msgs/Wrench',
        'std_msgs/Header',
        'tactile_ros/TactileContact',
    ]


def test_standard_definitions_come_without_a_ros_installation(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    pytest.importorskip('rosbags')
    definition.cache_clear()
    monkeypatch.setattr(sys, 'prefix', str(tmp_path))
    monkeypatch.delenv('AMENT_PREFIX_PATH', raising=False)
    assert 'string frame_id' in definition('std_msgs/msg/Header')
    assert (message_folder() / 'TactileFrame.msg').is_file()
    definition.cache_clear()


def test_definitions_are_found_in_the_share_of_an_installation(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    from tactile_ros.evaluation import definitions

    share = tmp_path / 'share' / 'tactile_ros' / 'msg'
    share.mkdir(parents=True)
    (share / 'TactileFrame.msg').write_text('uint64 sequence\n')
    room = tmp_path / 'lib' / 'python3.12' / 'site-packages' / 'tactile_ros' / 'evaluation'
    monkeypatch.setattr(definitions, '__file__', str(room / 'definitions.py'))
    assert message_folder() == share
    monkeypatch.setattr(definitions, '__file__', '/nowhere/a/b/definitions.py')
    monkeypatch.setenv('AMENT_PREFIX_PATH', str(tmp_path))
    assert message_folder() == share
    monkeypatch.delenv('AMENT_PREFIX_PATH')
    monkeypatch.setattr(sys, 'prefix', '/nowhere')
    with pytest.raises(RecordingError, match='were not found'):
        message_folder()
