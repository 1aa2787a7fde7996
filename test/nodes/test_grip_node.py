# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""grip_node over real DDS with a fake hand: grasps, faults, and silence while it is not active."""

from __future__ import annotations

import math
import re
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING

import numpy as np
import pytest
from action_msgs.msg import GoalStatus
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rcl_interfaces.msg import ParameterType, ParameterValue
from rcl_interfaces.srv import GetParameters
from rclpy.action import ActionClient
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from std_srvs.srv import SetBool
from trajectory_msgs.msg import JointTrajectory

from tactile_ros.action import Grasp
from tactile_ros.control import GraspOutcome, GraspProgress, GripConfig, GripPhase
from tactile_ros.control.grip_force import NOT_ASKED
from tactile_ros.hands import load_hand
from tactile_ros.messages import fill_header, stamp_ns
from tactile_ros.msg import GripState, TactileContacts, TactileFrame
from tactile_ros.nodes import grip_node, lifecycle
from tactile_ros.nodes.grip_loop import Decision
from tactile_ros.nodes.grip_node import (
    FEEDBACK_S,
    GraspServer,
    GripDiagnostics,
    GripNode,
    HandLink,
)
from tactile_ros.nodes.lifecycle import ManagedNode, qos
from tactile_ros.nodes.mock_hand_node import MockHandNode
from tactile_ros.nodes.record_node import RecordNode

if TYPE_CHECKING:
    from conftest import Ros

    from tactile_ros.hands.kinematics import RobotDescription

POSITION_CONTROLLER = '/allegro_hand_position_controller'
EFFORT_CONTROLLER = '/allegro_hand_position_effort_controller'
URDF = (
    '<robot name="qb"><joint name="qbhand1_synergy_joint" type="revolute"><parent link="p"/>'
    '<child link="h"/><limit lower="0" upper="0.35" velocity="100" effort="100"/></joint></robot>'
)
FINGERS = 'thumb', 'index', 'middle'
THUMB_FIRST = [f'ah_joint{f}{j}' for f in range(4) for j in range(4)]


def wire(ros: Ros, hand: str, **more: object) -> tuple[HandLink, list[np.ndarray]]:
    """A HandLink on a node of its own, and the postures that come in."""
    ros.init()
    node, postures = ros.add(ManagedNode('wired')), []
    return HandLink(node, load_hand(hand), lambda at, *_: postures.append(at), **more), postures


def test_a_controller_of_other_joints_gets_nothing(ros: Ros) -> None:
    link, _ = wire(ros, 'allegro_v4')

    def answer(_: object, response: GetParameters.Response) -> GetParameters.Response:
        told = ParameterValue(type=ParameterType.PARAMETER_STRING_ARRAY)
        told.string_array_value = ['ahl' + name[2:] for name in THUMB_FIRST]
        response.values = [told]
        return response

    ros.listener.create_service(GetParameters, f'{POSITION_CONTROLLER}/get_parameters', answer)
    assert ros.until(lambda: 'must name the 16 joints of this hand' in link.blocked)


def test_joint_states_of_others_are_left_out_and_damaged_ones_told(
    ros: Ros, capfd: pytest.CaptureFixture[str]
) -> None:
    link, postures = wire(ros, 'qb_softhand')
    # some drivers publish as sensors do
    profile = QoSProfile(depth=5, reliability=ReliabilityPolicy.BEST_EFFORT)
    states = ros.listener.create_publisher(JointState, '/qbhand1/joint_states', profile)
    assert ros.until(states.get_subscription_count)
    states.publish(JointState(name=['wrist'], position=[9.0]))
    said: list[str] = []

    def is_told() -> bool:
        states.publish(JointState(name=['qbhand1_synergy_joint'], position=[float('nan')]))
        said.append(capfd.readouterr().err)
        return 'positions of joint states must be finite' in ''.join(said)

    assert ros.until(is_told)
    whole = JointState(name=['wrist', 'qbhand1_synergy_joint'], position=[9.0, 0.25])
    assert ros.until(lambda: postures or states.publish(whole))
    np.testing.assert_array_equal(postures[0], [0.25])
    assert not link.blocked


