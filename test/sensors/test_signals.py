# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""The simple signals of the twins: plausible sizes and signs, truth that belongs to them."""

import dataclasses
from functools import lru_cache
from importlib import import_module

import numpy as np
import pytest

from tactile_ros.enrolment import Touches
from tactile_ros.sensors import load_sensor
from tactile_ros.types import Recording

# least and largest of the median change at full load (unit of values)
CHANGES = {
    'five_wire_skin': (0.2, 1.0), 'gradiometer': (1e-3, 20e-3), 'magnet_pad': (50e-6, 5e-3),
    'multipole_skin': (50e-6, 2e-3), 'reskin_board': (100e-6, 5e-3), 'taxel_array': (0.02, 0.9),
}  # fmt: skip


def touch(place: tuple[float, ...], force: tuple[float, ...]) -> Touches:
    """One frame of a press."""
    return Touches(np.array([0]), np.array([place]), np.array([force], float), np.ones(1))


def nothing() -> Touches:
    return Touches(np.array([-1]), np.full((1, 3), np.nan), np.zeros((1, 3)), np.zeros(1))


def model(key: str, touches: Touches) -> np.ndarray:
    values = import_module(f'tactile_ros.sensors.{key}.twin').reading(
        load_sensor(key).config(), touches
    )
    return np.asarray(values[0])


@lru_cache
def recorded(key: str, seed: int, count: int = 3) -> Recording:
    """Presses of a twin; not to be written."""
    spec = load_sensor(key)
    return spec.presses(spec.config(), seed, count)


@pytest.mark.parametrize('key', CHANGES)
class TestSignal:
    def test_presses_change_the_readings_and_saturate_nothing(self, key: str) -> None:
        spec = load_sensor(key)
        recording = recorded(key, 0)
        layout = spec.layout(spec.config())
        assert recording.layout.shape == layout.shape
        rest = recording.values[recording.tare].mean(axis=0)
        change = np.abs(recording.values - rest).max(axis=(1, 2))
        touched = recording.truth['in_contact'] == 1
        press = recording.truth['repetition']
        peaks = [change[touched & (press == i)].max() for i in np.unique(press[touched])]
        low, high = CHANGES[key]
        assert low < np.median(peaks) < high
        assert change[touched].mean() > 5 * change[~touched].mean()
        assert (np.abs(recording.values) < layout.saturation).all()

    def test_presses_have_seeds_and_counts(self, key: str) -> None:
        spec = load_sensor(key)
        one, other = recorded(key, 0), recorded(key, 1)
        np.testing.assert_array_equal(one.values, spec.presses(spec.config(), 0, 3).values)
        assert (one.values != other.values).any()
        assert set(one.truth['repetition']) == {0, 1, 2}
        for name, column in one.truth.items():
            assert len(column) == len(one), name

    def test_truth_is_blank_where_nothing_touches(self, key: str) -> None:
        recording = recorded(key, 0)
        free = recording.truth['in_contact'] == 0
        for name, column in recording.truth.items():
            if name in ('position', 'yaw'):
                assert np.isnan(column[free].astype(float)).all()
            elif name in ('cell', 'label'):
                assert (column[free] == -1).all()
            elif name in ('force', 'torque', 'taxel_force'):
                assert not np.nan_to_num(column[free].astype(float)).any()

    def test_more_taxels_and_other_rates(self, key: str) -> None:
        spec = load_sensor(key)
        config = spec.config()
        positions = np.concatenate([config.positions, config.positions + 1e-3])  # type: ignore[attr-defined]
        config = dataclasses.replace(config, positions=positions, rate_hz=25.0)  # type: ignore[type-var]
        recording = spec.presses(config, 0, 2)
        assert recording.values.shape[1] == len(positions)
        assert np.isfinite(recording.values).all()


