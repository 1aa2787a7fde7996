# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""gradiometer in a world of exact fields: force, noise, leaks, temperature, magnets and cost.

The world (`test/reference/gradiometer_world.py`) has fields of magpylib, gains, crossed axes,
offsets, a disc out of place and an elastomer that stiffens, expands and softens. The printed chain
learns from far more points than ours. The bound is that of Cramer and Rao with the same unknowns.
"""

from collections.abc import Callable

import numpy as np
from sklearn.linear_model import LinearRegression
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import PolynomialFeatures, StandardScaler

from benchmarks.harness.independent import independent_rows
from benchmarks.harness.rows import BenchResult, Row, frame_us, inside, shortest, within
from reference.gradiometer_world import Scene, World
from reference.inversion_frames import frames_of
from tactile_ros.estimators.polynomial_force import PolynomialForce
from tactile_ros.evaluation.figures import Plot, standalone
from tactile_ros.pipeline import Pipeline
from tactile_ros.sensors import load_sensor
from tactile_ros.types import Array, Bools, ContactStates, Recording

SENSOR = load_sensor('gradiometer')
SPECIMENS = {'quick': (11,), 'normal': tuple(range(11, 19)), 'full': tuple(range(11, 27))}
SECONDS = {'quick': np.inf, 'normal': 40.0, 'full': np.inf}  # of all specimens
MANY = {'quick': 600, 'normal': 13_000, 'full': 13_000}
AVERAGES = {'quick': (4,), 'normal': (1, 4, 16), 'full': (1, 4, 16)}
MILLI, STEP = 1e3, 1e-7
FULL = 3.5  # N [3]
PAPER_NOISE, SAMPLE_MS = 3e-6, 0.22  # T, of one sample at room temperature [3]
METHODS = ('polynomial', 'inversion', 'ridge')  # the first two are drawn, and quick
WARM = 1000  # presses of a calibration over temperatures
MAGNETS, BESIDE = 24, 40  # of each specimen, and presses beside each
UNIFORM = 2e-3  # T [3]
ANSWERS = ('Fx', 'Fy', 'Fz', 'Tx', 'Ty')
SHARES = {1: 68.27, 2: 95.45}  # % of normal errors inside so many sigmas
PRESSES = 300  # of a calibration whose coverage is judged
MEDIAN = 0.6745  # of the absolute value of normal errors, in sigmas
Errors = tuple[Array, Array]  # of the five answers (N, Nm), and their sigmas


def rms(error: Array) -> Array:
    """Root mean square of every component."""
    return np.asarray(np.sqrt((error**2).mean(axis=0)))


def fitted(world: World, *recordings: Recording, estimator: str | None = None) -> Pipeline:
    """Pipeline of a specimen that learned from recordings."""
    return SENSOR.pipeline(world.config, estimator).fit(*recordings)


def judged(pipeline: Pipeline, recording: Recording) -> tuple[ContactStates, Bools]:
    """States, and which of them are valid presses."""
    states = pipeline.process_batch(recording)
    return states, states.valid & ~recording.tare


def errors(pipeline: Pipeline, recording: Recording) -> Errors:
    """Errors (s, 5) of the answers and their sigmas, of valid presses; NaN: not estimated."""
    states, asked = judged(pipeline, recording)
    error, sigma = [], []
    for name, count in (('force', 3), ('torque', 2)):
        spread = np.sqrt(np.diagonal(getattr(states, f'{name}_cov'), axis1=1, axis2=2))
        error.append((getattr(states, name) - recording.truth[name])[asked, :count])
        sigma.append(spread[asked, :count])
    return np.hstack(error), np.hstack(sigma)


def bound(world: World, shift: Array) -> Array:
    """Least standard deviations (s, 3) (N) at places (s, 3): place and uniform field unknown."""
    heat = np.zeros(len(shift))

    def seen(place: Array) -> Array:
        field = np.einsum('tij,stj->sti', world.mix, world.field(place, world.tilts(place), heat))
        return np.asarray(field[..., [0, 2]].reshape(len(place), 8))

    def sloped(law: Callable[[Array], Array]) -> Array:
        steps = STEP * np.eye(3)
        return np.stack([(law(shift + d) - law(shift - d)) / 2 / STEP for d in steps], axis=2)

    slope, give = sloped(seen), sloped(lambda place: world.force(place, heat))
    uniform = np.linalg.qr(np.tile(np.eye(2), (4, 1)))[0]
    slope = slope - uniform @ (uniform.T @ slope)
    inverse = np.linalg.inv(np.einsum('sni,snj->sij', slope, slope))
    variance = np.einsum('sai,sij,saj->sa', give, inverse, give)
    return np.asarray(world.noise * np.sqrt(variance))


def accuracy(world: World, ours: Pipeline, extent: str) -> list[Row]:
    """Force with 300 points and with many, beside the printed chain on many; and its noise."""
    many, test = world.record(MANY[extent], 3), world.record(2000, 2)
    limit = float(np.max(world.config.saturation))
    table = []
    for recording in (many, test):
        sound = (np.abs(recording.values).max(axis=(1, 2)) < limit) & ~recording.tare
        table.append((recording.values[sound].reshape(-1, 8), recording.truth['force'][sound]))
    chain = rms(PolynomialForce().fit(*table[0]).predict(table[1][0]) - table[1][1])
    full = fitted(world, many)
    least = rms(bound(world, world.shifts(2000, np.random.default_rng([2, 5]))))
    rows = []
    for points, pipeline, share in ((300, ours, (0.2, 0.2, 1.0)), (MANY[extent], full, None)):
        found = rms(errors(pipeline, test)[0])
        for i, axis in enumerate('xyz'):
            aim = 1.2 * least[i] if share is None else share[i] * chain[i]
            rows.append(
                Row(f'F{axis}, {points} points, rms', 'mN', MILLI * found[i],
                    peer=MILLI * chain[i], bound=MILLI * least[i], aim=MILLI * aim)
            )  # fmt: skip
    for name, depth in (('a light touch', 0.03), ('mid load', 0.5)):
        place = np.array([[0.05 * world.gap, 0.03 * world.gap, -depth * world.depth]])
        found, least = held(world, full, place, 21).std(axis=0), bound(world, place)[0]
        worst = int(np.argmax(found / least))
        rows.append(
            Row(f'noise at {name}, worst axis F{"xyz"[worst]}', 'mN', MILLI * found[worst],
                bound=MILLI * least[worst], aim=1.1 * MILLI * least[worst])
        )  # fmt: skip
    return rows


def held(world: World, pipeline: Pipeline, place: Array, seed: int) -> Array:
    """Forces (s, 3) (N) that are estimated while the disc is held at a place (1, 3)."""
    shift = np.concatenate([np.zeros((world.rest, 3)), np.repeat(place, 2000, axis=0)])
    states, asked = judged(pipeline, world.recorded(shift, seed, Scene()))
    return states.force[asked]


def table_one(world: World, extent: str) -> list[Row]:
    """[3], table I: noise of Fz against averaging, and range."""
    rows = []
    for count in AVERAGES[extent]:
        quiet = World(11, noise=PAPER_NOISE / np.sqrt(count))
        place = np.array([[0.0, 0.0, -0.03 * quiet.depth]])
        force = held(quiet, fitted(quiet, quiet.record(1000, 3)), place, 22)[:, 2]
        rows.append(
            Row(f'Fz noise, {count} x {SAMPLE_MS} ms averaged', 'mN', MILLI * float(force.std()),
                paper=2.7 if count == 4 else None, bound=MILLI * bound(quiet, place)[0, 2])
        )  # fmt: skip
    deepest = world.force(np.array([[0.0, 0.0, -0.8 * world.gap]]), np.zeros(1))[0, 2]
    return [*rows, Row('Fz at 0.8 of the gap', 'N', float(deepest), 'high', paper=FULL)]


def leaks(world: World, ours: Pipeline) -> list[Row]:
    """A uniform field of 2 mT: without known gains, with, and where nothing is taken off."""
    few, clean, rows = world.record(300, 1), world.record(1000, 2), []
    gained = fitted(world, few, world.record(200, 9, Scene(turned=True)))
    for i, axis in enumerate('xyz'):
        moved = world.record(1000, 2, Scene(stray=tuple(UNIFORM * np.eye(3)[i])))
        for pipeline, known, aim in (
            (ours, 'no gains known', 0.15),
            (gained, 'gains known', 0.05),
        ):
            (a, first), (b, second) = (judged(pipeline, r) for r in (clean, moved))
            leak = 100 * float(rms((b.force - a.force)[first & second]).max()) / FULL
            rows.append(Row(f'leak of 2 mT along {axis}, {known}', '%', leak, paper=0.3, aim=aim))
    for name, taken, degree in (
        ('one pixel alone', slice(1), 3),
        ('squares of all channels, mean kept', slice(None), 2),
    ):

        def seen(recording: Recording, taken: slice = taken) -> Array:
            touched = recording.values[~recording.tare][:, taken]
            return touched.reshape(len(touched), -1)

        plain = make_pipeline(StandardScaler(), PolynomialFeatures(degree), LinearRegression())
        plain.fit(seen(few), few.truth['force'][~few.tare])
        still = plain.predict(seen(clean))
        apart = [
            plain.predict(seen(world.record(1000, 2, Scene(stray=tuple(way))))) - still
            for way in UNIFORM * np.concatenate([np.eye(3), -np.eye(3)])
        ]
        leak = 100 * np.abs(np.array(apart)) / FULL
        worst = float(np.sqrt((leak**2).mean(axis=1)).max())
        what = f'leak of 2 mT, {name}, worst axis'
        rows += [
            Row(what, '%', worst, paper=20.0),
            Row(f'{what} and press', '%', float(leak.max()), paper=20.0),
        ]
    return rows


def warmth() -> tuple[list[Row], str]:
    """10 to 60 C against one temperature, and figure 9 of [3]."""
    world = World(11)
    cases = {
        'disc as warm as the chip': Scene(span=50.0),
        'disc lags behind': Scene(span=50.0, ramp_s=600.0),
    }
    blind, rows, fits = fitted(world, world.record(WARM, 4)), [], []
    cold = rms(errors(blind, world.record(1000, 5))[0])
    for name, scene in cases.items():
        fits.append(fitted(world, world.record(WARM, 4, scene)))
        hot = rms(errors(fits[-1], world.record(1000, 5, scene))[0])
        ratio = float((hot / cold).max())
        rows.append(Row(f'10..60 C over isothermal, {name}', '1', ratio, aim=1.5))
    scene = cases['disc as warm as the chip']
    test = world.record(1000, 5, scene)
    chain = fitted(world, world.record(3 * WARM, 4, scene), estimator='polynomial')
    found = {'not compensated': blind, 'alpha and beta of [3], fitted': chain, 'ours': fits[0]}
    said = {}
    for name, pipeline in found.items():
        error = MILLI * errors(pipeline, test)[0][:, 2]
        rows.append(Row(f'Fz over 10..60 C, {name}', 'mN', float(rms(error))))
        said[name] = test.temperature_c[judged(pipeline, test)[1], 0], error
    high = max(float(np.quantile(np.abs(error), 0.99)) for _, error in said.values())
    title = 'Error of Fz over temperature'
    return rows, dots(said, (10.0, 60.0), (-high, high), 'temperature of the chip (°C)', title)


def dots(
    said: dict[str, Errors], wide: tuple[float, float], high: tuple[float, float], label: str,
    title: str, log: bool = False,
) -> str:  # fmt: skip
    """Errors of Fz (mN) over something, of methods by name."""
    plot = Plot(wide, high, label, 'error of Fz (mN)', (480, 320), description=title, log_y=log)
    for k, (x, error) in enumerate(said.values()):
        keep = (error >= high[0]) & (error < high[1])
        plot.dots(x[keep][:500], error[keep][:500], f'c{k}')
    words = (f'{name}: {rms(error):.3g} mN rms' for name, (_, error) in said.items())
    return standalone(plot, title=title, key=[(f'c{k}', one) for k, one in enumerate(words)])


def surroundings(extent: str) -> tuple[list[Row], list[int]]:
    """Magnets at 14 mm, clipped frames and coverage, over specimens; and their seeds."""
    clean, magnets, seeds = [], [], []
    clipped = np.zeros((2, 2), int)  # and flagged; clean ones, and valid
    for seed in within(SECONDS[extent], SPECIMENS[extent]):
        # presses, noise and magnets of its own: shares of the same draws are off together
        world, draw = World(seed), 1000 * seed
        seeds.append(seed)
        pipeline = fitted(world, world.record(PRESSES, draw + 1))
        clean.append(errors(pipeline, world.record(2000, draw + 2)))
        for k in range(MAGNETS):
            near = world.record(BESIDE, draw + 100 + k, Scene(magnet=14e-3))
            magnets.append(errors(pipeline, near))
        limit = float(np.max(world.config.saturation))
        strong = world.record(1000, draw + 7, Scene(stray=(0.0, 0.0, 0.3 * limit)))
        hit = (np.abs(strong.values) >= limit - 1e-9).any(axis=(1, 2))
        valid, sound = pipeline.process_batch(strong).valid, ~strong.tare & ~hit
        clipped += [[hit.sum(), (hit & ~valid).sum()], [sound.sum(), (sound & valid).sum()]]
    (clips, flagged), (sound, used) = clipped
    rows = [
        *coverage('', clean),
        *coverage(', magnet at 14 mm', magnets, certain=True),
        *widths(magnets),
        Row(f'clipped frames flagged, of {clips}', '%', 100 * flagged / max(clips, 1), 'high',
            aim=100.0),
        Row(f'clean frames valid, of {sound}', '%', 100 * used / sound, 'high', aim=99.9),
    ]  # fmt: skip
    return rows, seeds


def coverage(scene: str, found: list[Errors], *, certain: bool = False) -> list[Row]:
    """Shares of errors (s, 5) inside one and two sigma: of all rows, and of thirds of the sigma.

    The aim is a distance of five points from a normal distribution's share, or the 95 % interval
    of as many presses as calibrated a third where that is wider; beside magnets, whose fields are
    not those of any model, that two sigmas hold 95 % of all rows.
    """
    rows = []
    for i, answer in enumerate(ANSWERS):
        for sigmas, share in SHARES.items():
            table = [inside(error[:, i], sigma[:, i], sigmas) for error, sigma in found]
            mean = np.mean(table, axis=0)
            what = f'{answer} inside {sigmas} sigma{scene}'
            aim = 95.0 if certain and sigmas == 2 else None
            rows.append(Row(what, '%', mean[0], 'high', bound=share, aim=aim))
            rows += [
                Row(f'{what}, third {k} of sigma', '%', mean[k], 'high', bound=share)
                for k in (1, 2, 3)
            ]
            if not certain:
                off = float(np.abs(mean - share).max())
                chance = 2 * np.sqrt(share * (100 - share) / (PRESSES / 3 * len(found)))
                what = f'{what}: farthest off of the four'
                rows.append(Row(what, 'points', off, aim=float(max(5.0, chance))))
    return rows


def widths(found: list[Errors]) -> list[Row]:
    """Errors beside magnets, and the sigma that was stated."""
    error, sigma = (np.concatenate(part) for part in zip(*found, strict=True))
    rows = []
    for i, answer in enumerate(ANSWERS[:3]):
        what = f'{answer}, magnet at 14 mm'
        finite = error[np.isfinite(error[:, i]), i]
        rows.append(Row(f'{what}, rms', 'mN', MILLI * float(rms(finite))))
        ratio = np.nanmedian(sigma[:, i]) / (np.nanmedian(np.abs(error[:, i])) / MEDIAN)
        rows.append(Row(f'{what}, median sigma over what medians of errors ask for', '1', ratio))
    return rows


def cost(ours: Pipeline, world: World) -> list[Row]:
    """Microseconds of a frame: the chain, the inversion and the whole pipeline."""
    test = world.record(2000, 2)
    flat = test.values.reshape(-1, 8)
    printed = PolynomialForce().fit(flat, test.truth['force'])
    disc, change = ours.estimation, flat - flat[: world.rest].mean(axis=0)
    rows = []
    for name, call, x, aim in (
        ('chain of [3]', printed.predict, flat, 20.0),
        ('inversion', lambda x: disc.invert(frames_of(disc.model, MILLI * x)), change, 60.0),
    ):
        single = 1e6 * shortest(lambda call=call, x=x: call(x[100:101]), 200)
        batch = 1e6 * shortest(lambda call=call, x=x: call(x), 20) / len(x)
        rows.append(
            Row(f'{name}, one frame', 'us', single, aim=aim, us_single=single, us_batch=batch)
        )
        if name == 'chain of [3]':
            rows.append(Row(f'{name}, a frame of a batch', 'us', batch, aim=1.0))
    chain = fitted(world, world.record(1000, 1), estimator='polynomial')
    for name, pipeline in {'chain': chain, 'ours': ours}.items():
        single, batch = frame_us(pipeline, test, range(100, 120))
        rows.append(Row(f'whole pipeline, {name}', 'us', single, us_single=single, us_batch=batch))
    return rows


def methods(worlds: list[World], names: tuple[str, ...]) -> tuple[list[Row], str]:
    """Error of Fz of estimators of 300 points in worlds, and against load in the first."""
    rows, said = [], {}
    for name in names:
        found = []
        for world in worlds:
            pipeline, test = (
                fitted(world, world.record(300, 1), estimator=name),
                world.record(1000, 2),
            )
            states, asked = judged(pipeline, test)
            error = MILLI * np.abs(states.force - test.truth['force'])[asked, 2]
            found.append(float(rms(error)))
            if world is worlds[0]:
                us = frame_us(pipeline, test, range(100, 120))[0]
                said[name] = test.truth['force'][asked, 2], np.maximum(error, 1e-3)
        rows.append(
            Row.mean(f'Fz by {name}, 300 points, rms', 'mN', found, us_single=us,
                     compared='Fz of the gradiometer, 300 points', method=name)
        )  # fmt: skip
    title = 'Error of Fz against load, learned from 300 presses'
    drawn = {name: said[name] for name in METHODS[:2]}
    high = 2 * max(row.by_seed[0] for row in rows)
    top = float(said['inversion'][0].max())
    return rows, dots(drawn, (0.0, top), (1e-3, high), 'Fz (N)', title, log=True)


def run(extent: str, command: str) -> BenchResult:
    """Compare with the printed chain, then disturb, then time."""
    world, quick = World(11), extent == 'quick'
    ours = fitted(world, world.record(300, 1))
    rows = accuracy(world, ours, extent) + table_one(world, extent) + leaks(world, ours)
    around, specimens = surroundings(extent)
    rows += [*around, *cost(ours, world)]
    notes = [
        f'peer: the chain of [3] by least squares, {MANY[extent]} points',
        f'estimators: {ours.estimators}; specimens {specimens} of the world, '
        f'{len(specimens)} of {len(SPECIMENS[extent])}',
    ]
    others = [World(seed) for seed in SPECIMENS[extent][1:2]]
    compared, error = methods([world, *others], METHODS[: 2 if quick else None])
    rows += compared
    drawings = {'error': error}
    if quick:
        notes.append('quick: at one temperature, one count of averages, two estimators')
    else:
        thermal, drawings['temperature'] = warmth()
        rows += thermal
    rows += independent_rows('gradiometer', extent)
    return BenchResult('gradiometer', command, [11], rows, notes, drawings)
