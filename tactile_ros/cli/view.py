"""Show taxels, contacts, forces and grip in Foxglove: live, recorded or simulated.

Without anything named it listens to the topics of running nodes; a bag or file is played; a sensor
is simulated. Foxglove (or Lichtblick, its free sibling) connects to the address that is printed;
config/foxglove_view.json is a layout for it. Needs `pip install foxglove-sdk`.

example:
  tactile view
  tactile view --namespace thumb --namespace index
  tactile view out/demo/reskin_board/bags/place --speed 0.5
  tactile view --sensor gradiometer
  tactile view --sensor taxel_array --seconds 5 --mcap out/taxels.mcap
"""

from __future__ import annotations

import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.cli import interruptible
from tactile_ros.cli.console import refuse_unwritable, working
from tactile_ros.errors import DeviceTimeout, MissingPackageError, RecordingError
from tactile_ros.evaluation.fleet import open_calibration
from tactile_ros.evaluation.recording_files import load
from tactile_ros.evaluation.replay import failure_problems
from tactile_ros.sensors import load_sensor
from tactile_ros.types import ContactStates
from tactile_ros.view.viewer import Viewer

if TYPE_CHECKING:
    import argparse
    from collections.abc import Iterator

    from tactile_ros.evaluation.recording_files import LoadedRecording
    from tactile_ros.pipeline import Pipeline
    from tactile_ros.sensors import SensorSpec
    from tactile_ros.types import ContactState, Frame, Layout, SensorConfig

    Shown = tuple[Layout, Frame, ContactState]

PORT = 8765  # where Foxglove looks by itself
READ_S = 1.0
MOST_ROWS = 1000  # of simulated presses, for a fit of seconds
LAYOUT = 'config/foxglove_view.json'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `tactile view`."""
    parser.add_argument('recording', nargs='?', help='bag, .npz or .csv to play; none: topics')
    parser.add_argument('--sensor', help='simulate this sensor instead, see `tactile list`')
    parser.add_argument('--namespace', action='append', help='of topics; several are shown')
    parser.add_argument('--calibration', type=Path, help='for what was recorded or is simulated')
    parser.add_argument('--speed', type=float, default=1.0, help='of playing; 0: at once')
    parser.add_argument('--seed', type=int, default=0, help='of the simulated sensor')
    parser.add_argument('--seconds', type=float, help='stop by itself after so long')
    parser.add_argument('--port', type=int, default=PORT, help=f'of the server ({PORT}; 0: any)')
    parser.add_argument('--mcap', type=Path, help='write a file for Foxglove, without a server')


def run(options: argparse.Namespace) -> int:
    """Open the viewer and feed it until the end or Ctrl-C."""
    if options.sensor and options.recording:
        msg = f'name a recording or --sensor; received {options.recording} and {options.sensor}'
        raise ValueError(msg)
    if options.speed < 0:
        raise ValueError(f'--speed must be 0 or more; received {options.speed:g}')
    if options.mcap and options.mcap.exists():
        raise ValueError(f'{options.mcap} exists already; name a file that does not')
    if options.recording and not Path(options.recording).exists():
        raise RecordingError(f'{options.recording} does not exist; name a bag, .npz or .csv')
    if options.sensor:
        load_sensor(options.sensor)  # before anybody is asked to connect
    if options.mcap:
        refuse_unwritable(options.mcap)
        options.mcap.parent.mkdir(parents=True, exist_ok=True)
    with Viewer(None if options.mcap else options.port, options.mcap) as viewer:
        told = f'connect Foxglove to {viewer.address}, layout {LAYOUT}; Ctrl-C ends'
        print(f'writing {options.mcap}' if options.mcap else told, file=sys.stderr, flush=True)
        try:
            with interruptible():
                feed(viewer, options)
        except KeyboardInterrupt:
            print('stopping', file=sys.stderr)
    return 0


def feed(viewer: Viewer, options: argparse.Namespace) -> None:
    """Show whatever was asked for."""
    if options.sensor:
        for layout, frame, state in simulated(options):
            viewer.show('', layout, frame, state)
    elif options.recording:
        calibration = open_calibration(options.calibration) if options.calibration else None
        with working(f'reading {options.recording}'):
            found = load(Path(options.recording)).recordings
        for one in found:
            name = one.name if len(found) > 1 else ''
            for layout, frame, state in paced(played(one, calibration), options):
                viewer.show(name, layout, frame, state)
    else:
        try:
            from tactile_ros.nodes.viewer_node import run_viewer
        except ImportError as error:
            msg = 'topics need ROS 2; name a recording or --sensor, or use the road with make'
            raise MissingPackageError(msg) from error
        run_viewer(options.namespace or [''], viewer.show, viewer.grip, options.seconds)


def simulated(options: argparse.Namespace) -> Iterator[Shown]:
    """Frames of a twin through its driver, and what a pipeline says of them."""
    spec = load_sensor(options.sensor)
    config = spec.config(**spec.demo)
    if options.calibration:
        pipeline = open_calibration(options.calibration)
    else:
        with working(f'calibrating {spec.key} on simulated presses'):
            pipeline = fitted(spec, config, options.seed + 1)
    layout = pipeline.layout
    twin = spec.simulate(config, spec.connection(), None, options.seed)
    end = float('inf') if options.seconds is None else time.monotonic() + options.seconds
    with twin, twin.device(time.time_ns) as device:
        while time.monotonic() < end:
            try:
                frame = device.read(READ_S)
            except DeviceTimeout:
                continue
            yield layout, frame, pipeline.process(frame)


def fitted(spec: SensorSpec, config: SensorConfig, seed: int) -> Pipeline:
    """Pipeline that has learned from some of a twin's presses, within seconds."""
    train = spec.presses(config, seed)
    every = -(-len(train) // MOST_ROWS)
    return spec.pipeline(config).fit(train.select(slice(None, None, every)))


def played(loaded: LoadedRecording, pipeline: Pipeline | None) -> Iterator[Shown]:
    """Frames of a recording with what was said live, or what a calibration says of them."""
    recording = loaded.recording
    count, taxels = len(recording), len(recording.layout.positions)
    if pipeline is not None:
        with working(f'estimating {count} frames'):
            failures = pipeline.failures
            states = pipeline.process_batch(recording)
        for sentence in failure_problems(pipeline, failures):
            print(f'  {loaded.name}: {sentence}', file=sys.stderr)
        rows = np.arange(count)
    elif loaded.contacts is not None:
        states, rows = loaded.contacts.states, loaded.contacts.rows
    else:
        states, rows = ContactStates.assemble(count, taxels, {}), np.arange(count)
    for n, row in enumerate(rows.tolist()):
        yield recording.layout, recording.frame(row), states[n]


def paced(shown: Iterator[Shown], options: argparse.Namespace) -> Iterator[Shown]:
    """The same at the times of their stamps; frames without stamps at the layout's rate."""
    began, first = time.monotonic(), None
    for number, (layout, frame, state) in enumerate(shown):
        stamp = frame.stamp_ns
        if stamp is None:
            stamp = round(1e9 * number / (layout.rate_hz or 100.0))
        first = stamp if first is None else first
        due = (stamp - first) * 1e-9 / options.speed if options.speed else 0.0
        if options.seconds is not None and max(due, time.monotonic() - began) > options.seconds:
            return
        time.sleep(max(0.0, began + due - time.monotonic()))
        yield layout, replace(frame, stamp_ns=stamp), state
