# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Figures of `tactile bench five_wire_skin` in one world: places, forces, coverage, creep, time.

Worlds are those of the tests (`test/reference/five_wire_world.py`, `five_wire_sheet.py`); bounds
are what the noise of their readings makes by itself.
"""

from __future__ import annotations

import time
from importlib import import_module
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.interpolate import RBFInterpolator

from tactile_ros.sensors import load_sensor

if TYPE_CHECKING:
    from types import ModuleType

    from tactile_ros.pipeline import Pipeline
    from tactile_ros.types import Array, Recording

FRESH = 1500  # touches that judge
SENSOR = load_sensor('five_wire_skin')
LAYOUT = SENSOR.layout(SENSOR.config())


class Told(NamedTuple):
    """What a pipeline said of touches, less the truth, and the sigmas that it stated."""

    place: Array  # (s, 2) mm
    place_sigma: Array
    force: Array  # (s, 1) N
    force_sigma: Array


def world_figures(
    grids: ModuleType, world: object, seed: int, quick: bool
) -> tuple[dict[str, float], dict[str, list[float]]]:
    """All figures of one world, and its coverage."""
    rng = np.random.default_rng(seed + 100)
    places, load = rng.uniform(12.5e-3, 87.5e-3, (FRESH, 2)), rng.uniform(1, 15, FRESH)
    test = grids.touches(world, LAYOUT, places, load, seed + 200)
    train = {count: calibration(grids, world, count, seed + 300) for count in (4, 5, 7)}
    if not quick:
        train[60] = calibration(grids, world, 7, seed + 301, 60)
    began = time.perf_counter()
    fits = {count: SENSOR.pipeline().fit(one) for count, one in train.items()}
    seconds = (time.perf_counter() - began) / len(fits)
    told = {count: judged(fit, test) for count, fit in fits.items()}
    printed = SENSOR.pipeline(estimator='printed').fit(train[4])
    formula, squares = judged(printed, test), judged(printed, train[4])
    again = calibration(grids, world, 7, seed + 400)
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
        'force, 49 points, at its squares': _inside(*judged(fits[7], again)[2:]),
    }
    there = np.repeat(grids.grid(7), 8, axis=0), np.tile(np.linspace(1, 15, 8), 49)
    ours = calibration(grids, world, 4, seed + 500)
    return {
        'linear': length(formula.place), 'bound': 1e3 * world.bound(places),
        'plate': length(_plate(train[5], test)), 'printed': rms(formula.force),
        'at_squares': rms(squares.force), 'fit': seconds, 'least': _least(world, places, load),
        **{f'place{count * count}': length(told[count].place) for count in (4, 5, 7)},
        **{f'force{count * count}': rms(told[count].force) for count in (4, 5, 7)},
        'least_there': _least(world, *there), 'least_three': _least_of_three(world, *there),
        'square8': rms(judged(fits[7], again).force),
        'square60': np.nan if quick else rms(judged(fits[60], again).force),
        'worst16': float(np.abs(judged(fits[4], ours).force).max()),
        'curve16': _mean_curve(train[4], ours),
        **_curves(fits[4], grids, world), **_times(fits[7], test),
    }, coverage  # fmt: skip


def creep_figures(module: ModuleType, seed: int) -> dict[str, float]:
    """Force in presses on a film that creeps, and without the model of its past."""
    world, rng = module.SheetWorld(seed + 50), np.random.default_rng(seed)
    where = np.repeat(world_module('five_wire_world').grid(7), 3, axis=0)
    load = np.tile([3.0, 8.0, 14.0], 49) * rng.uniform(0.9, 1.05, 147)
    order = rng.permutation(147)
    train = module.pressed(world, LAYOUT, where[order], load[order], seed)
    places = rng.uniform(12.5e-3, 87.5e-3, (60, 2))
    test = module.pressed(world, LAYOUT, places, rng.uniform(2, 14, 60), seed + 1)
    pipeline = SENSOR.pipeline().fit(train)
    crept, lightest = rms(judged(pipeline, test).force), pipeline.report['contact']
    pipeline.estimation.crept_ = None
    without = rms(judged(pipeline, test).force)
    return {'crept': crept, 'uncrept': without, 'lightest': lightest['lightest_felt']}


def calibration(
    grids: ModuleType, world: object, count: int, seed: int, loads: int | None = None
) -> Recording:
    """Calibration: loads of 1..15 N at a grid of places."""
    loads = (15 if count == 4 else 8) if loads is None else loads
    where = np.repeat(grids.grid(count), loads, axis=0)
    load = np.tile(np.linspace(1, 15, loads), count**2)
    return grids.touches(world, LAYOUT, where, load, seed)


def judged(pipeline: Pipeline, test: Recording) -> Told:
    """Errors and stated sigmas of touches."""
    states = pipeline.process_batch(test)
    touched = (test.truth['in_contact'] == 1) & (states.in_contact == 1)
    place = 1e3 * (states.position - test.truth['position'])[touched, :2]
    force = (states.force - test.truth['force'])[touched, 2:]
    cov, cov_force = states.position_cov[touched], states.force_cov[touched, 2:, 2]
    sigma = 1e3 * np.sqrt(np.diagonal(cov, axis1=1, axis2=2))[:, :2]
    return Told(place, sigma, force, np.sqrt(cov_force))


def at_squares(pipeline: Pipeline, grids: ModuleType, world: object) -> tuple[Array, Array, Array]:
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


def _curves(pipeline: Pipeline, grids: ModuleType, world: object) -> dict[str, float]:
    """Non-linearity and relative standard deviation over 16 squares, before and after."""
    loads, before, said = at_squares(pipeline, grids, world)
    figures = (*_straight(said, loads), *_straight(before, loads))
    return dict(zip(('bent', 'uneven', 'raw_bent', 'raw_uneven'), figures, strict=True))


def _straight(curves: Array, loads: Array) -> tuple[float, float]:
    """Largest deviation of the mean curve from its line over its range; mean relative std (%)."""
    mean = curves.mean(axis=0)
    off = np.abs(mean - np.polyval(np.polyfit(loads, mean, 1), loads)).max()
    return 100 * off / np.ptp(mean), 100 * float((curves.std(axis=0) / mean).mean())


def _mean_curve(train: Recording, test: Recording) -> float:
    """Largest error (N) of a polynomial of the divider, which [5] compares with."""
    touched, asked = train.truth['in_contact'] == 1, test.truth['in_contact'] == 1
    level, force = train.values[touched, 0, 2], train.truth['force'][touched, 2]
    curve = np.polynomial.Polynomial.fit(level, force, 4)
    return float(np.abs(curve(test.values[asked, 0, 2]) - test.truth['force'][asked, 2]).max())


def _plate(train: Recording, test: Recording) -> Array:
    """Errors (mm) of a thin plate over the potentials."""
    touched, fresh = train.truth['in_contact'] == 1, test.truth['in_contact'] == 1
    plate = thin_plate(train.values[touched, 0, :2], train.truth['position'][touched, :2])
    said = plate(test.values[fresh, 0, :2])
    return 1e3 * (said - test.truth['position'][fresh, :2])


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


def _times(pipeline: Pipeline, test: Recording, count: int = 60) -> dict[str, float]:
    """Microseconds per frame: of the pipeline alone and in a batch, and of the estimators."""
    touched = np.flatnonzero(test.truth['in_contact'] == 1)[:count]
    frames = [test.frame(i) for i in touched]
    pipeline.reset()
    single = min(seconds_of(lambda: [pipeline.process(f) for f in frames]) for _ in range(30))
    batch = min(seconds_of(lambda: pipeline.process_batch(test)) for _ in range(5))
    estimation, kept = pipeline.estimation, []
    estimate = estimation.estimate
    estimation.estimate = lambda *given: (kept.append(given), estimate(*given))[1]
    for frame in frames:
        pipeline.process(frame)
    del estimation.estimate
    some = kept[:4]  # few at a time: what else the machine does would count
    alone = min(seconds_of(lambda: [estimate(*given) for given in some]) for _ in range(2000))
    scale = 1e6 / count
    return {
        'single': scale * single,
        'batch': 1e6 * batch / len(test),
        'estimators': 1e6 / len(some) * alone,
    }


def seconds_of(work: object) -> float:
    """Time of a call."""
    began = time.perf_counter()
    work()
    return time.perf_counter() - began


def world_module(name: str) -> ModuleType:
    """A world that the tests use too."""
    return import_module(f'reference.{name}')
