"""One description of what runs: command lines, listeners, order."""

from __future__ import annotations

import math
import subprocess
from pathlib import Path

import pytest
import yaml

from tactile_ros.errors import TactileError
from tactile_ros.nodes.graph import (
    Graph,
    Process,
    Setting,
    private_folder,
    sensing,
    yaml_text,
)
from tactile_ros.nodes.processes import Running


@pytest.mark.parametrize(
    'value', [True, 3, 2.0, 1e-7, 'a: b', '', 'ä"\\', [1.0, 2.5], float('inf'), -math.inf]
)
def test_values_survive_yaml(value: object) -> None:
    got = yaml.safe_load(yaml_text(value))
    assert float(got) == value if value == 1e-7 else got == value


def test_nan_survives_yaml() -> None:
    assert math.isnan(yaml.safe_load(yaml_text(math.nan)))


def names(graph: Graph) -> list[str]:
    return [process.executable for process in graph.processes]


def test_hardware_is_two_processes_or_one() -> None:
    assert names(sensing(Setting())) == ['contact_node', 'sensor_node']
    assert names(sensing(Setting(stack=True))) == ['stack']


def test_everybody_who_listens_is_waited_for() -> None:
    graph = sensing(Setting(source='recorded', bag='bag'))
    assert names(graph) == ['record', 'contact_node', 'sensor_node', 'player']
    assert graph['contact_node'].parameters['listeners'] == 2
    assert graph['sensor_node'].parameters['listeners'] == 3
    assert graph['player'].parameters['listeners'] == 1
    stack = sensing(Setting(source='recorded', bag='bag', stack=True))
    assert stack['stack'].parameters['listeners'] == 2


def test_a_node_gets_parameters_wherever_it_runs() -> None:
    for stack in (False, True):
        graph = sensing(Setting(stack=stack)).with_parameters('sensor_node', {'serial': 'A7'})
        assert graph['stack' if stack else 'sensor_node'].parameters['serial'] == 'A7'
    with pytest.raises(KeyError):
        sensing(Setting()).with_parameters('player', {})


def test_command_line() -> None:
    process = Process('stack', {'port': '/dev/x'}, 'hand/thumb', {'frame': 'raw'}, 'p.yaml')
    arguments = process.ros_arguments()
    assert arguments == [
        '-r', '__ns:=/hand/thumb', '-r', 'frame:=raw', '--params-file', 'p.yaml',
        '-p', 'port:="/dev/x"',
    ]  # fmt: skip
    assert process.command()[2:4] == ['tactile_ros.nodes', 'stack']


def test_a_process_that_fails_is_named_with_its_words() -> None:
    graph = Graph((Process('record', {'nothing': 1}), Process('sensor_node', {'sensor': 'none'})))
    with Running(graph) as running, pytest.raises(TactileError, match='sensor_node ended with'):
        running.wait('record', 120.0)
    assert 'sensor must be one of' in ' '.join(running.lines['sensor_node'])


def test_defaults_are_left_to_the_parameter_file() -> None:
    graph = sensing(Setting(params_file='p.yaml'))
    assert set(graph['sensor_node'].parameters) == {'listeners'}
    assert set(graph['contact_node'].parameters) == {'listeners'}
    named = sensing(Setting(port='/dev/x', calibration='c.npz', autostart=False))
    assert named['sensor_node'].parameters['port'] == '/dev/x'
    assert named['contact_node'].parameters['calibration'] == 'c.npz'
    assert named['contact_node'].parameters['autostart'] is False


def test_played_boards_do_not_share_a_port() -> None:
    ports = [
        sensing(Setting(source='recorded', namespace=space))['player'].parameters['port']
        for space in ('', 'hand/thumb', '/hand/index/')
    ]
    assert [Path(port).name for port in ports] == [
        'board', 'board_hand_thumb', 'board_hand_index',
    ]  # fmt: skip
    folders = {Path(port).parent for port in ports}
    assert folders == {private_folder()}
    # nobody else may put a port in its place
    assert private_folder().stat().st_mode & 0o777 == 0o700


@pytest.mark.parametrize('stack', [False, True])
def test_simulated_is_the_twin_and_no_player(stack: bool) -> None:
    chosen = Setting('gradiometer', 'simulated', bag='b', stack=stack, seed=3, fault='flipped:2')
    graph = sensing(chosen)
    assert 'player' not in names(graph)
    got = graph['stack' if stack else 'sensor_node'].parameters
    assert got['simulated'] is True
    assert (got['sensor'], got['seed'], got['fault']) == ('gradiometer', 3, 'flipped:2')
    assert 'port' not in got
    assert got['listeners'] == (1 if stack else 2)


@pytest.mark.parametrize(
    ('arguments', 'sentence'),
    [
        (['-p', 'rate_hz:=-1.0'], 'rate_hz'),
        (['-p', 'sensor:=none'], 'sensor must be one of five_wire_skin'),
        (['--params-file', '/nowhere.yaml'], 'the ROS arguments cannot be read'),
    ],
)
def test_a_start_that_cannot_be_is_one_sentence(arguments: list[str], sentence: str) -> None:
    command = [*Process('sensor_node').command(), '--ros-args', *arguments]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode in (1, 2)
    assert sentence in done.stderr
    assert 'Traceback' not in done.stderr
