# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""multipole_skin through the graph: processor time, delay and losses of 20 chips at 100 Hz.

The twin sends the bytes of its lesson (heads that press, one of them unknown) from this process,
so that the nodes have only a port to read, as with a board. Cost is the processor time of
sensor_node and contact_node for so many frames as they come in a second; every window is looked
for among templates of all heads.
"""

from __future__ import annotations

import tempfile
import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks.harness.driver_speed import processor_s
from benchmarks.harness.rows import BenchResult, Row
from tactile_ros.cli.record import wait_for_frames
from tactile_ros.enrolment import playing
from tactile_ros.evaluation.metrics import Spread, spread
from tactile_ros.evaluation.recording_files import load
from tactile_ros.evaluation.replay import replay
from tactile_ros.nodes.graph import SensorSetup, sensing
from tactile_ros.nodes.processes import Running
from tactile_ros.sensors import load_sensor

SECONDS = {'quick': 3.0, 'normal': 35.0, 'full': 120.0}
RATE_HZ = 100.0
SPEC = load_sensor('multipole_skin')
CORE_AIM = 25.0
SAME = 1e-9
WARM_S = 3.0
LATEST_S, LOOK_S = 20.0, 0.5


@dataclass(frozen=True)
class Road:
    """What one live run showed."""

    cores: dict[str, float]
    delay: Spread
    answers: Spread
    lost: int
    windows: int
    difference: float


def run(extent: str, command: str) -> BenchResult:
    """Two processes, then one."""
    config = replace(SPEC.config(), rate_hz=RATE_HZ)  # type: ignore[type-var]
    assert SPEC.lesson is not None
    scene = SPEC.lesson.scene(config, 0, 0.0)
    rows = []
    with tempfile.TemporaryDirectory() as name:
        path = Path(name) / 'skin.npz'
        lesson = SPEC.lesson.calibration(config, 1)
        if extent == 'quick':
            lesson = lesson.select(slice(0, len(lesson) // 4))
        SPEC.pipeline(config).fit(lesson).save(path)
        for stack in (False, True) if extent != 'quick' else (False,):
            with SPEC.simulate(config, _connection(), playing(scene), 0) as twin:
                road = _live(Path(name), path, twin.port, SECONDS[extent], stack)
            rows += _rows('one process' if stack else 'two processes', road)
    notes = [
        f'{len(config.positions)} chips at {RATE_HZ:g} Hz for {SECONDS[extent]:g} s a road, '
        f'after {WARM_S:g} s; pressed for 0.85 s of every 1.2 s; '
        f'{len(config.objects)} drawn heads, a window of {config.window} frames',
    ]
    if extent == 'quick':
        notes.append('quick: two processes alone, calibrated by the first quarter of the lesson')
    return BenchResult('multipole_graph', command, [0], rows, notes)


def _connection() -> object:
    return SPEC.connection(transport='serial', native_usb=True)


def _live(folder: Path, path: Path, port: str, seconds: float, stack: bool) -> Road:
    """One live run, and the replay of its bag."""
    bag = folder / ('stack' if stack else 'processes')
    setting = SensorSetup(
        sensor=SPEC.key, port=port, namespace=bag.name, calibration=str(path), bag=str(bag),
        stack=stack,
    )  # fmt: skip
    values = {'rate_hz': RATE_HZ, 'transport': 'serial', 'native_usb': True}
    graph = sensing(setting).with_parameters('sensor_node', values)
    nodes = [p.executable for p in graph.processes if p.executable != 'record']
    with Running(graph, {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}) as running:
        wait_for_frames(running, bag)
        time.sleep(WARM_S)
        before, began_ns = {n: processor_s(running.children[n].pid) for n in nodes}, time.time_ns()
        time.sleep(seconds)
        spent, ended_ns = (
            {n: processor_s(running.children[n].pid) - before[n] for n in nodes},
            time.time_ns(),
        )
        if not stack:
            running.stop(['sensor_node'])
            _wait_for_contacts(bag)
    loaded = load(bag).recordings[0]
    replayed = replay(loaded, SPEC.load(path))
    live, agreement = loaded.contacts, replayed.agreement
    assert live is not None
    assert agreement is not None
    assert loaded.recording.stamp_ns is not None
    delay = (live.log_ns - loaded.recording.stamp_ns[live.rows]) * 1e-9
    # by the frames that went through: a busy machine is late, and spends less meanwhile
    through = np.count_nonzero((live.log_ns > began_ns) & (live.log_ns <= ended_ns))
    cores = {node: RATE_HZ * cost / through for node, cost in spent.items()}
    answered = np.isfinite(live.states.position[:, 0])
    return Road(
        cores, spread(delay), spread(delay[answered]),
        agreement.without_contacts, int(answered.sum()), agreement.largest,
    )  # fmt: skip


def _wait_for_contacts(bag: Path) -> None:
    """Wait until the contacts of all frames are in a bag, for a while at most."""
    end = time.monotonic() + LATEST_S
    while time.monotonic() < end:
        time.sleep(LOOK_S)
        one = load(bag).recordings[0]
        if one.contacts is not None and len(one.contacts.rows) >= len(one.recording):
            return


def _rows(name: str, road: Road) -> list[Row]:
    """Figures of one road."""
    total = 100 * sum(road.cores.values())
    parts = [
        Row(f'{name}: {node} alone', '% of a core', 100 * cores)
        for node, cores in road.cores.items()
        if len(road.cores) > 1
    ]
    return [
        Row(f'{name}: sensor and contact', '% of a core', total, aim=CORE_AIM),
        *parts,
        Row(f'{name}: delay p50', 'ms', 1e3 * road.delay.p50),
        Row(f'{name}: delay p99', 'ms', 1e3 * road.delay.p99),
        Row(f'{name}: delay of the last frame of a window, p50', 'ms', 1e3 * road.answers.p50),
        Row(f'{name}: windows answered', 'windows', float(road.windows), 'high'),
        Row(f'{name}: frames lost', 'frames', float(road.lost), bound=0.0, aim=0.0),
        Row(f'{name}: largest difference to replay', '1', road.difference, bound=0.0, aim=SAME),
    ]
