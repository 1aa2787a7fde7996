# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""grip_node: contacts of the fingers to commands of a hand; serves grasps."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from math import inf, isfinite, nan
from typing import NamedTuple

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rcl_interfaces.srv import GetParameters
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, String
from std_srvs.srv import SetBool
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from tactile_ros import messages
from tactile_ros.action import Grasp
from tactile_ros.control import GraspOutcome, GripConfig, GripPhase
from tactile_ros.control.grip_force import NOT_ASKED
from tactile_ros.hands import HandDescription, drivers, load_hand
from tactile_ros.hands.description import narrowed
from tactile_ros.hands.drivers import JOINT_STATE, NUMBERS, TRAJECTORY, Topic
from tactile_ros.hands.kinematics import RobotDescription
from tactile_ros.messages import packed, stamp_ns, vector
from tactile_ros.msg import GripState, TactileContacts, TactileFrame
from tactile_ros.nodes.grip_loop import LATE, Decision, GripLoop, StampAge, StepTrigger, along
from tactile_ros.nodes.lifecycle import ManagedNode, diagnostic, qos
from tactile_ros.nodes.parameters import GripOptions
from tactile_ros.types import Array, ContactState, Frame, FrameStatus, GripCommand, Integers

ASK_PERIOD_S, PATIENCE = 0.5, 10  # periods in which a controller may answer
STALE = int(FrameStatus.STALE)
LAGS = (
    'at {:g} Hz a point of the trajectory lies two periods ahead, which is more than horizon_s: '
    'joints lag by 1.44 periods more, add them to the parameter lag'
)
WATCH_S = 1e-2  # how often the clock is looked at, at most
TINY = 1e-9  # N
SILENT_S = 1.0  # an input that diagnostics name
STATES = 5  # joint states that may wait
LAST_TURNS = 5
FEEDBACK_S = 0.02  # the least between two
MESSAGES = {JOINT_STATE: JointState, NUMBERS: Float64MultiArray, TRAJECTORY: JointTrajectory}


def sensed() -> QoSProfile:
    """Joint states of whatever driver: also of one that publishes as sensors do."""
    profile = qos(depth=STATES)
    profile.reliability = ReliabilityPolicy.BEST_EFFORT
    return profile


def blank(kind: str) -> object:
    """A fresh message of a command; a trajectory has the one point that is filled."""
    if kind == TRAJECTORY:
        return JointTrajectory(points=[JointTrajectoryPoint()])
    return MESSAGES[kind]()


class Touch(NamedTuple):
    """Contacts of a finger in one frame, in its sensor frame.

    `normal` (3,) is that of the contact, NaN where none is measured, None where nothing is
    touched; `covariance` (9,) that of the force (N^2).
    """

    force: Sequence[float]
    valid: bool
    slip: int
    normal: Sequence[float] | None
    covariance: Sequence[float]


def normal_of(contacts: Sequence[tuple[Sequence[float], Sequence[float]]]) -> list[float] | None:
    """Mean normal (3,) out of the skin of contacts, weighed by force; None: there is none."""
    if not contacts:
        return None
    total = [0.0, 0.0, 0.0]
    for normal, force in contacts:
        weight = abs(along(force, normal)) + TINY
        weight = -weight if normal[2] < 0.0 else weight
        total = [one + weight * part for one, part in zip(total, normal, strict=True)]
    return total


