"""Run a node by its executable's name: python -m tactile_ros.nodes sensor_node --ros-args ..."""

from __future__ import annotations

import os
import signal
import sys
from importlib import import_module

MODULES = {
    'sensor_node': 'sensor_node',
    'contact_node': 'contact_node',
    'grip_node': 'grip_node',
    'mock_hand': 'mock_hand_node',
    'stack': 'stack',
    'record': 'record_node',
    'player': 'player_node',
}


def main() -> None:
    """Import and run; Ctrl-C while numpy and rclpy still load ends without a traceback."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: sys.exit(0))
    from tactile_ros.nodes.processes import STARTED_BY, end_with_parent

    if STARTED_BY in os.environ:  # one that was started by hand outlives its shell
        end_with_parent()
    if len(sys.argv) < 2 or sys.argv[1] not in MODULES:
        sys.exit(f'name one of {", ".join(MODULES)}')
    name = MODULES[sys.argv.pop(1)]
    import_module(f'tactile_ros.nodes.{name}').main()


if __name__ == '__main__':
    main()
