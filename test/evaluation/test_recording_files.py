# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
import io
import os
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from reference import made_bags as make
from tactile_ros.errors import MissingPackageError, RecordingError
from tactile_ros.evaluation.bag import all_types
from tactile_ros.evaluation.recording_files import load, load_recording, save_recording
from tactile_ros.evaluation.truth import nearest, nearest_of_key
from tactile_ros.types import Layout, Recording

LAYOUT = Layout(
    np.arange(6.0).reshape(2, 3) * 1e-3, ('Bx', 'By', 'Bz'), 'T', np.tile(np.eye(3), (2, 1, 1)),
    saturation=np.array([1e-3, 1e-3, np.inf]), rate_hz=100.0, frame_id='thumb',
    sensor='reskin_board', serial='12',
)  # fmt: skip


@pytest.fixture
def recording() -> Recording:
    rng = np.random.default_rng(0)
    truth = {
        'position': np.where(np.arange(12).reshape(4, 3) == 5, np.nan, rng.normal(size=(4, 3))),
        'cell': np.array([0, -1, 2, 3]),
        'taxel_force': rng.normal(size=(4, 2)),
    }
    return Recording.from_arrays(
        LAYOUT, rng.normal(size=(4, 2, 3)), truth=truth, sequence=np.array([0, 1, 3, 4]),
        stamp_ns=np.array([1, 2, 3, 4]) * 1_700_000_000_123_456_789 // 4,
        temperature_c=rng.normal(25, 1, (4, 2)), stream=np.array([0, 0, 1, 1]),
        status=np.array([[0, 1], [0, 0], [8, 0], [0, 0]]), tare=np.arange(4) % 2 == 0,
    )  # fmt: skip


def assert_same(one: Recording, other: Recording) -> None:
    for name in ('values', 'stamp_ns', 'sequence', 'temperature_c', 'status', 'stream', 'tare'):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)
    assert one.truth.keys() == other.truth.keys()
    for key in one.truth:
        np.testing.assert_array_equal(one.truth[key], other.truth[key], err_msg=key)


def test_npz_gives_the_recording_back_bit_by_bit(recording: Recording, tmp_path: Path) -> None:
    save_recording(recording, tmp_path / 'a.npz')
    back = load_recording(tmp_path / 'a.npz')
    assert_same(recording, back)
    assert back.layout.channels == LAYOUT.channels
    assert back.layout.serial == '12'
    np.testing.assert_array_equal(back.layout.saturation, LAYOUT.saturation)
    assert load(tmp_path / 'a.npz').recordings[0].name == 'a'


class Trap:
    def __reduce__(self) -> tuple:
        return (pytest.fail, ('unpickled',))


def saved(**arrays: np.ndarray) -> bytes:
    buffer = io.BytesIO()
    np.savez(buffer, **arrays)
    return buffer.getvalue()


@pytest.mark.parametrize(
    ('data', 'sentence'),
    [
        (saved(values=np.array([Trap()], object)), 'no plain array'),
        (saved(x=np.zeros(3)), 'no recording of tactile_ros'),
        (saved(**{f'a{k}': np.zeros(1) for k in range(65)}), 'is no recording of tactile_ros'),
    ],
    ids=['pickle', 'other', 'members'],
)
def test_hostile_archives_are_refused(tmp_path: Path, data: bytes, sentence: str) -> None:
    (tmp_path / 'hostile.npz').write_bytes(data)
    with pytest.raises(RecordingError, match=sentence):
        load_recording(tmp_path / 'hostile.npz')
    with pytest.raises(RecordingError, match='does not exist'):
        load(tmp_path / 'gone.npz')


