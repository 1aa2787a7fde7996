# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""The independent world: tasks, limits as its page says them, rows of the benches."""

from __future__ import annotations

import math
import sys
from importlib import import_module

import numpy as np
import pytest

from benchmarks.harness.independent import FOLDER, TASKS, Task, figure, independent_rows


def test_the_page_has_every_task_with_its_bound_and_limit() -> None:
    lines = (FOLDER / 'README.md').read_text().splitlines()
    told = [line.strip('| ').split(' | ') for line in lines if line.startswith('| `')]

    def said(value: float | None) -> str:
        return '-' if value is None else f'{value:g}'

    assert told == [
        [
            f'`{task.name}`', task.what + ' (slow)' * task.slow, task.unit, said(task.bound),
            said(task.limit),
        ]
        for tasks in TASKS.values() for task in tasks
    ]  # fmt: skip


@pytest.mark.parametrize('sensor', TASKS)
def test_every_task_is_a_function_of_its_sensor(sensor: str) -> None:
    judge = import_module(f'benchmarks.independent.{sensor}')
    assert all(callable(getattr(judge, task.name)) for task in TASKS[sensor])
    assert len({task.what for task in TASKS[sensor]}) == len(TASKS[sensor])


def test_quick_benches_leave_slow_tasks_out_and_unanswered_ones_are_missed(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    judge = import_module('benchmarks.independent.five_wire_skin')

    def unanswered() -> float:
        return float(judge.answered(np.full((100, 3), np.nan)).mean())

    def answered() -> float:
        sys.stdout.write('told')
        return 0.2

    monkeypatch.setattr(judge, 'sheet_position', unanswered)
    monkeypatch.setattr(judge, 'sheet_touch_min', unanswered)
    monkeypatch.setattr(judge, 'sheet_force', answered)
    tasks = (
        Task('sheet_position', 'place', 'mm', 0.05), Task('sheet_touch_min', 'found', '%', 99),
        Task('sheet_force', 'force', 'N', 0.31, 0.13),
        Task('sheet_squares', 'squares', 'N', 1, slow=True),
    )  # fmt: skip
    monkeypatch.setitem(TASKS, 'five_wire_skin', tasks)
    place, found, force = independent_rows('five_wire_skin', 'quick')
    assert (place.ours, found.ours, force.ours) == (math.inf, -math.inf, 0.2)
    assert (place.held, found.held, force.held) == (False, False, True)
    assert (force.what, force.bound, force.aim) == ('independent world: force', 0.13, 0.31)
    said = capsys.readouterr()
    assert not said.out
    assert 'only 0.0 %' in said.err
    assert 'told' in said.err


def test_a_figure_comes_through_the_public_face() -> None:
    (task,) = (task for task in TASKS['magnet_pad'] if task.name == 'pad_nominal')
    assert figure('magnet_pad', task) <= task.limit
