"""The simulated port: bytes below the parser, and faults while it runs."""

from __future__ import annotations

import threading
from pathlib import Path

import numpy as np
import pytest

from tactile_ros.devices.reskin_protocol import encode
from tactile_ros.devices.serial_board import SerialBoard
from tactile_ros.devices.simulated_serial import SimulatedSerialPort
from tactile_ros.devices.transport import SerialPort
from tactile_ros.errors import DeviceError, DeviceTimeout
from tactile_ros.types import Layout


def test_nobody_reading_blocks_nobody(port: SimulatedSerialPort) -> None:
    with pytest.raises(DeviceTimeout, match=r'nobody reads .* bytes were not taken'):
        port.send(bytes(100_000), timeout=0.05)


def test_a_stream_that_nobody_reads_is_lost_as_on_a_board(
    port: SimulatedSerialPort, rows: np.ndarray
) -> None:
    full = threading.Event()

    def signal(t: float) -> np.ndarray:
        if port.overruns:
            full.set()
        return rows[0]

    port.stream(signal, 5000.0)
    assert full.wait(10.0)
    port.stop()
    assert port.overruns > 0


def test_readers_are_waited_for(port: SimulatedSerialPort) -> None:
    with pytest.raises(DeviceTimeout, match=r'nobody opened .* within 0\.01 s'):
        port.wait_for_reader(0.01)
    line = SerialPort(port.port)
    line.open()
    port.wait_for_reader(0.0)
    line.close()


def test_the_path_stays_and_goes(port: SimulatedSerialPort) -> None:
    path = Path(port.port)
    assert path.exists()
    port.replug()
    port.unplug()
    assert not path.is_symlink()
    with pytest.raises(DeviceError, match='is unplugged'):
        port.send(b'x')
    port.replug()
    assert path.exists()
    port.close()
    port.close()
    assert not path.parent.exists()


def test_faults_are_seeded_and_counted_in_writes(layout: Layout, rows: np.ndarray) -> None:
    def play(seed: int) -> bytes:
        with SimulatedSerialPort(seed) as port:
            line = SerialPort(port.port)
            line.open()
            port.inject('flipped', 2)
            port.inject('lost')
            for row in rows[:4]:
                port.send(encode(row))
            data = b''
            while len(data) < 3 * 82:
                data += line.read(5.0)
            line.close()
        return data

    data = play(7)
    assert data == play(7) != play(8)
    clean = encode(rows[:4])
    for i in range(2):
        ours, theirs = data[82 * i : 82 * i + 82], clean[82 * i : 82 * i + 82]
        bits = int.from_bytes(ours, 'big') ^ int.from_bytes(theirs, 'big')
        assert bits.bit_count() == 1
    assert data[164:] == clean[246:]


def test_unknown_faults_are_refused(port: SimulatedSerialPort) -> None:
    with pytest.raises(ValueError, match=r"fault must be one of dropped, .*; received 'gone'"):
        port.inject('gone')  # type: ignore[arg-type]


def test_a_signal_is_streamed_until_stopped(port: SimulatedSerialPort, board: SerialBoard) -> None:
    port.stream(lambda t: np.full((5, 3), 1e-3 * (1 + t)), 500.0, lambda t: np.full(5, 20.0 + t))
    with pytest.raises(DeviceError, match='streams already'):
        port.stream(lambda t: np.zeros((5, 3)), 1.0)
    frames = [board.read(2.0) for _ in range(20)]
    port.stop()
    port.stop()
    t = np.array([f.values[0, 0] for f in frames]) / 1e-3 - 1
    np.testing.assert_allclose(np.diff(t), 1 / 500, rtol=1e-3)
    assert frames[0].temperature_c is not None
    np.testing.assert_allclose(frames[0].temperature_c, 20.0 + t[0], rtol=1e-5)
