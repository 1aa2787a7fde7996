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
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache, partial

import numpy as np
from scipy.spatial import cKDTree

from benchmarks.harness import plots
from benchmarks.harness.independent import independent_rows
from benchmarks.harness.rows import BenchResult, Row, frame_us, shortest, within
from reference.magnet_pad_world import PadWorld, Touches
from tactile_ros.estimators.gaussian_sum_table import GaussianSumTable, Linearised
from tactile_ros.evaluation.metrics import AXES, WITHIN, Coverage, accuracy, confusion, coverage
from tactile_ros.pipeline import Pipeline
from tactile_ros.sensors import load_sensor
from tactile_ros.sensors.magnet_pad.config import MagnetPadConfig, surface_cells
from tactile_ros.types import Array, ContactStates, Integers, Recording

SPEC = load_sensor('magnet_pad')
GRIDS = {6: (3, 2), 15: (5, 3), 25: (5, 5)}
STRAY, TIP, REST = 0.5e-3, 3e-3, 60
DENSE = {0.1: 2500, 1.0: 6000}
LEARN, JUDGE, WORLD_SEED = 1, 2, 0
PRESSES = {'quick': 200, 'normal': 600, 'full': 1200}
PAPER = {6: 99.0, 15: 99.0, 25: 92.0}
PROBES = (2, 6, 10, 14)
TABLE_1 = ((98, 63, 64, 55), (45, 98, 83, 73), (49, 80, 99, 92), (44, 71, 95, 99))
CONE = np.pi / 4
SPECIMENS = {'quick': (), 'normal': (1, 2, 3, 4), 'full': tuple(range(1, 9))}
ALIKE_S = 6.0  # of one estimator beside others, for all its seeds
WARMER = (0.0, 2.0, 5.0)  # degrees above the temperature of the tare
FEW = 200  # presses that judge each specimen
THIRDS = ('least third', 'middle third', 'largest third')
HALF_SPACE = {'poisson': 0.5, 'stiffening': 1e9, 'height': 0.0, 'base': 1e-6, 'gains': 0.0}


class CellKnn:
    """Majority vote among the nearest training samples for a cell, as [2] localises touches.

    Readings are compared as they are. Of cells with as many votes the one whose voters are nearer
    in sum wins, then the lowest.
    """

    def __init__(self, neighbours: int = 5) -> None:
        self.neighbours = neighbours

    def fit(self, x: Array, cells: Integers) -> CellKnn:
        """Remember features x (n, d) of touches and their cells (n,)."""
        self._tree, self._cells = cKDTree(x), np.asarray(cells, np.int64)
        return self

    def predict(self, x: Array) -> Integers:
        """Cell (s,) of each row of features x (s, d)."""
        count = min(self.neighbours, len(self._cells))
        distance, index = self._tree.query(x, k=[*range(1, count + 1)])
        found = []
        for named, far in zip(self._cells[index].tolist(), distance.tolist(), strict=True):
            reach = dict.fromkeys(named, 0.0)
            for name, one in zip(named, far, strict=True):
                reach[name] += one
            found.append(min(reach, key=lambda n: (-named.count(n), reach[n], n)))
        return np.array(found, np.int64)


@dataclass(frozen=True)
class Session:
    """Presses with what was read."""

    config: MagnetPadConfig
    touches: Touches
    recording: Recording

    @property
    def change(self) -> Array:
        """Readings less the tare, shape (s, d) (T)."""
        values = self.recording.values.reshape(len(self.recording), -1)
        return values[REST:] - values[:REST].mean(axis=0)

    def right(self, states: ContactStates) -> float:
        """Per cent of cells that are named rightly."""
        return accuracy(states.cell[REST:], self.touches.cell)

    def away(self, states: ContactStates) -> float:
        """Mean distance of places from the truth (mm)."""
        off = states.position[REST:] - self.touches.place
        return 1e3 * float(np.nanmean(np.linalg.norm(off, axis=1)))

    def off_force(self, states: ContactStates) -> float:
        """Root mean square of how far forces are from the truth (N); NaN where there is none."""
        size = np.linalg.norm(states.force[REST:] - self.touches.force, axis=1)
        finite = size[np.isfinite(size)]
        return float(np.sqrt((finite**2).mean())) if len(finite) else float('nan')