def test_a_description_is_waited_for_and_one_of_another_hand_is_none(ros: Ros) -> None:
    learnt = []

    def learn(robot: RobotDescription) -> bool:
        learnt.append(list(robot.joints))
        return 'qbhand1_synergy_joint' in robot.joints

    link, _ = wire(ros, 'qb_softhand', learn=learn, wait=True)
    said = 'robot_description has not come'
    assert link.blocked == said
    publisher = ros.listener.create_publisher(String, 'robot_description', qos('layout'))
    publisher.publish(String(data=URDF.replace('qbhand1_synergy_joint', 'elbow')))
    assert ros.until(lambda: learnt)
    assert link.blocked == said
    publisher.publish(String(data='<!DOCTYPE robot><robot/>'))
    assert ros.until(lambda: 'no document type' in link.blocked)
    publisher.publish(String(data=URDF))
    assert ros.until(lambda: not link.blocked)
    assert learnt == [['elbow'], ['qbhand1_synergy_joint']]


def test_a_controller_that_never_answers_is_asked_once_at_a_time(ros: Ros) -> None:
    link, _ = wire(ros, 'allegro_v4')
    silent = Node('hangs')  # nobody spins it
    ros.nodes.append(silent)
    name = f'{POSITION_CONTROLLER}/get_parameters'
    silent.create_service(GetParameters, name, lambda _, response: response)
    assert ros.until(link._client.service_is_ready)
    for _ in range(25):
        link._request_order()
    assert len(link._client._pending_requests) == 1
    assert 'has not published the order' in link.blocked


@pytest.mark.parametrize(
    ('phase', 'refusal', 'warning', 'level', 'said'),
    [
        (GripPhase.HOLD, '', '', DiagnosticStatus.OK, 'HOLD, 1 steps a second'),
        (GripPhase.HOLD, '', 'index is stale', DiagnosticStatus.WARN, 'index is stale'),
        (GripPhase.IDLE, 'it was lost', '', DiagnosticStatus.WARN, 'it was lost'),
        (GripPhase.IDLE, NOT_ASKED, '', DiagnosticStatus.OK, 'IDLE, 1 steps a second'),
        (GripPhase.IDLE, NOT_ASKED, 'index is stale', DiagnosticStatus.WARN, 'index is stale'),
        (GripPhase.FAULT, 'it is stale', '', DiagnosticStatus.ERROR, 'it is stale'),
    ],
)
def test_the_worst_is_told(
    phase: GripPhase, refusal: str, warning: str, level: bytes, said: str
) -> None:
    tally, made = GripDiagnostics(), SimpleNamespace(phase=phase, warning=warning)
    tally.note(Decision(made, None, False, refusal, None, ''))  # type: ignore[arg-type]
    status = tally.status('hand', GripConfig(), True, False, [])
    assert (status.level, status.message) == (level, said)
    never = tally.status('hand', GripConfig(), True, False, ['ring'])
    assert 'ring' in never.message or warning


CONTACT_AT = 0.3  # closure
STIFFNESS = 40.0  # N per closure
FRICTION = 0.25  # N, with which the object lies where it is: so far the sides may differ
APART = 0.3
# a fast approach, since what a grasp takes is not what these tests are about; and patience with a
# loaded machine, on which a pause is no fault
QUICK = (
    'stiffness_high:=41.0', 'fault_time:=30.0', 'closing_rate:=1.0', 'stale_after:=0.5',
)  # fmt: skip


