"""Ports by pyserial on real pseudo-terminals: every failure is one sentence."""

from __future__ import annotations

import errno
import sys
import time
from types import SimpleNamespace
from typing import TYPE_CHECKING

import pytest
import serial.tools.list_ports

from tactile_ros.devices import transport
from tactile_ros.devices.transport import SerialPort, list_ports
from tactile_ros.errors import DeviceError, MissingPackageError

if TYPE_CHECKING:
    from pathlib import Path

    from tactile_ros.devices.simulated import SimulatedSerialPort


@pytest.fixture
def two_ports(monkeypatch: pytest.MonkeyPatch) -> None:
    ports = [SimpleNamespace(device='/dev/ttyB'), SimpleNamespace(device='/dev/ttyA')]
    monkeypatch.setattr(serial.tools.list_ports, 'comports', lambda: ports)


def test_bytes_go_both_ways_untranslated(port: SimulatedSerialPort) -> None:
    everything = bytes(range(256)) + b'\r\n\r\r\n\n\x03\x04\x11\x13'
    line = SerialPort(port.port)
    line.open()
    port.send(everything)
    got = b''
    while len(got) < len(everything):
        got += line.read(5.0)
    assert got == everything
    line.write(b'z\r\n')
    assert port.received(5.0) == b'z\r\n'
    line.close()
    line.close()


def test_read_takes_what_there_is_and_waits_no_longer_than_asked(
    port: SimulatedSerialPort,
) -> None:
    line = SerialPort(port.port)
    line.open()
    start = time.monotonic()
    assert line.read(0.03) == b''
    assert 0.029 < time.monotonic() - start < 1.0
    port.send(b'abc')
    start = time.monotonic()
    assert line.read(10.0) == b'abc'
    assert time.monotonic() - start < 1.0
    line.close()


@pytest.mark.usefixtures('two_ports')
def test_a_missing_port_names_those_that_exist(tmp_path: Path) -> None:
    assert list_ports() == ['/dev/ttyA', '/dev/ttyB']
    with pytest.raises(
        DeviceError, match=r'nothing does not exist; ports here: /dev/ttyA, /dev/ttyB$'
    ):
        SerialPort(str(tmp_path / 'nothing')).open()


def test_no_port_at_all(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(serial.tools.list_ports, 'comports', list)
    with pytest.raises(DeviceError, match='no serial port now: plug the board in'):
        SerialPort('/nonexistent/port').open()


@pytest.mark.usefixtures('two_ports')
def test_a_busy_port_says_so(port: SimulatedSerialPort) -> None:
    first = SerialPort(port.port)
    first.open()
    with pytest.raises(DeviceError, match='is busy: close the program that reads it; ports here'):
        SerialPort(port.port).open()
    first.close()
    second = SerialPort(port.port)
    second.open()
    second.close()


@pytest.mark.usefixtures('two_ports')
def test_other_refusals() -> None:
    forbidden = transport._refusal('/dev/ttyA', PermissionError(errno.EACCES, 'no'))
    assert 'add the user to the group dialout' in forbidden
    with pytest.raises(DeviceError, match='port /dev/null cannot be opened'):
        SerialPort('/dev/null').open()


def test_unplugging_closes_the_port(port: SimulatedSerialPort) -> None:
    line = SerialPort(port.port)
    line.open()
    port.unplug()
    with pytest.raises(DeviceError, match='was unplugged'):
        line.read(1.0)
    assert not line.is_open
    with pytest.raises(DeviceError, match='is not open'):
        line.read(0.0)
    with pytest.raises(DeviceError, match='is not open'):
        line.write(b'z')


def test_pyserial_is_asked_for_where_it_is_needed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, 'serial', None)
    with pytest.raises(MissingPackageError, match='pip install pyserial'):
        SerialPort('/dev/ttyA').open()
