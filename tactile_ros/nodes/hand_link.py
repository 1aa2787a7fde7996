"""The wires to a hand: its command topics, its joint states, its controller's order of joints."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from rcl_interfaces.srv import GetParameters
from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, String
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from tactile_ros.hands.driver import JOINT_STATE, NUMBERS, TRAJECTORY, in_order
from tactile_ros.hands.joint_messages import read_joint_states
from tactile_ros.hands.urdf import RobotDescription
from tactile_ros.messages import stamp_ns
from tactile_ros.nodes.quality import latched
from tactile_ros.types import GripCommand

if TYPE_CHECKING:
    from collections.abc import Callable

    from rclpy.publisher import Publisher

    from tactile_ros.hands import HandDescription
    from tactile_ros.hands.driver import Topic
    from tactile_ros.nodes.lifecycle import ManagedNode
    from tactile_ros.types import Array, Integers

ASK_PERIOD_S = 0.5
STATES = 10  # joint states that may wait
MESSAGES = {JOINT_STATE: JointState, NUMBERS: Float64MultiArray, TRAJECTORY: JointTrajectory}


def newest(depth: int = 1) -> QoSProfile:
    """Commands and states: reliable, and nothing old behind the newest."""
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST, depth=depth, reliability=ReliabilityPolicy.RELIABLE
    )


def sensed() -> QoSProfile:
    """Joint states of whatever driver: also of one that publishes as sensors do."""
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST, depth=STATES, reliability=ReliabilityPolicy.BEST_EFFORT
    )


def blank(kind: str) -> object:
    """A fresh message of a command; a trajectory has the one point that is filled."""
    if kind == TRAJECTORY:
        return JointTrajectory(points=[JointTrajectoryPoint()])
    return MESSAGES[kind]()


class HandLink:
    """Publishers and subscriptions of one hand while grip_node is active.

    Parameters
    ----------
    node : ManagedNode
        Whose they are.
    hand : HandDescription
        Which hand.
    take : callable
        Takes every measured posture (j,) and its stamp (ns).
    learn : callable or None
        Takes the `robot_description` where one comes, and says whether it is of this hand; after
        a ValueError nothing is sent.
    wait : bool
        Nothing is sent before the description has come.
    """

    def __init__(
        self,
        node: ManagedNode,
        hand: HandDescription,
        take: Callable[[Array, int], None],
        learn: Callable[[RobotDescription], bool] | None = None,
        wait: bool = False,
    ) -> None:
        self._node, self._hand, self._take = node, hand, take
        self._learn = learn
        self._order: Integers | None = None
        self._described = learn is None
        self._why_no_description = 'robot_description has not come' if wait else ''
        self._why_no_order = f'{hand.driver.controller} does not tell the order of its joints yet'
        driver = hand.driver
        # one message for all commands: a fresh one costs as much as the law
        self._publishers: list[tuple[Publisher, Topic, object]] = [
            (node.create_publisher(MESSAGES[t.kind], t.name, newest(3)), t, blank(t.kind))
            for t in driver.topics
        ]
        self._heard = [
            node.create_subscription(JointState, driver.states, self._on_states, sensed())
        ]
        if learn is not None:
            self._heard.append(
                node.create_subscription(
                    String, 'robot_description', self._on_description, latched()
                )
            )
        self._client = self._timer = self._asked = None
        if driver.controller:
            name = f'{driver.controller}/get_parameters'
            self._client = node.create_client(GetParameters, name)
            self._timer = node.steady_timer(ASK_PERIOD_S, self._ask)
            self._ask()
        else:
            self._order = np.arange(len(driver.joints))

    @property
    def blocked(self) -> str:
        """Why nothing may be sent yet; empty: nothing is in the way."""
        return self._why_no_description or (self._why_no_order if self._order is None else '')

    def send(self, command: GripCommand) -> None:
        """Publish a command in the order of the controller."""
        ordered = GripCommand(
            command.stamp_ns, command.position[self._order], command.effort[self._order]
        )
        for publisher, topic, message in self._publishers:
            topic.fill(message, ordered)
            publisher.publish(message)

    def close(self) -> None:
        """Remove all; nothing can be sent any more."""
        for publisher, _, _ in self._publishers:
            self._node.destroy_publisher(publisher)
        for subscription in self._heard:
            self._node.destroy_subscription(subscription)
        self._end_asking()

    def _end_asking(self) -> None:
        """The order is known, or no longer wanted."""
        if self._timer is not None:
            self._node.destroy_timer(self._timer)
            self._node.destroy_client(self._client)
            self._timer = self._client = self._asked = None

    def _on_states(self, message: JointState) -> None:
        """Hand a posture on; what is damaged is told and counts as silence."""
        try:
            position = read_joint_states(message, self._hand.driver.joints)
        except ValueError as err:
            self._node.get_logger().error(str(err), throttle_duration_sec=1.0)
            return
        if position is not None:
            self._take(position, stamp_ns(message.header))

    def _on_description(self, message: String) -> None:
        """Read the hand's description once; one that does not fit lets nothing out."""
        if self._described:
            return
        try:
            self._described = self._learn(RobotDescription(message.data))
        except ValueError as err:
            self._why_no_description = str(err)
            self._node.get_logger().error(str(err))
        if self._described:
            self._why_no_description = ''

    def _ask(self) -> None:
        """Ask the controller for the order of its joints."""
        if self._client is None or not self._client.service_is_ready():
            return
        if self._asked is not None:  # a controller that hangs is asked once at a time
            self._client.remove_pending_request(self._asked)
        self._asked = self._client.call_async(GetParameters.Request(names=['joints']))
        self._asked.add_done_callback(self._on_order)

    def _on_order(self, future: object) -> None:
        """Take the order, or say why it cannot be."""
        if future is not self._asked or self._client is None:
            return
        answer, self._asked = future.result(), None
        if answer is None or not answer.values:
            return
        told = tuple(answer.values[0].string_array_value)
        joints = self._hand.driver.joints
        if len(told) != len(joints) or set(told) != set(joints):
            self._why_no_order = (
                f'the parameter joints of {self._hand.driver.controller} must name the '
                f'{len(joints)} joints of this hand; received {", ".join(told)[:120] or "nothing"}'
            )
            self._node.get_logger().error(self._why_no_order, throttle_duration_sec=1.0)
            return
        self._order = in_order(joints, told)
        self._end_asking()
