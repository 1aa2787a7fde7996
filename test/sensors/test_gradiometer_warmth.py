"""The gradiometer where chips drift, dies are turned and tares warm: 0 to 50 degrees."""

from __future__ import annotations

from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, cast

import numpy as np
import pytest

from reference import gradiometer_world as made
from tactile_ros.calibration import read, write
from tactile_ros.errors import CalibrationError
from tactile_ros.pipeline import Pipeline
from tactile_ros.sensors import load_sensor
from tactile_ros.sensors.gradiometer.field_change import MOST_FORCES, WarmFit
from tactile_ros.sensors.gradiometer.temperature import (
    UNIT,
    StreamMemory,
    WarmRest,
    thermometer_noise,
)
from tactile_ros.types import Recording, Signals

if TYPE_CHECKING:
    from pathlib import Path

SENSOR = load_sensor('gradiometer')
DRIFT = 5e-6  # T over a degree: an offset of 1 mT that the sensitivity does not scale
AXES = np.tile([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]], (4, 1))


def judged(pipeline: Pipeline, test: Recording) -> tuple[np.ndarray, np.ndarray]:
    """Errors of force and their sigmas, of valid presses."""
    states = pipeline.process_batch(test)
    asked = states.valid & (states.in_contact != 0)
    sigma = np.sqrt(np.diagonal(states.force_cov, axis1=1, axis2=2))
    return (states.force - test.truth['force'])[asked], sigma[asked]


def rms(error: np.ndarray) -> np.ndarray:
    return np.asarray(np.sqrt((error**2).mean(axis=0)))


@pytest.mark.parametrize(('turned', 'ramp_s'), [(0.0, 0.0), (np.pi / 2, 600.0)])
def test_channels_that_drift_cost_less_than_half_as_much_again(
    turned: float, ramp_s: float
) -> None:
    world = made.World(41, drift=DRIFT, turned=turned)
    scene = made.Scene(span=50.0, ramp_s=ramp_s)
    warm = SENSOR.pipeline(world.config, 'inversion').fit(world.record(500, 4, scene))
    still = SENSOR.pipeline(world.config, 'inversion').fit(world.record(500, 4))
    cold = rms(judged(still, world.record(500, 5))[0])
    error, sigma = judged(warm, world.record(500, 5, scene))
    assert (rms(error) < 1.5 * cold).all()
    assert (np.abs(error) < 2 * sigma).mean() > 0.9
    if ramp_s:  # with dies turned, force tells the lag and pixels hardly do
        assert warm.report['disc']['thermal_lag'] == pytest.approx(world.lag_s, rel=0.05)


def test_one_temperature_tells_no_drift_and_sigmas_say_so() -> None:
    world = made.World(52, drift=DRIFT)
    pipeline = SENSOR.pipeline(world.config, 'inversion').fit(
        world.record(200, 4, made.Scene(span=0.01))
    )
    error, sigma = judged(pipeline, world.record(300, 5, made.Scene(span=5.0)))
    assert (np.abs(error) < 2 * sigma).mean() > 0.9
    still = judged(pipeline, world.record(300, 5, made.Scene(span=0.01)))[1]
    assert (np.median(sigma, axis=0) > 3 * np.median(still, axis=0)).all()


def test_a_baseline_tells_temperatures_of_chip_and_disc() -> None:
    rng = np.random.default_rng(0)
    level, warmer = 30e-3 * rng.normal(size=(2, 8)) * [[1.0], [0.02]]
    rest = WarmRest(AXES, np.array([1.0, -0.005, 0.0]), 35.0)
    rest.offset_ = np.stack([1e-4 * rng.normal(size=8), np.zeros(8)])

    def read(chip: float, disc: float) -> np.ndarray:
        field = level + warmer * disc / UNIT
        return np.asarray((1 - 0.005 * chip) * field + rest.offset_[0] * chip / UNIT)

    zero = np.zeros(10)
    rest.fit(np.tile(read(0.0, 0.0), (10, 1)), zero, zero, warmer)
    base = np.stack([read(10.0, 8.0), read(-12.0, -12.0)])
    told = UNIT * rest.temperatures(base)
    np.testing.assert_allclose(told, [[10.0, 8.0], [-12.0, -12.0]], atol=0.3)
    np.testing.assert_allclose(rest.usual_rest(base, told / UNIT), [level, level], atol=5e-6)


