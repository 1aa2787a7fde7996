# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Paper [4] and what replaces it: equal loads, washers, a hold, pick and place, and bounds.

Gains differ by 55 %, the converter has 10 bits, five of 72 taxels are dead or stuck and nobody
says so; coverage is counted by points. The paper's own way is a polynomial with a free constant,
a threshold, and a circle through what is pressed. In pick and place the grippers are those of [4];
each world has a skin of its own with taxels that are broken, and a part is right where it went to
its place.
"""

from collections.abc import Callable
from dataclasses import replace
from time import perf_counter

import numpy as np

from benchmarks.harness import plots
from benchmarks.harness.independent import independent_rows
from benchmarks.harness.rows import BenchResult, Row, frame_us, shortest, within
from benchmarks.worlds import taxel_skins
from reference import pick_world
from reference.pick_world import WASHERS, Gripper, Picked
from tactile_ros.conditioning.baseline import BaselineTracker
from tactile_ros.conditioning.faults import taxel_faults, usable_rows, without_faults
from tactile_ros.conditioning.viscoelastic import Creep
from tactile_ros.estimators.object_pose import TaxelPoints, first_state
from tactile_ros.physics.coverage import outline_fields
from tactile_ros.pipeline import Pipeline
from tactile_ros.sensors import load_sensor
from tactile_ros.sensors.taxel_array.config import TaxelArrayConfig, grid_positions
from tactile_ros.types import Array, Integers, Outline, Recording

SPEC = load_sensor('taxel_array')
COUNTS = {'quick': 20, 'normal': 200, 'full': 1000}
BAD = (3, 17, 30, 44, 61)
PITCH, TAXELS = 5e-3, 72
HEALTHY = np.setdiff1d(np.arange(TAXELS), BAD)
GRID = grid_positions(8, 9, PITCH)
SEED = 4  # of what is not of a world
WORLDS = 300  # seeds of skins and picks
PICKS = {'quick': (1, 2), 'normal': (2, 15), 'full': (8, 100)}  # worlds, picks of each
SECONDS = {'quick': np.inf, 'normal': 20.0, 'full': np.inf}  # of the worlds of each gripper


def run(extent: str, command: str) -> BenchResult:
    """Equilibrate, place washers, hold, pick and place, then time."""
    pipeline = _fitted()
    rows = _washer_rows(pipeline, COUNTS[extent])
    sorted_rows, drawings, worlds = sorted_parts(extent)
    drawings['hold'], drift = _hold()
    compared = 'coverage of 72 taxels'
    rows += sorted_rows
    rows += [
        Row(f'{compared} by {name}', 'parts', error, bound=_noise_of_cover(), us_single=spent,
            compared=compared, method=name)
        for name, (spent, error) in _covers(pipeline).items()
    ]  # fmt: skip
    rows.append(
        Row('hold of 120 s: drift after 1 s', '%', drift['with creep'], paper=6.6,
            peer=drift['law alone'], aim=0.3)
    )  # fmt: skip
    notes = [
        'paper: before equilibration (spread), one branch of Voigt (hold), its own parts',
        'peer: polynomial with a free constant; threshold and circle fit',
        'bound of coverage: the noise of one reading of a half covered taxel',
    ]
    seeds = [SEED, *worlds]
    if extent == 'quick':
        notes.append(
            'quick: 2 picks of washers, 3 in a jaw, in one world; neither tubes nor the world of '
            'fine cells'
        )
    else:
        rows += taxel_skins.rows(extent)
        seeds += [*taxel_skins.SEEDS.values(), taxel_skins.SEED]
        notes += [
            'bound: Cramer and Rao, by differences of a world of fine cells (tubes, jaw)',
            'coverage: on layouts, skins and parts that chose no constant; aims are 5 points or '
            'the 95 % binomial interval, whichever is wider',
        ]
    rows += independent_rows('taxel_array', extent)
    return BenchResult('taxel_array', command, seeds, rows, notes, drawings)


def _fitted() -> Pipeline:
    """Pipeline of 72 taxels of 5 mm and five washers, equilibrated by even loads."""
    angle = 2 * np.pi * np.arange(96) / 96
    rim = np.column_stack([np.cos(angle), np.sin(angle)])
    config = replace(
        SPEC.config(), positions=GRID, areas=np.full(TAXELS, PITCH**2), force_range=(0.0, 5.0),
        objects=tuple(
            Outline(f'washer_{i}', (outer * rim, (inner * rim)[::-1]))
            for i, (outer, inner) in enumerate(WASHERS)
        ),
    )  # fmt: skip
    force = _taught()
    truth = {'taxel_force': force, 'in_contact': (force[:, 0] > 0).astype(np.int8)}
    taught = Recording.from_arrays(SPEC.layout(config), _read(force, 2), truth=truth)
    return SPEC.pipeline(config).fit(taught)


def _read(force: Array, seed: int) -> Array:
    """Outputs (s, t, 1) of 10 bits."""
    gain = 1 / (1 + 0.55 * np.random.default_rng(9).uniform(size=TAXELS))
    output = gain * force / (force + 1.5)
    output[:, BAD[:3]], output[:, BAD[3:]] = 0.0, 0.3
    noise = 5e-4 * np.random.default_rng(seed).normal(size=output.shape)
    return np.asarray(np.round(np.clip(output + noise, 0, 0.999) * 1023)[..., None] / 1023)


def _taught() -> Array:
    """Even loads (s, t) after rest (N)."""
    force = np.repeat(np.random.default_rng(1).uniform(0.05, 3, (150, 1)), TAXELS, axis=1)
    force[:15] = 0
    return force


def _counted(side: int, at: Array, which: int = 0) -> Array:
    """Covered part (t,) of each taxel by a washer at a place, by side x side points."""
    line = PITCH * ((np.arange(side) + 0.5) / side - 0.5)
    points = np.stack(np.meshgrid(line, line), -1).reshape(-1, 2)
    radius = np.linalg.norm(GRID[:, None, :2] + points - at, axis=2)
    outer, inner = WASHERS[which]
    return np.asarray(((radius < outer) & (radius > inner)).mean(axis=1))


def _washer_rows(pipeline: Pipeline, count: int) -> list[Row]:
    """Washers pressed somewhere, and equal loads; beside the paper's own way."""
    rng = np.random.default_rng(SEED)
    label, place = rng.integers(len(WASHERS), size=count), rng.uniform(-3e-3, 3e-3, (count, 2))
    force = 1.5 * np.array([_counted(40, at, i) for i, at in zip(label, place, strict=True)])
    recording = Recording.from_arrays(pipeline.layout, _read(force, SEED + 1))
    states = pipeline.process_batch(recording)
    right = states.label == label
    miss = 1e3 * np.linalg.norm(states.position[:, :2] - place, axis=1)[right]
    variance, at = states.object_pose_cov[right][:, [0, 1], [0, 1]], states.position[right, :2]
    inside = np.abs(at - place[right]) <= np.sqrt(variance)
    plain = _threshold_and_circle(recording.values[..., 0], label, place)
    total = np.abs(states.force[:, 2] / force.sum(axis=1) - 1)
    even = np.repeat(np.linspace(0.3, 2.5, 30)[:, None], TAXELS, axis=1)
    (ours, rest), (paper, paper_rest) = (
        [how(_read(load, seed)) for load, seed in ((even, 3), (np.zeros((50, TAXELS)), SEED + 2))]
        for how in (lambda values: _forces(pipeline, values), _printed)
    )
    spread, paper_spread = (
        100 * float((one[:, HEALTHY] / even[:, HEALTHY]).std(axis=1).mean())
        for one in (ours, paper)
    )
    single, batch = frame_us(pipeline, recording, range(min(count, 60)))
    return [
        Row('washers of 5 types, 5 bad taxels: recognised', '%', 100 * float(right.mean()),
            'high', paper=95.0, peer=plain[0], aim=99.0, us_single=single, us_batch=batch),
        Row('washers: centre, median', 'mm', float(np.median(miss)), peer=plain[1], aim=0.06),
        Row('washers: inside one sigma', '%', 100 * float(inside.mean()), 'high'),
        Row('spread of taxels after equilibration', '%', spread, paper=55.0, peer=paper_spread,
            aim=2.0),
        Row('force at rest, largest of a taxel', 'mN', 1e3 * float(np.nanmax(rest)),
            peer=1e3 * float(paper_rest[:, HEALTHY].max()), aim=0.0),
        Row('total force, mean error', '%', 100 * float(np.nanmean(total))),
        Row('one frame of 72 taxels', 'us', single, aim=300.0),
    ]  # fmt: skip


