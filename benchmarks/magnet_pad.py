# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""magnet_pad: [2]'s neighbours beside ours and bounds, in a world that the package does not know.

The world (`test/reference/magnet_pad_world.py`) has exact blocks in a compressible body that
stiffens and fades towards its base, chips with gains, magnets that lie elsewhere than the config
says. Presses of 1.5..10 N, 4 uT of noise. Bounds are the posterior over many touches of the
world itself, with its own readings and slopes.
"""

from __future__ import annotations

import sys
import time
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.harness.independent import independent_rows
from benchmarks.harness.plots import drawings
from benchmarks.harness.rows import BenchResult, Row, within
from benchmarks.worlds import magnet_pad_sessions as pads
from benchmarks.worlds.cell_knn import CellKnn
from tactile_ros.evaluation.metrics import AXES, WITHIN, Coverage, accuracy, confusion, coverage

if TYPE_CHECKING:
    from collections.abc import Callable

    from benchmarks.worlds.magnet_pad_sessions import Session
    from tactile_ros.pipeline import Pipeline
    from tactile_ros.types import Array, ContactStates, Integers

SPEC, GRIDS, STRAY, REST = pads.SPEC, pads.GRIDS, pads.STRAY, pads.REST
LEARN, JUDGE, WORLD_SEED = pads.LEARN, pads.JUDGE, pads.WORLD_SEED
PRESSES = {'quick': 200, 'normal': 600, 'full': 1200}
SWEEP = {'quick': 400, 'normal': 1200, 'full': 4000}  # presses that neighbours alone share
PAPER = {6: 99.0, 15: 99.0, 25: 92.0}
PROBES = (2, 6, 10, 14)
TABLE_1 = ((98, 63, 64, 55), (45, 98, 83, 73), (49, 80, 99, 92), (44, 71, 95, 99))
CONE = np.pi / 4
SPECIMENS = {'quick': (), 'normal': (1, 2, 3, 4), 'full': tuple(range(1, 9))}
BODIES = {'quick': (), 'normal': (), 'full': tuple(range(1, 9))}  # whose coverage is judged
ALIKE_S = 6.0  # of one estimator beside others, for all its seeds
WARMER = (0.0, 2.0, 5.0)  # degrees above the temperature of the tare
FEW = 200  # presses that judge each specimen
THIRDS = ('least third', 'middle third', 'largest third')


def coverage_by_thirds(
    error: Array, variance: Array, groups: Integers
) -> dict[tuple[str, int], Coverage]:
    """Coverage by (part, sigmas): 'overall' and in the `THIRDS` of the stated variance."""
    kept = np.flatnonzero(np.isfinite(error) & np.isfinite(variance))
    order = kept[np.argsort(variance[kept], kind='stable')]
    thirds = zip(THIRDS, np.array_split(order, len(THIRDS)), strict=True)
    return {
        (part, sigmas): coverage(error[rows], variance[rows], groups[rows], sigmas)
        for part, rows in (('overall', order), *thirds)
        for sigmas in WITHIN
    }


def average_euclidean_error(said: Integers, true: Integers, centres: Array) -> float:
    """Mean distance of named cells from the true ones (mm); [2] divides by their number."""
    apart = centres[said, :2] - centres[true, :2]
    return 1e3 * float(np.hypot(apart[:, 0], apart[:, 1]).mean())


def run(extent: str, command: str) -> BenchResult:
    """All figures with one seed each for the world, for learning and for judging."""
    count, began = PRESSES[extent], time.monotonic()
    rows: list[Row] = []
    for name, part in parts(extent).items():
        sys.stderr.write(f'{time.monotonic() - began:5.0f} s  {name} ...\n')
        rows += part()
    said, voted, test = pads.pair(15, 1.0, count)
    costs = {row.what[9:]: (row.us_single or 1.0, row.ours or 0.0) for row in rows
             if row.what.startswith('place by ')}  # fmt: skip
    named = {'neighbours': voted, 'ours': said.cell[REST:]}
    plots = drawings(test.config.cells, test.touches.place, said.position[REST:], named,
                     test.touches.cell, costs)  # fmt: skip
    rows += independent_rows('magnet_pad', extent)
    seeds = [WORLD_SEED, LEARN, JUDGE]
    return BenchResult('magnet_pad', command, seeds, rows, _notes(extent, count), plots)


def parts(extent: str) -> dict[str, Callable[[], list[Row]]]:
    """What the bench consists of, by name; parts share fits, and nothing else."""
    count, found = PRESSES[extent], {}
    for cells in (15,) if extent == 'quick' else GRIDS:
        for spread in (1.0,) if extent == 'quick' else (0.1, 1.0):
            found[f'{cells} cells, {spread:g} wide'] = partial(_cells, cells, spread, count)
    found['coverage'] = partial(_coverage, count)
    found['neighbours'] = partial(_neighbours, extent)
    if extent != 'quick':
        found['probes'] = partial(_probes, count, extent)
        found['cone'] = partial(_cone, count // 2)
        found['mounts'] = partial(_sessions, count)
        found['untrained'] = partial(_untrained, count, extent)
        found['warm'] = partial(_warm, count)
    for seed in BODIES[extent]:
        found[f'coverage of specimen {seed}'] = partial(_specimen, seed, count)
    found['speed'] = partial(_speed, count, (0,) if extent == 'quick' else (0, 100, 200))
    return found


def _cells(cells: int, spread: float, count: int) -> list[Row]:
    """Cells and places with touches near the centres and anywhere."""
    where = 'near the centre' if spread < 1 else 'anywhere'
    ours, peer, seconds = pads.learned(cells, spread, count)
    said, voted, test = pads.pair(cells, spread, count)
    stray = pads.session(cells, count, spread, JUDGE, stray=STRAY)
    place, cell, met = pads.bounds(cells, spread, test, stray)
    far = 1e3 * np.linalg.norm(test.config.cells[voted] - test.touches.place, axis=1).mean()
    single, batch = pads.times(ours, test.recording)
    name = f'{cells} cells, {where}'
    return [
        Row(f'{name}: cells right', '%', pads.right(said, test), 'high',
            PAPER[cells] if spread < 1 else None, accuracy(voted, test.touches.cell), cell,
            100 - 1.2 * (100 - cell), single, batch),
        Row(f'{name}: place', 'mm', pads.away(said, test), peer=float(far), bound=place,
            aim=min(1.5 * place, far / 6) if spread == 1.0 else 1.5 * place),
        Row(f'{name}: average Euclidean error', 'mm',
            average_euclidean_error(said.cell[REST:], test.touches.cell, test.config.cells),
            peer=average_euclidean_error(voted, test.touches.cell, test.config.cells)),
        Row(f'{name}: cells right, 0.5 mT outside', '%',
            pads.right(ours.process_batch(stray.recording), stray), 'high',
            peer=accuracy(peer.predict(stray.change), stray.touches.cell), bound=met,
            aim=met - 1.5 if spread < 1 else None),
        Row(f'{name}: fit', 's', seconds, aim=20.0),
    ]  # fmt: skip


def _coverage(count: int) -> list[Row]:
    """Distance of shares inside one and two sigma from a Gaussian's: components and thirds."""
    ours, test = (
        pads.learned(15, 1.0, count)[0],
        pads.session(15, 3 * count, 1.0, JUDGE),
    )
    return _covered(ours, test)


