# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
import io
import json
import os
import signal
import sqlite3
import struct
import subprocess
import sys
import textwrap
import time
from contextlib import closing
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import yaml
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from reference import made_bags as make
from reference.made_bags import read_all
from tactile_ros.errors import RecordingError
from tactile_ros.evaluation import bag as bags
from tactile_ros.evaluation.bag import BagWriter, message_folder, records, schema_text, type_hash

STRING = 'std_msgs/msg/String'


def open_by_rosbags(path: Path) -> object:
    return AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE))


def test_closed_bag_is_read_by_rosbags_by_mcap_and_by_its_metadata(tmp_path: Path) -> None:
    path = make.write_bag(tmp_path / 'bag')
    with open_by_rosbags(path) as reader:
        kinds = {c.topic: c for c in reader.connections}
        assert reader.message_count == 153
        raw = reader.messages([kinds['/frame']])
        sequences = [reader.deserialize(data, c.msgtype).sequence for c, _, data in raw]
        durability = {t: c.ext.offered_qos_profiles[0].durability.value for t, c in kinds.items()}
    assert sequences == list(range(50))
    assert {t for t, d in durability.items() if d == 1} == {'/layout', '/baseline', '/calibration'}
    with (path / 'bag_0.mcap').open('rb') as file:
        reader = make_reader(file, validate_crcs=True)
        summary = reader.get_summary()
        stored = [(c.topic, m.log_time, m.data) for _, c, m in reader.iter_messages()]
        assert [m.name for m in reader.iter_metadata()] == ['rosbag2']
    ours = read_all(path)
    assert summary.statistics.message_count == len(stored) == len(ours.messages) == 153
    assert sorted(stored) == sorted((t, ns, data) for t, _, ns, data in ours.messages)
    assert all(schema.encoding == 'ros2msg' for schema in summary.schemas.values())
    assert ours.problems == []
    info = yaml.safe_load((path / 'metadata.yaml').read_text())['rosbag2_bagfile_information']
    topics = {t['topic_metadata']['name']: t for t in info['topics_with_message_count']}
    assert (info['message_count'], info['duration']['nanoseconds']) == (153, 493_000_000)
    assert info['version'] >= 7  # rosbag2 reads no hash of a type before
    assert topics['/frame']['message_count'] == 50
    qos = yaml.safe_load(topics['/layout']['topic_metadata']['offered_qos_profiles'])[0]
    assert (qos['durability'], qos['depth'], qos['reliability']) == (1, 1, 1)
    channels = {channel.topic: channel.metadata for channel in summary.channels.values()}
    for name, topic in topics.items():
        stored_hash = topic['topic_metadata']['type_description_hash']
        assert channels[name]['topic_type_hash'] == stored_hash != ''


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
    content = read_all(tmp_path / 'bag')
    assert content.counts['/text'] >= 900
    assert 'was not closed' in content.problems[0]
    with open_by_rosbags(tmp_path / 'bag') as reader:
        assert sum(1 for _ in reader.messages()) == content.counts['/text']


