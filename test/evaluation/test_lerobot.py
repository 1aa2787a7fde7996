# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Data sets for learning, against the description of their format."""

import io
import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from reference import made_bags as make
from tactile_ros.errors import RecordingError
from tactile_ros.evaluation.lerobot import pooled, statistics, write_dataset
from tactile_ros.evaluation.recording_files import load

NO_ARROW = 'pyarrow is not installed: pip install pyarrow'
NO_LEROBOT = 'lerobot, which needs torch, is not installed: pip install lerobot'
START_NS = 1_000_000_000
DATA = 'data/chunk-000/file-000.parquet'


@pytest.fixture
def parquet() -> SimpleNamespace:
    return pytest.importorskip('pyarrow.parquet', reason=NO_ARROW)


def test_every_frame_is_new_in_one_window_and_keeps_its_stamp(
    tmp_path: Path, parquet: SimpleNamespace
) -> None:
    bags = [
        make.write_bag(tmp_path / 'one', n=50, lost=(7, 8, 9, 10)),
        make.write_bag(tmp_path / 'two', n=31),
    ]
    done = write_dataset(bags, tmp_path / 'out', 30, 'press it', [])
    assert done.rows == [
        ('one', 'observation.tactile.sensor', 46, 16, 4),
        ('two', 'observation.tactile.sensor', 31, 10, 4),
    ]
    stored = parquet.read_table(tmp_path / 'out' / DATA).to_pydict()
    table = {key: np.array(column) for key, column in stored.items()}
    windows, stamps = table['observation.tactile.sensor'], table['tactile.sensor.stamp_ns']
    assert (windows.shape, stamps.shape) == ((26, 4, 5, 3), (26, 4))
    assert (np.diff(stamps, axis=1) >= 0).all()
    assert (stamps[:, -1] <= table['stamp_ns']).all()
    for number, bag in enumerate(bags):
        mine = np.flatnonzero(table['episode_index'] == number).tolist()
        new = [slice(4 - table['tactile.sensor.new'][row], 4) for row in mine]
        (stored,) = load(bag).recordings
        values = np.concatenate([windows[row, part] for row, part in zip(mine, new, strict=True)])
        np.testing.assert_array_equal(values, stored.recording.values.astype(np.float32))
        kept = np.concatenate([stamps[row, part] for row, part in zip(mine, new, strict=True)])
        np.testing.assert_array_equal(kept, stored.recording.stamp_ns)
    assert table['index'].tolist() == list(range(26))
    np.testing.assert_allclose(table['timestamp'][:3], [0, 1 / 30, 2 / 30], atol=1e-6)


@pytest.mark.filterwarnings('ignore')
def test_the_lerobot_package_reads_every_frame(tmp_path: Path) -> None:
    """Of a job of its own, where torch is wanted: `pip install lerobot`."""
    real = pytest.importorskip('lerobot.datasets.lerobot_dataset', reason=NO_LEROBOT)
    bags = [make.write_bag(tmp_path / name, n=n) for name, n in (('one', 50), ('two', 31))]
    write_dataset(bags, tmp_path / 'out', 30, 'press it', [])
    dataset = real.LeRobotDataset('made/here', root=tmp_path / 'out')
    assert (dataset.num_episodes, dataset.num_frames) == (2, len(dataset))
    assert dataset[0]['task'] == 'press it'
    frames = [dataset[row] for row in range(len(dataset))]
    new = [int(one['tactile.sensor.new']) for one in frames]
    windows = [one['observation.tactile.sensor'].numpy() for one in frames]
    found = np.concatenate([part[-n:] for part, n in zip(windows, new, strict=True) if n])
    values = [load(bag).recordings[0].recording.values for bag in bags]
    np.testing.assert_array_equal(found, np.concatenate(values).astype(np.float32))