class HandLink:
    """Publishers and subscriptions of one hand while grip_node is active.

    `take` gets every measured posture (j,), its efforts if any, and its stamp (ns). `learn` gets
    the `robot_description` where one comes, and says whether it is of this hand; after a
    ValueError nothing is sent. With `wait` nothing is sent before it has come.
    """

    def __init__(
        self,
        node: ManagedNode,
        hand: HandDescription,
        take: Callable[[Array, Array | None, int], None],
        learn: Callable[[RobotDescription], bool] | None = None,
        wait: bool = False,
    ) -> None:
        self._driver = driver = hand.driver
        self._node, self._take, self._learn = node, take, learn
        self._held = ExitStack()
        self._order: Integers | slice | None = None
        self._described = learn is None
        self._misfit = ''
        self._why_no_description = f'{driver.description} has not come' if wait else ''
        self._why_no_order = f'{driver.controller} has not published the order of its joints yet'
        # one message for all commands: a fresh one costs as much as the law
        self._publishers: list[tuple[Publisher, Topic, object]] = [
            (node.create_publisher(MESSAGES[t.kind], t.name, qos(depth=3)), t, blank(t.kind))
            for t in driver.topics
        ]
        for publisher, _, _ in self._publishers:
            self._held.callback(node.destroy_publisher, publisher)
        self._listen(JointState, driver.states, self._on_states, sensed())
        if learn is not None:
            latched = qos('robot_description')
            self._listen(String, driver.description, self._on_description, latched)
        self._client = self._timer = self._asked = None
        self._waited, self._activity = 0, ''
        if driver.controller:
            name = f'{driver.controller}/get_parameters'
            self._client = node.create_client(GetParameters, name)
            self._timer = node.steady_timer(ASK_PERIOD_S, self._request_order)
            self._request_order()
            self._listen(DiagnosticArray, '/diagnostics', self._on_activity, 10)
        else:
            self._order = slice(None)

    def _listen(self, kind: type, topic: str, hear: Callable, profile: QoSProfile | int) -> None:
        made = self._node.create_subscription(kind, topic, hear, profile)
        self._held.callback(self._node.destroy_subscription, made)

    @property
    def blocked(self) -> str:
        """Reason for sending nothing yet; empty: there is none."""
        why = self._misfit or self._why_no_description
        return why or (self._why_no_order if self._order is None else '')

    @property
    def refusal(self) -> str:
        """Reason against every grasp: another hand, or none that listens; empty: there is none."""
        driver = self._driver
        if self._misfit or self._activity not in ('', 'active'):
            return self._misfit or f'{driver.controller} is {self._activity}: {driver.remedy}'
        silent = [t.name for out, t, _ in self._publishers if not out.get_subscription_count()]
        return f'nothing listens to {silent[0]}: {driver.remedy}' if silent else ''

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
        self._held.close()
        self._end_requests()

    def _end_requests(self) -> None:
        if self._timer is not None:
            self._node.destroy_timer(self._timer)
            self._node.destroy_client(self._client)
            self._timer = self._client = self._asked = None

    def _on_states(self, message: JointState) -> None:
        """Hand a posture on; what is damaged is reported and counts as silence."""
        try:
            position = drivers.read_joint_states(message, self._driver.joints)
        except ValueError as err:
            self._node.get_logger().error(str(err), throttle_duration_sec=1.0)
            return
        if position is not None:
            effort = drivers.read_efforts(message, self._driver.joints)
            self._take(position, effort, stamp_ns(message.header))

    def _on_description(self, message: String) -> None:
        """Read the hand's description once; one that does not fit lets nothing out."""
        if self._described:
            return
        try:
            self._described = self._learn(RobotDescription(message.data))
        except ValueError as err:
            self._misfit = str(err)
            self._node.get_logger().error(str(err))
        if self._described:
            self._misfit = self._why_no_description = ''

    def _on_activity(self, message: DiagnosticArray) -> None:
        name = self._driver.controller.rsplit('/', 1)[-1]
        for pair in (pair for status in message.status for pair in status.values):
            if pair.key.removesuffix('.state') == name:
                self._activity = pair.value

    def _request_order(self) -> None:
        if self._client is None or not self._client.service_is_ready():
            return
        if self._asked is not None:  # a controller that hangs is asked once at a time
            self._waited += 1
            if self._waited < PATIENCE:
                return
            self._client.remove_pending_request(self._asked)
        self._waited = 0
        self._asked = self._client.call_async(GetParameters.Request(names=['joints']))
        self._asked.add_done_callback(self._on_order)

    def _on_order(self, future: object) -> None:
        """Take the order, or say why it cannot be."""
        if future is not self._asked or self._client is None:
            return
        answer, self._asked = future.result(), None
        if answer is None or not answer.values:
            return
        names = tuple(answer.values[0].string_array_value)
        joints = self._driver.joints
        if len(names) != len(joints) or set(names) != set(joints):
            self._why_no_order = (
                f'the parameter joints of {self._driver.controller} must name the {len(joints)} '
                f'joints of this hand; received {", ".join(names)[:120] or "nothing"}'
            )
            self._node.get_logger().error(self._why_no_order, throttle_duration_sec=1.0)
            return
        self._order = drivers.in_order(joints, names)
        self._end_requests()


