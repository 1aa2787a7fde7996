"""The five-wire skin on a world that is not the package's own."""

from __future__ import annotations

import importlib.util
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

from tactile_ros.pipeline import Pipeline
from tactile_ros.sensors import load_sensor
from tactile_ros.types import Recording

FILE = Path(__file__).parents[1] / 'reference' / 'five_wire_world.py'
SPEC = importlib.util.spec_from_file_location('five_wire_world', FILE)
reference = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(reference)
SENSOR = load_sensor('five_wire_skin')
LAYOUT = SENSOR.layout(SENSOR.config())


@lru_cache
def fitted(places: int, loads: int, seed: int = 0) -> tuple[Pipeline, Recording, object]:
    """Pipeline calibrated on a grid, fresh touches, and their world."""
    world = reference.FiveWireWorld(seed)
    where = np.repeat(reference.grid(places), loads, axis=0)
    load = np.tile(np.linspace(1, 15, loads), places**2)
    pipeline = SENSOR.pipeline().fit(reference.touches(world, LAYOUT, where, load, seed + 10))
    rng = np.random.default_rng(seed + 20)
    fresh = rng.uniform(12.5e-3, 87.5e-3, (1500, 2))
    test = reference.touches(world, LAYOUT, fresh, rng.uniform(1, 15, 1500), seed + 30)
    return pipeline, test, world


@pytest.mark.parametrize('seed', [0, 1])
def test_place_from_25_points_comes_near_the_bound(seed: int) -> None:
    pipeline, test, world = fitted(5, 10, seed)
    states = pipeline.process_batch(test)
    touched = test.truth['in_contact'] == 1
    true = test.truth['position'][touched]
    error = np.linalg.norm((states.position[touched] - true)[:, :2], axis=1).mean()
    assert pipeline.estimators['position'] == 'harmonic'
    assert error < 1.3 * world.bound(true[:, :2])


@pytest.mark.parametrize('seed', [0, 1])
def test_force_anywhere_from_49_points(seed: int) -> None:
    pipeline, test, _ = fitted(7, 8, seed)
    states = pipeline.process_batch(test)
    touched = test.truth['in_contact'] == 1
    error = (states.force - test.truth['force'])[touched, 2]
    assert np.sqrt((error**2).mean()) < 0.28
    sigma = np.sqrt(states.force_cov[touched, 2, 2])
    assert 0.4 < (np.abs(error) < sigma).mean() <= 1.0
    assert (np.abs(error) < 3 * sigma).mean() > 0.9


def test_a_floating_foil_is_no_touch_and_shear_is_not_felt() -> None:
    pipeline, test, _ = fitted(7, 8)
    states = pipeline.process_batch(test)
    assert (states.in_contact == test.truth['in_contact']).all()
    untouched = states.in_contact == 0
    assert np.isnan(states.position[untouched]).all()
    assert (states.force[untouched, 2] == 0).all()
    assert np.isnan(states.force[:, :2]).all()


def test_the_network_as_printed_gets_worse_between_squares() -> None:
    world = reference.FiveWireWorld(0)
    where, load = np.repeat(reference.grid(4), 15, axis=0), np.tile(np.arange(1.0, 16), 16)
    train = reference.touches(world, LAYOUT, where, load, 1)
    printed = SENSOR.pipeline(estimator='printed').fit(train)
    assert printed.estimators == {'position': 'printed', 'force': 'printed'}
    fresh = np.random.default_rng(2).uniform(12.5e-3, 87.5e-3, (400, 2))
    between = reference.touches(world, LAYOUT, fresh, np.full(400, 8.0), 3)

    def rms(recording: Recording) -> float:
        touched = recording.truth['in_contact'] == 1
        error = printed.process_batch(recording).force - recording.truth['force']
        return float(np.sqrt((error[touched, 2] ** 2).mean()))

    assert rms(between) > 1.2 * rms(train)


def test_unfitted_it_tells_the_place_by_the_formula_and_no_force() -> None:
    pipeline = SENSOR.pipeline()
    recording = SENSOR.presses(SENSOR.config(), 0, 6)
    states = pipeline.process_batch(recording)
    touched = recording.truth['in_contact'] == 1
    error = (states.position - recording.truth['position'])[touched, :2]
    assert np.abs(error).max() < 1e-3
    assert np.isnan(states.force).all()
