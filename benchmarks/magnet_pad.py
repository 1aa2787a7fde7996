"""magnet_pad in a world of the nominal mechanics: [2]'s nearest neighbours beside ours and bounds.

Presses of 1.5..10 N by a tip of 6 mm along the normal, 4 uT of noise, half of them to learn from.
The bound of a place is that of Cramer and Rao with place and load unknown; that of a cell follows
from it, and under a stray field from a table of many more touches than anyone records.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.estimators.touch_table import TouchTable
from tactile_ros.evaluation.benchmark import BenchResult, Row
from tactile_ros.sensors import load_sensor
from tactile_ros.sensors.magnet_pad.cells import PLAN, nearest, shares_of_cells
from tactile_ros.sensors.magnet_pad.config import MagnetPadConfig, surface_cells
from tactile_ros.sensors.magnet_pad.nominal import Presses, change_of_field
from tactile_ros.types import Array, Integers, Recording

if TYPE_CHECKING:
    from tactile_ros.pipeline import Pipeline
    from tactile_ros.types import ContactStates

PRESSES = {'quick': 600, 'normal': 1500, 'full': 4000}
GRIDS = {6: (3, 2), 15: (5, 3), 25: (5, 5)}
PAPER = {6: 99.0, 15: 99.0, 25: 92.0}
NOISE, STRAY, TIP, REST = 4e-6, 0.5e-3, 3e-3, 60
DENSE = 60_000
SPEC = load_sensor('magnet_pad')


@dataclass(frozen=True)
class World:
    """Presses of one session, with what was read."""

    config: MagnetPadConfig
    presses: Presses
    cells: Integers
    recording: Recording

    @property
    def places(self) -> Array:
        """True places, shape (s, 3) (m)."""
        return self.presses.places(self.config.radius)


def touches(
    config: MagnetPadConfig, grid: tuple[int, int], count: int, jitter: float, seed: int
) -> tuple[Presses, Integers]:
    """Presses around the centres of cells, within `jitter` of a cell's width."""
    rng = np.random.default_rng(seed)
    cell = rng.permutation(np.arange(count) % len(config.cells))
    width = np.array([config.length / grid[0], 2 * config.radius / grid[1]])
    plan = config.cells[cell, :2] + jitter * width * rng.uniform(-0.5, 0.5, (count, 2))
    around = np.arccos(np.clip(plan[:, 1] / config.radius, -0.97, 0.97))
    normal = np.column_stack([np.zeros(count), np.cos(around), np.sin(around)])
    force = rng.uniform(1.5, 10, (count, 1)) * normal
    tip, free = np.full(count, TIP), np.zeros(count)
    return Presses(plan[:, 0], around, force, tip, free), cell


def world(
    grid: tuple[int, int], count: int, jitter: float, seed: int, *, stray: float = 0.0,
    mount: float = 0.0,
) -> World:  # fmt: skip
    """A session; `mount` is how far magnets lie from where they should (m)."""
    rng = np.random.default_rng(seed + 1000)
    config = replace(SPEC.config(), cells=surface_cells(*grid))
    assert isinstance(config, MagnetPadConfig)
    presses, cell = touches(config, grid, count, jitter, seed)
    off = mount * rng.normal(size=config.magnet_positions.shape)
    moved = replace(config, magnet_positions=config.magnet_positions + off)
    outside = rng.normal(size=(count, 3))
    outside *= stray / np.linalg.norm(outside, axis=1, keepdims=True)
    change = change_of_field(moved, presses) + outside[:, None]
    values = 1e-3 + np.concatenate([np.zeros((REST, *change.shape[1:])), change])
    values += NOISE * rng.normal(size=values.shape)
    blank = np.full((REST, 3), np.nan)
    truth = {
        'position': np.concatenate([blank, presses.places(config.radius)]),
        'force': np.concatenate([blank, presses.force]),
        'cell': np.concatenate([np.full(REST, -1), cell]),
        'repetition': np.concatenate([np.zeros(REST, int), np.arange(count)]),
    }
    tare = np.arange(len(values)) < REST
    recording = Recording.from_arrays(SPEC.layout(config), values, tare=tare, truth=truth)
    return World(config, presses, cell, recording)


