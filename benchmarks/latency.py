# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Delay of a grip from a sensor's bytes to the hand's command, and what it costs a processor.

A board in a process of its own writes frames into a pseudo-terminal; a hand in another hears the
commands. Between them runs the stack (sensor, contacts and grip in one process), or the three
nodes of the graph. Delay runs from the write of the frame whose force a command answers, which the
command's stamp tells, to the time at which the nodes' middleware sent it.
"""

from __future__ import annotations

import sys
import tempfile
import time
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.harness.rows import BenchResult, Row
from benchmarks.worlds import grip_delay_plot, grip_rig, grip_scenes, grip_waits
from tactile_ros.control import GripConfig, GripForce, GripInput
from tactile_ros.evaluation.metrics import Spread, spread
from tactile_ros.nodes.graph import Graph, Process, Value
from tactile_ros.nodes.processes import Running

if TYPE_CHECKING:
    from benchmarks.worlds.grip_scenes import Scene
    from benchmarks.worlds.grip_waits import Waits
    from tactile_ros.types import Array, Integers

SECONDS = {'quick': 2.0, 'normal': 5.0, 'full': 60.0}
FOLDER = Path(__file__).parents[1]
STEPS = {'quick': 2_000, 'normal': 20_000, 'full': 50_000}
WARM_S = 1.5
PLAIN = "stack, polynomial of the disc's place"
BINS_MS = (0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0, 5.0, 10.0, np.inf)
LATE_S = 1e-3  # beyond the aim
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
    'from benchmarks.worlds import grip_waits; grip_waits.note({threads!r})\n'
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

    Attributes
    ----------
    busy : bool
        Whether there is a thread that never waits.
    threads : str
        File that its readers write their threads into; empty: none.
    """

    busy: bool = False
    threads: str = ''

    def command(self) -> list[str]:
        """Command line."""
        note = NOTE.format(folder=str(FOLDER), threads=self.threads) if self.threads else ''
        entry = ENTRY.format(more=note + BUSY * self.busy)
        return [sys.executable, '-c', entry, self.executable, '--ros-args', *self.ros_arguments()]


@dataclass(frozen=True)
class Run:
    """What one run showed."""

    delay: Array
    received: Array
    cores: float
    answered: float
    busiest: float = np.nan  # waiting for a processor over running, of the busiest thread
    calls: int = 0
    why: str = ''  # of what was not answered
    waits: Waits | None = None  # of the threads that read and answer, in one process

    @property
    def spread(self) -> Spread:
        """Of the delays (s)."""
        return spread(self.delay)


def run(extent: str, command: str) -> BenchResult:
    """Measure everything."""
    seconds = SECONDS[extent]
    rows: list[Row] = []
    notes = [
        'Delay: from the write of a frame to the write of the command that answers it, by the '
        "middleware's source time stamp; a hand of 16 joints, a law of four fingers that hear "
        'one gradiometer. Processor: of the nodes alone, once they run.',
        'The busy thread shares the lock of the measured process; the service is called back to '
        'back from another.',
        f'Up to 1000 commands a second; {seconds:g} s a run. Frames that waited in the port, '
        'because the one before cost more than its period, are estimated together and the newest '
        'is answered: their delay runs until that command.',
    ]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        runs = _runs(folder, seconds, extent == 'quick')
    for what, found in runs.items():
        rows += _rows(what, found)
        notes.append(f'{what}: {_histogram(found)}{_cause(found)}')
    with grip_rig.Helper(grip_rig.difference) as helper:
        apart = float(helper.hear())
    rows += [
        Row('roads: largest difference of commands', '1', apart, bound=0.0, aim=1e-9),
        step_row(STEPS[extent]),
    ]
    if extent == 'quick':
        notes.append('quick: the polynomial in one process alone')
    tails = grip_delay_plot.drawn(
        {what: found.delay for what, found in runs.items()}, 1e3 * LATE_S
    )
    return BenchResult('latency', command, [0], rows, notes, {'tails': tails})


