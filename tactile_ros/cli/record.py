"""Record what a replay needs of one sensor into a bag, until Ctrl-C.

Frames, layout, baselines, calibration, contacts and truth/contacts of a namespace; what was heard
up to a moment before is readable even after a kill.

example:
  tactile record -o out/my_bag
  tactile record -o out/thumb --namespace thumb --seconds 20
"""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING

from tactile_ros.nodes.graph import Graph, Process
from tactile_ros.nodes.processes import Running

if TYPE_CHECKING:
    import argparse


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `tactile record`."""
    parser.add_argument('-o', '--output', type=Path, required=True, help='folder of the bag')
    parser.add_argument('--namespace', default='', help='namespace of the sensor')
    parser.add_argument('--seconds', type=float, help='stop by itself after so long')


def run(options: argparse.Namespace) -> int:
    """Start the recorder and wait."""
    if options.output.exists():
        msg = f'{options.output} exists already; name a folder that does not'
        raise ValueError(msg)
    bag = str(options.output.resolve())
    process = Process('record', {'bag': bag}, options.namespace)
    with Running(Graph((process,)), hear=lambda _, line: print(line)) as running:
        try:
            wait(running, options.seconds)
        except KeyboardInterrupt:
            print('stopping')
    print(f'bag: {options.output}')
    return 0


def wait(running: Running, seconds: float | None) -> None:
    """Wait for the time to be over, or for the recorder to end."""
    end = float('inf') if seconds is None else time.monotonic() + seconds
    while time.monotonic() < end and running.is_alive('record'):
        time.sleep(0.1)
