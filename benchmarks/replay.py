# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Replay of a bag: speed against real time and against rosbags' own reading, memory, agreement.

The bag is that of a live run: a board of 20 chips at 100 Hz, its frames with temperatures, the
contacts that the pipeline said frame by frame, baselines of tares, and truth by sequence. Signal
and noise are made up: what is measured here is cost and agreement, not accuracy. Times are
processor time of one process with one thread, the least of three runs.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from copy import copy
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.harness.rows import BenchResult, Row
from tactile_ros.evaluation.bag import BagWriter, all_types
from tactile_ros.evaluation.fleet import evaluate_bag
from tactile_ros.evaluation.recording_files import Bag, load
from tactile_ros.evaluation.replay import replay
from tactile_ros.messages import fill_contacts
from tactile_ros.sensors import load_sensor
from tactile_ros.types import Frame, Recording

if TYPE_CHECKING:
    from collections.abc import Callable

    from tactile_ros.pipeline import Pipeline

SHORT = 90  # s: more than two pieces, so that memory has reached what it needs
QUICK = 30  # s
LONGER = {'normal': 4, 'full': 16}
RATE_HZ, CHIPS = 100, 20
STEP_NS = 1_000_000_000 // RATE_HZ
START_NS = 1_700_000_000_000_000_000
REPEATS = {'quick': 1, 'normal': 3, 'full': 3}
SEED = 0
PEAK = (
    'import sys; from pathlib import Path;'
    'from tactile_ros.sensors import load_sensor;'
    'from tactile_ros.evaluation.fleet import evaluate_bag;'
    'bag, calibration = map(Path, sys.argv[1:]);'
    'evaluate_bag(bag, {"c": load_sensor("reskin_board").load(calibration)});'
    # the kernel's own count: that of getrusage begins with the parent's
    'print(Path("/proc/self/status").read_text().split("VmHWM:")[1].split()[0])'
)


def run(extent: str, command: str) -> BenchResult:
    """Write the bag, replay it, read it with rosbags."""
    quick = extent == 'quick'
    seconds = QUICK if quick else LONGER[extent] * SHORT
    frames = seconds * RATE_HZ
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        pipeline = fitted()
        pipeline.save(folder / 'calibration.npz')
        bag = folder / 'long'
        source = touches(frames, SEED + 1)
        write_bag(bag, pipeline, source)
        rows = _rows(bag, pipeline, frames, REPEATS[extent])
        if not quick:
            short = folder / 'short'
            write_bag(short, pipeline, source.select(slice(0, SHORT * RATE_HZ)))
            rows += _memory_rows(short, bag, folder / 'calibration.npz', LONGER[extent])
        size = sum(file.stat().st_size for file in bag.glob('*.mcap')) / 1e6
    said = f'{frames} frames of {CHIPS} chips with contacts and truth, {size:.0f} MB; '
    notes = [said + ', '.join(pipeline.estimators.values())]
    notes.append(f'times: the least of {REPEATS[extent]}')
    if quick:
        notes.append('quick: a short bag, without its memory')
    return BenchResult('replay', command, [SEED], rows, notes)


def board() -> tuple[object, np.ndarray]:
    """Config of a board of 20 chips, 4 mm apart, and the places of the chips."""
    x, y = np.meshgrid(np.arange(5) * 4e-3, np.arange(4) * 4e-3)
    places = np.column_stack([x.ravel(), y.ravel(), np.zeros(CHIPS)])
    config = load_sensor('reskin_board').config()
    return replace(config, positions=places), places


