# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Rows of `tactile bench taxel_array` in a world of fine cells: beside bounds, coverage, creep.

The world (`test/reference/taxel_world.py`) shares nothing with the package's models: pressures on
cells of 0.1 mm, laws that are no polynomial, three branches of creep. A bound is that of Cramer
and Rao, from differences of the world itself, for the noise of the converter.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from benchmarks.harness.rows import Row
from tactile_ros.sensors import load_sensor
from tactile_ros.types import Outline, Recording

if TYPE_CHECKING:
    from collections.abc import Callable
    from types import ModuleType

    from tactile_ros.types import Array

COUNTS = {'normal': 40, 'full': 400}  # of each kind
SPEC = load_sensor('taxel_array')
SEEDS = {'tubes': 101, 'jaw': 102, 'washers': 103, 'hold': 104, 'cup': 120}
RADIUS, BEND = 10e-3, np.pi / 2
PART = 1e-3 * np.array([[-8, -6], [10, -6], [10, 0], [-2, 0], [-2, 8], [-8, 8.0]])
RADII = ((16e-3, 8e-3), (14e-3, 6.5e-3), (12e-3, 5e-3), (18e-3, 9e-3), (10e-3, 4e-3))
PROFILES = {'round': 'bed of springs', 'hertz': 'half-space', 'flat': 'strip'}
SPAN, NODES, FINER = 3e-3, 13, 8.0  # m; places along a side, and how much finer the rule looks
TOP, NOISE = 3.0, 4.2e-4  # N; fraction: noise and rounding


def rows(extent: str) -> list[Row]:
    """Tubes, the jaw, washers on rings, and a hold."""
    world, count = _world(), COUNTS[extent]
    tubes = [row for profile in PROFILES for row in _tubes(world, profile, count)]
    return tubes + _jaw(world, count) + _washers(world, count) + _cup(world, count) + _hold(world)


def _world() -> ModuleType:
    """The world of the tests, which is not installed."""
    from reference import taxel_world

    return taxel_world


def _own(array: object, pose: Array) -> tuple[Array, Array]:
    """Cells in an object's frame at x, y, yaw."""
    x, y = array.x - pose[0], array.y - pose[1]  # type: ignore[attr-defined]
    cos, sin = np.cos(pose[2]), np.sin(pose[2])
    return cos * x + sin * y, cos * y - sin * x


def _bound(forces: object, pose: Array, steps: Array, skin: object, law_error: float) -> Array:
    """Standard deviations (m,) that no method can beat, of parameters of `forces`."""
    slopes = []
    for i, step in enumerate(steps):
        away = np.zeros(len(pose))
        away[i] = step
        slopes.append((forces(pose + away) - forces(pose - away)) / 2)  # type: ignore[operator]
    sigma = _sigma(forces(pose), skin, law_error)  # type: ignore[operator]
    terms = np.array(slopes).T / sigma[:, None]
    inverse = np.linalg.inv(terms.T @ terms + 1e-9 * np.eye(len(steps)))
    return np.asarray(np.sqrt(np.diag(inverse)) * steps)


def _tubes(world: ModuleType, profile: str, count: int) -> list[Row]:
    """Angle tubes at any angle on 16 sectors, contact 10 to 16 mm wide."""
    array = world.radial((8e-3, 25e-3), (16,))
    config = world.config(array, (Outline('elbow', (), RADIUS, BEND),))
    seed = SEEDS['tubes'] + 10 * list(PROFILES).index(profile)
    rng, skin = np.random.default_rng(seed), world.Skin(seed, 16, 1.5)
    pipeline = SPEC.pipeline(config).fit(world.even_loads(array, config, skin, TOP, seed))
    poses = np.column_stack(
        [rng.uniform(-2e-3, 2e-3, (count, 2)), rng.uniform(-np.pi, np.pi, count),
         rng.uniform(5e-3, 8e-3, count), rng.uniform(1.0, 2.5, count)]
    )  # fmt: skip

    def forces(pose: Array) -> Array:
        told = world.on_tube(*_own(array, pose), RADIUS, BEND, min(pose[3], 9.9e-3), profile)
        return np.asarray(pose[4] / array.areas[0] * array.forces(told))

    force = np.array([forces(pose) for pose in poses])
    recording = Recording.from_arrays(SPEC.layout(config), skin.read(force, rng))
    states = pipeline.process_batch(recording)
    turn = (states.yaw - poses[:, 2] + np.pi) % (2 * np.pi) - np.pi
    steps = np.array([2e-4, 2e-4, 0.01, 1e-4, 0.01])
    sigma = [_bound(forces, pose, steps, skin, 0.003)[2] for pose in poses[:30]]
    least = np.abs(np.random.default_rng(0).normal(size=(500, len(sigma))) * sigma)
    name = f'tubes on 16 taxels, contact like a {PROFILES[profile]}'
    return [
        Row(f'{name}: turn, 95 %', 'deg', float(np.rad2deg(np.nanquantile(np.abs(turn), 0.95))),
            bound=float(np.rad2deg(np.quantile(least, 0.95))), aim=0.5),
        Row(f'{name}: turn, median', 'deg', float(np.rad2deg(np.nanmedian(np.abs(turn)))),
            bound=float(np.rad2deg(np.median(least)))),
        Row(f'{name}: recognised', '%', 100 * float((states.label == 0).mean()), 'high',
            paper=100.0),
        Row(f'{name}: turn inside one sigma', '%',
            100 * float((np.abs(turn) < states.yaw_std).mean()), 'high'),
    ]  # fmt: skip


