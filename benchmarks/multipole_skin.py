# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""multipole_skin in a world of its own: shapes and poses from few presses, or from none.

The world (`test/reference/multipole_world.py`) solves body, punch and field otherwise than the
package, and has flaws that no config tells: chips misplaced by 0.15 mm, tilted and of unlike gain,
an uneven sheet, the field of the Earth, drift, 4 uT of noise. Presses and places are drawn anew
for every seed; heads that are to be new are in no training.
"""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.harness.independent import independent_rows
from benchmarks.harness.rows import BenchResult, Row, within
from benchmarks.worlds import multipole_presses
from tactile_ros.estimators.few_shot import press_patterns
from tactile_ros.physics import compiled
from tactile_ros.types import Frame

if TYPE_CHECKING:
    from types import ModuleType

    from benchmarks.worlds.multipole_presses import Trials
    from tactile_ros.types import Array

SECONDS = {'quick': np.inf, 'normal': 400.0, 'full': np.inf}  # of all worlds
AGAIN = 30  # of which the fastest counts


def run(extent: str, command: str) -> BenchResult:
    """Shapes, poses and disturbances in every world, then time."""
    world, size = multipole_presses.world_module(), multipole_presses.EXTENTS[extent]
    trials, found = [], []
    for seed in within(SECONDS[extent], size.seeds):
        trials.append(multipole_presses.Trials(world, seed, size))
        found.append(trials[-1].all(tables=size.whole and seed == size.seeds[0]))
    names = {name for one in found for name in one}

    def known(name: str) -> tuple[float, ...]:
        return tuple(one[name] for one in found if name in one)

    def mean(name: str) -> float | None:
        return float(np.mean(known(name))) if known(name) else None

    rows = []
    for what, unit, name, better, paper, aim in FIGURES:
        if name in names:
            rows.append(
                Row(
                    what, unit, mean(name), better, paper=paper, peer=mean(f'{name} peer'),
                    bound=mean(f'{name} bound'), aim=aim, by_seed=known(name),
                )
            )  # fmt: skip
    rows += cost(trials[0], world)
    rows += independent_rows('multipole_skin', extent)
    few = (
        f'five new heads at {size.places} place(s) and {size.posed} poses'
        if size.places
        else 'quick: neither rest alone, new heads nor the bar'
    )
    notes = [
        f'{len(trials)} of {len(size.seeds)} worlds; {size.tested} presses of nine heads in each, '
        f'{few}; what is not named, or has no turn, is wrong',
        'peer: prototypes of whole windows with 1 / 3 / 5 shots, or nearest neighbours where '
        'classes are learned; of points lost, prototypes of five shots of the new heads',
        'bound: of turn and place what noise leaves where all else but the depth is known (Cramer '
        'and Rao); of shapes (--full) the same estimator with the chips, gains and bands of the '
        'world, which is no bound: a skin mended by presses does better',
        'paper: on its own sheet and heads, of which it gives no drawing',
    ]
    return BenchResult('multipole_skin', command, [one.seed for one in trials], rows, notes)


FIGURES: list[tuple[str, str, str, str, float | None, float | None]] = [
    ('shape, new places, 9 heads: rest alone', '%', 'rest', 'high', None, None),
    ('shape, new places, 9 heads: 20 presses of one', '%', 'zero', 'high', None, 90.0),
    ('  the same, not named', '%', 'unnamed', 'low', None, None),
    ('  the same, 0.05 mT after the tare: points lost', '1', 'stray', 'low', None, 4.0),
    ('shape, held-out fifth of 25 places, 9 heads', '%', 'split', 'high', 81.33, None),
    ('new heads, nine old open, 1 shot', '%', 'shot 1', 'high', 81.33, 90.0),
    ('new heads, nine old open, 3 shots', '%', 'shot 3', 'high', 84.18, None),
    ('new heads, nine old open, 5 shots', '%', 'shot 5', 'high', 84.60, 94.0),
    ('  old heads there, after 5 shots of the new', '%', 'kept', 'high', None, None),
    ('pose of six, bar never pressed, new place', '%', 'pose', 'high', 98.4, 98.0),
    ('  without a turn', '%', 'unturned', 'low', None, None),
    ('  its turn, median', 'deg', 'turn', 'low', None, 1.5),
    ('  its place, median', 'mm', 'place', 'low', None, 0.35),
    ('places inside 1 sigma', '%', 'sigma 1', 'high', None, None),
    ('places inside 2 sigma', '%', 'sigma 2', 'high', None, None),
    *((f'named with {low} to {high} %: {what}', '%', f'{what} {low}', 'high', None, None)
      for low, high in ((0, 70), (70, 90), (90, 100)) for what in ('stated', 'right')),
]  # fmt: skip


def cost(trials: Trials, world: ModuleType) -> list[Row]:
    """Microseconds of a window's last frame, of its search among templates, and of the network."""
    pipeline, one = trials.ours, trials.one
    tare = one.values[: world.TARE]
    window = one.values[world.TARE : world.TARE + world.WINDOW]
    pipeline.tare([Frame(i, i, row) for i, row in enumerate(tare)])
    recogniser = pipeline.estimation.recogniser_  # type: ignore[attr-defined]
    change = (window - tare.mean(axis=0)).reshape(len(window), -1)
    presses = press_patterns([change], recogniser.basis)

    def frames() -> Array:
        pipeline.reset()
        ends = [time.perf_counter()]
        for i, row in enumerate(window):
            pipeline.process(Frame(10**9 + 12_500_000 * i, i, row))
            ends.append(time.perf_counter())
        return np.diff(ends)[-2:]

    def search() -> float:
        began = time.perf_counter()
        recogniser.search.find(presses)
        return time.perf_counter() - began

    fast = 'numba' if compiled.AVAILABLE else 'arrays alone'
    before, last = np.min([frames() for _ in range(AGAIN)], axis=0)
    times = {
        'templates of nine heads': (min(search() for _ in range(AGAIN)), 500.0),
        'all that recognises a window': (last - before, 500.0),
        'a frame': (before, None), 'the last frame of a window': (last, None),
    }  # fmt: skip
    return [
        Row(f'{what} ({fast})', 'us', 1e6 * took, aim=aim, us_single=1e6 * took)
        for what, (took, aim) in times.items()
    ]
