# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""five_wire_skin on two worlds of its own: place and force on fresh touches, and their cost.

The worlds share nothing with the package's model: a border of uneven silver whose sheet a sine
series solves (`test/reference/five_wire_world.py`), and finite differences with silver pads, a
rough film over an air gap and creep (`five_wire_sheet.py`). Untouched, the foil floats. The chain
as printed is the linear formula and the network of [5] on its 16 squares. Bounds are what the
noise of the readings makes by itself.
"""

import time
from typing import NamedTuple

import numpy as np
from scipy.interpolate import RBFInterpolator

from benchmarks.harness.independent import independent_rows
from benchmarks.harness.rows import BenchResult, Row, frame_us, inside, shortest, within
from reference.five_wire_sheet import SheetWorld, pressed
from reference.five_wire_world import FiveWireWorld, grid, touches
from tactile_ros.evaluation.figures import Plot, shade_key, standalone
from tactile_ros.pipeline import Pipeline
from tactile_ros.sensors import load_sensor
from tactile_ros.types import Array, Recording

SENSOR = load_sensor('five_wire_skin')
LAYOUT = SENSOR.layout(SENSOR.config())
SEEDS = {'quick': 1, 'normal': 3, 'full': 10}
SECONDS = {'quick': np.inf, 'normal': 120.0, 'full': np.inf}
FIRST_SEED = 1000
FRESH, FEW = 1500, 500  # touches that judge, and that compare methods
LOADS = np.arange(1.0, 16.0)  # N, at the 16 squares of [5]
METHODS = (None, 'printed', 'ridge', 'grid_knn', 'kernel_ridge', 'perceptron')
ONE, TWO = 68.27, 95.45  # per cent of errors inside one and two sigma
STEPS = np.array([0.02, 0.05, 0.1, 0.2, 0.4])  # mm, of the shades of a map
World = FiveWireWorld | SheetWorld


class Errors(NamedTuple):
    """What a pipeline said of touches, less the truth, and the sigmas that it stated."""

    place: Array  # (s, 2) mm
    place_sigma: Array
    force: Array  # (s, 1) N
    force_sigma: Array


def run(extent: str, command: str) -> BenchResult:
    """Measure places and forces over several worlds of both kinds."""
    quick = extent == 'quick'
    seeds, found, spreads, streams, methods = [], [], [], [], []
    for seed in within(SECONDS[extent], range(FIRST_SEED, FIRST_SEED + SEEDS[extent])):
        for kind in (SheetWorld, FiveWireWorld)[: 1 if quick else 2]:
            figures, covered = world_figures(kind(seed), seed, quick)
            found.append(figures)
            spreads.append(covered)
        if not quick:
            streams.append(creep_figures(seed))
        names = METHODS[:-1] if quick else METHODS
        methods.append({name: _method(seed, name) for name in names})
        seeds.append(seed)
    mean = {key: float(np.mean([one[key] for one in found])) for key in found[0]}
    creep = ('crept', 'uncrept', 'lightest')
    mean |= {key: float(np.mean([one[key] for one in streams] or [np.nan])) for key in creep}
    each = {key: tuple(one[key] for one in found) for key in found[0]}
    rows = [*_accuracy(mean, each), *_covered(spreads)]
    rows += [
        Row('estimators, one frame', 'us', mean['estimators'], aim=30.0,
            us_single=mean['single'], us_batch=mean['batch']),
        Row('fit, 392 touches', 's', mean['fit'], aim=20.0),
    ]  # fmt: skip
    for k, (what, unit) in enumerate((('place', 'mm'), ('force', 'N'))):
        for name in methods[0]:
            title = (name or 'chosen').replace('_', ' ')
            rows.append(
                Row.mean(f'{what} by {title}, 49 points', unit, [one[name][k] for one in methods],
                         us_single=min(one[name][2] for one in methods), method=title,
                         compared=f'{what} on the five-wire skin, 49 points')
            )  # fmt: skip
    rows = [row for row in rows if row.ours is None or np.isfinite(row.ours)]
    rows += independent_rows('five_wire_skin', extent)
    notes = [
        'peer, where not named: the formula and the network of [5], learned on 16 squares',
        'bound: noise of the readings alone, everything else known; of forces that of the divider '
        'with the place known, which no frame tells: that of all three readings (x, y and force '
        'unknown, Cramer and Rao) stands beside it; of a share inside sigma: what '
        'chance makes of it (95 %), with a group for each place of each calibration',
        'fresh touches 12.5 mm and more inside the border, 1..15 N; untouched, the foil floats',
        'non-linearity: largest deviation of the mean curve from its least-squares line over its '
        'range; relative std: mean over loads of the std over squares over their mean',
        f'worlds: those of {len(seeds)} of {SEEDS[extent]} seeds',
    ]
    if quick:
        notes.append(
            'quick: finite differences alone, without 60 touches a square, creep, perceptrons and '
            'drawings'
        )
    drawings = {} if quick else drawn(seeds[0])
    return BenchResult('five_wire_skin', command, seeds, rows, notes, drawings)


def world_figures(
    world: World, seed: int, quick: bool
) -> tuple[dict[str, float], dict[str, list[float]]]:
    """All figures of one world, and its coverage."""
    rng = np.random.default_rng(seed + 100)
    places, load = rng.uniform(12.5e-3, 87.5e-3, (FRESH, 2)), rng.uniform(1, 15, FRESH)
    test = touches(world, LAYOUT, places, load, seed + 200)
    train = {side: calibration(world, side, seed + 300) for side in (4, 5, 7)}
    if not quick:
        train[60] = calibration(world, 7, seed + 301, 60)
    began = time.perf_counter()
    fits = {side: SENSOR.pipeline().fit(one) for side, one in train.items()}
    seconds = (time.perf_counter() - began) / len(fits)
    errors = {side: judged(fit, test) for side, fit in fits.items()}
    printed = SENSOR.pipeline(estimator='printed').fit(train[4])
    formula, squares = judged(printed, test), judged(printed, train[4])
    again, ours = calibration(world, 7, seed + 400), calibration(world, 4, seed + 500)
    known = judged(fits[7], again)
    coverage = {
        f'place, {side * side} points, {axis}':
            _covers(errors[side].place[:, k], errors[side].place_sigma[:, k])
        for side in (5, 7, 4) for k, axis in enumerate('xy')
    } | {
        f'force, {side * side} points': _covers(errors[side].force, errors[side].force_sigma)
        for side in (7, 5, 4)
    }  # fmt: skip
    coverage['force, 49 points, at its squares'] = _covers(known.force, known.force_sigma)
    there = np.repeat(grid(7), 8, axis=0), np.tile(np.linspace(1, 15, 8), 49)
    touched, fresh, asked = (one.truth['in_contact'] == 1 for one in (train[5], test, ours))
    plate = thin_plate(train[5].values[touched, 0, :2], train[5].truth['position'][touched, :2])
    plated = plate(test.values[fresh, 0, :2]) - test.truth['position'][fresh, :2]
    # [5] compares with a polynomial of the divider
    level, force = (one[train[4].truth['in_contact'] == 1, ..., 2]
                    for one in (train[4].values[:, 0], train[4].truth['force']))  # fmt: skip
    curve = np.polynomial.Polynomial.fit(level, force, 4)
    off = curve(ours.values[asked, 0, 2]) - ours.truth['force'][asked, 2]
    return {
        'linear': length(formula.place), 'bound': 1e3 * world.bound(places),
        'plate': length(1e3 * plated), 'printed': rms(formula.force),
        'at_squares': rms(squares.force), 'fit': seconds,
        'least': _least(world, places, load),
        **{f'place{side * side}': length(errors[side].place) for side in (4, 5, 7)},
        **{f'force{side * side}': rms(errors[side].force) for side in (4, 5, 7)},
        'least_there': _least(world, *there), 'least_three': _least_of_three(world, *there),
        'square8': rms(known.force),
        'square60': np.nan if quick else rms(judged(fits[60], again).force),
        'worst16': float(np.abs(judged(fits[4], ours).force).max()),
        'curve16': float(np.abs(off).max()),
        **_curves(fits[4], world), **_times(fits[7], test),
    }, coverage  # fmt: skip


def creep_figures(seed: int) -> dict[str, float]:
    """Force in presses on a film that creeps, and without the model of its past."""
    world, rng = SheetWorld(seed + 50), np.random.default_rng(seed)
    where = np.repeat(grid(7), 3, axis=0)
    load = np.tile([3.0, 8.0, 14.0], 49) * rng.uniform(0.9, 1.05, 147)
    order = rng.permutation(147)
    train = pressed(world, LAYOUT, where[order], load[order], seed)
    places = rng.uniform(12.5e-3, 87.5e-3, (60, 2))
    test = pressed(world, LAYOUT, places, rng.uniform(2, 14, 60), seed + 1)
    pipeline = SENSOR.pipeline().fit(train)
    crept, lightest = rms(judged(pipeline, test).force), pipeline.report['contact']
    pipeline.estimation.creep_ = None
    without = rms(judged(pipeline, test).force)
    return {'crept': crept, 'uncrept': without, 'lightest': lightest['lightest_felt']}


def calibration(world: World, side: int, seed: int, loads: int | None = None) -> Recording:
    """Calibration: loads of 1..15 N at a grid of places."""
    loads = (15 if side == 4 else 8) if loads is None else loads
    where = np.repeat(grid(side), loads, axis=0)
    return touches(world, LAYOUT, where, np.tile(np.linspace(1, 15, loads), side**2), seed)


def judged(pipeline: Pipeline, test: Recording) -> Errors:
    """Errors and stated sigmas of touches."""
    states = pipeline.process_batch(test)
    touched = (test.truth['in_contact'] == 1) & (states.in_contact == 1)
    place = 1e3 * (states.position - test.truth['position'])[touched, :2]
    force = (states.force - test.truth['force'])[touched, 2:]
    cov, cov_force = states.position_cov[touched], states.force_cov[touched, 2:, 2]
    sigma = 1e3 * np.sqrt(np.diagonal(cov, axis1=1, axis2=2))[:, :2]
    return Errors(place, sigma, force, np.sqrt(cov_force))


def _method(seed: int, name: str | None) -> tuple[float, float, float]:
    """Errors of place (mm) and force (N), and time of a frame (us), learned from 49 places."""
    world, rng = SheetWorld(seed), np.random.default_rng(seed + 100)
    where, load = rng.uniform(12.5e-3, 87.5e-3, (FEW, 2)), rng.uniform(1, 15, FEW)
    test = touches(world, LAYOUT, where, load, seed + 200)
    fit = SENSOR.pipeline(estimator=name).fit(calibration(world, 7, seed + 300))
    errors = judged(fit, test)
    return length(errors.place), rms(errors.force), frame_us(fit, test, range(60), 5)[0]


def _curves(pipeline: Pipeline, world: World) -> dict[str, float]:
    """Non-linearity and relative standard deviation over 16 squares, before and after."""
    rng = np.random.default_rng(0)
    where, load = np.repeat(grid(4), 15, axis=0), np.tile(LOADS, 16)
    test = touches(world, LAYOUT, where, load, 7)
    touched = test.truth['in_contact'] == 1
    order = np.lexsort(
        [test.truth['force'][touched, 2], *test.truth['position'][touched, 1::-1].T]
    )
    said = pipeline.process_batch(test).force[touched, 2][order].reshape(16, 15)
    before = (1 / world.readings(where, load, rng)[:, 2] - 1).reshape(16, 15)
    found = {}
    for prefix, curves in (('', said), ('raw_', before)):
        mean = curves.mean(axis=0)
        off = np.abs(mean - np.polyval(np.polyfit(LOADS, mean, 1), LOADS)).max()
        found[f'{prefix}bent'] = 100 * off / np.ptp(mean)
        found[f'{prefix}uneven'] = 100 * float((curves.std(axis=0) / mean).mean())
    return found


def thin_plate(x: Array, y: Array) -> RBFInterpolator:
    """Thin plate through the mean potentials (n, 2) of each place (n, 2)."""
    places, index = np.unique(y, axis=0, return_inverse=True)
    index, count = index.reshape(-1), np.bincount(index.reshape(-1))
    means = np.stack([np.bincount(index, column) / count for column in x.T], axis=1)
    return RBFInterpolator(means, places)


def length(error: Array) -> float:
    """Mean distance of errors (s, 2)."""
    return float(np.linalg.norm(error, axis=1).mean())


def rms(error: Array) -> float:
    """Root mean square."""
    return float(np.sqrt((error**2).mean()))


def _covers(error: Array, sigma: Array) -> list[float]:
    """Per cent inside one and two sigma, and inside one in each third of the sigma."""
    whole, *thirds = inside(error.ravel(), sigma.ravel())
    return [whole, inside(error.ravel(), sigma.ravel(), 2)[0], *thirds]


def _sloped(world: World, places: Array, force: Array, steps: list[Array]) -> Array:
    """Noise-free readings at touches (x, y, force) moved by steps, less those moved back."""
    noise, rng = world.noise, np.random.default_rng(0)
    world.noise = 0.0
    slopes = [
        world.readings(places + step[:2], force + step[2], rng)
        - world.readings(places - step[:2], force - step[2], rng)
        for step in steps
    ]
    world.noise = noise
    return np.stack(slopes, axis=-1)


def _least(world: World, places: Array, force: Array) -> float:
    """Force error (N) that the divider's noise alone makes, with all else known."""
    step = 1e-4
    apart = _sloped(world, places, force, [np.array([0.0, 0.0, step])])[:, 2, 0]
    return float(np.sqrt(np.mean((world.noise * 2 * step / apart) ** 2)))


