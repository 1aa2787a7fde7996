# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""What is shown of a state without a viewer, and the layouts of viewers."""

import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation

from reference.foxglove_messages import decoded
from tactile_ros.evaluation.bag import all_types
from tactile_ros.types import ContactState, Layout
from tactile_ros.view.viewer import (
    COLD,
    FORCE,
    GREY,
    METRES_PER_NEWTON,
    SLIPPING,
    WARM,
    Scene,
    grip_scalars,
    json_schema,
    state_scalars,
)

PLACES = np.array([[0.0, 0.0, 0.0], [4e-3, 0.0, 0.0]])
CHIPS = Layout(PLACES, ('Bx', 'By', 'Bz'), 'T')
TURN = np.tile([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]], (2, 1, 1))
MOST = 2e-3
GRIP = SimpleNamespace(
    phase=4, fingers=('thumb', 'index'), target_force=(1.0, 1.0), force=(0.9, float('nan')),
    friction=(float('nan'), 0.5), slip_margin=(0.2, 0.3), limited=True, refusal='',
    input_age=0.01,
)  # fmt: skip


def state(**known: object) -> ContactState:
    rows = {name: np.asarray(value)[None] for name, value in known.items()}
    return ContactState.assemble(2, rows)


TOUCHED = state(
    position=[1e-3, 2e-3, np.nan], position_cov=np.diag([1e-6, 4e-6, np.nan]),
    force=[np.nan, np.nan, 2.0], in_contact=np.int8(1), slip=np.int8(0),
)  # fmt: skip


def scene(values: object, state: ContactState, layout: Layout = CHIPS) -> SimpleNamespace:
    """Scene of readings above a rest of 0, as a viewer receives it."""
    pytest.importorskip('foxglove', reason='foxglove-sdk is not installed')
    made = Scene(layout, np.asarray(values, float).reshape(layout.shape), MOST, 1).update(state)
    (entity,) = decoded(made.get_schema(), [made.encode()])[0].entities
    return entity


def parts(thing: SimpleNamespace, names: str = 'xyz') -> list[float]:
    return [getattr(thing, name) for name in names]


def along(arrow: SimpleNamespace) -> np.ndarray:
    """Vector of an arrow (m)."""
    turn = arrow.pose.orientation
    x_axis = Rotation.from_quat([turn.x, turn.y, turn.z, turn.w]).apply([1.0, 0.0, 0.0])
    return (arrow.shaft_length + arrow.head_length) * x_axis


def test_taxels_are_warmer_the_more_they_feel_and_grey_unread() -> None:
    shown = scene([[MOST, 0, 0], [0, 0, 0]], state())
    assert [parts(ball.color, 'rgb') for ball in shown.spheres] == [list(WARM), list(COLD)]
    assert [parts(ball.pose.position) for ball in shown.spheres] == PLACES.tolist()
    assert not shown.texts
    unread = scene([[np.nan, 0, 0], [0, 0, MOST]], state())
    assert parts(unread.spheres[0].color, 'rgb') == list(GREY[:3])
    (arrow,) = unread.arrows
    assert parts(arrow.pose.position) == PLACES[1].tolist()


def test_fields_are_arrows_in_the_axes_of_the_sensor() -> None:
    turned = Layout(PLACES, ('Bx', 'By', 'Bz'), 'T', rotations=TURN)
    field = along(scene([[MOST, 0, 0], [0, 0, 0]], state(), turned).arrows[0])
    assert field[1] > 1e-3
    assert np.allclose(field[[0, 2]], 0.0)
    assert not scene([0.5, 0.1], state(), Layout(PLACES, ('pressure',), '1')).arrows


def test_contacts_have_two_sigmas_and_forces_that_are_red_where_they_slip() -> None:
    shown = scene(np.zeros((2, 3)), TOUCHED)
    ball, force = shown.spheres[-1], shown.arrows[-1]
    assert parts(ball.pose.position) == [1e-3, 2e-3, 0.0]
    assert parts(ball.size) == pytest.approx([4e-3, 8e-3, 1.2e-3])
    assert along(force) == pytest.approx([0.0, 0.0, 2 * METRES_PER_NEWTON])
    assert parts(force.color, 'rgb') == list(FORCE[:3])
    bare = state(position=[0.0, 0.0, 0.0], in_contact=np.int8(0), force=[0.0, 0.0, 0.0])
    assert len(scene(np.zeros((2, 3)), bare).spheres) == 2
    slips = scene(np.zeros((2, 3)), state(force=[0.0, 1.0, 1.0], slip=np.int8(1), label=3))
    assert parts(slips.arrows[-1].color, 'rgb') == list(SLIPPING[:3])
    assert [text.text for text in slips.texts] == ['label 3, slips']


def test_every_patch_has_its_ball_and_force() -> None:
    touched = state(
        contacts_id=[1, 2], contacts_position=PLACES,
        contacts_force=[[0, 0, 1.0], [0, 0, 2.0]],
        contacts_position_cov=np.tile(1e-6 * np.eye(3), (2, 1, 1)),
        contacts_normal=np.full((2, 3), np.nan), contacts_force_cov=np.full((2, 3, 3), np.nan),
        in_contact=np.int8(1),
    )  # fmt: skip
    shown = scene(np.zeros((2, 3)), touched)
    assert len(shown.spheres) == 4
    lengths = [along(arrow)[2] / METRES_PER_NEWTON for arrow in shown.arrows[-2:]]
    assert lengths == pytest.approx([1.0, 2.0])


def test_scalars_say_none_for_what_is_not_known() -> None:
    found = state_scalars(TOUCHED)
    assert found['force_z'] == 2.0
    assert found['force_x'] is None
    assert found['position_y_sigma'] == pytest.approx(2e-3)
    assert (found['in_contact'], found['slip'], found['cell'], found['valid']) == (1, 0, -1, 0)


def test_a_grip_has_its_numbers_by_finger() -> None:
    found = grip_scalars(GRIP)
    assert (found['phase'], found['limited'], found['refusal']) == (4, 1, '')
    fingers = [found[f'{name}_force'] for name in ('thumb', 'index')]
    assert json_schema(found)['properties']['refusal'] == {'type': 'string'}
    assert (fingers, found['index_friction']) == ([0.9, None], 0.5)


CONFIG = Path(__file__).parents[2] / 'config'
OWN = {'/scene', '/taxels', '/state', '/grip'}
NODES = {
    '/markers': None, '/surface': None,
    '/object_pose': 'geometry_msgs/msg/PoseWithCovarianceStamped',
    '/wrench': 'geometry_msgs/msg/WrenchStamped', '/contacts': 'tactile_ros/msg/TactileContacts',
    '/grip_node/state': 'tactile_ros/msg/GripState',
}  # fmt: skip


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
    known = {'/state': state_scalars(ContactState.assemble(1, {})), '/grip': grip_scalars(GRIP)}
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