class Fingers(Node):
    """Stands in for contact_node of every finger: springs on an object between the sides."""

    def __init__(self, hand: MockHandNode) -> None:
        super().__init__('fingers')
        self.hand, self.sequence, self.frozen = hand, 0, False
        self.states: list[GripState] = []
        self.silent = self.free = False
        self.stamped, self.stamp_ns = False, 0
        described = hand._hand
        names = [(s, f) for f in described.fingers for s in described.fingers[f].sensors]
        self.outputs = [
            (self.create_publisher(TactileContacts, f'{sensor}/contacts', qos()), finger)
            for sensor, finger in names
        ]
        self.described = described
        self.place = 0.0
        self.create_subscription(GripState, 'grip_node/state', self.states.append, 10)
        self.enable = self.create_client(SetBool, 'grip_node/enable')
        self.grasp = ActionClient(self, Grasp, 'grip_node/grasp')
        self.feedback: list[Grasp.Feedback] = []
        self.create_timer(0.01, self.feel)

    def forces(self) -> dict[str, float]:
        """Forces of the springs (N); the stronger side pushes the object to the other."""
        found = self.described.fingers
        joints = self.hand.joints.position
        places = [self.described.places(name) for name in found]
        pads = zip(found.values(), places, strict=True)
        deep = np.array([finger.depth(joints[place], CONTACT_AT) for finger, place in pads])
        sides = np.array([finger.side for finger in found.values()])
        # the fake's joints follow their commands: how far drives give way is in the spring
        own = np.array([f.stiffness if f.is_soft else np.inf for f in found.values()])
        stiffness = 1.0 / (1.0 / STIFFNESS + 1.0 / own)

        def pressed(place: float) -> np.ndarray:
            return stiffness * np.maximum(deep - sides * place, 0.0)

        for _ in range(40):
            spare = float(sides @ pressed(self.place))
            if self.free or abs(spare) <= FRICTION:
                break
            self.place += np.sign(spare) * (abs(spare) - 0.99 * FRICTION) / stiffness.sum()
        return dict(zip(found, 0.0 * sides if self.free else pressed(self.place), strict=True))

    def force(self, finger: str) -> float:
        """Force of one finger (N)."""
        return float(self.forces()[finger])

    def feel(self) -> None:
        """Publish what the fingers feel."""
        self.sequence += not self.frozen
        forces = self.forces()
        for publisher, finger in () if self.silent else self.outputs:
            message = TactileContacts(valid=True, slip=-1, sequence=self.sequence)
            message.wrench.force.z = float(forces[finger])
            if self.stamped:
                self.stamp_ns = self.get_clock().now().nanoseconds
                fill_header(message.header, self.stamp_ns, '')
            publisher.publish(message)

    def send(self, force: float, **goal: object) -> object:
        """Future of a goal's handle."""
        wanted = Grasp.Goal(target_force=force, **goal)
        return self.grasp.send_goal_async(wanted, lambda m: self.feedback.append(m.feedback))

    def ask(self, ros: Ros, force: float, **goal: object) -> object:
        """Send a goal; its handle."""
        assert ros.until(self.grasp.server_is_ready)
        return ros.result(self.send(force, **goal))

    def begin(self, ros: Ros, force: float, **goal: object) -> object:
        """Handle of a goal that is taken."""
        assert ros.until(self.grasp.server_is_ready)
        return ros.begin(lambda: self.send(force, **goal))

    def hold(self, ros: Ros) -> None:
        """Until a grasp of 2 N is held; a pause of the machine may end one as a fault."""
        for _ in range(3):
            ended = result(ros, self.begin(ros, 2.0))[1]
            if ended.outcome == Grasp.Result.HELD:
                return
        raise AssertionError(ended)

    def timely(self, since: int = 0) -> list[GripState]:
        """States but for those of a machine that paused for longer than forces may age."""
        return [state for state in self.states[since:] if 'stale' not in state.refusal]


def result(ros: Ros, handle: object) -> tuple[int, Grasp.Result]:
    """How a grasp ended."""
    future = handle.get_result_async()
    assert ros.until(future.done)
    return future.result().status, future.result().result


