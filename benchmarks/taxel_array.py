"""Paper [4] and what replaces it, on taxels whose coverage is counted by points.

Gains differ by 55 %, the converter has 10 bits, five of 72 taxels are dead or stuck and nobody
says so. The paper's own way is a polynomial with a free constant, a threshold, and a circle
through what is pressed.
"""

from __future__ import annotations

from dataclasses import replace
from time import perf_counter
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.evaluation.benchmark import BenchResult, Row
from tactile_ros.sensors import load_sensor
from tactile_ros.sensors.taxel_array.config import grid_positions
from tactile_ros.types import Frame, Outline, Recording

if TYPE_CHECKING:
    from tactile_ros.pipeline import Pipeline
    from tactile_ros.types import Array, Integers

COUNTS = {'quick': 60, 'normal': 200, 'full': 1000}
RADII = ((16e-3, 8e-3), (14e-3, 6.5e-3), (12e-3, 5e-3), (18e-3, 9e-3), (10e-3, 4e-3))
BAD = (3, 17, 30, 44, 61)
PITCH, TAXELS = 5e-3, 72
SEED = 4
SPEC = load_sensor('taxel_array')


def run(extent: str, command: str) -> BenchResult:
    """Equilibrate, place washers, and time."""
    config = _config()
    pipeline = _fitted(config)
    label, place, force = _washers(COUNTS[extent])
    recording = Recording.from_arrays(SPEC.layout(config), _read(force, SEED + 1))
    began = perf_counter()
    states = pipeline.process_batch(recording)
    batch = 1e6 * (perf_counter() - began) / len(recording)
    right = states.label == label
    miss = 1e3 * np.linalg.norm(states.position[:, :2] - place, axis=1)[right]
    variance, at = states.object_pose_cov[right][:, [0, 1], [0, 1]], states.position[right, :2]
    inside = np.abs(at - place[right]) <= np.sqrt(variance)
    plain = _threshold_and_circle(force, label, place)
    spread, paper_spread = _spreads(pipeline, config)
    total = np.abs(states.force[:, 2] / force.sum(axis=1) - 1)
    single = _single(pipeline, recording)
    rows = [
        Row('washers of 5 types, 5 bad taxels: recognised', '%', 100 * float(right.mean()),
            'high', paper=95.0, peer=plain[0], aim=99.0, us_single=single, us_batch=batch),
        Row('washers: centre, median', 'mm', float(np.median(miss)), peer=plain[1], aim=0.06),
        Row('washers: inside one sigma', '%', 100 * float(inside.mean()), 'high'),
        Row('spread of taxels after equilibration', '%', spread, paper=55.0, peer=paper_spread,
            aim=2.0),
        Row('total force, mean error', '%', 100 * float(np.nanmean(total))),
        Row('one frame of 72 taxels', 'us', single, aim=300.0),
    ]  # fmt: skip
    notes = ['paper: before equilibration (spread), its own parts (washers)',
             'peer: polynomial with a free constant; threshold and circle fit']  # fmt: skip
    return BenchResult('taxel_array', command, [SEED], rows, notes)


def _config() -> object:
    """72 taxels of 5 mm and five washers."""
    angle = 2 * np.pi * np.arange(96) / 96
    rim = np.column_stack([np.cos(angle), np.sin(angle)])
    washers = tuple(
        Outline(f'washer_{i}', (outer * rim, (inner * rim)[::-1]))
        for i, (outer, inner) in enumerate(RADII)
    )
    return replace(  # type: ignore[type-var]
        SPEC.config(), positions=grid_positions(8, 9, PITCH),
        areas=np.full(TAXELS, PITCH**2), force_range=(0.0, 5.0), objects=washers,
    )  # fmt: skip


def _read(force: Array, seed: int) -> Array:
    """Outputs (s, t, 1) of 10 bits."""
    gain = 1 / (1 + 0.55 * np.random.default_rng(9).uniform(size=TAXELS))
    output = gain * force / (force + 1.5)
    output[:, BAD[:3]], output[:, BAD[3:]] = 0.0, 0.3
    noise = 5e-4 * np.random.default_rng(seed).normal(size=output.shape)
    return np.asarray(np.round(np.clip(output + noise, 0, 0.999) * 1023)[..., None] / 1023)


