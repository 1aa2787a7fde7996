# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Serial ports by pyserial and I2C buses by smbus2, opened lazily; a failure is one sentence."""

from __future__ import annotations

import errno
import fcntl
import os
import select
import termios
import time
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from tactile_ros.errors import DeviceError, DeviceTimeout, NotAcknowledged, load_package

if TYPE_CHECKING:
    import serial
    from smbus2 import i2c_msg

    I2cMessage = i2c_msg

READ_BYTES = 4096
WAITS_S = 0.1  # the least that terminals wait for
LOOK_S = 1.0
I2C_TIMEOUT, I2C_TIMEOUT_10MS = 0x0702, 2  # linux/i2c-dev.h; how long an adapter may hold on
SERIAL = ('serial ports need pyserial', 'pyserial (or apt install python3-serial)')
SMBUS2 = ('I2C buses need smbus2', 'smbus2 (or apt install python3-smbus2)')


def list_ports() -> list[str]:
    """Names of the serial ports that this machine has."""
    return sorted(
        port.device for port in load_package('serial.tools.list_ports', *SERIAL).comports()
    )


def list_buses() -> list[str]:
    """Paths of the I2C buses that this machine has."""
    return sorted(str(path) for path in Path('/dev').glob('i2c-*'))


def _port_choice() -> str:
    nothing = 'this machine has no serial port now: plug the board in'
    return f'ports here: {", ".join(ports)}' if (ports := list_ports()) else nothing


def _bus_choice() -> str:
    nothing = 'this machine shows no I2C bus: enable it and load the module i2c-dev'
    return f'buses here: {", ".join(buses)}' if (buses := list_buses()) else nothing


def _refusal(what: str, group: str, choice: str, err: OSError) -> DeviceError:
    """Error of a port or bus that could not be opened: why, and what to do."""
    why = f'cannot be opened ({os.strerror(err.errno) if err.errno else err})'
    if err.errno in (errno.ENOENT, errno.ENODEV, errno.ENXIO):
        why = 'does not exist'
    elif err.errno in (errno.EAGAIN, errno.EBUSY):
        why = 'is busy: close the program that reads it'
    elif err.errno in (errno.EACCES, errno.EPERM):
        why = f'may not be opened by this user: add the user to the group {group} and log in again'
    return DeviceError(f'{what} {why}; {choice}')


class SerialPort:
    """A serial port that is read by one program, blocking and without busy waiting.

    A path under /dev/serial/by-id survives replugging. Reads wait at most `WAITS_S` for their
    first byte: no call but such reads lets go of Python's lock, and a busy thread takes it at each
    call more.
    """

    def __init__(self, port: str, baud: int = 115200) -> None:
        self.port = port
        self.baud = baud
        self._serial: serial.Serial | None = None
        self._poll = select.poll()
        self._wanted: list[int | list[bytes | int]] = []  # settings of the terminal
        self._due_s = 0.0  # when they are looked at again

    @property
    def is_open(self) -> bool:
        """True while the port is held."""
        return self._serial is not None

    def open(self) -> None:
        """Hold the port for this program alone, and discard what it had received before.

        A DeviceError says that it is missing, busy or forbidden.
        """
        if self._serial is not None:
            return
        pyserial, device = load_package('serial', *SERIAL), None
        try:
            device = pyserial.Serial(self.port, self.baud, timeout=0, exclusive=True)
            terminal = device.fileno()
            wanted = termios.tcgetattr(terminal)
            wanted[6][termios.VMIN], wanted[6][termios.VTIME] = 0, round(10 * WAITS_S)
            termios.tcsetattr(terminal, termios.TCSANOW, wanted)
            os.set_blocking(terminal, True)
            self._wanted = termios.tcgetattr(terminal)
        except (OSError, ValueError, termios.error) as err:  # also of a port that goes meanwhile
            if device is not None:
                device.close()
            failure = err if isinstance(err, OSError) else OSError(*err.args)
            name = f'port {self.port}'
            raise _refusal(name, 'dialout', _port_choice(), failure) from err
        self._serial, self._poll, self._due_s = device, select.poll(), 0.0
        self._poll.register(terminal, select.POLLIN)

    def close(self) -> None:
        """Let the port go; closing twice is allowed."""
        device, self._serial = self._serial, None
        if device is not None:
            device.close()

    def read(self, timeout: float) -> bytes:
        """Take all bytes that come within `timeout` (s), 0.1 s at most, up to 4096.

        A DeviceError says that the port is not open or is gone; it is closed then.
        """
        device, poll = self._serial, self._poll  # here still where another thread closes
        if device is None:
            msg = f'port {self.port} is not open'
            raise DeviceError(msg)
        try:
            if timeout < WAITS_S and not poll.poll(max(0.0, timeout) * 1e3):
                return b''
            terminal = device.fileno()
            data = self._take(terminal)
            if not data and poll.poll(0):  # gone, unless bytes have come between the two
                data = self._take(terminal)
                if not data:
                    raise self._lost()
        except (OSError, termios.error) as err:
            raise self._lost() from err
        return data

    def _take(self, terminal: int) -> bytes:
        """Take what comes in time; none where nothing does, or the device is gone.

        Other programs may open the port all the same and let reads wait for ever; that is undone.
        """
        if time.monotonic() >= self._due_s and termios.tcgetattr(terminal) != self._wanted:
            termios.tcsetattr(terminal, termios.TCSANOW, self._wanted)
        data = os.read(terminal, READ_BYTES)
        # while bytes come every read returns: now and then is enough
        self._due_s = time.monotonic() + LOOK_S if data else 0.0
        return data

    def _lost(self) -> DeviceError:
        self.close()
        why = 'was unplugged or taken by another program'
        return DeviceError(f'port {self.port} {why}; {_port_choice()}')