def _jaw(world: ModuleType, count: int) -> list[Row]:
    """A part without symmetry on 2000 taxels of 1 mm."""
    array = world.matrix(40, 50, 1e-3)
    config = world.config(array, (Outline('part', (PART,)),), 0.12)
    rng, skin = np.random.default_rng(SEEDS['jaw']), world.Skin(SEEDS['jaw'], 2000, 0.06)
    pipeline = SPEC.pipeline(config).fit(world.even_loads(array, config, skin, 0.12, 1))
    poses = np.column_stack(
        [rng.uniform(-4e-3, 4e-3, (count, 2)), rng.uniform(-np.pi, np.pi, count),
         rng.uniform(0.04, 0.09, count)]
    )  # fmt: skip

    def forces(pose: Array) -> Array:
        told = world.on_polygon(*_own(array, pose), PART)
        return np.asarray(pose[3] / array.areas[0] * array.forces(told))

    force = np.array([forces(pose) for pose in poses])
    states = pipeline.process_batch(
        Recording.from_arrays(SPEC.layout(config), skin.read(force, rng))
    )
    turn = np.abs((states.yaw - poses[:, 2] + np.pi) % (2 * np.pi) - np.pi)
    miss = np.linalg.norm(states.position[:, :2] - poses[:, :2], axis=1)
    steps = np.array([5e-4, 5e-4, 0.05, 0.001])
    least = np.array([_bound(forces, pose, steps, skin, 0.003)[:3] for pose in poses[:10]])
    place = float(np.sqrt(np.square(least[:, :2]).sum(axis=1)).mean())
    return [
        Row('jaw of 2000: place, rms', 'mm', 1e3 * float(np.sqrt(np.nanmean(miss**2))),
            bound=1e3 * place, aim=3e3 * place),
        Row('jaw of 2000: turn, rms', 'deg', float(np.rad2deg(np.sqrt(np.nanmean(turn**2)))),
            bound=float(np.rad2deg(least[:, 2].mean())),
            aim=3 * float(np.rad2deg(least[:, 2].mean()))),
        Row('jaw of 2000: flipped or not found', '%',
            100 * float(np.mean(~(turn < np.deg2rad(10)))), aim=0.0),
    ]  # fmt: skip


