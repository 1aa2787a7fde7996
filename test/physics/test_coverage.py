# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Parts on a plane: outlines, pressure of tubes, and the output of partly pressed taxels."""

import numpy as np
import pytest

from tactile_ros.physics.coverage import area_share, inside, part_pressure, read_parts, tube_fields
from tactile_ros.types import Outline

SQUARE = np.array([[-2, -2], [2, -2], [2, 2], [-2, 2.0]])
HOLE = 0.5 * SQUARE[::-1]
RADIUS, BLUR = 10e-3, 0.4e-3


def test_inside_a_square_with_a_hole() -> None:
    points = np.array([[1.5, 0], [0, 0], [3, 0], [0, -1.5], [0.5, 0.9]])
    assert inside([SQUARE], points).tolist() == [True, True, False, True, True]
    assert inside([SQUARE, HOLE], points).tolist() == [True, False, False, True, False]
    triangle, points = np.eye(3)[:, :2], np.random.default_rng(0).uniform(-0.5, 1.5, (500, 2))
    wanted = (points > 0).all(axis=1) & (points.sum(axis=1) < 1)
    np.testing.assert_array_equal(inside([triangle], points), wanted)


def test_a_tube_sinks_in_by_what_its_circle_lies_below_its_chord() -> None:
    tube = Outline('elbow', (), 8e-3, np.pi / 2)
    across = np.array([0.0, 2e-3, 4e-3, 5e-3])
    found = part_pressure(tube, np.column_stack([np.full(4, 20e-3), -across]))
    depth = np.sqrt(64 - np.array([0, 4, 16, 16.0])) - np.sqrt(48)
    np.testing.assert_allclose(found, depth / depth[0], atol=1e-12)
    assert part_pressure(tube, np.array([[0.0, 30e-3], [-9e-3, -9e-3]])).tolist() == [1.0, 0.0]


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


def sharp(z: np.ndarray, profile: int, width: float) -> np.ndarray:
    """Pressure under a bed of springs, on a half-space, and of a strip."""
    inside = np.abs(z) < width
    if profile == 2:
        return inside * 1.0
    if profile == 1:
        return np.sqrt(np.maximum(1 - (z / width) ** 2, 0))
    chord = np.sqrt(RADIUS**2 - width**2)
    return inside * (np.sqrt(np.maximum(RADIUS**2 - z**2, 0)) - chord) / (RADIUS - chord)


@pytest.mark.parametrize('profile', range(3))
def test_tube_fields_are_the_mean_across_a_blur_with_their_slopes(profile: int) -> None:
    fields = tube_fields(Outline('elbow', (), RADIUS, np.pi / 2), BLUR, 25e-3)[profile]
    table = fields.table.reshape(-1, fields.columns, 3)
    w = 24
    width = fields.low[0] + w * fields.low[1]
    z = fields.pitch * np.arange(0, len(table), 7)
    off = 0.866 * BLUR * (np.linspace(-1, 1, 4001)[1:] - 1 / 4000)
    mean = sharp(z[:, None] + off, profile, width).mean(axis=1)
    np.testing.assert_allclose(table[::7, w, 0], mean, atol=8e-3)
    rise = np.gradient(table[:, w, 0], fields.pitch)
    np.testing.assert_allclose(table[:, w, 1], rise, rtol=1e-3, atol=1e-2 * np.abs(rise).max())
    wider = (table[:, w + 1, 0] - table[:, w - 1, 0]) / (2 * fields.low[1])
    np.testing.assert_allclose(table[:, w, 2], wider, rtol=1e-3, atol=1e-2 * np.abs(wider).max())


def test_area_law_is_the_step_response_with_the_area_for_the_time() -> None:
    gain, t1, ti, td = 2.0, 20e-6, 400e-6, 5e-6
    law = np.array([gain * (1 - t1 / ti), gain / ti, gain * (td / t1 + t1 / ti - 1), t1])
    area = np.linspace(0, 120e-6, 13)
    fading = (td / t1 + t1 / ti - 1.0) * np.exp(-area / t1)
    wanted = gain * (1.0 + (area - t1) / ti + fading)
    found = area_share(area[:, None], area[-1:], law)[:, 0]
    np.testing.assert_allclose(found, np.maximum(wanted / wanted[-1], 0.05), rtol=1e-12)
    share = area_share(np.linspace(0, 110e-6, 20)[:, None], np.array([110e-6]), law)[:, 0]
    assert (np.diff(share) > 0).all()
    assert share[-1] == 1.0
    linear = np.array([0.0, 1.0, 0.0, 1.0])
    assert area_share(np.zeros((1, 1)), np.array([110e-6]), linear).tolist() == [[0.05]]
