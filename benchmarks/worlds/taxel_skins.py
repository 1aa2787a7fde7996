# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Rows of `tactile bench taxel_array` in a world of fine cells: beside bounds, and trust.

The world (`test/reference/taxel_world.py`) shares nothing with the package's models: pressures on
cells of 0.1 mm, laws that are no polynomial. A bound is that of Cramer and Rao, from differences
of the world itself, for the noise of the converter. Whether sigmas are what errors are (trust) is
asked on layouts, skins and parts that chose nothing.
"""

from collections.abc import Callable

import numpy as np

from benchmarks.harness.rows import Row, inside
from reference import taxel_world as world
from reference.pick_world import jaw
from tactile_ros.pipeline import Pipeline
from tactile_ros.sensors import load_sensor
from tactile_ros.types import Array, ContactStates, Outline, Recording

SPEC = load_sensor('taxel_array')
COUNTS = {'normal': 40, 'full': 400}  # of each kind
TRUSTED = {'normal': 60, 'full': 400}  # placed parts of each world
SEEDS = {'tubes': 101, 'jaw': 102}
RADIUS, BEND = 10e-3, np.pi / 2
(PART,) = jaw().objects[0].loops
PROFILES = {'round': 'bed of springs', 'hertz': 'half-space', 'flat': 'strip'}
TOP, NOISE, LAW_ERROR = 3.0, 4.2e-4, 0.003  # N; fraction: noise and rounding; of a force
BOUNDED = 30  # presses whose bound is computed
SEED = 905  # of worlds of trust
LAYOUTS = {
    'rings': lambda: world.radial((4e-3, 9e-3, 15e-3, 21e-3), (12, 18, 26)),
    'matrix': lambda: world.matrix(9, 10, 4e-3),
    'jaw': lambda: world.matrix(26, 28, 1.2e-3),
}
LAWS = ('divider', 'exponential')
RINGS = ((13e-3, 6e-3), (10.5e-3, 4.5e-3))
CORNERS = (
    1e-3 * np.array([[-9, -6], [10, -6], [-4, 9.0]]),
    1e-3 * np.array([[-9, -7], [8, -7], [8, -1], [-3, -1], [-3, 9], [-9, 9.0]]),
)
EXPECTED = (68.27, 95.45)


def rows(extent: str) -> list[Row]:
    """Tubes, the jaw, and coverage of sigmas."""
    count = COUNTS[extent]
    tubes = [row for profile in PROFILES for row in _tubes(profile, count)]
    shares = [
        row for name, pair in gathered(TRUSTED[extent]).items() for row in _distances(name, *pair)
    ]
    return tubes + _jaw(count) + shares


def _states(pipeline: Pipeline, values: Array) -> ContactStates:
    return pipeline.process_batch(Recording.from_arrays(pipeline.layout, values))


def _circular(turn: Array) -> Array:
    """Turns (rad) between minus and plus half a turn."""
    return (turn + np.pi) % (2 * np.pi) - np.pi


def _own(array: world.Array, pose: Array) -> tuple[Array, Array]:
    """Cells in an object's frame at x, y, yaw."""
    x, y = array.x - pose[0], array.y - pose[1]
    cos, sin = np.cos(pose[2]), np.sin(pose[2])
    return cos * x + sin * y, cos * y - sin * x


def _bound(forces: Callable[[Array], Array], pose: Array, steps: Array, skin: world.Skin) -> Array:
    """Standard deviations (m,) that no method can beat, of parameters of `forces`."""
    slopes = [(forces(pose + away) - forces(pose - away)) / 2 for away in np.diag(steps)]
    known = np.maximum(forces(pose), 1e-4)
    rise = (skin.settled(known[None] * 1.001) - skin.settled(known[None]))[0] / (1e-3 * known)
    sigma = np.sqrt(np.square(NOISE / rise) + np.square(LAW_ERROR * known))
    terms = np.array(slopes).T / sigma[:, None]
    inverse = np.linalg.inv(terms.T @ terms + 1e-9 * np.eye(len(steps)))
    return np.asarray(np.sqrt(np.diag(inverse)) * steps)


def _tubes(profile: str, count: int) -> list[Row]:
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
        cover = world.on_tube(*_own(array, pose), RADIUS, BEND, min(pose[3], 9.9e-3), profile)
        return np.asarray(pose[4] / array.areas[0] * array.forces(cover))

    states = _states(pipeline, skin.read(np.array([forces(pose) for pose in poses]), rng))
    turn = np.abs(_circular(states.yaw - poses[:, 2]))
    steps = np.array([2e-4, 2e-4, 0.01, 1e-4, 0.01])
    sigma = [_bound(forces, pose, steps, skin)[2] for pose in poses[:BOUNDED]]
    least = np.abs(np.random.default_rng(0).normal(size=(500, len(sigma))) * sigma)
    name = f'tubes on 16 taxels, contact like a {PROFILES[profile]}'
    return [
        Row(f'{name}: turn, 95 %', 'deg', float(np.rad2deg(np.nanquantile(turn, 0.95))),
            bound=float(np.rad2deg(np.quantile(least, 0.95))), aim=0.5),
        Row(f'{name}: turn, median', 'deg', float(np.rad2deg(np.nanmedian(turn))),
            bound=float(np.rad2deg(np.median(least)))),
        Row(f'{name}: recognised', '%', 100 * float((states.label == 0).mean()), 'high',
            paper=100.0),
        Row(f'{name}: turn inside one sigma', '%', 100 * float((turn < states.yaw_std).mean()),
            'high'),
    ]  # fmt: skip