def graph(ros: Ros, hand: str, *parameters: str) -> tuple[GripNode, MockHandNode, Fingers]:
    """All three nodes, connected."""
    ros.init(f'hand:={hand}', *QUICK, *parameters)
    mock = ros.add(MockHandNode())
    grip = ros.add(GripNode())
    lifecycle.start([mock, grip])
    fingers = ros.add(Fingers(mock))
    assert ros.until(lambda: fingers.states and not (grip.missing or grip._link.refusal))
    return grip, mock, fingers


def commands(mock: MockHandNode) -> int:
    return max(mock.received.values())


@pytest.mark.parametrize('hand', ['allegro_plexus', 'qb_softhand'])
def test_a_grasp_holds_with_feedback_and_opens_again(ros: Ros, hand: str) -> None:
    thumb_last = ', '.join(THUMB_FIRST[4:] + THUMB_FIRST[:4])  # as its controller may have it
    order = [f'order:=[{thumb_last}]'] if hand == 'allegro_plexus' else []
    _, mock, fingers = graph(ros, hand, *order)
    status, ended = result(ros, fingers.begin(ros, 2.0))
    assert (status, ended.outcome) == (GoalStatus.STATUS_SUCCEEDED, Grasp.Result.HELD), ended
    assert max(ended.force) == pytest.approx(2.0, rel=APART)
    phases = [state.phase for state in fingers.timely() if state.phase]
    assert phases == sorted(phases), {state.refusal for state in fingers.states}
    assert {GripPhase.CLOSE, GripPhase.HOLD} <= {*phases}
    assert {f.phase for f in fingers.feedback} <= {state.phase for state in fingers.states}
    assert fingers.feedback
    limits = mock._driver.limits
    sent = np.array([state.command for state in fingers.states if state.refusal == ''])
    assert (sent >= limits.lower).all()
    assert (sent <= limits.upper).all()
    status, ended = result(ros, fingers.begin(ros, 0.0))
    assert status == GoalStatus.STATUS_SUCCEEDED
    assert ended.message == 'the hand is open'
    assert mock.refused == 0
    if hand == 'allegro_plexus':
        assert 0 < mock.caps[4] < 0.345


def test_nothing_is_sent_before_a_grasp_while_disabled_or_inactive(
    ros: Ros, capfd: pytest.CaptureFixture[str]
) -> None:
    grip, mock, fingers = graph(ros, 'qb_softhand', 'enabled:=false')
    assert not fingers.ask(ros, 2.0).accepted
    assert 'grasp refused: the grip is disabled' in capfd.readouterr().err
    assert ros.until(lambda: fingers.states[-1].refusal == 'not active')
    assert ros.call(fingers.enable, SetBool.Request(data=True)).success
    assert ros.until(lambda: fingers.states[-1].refusal == 'no grasp was asked for')
    assert not fingers.ask(ros, 1.0, fingers=['nose']).accepted
    assert "received 'nose'" in capfd.readouterr().err
    assert commands(mock) == 0
    handle = fingers.begin(ros, 2.0)
    assert ros.until(lambda: commands(mock) > 3)
    assert ros.call(fingers.enable, SetBool.Request(data=False)).message.startswith('disabled')
    status, ended = result(ros, handle)
    assert (status, ended.message) == (GoalStatus.STATUS_ABORTED, 'the grip was disabled')
    before = silent_for(ros, mock, fingers)
    assert commands(mock) == before
    grip.trigger_deactivate()
    assert not fingers.ask(ros, 2.0).accepted
    assert not ros.call(fingers.enable, SetBool.Request(data=True)).success
    assert commands(mock) == before


def silent_for(ros: Ros, mock: MockHandNode, fingers: Fingers) -> int:
    """Commands that came in, once those under way have arrived and ten states have passed."""
    count = len(fingers.states)
    assert ros.until(lambda: len(fingers.states) > count + 2)
    before = commands(mock)
    assert ros.until(lambda: len(fingers.states) > count + 12)
    return before


