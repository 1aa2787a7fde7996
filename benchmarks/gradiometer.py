"""gradiometer in a world of exact fields: force, noise, leaks, temperature, magnets and cost.

The world (`test/reference/gradiometer_world.py`) has fields of magpylib, gains, crossed axes,
offsets, a disc out of place and an elastomer that stiffens, expands and softens. The printed chain
learns from far more points than ours. The bound is that of Cramer and Rao with the same unknowns.
"""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.estimators.polynomial_force import PolynomialForce
from tactile_ros.estimators.polynomial_ridge import PolynomialRidge
from tactile_ros.evaluation.benchmark import BenchResult, Row
from tactile_ros.evaluation.drawing import standalone
from tactile_ros.evaluation.sources import load_source
from tactile_ros.evaluation.svg import Plot
from tactile_ros.sensors import load_sensor
from tactile_ros.types import Frame

if TYPE_CHECKING:
    from collections.abc import Callable
    from types import ModuleType

    from tactile_ros.pipeline import Pipeline
    from tactile_ros.types import Array, Bools, ContactStates, Recording

MANY = {'quick': 1000, 'normal': 13_000, 'full': 13_000}
SPECIMENS = {'quick': (11,), 'normal': tuple(range(11, 19)), 'full': tuple(range(11, 27))}
WARM = {'quick': 300, 'normal': 1000, 'full': 1000}
MAGNETS, BESIDE = 24, 40  # of each specimen, and presses beside each
WORLD = Path(__file__).resolve().parents[1] / 'test' / 'reference' / 'gradiometer_world.py'
SENSOR = load_sensor('gradiometer')
MILLI, MICRO, STEP = 1e3, 1e6, 1e-7
FULL = 3.5  # N [3]
PAPER_NOISE = 3e-6  # T, of one sample of 220 us at room temperature [3]
SAMPLE_MS, AVERAGES = 0.22, (1, 4, 16)
HALF_POWER = 0.443  # of a running mean: its frequency of half power times its length
UNIFORM = 2e-3  # T [3]
ANSWERS = ('Fx', 'Fy', 'Fz', 'Tx', 'Ty')
SHARES = {1: 68.27, 2: 95.45}  # % of normal errors inside so many sigmas
PRESSES = 300  # of a calibration whose coverage is judged
MEDIAN = 0.6745  # of the absolute value of normal errors, in sigmas


def rms(error: Array) -> Array:
    """Root mean square of every component."""
    return np.asarray(np.sqrt((error**2).mean(axis=0)))


def judged(pipeline: Pipeline, recording: Recording, rest: int) -> tuple[ContactStates, Bools]:
    """States, and which of them are valid presses."""
    states = pipeline.process_batch(recording)
    asked = states.valid.copy()
    asked[:rest] = False
    return states, asked


def errors(pipeline: Pipeline, recording: Recording, rest: int) -> tuple[Array, Array]:
    """Errors (s, 5) of the answers (N, Nm) and their sigmas, of valid presses; NaN: not told."""
    states, asked = judged(pipeline, recording, rest)
    error, sigma = [], []
    for name, count in (('force', 3), ('torque', 2)):
        spread = np.sqrt(np.diagonal(getattr(states, f'{name}_cov'), axis1=1, axis2=2))
        error.append((getattr(states, name) - recording.truth[name])[asked, :count])
        sigma.append(spread[asked, :count])
    return np.hstack(error), np.hstack(sigma)


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
        name: rms(PolynomialForce(name).fit(*table[0]).predict(table[1][0]) - table[1][1])
        for name in ('squares', 'huber_l1')
    }
    better = min(chains.values(), key=lambda error: float((error**2).sum()))
    full = SENSOR.pipeline(world.config).fit(many)
    shift = world.shifts(2000, np.random.default_rng([2, 5]))
    least = rms(bound(world, shift))
    rows = []
    for points, pipeline, share in ((300, ours, (0.2, 0.2, 1.0)), (MANY[extent], full, None)):
        found = rms(errors(pipeline, test, world.rest)[0])
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
        states, asked = judged(pipeline, world.recorded(shift, 21, still()), world.rest)
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


