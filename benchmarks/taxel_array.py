# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Paper [4] and what replaces it, on taxels whose coverage is counted by points.

Gains differ by 55 %, the converter has 10 bits, five of 72 taxels are dead or stuck and nobody
says so. The paper's own way is a polynomial with a free constant, a threshold, and a circle
through what is pressed.
"""

from __future__ import annotations

from dataclasses import replace
from time import perf_counter
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.harness import plots
from benchmarks.harness.independent import independent_rows
from benchmarks.harness.rows import BenchResult, Row
from benchmarks.worlds import taxel_picks, taxel_skins, taxel_trust
from tactile_ros.estimators.object_pose import TaxelPoints, first_state
from tactile_ros.physics.coverage import outline_fields
from tactile_ros.sensors.taxel_array.config import grid_positions
from tactile_ros.types import Outline, Recording

if TYPE_CHECKING:
    from collections.abc import Callable

    from tactile_ros.pipeline import Pipeline
    from tactile_ros.types import Array, Integers

COUNTS = {'quick': 20, 'normal': 200, 'full': 1000}
RADII = ((16e-3, 8e-3), (14e-3, 6.5e-3), (12e-3, 5e-3), (18e-3, 9e-3), (10e-3, 4e-3))
BAD = (3, 17, 30, 44, 61)
PITCH, TAXELS = 5e-3, 72
SPEC, SEED = taxel_picks.SPEC, taxel_picks.SEED


def run(extent: str, command: str) -> BenchResult:
    """Equilibrate, place washers, and time."""
    config = _config()
    pipeline = _fitted(config)
    label, place, force = _washers(COUNTS[extent])
    recording = Recording.from_arrays(SPEC.layout(config), _read(force, SEED + 1))
    began = perf_counter()
    states = pipeline.process_batch(recording)
    batch = 1e6 * (perf_counter() - began) / len(recording)
    right = states.label == label
    miss = 1e3 * np.linalg.norm(states.position[:, :2] - place, axis=1)[right]
    variance, at = states.object_pose_cov[right][:, [0, 1], [0, 1]], states.position[right, :2]
    inside = np.abs(at - place[right]) <= np.sqrt(variance)
    plain = _threshold_and_circle(force, label, place)
    spread, paper_spread = _spreads(pipeline, config)
    total = np.abs(states.force[:, 2] / force.sum(axis=1) - 1)
    single = taxel_picks.frame_us(pipeline, recording)
    rows = [
        Row('washers of 5 types, 5 bad taxels: recognised', '%', 100 * float(right.mean()),
            'high', paper=95.0, peer=plain[0], aim=99.0, us_single=single, us_batch=batch),
        Row('washers: centre, median', 'mm', float(np.median(miss)), peer=plain[1], aim=0.06),
        Row('washers: inside one sigma', '%', 100 * float(inside.mean()), 'high'),
        Row('spread of taxels after equilibration', '%', spread, paper=55.0, peer=paper_spread,
            aim=2.0),
        _at_rest(pipeline, config),
        Row('total force, mean error', '%', 100 * float(np.nanmean(total))),
        Row('one frame of 72 taxels', 'us', single, aim=300.0),
    ]  # fmt: skip
    notes = ['paper: before equilibration (spread), one branch of Voigt (hold), its own parts',
             'peer: polynomial with a free constant; threshold and circle fit',
             'bound of picked tubes: a rule of Bayes that knows skin and pressures',
             'bound of coverage: the noise of one reading of a half covered taxel']  # fmt: skip
    sorted_rows, drawings, worlds = taxel_picks.sorted_parts(extent)
    rows += sorted_rows
    drawings['equilibration'] = _draw_spread(pipeline, config)
    covers = _covers(pipeline)
    drawings['coverage'] = plots.costs(
        covers, ('time for 72 taxels (us)', 'error of the covered part'),
        'Time and error of models of coverage',
    )  # fmt: skip
    told = 'coverage of 72 taxels'
    rows += [
        Row(f'{told} by {name}', 'parts', error, bound=_noise_of_cover(), us_single=spent,
            compared=told, method=name)
        for name, (spent, error) in covers.items()
    ]  # fmt: skip
    drawings['hold'], drift = _hold()
    rows.append(
        Row('hold of 120 s: drift after 1 s', '%', drift['with creep'], paper=6.6,
            peer=drift['law alone'], aim=0.3)
    )  # fmt: skip
    more, told, drawn_from = _skins(extent)
    rows, notes, seeds = rows + more, notes + told, [SEED, *worlds, *drawn_from]
    rows += independent_rows('taxel_array', extent)
    return BenchResult('taxel_array', command, seeds, rows, notes, drawings)


def _skins(extent: str) -> tuple[list[Row], list[str], list[int]]:
    """Rows, notes and seeds of the world of fine cells, where the sources are at hand."""
    notes = [
        'bound: Cramer and Rao, by differences of a world of fine cells (tubes, jaw); of washers '
        'on 16 sectors the rule of Bayes that knows this world',
        'trust: on layouts, skins and parts that chose no constant; aims are 5 points, or the '
        '95 % binomial interval where that is wider',
    ]
    if extent == 'quick':
        left = (
            'quick: 2 picks of washers, 3 in a jaw, in one world; neither tubes nor the world of '
            'fine cells'
        )
        return [], [left], []
    try:
        rows = taxel_skins.rows(extent) + taxel_trust.rows(extent)
        return rows, notes, [*taxel_skins.SEEDS.values(), taxel_trust.SEED]
    except ImportError as error:  # installed without the tests
        return [], [f'without the rows beside bounds: {error}'], []


def _config() -> object:
    """72 taxels of 5 mm and five washers."""
    angle = 2 * np.pi * np.arange(96) / 96
    rim = np.column_stack([np.cos(angle), np.sin(angle)])
    washers = tuple(
        Outline(f'washer_{i}', (outer * rim, (inner * rim)[::-1]))
        for i, (outer, inner) in enumerate(RADII)
    )
    return replace(  # type: ignore[type-var]
        SPEC.config(), positions=grid_positions(8, 9, PITCH),
        areas=np.full(TAXELS, PITCH**2), force_range=(0.0, 5.0), objects=washers,
    )  # fmt: skip


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


def _fitted(config: object) -> Pipeline:
    """Pipeline equilibrated by even loads."""
    force = _taught()
    truth = {'taxel_force': force, 'in_contact': (force[:, 0] > 0).astype(np.int8)}
    layout = SPEC.layout(config)
    return SPEC.pipeline(config).fit(  # type: ignore[arg-type]
        Recording.from_arrays(layout, _read(force, 2), truth=truth)
    )


def _washers(count: int) -> tuple[Integers, Array, Array]:
    """Labels, centres (m) and forces (s, t) (N), by 1600 points a taxel."""
    rng = np.random.default_rng(SEED)
    label, place = rng.integers(len(RADII), size=count), rng.uniform(-3e-3, 3e-3, (count, 2))
    line = PITCH * ((np.arange(40) + 0.5) / 40 - 0.5)
    points = np.stack(np.meshgrid(line, line), -1).reshape(-1, 2)
    grid = grid_positions(8, 9, PITCH)[:, None, :2] + points
    forces = []
    for i, at in zip(label, place, strict=True):
        radius = np.linalg.norm(grid - at, axis=2)
        forces.append(1.5 * ((radius < RADII[i][0]) & (radius > RADII[i][1])).mean(axis=1))
    return label, place, np.array(forces)


def _threshold_and_circle(force: Array, label: Integers, place: Array) -> tuple[float, float]:
    """Per cent right and median miss (mm) of a circle through the pressed taxels."""
    output = _read(force, SEED + 1)[..., 0]
    centres = grid_positions(8, 9, PITCH)[:, :2]
    middle_radius = np.array([(a + b) / 2 for a, b in RADII])
    right, miss = 0, []
    for row, wanted, at in zip(output, label, place, strict=True):
        x, y = centres[row > 0.1].T
        terms = np.column_stack([2 * x, 2 * y, np.ones(len(x))])
        a, b, c = np.linalg.lstsq(terms, x**2 + y**2, rcond=None)[0]
        radius = np.sqrt(max(c + a**2 + b**2, 0.0))
        right += int(np.argmin(np.abs(middle_radius - radius)) == wanted)
        miss.append(1e3 * float(np.hypot(a - at[0], b - at[1])))
    return 100 * right / len(label), float(np.median(miss))


def _spreads(pipeline: Pipeline, config: object) -> tuple[float, float]:
    """Per cent healthy taxels differ by under even loads: ours, the paper's polynomial."""
    healthy = np.setdiff1d(np.arange(TAXELS), BAD)
    force = np.repeat(np.linspace(0.3, 2.5, 30)[:, None], TAXELS, axis=1)
    values = _read(force, 3)
    found = pipeline.process_batch(Recording.from_arrays(SPEC.layout(config), values))
    ours = (found.taxel_force / force)[:, healthy]
    paper = _printed(values, healthy) / force[:, healthy]
    return 100 * float(ours.std(axis=1).mean()), 100 * float(paper.std(axis=1).mean())


