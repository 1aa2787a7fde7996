# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Drivers over their twins: faults, hostile bytes, speed, processor time and memory.

Faults and the speed of buses are on a virtual clock; decoding, processor time and memory are this
machine's.
"""

import os
import tempfile
import threading
import time
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from benchmarks.harness.driver_speed import bus_rows, decoding_rows, memory_rows
from benchmarks.harness.fault_trials import STORM, STORMS, Road, Trial, noise_beside, suffer, ways
from benchmarks.harness.fuzz import (
    PIECE,
    BoardSubject,
    FramedSubject,
    suffer_answers,
    suffer_bytes,
)
from benchmarks.harness.live import QUIET, processor_s, resident_kib
from benchmarks.harness.rows import BenchResult, Row
from reference.hidden_damage import hidden_damage
from tactile_ros.cli.record import wait_for_frames
from tactile_ros.devices.framed_protocol import (
    five_wires,
    gradiometer,
    taxel_matrix,
    three_axis_chips,
)
from tactile_ros.devices.simulated_serial import BYTE_FAULTS
from tactile_ros.evaluation.recording_files import load
from tactile_ros.nodes.graph import Graph, Process
from tactile_ros.nodes.processes import Running
from tactile_ros.sensors import list_sensors, load_sensor

STRINGS = {'quick': 2_000, 'normal': 1_000_000, 'full': 1_000_000}
DECODED = {'quick': 20_000, 'normal': 1_000_000, 'full': 1_000_000}
NODE_S = {'quick': (3.0, 3.0), 'normal': (10.0, 100.0), 'full': (10.0, 100.0)}  # 100 Hz, 1 kHz
WARM_S = {'quick': 3.0, 'normal': 10.0, 'full': 10.0}
ON_ITS_WAY_S = 0.5
SUMS = ('injected', 'counted', 'wrong')


def run(extent: str, command: str) -> BenchResult:
    """Measure all."""
    table, rows = _faults(extent)
    rows += [*_fuzz(STRINGS[extent]), *_hidden(extent), *bus_rows(), *decoding_rows()]
    rows += [*memory_rows(DECODED[extent]), *_nodes(extent)]
    notes = [
        'recovery: longest time between two frames of which every taxel may be used, the fault '
        'once and in a storm; unplug lasts 1 s of it, stall 0.5 s',
        'counted: by the counter of the driver, or frames that were marked; bus_errors counts '
        'tries on an unplugged bus, suspected the frames that are missing by the clock',
        'reskin_board: flipped, garbage and shifted may keep length and plausibility, lost frames '
        'leave no trace; its format shows no more',
        'stuck_chip: frames with a reading marked STALE or STUCK; the only converter of '
        'taxel_array and five_wire_skin freezes as a whole',
        f'fuzz: {STRINGS[extent]} strings for each decoder, a third each of random bytes, frames '
        'damaged in one of 7 ways, and 1 to 8 bytes overwritten; good frames before and after',
        *table,
    ]
    if extent == 'quick':
        notes.append('quick: faults in storms alone, no bursts over I2C; nodes for 3 s, after 3 s')
    return BenchResult('devices', command, [0, 1], rows, notes)


def _faults(extent: str) -> tuple[list[str], list[Row]]:
    """Every fault of every twin, once and in a storm: a table by kind of driver, and all rows."""
    rows: list[Row] = []
    outcomes: dict[tuple[str, str], list[Trial]] = {}
    wrong = unequal = 0
    threads, files = threading.active_count(), _descriptors()
    for key in list_sensors():
        for how in ways(load_sensor(key))[:: 2 if extent == 'quick' else 1]:  # no bursts
            name = ' '.join([key, *map(str, how.values())])
            untried = Road(load_sensor(key), how)
            twin = untried.twin
            kind = 'ReSkin board' if name == 'reskin_board' else 'framed boards'
            kind = 'chips on I2C' if 'i2c' in name else kind
            for fault in twin.faults:
                counts = (1, STORMS.get(fault, STORM))
                noise = noise_beside(fault, untried.layout)
                with Road(load_sensor(key), how, noise=noise) as road:
                    asked = counts[1:] if extent == 'quick' else counts
                    trials = [suffer(road, fault, count, 0.25) for count in asked]
                injected, counted, bad = _sums(trials)
                what = f'{name}, {fault}: injected {injected}, counted {counted}, wrong {bad}'
                recovery = max(trial.recovery_s for trial in trials)
                rows.append(Row(f'{what}; recovery', 's', recovery, aim=2.0))
                outcomes.setdefault((kind, fault), []).extend(trials)
                wrong += 0 if fault in twin.unseen else bad
                if not twin.unseen and 'i2c' not in name and fault != 'stuck_chip':
                    unequal += sum(abs(t.counted - t.injected) for t in trials)
    left = threading.active_count() - threads + _descriptors() - files
    table = [
        '| driver | fault | injected | counted | wrong | recovery (s) |',
        '|---|---|---|---|---|---|',
    ]
    for (kind, fault), trials in sorted(outcomes.items()):
        recovery = max(trial.recovery_s for trial in trials)
        cells = [kind, fault, *map(str, _sums(trials)), f'{recovery:.2f}']
        table.append(f'| {" | ".join(cells)} |')
    return table, [
        *rows,
        *(
            Row(f'faults: {what}', unit, float(count), bound=0.0, aim=0.0)
            for what, unit, count in (
                ('wrong readings marked valid, besides what the notes name', 'readings', wrong),
                ('difference of counted and injected, framed protocol', 'faults', unequal),
                ('threads and descriptors left behind', 'count', left),
            )
        ),
    ]


def _sums(trials: list[Trial]) -> list[int]:
    """How often a fault was injected and counted, and how many readings were wrong."""
    return [sum(getattr(trial, what) for trial in trials) for what in SUMS]


def _descriptors() -> int:
    """Open files of this process."""
    return len(os.listdir('/proc/self/fd'))  # noqa: PTH208


def _fuzz(count: int) -> list[Row]:
    """Random and mutated strings through each decoder, random answers of chips to the driver."""
    payloads = (gradiometer(), three_axis_chips(5), taxel_matrix(16), five_wires())
    subjects = {f'framed {one.kind.name.lower()}': FramedSubject(one) for one in payloads}
    rows: list[Row] = []
    for name, subject in {**subjects, 'ReSkin, 5 chips': BoardSubject(5)}.items():
        found = suffer_bytes(subject, count, 1)
        what = f'fuzz {name}, {found.strings} strings'
        rows += [
            Row(f'{what}: frames with wrong numbers delivered', '%',
                100 * found.wrong / found.strings, bound=0.0,
                aim=0.0 if name in subjects else None),
            Row(f'{what}: most good frames lost by one', 'frames', float(found.lost), aim=1.0),
            Row(f'{what}: most bytes held back', 'bytes', float(found.held), aim=8192.0),
            Row(f'{what}: slowest feed of {PIECE} bytes', 'ms', 1e3 * found.slowest_s, aim=250.0),
        ]  # fmt: skip
    for part in ('answers', 'status bytes'):
        status = part == 'status bytes'
        chips = suffer_answers(count // 10, 3, status, np.random.default_rng(1))
        what = f'fuzz MLX90393 {part} at RES 3, {chips.strings} strings'  # codes beyond the range
        figures = {'readings beyond the range that no bit marks': chips.beyond}
        if status:
            figures['wrong readings that no bit marks'] = chips.wrong
        rows += [
            *(Row(f'{what}: {name}', 'readings', float(figure), bound=0.0, aim=0.0)
              for name, figure in figures.items()),
            Row(f'{what}: time until all chips are good', 's', chips.recovery_s, aim=5.0),
        ]  # fmt: skip
    return rows


def _hidden(extent: str) -> list[Row]:
    """Share of damage that ReSkin's format cannot show, on a shipped recording."""
    values = load_sensor('reskin_board').recordings()['normal_1'].values[:500]
    rows = []
    for kind in BYTE_FAULTS:
        found = hidden_damage(values, kind, 0, 50 if extent == 'quick' else 1000)
        what = f'ReSkin frames {kind}: delivered'
        rows += [
            Row(f'{what}, numbers wrong', '%', 100 * found.passed),
            Row(f'{what}, wrong by more than 1 uT', '%', 100 * found.misled),
        ]
    return rows


