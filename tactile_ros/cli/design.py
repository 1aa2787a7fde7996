# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Choose geometry and materials of a sensor by what it must measure.

example:
  tactile design gradiometer
  tactile design magnet_pad --config my_pad.yaml
  tactile design gradiometer --json
  tactile design gradiometer --help
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from tactile_ros.cli.console import as_objects, read_config, working
from tactile_ros.sensors import SensorSpec, designable, load_sensor


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `tactile design`; what follows the sensor is for its own parser."""
    parser.add_argument('sensor', help=f'one of: {", ".join(designable()) or "none here"}')
    parser.add_argument(
        'rest', nargs=argparse.REMAINDER, metavar='...',
        help='--config, --json and what `tactile design SENSOR --help` names',
    )  # fmt: skip


def sensor_parser(spec: SensorSpec) -> argparse.ArgumentParser:
    """Arguments of the design of one sensor."""
    design = spec.design()
    parser = argparse.ArgumentParser(
        prog=f'tactile design {spec.key}',
        description=design.__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument('--config', type=Path, help='yaml with fields of the sensor config')
    parser.add_argument('--json', action='store_true', help='print the tables as JSON')
    design.add_arguments(parser)
    return parser


def run(options: argparse.Namespace) -> int:
    """Work out the tables of one sensor and print them."""
    spec = load_sensor(options.sensor)
    own = sensor_parser(spec).parse_args(options.rest)
    config = read_config(spec, own.config)
    with working(f'working out {spec.key}'):
        tables = spec.design().tables(config, own)
    if own.json:
        listed = [
            {'title': t.title, 'rows': as_objects(t.columns, t.rows), 'notes': list(t.notes)}
            for t in tables
        ]
        print(json.dumps(listed, indent=2, allow_nan=False))
    else:
        for table in tables:
            print(f'\n{table}')
    return 0
