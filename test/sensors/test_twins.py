# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Real drivers over twins: what a signal says comes out within quantisation and noise."""

import dataclasses
import json
import time
from typing import Any

import numpy as np
import pytest

from tactile_ros.cli.main import main
from tactile_ros.errors import DeviceError
from tactile_ros.sensors import SensorSpec, list_sensors, load_sensor
from tactile_ros.types import Frame, Twin

TWO_BUSES: dict[str, object] = {
    'transport': 'i2c', 'mode': 'burst', 'buses': ('a', 'b'), 'bus_of_chip': (0,) * 12 + (1,) * 8,
}  # fmt: skip
# sensor, how it is connected, largest step of a reading (unit of values), rate of the twin (Hz)
ROADS: list[tuple[str, dict[str, object], float, float]] = [
    ('reskin_board', {}, 1e-9, 200.0),
    ('multipole_skin', {'transport': 'i2c'}, 0.9e-6, 80.0),
    ('multipole_skin', {'transport': 'serial'}, 0.9e-6, 80.0),
    ('multipole_skin', TWO_BUSES, 0.9e-6, 80.0),
    ('magnet_pad', {'transport': 'i2c'}, 2e-6, 200.0),
    ('magnet_pad', {'transport': 'serial'}, 2e-6, 200.0),
    ('gradiometer', {}, 2.5e-6, 1000.0),
    ('taxel_array', {}, 1 / 1023, 200.0),
    ('five_wire_skin', {}, 1 / 4095, 200.0),
]  # fmt: skip
NAMES = [
    f'{key}-{"-".join(str(x) for x in how.values() if isinstance(x, str))}'
    for key, how, *_ in ROADS
]


def pressed(spec: SensorSpec, config: object) -> np.ndarray:
    """Readings in the middle of the first press, without noise."""
    plain = spec.presses(config, 0, 1, noise=0.0)
    row = round(1.5 * plain.layout.rate_hz)
    assert plain.truth['in_contact'][row] == 1
    return plain.values[row]


def frames_of(twin: Twin, count: int) -> list[Frame]:
    """Frames that the real driver reads."""
    with twin, twin.device(time.monotonic_ns) as device:
        return [device.read(60.0) for _ in range(count)]


@pytest.mark.parametrize(('key', 'how', 'step', 'rate_hz'), ROADS, ids=NAMES)
def test_twin_signal_comes_out_of_the_real_driver(
    key: str, how: dict[str, object], step: float, rate_hz: float
) -> None:
    spec = load_sensor(key)
    config: Any = dataclasses.replace(spec.config(), noise=0.0, rate_hz=rate_hz)  # type: ignore[type-var]
    wanted = pressed(spec, config)
    frames = frames_of(spec.simulate(config, spec.connection(**how), lambda t: wanted), 12)
    for frame in frames:
        assert np.abs(frame.values - wanted).max() <= 0.51 * step
        assert frame.values.shape == spec.layout(config).shape
    sequence = np.array([frame.sequence for frame in frames])
    assert (np.diff(sequence) >= 1).all()  # a busy machine loses some
    stamps = np.array([frame.stamp_ns for frame in frames], np.int64)
    assert (np.diff(stamps) > 0).all()
    if spec.layout(config).unit == 'T':
        assert frames[-1].temperature_c is not None
        assert np.abs(frames[-1].temperature_c - 25).max() < 1


@pytest.mark.parametrize('key', list_sensors())
def test_twin_without_a_signal_plays_its_own(key: str) -> None:
    spec = load_sensor(key)
    config: Any = dataclasses.replace(spec.config(), noise=0.0, rate_hz=50.0)  # type: ignore[type-var]
    played = spec.presses(config, 0, noise=0.0).values
    twin = spec.simulate(config, spec.connection())
    assert twin.faults
    assert set(twin.injected) == set(twin.faults)
    (frame,) = frames_of(twin, 1)
    # the beginning, unless this machine was busy; counts have steps
    miss = np.abs(played - frame.values).max(axis=(1, 2)).min()
    assert miss < {'T': 2e-6, '1': 1e-3}[spec.layout(config).unit]
    with pytest.raises(ValueError, match=r"fault must be one of .*; received 'flood'"):
        twin.inject('flood')


@pytest.mark.parametrize('key', list_sensors())
def test_sensor_names_a_missing_port(key: str) -> None:
    spec = load_sensor(key)
    device = spec.open(spec.config(), spec.connection(port='/dev/no_such_port'), time.monotonic_ns)
    missing = spec.connection(port='/dev/no_such_port')
    if hasattr(missing, 'buses'):
        missing = dataclasses.replace(missing, buses=('/dev/i2c-9999',))
        device = spec.open(spec.config(), missing, time.monotonic_ns)
    with pytest.raises(DeviceError, match=r'/dev/\S+ does not exist; ') as failed, device:
        pass
    assert '\n' not in str(failed.value)


def test_gradiometer_has_four_pixels_on_the_wire() -> None:
    spec = load_sensor('gradiometer')
    config: Any = dataclasses.replace(spec.config(), positions=np.zeros((6, 3)))  # type: ignore[type-var]
    with pytest.raises(ValueError, match=r'must have shape \(4, 2\); received \(6, 2\)'):
        spec.open(config, spec.connection(), time.monotonic_ns)


def test_list_shows_all_sensors(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(['list', '--json']) == 0
    rows = {row['sensor']: row for row in json.loads(capsys.readouterr().out)}
    assert list(rows) == list_sensors()
    papers = {
        'multipole_skin': '[1]', 'magnet_pad': '[2]', 'gradiometer': '[3]', 'taxel_array': '[4]',
        'five_wire_skin': '[5]', 'reskin_board': 'ReSkin',
    }  # fmt: skip
    for key, paper in papers.items():
        assert paper in rows[key]['paper']
        assert 'erial' in rows[key]['transports']
        assert 'port /dev/ttyACM0 at ' in rows[key]['connect']
        assert rows[key]['connect'].endswith(f'docs/{key}.md')
    for key in ('multipole_skin', 'magnet_pad'):
        assert 'I2C' in rows[key]['transports']
        assert rows[key]['connect'].startswith('buses /dev/i2c-1 or port')
    assert main(['list']) == 0
    shown = capsys.readouterr().out
    assert all(key in shown for key in papers)
