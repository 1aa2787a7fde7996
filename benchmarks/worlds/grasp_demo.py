# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""The scenes of `tactile demo grasp` in MuJoCo, one seed each, with plots and films."""

from __future__ import annotations

import importlib.util
import sys
import time
from typing import TYPE_CHECKING

from benchmarks.harness.rows import COLUMNS, BenchResult
from benchmarks.worlds import grasp_scenes
from reference.grasp_film import Film, prefer_no_screen, why_not
from tactile_ros.cli.console import show

if TYPE_CHECKING:
    from pathlib import Path

    from benchmarks.harness.rows import Row


def films() -> dict[str, Film]:
    """What is filmed, and from where."""
    return {
        'balloon': Film(4.0, (0.0, 0.06, 0.0), 0.32, azimuth=60.0, elevation=-40.0, speed_up=3.0),
        'allegro': Film(10.0, (0.07, 0.02, 0.05), 0.36, azimuth=310.0, elevation=-25.0),
        'loads': Film(12.0, (0.0, 0.0, 0.01), 0.22, azimuth=115.0, elevation=-15.0),
    }


def run_grasps(output: Path, seed: int, as_json: bool = False) -> int:
    """Run the scenes, print their figures, write plots and films into the folder `output`."""
    began = time.perf_counter()
    prefer_no_screen()
    sentence = why_not()
    made = {} if sentence else films()
    print('calibrating fingertips, then a minute or two of scenes', file=sys.stderr, flush=True)
    found = grasp_scenes.run('quick', seed, made)
    rows, told, drawn = _faults()
    rows, told, drawn = found.rows + rows, found.notes + told, {**found.drawings, **drawn}
    command = f'tactile demo grasp --seed {seed}'
    result = BenchResult('grasp', command, [seed], rows, told, drawn)
    cells, aside = [row.cells() for row in result.rows], sys.stderr if as_json else sys.stdout
    show(COLUMNS, cells, f'grasp: {command}', as_json)
    for note in result.notes:
        print(f'  {note}', file=aside)
    output.mkdir(parents=True, exist_ok=True)
    for path in result.draw(output):
        print(f'  drawn: {path}', file=aside)
    for name, film in made.items():
        print(f'  filmed: {film.save(output / f"grasp_{name}.gif")}', file=aside)
    if sentence:
        print(f'  no films: {sentence}', file=aside)
    print(f'  {time.perf_counter() - began:.0f} s', file=aside)
    return 0


def _faults() -> tuple[list[Row], list[str], dict[str, str]]:
    """Scene 4: faults of a grasp through the graph of nodes, where there is ROS."""
    if importlib.util.find_spec('rclpy') is None:
        return [], ['Faults during a grasp are left out: they need ROS 2.'], {}
    print('faults during a grasp through the nodes', file=sys.stderr, flush=True)
    from benchmarks.worlds.grip_faults import fault_rows

    rows, told, drawn = fault_rows('quick')
    return list(rows), list(told), dict(drawn)
