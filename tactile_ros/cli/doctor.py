# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Look at ports, permissions, buses and a sensor, or at a bag, and say what to do.

Nothing is written anywhere. `--probe` asks every I2C bus who answers (NOP and a read of one byte);
`--sensor` opens that sensor with its driver and reads it for a few seconds.

Of a bag (folder, .mcap or .db3) it shows topics, rates and definitions, frames that are lost,
repeated or out of time, dead taxels, damage, and what a replay leaves out. `--repair` saves what
can still be read of a torn bag into a new one.

example:
  tactile doctor
  tactile doctor my_bag
  tactile doctor my_bag --repair out/saved
  tactile doctor --sensor reskin_board --port /dev/ttyACM0
  tactile doctor --sensor gradiometer --simulated
  tactile doctor --sensor magnet_pad --set buses=[/dev/i2c-3] --probe --json
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import os
import sys
import time
from argparse import ArgumentTypeError
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path

import numpy as np

from tactile_ros import errors
from tactile_ros.cli.console import as_objects, note, refuse_no_new_folder, show, working
from tactile_ros.devices.connections import SerialConnection
from tactile_ros.devices.mlx90393 import MUX_ADDRESSES, Command
from tactile_ros.devices.transport import I2cBus, list_buses, list_ports
from tactile_ros.evaluation.bag_check import BagCheck, FrameCheck, check_bag, repair_bag
from tactile_ros.files import read_yaml
from tactile_ros.sensors import load_sensor
from tactile_ros.types import Array, Device, Frame, Layout, SensorConfig, TaxelStatus

OK, NOTE, WARN, BAD = 'ok', 'note', 'warn', 'bad'
LONGEST_S, READ_S = 3600, 0.5
CHIP_ADDRESSES = range(0x0C, 0x1C)  # of all variants of the MLX90393
MOST_LATENCY_MS = 1
ADVICE = 'save what can be read: `tactile doctor BAG --repair OUT`'
RULES = '/etc/udev/rules.d/60-tactile.rules'
SLOW, IRREGULAR, NOISY = 0.8, 0.5, 10.0  # of the nominal rate, of a period, of the usual noise
RARELY = 0.05  # a quiet chip repeats itself now and then
TO_SIGMA = 1.4826 / np.sqrt(6)  # median of |second differences| -> standard deviation
PACKAGES = {
    'serial': 'serial ports need pyserial: pip install pyserial',
    'smbus2': 'I2C buses need smbus2: pip install smbus2',
    'rclpy': 'nodes need ROS 2: source its setup.bash',
}
TROUBLES = {
    'nacks': 'check the wires and the addresses of the chips',
    'resets': 'check the supply: chips lose it for moments',
    'bus_errors': 'check pull-ups and wires of the bus',
    'stalls': 'check the supply, the wires, and what holds this machine up',
    'crc_errors': 'check cable and baud rate: bytes arrive damaged',
    'framing_errors': 'check cable and baud rate: bytes arrive damaged',
    'dropped': 'close what else uses the processor, or lower the rate: frames are lost',
    'malformed': 'check cable and baud rate: lines arrive damaged, or are no readings',
    'reconnects': 'check the plug: the port comes and goes',
    'temperatures_refused': 'check the board: it sends temperatures that no chip can have',
    'clock_jumps': 'check the supply of the board: its clock jumps',
}
MARKS = {
    TaxelStatus.SATURATED: 'lower the gain, or keep magnets away',
    TaxelStatus.WRAPPED: 'lower the gain, or keep magnets away',
    TaxelStatus.STUCK: 'switch the sensor off and on; replace what stays stuck',
    TaxelStatus.ERROR: 'check the wires and the supply of these taxels',
    TaxelStatus.STALE: 'lower the rate of the board: it outruns its chips',
}


@dataclass(frozen=True)
class Finding:
    """One thing that was looked at."""

    where: str  # port, bus, package, or quantity
    state: str  # ok; note: nothing to do; warn: works, but should be changed; bad: does not work
    what: str
    remedy: str = ''  # in one sentence; empty: nothing