def test_an_oven_that_begins_to_heat_is_no_noise_of_the_thermometer() -> None:
    time = np.arange(600)
    rng = np.random.default_rng(0)
    chip = np.interp(time, [0, 100, 200, 300, 400, 600], [0, 40, 10, 50, 5, 5])
    signals = Signals(
        np.zeros((600, 4, 2)), np.zeros((600, 4, 2)), np.zeros((600, 4, 2)), None,
        time * 10**9, time == 0, np.zeros(600, np.int8), np.ones(600, bool),
    )  # fmt: skip
    assert thermometer_noise(signals, chip) < 1e-9
    noisy = thermometer_noise(signals, chip + 0.05 * rng.normal(size=600))
    assert noisy == pytest.approx(0.05, rel=0.2)


def test_a_calibration_that_lacks_what_temperatures_need_is_refused(tmp_path: Path) -> None:
    world, path = made.World(41), tmp_path / 'old.npz'
    SENSOR.pipeline(world.config, 'inversion').fit(world.record(60, 4)).save(path)
    arrays = read(path)
    names = arrays['estimation/features_/readings_.names']
    arrays['estimation/features_/readings_.names'] = names[names != 'rest_']
    write(path, arrays)
    with pytest.raises(CalibrationError, match='rest_'):
        SENSOR.load(path)


@pytest.mark.parametrize('bend', [None, np.zeros(7)])
def test_a_calibration_that_fails_beyond_its_temperatures_is_refused(
    bend: np.ndarray | None, tmp_path: Path
) -> None:
    world, path = made.World(41), tmp_path / 'hot.npz'
    recording = world.record(60, 4, made.Scene(span=20.0))
    SENSOR.pipeline(world.config, 'differences').fit(recording).save(path)
    SENSOR.load(path)
    arrays = read(path)
    target = 'estimation/targets_/0'
    if bend is None:
        names = arrays[f'{target}.names']
        arrays[f'{target}.names'] = names[names != 'bend_']
    else:
        arrays[f'{target}/bend_.array'] = bend
    write(path, arrays)
    with pytest.raises(CalibrationError, match='calibrate again'):
        SENSOR.load(path)


def warm_signals(chips: np.ndarray, second: np.ndarray) -> Signals:
    count = len(chips)
    values = np.zeros((count, chips.shape[1], 2))
    return Signals(
        values, values, values, chips, (1e9 * second).astype(np.int64), np.zeros(count, bool),
        np.zeros(count, np.int8), np.ones(count, bool),
    )  # fmt: skip


def test_beside_others_a_silent_chip_is_as_warm_as_it_was_for_four_seconds() -> None:
    nan = np.nan
    chips = np.array(
        [[nan, 20], [25, 21], [nan, nan], [nan, 22], [26, nan], [nan, nan], [nan, 30]]
    )
    second = np.array([0.0, 1.0, 2.0, 6.0, 7.0, 6.5, 7.5])
    wanted = [[nan, 20], [25, 21], [25, 21], [nan, 22], [26, 22], [nan, 22], [26, 30]]
    whole = StreamMemory(8.0).with_temperatures(warm_signals(chips, second))
    np.testing.assert_array_equal(whole.temperature_c, wanted)
    memory = StreamMemory(8.0)
    for i in range(len(chips)):
        one = memory.with_temperatures(warm_signals(chips[i : i + 1], second[i : i + 1]))
        np.testing.assert_array_equal(one.temperature_c, wanted[i : i + 1])


def test_a_warm_fit_learns_from_so_many_forces_at_most() -> None:
    rows = np.arange(5000)
    nothing = cast('Any', None)
    readings = cast('Any', SimpleNamespace(change=lambda _: np.zeros((5000, 8))))
    fit = WarmFit(nothing, readings, nothing, nothing, rows < 0, rows, np.ones((5000, 3)))
    assert len(fit.told) == MOST_FORCES
    assert (fit.told[0], fit.told[-1]) == (0, 4999)
    assert set(np.diff(fit.told)) <= {3, 4}
