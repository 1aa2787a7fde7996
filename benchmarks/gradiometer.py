"""gradiometer in a world of exact fields: force, leak of stray fields, temperature and cost.

The world (`test/reference/test_gradiometer_world.py`) has fields of magpylib, gains, crossed axes,
offsets, a disc out of place and a stiffness that grows. The printed chain learns from far more
points than ours.
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
from tactile_ros.types import Frame

if TYPE_CHECKING:
    from types import ModuleType

    from tactile_ros.pipeline import Pipeline
    from tactile_ros.types import Recording

MANY = {'quick': 3000, 'normal': 13_000, 'full': 13_000}
WORLD = Path(__file__).resolve().parents[1] / 'test' / 'reference' / 'test_gradiometer_world.py'
SENSOR = load_sensor('gradiometer')
SEEDS = [1, 2, 3]


def run(extent: str, command: str) -> BenchResult:
    """Compare with the printed chain, then disturb, then time."""
    world = _world()
    few, many, test = world.record(300, 1), world.record(MANY[extent], 3), world.record(2000, 2)
    ours = SENSOR.pipeline(world.CONFIG).fit(few)
    chain = SENSOR.pipeline(world.CONFIG, 'polynomial').fit(many)
    error, sigma = world.errors(ours, test)
    found, printed = world.rms(error), world.rms(world.errors(chain, test)[0])
    share = (0.2, 0.2, 1.0)
    single, batch = _cost(ours, test)
    rows = [
        Row(
            f'F{axis}, 300 points, rms', 'mN', 1e3 * found[i], peer=1e3 * printed[i],
            aim=1e3 * share[i] * printed[i], us_single=single, us_batch=batch,
        )
        for i, axis in enumerate('xyz')
    ]  # fmt: skip
    clean = ours.process_batch(test)
    for i, axis in enumerate('xyz'):
        stray = tuple(2e-3 * np.eye(3)[i])
        moved = ours.process_batch(world.record(2000, 2, stray))
        asked = (clean.valid & moved.valid)[world.REST :]
        leak = world.rms((moved.force - clean.force)[world.REST :][asked]).max()
        percent = 100 * leak / world.CONFIG.full_scale
        rows.append(
            Row(f'leak of 2 mT along {axis}, no gains known', '%', percent, paper=0.3, aim=0.15)
        )
    warm = SENSOR.pipeline(world.CONFIG).fit(world.record(1000, 4, span=50.0))
    still = SENSOR.pipeline(world.CONFIG).fit(world.record(1000, 4))
    hot = world.rms(world.errors(warm, world.record(1000, 5, span=50.0))[0])
    cold = world.rms(world.errors(still, world.record(1000, 5))[0])
    rows.append(
        Row('0..50 C over isothermal, worst axis', '1', float((hot / cold).max()), aim=1.5)
    )
    for sigmas in (1, 2):
        inside = 100 * float((np.abs(error) < sigmas * sigma).mean())
        rows.append(Row(f'errors inside {sigmas} sigma', '%', inside, 'high'))
    notes = [f'peer: the chain of [3] by singular values on {MANY[extent]} points']
    return BenchResult('gradiometer', command, SEEDS, rows, notes)


def _cost(pipeline: Pipeline, test: Recording) -> tuple[float, float]:
    """Microseconds of one frame, alone and in a batch."""
    frames = [Frame(None, i, row) for i, row in enumerate(test.values[60:260])]
    pipeline.process(frames[0])
    began = time.perf_counter()
    for frame in frames:
        pipeline.process(frame)
    single = (time.perf_counter() - began) / len(frames)
    began = time.perf_counter()
    pipeline.process_batch(test)
    return 1e6 * single, 1e6 * (time.perf_counter() - began) / len(test.values)


def _world() -> ModuleType:
    """The world, which needs magpylib and the sources."""
    spec = importlib.util.spec_from_file_location('gradiometer_world', WORLD)
    try:
        assert spec is not None
        assert spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
    except (ImportError, FileNotFoundError) as error:
        msg = f'bench gradiometer needs magpylib and a source checkout ({error})'
        raise MissingPackageError(msg) from error
    return module
