# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Paper [4] and what replaces it: a hold, pick and place, and bounds.

Gains differ by 55 %, the converter has 10 bits. In pick and place the grippers are those of [4];
each world has a skin of its own with taxels that are broken and nobody says so, and a part is
right where it went to its place. Equal loads and washers are judged in the independent world.
"""

from time import perf_counter

import numpy as np

from benchmarks.harness import plots
from benchmarks.harness.independent import independent_rows
from benchmarks.harness.rows import BenchResult, Row, frame_us, within
from benchmarks.worlds import taxel_skins
from reference import pick_world
from reference.pick_world import Gripper, Picked
from tactile_ros.conditioning.baseline import BaselineTracker
from tactile_ros.conditioning.faults import taxel_faults, usable_rows, without_faults
from tactile_ros.conditioning.viscoelastic import Creep
from tactile_ros.sensors import load_sensor
from tactile_ros.sensors.taxel_array.config import TaxelArrayConfig
from tactile_ros.types import Array, Recording

SPEC = load_sensor('taxel_array')
SEED = 4  # of what is not of a world
WORLDS = 300  # seeds of skins and picks
PICKS = {'quick': (1, 2), 'normal': (2, 15), 'full': (8, 100)}  # worlds, picks of each
SECONDS = {'quick': np.inf, 'normal': 20.0, 'full': np.inf}  # of the worlds of each gripper


def run(extent: str, command: str) -> BenchResult:
    """Pick and place, hold, then time."""
    rows, drawings, worlds = sorted_parts(extent)
    drawings['hold'], drift = _hold()
    rows.append(
        Row('hold of 120 s: drift after 1 s', '%', drift['with creep'], paper=6.6,
            peer=drift['law alone'], aim=0.3)
    )  # fmt: skip
    notes = [
        'paper: one branch of Voigt (hold), its own parts',
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
    picks, drawings, first = {}, {}, {}
    for name, kind in kinds.items():
        few = max(count // 4, 3) if name == 'jaw' else count
        grips, picks[name] = [], []
        for i in within(SECONDS[extent], range(worlds)):
            grips.append(_gripper(kind, WORLDS + i))
            rng = np.random.default_rng([WORLDS + i, 1])
            picks[name].append([grips[-1].pick(rng) for _ in range(few)])
        first[name] = grips[0]
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
    rows += [
        _placed('parts in a jaw of 2000, 20 bad taxels', picks['jaw'], None, 99.0),
        _frame_row(first['washer'], picks['washer'][0], 300.0),
        _frame_row(first['jaw'], picks['jaw'][0], 3000.0),
        Row('conditioning of 2000 taxels: baseline, laws, two branches of creep', 'us',
            _conditioning(first['jaw']), aim=100.0),
    ]  # fmt: skip
    return rows, drawings, [WORLDS + i for i in range(max(map(len, picks.values())))]


def _frame_row(gripper: Gripper, picks: list[Picked], aim: float) -> Row:
    """Time of a frame of a gripper that holds."""
    loads = np.array([pick.loads for pick in picks])
    values = gripper.skin.read(loads, np.random.default_rng(SEED))
    gripper.pipeline.reset()
    recording = Recording.from_arrays(gripper.pipeline.layout, values)
    single, batch = frame_us(gripper.pipeline, recording, range(len(recording)))
    what = f'one frame of {loads.shape[1]} taxels'
    return Row(what, 'us', single, aim=aim, us_single=single, us_batch=batch)


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
