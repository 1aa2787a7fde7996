"""What a scene of the gradiometer leaves out, and how near its limit a reading is believed."""

from __future__ import annotations

import dataclasses

import numpy as np

from reference import gradiometer_world as made
from tactile_ros.sensors import load_sensor
from tactile_ros.sensors.gradiometer.field_change import MOST_MARGIN, margins
from tactile_ros.types import Recording, Signals

SENSOR = load_sensor('gradiometer')


def force_errors(pipeline: object, test: Recording) -> tuple[np.ndarray, np.ndarray]:
    """Root mean square of errors of force and the median of their sigmas, all axes together."""
    states = pipeline.process_batch(test)  # type: ignore[attr-defined]
    touched = ~test.tare & np.isfinite(states.force).all(axis=1)
    error = (states.force - test.truth['force'])[touched]
    variance = np.diagonal(states.force_cov, axis1=1, axis2=2)[touched]
    return np.sqrt((error**2).mean()), np.median(np.sqrt(variance))


def test_without_the_stray_term_force_is_surer_and_wrong_in_a_field() -> None:
    world, found = made.World(31), {}
    for term in (True, False):
        config = dataclasses.replace(world.config, stray_term=term)
        pipeline = SENSOR.pipeline(config, 'inversion').fit(world.record(300, 1))
        outside = world.record(200, 3, made.Scene(stray=(1e-3, 5e-4, -1e-3)))
        found[term] = [force_errors(pipeline, one) for one in (world.record(400, 2), outside)]
    (with_it, _), (without, _) = found[True][0], found[False][0]
    assert without < 0.95 * with_it
    assert found[False][0][1] < 0.95 * found[True][0][1]
    assert found[False][1][0] > 5 * found[True][1][0]


def test_without_the_thermal_term_no_temperature_of_the_disc_is_learned() -> None:
    world = made.World(31)
    recording = world.record(60, 4, made.Scene(span=50.0))
    for term, width in ((True, 3), (False, 0)):
        config = dataclasses.replace(world.config, thermal_term=term)
        pipeline = SENSOR.pipeline(config, 'differences').fit(recording)
        features = pipeline.estimation.features_
        blank = np.zeros((1, 4, 2))
        one = Signals(
            blank, blank, blank, np.full((1, 4), 20.0), None, np.zeros(1, bool),
            np.zeros(1, np.int8), np.ones(1, bool),
        )  # fmt: skip
        assert features.thermal(one, features.start()).shape == (1, width)
        assert any(name.startswith('term: temperature') for name in pipeline.report)


def test_the_margin_below_the_range_is_told_by_the_noise() -> None:
    config, noise = SENSOR.config(), 3e-6
    limit = float(np.max(config.saturation))
    below = np.array([0.0, 3.0, 5.0]) * noise
    values = np.zeros((6, 4, 2))
    values[:3, 2, 1], values[3:, 0, 0] = limit - below, below - limit
    signals = Signals(
        values, values, values, None, None, np.zeros(6, bool), np.zeros(6, np.int8),
        np.ones(6, bool),
    )  # fmt: skip
    assert margins(signals, config, noise).tolist() == 2 * [True, True, False]
    # however noisy, no more than a hundredth of the range is given up
    values[:3, 2, 1] = limit * (1 - MOST_MARGIN * np.array([0.5, 0.99, 1.01]))
    assert margins(signals, config, 1.0).tolist()[:3] == [True, True, False]
    bare = dataclasses.replace(config, saturation=None)
    assert not margins(signals, bare, noise).any()


def test_clipped_rows_of_a_calibration_are_counted_and_their_loads_are_not_told() -> None:
    world = made.World(31)
    lesson, test = world.record(120, 1), world.record(120, 2)
    limit = float(np.quantile(np.abs(lesson.values).max(axis=(1, 2)), 0.7))
    config = dataclasses.replace(world.config, saturation=limit, full_scale=10.0)
    clipped = (np.abs(lesson.values) >= limit).any(axis=(1, 2))
    layout = SENSOR.layout(config)
    seen = dataclasses.replace(lesson, values=np.clip(lesson.values, -limit, limit), layout=layout)
    pipeline = SENSOR.pipeline(config, 'differences').fit(seen)
    assert pipeline.report['left_out'] == {'rows with a faulty taxel': float(clipped.sum())}
    (said,) = [one for one in pipeline.report if one.startswith('not told: force beyond')]
    highest = lesson.truth['force'][~clipped, 2].max()
    assert highest < 0.9 * lesson.truth['force'][:, 2].max()
    assert f'..{highest:.2g} N along z' in said
    states = pipeline.process_batch(
        dataclasses.replace(test, values=np.clip(test.values, -limit, limit), layout=layout)
    )
    firm = (np.abs(test.values) >= limit).any(axis=(1, 2))
    assert firm.sum() > 10
    assert not states.valid[firm].any()
