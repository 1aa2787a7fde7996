# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Simulated ports and twins of boards: pace, faults, and nothing left behind."""

import time
from pathlib import Path

import numpy as np
import pytest

from tactile_ros.devices.simulated_serial import (
    BYTE_FAULTS,
    ReskinTwin,
    SimulatedSerialPort,
    damage,
)
from tactile_ros.devices.transport import SerialPort
from tactile_ros.errors import DeviceError, DeviceTimeout
from tactile_ros.sensors.reskin_board.twin import ReskinBoardConnection
from tactile_ros.types import Array, Layout

STEP = 1e-7


def ramp(t: float) -> Array:
    """A field that grows by 4e-7 T in each period of 400 Hz."""
    return np.full((5, 3), 1e-3) + round(t * 400) * 4 * STEP


def make_reskin(layout: Layout, step: float = STEP) -> ReskinTwin:
    connection = ReskinBoardConnection(step=np.full(3, step))
    return connection.simulate(layout, ramp, 0.0, 0)  # type: ignore[return-value]


@pytest.mark.parametrize('kind', BYTE_FAULTS)
def test_damage_is_seeded_and_of_its_kind(kind: str) -> None:
    frame = np.random.default_rng(1).bytes(82)
    grows = {'dropped': -1, 'truncated': -1, 'doubled': 1, 'inserted': 1}.get(kind, 0)
    changed = 0
    for seed in range(50):
        damaged = damage(frame, kind, np.random.default_rng(seed))
        assert damaged == damage(frame, kind, np.random.default_rng(seed))
        assert np.sign(len(damaged) - len(frame)) == grows
        bits = int.from_bytes(damaged, 'big') ^ int.from_bytes(frame, 'big')
        assert kind != 'flipped' or bits.bit_count() == 1
        changed += damaged != frame
    assert changed > 40


def test_port_without_reader_loses_what_it_cannot_hold(port: SimulatedSerialPort) -> None:
    with pytest.raises(DeviceTimeout, match=r'nobody reads .* bytes were not taken'):
        port.send(bytes(100_000), timeout=0.05)


def test_port_waits_for_readers(port: SimulatedSerialPort) -> None:
    with pytest.raises(DeviceTimeout, match=r'nobody opened .* within 0\.01 s'):
        port.wait_for_reader(0.01)
    line = SerialPort(port.port)
    line.open()
    port.wait_for_reader(0.0)
    line.close()


def test_port_keeps_its_path_through_unplugging(port: SimulatedSerialPort) -> None:
    path = Path(port.port)
    assert path.exists()
    port.replug()
    port.unplug()
    assert not path.is_symlink()
    assert not port.watched
    with pytest.raises(DeviceError, match='is unplugged'):
        port.send(b'x')
    port.replug()
    assert path.exists()
    port.close()
    port.close()
    assert not path.parent.exists()


def test_twin_refuses_unknown_faults_and_missing_rates(layout: Layout) -> None:
    twin = make_reskin(layout)
    with pytest.raises(ValueError, match=r"fault must be one of dropped, .*; received 'nack'"):
        twin.inject('nack')
    with pytest.raises(ValueError, match='rate_hz of the layout of a twin must be above 0'):
        make_reskin(Layout(np.zeros((5, 3)), ('x', 'y', 'z'), 'T'))
    endless = make_reskin(Layout(np.zeros((5, 3)), ('x', 'y', 'z'), 'T', rate_hz=400.0))
    assert 'saturation' not in endless.faults
    assert 'saturation' in twin.faults


def test_reskin_twin_sends_whole_steps(layout: Layout) -> None:
    step = 3 * STEP  # the ramp is not on this grid
    twin = make_reskin(layout, step=step)
    with twin, twin.device(time.monotonic_ns) as board:
        counts = np.array([board.read(60.0).values for _ in range(5)]) / step
    np.testing.assert_allclose(counts, np.round(counts), atol=1e-3)
