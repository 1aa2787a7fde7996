# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Real drivers over twins: what a signal says comes out within quantisation and noise."""

import dataclasses
import json
import time
from typing import Any

import numpy as np
import pytest

from tactile_ros.cli.main import main
from tactile_ros.sensors import SensorSpec, list_sensors, load_sensor
from tactile_ros.types import Frame, Twin

TWO_BUSES: dict[str, object] = {
    'transport': 'i2c', 'mode': 'burst', 'buses': ('a', 'b'), 'bus_of_chip': (0,) * 12 + (1,) * 8,
}  # fmt: skip


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


def test_chips_on_two_buses_keep_their_places() -> None:
    spec = load_sensor('multipole_skin')
    config: Any = dataclasses.replace(spec.config(), noise=0.0)  # type: ignore[type-var]
    wanted = pressed(spec, config)
    twin = spec.simulate(config, spec.connection(**TWO_BUSES), lambda t: wanted)
    for frame in frames_of(twin, 3):
        assert np.abs(frame.values - wanted).max() <= 0.51 * 0.9e-6  # of a step


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
