# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Parts gripped at random in a world of points: grippers and recognition."""

import numpy as np
import pytest

from reference import pick_world
from reference.pick_world import Gripper, TaxelScene, TaxelSkin, even_loads
from tactile_ros.sensors import load_sensor
from tactile_ros.sensors.taxel_array.config import TaxelArrayConfig, grid_positions
from tactile_ros.types import Outline

SPEC = load_sensor('taxel_array')
TURN = 2 * np.pi * np.arange(96) / 96
RIM = np.column_stack([np.cos(TURN), np.sin(TURN)])
WASHERS = tuple(
    Outline(f'washer_{i}', (outer * RIM, (inner * RIM)[::-1]))
    for i, (outer, inner) in enumerate([(16e-3, 8e-3), (12e-3, 5e-3), (10e-3, 4e-3)])
)
CONFIG = TaxelArrayConfig(
    positions=grid_positions(8, 9, 5e-3),
    areas=np.full(72, 25e-6),
    force_range=np.array([0.0, 5.0]),
    objects=WASHERS,
)


def test_loads_share_the_force_and_follow_the_pose() -> None:
    scene = TaxelScene(CONFIG)
    load = scene.loads(WASHERS[0], np.array([2e-3, -1e-3, 0.4]), 12.0)
    assert load.sum() == pytest.approx(12.0)
    np.testing.assert_allclose(load @ CONFIG.positions[:, :2] / 12, [2e-3, -1e-3], atol=5e-5)
    area = np.pi * (16e-3**2 - 8e-3**2)
    assert load.max() == pytest.approx(12 * 25e-6 / area, rel=0.02)


def test_washers_come_onto_their_stacks_with_broken_taxels() -> None:
    rng = np.random.default_rng(11)
    skin = TaxelSkin.drawn(72, 1.5, rng, broken=5)
    pipeline = SPEC.pipeline(CONFIG)
    pipeline.fit(even_loads(SPEC.layout(CONFIG), CONFIG.areas, skin, rng, 3.0))
    gripper = Gripper(CONFIG, TaxelScene(CONFIG), skin, pipeline, (10.0, 30.0), 3e-3)
    rng = np.random.default_rng(5)
    picks = [gripper.pick(rng) for _ in range(12)]
    assert sum(pick.placed for pick in picks) >= 11
    assert len({pick.part for pick in picks}) == 3


@pytest.mark.parametrize(
    ('build', 'taxels'),
    [(pick_world.magnet_gripper, 72), (pick_world.suction_cup, 16), (pick_world.jaw, 2000)],
)
def test_points_stand_for_the_areas_of_their_taxels(build: object, taxels: int) -> None:
    config = build()  # type: ignore[operator]
    assert len(config.positions) == taxels
    scene = TaxelScene(config)
    area = np.bincount(scene.owner, scene.part, taxels)
    np.testing.assert_allclose(area, config.areas, rtol=1e-9)
    for axis in (0, 1):
        centre = np.bincount(scene.owner, scene.part * scene.points[:, axis], taxels) / area
        np.testing.assert_allclose(centre, config.positions[:, axis], atol=1.5e-4)
