# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Figures of tasks: `python -m benchmarks.independent TASK ...`; without one, all their names."""

import sys
import time

from benchmarks.harness.independent import SENSORS, figure, tasks


def main(names: list[str]) -> None:
    """Print the figures of tasks, or what there are."""
    known = {task.name: task for sensor in SENSORS for task in tasks(sensor)}
    if unknown := [name for name in names if name not in known]:
        sys.exit(f'a task must be one of {", ".join(known)}; received {unknown[0]}')
    for name in names or known:
        task = known[name]
        if not names:
            print(f'{name:24s} {task.what} ({task.unit})')
            continue
        began = time.perf_counter()
        ours = figure(task)
        spent = time.perf_counter() - began
        print(f'{name} {ours:.4g} {task.unit}, limit {task.limit}, {spent:.0f} s', flush=True)


if __name__ == '__main__':
    main(sys.argv[1:])
