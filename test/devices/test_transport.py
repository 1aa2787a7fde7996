# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Ports on real pseudo-terminals, buses on real messages: every failure is one sentence."""

import errno
import os
import sys
import termios
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import pytest
import serial.tools.list_ports
import smbus2

from reference.wires import Wires
from tactile_ros.devices import transport
from tactile_ros.devices.simulated_serial import SimulatedSerialPort
from tactile_ros.devices.transport import I2cBus, SerialPort, list_ports
from tactile_ros.errors import DeviceError, DeviceTimeout, MissingPackageError, NotAcknowledged


@pytest.fixture
def line(port: SimulatedSerialPort) -> Iterator[SerialPort]:
    held = SerialPort(port.port)
    held.open()
    yield held
    held.close()


@pytest.fixture
def two_ports(monkeypatch: pytest.MonkeyPatch) -> None:
    ports = [SimpleNamespace(device='/dev/ttyB'), SimpleNamespace(device='/dev/ttyA')]
    monkeypatch.setattr(serial.tools.list_ports, 'comports', lambda: ports)


def test_serial_port_passes_all_bytes_untranslated(
    line: SerialPort, port: SimulatedSerialPort
) -> None:
    everything = bytes(range(256)) + b'\r\n\r\r\n\n\x03\x04\x11\x13'
    port.send(everything)
    got = b''
    while len(got) < len(everything):
        got += line.read(60.0)
    assert got == everything
    line.close()


def test_serial_port_reads_what_there_is_and_waits_no_longer(
    line: SerialPort, port: SimulatedSerialPort
) -> None:
    start = time.monotonic()
    assert line.read(0.03) == b''
    assert time.monotonic() - start > 0.029
    port.send(b'abc')
    start = time.monotonic()
    assert line.read(600.0) == b'abc'
    assert time.monotonic() - start < 60.0


@pytest.mark.usefixtures('two_ports')
def test_serial_port_names_the_ports_that_exist(tmp_path: Path) -> None:
    assert list_ports() == ['/dev/ttyA', '/dev/ttyB']
    why = 'nothing does not exist; ports here: /dev/ttyA, /dev/ttyB$'
    with pytest.raises(DeviceError, match=why):
        SerialPort(str(tmp_path / 'nothing')).open()


@pytest.mark.usefixtures('two_ports')
def test_serial_port_refuses_a_busy_one(port: SimulatedSerialPort) -> None:
    first = SerialPort(port.port)
    first.open()
    with pytest.raises(DeviceError, match='is busy: close the program that reads it; ports here'):
        SerialPort(port.port).open()
    first.close()
    second = SerialPort(port.port)
    second.open()
    second.close()


@pytest.mark.usefixtures('two_ports')
def test_serial_port_refuses_what_is_forbidden_or_no_port() -> None:
    forbidden = transport._refusal('port', 'dialout', '', PermissionError(errno.EACCES, 'no'))
    assert 'add the user to the group dialout' in str(forbidden)
    with pytest.raises(DeviceError, match='port /dev/null cannot be opened'):
        SerialPort('/dev/null').open()


def test_serial_port_closes_when_unplugged(line: SerialPort, port: SimulatedSerialPort) -> None:
    port.unplug()
    with pytest.raises(DeviceError, match='was unplugged'):
        line.read(1.0)
    assert not line.is_open
    with pytest.raises(DeviceError, match='is not open'):
        line.read(0.0)


def test_serial_port_undoes_settings_of_other_programs(
    line: SerialPort, port: SimulatedSerialPort
) -> None:
    other = os.open(port.port, os.O_RDWR | os.O_NOCTTY)  # no lock of files keeps it out
    settings = termios.tcgetattr(other)
    settings[6][termios.VMIN], settings[6][termios.VTIME] = 1, 0
    termios.tcsetattr(other, termios.TCSANOW, settings)
    os.close(other)
    told: list[bytes] = []
    reading = threading.Thread(target=lambda: told.append(line.read(0.25)), daemon=True)
    reading.start()
    reading.join(60.0)
    came_back = not reading.is_alive()
    port.send(b'z')  # what would be waited for
    reading.join(60.0)
    assert came_back
    assert told == [b'']


def test_serial_port_may_be_closed_while_it_is_read(
    line: SerialPort, port: SimulatedSerialPort
) -> None:
    take, inside = line._take, threading.Event()

    def closed(terminal: int) -> bytes:
        """Read from a port that is closed under the feet of whoever reads it."""
        inside.set()
        line.close()
        return take(terminal)

    line._take = closed  # type: ignore[method-assign]
    with pytest.raises(DeviceError, match='was unplugged or taken'):
        line.read(0.25)
    assert inside.is_set()


