# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Rows of `tactile bench gradiometer` with what surrounds it: fields, warmth, magnets, clipping.

What a sigma promises is judged here too, with nothing around and beside magnets.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from sklearn.linear_model import LinearRegression
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import PolynomialFeatures, StandardScaler

from benchmarks.harness.rows import Row, within
from benchmarks.worlds import gradiometer_trials
from tactile_ros.evaluation.figures import Plot, standalone

if TYPE_CHECKING:
    from types import ModuleType

    from tactile_ros.pipeline import Pipeline
    from tactile_ros.types import Array, Recording

SENSOR, SPECIMENS = gradiometer_trials.SENSOR, gradiometer_trials.SPECIMENS
MILLI, FULL = gradiometer_trials.MILLI, gradiometer_trials.FULL
SECONDS = {'quick': np.inf, 'normal': 40.0, 'full': np.inf}  # of all specimens
WARM = 1000  # presses of a calibration over temperatures
MAGNETS, BESIDE = 24, 40  # of each specimen, and presses beside each
UNIFORM = 2e-3  # T [3]
ANSWERS = ('Fx', 'Fy', 'Fz', 'Tx', 'Ty')
SHARES = {1: 68.27, 2: 95.45}  # % of normal errors inside so many sigmas
PRESSES = 300  # of a calibration whose coverage is judged
MEDIAN = 0.6745  # of the absolute value of normal errors, in sigmas


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
            (a, first), (b, second) = (
                gradiometer_trials.judged(pipeline, r, world.rest) for r in (clean, moved)
            )
            asked = first & second
            found[k, i] = gradiometer_trials.rms((b.force - a.force)[asked]).max()
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
    pixels: dict[str, tuple[slice, int]] = {
        'one pixel alone': (slice(1), 3),
        'squares of all channels, mean kept': (slice(None), 2),
    }
    rows = []
    for name, (taken, degree) in pixels.items():
        x, still = (r.values[touched, taken].reshape(-1, 2 * len(r.values[0, taken]))
                    for r in (few, clean))  # fmt: skip
        terms = PolynomialFeatures(degree)
        plain = make_pipeline(StandardScaler(), terms, LinearRegression())
        plain.fit(x, few.truth['force'][touched])
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


def warmth(module: ModuleType) -> tuple[list[Row], str]:
    """0 to 50 C against one temperature, and figure 9 of [3]."""
    world = module.World(11)
    scenes = {
        'disc as warm as the chip': module.Scene(span=50.0),
        'disc lags behind': module.Scene(span=50.0, ramp_s=600.0),
    }
    blind = SENSOR.pipeline(world.config).fit(world.record(WARM, 4))
    cold = gradiometer_trials.rms(
        gradiometer_trials.errors(blind, world.record(1000, 5), world.rest)[0]
    )
    fits = {
        name: SENSOR.pipeline(world.config).fit(world.record(WARM, 4, scene))
        for name, scene in scenes.items()
    }
    rows = []
    for name, scene in scenes.items():
        hot = gradiometer_trials.rms(
            gradiometer_trials.errors(fits[name], world.record(1000, 5, scene), world.rest)[0]
        )
        ratio = float((hot / cold).max())
        rows.append(Row(f'0..50 C over isothermal, {name}', '1', ratio, aim=1.5))
    good, scene = next(iter(fits.values())), next(iter(scenes.values()))
    many, test = world.record(3 * WARM, 4, scene), world.record(1000, 5, scene)
    chain = SENSOR.pipeline(world.config, 'polynomial').fit(many)
    found = {'not compensated': blind, 'alpha and beta of [3], fitted': chain, 'ours': good}
    said = {}
    for name, pipeline in found.items():
        error = gradiometer_trials.errors(pipeline, test, world.rest)[0]
        rows.append(
            Row(f'Fz over 0..50 C, {name}', 'mN', MILLI * float(gradiometer_trials.rms(error)[2]))
        )
        asked = gradiometer_trials.judged(pipeline, test, world.rest)[1]
        assert test.temperature_c is not None
        said[name] = test.temperature_c[asked, 0], MILLI * error[:, 2]
    return rows, drifts(said)


def drifts(said: dict[str, tuple[Array, Array]]) -> str:
    """Figure 9 of [3]: error of Fz (mN) against the chip's temperature."""
    high = max(float(np.quantile(np.abs(error), 0.99)) for _, error in said.values())
    told = 'Error of Fz over temperature, not compensated, by the chain of [3], and ours.'
    plot = Plot(
        (10, 60), (-high, high), 'chip (C)', 'error of Fz (mN)', (480, 320), description=told
    )
    for k, (name, (warm, error)) in enumerate(said.items()):
        keep = np.abs(error) < high
        plot.dots(warm[keep][:400], error[keep][:400], f'c{k}')
        plot.text(
            11,
            None,
            f'{name}: {gradiometer_trials.rms(error[:, None])[0]:.3g} mN rms',
            row=k,
            kind=f'c{k}',
        )
    return standalone(plot)


def surroundings(module: ModuleType, extent: str) -> tuple[list[Row], list[int]]:
    """Magnets at 14 mm, clipped frames and coverage, over specimens; and their seeds."""
    clean, magnets, clipped, usable, seeds = [], [], [], [], []
    for seed in within(SECONDS[extent], SPECIMENS[extent]):
        # presses, noise and magnets of its own: shares of the same draws are off together
        world, draw = module.World(seed), 1000 * seed
        seeds.append(seed)
        pipeline = SENSOR.pipeline(world.config).fit(world.record(PRESSES, draw + 1))
        clean.append(gradiometer_trials.errors(pipeline, world.record(2000, draw + 2), world.rest))
        for k in range(MAGNETS):
            near = world.record(BESIDE, draw + 100 + k, module.Scene(magnet=14e-3))
            magnets.append(gradiometer_trials.errors(pipeline, near, world.rest))
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
    rows = [
        *coverage('', clean),
        *coverage(', magnet at 14 mm', magnets, certain=True),
        *widths(magnets),
        Row(f'clipped frames flagged, of {told[0]}', '%', flagged, 'high', aim=100.0),
        Row(f'clean frames valid, of {valid[0]}', '%', used, 'high', aim=99.9),
    ]
    return rows, seeds


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
        rows.append(Row(f'{what}, rms', 'mN', MILLI * float(gradiometer_trials.rms(told))))
        ratio = np.nanmedian(sigma[:, i]) / (np.nanmedian(np.abs(error[:, i])) / MEDIAN)
        rows.append(Row(f'{what}, median sigma over what medians of errors ask for', '1', ratio))
    return rows


def limit_of(world: ModuleType) -> float:
    """Range of a pixel (T)."""
    return float(np.max(world.config.saturation))
