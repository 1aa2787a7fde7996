# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Objects on taxels, in a world of points counted inside circles and polygons."""

from __future__ import annotations

import dataclasses
from functools import lru_cache

import numpy as np
import pytest

from tactile_ros.physics.coverage import symmetry
from tactile_ros.pipeline import Pipeline
from tactile_ros.sensors import load_sensor
from tactile_ros.sensors.taxel_array.config import grid_positions
from tactile_ros.types import Outline, Recording, TaxelStatus

SPEC = load_sensor('taxel_array')
RADII = ((16e-3, 8e-3), (14e-3, 6.5e-3), (12e-3, 5e-3), (18e-3, 9e-3), (10e-3, 4e-3))
BAD = (3, 17, 30, 44, 61)
PITCH = 5e-3


def circle(radius: float, corners: int = 96) -> np.ndarray:
    angle = 2 * np.pi * np.arange(corners) / corners
    return radius * np.column_stack([np.cos(angle), np.sin(angle)])


WASHERS = tuple(
    Outline(f'washer_{i}', (circle(outer), circle(inner)[::-1]))
    for i, (outer, inner) in enumerate(RADII)
)
CONFIG = dataclasses.replace(  # type: ignore[type-var]
    SPEC.config(),
    positions=grid_positions(8, 9, PITCH),
    areas=np.full(72, PITCH**2),
    force_range=(0.0, 5.0),
    objects=WASHERS,
)


def covered(outer: float, inner: float, place: np.ndarray) -> np.ndarray:
    """Part of each taxel under a washer, by 1600 points."""
    line = (np.arange(40) + 0.5) / 40 - 0.5
    points = np.stack(np.meshgrid(line, line), -1).reshape(-1, 2) * PITCH
    away = CONFIG.positions[:, None, :2] + points - place
    radius = np.hypot(away[..., 0], away[..., 1])
    return np.asarray(((radius < outer) & (radius > inner)).mean(axis=1))


def read(force: np.ndarray, seed: int) -> np.ndarray:
    """Outputs of 10 bits with gains that differ by 55 %, and five taxels out of order."""
    rng = np.random.default_rng(9)
    gain = 1 / (1 + 0.55 * rng.uniform(size=72))
    output = gain * force / (force + 1.5)
    output[:, BAD[:3]], output[:, BAD[3:]] = 0.0, 0.3
    noise = 5e-4 * np.random.default_rng(seed).normal(size=output.shape)
    return np.round(np.clip(output + noise, 0, 0.999) * 1023)[..., None] / 1023


@lru_cache
def fitted() -> Pipeline:
    force = np.repeat(np.random.default_rng(1).uniform(0.05, 3, (150, 1)), 72, axis=1)
    force[:15] = 0
    truth = {'taxel_force': force, 'in_contact': (np.arange(150) >= 15).astype(np.int8)}
    return SPEC.pipeline(CONFIG).fit(
        Recording.from_arrays(SPEC.layout(CONFIG), read(force, 2), truth=truth)
    )