def config_of(cells: int) -> MagnetPadConfig:
    """Pad with so many cells."""
    return replace(SPEC.config(), cells=surface_cells(*GRIDS[cells]))


def session(
    cells: int, count: int, spread: float, seed: int, *, tip: float = TIP, stray: float = 0.0,
    cone: float = 0.0, specimen: int = WORLD_SEED, warm: float | None = None,
    **pad: float,
) -> Session:  # fmt: skip
    """Presses within `spread` of the width of their cells, by a tip of a radius (m).

    `warm` degrees above the tare, as the chips tell; None: they tell nothing.
    """
    config = config_of(cells)
    touches = Touches.in_cells(config, GRIDS[cells], count, spread, seed, cone=cone)
    world, layout = PadWorld(config, specimen, **pad), SPEC.layout(config)
    recording = world.record(touches, seed + 1000, tip=tip, stray=stray, layout=layout)
    if warm is not None:
        rise = np.where(np.arange(len(recording)) < REST, 0.0, warm)
        recording = world.warmed(recording, rise, seed, layout=layout)
    return Session(config, touches, recording)


def joined(*parts: Session) -> tuple[Pipeline, CellKnn]:
    """Ours and [2]'s, learned from sessions of one config."""
    ours = SPEC.pipeline(parts[0].config).fit(*(part.recording for part in parts))
    x = np.concatenate([part.change for part in parts])
    named = np.concatenate([part.touches.cell for part in parts])
    return ours, CellKnn(5).fit(x, named)


@lru_cache
def learned(cells: int, spread: float, count: int) -> tuple[Pipeline, CellKnn, float]:
    """Ours and [2]'s, learned from one session, and how long both took (s)."""
    train = session(cells, count, spread, LEARN)
    began = time.process_time()
    ours, peer = joined(train)
    return ours, peer, time.process_time() - began


@lru_cache
def _truth(cells: int, spread: float) -> tuple[GaussianSumTable, GaussianSumTable]:
    """Touches of the world itself, without and with an outside field of the size in use."""
    config = config_of(cells)
    pad, step = PadWorld(config, WORLD_SEED), (2e-5, 2e-5, 1e-3)
    touches = Touches.in_cells(config, GRIDS[cells], DENSE[spread], spread, 77)
    readings = pad.change(touches, TIP)
    reach = 0.5e-3 if spread == 1.0 else 0.1e-3
    slopes, leads = [], []
    for i, size in enumerate((reach, reach, reach / 20e-3)):
        moved = touches.shifted(*np.eye(3)[i] * step[i])
        slopes.append((pad.change(moved, TIP) - readings) / step[i] * size)
        leads.append((moved.place - touches.place) / step[i] * size)
    count = len(readings)
    rows = Linearised(
        readings.reshape(count, -1), np.stack(slopes, axis=-1).reshape(count, -1, 3),
        touches.place, np.stack(leads, axis=-1), np.full(count, pad.noise),
        np.full(count, 1 / count),
    )  # fmt: skip
    common = np.vstack([np.eye(3)] * len(config.positions))
    plain = GaussianSumTable(rows, neighbours=48)
    return plain, GaussianSumTable(rows, common, STRAY / np.sqrt(3), neighbours=192)