def test_a_newer_grasp_takes_the_place_of_the_first_and_a_cancelled_one_holds(ros: Ros) -> None:
    _, mock, fingers = graph(ros, 'allegro_v5')
    forces = [0.5, 0.5, 1.0, 2.0]
    first, second = fingers.begin(ros, 3.0), fingers.begin(ros, 0.0, forces=forces)
    status, ended = result(ros, first)
    assert status == GoalStatus.STATUS_ABORTED
    assert ended.message == 'a newer grasp took its place'
    status, ended = result(ros, second)
    assert (status, ended.outcome) == (GoalStatus.STATUS_SUCCEEDED, Grasp.Result.HELD)
    np.testing.assert_allclose(fingers.states[-1].target_force, forces)
    handle = fingers.begin(ros, 2.0)
    ros.result(handle.cancel_goal_async())
    assert result(ros, handle)[0] == GoalStatus.STATUS_CANCELED
    before = commands(mock)
    assert ros.until(lambda: commands(mock) > before + 10)
    assert ros.until(lambda: fingers.states[-1].phase == GripPhase.HOLD)


def test_forces_that_repeat_themselves_hold_what_is_held_and_its_loss_is_published(
    ros: Ros, capfd: pytest.CaptureFixture[str]
) -> None:
    # at rest: until an input counts as stale the law goes on with the error of the last
    grip, mock, fingers = graph(ros, 'allegro_v5')
    fingers.hold(ros)
    fingers.frozen = True
    assert ros.until(lambda: fingers.states[-1].phase == GripPhase.FAULT)
    before = silent_for(ros, mock, fingers)
    assert commands(mock) == before
    assert fingers.states[-1].refusal
    held = fingers.force('index')
    assert 0.2 < held < 1.5
    silent_for(ros, mock, fingers)
    assert fingers.force('index') == pytest.approx(held, rel=0.01)
    fingers.frozen = False
    assert ros.until(lambda: fingers.states[-1].phase == GripPhase.HOLD)
    fingers.free = True
    wanted = 'the object was lost; a new grasp is needed'
    assert ros.until(lambda: fingers.states[-1].refusal == wanted)
    assert 'the object was lost' in capfd.readouterr().err
    assert grip.diagnose().message == wanted


@pytest.mark.parametrize('stamped', [True, False])
def test_nothing_is_commanded_once_forces_are_a_tenth_of_a_second_old(
    ros: Ros, stamped: bool
) -> None:
    """On the machine's own clock, by stamps and by arrival; however busy the machine is."""
    grip, mock, fingers = graph(ros, 'allegro_v5', 'stale_after:=0.1')
    fingers.stamped = stamped
    fingers.begin(ros, 2.0)
    assert ros.until(lambda: fingers.states[-1].phase in (GripPhase.LOAD, GripPhase.HOLD))
    fingers.silent, last = True, fingers.sequence
    # by arrival what is still under way counts from when it arrives
    assert ros.until(lambda: set(grip._sequences.values()) == {last})
    silent_ns = fingers.stamp_ns or fingers.get_clock().now().nanoseconds
    assert ros.until(lambda: fingers.states[-1].phase == GripPhase.FAULT)
    silent_for(ros, mock, fingers)
    slack_ns = 2_000_000
    late = [s for s in fingers.states if stamp_ns(s.header) - silent_ns > 100_000_000 + slack_ns]
    assert late
    assert {state.phase for state in late} == {GripPhase.FAULT}
    found = re.fullmatch(r'\w+ is stale \((.*) s\)', late[-1].refusal)
    assert float(found[1]) > 0.1
    before = commands(mock)
    silent_for(ros, mock, fingers)
    assert commands(mock) == before


