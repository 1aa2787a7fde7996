"""five_wire_skin on two worlds of its own: place and force on fresh touches, and their cost.

The worlds share nothing with the package's model: a border of uneven silver whose sheet a sine
series solves (`test/reference/five_wire_world.py`), and finite differences with silver pads, a
rough film over an air gap and creep (`five_wire_sheet.py`). Untouched, the foil floats. The chain
as printed is the linear formula and the network of [5] on its 16 squares.
"""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from tactile_ros.estimators.harmonic_map import HarmonicMap
from tactile_ros.estimators.thin_plate import ThinPlate
from tactile_ros.evaluation import array_figures
from tactile_ros.evaluation.benchmark import BenchResult, Row
from tactile_ros.evaluation.drawing import standalone
from tactile_ros.evaluation.sources import load_source
from tactile_ros.evaluation.svg import Plot
from tactile_ros.physics.resistive import linear_place, sheet_potential
from tactile_ros.sensors import load_sensor

if TYPE_CHECKING:
    from types import ModuleType

    from tactile_ros.pipeline import Pipeline
    from tactile_ros.types import Array, Recording

SEEDS = {'quick': 1, 'normal': 3, 'full': 10}
FIRST_SEED = 1000
FRESH, FEW = 1500, 500
METHODS = (None, 'printed', 'mean_curve', 'ridge', 'grid_knn', 'kernel_ridge', 'perceptron')
FOLDER = Path(__file__).resolve().parents[1] / 'test' / 'reference'
SENSOR = load_sensor('five_wire_skin')
LAYOUT = SENSOR.layout(SENSOR.config())
SIZE = np.array([0.1, 0.1])
ONE, TWO = 68.27, 95.45  # per cent of errors inside one and two sigma
STEPS = np.array([0.02, 0.05, 0.1, 0.2, 0.4])  # mm, of the shades of a map


class Told(NamedTuple):
    """What a pipeline said of touches, less the truth, and the sigmas that it stated."""

    place: Array  # (s, 2) mm
    place_sigma: Array
    force: Array  # (s, 1) N
    force_sigma: Array


def run(extent: str, command: str) -> BenchResult:
    """Measure places and forces over several worlds of both kinds."""
    quick = extent == 'quick'
    seeds = [FIRST_SEED + seed for seed in range(SEEDS[extent])]
    known = _module('five_wire_world'), _module('five_wire_sheet')
    found, spreads = [], []
    for seed in seeds:
        kinds = (known[1].SheetWorld, known[0].FiveWireWorld)
        for kind in kinds[: 1 if quick else 2]:
            figures, covered = _one(known[0], kind(seed), seed, quick)
            found.append(figures)
            spreads.append(covered)
    streams = [_stream(known[1], seed) for seed in seeds]
    mean = {key: float(np.mean([one[key] for one in found])) for key in found[0]}
    mean |= {key: float(np.mean([one[key] for one in streams])) for key in streams[0]}
    worst = max(one['force49'] for one in found)
    each = {key: tuple(one[key] for one in found) for key in found[0]}
    rows = [*_accuracy(mean, each, worst), *_covered(spreads), *_cost(mean)]
    rows += _methods(known[1], seeds)
    rows = [row for row in rows if row.ours is None or np.isfinite(row.ours)]
    drawings = _draw(known[0], known[0].FiveWireWorld(seeds[0]), seeds[0])
    notes = _notes(quick)
    return BenchResult('five_wire_skin', command, seeds, rows, notes, drawings)