def _specimen(seed: int, count: int) -> list[Row]:
    """Coverage of another specimen: the means over components, overall and by thirds."""
    train = pads.session(15, count, 1.0, LEARN + 10 * seed, specimen=seed)
    test = pads.session(15, 2 * count, 1.0, JUDGE + 10 * seed, specimen=seed)
    rows = _covered(SPEC.pipeline(train.config).fit(train.recording), test)
    worst = max(rows, key=lambda row: (row.ours or 0.0) - (row.aim or 0.0))
    return [replace(worst, what=f'specimen {seed}, worst of {len(rows)}: {worst.what}')]


def _covered(ours: Pipeline, test: Session) -> list[Row]:
    """Of every component of place and force that varies."""
    said, rows = ours.process_batch(test.recording), []
    groups = np.arange(len(test.touches.place))
    for name, true in (('position', test.touches.place), ('force', test.touches.force)):
        error = getattr(said, name)[REST:] - true
        variance = np.diagonal(getattr(said, f'{name}_cov'), axis1=1, axis2=2)[REST:]
        for k in np.flatnonzero(np.ptp(true, axis=0)):
            found = coverage_by_thirds(error[:, k], variance[:, k], groups)
            rows += [
                Row(f'{name} {AXES[k]}, {part}: inside {sigmas} sigma, off '
                    f'{100 * WITHIN[sigmas]:.1f} %', 'points',
                    100 * abs(one.share - WITHIN[sigmas]),
                    aim=100 * max(one.high - WITHIN[sigmas], WITHIN[sigmas] - one.low))
                for (part, sigmas), one in found.items()
            ]  # fmt: skip
    return rows