def test_a_tare_while_holding_is_named_and_a_latched_one_is_not(ros: Ros) -> None:
    grip, _, fingers = graph(ros, 'allegro_v5')
    baseline = fingers.create_publisher(TactileFrame, 'index/baseline', qos('baseline'))
    early = TactileFrame(valid=True)
    fill_header(early.header, fingers.get_clock().now().nanoseconds, '')
    assert ros.until(baseline.get_subscription_count)
    fingers.hold(ros)
    baseline.publish(early)
    count = len(fingers.states)
    assert ros.until(lambda: len(fingers.timely(count)) > 10)
    assert {state.phase for state in fingers.timely(count)} == {GripPhase.HOLD}
    fill_header(early.header, fingers.get_clock().now().nanoseconds, '')
    baseline.publish(early)
    said = 'index was tared while it holds: its sensor cannot be trusted'
    assert ros.until(lambda: fingers.states[-1].refusal == said)
    assert grip.diagnose().level == DiagnosticStatus.ERROR
    assert fingers.force('index') > 0.2


def test_a_driver_whose_clock_steps_back_is_named(ros: Ros) -> None:
    grip, _, fingers = graph(ros, 'allegro_v5', 'stale_after:=0.3')
    fingers.begin(ros, 2.0)
    fingers.stamped = True
    assert ros.until(lambda: fingers.states[-1].phase == GripPhase.HOLD)
    behind = grip._on_joints

    def late(position: np.ndarray, effort: np.ndarray | None, stamp_ns: int) -> None:
        behind(position, effort, stamp_ns - 500_000_000)

    grip._link._take = late
    said = re.compile(
        r'joint states are stale \(0\.\d+ s\).*: the clock stepped back of the joint states by 0\.'
    )
    assert ros.until(lambda: said.match(fingers.states[-1].refusal)), fingers.states[-1].refusal


def test_limits_of_a_description_bound_every_command(ros: Ros) -> None:
    ros.init('hand:=qb_softhand', 'wait_for_robot_description:=true', *QUICK)
    mock, grip = ros.add(MockHandNode()), ros.add(GripNode())
    lifecycle.start([mock, grip])
    fingers = ros.add(Fingers(mock))
    fingers.free = True
    assert ros.until(lambda: fingers.states)
    assert fingers.states[-1].refusal == 'robot_description has not come'
    early = fingers.begin(ros, 2.0)
    fingers.create_publisher(String, 'robot_description', qos('layout')).publish(String(data=URDF))
    assert ros.until(lambda: fingers.states[-1].refusal == 'no grasp was asked for')
    assert result(ros, early)[1].message == 'the grip began anew with its robot_description'
    assert ros.until(lambda: not grip.missing)
    assert result(ros, fingers.begin(ros, 2.0))[1].outcome == Grasp.Result.NO_OBJECT
    sent = np.array([state.command for state in fingers.states if state.refusal == ''])
    assert sent.max() == 0.35


def test_a_description_that_comes_later_bounds_the_next_grasp_without_being_asked_for(
    ros: Ros,
) -> None:
    grip, _, fingers = graph(ros, 'qb_softhand')
    fingers.hold(ros)
    fingers.create_publisher(String, 'robot_description', qos('layout')).publish(String(data=URDF))
    assert ros.until(lambda: grip._next is not None)
    count = len(fingers.states)
    assert ros.until(lambda: len(fingers.timely(count)) > 10)
    assert {state.phase for state in fingers.timely(count)} == {GripPhase.HOLD}
    assert result(ros, fingers.begin(ros, 0.0))[1].message == 'the hand is open'
    assert ros.until(lambda: grip._next is None and not grip.missing)
    fingers.free, count = True, len(fingers.states)
    assert result(ros, fingers.begin(ros, 2.0))[1].outcome == Grasp.Result.NO_OBJECT
    assert np.nanmax([state.command[0] for state in fingers.states[count:]]) == 0.35