def _printed(values: Array, taxels: Integers) -> Array:
    """Forces (s, n) of readings (s, t, 1) by the paper's polynomial with a free constant (N)."""
    taught, output = _taught()[15:], _read(_taught(), 2)[15:, :, 0]
    found = [
        np.polyval(np.polyfit(output[:, i], taught[:, i], 2), values[:, i, 0]) for i in taxels
    ]
    return np.stack(found, axis=1)


def _at_rest(pipeline: Pipeline, config: object) -> Row:
    """Largest force of a taxel on which nothing lies."""
    values = _read(np.zeros((50, TAXELS)), SEED + 2)
    found = pipeline.process_batch(Recording.from_arrays(SPEC.layout(config), values))
    paper = _printed(values, np.setdiff1d(np.arange(TAXELS), BAD))
    return Row(
        'force at rest, largest of a taxel', 'mN', 1e3 * float(np.nanmax(found.taxel_force)),
        peer=1e3 * float(paper.max()), aim=0.0,
    )  # fmt: skip


def _draw_spread(pipeline: Pipeline, config: object) -> str:
    """Spread of healthy taxels over the load: raw outputs, the paper's polynomial, ours."""
    load, healthy = np.linspace(0.1, 2.8, 28), np.setdiff1d(np.arange(TAXELS), BAD)
    values = _read(np.repeat(load[:, None], TAXELS, axis=1), 3)
    found = pipeline.process_batch(Recording.from_arrays(SPEC.layout(config), values))
    paper = _printed(values, healthy)
    raw, ours = values[:, healthy, 0], found.taxel_force[:, healthy]
    lines = {
        name: (load, 100 * np.abs(of.std(axis=1) / of.mean(axis=1)))
        for name, of in (('outputs', raw), ('polynomial, free constant', paper), ('ours', ours))
    }
    return plots.curves(
        lines, ('load of every taxel (N)', 'spread (%)'),
        'Spread of equally loaded taxels over the load', log_y=True,
    )  # fmt: skip