class BusMaster(Protocol):
    """Carrier of messages: an smbus2.SMBus, or what stands in for it."""

    def i2c_rdwr(self, *messages: I2cMessage) -> None:
        """Carry messages in one transaction, a repeated start between them."""
        ...

    def close(self) -> None:
        """Let the bus go."""
        ...


class I2cBus:
    """An I2C bus whose transfers are combined transactions (a true repeated start).

    `path` is the device, such as /dev/i2c-1, or a name for sentences where `smbus` carries
    messages.
    """

    def __init__(self, path: str, smbus: BusMaster | None = None) -> None:
        self.path = path
        self._given = smbus
        self._master: BusMaster | None = None
        self._messages: dict[tuple[int, bytes, int], tuple[I2cMessage, ...]] = {}

    def open(self) -> None:
        """Hold the bus; DeviceError where it is missing or forbidden."""
        if self._master is not None:
            return
        smbus2 = load_package('smbus2', *SMBUS2)
        if self._given is not None:
            self._master = self._given
            return
        bus = smbus2.SMBus()
        try:
            bus.open(self.path)
            # the kernel waits a whole second for a stuck bus otherwise
            fcntl.ioctl(bus.fd, I2C_TIMEOUT, I2C_TIMEOUT_10MS)
        except OSError as err:
            bus.close()
            name = f'bus {self.path}'
            raise _refusal(name, 'i2c', _bus_choice(), err) from err
        self._master = bus

    def close(self) -> None:
        """Let the bus go; closing twice is allowed."""
        master, self._master = self._master, None
        if master is not None:
            master.close()

    def transfer(self, address: int, data: bytes, count: int) -> bytes:
        """Write bytes to a chip and read `count` of its answer in one transaction; or either.

        NotAcknowledged says that no chip answers to the address, DeviceTimeout that the bus is
        stuck, DeviceError that it is not open, fails, or is gone and closed.
        """
        if self._master is None:
            msg = f'bus {self.path} is not open'
            raise DeviceError(msg)
        messages = self._messages.get((address, data, count)) or self._build(address, data, count)
        try:
            self._master.i2c_rdwr(*messages)
        except OSError as err:
            raise self._failure(address, err) from err
        return bytes(messages[-1]) if count else b''

    def _build(self, address: int, data: bytes, count: int) -> tuple[I2cMessage, ...]:
        """Messages of a transfer; those of commands are kept, since they come again."""
        message = load_package('smbus2', *SMBUS2).i2c_msg
        parts = [message.write(address, data)] if data else []
        parts += [message.read(address, count)] if count else []
        if len(data) <= 1:
            self._messages[address, data, count] = tuple(parts)
        return tuple(parts)

    def _failure(self, address: int, err: OSError) -> DeviceError:
        # EIO: adapters report it that tell no causes
        if err.errno in (errno.EREMOTEIO, errno.ENXIO, errno.EIO):
            return NotAcknowledged(
                f'nothing answers at {address:#04x} on bus {self.path}: '
                'check power, wires and the address of the chip'
            )
        if err.errno == errno.ETIMEDOUT:
            return DeviceTimeout(
                f'bus {self.path} is stuck: a chip holds its lines low; '
                'check the pull-ups and the wires, switch the chips off and on'
            )
        if err.errno in (errno.ENODEV, errno.ENOENT, errno.EBADF, errno.ESHUTDOWN):
            self.close()
            return DeviceError(f'bus {self.path} was unplugged; {_bus_choice()}')
        return DeviceError(f'bus {self.path} failed ({err}); {_bus_choice()}')