def placed(count: int, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Labels, places and forces of washers."""
    rng = np.random.default_rng(seed)
    label, place = rng.integers(5, size=count), rng.uniform(-3e-3, 3e-3, (count, 2))
    force = [1.5 * covered(*RADII[i], at) for i, at in zip(label, place, strict=True)]
    return label, place, np.array(force)


def test_washers_are_recognised_with_bad_taxels_that_nobody_marked() -> None:
    label, place, force = placed(60, 4)
    states = fitted().process_batch(Recording.from_arrays(SPEC.layout(CONFIG), read(force, 5)))
    assert (states.label == label).mean() >= 0.98
    right = states.label == label
    miss = np.linalg.norm(states.position[right, :2] - place[right], axis=1)
    assert np.median(miss) < 0.06e-3
    assert (states.symmetry[right] == 0).all()
    assert np.isnan(states.yaw[right]).all()
    assert (states.taxel_status[:, BAD] & TaxelStatus.DEAD).all()
    assert np.isnan(states.taxel_force[:, BAD]).all()
    healthy = np.setdiff1d(np.arange(72), BAD)
    firm = force[:, healthy] > 0.2
    ratio = (states.taxel_force[:, healthy] / np.maximum(force[:, healthy], 1e-9))[firm]
    assert abs(np.mean(ratio) - 1) < 0.01
    assert np.std(ratio) < 0.02
    total = force[right].sum(axis=1)
    np.testing.assert_allclose(states.force[right, 2], total, rtol=0.02)
    # what bad taxels hide is neither surer nor vaguer than what the others say
    ratio = (states.force[right, 2] - total) / np.sqrt(states.force_cov[right, 2, 2])
    assert 0.6 < np.sqrt(np.mean(np.square(ratio))) < 1.5


def test_nothing_touches_and_nothing_is_recognised() -> None:
    states = fitted().process_batch(
        Recording.from_arrays(SPEC.layout(CONFIG), read(np.zeros((20, 72)), 6))
    )
    assert (states.in_contact == 0).all()
    assert (states.label == -1).all()
    assert np.isnan(states.object_pose).all()
    assert not np.nansum(states.force[:, 2])


def test_a_strange_object_is_none_of_these() -> None:
    bar = 2.0 * (np.abs(CONFIG.positions[:, 1]) < 3e-3)
    states = fitted().process_batch(Recording.from_arrays(SPEC.layout(CONFIG), read(bar[None], 7)))
    assert states.label.tolist() == [-1]
    assert np.isnan(states.label_probability).all()


def test_a_part_without_symmetry_does_not_flip() -> None:
    part = Outline('part', (1e-3 * np.array(
        [[-8, -6], [10, -6], [10, 0], [-2, 0], [-2, 8], [-8, 8.0]]),))  # fmt: skip
    positions = grid_positions(40, 50, 1e-3)
    config = dataclasses.replace(  # type: ignore[type-var]
        SPEC.config(), positions=positions, areas=np.full(2000, 1e-6), objects=(part,)
    )
    objects = SPEC.pipeline(config).estimation.objects  # type: ignore[attr-defined]
    rng = np.random.default_rng(2)
    for _ in range(6):
        yaw, place = rng.uniform(-np.pi, np.pi), rng.uniform(-4e-3, 4e-3, 2)
        cos, sin = np.cos(yaw), np.sin(yaw)
        line = 1e-3 * ((np.arange(7) + 0.5) / 7 - 0.5)
        grid = positions[:, None, :2] + np.stack(np.meshgrid(line, line), -1).reshape(-1, 2)
        own = 1e3 * (grid - place) @ np.array([[cos, -sin], [sin, cos]])
        x, y = own[..., 0], own[..., 1]
        in_foot = (x > -8) & (x < 10) & (y > -6) & (y < 0)
        in_arm = (x > -8) & (x < -2) & (y >= 0) & (y < 8)
        force = (in_foot | in_arm).mean(axis=1)
        found = objects.locate(force, np.full(2000, 1e-3), np.ones(2000, bool), 0.03)
        turn = (found.pose[2] - yaw + np.pi) % (2 * np.pi) - np.pi
        assert abs(np.rad2deg(turn)) < 0.6
        assert np.linalg.norm(found.pose[:2] - place) < 0.1e-3


@pytest.mark.parametrize(
    ('corners', 'order'), [(circle(5e-3, 3), 3), (circle(5e-3, 4), 4), (circle(5e-3), 0)]
)
def test_symmetry(corners: np.ndarray, order: int) -> None:
    assert symmetry(Outline('o', (corners,))) == order


def test_symmetry_of_tubes() -> None:
    assert symmetry(Outline('elbow', (), 4e-3, np.pi / 2)) == 1
    assert symmetry(Outline('straight', (), 4e-3, np.pi)) == 2