def _runs(folder: Path, seconds: float, quick: bool) -> dict[str, Run]:
    """Every run by its name; where it shall be quick the first alone."""
    plain = grip_scenes.gradiometer_scene(folder / 'plain', estimator='polynomial')
    first = {PLAIN: measure(folder / 'plain', plain, seconds)}
    if quick:
        return first
    fast, slow = grip_scenes.gradiometer_scene(folder), grip_scenes.skin_scene(folder)
    return {
        **first,
        'stack': measure(folder, fast, seconds),
        'stack, a second busy thread': measure(folder, fast, seconds, busy=True),
        'stack, a service is called': measure(folder, fast, seconds, called=True),
        'three nodes over DDS': measure(folder, fast, seconds, stack=False),
        f'stack, 4 fingers x {grip_scenes.CHIPS} chips at 100 Hz': measure(folder, slow, seconds),
    }


def _rows(what: str, run: Run) -> list[Row]:
    """Figures of one run."""
    found, heard = run.spread, spread(run.received)
    fast = 'chips' not in what
    own = 'three' not in what
    quiet = 'busy' not in what and 'called' not in what
    cores = (50.0 if fast else 35.0) if own and quiet else None
    tail = 1.0 if fast and own else None
    rows = [
        Row(f'{what}: delay p50', 'ms', _known(1e3 * found.p50)),
        Row(f'{what}: delay p99', 'ms', _known(1e3 * found.p99), aim=tail),
        Row(f'{what}: delay, largest', 'ms', _known(1e3 * found.largest)),
        Row(f'{what}: delay p99 to the listener', 'ms', _known(1e3 * heard.p99)),
        Row(f'{what}: frames with a command of their own', '%', 100 * run.answered, 'high'),
        Row(f'{what}: processor', '% of a core', _known(100 * run.cores), aim=cores),
    ]
    if run.calls:
        rows.append(Row(f'{what}: services answered', '1', float(run.calls)))
    return rows


def _known(figure: float) -> float | None:
    """A figure, None where there is none; the notes say why."""
    return figure if np.isfinite(figure) else None


def _histogram(run: Run) -> str:
    """Shares of delays up to each of the bins, and what the grip said where it was silent."""
    edges = np.array([0.0, *BINS_MS]) * 1e-3
    counts = np.histogram(run.delay[np.isfinite(run.delay)], edges)[0]
    told = [
        f'<= {high:g} ms {100 * count / max(len(run.delay), 1):.2f} %'
        for high, count in zip(BINS_MS, counts, strict=True)
        if count
    ]
    said = f'; the nodes said: {run.why}' if run.why else ''
    return (', '.join(told) or 'NO COMMAND CAME') + said


def _cause(run: Run) -> str:
    """What was waited for, as far as the kernel tells it."""
    late = f'; {100 * float((run.delay > LATE_S).mean()):.1f} % later than {1e3 * LATE_S:g} ms'
    if run.waits is not None:
        return f'{late}; {run.waits.tell()}'
    if not np.isfinite(run.busiest):
        return f'{late}; {grip_waits.UNTOLD}'
    share = 100 * run.busiest
    return (
        f'{late}; while other programs had the processor, the busiest thread of the first process '
        f'was ready to run for {share:.0f} % of the time that it ran'
    )