def _methods(module: ModuleType, seeds: list[int]) -> list[Row]:
    """Every estimator of place and force, learned from 49 places, on the same touches."""
    grids, places, forces = _module('five_wire_world'), [], []
    for name in METHODS:
        away, off, spent = [], [], []
        for seed in seeds:
            world, rng = module.SheetWorld(seed), np.random.default_rng(seed + 100)
            where, load = rng.uniform(12.5e-3, 87.5e-3, (FEW, 2)), rng.uniform(1, 15, FEW)
            test = grids.touches(world, LAYOUT, where, load, seed + 200)
            fit = SENSOR.pipeline(estimator=name).fit(_grid(grids, world, 7, seed + 300))
            told = _told(fit, test)
            away.append(_length(told.place))
            off.append(_rms(told.force))
            spent.append(_single(fit, test))
        title = (name or 'chosen').replace('_', ' ')
        places.append(_method('place', 'mm', title, away, spent))
        forces.append(_method('force', 'N', title, off, spent))
    return places + forces


def _single(pipeline: Pipeline, test: Recording) -> float:
    """Microseconds of a frame alone."""
    frames = [test.frame(row) for row in range(60)]
    least = min(_seconds(lambda: [pipeline.process(f) for f in frames]) for _ in range(5))
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


def _one(
    grids: ModuleType, world: object, seed: int, quick: bool
) -> tuple[dict[str, float], dict[str, list[float]]]:
    """All figures of one world, and its coverage."""
    rng = np.random.default_rng(seed + 100)
    places, load = rng.uniform(12.5e-3, 87.5e-3, (FRESH, 2)), rng.uniform(1, 15, FRESH)
    test = grids.touches(world, LAYOUT, places, load, seed + 200)
    train = {count: _grid(grids, world, count, seed + 300) for count in (4, 5, 7)}
    if not quick:
        train[60] = _grid(grids, world, 7, seed + 301, 60)
    began = time.perf_counter()
    fits = {count: SENSOR.pipeline().fit(one) for count, one in train.items()}
    seconds = (time.perf_counter() - began) / len(fits)
    told = {count: _told(fit, test) for count, fit in fits.items()}
    printed = SENSOR.pipeline(estimator='printed').fit(train[4])
    formula, squares = _told(printed, test), _told(printed, train[4])
    again = _grid(grids, world, 7, seed + 400)
    coverage = {
        'place, 25 points, x': _inside(told[5].place[:, :1], told[5].place_sigma[:, :1]),
        'place, 25 points, y': _inside(told[5].place[:, 1:], told[5].place_sigma[:, 1:]),
        'place, 49 points, x': _inside(told[7].place[:, :1], told[7].place_sigma[:, :1]),
        'place, 49 points, y': _inside(told[7].place[:, 1:], told[7].place_sigma[:, 1:]),
        'place, 16 points, x': _inside(told[4].place[:, :1], told[4].place_sigma[:, :1]),
        'place, 16 points, y': _inside(told[4].place[:, 1:], told[4].place_sigma[:, 1:]),
        'force, 49 points': _inside(told[7].force, told[7].force_sigma),
        'force, 25 points': _inside(told[5].force, told[5].force_sigma),
        'force, 16 points': _inside(told[4].force, told[4].force_sigma),
        'force, 49 points, at its squares': _inside(*_told(fits[7], again)[2:]),
    }
    there = np.repeat(grids.grid(7), 8, axis=0), np.tile(np.linspace(1, 15, 8), 49)
    curve, ours = SENSOR.pipeline(estimator='mean_curve'), _grid(grids, world, 4, seed + 500)
    return {
        'linear': _length(formula.place), 'bound': 1e3 * world.bound(places),
        'plate': _length(_plate(train[5], test)), 'printed': _rms(formula.force),
        'at_squares': _rms(squares.force), 'fit': seconds, 'least': _least(world, places, load),
        **{f'place{count * count}': _length(told[count].place) for count in (4, 5, 7)},
        **{f'force{count * count}': _rms(told[count].force) for count in (4, 5, 7)},
        'least_there': _least(world, *there), 'least_three': _least_of_three(world, *there),
        'square8': _rms(_told(fits[7], again).force),
        'square60': np.nan if quick else _rms(_told(fits[60], again).force),
        'worst16': float(np.abs(_told(fits[4], ours).force).max()),
        'curve16': float(np.abs(_told(curve.fit(train[4]), ours).force).max()),
        **_curves(fits[4], grids, world), **_times(fits[7], test),
    }, coverage  # fmt: skip


