"""What this machine offers to sensors: ports, buses, packages, and who may use them."""

from __future__ import annotations

import importlib.util
import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from tactile_ros.devices.mlx90393 import MUX_ADDRESSES, Command
from tactile_ros.errors import DeviceError, NotAcknowledged

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tactile_ros.devices.transport import I2cBus

OK, NOTE, WARN, BAD = 'ok', 'note', 'warn', 'bad'
CHIP_ADDRESSES = range(0x0C, 0x1C)  # of all variants of the MLX90393
MOST_LATENCY_MS = 1
RULES = '/etc/udev/rules.d/60-tactile.rules'
PACKAGES = {
    'serial': 'serial ports need pyserial: pip install pyserial',
    'smbus2': 'I2C buses need smbus2: pip install smbus2',
    'rclpy': 'nodes need ROS 2: source its setup.bash',
}


@dataclass(frozen=True)
class Finding:
    """One thing that was looked at.

    Attributes
    ----------
    where : str
        Port, bus, package, or quantity.
    state : str
        ok; note: nothing to do; warn: works, but should be changed; bad: does not work.
    what : str
        What was found.
    remedy : str
        What to do, in one sentence; empty: nothing.
    """

    where: str
    state: str
    what: str
    remedy: str = ''


def packages() -> list[Finding]:
    """Optional packages that sensors and nodes need."""
    found = []
    for name, remedy in PACKAGES.items():
        there = importlib.util.find_spec(name) is not None
        what = 'installed' if there else 'not installed'
        found.append(Finding(name, OK if there else WARN, what, '' if there else remedy))
    return found


def permission(path: Path, group: str, rule: str) -> Finding:
    """Whether this user may read and write a device file, and otherwise how to allow it.

    Parameters
    ----------
    path : Path
        Of the device file.
    group : str
        That such files usually belong to.
    rule : str
        udev rule that gives the file to that group.
    """
    if not path.exists():
        return Finding(str(path), BAD, 'does not exist', 'plug it in, or name another one')
    if os.access(path, os.R_OK | os.W_OK):
        return Finding(str(path), OK, 'may be read and written')
    try:
        owner = path.group()
    except KeyError:  # a group without a name, as in containers
        owner = str(path.stat().st_gid)
    if owner in ('root', 'nogroup'):
        remedy = (
            f"put the udev rule '{rule}' into {RULES}, reload by `sudo udevadm control --reload`"
        )
        return Finding(str(path), BAD, f'belongs to the group {owner}', remedy + ' and replug')
    remedy = f'add yourself to its group: `sudo usermod -aG {owner} $USER`, and log in again'
    return Finding(str(path), BAD, f'only the group {owner or group} may use it', remedy)


def port_rule(name: str, root: Path) -> str:
    """Rule (udev) for the port of a name such as ttyACM0."""
    match = 'SUBSYSTEM=="tty"'
    device = root / 'sys/class/tty' / name / 'device'
    for folder in (device / '..', device / '../..', device / '../../..'):
        vendor, product = folder / 'idVendor', folder / 'idProduct'
        if vendor.is_file() and product.is_file():
            ids = vendor.read_text().strip(), product.read_text().strip()
            match += f', ATTRS{{idVendor}}=="{ids[0]}", ATTRS{{idProduct}}=="{ids[1]}"'
            break
    return f'{match}, GROUP="dialout", MODE="0660"'


def latency(name: str, root: Path) -> Finding | None:
    """How long the USB converter of a port keeps bytes back; None where it has no such timer."""
    timer = root / 'sys/class/tty' / name / 'device/latency_timer'
    if not timer.is_file():
        return None
    text = timer.read_text().strip()
    milliseconds = int(text) if text.isdigit() else 0
    what = f'its converter keeps bytes back for up to {milliseconds} ms'
    if milliseconds <= MOST_LATENCY_MS:
        return Finding(f'/dev/{name} latency', OK, what)
    remedy = (
        f'write 1 into {timer} as root, and for ever by the udev rule '
        f'\'ACTION=="add", SUBSYSTEM=="usb-serial", DRIVER=="ftdi_sio", '
        f'ATTR{{latency_timer}}="1"\' in {RULES}'
    )
    return Finding(f'/dev/{name} latency', WARN, what, remedy)


def serial_ports(names: Sequence[str], root: Path = Path('/')) -> list[Finding]:
    """Every serial port: permission and latency timer."""
    found: list[Finding] = []
    for name in names:
        path = root / name.lstrip('/')
        found.append(permission(path, 'dialout', port_rule(path.name, root)))
        timer = latency(path.name, root)
        found += [timer] if timer is not None else []
    return found or [
        Finding('serial ports', NOTE, 'this machine has none', 'plug a board in, if you have one')
    ]


def buses(names: Sequence[str]) -> list[Finding]:
    """Every I2C bus: permission."""
    rule = 'KERNEL=="i2c-[0-9]*", GROUP="i2c", MODE="0660"'
    found = [permission(Path(name), 'i2c', rule) for name in names]
    remedy = 'where chips are wired to this machine: enable the bus and load the module i2c-dev'
    return found or [Finding('I2C buses', NOTE, 'this machine shows none', remedy)]


def probe(bus: I2cBus) -> Finding:
    """Who answers on a bus: NOP to the addresses of the chips, one byte read from switches.

    Neither changes anything in a chip or switch of these kinds.
    """
    try:
        bus.open()
        chips = [a for a in CHIP_ADDRESSES if _answers(bus, a, bytes((Command.NOP,)))]
        switches = [a for a in MUX_ADDRESSES if _answers(bus, a, b'')]
    except DeviceError as err:
        return Finding(bus.path, BAD, 'cannot be asked', str(err))
    finally:
        bus.close()
    named = [f'{a:#04x}' for a in chips] + [f'{a:#04x} (switch)' for a in switches]
    if named:
        return Finding(bus.path, OK, f'answers come from {", ".join(named)}')
    remedy = 'check power, ground, SDA and SCL, and pull-ups of the chips'
    return Finding(bus.path, WARN, 'nobody answers at the addresses of chips and switches', remedy)


def _answers(bus: I2cBus, address: int, data: bytes) -> bool:
    """Whether somebody acknowledges an address."""
    try:
        bus.transfer(address, data, 1)
    except NotAcknowledged:
        return False
    return True
