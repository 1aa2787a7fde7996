# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""five_wire_skin on two worlds of its own: place and force on fresh touches, and their cost.

The worlds share nothing with the package's model: a border of uneven silver whose sheet a sine
series solves (`test/reference/five_wire_world.py`), and finite differences with silver pads, a
rough film over an air gap and creep (`five_wire_sheet.py`). Untouched, the foil floats. The chain
as printed is the linear formula and the network of [5] on its 16 squares.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from benchmarks.harness.independent import independent_rows
from benchmarks.harness.rows import BenchResult, Row, within
from benchmarks.worlds import five_wire_figures, five_wire_trials

if TYPE_CHECKING:
    from types import ModuleType

    from tactile_ros.pipeline import Pipeline
    from tactile_ros.types import Recording

SENSOR, LAYOUT = five_wire_trials.SENSOR, five_wire_trials.LAYOUT
SEEDS = {'quick': 1, 'normal': 3, 'full': 10}
SECONDS = {'quick': np.inf, 'normal': 120.0, 'full': np.inf}
FIRST_SEED = 1000
FEW = 500  # touches that compare methods
METHODS = (None, 'printed', 'ridge', 'grid_knn', 'kernel_ridge', 'perceptron')
ONE, TWO = 68.27, 95.45  # per cent of errors inside one and two sigma


def run(extent: str, command: str) -> BenchResult:
    """Measure places and forces over several worlds of both kinds."""
    quick = extent == 'quick'
    known = (
        five_wire_trials.world_module('five_wire_world'),
        five_wire_trials.world_module('five_wire_sheet'),
    )
    compared = METHODS[:-1] if quick else METHODS
    seeds, found, spreads, streams, methods = [], [], [], [], []
    for seed in within(SECONDS[extent], range(FIRST_SEED, FIRST_SEED + SEEDS[extent])):
        kinds = (known[1].SheetWorld, known[0].FiveWireWorld)
        for kind in kinds[: 1 if quick else 2]:
            figures, covered = five_wire_trials.world_figures(known[0], kind(seed), seed, quick)
            found.append(figures)
            spreads.append(covered)
        if not quick:
            streams.append(five_wire_trials.creep_figures(known[1], seed))
        methods.append({name: _judged(known, seed, name) for name in compared})
        seeds.append(seed)
    mean = {key: float(np.mean([one[key] for one in found])) for key in found[0]}
    creep = ('crept', 'uncrept', 'lightest')
    mean |= {key: float(np.mean([one[key] for one in streams] or [np.nan])) for key in creep}
    worst = max(one['force49'] for one in found)
    each = {key: tuple(one[key] for one in found) for key in found[0]}
    rows = [*_accuracy(mean, each, worst), *_covered(spreads), *_cost(mean), *_methods(methods)]
    rows = [row for row in rows if row.ours is None or np.isfinite(row.ours)]
    rows += independent_rows('five_wire_skin', extent)
    notes = [*_notes(quick), f'worlds: those of {len(seeds)} of {SEEDS[extent]} seeds']
    result = BenchResult('five_wire_skin', command, seeds, rows, notes)
    if not quick:
        world = known[0].FiveWireWorld(seeds[0])
        drawings, ways = five_wire_figures.drawn(known[0], world, seeds[0])
        result.drawings.update(drawings)
        result.rows.extend(ways)
    return result


def _judged(
    known: tuple[ModuleType, ModuleType], seed: int, name: str | None
) -> tuple[float, float, float]:
    """Errors of place (mm) and force (N), and time of a frame (us), learned from 49 places."""
    grids, sheets = known
    world, rng = sheets.SheetWorld(seed), np.random.default_rng(seed + 100)
    where, load = rng.uniform(12.5e-3, 87.5e-3, (FEW, 2)), rng.uniform(1, 15, FEW)
    test = grids.touches(world, LAYOUT, where, load, seed + 200)
    fit = SENSOR.pipeline(estimator=name).fit(
        five_wire_trials.calibration(grids, world, 7, seed + 300)
    )
    told = five_wire_trials.judged(fit, test)
    return (
        five_wire_trials.length(told.place),
        five_wire_trials.rms(told.force),
        _single(fit, test),
    )


def _methods(found: list[dict[str | None, tuple[float, float, float]]]) -> list[Row]:
    """Every estimator of place and force on the same touches, of each seed."""
    places, forces = [], []
    for name in found[0]:
        away, off, spent = (list(part) for part in zip(*(one[name] for one in found), strict=True))
        title = (name or 'chosen').replace('_', ' ')
        places.append(_method('place', 'mm', title, away, spent))
        forces.append(_method('force', 'N', title, off, spent))
    return places + forces


def _single(pipeline: Pipeline, test: Recording) -> float:
    """Microseconds of a frame alone."""
    frames = [test.frame(row) for row in range(60)]
    least = min(
        five_wire_trials.seconds_of(lambda: [pipeline.process(f) for f in frames])
        for _ in range(5)
    )
    return 1e6 * least / len(frames)


def _method(what: str, unit: str, title: str, found: list[float], spent: list[float]) -> Row:
    """Row of an estimator among others."""
    return Row(
        f'{what} by {title}, 49 points', unit, float(np.mean(found)), us_single=min(spent),
        by_seed=tuple(found), compared=f'{what} on the five-wire skin, 49 points', method=title,
    )  # fmt: skip


