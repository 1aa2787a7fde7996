# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Layouts of viewers beside what is published, and settings of their panels and displays."""

from __future__ import annotations

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
PATH = {'value', 'enabled', 'color', 'label', 'timestampMethod', 'showLine', 'lineSize'}
# settings of panels in Lichtblick 1.10 (MPL-2.0), of the same names as Foxglove's
PANELS = {
    '3D': {'cameraState', 'followMode', 'followTf', 'scene', 'transforms', 'topics', 'layers',
           'publish', 'imageMode'},
    'Plot': {'paths', 'minXValue', 'maxXValue', 'minYValue', 'maxYValue', 'showLegend',
             'legendDisplay', 'showPlotValuesInLegend', 'showXAxisLabels', 'showYAxisLabels',
             'isSynced', 'xAxisVal', 'xAxisPath', 'followingViewWidth', 'sidebarDimension',
             'foxglovePanelTitle'},
    'StateTransitions': {'isSynced', 'paths', 'xAxisMaxValue', 'xAxisMinValue', 'xAxisRange',
                         'showPoints'},
    'RawMessages': {'diffEnabled', 'diffMethod', 'diffTopicPath', 'expansion', 'fontSize',
                    'showFullMessageForDiff', 'topicPath'},
}  # fmt: skip
CAMERA = {
    'distance', 'perspective', 'phi', 'target', 'targetOffset', 'targetOrientation',
    'thetaOffset', 'fovy', 'near', 'far',
}  # fmt: skip
TOPIC = {
    'visible', 'colorField', 'colorMode', 'colorMap', 'pointSize', 'pointShape', 'type',
    'axisScale', 'showCovariance',
}  # fmt: skip
# properties of displays in RViz (BSD), next to Class, Name, Enabled and Topic
DISPLAYS = {
    'Grid': {'Cell Size', 'Plane Cell Count', 'Reference Frame', 'Alpha', 'Color', 'Plane'},
    'TF': {'Marker Scale', 'Show Names', 'Show Axes', 'Show Arrows', 'Frame Timeout'},
    'MarkerArray': {'Namespaces'},
    'Wrench': {'Force Arrow Scale', 'Torque Arrow Scale', 'Arrow Width', 'History Length',
               'Accept NaN Values', 'Force Color', 'Torque Color', 'Alpha'},
    'PointCloud2': {'Style', 'Size (m)', 'Size (Pixels)', 'Color Transformer', 'Axis', 'Alpha',
                    'Position Transformer', 'Decay Time'},
    'PoseWithCovariance': {'Shape', 'Axes Length', 'Axes Radius', 'Covariance'},
}  # fmt: skip
POLICIES = {'Value', 'Depth', 'Reliability Policy', 'Durability Policy', 'History Policy'}
VIEW = {'Class', 'Name', 'Distance', 'Pitch', 'Yaw', 'Focal Point', 'Target Frame'}


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
def test_layouts_show_topics_by_settings_that_there_are(name: str, topics: set[str]) -> None:
    layout = layout_of(name)
    assert {path.partition('.')[0] for path in paths_of(layout)} == topics

    def panels(tree: object) -> set[str]:
        return {tree} if isinstance(tree, str) else panels(tree['first']) | panels(tree['second'])

    assert panels(layout['layout']) == set(layout['configById'])
    for title, panel in layout['configById'].items():
        assert set(panel) <= PANELS[title.partition('!')[0]], title
        assert all(set(path) <= PATH and path['enabled'] for path in panel.get('paths', []))
        assert all(set(one) <= TOPIC for one in panel.get('topics', {}).values())
        assert set(panel.get('cameraState', {})) <= CAMERA


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


def test_the_rviz_config_shows_topics_that_there_are_by_settings_that_there_are() -> None:
    found = yaml.safe_load((CONFIG / 'tactile.rviz').read_text())['Visualization Manager']
    topics = {d['Topic']['Value'] for d in found['Displays'] if 'Topic' in d}
    assert topics == {'/markers', '/wrench', '/surface', '/object_pose'}
    assert found['Global Options']['Fixed Frame'] == 'tactile_sensor'
    for display in found['Displays']:
        plugin, _, kind = display['Class'].partition('/')
        assert plugin == 'rviz_default_plugins'
        own = set(display) - {'Class', 'Name', 'Enabled', 'Topic'}
        assert own <= DISPLAYS[kind], display['Name']
        assert set(display.get('Topic', POLICIES)) == POLICIES
    assert set(found['Views']['Current']) <= VIEW
