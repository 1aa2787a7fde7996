# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Show every sensor: key, paper, transports, how to connect.

example:
  tactile list
  tactile list --json
"""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING

from tactile_ros.cli.console import show, working
from tactile_ros.sensors import list_sensors, load_sensor

if TYPE_CHECKING:
    import argparse

    from tactile_ros.sensors import SensorSpec

COLUMNS = ('sensor', 'paper', 'what', 'transports', 'connect', 'estimators')


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `tactile list`."""
    parser.add_argument('--json', action='store_true', help='print the table as JSON')


def run(options: argparse.Namespace) -> int:
    """Print a paragraph, or an object, for every sensor."""
    with working('reading the sensors'):
        specs = [load_sensor(key) for key in list_sensors()]
    rows = [
        (
            s.key, s.paper, s.summary, '; '.join(s.transports), how_to_connect(s),
            ', '.join(s.estimator_names),
        )
        for s in specs
    ]  # fmt: skip
    if options.json:
        show(COLUMNS, rows, as_json=True)
        return 0
    for key, *cells in rows:
        print(key)
        for name, cell in zip(COLUMNS[1:], cells, strict=True):
            left = f'  {name:12}'
            print(textwrap.fill(cell, 79, initial_indent=left, subsequent_indent=' ' * len(left)))
    return 0


def how_to_connect(spec: SensorSpec) -> str:
    """Default place of a sensor, and the page that says more."""
    connection = spec.connection()
    buses = getattr(connection, 'buses', ())
    ways = [f'buses {", ".join(buses)}'] if buses else []
    if hasattr(connection, 'port'):
        baud = getattr(connection, 'baud', '')
        ways.append(f'port {connection.port}' + (f' at {baud} baud' if baud else ''))
    return f'{" or ".join(ways)}; docs/{spec.key}.md'
