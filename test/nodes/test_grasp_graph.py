"""What runs on a hand: sensors of every finger, the grip, a fake hand; and that it all starts."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from rclpy.node import Node
from std_msgs.msg import Float64MultiArray

from tactile_ros.msg import GripState
from tactile_ros.nodes.graph import Graph
from tactile_ros.nodes.grasp_graph import Grasping, grasping
from tactile_ros.nodes.processes import Running

if TYPE_CHECKING:
    from conftest import Ros

PATIENCE_S = 120.0


def test_every_finger_has_its_namespace_port_and_calibration() -> None:
    graph = grasping(Grasping('allegro_v4', calibrations='/cal', namespace='/left/', stack=True))
    assert [graph.name_of(p) for p in graph.processes] == [
        'grip_node', 'left/index/stack', 'left/middle/stack', 'left/ring/stack',
        'left/thumb/stack',
    ]  # fmt: skip
    assert graph['grip_node'].namespace == '/left/'
    ring = graph.processes[3]
    assert ring.parameters['port'] == '/dev/ttyACM2'
    assert ring.parameters['calibration'] == '/cal/ring.npz'
    assert ring.parameters['frame_id'] == 'ring_tactile_link'


def test_ports_are_those_named_or_left_to_the_parameter_file() -> None:
    named = grasping(Grasping('joint_trajectory', ports='/dev/a, /dev/b'))
    ports = [p.parameters.get('port') for p in named.processes if p.executable == 'sensor_node']
    assert ports == ['/dev/a', '/dev/b']
    left = grasping(Grasping('joint_trajectory', params_file='hand.yaml'))
    assert all('port' not in process.parameters for process in left.processes)
    twins = grasping(Grasping('joint_trajectory', source='simulated', seed=4))
    sensors = [p.parameters for p in twins.processes if p.executable == 'sensor_node']
    assert [(p['simulated'], p['seed']) for p in sensors] == [(True, 4), (True, 5)]


def test_some_fingers_alone_take_part() -> None:
    graph = grasping(Grasping('allegro_v5', fingers='thumb,index', mock_hand=True))
    assert graph['grip_node'].parameters['fingers'] == ['thumb', 'index']
    assert graph['mock_hand'].parameters['hand'] == 'allegro_v5'
    assert len(graph.processes) == 6
    with pytest.raises(ValueError, match=r"fingers must be of index, .*; received 'nose'"):
        grasping(Grasping('allegro_v5', fingers='nose'))
    with pytest.raises(ValueError, match='hand must be one of'):
        grasping(Grasping('none'))


class Watcher(Node):
    """Hears the grip and what goes to the hand."""

    def __init__(self) -> None:
        super().__init__('watcher')
        self.states: list[GripState] = []
        self.commands: list[Float64MultiArray] = []
        self.create_subscription(GripState, 'grip_node/state', self.states.append, 10)
        topic = '/allegro_hand_position_controller/commands'
        self.create_subscription(Float64MultiArray, topic, self.commands.append, 10)


def test_the_grip_of_a_fake_hand_starts_says_why_it_waits_and_ends(ros: Ros) -> None:
    whole = grasping(Grasping('allegro_v4', mock_hand=True, source='simulated'))
    graph = Graph(whole.processes[:2])
    ros.init()
    watcher = ros.add(Watcher())
    with Running(graph) as running:
        assert ros.until(lambda: watcher.states, PATIENCE_S), running.lines
        assert watcher.states[-1].fingers == ['index', 'middle', 'ring', 'thumb']
        waits = 'no grasp was asked for'
        assert ros.until(lambda: watcher.states[-1].refusal == waits, PATIENCE_S)
        assert running.stop() == {'mock_hand': 0, 'grip_node': 0}
    assert not watcher.commands
    assert np.isnan(watcher.states[-1].command).all()
