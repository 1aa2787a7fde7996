# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""multipole_skin through the graph: processor time, delay and losses of 20 chips at 100 Hz.

The twin sends the bytes of its lesson (heads that press, one of them unknown) from this process,
so that the nodes have only a port to read, as with a board. Cost is the processor time of
sensor_node and contact_node for so many frames as they come in a second; every window is looked
for among templates of all heads.
"""

import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.harness.live import QUIET, Replayed, processor_s
from benchmarks.harness.rows import BenchResult, Row
from tactile_ros.cli.record import wait_for_frames
from tactile_ros.enrolment import playing
from tactile_ros.evaluation.metrics import spread
from tactile_ros.evaluation.recording_files import load
from tactile_ros.nodes.graph import SensorSetup, sensing
from tactile_ros.nodes.processes import Running
from tactile_ros.sensors import load_sensor

SECONDS = {'quick': 3.0, 'normal': 35.0, 'full': 120.0}
RATE_HZ, CORE_AIM = 100.0, 25.0
SPEC = load_sensor('multipole_skin')
WARM_S, LATEST_S, LOOK_S = 3.0, 20.0, 0.5


def run(extent: str, command: str) -> BenchResult:
    """Two processes, then one."""
    config = replace(SPEC.config(), rate_hz=RATE_HZ)
    scene, rows = SPEC.new_class.scene(config, 0, 0.0), []
    connection = SPEC.connection(transport='serial', native_usb=True)
    with tempfile.TemporaryDirectory() as name:
        path = Path(name) / 'skin.npz'
        lesson = SPEC.new_class.calibration(config, 1)
        if extent == 'quick':
            lesson = lesson.select(slice(0, len(lesson) // 4))
        SPEC.pipeline(config).fit(lesson).save(path)
        for stack in (False, True) if extent != 'quick' else (False,):
            with SPEC.simulate(config, connection, playing(scene), 0) as twin:
                rows += _live(path, twin.port, SECONDS[extent], stack)
    notes = [
        f'{len(config.positions)} chips at {RATE_HZ:g} Hz for {SECONDS[extent]:g} s a road, '
        f'after {WARM_S:g} s; pressed for 0.85 s of every 1.2 s; '
        f'{len(config.objects)} drawn heads, a window of {config.window} frames'
    ]
    if extent == 'quick':
        notes.append('quick: two processes alone, calibrated by the first quarter of the lesson')
    return BenchResult('multipole_graph', command, [0], rows, notes)


def _live(path: Path, port: str, seconds: float, stack: bool) -> list[Row]:
    """Figures of one live run, and of the replay of its bag."""
    bag = path.parent / ('stack' if stack else 'processes')
    setting = SensorSetup(
        sensor=SPEC.key, port=port, namespace=bag.name, calibration=str(path), bag=str(bag),
        stack=stack,
    )  # fmt: skip
    values = {'rate_hz': RATE_HZ, 'transport': 'serial', 'native_usb': True}
    graph = sensing(setting).with_parameters('sensor_node', values)
    nodes = [p.executable for p in graph.processes if p.executable != 'record']
    with Running(graph, QUIET) as running:

        def spent() -> np.ndarray:
            return np.array([processor_s(running.children[node].pid) for node in nodes])

        wait_for_frames(running, bag)
        time.sleep(WARM_S)
        before, began_ns = spent(), time.time_ns()
        time.sleep(seconds)
        took, ended_ns = spent() - before, time.time_ns()
        if not stack:
            running.stop(['sensor_node'])
            _wait_for_contacts(bag)
    found = Replayed.of(bag, SPEC.load(path))
    # by the frames that went through: a busy machine is late, and spends less meanwhile
    through = np.count_nonzero((found.live.log_ns > began_ns) & (found.live.log_ns <= ended_ns))
    shares = 100 * RATE_HZ * took / through
    answered = np.isfinite(found.live.states.position[:, 0])
    name = 'one process' if stack else 'two processes'
    alone = [
        Row(f'{name}: {node} alone', '% of a core', float(share))
        for node, share in zip(nodes, shares, strict=True)
    ]
    return [
        Row(f'{name}: sensor and contact', '% of a core', float(shares.sum()), aim=CORE_AIM),
        *(alone if len(nodes) > 1 else ()),
        *found.rows(name),
        Row(f'{name}: delay of the last frame of a window, p50', 'ms',
            1e3 * spread(found.delay[answered]).p50),
        Row(f'{name}: windows answered', 'windows', float(answered.sum()), 'high'),
    ]  # fmt: skip


def _wait_for_contacts(bag: Path) -> None:
    """Wait until the contacts of all frames are in a bag, for a while at most."""
    end = time.monotonic() + LATEST_S
    while time.monotonic() < end:
        time.sleep(LOOK_S)
        one = load(bag).recordings[0]
        if one.contacts is not None and len(one.contacts.rows) >= len(one.recording):
            return
