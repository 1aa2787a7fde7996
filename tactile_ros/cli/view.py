# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Show taxels, contacts, forces and grip live in the browser, or in Foxglove.

The page opens by itself and is served on this machine alone. Without anything named it shows the
topics of running nodes; a bag or file is played; a board is read without ROS, or simulated.

example:
  tactile view
  tactile view --namespace thumb --namespace index --control
  tactile view --sensor reskin_board --board /dev/ttyACM0
  tactile view --sensor gradiometer --control
  tactile view out/demo/reskin_board/bags/place --loop
  tactile view --sensor taxel_array --foxglove
  tactile view --sensor taxel_array --seconds 5 --mcap out/taxels.mcap
"""

from __future__ import annotations

import argparse
import os
import sys
import threading
import time
import webbrowser
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future
from contextlib import ExitStack, suppress
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from tactile_ros.cli import interruptible
from tactile_ros.cli.console import PATIENCE_S, SHARE, note, refuse_unwritable, working
from tactile_ros.errors import DeviceTimeout, MissingPackageError, RecordingError, TactileError
from tactile_ros.evaluation.fleet import open_calibration
from tactile_ros.evaluation.recording_files import LoadedRecording, load
from tactile_ros.evaluation.replay import failure_problems
from tactile_ros.pipeline import Pipeline
from tactile_ros.sensors import SensorSpec, load_sensor
from tactile_ros.types import ContactState, ContactStates, Frame, Layout, SensorConfig
from tactile_ros.view.page_server import PageServer
from tactile_ros.view.viewer import Viewer

Shown = tuple[Layout, Frame, ContactState]
Show = Callable[[PageServer | Viewer], None]

PORT = 8765  # where Foxglove looks by itself
READ_S = 1.0
MOST_ROWS = 1000  # of simulated presses, for a fit of seconds
LEARNING = 'calibrating on simulated presses'
TARE_FRAMES = 50
LAYOUT = 'config/foxglove_view.json'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `tactile view`."""
    parser.add_argument('recording', nargs='?', help='bag, .npz or .csv to play; none: topics')
    parser.add_argument('--sensor', help='simulate this sensor, see `tactile list`')
    parser.add_argument('--board', help='port or I2C bus of a real --sensor, read without ROS')
    parser.add_argument('--namespace', action='append', help='namespace of topics (all)')
    parser.add_argument('--calibration', type=Path, help='calibration file (.npz)')
    parser.add_argument('--speed', type=float, default=1.0, help='speed of playing; 0: at once')
    parser.add_argument('--loop', action='store_true', help='play for ever, once a page is open')
    parser.add_argument('--seed', type=int, default=0, help='seed of the simulated sensor')
    parser.add_argument('--seconds', type=float, help='stop by itself after so long')
    parser.add_argument('--port', type=int, default=PORT, help=f'page port ({PORT}; 0: any)')
    parser.add_argument('--control', action='store_true', help='the page may tare (key T)')
    parser.add_argument('--no-open', action='store_true', help='print the address alone')
    parser.add_argument('--foxglove', action='store_true', help='serve Foxglove instead of a page')
    parser.add_argument('--mcap', type=Path, help='write a file for Foxglove, without a server')


def run(options: argparse.Namespace) -> int:
    """Open the viewer and feed it until the end or Ctrl-C."""
    check_options(options)
    show = load_shown(options)
    with open_viewer(options) as viewer:
        try:
            with interruptible():
                show(viewer)
        except KeyboardInterrupt:
            print('stopping', file=sys.stderr)
    return 0


