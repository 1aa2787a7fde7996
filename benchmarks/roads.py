# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""The three ways of one recording: processes over DDS, one process, and offline.

The board's bytes come from a player at 100 Hz. Delay runs from the arrival of a frame's bytes to
the recorder that heard its contacts; cost is the processor time of the nodes between them.
"""

import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.harness.live import QUIET, Replayed, processor_s
from benchmarks.harness.rows import BenchResult, Row
from tactile_ros.evaluation.recording_files import load, save_recording
from tactile_ros.evaluation.replay import replay
from tactile_ros.nodes.graph import SensorSetup, sensing
from tactile_ros.nodes.processes import Running
from tactile_ros.sensors import load_sensor
from tactile_ros.types import Recording

SECONDS = {'quick': 3, 'normal': 20, 'full': 60}
RATE_HZ, SPEC = 100, load_sensor('reskin_board')


def run(extent: str, command: str) -> BenchResult:
    """Play the same rows through both live ways, and replay their bags."""
    rows, cores = [], []
    with tempfile.TemporaryDirectory() as name:
        folder, recordings = Path(name), SPEC.recordings()
        SPEC.pipeline().fit(recordings['normal_1']).save(folder / 'calibration.npz')
        save_recording(steady(recordings['normal_2'], SECONDS[extent]), folder / 'rows.npz')
        for way, stack in (('processes over DDS', False), ('stack, one process', True)):
            found, spent = _live(folder, stack=stack)
            cores.append(spent)
            rows += [*found.rows(way), Row(f'{way}: processor, with start-up', 'cores', spent)]
        loaded = load(folder / 'rows.npz').recordings[0]
        offline = replay(loaded, SPEC.load(folder / 'calibration.npz'))
    rows += [
        Row('offline replay: time per frame', 'us', offline.us_single,
            us_single=offline.us_single, us_batch=offline.us_batch),
        Row('stack against processes: processor time', 'ratio', cores[1] / cores[0]),
    ]  # fmt: skip
    return BenchResult('roads', command, [0], rows, [f'{RATE_HZ} Hz, {SECONDS[extent]} s a way'])


def steady(recording: Recording, seconds: int) -> Recording:
    """Rows after the first tare as one stream at the bench's rate."""
    count = min(seconds * RATE_HZ, len(recording) - 1) + 1
    period = 1_000_000_000 // RATE_HZ
    return replace(
        recording.select(slice(0, count)), tare=np.arange(count) == 0,
        stamp_ns=np.arange(count, dtype=np.int64) * period,
    )  # fmt: skip


def _live(folder: Path, *, stack: bool) -> tuple[Replayed, float]:
    """One live run with the replay of its bag, and the cores that its nodes took."""
    name = 'stack' if stack else 'processes'
    setting = SensorSetup(
        sensor=SPEC.key, source='recorded', port=str(folder / f'{name}.port'), namespace=name,
        recording=str(folder / 'rows.npz'), calibration=str(folder / 'calibration.npz'),
        bag=str(folder / name), stack=stack,
    )  # fmt: skip
    graph = sensing(setting)
    nodes = [p.executable for p in graph.processes if p.executable not in ('player', 'record')]
    with Running(graph, QUIET) as running:
        running.wait_for_line('player', 'played', timeout=120.0)
        spent = sum(processor_s(running.children[node].pid) for node in nodes)
    found = Replayed.of(folder / name, SPEC.load(folder / 'calibration.npz'))
    stamp_ns = found.recording.stamp_ns
    return found, spent / (1e-9 * float(stamp_ns[-1] - stamp_ns[0]))