def touches(frames: int, seed: int) -> Recording:
    """Half a second of rest, half a second of touch at some place, over and over."""
    rng = np.random.default_rng(seed)
    config, places = board()
    number = np.arange(frames) // 50
    touched = number % 2 == 1
    spot = rng.uniform(0, [16e-3, 12e-3], (number[-1] + 1, 2))[number]
    push = rng.uniform(0.5, 3.0, number[-1] + 1)[number]
    away = places[None, :, :2] - spot[:, None]
    bump = push[:, None] * np.exp(-((away / 5e-3) ** 2).sum(axis=2))
    field = np.concatenate([0.3 * bump[..., None] * away, 1e-4 * bump[..., None]], axis=2)
    values = 1e-4 + field * touched[:, None, None] + rng.normal(0, 1e-7, field.shape)
    place = np.column_stack([spot, np.full(frames, np.nan)])
    force = np.column_stack([np.full((frames, 2), np.nan), np.where(touched, push, 0.0)])
    return Recording.from_arrays(
        load_sensor('reskin_board').layout(config), values,
        stamp_ns=START_NS + STEP_NS * np.arange(frames), sequence=np.arange(frames),
        temperature_c=np.full((frames, CHIPS), 25.0),
        truth={
            'position': np.where(touched[:, None], place, np.nan),
            'force': force,
            'in_contact': touched.astype(int),
        },
    )  # fmt: skip


def fitted() -> Pipeline:
    """The default pipeline of the board, fitted on other touches."""
    config, _ = board()
    return load_sensor('reskin_board').pipeline(config).fit(touches(1500, SEED))


class Messages:
    """Serialised messages of the board."""

    def __init__(self, recording: Recording) -> None:
        self.store = all_types()
        self.recording = recording
        self.makers: dict[str, Callable[[], object]] = {}

    def new(self, name: str) -> object:
        """A message with every field empty or zero."""
        if name not in self.makers:
            kind, fields = self.store.types[name], self.store.fielddefs[name][1]
            makers = {field: self._maker(*what) for field, what in fields}
            self.makers[name] = lambda: kind(**{f: make() for f, make in makers.items()})
        return self.makers[name]()

    def _maker(self, kind: int, what: object) -> Callable[[], object]:
        if kind == 1:
            blank = '' if what[0] == 'string' else np.dtype(what[0]).type(0).item()
            return lambda: blank
        if kind == 2:
            return lambda: self.new(what)
        (inner, name), count = what
        if inner == 1 and name[0] != 'string':
            return lambda: np.zeros(count, name[0])
        return list

    def header(self, message: object, stamp_ns: int) -> None:
        """Stamp and frame id."""
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp_ns, 10**9)
        message.header.frame_id = 'tactile_sensor'

    def frame(self, frame: Frame) -> object:
        """TactileFrame."""
        message = self.new('tactile_ros/msg/TactileFrame')
        self.header(message, frame.stamp_ns or 0)
        message.sequence, message.valid = frame.sequence, True
        message.values = np.ravel(frame.values)
        if frame.temperature_c is not None:
            message.temperature_c = frame.temperature_c
        return message

    def layout(self) -> object:
        """TactileLayout."""
        message = self.new('tactile_ros/msg/TactileLayout')
        layout = self.recording.layout
        message.sensor, message.unit = layout.sensor, layout.unit
        message.channels, message.rate_hz = list(layout.channels), float(RATE_HZ)
        message.saturation = np.asarray(layout.saturation, np.float64)
        for x, y, z in layout.positions.tolist():
            point = self.new('geometry_msgs/msg/Point')
            point.x, point.y, point.z = x, y, z
            message.positions.append(point)
        return message

    def contacts(self, frame: Frame, state: object, *, stamped: bool = True) -> object:
        """TactileContacts of a state or of a row of truth."""
        message = self.new('tactile_ros/msg/TactileContacts')
        fill_contacts(message, state, lambda: self.new('tactile_ros/msg/TactileContact'))
        for name in ('taxel_force', 'deformation', 'taxel_status'):
            setattr(message, name, np.asarray(getattr(message, name)))
        self.header(message, frame.stamp_ns if stamped else 0)
        message.sequence = frame.sequence
        return message

    def cdr(self, message: object) -> bytes:
        """Serialised."""
        return bytes(self.store.serialize_cdr(message, message.__msgtype__))