def _forces(pipeline: Pipeline, values: Array) -> Array:
    """Forces (s, t) of readings."""
    return pipeline.process_batch(Recording.from_arrays(pipeline.layout, values)).taxel_force


def _printed(values: Array) -> Array:
    """Forces (s, t) of readings (s, t, 1) by the paper's polynomial with a free constant (N)."""
    taught, output = _taught()[15:], _read(_taught(), 2)[15:, :, 0]
    found = np.full(values.shape[:2], np.nan)
    for i in HEALTHY:
        found[:, i] = np.polyval(np.polyfit(output[:, i], taught[:, i], 2), values[:, i, 0])
    return found


def _threshold_and_circle(output: Array, label: Integers, place: Array) -> tuple[float, float]:
    """Per cent right and median miss (mm) of a circle through the pressed taxels."""
    middle = np.mean(WASHERS, axis=1)
    right, miss = 0, []
    for row, wanted, at in zip(output, label, place, strict=True):
        x, y = GRID[row > 0.1, :2].T
        terms = np.column_stack([2 * x, 2 * y, np.ones(len(x))])
        a, b, c = np.linalg.lstsq(terms, x**2 + y**2, rcond=None)[0]
        radius = np.sqrt(max(c + a**2 + b**2, 0.0))
        right += int(np.argmin(np.abs(middle - radius)) == wanted)
        miss.append(1e3 * float(np.hypot(a - at[0], b - at[1])))
    return 100 * right / len(label), float(np.median(miss))


