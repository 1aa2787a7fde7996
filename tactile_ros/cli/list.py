# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Show every sensor: key, paper, transports, how to connect.

example:
  tactile list
  tactile list --json
"""

from __future__ import annotations

import argparse
import textwrap
from pathlib import Path

from tactile_ros import sensors
from tactile_ros.cli.console import show, working

COLUMNS = ('sensor', 'paper', 'what', 'transports', 'connect', 'estimators')


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `tactile list`."""
    parser.add_argument('--json', action='store_true', help='print the table as JSON')


def run(options: argparse.Namespace) -> int:
    """Print a paragraph, or an object, for every sensor."""
    with working('reading the sensors'):
        rows = [_row(sensors.load_sensor(key)) for key in sensors.list_sensors()]
    if options.json:
        show(COLUMNS, rows, as_json=True)
        return 0
    for key, *cells in rows:
        print(key)
        for name, cell in zip(COLUMNS[1:], cells, strict=True):
            left = f'  {name:12}'
            print(textwrap.fill(cell, 79, initial_indent=left, subsequent_indent=' ' * len(left)))
    return 0


def _row(spec: sensors.SensorSpec) -> tuple[str, ...]:
    connection = spec.connection()
    buses = getattr(connection, 'buses', ())
    ways = [f'buses {", ".join(buses)}'] if buses else []
    if hasattr(connection, 'port'):
        baud = getattr(connection, 'baud', '')
        ways.append(f'port {connection.port}' + (f' at {baud} baud' if baud else ''))
    page = f'; docs/{spec.key}.md' if Path(sensors.__path__[0], spec.key).is_dir() else ''
    return (
        spec.key, spec.paper, spec.summary, '; '.join(spec.transports),
        f'{" or ".join(ways)}{page}', ', '.join(spec.estimator_names),
    )  # fmt: skip