def measure(
    folder: Path,
    scene: Scene,
    seconds: float,
    *,
    stack: bool = True,
    busy: bool = False,
    called: bool = False,
) -> Run:
    """One run of the nodes between boards and hand."""
    calls = 0
    with ExitStack() as held:
        board = held.enter_context(
            grip_rig.Helper(grip_rig.boards(scene.encode, len(scene.fingers), scene.rate_hz))
        )
        hand = held.enter_context(grip_rig.Helper(grip_rig.listener))
        asking = (
            held.enter_context(grip_rig.Helper(grip_rig.caller('/grip_node/get_parameters')))
            if called
            else None
        )
        ports = board.hear()
        noted = folder / 'threads'
        noted.write_text('', 'ascii')
        one = partial(_stack, busy=busy, threads=str(noted))
        graph = (one if stack else _nodes)(folder, scene, ports)
        quiet = {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST', 'OMP_NUM_THREADS': '1'}
        with Running(graph, quiet) as running:
            with suppress(TimeoutError):  # too slow for any command: said by the rows
                hand.hear()
            time.sleep(WARM_S)
            pids = [running.children[graph.name_of(process)].pid for process in graph.processes]
            before = grip_rig.kept_waiting(pids[0])
            begin, spent = time.time_ns(), -sum(map(grip_rig.processor_seconds, pids))
            threads = [int(line) for line in noted.read_text('ascii').split()]
            slept = grip_waits.asleep(pids[0], threads, seconds)
            end, spent = time.time_ns(), spent + sum(map(grip_rig.processor_seconds, pids))
            ended = _ended(running)
            if ended:
                return Run(NOTHING, NOTHING, np.nan, 0.0, why=ended)
            after = grip_rig.kept_waiting(pids[0])
            written, heard = board.end(), hand.end()
            if asking is not None:
                calls = asking.end()
    delay, received, answered = _delays(written, heard, begin, end)
    cores, busiest = spent * grip_rig.NS / (end - begin), grip_rig.busiest(before, after)
    waits = grip_waits.waits_of(threads, before, after, slept, (end - begin) / grip_rig.NS)
    return Run(delay, received, cores, answered, busiest, calls, heard.refusal, waits)


def _ended(running: Running) -> str:
    """Last words of nodes that ended; empty: all run."""
    gone = [name for name in running.lines if not running.is_alive(name)]
    return '; '.join(f'{name} ended: {" ".join(running.lines[name][-LAST:])}' for name in gone)


def _delays(written: Integers, heard: object, begin: int, end: int) -> tuple[Array, Array, float]:
    """Delays to sending and to receiving (s), and the share of frames with a command of their own.

    Of every frame: until the first command that answers it or a later one, since what waited is
    answered together; of one that nothing answers, at least until the last command.
    """
    row = np.searchsorted(written, heard.stamp_ns + TOLERANCE_NS) - 1
    order = np.argsort(heard.sent_ns, kind='stable')
    row = np.maximum.accumulate(row[order])
    frames = np.flatnonzero((written >= begin) & (written < end))
    own = np.unique(row[(heard.sent_ns[order] >= begin) & (heard.sent_ns[order] < end)])
    if not len(own) or not len(frames):
        return np.full(1, np.nan), np.full(1, np.nan), 0.0
    first = np.minimum(np.searchsorted(row, frames), len(row) - 1)
    at = written[frames]
    return (
        1e-9 * np.maximum(heard.sent_ns[order][first] - at, 0),
        1e-9 * np.maximum(heard.received_ns[order][first] - at, 0),
        len(own) / len(frames),
    )


def _stack(folder: Path, scene: Scene, ports: list[str], busy: bool, threads: str) -> Graph:
    """Everything in one process."""
    values: dict[str, Value] = {
        'hand': 'allegro_v5', 'sensor': scene.sensor, 'ports': ports,
        'calibrations': str(folder / scene.sensor), 'input_rate_hz': scene.rate_hz, **scene.values,
    }  # fmt: skip
    return Graph((Measured('stack', values, '', scene.heard, busy=busy, threads=threads),))


def _nodes(folder: Path, scene: Scene, ports: list[str]) -> Graph:
    """Three processes, of the first finger."""
    finger = scene.fingers[0]
    file = str(folder / scene.sensor / f'{finger}.npz')
    sensor = {'sensor': scene.sensor, **scene.values}
    grip: dict[str, Value] = {
        'hand': 'allegro_v5', 'rate_hz': scene.rate_hz, 'input_rate_hz': scene.rate_hz,
    }  # fmt: skip
    return Graph(
        (
            Measured('grip_node', grip, '', scene.heard),
            Measured('contact_node', {**sensor, 'calibration': file}, finger),
            Measured('sensor_node', {**sensor, 'port': ports[0]}, finger),
        )
    )


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