def test_csv_gives_the_same_recording(recording: Recording, tmp_path: Path) -> None:
    columns = {n: getattr(recording, n) for n in ('stamp_ns', 'sequence', 'stream', 'tare')}
    columns |= {f'{c}_{t}': recording.values[:, t, i]
                for t in range(2) for i, c in enumerate(LAYOUT.channels)}  # fmt: skip
    for t in range(2):
        columns |= {f'{n}_{t}': getattr(recording, n)[:, t] for n in ('temperature_c', 'status')}
        columns[f'taxel_force_{t}'] = recording.truth['taxel_force'][:, t]
    columns |= {f'position_{a}': recording.truth['position'][:, i] for i, a in enumerate('xyz')}
    columns['cell'] = recording.truth['cell']
    lines = [','.join(columns)]
    for row in zip(*columns.values(), strict=True):
        lines.append(','.join('' if np.isnan(x) else str(x * 1) for x in row))
    (tmp_path / 'a.csv').write_text('\n'.join(lines))
    assert_same(load(tmp_path / 'a.csv', LAYOUT).recordings[0].recording, recording)
    single = Layout(np.zeros((1, 3)), ('u',), '1')
    (tmp_path / 's.csv').write_text(
        '\ufefftime_s,u_0\n1743468220.123456789,0.5\n1743468221,0.25\n'
    )
    stamps = load(tmp_path / 's.csv', single).recordings[0].recording.stamp_ns
    assert stamps.tolist() == [1743468220123456789, 1743468221000000000]
    os.mkfifo(tmp_path / 'pipe.csv')
    with pytest.raises(RecordingError, match='it is no file'):
        load(tmp_path / 'pipe.csv', single)


Put = Callable[..., None]


@pytest.fixture
def put(tmp_path: Path) -> Iterator[Put]:
    """Writer of messages into `bag`: topic, message, log time, and bytes in its place."""
    with make.Bag(tmp_path / 'bag') as bag:

        def write(topic: str, message: object, log_ns: int = 0, data: bytes = b'') -> None:
            if data:
                bag.write(topic, message.__msgtype__, log_ns, data)
            else:
                bag.put(topic, message, log_ns)
            bag.flush()

        yield write


@pytest.mark.parametrize(
    ('text', 'sentence'),
    [
        ('', 'no rows'), ('u_0\n', 'no rows'), ('u_0,u_0\n1,2\n', 'line 1 does not fit'),
        ('u_0\n1,2\n', 'line 2'), ('w\n1\n', "'u_0' is missing"),
        ('u_0\n1\nred\n', "row 2 of column u_0 must be a number; received 'red'"),
        ('u_0,stamp_ns\n1,0.02\n', "stamp_ns must be whole nanoseconds .* received '0.02'"),
        ('u_0,time_s\n1,\n', "row 1 of column time_s must be seconds; received ''"),
        ('u_0,Fz\n1,2\n', "one of time_s, stamp_ns.*force_z, torque_z,.* received 'Fz'"),
        ('u_0;tare\n1;2\n', 'line 1 does not fit 1 columns, which commas separate'),
        ('u_0,stamp_ns\n1,99999999999999999999999\n', 'no recording'),
    ],
)  # fmt: skip
def test_csv_that_makes_no_sense_is_refused_with_a_sentence(
    tmp_path: Path, text: str, sentence: str
) -> None:
    file = tmp_path / 'a.csv'
    file.write_text(text)
    with pytest.raises(RecordingError, match=sentence):
        load(file, Layout(np.zeros((1, 3)), ('u',), '1'))


def test_a_bag_becomes_frames_contacts_baselines_and_truth(tmp_path: Path) -> None:
    loaded = load(make.write_bag(tmp_path / 'bag', n=20, lost=(4, 5)))
    (found,) = loaded.recordings
    recording = found.recording
    assert loaded.problems == ()
    assert found.problems == ('2 messages of /truth/contacts belong to no frame',)
    assert recording.sequence.tolist() == [k for k in range(20) if k not in (4, 5)]
    assert (np.diff(recording.stamp_ns)[:3] == 10_000_000).all()
    assert recording.layout.sensor == 'reskin_board'
    assert found.calibrations == ('a' * 64,)
    (baseline,) = found.baselines
    assert (baseline.sequence, baseline.averaged) == (0, 8)
    assert (baseline.values == 1e-6).all()
    assert baseline.temperature_c.tolist() == [25, 26, 27, 28, 29]
    assert found.contacts.rows.tolist() == list(range(18))
    np.testing.assert_allclose(found.contacts.log_ns - recording.stamp_ns, 3_000_000)
    error = found.contacts.states.position[:, :2] - recording.truth['position'][:, :2]
    np.testing.assert_allclose(error[:, 0], -1e-6, atol=1e-15)
    np.testing.assert_array_equal(recording.truth['force'][:, 2], recording.sequence)
    assert set(recording.truth) == {'position', 'force', 'in_contact'}