def bounds(cells: int, spread: float, test: Session, stray: Session) -> tuple[float, ...]:
    """Mean error of a place (mm), cells right (%) and with an outside field, by the posterior."""
    # anywhere is the same for all cells
    plain, blind = _truth(cells if spread < 1.0 else 15, spread)
    centres = test.config.cells * np.array([1.0, 1.0, 0.0])
    seen, met = plain(test.change), blind(stray.change)
    away = 1e3 * float(np.linalg.norm(seen.mean - test.touches.place, axis=1).mean())
    named = (t.shares(s, centres).argmax(axis=1) for t, s in ((plain, seen), (blind, met)))
    return away, *(accuracy(one, test.touches.cell) for one in named)


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
    (ours, peer, _), test = learned(15, 1.0, count), session(15, count, 1.0, JUDGE)
    said, cells = ours.process_batch(test.recording), test.config.cells
    named = {'neighbours': peer.predict(test.change), 'ours': said.cell[REST:]}
    drawings = {
        f'cells_{name}': plots.cell_map(
            cells, np.diag(confusion(cell, test.touches.cell, len(cells))),
            f'Touches named rightly by cell: {name}',
        )
        for name, cell in named.items()
    }  # fmt: skip
    error = np.linalg.norm(said.position[REST:] - test.touches.place, axis=1)
    drawings['errors'] = plots.error_map(
        test.touches.place, error, 'Error of the place over the pad'
    )
    rows += independent_rows('magnet_pad', extent)
    notes = [
        f'extent {extent}: {count} presses to learn from, as many others to be judged on',
        'peer: five nearest neighbours [2]; its place is the centre of the cell that it names',
        'bound: posterior over touches of the world, which knows where touches are likely',
        'one frame and batch of cells: the whole pipeline; the rows at the end: estimators alone',
        'sigmas: aim of 5 points, or the 95 % binomial interval of the judged presses',
        'near the centre: within a tenth of a cell; probes, cone: within 0.4 of a cell',
    ]
    if extent == 'quick':
        notes.append('quick: 15 cells, touches anywhere; no probes, cone, untrained specimens')
    seeds = [WORLD_SEED, LEARN, JUDGE]
    return BenchResult('magnet_pad', command, seeds, rows, notes, drawings)