def _neighbours(extent: str) -> list[Row]:
    """[2]'s figures 5, 7 and 8: K, training share, cells and distance."""
    rows, count = [], SWEEP[extent]
    sweep = [(k, share, 2.0) for share in (20, 50, 80) for k in (1, 5, 10)]
    sweep += [(5, 50, 1.0), (5, 50, np.inf)]
    for cells in GRIDS:
        whole = pads.session(cells, count, 0.4, LEARN)
        order = np.random.default_rng(0).permutation(count)
        for k, share, power in sweep if extent == 'full' else [(1, 20, 2.0), (5, 50, 2.0)]:
            seen, new = np.split(order, [len(order) * share // 100])
            knn = CellKnn(k, power).fit(whole.change[seen], whole.touches.cell[seen])
            said, true = knn.predict(whole.change[new]), whole.touches.cell[new]
            table = confusion(said, true, cells)
            error = average_euclidean_error(said, true, whole.config.cells)
            what = f'neighbours of [2], {cells} cells, K {k}, {share} % training'
            what += '' if power == 2 else f', distance of power {power:g}'
            rows += [
                Row(f'{what}: cells right', '%', accuracy(said, true), 'high', 92.0),
                Row(f'{what}: average Euclidean error', 'mm', error),
                Row(f'{what}: worst cell', '%', float(np.nanmin(np.diag(table))), 'high'),
            ]
    return rows


def _probes(count: int, extent: str) -> list[Row]:
    """Table 1 of [2]: trained on one probe, on two and on all, judged on each."""
    each = {p: pads.session(15, count // 3, 0.4, 10 + p, tip=p / 2e3) for p in PROBES}
    fresh = {p: pads.session(15, count // 3, 0.4, 50 + p, tip=p / 2e3) for p in PROBES}
    learned = [(p,) for p in PROBES] + [(2, 14), PROBES]
    learned += [(2, 6), (6, 14)] if extent == 'full' else []
    rows = []
    for known in learned:
        ours, peer = pads.joined(*(each[p] for p in known))
        for p in PROBES:
            one, names = fresh[p], ' and '.join(map(str, known)) if len(known) < 4 else 'all'
            printed = TABLE_1[PROBES.index(known[0])][PROBES.index(p)]
            printed = printed if len(known) == 1 else 97 if len(known) == 4 else None
            rows.append(
                Row(f'15 cells, {p} mm probe, learned on {names} mm: cells right', '%',
                    pads.right(ours.process_batch(one.recording), one), 'high', printed,
                    accuracy(peer.predict(one.change), one.touches.cell)))  # fmt: skip
    return rows


def _cone(count: int) -> list[Row]:
    """Forces up to 45 degrees from the normal, by tips of 2 and 6 mm."""
    rows, kept = [], []
    for probe, printed in ((2, 92.0), (6, 96.0), (None, 93.0)):
        sizes = [probe] if probe else [2, 6]
        train = [pads.session(15, count, 0.4, 20 + p, tip=p / 2e3, cone=CONE) for p in sizes]
        test = [pads.session(15, count, 0.4, 30 + p, tip=p / 2e3, cone=CONE) for p in sizes]
        ours, peer = pads.joined(*train)
        said = [(ours.process_batch(t.recording), t) for t in test]
        name = f'15 cells, cone of 45 degrees, {probe or "2 and 6"} mm'
        voted = np.mean([accuracy(peer.predict(t.change), t.touches.cell) for t in test])
        right = float(np.mean([pads.right(*s) for s in said]))
        rows.append(Row(f'{name}: cells right', '%', right,
                        'high', printed, float(voted)))  # fmt: skip
        kept.append(
            Row(
                f'{name}: place',
                'mm',
                float(np.mean([pads.away(*s) for s in said])),
            )
        )
    return rows + kept


def _sessions(count: int) -> list[Row]:
    """A mount that was not learned from."""
    mounts = [
        pads.session(15, count // 3, 0.4, seed, mount=1e-4, remounted=seed, number=seed)
        for seed in range(1, 4)
    ]
    fresh = pads.session(15, count, 0.4, 9, mount=1e-4, remounted=9)
    ours, peer = pads.joined(*mounts)
    right = pads.right(ours.process_batch(fresh.recording), fresh)
    voted = accuracy(peer.predict(fresh.change), fresh.touches.cell)
    what = '15 cells, a new mount where three are known: cells right'
    return [Row(what, '%', right, 'high', peer=voted, aim=97.0)]


def _untrained(count: int, extent: str) -> list[Row]:
    """Nothing but resting frames, on the mechanics of the config and on another body.

    Magnets of every specimen lie elsewhere than the config says, but in the row that says so.
    """
    plain = {'poisson': 0.5, 'stiffening': 1e9, 'height': 0.0, 'base': 1e-6, 'gains': 0.0}
    other: dict[str, float] = {}
    half, body = 'a half-space as in the config', 'another body'
    cases = [
        (WORLD_SEED, count, plain, 0.0, half, 0.9), (WORLD_SEED, count, other, 0.0, body, 2.0),
        (WORLD_SEED, count, plain, STRAY, 'a half-space, 0.5 mT outside', None),
        (WORLD_SEED, count, {**plain, 'amiss': 0.0}, 0.0, f'{half}, magnets too', 0.9),
    ]  # fmt: skip
    for seed in SPECIMENS[extent]:
        cases += [(seed, FEW, plain, 0.0, half, 0.9), (seed, FEW, other, 0.0, body, 2.0)]
    rows = []
    for seed, presses, pad, stray, what, aim in cases:
        test = pads.session(15, presses, 1.0, JUDGE, stray=stray, specimen=seed, **pad)
        ours = SPEC.pipeline(test.config).fit(test.recording.select(test.recording.tare))
        away = pads.away(ours.process_batch(test.recording), test)
        rows.append(Row(f'rest frames only, specimen {seed}, {what}: place', 'mm', away, aim=aim))
    return rows


def _warm(count: int) -> list[Row]:
    """Warmer than at the tare; peer: the same readings where chips tell no temperature."""
    ours, rows, usual = pads.learned(15, 1.0, count)[0], [], (np.inf, np.inf)
    for rise in WARMER:
        test = pads.session(15, count, 1.0, JUDGE, warm=rise)
        blind = replace(test.recording, temperature_c=None)
        told, untold = (_judged(ours.process_batch(one), test) for one in (test.recording, blind))
        usual = usual if rise else told[:2]
        what = f'{rise:g} degrees above the tare'
        off, peer = (100 * abs(one[2].share - WITHIN[2]) for one in (told, untold))
        allowed = 100 * max(told[2].high - WITHIN[2], WITHIN[2] - told[2].low)
        rows += [
            Row(f'{what}: place', 'mm', told[0], peer=untold[0], aim=1.1 * usual[0]),
            Row(f'{what}: Fz', 'N', told[1], peer=untold[1], aim=1.1 * usual[1]),
            Row(f'{what}: Fz inside 2 sigma, off {100 * WITHIN[2]:.1f} %', 'points', off,
                peer=peer, aim=allowed),
        ]  # fmt: skip
    return rows


def _judged(said: ContactStates, test: Session) -> tuple[float, float, Coverage]:
    """Mean error of places (mm), that of Fz (N, root mean square), and what its sigmas hold."""
    error = said.force[REST:, 2] - test.touches.force[:, 2]
    held = coverage(error, said.force_cov[REST:, 2, 2], np.arange(len(error)), 2)
    return pads.away(said, test), float(np.sqrt((error**2).mean())), held


def _speed(count: int, seeds: tuple[int, ...]) -> list[Row]:
    """The neighbours of [2] on 10 000 samples, and the inversion, alone (us)."""
    ours, _, _ = pads.learned(15, 1.0, count)
    many, test = (
        pads.session(15, 10_000, 1.0, 5),
        pads.session(15, 200, 1.0, 6),
    )
    knn = CellKnn(5).fit(many.change, many.touches.cell)
    alone = [test.change[i : i + 1] for i in range(200)]
    inversion, cells = ours.estimation.inversion_, test.config.cells
    rows = []
    for name in (None, 'ridge', 'grid_knn', 'kernel_ridge', 'perceptron'):
        away, right, force = [], [], []
        for seed in within(ALIKE_S, seeds):
            train, fresh = (pads.session(15, count, 1.0, seed + part) for part in (LEARN, JUDGE))
            own = name is None and seed == 0
            one = ours if own else SPEC.pipeline(test.config, name).fit(train.recording)
            said = one.process_batch(fresh.recording)
            away.append(pads.away(said, fresh))
            right.append(pads.right(said, fresh))
            force.append(pads.off_force(said, fresh))
        single, batch = pads.times(one, fresh.recording)
        title = 'table Gauss-Newton' if name is None else name.replace('_', ' ')
        rows.append(
            Row(f'place by {title}', 'mm', float(np.mean(away)), us_single=single,
                us_batch=batch, by_seed=tuple(away), compared='place on the pad, 15 cells',
                method=title)
        )  # fmt: skip
        rows.append(
            Row(f'force by {title}', 'N', float(np.mean(force)), us_single=single,
                us_batch=batch, by_seed=tuple(force), compared='force on the pad, 15 cells',
                method=title)
        )  # fmt: skip
        if (said.cell >= 0).any():  # regressors of the place name none
            rows.append(
                Row(f'cell by {title}', '%', float(np.mean(right)), 'high', us_single=single,
                    us_batch=batch, by_seed=tuple(right), method=title,
                    compared='cells right on the pad, of 15')
            )  # fmt: skip
    rows += [
        Row('five neighbours among 10 000, one frame', 'us',
            pads.least_us(knn.predict, alone), aim=20.0),
        Row('inversion, one frame', 'us',
            pads.least_us(lambda x: inversion.invert(x, cells), alone), aim=60.0),
    ]  # fmt: skip
    return rows


def _notes(extent: str, count: int) -> list[str]:
    """What the figures stand on."""
    return [
        f'extent {extent}: {count} presses to learn from, as many others to be judged on',
        'peer: five nearest neighbours [2]; its place is the centre of the cell that it names',
        'bound: posterior over touches of the world, which knows where touches are likely',
        'one frame and batch of cells: the whole pipeline; the rows at the end: estimators alone',
        'sigmas: aim of 5 points, or the 95 % binomial interval of the judged presses',
        'near the centre: within a tenth of a cell; probes, cone, mounts: within 0.4 of a cell',
        *(
            ['quick: 15 cells, touches anywhere; no probes, cone, mounts, untrained specimens']
            if extent == 'quick'
            else []
        ),
    ]