def _noise_of_cover() -> float:
    """What the noise of a reading makes of the covered part of a taxel, half of it covered."""
    noise, half, load = np.hypot(5e-4, 1 / 1023 / 12**0.5), 1.5, 0.75
    slope = 1 / (1 + 0.55 / 2) * half / (load + half) ** 2
    return float(noise / slope / (2 * load))


def _covers(pipeline: Pipeline) -> dict[str, tuple[float, float]]:
    """Time (us) and error of the coverage of 72 taxels by points and soft points."""
    config, rng = pipeline.config, np.random.default_rng(SEED)
    places = rng.uniform(-3e-3, 3e-3, (60, 2))
    exact = np.array([_counted(40, at) for at in places])
    models: dict[str, Callable[[Array], Array]] = {
        f'{n * n} point' + 's' * (n > 1): lambda at, n=n: _counted(n, at) for n in (1, 3, 5, 7, 20)
    }
    for count in (4, 16, 32):
        soft = TaxelPoints(config.positions, config.areas, None, count)
        fields = outline_fields(config.objects[0], soft.radius, 1)
        models[f'{count} soft points'] = lambda at, soft=soft, fields=fields: (
            soft.pressed(fields, first_state(fields, *at, 0.0))[0] / PITCH**2
        )
    found = {}
    for name, model in models.items():
        error = np.array([model(at) for at in places]) - exact
        spent = 1e6 * shortest(lambda model=model: model(places[0]), len(places))
        found[name] = spent, float(np.sqrt(np.mean(np.square(error))))
    return found


