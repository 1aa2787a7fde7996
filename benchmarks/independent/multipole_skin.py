# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Independent multipole sheet: heads pressed with 2..8 N, windows of ten frames at 20 Hz.

The config holds the values of a data sheet, from which the world's sheet and chips differ.
"""

from functools import cache

import numpy as np

from benchmarks.independent.recordings import Task, answered, pipeline_with, recording, turn, world
from tactile_ros.pipeline import Pipeline
from tactile_ros.types import Array, Bools, Integers, Outline, Recording

DATA = world('multipole_skin')
HEADS = [(kind, size) for kind in ('square', 'triangle', 'circle') for size in (10, 15, 20)]
BARS = [('bar', (30, 6)), ('bar', (36, 5)), ('bar', (24, 8))]
ROWS = 11  # of a window: one at rest, then ten frames
LAST = slice(ROWS - 1, None, ROWS)


def outline(kind: str, size: float | tuple[float, float]) -> Outline:
    """Head (mm) around its centroid; triangles point to +y, bars lie along x."""
    if kind == 'circle':
        angle = np.arange(128) * 2 * np.pi / 128
        loop = np.column_stack([np.cos(angle), np.sin(angle)]) * size / 2
    elif kind == 'triangle':
        low = size / np.sqrt(12)
        loop = np.array([(-size / 2, -low), (size / 2, -low), (0, 2 * low)])
    else:
        a, b = np.broadcast_to(size, 2) / 2
        loop = np.array([(-a, -b), (a, -b), (a, b), (-a, b)])
    return Outline(f'{kind} {size}', (loop * 1e-3,))


def nominal(*heads: tuple[str, float | tuple[float, float]]) -> Pipeline:
    """Pipeline by the data sheet with described heads, not fitted."""
    return pipeline_with(
        'multipole_skin', positions=DATA['hall_m'], sheet_size=(0.075, 0.075),
        sheet_thickness=0.002, layer_thickness=0.002, pole_pitch=0.01875, magnetisation='M4',
        remanence=0.045, youngs_modulus=70e3, poisson_ratio=0.49,
        objects=tuple(outline(*head) for head in heads),
    )  # fmt: skip


def presses(pipeline: Pipeline, windows: Array, **truth: Array) -> Recording:
    """Windows (n, 60, 10), each a sequence of its own after a row at rest, with truth (n, ...)."""
    count = len(windows)
    change = np.concatenate([np.zeros((count, 1, 60)), np.swapaxes(windows, 1, 2)], 1)
    first = np.arange(ROWS * count) % ROWS == 0
    truth = {**truth, 'in_contact': np.ones(count, int)}
    rows = {key: np.repeat(np.asarray(column), ROWS, axis=0) for key, column in truth.items()}
    for key, column in rows.items():
        column[first] = 0 if key == 'in_contact' else -1 if column.dtype.kind == 'i' else np.nan
    since = np.tile(np.arange(ROWS) * 50_000_000, count)
    stamp = (np.repeat(np.arange(count) * 10**10, ROWS) + since).astype(np.int64)
    return recording(
        pipeline.layout, change.reshape(-1, 20, 3) + DATA['rest'], stamp_ns=stamp,
        sequence=np.repeat(np.arange(count), ROWS), tare=first, truth=rows,
    )  # fmt: skip


def place(xy_mm: Array) -> Array:
    """Places (m) of unknown height."""
    return np.column_stack([xy_mm * 1e-3, np.full(len(xy_mm), np.nan)])


def taken(name: str, rows: Integers | slice = slice(None)) -> tuple[Array, ...]:
    """Windows, heads, locations, places (mm) and turns of one set."""
    return tuple(DATA[f'{name}_{k}'][rows] for k in ('X', 'head', 'loc', 'xy', 'yaw'))


def shots(count: int, query: str = 'new') -> float:
    """New heads that are named by `count` presses of each at one place, mean of two draws (%).

    Nine base heads at 13 places; the new ones at 12 others. The rest of their presses is asked,
    or presses in a uniform field of 0.05 mT after the tare.
    """
    rng, share = np.random.default_rng(count), []
    heads, places = DATA['new_head'], DATA['new_loc']
    for _ in range(2):
        groups = [
            np.flatnonzero((heads == head) & (places == at))
            for head in range(5) for at in range(12)
        ]  # fmt: skip
        shown = np.concatenate([rng.permutation(group)[:count] for group in groups])
        pipeline = nominal()
        windows, head, at, xy, _ = taken('shape')
        base = presses(pipeline, windows, label=head, cell=2 * at, position=place(xy))
        windows, head, at, xy, _ = taken('new', shown)
        few = presses(pipeline, windows, label=9 + head, cell=1 + 2 * at, position=place(xy))
        pipeline = pipeline.fit(base, few)
        rest = np.setdiff1d(np.arange(len(heads)), shown)
        windows, head, *_ = taken('new', rest) if query == 'new' else taken(query)
        found = np.asarray(pipeline.process_batch(presses(pipeline, windows)).label)[LAST]
        share.append(100 * np.mean(found == 9 + head))
    print('% per draw:', np.round(share, 1))
    return float(np.mean(share))


@cache
def bars() -> Array:
    """Errors of the turn (degrees) of a described bar never pressed, at new places."""
    pipeline = nominal(*BARS)
    windows, head, _, xy, turns = taken('bar')
    pipeline = pipeline.fit(presses(pipeline, windows, label=head, position=place(xy), yaw=turns))
    windows, *_, turns = taken('newbar')
    found = np.asarray(pipeline.process_batch(presses(pipeline, windows)).yaw)[LAST]
    return turn(answered(found), turns, np.pi)


@cache
def nine() -> tuple[Bools, Array]:
    """Right names and errors of places (m) of nine described heads after 20 presses of one."""
    pipeline = nominal(*HEADS)
    windows, head, _, xy, _ = taken('one')
    pipeline = pipeline.fit(presses(pipeline, windows, label=head + 1, position=place(xy)))
    windows, head, _, xy, _ = taken('all')
    found = pipeline.process_batch(presses(pipeline, windows))
    away = answered(np.asarray(found.position)[LAST, :2]) - xy * 1e-3
    return np.asarray(found.label)[LAST] == head, np.hypot(*away.T)


TASKS = (
    Task('skin_one_shot_min', 'new heads, one press each', '%', 88, None, lambda: shots(1),
         slow=True),
    Task('skin_five_shot_min', 'new heads, five presses each', '%', 92, None, lambda: shots(5),
         slow=True),
    Task('skin_stray_min', 'the same, 0.05 mT after the tare', '%', 89, None,
         lambda: shots(5, 'stray'), slow=True),
    Task('skin_pose_min', 'new bar: turn within 15 deg', '%', 97, 100,
         lambda: 100 * np.mean(bars() <= 15), slow=True),
    Task('skin_yaw', 'new bar: its turn, median', 'deg', 1.9, 0.35, lambda: np.median(bars()),
         slow=True),
    Task('skin_zero_shot_min', 'nine heads, 20 presses of one', '%', 88, 92.2,
         lambda: 100 * nine()[0].mean()),
    Task('skin_place', 'nine heads: place, median', 'mm', 0.40, 0.31,
         lambda: 1e3 * np.median(nine()[1])),
)  # fmt: skip