def _stream(module: ModuleType, seed: int) -> dict[str, float]:
    """Force in presses on a film that creeps, and without the model of its past."""
    world, rng = module.SheetWorld(seed + 50), np.random.default_rng(seed)
    where = np.repeat(_module('five_wire_world').grid(7), 3, axis=0)
    load = np.tile([3.0, 8.0, 14.0], 49) * rng.uniform(0.9, 1.05, 147)
    order = rng.permutation(147)
    train = module.pressed(world, LAYOUT, where[order], load[order], seed)
    places = rng.uniform(12.5e-3, 87.5e-3, (60, 2))
    test = module.pressed(world, LAYOUT, places, rng.uniform(2, 14, 60), seed + 1)
    pipeline = SENSOR.pipeline().fit(train)
    crept, lightest = _rms(_told(pipeline, test).force), pipeline.report['contact']
    pipeline.estimation.crept_ = None
    without = _rms(_told(pipeline, test).force)
    return {'crept': crept, 'uncrept': without, 'lightest': lightest['lightest_felt']}


def _grid(
    grids: ModuleType, world: object, count: int, seed: int, loads: int | None = None
) -> Recording:
    """Calibration: loads of 1..15 N at a grid of places."""
    loads = (15 if count == 4 else 8) if loads is None else loads
    where = np.repeat(grids.grid(count), loads, axis=0)
    load = np.tile(np.linspace(1, 15, loads), count**2)
    return grids.touches(world, LAYOUT, where, load, seed)


def _told(pipeline: Pipeline, test: Recording) -> Told:
    """Errors and stated sigmas of touches."""
    states = pipeline.process_batch(test)
    touched = (test.truth['in_contact'] == 1) & (states.in_contact == 1)
    place = 1e3 * (states.position - test.truth['position'])[touched, :2]
    force = (states.force - test.truth['force'])[touched, 2:]
    cov, cov_force = states.position_cov[touched], states.force_cov[touched, 2:, 2]
    sigma = 1e3 * np.sqrt(np.diagonal(cov, axis1=1, axis2=2))[:, :2]
    return Told(place, sigma, force, np.sqrt(cov_force))


def _plate(train: Recording, test: Recording) -> Array:
    """Errors (mm) of a thin plate over the potentials."""
    touched, fresh = train.truth['in_contact'] == 1, test.truth['in_contact'] == 1
    plate = ThinPlate().fit(train.values[touched, 0, :2], train.truth['position'][touched, :2])
    said = plate.predict(test.values[fresh, 0, :2])
    return 1e3 * (said - test.truth['position'][fresh, :2])


def _length(error: Array) -> float:
    return float(np.linalg.norm(error, axis=1).mean())


def _rms(error: Array) -> float:
    return float(np.sqrt((error**2).mean()))


def _inside(error: Array, sigma: Array) -> list[float]:
    """Per cent inside one and two sigma, and inside one in each third of the sigma."""
    ratio, order = np.abs(error / sigma).ravel(), np.argsort(sigma.ravel(), kind='stable')
    thirds = [100 * float((ratio[rows] < 1).mean()) for rows in np.array_split(order, 3)]
    return [100 * float((ratio < 1).mean()), 100 * float((ratio < 2).mean()), *thirds]


def _least(world: object, places: Array, force: Array) -> float:
    """Force error (N) that the divider's noise alone makes, with all else known."""
    step, noise, rng = 1e-4, world.noise, np.random.default_rng(0)
    world.noise = 0.0
    high, low = (world.readings(places, force + d, rng)[:, 2] for d in (step, -step))
    world.noise = noise
    return float(np.sqrt(np.mean((noise * 2 * step / (high - low)) ** 2)))