def write_bag(path: Path, pipeline: Pipeline, recording: Recording) -> None:
    """What a recorder hears of a live run, a tare every ten seconds."""
    messages = Messages(recording)
    pipeline = copy(pipeline)  # its tares are its own
    pipeline.reset()
    blank = pipeline.process_batch(recording.select(slice(0, 1)))[0]
    with BagWriter(path) as bag:

        def put(topic: str, message: object, log_ns: int) -> None:
            bag.write(topic, message.__msgtype__, log_ns, messages.cdr(message))

        put('/layout', messages.layout(), START_NS)
        text = messages.new('std_msgs/msg/String')
        text.data = pipeline.digest
        put('/calibration', text, START_NS)
        for row in range(len(recording)):
            frame = recording.frame(row)
            if row % (10 * RATE_HZ) == 10:
                rest = Frame(frame.stamp_ns, row, recording.values[row], averaged=0)
                put('/baseline', messages.frame(rest), frame.stamp_ns)
                pipeline.tare([rest])
            put('/frame', messages.frame(frame), frame.stamp_ns + 1_000_000)
            state = pipeline.process(frame)
            put('/contacts', messages.contacts(frame, state), frame.stamp_ns + 2_000_000)
            told = {key: value[row] for key, value in recording.truth.items()}
            told |= {'position_cov': np.full((3, 3), np.nan), 'contacts_id': np.array([-1])}
            truth = replace(blank, **told)
            put('/truth/contacts', messages.contacts(frame, truth, stamped=False),
                frame.stamp_ns + 3_000_000)  # fmt: skip


@dataclass(frozen=True)
class Timed:
    """What came out, and the least processor time of some runs (s)."""

    result: object
    seconds: float


def timed(what: Callable[[], object], repeats: int) -> Timed:
    """Run it some times."""
    spent, result = [], None
    for _ in range(repeats):
        begin = time.process_time()
        result = what()
        spent.append(time.process_time() - begin)
    return Timed(result, min(spent))


def _rows(bag: Path, pipeline: Pipeline, frames: int, repeats: int) -> list[Row]:
    """Figures of one bag."""
    ours = timed(lambda: evaluate_bag(bag, {'c': pipeline}), repeats)
    read = timed(lambda: sum(1 for _ in Bag(bag)), repeats)
    theirs = timed(lambda: _by_rosbags(bag), repeats)
    (found,) = ours.result
    whole = _whole(bag, pipeline)
    part = found.answers[0].target('position').spread
    each = 1e6 * ours.seconds / frames
    return [
        Row('replay against real time', 'ratio', frames / RATE_HZ / ours.seconds, 'high',
            aim=500.0, us_batch=each),
        Row('replay against reading by rosbags', 'ratio', ours.seconds / theirs.seconds, aim=3.0),
        Row('of it: reading into arrays', 'us', 1e6 * read.seconds / frames,
            peer=1e6 * theirs.seconds / frames),
        Row('largest difference to live contacts', '1', found.answers[0].agreement.largest,
            bound=0.0, aim=1e-9),
        Row('mean error of place, pieces less whole', 'm', abs(part.mean - whole), bound=0.0,
            aim=1e-12),
    ]  # fmt: skip


def _by_rosbags(bag: Path) -> int:
    """Read and decode every message as rosbags does."""
    from rosbags.highlevel import AnyReader

    with AnyReader([bag], default_typestore=all_types()) as reader:
        return sum(
            reader.deserialize(data, connection.msgtype) is not None
            for connection, _, data in reader.messages()
        )


def _whole(bag: Path, pipeline: Pipeline) -> float:
    """Mean error of place by the road that holds the whole bag in memory, frame by frame."""
    (loaded,) = load(bag).recordings
    states = replay(loaded, pipeline).states
    error = states.position[:, :2] - loaded.recording.truth['position'][:, :2]
    return float(np.nanmean(np.linalg.norm(error, axis=1)))


def _memory_rows(short: Path, long: Path, calibration: Path, longer: int) -> list[Row]:
    """What bags of two lengths take."""
    least, most = (_peak(bag, calibration) for bag in (short, long))
    return [
        Row('peak memory', 'MB', most / 1e3),
        Row(f'peak memory, bag {longer} x longer', 'ratio', most / least, aim=1.1),
    ]


def _peak(bag: Path, calibration: Path) -> int:
    """Largest memory of a process of its own that replays a bag (kB)."""
    command = [sys.executable, '-c', PEAK, str(bag), str(calibration)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return int(done.stdout)
