# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Layouts of viewers beside what is published."""

import json
from pathlib import Path
from types import SimpleNamespace

import pytest
import yaml

from tactile_ros.evaluation.bag import all_types
from tactile_ros.types import ContactState
from tactile_ros.view.viewer import grip_scalars, state_scalars

CONFIG = Path(__file__).parents[2] / 'config'
OWN = {'/scene', '/taxels', '/state', '/grip'}
NODES = {
    '/markers': None,
    '/surface': None,
    '/object_pose': 'geometry_msgs/msg/PoseWithCovarianceStamped',
    '/wrench': 'geometry_msgs/msg/WrenchStamped',
    '/contacts': 'tactile_ros/msg/TactileContacts',
    '/grip_node/state': 'tactile_ros/msg/GripState',
}


GRIP = SimpleNamespace(
    phase=4, limited=False, refusal='', input_age=0.0, fingers=('thumb', 'index'),
    **dict.fromkeys(('target_force', 'force', 'friction', 'slip_margin'), (1.0, 1.0)),
)  # fmt: skip


def layout_of(name: str) -> dict[str, object]:
    return json.loads((CONFIG / f'foxglove_{name}.json').read_text())


def paths_of(layout: dict[str, object]) -> list[str]:
    """Every path of a message that the panels of a layout show."""
    panels = layout['configById'].values()
    topics = [topic for panel in panels for topic in panel.get('topics', {})]
    shown = [path['value'] for panel in panels for path in panel.get('paths', [])]
    return [*topics, *shown, *(p['topicPath'] for p in panels if 'topicPath' in p)]


@pytest.mark.parametrize(('name', 'topics'), [('view', OWN), ('ros', set(NODES))])
def test_layouts_show_topics_that_there_are(name: str, topics: set[str]) -> None:
    layout = layout_of(name)
    assert {path.partition('.')[0] for path in paths_of(layout)} == topics

    def panels(tree: object) -> set[str]:
        return {tree} if isinstance(tree, str) else panels(tree['first']) | panels(tree['second'])

    assert panels(layout['layout']) == set(layout['configById'])


def test_numbers_of_the_viewer_are_in_its_messages() -> None:
    known = {
        '/state': state_scalars(ContactState.assemble(1, {})),
        '/grip': grip_scalars(GRIP),
    }
    for path in paths_of(layout_of('view')):
        topic, _, field = path.partition('.')
        assert not field or field in known[topic], path


def test_numbers_of_the_nodes_are_in_their_messages() -> None:
    fields = all_types().fielddefs
    for path in paths_of(layout_of('ros')):
        topic, *names = path.replace('[0]', '').split('.')
        kind = NODES[topic]
        for name in names:
            inner = dict(fields[kind][1])
            assert name in inner, path
            kind = inner[name][1]


def test_the_rviz_config_shows_topics_that_there_are() -> None:
    found = yaml.safe_load((CONFIG / 'tactile.rviz').read_text())['Visualization Manager']
    topics = {d['Topic']['Value'] for d in found['Displays'] if 'Topic' in d}
    assert topics == {'/markers', '/wrench', '/surface', '/object_pose'}
    assert found['Global Options']['Fixed Frame'] == 'tactile_sensor'