def test_the_description_is_that_of_the_format(tmp_path: Path, parquet: SimpleNamespace) -> None:
    bags = [make.write_bag(tmp_path / name, n=n) for name, n in (('one', 40), ('two', 20))]
    write_dataset(bags, tmp_path / 'out', 50, 'press it', [])
    meta = tmp_path / 'out' / 'meta'
    info = json.loads((meta / 'info.json').read_text())
    assert info['codebase_version'] == 'v3.0'
    assert (info['total_episodes'], info['total_frames'], info['fps']) == (2, 32, 50)
    assert info['splits'] == {'train': '0:2'}
    schema = parquet.read_schema(tmp_path / 'out' / DATA)
    assert schema.names == list(info['features'])
    for key, feature in info['features'].items():
        kind, shape = schema.field(key).type, list(feature['shape'])
        for _ in shape if shape != [1] else ():
            kind = kind.value_type
        assert str(kind).replace('float', 'float32') == feature['dtype']
    tactile = info['features']['observation.tactile.sensor']
    assert (tactile['shape'], tactile['info']['unit']) == ([2, 5, 3], 'T')
    tasks = parquet.read_table(meta / 'tasks.parquet')
    assert tasks.to_pydict() == {'task_index': [0], 'task': ['press it']}
    assert json.loads(tasks.schema.metadata[b'pandas'])['index_columns'] == ['task']
    rows = parquet.read_table(meta / 'episodes/chunk-000/file-000.parquet').to_pylist()
    spans = [(row['dataset_from_index'], row['dataset_to_index'], row['length']) for row in rows]
    assert spans == [(0, 21, 21), (21, 32, 11)]
    assert rows[1]['tasks'] == ['press it']
    stats = json.loads((meta / 'stats.json').read_text())
    assert stats.keys() == info['features'].keys()
    values = np.concatenate([load(bag).recordings[0].recording.values for bag in bags])
    expected = values[:40].reshape(-1, 3).mean(axis=0)
    np.testing.assert_allclose(rows[0]['stats/observation.tactile.sensor/mean'], expected, 1e-5)


def test_joint_states_and_commands_are_held_until_the_next(
    tmp_path: Path,
    parquet: SimpleNamespace,
) -> None:  # fmt: skip
    with make.Bag(tmp_path / 'bag') as bag:
        bag.put('/f/layout', make.layout())
        for k in range(20):
            stamp = START_NS + k * 10_000_000
            bag.put('/f/frame', make.frame(k, np.zeros(15), stamp), stamp)
            if k % 5 == 2:
                for names, position in ((['a', 'b'], [k, -k]), (['arm'], [9.0])):
                    state = make.new('JointState', header=make.header(stamp))
                    state.name, state.position = names, np.array(position, float)
                    bag.put('/joint_states', state, stamp)
                point = make.new('JointTrajectoryPoint', positions=np.array([k, 1.0]))
                path = make.new('JointTrajectory', joint_names=['a', 'b'], points=[point])
                bag.put('/hand/joint_trajectory', path, stamp)
        speed = make.new('JointState', velocity=np.array([1.0]))
        speed.name = ['a']
        bag.put('/joint_states', speed, stamp)
    done = write_dataset([tmp_path / 'bag'], tmp_path / 'out', 100, 'grasp', [])
    assert 'bag: 1 messages of /joint_states without positions left out' in done.notes
    table = parquet.read_table(tmp_path / 'out' / DATA).to_pydict()
    held = [2] * 7 + [7] * 5 + [12] * 5 + [17] * 3
    assert table['observation.state'] == [[k, -k, 9.0] for k in held]
    assert table['action'] == [[k, 1.0] for k in held]
    features = json.loads((tmp_path / 'out' / 'meta' / 'info.json').read_text())['features']
    assert features['observation.state']['names'] == ['a', 'b', 'arm']


