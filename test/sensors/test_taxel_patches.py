# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Several contacts on one array, through the whole pipeline and the message."""

from __future__ import annotations

import dataclasses
from functools import lru_cache

import numpy as np
import pytest

from tactile_ros.pipeline import Pipeline
from tactile_ros.sensors import load_sensor
from tactile_ros.sensors.taxel_array.config import grid_positions
from tactile_ros.types import Frame, Recording

SPEC = load_sensor('taxel_array')
PITCH = 2e-3
TAXELS = 14 * 18
CONFIG = dataclasses.replace(  # type: ignore[type-var]
    SPEC.config(),
    positions=grid_positions(14, 18, PITCH),
    areas=np.full(TAXELS, PITCH**2),
    force_range=(0.0, 5.0),
)


def bodies(*pressed: tuple[float, float, float, float]) -> np.ndarray:
    """Force of each taxel under discs (x, y, radius in mm, pressure in N a taxel)."""
    line = PITCH * ((np.arange(12) + 0.5) / 12 - 0.5)
    points = CONFIG.positions[:, None, :2] + np.stack(np.meshgrid(line, line), -1).reshape(-1, 2)
    force = np.zeros(TAXELS)
    for x, y, radius, pressure in pressed:
        away = np.linalg.norm(points - 1e-3 * np.array([x, y]), axis=2)
        force += pressure * (away < 1e-3 * radius).mean(axis=1)
    return force


def read(force: np.ndarray, seed: int) -> np.ndarray:
    """Outputs of 10 bits, gains 55 % apart."""
    gain = 1 / (1 + 0.55 * np.random.default_rng(9).uniform(size=TAXELS))
    output = gain * force / (force + 1.5)
    noise = 5e-4 * np.random.default_rng(seed).normal(size=output.shape)
    return np.round(np.clip(output + noise, 0, 0.999) * 1023)[..., None] / 1023


@lru_cache
def fitted() -> Pipeline:
    force = np.repeat(np.random.default_rng(1).uniform(0.05, 3, (120, 1)), TAXELS, axis=1)
    force[:15] = 0
    truth = {'taxel_force': force, 'in_contact': (np.arange(120) >= 15).astype(np.int8)}
    return SPEC.pipeline(CONFIG).fit(
        Recording.from_arrays(SPEC.layout(CONFIG), read(force, 2), truth=truth)
    )


def stream(*rows: np.ndarray) -> Recording:
    """Rows 10 ms apart after a rest that is a tare."""
    force = np.stack([np.zeros(TAXELS), *rows])
    stamp_ns = 10_000_000 * np.arange(len(force))
    tare = np.arange(len(force)) == 0
    return Recording.from_arrays(SPEC.layout(CONFIG), read(force, 5), stamp_ns, tare=tare)


def test_two_bodies_are_two_contacts_with_their_own_places_and_forces() -> None:
    force = bodies((-10, 4, 3.5, 0.8), (9, -5, 5, 0.5))
    states = fitted().process_batch(stream(*[force] * 5))
    assert (states.contacts_id[1:, :2] == [0, 1]).all()
    assert (states.contacts_id[:, 2:] == -1).all()
    places = states.contacts_position[1:, :2, :2]
    wanted = 1e-3 * np.array([[9, -5], [-10, 4]])
    assert np.abs(places - wanted).max() < 0.1e-3
    sigma = np.sqrt(states.contacts_position_cov[1:, :2, [0, 1], [0, 1]])
    assert (np.abs(places - wanted) < 3 * sigma).all()
    left = force[CONFIG.positions[:, 0] < 0].sum()
    np.testing.assert_allclose(
        states.contacts_force[1:, :2, 2], [[force.sum() - left, left]] * 5, rtol=0.02
    )
    assert np.isnan(states.contacts_force[1:, :2, :2]).all()
    np.testing.assert_allclose(states.contacts_normal[1:, :2], [[[0, 0, 1.0]] * 2] * 5)
    # the state speaks of the strongest
    np.testing.assert_array_equal(states.position, states.contacts_position[:, 0])
    np.testing.assert_allclose(states.force[1:, 2], force.sum(), rtol=0.02)
    assert len(states[1].contacts) == 2