@dataclass(frozen=True)
class DeviceCheck:
    """Frames and counters of a few seconds of reading."""

    layout: Layout
    frames: list[Frame]
    failure: str  # why it could not be opened or fell silent; empty: it did not
    counters: dict[str, int]  # of the driver


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `tactile doctor`."""
    parser.add_argument('bag', nargs='?', type=Path, help='bag to look at: folder, .mcap or .db3')
    parser.add_argument('--repair', type=Path, metavar='OUT', help='new folder for what is saved')
    parser.add_argument('--sensor', help='read this sensor for a few seconds')
    parser.add_argument('--simulated', action='store_true', help='read a simulated one instead')
    parser.add_argument('--seed', type=int, default=0, help='seed of the simulated one')
    parser.add_argument('--fault', default='', help='fault of it: name or name:count')
    parser.add_argument('--port', help='port or I2C bus of the sensor')
    parser.add_argument(
        '--set', action='append', default=[], metavar='NAME=VALUE',
        help='another field of its connection or config',
    )  # fmt: skip
    parser.add_argument('--seconds', type=duration, default=3.0, help='how long it is read')
    parser.add_argument('--probe', action='store_true', help='ask the I2C buses who answers')
    parser.add_argument('--json', action='store_true', help='print the findings as JSON')


def duration(text: str) -> float:
    """Seconds above 0, at most an hour."""
    seconds = float(text)
    if not 0 < seconds <= LONGEST_S:
        raise ArgumentTypeError(f'seconds must be above 0, at most {LONGEST_S}; received {text}')
    return seconds


def run(options: argparse.Namespace) -> int:
    """Look, print, and return 1 where something does not work."""
    if options.sensor is None and (options.simulated or options.set or options.port):
        raise ValueError('--sensor must name the sensor that is meant; received none')
    if options.bag is not None:
        return run_bag(options)
    if options.repair is not None:
        raise ValueError('--repair must come with the bag that is meant; received none')
    found = [
        Finding(name, OK, 'installed')
        if importlib.util.find_spec(name)
        else Finding(name, WARN, 'not installed', remedy)
        for name, remedy in PACKAGES.items()
    ]
    found += [] if options.simulated else machine(options.probe)
    if options.sensor is not None:
        found += examine(options)
    elif not any('/dev/' in finding.where for finding in found):
        found.append(Finding('sensor', BAD, 'nothing is connected', 'plug a sensor in, or try '
                             '`tactile doctor --sensor reskin_board --simulated`'))  # fmt: skip
    if options.json:
        print(json.dumps([asdict(finding) for finding in found], indent=2))
    else:
        show_findings(found)
    return int(any(finding.state == BAD for finding in found))


def show_findings(found: Sequence[Finding], title: str = '') -> None:
    """Print a table of findings, then what to do."""
    show(('what', 'state', 'found'), [(f.where, f.state, f.what) for f in found], title)
    for finding in found:
        if finding.remedy:
            print(errors.plain(f'{finding.where}: {finding.remedy}'))


def run_bag(options: argparse.Namespace) -> int:
    """Look at a bag, print, repair it where asked, else return 1 where something is wrong."""
    if options.sensor is not None:
        raise ValueError('--sensor must stand without a bag; received both')
    if options.repair is not None:
        refuse_no_new_folder(options.repair, [options.bag])
    with working(f'reading {options.bag}'):
        check = check_bag(options.bag)
    found = bag_findings(check, '' if options.repair else ADVICE)
    columns = ('topic', 'type', 'messages', 'rate (Hz)', 'longest pause (s)', 'definition')
    topics = [
        (name, one.type_name, one.messages, one.rate_hz, one.pause_ns * 1e-9, one.schema)
        for name, one in sorted(check.topics.items())
    ]
    if options.json:
        listed = {'topics': as_objects(columns, topics), 'findings': [asdict(f) for f in found]}
        print(json.dumps(listed, indent=2))
    else:
        show(columns, topics)
        show_findings(found, 'findings')
    if options.repair is not None:
        with working(f'repairing {options.bag}'):
            saved = repair_bag(options.bag, options.repair)
        note(f'left out: {sentence}' for sentence in saved.problems)
        total = f'{saved.counts.total()} messages of {len(saved.counts)} topics'
        print(errors.plain(f'bag: {options.repair}, {total}'), file=sys.stderr)
    return int(options.repair is None and any(finding.state == BAD for finding in found))


def bag_findings(check: BagCheck, advice: str = '') -> list[Finding]:
    """Findings of a bag with remedies; `advice` is that of damage that leaves messages."""
    found = [Finding('file', BAD, sentence) for sentence in check.damage]
    if found and any(topic.messages for topic in check.topics.values()):
        found[-1] = replace(found[-1], remedy=advice)
    found += [Finding('replay', BAD, f'leaves out {sentence}') for sentence in check.left_out]
    if check.unused:
        found.append(Finding('replay', NOTE, f'leaves out {", ".join(check.unused)}'))
    if not check.sensors:
        remedy = 'record the topics of a sensor: `tactile record`'
        found.append(Finding('frames', BAD, 'no frame that could be read', remedy))
    for space, frames in check.sensors.items():
        found += [replace(f, where=f'{space} {f.where}'.strip()) for f in _of_frames(frames)]
    return found


def _of_frames(check: FrameCheck) -> list[Finding]:
    lost, jumps = check.lost, check.jumps
    worst = jumps[np.argmax(np.abs(jumps))] if len(jumps) else 0.0
    share = ', '.join(f'{taxel} ({100 * part:.3g} %)' for taxel, part in check.dead.items())
    rows = [
        ('gaps', len(lost), f'{lost.sum()} frames are lost in {len(lost)} gaps, at most '
         f'{lost.max(initial=0)} at once', 'close what else uses the processor while recording'),
        ('repeats', check.repeats, f'{check.repeats} frames stand there twice',
         'check that one node alone publishes them'),
        ('stamps', len(jumps), f'{len(jumps)} jump, by up to {worst:+.3g} s',
         'check the clock of the sensor and of its computer'),
        ('taxels', len(check.dead), f'unusable: {share}',
         'check their wires and supply; a fit leaves dead taxels out'),
    ]  # fmt: skip
    found = [Finding('frames', OK, f'{check.frames}, {1 / check.period_s:.4g} Hz by their stamps')]
    found += [
        Finding(name, BAD, what, remedy) if wrong else Finding(name, OK, 'none')
        for name, wrong, what, remedy in rows
    ]
    if check.restarts:
        found.append(Finding('counter', NOTE, f'began again {check.restarts} times'))
    return found + [Finding('replay', WARN, f'says: {one}') for one in check.problems]


def machine(probed: bool) -> list[Finding]:
    """Ports and buses; who answers on the buses where that was asked for."""
    try:
        ports = [name for name in list_ports() if not name.startswith('/dev/ttyS')]
    except errors.MissingPackageError as err:
        return [Finding('serial ports', BAD, 'cannot be listed', str(err))]
    names = list_buses()
    found = serial_ports(ports) + buses(names)
    return found + ([probe(I2cBus(name)) for name in names] if probed else [])


def serial_ports(names: Sequence[str], root: Path = Path('/')) -> list[Finding]:
    """Permission and latency timer of every serial port."""
    found: list[Finding] = []
    for name in names:
        path = root / name.lstrip('/')
        device = root / 'sys/class/tty' / path.name / 'device'
        found.append(permission(path, 'dialout', port_rule(device)))
        timer = device / 'latency_timer'
        if timer.is_file():
            found.append(latency(path.name, timer))
    return found or [Finding('serial ports', NOTE, 'none but /dev/ttyS*', 'plug a board in')]


def permission(path: Path, group: str, rule: str) -> Finding:
    """May this user read and write a device file; if not, by which group or udev rule."""
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
            f"put the udev rule '{rule}' into {RULES}, reload by `sudo udevadm control --reload` "
            'and replug'
        )
        return Finding(str(path), BAD, f'belongs to the group {owner}', remedy)
    remedy = f'add yourself to its group: `sudo usermod -aG {owner} $USER`, and log in again'
    return Finding(str(path), BAD, f'only the group {owner or group} may use it', remedy)


def port_rule(device: Path) -> str:
    """Rule (udev) for the port of a device below /sys/class/tty."""
    match = 'SUBSYSTEM=="tty"'
    for folder in (device / '..', device / '../..', device / '../../..'):
        vendor, product = folder / 'idVendor', folder / 'idProduct'
        if vendor.is_file() and product.is_file():
            ids = vendor.read_text().strip(), product.read_text().strip()
            match += f', ATTRS{{idVendor}}=="{ids[0]}", ATTRS{{idProduct}}=="{ids[1]}"'
            break
    return f'{match}, GROUP="dialout", MODE="0660"'


def latency(name: str, timer: Path) -> Finding:
    """Latency timer of the USB converter of a port."""
    text = timer.read_text().strip()
    milliseconds = int(text) if text.isdigit() else 0
    remedy = (
        f'write 1 into {timer} as root, and for ever by the udev rule '
        f'\'ACTION=="add", SUBSYSTEM=="usb-serial", DRIVER=="ftdi_sio", '
        f'ATTR{{latency_timer}}="1"\' in {RULES}'
    )
    what = f'its converter keeps bytes back for up to {milliseconds} ms'
    return judged(f'/dev/{name} latency', what, milliseconds > MOST_LATENCY_MS, remedy)


def judged(where: str, what: str, wrong: bool, remedy: str) -> Finding:
    """Finding that is ok, or a warning with its remedy."""
    return Finding(where, WARN, what, remedy) if wrong else Finding(where, OK, what)


def buses(names: Sequence[str]) -> list[Finding]:
    """Permission of every I2C bus."""
    rule = 'KERNEL=="i2c-[0-9]*", GROUP="i2c", MODE="0660"'
    remedy = 'where chips are wired to this machine: enable the bus and load the module i2c-dev'
    return [permission(Path(name), 'i2c', rule) for name in names] or [
        Finding('I2C buses', NOTE, 'this machine shows none', remedy)
    ]


def probe(bus: I2cBus) -> Finding:
    """Probe a bus: NOP to the addresses of the chips, one byte read from switches.

    Neither changes anything in a chip or switch of these kinds.
    """
    try:
        bus.open()
        chips = [a for a in CHIP_ADDRESSES if _answers(bus, a, bytes((Command.NOP,)))]
        switches = [a for a in MUX_ADDRESSES if _answers(bus, a, b'')]
    except errors.DeviceError as err:
        return Finding(bus.path, BAD, 'cannot be asked', str(err))
    finally:
        bus.close()
    named = [f'{a:#04x}' for a in chips] + [f'{a:#04x} (switch)' for a in switches]
    what = f'answers come from {", ".join(named)}' if named else 'no chip or switch answers'
    remedy = 'check power, ground, SDA and SCL, and pull-ups of the chips'
    return judged(bus.path, what, not named, remedy)


def _answers(bus: I2cBus, address: int, data: bytes) -> bool:
    try:
        bus.transfer(address, data, 1)
    except errors.NotAcknowledged:
        return False
    return True


def examine(options: argparse.Namespace) -> list[Finding]:
    """Read the sensor, or its twin."""
    spec = load_sensor(options.sensor)
    given = dict(_pair(text) for text in options.set)
    connection = spec.connection() if options.port is None else spec.connection().at(options.port)
    config, connection = _with(given, spec.config(), connection)
    with ExitStack() as held:
        if options.simulated:
            twin = held.enter_context(spec.simulate(config, connection, None, options.seed))
            device = twin.device(time.time_ns)
            if options.fault:
                name, _, count = options.fault.partition(':')
                twin.inject(name, int(count or 1))
        else:
            device = spec.open(config, connection, time.time_ns)
        try:
            with working(f'reading {spec.key}'):
                check = watch(device, options.seconds)
        except errors.TactileError as err:
            return [Finding(spec.key, BAD, 'cannot be read', str(err))]
    kind = 'simulated twin' if options.simulated else 'sensor'
    what = f'{kind}, {len(check.frames)} frames in {options.seconds:g} s'
    return [Finding(spec.key, NOTE, what), *findings(check)] if check.frames else findings(check)


def _pair(text: str) -> tuple[str, object]:
    name, equals, value = text.partition('=')
    if not (name and equals):
        raise ValueError(f'--set must be NAME=VALUE; received {text!r}')
    try:
        return name, read_yaml(value)
    except ValueError as err:
        msg = f'--set {name} must have a value that yaml can read; received {value!r}'
        raise ValueError(msg) from err


def _with(given: dict[str, object], *parts: object) -> tuple[SensorConfig, SerialConnection]:
    names = [{f.name for f in fields(part)} for part in parts]  # type: ignore[arg-type]
    every = set().union(*names)
    if stray := sorted(set(given) - every):
        known = ', '.join(sorted(every))
        raise ValueError(f'--set must name one of {known}; received {", ".join(stray)}')
    given = {n: tuple(v) if isinstance(v, list) else v for n, v in given.items()}
    return tuple(  # type: ignore[return-value]
        replace(part, **{n: v for n, v in given.items() if n in own})  # type: ignore[type-var]
        for part, own in zip(parts, names, strict=True)
    )


def watch(device: Device, seconds: float) -> DeviceCheck:
    """Open a device and read it for so many seconds; no failure is raised."""
    frames: list[Frame] = []
    failure = ''
    try:
        with device:
            end = time.monotonic() + seconds
            while time.monotonic() < end:
                try:
                    frames.append(device.read(READ_S))
                    failure = ''
                except errors.DeviceTimeout as err:
                    failure = str(err)
    except errors.TactileError as err:
        failure = str(err)
    return DeviceCheck(device.layout, frames, failure, device.counters())


def findings(check: DeviceCheck) -> list[Finding]:
    """Findings of a sensor that was read, with remedies."""
    troubles = [
        Finding(name.replace('_', ' '), WARN, str(check.counters[name]), remedy)
        for name, remedy in TROUBLES.items()
        if check.counters.get(name)
    ]
    if len(check.frames) < 4:
        what = f'{len(check.frames)} frames came'
        remedy = check.failure or 'check that the sensor is powered and is this kind of sensor'
        return [Finding('frames', BAD, what, remedy), *troubles]
    broken = [Finding('connection', BAD, 'fell silent', check.failure)] if check.failure else []
    return [*broken, *_pace(check), _noise(check), _temperature(check), *_marks(check), *troubles]


def _pace(check: DeviceCheck) -> list[Finding]:
    gaps = np.diff([frame.stamp_ns or 0 for frame in check.frames]) * 1e-9
    rate, jitter, nominal = 1.0 / gaps.mean(), float(gaps.std()), check.layout.rate_hz
    return [
        judged(
            'rate', f'{rate:.4g} Hz, nominal {nominal:g} Hz', rate < SLOW * nominal,
            'set rate_hz to what the sensor does, or find what holds it up (latency timer, bus)',
        ),
        judged(
            'jitter', f'{1e3 * jitter:.3g} ms', jitter * nominal > IRREGULAR,
            'close what else uses the processor, lower the latency timer of the port',
        ),
    ]  # fmt: skip


def noise_of(check: DeviceCheck) -> Array:
    """Noise of every taxel and channel, shape (t, c) (unit of values), whatever moves slowly."""
    values = np.array([frame.values for frame in check.frames])
    noise: Array = TO_SIGMA * np.nanmedian(np.abs(np.diff(values, 2, axis=0)), axis=0)
    return noise


def _noise(check: DeviceCheck) -> Finding:
    with np.errstate(all='ignore'):
        noise = noise_of(check)
    unit = check.layout.unit if check.layout.unit != '1' else 'of full scale'
    usual = np.nanmedian(noise, axis=0)
    each = ', '.join(f'{c} {x:.2g}' for c, x in zip(check.layout.channels, usual, strict=True))
    what = f'{each} {unit} (standard deviation, median of the taxels)'
    # smallest change of any reading, that of the converter where it is coarse
    steps = np.abs(np.diff([frame.values for frame in check.frames], axis=0))
    step = float(np.min(steps, where=steps > 0, initial=np.inf))
    odd = np.flatnonzero((noise > NOISY * np.maximum(usual, step)).any(axis=1)).tolist()
    if odd:
        remedy = f'check taxels {odd}: they are over {NOISY:g} times as noisy as the rest'
        return Finding('noise', WARN, what, remedy)
    # readings of a coarse converter may stand still at rest
    silent = np.flatnonzero((noise == 0).all(axis=1)).tolist() if (usual > 2 * step).any() else []
    remedy = f'check taxels {silent}: their readings never change'
    return judged('noise', what, bool(silent), remedy)


def _temperature(check: DeviceCheck) -> Finding:
    celsius = check.frames[-1].temperature_c
    if celsius is None or not np.isfinite(celsius).any():
        return Finding('temperature', NOTE, 'not measured')
    return Finding('temperature', OK, f'{np.nanmin(celsius):.1f} to {np.nanmax(celsius):.1f} C')


def _marks(check: DeviceCheck) -> list[Finding]:
    blank = np.zeros(check.layout.shape[0], np.uint8)
    bits = np.array([blank if f.status is None else f.status for f in check.frames])
    found = []
    for bit, remedy in MARKS.items():
        share = (bits & int(bit) > 0).mean(axis=0)
        taxels = np.flatnonzero(share > (RARELY if bit == TaxelStatus.STALE else 0)).tolist()
        if taxels:
            state = BAD if share.max() > 0.5 else WARN
            what = f'taxels {taxels}, in up to {100 * share.max():.3g} % of the frames'
            found.append(Finding(str(bit.name).lower(), state, what, remedy))
    return found
