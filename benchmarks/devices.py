# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Drivers over their twins: faults, hostile bytes, speed, processor time and memory.

Faults and the speed of buses are on a virtual clock; decoding, processor time and memory are this
machine's.
"""

from __future__ import annotations

import os
import tempfile
import threading
import time
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from benchmarks.harness.driver_speed import (
    bus_rows,
    decoding_rows,
    memory_rows,
    processor_s,
    resident_kib,
)
from benchmarks.harness.fault_trials import STORM, STORMS, Road, Trial, suffer, ways
from benchmarks.harness.fuzz import (
    PIECE,
    BoardSubject,
    FramedSubject,
    Fuzzed,
    suffer_answers,
    suffer_bytes,
)
from benchmarks.harness.rows import BenchResult, Row
from reference import hidden_damage
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


def run(extent: str, command: str) -> BenchResult:
    """Measure all."""
    table, rows = _faults(extent)
    rows += [*_fuzz(extent), *_hidden(extent), *bus_rows(), *decoding_rows()]
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


# --- faults --------------------------------------------------------------------------------------


def _faults(extent: str) -> tuple[list[str], list[Row]]:
    """Every fault of every twin, once and in a storm: a table by kind of driver, and all rows."""
    rows: list[Row] = []
    outcomes: dict[tuple[str, str], list[Trial]] = {}
    wrong = unequal = 0
    threads, files = threading.active_count(), _descriptors()
    for key in list_sensors():
        for how in ways(load_sensor(key))[:: 2 if extent == 'quick' else 1]:  # no bursts
            name = ' '.join([key, *map(str, how.values())])
            twin = Road(load_sensor(key), how).twin
            for fault in twin.faults:
                trials = _trials(key, how, fault, extent)
                rows.append(_fault_row(name, fault, trials))
                outcomes.setdefault((_kind(name), fault), []).extend(trials)
                bad = sum(trial.wrong for trial in trials)
                wrong += 0 if fault in twin.unseen else bad
                if not twin.unseen and 'i2c' not in name and fault != 'stuck_chip':
                    unequal += sum(abs(t.counted - t.injected) for t in trials)
    left = threading.active_count() - threads + _descriptors() - files
    return _table(outcomes), [
        *rows,
        Row('faults: wrong readings marked valid, besides what the notes name', 'readings',
            float(wrong), bound=0.0, aim=0.0),
        Row('faults: difference of counted and injected, framed protocol', 'faults',
            float(unequal), bound=0.0, aim=0.0),
        Row('faults: threads and descriptors left behind', 'count', float(left), bound=0.0,
            aim=0.0),
    ]  # fmt: skip


def _kind(name: str) -> str:
    """Which driver a sensor has that is connected so."""
    if 'i2c' in name:
        return 'chips on I2C'
    return 'ReSkin board' if name == 'reskin_board' else 'framed boards'


def _table(outcomes: dict[tuple[str, str], list[Trial]]) -> list[str]:
    """Faults by kind of driver, all sensors together."""
    lines = [
        '| driver | fault | injected | counted | wrong | recovery (s) |',
        '|---|---|---|---|---|---|',
    ]
    for (kind, fault), trials in sorted(outcomes.items()):
        sums = [sum(getattr(t, what) for t in trials) for what in ('injected', 'counted', 'wrong')]
        cells = [kind, fault, *map(str, sums), f'{max(t.recovery_s for t in trials):.2f}']
        lines.append(f'| {" | ".join(cells)} |')
    return lines


def _trials(key: str, how: dict[str, object], fault: str, extent: str) -> list[Trial]:
    """A fault once (not where it shall be quick), and in a storm."""
    counts = (1, STORMS.get(fault, STORM))
    with Road(load_sensor(key), how) as road:
        asked = counts[1:] if extent == 'quick' else counts
        return [suffer(road, fault, count, 0.25) for count in asked]


def _fault_row(name: str, fault: str, trials: list[Trial]) -> Row:
    """What a driver made of a fault."""
    injected, counted, wrong = (
        sum(getattr(trial, what) for trial in trials) for what in ('injected', 'counted', 'wrong')
    )
    what = f'{name}, {fault}: injected {injected}, counted {counted}, wrong {wrong}; recovery'
    return Row(what, 's', max(trial.recovery_s for trial in trials), aim=2.0)


def _descriptors() -> int:
    """Open files of this process."""
    return len(os.listdir('/proc/self/fd'))  # noqa: PTH208


# --- hostile bytes -------------------------------------------------------------------------------


def _fuzz(extent: str) -> list[Row]:
    """Random and mutated strings through each decoder."""
    count = STRINGS[extent]
    rows: list[Row] = []
    for payload in (gradiometer(), three_axis_chips(5), taxel_matrix(16), five_wires()):
        found = suffer_bytes(FramedSubject(payload), count, 1)
        rows += _fuzz_rows(f'framed {payload.kind.name.lower()}', found, hidden=False)
    rows += _fuzz_rows('ReSkin, 5 chips', suffer_bytes(BoardSubject(5), count, 1), hidden=True)
    return [*rows, *_fuzz_chips(count)]


def _fuzz_rows(name: str, found: Fuzzed, hidden: bool) -> list[Row]:
    """Figures of one decoder."""
    what = f'fuzz {name}, {found.strings} strings'
    share = 100 * found.wrong / found.strings
    return [
        Row(f'{what}: frames with wrong numbers delivered', '%', share, bound=0.0,
            aim=None if hidden else 0.0),
        Row(f'{what}: most good frames lost by one', 'frames', float(found.lost), aim=1.0),
        Row(f'{what}: most bytes held back', 'bytes', float(found.held), aim=8192.0),
        Row(f'{what}: slowest feed of {PIECE} bytes', 'ms', 1e3 * found.slowest_s, aim=250.0),
    ]  # fmt: skip


def _fuzz_chips(count: int) -> list[Row]:
    """Random answers of chips to the whole driver; RES 3 has codes beyond the range."""
    rows = []
    for status_only in (False, True):
        rng = np.random.default_rng(1)
        found = suffer_answers(count // 10, 3, status_only, rng)
        part = 'status bytes' if status_only else 'answers'
        what = f'fuzz MLX90393 {part} at RES 3, {found.strings} strings'
        rows.append(Row(f'{what}: readings beyond the range that no bit marks', 'readings',
                        float(found.beyond), bound=0.0, aim=0.0))  # fmt: skip
        if status_only:
            rows.append(Row(f'{what}: wrong readings that no bit marks', 'readings',
                            float(found.wrong), bound=0.0, aim=0.0))  # fmt: skip
        rows.append(Row(f'{what}: time until all chips are good', 's', found.recovery_s,
                        aim=5.0))  # fmt: skip
    return rows


def _hidden(extent: str) -> list[Row]:
    """Share of damage that ReSkin's format cannot show, on a shipped recording."""
    values = load_sensor('reskin_board').recordings()['normal_1'].values[:500]
    trials = 50 if extent == 'quick' else 1000
    rows = []
    for kind in BYTE_FAULTS:
        found = hidden_damage.hidden_damage(values, kind, 0, trials)
        rows.append(
            Row(f'ReSkin frames {kind}: delivered, numbers wrong', '%', 100 * found.passed)
        )
        rows.append(Row(f'ReSkin frames {kind}: delivered, wrong by more than 1 uT', '%',
                        100 * found.misled))  # fmt: skip
    return rows