def _washers(world: ModuleType, count: int) -> list[Row]:
    """Washers on 72 taxels in rings, of skins of three laws, five taxels bad."""
    array = world.radial((6e-3, 12e-3, 18e-3, 24e-3), (16, 24, 32))
    config = world.config(array, tuple(world.washer(f'w{i}', *r) for i, r in enumerate(RADII)))
    right, inside, stated, force_in, miss = [], [], [], [], []
    for k, law in enumerate(('divider', 'exponential', 'logarithm')):
        seed = SEEDS['washers'] + 10 * k
        rng, skin = np.random.default_rng(seed), world.Skin(seed, 72, 1.5, law=law)
        taught = world.even_loads(array, config, skin, TOP, seed)
        label, place = rng.integers(5, size=count), rng.uniform(-3e-3, 3e-3, (count, 2))
        force = np.array([
            rng.uniform(0.8, 1.8) / array.areas.mean()
            * array.forces(world.on_washer(array.x - x, array.y - y, *RADII[i]))
            for i, (x, y) in zip(label, place, strict=True)
        ])  # fmt: skip
        values, bad = skin.read(force, rng), rng.choice(72, 5, replace=False)
        values[:, bad] = taught.values[:, bad] = 0.3 * (np.arange(5) % 2)[:, None]
        pipeline = SPEC.pipeline(config).fit(taught)
        states = pipeline.process_batch(Recording.from_arrays(SPEC.layout(config), values))
        ok = states.label == label
        off = np.abs(states.position[ok, :2] - place[ok])
        sigma = np.sqrt(states.object_pose_cov[ok][:, [0, 1], [0, 1]])
        right.append(ok.mean())
        inside.append(off < sigma)
        stated.append(sigma)
        miss.append(np.hypot(*off.T))
        error = np.abs(states.force[:, 2] - force.sum(axis=1))
        force_in.append(error < np.sqrt(states.force_cov[:, 2, 2]))
    told, sigma = np.concatenate(inside).reshape(-1), np.concatenate(stated).reshape(-1)
    third = np.digitize(sigma, np.quantile(sigma, [1 / 3, 2 / 3]))
    parts = [100 * float(told[third == k].mean()) for k in range(3)]
    laws = [[100 * float(np.mean(one)) for one in each] for each in (right, inside, force_in)]
    return [
        Row('washers on 72 in rings, 3 laws: recognised', '%', 100 * float(np.mean(right)),
            'high', paper=95.0, aim=99.0, by_seed=tuple(laws[0])),
        Row('washers on 72 in rings: centre, median', 'mm',
            1e3 * float(np.median(np.concatenate(miss))), aim=0.06,
            by_seed=tuple(1e3 * float(np.median(one)) for one in miss)),
        Row('washers: place inside one sigma', '%', 100 * float(told.mean()), 'high',
            by_seed=tuple(laws[1])),
        *(Row(f'washers: inside one sigma, third {k + 1} of sigma', '%', part, 'high')
          for k, part in enumerate(parts)),
        Row('washers: total force inside one sigma', '%',
            100 * float(np.concatenate(force_in).mean()), 'high', by_seed=tuple(laws[2])),
    ]  # fmt: skip


def _cup(world: ModuleType, count: int) -> list[Row]:
    """Washers of five types on 16 sectors, beside the rule of Bayes that knows this very world."""
    array = world.radial((8e-3, 25e-3), (16,))
    config = world.config(array, tuple(world.washer(f'w{i}', *r) for i, r in enumerate(RADII)))
    rng, skin = np.random.default_rng(SEEDS['cup']), world.Skin(SEEDS['cup'], 16, 1.5)
    pipeline = SPEC.pipeline(config).fit(world.even_loads(array, config, skin, TOP, 1))
    label, place = rng.integers(5, size=count), rng.uniform(-SPAN, SPAN, (count, 2))

    def cover(i: int, at: Array) -> Array:
        told = world.on_washer(array.x - at[0], array.y - at[1], *RADII[i])
        return np.asarray(array.forces(told) / array.areas[0])

    part = np.array([cover(i, at) for i, at in zip(label, place, strict=True)])
    force = rng.uniform(0.8, 1.8, (count, 1)) * part
    states = pipeline.process_batch(
        Recording.from_arrays(SPEC.layout(config), skin.read(force, rng))
    )
    told, chance = states.label == label, states.label_probability
    templates = _templates(cover)
    bayes = np.mean([
        _likeliest(templates, _noisy(row, skin, rng), _sigma(row, skin, 0.003)) == i
        for i, row in zip(label, force, strict=True)
    ])  # fmt: skip
    return [
        Row('washers on 16 sectors: recognised', '%', 100 * float(told.mean()), 'high',
            bound=100 * float(bayes)),
        Row('washers on 16 sectors: named ones that are right', '%',
            100 * float(told[states.label >= 0].mean()), 'high'),
        Row('washers on 16 sectors: mean probability stated for them', '%',
            100 * float(np.nanmean(chance)), 'high'),
    ]  # fmt: skip


