# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Play of a skin, learned and stated alike at any rate of frames."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest

from reference import taxel_world
from tactile_ros.pipeline import Pipeline
from tactile_ros.sensors import load_sensor
from tactile_ros.types import ContactStates, Recording

SPEC = load_sensor('taxel_array')
RATES = (20.0, 100.0, 2000.0)
TOP, PLAY, TAXELS = 3.0, 0.02, 4
UNEVEN = np.array([1.0, 0.7, 0.4, 0.15])  # of the largest load: other levels of a law
ARRAY = taxel_world.radial((8e-3, 25e-3), (TAXELS,))


def presses(seed: int, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Corners (n,) in time (s) and load (N) of presses whose ramps last 0.3 to 1.2 s."""
    rng, corners, loads = np.random.default_rng(seed), [0.0, 1.0], [0.0, 0.0]
    for i in range(count):
        rise, fall = rng.uniform(0.3, 1.2, 2)
        times = np.round(np.cumsum([rise, 0.2, fall, 0.4]), 1)  # at a row of every rate
        corners += (corners[-1] + times).tolist()
        loads += [one := TOP * (0.5, 1.0, 0.75, 0.95)[i % 4], one, 0.0, 0.0]
    return np.array(corners), np.array(loads)


def recorded(rate: float, seed: int, count: int, shares: np.ndarray) -> Recording:
    """Presses of which every taxel bears a share."""
    corners, loads = presses(seed, count)
    time = np.arange(round(corners[-1] * rate)) / rate
    force = np.interp(time, corners, loads)[:, None] * shares
    skin = taxel_world.Skin(7, TAXELS, 1.5, play=PLAY, bits=14)
    values = skin.read(force, np.random.default_rng(seed))
    truth = {'taxel_force': force, 'in_contact': (force[:, 0] > 0).astype(np.int8)}
    return Recording.from_arrays(
        SPEC.layout(taxel_world.config(ARRAY)), values,
        stamp_ns=np.round(1e9 * time).astype(np.int64),
        stream=np.zeros(len(time), int), tare=time < 0.5, truth=truth,
    )  # fmt: skip


@lru_cache
def told(rate: float) -> tuple[Pipeline, ContactStates, Recording]:
    """Pipeline that learned at a rate, and what it says of other presses read at that rate."""
    pipeline = SPEC.pipeline(taxel_world.config(ARRAY)).fit(recorded(rate, 1, 8, np.ones(TAXELS)))
    asked = recorded(rate, 2, 3, UNEVEN)
    return pipeline, pipeline.process_batch(asked), asked


@pytest.mark.parametrize('rate', RATES[1:])
def test_forces_and_their_sigmas_are_alike_at_any_rate(rate: float) -> None:
    truth = told(RATES[0])[2].truth['taxel_force'].sum(axis=1)
    pressed = truth > 0.1 * truth.max()
    found = []
    for one in (RATES[0], rate):
        states, step = told(one)[1], round(one / RATES[0])
        force, cov = states.force[::step, 2], states.force_cov[::step, 2, 2]
        found.append((force[pressed], np.sqrt(cov[pressed])))
    (slow, slow_sigma), (fast, fast_sigma) = found
    assert np.abs(fast - slow).max() < 0.015 * truth.max()
    assert fast_sigma == pytest.approx(slow_sigma, rel=0.5)
    inside = np.abs(fast - truth[pressed]) <= 2 * fast_sigma
    assert inside.mean() > 0.9