def _least_of_three(world: object, places: Array, force: Array) -> float:
    """Force error (N) that the noise of all three readings makes: the place is not known."""
    noise, rng, steps = world.noise, np.random.default_rng(0), np.diag([1e-5, 1e-5, 1e-3])
    world.noise = 0.0
    slopes = [
        world.readings(places + step[:2], force + step[2], rng)
        - world.readings(places - step[:2], force - step[2], rng)
        for step in steps
    ]
    world.noise = noise
    turned = np.linalg.inv(np.stack(slopes, axis=-1) / 2)[:, 2] * steps[2, 2]
    return float(noise * np.sqrt((turned**2).sum(axis=1).mean()))


def _curves(pipeline: Pipeline, grids: ModuleType, world: object) -> dict[str, float]:
    """Non-linearity and relative standard deviation over 16 squares, before and after."""
    loads, before, said = _squares(pipeline, grids, world)
    figures = (*_straight(said, loads), *_straight(before, loads))
    return dict(zip(('bent', 'uneven', 'raw_bent', 'raw_uneven'), figures, strict=True))


def _squares(pipeline: Pipeline, grids: ModuleType, world: object) -> tuple[Array, Array, Array]:
    """Loads (15,), resistances over R0 and forces (16, 15) at the squares of [5]."""
    rng, loads = np.random.default_rng(0), np.arange(1.0, 16.0)
    where, load = np.repeat(grids.grid(4), 15, axis=0), np.tile(loads, 16)
    test = grids.touches(world, LAYOUT, where, load, 7)
    touched = test.truth['in_contact'] == 1
    order = np.lexsort(
        [test.truth['force'][touched, 2], *test.truth['position'][touched, 1::-1].T]
    )
    said = pipeline.process_batch(test).force[touched, 2][order].reshape(16, 15)
    return loads, (1 / world.readings(where, load, rng)[:, 2] - 1).reshape(16, 15), said


def _straight(curves: Array, loads: Array) -> tuple[float, float]:
    """Largest deviation of the mean curve from its line over its range; mean relative std (%)."""
    mean = curves.mean(axis=0)
    off = np.abs(mean - np.polyval(np.polyfit(loads, mean, 1), loads)).max()
    return 100 * off / np.ptp(mean), 100 * float((curves.std(axis=0) / mean).mean())


def _times(pipeline: Pipeline, test: Recording, count: int = 60) -> dict[str, float]:
    """Microseconds per frame: of the pipeline alone and in a batch, and of the estimators."""
    touched = np.flatnonzero(test.truth['in_contact'] == 1)[:count]
    frames = [test.frame(i) for i in touched]
    pipeline.reset()
    single = min(_seconds(lambda: [pipeline.process(f) for f in frames]) for _ in range(30))
    batch = min(_seconds(lambda: pipeline.process_batch(test)) for _ in range(5))
    estimation, kept = pipeline.estimation, []
    estimate = estimation.estimate
    estimation.estimate = lambda *given: (kept.append(given), estimate(*given))[1]
    for frame in frames:
        pipeline.process(frame)
    del estimation.estimate
    some = kept[:4]  # few at a time: what else the machine does would count
    alone = min(_seconds(lambda: [estimate(*given) for given in some]) for _ in range(2000))
    scale = 1e6 / count
    return {
        'single': scale * single,
        'batch': 1e6 * batch / len(test),
        'estimators': 1e6 / len(some) * alone,
    }


def _seconds(work: object) -> float:
    began = time.perf_counter()
    work()
    return time.perf_counter() - began