def test_ids_live_while_bodies_slide_and_one_lifts() -> None:
    rows = [
        bodies((-12 + 0.5 * i, 3, 3.5, 0.8), *([(9, -5, 4, 0.5)] if 5 <= i < 15 else []))
        for i in range(20)
    ]
    rows[8:8] = [np.zeros(TAXELS)]  # a frame in which nothing touches ends all
    states = fitted().process_batch(stream(*rows))
    ids = [sorted(set(row[row >= 0].tolist())) for row in states.contacts_id]
    assert ids[:6] == [[], *[[0]] * 5]
    assert ids[6:9] == [[0, 1]] * 3
    assert ids[9] == []
    assert ids[10:17] == [[2, 3]] * 7
    sliding = [
        row[np.argmin(place[:, 0])] for row, place in
        zip(states.contacts_id[17:], np.nan_to_num(states.contacts_position[17:], nan=1.0),
            strict=True)
    ]  # fmt: skip
    assert len(set(sliding)) == 1


def test_live_is_batch_with_many_patches() -> None:
    rng = np.random.default_rng(4)
    rows = [
        bodies(*((x, y, 2.5, 0.6) for x, y in rng.uniform((-15, -11), (15, 11), (4, 2))))
        for _ in range(12)
    ]
    recording = stream(*rows)
    states = fitted().process_batch(recording)
    assert (states.contacts_id[:, 1] >= 0).any()
    fitted().tare([Frame(None, 0, recording.values[0])])
    for i in range(1, len(recording)):
        one = fitted().process(Frame(int(recording.stamp_ns[i]), i, recording.values[i]))
        for name in ('id', 'position', 'force', 'normal', 'position_cov', 'force_cov'):
            found, wanted = (getattr(s, f'contacts_{name}') for s in (one, states[i]))
            np.testing.assert_allclose(found, wanted, rtol=1e-9, atol=1e-12, err_msg=name)


@pytest.mark.parametrize('taxel', [100, 130])
def test_a_lost_taxel_does_not_part_a_contact(taxel: int) -> None:
    force = np.repeat(np.random.default_rng(1).uniform(0.05, 3, (60, 1)), TAXELS, axis=1)
    force[:15] = 0
    values = read(force, 2)
    values[:, taxel] = 0.0
    truth = {'taxel_force': force, 'in_contact': (np.arange(60) >= 15).astype(np.int8)}
    pipeline = SPEC.pipeline(CONFIG).fit(
        Recording.from_arrays(SPEC.layout(CONFIG), values, truth=truth)
    )
    at = 1e3 * CONFIG.positions[taxel]
    bar = sum(bodies((at[0] + x, at[1], 1.2, 1.0)) for x in (-4, -2, 0, 2, 4))
    touch = read(np.stack([bar]), 7)
    touch[:, taxel] = 0.0
    states = pipeline.process_batch(Recording.from_arrays(SPEC.layout(CONFIG), touch))
    assert (states.contacts_id >= 0).sum() == 1
    np.testing.assert_allclose(states.contacts_force[0, 0, 2], states.force[0, 2])


def test_without_a_law_patches_have_places_and_no_force() -> None:
    rest = Recording.from_arrays(
        SPEC.layout(CONFIG), read(np.zeros((20, TAXELS)), 1),
        truth={'in_contact': np.zeros(20, np.int8)},
    )  # fmt: skip
    states = (
        SPEC.pipeline(CONFIG)
        .fit(rest)
        .process_batch(stream(bodies((-10, 4, 3.5, 0.8), (9, -5, 5, 0.5))))
    )
    assert (states.contacts_id[1] >= 0).sum() == 2
    assert np.abs(states.contacts_position[1, 0, :2] - [9e-3, -5e-3]).max() < 0.4e-3
    assert np.isnan(states.contacts_force[1]).all()
