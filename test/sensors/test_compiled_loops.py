# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""No frame waits for the compiler: fits and loads build what frames need."""

import subprocess
import sys
from pathlib import Path

import pytest

from tactile_ros.physics import compiled

pytestmark = pytest.mark.skipif(not compiled.AVAILABLE, reason='numba is not installed')
PRESSES = {'gradiometer': 12, 'magnet_pad': 30, 'taxel_array': 12, 'five_wire_skin': 30}


FIRST_FRAMES = """
import sys
from dataclasses import replace
from tactile_ros.enrolment import thinned
from tactile_ros.sensors import load_sensor
from tactile_ros.sensors.magnet_pad import inversion

inversion.FOLDS = 2  # fits take half the time

def built():
    loops = set()
    for name, module in list(sys.modules.items()):
        if name.startswith('tactile_ros'):
            for key, loop in vars(module).items():
                loops |= {f'{name}.{key}{kind}' for kind in getattr(loop, 'signatures', ())}
    return loops

key, estimator, way, presses, path = sys.argv[1:]
sensor = load_sensor(key)
def pressed(count):
    return thinned(sensor.presses(sensor.config(), 1, count))
fresh = pressed(1)
if way == 'loaded':
    pipeline = sensor.load(path)
else:
    pipeline = sensor.pipeline(estimator=estimator or None)
    if way == 'fitted':
        pipeline.fit(pressed(int(presses))).save(path)
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
        ('gradiometer', 'inversion'),
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
