"""Compiled loops and arrays give the same numbers, and no frame waits for the compiler.

The scale of a quantity is the largest size that any of its components has in the recording; of a
covariance, which spans decades, the largest of its own row.
"""

from __future__ import annotations

import dataclasses
import subprocess
import sys
from typing import TYPE_CHECKING

import numpy as np
import pytest

from tactile_ros.enrolment import thinned
from tactile_ros.physics import compiled
from tactile_ros.sensors import load_sensor
from tactile_ros.types import STATE_FIELDS, ContactStates, Recording

if TYPE_CHECKING:
    from pathlib import Path

    from tactile_ros.pipeline import Pipeline

pytestmark = pytest.mark.skipif(not compiled.available(), reason='numba is not installed')
SAME = 1e-12
WILD = 1e-11  # of frames that are no touch's: their inversions are worse conditioned
NO_TOUCH = (17, 3)  # every which row, from which on
CASES = [
    ('gradiometer', 'history'),
    ('gradiometer', 'inversion_tilt'),
    ('gradiometer', 'polynomial'),
    ('magnet_pad', 'table_gauss_newton'),
    ('magnet_pad', 'nominal'),
    ('taxel_array', None),
    ('five_wire_skin', None),
]
PRESSES = {'gradiometer': 12, 'magnet_pad': 30, 'taxel_array': 12, 'five_wire_skin': 30}


def recording(key: str, seed: int) -> Recording:
    """Presses of the sensor's own programme, with its magnets and temperatures."""
    sensor = load_sensor(key)
    return thinned(sensor.presses(sensor.config(), seed, PRESSES[key]))


def eventful(key: str) -> Recording:
    """Fresh presses: in uniform fields, with lost readings, and such as are no touch's."""
    fresh, rng = recording(key, 2), np.random.default_rng(3)
    values, rows = fresh.values.copy(), np.arange(len(fresh))
    met = (rows % 5 == 1)[:, None, None]
    values += met * 0.3e-3 * rng.normal(size=(len(rows), 1, values.shape[2]))
    odd = rows % NO_TOUCH[0] == NO_TOUCH[1]
    values[odd] += 1e-3 * rng.normal(size=values[odd].shape)
    values[rows % 31 == 5, 0] = np.nan
    return dataclasses.replace(fresh, values=values)


def refuse_difference(one: ContactStates, other: ContactStates) -> None:
    """Whole numbers are equal, floats within `SAME` (or `WILD`) of the scale of their quantity."""
    wild = np.arange(len(one.valid)) % NO_TOUCH[0] == NO_TOUCH[1]
    same = np.where(wild, WILD, SAME)
    for name in STATE_FIELDS:
        a, b = np.asarray(getattr(one, name)), np.asarray(getattr(other, name))
        if a.dtype.kind != 'f':
            np.testing.assert_array_equal(a, b, err_msg=name)
            continue
        size = np.abs(np.nan_to_num(a)).reshape(len(a), -1).max(axis=1, initial=0.0)
        scale = size if name.endswith('_cov') else size.max() + 0 * size
        np.testing.assert_array_equal(np.isnan(a), np.isnan(b), err_msg=name)
        apart = np.nan_to_num(np.abs(a - b)).reshape(len(a), -1).max(axis=1, initial=0.0)
        assert (apart <= same * scale).all(), (name, (apart - same * scale).max())


def live(pipeline: Pipeline, recording: Recording) -> ContactStates:
    """States of the first hundred frames, one after the other."""
    pipeline.reset()
    states = [pipeline.process(recording.frame(row)) for row in range(100)]
    return ContactStates(
        **{name: np.stack([getattr(state, name) for state in states]) for name in STATE_FIELDS}
    )


@pytest.mark.parametrize(('key', 'estimator'), CASES)
def test_without_a_compiler_the_numbers_are_the_same(
    key: str, estimator: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    pipeline = load_sensor(key).pipeline(estimator=estimator).fit(recording(key, 1))
    fresh = eventful(key)
    assert fresh.tare is not None
    pipeline.tare([fresh.frame(row) for row in np.flatnonzero(fresh.tare)])
    batches, frames = [], []
    for available in (True, False):
        monkeypatch.setattr(compiled, 'AVAILABLE', available)
        batches.append(pipeline.process_batch(fresh))
        frames.append(live(pipeline, fresh))
    felt = np.isfinite(batches[0].force[batches[0].in_contact == 1])
    # the chain of [3] says nothing of force beside the strongest magnets
    assert felt[:, felt.any(axis=0)].all(axis=1).mean() > 0.85
    refuse_difference(*batches)
    refuse_difference(*frames)


FIRST_FRAMES = """
import sys
from dataclasses import replace
from tactile_ros.enrolment import thinned
from tactile_ros.sensors import load_sensor

def built():
    loops = set()
    for name, module in list(sys.modules.items()):
        if name.startswith('tactile_ros'):
            for key, loop in vars(module).items():
                loops |= {f'{name}.{key}{kind}' for kind in getattr(loop, 'signatures', ())}
    return loops

key, estimator, way, presses, path = sys.argv[1:]
sensor = load_sensor(key)
lesson, fresh = (thinned(sensor.presses(sensor.config(), i, int(presses))) for i in (1, 2))
if way == 'loaded':
    pipeline = sensor.load(path)
else:
    pipeline = sensor.pipeline(estimator=estimator or None)
    if way == 'fitted':
        pipeline.fit(lesson).save(path)
    else:
        pipeline.warm_up()
before = built()
print(len(before), 'built')
pipeline.tare([fresh.frame(0)])
for row in range(0, len(fresh), 5):
    frame = fresh.frame(row)
    pipeline.process(frame)
    pipeline.process(replace(frame, values=frame.values + 3e-4, stamp_ns=None))
print(*built() - before, sep='\\n')
"""


def run_first_frames(key: str, estimator: str, way: str, path: Path) -> None:
    """Use a sensor in a fresh process, and refuse loops that only a frame built."""
    told = (key, estimator, way, str(PRESSES[key]), str(path))
    command = [sys.executable, '-c', FIRST_FRAMES, *told]
    answer = subprocess.run(command, capture_output=True, text=True, check=False)
    assert answer.returncode == 0, answer.stderr
    count, late = answer.stdout.split(' built\n')
    assert int(count) > 0
    assert late.strip() == ''


@pytest.mark.parametrize(
    ('key', 'estimator'),
    [
        ('gradiometer', 'inversion_tilt'),
        ('magnet_pad', 'table_gauss_newton'),
        ('taxel_array', ''),
        ('five_wire_skin', ''),
    ],
)
def test_a_fit_and_a_load_build_all_that_frames_need(
    key: str, estimator: str, tmp_path: Path
) -> None:
    for way in ('fitted', 'loaded'):
        run_first_frames(key, estimator, way, tmp_path / 'c.npz')


def test_what_nobody_fitted_is_built_before_its_first_frame(tmp_path: Path) -> None:
    run_first_frames('magnet_pad', 'nominal', 'as sold', tmp_path)
