"""What a viewer gets: a file of Foxglove's own, read back; a server on this machine alone."""

from __future__ import annotations

import json
import socket
from pathlib import Path

import numpy as np
import pytest
import yaml

from tactile_ros.cli.main import main
from tactile_ros.evaluation.archive import save_recording
from tactile_ros.sensors import load_sensor
from tactile_ros.types import ContactState
from tactile_ros.view.scalars import state_scalars
from tactile_ros.view.viewer import HOST, Seen

CONFIG = Path(__file__).parents[2] / 'config'
OWN = {'/scene', '/taxels', '/state', '/grip'}
NODES = {'/markers', '/surface', '/object_pose', '/wrench', '/contacts', '/grip_node/state'}


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


def test_a_file_has_every_frame(few: Path, tmp_path: Path) -> None:
    pytest.importorskip('foxglove', reason='foxglove-sdk is not installed')
    from mcap.reader import make_reader

    out = tmp_path / 'new' / 'shown.mcap'
    assert main(['view', str(few), '--speed', '0', '--mcap', str(out)]) == 0
    with out.open('rb') as stream:
        found = list(make_reader(stream).iter_messages())
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
        assert main(['view', str(few), '--port', str(port)]) == 1
    (said,) = capsys.readouterr().err.splitlines()
    assert f'nothing can be shown at port {port}' in said


def test_a_server_says_where_it_is(few: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip('foxglove', reason='foxglove-sdk is not installed')
    assert main(['view', str(few), '--speed', '0', '--port', '0']) == 0
    assert f'connect Foxglove to ws://{HOST}:' in capsys.readouterr().err


def test_without_the_package_there_is_one_sentence(
    few: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(__import__('sys').modules, 'foxglove', None)
    assert main(['view', str(few)]) == 1
    (said,) = capsys.readouterr().err.splitlines()
    assert said == 'tactile view: tactile view needs foxglove-sdk: pip install foxglove-sdk'


@pytest.mark.parametrize(
    ('words', 'said'),
    [
        (['a.npz', '--sensor', 'gradiometer'], 'name a recording or --sensor'),
        (['a.npz', '--speed', '-1'], '--speed must be 0 or more'),
        (['a.npz', '--mcap', __file__], 'exists already'),
    ],
)
def test_wrong_use_is_refused(
    words: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(['view', *words]) == 2
    assert said in capsys.readouterr().err


def paths_of(layout: object) -> list[str]:
    """Every path of a message that the panels of a layout show."""
    panels = layout['configById'].values()
    topics = [topic for panel in panels for topic in panel.get('topics', {})]
    shown = [path['value'] for panel in panels for path in panel.get('paths', [])]
    return [*topics, *shown]


@pytest.mark.parametrize(('name', 'topics'), [('view', OWN), ('ros', NODES)])
def test_layouts_show_topics_that_there_are(name: str, topics: set[str]) -> None:
    layout = json.loads((CONFIG / f'foxglove_{name}.json').read_text())
    paths = paths_of(layout)
    assert {path.partition('.')[0] for path in paths} == topics
    fields = state_scalars(ContactState.assemble(1, {}))
    own = [path.partition('.')[2] for path in paths if path.startswith('/state.')]
    assert set(own) <= set(fields)

    def panels(tree: object) -> set[str]:
        return {tree} if isinstance(tree, str) else panels(tree['first']) | panels(tree['second'])

    assert panels(layout['layout']) == set(layout['configById'])


def test_the_rviz_config_shows_topics_that_there_are() -> None:
    found = yaml.safe_load((CONFIG / 'tactile.rviz').read_text())['Visualization Manager']
    topics = {d['Topic']['Value'] for d in found['Displays'] if 'Topic' in d}
    assert topics == {'/markers', '/wrench', '/surface', '/object_pose'}
    assert found['Global Options']['Fixed Frame'] == 'tactile_sensor'
