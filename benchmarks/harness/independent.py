# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Rows of a sensor's bench in the independent world: one a task, beside bound and limit."""

import sys
from contextlib import redirect_stdout
from importlib import import_module
from math import inf
from pathlib import Path

from benchmarks.harness.rows import Row

FOLDER = Path(__file__).parents[1] / 'independent'
SENSORS = ('multipole_skin', 'gradiometer', 'magnet_pad', 'five_wire_skin', 'taxel_array')


def tasks(sensor: str) -> tuple[object, ...]:
    """Tasks of a sensor's world."""
    return import_module(f'benchmarks.independent.{sensor}').TASKS


def figure(task: object) -> float:
    """Figure of a task; the worst there is where too few frames were answered."""
    unanswered = import_module('benchmarks.independent.recordings').UnansweredError
    with redirect_stdout(sys.stderr):
        try:
            return float(task.judge())
        except unanswered as error:
            print(f'{task.name}: {error}')
            return -inf if task.high else inf


def independent_rows(sensor: str, extent: str) -> list[Row]:
    """One row a task; none where the world is not at hand, as beside an installed package."""
    if not FOLDER.is_dir():
        return []
    return [
        Row(
            f'independent world: {task.what}', task.unit, figure(task),
            'high' if task.high else 'low', bound=task.bound, aim=task.limit,
        )
        for task in tasks(sensor) if extent != 'quick' or not task.slow
    ]  # fmt: skip
