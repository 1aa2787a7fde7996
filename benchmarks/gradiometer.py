# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""gradiometer in a world of exact fields: force, noise, leaks, temperature, magnets and cost.

The world (`test/reference/gradiometer_world.py`) has fields of magpylib, gains, crossed axes,
offsets, a disc out of place and an elastomer that stiffens, expands and softens. The printed chain
learns from far more points than ours. The bound is that of Cramer and Rao with the same unknowns.
"""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.harness.independent import independent_rows
from benchmarks.harness.rows import BenchResult, Row
from benchmarks.worlds import gradiometer_surroundings, gradiometer_trials
from benchmarks.worlds.huber_polynomial import HuberPolynomial
from tactile_ros.estimators.polynomial_force import PolynomialForce
from tactile_ros.evaluation.figures import Plot, standalone
from tactile_ros.types import Frame

if TYPE_CHECKING:
    from collections.abc import Callable
    from types import ModuleType

    from tactile_ros.pipeline import Pipeline
    from tactile_ros.types import Array, Recording

SENSOR, SPECIMENS = gradiometer_trials.SENSOR, gradiometer_trials.SPECIMENS
MILLI, FULL = gradiometer_trials.MILLI, gradiometer_trials.FULL
MANY = {'quick': 600, 'normal': 13_000, 'full': 13_000}
MICRO, STEP = 1e6, 1e-7
PAPER_NOISE = 3e-6  # T, of one sample of 220 us at room temperature [3]
SAMPLE_MS = 0.22
AVERAGES = {'quick': (4,), 'normal': (1, 4, 16), 'full': (1, 4, 16)}
DRAWN, MORE = ('polynomial', 'inversion'), ('ridge',)
HALF_POWER = 0.443  # of a running mean: its frequency of half power times its length


def bound(world: ModuleType, shift: Array) -> Array:
    """Least standard deviations (s, 3) (N) at places (s, 3): place and uniform field unknown."""
    heat = np.zeros(len(shift))

    def seen(place: Array) -> Array:
        field = np.einsum('tij,stj->sti', world.mix, world.field(place, world.tilts(place), heat))
        return np.asarray(field[..., [0, 2]].reshape(len(place), 8))

    steps = STEP * np.eye(3)
    slope = np.stack([(seen(shift + d) - seen(shift - d)) / 2 / STEP for d in steps], axis=2)
    give = np.stack(
        [(world.force(shift + d, heat) - world.force(shift - d, heat)) / 2 / STEP for d in steps],
        axis=2,
    )
    uniform = np.linalg.qr(np.tile(np.eye(2), (4, 1)))[0]
    slope = slope - uniform @ (uniform.T @ slope)
    inverse = np.linalg.inv(np.einsum('sni,snj->sij', slope, slope))
    variance = np.einsum('sai,sij,saj->sa', give, inverse, give)
    return np.asarray(world.noise * np.sqrt(variance))


def accuracy(world: ModuleType, ours: Pipeline, extent: str) -> list[Row]:
    """Force with 300 points and with many, beside the printed chain on many."""
    many, test = world.record(MANY[extent], 3), world.record(2000, 2)
    limit = float(np.max(world.config.saturation))
    table = []
    for recording in (many, test):
        sound = np.abs(recording.values).max(axis=(1, 2)) < limit
        sound[: world.rest] = False
        table.append((recording.values[sound].reshape(-1, 8), recording.truth['force'][sound]))
    chains = {
        name: gradiometer_trials.rms(chain.fit(*table[0]).predict(table[1][0]) - table[1][1])
        for name, chain in (('squares', PolynomialForce()), ('huber_l1', HuberPolynomial()))
    }
    better = min(chains.values(), key=lambda error: float((error**2).sum()))
    full = SENSOR.pipeline(world.config).fit(many)
    shift = world.shifts(2000, np.random.default_rng([2, 5]))
    least = gradiometer_trials.rms(bound(world, shift))
    rows = []
    for points, pipeline, share in ((300, ours, (0.2, 0.2, 1.0)), (MANY[extent], full, None)):
        found = gradiometer_trials.rms(gradiometer_trials.errors(pipeline, test, world.rest)[0])
        for i, axis in enumerate('xyz'):
            aim = 1.2 * least[i] if share is None else share[i] * better[i]
            rows.append(
                Row(f'F{axis}, {points} points, rms', 'mN', MILLI * found[i],
                    peer=MILLI * better[i], bound=MILLI * least[i], aim=MILLI * aim)
            )  # fmt: skip
    rows += [
        Row(f'chain of [3], {name}, Fz rms', 'mN', MILLI * error[2])
        for name, error in chains.items()
    ]
    return rows + precision(world, full)


def precision(world: ModuleType, pipeline: Pipeline) -> list[Row]:
    """Noise of a light touch and at mid load, over the bound."""
    rows = []
    for name, depth in (('a light touch', 0.03), ('mid load', 0.5)):
        place = np.array([[0.05 * world.gap, 0.03 * world.gap, -depth * world.depth]])
        shift = np.concatenate([np.zeros((world.rest, 3)), np.repeat(place, 2000, axis=0)])
        states, asked = gradiometer_trials.judged(
            pipeline, world.recorded(shift, 21, still()), world.rest
        )
        least = bound(world, place)[0]
        found = states.force[asked].std(axis=0)
        worst = int(np.argmax(found / least))
        rows.append(
            Row(f'noise at {name}, worst axis F{"xyz"[worst]}', 'mN', MILLI * found[worst],
                bound=MILLI * least[worst], aim=1.1 * MILLI * least[worst])
        )  # fmt: skip
    return rows


def still() -> object:
    """A scene without anything around."""
    return _module().Scene()


def table_one(module: ModuleType, extent: str) -> tuple[list[Row], str]:
    """[3], table I and figure 7: noise of Fz against averaging, and range."""
    rows, drawing = [], ''
    for count in AVERAGES[extent]:
        world = module.World(11, noise=PAPER_NOISE / np.sqrt(count))
        pipeline = SENSOR.pipeline(world.config).fit(world.record(1000, 3))
        place = np.array([[0.0, 0.0, -0.03 * world.depth]])
        shift = np.concatenate([np.zeros((world.rest, 3)), np.repeat(place, 2000, axis=0)])
        states, asked = gradiometer_trials.judged(
            pipeline, world.recorded(shift, 22, still()), world.rest
        )
        force = MILLI * states.force[asked, 2]
        least = MILLI * bound(world, place)[0, 2]
        what = f'Fz noise, {count} x {SAMPLE_MS} ms averaged'
        paper = 2.7 if count == 4 else None
        rows.append(Row(what, 'mN', float(force.std()), paper=paper, bound=least))
        band = MILLI * HALF_POWER / (count * SAMPLE_MS)
        rows.append(Row(f'bandwidth, {count} x {SAMPLE_MS} ms averaged', 'Hz', band, 'high'))
        if count == 4:
            drawing = histogram(force - force.mean())
    deepest = world.force(np.array([[0.0, 0.0, -0.8 * world.gap]]), np.zeros(1))[0, 2]
    rows.append(Row('Fz at 0.8 of the gap', 'N', float(deepest), 'high', paper=FULL))
    return rows, drawing


def histogram(force: Array) -> str:
    """Figure 7 of [3]: how often forces (s,) (mN) were said while one was held."""
    edges = np.linspace(-1.5, 1.5, 41)
    heights = np.histogram(force, edges)[0] / len(force) / (edges[1] - edges[0])
    told = f'Fz about its mean, four averages, {force.std():.2f} mN rms; [3] has 2.7 mN.'
    plot = Plot(
        (-1.5, 1.5), (0, 1.15 * heights.max()), 'Fz (mN)', 'density (1/mN)', description=told
    )
    plot.bars(edges, heights, 'fill c0')
    plot.text(0.2, None, f'{force.std():.2f} mN rms ([3]: 2.7)')
    return standalone(plot)


def least_us(call: Callable[[], object], repeats: int = 200) -> float:
    """Least time of a call (microseconds)."""
    call()
    best = np.inf
    for _ in range(repeats):
        began = time.perf_counter()
        call()
        best = min(best, time.perf_counter() - began)
    return MICRO * best


def cost(ours: Pipeline, world: ModuleType) -> list[Row]:
    """Microseconds of a frame: the chain, the inversion and the whole pipeline."""
    test = world.record(2000, 2)
    chain = SENSOR.pipeline(world.config, 'polynomial').fit(world.record(1000, 1))
    flat = test.values.reshape(-1, 8)
    printed = PolynomialForce().fit(flat, test.truth['force'])
    disc = ours.estimation
    change = flat - flat[: world.rest].mean(axis=0)
    methods: dict[str, tuple[Callable[[Array], object], Array, float]] = {
        'chain of [3]': (printed.predict, flat, 20.0),
        'inversion': (lambda x: disc.invert(disc.model.frames(MILLI * x)), change, 60.0),  # type: ignore[attr-defined]
    }
    rows = []
    for name, (call, x, aim) in methods.items():
        single = least_us(lambda call=call, x=x: call(x[100:101]))  # type: ignore[misc]
        batch = least_us(lambda call=call, x=x: call(x), 20) / len(x)  # type: ignore[misc]
        rows.append(
            Row(f'{name}, one frame', 'us', single, aim=aim, us_single=single, us_batch=batch)
        )
        if name == 'chain of [3]':
            rows.append(Row(f'{name}, a frame of a batch', 'us', batch, aim=1.0))
    for name, pipeline in {'chain': chain, 'ours': ours}.items():
        frame = Frame(None, 0, test.values[100])
        single = least_us(lambda p=pipeline, f=frame: p.process(f))  # type: ignore[misc]
        batch = least_us(lambda p=pipeline: p.process_batch(test), 5) / len(flat)  # type: ignore[misc]
        rows.append(Row(f'whole pipeline, {name}', 'us', single, us_single=single, us_batch=batch))
    return rows


def _fz(world: ModuleType, name: str) -> tuple[Pipeline, Recording, Array, Array]:
    """An estimator of 300 points, what judges it, its loads (N) and its errors of Fz (mN)."""
    pipeline, test = SENSOR.pipeline(world.config, name), world.record(1000, 2)
    states, asked = gradiometer_trials.judged(pipeline.fit(world.record(300, 1)), test, world.rest)
    error = MILLI * np.abs(states.force - test.truth['force'])[asked, 2]
    return pipeline, test, test.truth['force'][asked, 2], error


def speeds(
    world: ModuleType, others: list[ModuleType], names: tuple[str, ...]
) -> tuple[list[Row], str, str]:
    """Error of Fz against the time of a frame, and against load, of estimators of 300 points."""
    found, said, seeds = {}, {}, {}
    for name in names:
        pipeline, test, load, error = _fz(world, name)
        frame = Frame(None, 0, test.values[100])
        spent = least_us(lambda p=pipeline, f=frame: p.process(f))  # type: ignore[misc]
        found[name] = spent, float(gradiometer_trials.rms(error[:, None])[0])
        said[name] = load, np.maximum(error, 1e-3)
        more = [float(gradiometer_trials.rms(_fz(other, name)[3][:, None])[0]) for other in others]
        seeds[name] = (found[name][1], *more)
    told = 'Time of a frame through the whole pipeline against the error of Fz, 300 points each.'
    high = 2 * max(error for _, error in found.values())
    wide = 0.8 * min(us for us, _ in found.values()), 1.4 * max(us for us, _ in found.values())
    speed = Plot(wide, (0.05, high), 'time of a frame (us)', 'Fz rms (mN)', (480, 320),
                 log_x=True, description=told, log_y=True)  # fmt: skip
    for k, (name, (us, error)) in enumerate(found.items()):
        speed.mark(us, error, k % 4, f'fill c{k % 4}')
        speed.text(us, error, name, 'middle', shift=-14)
    told = 'Error of Fz against load: the chain of [3] and the inversion, 300 points each.'
    top = float(said['inversion'][0].max())
    load = Plot((0, top), (1e-3, high), 'Fz (N)', 'error of Fz (mN)', (480, 320), description=told,
                log_y=True)  # fmt: skip
    for k, name in enumerate(DRAWN):
        load.dots(said[name][0][:500], said[name][1][:500], f'c{k}')
        load.text(0.02 * top, None, f'{name}: {found[name][1]:.3g} mN rms', row=k, kind=f'c{k}')
    rows = [
        Row(f'Fz by {name}, 300 points, rms', 'mN', float(np.mean(seeds[name])), us_single=us,
            by_seed=seeds[name], compared='Fz of the gradiometer, 300 points', method=name)
        for name, (us, _) in found.items()
    ]  # fmt: skip
    return rows, standalone(speed), standalone(load)


def run(extent: str, command: str) -> BenchResult:
    """Compare with the printed chain, then disturb, then time."""
    module = _module()
    world = module.World(11)
    ours = SENSOR.pipeline(world.config).fit(world.record(300, 1))
    rows = accuracy(world, ours, extent)
    ranges, noise = table_one(module, extent)
    rows += [*ranges, *gradiometer_surroundings.leaks(world, module, ours)]
    around, specimens = gradiometer_surroundings.surroundings(module, extent)
    rows += [*around, *cost(ours, world)]
    notes = [
        f'peer: the better of converged Huber + L1 and SVD of the chain, {MANY[extent]} points',
        f'estimators: {ours.estimators}; specimens {specimens} of the world, '
        f'{len(specimens)} of {len(SPECIMENS[extent])}',
    ]
    names = DRAWN if extent == 'quick' else DRAWN + MORE
    others = [module.World(s) for s in SPECIMENS[extent][1:2]]
    methods, speed, load = speeds(world, others, names)
    rows += methods
    drawings = {'noise': noise, 'speed': speed, 'error': load}
    if extent == 'quick':
        notes.append('quick: at one temperature, one count of averages, two estimators')
    else:
        thermal, drawings['temperature'] = gradiometer_surroundings.warmth(module)
        rows += thermal
    rows += independent_rows('gradiometer', extent)
    return BenchResult('gradiometer', command, [11], rows, notes, drawings)


def _module() -> ModuleType:
    """The world, which needs magpylib and the sources."""
    from reference import gradiometer_world

    return gradiometer_world
