# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Scenes of MuJoCo for `tactile bench grasp` and `tactile demo grasp`.

A magnet by a balloon, grasps, changing loads; for the demo one seed each, with films.
"""

import importlib.util
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from scipy import stats

from benchmarks.grasp import load_rows
from benchmarks.harness.rows import COLUMNS, BenchResult, Row, within
from reference.grasp_film import Film, prefer_no_screen, why_not
from reference.grasp_trials import GENTLE, Trials, grips, named, unseen
from reference.hand_scenes import CHANGES, Carried, Grasped, Handling, Held
from reference.hand_scenes import KINDS as THINGS
from reference.hand_world import HandWorld
from tactile_ros.cli.console import show
from tactile_ros.evaluation.figures import Plot, standalone

GRASPS = {'quick': 1, 'normal': 3, 'full': 50}  # of each object
FORCES = {'quick': 1, 'normal': 2, 'full': 10}  # of each object and hand
LOADS = {'quick': 2, 'normal': 10, 'full': 100}  # of either kind
SECONDS = {'quick': np.inf, 'normal': 15.0, 'full': np.inf}  # of a study's seeds
PAPER = {'cube': 94.0, 'sphere': 96.0, 'mouse': 94.0}  # [2], % of 50 grasps each
FINGERS = {'allegro': ('index', 'middle', 'thumb'), 'soft': ('thumb', 'index', 'middle')}
SETTLED = {'allegro': 0.5, 'soft': 1.5}  # s
HELD, SPARED = 0.98, 0.8
UNTIL = 0.05  # m
Watcher = Callable[[HandWorld], None]
FRESH = 3000  # seeds from here on: none that a gain, a hand or a calibration was looked at with


@dataclass
class Found:
    """What scenes gave."""

    rows: list[Row] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    drawings: dict[str, str] = field(default_factory=dict)

    def timed(self, what: str, simulated: float, began: float) -> None:
        """Keep simulated over elapsed time (s)."""
        factor = simulated / (time.perf_counter() - began)
        self.rows.append(Row(f'{what}: real-time factor', '1', factor, 'high'))


def run(extent: str, seed: int = FRESH, films: Mapping[str, Watcher] | None = None) -> Found:
    """All scenes, from a seed on; films, by scene, see one run of each."""
    trials, found, films = Trials(), Found(), films or {}
    balloon(trials, found, films.get('balloon', unseen))
    time_s = SECONDS[extent]
    cells(trials, found, range(seed, seed + GRASPS[extent]), films.get('allegro', unseen))
    some = range(seed, seed + FORCES[extent])
    for version in ('v4', 'v5'):  # with the torques that the makers' nodes clip at, as shipped
        grasps = [
            trials.pads(kind, one, version=version)
            for one in within(time_s, some) for kind in THINGS
        ]  # fmt: skip
        what = f'Allegro-like with motors of {version.upper()} as shipped, {len(grasps)} grasps'
        held = float(np.mean([grasp.held for grasp in grasps]))
        found.rows.append(Row(f'{what}: held through 2 N', '1', held, 'high'))
    for hand in SETTLED:
        forces(trials, found, hand, some, time_s)
    loads(trials, found, range(seed, seed + LOADS[extent]), films.get('loads', unseen), 2 * time_s)
    found.notes += [
        'Scenes of MuJoCo (docs/simulation.md): contact forces go through the model of the sensor '
        'into the bytes of its board, the driver, the pipeline and the loop of grip_node; joints '
        'come back in the message of the adapter.',
        'Grasps in MuJoCo judge three pads each; bound: what noise alone leaves right, from the '
        'covariance that the pad states (Bayes). Settling from load to 5 % of the sum of forces.',
    ]
    return found


def balloon(trials: Trials, found: Found, film: Watcher) -> None:
    """Scene 1: errors until 50 mm, and from where nothing is valid."""
    began = time.perf_counter()
    held, single = trials.balloon(single=False, film=film), trials.balloon(single=True)
    per_cent = 100.0 / GENTLE
    found.rows += [
        Row('balloon, magnet to 50 mm: largest error of force', '% of full scale',
            per_cent * held.error_until(UNTIL), peer=per_cent * single.error_until(UNTIL),
            aim=2.0),
        Row('balloon: distance below which no reading is valid', 'mm', 1e3 * held.invalid_from),
    ]  # fmt: skip
    found.timed('balloon', held.seconds + single.seconds, began)
    found.notes.append(
        f'Balloon: {held.fate} with the gradiometer, {single.fate} with one pixel (the peer).'
    )
    found.drawings['balloon'] = drawn_balloon(held, single)


def drawn_balloon(held: Held, single: Held) -> str:
    """Force over the magnet's distance, of both readings."""
    plot = Plot((10, 100), (0, 3.2), 'distance of the magnet (mm)', 'force of the thumb (N)',
                (480, 320),
                description='Force over distance, gradiometer and one pixel')  # fmt: skip
    for kind, one in (('line c0', held), ('line c1', single)):
        plot.line(1e3 * one.distance, np.minimum(one.force, 3.1), kind)
    plot.rule(1e3 * UNTIL, '50 mm')
    if np.isfinite(held.invalid_from):
        plot.rule(1e3 * held.invalid_from, 'not valid from here on', row=1)
    key = (('c0', f'gradiometer: {held.fate}'), ('c1', f'one pixel: {single.fate}'))
    return standalone(plot, title='A balloon is held while a magnet comes', key=key)