def _least_of_three(world: World, places: Array, force: Array) -> float:
    """Force error (N) that the noise of all three readings makes: the place is not known."""
    steps = np.diag([1e-5, 1e-5, 1e-3])
    turned = np.linalg.inv(_sloped(world, places, force, [*steps]) / 2)[:, 2] * steps[2, 2]
    return float(world.noise * np.sqrt((turned**2).sum(axis=1).mean()))


def _times(pipeline: Pipeline, test: Recording, count: int = 60) -> dict[str, float]:
    """Microseconds per frame: of the pipeline alone and in a batch, and of the estimators."""
    touched = np.flatnonzero(test.truth['in_contact'] == 1)[:count]
    pipeline.reset()
    single, batch = frame_us(pipeline, test, touched)
    estimation, kept = pipeline.estimation, []
    estimate = estimation.estimate
    estimation.estimate = lambda *given: (kept.append(given), estimate(*given))[1]
    for row in touched:
        pipeline.process(test.frame(row))
    del estimation.estimate
    some = kept[:4]  # few at a time: what else the machine does would count
    alone = shortest(lambda: [estimate(*given) for given in some], 2000)
    return {'single': single, 'batch': batch, 'estimators': 1e6 / len(some) * alone}


def _accuracy(mean: dict[str, float], each: dict[str, tuple[float, ...]]) -> list[Row]:
    """Rows of errors."""
    bound, least = mean['bound'], mean['least']
    there, three = mean['least_there'], mean['least_three']
    return [
        Row('place, 25 points, mean', 'mm', mean['place25'], paper=5.0, peer=mean['linear'],
            bound=bound, aim=1.3 * bound, by_seed=each['place25']),
        Row('place, 25 points, mean (peer: thin plate)', 'mm', mean['place25'],
            peer=mean['plate'], bound=bound),
        Row('place, 16 points, mean', 'mm', mean['place16'], peer=mean['linear'], bound=bound,
            by_seed=each['place16']),
        Row('place, 49 points, mean', 'mm', mean['place49'], bound=bound,
            by_seed=each['place49']),
        *(
            Row(what, 'N', mean[f'square{count}'], bound=least, aim=1.05 * least)
            for label, least in (('force at 49 calibration squares, {} touches each, rms', there),
                                ('the same, {} touches (bound: noise of all three readings)',
                                 three))
            for count in (8, 60) for what in (label.format(count),)
        ),
        Row('force anywhere, 49 points, rms', 'N', mean['force49'], paper=1.0,
            peer=mean['printed'], bound=least, aim=0.28, by_seed=each['force49']),
        Row('force anywhere, 49 points, rms of the worst world', 'N', max(each['force49']),
            aim=0.28),
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
        Row('air gap: lightest force detected', 'N', mean['lightest']),
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


def drawn(seed: int) -> dict[str, str]:
    """Maps of place error, darker where it is larger, learned from 25 points."""
    world, line = FiveWireWorld(seed), np.linspace(13e-3, 87e-3, 25)
    train = calibration(world, 5, seed)
    where = np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)
    test = touches(world, LAYOUT, where, np.full(len(where), 8.0), seed + 1)
    touched = test.truth['in_contact'] == 1
    found = {}
    for name, estimator, steps, title in (
        ('linear_map', 'printed', 20 * STEPS, 'Place error of the linear formula'),
        ('place_map', None, STEPS, 'Place error of the harmonic map, 25 points'),
    ):
        fit = SENSOR.pipeline(estimator=estimator).fit(train)
        error = np.linalg.norm(judged(fit, test).place, axis=1)
        plot = Plot.plan((0.0, 100.0), (0.0, 100.0), '(mm)', title)
        kinds = [f's{n}' for n in np.searchsorted(steps, error)]
        plot.boxes(*1e3 * test.truth['position'][touched, :2].T, 3.1, kinds)
        found[name] = standalone(plot, title=title, key=shade_key(steps, 'mm'))
    return found
