# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Checks of bags, and repair of those that were cut at any byte.

`TACTILE_BAG_CUTS=10000` tries so many cuts, which takes minutes.
"""

import os
import shutil
import sqlite3
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as RosbagsWriter
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from reference import made_bags as make
from reference.made_bags import read_all
from tactile_ros.errors import RecordingError, TactileError
from tactile_ros.evaluation.bag import BagWriter
from tactile_ros.evaluation.bag_check import BagCheck, check_bag, repair_bag
from tactile_ros.sensors import load_sensor

STEP_NS = 10_000_000
START_NS = 1_000_000_000
OWN = 'other_msgs/msg/Pair'
CUTS = int(os.environ.get('TACTILE_BAG_CUTS', '100'))


def frames_of(
    path: Path, rows: list[tuple[int, int]], values: np.ndarray | None = None
) -> BagCheck:
    """Check of a bag with frames of such sequence and time (steps)."""
    rng = np.random.default_rng(1)
    with make.Bag(path) as bag:
        bag.put('/finger/layout', make.layout(), START_NS, latched=True)
        for k, (sequence, step) in enumerate(rows):
            given = rng.normal(0.0, 1e-5, 15) if values is None else values[k]
            stamp = START_NS + step * STEP_NS
            bag.put('/finger/frame', make.frame(sequence, given, stamp), stamp)
    return check_bag(path)


def test_check_of_a_whole_bag_finds_topics_and_nothing_wrong(tmp_path: Path) -> None:
    check = check_bag(make.write_bag(tmp_path / 'bag'))
    assert check.damage == check.left_out == check.unused == ()
    frame = check.topics['/frame']
    assert (frame.messages, frame.schema) == (50, 'as here')
    assert frame.rate_hz == pytest.approx(100.0)
    assert frame.pause_ns == STEP_NS
    assert check.topics['/calibration'].schema == 'in the bag'
    assert np.isnan(check.topics['/layout'].rate_hz)
    one = check.sensors['']
    assert (one.frames, one.repeats, one.restarts) == (50, 0, 0)
    assert len(one.lost) == len(one.jumps) == 0
    assert one.period_s == pytest.approx(0.01)
    assert (one.dead, one.problems) == ({}, ())


def test_check_counts_gaps_repeats_restarts_and_jumps_of_stamps(tmp_path: Path) -> None:
    rows = [(k, k) for k in range(20)]
    rows[10:12] = []  # two frames lost
    rows += [(19, 19), *((k, k + 7) for k in range(20, 30)), *((k, k + 40) for k in range(10))]
    rows += [(10, 45), (11, 51)]  # the clock goes back, and forth again
    one = frames_of(tmp_path / 'made', rows).sensors['/finger']
    assert one.lost.tolist() == [2]
    assert (one.frames, one.repeats, one.restarts) == (len(rows), 1, 1)
    assert one.jumps.tolist() == pytest.approx([0.07, -0.05, 0.05])


def test_check_names_dead_taxels_unless_all_readings_are_coarse(tmp_path: Path) -> None:
    rng = np.random.default_rng(2)
    values = rng.normal(0.0, 1e-5, (60, 5, 3))
    values[:, 1] = 3e-5  # stands still
    values[:, 2] = np.nan
    values[:40, 3] = 0.0  # no chip reads that
    rows = [(k, k) for k in range(60)]
    assert frames_of(tmp_path / 'made', rows, values).sensors['/finger'].dead == pytest.approx(
        {1: 1.0, 2: 1.0, 3: 2 / 3}
    )
    still = np.full((60, 5, 3), 3e-5)
    assert frames_of(tmp_path / 'coarse', rows, still).sensors['/finger'].dead == {}


def test_check_of_a_type_of_another_version_names_it(tmp_path: Path) -> None:
    with BagWriter(tmp_path / 'made') as bag:
        kind = 'tactile_ros/msg/TactileFrame'
        bag.add_topic('/frame', kind, text='uint8 other\n')
        bag.write('/frame', kind, 1, make.cdr(make.new('String', data='x')))
        bag.add_topic('/odd', 'tactile_ros/msg/../../Odd', text='uint8 other\n')
        bag.write('/odd', 'tactile_ros/msg/../../Odd', 1, b'')
    check = check_bag(tmp_path / 'made')
    assert check.topics['/frame'].schema == 'another version'
    assert check.topics['/odd'].schema == 'another version'
    assert 'of another version; left out' in check.damage[0]


def test_a_message_later_than_any_clock_is_left_out(tmp_path: Path) -> None:
    with make.Bag(tmp_path / 'made') as bag:
        bag.put('/layout', make.layout())
        for log_ns in (START_NS, 1 << 63):
            bag.put('/frame', make.frame(0, np.zeros(15), START_NS), log_ns)
    check = check_bag(tmp_path / 'made')
    assert check.sensors[''].frames == 1
    assert 'at times that no clock shows (1 records left out)' in check.damage[0]


def test_repair_of_a_bag_cut_at_any_byte_is_a_closed_bag_that_others_read(tmp_path: Path) -> None:
    real = load_sensor('reskin_board').recordings()['spatial'].values
    with make.Bag(tmp_path / 'made') as bag:
        bag.put('/finger/layout', make.layout(), START_NS, latched=True)
        for k in range(12):
            stamp = START_NS + k * STEP_NS
            bag.put('/finger/frame', make.frame(k, real[k], stamp), stamp)
            if k % 3 == 2:
                bag.flush()
    data = (tmp_path / 'made' / 'made_0.mcap').read_bytes()
    whole = read_all(tmp_path / 'made').messages
    torn, out, opened, counts = tmp_path / 'torn.mcap', tmp_path / 'out', set(), []
    for size in np.linspace(0, len(data) - 1, CUTS).astype(int).tolist():
        torn.write_bytes(data[:size])
        try:
            counts.append(repair_bag(torn, out).counts.total())
        except RecordingError:  # nothing could be saved
            assert sorted(tmp_path.iterdir()) == [tmp_path / 'made', torn]
            counts.append(0)
            continue
        saved = (out / 'out_0.mcap').read_bytes(), (out / 'metadata.yaml').read_bytes()
        if saved not in opened:  # the same files are read alike
            opened.add(saved)
            found = read_all(out)
            assert (found.messages, found.problems) == (whole[: counts[-1]], [])
            assert others_count(out) == (counts[-1], counts[-1])
        shutil.rmtree(out)
    assert counts == sorted(counts)  # a longer file saves no less
    assert set(counts) >= {0, 1, 4, 7, 10, 13}
    assert len(opened) == len(set(counts) - {0})


def others_count(path: Path) -> tuple[int, int]:
    """Messages of a closed bag, as mcap and rosbags read them."""
    with (path / f'{path.name}_0.mcap').open('rb') as file:
        reader = make_reader(file, validate_crcs=True)
        by_mcap = sum(1 for _ in reader.iter_messages())
        assert reader.get_summary().statistics.message_count == by_mcap
    with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
        return by_mcap, sum(1 for _ in reader.messages())


@pytest.mark.parametrize('plugin', [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
def test_repair_keeps_definitions_of_others_and_latched_topics(
    plugin: StoragePlugin, tmp_path: Path
) -> None:
    types = get_typestore(Stores.ROS2_HUMBLE)
    types.register(get_types_from_msg('float64 one\nfloat64 two\n', OWN))
    with RosbagsWriter(tmp_path / 'bag', version=9, storage_plugin=plugin) as writer:
        place = writer.add_connection('/pair', OWN, typestore=types)
        text = writer.add_connection('/text', 'std_msgs/msg/String', typestore=types)
        pair = types.types[OWN](one=1.0, two=2.0)
        writer.write(place, 5, types.serialize_cdr(pair, OWN))
        writer.write(text, 6, make.cdr(make.new('String', data='x')))
    saved = repair_bag(tmp_path / 'bag', tmp_path / 'saved')
    assert (saved.counts, saved.problems) == ({'/pair': 1, '/text': 1}, [])
    with AnyReader([tmp_path / 'saved']) as reader:
        ((connection, _, data), _) = reader.messages()
        assert reader.deserialize(data, connection.msgtype).two == 2.0
    with make.Bag(tmp_path / 'ours') as bag:
        bag.put('/text', make.new('String', data='x'), 1, latched=True)
    repair_bag(tmp_path / 'ours', tmp_path / 'again')
    assert read_all(tmp_path / 'again').latched == {'/text'}


def test_repair_leaves_out_types_that_nobody_defines(tmp_path: Path) -> None:
    file = tmp_path / 'bag.db3'
    with sqlite3.connect(file) as base:
        base.execute('CREATE TABLE topics(id INTEGER, name TEXT, type TEXT)')
        base.execute('CREATE TABLE messages(id, topic_id, timestamp, data)')
        base.execute('INSERT INTO topics VALUES (1, "/a", "no_msgs/msg/None"), (2, "/b", ?)',
                     ('std_msgs/msg/String',))  # fmt: skip
        text = make.cdr(make.new('String', data='x'))
        base.executemany('INSERT INTO messages VALUES (?, ?, ?, ?)',
                         [(1, 1, 1, b'x'), (2, 2, -5, text)])  # fmt: skip
    base.close()
    saved = repair_bag(file, tmp_path / 'saved')
    assert saved.counts == {'/b': 1}
    assert '/a was left out: no definition of message type' in saved.problems[-1]


def test_repair_writes_over_nothing(tmp_path: Path) -> None:
    path = make.write_bag(tmp_path / 'bag', n=3)
    taken = tmp_path / 'taken'
    taken.mkdir()
    (tmp_path / 'link').symlink_to(tmp_path / 'nowhere')
    for target in (taken, tmp_path / 'link', path):
        with pytest.raises(TactileError, match='exists already'):
            repair_bag(path, target)
    (tmp_path / 'empty.mcap').touch()
    with pytest.raises(RecordingError, match=r'empty\.mcap is empty'):
        repair_bag(tmp_path / 'empty.mcap', tmp_path / 'new')
    assert sorted(p.name for p in tmp_path.iterdir()) == ['bag', 'empty.mcap', 'link', 'taken']
