# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Run a node by its executable's name, that of this program or its first argument."""

from __future__ import annotations

import os
import signal
import sys
from importlib import import_module
from pathlib import Path

# executable: its module, and what makes its node there, or its nodes
NODES = {
    'sensor_node': ('sensor_node', 'SensorNode'),
    'contact_node': ('contact_node', 'ContactNode'),
    'grip_node': ('grip_node', 'GripNode'),
    'mock_hand': ('mock_hand_node', 'MockHandNode'),
    'stack': ('stack', 'build'),
    'record': ('record_node', 'RecordNode'),
    'player': ('player_node', 'PlayerNode'),
}


def start() -> None:
    """Import and run; Ctrl-C while numpy and rclpy still load ends without a traceback."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: os._exit(0))
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})  # as the executables block it
    from tactile_ros.nodes.processes import STARTED_BY, end_with_parent

    if STARTED_BY in os.environ:  # one that was started by hand outlives its shell
        end_with_parent()
    name = Path(sys.argv[0]).name
    if name not in NODES:
        if len(sys.argv) < 2 or sys.argv[1] not in NODES:
            sys.exit(f'name one of {", ".join(NODES)}')
        name = sys.argv.pop(1)
    module, builder = NODES[name]
    build = getattr(import_module(f'tactile_ros.nodes.{module}'), builder)
    import_module('tactile_ros.nodes.lifecycle').run(build)


if __name__ == '__main__':
    start()
