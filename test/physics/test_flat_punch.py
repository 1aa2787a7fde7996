"""A round punch on a layer against its half-space, its map of squares and its own definition."""

from __future__ import annotations

import numpy as np
import pytest

from tactile_ros.physics.elastomer import FlatPunch, Layer

RADIUS, SHEAR = 6e-3, 3e4


def test_on_a_deep_layer_it_is_boussinesqs_punch() -> None:
    ratio = 0.3
    punch = FlatPunch(Layer(2.0, SHEAR, ratio), RADIUS, 20e-3)
    # total load of a rigid punch on a half-space: 4 G a d / (1 - nu)
    total = 2 * np.pi * punch.pressure(np.zeros(1))[0]
    assert total == pytest.approx(4 * SHEAR * RADIUS / (1 - ratio), rel=0.02)


@pytest.mark.parametrize('ratio', [0.3, 0.49])
def test_under_the_head_all_sinks_alike_and_a_thin_layer_holds_more(ratio: float) -> None:
    layer = Layer(4e-3, SHEAR, ratio)
    punch = FlatPunch(layer, RADIUS, 20e-3)
    near = punch.movement(1e-4)(np.array([0.0, 2e-3, 4e-3, 5e-3]))[:, 1]
    np.testing.assert_allclose(near, -1.0, atol=0.04)  # a little is felt over 0.1 mm
    total = 2 * np.pi * punch.pressure(np.zeros(1))[0]
    assert total > 1.5 * 4 * SHEAR * RADIUS / (1 - ratio)


def test_a_map_of_fine_squares_comes_near() -> None:
    layer, pitch, depth = Layer(4e-3, SHEAR, 0.49), 0.4e-3, 1.5e-3
    line = pitch * (np.arange(151) - 75)
    covered = np.hypot(*np.meshgrid(line, line)) <= RADIUS
    tractions = layer.punch(covered, pitch, 1.0)
    moved = layer.displacement(tractions, pitch, layer.thickness - depth)[75, 75:125]
    away, up = FlatPunch(layer, RADIUS, 25e-3).movement(depth)(line[75:125]).T
    assert np.abs(moved[:, 0] - away).max() < 0.03 * np.abs(away).max()
    assert np.abs(moved[:, 2] - up).max() < 0.05  # where squares make a ragged edge
