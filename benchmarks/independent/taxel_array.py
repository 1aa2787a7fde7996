# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Independent taxels: 72 of which five are dead or stuck, 16 with creep, 16 under tubes, a jaw.

Nobody says which taxels are bad. Readings are counts of a converter of 10 bits.
"""

from functools import cache

import numpy as np

from benchmarks.independent.recordings import Task, answered, pipeline_with, recording, turn, world
from tactile_ros.pipeline import Pipeline
from tactile_ros.types import Array, Bools, ContactStates, Integers, Outline, Recording

DATA = world('taxel_array')
FULL = 1023
GOOD = ~np.isin(np.arange(72), DATA['bad'])


def nominal(taxels: int, *objects: Outline) -> Pipeline:
    """Pipeline of 16, 72 or 2000 taxels by the nominal config, not fitted."""
    places = np.pad(DATA[f'layout{taxels}_m'], ((0, 0), (0, 1)))
    outlines, areas = None, np.full(taxels, 1e-6)
    if taxels < 2000:
        loops = DATA[f'outlines{taxels}_m']
        outlines = tuple(Outline(f't{i}', (loop,)) for i, loop in enumerate(loops))
        areas = DATA[f'areas{taxels}_m2']
    more = {'objects': objects} if objects else {}
    return pipeline_with(
        'taxel_array', positions=places, areas=areas, taxel_outlines=outlines, saturation=1.0,
        **more,
    )  # fmt: skip


def frames(
    pipeline: Pipeline, counts: Array, load: Array | None = None,
    stamp_ns: Integers | None = None, truth: dict[str, Array] | None = None,
) -> Recording:  # fmt: skip
    """Counts (s, t) as parts of the range; a load (s,) lies equally on every taxel."""
    if load is not None:
        truth = {'taxel_force': np.repeat(load[:, None], counts.shape[1], 1)}
    return recording(pipeline.layout, counts[:, :, None] / FULL, stamp_ns=stamp_ns, truth=truth)


@cache
def equilibrated() -> Pipeline:
    """72 taxels fitted on equal loads."""
    pipeline = nominal(72)
    return pipeline.fit(frames(pipeline, DATA['cal'], DATA['cal_F']))


def answers(pipeline: Pipeline, counts: Array, stamp_ns: Integers | None = None) -> ContactStates:
    """Answers to counts."""
    return pipeline.process_batch(frames(pipeline, counts, stamp_ns=stamp_ns))


def spread() -> float:
    """P95 over loads of 1..5 N of (max - min) / min of good taxels (%)."""
    # a saturated reading may be refused
    rows = (DATA['test_F'] >= 1) & (DATA['test'][:, GOOD].max(1) < FULL)
    force = answered(answers(equilibrated(), DATA['test'][rows]).taxel_force[:, GOOD])
    apart = (force.max(1) - force.min(1)) / np.maximum(force.min(1), 1e-3)
    return float(100 * np.percentile(apart, 95))


def bad() -> float:
    """Worse of bad taxels that are given no force and good ones that are (%)."""
    given = np.isfinite(answers(equilibrated(), DATA['test']).taxel_force)
    given |= GOOD & (DATA['test'] >= FULL)  # a saturated reading may be refused
    share = given.mean(0)
    return float(100 * min(1 - share[~GOOD].mean(), share[GOOD].mean()))


def zero() -> float:
    """Largest force of a good taxel that nobody touches, 200 frames (mN)."""
    force = answers(equilibrated(), DATA['zero']).taxel_force[:, GOOD]
    return float(1e3 * np.abs(answered(force)).max())


def stamps(count: int, step_s: float) -> Integers:
    """Times of even steps (ns)."""
    return (np.arange(count) * step_s * 1e9).round().astype(np.int64)


def hold() -> float:
    """Worst of 16 taxels under 2 N for 120 s: drift, or what is left 1 s after it (%)."""
    pipeline, steps, held = nominal(16), DATA['steps'], DATA['hold']
    when = stamps(len(steps), float(DATA['steps_dt']))
    pipeline = pipeline.fit(frames(pipeline, steps, DATA['steps_F'], when))
    force = answered(answers(pipeline, held, stamps(len(held), 0.01)).taxel_force)
    spans = ((250, 300), (12100, 12200), (12300, 12330))
    first, last, after = (force[a:b].mean(0) for a, b in spans)
    drift, left = 100 * np.abs(last / first - 1).max(), 100 * np.abs(after).max() / 2
    off = 100 * abs(force[250:12200].mean() / 2 - 1)  # 5 % of it pass: the skin has hysteresis
    print(f'drift {drift:.2f} %, left {left:.2f} %, off {off:.2f} %')
    return float(max(drift, left, off - 5))


def circle(radius: float) -> Array:
    """Round loop."""
    angle = 2 * np.pi * np.arange(256) / 256
    return radius * np.column_stack([np.cos(angle), np.sin(angle)])


@cache
def washers() -> tuple[Bools, Array]:
    """Right types and errors of centres (m) of 400 presses, fitted on equal loads alone."""
    pipeline = nominal(72, *(
        Outline(f'washer{i}', (circle(outer), circle(inner)[::-1]))
        for i, (inner, outer) in enumerate(DATA['washer_m'])
    ))  # fmt: skip
    pipeline = pipeline.fit(frames(pipeline, DATA['cal'], DATA['cal_F']))
    found = answers(pipeline, DATA['washer_frames'])
    away = answered(found.object_pose)[:, :2, 3] - DATA['washer_xy_m']
    return np.asarray(found.label) == DATA['washer_type'], np.hypot(*away.T)


def placed() -> float:
    """Washers of five types with the type right and the centre within 0.5 mm (%)."""
    right, away = washers()
    return float(100 * (right & (away < 0.5e-3)).mean())


def tube() -> float:
    """P95 of the turn of tubes on 16 taxels, 150 labelled frames to learn from (degrees)."""
    pipeline, turns, count = nominal(16), DATA['tube_theta'], 150
    place = np.column_stack([DATA['tube_xy_m'][:count], np.full(count, np.nan)])
    truth = {'yaw': turns[:count], 'position': place}
    pipeline = pipeline.fit(
        frames(pipeline, DATA['tube_cal'], DATA['tube_cal_F']),
        frames(pipeline, DATA['tube_frames'][:count], truth=truth),
    )
    found = answered(answers(pipeline, DATA['tube_frames'][count:]).yaw)
    return float(np.percentile(turn(found, turns[count:]), 95))


@cache
def jaw() -> tuple[float, float]:
    """P95 of place (m) and turn (degrees) of 60 rectangles and 60 trapezoids, 2000 taxels."""
    pipeline = nominal(2000, *(Outline(k, (DATA[f'{k}_m'],)) for k in ('rectangle', 'trapezoid')))
    pipeline = pipeline.fit(frames(pipeline, DATA['jaw_cal'], DATA['jaw_cal_F']))
    found = answered(answers(pipeline, DATA['jaw_frames']).object_pose)
    turns, truth = np.arctan2(found[:, 1, 0], found[:, 0, 0]), DATA['jaw_pose']
    away = np.hypot(*(found[:, :2, 3] - truth[:, :2]).T)
    half = turn(turns[:60], truth[:60, 2], np.pi)  # a rectangle is its own half turn
    off = np.r_[half, turn(turns[60:], truth[60:, 2])]
    return np.percentile(away, 95), np.percentile(off, 95)


TASKS = (
    Task('array_spread', 'spread under equal loads, p95', '%', 2.8, 2.5, spread),
    Task('array_bad_min', 'bad taxels silent, good ones not', '%', 100, 100, bad),
    Task('array_zero', 'force at rest, largest of a taxel', 'mN', 16, None, zero),
    Task('array_hold', 'hold of 120 s: drift, or left after it', '%', 0.46, None, hold),
    Task('array_washer_min', 'washers of 5 types', '%', 99, None, placed),
    Task('array_washer_centre', 'washers: centre, median', 'mm', 0.061, None,
         lambda: 1e3 * np.median(washers()[1])),
    Task('array_tube', 'turn of tubes on 16 taxels, p95', 'deg', 0.44, None, tube),
    Task('array_jaw_position', 'part between jaws: place, p95', 'mm', 0.011, 0.003,
         lambda: 1e3 * jaw()[0]),
    Task('array_jaw_yaw', 'part between jaws: turn, p95', 'deg', 0.092, 0.02, lambda: jaw()[1]),
)  # fmt: skip
