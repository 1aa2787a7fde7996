"""Parts gripped at random in a world of points, recognised and sorted."""

from __future__ import annotations

import dataclasses
from functools import lru_cache

import numpy as np
import pytest

from tactile_ros.sensors import load_sensor
from tactile_ros.sensors.taxel_array.config import TaxelArrayConfig, grid_positions
from tactile_ros.simulation import grippers
from tactile_ros.simulation.pick_and_place import Gripper, even_loads, turn_between
from tactile_ros.simulation.taxel_scene import TaxelScene, TaxelSkin
from tactile_ros.types import Outline, Recording

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


@lru_cache
def gripper(broken: int) -> Gripper:
    rng = np.random.default_rng(11)
    skin = TaxelSkin.drawn(72, 1.5, rng, broken)
    pipeline = SPEC.pipeline(CONFIG)
    pipeline.fit(even_loads(SPEC.layout(CONFIG), CONFIG.areas, skin, rng, 3.0))
    return Gripper(CONFIG, TaxelScene(CONFIG), skin, pipeline, (10.0, 30.0), 3e-3)


def test_loads_share_the_force_and_follow_the_pose() -> None:
    scene = TaxelScene(CONFIG)
    load = scene.loads(WASHERS[0], np.array([2e-3, -1e-3, 0.4]), 12.0)
    assert load.sum() == pytest.approx(12.0)
    np.testing.assert_allclose(load @ CONFIG.positions[:, :2] / 12, [2e-3, -1e-3], atol=5e-5)
    area = np.pi * (16e-3**2 - 8e-3**2)
    assert load.max() == pytest.approx(12 * 25e-6 / area, rel=0.02)


@pytest.mark.parametrize('broken', [0, 5])
def test_washers_come_onto_their_stacks(broken: int) -> None:
    rng = np.random.default_rng(5)
    picks = [gripper(broken).pick(rng) for _ in range(12)]
    assert sum(pick.placed for pick in picks) >= 11
    assert len({pick.part for pick in picks}) == 3


def test_tubes_of_a_narrow_contact_come_into_their_deposits() -> None:
    # fits of a narrow contact far off the cup are as near to some readings: they are unlikely
    config = grippers.suction_cup()
    rng = np.random.default_rng(301)
    skin = TaxelSkin.drawn(16, 8.0, rng)
    taught = even_loads(SPEC.layout(config), config.areas, skin, rng, 20.0)
    pipeline = SPEC.pipeline(config).fit(taught)
    scene, poses = TaxelScene(config), rng.uniform(-1, 1, (15, 3)) * (2e-3, 2e-3, np.pi)
    parts, force = rng.integers(2, size=15), rng.uniform(10.0, 40.0, 15)
    loads = [
        scene.loads(config.objects[part], pose, whole)
        for part, pose, whole in zip(parts, poses, force, strict=True)
    ]
    states = pipeline.process_batch(
        Recording.from_arrays(SPEC.layout(config), skin.read(np.array(loads), rng))
    )
    turned = [
        np.rad2deg(turn_between(found, true, 1))
        for found, true in zip(states.yaw, poses[:, 2], strict=True)
    ]
    assert (states.label == parts).sum() >= 14
    assert np.sum(np.array(turned) < 5.0) >= 14


def test_a_part_that_nobody_told_is_put_aside() -> None:
    bar = Outline('bar', (1e-3 * np.array([[-18, -3], [18, -3], [18, 3], [-18, 3.0]]),))
    one = gripper(0)
    other = Gripper(
        dataclasses.replace(CONFIG, objects=(bar,)), one.scene, one.skin, one.pipeline,
        (10.0, 20.0), 3e-3,
    )  # fmt: skip
    picks = [other.pick(np.random.default_rng(seed)) for seed in range(4)]
    assert [int(pick.state.label) for pick in picks] == [-1] * 4
    assert not any(pick.placed for pick in picks)


@pytest.mark.parametrize(
    ('found', 'true', 'order', 'wanted'),
    [(0.1, 0.3, 1, 0.2), (np.pi, -np.pi, 1, 0.0), (0.0, np.pi / 2, 4, 0.0), (1.0, 2.5, 0, 0.0)],
)
def test_turns_are_compared_within_their_symmetry(
    found: float, true: float, order: int, wanted: float
) -> None:
    assert turn_between(found, true, order) == pytest.approx(wanted, abs=1e-12)
