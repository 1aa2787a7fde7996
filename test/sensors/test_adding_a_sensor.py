# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""docs/adding_a_sensor.md, executed: its made-up sensor is found, read, fitted and run."""

import os
import re
import subprocess
import sys
import time
from importlib.util import find_spec
from pathlib import Path

import pytest

from tactile_ros.devices.simulated_serial import BYTE_FAULTS
from tactile_ros.evaluation.recording_files import load
from tactile_ros.nodes.graph import SensorSetup, sensing
from tactile_ros.nodes.processes import Running

ROOT = Path(__file__).resolve().parents[2]
BLOCKS = re.findall(
    r'^```python\n# (\S+\.py)\n(.*?)^```$',
    (ROOT / 'docs' / 'adding_a_sensor.md').read_text(),
    re.DOTALL | re.MULTILINE,
)
INTERFACES = find_spec('rclpy') is not None
PATIENCE_S = 120.0


@pytest.fixture(scope='module')
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder that TACTILE_SENSORS names, with the files of the page."""
    folder = tmp_path_factory.mktemp('my_sensors')
    (folder / 'pinch_pad').mkdir()
    for name, text in BLOCKS:
        place = folder if name == 'try_it.py' else folder / 'pinch_pad'
        (place / name).write_text(text)
    return folder


def python(home: Path, *arguments: str) -> str:
    """What a new Python prints that knows the folder."""
    environment = {**os.environ, 'TACTILE_SENSORS': str(home), 'PYTHONPATH': str(ROOT)}
    done = subprocess.run(
        [sys.executable, *arguments],
        env=environment, cwd=home, check=True, capture_output=True, text=True,
    )  # fmt: skip
    return done.stdout


def test_the_commands_find_it_by_the_variable_alone(home: Path) -> None:
    environment = {**os.environ, 'PYTHONPATH': str(ROOT)}
    environment.pop('TACTILE_SENSORS', None)
    command = ['-m', 'tactile_ros', 'list']
    done = subprocess.run(
        [sys.executable, *command], env=environment, check=True, capture_output=True, text=True
    )
    assert 'gradiometer' in done.stdout
    assert 'pinch_pad' not in done.stdout
    assert 'two force-sensing resistors on a gripper' in python(home, *command)


def test_the_program_of_the_page_estimates_from_its_twin(home: Path) -> None:
    shown = 'print(sorted(pipeline.estimators), state.force.shape, state.valid, config.rate_hz)'
    (home / 'shown.py').write_text((home / 'try_it.py').read_text() + shown + '\n')
    assert python(home, 'shown.py').strip() == "['force'] (3,) True 100.0"


def test_its_driver_passes_the_trials_of_faults(home: Path) -> None:
    code = f"""
from benchmarks.harness.fault_trials import Road, suffer
from tactile_ros.sensors import load_sensor

for fault in {BYTE_FAULTS!r}:
    with Road(load_sensor('pinch_pad')) as road:
        trial = suffer(road, fault, 3, 0.25)
        assert trial.injected == trial.counted == 3, trial
        assert trial.wrong == 0 and trial.recovery_s < 2.0, trial
print('conforms')
"""
    assert python(home, '-c', code).strip() == 'conforms'


@pytest.mark.ros
@pytest.mark.skipif(not INTERFACES, reason='without ROS 2')
def test_it_runs_through_the_real_graph(home: Path, tmp_path: Path) -> None:
    bag = str(tmp_path / 'bag')
    setting = SensorSetup(sensor='pinch_pad', source='simulated', bag=bag, namespace='pinch')
    graph = sensing(setting)
    # this test listens too
    everybody = graph['sensor_node'].parameters['listeners'] + 1
    graph = graph.with_parameters('sensor_node', {'listeners': everybody})
    environment = {'TACTILE_SENSORS': str(home), 'PYTHONPATH': str(ROOT)}
    with Running(graph, environment) as running:
        assert hear('/pinch/frame', 60) == 60, running.lines
        assert set(running.stop().values()) == {0}
    recording = load(bag).recordings[0].recording
    assert recording.layout.sensor == 'pinch_pad'
    assert recording.values.shape[1:] == (2, 1)
    assert len(recording) >= 60


def hear(topic: str, count: int) -> int:
    """Frames of a topic that arrive, until there are `count` of them."""
    import rclpy
    from rclpy.executors import SingleThreadedExecutor
    from rclpy.qos import qos_profile_sensor_data

    from tactile_ros.msg import TactileFrame

    heard = []
    rclpy.init()
    try:
        node = rclpy.create_node('listener')
        node.create_subscription(TactileFrame, topic, heard.append, qos_profile_sensor_data)
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        deadline = time.monotonic() + PATIENCE_S
        while len(heard) < count and time.monotonic() < deadline:
            executor.spin_once(0.05)
        node.destroy_node()
    finally:
        rclpy.try_shutdown()
    return len(heard)
