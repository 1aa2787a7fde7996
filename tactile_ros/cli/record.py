# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Record what a replay needs of one sensor into a bag, until Ctrl-C.

Frames, layout, baselines, calibration, contacts and truth/contacts of a namespace; what was heard
up to a moment before is readable even after a kill.

example:
  tactile record -o out/my_bag
  tactile record -o out/thumb --namespace thumb --seconds 20
"""

from __future__ import annotations

import argparse
import shutil
import time
from pathlib import Path

from tactile_ros.cli import interruptible
from tactile_ros.cli.console import refuse_no_new_folder, refuse_unwritable
from tactile_ros.errors import RecordingError, TactileError, plain
from tactile_ros.evaluation.recording_files import load
from tactile_ros.nodes.graph import Graph, Process
from tactile_ros.nodes.processes import Running

START_S = 20.0
FIRST_FRAME_S = 60.0
LOOK_S = 0.2


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `tactile record`."""
    parser.add_argument('-o', '--output', type=Path, required=True, help='folder of the bag')
    parser.add_argument('--namespace', default='', help='namespace of the sensor')
    parser.add_argument('--seconds', type=float, help='stop by itself after so long')


def run(options: argparse.Namespace) -> int:
    """Start the recorder and wait."""
    refuse_no_new_folder(options.output)
    refuse_unwritable(options.output)
    bag = str(options.output.resolve())
    process = Process('record', {'bag': bag}, options.namespace)
    with Running(Graph((process,)), hear=lambda _, line: print(plain(line))) as running:
        try:
            with interruptible():
                wait(running, options.output, options.seconds)
        except KeyboardInterrupt:
            print('stopping')
            if not (options.output / 'metadata.yaml').exists():  # not begun yet
                raise
        if code := running.stop()['record']:
            msg = f'the recorder ended with code {code}; its last lines say why'
            raise TactileError(msg)
    refuse_empty(options.output, options.namespace)
    print(f'bag: {options.output}')
    return 0


def refuse_empty(bag: Path, namespace: str) -> None:
    """Remove a bag without a message; TactileError says where nothing came."""
    import yaml

    about = yaml.safe_load((bag / 'metadata.yaml').read_text())
    if not about['rosbag2_bagfile_information']['message_count']:
        shutil.rmtree(bag)
        msg = (
            f'{bag} was removed, nothing was received in /{namespace}: are sensor_node and '
            'contact_node running there, with the same ROS_DOMAIN_ID?'
        )
        raise TactileError(msg)


def wait(running: Running, bag: Path, seconds: float | None) -> None:
    """Wait for so many seconds of recording, or for the recorder to end.

    Raises TactileError if no recording begins.
    """
    end = time.monotonic() + START_S
    while not bag.exists() and running.is_alive('record'):
        if time.monotonic() > end:
            raise TactileError(f'no bag was begun at {bag} within {START_S:g} s')
        time.sleep(0.05)
    end = float('inf') if seconds is None else time.monotonic() + seconds
    while time.monotonic() < end and running.is_alive('record'):
        time.sleep(0.05)


def wait_for_frames(running: Running, bag: Path) -> None:
    """Wait until frames are in a bag: nodes take seconds to start and to find one another.

    Raises TactileError if none comes.
    """
    end = time.monotonic() + FIRST_FRAME_S
    while all(running.is_alive(process.executable) for process in running.graph.processes):
        time.sleep(LOOK_S)
        try:
            load(bag)
        except RecordingError as err:
            if time.monotonic() > end:
                raise TactileError(f'no frame came within {FIRST_FRAME_S:g} s: {err}') from err
        else:
            return