@pytest.mark.usefixtures('two_ports')
def test_serial_port_may_go_while_it_is_opened(
    port: SimulatedSerialPort, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Going(serial.Serial):
        """Unplugged as soon as it is open."""

        def open(self) -> None:
            super().open()
            port.unplug()

    monkeypatch.setattr(serial, 'Serial', Going)
    line = SerialPort(port.port)
    with pytest.raises(DeviceError, match='cannot be opened'):
        line.open()
    assert not line.is_open


@pytest.mark.parametrize(
    ('name', 'package', 'thing'),
    [('serial', 'pyserial', SerialPort('/dev/ttyA')), ('smbus2', 'smbus2', I2cBus('/dev/i2c-1'))],
)
def test_missing_packages_are_named(
    name: str, package: str, thing: SerialPort | I2cBus, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(MissingPackageError, match=f'pip install {package} '):
        thing.open()


def test_i2c_bus_transfers_in_one_transaction() -> None:
    wires = Wires()
    bus = I2cBus('wires', smbus=wires)
    bus.open()
    bus.open()
    for data, count in (
        (b'\x4f', 9),
        (b'\x4f', 9),
        (b'\x01', 0),
        (b'', 1),
        (b'\x60\x12\x34\x08', 1),
    ):
        assert bus.transfer(0x0C, data, count) == bytes(range(count))
        written = [(0x0C, 0, data)] * bool(data)
        assert wires.seen[-1][: len(written)] == written
        assert [m[:2] for m in wires.seen[-1][len(written) :]] == [(0x0C, 1)] * bool(count)
    bus.close()
    bus.close()
    assert wires.closed == 1
    with pytest.raises(DeviceError, match='bus wires is not open'):
        bus.transfer(0x0C, b'\x00', 1)


@pytest.mark.parametrize(
    ('failure', 'kind', 'sentence', 'stays_open'),
    [
        (errno.EREMOTEIO, NotAcknowledged, 'nothing answers at 0x0c on bus wires', True),
        (errno.ENXIO, NotAcknowledged, 'nothing answers at 0x0c', True),
        (errno.ETIMEDOUT, DeviceTimeout, 'bus wires is stuck: a chip holds its lines low', True),
        (errno.ENODEV, DeviceError, 'bus wires was unplugged', False),
        (errno.EIO, NotAcknowledged, 'nothing answers at 0x0c', True),
        (errno.EAGAIN, DeviceError, 'bus wires failed', True),
    ],
)
def test_i2c_bus_names_failures_of_a_transfer(
    failure: int, kind: type[DeviceError], sentence: str, stays_open: bool
) -> None:
    wires = Wires(failure)
    bus = I2cBus('wires', smbus=wires)
    bus.open()
    with pytest.raises(DeviceError, match=sentence) as caught:
        bus.transfer(0x0C, b'\x00', 1)
    assert type(caught.value) is kind
    assert wires.closed == (0 if stays_open else 1)


@pytest.mark.parametrize(
    ('failure', 'buses', 'sentence'),
    [
        (errno.ENOENT, ['/dev/i2c-1'], r'does not exist; buses here: /dev/i2c-1$'),
        (errno.EACCES, ['/dev/i2c-1'], 'add the user to the group i2c and log in again'),
        (errno.ENOENT, [], 'no I2C bus: enable it and load the module i2c-dev'),
    ],
)
def test_i2c_bus_says_what_to_do_where_it_cannot_be_opened(
    failure: int, buses: list[str], sentence: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(self: smbus2.SMBus, path: str) -> None:
        raise OSError(failure, 'no')

    monkeypatch.setattr(smbus2.SMBus, 'open', refuse)
    monkeypatch.setattr(transport, 'list_buses', lambda: buses)
    with pytest.raises(DeviceError, match=sentence):
        I2cBus('/dev/i2c-7').open()


def test_serial_port_asks_to_plug_a_board_in(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(serial.tools.list_ports, 'comports', list)
    with pytest.raises(DeviceError, match='no serial port now: plug the board in'):
        SerialPort('/nonexistent/port').open()


def test_i2c_bus_lets_go_of_what_is_none() -> None:
    with pytest.raises(DeviceError, match='bus /dev/null cannot be opened'):
        I2cBus('/dev/null').open()
