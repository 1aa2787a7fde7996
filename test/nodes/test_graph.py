# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""One description of what runs: command lines, listeners, order."""

from __future__ import annotations

import math
import signal
import subprocess
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
import yaml
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.action import ActionClient
from sensor_msgs.msg import JointState

from tactile_ros.action import Grasp
from tactile_ros.enrolment import thinned
from tactile_ros.msg import GripState, TactileContacts, TactileFrame
from tactile_ros.nodes.graph import (
    Graph,
    HandSetup,
    Process,
    SensorSetup,
    frame_of,
    grasping,
    private_folder,
    sensing,
    stack_of,
    yaml_text,
)
from tactile_ros.nodes.lifecycle import qos
from tactile_ros.nodes.processes import Running
from tactile_ros.sensors import load_sensor

if TYPE_CHECKING:
    from conftest import Ros

PATIENCE_S = 120.0
BOTH = {'fewest_fingers': 2, 'fault_time': 60.0}  # patient while the graph comes up


def test_every_finger_has_its_namespace_port_and_calibration() -> None:
    graph = grasping(HandSetup('allegro_v4', calibrations='/cal', namespace='/left/'))
    assert [graph.name_of(p) for p in graph.processes[::2]] == [
        'grip_node', 'left/index/sensor_node', 'left/middle/sensor_node', 'left/ring/sensor_node',
        'left/thumb/sensor_node',
    ]  # fmt: skip
    assert graph['grip_node'].namespace == '/left/'
    ring = {**graph.processes[5].parameters, **graph.processes[6].parameters}
    assert ring['port'] == '/dev/ttyACM2'
    assert ring['calibration'] == '/cal/ring.npz'
    assert frame_of(graph.processes[5].namespace) == 'left/ring_tactile_link'


def test_a_stack_is_one_process_that_knows_the_same_of_every_finger() -> None:
    choice = HandSetup('allegro_v4', calibrations='/cal', namespace='/left/', stack=True, seed=3)
    (stack,) = grasping(choice).processes
    assert (stack.executable, stack.namespace) == ('stack', '/left/')
    assert stack.nodes == ('grip_node', 'contact_node', 'sensor_node')
    assert stack.parameters == {
        'hand': 'allegro_v4', 'calibrations': '/cal', 'seed': 3,
        'ports': [f'/dev/ttyACM{i}' for i in range(4)],
    }  # fmt: skip
    thumb = stack_of(choice)[3]
    assert thumb.namespace == 'left/thumb'
    assert thumb.parameters['port'] == '/dev/ttyACM3'
    assert thumb.parameters['calibration'] == '/cal/thumb.npz'
    played = grasping(HandSetup('joint_trajectory', source='recorded', stack=True))
    assert [p.executable for p in played.processes] == ['stack', 'player', 'player']
    places = [p.parameters['port'] for p in played.processes[1:]]
    assert played['stack'].parameters['ports'] == places


def test_ports_are_those_named_or_left_to_the_parameter_file() -> None:
    named = grasping(HandSetup('joint_trajectory', ports='/dev/a, /dev/b'))
    ports = [p.parameters.get('port') for p in named.processes if p.executable == 'sensor_node']
    assert ports == ['/dev/a', '/dev/b']
    left = grasping(HandSetup('joint_trajectory', params_file='hand.yaml'))
    assert all('port' not in process.parameters for process in left.processes)
    twins = grasping(HandSetup('joint_trajectory', source='simulated', seed=4))
    sensors = [p.parameters for p in twins.processes if p.executable == 'sensor_node']
    assert [(p['simulated'], p['seed']) for p in sensors] == [(True, 4), (True, 5)]


def test_some_fingers_alone_take_part() -> None:
    graph = grasping(HandSetup('allegro_v5', fingers='thumb,index', mock_hand=True))
    assert graph['grip_node'].parameters['fingers'] == ['thumb', 'index']
    assert graph['mock_hand'].parameters['hand'] == 'allegro_v5'
    assert len(graph.processes) == 6
    with pytest.raises(ValueError, match=r"fingers must be of index, .*; received 'nose'"):
        grasping(HandSetup('allegro_v5', fingers='nose'))
    with pytest.raises(ValueError, match='hand must be one of'):
        grasping(HandSetup('none'))
    with pytest.raises(ValueError, match='gradiometer has no recordings to play'):
        sensing(SensorSetup(sensor='gradiometer', source='recorded'))


