"""Every adapter over real DDS, against listeners written from the drivers' own interfaces."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np
import pytest
from rcl_interfaces.msg import ParameterType, ParameterValue
from rcl_interfaces.srv import GetParameters
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, String
from trajectory_msgs.msg import JointTrajectory

from tactile_ros.hands import load_hand
from tactile_ros.nodes.grip_node import HandLink
from tactile_ros.nodes.lifecycle import ManagedNode
from tactile_ros.types import GripCommand

if TYPE_CHECKING:
    from conftest import Ros

    from tactile_ros.hands.kinematics import RobotDescription

POSITION_CONTROLLER = '/allegro_hand_position_controller'
EFFORT_CONTROLLER = '/allegro_hand_position_effort_controller'


@dataclass
class Wiring:
    """A HandLink on a node of its own, and what came in."""

    node: ManagedNode
    link: HandLink
    postures: list = field(default_factory=list)


def wire(ros: Ros, hand: str, **options: object) -> Wiring:
    """Connect the adapter of a hand."""
    ros.init()
    node = ros.add(ManagedNode('wired'))
    described = load_hand(hand)
    described = replace(described, driver=replace(described.driver, **options))
    postures: list = []
    link = HandLink(node, described, lambda posture, _: postures.append(posture))
    return Wiring(node, link, postures)


def listen(ros: Ros, kind: type, topic: str, heard: list) -> Node:
    """A driver's subscription: system default QoS of ros2_control and of the vendor's node."""
    node = Node(f'driver{len(ros.nodes)}')
    node.create_subscription(kind, topic, heard.append, 1)
    return ros.add(node)


def tell_order(ros: Ros, controller: str, joints: list[str]) -> None:
    """A controller that answers for its parameter `joints`."""

    def answer(
        request: GetParameters.Request, response: GetParameters.Response
    ) -> GetParameters.Response:
        assert list(request.names) == ['joints']
        kind = ParameterType.PARAMETER_STRING_ARRAY
        response.values = [ParameterValue(type=kind, string_array_value=joints)]
        return response

    other = ros.add(Node('controller'))
    other.create_service(GetParameters, f'{controller}/get_parameters', answer)


def command(position: list[float], effort: float = np.nan) -> GripCommand:
    return GripCommand(5_000_000_000, np.array(position), np.full(len(position), effort))


def sent(ros: Ros, link: HandLink, heard: list, given: GripCommand) -> object:
    """First message that arrives of a command; sent again until the driver listens."""
    assert ros.until(lambda: not link.blocked), link.blocked
    assert ros.until(lambda: heard or link.send(given))
    return heard[0]


THUMB_FIRST = [f'ah_joint{f}{j}' for f in range(4) for j in range(4)]
# of thumb, index, middle, ring: 0.00 .. 0.03, 0.10 .. 0.13, ...
VALUES = [f / 10 + j / 100 for f in range(4) for j in range(4)]


@pytest.mark.parametrize(
    'told', [THUMB_FIRST, THUMB_FIRST[4:] + THUMB_FIRST[:4]], ids=['thumb first', 'thumb last']
)
def test_v4_gets_sixteen_numbers_in_the_order_that_its_controller_tells(
    ros: Ros, told: list[str]
) -> None:
    wired = wire(ros, 'allegro_v4')
    heard: list = []
    listen(ros, Float64MultiArray, f'{POSITION_CONTROLLER}/commands', heard)
    assert 'does not tell the order of its joints yet' in wired.link.blocked
    tell_order(ros, POSITION_CONTROLLER, told)
    message = sent(ros, wired.link, heard, command(VALUES))
    by_name = dict(zip(THUMB_FIRST, VALUES, strict=True))
    np.testing.assert_allclose(message.data, [by_name[name] for name in told])
    assert not message.layout.dim


def test_a_controller_of_other_joints_gets_nothing(ros: Ros) -> None:
    wired = wire(ros, 'allegro_v4')
    tell_order(ros, POSITION_CONTROLLER, ['ahl' + name[2:] for name in THUMB_FIRST])
    assert ros.until(lambda: 'must name the 16 joints of this hand' in wired.link.blocked)


def test_plexus_gets_caps_and_positions(ros: Ros) -> None:
    wired = wire(ros, 'allegro_plexus')
    caps: list = []
    positions: list = []
    listen(ros, Float64MultiArray, f'{EFFORT_CONTROLLER}/efforts', caps)
    listen(ros, Float64MultiArray, f'{EFFORT_CONTROLLER}/commands', positions)
    tell_order(ros, EFFORT_CONTROLLER, THUMB_FIRST)
    message = sent(ros, wired.link, positions, command(VALUES, 0.2))
    np.testing.assert_allclose(message.data, VALUES)
    assert ros.until(lambda: caps)
    np.testing.assert_allclose(caps[0].data, 0.2)


@pytest.mark.parametrize('hand', ['allegro_v5', 'allegro_v5_sense'])
def test_v5_gets_a_stamped_joint_state_of_sixteen_index_first(ros: Ros, hand: str) -> None:
    wired = wire(ros, hand, number=3)
    heard: list = []
    listen(ros, JointState, '/allegroHand_3/joint_cmd', heard)
    message = sent(ros, wired.link, heard, command(VALUES))
    assert list(message.name) == [f'joint_{i}_0' for i in range(16)]
    np.testing.assert_allclose(message.position, VALUES)
    assert not message.velocity
    assert not message.effort
    assert message.header.stamp.sec == 5


@pytest.mark.parametrize(
    ('hand', 'topic', 'joints'),
    [
        ('qb_softhand', '/qbhand1/qbhand1_synergy_trajectory_controller/joint_trajectory',
         ['qbhand1_synergy_joint']),
        ('qb_softhand_2m', '/qbhand2m1/qbhand2m1_synergies_trajectory_controller/joint_trajectory',
         ['qbhand2m1_synergy_joint', 'qbhand2m1_manipulation_joint']),
        ('joint_trajectory', '/joint_trajectory_controller/joint_trajectory',
         ['left_finger_joint', 'right_finger_joint']),
    ],
)  # fmt: skip
def test_trajectory_controllers_get_one_near_point(
    ros: Ros, hand: str, topic: str, joints: list[str]
) -> None:
    wired = wire(ros, hand)
    heard: list = []
    listen(ros, JointTrajectory, topic, heard)
    message = sent(ros, wired.link, heard, command([0.3, 0.4][: len(joints)]))
    assert list(message.joint_names) == joints
    assert len(message.points) == 1
    np.testing.assert_allclose(message.points[0].positions, [0.3, 0.4][: len(joints)])
    horizon = message.points[0].time_from_start
    assert horizon.sec == 0
    assert 2e7 <= horizon.nanosec <= 2e8
    assert message.header.stamp.sec == 0


def test_topics_are_parameters(ros: Ros) -> None:
    wired = wire(
        ros, 'allegro_v5', command_topic='/allegroHand/joint_cmd', state_topic='/old/states'
    )
    heard: list = []
    driver = listen(ros, JointState, '/allegroHand/joint_cmd', heard)
    assert sent(ros, wired.link, heard, command(VALUES))
    assert driver.count_subscribers('/old/states') == 1


def test_joint_states_of_others_are_left_out_and_damaged_ones_told(
    ros: Ros, capfd: pytest.CaptureFixture[str]
) -> None:
    wired = wire(ros, 'qb_softhand')
    driver = ros.add(Node('driver'))
    states = driver.create_publisher(JointState, '/qbhand1/joint_states', 10)
    assert ros.until(states.get_subscription_count)
    states.publish(JointState(name=['wrist'], position=[9.0]))
    states.publish(JointState(name=['qbhand1_synergy_joint'], position=[float('nan')]))
    said: list[str] = []

    def is_told() -> bool:
        said.append(capfd.readouterr().err)
        return 'positions of joint states must be finite' in ''.join(said)

    assert ros.until(is_told)
    states.publish(JointState(name=['wrist', 'qbhand1_synergy_joint'], position=[9.0, 0.25]))
    assert ros.until(lambda: wired.postures)
    np.testing.assert_array_equal(wired.postures, [[0.25]])


def test_a_closed_link_can_send_no_more(ros: Ros) -> None:
    wired = wire(ros, 'allegro_v5')
    heard: list = []
    driver = listen(ros, JointState, '/allegroHand_0/joint_cmd', heard)
    sent(ros, wired.link, heard, command(VALUES))
    wired.link.close()
    assert ros.until(lambda: not driver.count_publishers('/allegroHand_0/joint_cmd'))


URDF = '<robot name="qb"><joint name="qbhand1_synergy_joint" type="revolute">' \
    '<parent link="palm"/><child link="hand"/><limit lower="0" upper="0.8" velocity="0.5" ' \
    'effort="100"/></joint></robot>'  # fmt: skip


OTHER = '<robot name="arm"><joint name="elbow" type="revolute"><parent link="a"/>' \
    '<child link="b"/></joint></robot>'  # fmt: skip


class Learner:
    """Takes descriptions of a qb SoftHand."""

    def __init__(self) -> None:
        self.learnt: list[list[str]] = []

    def __call__(self, robot: RobotDescription) -> bool:
        self.learnt.append(list(robot.joints))
        return 'qbhand1_synergy_joint' in robot.joints


@pytest.mark.parametrize('wait', [True, False])
def test_a_description_is_taken_where_it_comes_and_waited_for_where_asked(
    ros: Ros, wait: bool
) -> None:
    ros.init()
    node, learner = ros.add(ManagedNode('wired')), Learner()
    link = HandLink(node, load_hand('qb_softhand'), lambda *_: None, learner, wait)
    assert link.blocked == ('robot_description has not come' if wait else '')
    publisher = ros.add(Node('robot_state_publisher')).create_publisher(
        String, 'robot_description',
        QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL),
    )  # fmt: skip
    publisher.publish(String(data=OTHER))
    assert ros.until(lambda: learner.learnt)
    assert link.blocked == ('robot_description has not come' if wait else '')
    publisher.publish(String(data='<!DOCTYPE robot><robot/>'))
    assert ros.until(lambda: 'no document type' in link.blocked)
    publisher.publish(String(data=URDF))
    assert ros.until(lambda: not link.blocked)
    assert learner.learnt == [['elbow'], ['qbhand1_synergy_joint']]


@pytest.mark.parametrize(
    'reliability', [ReliabilityPolicy.RELIABLE, ReliabilityPolicy.BEST_EFFORT]
)
def test_joint_states_come_from_a_driver_of_either_reliability(
    ros: Ros, reliability: ReliabilityPolicy
) -> None:
    wired = wire(ros, 'qb_softhand')
    states = ros.add(Node('driver')).create_publisher(
        JointState, '/qbhand1/joint_states', QoSProfile(depth=5, reliability=reliability)
    )
    message = JointState(name=['qbhand1_synergy_joint'], position=[0.25])
    assert ros.until(lambda: wired.postures or states.publish(message))


def test_a_controller_that_never_answers_is_asked_once_at_a_time(ros: Ros) -> None:
    wired = wire(ros, 'allegro_v4')
    name = f'{POSITION_CONTROLLER}/get_parameters'
    silent = Node('hangs')  # nobody spins it
    ros.nodes.append(silent)
    silent.create_service(GetParameters, name, lambda _, response: response)
    client = wired.link._client
    assert ros.until(client.service_is_ready)
    for _ in range(5):
        wired.link._ask()
    assert len(client._pending_requests) == 1
    assert 'does not tell the order' in wired.link.blocked
