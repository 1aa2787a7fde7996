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
from typing import TYPE_CHECKING

import numpy as np

from tactile_ros.devices import framed, packets
from tactile_ros.devices.chip_array_twin import ChipArrayTwin
from tactile_ros.devices.clock import VirtualClock
from tactile_ros.devices.damage import DAMAGES, unseen
from tactile_ros.devices.framed_decoder import FramedDecoder
from tactile_ros.devices.framed_payloads import (
    Kind,
    Payload,
    five_wires,
    gradiometer,
    taxel_matrix,
    three_axis_chips,
)
from tactile_ros.devices.framing import FrameDecoder
from tactile_ros.devices.mlx90393 import ChipSettings, Decoder
from tactile_ros.devices.mux import ChipPlace, clusters
from tactile_ros.evaluation.benchmark import BenchResult, Row
from tactile_ros.evaluation.fault_trials import STORM, STORMS, Road, Trial, suffer, ways
from tactile_ros.evaluation.hostile_bytes import (
    PIECE,
    BoardSubject,
    FramedSubject,
    Fuzzed,
    cut,
    suffer_bytes,
)
from tactile_ros.evaluation.hostile_chips import suffer_answers
from tactile_ros.evaluation.recording import load
from tactile_ros.nodes.graph import Graph, Process
from tactile_ros.nodes.processes import Running
from tactile_ros.sensors import list_sensors, load_sensor
from tactile_ros.types import Layout

if TYPE_CHECKING:
    from collections.abc import Callable

    from tactile_ros.devices.chip_array import Mode

STRINGS = {'quick': 20_000, 'normal': 1_000_000, 'full': 1_000_000}
DECODED = {'quick': 100_000, 'normal': 1_000_000, 'full': 1_000_000}
NODE_S = {'quick': 10.0, 'normal': 100.0, 'full': 100.0}
WARM_S = 5.0
UNSEEN = ('flipped', 'garbage', 'shifted')
RESTING = ('taxel_array', 'five_wire_skin')
CHUNK = 1000
PAGE_KIB = os.sysconf('SC_PAGE_SIZE') / 1024


def run(extent: str, command: str) -> BenchResult:
    """Measure all."""
    table, rows = _faults()
    rows += [*_fuzz(extent), *_hidden(extent), *_buses(), *_decoding()]
    rows += [*_flat(extent), *_nodes(extent)]
    notes = [
        'recovery: longest time between two frames of which every taxel may be used, the fault '
        'once and in a storm; unplug lasts 1 s of it, stall 0.5 s',
        'counted: by the counter of the driver, or readings that were marked; bus_errors counts '
        'tries on an unplugged bus, suspected the frames that are missing by the clock',
        'reskin_board: flipped, garbage and shifted may keep length and plausibility, lost frames '
        'leave no trace; its format shows no more',
        f'{", ".join(RESTING)}: a stuck taxel looks like one that rests, and is not marked',
        f'fuzz: {STRINGS[extent]} strings for each decoder, a third each of random bytes, frames '
        'damaged in one of 7 ways, and 1 to 8 bytes overwritten; good frames before and after',
        *table,
    ]
    return BenchResult('devices', command, [0, 1], rows, notes)


# --- faults --------------------------------------------------------------------------------------


def _faults() -> tuple[list[str], list[Row]]:
    """Every fault of every twin, once and in a storm: a table by kind of driver, and all rows."""
    rows: list[Row] = []
    outcomes: dict[tuple[str, str], list[Trial]] = {}
    wrong = unequal = 0
    threads, files = threading.active_count(), _descriptors()
    for key in list_sensors():
        for how in ways(load_sensor(key)):
            name = ' '.join([key, *map(str, how.values())])
            for fault in Road(load_sensor(key), how).twin.faults:
                trials = _trials(key, how, fault)
                rows.append(_fault_row(name, fault, trials))
                outcomes.setdefault((_kind(name), fault), []).extend(trials)
                bad = sum(trial.wrong for trial in trials)
                hidden = key == 'reskin_board' and fault in UNSEEN
                wrong += 0 if hidden or (fault == 'stuck_chip' and key in RESTING) else bad
                if key != 'reskin_board' and 'i2c' not in name and fault != 'stuck_chip':
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


