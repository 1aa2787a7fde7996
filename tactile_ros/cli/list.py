"""Show every sensor: key, paper, transports, how to connect.

example:
  tactile list
  tactile list --json
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from tactile_ros.cli.table import show, show_json
from tactile_ros.sensors import list_sensors, load_sensor

if TYPE_CHECKING:
    import argparse

COLUMNS = ('sensor', 'paper', 'what', 'transports', 'estimators')


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `tactile list`."""
    parser.add_argument('--json', action='store_true', help='print the table as JSON')


def run(options: argparse.Namespace) -> int:
    """Print one row per sensor."""
    specs = [load_sensor(key) for key in list_sensors()]
    rows = [
        (s.key, s.paper, s.summary, '; '.join(s.transports), ', '.join(s.estimator_names))
        for s in specs
    ]
    (show_json if options.json else show)(COLUMNS, rows)
    return 0