def test_an_interrupted_write_is_written_over(tmp_path: Path) -> None:
    text = make.cdr(make.new('String', data='x' * 1000))
    bag = BagWriter(tmp_path / 'bag')
    bag.write('/text', STRING, 1, text)
    bag.flush()

    whole = bag._file

    def torn(data: memoryview) -> int:
        whole.write(data[: len(data) // 2])
        raise KeyboardInterrupt

    bag._file = SimpleNamespace(closed=False, seek=whole.seek, write=torn)
    bag.write('/text', STRING, 2, text)
    with pytest.raises(KeyboardInterrupt):
        bag.flush()
    bag._file = whole
    bag.close()
    content = read_all(tmp_path / 'bag')
    assert [m.log_ns for m in content.messages] == [1, 2]
    assert content.problems == []


def test_bytes_hit_anywhere_never_raise_and_never_change_what_comes_out(tmp_path: Path) -> None:
    path = make.write_bag(tmp_path / 'bag', n=30)
    data = (path / 'bag_0.mcap').read_bytes()
    whole = set(read_all(path).messages)
    topics = {(m.topic, m.type_name) for m in whole}
    hit = tmp_path / 'hit.mcap'
    rng = np.random.default_rng(3)
    chunk = data.index(b'\x06', 9)
    for place in rng.integers(chunk, len(data), 150):
        damaged = bytearray(data)
        damaged[place] ^= 1 << int(rng.integers(8))
        hit.write_bytes(damaged)
        content = read_all(hit)
        known = {m for m in content.messages if (m.topic, m.type_name) in topics}
        assert {m.data for m in known} <= {m.data for m in whole}


def test_a_damaged_chunk_is_left_out_and_the_rest_is_read(tmp_path: Path) -> None:
    text = make.cdr(make.new('String', data='x'))
    with BagWriter(tmp_path / 'bag') as bag:
        for k in range(30):
            bag.write('/text', STRING, k, text)
            if k % 10 == 9:
                bag.flush()
    file = tmp_path / 'bag' / 'bag_0.mcap'
    data = bytearray(file.read_bytes())
    walk = records(io.BytesIO(data), 8, len(data))
    chunks = [record.at for record in walk if record.code == bags.CHUNK]
    data[chunks[1] + 80] ^= 0xFF
    file.write_bytes(data)
    content = read_all(tmp_path / 'bag')
    assert [m.log_ns for m in content.messages] == [*range(10), *range(20, 30)]
    assert 'checksum' in content.problems[0]
    data[chunks[1]] = 0x7F  # now the framing itself is broken: the index leads on
    file.write_bytes(data)
    content = read_all(tmp_path / 'bag')
    assert [m.log_ns for m in content.messages] == [*range(10), *range(20, 30)]
    assert f'going on at byte {chunks[2]}' in content.problems[0]


def test_an_index_of_many_places_without_a_chunk_costs_little(tmp_path: Path) -> None:
    file, count = tmp_path / 'bag.mcap', 20_000
    padding = bytes(count)
    entries = b''.join(
        bags.HEAD.pack(bags.CHUNK_INDEX, 56) + struct.pack('<3Q32x', 0, 0, 9 + place)
        for place in range(count)
    )
    footer = bags.HEAD.pack(bags.FOOTER, 20) + struct.pack('<QQI', 8 + count, 0, 0)
    file.write_bytes(bags.MAGIC + padding + entries + footer + bags.MAGIC)
    began = time.process_time()
    content = read_all(file)
    assert time.process_time() - began < 5.0
    assert content.messages == []
    assert 'is damaged at byte 8; going on at byte 9' in content.problems[0]


@pytest.mark.parametrize('compression', ['ZSTD', 'LZ4'])
def test_compressed_chunks_are_read_also_when_cut(tmp_path: Path, compression: str) -> None:
    file = tmp_path / 'bag.mcap'
    with file.open('wb') as opened:
        writer = Writer(opened, chunk_size=4000, compression=CompressionType[compression])
        writer.start('ros2', 'test')
        schema = writer.register_schema(STRING, 'ros2msg', b'string data')
        channel = writer.register_channel('/text', 'cdr', schema)
        for k in range(100):
            writer.add_message(channel, k, make.cdr(make.new('String', data=f'{k}' * 40)), k)
        writer.finish()
    whole = read_all(file).messages
    assert len(whole) == 100
    data = file.read_bytes()
    places = [r.at for r in records(io.BytesIO(data), 8, len(data)) if r.code == bags.CHUNK]
    file.write_bytes(data[: places[-1] + 200])
    cut = read_all(file)
    assert cut.problems
    assert 50 < len(cut.messages) < 100
    assert cut.messages == whole[: len(cut.messages)]


def test_a_chunk_that_claims_too_much_is_named_and_skipped(tmp_path: Path) -> None:
    bomb = struct.pack('<QQQI', 0, 1, 1 << 40, 0) + b'\4\0\0\0zstd' + bytes(8) + b'junk'
    chunk = struct.pack('<BQ', bags.CHUNK, len(bomb)) + bomb
    file = tmp_path / 'bomb.mcap'
    file.write_bytes(bags.MAGIC + chunk + bags.TAIL)
    content = read_all(file)
    assert content.messages == []
    assert any('claims 1099511627776 bytes' in problem for problem in content.problems)


def test_files_are_listed_as_yaml_writes_them(tmp_path: Path) -> None:
    path = tmp_path / 'my b\u00e1g'  # yaml escapes it
    with BagWriter(path):
        pass
    metadata = path / 'metadata.yaml'
    assert '\\xE1' in metadata.read_text()
    assert read_all(path).problems == []
    metadata.write_text(metadata.read_text().replace('_0.mcap', '_1.mcap'))
    assert read_all(path).problems == ['my b\u00e1g_1.mcap of the bag is missing']
    metadata.write_text('[' * 9999)
    assert read_all(path).problems == ['metadata.yaml of the bag names no files; all were read']


def test_sqlite3_bags_are_read_and_a_damaged_one_as_far_as_it_goes(tmp_path: Path) -> None:
    text = make.cdr(make.new('String', data='x' * 300))
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
    content = read_all(file.parent)
    assert [m.log_ns for m in content.messages] == list(range(1000, 1200))
    assert content.problems == ['metadata.yaml of the bag is missing; its files were read anyway']
    data = bytearray(file.read_bytes())
    data[40_000:44_096] = bytes(4096)
    file.write_bytes(data)
    damaged = read_all(file)
    assert len(damaged.messages) < 200
    assert 'is damaged after' in damaged.problems[0]


ENDLESS = (
    'AS WITH RECURSIVE t(id) AS (SELECT 1 UNION ALL SELECT id + 1 FROM t) '
    "SELECT id, 1 AS topic_id, id AS timestamp, '/x' AS name, 'y' AS type, x'00' AS data FROM t"
)


@pytest.mark.parametrize(
    ('tables', 'said'),
    [
        (f'CREATE TABLE topics(id, name, type); CREATE VIEW messages {ENDLESS}', 'no table'),
        (f'CREATE VIEW topics {ENDLESS}; CREATE TABLE messages(id)', 'topics that is no table'),
        ('CREATE TABLE topics(id, name, type); CREATE TABLE messages(id, topic_id, timestamp, '
         'data GENERATED ALWAYS AS (zeroblob(900000000)))', 'computed columns in messages'),
    ],
)  # fmt: skip
def test_sqlite3_rows_that_are_made_up_are_not_read(
    tmp_path: Path, tables: str, said: str
) -> None:
    with closing(sqlite3.connect(tmp_path / 'bag.db3')) as base:
        base.executescript(tables)
    content = read_all(tmp_path / 'bag.db3')
    assert content.messages == []
    assert said in content.problems[0]


def test_wrong_files_folders_and_types_are_named_and_nothing_is_written_over(
    tmp_path: Path,
) -> None:
    with pytest.raises(RecordingError, match='holds no bag'):
        read_all(tmp_path)
    other = tmp_path / 'notes.txt'
    other.write_text('hello')
    with pytest.raises(RecordingError, match='is no bag'):
        read_all(other)
    path = make.write_bag(tmp_path / 'bag', n=3)
    os.mkfifo(path / 'pipe.db3')
    assert 'pipe.db3 is no file' in read_all(path).problems
    (path / 'bag_0.mcap').rename(path / 'other.mcap')
    assert 'bag_0.mcap of the bag is missing' in read_all(path).problems
    with pytest.raises(RecordingError, match='not empty'):
        BagWriter(path)
    closed = BagWriter(tmp_path / 'new')
    closed.close()
    with pytest.raises(RecordingError, match='is closed'):
        closed.write('/text', STRING, 0, b'')
    with pytest.raises(RecordingError, match='no_msgs/msg/None'):
        schema_text('no_msgs/msg/None')
    (tmp_path / 'junk.mcap').write_bytes(b'hello')
    assert 'does not begin like an MCAP file' in read_all(tmp_path / 'junk.mcap').problems[0]


def test_type_hash_is_that_of_the_generated_interface() -> None:
    share = Path(__file__).parents[2] / 'install/tactile_ros/share/tactile_ros/msg'
    for path in sorted(share.glob('*.json')):
        for entry in json.loads(path.read_text())['type_hashes']:
            if entry['type_name'] in bags.all_types().fielddefs:
                assert type_hash(entry['type_name']) == entry['hash_string']
    assert type_hash('std_msgs/msg/String').startswith('RIHS01_df668c740482bbd4')
    assert type_hash('other_msgs/msg/Unknown') == ''


def test_definitions_are_found_in_the_share_of_an_installation(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    share = tmp_path / 'share' / 'tactile_ros' / 'msg'
    share.mkdir(parents=True)
    (share / 'TactileFrame.msg').write_text('uint64 sequence\n')
    room = tmp_path / 'lib' / 'python3.12' / 'site-packages' / 'tactile_ros' / 'evaluation'
    monkeypatch.setattr(bags, '__file__', str(room / 'bag.py'))
    assert message_folder() == share
    monkeypatch.setattr(bags, '__file__', '/nowhere/a/b/bag.py')
    monkeypatch.setenv('AMENT_PREFIX_PATH', str(tmp_path))
    assert message_folder() == share
    monkeypatch.delenv('AMENT_PREFIX_PATH')
    monkeypatch.setattr(sys, 'prefix', '/nowhere')
    with pytest.raises(RecordingError, match='were not found'):
        message_folder()
