# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Scenes of MuJoCo for `tactile bench grasp`: a magnet by a balloon, grasps, changing loads."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from scipy import stats

from benchmarks.harness.rows import Row, within
from reference.grasp_trials import GENTLE, Trials, grips, named, unseen
from tactile_ros.evaluation.figures import Plot, standalone
from tactile_ros.simulation.scenes import CHANGES, Handling
from tactile_ros.simulation.scenes import KINDS as THINGS

if TYPE_CHECKING:
    from collections.abc import Mapping

    from reference.grasp_trials import Watcher
    from tactile_ros.simulation.scenes import Carried, Grasped, Held

GRASPS = {'quick': 1, 'normal': 3, 'full': 50}  # of each object
FORCES = {'quick': 1, 'normal': 2, 'full': 10}  # of each object and hand
LOADS = {'quick': 2, 'normal': 10, 'full': 100}  # of either kind
SECONDS = {'quick': np.inf, 'normal': 15.0, 'full': np.inf}  # of a study's seeds
PAPER = {'cube': 94.0, 'sphere': 96.0, 'mouse': 94.0}  # [2], % of 50 grasps each
SETTLED = {'allegro': 0.5, 'soft': 1.5}  # s
HELD, SPARED = 0.98, 0.8
BLOCKS = 5  # of seeds of loads, each of which gives a value
UNTIL = 0.05  # m
FRESH = 3000  # seeds from here on: none that a gain, a hand or a calibration was looked at with


@dataclass
class Found:
    """What scenes gave."""

    rows: list[Row] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    drawings: dict[str, str] = field(default_factory=dict)


def run(extent: str, seed: int = FRESH, films: Mapping[str, Watcher] | None = None) -> Found:
    """All scenes, from a seed on; films, by scene, see one run of each."""
    trials, found, films = Trials(), Found(), films or {}
    balloon(trials, found, films.get('balloon', unseen))
    time_s = SECONDS[extent]
    cells(trials, found, range(seed, seed + GRASPS[extent]), films.get('allegro', unseen))
    weaker(trials, found, range(seed, seed + FORCES[extent]), time_s)
    for hand in SETTLED:
        forces(trials, found, hand, range(seed, seed + FORCES[extent]), time_s)
    loads(trials, found, range(seed, seed + LOADS[extent]), films.get('loads', unseen), 2 * time_s)
    found.notes += [
        'Scenes of MuJoCo (docs/simulation.md): contact forces go through the model of the sensor '
        'into the bytes of its board, the driver, the pipeline and the loop of grip_node; joints '
        'come back in the message of the adapter. Models of the signals, as fidelity picked them: '
        f'gradiometer {trials.gentle.skin.model}, magnet pad {trials.pad.skin.model}.',
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
            per_cent * held.error_until(UNTIL), paper=None,
            peer=per_cent * single.error_until(UNTIL), aim=2.0),
        Row('balloon: distance below which no reading is valid', 'mm', 1e3 * held.invalid_from),
        _real_time('balloon', held.seconds + single.seconds, time.perf_counter() - began),
    ]  # fmt: skip
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
    plot.text(70.0, 1.1, 'gradiometer', 'start')
    plot.text(70.0, 1.6, f'one pixel: {single.fate}', 'start')
    plot.rule(1e3 * UNTIL, '50 mm')
    if np.isfinite(held.invalid_from):
        plot.rule(1e3 * held.invalid_from, 'not valid from here on', row=1)
    return standalone(plot)


def cells(trials: Trials, found: Found, seeds: range, film: Watcher) -> None:
    """Scene 2: cells of [2] on the Allegro-like hand, and whether things stay."""
    for kind in THINGS:
        began = time.perf_counter()
        grasps = [
            trials.pads(kind, seed, film if (kind, seed) == (THINGS[0], seeds[0]) else unseen)
            for seed in seeds
        ]
        centres = trials.pad.skin.config.cells
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
            _real_time(what, sum(g.seconds for g in grasps), time.perf_counter() - began),
        ]  # fmt: skip
        if kind == 'cube':
            found.drawings['allegro'] = drawn_grasp(grasps[0])


def weaker(trials: Trials, found: Found, seeds: range, time_s: float) -> None:
    """The same with the torques that the makers' nodes clip at, as they are shipped."""
    for version in ('v4', 'v5'):
        grasps = [
            trials.pads(kind, seed, version=version)
            for seed in within(time_s, seeds)
            for kind in THINGS
        ]
        what = f'Allegro-like with motors of {version.upper()} as shipped, {len(grasps)} grasps'
        held = float(np.mean([grasp.held for grasp in grasps]))
        found.rows.append(Row(f'{what}: held through 2 N', '1', held, 'high'))


