# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""What a viewer gets: a file of Foxglove's own, read back; a server on this machine alone."""

import json
import socket
import sys
from pathlib import Path

import numpy as np
import pytest

from reference.foxglove_messages import decoded
from tactile_ros.cli.main import main
from tactile_ros.evaluation.recording_files import save_recording
from tactile_ros.sensors import load_sensor
from tactile_ros.types import ContactState, Frame
from tactile_ros.view.viewer import HOST, Seen

Shown = list[tuple[object, object, object]]  # schema, channel, message


@pytest.fixture(scope='module')
def few(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Eight frames of a real board."""
    path = tmp_path_factory.mktemp('few') / 'few.npz'
    save_recording(load_sensor('reskin_board').recordings()['normal_1'].select(slice(0, 8)), path)
    return path


@pytest.fixture(scope='module')
def found(few: Path) -> Shown:
    """The file that is written of them, read back."""
    pytest.importorskip('foxglove', reason='foxglove-sdk is not installed')
    from mcap.reader import make_reader

    out = few.with_name('new') / 'shown.mcap'
    assert main(['view', str(few), '--speed', '0', '--mcap', str(out)]) == 0
    with out.open('rb') as stream:
        return list(make_reader(stream).iter_messages())


def test_seen_scales_colours_by_the_largest_change() -> None:
    seen = Seen()
    bare, touched = (
        ContactState.assemble(1, {'in_contact': np.array([c], np.int8)}) for c in (0, 1)
    )
    scales = [
        seen.scale(Frame(0, 0, np.full((1, 1), value)), state)
        for value, state in ((0.0, bare), (2.0, touched), (1.0, bare))
    ]
    assert [rest.tolist() for rest, _ in scales] == [[[0.0]], [[0.0]], [[1.0]]]
    assert scales[1][1] == 2.0
    assert 1.9 < scales[2][1] < 2.0


def of_topic(found: Shown, topic: str) -> list[object]:
    """Messages of a topic by the schema that lies in the file."""
    schema = next(schema for schema, channel, _ in found if channel.topic == topic)
    return decoded(schema, [m.data for _, channel, m in found if channel.topic == topic])


def split(data: bytes) -> tuple[np.ndarray, np.ndarray]:
    """Numbers (t, 7) and colours (t, 4) of a cloud."""
    rows = np.frombuffer(data, np.uint8).reshape(-1, 60)
    return rows[:, :56].copy().view('<f8'), rows[:, 56:]


def test_scenes_and_clouds_of_a_file_are_whole(found: Shown) -> None:
    recording = load_sensor('reskin_board').recordings()['normal_1']
    clouds = of_topic(found, '/taxels')
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
    for scene in of_topic(found, '/scene'):
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


def test_foxglove_server_says_where_it_is_or_that_it_cannot_be(
    few: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip('foxglove', reason='foxglove-sdk is not installed')
    words = ['view', str(few), '--foxglove', '--speed', '0']
    assert main([*words, '--port', '0']) == 0
    assert f'connect Foxglove to ws://{HOST}:' in capsys.readouterr().err
    with socket.socket() as taken:
        taken.bind((HOST, 0))
        taken.listen()
        port = taken.getsockname()[1]
        assert main([*words, '--port', str(port)]) == 1
    (said,) = capsys.readouterr().err.splitlines()
    assert f'nothing can be shown at port {port}' in said
    monkeypatch.setitem(sys.modules, 'foxglove', None)
    assert main(words) == 1
    (said,) = capsys.readouterr().err.splitlines()
    assert said == 'tactile view: tactile view needs foxglove-sdk: pip install foxglove-sdk'
