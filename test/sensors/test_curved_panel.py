# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""A panel that is bent round a cylinder and is no rectangle, on the five-wire skin's own chain."""

import numpy as np
import pytest
from scipy.interpolate import LinearNDInterpolator

from reference import five_wire_world as grids
from reference.sheet_solver import OutlineMesh
from tactile_ros.estimators.potential_map import PotentialMap
from tactile_ros.physics import coverage
from tactile_ros.physics.resistive_sheet import rolled, unrolled
from tactile_ros.sensors import load_sensor
from tactile_ros.types import Array

RADIUS, NOISE = 0.06, 3e-4
DIAGONALS = [([0, 2], [1.0, 0.0]), ([1, 3], [1.0, 0.0])]
PHASES = [([0, 1, 2], [float(v) for v in np.roll([1.0, 0.0, 0.5], k)]) for k in range(3)]
CORNERS = np.array([[0.01, 0.0], [0.12, 0.01], [0.1, 0.1], [0.0, 0.08]])
SENSOR = load_sensor('five_wire_skin')
CONFIG = SENSOR.config(size=np.array([0.12, 0.1]), positions=np.array([[0.06, 0.05, 0.0]]))


class Panel:
    """Uneven silver round a kite; potentials by triangles, a film of one exponent."""

    noise = NOISE

    def __init__(self) -> None:
        self.excited = DIAGONALS
        mesh = OutlineMesh.of(CORNERS, 0.0025)
        border = 24.0 * np.random.default_rng(6).uniform(0.3, 1.7, mesh.border)
        self.mesh, self.border, self.held = mesh, border, mesh.nearest(CORNERS)

    def potentials(self, places: Array, excitations: list[tuple[list[int], list[float]]]) -> Array:
        solved = [
            self.mesh.potential(self.border, self.held[at], np.array(level))
            for at, level in excitations
        ]
        return np.asarray(LinearNDInterpolator(self.mesh.points, np.array(solved).T)(places))

    def readings(self, places: Array, force: Array, rng: np.random.Generator) -> Array:
        told = self.potentials(places, self.excited)
        exact = np.column_stack([told, 1 / (1 + 2.0 * force**-0.7)])
        return np.asarray(exact + NOISE * rng.normal(size=exact.shape))


@pytest.fixture(scope='module')
def panel() -> Panel:
    return Panel()


def inside(count: int, seed: int) -> Array:
    """Places (s, 2) at least 10 mm from the corners' own box, inside the outline (m)."""
    drawn = np.random.default_rng(seed).uniform([0.015, 0.015], [0.1, 0.08], (4 * count, 2))
    middle = CORNERS.mean(axis=0)
    return drawn[coverage.inside([middle + 0.8 * (CORNERS - middle)], drawn)][:count]


@pytest.mark.parametrize('excited', [DIAGONALS, PHASES[:2]], ids=['diagonals', 'two_phases'])
def test_a_bent_panel_is_the_flat_sheet_of_its_development(
    panel: Panel, excited: list[tuple[list[int], list[float]]]
) -> None:
    panel.excited = excited
    on_panel = rolled(inside(60, 1), RADIUS)  # where a hand touches it
    flat = unrolled(on_panel, RADIUS)
    layout = SENSOR.layout(CONFIG)
    where, load = np.repeat(flat, 4, axis=0), np.tile([2.0, 5.0, 9.0, 14.0], len(flat))
    pipeline = SENSOR.pipeline(CONFIG).fit(grids.touches(panel, layout, where, load, 2))
    fresh = inside(200, 3)
    test = grids.touches(panel, layout, fresh, np.full(len(fresh), 7.0), 4)
    states = pipeline.process_batch(test)
    touched = test.truth['in_contact'] == 1
    found = rolled(states.position[touched, :2], RADIUS)
    truth = rolled(test.truth['position'][touched, :2], RADIUS)
    miss = np.linalg.norm(found - truth, axis=1)
    assert np.mean(miss) < 0.3e-3
    assert np.quantile(miss, 0.95) < 0.8e-3
    np.testing.assert_allclose(states.force[touched, 2], 7.0, atol=0.3)


def test_two_phases_of_three_tell_the_place_as_well(panel: Panel) -> None:
    rng, known, fresh = np.random.default_rng(5), inside(60, 1), inside(200, 3)
    told = [
        u + NOISE * rng.normal(size=u.shape)
        for u in (panel.potentials(places, PHASES) for places in (known, fresh))
    ]
    np.testing.assert_allclose(told[1].sum(axis=1), 1.5, atol=8 * NOISE)  # the third is a check
    found = PotentialMap(CONFIG.size).fit(told[0][:, :2], known).predict(told[1][:, :2])
    assert np.linalg.norm(found - fresh, axis=1).mean() < 0.5e-3
