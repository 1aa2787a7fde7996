"""five_wire_skin on a world of its own: place and force on fresh touches, and their cost.

The world (`test/reference/five_wire_world.py`) shares nothing with the package's model: an uneven
border, a film whose power law varies by bumps, a floating foil. The chain as printed is the linear
formula and the network of [5] on its 16 squares.
"""

from __future__ import annotations

import importlib.util
import time
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.errors import MissingPackageError
from tactile_ros.evaluation.benchmark import BenchResult, Row
from tactile_ros.sensors import load_sensor

if TYPE_CHECKING:
    from types import ModuleType

    from tactile_ros.pipeline import Pipeline
    from tactile_ros.types import Array, Recording

SEEDS = {'quick': 2, 'normal': 5, 'full': 10}
FRESH = 2000
WORLD = Path(__file__).resolve().parents[1] / 'test' / 'reference' / 'five_wire_world.py'
SENSOR = load_sensor('five_wire_skin')
LAYOUT = SENSOR.layout(SENSOR.config())


def run(extent: str, command: str) -> BenchResult:
    """Measure places and forces over several worlds."""
    seeds = list(range(SEEDS[extent]))
    found = [_one(seed) for seed in seeds]
    mean = {key: float(np.mean([one[key] for one in found])) for key in found[0]}
    worst = {key: float(np.max([one[key] for one in found])) for key in found[0]}
    rows = [
        Row('place, 25 points, mean', 'mm', mean['place25'], paper=5.0, peer=mean['linear'],
            bound=mean['bound'], aim=1.3 * mean['bound'],
            us_single=mean['single'], us_batch=mean['batch']),
        Row('place, 16 points, mean', 'mm', mean['place16'], peer=mean['linear'],
            bound=mean['bound']),
        Row('force at 49 calibration squares, rms', 'N', mean['square49'], bound=mean['least'],
            aim=1.05 * mean['least']),
        Row('force anywhere, 49 points, rms', 'N', mean['force49'], paper=1.0,
            peer=mean['printed'], bound=mean['least'], aim=0.28),
        Row('force anywhere, 49 points, rms of the worst world', 'N', worst['force49']),
        Row('force anywhere, 16 points, rms', 'N', mean['force16'], peer=mean['printed'],
            bound=mean['least']),
        Row('non-linearity, 16 squares (before: peer)', '%', mean['bent'], paper=4.5,
            peer=mean['raw_bent']),
        Row('relative std, 16 squares (before: peer)', '%', mean['uneven'], paper=8.6,
            peer=mean['raw_uneven']),
        Row('estimators, one frame', 'us', mean['estimators'], aim=30.0),
        Row('fit, 392 touches', 's', mean['fit'], aim=20.0),
    ]  # fmt: skip
    rows += [
        Row(f'{name}: off 68.3 inside one sigma', 'points', mean[f'in_{name}'], bound=0.0, aim=5.0)
        for name in ('place', 'force')
    ]
    return BenchResult('five_wire_skin', command, seeds, rows, _notes())


def _one(seed: int) -> dict[str, float]:
    """All figures of one world."""
    known = _world()
    world = known.FiveWireWorld(seed)
    rng = np.random.default_rng(seed + 100)
    places = rng.uniform(12.5e-3, 87.5e-3, (FRESH, 2))
    test = known.touches(world, LAYOUT, places, rng.uniform(1, 15, FRESH), seed + 200)
    train = {count: _grid(known, world, count, seed) for count in (4, 5, 7)}
    began = time.perf_counter()
    fits = {count: SENSOR.pipeline().fit(one) for count, one in train.items()}
    seconds = (time.perf_counter() - began) / len(fits)
    printed = SENSOR.pipeline(estimator='printed').fit(train[4])
    places_only = {count: _errors(fits[count], test) for count in fits}
    formula = _errors(printed, test)
    squares = _grid(known, world, 7, seed + 1)
    spread = places_only[5][1], places_only[7][3]
    return {
        'linear': _length(formula[0]), 'bound': 1e3 * world.bound(places),
        'place25': _length(places_only[5][0]), 'place16': _length(places_only[4][0]),
        'force49': _rms(places_only[7][2]), 'force16': _rms(places_only[4][2]),
        'square49': _rms(_errors(fits[7], squares)[2]), 'printed': _rms(formula[2]),
        'least': _least(world, places, rng), 'fit': seconds,
        'in_place': _off(places_only[5][0], spread[0]),
        'in_force': _off(places_only[7][2], spread[1]),
        **_curves(fits[4], known, world), **_times(fits[7], test),
    }  # fmt: skip


def _grid(known: ModuleType, world: object, count: int, seed: int) -> Recording:
    """Calibration: loads of 1..15 N at a grid of places."""
    loads = 15 if count == 4 else 8
    where = np.repeat(known.grid(count), loads, axis=0)
    load = np.tile(np.linspace(1, 15, loads), count**2)
    return known.touches(world, LAYOUT, where, load, seed + 300)