def test_points_of_a_trajectory_lie_two_periods_ahead(
    ros: Ros, capfd: pytest.CaptureFixture[str]
) -> None:
    _, mock, fingers = graph(ros, 'joint_trajectory', 'rate_hz:=25.0')
    assert 'at 25 Hz a point of the trajectory lies two periods' in capfd.readouterr().err
    sent: list[JointTrajectory] = []
    topic = mock._driver.topics[0].name
    fingers.create_subscription(JointTrajectory, topic, sent.append, 10)
    fingers.begin(ros, 2.0)
    assert ros.until(lambda: len(sent) > 3)
    (point,) = sent[-1].points
    assert (point.time_from_start.sec, point.time_from_start.nanosec) == (0, 80_000_000)


def opposed(apart: float) -> str:
    """All joints of a V5, those of the thumb so far from the others (m)."""
    joints = (
        f'<joint name="joint_{i}_0" type="revolute"><parent link="{i - 1 if i % 4 else "palm"}"/>'
        f'<child link="{i}"/><origin xyz="0 {apart if i == 12 else 0.0} 0"/></joint>'
        for i in range(16)
    )
    return f'<robot name="v5">{"".join(joints)}</robot>'


def test_a_left_hand_is_refused_by_its_description_on_the_topic_of_its_driver(
    ros: Ros, capfd: pytest.CaptureFixture[str]
) -> None:
    grip, _, fingers = graph(ros, 'allegro_v5_sense', 'number:=2')
    description = fingers.create_publisher(
        String, '/allegroHand_2/allegro_hand_description', qos('robot_description')
    )
    description.publish(String(data=opposed(0.25)))
    said = 'thumb and fingers of robot_description are 250 mm apart where allegro_v5_sense has'
    assert ros.until(lambda: grip._link.blocked.startswith(said))
    assert not fingers.ask(ros, 1.0).accepted
    assert f'grasp refused: {said}' in capfd.readouterr().err
    description.publish(String(data=opposed(0.05)))
    assert ros.until(lambda: not grip._link.blocked)
    fingers.begin(ros, 1.0)


def test_a_goal_that_no_driver_would_hear_of_is_refused_with_what_to_type(
    ros: Ros, capfd: pytest.CaptureFixture[str]
) -> None:
    grip, mock, fingers = graph(ros, 'allegro_plexus')
    said = (
        f'{EFFORT_CONTROLLER} is inactive: ros2 control switch_controllers --activate '
        f'{EFFORT_CONTROLLER[1:]} --deactivate {POSITION_CONTROLLER[1:]}'
    )
    told = fingers.create_publisher(DiagnosticArray, '/diagnostics', 10)
    assert ros.until(lambda: told.get_subscription_count() > 0)
    for state in ('inactive', 'active'):
        pairs = [KeyValue(key=EFFORT_CONTROLLER[1:], value=state)]
        told.publish(DiagnosticArray(status=[DiagnosticStatus(values=pairs)]))
        assert ros.until(lambda wanted=state: grip._link._activity == wanted)
        assert grip._link.refusal == ('' if state == 'active' else said)
        assert fingers.ask(ros, 1.0).accepted == (state == 'active')
    assert f'grasp refused: {said}' in capfd.readouterr().err
    mock.trigger_deactivate()
    mock.trigger_cleanup()
    assert ros.until(lambda: 'nothing listens to' in grip._link.refusal)
    assert not fingers.ask(ros, 1.0).accepted