class GripDiagnostics:
    """Steps and commands counted since the grip is active, and the last step."""

    def __init__(self) -> None:
        self.steps = self.commands = self.limited = 0
        self._steps_before = 0
        self._refusal, self._phase, self._warning = '', GripPhase.IDLE, ''

    def note(self, decision: Decision) -> None:
        """Take in a step."""
        self.steps += 1
        self.commands += decision.command is not None
        self.limited += decision.limited
        self._refusal, self._phase = decision.refusal, decision.made.phase
        self._warning = decision.made.warning

    def status(
        self, hand: str, config: GripConfig, enabled: bool, busy: bool, missing: Sequence[str]
    ) -> DiagnosticStatus:
        """Phase, rate, refusals, once a second; the sentence says what is worst."""
        steps, self._steps_before = self.steps - self._steps_before, self.steps
        level, sentence = DiagnosticStatus.OK, f'{self._phase.name}, {steps} steps a second'
        if self._refusal and self._refusal != NOT_ASKED:
            level = DiagnosticStatus.WARN if enabled else DiagnosticStatus.OK
            sentence = self._refusal
        if missing:
            level, sentence = DiagnosticStatus.WARN, f'nothing came of {", ".join(missing)}'
        if self._warning:
            level, sentence = DiagnosticStatus.WARN, self._warning
        if self._phase == GripPhase.FAULT:
            level = DiagnosticStatus.ERROR
        values = {
            'phase': self._phase.name,
            'enabled': enabled,
            'steps': self.steps,
            'commands': self.commands,
            'limited': self.limited,
            'rate (Hz)': steps,
            'nominal rate (Hz)': config.rate_hz,
            'grasp under way': busy,
            'refusal': self._refusal or 'none',
            'warning': self._warning or 'none',
            'silent': ', '.join(missing) or 'none',
        }
        return diagnostic('grip', sentence, values, level, hand)


class GraspServer:
    """Serve grasps; all but `note` runs in the thread of the executor.

    `refuse` says why a goal cannot be (empty: it can); `begin` takes an accepted goal, which a
    ValueError ends at once; `cancel` is called when the client cancels.
    """

    def __init__(
        self,
        node: Node,
        refuse: Callable[[Grasp.Goal], str],
        begin: Callable[[Grasp.Goal], None],
        cancel: Callable[[], None],
    ) -> None:
        self._node = node
        self._refuse, self._begin, self._cancel = refuse, begin, cancel
        self._handle: ServerGoalHandle | None = None
        self._ends: dict[bytes, tuple[str, Grasp.Result]] = {}
        self._force: list[float] = []
        self._newest: Decision | None = None
        self._last: Decision | None = None
        self._fed_s = -inf
        self._server = ActionServer(
            node, Grasp, '~/grasp',
            execute_callback=self._execute,
            goal_callback=self._on_goal,
            handle_accepted_callback=self._on_accepted,
            cancel_callback=lambda _: CancelResponse.ACCEPT,
        )  # fmt: skip

    @property
    def is_busy(self) -> bool:
        """A grasp is under way."""
        return self._handle is not None

    def close(self) -> None:
        """End a grasp that is under way, then the action."""
        self.finish(GraspOutcome.FAULT, 'grip_node ended')
        executor = self._node.executor
        for _ in range(LAST_TURNS if executor is not None else 0):
            if self._ends:  # a client still waits for its result
                executor.spin_once(timeout_sec=0.0)
        self._server.destroy()

    def _on_goal(self, goal: Grasp.Goal) -> GoalResponse:
        reason = self._refuse(goal)
        if reason:
            self._node.get_logger().error(f'grasp refused: {reason}')
        return GoalResponse.REJECT if reason else GoalResponse.ACCEPT

    def _on_accepted(self, handle: ServerGoalHandle) -> None:
        """Take the place of the grasp before."""
        self.finish(GraspOutcome.FAULT, 'a newer grasp took its place')
        self._handle = handle
        self._force, self._fed_s = [], -inf
        try:
            self._begin(handle.request)
        except ValueError as err:
            self.finish(GraspOutcome.FAULT, str(err))

    def _execute(self, handle: ServerGoalHandle) -> Grasp.Result:
        state, result = self._ends.pop(bytes(handle.goal_id.uuid))
        getattr(handle, state)()
        return result

    def forget(self) -> None:
        """Drop decisions, which belong to the grasp before."""
        self._newest = self._last = None

    def note(self, decision: Decision) -> None:
        """Keep what a step decided, from whatever thread; the end of a grasp stays."""
        self._newest = decision
        if decision.ended is not None:
            self._last = decision

    def publish_progress(self) -> None:
        """Tell the client how it goes, and the end."""
        decision, self._newest = self._last or self._newest, None
        now_s = time.monotonic()
        if self._handle is None or decision is None:
            return
        made = decision.made
        self._force = made.force.tolist()
        if decision.ended is not None:
            self.finish(decision.ended.outcome, decision.ended.message)
        elif self._handle.is_cancel_requested:
            self._cancel()
            self.finish(GraspOutcome.FAULT, 'cancelled', 'canceled')
        elif now_s - self._fed_s >= FEEDBACK_S:
            self._fed_s = now_s
            margins = [x for x in made.slip_margin.tolist() if isfinite(x)]
            feedback = Grasp.Feedback(phase=int(made.phase), force=self._force)
            feedback.slip_margin = min(margins, default=nan)
            self._handle.publish_feedback(feedback)

    def finish(self, outcome: GraspOutcome, message: str, state: str = '') -> None:
        """End the grasp that is under way, if there is one."""
        handle, self._handle = self._handle, None
        if handle is None:
            return
        closes = handle.request.target_force or handle.request.forces
        wanted = GraspOutcome.HELD if closes else GraspOutcome.NO_OBJECT
        ending = state or ('succeed' if outcome == wanted else 'abort')
        result = Grasp.Result(outcome=int(outcome), message=message, force=self._force)
        self._ends[bytes(handle.goal_id.uuid)] = ending, result
        # only now: executors ask a coroutine that waits again and again, at the price of a core
        handle.execute()