def _trials(key: str, how: dict[str, object], fault: str) -> list[Trial]:
    """A fault once, and in a storm."""
    with Road(load_sensor(key), how) as road:
        return [suffer(road, fault, count, 0.25) for count in (1, STORMS.get(fault, STORM))]


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
    trials = 200 if extent == 'quick' else 1000
    rows = []
    for kind in DAMAGES:
        found = unseen(values, 25.0, kind, 0, trials)
        rows.append(
            Row(f'ReSkin frames {kind}: delivered, numbers wrong', '%', 100 * found.passed)
        )
        rows.append(Row(f'ReSkin frames {kind}: delivered, wrong by more than 1 uT', '%',
                        100 * found.misled))  # fmt: skip
    return rows


# --- speed ---------------------------------------------------------------------------------------


def _buses() -> list[Row]:
    """Twenty chips on one bus of 400 kHz, with and without a switch, on the virtual clock."""
    wirings = {
        'behind a switch': clusters(),
        'on one bus without a switch': [ChipPlace(0x0C + i) for i in range(20)],
    }
    aims = {'single': 104.0, 'burst': 180.0}
    rows: list[Row] = []
    for name, places in wirings.items():
        for mode, aim in aims.items():
            share, rate = _bus(places, 'burst' if mode == 'burst' else 'single')
            what = f'20 chips {name}, {mode}'
            rows.append(
                Row(
                    f'{what}: share of the limit of the bus',
                    '1',
                    share,
                    'high',
                    bound=1.0,
                    aim=0.9,
                )
            )
            rows.append(Row(f'{what}: rate', 'Hz', rate, 'high', bound=rate / share,
                            aim=None if 'behind' in name else aim))  # fmt: skip
    return rows


def _bus(places: list[ChipPlace], mode: Mode) -> tuple[float, float]:
    """Share of the time that bytes are on the wire, and frames per second."""
    clock = VirtualClock()
    layout = Layout(np.zeros((20, 3)), ('Bx', 'By', 'Bz'), 'T')
    twin = ChipArrayTwin(places, layout, lambda t: np.full((20, 3), 1e-3), mode=mode, clock=clock)
    with twin, twin.device(clock.now_ns) as array:
        begun_ns, busy_s = clock.now_ns(), twin.buses[0].busy_s
        for _ in range(200):
            array.read(1.0)
        elapsed_s = (clock.now_ns() - begun_ns) * 1e-9
        return (twin.buses[0].busy_s - busy_s) / elapsed_s, 200 / elapsed_s


def _decoding() -> list[Row]:
    """Time to decode one frame."""
    settings = ChipSettings()
    chips = Decoder(settings, np.zeros(20))
    answers = bytearray(np.random.default_rng(0).bytes(20 * settings.answer_bytes))
    rows = [_time_row('MLX90393 answers, 20 chips', 20.0, _best(lambda: _decode(chips, answers)))]
    subjects: list[tuple[str, float, bytes, int, FramedDecoder | FrameDecoder]] = []
    for name, payload, aim in (
        ('framed, 20 chips', three_axis_chips(20), 20.0),
        ('framed, 2000 taxels', taxel_matrix(2000), 100.0),
    ):
        data, size = _stream(payload, 256)
        subjects.append((name, aim, data, size, FramedDecoder(payload)))
    values = np.random.default_rng(0).integers(-2500, 2500, (256, 20, 3)) * 2.4e-6
    data = packets.encode(values, np.full((256, 20), 25.0))
    subjects.append(('ReSkin, 20 chips', 20.0, data, packets.frame_bytes(20), FrameDecoder(20)))
    for name, aim, stream, size, decoder in subjects:
        pieces = cut(stream, size)
        single = _best(lambda d=decoder, p=pieces: [d.feed(x) for x in p]) / len(pieces)
        batch = _best(lambda d=decoder, s=stream: d.feed(s)) / len(pieces)
        rows.append(_time_row(name, aim, single, batch))
    return rows


def _decode(decoder: Decoder, answers: bytearray) -> None:
    """One frame of chips."""
    decoder.values(decoder.words(answers)[1])


def _time_row(name: str, aim: float, single: float, batch: float | None = None) -> Row:
    """Time of a frame that comes alone and of one among many (s)."""
    many = None if batch is None else 1e6 * batch
    return Row(f'decode a frame: {name}', 'us', 1e6 * single, aim=aim, us_single=1e6 * single,
               us_batch=many)  # fmt: skip


def _stream(payload: Payload, count: int) -> tuple[bytes, int]:
    """Frames of random counts, and the length of one."""
    high = 1023 if payload.kind == Kind.TAXELS else 30_000
    counts = np.random.default_rng(0).integers(0, high, (count, payload.count, payload.channels))
    data = framed.encode(payload, counts, 0, np.arange(count) * 1000, 25.0)
    return data, framed.frame_bytes(payload)


