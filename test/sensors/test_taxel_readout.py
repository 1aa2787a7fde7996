# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Crosstalk of a matrix and the area law as options of the config, in circuits solved apart."""

import dataclasses

import numpy as np
import pytest

from tactile_ros.sensors import load_sensor
from tactile_ros.sensors.taxel_array.config import grid_positions, radial_positions
from tactile_ros.types import Frame, Outline, Recording

SPEC = load_sensor('taxel_array')
ROWS, COLUMNS, PITCH = 8, 9, 5e-3
TAXELS = ROWS * COLUMNS
OUTER, INNER = 14e-3, 6.5e-3
ANGLE = 2 * np.pi * np.arange(96) / 96
RIM = np.column_stack([np.cos(ANGLE), np.sin(ANGLE)])
WASHER = Outline('washer', (OUTER * RIM, (INNER * RIM)[::-1]))
CONFIG = dataclasses.replace(  # type: ignore[type-var]
    SPEC.config(),
    positions=grid_positions(ROWS, COLUMNS, PITCH),
    areas=np.full(TAXELS, PITCH**2),
    force_range=(0.0, 5.0),
    objects=(WASHER,),
)


def covered(x: float, y: float) -> np.ndarray:
    """Part of each taxel under the washer, by 900 points."""
    line = PITCH * ((np.arange(30) + 0.5) / 30 - 0.5)
    points = CONFIG.positions[:, None, :2] + np.stack(np.meshgrid(line, line), -1).reshape(-1, 2)
    away = np.linalg.norm(points - np.array([x, y]), axis=2)
    return np.asarray(((away < OUTER) & (away >= INNER)).mean(axis=1))


def conductance(force: np.ndarray) -> np.ndarray:
    """Of taxels that differ by half: rises with the force and levels off."""
    gain = 1 / (1 + 0.5 * np.random.default_rng(9).uniform(size=TAXELS))
    return gain * force / (force + 3.0)


def circuit(g: np.ndarray, kind: str) -> np.ndarray:
    """Outputs (t,) of the whole matrix, from the equations of all its nodes."""
    if kind == 'none':
        return g / (1 + g)
    matrix = g.reshape(ROWS, COLUMNS)
    if kind == 'grounded':
        return (matrix / (1 + matrix.sum(axis=0))).ravel()
    plain = np.diag(np.concatenate([matrix.sum(axis=1), matrix.sum(axis=0)]) + 1e-12)
    plain[:ROWS, ROWS:], plain[ROWS:, :ROWS] = -matrix, -matrix.T
    one, (i, j) = np.eye(ROWS + COLUMNS), np.divmod(np.arange(TAXELS), COLUMNS)
    nodes, each = np.tile(plain, (TAXELS, 1, 1)), np.arange(TAXELS)
    nodes[each, ROWS + j, ROWS + j] += 1.0
    nodes[each, i] = one[i]
    return np.linalg.solve(nodes, one[i, :, None])[each, ROWS + j, 0]


def read(force: np.ndarray, kind: str, seed: int) -> np.ndarray:
    """Outputs (s, t, 1) of 12 bits."""
    output = np.array([circuit(conductance(row), kind) for row in force])
    noise = 2e-4 * np.random.default_rng(seed).normal(size=output.shape)
    return np.round(np.clip(output + noise, 0, 0.999) * 4095)[..., None] / 4095


def taught() -> np.ndarray:
    """Each column of taxels pressed alone, in growing loads, after rest (N)."""
    force = np.zeros((10 + 6 * COLUMNS, TAXELS))
    for j in range(COLUMNS):
        for k in range(6):
            force[10 + 6 * j + k, j::COLUMNS] = 0.3 * (k + 1)
    return force


def states_of(kind: str, told: str) -> tuple[object, np.ndarray]:
    """Answers to washers of a matrix of a kind, by a config that tells one."""
    config = dataclasses.replace(CONFIG, crosstalk=told)  # type: ignore[type-var]
    force = taught()
    truth = {'taxel_force': force, 'in_contact': (force.any(axis=1)).astype(np.int8)}
    pipeline = SPEC.pipeline(config).fit(
        Recording.from_arrays(SPEC.layout(config), read(force, kind, 1), truth=truth)
    )
    washers = np.array([1.2 * covered(x, y) for x, y in ((0, 0), (2e-3, -1e-3), (-2e-3, 2e-3))])
    values = read(washers, kind, 2)
    states = pipeline.process_batch(Recording.from_arrays(SPEC.layout(config), values))
    for i in range(len(values)):
        live = pipeline.process(Frame(None, i, values[i]))
        np.testing.assert_allclose(live.taxel_force, states.taxel_force[i], atol=1e-9)
    return states, washers


