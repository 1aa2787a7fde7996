"""Look at ports, permissions, buses and a sensor, and say what to do.

Nothing is written anywhere. `--probe` asks every I2C bus who answers (NOP and a read of one byte);
`--sensor` opens that sensor with its driver and reads it for a few seconds.

example:
  tactile doctor
  tactile doctor --sensor reskin_board --port /dev/ttyACM0
  tactile doctor --sensor gradiometer --simulated
  tactile doctor --sensor magnet_pad --set buses=[/dev/i2c-3] --probe --json
"""

from __future__ import annotations

import json
import time
from argparse import ArgumentTypeError
from contextlib import ExitStack
from dataclasses import asdict, fields, replace
from typing import TYPE_CHECKING

from tactile_ros.cli.machine import BAD, NOTE, Finding, buses, packages, probe, serial_ports
from tactile_ros.cli.table import show
from tactile_ros.cli.trial import findings, watch
from tactile_ros.cli.working import working
from tactile_ros.devices.transport import I2cBus, list_buses, list_ports
from tactile_ros.errors import MissingPackageError, TactileError
from tactile_ros.sensors import load_sensor

if TYPE_CHECKING:
    import argparse

    from tactile_ros.types import Device

LONGEST_S = 3600
COLUMNS = ('what', 'state', 'found', 'to do')


def duration(text: str) -> float:
    """Seconds, at most an hour."""
    seconds = float(text)
    if not 0 <= seconds <= LONGEST_S:
        msg = f'seconds must be 0 to {LONGEST_S}; received {text}'
        raise ArgumentTypeError(msg)
    return seconds


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `tactile doctor`."""
    parser.add_argument('--sensor', help='read this sensor for a few seconds')
    parser.add_argument('--simulated', action='store_true', help='read its twin instead')
    parser.add_argument('--seed', type=int, default=0, help='of the twin')
    parser.add_argument('--fault', default='', help='that the twin suffers: name or name:count')
    parser.add_argument('--port', help='serial port of the sensor')
    parser.add_argument(
        '--set', action='append', default=[], metavar='NAME=VALUE',
        help='another field of its connection or config',
    )  # fmt: skip
    parser.add_argument('--seconds', type=duration, default=3.0, help='how long it is read')
    parser.add_argument('--probe', action='store_true', help='ask the I2C buses who answers')
    parser.add_argument('--json', action='store_true', help='print the findings as JSON')


def run(options: argparse.Namespace) -> int:
    """Look, print, and return 1 where something does not work."""
    if options.sensor is None and (options.simulated or options.set or options.port):
        msg = '--sensor must name the sensor that is meant; received none'
        raise ValueError(msg)
    found = packages() + ([] if options.simulated else machine(options.probe))
    if options.sensor is not None:
        found += examine(options)
    elif not any('/dev/' in finding.where for finding in found):
        found.append(Finding('sensor', BAD, 'nothing is connected', 'plug a sensor in, or try '
                             '`tactile doctor --sensor reskin_board --simulated`'))  # fmt: skip
    if options.json:
        print(json.dumps([asdict(finding) for finding in found], indent=2))
    else:
        rows = [(f.where, f.state, f.what) for f in found]
        show(COLUMNS[:3], rows)
        for finding in found:
            if finding.remedy:
                print(f'{finding.where}: {finding.remedy}')
    return int(any(finding.state == BAD for finding in found))


def machine(asked: bool) -> list[Finding]:
    """Ports and buses; who answers on the buses where that was asked for."""
    try:
        ports = [name for name in list_ports() if not name.startswith('/dev/ttyS')]
    except MissingPackageError as err:
        return [Finding('serial ports', BAD, 'cannot be listed', str(err))]
    names = list_buses()
    found = serial_ports(ports) + buses(names)
    return found + ([probe(I2cBus(name)) for name in names] if asked else [])


def examine(options: argparse.Namespace) -> list[Finding]:
    """Read the sensor, or its twin."""
    spec = load_sensor(options.sensor)
    given = dict(_pair(text) for text in options.set)
    if options.port is not None:
        given['port'] = options.port
    config, connection = _with(given, spec.config(), spec.connection())
    with ExitStack() as held:
        device: Device
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
                trial = watch(device, options.seconds)
        except TactileError as err:
            return [Finding(spec.key, BAD, 'cannot be read', str(err))]
    kind = 'simulated twin' if options.simulated else 'sensor'
    what = f'{kind}, {len(trial.frames)} frames in {options.seconds:g} s'
    return [Finding(spec.key, NOTE, what), *findings(trial)]


def _pair(text: str) -> tuple[str, object]:
    """Name and value of --set."""
    import yaml

    name, equals, value = text.partition('=')
    if not (name and equals):
        msg = f'--set must be NAME=VALUE; received {text!r}'
        raise ValueError(msg)
    try:
        return name, yaml.safe_load(value)
    except yaml.YAMLError as err:
        msg = f'--set {name} must have a value that yaml can read; received {value!r}'
        raise ValueError(msg) from err


def _with(given: dict[str, object], *parts: object) -> list[object]:
    """Dataclasses with the fields that were given."""
    known = [{f.name for f in fields(part)} for part in parts]  # type: ignore[arg-type]
    names = sorted(set().union(*known))
    if stray := sorted(set(given) - set(names)):
        msg = f'--set must name one of {", ".join(names)}; received {", ".join(stray)}'
        raise ValueError(msg)
    return [
        replace(part, **{  # type: ignore[type-var]
            n: tuple(v) if isinstance(v, list) else v for n, v in given.items() if n in names
        })
        for part, names in zip(parts, known, strict=True)
    ]  # fmt: skip
