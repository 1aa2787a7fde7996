# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Processes end with whoever started them, however that ends."""

import os
import select
import signal
import subprocess
import sys
import textwrap
import time
from pathlib import Path

import pytest

from tactile_ros.calibration import MOST_MEMBERS
from tactile_ros.errors import TactileError
from tactile_ros.nodes.graph import Graph, Process
from tactile_ros.nodes.processes import STARTED_BY, Running
from tactile_ros.sensors import load_sensor

ROOT = Path(__file__).resolve().parents[2]
PATIENCE_S = 120.0

pytestmark = pytest.mark.skipif(sys.platform != 'linux', reason='only Linux tells of a death')

NODES = """
    from tactile_ros.nodes.graph import Graph, Process
    from tactile_ros.nodes.processes import Running
    with Running(Graph((Process('sensor_node', {'port': '/nowhere'}),))) as running:
        running.wait_for_line('sensor_node', '/nowhere', 120.0)
        print(running.children['sensor_node'].pid, flush=True)
        running.children['sensor_node'].wait(120.0)
"""
WORKERS = """
    import os, time
    from tactile_ros.cli.demo import workers
    with workers() as pool:
        print(pool.submit(os.getpid).result(), flush=True)
        pool.submit(time.sleep, 60.0).result()
"""
WORKERS_3_14 = f"""
    import multiprocessing
    multiprocessing.set_start_method('forkserver')
    {WORKERS.strip()}
"""


@pytest.mark.parametrize('code', [NODES, WORKERS, WORKERS_3_14], ids=['nodes', 'workers', '3.14'])
def test_a_killed_parent_takes_its_children_along(code: str) -> None:
    with subprocess.Popen(
        [sys.executable, '-c', textwrap.dedent(code)],
        stdout=subprocess.PIPE,
        env={**os.environ, 'PYTHONPATH': str(ROOT)},
    ) as parent:
        child = os.pidfd_open(int(parent.stdout.readline()))
        parent.kill()
        over = select.select([child], [], [], PATIENCE_S)[0]
        if not over:
            signal.pidfd_send_signal(child, signal.SIGKILL)
        os.close(child)
    assert over


def test_a_node_whose_parent_is_gone_does_not_begin() -> None:
    done = subprocess.run(
        Process('record').command(), env={**os.environ, STARTED_BY: '-1'}, capture_output=True,
        text=True, timeout=PATIENCE_S, check=False,
    )  # fmt: skip
    assert done.returncode == 1
    assert done.stderr == 'what started this node has ended\n'


def test_a_stop_while_a_node_starts_is_no_traceback() -> None:
    with Running(Graph((Process('sensor_node'),))) as running:
        running.stop()
    assert running.lines['sensor_node'] == []


@pytest.fixture(scope='module')
def large(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A calibration that takes seconds to load: nearly as many members as a file may hold."""
    path = tmp_path_factory.mktemp('large') / 'large.npz'
    pipeline = load_sensor('gradiometer').pipeline()
    pipeline.left_out_ = {str(i): 0.0 for i in range(MOST_MEMBERS - 1000)}
    pipeline.save(path)
    return path


def reads(child: subprocess.Popen[str], path: Path) -> bool:
    """A process has a file open."""
    try:
        return path in [link.readlink() for link in Path(f'/proc/{child.pid}/fd').iterdir()]
    except FileNotFoundError:  # one was closed meanwhile
        return False


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize('executable', ['contact_node', 'stack'])
def test_a_signal_amid_a_long_configure_ends_a_node_within_a_second(
    executable: str, number: int, large: Path
) -> None:
    values = {'sensor': 'gradiometer', 'calibration': str(large), 'simulated': True}
    with Running(Graph((Process(executable, values),))) as running:
        child = running.children[executable]
        until = time.monotonic() + PATIENCE_S
        while not reads(child, large):
            assert time.monotonic() < until, running.lines
            time.sleep(1e-3)
        child.send_signal(number)
        assert child.wait(1.0) == 0
    assert running.lines[executable] == []


def test_who_waits_hears_what_the_others_said_and_many_signals_end_a_node_as_one() -> None:
    graph = Graph((Process('sensor_node', {'port': '/nowhere'}), Process('record')))
    with Running(graph) as running:
        running.wait_for_line('sensor_node', '/nowhere', PATIENCE_S)
        sentence = r"say 'x' within 0.1 s; sensor_node said: .*/nowhere"
        with pytest.raises(TactileError, match=sentence):
            running.wait_for_line('record', 'x', 0.1)
        for _ in range(200_000):
            if not running.is_alive('sensor_node'):
                break
            running.children['sensor_node'].send_signal(signal.SIGINT)
            running.children['sensor_node'].send_signal(signal.SIGTERM)
            time.sleep(1e-4)  # the node needs a processor to end
        assert running.children['sensor_node'].wait(PATIENCE_S) == 0, running.lines