def _noise_of_cover() -> float:
    """What the noise of a reading makes of the covered part of a taxel, half of it covered."""
    noise, half, load = np.hypot(5e-4, 1 / 1023 / 12**0.5), 1.5, 0.75
    slope = 1 / (1 + 0.55 / 2) * half / (load + half) ** 2
    return float(noise / slope / (2 * load))


def _covers(pipeline: Pipeline) -> dict[str, tuple[float, float]]:
    """Time and error of the coverage of 72 taxels by points, soft points and a table."""
    settings, rng = pipeline.config, np.random.default_rng(SEED)
    outline = settings.objects[0]  # type: ignore[attr-defined]
    places = rng.uniform(-3e-3, 3e-3, (60, 2))
    exact = np.array([_counted(40, at) for at in places])
    points = {
        f'{n * n} point' + 's' * (n > 1): _cost(lambda at, n=n: _counted(n, at), places, exact)
        for n in (1, 3, 5, 7, 20)
    }
    for count in (4, 16, 32):
        soft = TaxelPoints(settings.positions, settings.areas, None, count)  # type: ignore[attr-defined]
        fields = outline_fields(outline, soft.radius, 1)
        points[f'{count} soft points'] = _cost(
            lambda at, soft=soft, fields=fields: soft.pressed(
                fields, first_state(fields, *at, 0.0)
            )[0] / PITCH**2,
            places, exact,
        )  # fmt: skip
    return points


def _counted(side: int, at: Array) -> Array:
    """Covered part of each taxel by the first washer, by points."""
    line = PITCH * ((np.arange(side) + 0.5) / side - 0.5)
    points = np.stack(np.meshgrid(line, line), -1).reshape(-1, 2)
    away = grid_positions(8, 9, PITCH)[:, None, :2] + points - at
    squared = away[..., 0] ** 2 + away[..., 1] ** 2
    within = (squared < RADII[0][0] ** 2) & (squared > RADII[0][1] ** 2)
    return np.asarray(within.mean(axis=1))


def _cost(model: Callable[[Array], Array], places: Array, exact: Array) -> tuple[float, float]:
    """Least time (us) and error (rms) of a model of coverage."""
    spent, found = [], []
    for at in places:
        began = perf_counter()
        cover = model(at)
        spent.append(perf_counter() - began)
        found.append(cover)
    return 1e6 * min(spent), float(np.sqrt(np.mean(np.square(np.array(found) - exact))))


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
    drawn = plots.curves(
        lines, ('time since the load (s)', 'error (% of the load)'),
        'Error of the force over a hold of 120 s and after it',
    )  # fmt: skip
    return drawn, drift


def _crept(config: object, load: Array, seed: int, stamped: bool) -> Recording:
    """Even loads (s,) at 10 Hz on 16 taxels whose skin creeps by three fading branches."""
    felt = load.copy()
    for share, tau in ((0.06, 0.7), (0.05, 6.0), (0.05, 45.0)):
        fade, strain = float(np.exp(-0.1 / tau)), 0.0
        for i in range(1, len(load)):
            strain = fade * strain + (1 - fade) * load[i]
            felt[i] += share * strain
    rng = np.random.default_rng(9)
    gain = 1 / (1 + 0.55 * rng.uniform(size=16))
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