@pytest.fixture(scope='module')
def calibrations(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Of both fingers of a gripper, on presses of another seed than those of the twins."""
    folder = tmp_path_factory.mktemp('calibrations')
    spec = load_sensor('reskin_board')
    pipeline = spec.pipeline(estimator='ridge').fit(thinned(spec.presses(spec.config(), 7), 20.0))
    for finger in ('left', 'right'):
        pipeline.save(folder / f'{finger}.npz')
    return folder


def test_a_grasp_is_held_through_the_whole_graph(ros: Ros, calibrations: Path) -> None:
    """Twins that the closing presses, their drivers, contacts, grip and fake hand, to `held`."""
    choice = HandSetup(
        'joint_trajectory', mock_hand=True, source='simulated', stack=True,
        calibrations=str(calibrations), seed=3,
    )  # fmt: skip
    graph = grasping(choice).with_parameters(
        'grip_node', {'closing_rate': 1.0, 'stiffness_high': 60.0, 'stale_after': 0.5, **BOTH}
    )
    ros.init()
    states: list[GripState] = ros.hear(GripState, 'grip_node/state')
    joints: list[JointState] = ros.hear(JointState, '/joint_states')
    felt = [ros.hear(TactileContacts, f'{name}/contacts') for name in ('left', 'right')]
    client = ActionClient(ros.listener, Grasp, 'grip_node/grasp')

    def pressed() -> np.ndarray:
        """Forces (N) that the springs of the fake hand have at its newest posture."""
        return 40.0 * (np.array(joints[-1].position) / 0.8 - 0.4)

    def grasped(force: float) -> Grasp.Result:
        goal = Grasp.Goal(target_force=force, timeout=PATIENCE_S)
        handle = ros.begin(lambda: client.send_goal_async(goal))
        return ros.result(handle.get_result_async()).result

    with Running(graph) as running:
        assert ros.until(lambda: states and joints and all(felt)), running.lines
        assert ros.until(client.server_is_ready)
        ended = grasped(2.0)
        assert ended.outcome == Grasp.Result.HELD, (ended, running.lines)
        # no object joins the springs: what they differ by stays, and the stronger side rules
        most = 2.0 * 2.0  # the asked force and as much again
        assert 0.9 * 2.0 < max(ended.force) < 1.1 * most, ended.force
        told = np.array(ended.force)
        # of a machine that is busy the newest joint states come a little later than the result
        assert ros.until(lambda: np.abs(pressed() - told).max() < 1.0), (pressed(), told)
        assert grasped(0.0).message == 'the hand is open'
        assert set(running.stop().values()) == {0}


def test_what_a_launch_file_starts_measures_and_outlives_a_kill(
    ros: Ros, calibrations: Path
) -> None:
    """Two processes in a namespace: forces as in truth; a killed driver is seen and comes back."""
    graph = sensing(
        SensorSetup(
            source='simulated', namespace='palm', seed=3,
            calibration=str(calibrations / 'left.npz'),
        )
    )  # fmt: skip
    ros.init()
    felt: list[TactileContacts] = ros.hear(TactileContacts, 'palm/contacts')
    true: list[TactileContacts] = ros.hear(TactileContacts, 'palm/truth/contacts')
    told: list[DiagnosticArray] = ros.hear(DiagnosticArray, '/diagnostics')

    def silent() -> bool:
        states = [state for message in told for state in message.status]
        return any('contact_node' in s.name and s.level == s.ERROR for s in states)

    def pairs() -> list[tuple[TactileContacts, TactileContacts]]:
        truth = {message.sequence: message for message in true}
        return [(m, truth[m.sequence]) for m in felt if m.sequence in truth]

    with Running(graph) as running:
        assert ros.until(lambda: sum(t.in_contact for _, t in pairs()) > 100), running.lines
        off = [m.wrench.force.z - t.wrench.force.z for m, t in pairs()]
        load = [t.wrench.force.z for _, t in pairs()]
        same = [m.in_contact == t.in_contact for m, t in pairs()]
        assert np.sqrt(np.mean(np.square(off))) < 0.3 * np.std(load)
        assert np.mean(same) > 0.9
        running.children['sensor_node'].kill()
        assert running.children['sensor_node'].wait() == -signal.SIGKILL
        told.clear()
        assert ros.until(silent), running.lines
        running.start(graph['sensor_node'])
        felt.clear()
        assert ros.until(lambda: felt), running.lines
        assert set(running.stop().values()) == {0}


@pytest.mark.parametrize(
    'value', [True, 3, 2.0, 1e-7, 'a: b', 'ä"\\', [1.0, 2.5], -math.inf, math.nan]
)
def test_values_survive_yaml(value: object) -> None:
    got = yaml.safe_load(yaml_text(value))
    np.testing.assert_equal(float(got) if value == 1e-7 else got, value)


def names(graph: Graph) -> list[str]:
    return [process.executable for process in graph.processes]


@pytest.mark.parametrize('stack', [False, True])
def test_everybody_who_listens_is_waited_for(stack: bool) -> None:
    nodes = ['stack'] if stack else ['contact_node', 'sensor_node']
    assert names(sensing(SensorSetup(stack=stack))) == nodes
    graph = sensing(SensorSetup(source='recorded', bag='bag', stack=stack))
    assert names(graph) == ['record', *nodes, 'player']
    listeners = [process.parameters.get('listeners') for process in graph.processes]
    assert listeners == [None, *([2] if stack else [2, 3]), 1]
    twin = SensorSetup(
        sensor='gradiometer', source='simulated', bag='b', stack=stack, seed=3, fault='flipped:2'
    )
    graph = sensing(twin)
    assert names(graph) == ['record', *nodes]
    got = graph[nodes[-1]].parameters
    expected = {'simulated': True, 'sensor': 'gradiometer', 'seed': 3, 'fault': 'flipped:2'}
    assert expected.items() <= got.items()
    assert 'port' not in got
    assert got['listeners'] == (1 if stack else 2)


def test_a_node_gets_parameters_wherever_it_runs() -> None:
    for stack in (False, True):
        graph = sensing(SensorSetup(stack=stack)).with_parameters('sensor_node', {'serial': 'A7'})
        assert graph['stack' if stack else 'sensor_node'].parameters['serial'] == 'A7'
    with pytest.raises(KeyError):
        sensing(SensorSetup()).with_parameters('player', {})


def test_command_line() -> None:
    process = Process('stack', {'port': '/dev/x'}, 'hand/thumb', 'p.yaml')
    arguments = process.ros_arguments()
    assert arguments == [
        '-r', '__ns:=/hand/thumb', '--params-file', 'p.yaml', '-p', 'port:="/dev/x"',
    ]  # fmt: skip
    assert process.command()[2:4] == ['tactile_ros.nodes', 'stack']


def test_defaults_are_left_to_the_parameter_file() -> None:
    graph = sensing(SensorSetup(params_file='p.yaml'))
    assert set(graph['sensor_node'].parameters) == {'listeners'}
    assert set(graph['contact_node'].parameters) == {'listeners'}
    named = sensing(SensorSetup(port='/dev/x', calibration='c.npz', autostart=False))
    assert named['sensor_node'].parameters['port'] == '/dev/x'
    assert named['contact_node'].parameters['calibration'] == 'c.npz'
    assert named['contact_node'].parameters['autostart'] is False


def test_played_boards_do_not_share_a_port() -> None:
    ports = [
        sensing(SensorSetup(source='recorded', namespace=space))['player'].parameters['port']
        for space in ('', 'hand/thumb', '/hand/index/')
    ]
    assert [Path(port).name for port in ports] == [
        'board', 'board_hand_thumb', 'board_hand_index',
    ]  # fmt: skip
    folders = {Path(port).parent for port in ports}
    assert folders == {private_folder()}
    # nobody else may put a port in its place
    assert private_folder().stat().st_mode & 0o777 == 0o700


def test_a_start_that_cannot_be_is_one_sentence() -> None:
    cases = {
        'rate_hz': ('sensor_node', '-p', 'rate_hz:=-1.0'),
        'the ROS arguments cannot be read': ('sensor_node', '--params-file', '/nowhere.yaml'),
        'hand must be one of allegro_plexus': ('grip_node', '-p', 'hand:=none'),
        'sensor must be one of five_wire_skin': ('contact_node', '-p', 'sensor:=none'),
        'cannot be read as plain arrays (it is no file)': ('stack', '-p', 'calibration:=/tmp'),
    }
    started = {
        sentence: subprocess.Popen(
            [*Process(name).command(), '--ros-args', *arguments], stderr=subprocess.PIPE, text=True
        )
        for sentence, (name, *arguments) in cases.items()
    }
    for sentence, process in started.items():
        said = process.communicate(timeout=120)[1]
        assert process.returncode in (1, 2)
        assert sentence in said
        assert 'Traceback' not in said


def test_a_full_disk_ends_the_recorder_with_a_sentence(ros: Ros, tmp_path: Path) -> None:
    command = Process('record', {'bag': str(tmp_path / 'bag')}).command()
    limited = ['/bin/sh', '-c', 'ulimit -f 40; exec "$@"', 'sh', *command]
    ros.init()
    publisher = ros.listener.create_publisher(TactileFrame, 'frame', qos())
    message = TactileFrame(values=[0.0] * 15)
    with subprocess.Popen(
        limited, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    ) as recorder:
        assert ros.until(lambda: recorder.poll() is not None or publisher.publish(message))
        said = recorder.stdout.read()
    assert recorder.returncode == 1, said
    assert said.count('cannot grow: File too large') == 1, said
    assert 'Traceback' not in said