def test_images_are_kept_as_they_came_and_broken_ones_are_counted(
    tmp_path: Path,
    parquet: SimpleNamespace,
) -> None:  # fmt: skip
    pillow = pytest.importorskip('PIL.Image', reason='pillow is not installed: pip install pillow')
    sent = []
    with make.Bag(tmp_path / 'bag') as bag:
        bag.put('/f/layout', make.layout())
        for k in range(10):
            stamp = START_NS + k * 10_000_000
            bag.put('/f/frame', make.frame(k, np.zeros(15), stamp), stamp)
            if k % 2 == 0:
                size = (8, 6) if k < 8 else (4, 4)
                file = io.BytesIO()
                pillow.new('RGB', size, (255, 51 * k // 2, 0)).save(file, 'png')
                data = b'junk' if k == 6 else file.getvalue()
                image = make.new('CompressedImage', header=make.header(stamp), format='png',
                                 data=np.frombuffer(data, np.uint8))  # fmt: skip
                bag.put('/camera/compressed', image, stamp)
                sent.append(data)
    done = write_dataset([tmp_path / 'bag'], tmp_path / 'out', 100, 'look', [])
    lost = '1 images of /camera/compressed are left out, they cannot be opened'
    assert f'bag: {lost}' in done.notes
    assert sum('size is not that of the first' in note for note in done.notes) == 1
    key = 'observation.images.camera.compressed'
    table = parquet.read_table(tmp_path / 'out' / DATA).to_pydict()
    assert [row['bytes'] for row in table[key]] == [sent[i] for i in (0, 0, 1, 1, *[2] * 6)]
    meta = tmp_path / 'out' / 'meta'
    assert json.loads((meta / 'info.json').read_text())['features'][key]['shape'] == [6, 8, 3]
    mean = json.loads((meta / 'stats.json').read_text())[key]['mean']
    np.testing.assert_allclose(mean, [[[1.0]], [[0.2]], [[0.0]]])


def test_bags_with_other_features_or_senseless_stamps_are_refused(
    tmp_path: Path, parquet: SimpleNamespace
) -> None:
    def frames(name: str, stamps: list[int], taxels: int = 5, space: str = '') -> Path:
        with make.Bag(tmp_path / name) as bag:
            bag.put(f'{space}/layout', make.layout(taxels))
            for k, stamp in enumerate(stamps):
                bag.put(f'{space}/frame', make.frame(k, np.zeros(3 * taxels), stamp), k)
        return tmp_path / name

    steps = [10_000_000 * k for k in range(1, 500)]
    cases = {
        'first bag in observation.tactile.sensor, .*thumb': frames('far', steps, space='/thumb'),
        'differs from the first bag in observation.tactile': frames('small', steps, 4),
        'are spread over': frames('jump', [*steps, 10**18]),
        'nearly the same stamp': frames('still', [*steps, *range(10**10, 10**10 + 200)]),
    }
    whole = make.write_bag(tmp_path / 'whole', n=5)
    for sentence, path in cases.items():
        with pytest.raises(RecordingError, match=sentence):
            write_dataset([whole, path], tmp_path / 'out', 30, 'x', [])
        assert not (tmp_path / 'out').exists()


def test_statistics_pass_over_unknown_values_and_are_pooled_exactly() -> None:
    rng = np.random.default_rng(0)
    values = rng.normal(2.0, 3.0, (50, 4, 3))
    values[3, 1, 2] = np.nan
    one, two = statistics(values[:20], 20), statistics(values[20:], 30)
    assert one['count'] == [20]
    np.testing.assert_allclose(two['std'], values[20:].reshape(-1, 3).std(axis=0))
    values[3, 1, 2] = 2.0
    parts = [statistics(part, len(part)) for part in (values[:20], values[20:])]
    both, whole = pooled(parts), statistics(values, 50)
    for name in ('mean', 'std', 'min', 'max', 'count'):
        np.testing.assert_allclose(both[name], whole[name])
    assert both['q01'] == np.minimum(parts[0]['q01'], parts[1]['q01']).tolist()
    assert statistics(np.full((3, 1), np.nan), 3)['mean'] == [0.0]