def _hold() -> tuple[str, dict[str, float]]:
    """Error of the force over a hold of 120 s in a skin that creeps, drawn, and its drift (%)."""
    config = SPEC.config()
    rng = np.random.default_rng(SEED)
    taught = np.concatenate([np.zeros(20)] + [
        np.full(int(n), load) for n, load in zip(
            rng.integers(10, 120, 40), np.where(np.arange(40) % 2, rng.uniform(3, 30, 40), 0),
            strict=True)
    ])  # fmt: skip
    held = np.concatenate([np.zeros(20), np.full(1200, 20.0), np.zeros(300)])
    lines: dict[str, tuple[Array, Array]] = {}
    drift = {}
    for name, stamped in (('law alone', False), ('with creep', True)):
        pipeline = SPEC.pipeline(config).fit(_crept(config, taught, 5, stamped))
        states = pipeline.process_batch(_crept(config, held, 6, stamped))
        miss = 100 * (np.nanmean(states.taxel_force, axis=1) / 20.0 - held / 20.0)
        lines[name] = (0.1 * np.arange(len(held))[::10] - 2.0, miss[::10])
        drift[name] = float(np.ptp(np.convolve(miss[30:1220], np.ones(20) / 20, 'valid')))
    title = 'Error of the force over a hold of 120 s and after it'
    return plots.curves(lines, ('time since the load (s)', 'error (% of the load)'), title), drift


def _crept(config: TaxelArrayConfig, load: Array, seed: int, stamped: bool) -> Recording:
    """Even loads (s,) at 10 Hz on 16 taxels whose skin creeps by three fading branches."""
    felt = load.copy()
    for share, tau in ((0.06, 0.7), (0.05, 6.0), (0.05, 45.0)):
        fade, strain = float(np.exp(-0.1 / tau)), 0.0
        for i in range(1, len(load)):
            strain = fade * strain + (1 - fade) * load[i]
            felt[i] += share * strain
    gain = 1 / (1 + 0.55 * np.random.default_rng(9).uniform(size=16))
    size = (felt[:, None] / 20.0) ** 0.9
    output = gain * size / (1 + size)
    output = output + 3e-4 * np.random.default_rng(seed).normal(size=output.shape)
    count = len(load)
    return Recording.from_arrays(
        SPEC.layout(config), np.round(np.clip(output, 0, 1) * 1023)[..., None] / 1023,
        100_000_000 * np.arange(count) if stamped else None,
        tare=np.arange(count) < 15,
        truth={
            'taxel_force': np.repeat(load[:, None], 16, axis=1),
            'in_contact': (load > 0).astype(np.int8),
        },
    )  # fmt: skip