def table_one(module: ModuleType) -> tuple[list[Row], str]:
    """[3], table I and figure 7: noise of Fz against averaging, and range."""
    rows, drawing = [], ''
    for count in AVERAGES:
        world = module.World(11, noise=PAPER_NOISE / np.sqrt(count))
        pipeline = SENSOR.pipeline(world.config).fit(world.record(1000, 3))
        place = np.array([[0.0, 0.0, -0.03 * world.depth]])
        shift = np.concatenate([np.zeros((world.rest, 3)), np.repeat(place, 2000, axis=0)])
        states, asked = judged(pipeline, world.recorded(shift, 22, still()), world.rest)
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
    plot = Plot((-1.5, 1.5), (0, 1.15 * heights.max()), 'Fz (mN)', 'density (1/mN)', told=told)
    plot.bars(edges, heights, 'fill c0')
    plot.text(0.2, None, f'{force.std():.2f} mN rms ([3]: 2.7)')
    return standalone(plot)


def leaks(world: ModuleType, module: ModuleType, ours: Pipeline) -> list[Row]:
    """A uniform field of 2 mT: one pixel alone, without known gains, and with."""
    few = world.record(300, 1)
    gained = SENSOR.pipeline(world.config).fit(
        few, world.record(200, 9, module.Scene(turned=True))
    )
    clean, rows = world.record(1000, 2), []
    found = np.zeros((2, 3))
    for i in range(3):
        moved = world.record(1000, 2, module.Scene(stray=tuple(UNIFORM * np.eye(3)[i])))
        for k, pipeline in enumerate((ours, gained)):
            (a, first), (b, second) = (judged(pipeline, r, world.rest) for r in (clean, moved))
            asked = first & second
            found[k, i] = rms((b.force - a.force)[asked]).max()
    percent = 100 * found / FULL
    for i, axis in enumerate('xyz'):
        what = f'leak of 2 mT along {axis}'
        rows.append(Row(f'{what}, no gains known', '%', percent[0, i], paper=0.3, aim=0.15))
        rows.append(Row(f'{what}, gains known', '%', percent[1, i], paper=0.3, aim=0.05))
    return rows + magnetometers(world, module, few, clean)


def magnetometers(
    world: ModuleType, module: ModuleType, few: Recording, clean: Recording
) -> list[Row]:
    """The same field where nothing is taken off: one pixel, and all as a plain magnetometer."""
    touched = slice(world.rest, None)
    pixels: dict[str, tuple[slice, tuple[int, ...]]] = {
        'one pixel alone': (slice(1), (1, 2, 3)),
        'squares of all channels, mean kept': (slice(None), (1, 2)),
    }
    rows = []
    for name, (taken, degrees) in pixels.items():
        x, still = (r.values[touched, taken].reshape(-1, 2 * len(r.values[0, taken]))
                    for r in (few, clean))  # fmt: skip
        plain = PolynomialRidge(degrees).fit(x, few.truth['force'][touched])
        apart = []
        for way in UNIFORM * np.concatenate([np.eye(3), -np.eye(3)]):
            moved = world.record(1000, 2, module.Scene(stray=tuple(way))).values[touched, taken]
            apart.append(plain.predict(moved.reshape(still.shape)) - plain.predict(still))
        leak = 100 * np.abs(np.array(apart)) / FULL
        worst = float(np.sqrt((leak**2).mean(axis=1)).max())
        what = f'leak of 2 mT, {name}'
        rows += [
            Row(f'{what}, worst axis', '%', worst, paper=20.0),
            Row(f'{what}, worst axis and press', '%', float(leak.max()), paper=20.0),
        ]
    return rows


def warmth(module: ModuleType, extent: str) -> tuple[list[Row], str]:
    """0 to 50 C against one temperature, and figure 9 of [3]."""
    world, count = module.World(11), WARM[extent]
    scenes = {
        'disc as warm as the chip': module.Scene(span=50.0),
        'disc lags behind': module.Scene(span=50.0, ramp_s=600.0),
    }
    blind = SENSOR.pipeline(world.config).fit(world.record(count, 4))
    cold = rms(errors(blind, world.record(1000, 5), world.rest)[0])
    fits = {
        name: SENSOR.pipeline(world.config).fit(world.record(count, 4, scene))
        for name, scene in scenes.items()
    }
    rows = []
    for name, scene in scenes.items():
        hot = rms(errors(fits[name], world.record(1000, 5, scene), world.rest)[0])
        ratio = float((hot / cold).max())
        rows.append(Row(f'0..50 C over isothermal, {name}', '1', ratio, aim=1.5))
    good, scene = next(iter(fits.values())), next(iter(scenes.values()))
    many, test = world.record(3 * count, 4, scene), world.record(1000, 5, scene)
    chain = SENSOR.pipeline(world.config, 'polynomial').fit(many)
    found = {'not compensated': blind, 'alpha and beta of [3], fitted': chain, 'ours': good}
    said = {}
    for name, pipeline in found.items():
        error = errors(pipeline, test, world.rest)[0]
        rows.append(Row(f'Fz over 0..50 C, {name}', 'mN', MILLI * float(rms(error)[2])))
        asked = judged(pipeline, test, world.rest)[1]
        assert test.temperature_c is not None
        said[name] = test.temperature_c[asked, 0], MILLI * error[:, 2]
    return rows, drifts(said)


