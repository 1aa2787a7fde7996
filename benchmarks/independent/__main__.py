# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Figures of tasks: `python -m benchmarks.independent TASK ...`; without one, all their names."""

from __future__ import annotations

import sys
import time

from benchmarks.harness.independent import TASKS, figure


def main(names: list[str]) -> None:
    """Print the figures of tasks, or what there are."""
    known = {task.name: (sensor, task) for sensor, tasks in TASKS.items() for task in tasks}
    if unknown := [name for name in names if name not in known]:
        sys.exit(f'a task must be one of {", ".join(known)}; received {unknown[0]}')
    for name in names or known:
        sensor, task = known[name]
        if not names:
            print(f'{name:24s} {task.what} ({task.unit})')
            continue
        began = time.perf_counter()
        ours = figure(sensor, task)
        spent = time.perf_counter() - began
        print(f'{name} {ours:.4g} {task.unit}, limit {task.limit}, {spent:.0f} s', flush=True)


if __name__ == '__main__':
    main(sys.argv[1:])