def check_options(options: argparse.Namespace) -> None:
    """Refuse options that contradict one another."""
    if options.sensor and options.recording:
        msg = f'name a recording or --sensor; received {options.recording} and {options.sensor}'
        raise ValueError(msg)
    if options.board and not options.sensor:
        raise ValueError(f'--board needs the --sensor that it is; received {options.board} alone')
    if options.speed < 0 or (options.seconds or 0) < 0:
        raise ValueError('--speed and --seconds must be 0 or more')
    if not 0 <= options.port < 2**16:
        raise ValueError(f'--port must be 0 to {2**16 - 1}; received {options.port}')
    if options.loop and not (options.speed and options.recording):
        raise ValueError('--loop needs a recording and a --speed above 0')
    if options.mcap and options.mcap.exists():
        raise TactileError(f'{options.mcap} exists already; name a file that does not')
    if options.mcap:
        refuse_unwritable(options.mcap)


def load_shown(options: argparse.Namespace) -> Show:
    """Read what was named, before anybody is asked to connect; return what shows it."""
    if options.sensor:
        spec = load_sensor(options.sensor)
        calibration = spec.load(options.calibration) if options.calibration else None
        return partial(show_sensor, options, spec, calibration)
    if options.recording:
        if not Path(options.recording).exists():
            raise RecordingError(f'{options.recording} does not exist; name a bag, .npz or .csv')
        with working(f'reading {options.recording}'):
            calibration = open_calibration(options.calibration) if options.calibration else None
            layout = calibration.layout if calibration else None
            found = load(Path(options.recording), layout).recordings
        return partial(show_recordings, options, found, calibration)
    try:
        from tactile_ros.nodes.viewer_node import ViewerNode
    except ImportError as error:
        msg = 'topics need ROS 2; name a recording or --sensor, or set up with make'
        raise MissingPackageError(msg) from error

    def show_topics(viewer: PageServer | Viewer) -> None:
        node = ViewerNode(options.namespace or (), viewer.show, viewer.grip)
        if isinstance(viewer, PageServer):
            viewer.tare = node.tare
        node.run(options.seconds)

    return show_topics


def open_viewer(options: argparse.Namespace) -> PageServer | Viewer:
    """Page, server of Foxglove or file that was asked for, with a line that says where it is."""
    if options.mcap or options.foxglove:
        if options.mcap:
            options.mcap.parent.mkdir(parents=True, exist_ok=True)
        viewer = Viewer(None if options.mcap else options.port, options.mcap)
        address = f'connect Foxglove to {viewer.address}, layout {LAYOUT}; Ctrl-C ends'
        print(f'writing {options.mcap}' if options.mcap else address, file=sys.stderr, flush=True)
        return viewer
    page = PageServer(options.port, control=options.control)
    print(f'showing {page.address} ; Ctrl-C ends', file=sys.stderr, flush=True)
    screen = any(os.environ.get(name) for name in ('DISPLAY', 'WAYLAND_DISPLAY', 'BROWSER'))
    if screen and not options.no_open:
        threading.Thread(target=webbrowser.open, args=(page.address,), daemon=True).start()
    return page


class LivePipeline:
    """Pipeline of what is read, in one thread, and tared in another."""

    def __init__(self, pipeline: Pipeline, learned: Future[Pipeline] | None) -> None:
        self.pipeline = pipeline
        self._learned = learned  # takes its place when it is there
        self._recent: deque[Frame] = deque(maxlen=TARE_FRAMES)
        self._lock = threading.Lock()

    def tare(self, _: str) -> str:
        """Take the last frames for rest; return what was done, or why not."""
        with self._lock:
            try:
                self.pipeline.tare(list(self._recent))
            except ValueError as error:
                return str(error)
            return f'tared on the last {len(self._recent)} frames'

    def process(self, frame: Frame) -> ContactState:
        """State of the next frame."""
        with self._lock:
            if self._learned is not None and self._learned.done():
                self.pipeline, self._learned = self._learned.result(), None
                print('calibrated on simulated presses', file=sys.stderr)
            self._recent.append(frame)
            return self.pipeline.process(frame)


