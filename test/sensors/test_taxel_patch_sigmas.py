# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Sigmas of several contacts' places and forces, on skins and layouts that chose no constant."""

from __future__ import annotations

import dataclasses
from functools import lru_cache

import numpy as np
import pytest

from reference.pick_world import TaxelScene, TaxelSkin, even_loads
from tactile_ros.sensors import load_sensor
from tactile_ros.sensors.taxel_array.config import grid_positions, radial_positions, sectors
from tactile_ros.types import Recording

SPEC = load_sensor('taxel_array')
PITCH, FRAMES = 2e-3, 40
MATRIX = dataclasses.replace(  # type: ignore[type-var]
    SPEC.config(), positions=grid_positions(14, 18, PITCH), areas=np.full(14 * 18, PITCH**2),
    objects=(),
)  # fmt: skip
RING = dataclasses.replace(  # type: ignore[type-var]
    SPEC.config(), positions=radial_positions(16, 8e-3, 25e-3), objects=(),
    taxel_outlines=sectors(16, 8e-3, 25e-3), areas=np.full(16, np.pi * (25e-3**2 - 8e-3**2) / 16),
)  # fmt: skip


def body(scene: TaxelScene, at: np.ndarray, radius: float, peak: float, domed: bool) -> np.ndarray:
    """Load of each taxel under a round body whose strongest taxel bears `peak` N."""
    away = np.linalg.norm(scene.points - at, axis=1) / radius
    press = np.sqrt(np.maximum(1 - away**2, 0)) if domed else np.ones(len(away))
    load = np.bincount(scene.owner, np.where(away < 1, press, 0) * scene.part, scene.taxels)
    return peak * load / load.max()


def pressed(config: object, seed: int, places: np.ndarray, radii: tuple[float, float]) -> tuple:
    """States of frames in which a body lies at each of places (s, n, 2), and loads (s, n, t)."""
    rng, scene = np.random.default_rng(seed), TaxelScene(config)  # type: ignore[arg-type]
    skin = TaxelSkin.drawn(scene.taxels, 1.5, rng)
    layout = SPEC.layout(config)
    areas = config.areas  # type: ignore[attr-defined]
    pipeline = SPEC.pipeline(config).fit(even_loads(layout, areas, skin, rng, 3.0))
    loads = np.array([
        [body(scene, at, rng.uniform(*radii), rng.uniform(0.3, 2.5), rng.random() < 0.5)
         for at in row] for row in places
    ])  # fmt: skip
    values = skin.read(loads.sum(axis=1), rng)
    return pipeline.process_batch(Recording.from_arrays(layout, values)), loads


@lru_cache
def two_bodies() -> dict[str, np.ndarray]:
    """Errors over sigma, and sigmas, of x, y and force of two bodies on a matrix."""
    found: dict[str, list[tuple[float, float]]] = {'x': [], 'y': [], 'force': []}
    for seed in (41, 42, 43):
        rng = np.random.default_rng(seed)
        x = rng.uniform(8e-3, 12e-3, (FRAMES, 2)) * np.array([-1, 1])
        places = np.stack([x, rng.uniform(-6e-3, 6e-3, (FRAMES, 2))], axis=2)
        states, loads = pressed(MATRIX, seed, places, (2.5e-3, 5e-3))
        assert ((states.contacts_id >= 0).sum(axis=1) == 2).all()
        for row in range(FRAMES):
            for k in range(2):
                place = states.contacts_position[row, k]
                body = int(place[0] > 0)
                sigma = np.sqrt(np.diag(states.contacts_position_cov[row, k]))
                for n, name in enumerate('xy'):
                    found[name].append((place[n] - places[row, body, n], sigma[n]))
                error = states.contacts_force[row, k, 2] - loads[row, body].sum()
                sigma = np.sqrt(states.contacts_force_cov[row, k, 2, 2])
                found['force'].append((error, sigma))
    return {name: np.array(pairs).T for name, pairs in found.items()}


@pytest.mark.parametrize('name', ['x', 'y', 'force'])
def test_sigmas_of_two_contacts_are_what_their_errors_are(name: str) -> None:
    error, sigma = two_bodies()[name]
    ratio = np.abs(error) / sigma
    thirds = np.array_split(np.argsort(sigma, kind='stable'), 3)
    for sigmas, right in ((1, 0.6827), (2, 0.9545)):
        for rows in (np.arange(len(ratio)), *thirds):
            allowed = max(0.05, 1.96 * np.sqrt(right * (1 - right) / len(rows)))
            assert (ratio[rows] < sigmas).mean() >= right - allowed, (sigmas, len(rows))
    # errors of edges are of many sizes: more of them are small than of a bell
    assert 0.7 < np.sqrt(np.mean(ratio**2)) < 1.25
    if name != 'force':
        assert np.sqrt(np.mean(error**2)) < 0.02e-3
        assert np.sqrt(np.mean(sigma**2)) < 0.03e-3


def test_a_ring_tells_no_radius_and_its_sigma_says_so() -> None:
    rng = np.random.default_rng(44)
    angle, radius = rng.uniform(-np.pi, np.pi, 90), rng.uniform(9e-3, 24e-3, 90)
    out = np.column_stack([np.cos(angle), np.sin(angle)])
    at = radius[:, None] * out
    states, _ = pressed(RING, 45, at[:, None], (2e-3, 5e-3))
    one = (states.contacts_id[:, 0] >= 0) & (states.contacts_id[:, 1] < 0)
    assert one.mean() > 0.9
    error = states.contacts_position[:, 0, :2] - at
    cov = states.contacts_position_cov[:, 0, :2, :2]
    for way in (out, np.column_stack([-out[:, 1], out[:, 0]])):
        off = np.abs((error * way).sum(axis=1)) / np.sqrt(np.einsum('si,sij,sj->s', way, cov, way))
        assert (off[one] < 1).mean() > 0.55
        assert (off[one] < 2).mean() > 0.9
