"""Parts on a plane: what presses where, and parts of a text."""

from __future__ import annotations

import numpy as np
import pytest

from tactile_ros.physics.coverage import part_pressure, read_parts, washer
from tactile_ros.types import Outline


def test_a_tube_sinks_in_by_what_its_circle_lies_below_its_chord() -> None:
    tube = Outline('elbow', (), 8e-3, np.pi / 2)
    across = np.array([0.0, 2e-3, 4e-3, 5e-3])
    found = part_pressure(tube, np.column_stack([np.full(4, 20e-3), -across]))
    depth = np.sqrt(64 - np.array([0, 4, 16, 16.0])) - np.sqrt(48)
    np.testing.assert_allclose(found, depth / depth[0], atol=1e-12)
    assert part_pressure(tube, np.array([[0.0, 30e-3], [-9e-3, -9e-3]])).tolist() == [1.0, 0.0]


def test_a_washer_presses_between_its_radii() -> None:
    points = 1e-3 * np.array([[0, 0], [7, 0], [0, -9], [10, 0.0]])
    found = part_pressure(washer('washer', 9.5e-3, 5e-3), points)
    assert found.tolist() == [0.0, 1.0, 1.0, 0.0]


def test_parts_of_a_text() -> None:
    parts = read_parts('washer 16 8;tube 135 9; polygon 0 0 10 0 0 10')
    assert [part.name for part in parts] == ['washer_16_8', 'tube_135_9', 'polygon']
    assert np.linalg.norm(parts[0].loops[0], axis=1).max() == pytest.approx(16e-3)
    assert parts[1].bend == pytest.approx(0.75 * np.pi)
    assert parts[1].thickness == pytest.approx(9e-3)
    np.testing.assert_allclose(parts[2].loops[0], [[0, 0], [10e-3, 0], [0, 10e-3]])
    assert read_parts(' ') == ()


@pytest.mark.parametrize(
    'text', ['washer 8 16', 'ring 1 2', 'tube 90', 'washer a b', 'polygon 1 2 3 4 5']
)
def test_a_part_that_cannot_be_read_is_named(text: str) -> None:
    with pytest.raises(ValueError, match=text.split(maxsplit=1)[0]):
        read_parts(text)
