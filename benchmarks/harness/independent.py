# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Rows of a sensor's bench in the independent world: one a task, beside bound and limit."""

from __future__ import annotations

import sys
from contextlib import redirect_stdout
from dataclasses import dataclass
from importlib import import_module
from math import inf
from pathlib import Path

from benchmarks.harness.rows import Row

FOLDER = Path(__file__).parents[1] / 'independent'


@dataclass(frozen=True)
class Task:
    """Function `name` of `independent/<sensor>.py`; a name that ends in _min is better high."""

    name: str
    what: str
    unit: str
    limit: float | None
    bound: float | None = None
    slow: bool = False  # above a minute: no quick bench asks it

    @property
    def high(self) -> bool:
        """Tell whether more is better."""
        return self.name.endswith('_min')


TASKS = {
    'multipole_skin': (
        Task('skin_one_shot_min', 'new heads, one press each', '%', 88, slow=True),
        Task('skin_five_shot_min', 'new heads, five presses each', '%', 92, slow=True),
        Task('skin_stray_min', 'the same, 0.05 mT after the tare', '%', 89, slow=True),
        Task('skin_pose_min', 'new bar: turn within 15 deg', '%', 97, 100, slow=True),
        Task('skin_yaw', 'new bar: its turn, median', 'deg', 1.9, 0.35, slow=True),
        Task('skin_zero_shot_min', 'nine heads, 20 presses of one', '%', 88, 92.2),
        Task('skin_place', 'nine heads: place, median', 'mm', 0.40, 0.31),
    ),
    'gradiometer': (
        Task('grad_fx_fy', 'Fx, Fy over the printed chain', 'ratio', 0.28, 0.087),
        Task('grad_fz', 'Fz over the printed chain', 'ratio', 1.3, 0.41),
        Task('grad_stray', 'leak of 2 mT, force calibration alone', '%', 0.03, 0),
        Task('grad_stray_calibrated', 'leak of 2 mT, turned in a known field', '%', 0.01, 0),
        Task('grad_stray_field', 'uniform field of 2 mT', '%', 0.1, 0),
        Task('grad_thermal', 'Fz, 0..50 C over 35 C', 'ratio', 1.3, 1, slow=True),
        Task('grad_near14_min', 'inside two sigma, magnet at 14 mm', '%', 90, 95.4),
        Task('grad_noise', 'noise over its bound', 'ratio', 1.1, 1),
        Task('grad_clip', 'clipped frames that pass', '%', 0, 0),
        Task('grad_coverage', 'off 68.3 inside one sigma', 'points', 8, 0),
    ),
    'magnet_pad': (
        Task('pad_position', 'place, mean', 'mm', 0.28, 0.25),
        Task('pad_cells_min', 'cells of 25', '%', 94.5, 95.8),
        Task('pad_force', 'size of the force, rms', 'N', 0.34, 0.19),
        Task('pad_stray_min', 'cells, 0.5 mT, fixed rig', '%', 88.5, 90.0),
        Task('pad_stray_anywhere_min', 'cells, 0.5 mT, anywhere', '%', None, 79),
        Task('pad_new_session_min', 'cells in six new mountings', '%', 95.5, slow=True),
        Task('pad_nominal', 'place, nominal model', 'mm', 1.2, 0.56),
        Task('pad_coverage', 'off 68.3 inside one sigma', 'points', 5, 0),
    ),
    'five_wire_skin': (
        Task('sheet_position', 'place anywhere, 25 points, mean', 'mm', 0.050, 0.044),
        Task('sheet_force', 'force anywhere, 49 points, rms', 'N', 0.31, 0.13),
        Task('sheet_squares', 'force at 16 squares over its bound', 'ratio', 1.08, 1),
        Task('sheet_touch_min', 'light presses found, rest left free', '%', 99, 100),
        Task('sheet_coverage', 'off 68.3 inside one sigma, worst', 'points', 6, 0.9),
    ),
    'taxel_array': (
        Task('array_spread', 'spread under equal loads, p95', '%', 2.8, 2.5),
        Task('array_bad_min', 'bad taxels silent, good ones not', '%', 100, 100),
        Task('array_zero', 'force at rest, largest of a taxel', 'mN', 16),
        Task('array_hold', 'hold of 120 s: drift, or left after it', '%', 0.46),
        Task('array_washer_min', 'washers of 5 types', '%', 99),
        Task('array_washer_centre', 'washers: centre, median', 'mm', 0.061),
        Task('array_tube', 'turn of tubes on 16 taxels, p95', 'deg', 0.44),
        Task('array_jaw_position', 'part between jaws: place, p95', 'mm', 0.011, 0.003),
        Task('array_jaw_yaw', 'part between jaws: turn, p95', 'deg', 0.092, 0.02),
    ),
}  # fmt: skip


def figure(sensor: str, task: Task) -> float:
    """Figure of a task; the worst there is where too few frames were answered."""
    unanswered = import_module('benchmarks.independent.recordings').UnansweredError
    judge = getattr(import_module(f'benchmarks.independent.{sensor}'), task.name)
    with redirect_stdout(sys.stderr):
        try:
            return float(judge())
        except unanswered as error:
            print(f'{task.name}: {error}')
            return -inf if task.high else inf


def independent_rows(sensor: str, extent: str) -> list[Row]:
    """One row a task; none where the world is not at hand, as beside an installed package."""
    if not FOLDER.is_dir():
        return []
    return [
        Row(
            f'independent world: {task.what}', task.unit, figure(sensor, task),
            'high' if task.high else 'low', bound=task.bound, aim=task.limit,
        )
        for task in TASKS[sensor] if extent != 'quick' or not task.slow
    ]  # fmt: skip
