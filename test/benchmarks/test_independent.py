# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""The independent world: tasks, limits as its page says them, rows of the benches."""

import math
import sys

import numpy as np
import pytest

from benchmarks.harness.independent import figure, independent_rows, tasks
from benchmarks.independent import five_wire_skin as judge
from benchmarks.independent.recordings import Task


def test_quick_benches_leave_slow_tasks_out_and_unanswered_ones_are_missed(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def unanswered() -> float:
        return float(judge.answered(np.full((100, 3), np.nan)).mean())

    def answered() -> float:
        sys.stdout.write('told')
        return 0.2

    asked = (
        Task('sheet_position', 'place', 'mm', 0.05, None, unanswered),
        Task('sheet_touch_min', 'found', '%', 99, None, unanswered),
        Task('sheet_force', 'force', 'N', 0.31, 0.13, answered),
        Task('sheet_squares', 'squares', 'N', 1, None, answered, slow=True),
    )
    monkeypatch.setattr(judge, 'TASKS', asked)
    place, found, force = independent_rows('five_wire_skin', 'quick')
    assert (place.ours, found.ours, force.ours) == (math.inf, -math.inf, 0.2)
    assert (place.held, found.held, force.held) == (False, False, True)
    assert (force.what, force.bound, force.aim) == ('independent world: force', 0.13, 0.31)
    said = capsys.readouterr()
    assert not said.out
    assert 'only 0.0 %' in said.err
    assert 'told' in said.err


def test_a_figure_comes_through_the_public_face() -> None:
    (task,) = (task for task in tasks('magnet_pad') if task.name == 'pad_nominal')
    assert figure(task) <= task.limit
