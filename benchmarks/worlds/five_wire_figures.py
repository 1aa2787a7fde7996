# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Drawings of `tactile bench five_wire_skin`: maps of place error, curves of force, cost."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from benchmarks.harness import plots
from benchmarks.harness.rows import Row
from benchmarks.worlds import five_wire_trials
from benchmarks.worlds.sheet_solver import sheet_potential
from tactile_ros.estimators.potential_map import PotentialMap
from tactile_ros.evaluation.figures import Plot, standalone
from tactile_ros.physics.resistive_sheet import linear_place

if TYPE_CHECKING:
    from types import ModuleType

    from tactile_ros.pipeline import Pipeline
    from tactile_ros.types import Array, Recording

SENSOR, LAYOUT = five_wire_trials.SENSOR, five_wire_trials.LAYOUT
SIZE = np.array([0.1, 0.1])
STEPS = np.array([0.02, 0.05, 0.1, 0.2, 0.4])  # mm, of the shades of a map


def drawn(grids: ModuleType, world: object, seed: int) -> tuple[dict[str, str], list[Row]]:
    """Maps of place error, curves of force before and after, error against time with its rows."""
    train = five_wire_trials.calibration(grids, world, 5, seed)
    ours, linear = SENSOR.pipeline().fit(train), SENSOR.pipeline(estimator='printed').fit(train)
    line = np.linspace(13e-3, 87e-3, 25)
    where = np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)
    test = grids.touches(world, LAYOUT, where, np.full(len(where), 8.0), seed + 1)
    loads, before, said = five_wire_trials.at_squares(
        SENSOR.pipeline().fit(five_wire_trials.calibration(grids, world, 4, seed)), grids, world
    )
    ways = _costs(train, test)
    labels = ('one frame (us)', 'mean error (mm)')
    drawings = {
        'linear_map': _map(linear, test, 20 * STEPS, 'Place error of the linear formula'),
        'place_map': _map(ours, test, STEPS, 'Place error of the harmonic map, 25 points'),
        'before': _lines(loads, before, 'R / R0', 'Resistance at the 16 squares over the load'),
        'after': _lines(loads, said, 'estimate (N)', 'Force at the 16 squares over the load'),
        'cost': plots.costs(ways, labels, 'Error against time'),
    }
    told = 'place from two potentials, 25 points'
    rows = [
        Row(f'{told}, by {name}', 'mm', error, us_single=spent, compared=told, method=name)
        for name, (spent, error) in ways.items()
    ]
    return drawings, rows


def _lines(loads: Array, told: Array, label: str, words: str) -> str:
    """One line for each of 4 x 4 squares: colours tell x, marks tell y."""
    high = 1.5 * float(told.max())
    plot = Plot((0.0, 15.5), (0.0, high), 'load (N)', label, (360, 300), description=words)
    for n, row in enumerate(told):
        across, up = divmod(n, 4)
        at = up  # where resistances differ most
        plot.line(loads, row, f'line c{across}')
        plot.mark(float(loads[at]), float(row[at]), up, f'fill c{across}')
    for n, place in enumerate(np.linspace(12.5, 87.5, 4)):
        plot.text(0.0, None, f'x = {place:g} mm', kind=f'key c{n}', row=n)
        plot.text(8.0, None, f'{plots.GLYPHS[n]} y = {place:g} mm', row=n)
    return standalone(plot)


def _map(pipeline: Pipeline, test: Recording, steps: Array, told: str) -> str:
    """Errors over the sheet, darker where they are larger."""
    touched = test.truth['in_contact'] == 1
    place = 1e3 * test.truth['position'][touched, :2]
    error = np.linalg.norm(five_wire_trials.judged(pipeline, test).place, axis=1)
    shades = ', '.join(f'{step:g}' for step in steps)
    plot = Plot.plan((0.0, 100.0), (0.0, 100.0), '(mm)', f'{told}; shades above {shades} mm')
    kinds = [f's{n}' for n in np.searchsorted(steps, error)]
    plot.boxes(*place.T, 3.1, kinds)
    return standalone(plot)


def _costs(train: Recording, test: Recording) -> dict[str, tuple[float, float]]:
    """Time of a frame (us) and error of its place (mm), for each way to it."""
    touched, fresh = train.truth['in_contact'] == 1, test.truth['in_contact'] == 1
    x, y = train.values[touched, 0, :2], train.truth['position'][touched, :2]
    ways = {
        'harmonic map': PotentialMap(SIZE).fit(x, y).predict,
        'thin plate': five_wire_trials.thin_plate(x, y),
    }
    told, points = test.truth['position'][fresh, :2], {}
    given = test.values[fresh, 0, :2]

    def measure(predict: object, some: int = five_wire_trials.FRESH) -> tuple[float, float]:
        error = 1e3 * np.linalg.norm(predict(given[:some]) - told[:some], axis=1).mean()
        seconds = min(
            five_wire_trials.seconds_of(lambda: predict(given[:1])) for _ in range(min(some, 200))
        )
        return 1e6 * seconds, float(error)

    for name, way in ways.items():
        points[name] = measure(way)
    points['linear formula'] = measure(lambda u: linear_place(u, SIZE))
    points['a solve each frame'] = measure(_solved, 20)
    return points


def _solved(potentials: Array) -> Array:
    """Places by a solve of the nominal sheet for each frame: what a table spares."""
    shape, border = (33, 33), np.full((4, 8), 24.0)
    line = np.linspace(0, SIZE[0], 33)
    places = np.stack(np.meshgrid(line, line, indexing='ij'), axis=-1).reshape(-1, 2)
    found = []
    for one in potentials:
        held = np.array([1.0, np.nan, 0.0, np.nan])
        both = [sheet_potential(SIZE, shape, border, np.roll(held, turn)) for turn in (0, 1)]
        apart = np.stack([u.ravel() for u in both], axis=1) - one
        found.append(places[(apart**2).sum(axis=1).argmin()])
    return np.array(found)