def cells(trials: Trials, found: Found, seeds: range, film: Watcher) -> None:
    """Scene 2: cells of [2] on the Allegro-like hand, and whether things stay."""
    centres = trials.pad.skin.config.cells
    for kind in THINGS:
        began = time.perf_counter()
        grasps = [
            trials.pads(kind, seed, film if (kind, seed) == (THINGS[0], seeds[0]) else unseen)
            for seed in seeds
        ]
        judged = [named(touched, centres) for g in grasps for touched in g.contacts]
        judged = [one for one in judged if one.true >= 0]
        right = sum(one.true == one.estimated for one in judged)
        low, high = stats.beta.ppf([0.025, 0.975], right + np.array([0.5, 0.5]),
                                   len(judged) - right + 0.5)  # fmt: skip
        left = 100 * (1 - float(np.mean([one.chance for one in judged])))
        what = f'Allegro-like, {kind}, {len(grasps)} grasps'
        found.rows += [
            Row(f'{what}: cell of 15 right', '%', 100 * right / len(judged), 'high',
                paper=PAPER[kind], bound=left, aim=95.0),
            Row(f'{what}: cell right, 95 % interval from', '%', 100 * low, 'high'),
            Row(f'{what}: cell right, 95 % interval to', '%', 100 * high, 'high'),
            Row(f'{what}: place, median error', 'mm',
                1e3 * float(np.median([one.error for one in judged]))),
            Row(f'{what}: held through 2 N', '1', float(np.mean([g.held for g in grasps])),
                'high', aim=1.0),
        ]  # fmt: skip
        found.timed(what, sum(g.seconds for g in grasps), began)
        if kind == 'cube':
            found.drawings['allegro'] = drawn_grasp(grasps[0], 'allegro')


def forces(trials: Trials, found: Found, hand: str, seeds: range, time_s: float) -> None:
    """Overshoot, settling and steady error of a hand with gradiometers, all objects."""
    began = time.perf_counter()
    grasps = [trials.forces(hand, kind, seed) for seed in within(time_s, seeds) for kind in THINGS]
    over, steady, settled = (
        np.array([getattr(g, name) for g in grasps]) for name in ('overshoot', 'steady', 'settled')
    )
    what, count = f'{hand} hand in MuJoCo', f'({len(grasps)} grasps)'
    found.rows += [
        Row(f'{what}: {name} {count}', unit, float(figure), aim=aim)
        for name, unit, figure, aim in (
            ('worst overshoot', '%', 100 * over.max(), 10.0),
            ('slowest from load to 5 %', 's', settled.max(), SETTLED[hand]),
            ('from load to 5 %, median', 's', np.median(settled), None),
            ('worst steady error', '%', 100 * steady.max(), 2.0),
        )
    ]
    found.timed(f'{what} {count}', sum(g.seconds for g in grasps), began)
    found.drawings[f'{hand}_force'] = drawn_grasp(grasps[0], hand)


def drawn_grasp(grasp: Grasped, hand: str) -> str:
    """True forces of all fingers over time, and what was asked for."""
    trace = grasp.trace
    count = (trace.shape[1] - 1) // 2
    plot = Plot((float(trace[0, 0]), float(trace[-1, 0])), (0, 1.25 * float(trace[:, 1:].max())),
                'time (s)', 'normal force (N)', (480, 300),
                description='Forces of a grasp')  # fmt: skip
    for i in range(count):
        plot.line(trace[:, 0], trace[:, 1 + count + i], 'rule')
        plot.line(trace[:, 0], trace[:, 1 + i], f'line c{i}')
    key = [
        *((f'c{i}', name) for i, name in enumerate(FINGERS[hand])),
        ('ink', 'dashed: asked for'),
    ]
    return standalone(plot, title=f'True forces of a grasp, {hand} hand', key=key)