def test_control_keeps_the_newest_and_the_recorder_all(ros: Ros, tmp_path: Path) -> None:
    # by the nodes' own profiles: DDS names no depth in what it discovers
    ros.init('hand:=qb_softhand', f'bag:={tmp_path / "bag"}')
    nodes = [ros.add(kind()) for kind in (GripNode, MockHandNode, RecordNode)]
    lifecycle.start(nodes)
    control, board, recorder = (
        {end.topic_name: end.qos_profile.depth for end in node.subscriptions} for node in nodes
    )
    (command,) = (topic for topic in board if topic.endswith('joint_trajectory'))
    fingers = {f'/{finger}/{topic}' for finger in FINGERS for topic in ('contacts', 'baseline')}
    assert control.keys() == {*fingers, '/qbhand1/joint_states', '/robot_description'}
    assert {control[topic] for topic in fingers} == {1}
    assert 1 <= max(control.values()) <= 5
    assert 1 <= board[command] <= 5
    sent = {end.topic_name: end.qos_profile.depth for end in nodes[0].publishers}
    assert 1 <= sent[command] <= 5
    assert {recorder[topic] for topic in ('/frame', '/contacts')} == {1000}


def test_it_can_be_deactivated_and_activated_again(ros: Ros) -> None:
    grip, mock, fingers = graph(ros, 'qb_softhand')
    handle = fingers.begin(ros, 2.0)
    assert ros.until(lambda: commands(mock) > 3)
    assert grip.trigger_deactivate() == lifecycle.SUCCESS
    assert result(ros, handle)[1].message == 'grip_node was deactivated'
    assert ros.until(lambda: not mock.count_publishers(mock._driver.topics[0].name))
    assert grip.trigger_activate() == lifecycle.SUCCESS
    fingers.hold(ros)
    told = {pair.key: pair.value for pair in grip.diagnose().values}
    assert told['phase'] == 'HOLD'
    assert int(told['commands']) > 3


def handle(number: int) -> SimpleNamespace:
    """A goal as rclpy hands it over."""
    heard, executed = [], []
    return SimpleNamespace(
        request=Grasp.Goal(target_force=2.0), goal_id=SimpleNamespace(uuid=bytes([number])),
        is_cancel_requested=False, feedback=heard, publish_feedback=heard.append,
        executed=executed, execute=lambda: executed.append(number),
    )  # fmt: skip


def decision(force: float, ended: GraspProgress | None = None) -> SimpleNamespace:
    made = SimpleNamespace(
        phase=GripPhase.CLOSE, force=np.array([force]), slip_margin=np.array([math.nan, 0.5])
    )
    return SimpleNamespace(made=made, ended=ended)


def test_feedback_comes_at_once_then_by_its_period_and_the_end_once(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    clock = SimpleNamespace(now_s=100.0)
    clock.monotonic = lambda: clock.now_s
    monkeypatch.setattr(grip_node, 'time', clock)
    monkeypatch.setattr(grip_node, 'ActionServer', lambda *_, **__: None)
    server = GraspServer(SimpleNamespace(), lambda _: '', lambda _: None, lambda: None)
    first, second = handle(1), handle(2)
    server._on_accepted(first)
    fed = []
    for step in range(100):
        before = len(first.feedback)
        server.note(decision(float(step)))
        server.publish_progress()
        if len(first.feedback) > before:
            fed.append(clock.now_s)
            assert first.feedback[-1].force[0] == step  # the newest
        clock.now_s += 1e-3
    assert fed[0] == 100.0
    assert np.diff(fed) == pytest.approx(FEEDBACK_S, abs=1.5e-3)
    assert first.feedback[0].slip_margin == 0.5
    # a new goal hears at once, and an end waits for no period
    server._on_accepted(second)
    server.note(decision(1.0))
    server.publish_progress()
    assert (first.executed, len(second.feedback)) == ([1], 1)
    server.note(decision(2.0, GraspProgress(GraspOutcome.HELD, 'held')))
    server.note(decision(2.1))  # steps go on before the executor has its turn
    server.publish_progress()
    server.publish_progress()
    assert (second.executed, server.is_busy) == ([2], False)
    ending, ended = server._ends[b'\x02']
    assert (ending, ended.outcome, list(ended.force)) == ('succeed', Grasp.Result.HELD, [2.0])
    assert len(second.feedback) == 1
