# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Layouts, frames and outlines check what they are given, once, at the door."""

import numpy as np
import pytest

from tactile_ros.types import Frame, Layout, Outline


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