def run(extent: str, command: str) -> BenchResult:
    """All figures with one seed each for learning and judging."""
    count = PRESSES[extent]
    rows: list[Row] = []
    for cells, grid in GRIDS.items():
        rows += _cells(cells, grid, count)
    rows += _sessions(count) + _untrained(count)
    return BenchResult('magnet_pad', command, [1, 2], rows, _notes(extent, count))


def _cells(cells: int, grid: tuple[int, int], count: int) -> list[Row]:
    """Cells and places with touches near the centres and anywhere."""
    rows = []
    for jitter, where in ((0.1, 'near the centre'), (1.0, 'anywhere')):
        train, test = world(grid, count, jitter, 1), world(grid, count, jitter, 2)
        stray = world(grid, count, jitter, 2, stray=STRAY)
        began = time.process_time()
        ours = SPEC.pipeline(train.config).fit(train.recording)
        seconds = time.process_time() - began
        peer = SPEC.pipeline(train.config, 'grid_knn').fit(train.recording)
        single, batch = _times(ours, test.recording)
        printed = PAPER[cells] if jitter < 1 else None
        place, cell = _bounds(test)
        said, voted = _states(ours, test), _states(peer, test)
        far = np.linalg.norm(train.config.cells[voted.cell[REST:]] - test.places, axis=1)
        name = f'{cells} cells, {where}'
        blind = _blind(stray, grid, jitter)
        rows += [
            Row(f'{name}: cells right', '%', _right(said, test), 'high', printed,
                _right(voted, test), cell, 100 - 1.2 * (100 - cell), single, batch),
            Row(f'{name}: place', 'mm', _away(said, test), peer=1e3 * float(far.mean()),
                bound=place, aim=1.5 * place),
            Row(f'{name}: cells right, 0.5 mT outside', '%', _right(_states(ours, stray), stray),
                'high', peer=_right(_states(peer, stray), stray), bound=blind,
                aim=blind - 1.5 if jitter < 1 else None),
            Row(f'{name}: fit', 's', seconds, aim=20.0),
        ]  # fmt: skip
    return rows