def _draw(grids: ModuleType, world: object, seed: int) -> dict[str, str]:
    """Maps of place error, curves of force before and after, and error against time."""
    train = _grid(grids, world, 5, seed)
    ours, linear = SENSOR.pipeline().fit(train), SENSOR.pipeline(estimator='printed').fit(train)
    line = np.linspace(13e-3, 87e-3, 25)
    where = np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)
    test = grids.touches(world, LAYOUT, where, np.full(len(where), 8.0), seed + 1)
    loads, before, said = _squares(
        SENSOR.pipeline().fit(_grid(grids, world, 4, seed)), grids, world
    )
    return {
        'linear_map': _map(linear, test, 20 * STEPS, 'Place error of the linear formula'),
        'place_map': _map(ours, test, STEPS, 'Place error of the harmonic map, 25 points'),
        'before': _lines(loads, before, 'R / R0', 'Resistance at the 16 squares over the load'),
        'after': _lines(loads, said, 'estimate (N)', 'Force at the 16 squares over the load'),
        'cost': _drawn_cost(train, test),
    }


def _lines(loads: Array, told: Array, label: str, words: str) -> str:
    """One line for each square."""
    high = 1.05 * float(told.max())
    plot = Plot((0.0, 15.5), (0.0, high), 'load (N)', label, (360, 300), told=words)
    for n, row in enumerate(told):
        plot.line(loads, row, f'line c{n % 5}')
    return standalone(plot)


def _map(pipeline: Pipeline, test: Recording, steps: Array, told: str) -> str:
    """Errors over the sheet, darker where they are larger."""
    touched = test.truth['in_contact'] == 1
    place = 1e3 * test.truth['position'][touched, :2]
    error = np.linalg.norm(_told(pipeline, test).place, axis=1)
    shades = ', '.join(f'{step:g}' for step in steps)
    plot = Plot.plan((0.0, 100.0), (0.0, 100.0), '(mm)', f'{told}; shades above {shades} mm')
    kinds = [f's{n}' for n in np.searchsorted(steps, error)]
    plot.boxes(*place.T, 3.1, kinds)
    return standalone(plot)


def _drawn_cost(train: Recording, test: Recording) -> str:
    """Error of a place over the time of a frame, for each way to it."""
    touched, fresh = train.truth['in_contact'] == 1, test.truth['in_contact'] == 1
    x, y = train.values[touched, 0, :2], train.truth['position'][touched, :2]
    ways = {'harmonic map': HarmonicMap(SIZE), 'thin plate': ThinPlate()}
    told, points = test.truth['position'][fresh, :2], {}
    given = test.values[fresh, 0, :2]

    def measure(predict: object, some: int = FRESH) -> tuple[float, float]:
        error = 1e3 * np.linalg.norm(predict(given[:some]) - told[:some], axis=1).mean()
        seconds = min(_seconds(lambda: predict(given[:1])) for _ in range(min(some, 200)))
        return 1e6 * seconds, float(error)

    for name, way in ways.items():
        points[name] = measure(way.fit(x, y).predict)
    points['linear formula'] = measure(lambda u: linear_place(u, SIZE))
    points['a solve each frame'] = measure(_solved, 20)
    return array_figures.costs(points, ('one frame (us)', 'mean error (mm)'), 'Error against time')


def _solved(potentials: Array) -> Array:
    """Places by a solve of the nominal sheet for each frame: what a table spares."""
    shape, border = (33, 33), np.full((4, 8), 24.0)
    line = np.linspace(0, SIZE[0], 33)
    places = np.stack(np.meshgrid(line, line, indexing='ij'), axis=-1).reshape(-1, 2)
    found = []
    for one in potentials:
        held = np.array([1.0, np.nan, 0.0, np.nan])
        both = [sheet_potential(SIZE, shape, border, np.roll(held, turn)) for turn in (0, 1)]
        apart = np.stack([u.ravel() for u in both], axis=1) - one
        found.append(places[(apart**2).sum(axis=1).argmin()])
    return np.array(found)


def _module(name: str) -> ModuleType:
    """A world that the tests use too."""
    return load_source(FOLDER / f'{name}.py', 'bench five_wire_skin')


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
        *(['quick: the world of finite differences alone, without 60 touches a square'] * quick),
    ]
