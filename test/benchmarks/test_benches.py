# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Parts of benches by themselves: seeds, neighbours, speed, plots, the independent world."""

import json
import math
import os
import subprocess
import sys
import xml.etree.ElementTree as ET
from collections import Counter
from itertools import count
from pathlib import Path

import numpy as np
import pytest

from benchmarks.harness import plots
from benchmarks.harness.driver_speed import bus_rows, decoding_rows, memory_rows
from benchmarks.harness.independent import figure, independent_rows, tasks
from benchmarks.harness.live import resident_kib
from benchmarks.harness.rows import within
from benchmarks.independent import five_wire_skin as judge
from benchmarks.independent.recordings import Task
from benchmarks.magnet_pad import CellKnn

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.parametrize(
    ('seconds', 'taken'), [(0.0, 1), (9.9, 1), (10.1, 2), (29.9, 5), (30.1, 6), (np.inf, 8)]
)
def test_as_many_are_taken_as_end_in_time(seconds: float, taken: int) -> None:
    clock = count(0.0, 5.0)  # asked once at the start and before each but the first
    assert list(within(seconds, range(8), clock.__next__)) == list(range(taken))
    assert list(within(seconds, [])) == []


def slow_vote(samples: np.ndarray, cells: np.ndarray, x: np.ndarray, k: int) -> int:
    """Every distance, sorted; then votes, distances and numbers, one after the other."""
    far = np.linalg.norm(samples - x, axis=1)
    near = [(far[i], int(cells[i])) for i in np.argsort(far)[:k]]
    votes = Counter(cell for _, cell in near)
    reach = {cell: sum(d for d, c in near if c == cell) for cell in votes}
    return min(votes, key=lambda cell: (-votes[cell], reach[cell], cell))


@pytest.mark.parametrize('k', [1, 2, 5, 10])
def test_neighbours_are_the_slow_vote(k: int) -> None:
    rng = np.random.default_rng(k)
    samples, x = 40e-3 + 3e-6 * rng.normal(size=(300, 6)), 40e-3 + 3e-6 * rng.normal(size=(60, 6))
    cells = rng.integers(0, 5, 300)
    said = CellKnn(k).fit(samples, cells).predict(x)
    assert said.tolist() == [slow_vote(samples, cells, row, k) for row in x]


def test_neighbours_with_as_many_votes_are_told_apart_by_distance_then_number() -> None:
    knn = CellKnn(2).fit(np.array([[0.0], [2.0]]), np.array([9, 3]))
    assert knn.predict(np.array([[1.0], [0.9]])).tolist() == [3, 9]


def test_twenty_chips_use_the_bus() -> None:
    rows = bus_rows()
    assert len(rows) == 8
    assert all(row.held is not False for row in rows)
    assert all(row.ours <= 1.001 * row.bound for row in rows if row.bound is not None)


def test_codecs_are_timed_alone_and_among_many_and_their_memory_is_watched() -> None:
    rows = decoding_rows()
    assert len(rows) == 4
    assert all(0 < row.ours < 1e4 for row in rows)
    assert sum(row.us_batch is not None for row in rows) == 3
    assert all(row.unit == 'KiB' and row.ours < 4096 for row in memory_rows(10_000))
    assert 1e3 < resident_kib(os.getpid()) < 1e8


def paths(svg: str, kind: str) -> list[str]:
    """Path data of a class."""
    return [e.get('d', '') for e in ET.fromstring(svg).iter() if e.get('class') == kind]


def test_maps_of_a_pad_are_drawn() -> None:
    rng = np.random.default_rng(0)
    cells = 1e-3 * np.array([[x, y, 5.0] for y in (-5, 5) for x in (-8, 0, 8)])
    places = cells[rng.integers(0, 6, 300)] + 1e-3 * rng.normal(size=(300, 3))
    share = plots.cell_map(cells, np.array([100.0, 91.0, 80.0, 50.0, 97.5, np.nan]), 'shares')
    assert all(f'>{words}<' in share for words in ('100', '91', '-'))
    error = plots.error_map(places, np.linalg.norm(rng.normal(size=(300, 3)), axis=1), 'errors')
    lines = {'one': (np.arange(9.0), np.arange(9.0)), 'two': (np.arange(9.0), -np.arange(9.0))}
    curves = plots.curves(lines, ('x', 'y'), 'curves')
    assert len(paths(curves, 'line c0')) == len(paths(curves, 'line c1')) == 1
    for text in (share, error):
        assert ET.fromstring(text).tag.endswith('svg')
        assert len(text) < 100_000


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


LATENCY = """
from dataclasses import replace
from pathlib import Path
from benchmarks import latency
from benchmarks.worlds import grip_rig
learn, here = grip_rig._calibrated, Path()
grip_rig._calibrated = lambda *given: learn(*given, 'ridge')
scene = replace(grip_rig.skin_scene(here), fingers=grip_rig.FINGERS[:1])
run = latency.measure(here, scene, 1.0)
print(json.dumps([run.why, {row.what: row.ours for row in latency._rows('stack', run)}]))
"""


@pytest.mark.ros
def test_a_grip_of_the_latency_bench_runs_to_its_figures(tmp_path: Path) -> None:
    """Boards, stack and hand as the bench starts them: by forks of a process without threads."""
    pytest.importorskip('rclpy')
    paths = os.pathsep.join([str(ROOT), str(ROOT / 'test'), os.environ.get('PYTHONPATH', '')])
    made = subprocess.run(
        [sys.executable, '-c', f'import json{LATENCY}'], cwd=tmp_path, check=False, text=True,
        capture_output=True, timeout=200, env={**os.environ, 'PYTHONPATH': paths},
    )  # fmt: skip
    assert made.returncode == 0, made.stderr[-2000:]
    why, figures = json.loads(made.stdout.splitlines()[-1])
    assert 'ended:' not in why
    assert figures['stack: processor'] > 0
    if figures['stack: delay p50'] is None:  # a busy machine answers nothing in a second
        return
    assert 0 < figures['stack: delay p50'] <= figures['stack: delay p99']
    assert 0 < figures['stack: frames with a command of their own'] <= 100
