# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Run the nodes of a sensor, or of a hand with its sensors, until Ctrl-C.

Without --port the only serial port here is taken, without --calibration the nominal model of the
sensor estimates, where it has one. Simulated sensors are pressed otherwise than by `tactile
calibrate --live`. `tactile view` shows what the nodes publish.

example:
  tactile run --sensor gradiometer --simulated
  tactile run --sensor reskin_board --port /dev/ttyACM0 --calibration out/mine.npz
  tactile run --hand allegro_v5 --calibrations out/fingers --mock-hand
"""

from __future__ import annotations

import argparse
import sys
import time

from tactile_ros.cli import interruptible
from tactile_ros.devices.transport import list_ports
from tactile_ros.errors import CalibrationError, DeviceError, TactileError, plain
from tactile_ros.evaluation.fleet import open_calibration
from tactile_ros.nodes.graph import Graph, HandSetup, SensorSetup, grasping, has_port, sensing
from tactile_ros.nodes.processes import Running
from tactile_ros.sensors import load_sensor

LOOK_S = 0.1
PLAYED = 1  # seed of simulated presses; calibrations are learned from those of 0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `tactile run`."""
    parser.add_argument('--sensor', default='reskin_board', help='key, see `tactile list`')
    parser.add_argument('--port', default='', help='serial port; empty: the only one there is')
    parser.add_argument('--calibration', default='', help='calibration file of the sensor (.npz)')
    parser.add_argument('--hand', default='', help='hand, or a .yaml that describes one')
    parser.add_argument('--ports', default='', help='serial ports of its fingers, with commas')
    parser.add_argument('--calibrations', default='', help='folder with <finger>.npz')
    parser.add_argument('--fingers', default='', help='sensors that take part; empty: all')
    parser.add_argument('--mock-hand', action='store_true', help='a fake replaces the driver')
    parser.add_argument('--simulated', action='store_true', help='simulate the sensors')
    parser.add_argument('--namespace', default='', help='namespace of nodes and topics')
    parser.add_argument('--params-file', default='', help='yaml of parameters, as in config')
    parser.add_argument('--seconds', type=float, help='stop by itself after so long')


def run(options: argparse.Namespace) -> int:
    """Start the processes and wait."""
    graph = graph_of(options)
    end = float('inf') if options.seconds is None else time.monotonic() + options.seconds
    names = ', '.join(graph.name_of(process) for process in graph.processes)
    print(f'running {names}; Ctrl-C ends', file=sys.stderr, flush=True)
    with Running(graph, hear=lambda name, line: print(plain(f'{name}: {line}'))) as running:
        try:
            with interruptible():
                while time.monotonic() < end:
                    for name in running.lines:
                        if not running.is_alive(name):
                            raise TactileError(f'{name} has ended; its last lines say why')
                    time.sleep(LOOK_S)
        except KeyboardInterrupt:
            print('stopping', file=sys.stderr)
    return 0


def graph_of(options: argparse.Namespace) -> Graph:
    """Processes that the options describe.

    Raises TactileError if not one port could be meant, or a calibration cannot be read.
    """
    key = load_sensor(options.sensor).key
    place = {'namespace': options.namespace, 'params_file': options.params_file}
    source = 'simulated' if options.simulated else 'hardware'
    if options.hand:
        setup = HandSetup(
            hand=options.hand, sensor=key, source=source, ports=options.ports, stack=True,
            calibrations=options.calibrations, fingers=options.fingers,
            mock_hand=options.mock_hand, seed=PLAYED, **place,
        )  # fmt: skip
        return grasping(setup)
    if options.calibration:
        fitted = open_calibration(options.calibration).sensor
        if fitted != key:
            msg = f'{options.calibration} is a calibration of {fitted}; name --sensor {fitted}'
            raise CalibrationError(msg)
    else:
        print('no --calibration: only what the nominal model gives is estimated', file=sys.stderr)
    port = options.port or ('' if options.simulated or not has_port(key) else only_port())
    setup = SensorSetup(
        sensor=key, source=source, calibration=options.calibration, stack=True,
        seed=PLAYED, **place, **({'port': port} if port else {}),
    )  # fmt: skip
    return sensing(setup)


def only_port() -> str:
    """The one serial port that a board may be at; DeviceError if there are none or several."""
    ports = [name for name in list_ports() if not name.startswith('/dev/ttyS')]
    if len(ports) == 1:
        return ports[0]
    here = f'there are {", ".join(ports)}' if ports else 'none is here: plug the board in'
    raise DeviceError(f'--port must name the serial port of the board; {here}')
