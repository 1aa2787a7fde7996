# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Whether the sigmas of [4] are what errors are: on layouts, skins and parts that chose nothing.

Each world has a layout, a law and a seed of its own; parts lie anywhere within reach, at any turn.
What is counted is each component inside one and two sigma, overall and in each third of sigma.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from benchmarks.harness.rows import Row
from tactile_ros.sensors import load_sensor
from tactile_ros.types import Outline, Recording

if TYPE_CHECKING:
    from types import ModuleType

    from tactile_ros.types import Array

COUNTS = {'normal': 60, 'full': 400}  # placed parts of each world
SPEC = load_sensor('taxel_array')
SEED = 905
LAYOUTS = ('rings', 'matrix', 'jaw')
LAWS = ('divider', 'exponential')
RINGS = ((13e-3, 6e-3), (10.5e-3, 4.5e-3))
CORNERS = (
    1e-3 * np.array([[-9, -6], [10, -6], [-4, 9.0]]),
    1e-3 * np.array([[-9, -7], [8, -7], [8, -1], [-3, -1], [-3, 9], [-9, 9.0]]),
)
ORDERS = (0, 0, 1, 1)
TOP = 3.0  # N, of a taxel of mean area in equilibration
EXPECTED = (68.27, 95.45)


def rows(extent: str) -> list[Row]:
    """Distances from what is right, of every component, in points."""
    return [row for name, told in gathered(COUNTS[extent]).items() for row in _rows(name, *told)]


def gathered(count: int) -> dict[str, tuple[Array, Array]]:
    """Errors and their sigmas (n,) of every component, over all worlds."""
    from reference import taxel_world as world

    parts = [
        told_in(world, layout, law, SEED + 10 * i + k, count)
        for i, layout in enumerate(LAYOUTS)
        for k, law in enumerate(LAWS)
    ]
    return {
        name: (
            np.concatenate([part[name][0] for part in parts]),
            np.concatenate([part[name][1] for part in parts]),
        )
        for name in parts[0]
    }


def told_in(
    world: ModuleType, layout: str, law: str, seed: int, count: int
) -> dict[str, tuple[Array, Array]]:
    """The same of one world; frames in which nothing was recognised are left out."""
    array = _array(world, layout)
    washers = tuple(world.washer(f'w{i}', *radii) for i, radii in enumerate(RINGS))
    parts = tuple(Outline(f'part_{i}', (corners,)) for i, corners in enumerate(CORNERS))
    config = world.config(array, washers + parts)
    rng = np.random.default_rng(seed)
    skin = world.Skin(seed, len(array.positions), 1.5, law=law)
    pipeline = SPEC.pipeline(config).fit(world.even_loads(array, config, skin, TOP, seed))
    label, pose = rng.integers(4, size=count), rng.uniform(-1, 1, (count, 3))
    pose *= np.array([3e-3, 3e-3, np.pi])
    cover = np.array([_pressed(world, array, i, p) for i, p in zip(label, pose, strict=True)])
    force = rng.uniform(0.8, 1.8, (count, 1)) * cover / array.areas.mean()
    states = pipeline.process_batch(
        Recording.from_arrays(SPEC.layout(config), skin.read(force, rng))
    )
    right = states.label == label
    turned = right & (label >= len(RINGS))
    turn = states.yaw - pose[:, 2]
    turn = np.arctan2(np.sin(turn), np.cos(turn))
    sigma = np.sqrt(np.diagonal(states.object_pose_cov, axis1=1, axis2=2))
    miss = states.position[:, :2] - pose[:, :2]
    total = states.force[:, 2] - force.sum(axis=1)
    return {
        'x': (miss[right, 0], sigma[right, 0]),
        'y': (miss[right, 1], sigma[right, 1]),
        'turn': (turn[turned], states.yaw_std[turned]),
        'total force': (total, np.sqrt(states.force_cov[:, 2, 2])),
    }


def _array(world: ModuleType, layout: str) -> object:
    """One of the layouts."""
    if layout == 'rings':
        return world.radial((4e-3, 9e-3, 15e-3, 21e-3), (12, 18, 26))
    return world.matrix(9, 10, 4e-3) if layout == 'matrix' else world.matrix(26, 28, 1.2e-3)


def _pressed(world: ModuleType, array: object, which: int, pose: Array) -> Array:
    """Covered area (t,) (m2) of every taxel under a part."""
    x, y = array.x - pose[0], array.y - pose[1]  # type: ignore[attr-defined]
    if which < len(RINGS):
        return np.asarray(array.forces(world.on_washer(x, y, *RINGS[which])))  # type: ignore[attr-defined]
    cos, sin = np.cos(pose[2]), np.sin(pose[2])
    told = world.on_polygon(cos * x + sin * y, cos * y - sin * x, CORNERS[which - len(RINGS)])
    return np.asarray(array.forces(told))  # type: ignore[attr-defined]


def distances(error: Array, sigma: Array) -> list[tuple[str, float, float]]:
    """Points from what is right, and what is allowed, inside one and two sigma and in thirds.

    Allowed are 5 points, or the 95 % binomial interval where that is wider.
    """
    found = []
    thirds = np.array_split(np.argsort(sigma, kind='stable'), 3)
    for k, right in enumerate(EXPECTED):
        inside = np.abs(error) <= (k + 1) * sigma
        for name, part in (('all', np.arange(len(error))), *zip('123', thirds, strict=True)):
            allowed = max(5.0, 196 * np.sqrt(right * (100 - right) / len(part) / 1e4))
            off = abs(100 * float(inside[part].mean()) - right)
            found.append((f'{k + 1} sigma, {name}', off, float(allowed)))
    return found


def _rows(name: str, error: Array, sigma: Array) -> list[Row]:
    """Of one component: overall, and the third that is farthest beyond what is allowed."""
    told = distances(error, sigma)
    rows = []
    for k in (1, 2):
        whole, *thirds = (one for one in told if one[0].startswith(str(k)))
        worst = max(thirds, key=lambda one: one[1] - one[2])
        rows += [
            Row(f'trust, {name}: off {EXPECTED[k - 1]} inside {k} sigma', 'points', whole[1],
                aim=whole[2]),
            Row(f'trust, {name}: the same, worst third of sigma', 'points', worst[1],
                aim=worst[2]),
        ]  # fmt: skip
    return rows