def show_sensor(
    options: argparse.Namespace, spec: SensorSpec, calibration: Pipeline | None,
    viewer: PageServer | Viewer,
) -> None:  # fmt: skip
    """Frames of a board or of a twin through the driver, and what a pipeline says of them."""
    usual = {} if options.board else spec.demo
    config = calibration.config if calibration else spec.config(**usual)
    learned = None
    if calibration is None and not options.board:
        learned = learning(lambda: fitted(spec, config, options.seed + 1))
        if not isinstance(viewer, PageServer):  # a page shows the nominal model meanwhile
            with working(f'calibrating {spec.key} on simulated presses'):
                learned.result()
    live = LivePipeline(calibration or spec.pipeline(config), learned)
    end = end_of(options)
    with ExitStack() as held:
        if options.board:
            connection = spec.connection().at(options.board)
            device = held.enter_context(spec.open(config, connection, time.time_ns))
        else:
            twin = held.enter_context(spec.simulate(config, spec.connection(), None, options.seed))
            device = held.enter_context(twin.device(time.time_ns))
        if isinstance(viewer, PageServer):
            viewer.tare = live.tare
            if learned is not None:
                viewer.guide({'targets': [], 'phase': '', 'text': LEARNING, 'error': ''})
                learned.add_done_callback(lambda _: viewer.guide(None))
        while time.monotonic() < end:
            try:
                frame = device.read(READ_S)
            except DeviceTimeout:
                continue
            viewer.show('', live.pipeline.layout, frame, live.process(frame))


def end_of(options: argparse.Namespace) -> float:
    """Monotonic time at which the view stops by itself (s)."""
    return float('inf') if options.seconds is None else time.monotonic() + options.seconds


def learning(fit: Callable[[], Pipeline]) -> Future[Pipeline]:
    """Calibration that is made meanwhile, in a thread that no end waits for."""
    made: Future[Pipeline] = Future()

    def work() -> None:
        try:
            made.set_result(fit())
        except Exception as error:  # raised again where the result is asked for
            made.set_exception(error)

    threading.Thread(target=work, daemon=True).start()
    return made


def fitted(spec: SensorSpec, config: SensorConfig, seed: int) -> Pipeline:
    """Pipeline that has learned from some of a twin's presses, within seconds."""
    train = spec.presses(config, seed)
    some, began = train.select(slice(None, None, -(-len(train) // MOST_ROWS))), time.monotonic()
    with suppress(ValueError):  # a part may tell too little
        spec.pipeline(config).fit(some.select(slice(0, -(-len(some) // SHARE))))
        if (seconds := SHARE * (time.monotonic() - began)) > PATIENCE_S:
            print(f'{LEARNING}, about {seconds:.0f} s', file=sys.stderr)
    return spec.pipeline(config).fit(some)


def show_recordings(
    options: argparse.Namespace, found: Sequence[LoadedRecording], calibration: Pipeline | None,
    viewer: PageServer | Viewer,
) -> None:  # fmt: skip
    """Play every recording of a path, for ever where it loops."""
    page = viewer if isinstance(viewer, PageServer) else None
    if page and options.loop:
        page.wait_for_page(options.seconds)
    end = end_of(options)
    while True:
        for one in found:
            name = one.name if len(found) > 1 else ''
            for layout, frame, state in paced(played(one, calibration), options):
                viewer.show(name, layout, frame, state)
        if not options.loop or time.monotonic() > end:
            break
    if page and options.speed and options.seconds is None:
        print('played; the page stays until Ctrl-C', file=sys.stderr, flush=True)
        threading.Event().wait()


def played(loaded: LoadedRecording, pipeline: Pipeline | None) -> Iterator[Shown]:
    """Frames of a recording with what was said live, or what a calibration says of them."""
    recording = loaded.recording
    count, taxels = len(recording), len(recording.layout.positions)
    rows = np.arange(count)
    if pipeline is not None:
        with working(f'estimating {count} frames'):
            failures = pipeline.failures
            states = pipeline.process_batch(recording)
        note(f'{loaded.name}: {said}' for said in failure_problems(pipeline, failures))
    elif loaded.contacts is not None:
        states, rows = loaded.contacts.states, loaded.contacts.rows
    else:
        states = ContactStates.assemble(count, taxels, {})
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