def _accuracy(
    mean: dict[str, float], each: dict[str, tuple[float, ...]], worst: float
) -> list[Row]:
    """Rows of errors."""
    bound, least, there = mean['bound'], mean['least'], mean['least_there']
    return [
        Row('place, 25 points, mean', 'mm', mean['place25'], paper=5.0, peer=mean['linear'],
            bound=bound, aim=1.3 * bound, by_seed=each['place25']),
        Row('place, 25 points, mean (peer: thin plate)', 'mm', mean['place25'],
            peer=mean['plate'], bound=bound),
        Row('place, 16 points, mean', 'mm', mean['place16'], peer=mean['linear'], bound=bound,
            by_seed=each['place16']),
        Row('place, 49 points, mean', 'mm', mean['place49'], bound=bound,
            by_seed=each['place49']),
        Row('force at 49 calibration squares, 8 touches each, rms', 'N', mean['square8'],
            bound=there, aim=1.05 * there),
        Row('force at 49 calibration squares, 60 touches each, rms', 'N', mean['square60'],
            bound=there, aim=1.05 * there),
        Row('the same, 8 touches (bound: noise of all three readings)', 'N', mean['square8'],
            bound=mean['least_three'], aim=1.05 * mean['least_three']),
        Row('the same, 60 touches (bound: noise of all three readings)', 'N', mean['square60'],
            bound=mean['least_three'], aim=1.05 * mean['least_three']),
        Row('force anywhere, 49 points, rms', 'N', mean['force49'], paper=1.0,
            peer=mean['printed'], bound=least, aim=0.28, by_seed=each['force49']),
        Row('force anywhere, 49 points, rms of the worst world', 'N', worst, aim=0.28),
        Row('force anywhere, 25 points, rms', 'N', mean['force25'], bound=least,
            by_seed=each['force25']),
        Row('force anywhere, 16 points, rms', 'N', mean['force16'], peer=mean['printed'],
            bound=least),
        Row('network as printed: at its 16 squares (peer: between them)', 'N', mean['at_squares'],
            peer=mean['printed'], paper=0.5),
        Row('force, worst over 16 squares (peer: mean curve)', 'N', mean['worst16'], paper=0.5,
            peer=mean['curve16']),
        Row('presses with creep, 49 places, rms (peer: without its model)', 'N', mean['crept'],
            peer=mean['uncrept']),
        Row('air gap: lightest force felt', 'N', mean['lightest']),
        Row('non-linearity, 16 squares (peer: before)', '%', mean['bent'], paper=4.5,
            peer=mean['raw_bent']),
        Row('relative std, 16 squares (peer: before)', '%', mean['uneven'], paper=8.6,
            peer=mean['raw_uneven']),
    ]  # fmt: skip


def _covered(spreads: list[dict[str, list[float]]]) -> list[Row]:
    """Rows of coverage, means over worlds: inside one and two sigma, the worst third and world.

    Touches between the same places of a calibration err together, so that chance has a group for
    each place of each world.
    """
    rows = []
    for name in spreads[0]:
        one, two, *thirds = np.mean([world[name] for world in spreads], axis=0)
        far = max(abs(third - ONE) for third in thirds)
        groups = len(spreads) * int(name.split()[1])
        for what, off, share, count in (
            ('68.3 inside one sigma', abs(one - ONE), ONE, groups),
            ('95.4 inside two sigma', abs(two - TWO), TWO, groups),
            ('68.3 in the worst third of sigma', far, ONE, groups / 3),
        ):
            chance = 1.96 * float(np.sqrt(share * (100 - share) / count))
            rows.append(
                Row(f'{name}: off {what}', 'points', off, bound=chance, aim=max(5.0, chance))
            )
        worst = max(abs(world[name][0] - ONE) for world in spreads)
        rows.append(Row(f'{name}: off 68.3 inside one sigma in the worst world', 'points', worst))
    return rows


def _cost(mean: dict[str, float]) -> list[Row]:
    """Rows of time."""
    return [
        Row('estimators, one frame', 'us', mean['estimators'], aim=30.0,
            us_single=mean['single'], us_batch=mean['batch']),
        Row('fit, 392 touches', 's', mean['fit'], aim=20.0),
    ]  # fmt: skip


def _notes(quick: bool) -> list[str]:
    """What the figures stand on."""
    return [
        'peer, where not named: the formula and the network of [5], learned on 16 squares',
        'bound: noise of the readings alone, everything else known; of forces that of the divider '
        'with the place known, which no frame tells: that of all three readings (x, y and force '
        'unknown, Cramer and Rao) stands beside it; of a share inside sigma: what '
        'chance makes of it (95 %), with a group for each place of each calibration',
        'fresh touches 12.5 mm and more inside the border, 1..15 N; untouched, the foil floats',
        'non-linearity: largest deviation of the mean curve from its least-squares line over its '
        'range; relative std: mean over loads of the std over squares over their mean',
        *(
            [
                'quick: finite differences alone, without 60 touches a square, creep, '
                'perceptrons and drawings'
            ]
            * quick
        ),
    ]
