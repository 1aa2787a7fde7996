# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Hard cases of what an array says: symmetry, flips, 0/0 of the shape factor, ghosts, bad input.

Numbers are those of the list of hard cases that this package was built against.
"""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from reference.pick_world import turn_between
from tactile_ros.physics.coverage import part_pressure, washer
from tactile_ros.pipeline import Pipeline
from tactile_ros.sensors import load_sensor
from tactile_ros.sensors.taxel_array.config import TaxelArrayConfig, grid_positions
from tactile_ros.types import Frame, FrameStatus, Outline, Recording

SPEC = load_sensor('taxel_array')
ROWS, COLUMNS, PITCH = 16, 18, 2e-3
TAXELS = ROWS * COLUMNS
PARTS = (
    Outline('rectangle', (1e-3 * np.array([[-9, -5], [9, -5], [9, 5], [-9, 5.0]]),)),
    Outline('square', (1e-3 * np.array([[-6, -6], [6, -6], [6, 6], [-6, 6.0]]),)),
    washer('washer', 11e-3, 5e-3),
    Outline('trapezoid', (1e-3 * np.array([[-10, -6], [10, -6], [5, 6], [-5, 6.0]]),)),
)
ORDERS = (2, 4, 0, 1)


def config(*objects: Outline) -> TaxelArrayConfig:
    return TaxelArrayConfig(
        positions=grid_positions(ROWS, COLUMNS, PITCH),
        areas=np.full(TAXELS, PITCH**2),
        force_range=np.array([0.0, 5.0]),
        objects=objects,
    )


def loads(part: Outline, x: float, y: float, yaw: float) -> np.ndarray:
    """Load of each taxel at 1 N on a wholly covered one, by 144 points."""
    line = PITCH * ((np.arange(12) + 0.5) / 12 - 0.5)
    points = config().positions[:, None, :2] + np.stack(np.meshgrid(line, line), -1).reshape(-1, 2)
    cos, sin = np.cos(yaw), np.sin(yaw)
    own = (points.reshape(-1, 2) - np.array([x, y])) @ np.array([[cos, -sin], [sin, cos]])
    return part_pressure(part, own).reshape(TAXELS, -1).mean(axis=1)


def read(force: np.ndarray, seed: int, stuck: int = -1) -> np.ndarray:
    gain = 1 / (1 + 0.55 * np.random.default_rng(3).uniform(size=TAXELS))
    output = gain * force / (force + 1.5)
    if stuck >= 0:
        output[:, stuck] = 0.4
    output = output + 4e-4 * np.random.default_rng(seed).normal(size=output.shape)
    return np.round(np.clip(output, 0, 0.999) * 1023)[..., None] / 1023


def fitted(settings: TaxelArrayConfig, stuck: int = -1, **truth: np.ndarray) -> Pipeline:
    """Equilibrated by even loads; further truth is a factor of the force."""
    force = np.repeat(np.random.default_rng(1).uniform(0.02, 2, (120, 1)), TAXELS, axis=1)
    force[:15] = 0
    told = {
        'taxel_force': force, 'in_contact': (force[:, 0] > 0).astype(np.int8),
        **{name: factor * force for name, factor in truth.items()},
    }  # fmt: skip
    recording = Recording.from_arrays(SPEC.layout(settings), read(force, 2, stuck), truth=told)
    return SPEC.pipeline(settings).fit(recording)


@pytest.mark.parametrize('which', range(4), ids=[part.name for part in PARTS])
def test_case_11_the_class_of_turns_is_told_and_nothing_flips(which: int) -> None:
    part, order = PARTS[which], ORDERS[which]
    settings = config(part)
    pipeline = fitted(settings)
    rng = np.random.default_rng(7)
    poses = np.column_stack([rng.uniform(-2e-3, 2e-3, (12, 2)), rng.uniform(-np.pi, np.pi, 12)])
    force = np.array([loads(part, *pose) for pose in poses])
    states = pipeline.process_batch(Recording.from_arrays(SPEC.layout(settings), read(force, 5)))
    assert (states.label == 0).all()
    assert (states.symmetry == order).all()
    assert np.median(np.linalg.norm(states.position[:, :2] - poses[:, :2], axis=1)) < 0.1e-3
    if order == 0:
        assert np.isnan(states.yaw).all()
        assert np.isnan(states.yaw_std).all()
        return
    turns = [turn_between(a, b, order) for a, b in zip(states.yaw, poses[:, 2], strict=True)]
    assert np.rad2deg(max(turns)) < 3.0
    assert (np.abs(states.yaw) <= np.pi / order + 1e-9).all()


def test_equation_3_is_no_0_over_0_where_nothing_touches() -> None:
    settings = config()
    pipeline = fitted(settings, deformation=np.array(2e-4))
    force = loads(PARTS[1], 0.0, 0.0, 0.0)
    pipeline.tare([Frame(None, 0, read(np.zeros((1, TAXELS)), 8)[0])])
    state = pipeline.process(Frame(None, 1, read(force[None], 9)[0]))
    points = pipeline.estimation.surface(state)  # type: ignore[attr-defined]
    untouched, whole = force == 0, force > 0.9
    assert np.isnan(points[untouched]).mean() > 0.97
    np.testing.assert_allclose(points[whole, 2], -2e-4 * force[whole], rtol=0.05)
    np.testing.assert_array_equal(points[whole, :2], settings.positions[whole, :2])
    rest = pipeline.process(Frame(None, 2, read(np.zeros((1, TAXELS)), 10)[0]))
    assert np.isnan(pipeline.estimation.surface(rest)).all()  # type: ignore[attr-defined]


def test_a_rigid_array_has_a_shape_factor_of_0() -> None:
    settings = config()
    pipeline = fitted(settings)
    force = loads(PARTS[1], 0.0, 0.0, 0.0)
    state = pipeline.process(Frame(None, 1, read(force[None], 9)[0]))
    points = pipeline.estimation.surface(state)  # type: ignore[attr-defined]
    whole = force > 0.9
    np.testing.assert_array_equal(points[whole], settings.positions[whole])


def test_case_9_a_stuck_taxel_is_no_contact() -> None:
    stuck = TAXELS // 2 + 3
    pipeline = fitted(config(), stuck)
    quiet = pipeline.process_batch(
        Recording.from_arrays(SPEC.layout(config()), read(np.zeros((5, TAXELS)), 11, stuck))
    )
    assert (quiet.contacts_id == -1).all()
    assert not np.nansum(quiet.taxel_force)
    away = loads(PARTS[1], -9e-3, -7e-3, 0.2)
    touched = pipeline.process_batch(
        Recording.from_arrays(SPEC.layout(config()), read(away[None], 12, stuck))
    )
    assert (touched.contacts_id >= 0).sum() == 1
    np.testing.assert_allclose(touched.contacts_position[0, 0, :2], [-9e-3, -7e-3], atol=2e-4)


def test_case_13_what_creeps_back_after_a_hold_is_no_contact() -> None:
    # a held load leaves 16 % of the output behind, which fades in seconds
    settings = dataclasses.replace(SPEC.config(), objects=())  # type: ignore[type-var]

    def played(load: np.ndarray, seed: int) -> Recording:
        felt, strain = load.copy(), 0.0
        for i in range(1, len(load)):
            strain = 0.98 * strain + 0.02 * load[i]  # 5 s at 10 Hz
            felt[i] += 0.16 * strain
        output = felt[:, None] / (felt[:, None] + 20) * np.linspace(0.7, 1, 16)
        output = output + 3e-4 * np.random.default_rng(seed).normal(size=output.shape)
        truth = {
            'taxel_force': np.repeat(load[:, None], 16, axis=1),
            'in_contact': (load > 0).astype(np.int8),
        }
        stamps = 100_000_000 * np.arange(len(load))
        return Recording.from_arrays(
            SPEC.layout(settings), np.round(np.clip(output, 0, 1) * 1023)[..., None] / 1023,
            stamps, tare=np.arange(len(load)) < 10, truth=truth,
        )  # fmt: skip

    rng = np.random.default_rng(2)
    steps = [np.full(int(n), f) for n, f in zip(
        rng.integers(20, 90, 24), np.where(np.arange(24) % 2, rng.uniform(4, 30, 24), 0),
        strict=True)]  # fmt: skip
    pipeline = SPEC.pipeline(settings).fit(played(np.concatenate([np.zeros(15), *steps]), 3))
    assert 'creep' in pipeline.estimators['taxel_force']
    hold = np.concatenate([np.zeros(15), np.full(600, 20.0), np.zeros(60)])
    states = pipeline.process_batch(played(hold, 4))
    released = slice(620, None)
    assert np.nanmax(np.abs(states.taxel_force[released])) < 0.2
    assert np.nansum(states.contacts_force[released, :, 2], axis=1).max() < 1.0


@pytest.mark.parametrize('broken', ['nan', 'constant', 'count'])
def test_bad_input_is_no_plausible_number(broken: str) -> None:
    pipeline = fitted(config(PARTS[1]))
    good = read(loads(PARTS[1], 0.0, 0.0, 0.3)[None], 13)[0]
    if broken == 'count':
        with pytest.raises(ValueError, match='288'):
            pipeline.process(Frame(None, 0, good[:-1]))
        return
    values = np.full_like(good, np.nan if broken == 'nan' else 0.5)
    state = pipeline.process(Frame(None, 0, values))
    assert int(state.label) == -1
    assert np.isnan(state.object_pose).all()
    if broken == 'nan':
        assert not state.valid
        assert (state.contacts_id == -1).all()
    else:
        assert state.status & FrameStatus.ABSTAINED
