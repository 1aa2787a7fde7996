# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""What a viewer gets: a file of Foxglove's own, read back; a server on this machine alone."""

from __future__ import annotations

import json
import socket
from typing import TYPE_CHECKING

import numpy as np
import pytest

from tactile_ros.cli.main import main
from tactile_ros.evaluation.recording_files import save_recording
from tactile_ros.sensors import load_sensor
from tactile_ros.types import ContactState
from tactile_ros.view.viewer import HOST, Seen

if TYPE_CHECKING:
    from pathlib import Path

    Shown = list[tuple[object, object, object]]  # schema, channel, message


@pytest.fixture
def few(tmp_path: Path) -> Path:
    """Eight frames of a real board."""
    path = tmp_path / 'few.npz'
    save_recording(load_sensor('reskin_board').recordings()['normal_1'].select(slice(0, 8)), path)
    return path


def test_the_scale_of_colours_follows_the_largest_change() -> None:
    seen, bare = Seen(), ContactState.assemble(1, {'in_contact': np.array([0], np.int8)})
    touched = ContactState.assemble(1, {'in_contact': np.array([1], np.int8)})

    class Read:
        values = np.zeros((1, 1))

    rest, _ = seen.scale(Read, bare)
    assert rest.tolist() == [[0.0]]
    Read.values = np.full((1, 1), 2.0)
    rest, most = seen.scale(Read, touched)
    assert (rest.tolist(), most) == ([[0.0]], 2.0)
    Read.values = np.full((1, 1), 1.0)
    rest, most = seen.scale(Read, bare)
    assert rest.tolist() == [[1.0]]
    assert 1.9 < most < 2.0


@pytest.fixture
def found(few: Path, tmp_path: Path) -> Shown:
    """The file that is written of them, read back."""
    pytest.importorskip('foxglove', reason='foxglove-sdk is not installed')
    from mcap.reader import make_reader

    out = tmp_path / 'new' / 'shown.mcap'
    assert main(['view', str(few), '--speed', '0', '--mcap', str(out)]) == 0
    with out.open('rb') as stream:
        return list(make_reader(stream).iter_messages())


def decoded(found: Shown, topic: str) -> list[object]:
    """Messages of a topic by the schema that lies in the file."""
    descriptor_pb2 = pytest.importorskip('google.protobuf.descriptor_pb2')
    from google.protobuf import descriptor_pool, message_factory

    schema = next(schema for schema, channel, _ in found if channel.topic == topic)
    pool = descriptor_pool.DescriptorPool()
    for file in descriptor_pb2.FileDescriptorSet.FromString(schema.data).file:
        pool.Add(file)
    kind = message_factory.GetMessageClass(pool.FindMessageTypeByName(schema.name))
    return [kind.FromString(m.data) for _, channel, m in found if channel.topic == topic]


def split(data: bytes) -> tuple[np.ndarray, np.ndarray]:
    """Numbers (t, 7) and colours (t, 4) of a cloud."""
    rows = np.frombuffer(data, np.uint8).reshape(-1, 60)
    return rows[:, :56].copy().view('<f8'), rows[:, 56:]


def test_scenes_and_clouds_of_a_file_are_whole(found: Shown) -> None:
    recording = load_sensor('reskin_board').recordings()['normal_1']
    clouds = decoded(found, '/taxels')
    for cloud in clouds:
        names = [field.name for field in cloud.fields]
        shades = ['red', 'green', 'blue', 'alpha']
        assert names == ['x', 'y', 'z', 'change_Bx', 'change_By', 'change_Bz', 'change', *shades]
        assert [field.offset for field in cloud.fields] == [*range(0, 56, 8), *range(56, 60)]
        assert cloud.point_stride == 60
        table, colours = split(cloud.data)
        assert np.all(colours[:, 3] == 255)
        assert np.argmax(colours[:, 0].astype(int)) == np.argmax(table[:, 6])
        assert np.array_equal(table[:, :3], recording.layout.positions)
        assert np.allclose(np.linalg.norm(table[:, 3:6], axis=1), table[:, 6])
    assert any(split(cloud.data)[0][:, 6].any() for cloud in clouds)
    for scene in decoded(found, '/scene'):
        (entity,) = scene.entities
        assert entity.frame_id == recording.layout.frame_id
        assert len(entity.spheres) == len(recording.layout.positions)
        sizes = [(ball.size.x, ball.size.y, ball.size.z) for ball in entity.spheres]
        assert np.all(np.array(sizes) > 0)
        for arrow in entity.arrows:
            turn = arrow.pose.orientation
            assert np.isclose(turn.x**2 + turn.y**2 + turn.z**2 + turn.w**2, 1.0)
            assert arrow.shaft_length > 0


def test_a_file_has_every_frame(found: Shown) -> None:
    topics = [channel.topic for _, channel, _ in found]
    assert {name: topics.count(name) for name in set(topics)} == dict.fromkeys(
        ('/scene', '/taxels', '/state'), 8
    )
    schemas = {channel.topic: schema.name for schema, channel, _ in found if schema}
    assert schemas['/scene'] == 'foxglove.SceneUpdate'
    assert schemas['/taxels'] == 'foxglove.PointCloud'
    told = next(schema for schema, channel, _ in found if channel.topic == '/state')
    assert json.loads(told.data)['properties']['force_z'] == {'type': 'number'}
    said = [json.loads(m.data) for _, channel, m in found if channel.topic == '/state']
    assert said[0]['in_contact'] == -1
    times = [m.log_time for _, channel, m in found if channel.topic == '/state']
    assert np.diff(times).min() > 0


def test_a_port_that_is_taken_is_one_sentence(
    few: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip('foxglove', reason='foxglove-sdk is not installed')
    with socket.socket() as taken:
        taken.bind((HOST, 0))
        taken.listen()
        port = taken.getsockname()[1]
        assert main(['view', str(few), '--foxglove', '--port', str(port)]) == 1
    (said,) = capsys.readouterr().err.splitlines()
    assert f'nothing can be shown at port {port}' in said


def test_a_server_says_where_it_is(few: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip('foxglove', reason='foxglove-sdk is not installed')
    assert main(['view', str(few), '--foxglove', '--speed', '0', '--port', '0']) == 0
    assert f'connect Foxglove to ws://{HOST}:' in capsys.readouterr().err


def test_without_the_package_there_is_one_sentence(
    few: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(__import__('sys').modules, 'foxglove', None)
    assert main(['view', str(few), '--foxglove']) == 1
    (said,) = capsys.readouterr().err.splitlines()
    assert said == 'tactile view: tactile view needs foxglove-sdk: pip install foxglove-sdk'


@pytest.mark.parametrize(
    ('words', 'said'),
    [
        (['a.npz', '--sensor', 'gradiometer'], 'name a recording or --sensor'),
        (['a.npz', '--speed', '-1'], '--speed must be 0 or more'),
        (['--board', '/dev/ttyACM0'], '--board needs the --sensor'),
        (['a.npz', '--loop', '--speed', '0'], '--loop needs a --speed above 0'),
        (['a.npz', '--mcap', __file__], 'exists already'),
    ],
)
def test_wrong_use_is_refused(
    words: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(['view', *words]) == 2
    assert said in capsys.readouterr().err