def _best(work: Callable[[], object], repetitions: int = 15) -> float:
    """Shortest of several durations (s)."""
    times = []
    for _ in range(repetitions):
        began = time.perf_counter()
        work()
        times.append(time.perf_counter() - began)
    return min(times)


# --- memory and processor ------------------------------------------------------------------------


def _resident_kib(pid: str | int = 'self') -> float:
    """Resident memory of a process (KiB)."""
    return int(Path(f'/proc/{pid}/statm').read_text().split()[1]) * PAGE_KIB


def _flat(extent: str) -> list[Row]:
    """Growth of memory over many frames, one in 32 of them damaged, through each decoder."""
    count = DECODED[extent]
    data, size = _stream(gradiometer(), CHUNK)
    values = np.random.default_rng(0).integers(-2500, 2500, (CHUNK, 5, 3)) * 2.4e-6
    board = packets.encode(values, np.full((CHUNK, 5), 25.0))
    rows = []
    for name, decoder, stream, length in (
        ('framed', FramedDecoder(gradiometer()), data, size),
        ('ReSkin', FrameDecoder(5), board, packets.frame_bytes(5)),
    ):
        hurt = bytearray(stream)
        hurt[:: 32 * length] = bytes(b ^ 4 for b in hurt[:: 32 * length])
        grown = _growth(decoder, bytes(hurt), count)
        what = f'memory grown over {count} frames, {name} decoder'
        rows.append(Row(what, 'KiB', grown, bound=0.0, aim=1024.0))
    return rows


def _growth(decoder: FramedDecoder | FrameDecoder, stream: bytes, count: int) -> float:
    """Growth of resident memory after the first tenth (KiB)."""
    passes = count // CHUNK
    before = 0.0
    for i in range(passes):
        if i == passes // 10:
            before = _resident_kib()
        for piece in cut(stream, PIECE):
            decoder.feed(piece)
    return _resident_kib() - before


def _nodes(extent: str) -> list[Row]:
    """Share of a core that sensor_node takes at its port, and its memory."""
    jobs = (
        ('100 Hz x 20 chips', 'multipole_skin', {'transport': 'serial'}, 100.0, 15.0, 10.0),
        ('1 kHz x 8 channels', 'gradiometer', {}, 1000.0, 40.0, NODE_S[extent]),
    )
    rows: list[Row] = []
    for name, sensor, how, rate_hz, aim, seconds in jobs:
        if find_spec('rclpy') is None:
            rows.append(Row(f'sensor_node, {name}: not measured, no rclpy here', '%', None,
                            aim=aim))  # fmt: skip
            continue
        cores, grown, heard = _node(sensor, dict(how), rate_hz, seconds)
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
    sensor: str, how: dict[str, object], rate_hz: float, seconds: float
) -> tuple[float, float, float]:
    """Cores, growth of memory (KiB), and share of the frames that a recorder heard.

    The twin sends from this process, so that the node has only a port to read, as with a board.
    """
    spec = load_sensor(sensor)
    config = replace(spec.config(), rate_hz=rate_hz)  # type: ignore[type-var]
    connection = spec.connection(native_usb=True, **how)
    level = np.full(spec.layout(config).shape, 1e-4)
    with tempfile.TemporaryDirectory() as name:
        bag = str(Path(name) / 'bag')
        twin = spec.simulate(config, connection, lambda t: level * (1 + 0.1 * np.sin(t)), 0)
        with twin:
            values = {'sensor': sensor, 'port': twin.port, 'rate_hz': rate_hz, 'native_usb': True,
                      'listeners': 1, **how}  # fmt: skip
            graph = Graph((Process('record', {'bag': bag}), Process('sensor_node', values)))
            with Running(graph, {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}) as running:
                pid = running.pid('sensor_node')
                cores, grown = _watch(pid, seconds)
        recording = load(bag).recordings[0].recording
    assert recording.sequence is not None
    span = int(recording.sequence[-1] - recording.sequence[0]) + 1
    return cores, grown, min(len(recording) / span, len(recording) / (rate_hz * seconds))


def _watch(pid: int, seconds: float) -> tuple[float, float]:
    """Cores and growth of memory (KiB) of a process after its start."""
    time.sleep(WARM_S)
    memory, spent, began = _resident_kib(pid), _processor_s(pid), time.monotonic()
    time.sleep(seconds)
    cores = (_processor_s(pid) - spent) / (time.monotonic() - began)
    return cores, _resident_kib(pid) - memory


def _processor_s(pid: int) -> float:
    """User and system time of a process so far (s)."""
    fields = Path(f'/proc/{pid}/stat').read_text().rsplit(')', 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK')
