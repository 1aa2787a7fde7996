# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Parts gripped at random in a world of points: grippers, recognition, the bound for tubes."""

from __future__ import annotations

import dataclasses
from functools import lru_cache
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest

from benchmarks.worlds import taxel_picks
from reference import pick_world
from reference.pick_world import Gripper, TaxelScene, TaxelSkin, even_loads, turn_between
from tactile_ros.sensors import load_sensor
from tactile_ros.sensors.taxel_array.config import TaxelArrayConfig, grid_positions
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
    config = pick_world.suction_cup()
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


def test_rings_are_five_millimetres_wide() -> None:
    inner = np.array([radius for _, radius in pick_world.RINGS])
    np.testing.assert_allclose(np.diff(inner), pick_world.PITCH)
    assert sum(count for count, _ in pick_world.RINGS) == 72


@pytest.fixture(scope='module')
def bench() -> ModuleType:
    return taxel_picks


def limit(bench: ModuleType, bends: tuple[float, float], noise: float = 5e-4) -> float:
    """Of four tubes that lie somewhere."""
    config = dataclasses.replace(pick_world.suction_cup(), objects=pick_world.tubes(bends))
    scene, rng = TaxelScene(config), np.random.default_rng(5)
    skin = dataclasses.replace(TaxelSkin.drawn(16, 8.0, rng), noise=noise)
    gripper = SimpleNamespace(config=config, scene=scene, skin=skin)
    poses = np.column_stack([rng.uniform(-2e-3, 2e-3, (4, 2)), rng.uniform(-np.pi, np.pi, 4)])
    picks = [
        SimpleNamespace(
            part=i % 2, pose=pose, loads=scene.loads(config.objects[i % 2], pose, 20.0)
        )
        for i, pose in enumerate(poses)
    ]
    return float(bench._limit([gripper], [picks]))


def test_bends_far_apart_are_all_told(bench: ModuleType) -> None:
    assert limit(bench, (90.0, 135.0)) == pytest.approx(100.0, abs=1e-6)


def test_bends_that_are_alike_are_told_by_a_coin(bench: ModuleType) -> None:
    assert limit(bench, (90.0, 90.02)) == pytest.approx(50.0, abs=4.0)


def test_noise_brings_the_bound_down(bench: ModuleType) -> None:
    assert 80.0 < limit(bench, (90.0, 100.0), noise=0.01) < 97.0