@pytest.mark.parametrize(('kind', 'most'), [('grounded', 0.03), ('floating', 0.06)])
def test_crosstalk_is_undone_where_config_tells_it(kind: str, most: float) -> None:
    states, washers = states_of(kind, kind)
    plain, _ = states_of(kind, 'none')
    miss, worse = (np.sqrt(np.mean(np.square(s.taxel_force - washers))) for s in (states, plain))
    assert miss < most
    assert worse > 4 * miss
    np.testing.assert_allclose(states.force[:, 2], washers.sum(axis=1), rtol=0.03)
    assert (states.contacts_id >= 0).sum(axis=1).tolist() == [1, 1, 1]


def test_crosstalk_is_off_by_default_and_costs_nothing() -> None:
    assert SPEC.config().crosstalk == 'none'
    states, washers = states_of('none', 'none')
    assert np.sqrt(np.mean(np.square(states.taxel_force - washers))) < 0.02


def test_lines_of_a_radial_matrix_are_told() -> None:
    rings = np.vstack([radial_positions(24, r, r + 5e-3) for r in (5e-3, 10e-3, 15e-3)])
    lines = np.stack([np.repeat(np.arange(3), 24), np.tile(np.arange(24), 3)], axis=1)
    config = dataclasses.replace(  # type: ignore[type-var]
        CONFIG, positions=rings, objects=(), crosstalk='grounded', matrix_lines=lines
    )
    g = conductance(np.ones(TAXELS)).reshape(3, 24)
    mixed = (g / (1 + g.sum(axis=0))).ravel()
    unmixed = SPEC.pipeline(config).estimation.unmixing.outputs(mixed[None])  # type: ignore[attr-defined]
    np.testing.assert_allclose(unmixed[0], (g / (1 + g)).ravel(), rtol=1e-12)


@pytest.mark.parametrize(
    ('changes', 'said'),
    [
        ({'crosstalk': 'some'}, 'must be one of none, grounded, floating'),
        ({'matrix_lines': np.zeros((3, 2))}, 'matrix_lines'),
        ({'crosstalk': 'grounded', 'matrix_lines': np.zeros((TAXELS, 2))}, 'own crossing'),
        ({'area_law': (1.0, 2.0)}, 'area_law'),
        ({'area_law': (1.0, 0.0, -1.0, 0.0)}, 'p4'),
    ],
)
def test_options_that_cannot_be_are_refused(changes: dict[str, object], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        dataclasses.replace(CONFIG, **changes)  # type: ignore[type-var]


def test_partly_pressed_taxels_bear_what_the_area_law_says() -> None:
    # a load on a part of a taxel reads more weakly than the same load on all of it
    law = np.array([1.0, 0.0, -0.9, 12e-6])
    whole = PITCH**2

    def share(cover: np.ndarray) -> np.ndarray:
        area = cover * whole
        return (1 - 0.9 * np.exp(-area / 12e-6)) / (1 - 0.9 * np.exp(-whole / 12e-6))

    config = dataclasses.replace(CONFIG, area_law=law)  # type: ignore[type-var]
    force = np.repeat(np.linspace(0, 2, 60)[:, None], TAXELS, axis=1)
    truth = {'taxel_force': force, 'in_contact': (force[:, 0] > 0).astype(np.int8)}
    cover = np.array([covered(x, y) for x, y in ((0.5e-3, 1e-3), (2e-3, -1e-3), (-2e-3, 2e-3))])
    output = np.array([circuit(conductance(row), 'none') for row in 1.2 * cover]) * share(cover)
    missed = {}
    for one in (config, CONFIG):
        fit = Recording.from_arrays(SPEC.layout(one), read(force, 'none', 1), truth=truth)
        pipeline = SPEC.pipeline(one).fit(fit)
        states = pipeline.process_batch(Recording.from_arrays(SPEC.layout(one), output[..., None]))
        assert one is CONFIG or (states.label == 0).all()
        miss = np.abs(states.force[:, 2] / (1.2 * cover.sum(axis=1)) - 1)
        missed[one is config] = float(miss.max())
        partly = (cover > 0.2) & (cover < 0.8)
        ratio = (states.taxel_force / np.maximum(1.2 * cover, 1e-9))[partly]
        missed[f'taxel {one is config}'] = float(np.abs(ratio - 1).mean())
    assert missed[True] < 0.02
    assert missed[False] > 0.05
    assert missed['taxel True'] < 0.06
    assert missed['taxel False'] > 0.15
