"""A port that goes and comes back: how often it is tried, and what it cannot carry."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from tactile_ros.devices.serial_board import ReconnectingPort, check_capacity, wire_s
from tactile_ros.devices.simulated_serial import SimulatedSerialPort
from tactile_ros.devices.timestamps import VirtualClock


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> VirtualClock:
    """The time of pauses, and of nothing else."""
    virtual = VirtualClock()
    stand_in = SimpleNamespace(monotonic=lambda: virtual.now_ns() * 1e-9, sleep=virtual.sleep)
    monkeypatch.setattr('tactile_ros.devices.serial_board.time', stand_in)
    return virtual


def test_tries_are_spaced_by_growing_pauses(
    clock: VirtualClock, monkeypatch: pytest.MonkeyPatch
) -> None:
    with SimulatedSerialPort() as port:
        port.unplug()
        line = ReconnectingPort(port.port, 115200, lambda again: None)
        tries: list[float] = []
        real = line.open

        def counted() -> None:
            tries.append(clock.now_ns() * 1e-9)
            real()

        monkeypatch.setattr(line, 'open', counted)
        while clock.now_ns() < 4e9:
            assert line.take(10.0) == b''
        np.testing.assert_allclose(np.diff(tries)[:6], [0.05, 0.1, 0.2, 0.4, 0.5, 0.5])
        assert 'does not exist' in line.failure
        port.replug()
        came = clock.now_ns()
        while not line.is_open:
            line.take(10.0)
        assert clock.now_ns() - came <= 0.5e9
        line.close()


def test_a_short_timeout_waits_no_longer(clock: VirtualClock) -> None:
    with SimulatedSerialPort() as port:
        port.unplug()
        line = ReconnectingPort(port.port, 115200, lambda again: None)
        line.take(0.0)
        before = clock.now_ns()
        line.take(0.02)
        assert clock.now_ns() - before == pytest.approx(0.02e9, abs=10)


def test_only_openings_after_the_first_are_reconnections() -> None:
    told: list[bool] = []
    with SimulatedSerialPort() as port:
        line = ReconnectingPort(port.port, 115200, told.append)
        for _ in range(3):
            line.open()
            line.open()
            line.close()
    assert told == [False, True, True]
    assert line.reconnects == 2


def test_what_a_uart_carries() -> None:
    assert wire_s(38, 460800) == pytest.approx(38 * 10 / 460800)
    check_capacity('frames', 1152, 10.0, 115200)
    check_capacity('frames', 10**9, float('nan'), 115200)
    why = r'frames at 11 Hz must fit the port: they are 12672 bytes/s and 115200 baud carry 11520'
    with pytest.raises(ValueError, match=why):
        check_capacity('frames', 1152, 11.0, 115200)