def _errors(pipeline: Pipeline, test: Recording) -> tuple[Array, Array, Array, Array]:
    """Errors and stated sigmas of place (s, 2) (mm) and of normal force (s, 1) (N)."""
    states, touched = pipeline.process_batch(test), test.truth['in_contact'] == 1
    place = 1e3 * (states.position - test.truth['position'])[touched, :2]
    force = (states.force - test.truth['force'])[touched, 2:]
    cov, cov_force = states.position_cov[touched], states.force_cov[touched, 2:, 2]
    sigma = 1e3 * np.sqrt(np.diagonal(cov, axis1=1, axis2=2))[:, :2]
    return place, sigma, force, np.sqrt(cov_force)


def _length(error: Array) -> float:
    return float(np.linalg.norm(error, axis=1).mean())


def _rms(error: Array) -> float:
    return float(np.sqrt((error**2).mean()))


def _off(error: Array, sigma: Array) -> float:
    """How far the share inside one sigma is off, in points."""
    return 100 * abs(float((np.abs(error) <= sigma).mean()) - 0.6827)


def _least(world: object, places: Array, rng: np.random.Generator) -> float:
    """Force error (N) that the divider's noise alone makes, with all else known."""
    force = rng.uniform(1, 15, len(places))
    step, noise, world.noise = 1e-4, world.noise, 0.0
    high, low = (world.readings(places, force + d, rng)[:, 2] for d in (step, -step))
    world.noise = noise
    return float(np.sqrt(np.mean((noise * 2 * step / (high - low)) ** 2)))


def _curves(pipeline: Pipeline, known: ModuleType, world: object) -> dict[str, float]:
    """Non-linearity and relative standard deviation over 16 squares, before and after."""
    rng, loads = np.random.default_rng(0), np.arange(1.0, 16.0)
    where, load = np.repeat(known.grid(4), 15, axis=0), np.tile(loads, 16)
    test = known.touches(world, LAYOUT, where, load, 7)
    touched = test.truth['in_contact'] == 1
    order = np.lexsort(
        [test.truth['force'][touched, 2], *test.truth['position'][touched, 1::-1].T]
    )
    said = pipeline.process_batch(test).force[touched, 2][order].reshape(16, 15)
    divider = world.readings(where, load, rng)[:, 2].reshape(16, 15)
    after, before = _straight(said, loads), _straight(1 / divider - 1, loads)
    return dict(zip(('bent', 'uneven', 'raw_bent', 'raw_uneven'), (*after, *before), strict=True))


def _straight(curves: Array, loads: Array) -> tuple[float, float]:
    """Largest deviation of the mean curve from its line over its range; mean relative std (%)."""
    mean = curves.mean(axis=0)
    off = np.abs(mean - np.polyval(np.polyfit(loads, mean, 1), loads)).max()
    return 100 * off / np.ptp(mean), 100 * float((curves.std(axis=0) / mean).mean())


def _times(pipeline: Pipeline, test: Recording, count: int = 300) -> dict[str, float]:
    """Microseconds per frame: of the pipeline alone and in a batch, and of the estimators."""
    frames = [test.frame(i) for i in range(5, 5 + count)]
    pipeline.reset()
    single = min(_seconds(lambda: [pipeline.process(f) for f in frames]) for _ in range(3))
    batch = min(_seconds(lambda: pipeline.process_batch(test)) for _ in range(3))
    estimation, kept = pipeline.estimation, []
    estimate = estimation.estimate
    estimation.estimate = lambda *given: (kept.append(given), estimate(*given))[1]
    for frame in frames:
        pipeline.process(frame)
    del estimation.estimate
    alone = min(_seconds(lambda: [estimate(*given) for given in kept]) for _ in range(3))
    scale = 1e6 / count
    return {
        'single': scale * single,
        'batch': 1e6 * batch / len(test),
        'estimators': scale * alone,
    }


def _seconds(work: object) -> float:
    began = time.perf_counter()
    work()
    return time.perf_counter() - began


def _world() -> ModuleType:
    """The world that the tests use too."""
    if not WORLD.is_file():
        msg = 'bench five_wire_skin needs test/reference of the sources: run it from a clone'
        raise MissingPackageError(msg)
    spec = importlib.util.spec_from_file_location('five_wire_world', WORLD)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def _notes() -> list[str]:
    """What the figures stand on."""
    return [
        'peer: the formula and the network of [5] as printed, learned on 16 squares at 15 loads',
        'bound: noise of the readings alone, everything else known',
        'fresh touches 12.5 mm and more inside the border, 1..15 N; untouched, the foil floats',
        'non-linearity: largest deviation of the mean curve from its least-squares line over its '
        'range; relative std: mean over loads of the std over squares over their mean',
    ]