def _jaw(count: int) -> list[Row]:
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
        cover = world.on_polygon(*_own(array, pose), PART)
        return np.asarray(pose[3] / array.areas[0] * array.forces(cover))

    states = _states(pipeline, skin.read(np.array([forces(pose) for pose in poses]), rng))
    turn = np.abs(_circular(states.yaw - poses[:, 2]))
    miss = np.linalg.norm(states.position[:, :2] - poses[:, :2], axis=1)
    steps = np.array([5e-4, 5e-4, 0.05, 0.001])
    least = np.array([_bound(forces, pose, steps, skin)[:3] for pose in poses[:10]])
    place = 1e3 * float(np.sqrt(np.square(least[:, :2]).sum(axis=1)).mean())
    angle = float(np.rad2deg(least[:, 2].mean()))
    flipped = 100 * float(np.mean(~(turn < np.deg2rad(10))))
    return [
        Row('jaw of 2000: place, rms', 'mm', 1e3 * float(np.sqrt(np.nanmean(miss**2))),
            bound=place, aim=3 * place),
        Row('jaw of 2000: turn, rms', 'deg', float(np.rad2deg(np.sqrt(np.nanmean(turn**2)))),
            bound=angle, aim=3 * angle),
        Row('jaw of 2000: flipped or not found', '%', flipped, aim=0.0),
    ]  # fmt: skip


def gathered(count: int) -> dict[str, tuple[Array, Array]]:
    """Errors and their sigmas (n,) of every component, over all worlds of trust."""
    parts = [
        _trusted(layout, law, SEED + 10 * i + k, count)
        for i, layout in enumerate(LAYOUTS)
        for k, law in enumerate(LAWS)
    ]
    return {
        name: tuple(np.concatenate([part[name][k] for part in parts]) for k in (0, 1))
        for name in parts[0]
    }


def _trusted(layout: str, law: str, seed: int, count: int) -> dict[str, tuple[Array, Array]]:
    """The same of one world; frames in which nothing was recognised are left out."""
    array = LAYOUTS[layout]()
    washers = tuple(world.washer(f'w{i}', *radii) for i, radii in enumerate(RINGS))
    parts = tuple(Outline(f'part_{i}', (corners,)) for i, corners in enumerate(CORNERS))
    config = world.config(array, washers + parts)
    rng = np.random.default_rng(seed)
    skin = world.Skin(seed, len(array.positions), 1.5, law=law)
    pipeline = SPEC.pipeline(config).fit(world.even_loads(array, config, skin, TOP, seed))
    label, pose = rng.integers(4, size=count), rng.uniform(-1, 1, (count, 3))
    pose *= np.array([3e-3, 3e-3, np.pi])

    def pressed(which: int, at: Array) -> Array:
        """Covered area (t,) (m2) of every taxel under a part."""
        if which < len(RINGS):
            cover = world.on_washer(array.x - at[0], array.y - at[1], *RINGS[which])
        else:
            cover = world.on_polygon(*_own(array, at), CORNERS[which - len(RINGS)])
        return np.asarray(array.forces(cover))

    cover = np.array([pressed(i, p) for i, p in zip(label, pose, strict=True)])
    force = rng.uniform(0.8, 1.8, (count, 1)) * cover / array.areas.mean()
    states = _states(pipeline, skin.read(force, rng))
    right = states.label == label
    turned = right & (label >= len(RINGS))
    sigma = np.sqrt(np.diagonal(states.object_pose_cov, axis1=1, axis2=2))
    miss = states.position[:, :2] - pose[:, :2]
    return {
        'x': (miss[right, 0], sigma[right, 0]),
        'y': (miss[right, 1], sigma[right, 1]),
        'turn': (_circular(states.yaw - pose[:, 2])[turned], states.yaw_std[turned]),
        'total force': (
            states.force[:, 2] - force.sum(axis=1), np.sqrt(states.force_cov[:, 2, 2]),
        ),
    }  # fmt: skip


def _distances(name: str, error: Array, sigma: Array) -> list[Row]:
    """Points from what is right inside one and two sigma, overall and in the worst third of sigma.

    Aims are 5 points, or the 95 % binomial interval where that is wider.
    """
    found = []
    for k, right in enumerate(EXPECTED, start=1):
        whole, *thirds = (abs(share - right) for share in inside(error, sigma, k))
        for what, off, count in (
            (f'off {right} inside {k} sigma', whole, len(error)),
            ('the same, worst third of sigma', max(thirds), len(error) // 3),
        ):
            allowed = max(5.0, 196 * np.sqrt(right * (100 - right) / count / 1e4))
            found.append(Row(f'coverage, {name}: {what}', 'points', off, aim=float(allowed)))
    return found