def parts(extent: str) -> dict[str, Callable[[], list[Row]]]:
    """What the bench consists of, by name; parts share fits, and nothing else."""
    count, found, quick = PRESSES[extent], {}, extent == 'quick'
    for cells in (15,) if quick else GRIDS:
        for spread in (1.0,) if quick else (0.1, 1.0):
            found[f'{cells} cells, {spread:g} wide'] = partial(_cells, cells, spread, count)
    found['coverage'] = partial(_covered, count)
    if not quick:
        found['probes'] = partial(_probes, count, extent)
        found['cone'] = partial(_cone, count // 2)
        found['untrained'] = partial(_untrained, count, extent)
        found['warm'] = partial(_warm, count)
    found['speed'] = partial(_speed, count, (0,) if quick else (0, 100, 200))
    return found


def _cells(cells: int, spread: float, count: int) -> list[Row]:
    """Cells and places with touches near the centres and anywhere."""
    where = 'near the centre' if spread < 1 else 'anywhere'
    ours, peer, seconds = learned(cells, spread, count)
    test = session(cells, count, spread, JUDGE)
    stray = session(cells, count, spread, JUDGE, stray=STRAY)
    said, voted, true = ours.process_batch(test.recording), peer.predict(test.change), test.touches
    place, cell, met = bounds(cells, spread, test, stray)
    centres = test.config.cells
    far = 1e3 * np.linalg.norm(centres[voted] - true.place, axis=1).mean()
    single, batch = frame_us(ours, test.recording, range(REST, REST + 200))
    name = f'{cells} cells, {where}'
    return [
        Row(f'{name}: cells right', '%', test.right(said), 'high',
            PAPER[cells] if spread < 1 else None, accuracy(voted, true.cell), cell,
            100 - 1.2 * (100 - cell), single, batch),
        Row(f'{name}: place', 'mm', test.away(said), peer=float(far), bound=place,
            aim=min(1.5 * place, far / 6) if spread == 1.0 else 1.5 * place),
        Row(f'{name}: average Euclidean error', 'mm',
            average_euclidean_error(said.cell[REST:], true.cell, centres),
            peer=average_euclidean_error(voted, true.cell, centres)),
        Row(f'{name}: cells right, 0.5 mT outside', '%',
            stray.right(ours.process_batch(stray.recording)), 'high',
            peer=accuracy(peer.predict(stray.change), stray.touches.cell), bound=met,
            aim=met - 1.5 if spread < 1 else None),
        Row(f'{name}: fit', 's', seconds, aim=20.0),
    ]  # fmt: skip


def _covered(count: int) -> list[Row]:
    """Shares inside one and two sigma off a Gaussian's, of components that vary, by thirds."""
    test, rows = session(15, 3 * count, 1.0, JUDGE), []
    said = learned(15, 1.0, count)[0].process_batch(test.recording)
    groups = np.arange(len(test.touches.place))
    for name, true in (('position', test.touches.place), ('force', test.touches.force)):
        error = getattr(said, name)[REST:] - true
        variance = np.diagonal(getattr(said, f'{name}_cov'), axis1=1, axis2=2)[REST:]
        for k in np.flatnonzero(np.ptp(true, axis=0)):
            found = coverage_by_thirds(error[:, k], variance[:, k], groups)
            rows += [
                Row(f'{name} {AXES[k]}, {part}: inside {sigmas} sigma, off '
                    f'{100 * WITHIN[sigmas]:.1f} %', 'points',
                    100 * abs(one.share - WITHIN[sigmas]), aim=_allowed(one, sigmas))
                for (part, sigmas), one in found.items()
            ]  # fmt: skip
    return rows


def _allowed(one: Coverage, sigmas: int) -> float:
    """Points by which a share may be off."""
    return 100 * max(one.high - WITHIN[sigmas], WITHIN[sigmas] - one.low)


def _probes(count: int, extent: str) -> list[Row]:
    """Table 1 of [2]: trained on one probe, on two and on all, judged on each."""
    each = {p: session(15, count // 3, 0.4, 10 + p, tip=p / 2e3) for p in PROBES}
    fresh = {p: session(15, count // 3, 0.4, 50 + p, tip=p / 2e3) for p in PROBES}
    known_ones = [(p,) for p in PROBES] + [(2, 14), PROBES]
    known_ones += [(2, 6), (6, 14)] if extent == 'full' else []
    rows = []
    for known in known_ones:
        ours, peer = joined(*(each[p] for p in known))
        names = ' and '.join(map(str, known)) if len(known) < 4 else 'all'
        for p, one in fresh.items():
            printed = TABLE_1[PROBES.index(known[0])][PROBES.index(p)]
            printed = printed if len(known) == 1 else 97 if len(known) == 4 else None
            rows.append(
                Row(f'15 cells, {p} mm probe, learned on {names} mm: cells right', '%',
                    one.right(ours.process_batch(one.recording)), 'high', printed,
                    accuracy(peer.predict(one.change), one.touches.cell)))  # fmt: skip
    return rows


def _cone(count: int) -> list[Row]:
    """Forces up to 45 degrees from the normal, by tips of 2 and 6 mm."""
    rows = []
    for probe, printed in ((2, 92.0), (6, 96.0), (None, 93.0)):
        sizes = [probe] if probe else [2, 6]
        train, test = (
            [session(15, count, 0.4, seed + p, tip=p / 2e3, cone=CONE) for p in sizes]
            for seed in (20, 30)
        )
        ours, peer = joined(*train)
        said = [ours.process_batch(t.recording) for t in test]
        voted = [accuracy(peer.predict(t.change), t.touches.cell) for t in test]
        right, away = (
            float(np.mean([of(t, s) for t, s in zip(test, said, strict=True)]))
            for of in (Session.right, Session.away)
        )
        name = f'15 cells, cone of 45 degrees, {probe or "2 and 6"} mm'
        rows += [
            Row(f'{name}: cells right', '%', right, 'high', printed, float(np.mean(voted))),
            Row(f'{name}: place', 'mm', away),
        ]
    return rows


def _untrained(count: int, extent: str) -> list[Row]:
    """Nothing but resting frames, on the mechanics of the config and on another body.

    Magnets of every specimen lie elsewhere than the config says, but in the row that says so.
    """
    half, body = 'a half-space as in the config', 'another body'
    cases = [
        (WORLD_SEED, count, HALF_SPACE, 0.0, half, 0.9), (WORLD_SEED, count, {}, 0.0, body, 2.0),
        (WORLD_SEED, count, HALF_SPACE, STRAY, 'a half-space, 0.5 mT outside', None),
        (WORLD_SEED, count, {**HALF_SPACE, 'amiss': 0.0}, 0.0, f'{half}, magnets too', 0.9),
    ]  # fmt: skip
    for seed in SPECIMENS[extent]:
        cases += [(seed, FEW, HALF_SPACE, 0.0, half, 0.9), (seed, FEW, {}, 0.0, body, 2.0)]
    rows = []
    for seed, presses, pad, stray, what, aim in cases:
        test = session(15, presses, 1.0, JUDGE, stray=stray, specimen=seed, **pad)
        ours = SPEC.pipeline(test.config).fit(test.recording.select(test.recording.tare))
        away = test.away(ours.process_batch(test.recording))
        rows.append(Row(f'rest frames only, specimen {seed}, {what}: place', 'mm', away, aim=aim))
    return rows


def _warm(count: int) -> list[Row]:
    """Warmer than at the tare; peer: the same readings where chips tell no temperature."""
    ours, rows, usual = learned(15, 1.0, count)[0], [], (np.inf, np.inf)
    for rise in WARMER:
        test = session(15, count, 1.0, JUDGE, warm=rise)
        blind = replace(test.recording, temperature_c=None)
        seen, unseen = (_judged(ours.process_batch(one), test) for one in (test.recording, blind))
        usual = usual if rise else seen[:2]
        what = f'{rise:g} degrees above the tare'
        off, peer = (100 * abs(one[2].share - WITHIN[2]) for one in (seen, unseen))
        rows += [
            Row(f'{what}: place', 'mm', seen[0], peer=unseen[0], aim=1.1 * usual[0]),
            Row(f'{what}: Fz', 'N', seen[1], peer=unseen[1], aim=1.1 * usual[1]),
            Row(f'{what}: Fz inside 2 sigma, off {100 * WITHIN[2]:.1f} %', 'points', off,
                peer=peer, aim=_allowed(seen[2], 2)),
        ]  # fmt: skip
    return rows


def _judged(said: ContactStates, test: Session) -> tuple[float, float, Coverage]:
    """Mean error of places (mm), that of Fz (N, root mean square), and what its sigmas hold."""
    error = said.force[REST:, 2] - test.touches.force[:, 2]
    held = coverage(error, said.force_cov[REST:, 2, 2], np.arange(len(error)), 2)
    return test.away(said), float(np.sqrt((error**2).mean())), held


def _speed(count: int, seeds: tuple[int, ...]) -> list[Row]:
    """Every estimator on the same touches; neighbours and the inversion alone."""
    ours, rows = learned(15, 1.0, count)[0], []
    for name in (None, 'ridge', 'grid_knn', 'kernel_ridge', 'perceptron'):
        away, right, force = [], [], []
        for seed in within(ALIKE_S, seeds):
            train, fresh = (session(15, count, 1.0, seed + part) for part in (LEARN, JUDGE))
            own = name is None and seed == 0
            one = ours if own else SPEC.pipeline(train.config, name).fit(train.recording)
            said = one.process_batch(fresh.recording)
            away.append(fresh.away(said))
            right.append(fresh.right(said))
            force.append(fresh.off_force(said))
        single, batch = frame_us(one, fresh.recording, range(REST, REST + 200))
        title = 'table Gauss-Newton' if name is None else name.replace('_', ' ')
        for what, unit, found, better, compared in (
            ('place', 'mm', away, 'low', 'place on the pad, 15 cells'),
            ('force', 'N', force, 'low', 'force on the pad, 15 cells'),
            ('cell', '%', right, 'high', 'cells right on the pad, of 15'),
        ):
            if what != 'cell' or (said.cell >= 0).any():  # regressors of the place name none
                rows.append(
                    Row.mean(f'{what} by {title}', unit, found, better, us_single=single,
                             us_batch=batch, compared=compared, method=title)
                )  # fmt: skip
    many, test = session(15, 10_000, 1.0, 5), session(15, 200, 1.0, 6)
    knn, inversion = CellKnn(5).fit(many.change, many.touches.cell), ours.estimation.inversion_
    alone = [test.change[i : i + 1] for i in range(200)]
    for what, call, aim in (
        ('five neighbours among 10 000', knn.predict, 20.0),
        ('inversion', lambda x: inversion.invert(x, test.config.cells), 60.0),
    ):
        spent = shortest(lambda call=call: [call(x) for x in alone]) / len(alone)
        rows.append(Row(f'{what}, one frame', 'us', 1e6 * spent, aim=aim))
    return rows