class GripNode(ManagedNode):
    """Publish the hand's command and `~/state`; serve `~/grasp` and `~/enable`.

    `direct` holds the topics, by their full names, whose contacts come by `take_states` from the
    same process.
    """

    def __init__(self) -> None:
        super().__init__('grip_node')
        self._grasps = GraspServer(self, self._why_not, self._begin, self._cancel)
        self.direct: set[str] = set()
        self._link: HandLink | None = None
        self._loop: GripLoop | None = None
        self._next: GripLoop | None = None
        self.declare(GripOptions())
        self._hand = load_hand(self.get_parameter('hand').value)
        self.declare(self._hand.driver, self._hand.grip())
        self._states = self.managed_publisher(GripState, '~/state', 10)
        self.create_service(SetBool, '~/enable', self._on_enable)
        self._options = GripOptions()
        self._config = GripConfig()
        self._described: HandDescription = self._hand
        self._enabled = False
        # Contacts of the same process come in the threads that read the sensors.
        self._lock = threading.RLock()

    def configure(self) -> None:
        """Check the parameters against each other and the hand."""
        self._options = self.options(GripOptions)
        self._config = self.options(GripConfig)
        described = self._hand.driven_by(self.options(type(self._hand.driver)))
        self._described = described.paced(self._config.rate_hz)
        if self._described.driver != described.driver:
            self.get_logger().warning(LAGS.format(self._config.rate_hz))
        GripLoop(self._described, self._config, self._options.fingers)

    def activate(self) -> None:
        """Listen to the fingers and the hand, and begin to step."""
        self._enabled = self._options.enabled
        self._diagnosed = GripDiagnostics()
        self._sequences: dict[str, int] = {}
        self._ages: dict[str, StampAge] = {}
        self._joint_age = StampAge()
        self._next = GripLoop(self._described, self._config, self._options.fingers)
        self._loop = None
        self._renew()
        wait = self._options.wait_for_robot_description
        learn = self._on_robot if wait or self._options.use_robot_description else None
        self._link = HandLink(self, self._described, self._on_joints, learn, wait)
        names = self._loop.fingers
        period = 1.0 / self._config.rate_hz
        self._trigger = StepTrigger(period, LATE * self._config.slowest_period, len(names))
        topics = [self.topic_of(name) for name in names]
        self._fingers = {t: [i for i, one in enumerate(topics) if one == t] for t in topics}
        for topic in self._fingers.keys() - self.direct:
            self.subscribe(TactileContacts, topic, partial(self._on_contacts, topic), 1)
        for topic in self._fingers:
            baseline = f'{topic.removesuffix("contacts")}baseline'
            self.subscribe(TactileFrame, baseline, partial(self._on_tare, topic), 1)
        self.steady_timer(max(0.5 * period, WATCH_S), self._on_tick)

    def topic_of(self, finger: str) -> str:
        """Full name of the topic of a finger's contacts, after remapping."""
        return self.resolve_topic_name(f'{finger}/contacts')

    def _on_robot(self, robot: RobotDescription) -> bool:
        """Take limits and pads from a description of this hand; ValueError where it misfits."""
        driver = self._described.driver
        if not any(name in robot.joints for name in driver.joints):
            self.get_logger().warning('robot_description names no joint of the hand: not used')
            return False
        limits = robot.limits(driver.joints, driver.limits)
        limits = narrowed(limits, driver.limits, self._hand.driver.limits)
        hand = self._described.with_limits(limits)
        robot.refuse_misfit(hand.name, hand.fingers)
        self._next = GripLoop(hand, self._config, self._options.fingers, robot)
        self._renew()
        return True

    def _renew(self) -> None:
        """Take what a description said once nothing is gripped: limits change under no grip."""
        with self._lock:
            if self._next is None or not (self._loop is None or self._loop.is_free):
                return
            self._loop, self._next = self._next, None
            if self._enabled:
                self._loop.enable()
        self._grasps.publish_progress()  # how it ended, where that is not reported yet
        self._grasps.finish(GraspOutcome.FAULT, 'the grip began anew with its robot_description')

    def deactivate(self) -> None:
        """Send nothing more: the last command is a posture, which holds."""
        with self._lock:
            self._link.close()
            self._link, self._enabled = None, False
        self._grasps.finish(GraspOutcome.FAULT, 'grip_node was deactivated')

    def cleanup(self) -> None:
        """Forget the hand's state."""
        self._loop = None

    def destroy_node(self) -> None:
        """End the action before the node."""
        self._grasps.close()
        super().destroy_node()

    @property
    def missing(self) -> list[str]:
        """Inputs of which nothing came in the last second."""
        return [] if self._loop is None else self._loop.missing(time.monotonic() - SILENT_S)

    def _on_contacts(self, topic: str, message: TactileContacts) -> None:
        touch = Touch(
            vector(message.wrench.force),
            bool(message.valid and not message.status & STALE),
            message.slip,
            normal_of([(vector(c.normal), vector(c.force)) for c in message.contacts]),
            [message.wrench_covariance[6 * i + j] for i in range(3) for j in range(3)],
        )
        self._take(topic, touch, message.sequence, messages.stamp_ns(message.header))

    def _on_tare(self, topic: str, baseline: TactileFrame) -> None:
        """Take in a new baseline of the sensor of a topic of contacts; older ones do not come."""
        with self._lock:
            for finger in self._fingers.get(topic, ()) if self.is_active else ():
                self._loop.take_tare(finger, stamp_ns(baseline.header))

    def take_states(
        self, topic: str, frames: Sequence[Frame], states: Sequence[ContactState]
    ) -> None:
        """Contacts of the same process, under the full name of their topic.

        Of several that waited the newest is answered; a slip in any of them counts.
        """
        frame, state = frames[-1], states[-1]
        touch = Touch(
            state.force.tolist(),
            bool(state.valid) and not int(state.status) & STALE,
            1 if any(one.slip == 1 for one in states) else int(state.slip),
            normal_of([(one.normal.tolist(), one.force.tolist()) for one in state.contacts]),
            np.ravel(state.force_cov).tolist(),
        )
        self._take(topic, touch, frame.sequence, frame.stamp_ns or 0)

    def _take(self, topic: str, touch: Touch, sequence: int, stamp_ns: int) -> None:
        """Take in a force, and step where it is the last that was waited for."""
        with self._lock:
            # the same frame once more is no news: it grows stale
            if not self.is_active or sequence == self._sequences.get(topic):
                return
            self._sequences[topic] = sequence
            now_s, now_ns = time.monotonic(), self.now_ns()
            age = self._ages.get(topic) or self._ages.setdefault(topic, StampAge())
            measured_s = age.measured_s(stamp_ns, now_ns, now_s)
            fingers = self._fingers.get(topic, ())
            self._loop.take_touch(
                fingers, touch.force, touch.valid, touch.slip, measured_s, touch.normal,
                touch.covariance,
            )  # fmt: skip
            stamp_ns = stamp_ns if age.agrees else None
            if fingers and self._trigger.take(fingers, stamp_ns, now_s):
                self._step(now_s, now_ns)

    def _on_joints(self, position: Array, effort: Array | None, stamp_ns: int) -> None:
        with self._lock:
            if self._loop is not None:
                now_s = time.monotonic()
                measured_s = self._joint_age.measured_s(stamp_ns, self.now_ns(), now_s)
                self._loop.take_joints(position, measured_s, effort)

    def _on_tick(self) -> None:
        """Step where forces fail to, and tell clients how their grasp goes."""
        with self._lock:
            now_s = time.monotonic()
            if self.is_active and self._trigger.is_late(now_s):
                self._step(now_s, self.now_ns())
        self._renew()
        self._grasps.publish_progress()

    def _step(self, now_s: float, now_ns: int) -> None:
        answered_ns = self._trigger.newest_ns or now_ns
        since = self._trigger.step(now_s)
        decision = self._dated(self._loop.step(now_s, answered_ns, self._link.blocked, since))
        if decision.command is not None:
            self._link.send(decision.command)
        self._diagnosed.note(decision)
        if decision.lost:
            self.get_logger().error(decision.lost)
        if decision.made.warning:
            self.get_logger().warning(decision.made.warning, throttle_duration_sec=1.0)
        if self._states.get_subscription_count():
            self._publish(decision, now_ns)
        self._grasps.note(decision)

    def _dated(self, decision: Decision) -> Decision:
        """The same, where an input is stale since its clock stepped back: naming that."""
        ages = {**self._ages, 'the joint states': self._joint_age}
        steps = [f'{who} by {a.back_s:.3f} s' for who, a in ages.items() if a.back_s > 0]
        if not steps or 'stale' not in decision.refusal:
            return decision
        refusal = f'{decision.refusal}: the clock stepped back of {", ".join(steps)}'
        ended = decision.ended
        if ended is not None and ended.outcome == GraspOutcome.FAULT:
            ended = replace(ended, message=refusal)
        return replace(decision, refusal=refusal, ended=ended)

    def _publish(self, decision: Decision, now_ns: int) -> None:
        made = decision.made
        message = GripState(phase=int(made.phase), fingers=self._loop.fingers)
        messages.fill_header(message.header, now_ns, '')
        message.target_force, message.force = packed(made.target_force), packed(made.force)
        message.friction, message.slip_margin = packed(made.friction), packed(made.slip_margin)
        message.command = packed(self._loop.sent)
        message.limited, message.refusal = decision.limited, decision.refusal
        message.input_age = float(made.input_age)
        self._states.publish(message)

    def _on_enable(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        """Let commands out, or no more; the hand keeps its last posture."""
        if not self.is_active:
            response.message = 'grip_node is not active: activate it first'
            return response
        response.success = True
        response.message = 'enabled' if request.data else 'disabled: the last posture holds'
        if request.data != self._enabled:
            with self._lock:
                self._enabled = request.data
                (self._loop.enable if request.data else self._loop.disable)()
            if not request.data:
                self._grasps.finish(GraspOutcome.FAULT, 'the grip was disabled')
        return response

    def _why_not(self, goal: Grasp.Goal) -> str:
        """Reason against a grasp; empty: there is none."""
        if not (self.is_active and self._enabled):
            return 'the grip is disabled' if self.is_active else 'grip_node is not active'
        try:
            self._loop.admit(goal.target_force, goal.fingers, goal.timeout, goal.forces)
        except ValueError as err:
            return str(err)
        return self._link.refusal

    def _begin(self, goal: Grasp.Goal) -> None:
        with self._lock:
            self._grasps.forget()
            beyond = self._loop.grasp(
                goal.target_force, goal.fingers, goal.timeout, goal.adapt, goal.forces
            )
        if beyond:
            self.get_logger().warning(beyond)

    def _cancel(self) -> None:
        with self._lock:
            self._loop.cancel()

    def diagnose(self) -> DiagnosticStatus:
        """Phase, rate, refusals."""
        return self._diagnosed.status(
            self._hand.name, self._config, self._enabled, self._grasps.is_busy, self.missing
        )
