# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Replay of a bag: speed against real time and against rosbags' own reading, memory, agreement.

The bag is that of a live run: a board of 20 chips at 100 Hz, its frames with temperatures, the
contacts that the pipeline said frame by frame, baselines of tares, and truth by sequence. Signal
and noise are made up: what is measured here is cost and agreement, not accuracy. Times are
processor time of one process with one thread, the least of three runs.
"""

import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from copy import copy
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.harness.rows import BenchResult, Row
from tactile_ros.evaluation.bag import BagWriter, all_types, blank_message, cdr_of
from tactile_ros.evaluation.fleet import evaluate_bag
from tactile_ros.evaluation.recording_files import Bag, load
from tactile_ros.evaluation.replay import replay
from tactile_ros.messages import fill_contacts, fill_frame, fill_header, fill_layout
from tactile_ros.pipeline import Pipeline
from tactile_ros.sensors import load_sensor
from tactile_ros.types import Frame, Recording

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
            least, most = (_peak(one, folder / 'calibration.npz') for one in (short, bag))
            what = f'peak memory, bag {LONGER[extent]} x longer'
            rows += [
                Row('peak memory', 'MB', most / 1e3),
                Row(what, 'ratio', most / least, aim=1.1),
            ]
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


def write_bag(path: Path, pipeline: Pipeline, recording: Recording) -> None:
    """What a recorder hears of a live run, a tare every ten seconds."""
    pipeline = copy(pipeline)  # its tares are its own
    pipeline.reset()
    blank = pipeline.process_batch(recording.select(slice(0, 1)))[0]
    blank = replace(blank, position_cov=np.full((3, 3), np.nan), contacts_id=np.array([-1]))

    def frame_of(frame: Frame) -> object:
        message = blank_message('TactileFrame')
        fill_frame(message, frame, 'tactile_sensor')
        return message

    def contacts(frame: Frame, state: object, stamp_ns: int | None) -> object:
        message = blank_message('TactileContacts')
        fill_contacts(message, state, partial(blank_message, 'TactileContact'))
        fill_header(message.header, stamp_ns, 'tactile_sensor')
        message.sequence = frame.sequence
        return message

    with BagWriter(path) as bag:

        def put(topic: str, message: object, log_ns: int) -> None:
            bag.write(topic, message.__msgtype__, log_ns, cdr_of(message))

        layout = blank_message('TactileLayout')
        parts = (partial(blank_message, f'geometry_msgs/msg/{k}') for k in ('Point', 'Quaternion'))
        fill_layout(layout, recording.layout, *parts)
        layout.rate_hz = float(RATE_HZ)
        put('/layout', layout, START_NS)
        text = blank_message('std_msgs/msg/String')
        text.data = pipeline.digest
        put('/calibration', text, START_NS)
        for row in range(len(recording)):
            frame = recording.frame(row)
            at = frame.stamp_ns
            if row % (10 * RATE_HZ) == 10:
                rest = Frame(at, row, recording.values[row], averaged=0)
                put('/baseline', frame_of(rest), at)
                pipeline.tare([rest])
            put('/frame', frame_of(frame), at + 1_000_000)
            put('/contacts', contacts(frame, pipeline.process(frame), at), at + 2_000_000)
            row_truth = {key: value[row] for key, value in recording.truth.items()}
            truth = contacts(frame, replace(blank, **row_truth), None)
            put('/truth/contacts', truth, at + 3_000_000)


def timed(what: Callable[[], object], repeats: int) -> tuple[object, float]:
    """What comes out of some runs, and their least processor time (s)."""
    spent = []
    for _ in range(repeats):
        begin = time.process_time()
        result = what()
        spent.append(time.process_time() - begin)
    return result, min(spent)


def _rows(bag: Path, pipeline: Pipeline, frames: int, repeats: int) -> list[Row]:
    """Figures of one bag."""
    (found,), ours = timed(lambda: evaluate_bag(bag, {'c': pipeline}), repeats)
    _, read = timed(lambda: sum(1 for _ in Bag(bag)), repeats)
    _, theirs = timed(lambda: _by_rosbags(bag), repeats)
    part, micro = found.answers[0].target('position').spread, 1e6 / frames
    return [
        Row('replay against real time', 'ratio', frames / RATE_HZ / ours, 'high', aim=500.0,
            us_batch=micro * ours),
        Row('replay against reading by rosbags', 'ratio', ours / theirs, aim=3.0),
        Row('of it: reading into arrays', 'us', micro * read, peer=micro * theirs),
        Row('largest difference to live contacts', '1', found.answers[0].agreement.largest,
            bound=0.0, aim=1e-9),
        Row('mean error of place, pieces less whole', 'm', abs(part.mean - _whole(bag, pipeline)),
            bound=0.0, aim=1e-12),
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


def _peak(bag: Path, calibration: Path) -> int:
    """Largest memory of a process of its own that replays a bag (kB)."""
    command = [sys.executable, '-c', PEAK, str(bag), str(calibration)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return int(done.stdout)