def _templates(cover: Callable[[int, Array], Array]) -> Array:
    """Covered parts (5, n, 16) of the washers at places 0.06 mm apart, from some 0.5 mm apart."""
    from scipy.ndimage import zoom

    line = np.linspace(-SPAN, SPAN, NODES)
    found = []
    for i in range(len(RADII)):
        grid = np.array([[cover(i, np.array([x, y])) for y in line] for x in line])
        found.append(zoom(grid, (FINER, FINER, 1), order=3, grid_mode=False).reshape(-1, 16))
    return np.array(found)


def _sigma(force: Array, skin: object, law_error: float) -> Array:
    """Standard deviation (t,) of what the outputs tell of forces."""
    known = np.maximum(force, 1e-4)
    rise = (skin.settled(known[None] * 1.001) - skin.settled(known[None]))[0] / (1e-3 * known)  # type: ignore[attr-defined]
    return np.asarray(np.sqrt(np.square(NOISE / rise) + np.square(law_error * known)))


def _noisy(force: Array, skin: object, rng: np.random.Generator) -> Array:
    """Forces as the best law would tell them."""
    return force + _sigma(force, skin, 0.003) * rng.normal(size=force.shape)


def _likeliest(templates: Array, force: Array, sigma: Array) -> int:
    """Washer that is likeliest over all places and pressures."""
    scaled, y = templates / sigma, force / sigma
    squared = np.maximum(np.square(scaled).sum(axis=2), 1e-12)
    pressure = np.clip(scaled @ y / squared, 0.8, 1.8)
    wrong = y @ y - 2 * pressure * (scaled @ y) + pressure**2 * squared
    likely = np.exp(-0.5 * (wrong - wrong.min())) / np.sqrt(squared)
    return int(np.argmax(likely.sum(axis=1)))


def _programme(seed: int, seconds: float) -> tuple[Array, Array]:
    """Times (s,) and even loads (s, 16): ramps, holds of 1 to 25 s, rests."""
    rng, time, now = np.random.default_rng(seed), np.arange(0, seconds, 0.05), 1.0
    load = np.zeros(len(time))
    while now < seconds:
        ramp, hold = rng.uniform(0.1, 0.6), rng.choice([1, 3, 8, 25], p=[0.35, 0.3, 0.2, 0.15])
        end = now + 2 * ramp + hold
        rise = np.clip(np.minimum(time - now, end - time) / ramp, 0, 1)
        load += rng.uniform(0.1, 1) * TOP * rise
        now = end + rng.uniform(1, 4)
    return time, np.repeat(load[:, None], 16, axis=1)


def _hold(world: ModuleType) -> list[Row]:
    """A hold of two minutes with ten seconds lost, on skins of two and three branches."""
    array = world.radial((8e-3, 25e-3), (16,))
    config, drift, gap = world.config(array), [], []
    for seed, creep in ((SEEDS['hold'], (0.08, 0.06)), (SEEDS['hold'] + 1, (0.08, 0.05, 0.03))):
        skin = world.Skin(seed, 16, 1.5, creep=creep)
        pipeline = SPEC.pipeline(config)
        time, force = _programme(seed, 200.0)
        for _ in range(2):  # learn, then hold
            values = skin.read(force, np.random.default_rng(seed), time)
            truth = {'taxel_force': force, 'in_contact': (force[:, 0] > 0).astype(np.int8)}
            recording = Recording.from_arrays(
                SPEC.layout(config), values, stamp_ns=(1e9 * time).astype(np.int64),
                stream=np.zeros(len(time), int), tare=np.arange(len(time)) < 10, truth=truth,
            )  # fmt: skip
            if not pipeline.calibrated:
                pipeline.fit(recording)
            time = np.arange(0, 122, 0.05)
            time = time[(time < 40) | (time > 50)]
            force = np.repeat(1.8 * np.clip((time - 1) / 0.2, 0, 1)[:, None], 16, axis=1)
        total = pipeline.process_batch(recording).taxel_force.mean(axis=1)
        early, late = total[(time > 2) & (time < 5)].mean(), total[time > 118].mean()
        before = total[(time > 36) & (time < 40)].mean()
        after = total[(time > 50) & (time < 54)].mean()
        drift.append(100 * abs(late / early - 1))
        gap.append(100 * abs(after / before - 1))
    return [
        Row('hold of 120 s, learned creep: drift', '%', max(drift), paper=6.6, aim=0.3),
        Row('10 s without frames in a hold: change', '%', max(gap), aim=0.3),
    ]