def loads(trials: Trials, found: Found, seeds: range, film: Watcher, time_s: float) -> None:
    """Scene 3: drop rate against mean force of three grips, drawn too."""
    # below it no fixed force (N) could hold 98 % of the 200 loads of a full run
    every = range(FRESH, FRESH + LOADS['full'])
    needed = [Handling.draw(kind, seed).needed for kind in CHANGES for seed in every]
    fixed = float(np.quantile(needed, HELD))
    tried, began = grips(fixed), time.perf_counter()
    each: dict[str, list[list[Carried]]] = {name: [] for name in tried}
    for seed in within(time_s, seeds):
        pair = [Handling.draw(kind, seed) for kind in CHANGES]
        for name, grip in tried.items():
            seen = pair[-1] if (name, seed) == ('adaptive', seeds[0]) else None
            each[name].append(
                [trials.carry(one, seed, grip, film if one is seen else unseen) for one in pair]
            )
    plot = Plot((0, 10), (0, 100), 'mean force (N)', 'dropped (%)', (480, 320),
                description='Drop rate over mean force')  # fmt: skip
    for i, (name, pairs) in enumerate(each.items()):
        carried = np.array([[(one.held, one.mean_force) for one in pair] for pair in pairs])
        held, force = carried.mean(axis=(0, 1)).tolist()
        what = f'{carried.shape[0] * carried.shape[1]} loads in MuJoCo, {name}'
        aims = (HELD, SPARED * fixed) if name == 'adaptive' else (None, None)
        found.rows += load_rows(what, carried, aims)
        plot.mark(force, 100 * (1 - held), i, f'fill c{i}')
        plot.text(force, 100 * (1 - held), name, 'middle', shift=-12.0)
    simulated = sum(one.seconds for pairs in each.values() for pair in pairs for one in pair)
    found.timed('loads in MuJoCo', simulated, began)
    found.notes.append(
        f'Fixed in MuJoCo: {fixed:.2f} N, below which no fixed force could hold 98 % of the 200 '
        'loads of a full run.'
    )
    title = 'Loads that grow or slip: dropped against the force of the grip'
    found.drawings['loads'] = standalone(plot, title=title)


def films() -> dict[str, Film]:
    """What is filmed, and from where."""
    return {
        'balloon': Film(4.0, (0.0, 0.06, 0.0), 0.32, azimuth=60.0, elevation=-40.0, speed_up=3.0),
        'allegro': Film(10.0, (0.07, 0.02, 0.05), 0.36, azimuth=310.0, elevation=-25.0),
        'loads': Film(12.0, (0.0, 0.0, 0.01), 0.22, azimuth=115.0, elevation=-15.0),
    }


def run_grasps(output: Path, seed: int, as_json: bool = False) -> int:
    """Run the scenes, print their figures, write plots and films into the folder `output`."""
    began = time.perf_counter()
    prefer_no_screen()
    sentence = why_not()
    made = {} if sentence else films()
    print('calibrating fingertips, then a minute or two of scenes', file=sys.stderr, flush=True)
    found = run('quick', seed, made)
    if importlib.util.find_spec('rclpy') is None:
        found.notes.append('Faults during a grasp are left out: they need ROS 2.')
    else:
        print('faults during a grasp through the nodes', file=sys.stderr, flush=True)
        from benchmarks.worlds.grip_faults import fault_rows

        rows, notes, drawn = fault_rows('quick')
        found = Found(found.rows + rows, found.notes + notes, {**found.drawings, **drawn})
    command = f'tactile demo grasp --seed {seed}'
    result = BenchResult('grasp', command, [seed], found.rows, found.notes, found.drawings)
    show(COLUMNS, [row.cells() for row in result.rows], f'grasp: {command}', as_json)
    output.mkdir(parents=True, exist_ok=True)
    lines = [*result.notes, *(f'drawn: {path}' for path in result.draw(output))]
    for name, film in made.items():
        lines.append(f'filmed: {film.save(output / f"grasp_{name}.gif")}')
    if sentence:
        lines.append(f'no films: {sentence}')
    lines.append(f'{time.perf_counter() - began:.0f} s')
    for line in lines:
        print(f'  {line}', file=sys.stderr if as_json else sys.stdout)
    return 0
