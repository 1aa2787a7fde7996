# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""The three roads of one recording: processes over DDS, one process, and offline.

The board's bytes come from a player at 100 Hz. Delay runs from the arrival of a frame's bytes to
the recorder that heard its contacts; cost is the processor time of the nodes between them.
"""

from __future__ import annotations

import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks.harness.driver_speed import processor_s
from benchmarks.harness.rows import BenchResult, Row
from tactile_ros.evaluation.metrics import Spread, spread
from tactile_ros.evaluation.recording_files import load, save_recording
from tactile_ros.evaluation.replay import replay
from tactile_ros.nodes.graph import SensorSetup, sensing
from tactile_ros.nodes.processes import Running
from tactile_ros.sensors import load_sensor
from tactile_ros.types import Recording

SECONDS = {'quick': 3, 'normal': 20, 'full': 60}
RATE_HZ = 100
SENSOR = 'reskin_board'
SAME = 1e-9


@dataclass(frozen=True)
class Road:
    """What one live run showed."""

    delay: Spread
    cores: float
    dropped: int
    difference: float
    us_single: float


def run(extent: str, command: str) -> BenchResult:
    """Play the same rows through both live roads, and replay their bags."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        spec = load_sensor(SENSOR)
        source = spec.recordings()['normal_2']
        spec.pipeline().fit(spec.recordings()['normal_1']).save(folder / 'calibration.npz')
        save_recording(steady(source, SECONDS[extent]), folder / 'rows.npz')
        roads = {
            'processes over DDS': _live(folder, stack=False),
            'stack, one process': _live(folder, stack=True),
        }
        offline = _offline(folder)
    rows = [row for name, road in roads.items() for row in _rows(name, road)]
    rows += [
        Row('offline replay: time per frame', 'us', offline[0], us_single=offline[0],
            us_batch=offline[1]),
        Row('stack against processes: processor time', 'ratio',
            roads['stack, one process'].cores / roads['processes over DDS'].cores),
    ]  # fmt: skip
    return BenchResult('roads', command, [0], rows, [f'{RATE_HZ} Hz, {SECONDS[extent]} s a road'])


def steady(recording: Recording, seconds: int) -> Recording:
    """Rows after the first tare as one stream at the bench's rate."""
    count = min(seconds * RATE_HZ, len(recording) - 1) + 1
    part = recording.select(slice(0, count))
    tare = np.zeros(count, bool)
    tare[0] = True
    period = 1_000_000_000 // RATE_HZ
    return replace(part, tare=tare, stamp_ns=np.arange(count, dtype=np.int64) * period)


def _live(folder: Path, *, stack: bool) -> Road:
    """One live run, and the replay of its bag."""
    name = 'stack' if stack else 'processes'
    setting = SensorSetup(
        sensor=SENSOR, source='recorded', port=str(folder / f'{name}.port'), namespace=name,
        recording=str(folder / 'rows.npz'), calibration=str(folder / 'calibration.npz'),
        bag=str(folder / name), stack=stack,
    )  # fmt: skip
    graph = sensing(setting)
    nodes = [p.executable for p in graph.processes if p.executable not in ('player', 'record')]
    with Running(graph, {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}) as running:
        running.wait_for_line('player', 'played', timeout=120.0)
        spent = sum(processor_s(running.children[node].pid) for node in nodes)
    loaded = load(folder / name).recordings[0]
    replayed = replay(loaded, load_sensor(SENSOR).load(folder / 'calibration.npz'))
    recording, live = loaded.recording, loaded.contacts
    assert live is not None
    assert recording.stamp_ns is not None
    assert replayed.agreement is not None
    lasted = 1e-9 * float(recording.stamp_ns[-1] - recording.stamp_ns[0])
    return Road(
        spread((live.log_ns - recording.stamp_ns[live.rows]) * 1e-9), spent / lasted,
        replayed.agreement.without_contacts, replayed.agreement.largest, replayed.us_single,
    )  # fmt: skip


def _offline(folder: Path) -> tuple[float, float]:
    """Microseconds per frame without any graph, one at a time and in a batch."""
    loaded = load(folder / 'rows.npz').recordings[0]
    replayed = replay(loaded, load_sensor(SENSOR).load(folder / 'calibration.npz'))
    return replayed.us_single, replayed.us_batch


def _rows(name: str, road: Road) -> list[Row]:
    """Figures of one live road."""
    return [
        Row(f'{name}: delay p50', 'ms', 1e3 * road.delay.p50, us_single=road.us_single),
        Row(f'{name}: delay p99', 'ms', 1e3 * road.delay.p99),
        Row(f'{name}: processor, start-up included', 'cores', road.cores),
        Row(f'{name}: frames lost', 'frames', float(road.dropped), bound=0.0, aim=0.0),
        Row(f'{name}: largest difference to replay', '1', road.difference, bound=0.0, aim=SAME),
    ]