def test_foreign_topics_damaged_messages_and_lost_layouts_are_named(
    put: Put, tmp_path: Path
) -> None:
    put('/camera', make.new('String', data='x'))
    with pytest.raises(RecordingError, match=r'holds no frames .*/camera'):
        load(tmp_path / 'bag')
    frame = make.frame(0, np.zeros(15), 5)
    put('/frame', frame)
    put('/frame', frame, 0, make.cdr(frame)[:20])
    put('/frame', make.frame(1, np.zeros(6), 6))
    with pytest.raises(RecordingError, match='its layout is not in the bag'):
        load(tmp_path / 'bag')
    loaded = load(tmp_path / 'bag', Layout(np.zeros((5, 3)), ('Bx', 'By', 'Bz'), 'T'))
    assert len(loaded.recordings[0].recording) == 1
    said = ' | '.join(loaded.sentences)
    assert 'topics that are not ours were left out: /camera' in said
    assert '1 messages of /frame are damaged' in said
    assert '1 frames were left out' in said


def test_garbage_in_place_of_messages_never_raises_anything_else(put: Put, tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    contacts = make.contacts(0, 0)
    good = make.cdr(contacts)
    put('/layout', make.layout())
    put('/frame', make.frame(0, np.zeros(15), 5))
    for k in range(300):
        data = bytearray(good)
        for place in rng.integers(4, len(data), 3):
            data[place] = int(rng.integers(256))
        put('/contacts', contacts, k, bytes(data))
    (one,) = load(tmp_path / 'bag').recordings
    assert len(one.recording) == 1
    assert one.contacts is not None


def test_restarted_counter_begins_a_new_stream(put: Put, tmp_path: Path) -> None:
    for space in ('/thumb', '/index'):
        put(f'{space}/layout', make.layout())
    for k, sequence in enumerate([0, 1, 2, 0, 1]):
        for space, force in (('/thumb', k), ('/index', -k)):
            put(f'{space}/frame', make.frame(sequence, np.zeros(15), 1000 + k), k)
            put(f'{space}/truth/contacts', make.contacts(sequence, 0, force=(force, 0, 0)), k)
    for loaded, sign in zip(load(tmp_path / 'bag').recordings, (-1, 1), strict=True):
        assert loaded.recording.stream.tolist() == [0, 0, 0, 1, 1]
        force = loaded.recording.truth['force'][:, 0]
        assert force.tolist() == [sign * k for k in range(5)]  # heard beside its frame


def test_truth_of_other_instruments_is_taken_at_the_nearest_time(put: Put, tmp_path: Path) -> None:
    put('/layout', make.layout())
    for k in range(10):
        put('/frame', make.frame(k, np.zeros(15), 10**9 + k * 10_000_000), 10**9 + k)
    for k in range(3):
        stamp = 10**9 + k * 20_000_000 + 4_000_000
        put('/cell/wrench', make.wrench(stamp, (0, 0, k)), stamp)
    put('/object', make.new('String', data='mug'), 10**9 + 45_000_000)
    (one,) = load(tmp_path / 'bag', truth_topics=('/cell/wrench', '/object')).recordings
    expected = [0, 0, 1, 1, 2, 2, np.nan, np.nan, np.nan, np.nan]
    np.testing.assert_array_equal(one.recording.truth['force'][:, 2], expected)
    assert one.recording.truth['label'].tolist() == [-1] * 5 + [0] * 5
    assert one.label_names == ('mug',)


def test_nearest_against_the_plain_search() -> None:
    rng = np.random.default_rng(2)
    keys, times = rng.integers(0, 9, 80), rng.integers(0, 1000, 80)
    asked_keys, asked = rng.integers(0, 12, 300), rng.integers(-50, 1050, 300)
    near, rows = nearest(times, asked, 12), nearest_of_key(keys, times, asked_keys, asked)
    for key, time, index, row in zip(asked_keys, asked, near, rows, strict=True):
        far = np.abs(times - time)
        assert index == -1 if far.min() > 12 else far[index] == far.min()
        same = far[keys == key]
        assert row == -1 if not len(same) else (keys[row], far[row]) == (key, same.min())
    assert nearest(times[:0], asked, 12).max() == -1


def test_a_bag_without_rosbags_is_one_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = make.write_bag(tmp_path / 'bag', n=3)
    all_types.cache_clear()
    monkeypatch.setitem(sys.modules, 'rosbags.typesys', None)
    with pytest.raises(MissingPackageError, match='pip install rosbags'):
        load(path)
