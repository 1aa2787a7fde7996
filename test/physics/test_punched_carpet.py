"""Carpets in a bonded layer under punches, against an exact round one and a grid of cells."""

from __future__ import annotations

import numpy as np

from reference import multipole_world as world
from tactile_ros.physics.elastomer import FlatPunch, Layer, PunchDents, PunchedCarpet
from tactile_ros.physics.magnet_sheet import Sheet

LAYER = Layer(4e-3, 69e3 / 2.98, 0.49)
HEIGHTS = np.array([2.4e-3, 3.6e-3])
LINE = 37e-3 * np.sin(np.linspace(-np.pi / 2, np.pi / 2, 41))  # rows need not be even
CARPET = PunchedCarpet(LAYER, LINE, 0.9 * LINE, HEIGHTS)


def test_a_round_punch_moves_its_nodes_as_the_exact_one() -> None:
    pose = np.array([4e-3, -3e-3, 0.7])
    points, loads = CARPET.loads(world.regular('', 96, 6e-3))
    moved, turned = CARPET.under(points, loads, pose)
    places = np.stack(np.meshgrid(LINE, 0.9 * LINE, HEIGHTS, indexing='ij'), -1).reshape(-1, 3)
    apart = places[:, :2] - pose[:2]
    away = np.hypot(*apart.T)
    exact = FlatPunch(LAYER, 6e-3, 60e-3)
    for height in HEIGHTS:
        here = (places[:, 2] == height) & (away < 30e-3)
        out, up = exact.movement(LAYER.thickness - height)(away[here]).T
        side = apart[here] / np.maximum(away[here], 1e-12)[:, None]
        wanted = np.column_stack([side * out[:, None], up])
        error = moved[here] - wanted
        # the exact one has a root at the rim, which no sum of waves follows
        assert np.sqrt(np.square(error).mean()) < 0.005
        assert np.abs(error).max() < 0.08
    assert not turned[:, 2].any()


def test_a_turned_outline_is_turned() -> None:
    triangle = world.regular('', 3, 8e-3, np.pi / 2)
    punch = CARPET.loads(triangle)
    moved, _ = CARPET.under(*punch, np.array([0.0, 0.0, 0.0]))
    mirrored, _ = CARPET.under(*punch, np.array([0.0, 0.0, np.pi]))
    shape = (*CARPET.shape, 3)
    turned = moved.reshape(shape)[::-1, ::-1] * [-1, -1, 1]
    np.testing.assert_allclose(mirrored.reshape(shape), turned, atol=1e-9)
    assert np.abs(mirrored - moved).max() > 0.1


def test_turns_are_those_of_cells() -> None:
    sheet = Sheet(np.array([75e-3, 75e-3]), 2e-3, 2e-3, 75e-3 / 8, 'M4', np.full(9, 0.1))
    x, y = sheet.lines
    carpet = PunchedCarpet(LAYER, x, y, sheet.levels)
    dents, head, pose = PunchDents(sheet, 0.0, LAYER), world.box('', 14e-3, 9e-3), np.zeros(3)
    images = dents.on_sheet(sheet, dents.images(*dents.loads(head), pose))
    moved, turned = carpet.under(*carpet.loads(head), pose)
    assert np.corrcoef(moved.T.ravel(), images[:3].ravel())[0, 1] > 0.997
    assert np.corrcoef(turned[:, :2].T.ravel(), images[3:].ravel())[0, 1] > 0.98
