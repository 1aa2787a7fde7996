"""The gradiometer where a fit says little: presses all alike, touches lighter than all others."""

from __future__ import annotations

import numpy as np
import pytest

from tactile_ros.physics.magnetics import exact_disc
from tactile_ros.pipeline import Pipeline
from tactile_ros.sensors import load_sensor
from tactile_ros.types import FrameStatus, Recording

SENSOR = load_sensor('gradiometer')
CONFIG = SENSOR.config()
REST, NOISE = 40, 9e-6
STIFFNESS = np.array([700.0, 700.0, 2300.0])  # N/m, of three springs


def record(sinks: tuple[float, float], count: int, seed: int) -> Recording:
    """Presses that sink the disc by depths (m) and move it as far aside, after a rest."""
    rng = np.random.default_rng(seed)
    moved = np.zeros((REST + count, 3))
    moved[REST:, 2] = -rng.uniform(*sinks, count)
    moved[REST:, :2] = rng.uniform(-1, 1, (count, 2)) * moved[REST:, 2:]
    places = moved + np.array([0, 0, CONFIG.gap + CONFIG.disc_height / 2])
    disc = CONFIG.disc_diameter, CONFIG.disc_height, CONFIG.remanence
    field = exact_disc(CONFIG.positions, disc).readings(np.hstack([places, 0 * moved[:, :2]]))
    read = field[..., [0, 2]] + NOISE * rng.normal(size=(len(moved), 4, 2))
    force = -moved * STIFFNESS + 0.0
    tare = np.arange(len(moved)) < REST
    truth = {'force': force, 'in_contact': (~tare).astype(np.int8)}
    return Recording.from_arrays(SENSOR.layout(CONFIG), read, tare=tare, truth=truth)


@pytest.fixture(scope='module')
def firm() -> Pipeline:
    return SENSOR.pipeline(CONFIG).fit(record((0.5e-3, 1.2e-3), 300, 1))


def test_touches_too_light_to_be_called_so_are_in_the_covariance(firm: Pipeline) -> None:
    light = record((5e-6, 80e-6), 200, 2)
    states = firm.process_batch(light)
    missed = (states.in_contact == 0) & ~light.tare
    assert missed.sum() > 20
    assert not states.force[missed].any()
    error = np.abs(light.truth['force'])[missed]
    assert error.max() > 0.02  # N, where presses err by 1e-3
    sigma = np.sqrt(np.diagonal(states.force_cov, axis1=1, axis2=2))
    assert (error < 2 * sigma[missed]).mean() > 0.95
    assert np.median(sigma[REST:][missed[REST:], 2]) > 10 * np.median(sigma[:REST, 2])


def test_one_reading_again_and_again_tells_no_force_of_another_place() -> None:
    one = record((0.8e-3, 0.8e-3), 1, 3)
    rows = np.r_[np.arange(REST), np.full(100, REST)]
    pipeline = SENSOR.pipeline(CONFIG).fit(one.select(rows))
    test = record((0.2e-3, 1.2e-3), 100, 4)
    states = pipeline.process_batch(test)
    said = np.isfinite(states.force).all(axis=1)[REST:]
    assert said.mean() < 0.4
    refused = FrameStatus.ABSTAINED | FrameStatus.SATURATED
    assert (states.status[REST:][~said] & refused > 0).all()
    assert any('other ways than the 0' in name for name in pipeline.report)
