# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Pick and place of `tactile bench taxel_array`: washers, angle tubes and a jaw of 2000 taxels.

The grippers are those of [4]; each world has a skin of its own with taxels that are broken, and a
part is right where it went to its place.
"""

from __future__ import annotations

from itertools import product
from time import perf_counter
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import least_squares
from scipy.special import ndtr

from benchmarks.harness import plots
from benchmarks.harness.rows import Row, within
from reference import pick_world
from tactile_ros.conditioning.baseline import BaselineTracker
from tactile_ros.conditioning.faults import taxel_faults, usable_rows, without_faults
from tactile_ros.conditioning.viscoelastic import Creep
from tactile_ros.sensors import load_sensor
from tactile_ros.types import Frame, Recording

if TYPE_CHECKING:
    from collections.abc import Iterator

    from reference.pick_world import Gripper, Picked, TaxelSkin
    from tactile_ros.pipeline import Pipeline
    from tactile_ros.types import Array

SEED = 4  # of what is not of a world
WORLDS = 300  # seeds of skins and picks
PICKS = {'quick': (1, 2), 'normal': (2, 15), 'full': (8, 100)}  # worlds, picks of each
SECONDS = {'quick': np.inf, 'normal': 20.0, 'full': np.inf}  # of the worlds of each gripper
ASKED = 15  # picks of each world whose other tube is looked for
SPAN, NODES, TURNS = 2.8e-3, 9, 4  # m; places along a side, and turns within a sector, to begin at
LAW_ERROR = 0.003  # of a force: what 150 even loads leave open
SPEC = load_sensor('taxel_array')


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
    picks, drawings, limit = {}, {}, np.nan
    for name, kind in kinds.items():
        few = max(count // 4, 3) if name == 'jaw' else count
        grips, picks[name] = [], []
        for i in within(SECONDS[extent], range(worlds)):
            grips.append(_world(kind, WORLDS + i))
            rng = np.random.default_rng([WORLDS + i, 1])
            picks[name].append([grips[-1].pick(rng) for _ in range(few)])
        if name == 'tube':
            limit = _limit(grips, picks[name])
        drawings[name] = _draw_pick(kind[0], picks[name][0][0])
    rows = [
        _placed('pick and place: washers of 5 types, 5 bad taxels', picks['washer'], 95.0, 99.0),
        *_tube_rows(picks.get('tube', []), limit),
        _placed('pick and place: parts in a jaw of 2000, 20 bad taxels', picks['jaw'], None, 99.0),
        _jaw_time(grips[0], picks['jaw'][0]),
        Row(
            'conditioning of 2000 taxels: baseline, laws, two branches of creep',
            'us',
            _conditioning(grips[0]),
            aim=100.0,
        ),
    ]
    return rows, drawings, [WORLDS + i for i in range(max(map(len, picks.values())))]


def _tube_rows(picks: list[list[Picked]], limit: float) -> list[Row]:
    """Of tubes, where there were any."""
    if not picks:
        return []
    turn = [
        np.rad2deg(pick_world.turn_between(float(p.state.yaw), float(p.pose[2]), 1))
        for part in picks
        for p in part
    ]
    return [
        _placed('pick and place: angle tubes of 2 bends, 16 taxels', picks, 100.0, 100.0, limit),
        Row('picked tubes: turn, median', 'deg', float(np.nanmedian(turn))),
    ]


def _world(kind: tuple, seed: int) -> Gripper:
    """One gripper with a skin of its own."""
    config, half_load, top, force, play, broken = kind
    rng = np.random.default_rng(seed)
    skin = pick_world.TaxelSkin.drawn(len(config.positions), half_load, rng, broken)
    taught = pick_world.even_loads(SPEC.layout(config), config.areas, skin, rng, top)
    pipeline = SPEC.pipeline(config).fit(taught)
    return pick_world.Gripper(config, pick_world.TaxelScene(config), skin, pipeline, force, play)


def _placed(
    what: str, picks: list[list[Picked]], paper: float | None, aim: float,
    bound: float | None = None,
) -> Row:  # fmt: skip
    """Per cent of parts that went where they belong, of all worlds and of each."""
    each = [100.0 * float(np.mean([pick.placed for pick in part])) for part in picks]
    count = sum(map(len, picks))
    worlds = f'{len(picks)} world' + 's' * (len(picks) > 1)
    return Row(
        f'{what} ({count} picks in {worlds})', '%', float(np.mean(each)), 'high', paper=paper,
        aim=aim, bound=bound, by_seed=tuple(each),
    )  # fmt: skip


def _limit(grips: list[Gripper], picks: list[list[Picked]]) -> float:
    """Per cent of tubes whose bend and turn a rule that knows this very world may tell.

    Of two tubes whose readings are d sigmas apart at the nearest poses a rule of Bayes names
    Phi(d / 2) rightly; a turn lies within its clearance as often as Cramer and Rao let it.
    """
    right = []
    for gripper, taken in zip(grips, picks, strict=True):
        starts = [list(_begins(gripper, part)) for part in range(len(gripper.config.objects))]
        for pick in taken[:ASKED]:
            sigma = _sigma(gripper.skin, pick.loads)
            apart = min(
                _apart(gripper, part, pick.loads, sigma, begins)
                for part, begins in enumerate(starts)
                if part != pick.part
            )
            turn = _turn_sigma(gripper, pick, sigma)
            right.append(ndtr(apart / 2) * (2 * ndtr(pick_world.DEPOSIT_CLEARANCE / turn) - 1))
    return 100 * float(np.mean(right))


def _begins(gripper: Gripper, part: int) -> Iterator[tuple[Array, Array]]:
    """Poses (3,) of a part, and loads (t,) of one newton there; all sectors are alike."""
    count = gripper.scene.taxels
    line, sector = np.linspace(-SPAN, SPAN, NODES), 2 * np.pi / count
    for x, y, turn in product(line, line, sector * np.arange(TURNS) / TURNS):
        load = gripper.scene.loads(gripper.config.objects[part], np.array([x, y, turn]), 1.0)
        for k in range(count):
            cos, sin = np.cos(k * sector), np.sin(k * sector)
            pose = np.array([cos * x - sin * y, sin * x + cos * y, turn + k * sector])
            yield pose, np.roll(load, k)


def _sigma(skin: TaxelSkin, load: Array) -> Array:
    """Standard deviation (t,) of what one frame tells of loads (N)."""
    known = np.maximum(load, 1e-4)
    size = (known / skin.half_load) ** skin.power
    slope = skin.gain * skin.power * size / (known * (1 + size) ** 2)
    return np.asarray(np.hypot(np.hypot(skin.noise, 1 / skin.steps / 12**0.5) / slope,
                               LAW_ERROR * known))  # fmt: skip


def _apart(
    gripper: Gripper, part: int, load: Array, sigma: Array, begins: list[tuple[Array, Array]]
) -> float:
    """Least distance (sigmas) of loads from those of a part at any pose and force."""
    force, outline = float(load.sum()), gripper.config.objects[part]
    wrong = (force * np.array([one for _, one in begins]) - load) / sigma
    pose = begins[int(np.square(wrong).sum(axis=1).argmin())][0]
    scale = np.array([1e-3, 1e-3, 0.1, 0.1 * force])

    def left(steps: Array) -> Array:
        x, y, turn, now = np.append(pose, force) + scale * steps
        return np.asarray(
            (gripper.scene.loads(outline, np.array([x, y, turn]), now) - load) / sigma
        )

    found = least_squares(left, np.zeros(4), diff_step=1e-2, max_nfev=10)
    return float(np.sqrt(2 * found.cost))


def _turn_sigma(gripper: Gripper, pick: Picked, sigma: Array) -> float:
    """Standard deviation (rad) of a turn, place and force unknown, by Cramer and Rao."""
    outline, steps, force = gripper.config.objects[pick.part], 1e-4, float(pick.loads.sum())
    slopes = [pick.loads / force]
    for away in np.diag([steps, steps, 1e2 * steps]):
        high, low = (gripper.scene.loads(outline, pick.pose + d, force) for d in (away, -away))
        slopes.append((high - low) / (2 * away.sum()))
    terms = np.stack(slopes, axis=1) / sigma[:, None]
    return float(np.sqrt(np.linalg.inv(terms.T @ terms)[3, 3]))


def frame_us(pipeline: Pipeline, recording: Recording) -> float:
    """Median over frames of the least time of one live frame (us)."""
    spent = []
    for i in range(min(len(recording), 60)):
        frame = Frame(None, i, recording.values[i])
        times = []
        for _ in range(7):
            began = perf_counter()
            pipeline.process(frame)
            times.append(perf_counter() - began)
        spent.append(min(times))
    return 1e6 * float(np.median(spent))


def _jaw_time(gripper: Gripper, picks: list[Picked]) -> Row:
    """Time of a frame of a jaw, alone and in a batch (us)."""
    rng = np.random.default_rng(SEED)
    values = gripper.skin.read(np.array([pick.loads for pick in picks]), rng)
    recording = Recording.from_arrays(SPEC.layout(gripper.config), values)
    gripper.pipeline.reset()
    single, times = frame_us(gripper.pipeline, recording), []
    for _ in range(5):
        began = perf_counter()
        gripper.pipeline.process_batch(recording)
        times.append(1e6 * (perf_counter() - began) / len(recording))
    return Row('one frame of 2000 taxels', 'us', single, aim=3000.0, us_single=single,
               us_batch=min(times))  # fmt: skip


def _conditioning(gripper: Gripper) -> float:
    """Least time from readings to forces of a frame, the creep of two branches undone (us)."""
    pipeline, law = gripper.pipeline, gripper.pipeline.estimation.law_  # type: ignore[attr-defined]
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


def _draw_pick(config: object, pick: Picked) -> str:
    """A part as it was felt, found, and as it lay."""
    part = plots.edges_of(config.objects[pick.part])  # type: ignore[attr-defined]
    corners = plots.taxel_corners(
        config.positions, config.areas, config.taxel_outlines  # type: ignore[attr-defined]
    )  # fmt: skip
    found: list[Array] = []
    if pick.state.label >= 0:
        pose = pick.state.object_pose
        turn = np.arctan2(pose[1, 0], pose[0, 0])
        shown = plots.edges_of(config.objects[pick.state.label])  # type: ignore[attr-defined]
        found = plots.placed(shown, np.array([*pose[:2, 3], turn]))
    pressure = pick.state.taxel_force / config.areas  # type: ignore[attr-defined]
    told = 'Pressure on the taxels, the object as it lies and as it was found'
    return plots.object_map(corners, pressure, found, plots.placed(part, pick.pose), told)