def forces(trials: Trials, found: Found, hand: str, seeds: range, time_s: float) -> None:
    """Overshoot, settling and steady error of a hand with gradiometers, all objects."""
    began = time.perf_counter()
    grasps = [trials.forces(hand, kind, seed) for seed in within(time_s, seeds) for kind in THINGS]
    over, steady, settled = (
        np.array([getattr(g, name) for g in grasps]) for name in ('overshoot', 'steady', 'settled')
    )
    what, count = f'{hand} hand in MuJoCo', f'({len(grasps)} grasps)'
    found.rows += [
        Row(f'{what}: worst overshoot {count}', '%', 100 * float(over.max()), aim=10.0),
        Row(
            f'{what}: slowest from load to 5 % {count}',
            's',
            float(settled.max()),
            aim=SETTLED[hand],
        ),
        Row(f'{what}: from load to 5 %, median {count}', 's', float(np.median(settled))),
        Row(f'{what}: worst steady error {count}', '%', 100 * float(steady.max()), aim=2.0),
        _real_time(f'{what} {count}', sum(g.seconds for g in grasps), time.perf_counter() - began),
    ]
    found.drawings[f'{hand}_force'] = drawn_grasp(grasps[0])


def drawn_grasp(grasp: Grasped) -> str:
    """True forces of all fingers over time, and what was asked for."""
    trace = grasp.trace
    count = (trace.shape[1] - 1) // 2
    plot = Plot((float(trace[0, 0]), float(trace[-1, 0])), (0, 1.25 * float(trace[:, 1:].max())),
                'time (s)', 'normal force (N)', (480, 300),
                description='Forces of a grasp')  # fmt: skip
    for i in range(count):
        plot.line(trace[:, 0], trace[:, 1 + count + i], 'rule')
        plot.line(trace[:, 0], trace[:, 1 + i], f'line c{i}')
    return standalone(plot)


def loads(trials: Trials, found: Found, seeds: range, film: Watcher, time_s: float) -> None:
    """Scene 3: drop rate against mean force of three grips."""
    fixed = smallest_fixed()
    tried = grips(fixed)
    each: dict[str, list[list[Carried]]] = {name: [] for name in tried}
    spent = dict.fromkeys(tried, 0.0)
    for seed in within(time_s, seeds):
        pair = [Handling.draw(kind, seed) for kind in CHANGES]
        for name, grip in tried.items():
            began = time.perf_counter()
            seen = pair[-1] if (name, seed) == ('adaptive', seeds[0]) else None
            each[name].append(
                [trials.carry(one, seed, grip, film if one is seen else unseen) for one in pair]
            )
            spent[name] += time.perf_counter() - began
    points = {}
    for name, pairs in each.items():
        parts = list(zip(*pairs, strict=True))
        carried = [one for part in parts for one in part]
        points[name] = shares(carried)
        mean, dropped = zip(*blocks(carried, len(pairs)), strict=True)
        aims = (HELD, SPARED * fixed) if name == 'adaptive' else (None, None)
        what = f'{len(carried)} loads in MuJoCo, {name}'
        found.rows += [
            Row(f'{what}: held', '1', 1 - points[name][1], 'high', aim=aims[0],
                by_seed=tuple(1 - share for share in dropped)),
            Row(f'{what}: mean force', 'N', points[name][0], aim=aims[1], by_seed=mean),
            *(
                Row(f'{what}, {kind}: held', '1',
                    float(np.mean([one.held for one in part])), 'high')
                for kind, part in zip(CHANGES, parts, strict=True)
            ),
            _real_time(what, sum(one.seconds for one in carried), spent[name]),
        ]  # fmt: skip
    found.notes.append(
        f'Fixed in MuJoCo: {fixed:.2f} N, below which no fixed force could hold 98 % of the 200 '
        'loads of a full run.'
    )
    found.drawings['loads'] = drawn_loads(points)


def smallest_fixed() -> float:
    """Force (N) below which none could hold 98 % of the 200 loads of a full run."""
    seeds = range(FRESH, FRESH + LOADS['full'])
    needed = [Handling.draw(kind, seed).needed for kind in CHANGES for seed in seeds]
    return float(np.quantile(needed, HELD))


def shares(carried: list[Carried]) -> tuple[float, float]:
    """Mean force (N) and drop rate."""
    force = float(np.mean([one.mean_force for one in carried]))
    return force, 1 - float(np.mean([one.held for one in carried]))


def blocks(carried: list[Carried], count: int) -> list[tuple[float, float]]:
    """The same of blocks of their seeds, of which each kind has `count`."""
    parts = np.array_split(np.arange(len(carried)).reshape(-1, count), min(BLOCKS, count), axis=1)
    return [shares([carried[i] for i in part.ravel()]) for part in parts]


def drawn_loads(points: dict[str, tuple[float, float]]) -> str:
    """Drop rate over mean force."""
    plot = Plot((0, 10), (0, 100), 'mean force (N)', 'dropped (%)', (480, 320),
                description='Drop rate over mean force')  # fmt: skip
    for i, (name, (force, dropped)) in enumerate(points.items()):
        plot.mark(force, 100 * dropped, i, f'fill c{i}')
        plot.text(force, 100 * dropped, name, 'middle', shift=-12.0)
    return standalone(plot)


def _real_time(what: str, seconds: float, elapsed: float) -> Row:
    """Simulated over elapsed time (s)."""
    return Row(f'{what}: real-time factor', '1', seconds / elapsed, 'high')
