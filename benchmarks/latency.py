# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Delay of a grip from a sensor's bytes to the hand's command, and what it costs a processor.

A process writes frames into a pseudo-terminal, another hears the commands of the hand. Between
them runs the stack (sensor, contacts and grip in one process), or the three nodes of the graph.
Delay runs from the write of the frame that a command answers until the middleware sent that.
"""

import sys
import tempfile
import time
from collections.abc import Mapping
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from benchmarks.harness.live import QUIET, processor_s
from benchmarks.harness.plots import curves
from benchmarks.harness.rows import BenchResult, Row
from benchmarks.worlds import grip_rig
from benchmarks.worlds.grip_rig import Helper, Scene
from tactile_ros.control import GripConfig, GripForce, GripInput
from tactile_ros.evaluation.metrics import spread
from tactile_ros.nodes.graph import Graph, Process
from tactile_ros.nodes.processes import Running
from tactile_ros.types import Array, Integers

SECONDS = {'quick': 2.0, 'normal': 5.0, 'full': 60.0}
FOLDER = Path(__file__).parents[1]
STEPS = {'quick': 2_000, 'normal': 20_000, 'full': 50_000}
WARM_S = 1.5
PLAIN = "stack, polynomial of the disc's place"
FLOOR, THREE = 'floor: port read, command by bare rclpy', 'three nodes over DDS'
BINS_MS = (0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0, 5.0, 10.0, np.inf)
SHOWN_MS = np.linspace(0.0, 20.0, 81)  # of the drawing
NOTHING = np.full(1, np.nan)
LAST = 5  # lines of nodes that ended
TOLERANCE_NS = 300_000  # between a frame's stamp and its write
# The hand takes 333 commands a second; here each frame of 1 kHz shall be answered.
ENTRY = (
    'import sys; from tactile_ros.hands.drivers import AllegroV5; '
    'AllegroV5.fastest_hz = 1000.0; exec({more!r}); '
    'from tactile_ros.nodes.__main__ import start; start()'
)
NOTE = (
    'import sys; sys.path.append({folder!r})\n'
    'from benchmarks.worlds import grip_rig; grip_rig.note({threads!r})\n'
)
BUSY = (
    'import threading\n'
    'def work():\n'
    '    while True: sum(range(1000))\n'
    'threading.Thread(target=work, daemon=True).start()\n'
)


@dataclass(frozen=True)
class Measured(Process):
    """A process of the bench: a hand that takes every command, a second thread where asked.

    Its readers write their threads into a file; `heard` are topics by those in their place.
    """

    heard: Mapping[str, str] = field(default_factory=dict)
    threads: str = ''
    busy: bool = False

    def command(self) -> list[str]:
        """Command line."""
        entry = ENTRY.format(
            more=NOTE.format(folder=str(FOLDER), threads=self.threads) + BUSY * self.busy
        )
        heard = [part for pair in self.heard.items() for part in ('-r', ':='.join(pair))]
        run = [sys.executable, '-c', entry, self.executable, '--ros-args']
        return [*run, *heard, *self.ros_arguments()]


@dataclass(frozen=True)
class Floor(Process):
    """What no node can do without: bytes are read, and a command is published for each frame."""

    port: str = ''
    threads: str = ''

    def command(self) -> list[str]:
        """Command line."""
        entry = NOTE.format(folder=str(FOLDER), threads=self.threads)
        return [sys.executable, '-c', f'{entry}grip_rig.floor({self.port!r}, {self.threads!r})']


@dataclass(frozen=True)
class Run:
    """Delays (s) to sending and to receiving of one run, and cost.

    `why` something was not answered, and what the threads that read and answer `waited` for.
    """

    delay: Array
    received: Array
    cores: float
    answered: float
    calls: int = 0
    why: str = ''
    waited: str = grip_rig.UNKNOWN


def run(extent: str, command: str) -> BenchResult:
    """Measure everything."""
    seconds = SECONDS[extent]
    rows: list[Row] = []
    notes = [
        "Delay: from the write of a frame to the middleware's source time stamp of its command; "
        'a hand of 16 joints, four fingers that hear one gradiometer. Processor: of the nodes '
        'alone, once they run.',
        'The busy thread shares the lock of the measured process; another calls the service.',
        f'Up to 1000 commands a second; {seconds:g} s a run. Frames that waited in the port are '
        'estimated together and the newest is answered: their delay runs until that command.',
    ]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        plain = grip_rig.gradiometer_scene(folder / 'plain', estimator='polynomial')
        runs = {name: measure(folder / 'plain', plain, seconds, name) for name in (FLOOR, PLAIN)}
        if extent == 'quick':
            notes.append('quick: the polynomial in one process alone')
        else:
            fast, slow = grip_rig.gradiometer_scene(folder), grip_rig.skin_scene(folder)
            runs |= {
                'stack': measure(folder, fast, seconds),
                'stack, a second busy thread': measure(folder, fast, seconds, busy=True),
                'stack, a service is called': measure(folder, fast, seconds, called=True),
                THREE: measure(folder, fast, seconds, THREE),
                f'stack, 4 fingers x {grip_rig.CHIPS} chips at 100 Hz':
                    measure(folder, slow, seconds),
            }  # fmt: skip
    for what, found in runs.items():
        rows += _rows(what, found)
        if what.startswith('stack') and not what.endswith('Hz'):
            over = 1e3 * (spread(found.delay).p99 - spread(runs[FLOOR].delay).p99)
            rows.append(Row(f'{what}: delay p99 over the floor', 'ms', over, aim=0.5))
        notes.append(f'{what}: {_histogram(found)}; {found.waited}')
    rows.append(step_row(STEPS[extent]))
    lines = {
        what: (SHOWN_MS, 100 * (one.delay <= 1e-3 * SHOWN_MS[:, None]).mean(axis=1))
        for what, one in [*runs.items()][:3]
    }
    drawings = {'delay': curves(lines, ('delay (ms)', 'answered (%)'), 'From bytes to command')}
    return BenchResult('latency', command, [0], rows, notes, drawings)


def _rows(what: str, run: Run) -> list[Row]:
    """Figures of one run; None where there is none, and the notes say why."""
    found = spread(run.delay)
    fast, own = 'chips' not in what, what.startswith('stack')
    quiet = 'busy' not in what and 'called' not in what
    figures = (
        ('delay p50', 'ms', 1e3 * found.p50, None),
        ('delay p99', 'ms', 1e3 * found.p99, 1.0 if fast and own else None),
        ('delay, largest', 'ms', 1e3 * found.largest, None),
        ('delay p99 to the listener', 'ms', 1e3 * spread(run.received).p99, None),
        ('processor', '% of a core', 100 * run.cores,
         (50.0 if fast else 35.0) if own and quiet else None),
    )  # fmt: skip
    rows = [
        Row(f'{what}: {name}', unit, figure if np.isfinite(figure) else None, aim=aim)
        for name, unit, figure, aim in figures
    ]
    share = 100 * run.answered
    rows.append(Row(f'{what}: frames with a command of their own', '%', share, 'high'))
    if run.calls:
        rows.append(Row(f'{what}: services answered', '1', float(run.calls)))
    return rows


def _histogram(run: Run) -> str:
    """Shares of delays up to each of the bins, and what the grip said where it was silent."""
    edges = np.array([0.0, *BINS_MS]) * 1e-3
    counts = np.histogram(run.delay[np.isfinite(run.delay)], edges)[0]
    shares = zip(BINS_MS, 100 * counts / max(len(run.delay), 1), strict=True)
    bins = [f'<= {high:g} ms {share:.2f} %' for high, share in shares if share]
    said = f'; of the nodes: {run.why}' if run.why else ''
    return f'{", ".join(bins) or "NO COMMAND CAME"}{said}'


def measure(
    folder: Path, scene: Scene, seconds: float, what: str = 'stack', *, busy: bool = False,
    called: bool = False,
) -> Run:  # fmt: skip
    """One run of the nodes between boards and hand."""
    with ExitStack() as held:
        board = held.enter_context(Helper(grip_rig.boards(scene)))
        hand = held.enter_context(Helper(grip_rig.listener))
        asking = held.enter_context(Helper(grip_rig.caller)) if called else None
        ports, noted = board.hear(), folder / 'threads'
        noted.write_text('', 'ascii')
        graph = _graph(folder, scene, ports, str(noted), what, busy)
        with Running(graph, {**QUIET, 'OMP_NUM_THREADS': '1'}) as running:
            with suppress(TimeoutError, OSError):  # no command came: said by the rows
                hand.hear()
                board.ours.send('press')
            time.sleep(WARM_S)
            pids = [running.children[graph.name_of(process)].pid for process in graph.processes]
            begin, spent = time.time_ns(), -sum(map(processor_s, pids))
            threads = [int(line) for line in noted.read_text('ascii').split()]
            waited = grip_rig.watched(pids[-1], threads, seconds)
            end, spent = time.time_ns(), spent + sum(map(processor_s, pids))
            if gone := [name for name in running.lines if not running.is_alive(name)]:
                last = (f'{name} ended: {" ".join(running.lines[name][-LAST:])}' for name in gone)
                return Run(NOTHING, NOTHING, np.nan, 0.0, why='; '.join(last))
            written, (heard, said) = board.end(), hand.end()
            calls = asking.end() if asking else 0
    delay, received, answered = _delays(written, heard, begin, end)
    cores = spent * grip_rig.NS / (end - begin)
    return Run(delay, received, cores, answered, calls, said, waited)


def _delays(
    written: Integers, heard: Integers, begin: int, end: int
) -> tuple[Array, Array, float]:
    """Delays to sending and to receiving (s), and the share of frames with a command of their own.

    Of every frame: until the first command that answers it or a later one, since what waited is
    answered together; of one that nothing answers, at least until the last command.
    """
    stamp, sent, received = heard[:, np.argsort(heard[1], kind='stable')]
    row = np.maximum.accumulate(np.searchsorted(written, stamp + TOLERANCE_NS) - 1)
    frames = np.flatnonzero((written >= begin) & (written < end))
    own = np.unique(row[(sent >= begin) & (sent < end)])
    if not len(own) or not len(frames):
        return NOTHING, NOTHING, 0.0
    first = np.minimum(np.searchsorted(row, frames), len(row) - 1)
    late = [1e-9 * np.maximum(at[first] - written[frames], 0) for at in (sent, received)]
    return *late, len(own) / len(frames)


def _graph(
    folder: Path, scene: Scene, ports: list[str], threads: str, what: str, busy: bool
) -> Graph:
    """Everything in one process, or three of them with the first finger; the reader comes last."""
    if what == FLOOR:
        return Graph((Floor('floor', port=ports[0], threads=threads),))
    both = {'hand': 'allegro_v5', 'input_rate_hz': scene.rate_hz}
    sensor = {'sensor': scene.sensor, **scene.values}
    calibrations, finger = folder / scene.sensor, scene.fingers[0]
    if what != THREE:
        values = {**both, **sensor, 'ports': ports, 'calibrations': str(calibrations)}
        return Graph((Measured('stack', values, heard=scene.heard, threads=threads, busy=busy),))
    grip = {**both, 'rate_hz': scene.rate_hz}
    contact = {**sensor, 'calibration': str(calibrations / f'{finger}.npz')}
    return Graph((
        Measured('grip_node', grip, heard=scene.heard, threads=threads),
        Measured('contact_node', contact, finger, threads=threads),
        Measured('sensor_node', {**sensor, 'port': ports[0]}, finger, threads=threads),
    ))  # fmt: skip


def step_row(steps: int) -> Row:
    """Time of one step of the law for four fingers that hold."""
    law = GripForce(GripConfig(), (0, 1, 2, 3), (1, 1, 1, -1))
    law.enable()
    law.grasp(3.0)
    rng = np.random.default_rng(0)
    force, across = 1.0 + 0.02 * rng.normal(size=(2, steps, 4))
    took = []
    for i in range(steps):
        given = GripInput(
            force[i] if i > 10 else np.zeros(4), 0.2 * across[i], np.ones(4, bool),
            np.full(4, -1, np.int8), np.zeros(4), np.full(4, 0.3) + 1e-3 * force[i], 0.0,
        )  # fmt: skip
        began = time.perf_counter()
        law.step(given, 0.01)
        took.append(time.perf_counter() - began)
    micro = 1e6 * float(np.median(took[steps // 2 :]))
    return Row('law step, 4 fingers', 'us', micro, aim=50.0, us_single=micro)