def drifts(said: dict[str, tuple[Array, Array]]) -> str:
    """Figure 9 of [3]: error of Fz (mN) against the chip's temperature."""
    high = max(float(np.quantile(np.abs(error), 0.99)) for _, error in said.values())
    told = 'Error of Fz over temperature, not compensated, by the chain of [3], and ours.'
    plot = Plot((10, 60), (-high, high), 'chip (C)', 'error of Fz (mN)', (480, 320), told=told)
    for k, (name, (warm, error)) in enumerate(said.items()):
        keep = np.abs(error) < high
        plot.dots(warm[keep][:400], error[keep][:400], f'c{k}')
        plot.text(11, None, f'{name}: {rms(error[:, None])[0]:.3g} mN rms', row=k, kind=f'c{k}')
    return standalone(plot)


def surroundings(module: ModuleType, extent: str) -> list[Row]:
    """Magnets at 14 mm, clipped frames and coverage, over specimens."""
    clean, magnets, clipped, usable = [], [], [], []
    for seed in SPECIMENS[extent]:
        # presses, noise and magnets of its own: shares of the same draws are off together
        world, draw = module.World(seed), 1000 * seed
        pipeline = SENSOR.pipeline(world.config).fit(world.record(PRESSES, draw + 1))
        clean.append(errors(pipeline, world.record(2000, draw + 2), world.rest))
        for k in range(MAGNETS):
            near = world.record(BESIDE, draw + 100 + k, module.Scene(magnet=14e-3))
            magnets.append(errors(pipeline, near, world.rest))
        strong = world.record(
            1000, draw + 7, module.Scene(stray=(0.0, 0.0, 0.3 * limit_of(world)))
        )
        hit = (np.abs(strong.values) >= limit_of(world) - 1e-9).any(axis=(1, 2))
        states = pipeline.process_batch(strong)
        clipped.append((hit.sum(), (hit & ~states.valid).sum()))
        rest = np.arange(len(hit)) >= world.rest
        usable.append(((rest & ~hit).sum(), (rest & ~hit & states.valid).sum()))
    told, valid = np.sum(clipped, axis=0), np.sum(usable, axis=0)
    flagged, used = 100 * told[1] / max(told[0], 1), 100 * valid[1] / valid[0]
    return [
        *coverage('', clean),
        *coverage(', magnet at 14 mm', magnets, certain=True),
        *widths(magnets),
        Row(f'clipped frames flagged, of {told[0]}', '%', flagged, 'high', aim=100.0),
        Row(f'clean frames valid, of {valid[0]}', '%', used, 'high', aim=99.9),
    ]


def coverage(scene: str, found: list[tuple[Array, Array]], *, certain: bool = False) -> list[Row]:
    """Shares of errors (s, 5) inside one and two sigma: of all rows, and of thirds of the sigma.

    The aim is a distance of five points from a normal distribution's share, or the 95 % interval
    of as many presses as calibrated a third where that is wider; beside magnets, whose fields are
    not those of any model, that two sigmas hold 95 % of all rows.
    """
    rows = []
    for i, answer in enumerate(ANSWERS):
        for sigmas, share in SHARES.items():
            table = np.array([parts(error[:, i], sigmas * sigma[:, i]) for error, sigma in found])
            mean = 100 * table.mean(axis=0)
            what = f'{answer} inside {sigmas} sigma{scene}'
            aim = 95.0 if certain and sigmas == 2 else None
            rows.append(Row(what, '%', mean[0], 'high', bound=share, aim=aim))
            rows += [
                Row(f'{what}, third {k + 1} of sigma', '%', mean[k + 1], 'high', bound=share)
                for k in range(3)
            ]
            if not certain:
                off = float(np.abs(mean - share).max())
                chance = 2 * np.sqrt(share * (100 - share) / (PRESSES / 3 * len(found)))
                what = f'{what}: farthest off of the four'
                rows.append(Row(what, 'points', off, aim=float(max(5.0, chance))))
    return rows


