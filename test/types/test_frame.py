# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Layouts, frames and outlines check what they are given, once, at the door."""

import numpy as np
import pytest

from tactile_ros.types import Frame, Layout, Outline, as_shape


@pytest.mark.parametrize('value', ['far', [[1, 2], [3]], [object()], {'a': 1}])
def test_what_is_no_number_is_refused(value: object) -> None:
    with pytest.raises(ValueError, match=r'^positions of X must be numbers; received ') as refused:
        as_shape('positions of X', value, (-1, 3))
    assert refused.value.__cause__ is not None


def test_as_shape_names_what_is_wrong() -> None:
    assert as_shape('x', [[1, 2]], (-1, 2)).dtype == np.float64
    with pytest.raises(ValueError, match=r'^x must have shape \(any, 3\); received \(1, 2\)$'):
        as_shape('x', [[1, 2]], (-1, 3))
    with pytest.raises(ValueError, match=r'received \(2,\)'):
        as_shape('x', [1, 2], (-1, 2))


def test_a_layout_says_what_it_is() -> None:
    layout = Layout(np.zeros((5, 3)), ('Bx', 'By', 'Bz'), 'T')
    assert layout.shape == (5, 3)
    np.testing.assert_array_equal(layout.saturation, [np.inf] * 3)
    clipped = Layout(np.zeros((5, 3)), ('Bx', 'By', 'Bz'), 'T', saturation=np.array([1.0, 2, 3]))
    np.testing.assert_array_equal(clipped.saturation, [1, 2, 3])  # type: ignore[arg-type]


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