def _sessions(count: int) -> list[Row]:
    """A mount that was not learned from."""
    mounts = [world(GRIDS[15], count // 3, 0.4, seed, mount=1e-4) for seed in range(1, 4)]
    fresh = world(GRIDS[15], count, 0.4, 9, mount=1e-4)
    ours = SPEC.pipeline(fresh.config).fit(*(m.recording for m in mounts))
    peer = SPEC.pipeline(fresh.config, 'grid_knn').fit(*(m.recording for m in mounts))
    right, voted = _right(_states(ours, fresh), fresh), _right(_states(peer, fresh), fresh)
    what = '15 cells, a new mount where three are known: cells right'
    return [Row(what, '%', right, 'high', peer=voted, aim=97.0)]


def _untrained(count: int) -> list[Row]:
    """Nothing but resting frames, on the mechanics of the config and with another mount."""
    rows = []
    for mount, what, aim in ((0.0, 'nominal', 0.9), (2e-4, 'magnets 0.2 mm off', 2.0)):
        test = world(GRIDS[15], count, 1.0, 2, mount=mount)
        ours = SPEC.pipeline(test.config).fit(test.recording.select(test.recording.tare))
        said = _states(ours, test)
        rows.append(Row(f'rest frames only, {what}: place', 'mm', _away(said, test), aim=aim))
    return rows


def _states(pipeline: Pipeline, one: World) -> ContactStates:
    return pipeline.process_batch(one.recording)


def _right(states: ContactStates, one: World) -> float:
    """Share of touches that are named rightly (%)."""
    return 100 * float((states.cell[REST:] == one.cells).mean())


def _away(states: ContactStates, one: World) -> float:
    """Mean distance of places from the truth (mm)."""
    return 1e3 * float(np.nanmean(np.linalg.norm(states.position[REST:] - one.places, axis=1)))


def _bounds(one: World) -> tuple[float, float]:
    """Mean error of a place (mm), and share of cells (%), that no estimator beats."""
    config, presses, step = one.config, one.presses, 1e-5
    shifted = (
        replace(presses, along=presses.along + step),
        _turned(presses, step / config.radius),
        replace(presses, force=presses.force * (1 + 1e-3)),
    )
    level = change_of_field(config, presses)
    slopes = np.stack([change_of_field(config, p) - level for p in shifted], axis=-1)
    slopes = slopes.reshape(len(level), -1, 3) / (NOISE * np.array([step, step, 1e-3]))
    cov = np.linalg.inv(np.matmul(slopes.transpose(0, 2, 1), slopes))[:, :2, :2]
    normal = presses.normals
    frame = np.zeros((len(level), 3, 2))
    frame[:, 0, 0] = 1.0
    frame[:, 1, 1], frame[:, 2, 1] = -normal[:, 2], normal[:, 1]
    space = frame @ cov @ frame.transpose(0, 2, 1)
    draws = np.random.default_rng(3).normal(size=(200, 2))
    spread = np.einsum('sij,nj->sni', np.linalg.cholesky(cov), draws)
    shares = shares_of_cells(one.places, space, config.cells, PLAN)
    named = nearest(one.places, config.cells, PLAN)
    hit = shares[np.arange(len(named)), named].mean()
    return 1e3 * float(np.linalg.norm(spread, axis=2).mean()), 100 * float(hit)


def _turned(presses: Presses, angle: float) -> Presses:
    """The same presses a little further around."""
    turned = replace(presses, around=presses.around + angle)
    size = np.linalg.norm(presses.force, axis=1, keepdims=True)
    return replace(turned, force=size * turned.normals)


def _blind(one: World, grid: tuple[int, int], jitter: float) -> float:
    """Share of cells (%) by the likelihood of very many touches under an unknown field."""
    presses, cell = touches(one.config, grid, DENSE, jitter, 77)
    x = change_of_field(one.config, presses).reshape(DENSE, -1)
    common = np.vstack([np.eye(3)] * len(one.config.positions))
    table = TouchTable(NOISE, common, STRAY / np.sqrt(3)).fit(x)
    seen = one.recording.values[REST:] - one.recording.values[:REST].mean(axis=0)
    shares = table.blame(seen.reshape(len(seen), -1)).shares(cell, len(one.config.cells))
    return 100 * float((shares.argmax(axis=1) == one.cells).mean())


def _times(pipeline: Pipeline, test: Recording) -> tuple[float, float]:
    """Microseconds per frame: one at a time, and in a batch; minima of three."""
    frames = [test.frame(row) for row in range(REST, REST + 200)]
    single, batch = [], []
    for _ in range(3):
        began = time.perf_counter()
        for frame in frames:
            pipeline.process(frame)
        single.append((time.perf_counter() - began) / len(frames))
        began = time.perf_counter()
        pipeline.process_batch(test)
        batch.append((time.perf_counter() - began) / len(test))
    return 1e6 * min(single), 1e6 * min(batch)


def _notes(extent: str, count: int) -> list[str]:
    """What the figures stand on."""
    return [
        f'extent {extent}: {count} presses to learn from, as many others to be judged on',
        'the world is a half-space under even pressure on 6 mm, the magnets eight dipoles each',
        'peer: five nearest neighbours; its place is the centre of the cell that it names',
        'bounds of places know nothing of where touches are likely: near centres ours is below',
        'bound of cells under a stray field: likelihood over 60 000 touches, size of field known',
    ]