def _taught() -> Array:
    """Even loads (s, t) after rest (N)."""
    force = np.repeat(np.random.default_rng(1).uniform(0.05, 3, (150, 1)), TAXELS, axis=1)
    force[:15] = 0
    return force


def _fitted(config: object) -> Pipeline:
    """Pipeline equilibrated by even loads."""
    force = _taught()
    truth = {'taxel_force': force, 'in_contact': (force[:, 0] > 0).astype(np.int8)}
    layout = SPEC.layout(config)
    return SPEC.pipeline(config).fit(  # type: ignore[arg-type]
        Recording.from_arrays(layout, _read(force, 2), truth=truth)
    )


def _washers(count: int) -> tuple[Integers, Array, Array]:
    """Labels, centres (m) and forces (s, t) (N), by 1600 points a taxel."""
    rng = np.random.default_rng(SEED)
    label, place = rng.integers(len(RADII), size=count), rng.uniform(-3e-3, 3e-3, (count, 2))
    line = PITCH * ((np.arange(40) + 0.5) / 40 - 0.5)
    points = np.stack(np.meshgrid(line, line), -1).reshape(-1, 2)
    grid = grid_positions(8, 9, PITCH)[:, None, :2] + points
    forces = []
    for i, at in zip(label, place, strict=True):
        radius = np.linalg.norm(grid - at, axis=2)
        forces.append(1.5 * ((radius < RADII[i][0]) & (radius > RADII[i][1])).mean(axis=1))
    return label, place, np.array(forces)


def _threshold_and_circle(force: Array, label: Integers, place: Array) -> tuple[float, float]:
    """Per cent right and median miss (mm) of a circle through the pressed taxels."""
    output = _read(force, SEED + 1)[..., 0]
    centres = grid_positions(8, 9, PITCH)[:, :2]
    middle_radius = np.array([(a + b) / 2 for a, b in RADII])
    right, miss = 0, []
    for row, wanted, at in zip(output, label, place, strict=True):
        x, y = centres[row > 0.1].T
        terms = np.column_stack([2 * x, 2 * y, np.ones(len(x))])
        a, b, c = np.linalg.lstsq(terms, x**2 + y**2, rcond=None)[0]
        radius = np.sqrt(max(c + a**2 + b**2, 0.0))
        right += int(np.argmin(np.abs(middle_radius - radius)) == wanted)
        miss.append(1e3 * float(np.hypot(a - at[0], b - at[1])))
    return 100 * right / len(label), float(np.median(miss))


def _spreads(pipeline: Pipeline, config: object) -> tuple[float, float]:
    """Per cent healthy taxels differ by under even loads: ours, the paper's polynomial."""
    taught, healthy = _taught()[15:], np.setdiff1d(np.arange(TAXELS), BAD)
    force = np.repeat(np.linspace(0.3, 2.5, 30)[:, None], TAXELS, axis=1)
    values = _read(force, 3)
    found = pipeline.process_batch(Recording.from_arrays(SPEC.layout(config), values))
    ours = (found.taxel_force / force)[:, healthy]
    output = _read(_taught(), 2)[15:, :, 0]
    paper = [
        np.polyval(np.polyfit(output[:, i], taught[:, i], 2), values[:, i, 0]) / force[:, i]
        for i in healthy
    ]
    return 100 * float(ours.std(axis=1).mean()), 100 * float(np.std(paper, axis=0).mean())


def _single(pipeline: Pipeline, recording: Recording) -> float:
    """Median time of one live frame (us)."""
    spent = []
    for i in range(min(len(recording), 60)):
        frame = Frame(None, i, recording.values[i])
        began = perf_counter()
        pipeline.process(frame)
        spent.append(perf_counter() - began)
    return 1e6 * float(np.median(spent))