def parts(error: Array, limit: Array) -> list[float]:
    """Shares of told errors (s,) within limits (s,), of all and of thirds by the limit."""
    known = np.isfinite(error)
    error, limit = error[known], limit[known]
    order = np.argsort(limit, kind='stable')
    inside = np.abs(error) < limit
    return [float(inside[rows].mean()) for rows in (order, *np.array_split(order, 3))]


def widths(found: list[tuple[Array, Array]]) -> list[Row]:
    """Errors beside magnets, and the sigma that was stated."""
    error, sigma = (np.concatenate(part) for part in zip(*found, strict=True))
    rows = []
    for i, answer in enumerate(ANSWERS[:3]):
        what = f'{answer}, magnet at 14 mm'
        told = error[np.isfinite(error[:, i]), i]
        rows.append(Row(f'{what}, rms', 'mN', MILLI * float(rms(told))))
        ratio = np.nanmedian(sigma[:, i]) / (np.nanmedian(np.abs(error[:, i])) / MEDIAN)
        rows.append(Row(f'{what}, median sigma over what medians of errors ask for', '1', ratio))
    return rows


def limit_of(world: ModuleType) -> float:
    """Range of a pixel (T)."""
    return float(np.max(world.config.saturation))


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
    disc = ours.estimation.features_.place_  # type: ignore[attr-defined]
    change = flat - flat[: world.rest].mean(axis=0)
    methods: dict[str, tuple[Callable[[Array], object], Array, float]] = {
        'chain of [3]': (printed.predict, flat, 20.0),
        'inversion': (disc.invert, change, 60.0),
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
    states, asked = judged(pipeline.fit(world.record(300, 1)), test, world.rest)
    error = MILLI * np.abs(states.force - test.truth['force'])[asked, 2]
    return pipeline, test, test.truth['force'][asked, 2], error


def speeds(world: ModuleType, others: list[ModuleType]) -> tuple[list[Row], str, str]:
    """Error of Fz against the time of a frame, and against load, of estimators of 300 points."""
    found, said, seeds = {}, {}, {}
    for name in ('inversion', 'polynomial', 'differences', 'channels', 'kernel_ridge', 'grid_knn'):
        pipeline, test, load, error = _fz(world, name)
        frame = Frame(None, 0, test.values[100])
        spent = least_us(lambda p=pipeline, f=frame: p.process(f))  # type: ignore[misc]
        found[name] = spent, float(rms(error[:, None])[0])
        said[name] = load, np.maximum(error, 1e-3)
        more = [float(rms(_fz(other, name)[3][:, None])[0]) for other in others]
        seeds[name] = (found[name][1], *more)
    told = 'Time of a frame through the whole pipeline against the error of Fz, 300 points each.'
    high = 2 * max(error for _, error in found.values())
    wide = 0.8 * min(us for us, _ in found.values()), 1.4 * max(us for us, _ in found.values())
    speed = Plot(wide, (0.05, high), 'time of a frame (us)', 'Fz rms (mN)', (480, 320),
                 log_x=True, told=told, log_y=True)  # fmt: skip
    for k, (name, (us, error)) in enumerate(found.items()):
        speed.mark(us, error, k % 4, f'fill c{k % 4}')
        speed.text(us, error, name, 'middle', shift=-14)
    told = 'Error of Fz against load: the chain of [3] and the inversion, 300 points each.'
    top = float(said['inversion'][0].max())
    load = Plot((0, top), (1e-3, high), 'Fz (N)', 'error of Fz (mN)', (480, 320), told=told,
                log_y=True)  # fmt: skip
    for k, name in enumerate(('polynomial', 'inversion')):
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
    ranges, noise = table_one(module)
    thermal, drift = warmth(module, extent)
    rows += [*ranges, *leaks(world, module, ours), *thermal]
    rows += [*surroundings(module, extent), *cost(ours, world)]
    notes = [
        f'peer: the better of converged Huber + L1 and SVD of the chain, {MANY[extent]} points',
        f'estimators: {ours.estimators}; specimens {SPECIMENS[extent]} of the world',
    ]
    methods, speed, load = speeds(world, [module.World(s) for s in SPECIMENS[extent][1:3]])
    rows += methods
    drawings = {'noise': noise, 'temperature': drift, 'speed': speed, 'error': load}
    return BenchResult('gradiometer', command, [11], rows, notes, drawings)


def _module() -> ModuleType:
    """The world, which needs magpylib and the sources."""
    return load_source(WORLD, 'bench gradiometer')
