# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Loads beyond any that was told: bounded forces that rise, wide sigmas, and a flag."""

import dataclasses

import numpy as np
import pytest

from tactile_ros.pipeline import Pipeline
from tactile_ros.sensors import load_sensor
from tactile_ros.types import ContactStates, FrameStatus, Recording

TAXELS = load_sensor('taxel_array')
WIRES = load_sensor('five_wire_skin')
CONFIG = dataclasses.replace(TAXELS.config(), objects=())  # type: ignore[type-var]
LAYOUT = TAXELS.layout(CONFIG)
HALF = 20.0  # N, load of half the range
GAIN = 1 / (1 + 0.55 * np.random.default_rng(3).uniform(size=16))


def read(force: np.ndarray, seed: int) -> np.ndarray:
    """Outputs of 10 bits of taxels whose gains differ by 55 %."""
    output = GAIN * force / (force + HALF)
    output = output + 4e-4 * np.random.default_rng(seed).normal(size=output.shape)
    return np.round(np.clip(output, 0, 1) * 1023)[..., None] / 1023


def fitted(top: float) -> Pipeline:
    """Equilibrated by even loads up to some force."""
    force = np.repeat(np.random.default_rng(1).uniform(0.02, top, (120, 1)), 16, axis=1)
    force[:15] = 0
    truth = {'taxel_force': force, 'in_contact': (force[:, 0] > 0).astype(np.int8)}
    return TAXELS.pipeline(CONFIG).fit(Recording.from_arrays(LAYOUT, read(force, 2), truth=truth))


def flagged(states: ContactStates) -> np.ndarray:
    return np.asarray(states.status & FrameStatus.OUT_OF_RANGE > 0)


@pytest.mark.parametrize('top', [1.0, 60.0])
def test_no_reading_is_a_negative_or_an_endless_force(top: float) -> None:
    level = np.linspace(0, 0.99, 100)
    values = np.repeat(level[:, None, None], 16, axis=1)
    states = fitted(top).process_batch(Recording.from_arrays(LAYOUT, values))
    assert (np.diff(states.taxel_force, axis=0) >= -1e-9).all()
    assert states.taxel_force.min() >= 0
    assert states.taxel_force.max() < 100 * top
    assert flagged(states)[-1]
    # 0.99 is more than some taxels say of any load: nothing is known of it
    assert np.sqrt(states.force_cov[-1, 2, 2]) > 0.3 * states.force[-1, 2]


@pytest.mark.parametrize('top', [5.0, 20.0])
def test_heavier_loads_are_inside_two_sigma_and_flagged(top: float) -> None:
    pipeline = fitted(top)
    load = top * np.array([0.3, 0.6, 0.9, 1.0, 1.3, 1.6, 2.0, 3.0])
    states = pipeline.process_batch(
        Recording.from_arrays(LAYOUT, read(np.repeat(load[:, None], 16, axis=1), 4))
    )
    assert flagged(states).tolist() == 4 * [False] + 4 * [True]
    error = states.force[:, 2] - 16 * load
    sigma = np.sqrt(states.force_cov[:, 2, 2])
    assert (np.abs(error)[4:] < 2 * sigma[4:]).all()
    assert (np.diff(sigma[3:]) > 0).all()
    assert (sigma[:4] < 0.01 * 16 * load[:4]).all()


def test_one_loud_taxel_is_flagged_and_makes_the_sum_unsure() -> None:
    pipeline = fitted(20.0)
    values = read(np.full((2, 16), 6.0), 5)
    values[1, 4] = 0.98
    states = pipeline.process_batch(Recording.from_arrays(LAYOUT, values))
    assert flagged(states).tolist() == [False, True]
    error = states.force[1, 2] - 16 * 6.0
    assert error > 20
    assert error < 3 * np.sqrt(states.force_cov[1, 2, 2])


def test_a_short_of_the_film_is_no_force_that_is_sure_of_itself() -> None:
    lesson = WIRES.presses(WIRES.config(), 0, 20)
    force = lesson.truth['force'][:, 2].astype(float)
    touched = np.flatnonzero(lesson.truth['in_contact'] == 1)
    pipeline = WIRES.pipeline().fit(lesson)
    own = pipeline.process_batch(lesson)
    assert not flagged(own).any()
    heaviest = touched[np.nanargmax(force[touched])]
    values = np.repeat(lesson.values[heaviest][None], 6, axis=0)
    values[1:, 0, 2] = 0.85, 0.9, 0.95, 0.99, 0.999
    states = pipeline.process_batch(Recording.from_arrays(WIRES.layout(WIRES.config()), values))
    assert flagged(states).tolist() == [False, *5 * [True]]
    assert (states.force[2:, 2] > 1.3 * force[heaviest]).all()
    sigma = np.sqrt(states.force_cov[:, 2, 2])
    assert (sigma[2:] >= states.force[2:, 2]).all()
    assert sigma[0] < 0.02 * force[heaviest]