def sorted_parts(extent: str) -> tuple[list[Row], dict[str, str], list[int]]:
    """Pick and place with the paper's grippers, drawings of what they felt, seeds of worlds."""
    worlds, count = PICKS[extent]
    kinds = {
        'washer': (pick_world.magnet_gripper(), 1.5, 3.0, (10.0, 30.0), 3e-3, 5),
        'tube': (pick_world.suction_cup(), 8.0, 20.0, (10.0, 40.0), 2e-3, 0),
        'jaw': (pick_world.jaw(), 0.05, 0.1, (4.0, 10.0), 4e-3, 20),
    }
    if extent == 'quick':
        del kinds['tube']
    picks, drawings = {}, {}
    for name, kind in kinds.items():
        few = max(count // 4, 3) if name == 'jaw' else count
        grips, picks[name] = [], []
        for i in within(SECONDS[extent], range(worlds)):
            grips.append(_gripper(kind, WORLDS + i))
            rng = np.random.default_rng([WORLDS + i, 1])
            picks[name].append([grips[-1].pick(rng) for _ in range(few)])
        shown = next((p for p in picks[name][0] if p.state.label >= 0), picks[name][0][0])
        drawings[name] = _draw_pick(kind[0], shown)
    rows = [_placed('washers of 5 types, 5 bad taxels', picks['washer'], 95.0, 99.0)]
    if tubes := picks.get('tube'):
        turn = [
            pick_world.turn_between(float(pick.state.yaw), float(pick.pose[2]), 1)
            for part in tubes for pick in part
        ]  # fmt: skip
        rows += [
            _placed('angle tubes of 2 bends, 16 taxels', tubes, 100.0, 100.0),
            Row('picked tubes: turn, median', 'deg', float(np.rad2deg(np.nanmedian(turn)))),
        ]
    jaw, rng = grips[0], np.random.default_rng(SEED)
    values = jaw.skin.read(np.array([pick.loads for pick in picks['jaw'][0]]), rng)
    recording = Recording.from_arrays(SPEC.layout(jaw.config), values)
    jaw.pipeline.reset()
    single, batch = frame_us(jaw.pipeline, recording, range(len(recording)))
    rows += [
        _placed('parts in a jaw of 2000, 20 bad taxels', picks['jaw'], None, 99.0),
        Row('one frame of 2000 taxels', 'us', single, aim=3000.0, us_single=single,
            us_batch=batch),
        Row('conditioning of 2000 taxels: baseline, laws, two branches of creep', 'us',
            _conditioning(jaw), aim=100.0),
    ]  # fmt: skip
    return rows, drawings, [WORLDS + i for i in range(max(map(len, picks.values())))]


def _gripper(kind: tuple, seed: int) -> Gripper:
    """One gripper with a skin of its own."""
    config, half_load, top, force, play, broken = kind
    rng = np.random.default_rng(seed)
    skin = pick_world.TaxelSkin.drawn(len(config.positions), half_load, rng, broken)
    taught = pick_world.even_loads(SPEC.layout(config), config.areas, skin, rng, top)
    pipeline = SPEC.pipeline(config).fit(taught)
    return Gripper(config, pick_world.TaxelScene(config), skin, pipeline, force, play)


def _placed(what: str, picks: list[list[Picked]], paper: float | None, aim: float) -> Row:
    """Per cent of parts that went where they belong, of all worlds and of each."""
    each = [100.0 * float(np.mean([pick.placed for pick in part])) for part in picks]
    worlds = f'{len(picks)} world' + 's' * (len(picks) > 1)
    label = f'pick and place: {what} ({sum(map(len, picks))} picks in {worlds})'
    return Row.mean(label, '%', each, 'high', paper=paper, aim=aim)


def _conditioning(gripper: Gripper) -> float:
    """Least time from readings to forces of a frame, the creep of two branches undone (us)."""
    pipeline, law = gripper.pipeline, gripper.pipeline.estimation.law_
    taxels = len(gripper.config.positions)
    creep = Creep(np.array([0.7, 6.0]), np.full((2, taxels), 0.08))
    state = creep.start()
    tracker = BaselineTracker(np.nan_to_num(pipeline.baseline), pipeline.rest_.scale)
    values = gripper.skin.read(np.full((1, taxels), 0.01), np.random.default_rng(SEED))[0]
    first, times = np.zeros(1, bool), []
    for i in range(1, 200):
        stamp = np.array([i * 10_000_000])
        began = perf_counter()
        bits = taxel_faults(values[None], None, pipeline.layout)
        usable = without_faults(values[None], bits)
        delta = usable - tracker.follow(usable, stamp)[0]
        pipeline.rest_.contact(delta, usable_rows(bits), None)
        creep.undo(law.forces(delta[..., 0]), stamp, first, state)
        times.append(perf_counter() - began)
    return 1e6 * min(times)


def _draw_pick(config: TaxelArrayConfig, pick: Picked) -> str:
    """A part as it was felt, found, and as it lay."""
    part, found = plots.edges_of(config.objects[pick.part]), []
    corners = plots.taxel_corners(config.positions, config.areas, config.taxel_outlines)
    if pick.state.label >= 0:
        pose = pick.state.object_pose
        turn = np.arctan2(pose[1, 0], pose[0, 0])
        shown = plots.edges_of(config.objects[pick.state.label])
        found = plots.placed(shown, np.array([*pose[:2, 3], turn]))
    pressure = pick.state.taxel_force / config.areas
    title = f'Pressure on {len(config.positions)} taxels, and the object'
    return plots.object_map(corners, pressure, found, plots.placed(part, pick.pose), title)
