# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Types at their doors: layouts, frames, limits, tables, and states with every attribute."""

import numpy as np
import pytest

from tactile_ros.types import (
    STATE_FIELDS,
    ContactStates,
    Frame,
    JointLimits,
    Layout,
    Outline,
    Table,
    field_shape,
)

TAXELS = 4


def some_states() -> ContactStates:
    rng = np.random.default_rng(0)
    return ContactStates.assemble(
        3,
        TAXELS,
        {
            'force': rng.normal(size=(3, 3)),
            'contacts_id': np.array([[0, -1], [0, 1], [-1, -1]]),
            'contacts_position': rng.normal(size=(3, 2, 3)),
        },
    )


def test_what_is_not_known_is_nan_or_minus_one() -> None:
    states = ContactStates.assemble(2, TAXELS, {})
    states.refuse_misfit(TAXELS)
    for name, (_, dtype, fill) in STATE_FIELDS.items():
        value = getattr(states, name)
        assert value.shape == (2, *field_shape(name, TAXELS)), name
        assert value.dtype == dtype, name
        np.testing.assert_array_equal(value, np.full(value.shape, fill, dtype))
    assert not states.valid.any()


def test_lists_of_patches_have_one_length() -> None:
    states = some_states()
    states.refuse_misfit(TAXELS)
    assert states.contacts_force_cov.shape == (3, 2, 3, 3)
    assert [len(state.contacts) for state in states] == [1, 2, 0]
    second = states[1].contacts[1]
    assert second.id == 1
    np.testing.assert_array_equal(second.position, states.contacts_position[1, 1])
    assert np.isnan(second.force).all()


def test_a_state_is_a_row_of_states() -> None:
    states = some_states()
    assert len(states) == 3
    for row, state in enumerate(states):
        for name in STATE_FIELDS:
            np.testing.assert_array_equal(getattr(state, name), getattr(states, name)[row])
    with pytest.raises(IndexError):
        states[3]
    for rows in (slice(1, 3), np.array([False, True, True]), np.array([1, 2])):
        assert len(states[rows]) == 2
        np.testing.assert_array_equal(states[rows].force, states.force[rows])
        assert repr(states[rows]).startswith('ContactStates(2 frames')


@pytest.mark.parametrize(
    'known',
    [
        {'force': np.zeros((3, 2))},
        {'force': np.zeros((3, 3), int)},
        {'contacts_id': np.zeros((3, 2), int), 'contacts_force': np.zeros((3, 1, 3))},
    ],
)
def test_misfits_are_found(known: dict[str, np.ndarray]) -> None:
    with pytest.raises(ValueError, match='of ContactStates must have shape'):
        ContactStates.assemble(3, TAXELS, known).refuse_misfit(TAXELS)


def test_states_are_plain_numbers_by_name_and_short_in_print() -> None:
    force, touched = np.array([[0.0, 0.0, 1.5], [0.0, 0.0, 0.0]]), np.array([1, 0])
    states = ContactStates.assemble(2, 2, {'force': force, 'in_contact': touched})
    plain = states[0].as_dict()
    assert list(plain) == list(STATE_FIELDS)
    assert plain['force'] == [0.0, 0.0, 1.5]
    assert plain['label'] == -1
    assert repr(states) == 'ContactStates(2 frames, 1 in contact, 0 valid; estimated: force)'
    assert repr(states[0]).startswith('ContactState(in contact; force [')


GOOD = {'lower': [0.0, -1.0], 'upper': [1.0, 1.0], 'velocity': [2.0, 2.0], 'effort': [1.0, np.inf]}


@pytest.mark.parametrize(
    ('change', 'sentence'),
    [
        ({'upper': [1.0]}, r'upper of JointLimits must have shape \(2,\)'),
        ({'lower': [0.0, np.nan]}, 'lower and upper of JointLimits must be finite'),
        ({'upper': [np.inf, 1.0]}, 'lower and upper of JointLimits must be finite'),
        ({'lower': [0.0, 1.0]}, r'must be below upper; received 1\.0 and 1\.0 for joint 1'),
        ({'velocity': [2.0, 0.0]}, 'velocity of JointLimits must be above 0'),
        ({'velocity': [2.0, np.inf]}, 'velocity of JointLimits must be above 0'),
        ({'effort': [np.nan, 1.0]}, 'effort of JointLimits must be above 0'),
    ],
)
def test_limits_that_cannot_be_are_one_sentence(
    change: dict[str, list[float]], sentence: str
) -> None:
    with pytest.raises(ValueError, match=sentence):
        JointLimits(**{**GOOD, **change})


def test_rows_have_a_cell_for_each_column() -> None:
    Table('t', ('a', 'b'), ((1.0, None), ('x', 2)))
    with pytest.raises(ValueError, match="rows of 't' must have 2 cells"):
        Table('t', ('a', 'b'), ((1.0,),))


@pytest.mark.parametrize(
    ('positions', 'rotations'),
    [(np.zeros((5, 2)), None), (np.zeros(3), None), (np.zeros((5, 3)), np.zeros((4, 3, 3)))],
)
def test_a_layout_refuses_other_shapes(positions: np.ndarray, rotations: np.ndarray) -> None:
    with pytest.raises(ValueError, match='of Layout must have shape'):
        Layout(positions, ('Bx', 'By', 'Bz'), 'T', rotations=rotations)


def test_loops_of_an_outline_are_plane() -> None:
    disc = Outline('disc', (np.zeros((3, 2)),))
    assert disc.name == 'disc'
    assert disc.loops[0].shape == (3, 2)
    with pytest.raises(ValueError, match='a loop of Outline disc'):
        Outline('disc', (np.zeros((3, 3)),))


def test_a_frame_is_a_table() -> None:
    with pytest.raises(ValueError, match=r'values of Frame must have shape \(t, c\)'):
        Frame(0, 0, np.zeros(15))
    frame = Frame(None, 3, np.zeros((5, 3)))
    assert frame.temperature_c is None
    assert frame.status is None