# --- processor -----------------------------------------------------------------------------------


def _nodes(extent: str) -> list[Row]:
    """Share of a core that sensor_node takes at its port, and its memory."""
    jobs = (
        ('100 Hz x 20 chips', 'multipole_skin', {'transport': 'serial'}, 100.0, 15.0),
        ('1 kHz x 8 channels', 'gradiometer', {}, 1000.0, 40.0),
    )
    rows: list[Row] = []
    for (name, sensor, how, rate_hz, aim), seconds in zip(jobs, NODE_S[extent], strict=True):
        if find_spec('rclpy') is None:
            rows.append(Row(f'sensor_node, {name}: not measured, no rclpy here', '%', None,
                            aim=aim))  # fmt: skip
            continue
        cores, grown, heard = _node(sensor, dict(how), rate_hz, (WARM_S[extent], seconds))
        frames = round(rate_hz * seconds)
        rows += [
            Row(f'sensor_node, {name}: share of a core', '%', 100 * cores, aim=aim),
            Row(f'sensor_node, {name}: memory grown over {frames} frames', 'KiB', grown,
                bound=0.0, aim=2048.0),
            Row(f'sensor_node, {name}: frames heard by a recorder', '%', 100 * heard, 'high',
                bound=100.0, aim=99.0),
        ]  # fmt: skip
    return rows


def _node(
    sensor: str, how: dict[str, object], rate_hz: float, seconds: tuple[float, float]
) -> tuple[float, float, float]:
    """Cores, growth of memory (KiB), and share of the frames that a recorder heard, after a while.

    The twin sends from this process, so that the node has only a port to read, as with a board.
    """
    spec = load_sensor(sensor)
    config = replace(spec.config(), rate_hz=rate_hz)  # type: ignore[type-var]
    connection = spec.connection(native_usb=True, **how)
    level = np.full(spec.layout(config).shape, 1e-4)
    with tempfile.TemporaryDirectory() as name:
        bag = Path(name) / 'bag'
        twin = spec.simulate(config, connection, lambda t: level * (1 + 0.1 * np.sin(t)), 0)
        with twin:
            values = {'sensor': sensor, 'port': twin.port, 'rate_hz': rate_hz, 'native_usb': True,
                      'listeners': 1, **how}  # fmt: skip
            graph = Graph((Process('record', {'bag': str(bag)}), Process('sensor_node', values)))
            with Running(graph, {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}) as running:
                wait_for_frames(running, bag)
                time.sleep(seconds[0])
                began_ns = time.time_ns()
                cores, grown = _watch(running.children['sensor_node'].pid, seconds[1])
                ended_ns = time.time_ns()
                time.sleep(ON_ITS_WAY_S)
        stamp_ns = load(bag).recordings[0].recording.stamp_ns
    assert stamp_ns is not None
    heard = np.count_nonzero((stamp_ns > began_ns) & (stamp_ns <= ended_ns))
    return cores, grown, min(1.0, heard * 1e9 / (rate_hz * (ended_ns - began_ns)))


def _watch(pid: int, seconds: float) -> tuple[float, float]:
    """Cores and growth of memory (KiB) of a process that has warmed up."""
    memory, spent, began = resident_kib(pid), processor_s(pid), time.monotonic()
    time.sleep(seconds)
    cores = (processor_s(pid) - spent) / (time.monotonic() - began)
    return cores, resident_kib(pid) - memory