def _nodes(extent: str) -> list[Row]:
    """Share of a core that sensor_node takes at its port, and its memory."""
    jobs = (
        ('100 Hz x 20 chips', 'multipole_skin', {'transport': 'serial'}, 100.0, 15.0),
        ('1 kHz x 8 channels', 'gradiometer', {}, 1000.0, 40.0),
    )
    rows: list[Row] = []
    for (name, sensor, how, rate_hz, aim), seconds in zip(jobs, NODE_S[extent], strict=True):
        what = f'sensor_node, {name}'
        if find_spec('rclpy') is None:
            rows.append(Row(f'{what}: not measured, no rclpy here', '%', None, aim=aim))
            continue
        cores, grown, heard = _node(sensor, how, rate_hz, WARM_S[extent], seconds)
        rows += [
            Row(f'{what}: share of a core', '%', 100 * cores, aim=aim),
            Row(f'{what}: memory grown over {round(rate_hz * seconds)} frames', 'KiB', grown,
                bound=0.0, aim=2048.0),
            Row(f'{what}: frames heard by a recorder', '%', 100 * heard, 'high', bound=100.0,
                aim=99.0),
        ]  # fmt: skip
    return rows


def _node(
    sensor: str, how: dict[str, object], rate_hz: float, warm: float, seconds: float
) -> tuple[float, float, float]:
    """Cores, growth of memory (KiB), and share of the frames that a recorder heard, after a while.

    The twin sends from this process, so that the node has only a port to read, as with a board.
    """
    spec = load_sensor(sensor)
    config = replace(spec.config(), rate_hz=rate_hz)
    connection = spec.connection(native_usb=True, **how)
    level = np.full(spec.layout(config).shape, 1e-4)
    with tempfile.TemporaryDirectory() as name:
        bag = Path(name) / 'bag'
        with spec.simulate(config, connection, lambda t: level * (1 + 0.1 * np.sin(t)), 0) as twin:
            values = {'sensor': sensor, 'port': twin.port, 'rate_hz': rate_hz, 'native_usb': True,
                      'listeners': 1, **how}  # fmt: skip
            graph = Graph((Process('record', {'bag': str(bag)}), Process('sensor_node', values)))
            with Running(graph, QUIET) as running:
                wait_for_frames(running, bag)
                time.sleep(warm)
                pid, began_ns = running.children['sensor_node'].pid, time.time_ns()
                memory, spent, began = resident_kib(pid), processor_s(pid), time.monotonic()
                time.sleep(seconds)
                cores = (processor_s(pid) - spent) / (time.monotonic() - began)
                grown, ended_ns = resident_kib(pid) - memory, time.time_ns()
                time.sleep(ON_ITS_WAY_S)
        stamp_ns = load(bag).recordings[0].recording.stamp_ns
    heard = np.count_nonzero((stamp_ns > began_ns) & (stamp_ns <= ended_ns))
    return cores, grown, min(1.0, heard * 1e9 / (rate_hz * (ended_ns - began_ns)))