def test_a_press_brings_the_disc_nearer_and_shear_moves_it() -> None:
    rest = model('gradiometer', nothing())
    pressed = model('gradiometer', touch((0, 0, 4e-3), (0, 0, 1.0)))
    # all four pixels see more of Bz, and more of the field lines that return to the disc
    assert (pressed[:, 1] > rest[:, 1]).all()
    x = load_sensor('gradiometer').config().positions[:, 0]  # type: ignore[attr-defined]
    assert (np.sign(pressed[:, 0] - rest[:, 0]) == -np.sign(x)).all()
    # the skin pulls the object back to -x: it was dragged to +x
    dragged = model('gradiometer', touch((0, 0, 4e-3), (-0.3, 0, 0)))
    assert (dragged[x > 0, 1] > rest[x > 0, 1]).all()
    assert (dragged[x < 0, 1] < rest[x < 0, 1]).all()


def test_the_gradiometer_tells_torque_of_force_on_its_top() -> None:
    spec = load_sensor('gradiometer')
    truth = spec.presses(spec.config(), 0, 6).truth
    force, torque = truth['force'], truth['torque']
    arm = np.array([0, 0, 4e-3])
    np.testing.assert_allclose(torque[:, :2], np.cross(arm, force)[:, :2], atol=1e-12)
    assert np.isnan(torque[:, 2].astype(float)).all()


def test_the_pad_names_the_cell_that_is_pressed() -> None:
    spec = load_sensor('magnet_pad')
    config = spec.config()
    recording = spec.presses(config, 0, len(config.cells))  # type: ignore[attr-defined]
    touched = recording.truth['in_contact'] == 1
    assert set(recording.truth['cell'][touched]) == set(range(len(config.cells)))  # type: ignore[attr-defined]
    place = recording.truth['position'][touched]
    np.testing.assert_allclose(np.hypot(place[:, 1], place[:, 2]), 10e-3)
    outward = place * [0, 1, 1]
    np.testing.assert_allclose(np.cross(outward, recording.truth['force'][touched]), 0, atol=1e-9)


def test_taxels_carry_the_whole_load_and_rise_with_it() -> None:
    config = load_sensor('taxel_array').config()
    module = import_module('tactile_ros.sensors.taxel_array.twin')
    place = tuple(config.positions[3])  # type: ignore[attr-defined]
    light, heavy = touch(place, (0, 0, 2.0)), touch(place, (0, 0, 20.0))
    assert module.taxel_forces(config, heavy).sum() == pytest.approx(20.0)
    assert model('taxel_array', heavy)[3] > model('taxel_array', light)[3] > 0
    assert model('taxel_array', heavy).argmax() == 3
    assert not model('taxel_array', nothing()).any()
    gains = module.gains(16)
    assert 1.3 < gains.max() / gains.min() <= 1.55


def test_potentials_of_the_five_wires_are_linear_and_force_lowers_resistance() -> None:
    corners = {(0, 0): (1, 0.5), (0.1, 0): (0.5, 1), (0, 0.1): (0.5, 0), (0.1, 0.1): (0, 0.5)}
    for (x, y), wanted in corners.items():
        read = model('five_wire_skin', touch((x, y, 0), (0, 0, 5.0)))[0]
        np.testing.assert_allclose(read[:2], wanted, atol=1e-12)
    light = model('five_wire_skin', touch((0.05, 0.05, 0), (0, 0, 1.0)))[0]
    heavy = model('five_wire_skin', touch((0.05, 0.05, 0), (0, 0, 15.0)))[0]
    np.testing.assert_allclose(light[:2], [0.5, 0.5])
    assert 0 < light[2] < heavy[2] < 1
    assert not model('five_wire_skin', nothing()).any()


@pytest.mark.parametrize('key', ['gradiometer', 'magnet_pad', 'multipole_skin', 'reskin_board'])
def test_turned_chips_read_in_their_own_axes(key: str) -> None:
    spec = load_sensor(key)
    config = spec.config()
    taxels = len(config.positions)  # type: ignore[attr-defined]
    half = np.tile(np.diag([-1.0, -1, 1]), (taxels, 1, 1))
    turned = dataclasses.replace(config, rotations=half)  # type: ignore[type-var]
    one, other = (spec.presses(c, 0, 1, noise=0.0).values for c in (config, turned))
    sign = [-1, 1] if key == 'gradiometer' else [-1, -1, 1]
    np.testing.assert_allclose(other, one * sign, atol=1e-15)
