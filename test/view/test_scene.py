# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""What is shown of a state: places, colours and lengths, without a viewer."""

from types import SimpleNamespace

import numpy as np
import pytest

from tactile_ros.types import ContactState, Frame, Layout
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
    scene_of,
    state_scalars,
)

PLACES = np.array([[0.0, 0.0, 0.0], [4e-3, 0.0, 0.0]])
CHIPS = Layout(PLACES, ('Bx', 'By', 'Bz'), 'T')
TURN = np.tile([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]], (2, 1, 1))
MOST = 2e-3


def state(**known: object) -> ContactState:
    rows = {name: np.asarray(value)[None] for name, value in known.items()}
    return ContactState.assemble(2, rows)


TOUCHED = state(
    position=[1e-3, 2e-3, np.nan],
    position_cov=np.diag([1e-6, 4e-6, np.nan]),
    force=[np.nan, np.nan, 2.0],
    in_contact=np.int8(1),
    slip=np.int8(0),
)


def scene(values: object, state: ContactState, layout: Layout = CHIPS) -> Scene:
    """Scene of readings above a rest of 0."""
    read = Frame(1, 0, np.asarray(values, float).reshape(layout.shape))
    return scene_of(layout, read, np.zeros(layout.shape), state, MOST)


def test_taxels_are_warmer_the_more_they_feel_and_grey_unread() -> None:
    shown = scene([[MOST, 0, 0], [0, 0, 0]], state())
    assert [ball.colour[:3] for ball in shown.balls] == [tuple(WARM), tuple(COLD)]
    assert [ball.middle.tolist() for ball in shown.balls] == PLACES.tolist()
    assert shown.words == ''
    unread = scene([[np.nan, 0, 0], [0, 0, MOST]], state())
    assert unread.balls[0].colour[:3] == GREY[:3]
    (arrow,) = unread.arrows
    assert arrow.start.tolist() == PLACES[1].tolist()


def test_fields_are_arrows_in_the_axes_of_the_sensor() -> None:
    turned = Layout(PLACES, ('Bx', 'By', 'Bz'), 'T', rotations=TURN)
    along = scene([[MOST, 0, 0], [0, 0, 0]], state(), turned).arrows[0].along
    assert along[1] > 1e-3
    assert np.allclose(along[[0, 2]], 0.0)
    assert scene([0.5, 0.1], state(), Layout(PLACES, ('pressure',), '1')).arrows == []


def test_contacts_have_two_sigmas_and_forces_that_are_red_where_they_slip() -> None:
    shown = scene(np.zeros((2, 3)), TOUCHED)
    ball, force = shown.balls[-1], shown.arrows[-1]
    assert ball.middle.tolist() == [1e-3, 2e-3, 0.0]
    assert ball.half_axes == pytest.approx([2e-3, 4e-3, 6e-4])
    assert force.along == pytest.approx([0.0, 0.0, 2 * METRES_PER_NEWTON])
    assert force.colour == FORCE
    bare = state(position=[0.0, 0.0, 0.0], in_contact=np.int8(0), force=[0.0, 0.0, 0.0])
    assert len(scene(np.zeros((2, 3)), bare).balls) == 2
    slips = scene(np.zeros((2, 3)), state(force=[0.0, 1.0, 1.0], slip=np.int8(1), label=3))
    assert slips.arrows[-1].colour == SLIPPING
    assert slips.words == 'label 3, slips'


def test_every_patch_has_its_ball_and_force() -> None:
    touched = state(
        contacts_id=[1, 2], contacts_position=PLACES,
        contacts_force=[[0, 0, 1.0], [0, 0, 2.0]],
        contacts_position_cov=np.tile(1e-6 * np.eye(3), (2, 1, 1)),
        contacts_normal=np.full((2, 3), np.nan), contacts_force_cov=np.full((2, 3, 3), np.nan),
        in_contact=np.int8(1),
    )  # fmt: skip
    shown = scene(np.zeros((2, 3)), touched)
    assert len(shown.balls) == 4
    lengths = [arrow.along[2] / METRES_PER_NEWTON for arrow in shown.arrows[-2:]]
    assert lengths == pytest.approx([1.0, 2.0])


def test_scalars_say_none_for_what_is_not_known() -> None:
    found = state_scalars(TOUCHED)
    assert found['force_z'] == 2.0
    assert found['force_x'] is None
    assert found['position_y_sigma'] == pytest.approx(2e-3)
    assert (found['in_contact'], found['slip'], found['cell'], found['valid']) == (1, 0, -1, 0)


GRIP = SimpleNamespace(
    phase=4, fingers=('thumb', 'index'), target_force=(1.0, 1.0), force=(0.9, float('nan')),
    friction=(float('nan'), 0.5), slip_margin=(0.2, 0.3), limited=True, refusal='',
    input_age=0.01,
)  # fmt: skip


def test_a_grip_has_its_numbers_by_finger() -> None:
    found = grip_scalars(GRIP)
    assert (found['phase'], found['limited'], found['refusal']) == (4, 1, '')
    fingers = [found[f'{name}_force'] for name in ('thumb', 'index')]
    assert json_schema(found)['properties']['refusal'] == {'type': 'string'}
    assert (fingers, found['index_friction']) == ([0.9, None], 0.5)
