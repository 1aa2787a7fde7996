"""grip_node: contacts of the fingers to commands of a hand; serves grasps."""

from __future__ import annotations

import threading
import time
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

from std_srvs.srv import SetBool

from tactile_ros import messages
from tactile_ros.control import GraspOutcome, GripConfig
from tactile_ros.hands import load_hand
from tactile_ros.hands.description import narrowed
from tactile_ros.messages import packed, vector
from tactile_ros.msg import GripState, TactileContacts
from tactile_ros.nodes.grasp_server import GraspServer
from tactile_ros.nodes.grip_options import GripOptions
from tactile_ros.nodes.grip_pace import LATE, GripPace
from tactile_ros.nodes.grip_stage import GripStage
from tactile_ros.nodes.grip_tally import GripTally
from tactile_ros.nodes.hand_link import HandLink, newest
from tactile_ros.nodes.lifecycle import ManagedNode, main_of, serving
from tactile_ros.nodes.stamp_age import StampAge
from tactile_ros.types import FrameStatus

if TYPE_CHECKING:
    from collections.abc import Sequence

    from diagnostic_msgs.msg import DiagnosticStatus
    from rclpy.subscription import Subscription
    from rclpy.timer import Timer

    from tactile_ros.action import Grasp
    from tactile_ros.hands import HandDescription
    from tactile_ros.hands.urdf import RobotDescription
    from tactile_ros.nodes.grip_decision import Decision
    from tactile_ros.types import Array, ContactState, Frame

STALE = int(FrameStatus.STALE)
LAGS = (
    'at {:g} Hz a point of the trajectory lies two periods ahead, which is more than horizon_s: '
    'joints lag by 1.44 periods more, which the parameter lag must be told too'
)
WATCH_S = 1e-2  # how often the clock is looked at, at most


class GripNode(ManagedNode):
    """Publish the hand's command and `~/state`; serve `~/grasp` and `~/enable`.

    Attributes
    ----------
    direct : set of str
        Topics, by their full names, whose contacts come by `take_states` from the same process.
    """

    def __init__(self) -> None:
        super().__init__('grip_node')
        self.direct: set[str] = set()
        self._link: HandLink | None = None
        self._stage: GripStage | None = None
        self._next: GripStage | None = None
        self.declare(GripOptions())
        self._hand = load_hand(self.get_parameter('hand').value)
        self.declare(self._hand.driver, self._hand.driver.grip())
        self._states = self.managed_publisher(GripState, '~/state', newest(10))
        self._enable = self.create_service(SetBool, '~/enable', self._on_enable)
        self._grasps = GraspServer(self, self._why_not, self._begin, self._cancel)
        self._options = GripOptions()
        self._config = GripConfig()
        self._described: HandDescription = self._hand
        self._heard: list[Subscription] = []
        self._ticking: Timer | None = None
        self._enabled = False
        # Contacts of the same process come in the threads that read the sensors.
        self._lock = threading.RLock()
        self._forget()

    def _forget(self) -> None:
        """Nothing has come, and nothing was done."""
        self._tally = GripTally()
        self._sequences: dict[str, int] = {}
        self._ages: dict[str, StampAge] = {}
        self._joint_age = StampAge()

    def configure(self) -> None:
        """Check the parameters against each other and the hand."""
        self._options = self.options(GripOptions)
        self._config = self.options(GripConfig)
        described = self._hand.driven_by(self.options(type(self._hand.driver)))
        self._described = described.paced(self._config.rate_hz)
        if self._described.driver != described.driver:
            self.get_logger().warning(LAGS.format(self._config.rate_hz))
        GripStage(self._described, self._config, self._options.fingers)

    def activate(self) -> None:
        """Listen to the fingers and the hand, and begin to step."""
        self._enabled = self._options.enabled
        self._forget()
        self._next = GripStage(self._described, self._config, self._options.fingers)
        self._stage = None
        self._renew()
        wait = self._options.wait_for_robot_description
        learn = self._on_robot if wait or self._options.use_robot_description else None
        self._link = HandLink(self, self._described, self._on_joints, learn, wait)
        names = self._stage.fingers
        period = 1.0 / self._config.rate_hz
        self._pace = GripPace(period, LATE * self._config.slowest_period, len(names))
        topics = [self.topic_of(name) for name in names]
        self._fingers = {t: [i for i, one in enumerate(topics) if one == t] for t in topics}
        self._heard = [
            self.create_subscription(
                TactileContacts, topic, partial(self._on_contacts, topic), newest()
            )
            for topic in self._fingers
            if topic not in self.direct
        ]
        self._ticking = self.steady_timer(max(0.5 * period, WATCH_S), self._on_tick)

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
        self._next = GripStage(hand, self._config, self._options.fingers, robot)
        self._renew()
        return True

    def _renew(self) -> None:
        """Take what a description said once nothing is gripped: limits change under no grip."""
        with self._lock:
            if self._next is None or not (self._stage is None or self._stage.is_free):
                return
            self._stage, self._next = self._next, None
            if self._enabled:
                self._stage.enable()
        self._grasps.tell()  # how it ended, where that is not told yet
        self._grasps.finish(GraspOutcome.FAULT, 'the grip began anew with its robot_description')

    def deactivate(self) -> None:
        """Send nothing more: the last command is a posture, which holds."""
        with self._lock:
            if self._ticking is not None:
                self.destroy_timer(self._ticking)
                self._ticking = None
            if self._link is not None:
                self._link.close()
                self._link = None
            self._enabled = False
        self._grasps.finish(GraspOutcome.FAULT, 'grip_node was deactivated')
        for subscription in self._heard:
            self.destroy_subscription(subscription)
        self._heard = []

    def cleanup(self) -> None:
        """Forget the hand's state."""
        self._stage = None

    def destroy_node(self) -> None:
        """End the action before the node."""
        self._grasps.close()
        super().destroy_node()

    @property
    def unheard(self) -> list[str]:
        """Inputs of which nothing has come since the node is active."""
        return [] if self._stage is None else self._stage.unheard

    def _on_contacts(self, topic: str, message: TactileContacts) -> None:
        """Contacts from a topic."""
        force = vector(message.wrench.force)
        valid = message.valid and not message.status & STALE
        stamp_ns = messages.stamp_ns(message.header)
        self._take(topic, (force, valid, message.slip), message.sequence, stamp_ns)

    def take_states(
        self, topic: str, frames: Sequence[Frame], states: Sequence[ContactState]
    ) -> None:
        """Contacts of the same process, under the full name of their topic.

        Of several that waited the newest is answered; a slip in any of them counts.
        """
        frame, state = frames[-1], states[-1]
        valid = bool(state.valid) and not int(state.status) & STALE
        slip = 1 if any(one.slip == 1 for one in states) else int(state.slip)
        felt = state.force.tolist(), valid, slip
        self._take(topic, felt, frame.sequence, frame.stamp_ns or 0)

    def _take(
        self, topic: str, felt: tuple[Sequence[float], bool, int], sequence: int, stamp_ns: int
    ) -> None:
        """Take in what is felt, and step where it is the last that was waited for."""
        with self._lock:
            # the same frame once more is no news: it grows stale
            if self._ticking is None or sequence == self._sequences.get(topic):
                return
            self._sequences[topic] = sequence
            now_s, now_ns = time.monotonic(), self.now_ns()
            age = self._ages.setdefault(topic, StampAge())
            measured_s = age.measured_s(stamp_ns, now_ns, now_s)
            due = False
            for finger in self._fingers.get(topic, ()):
                self._stage.take_touch(finger, *felt, measured_s)
                due = self._pace.take(finger, stamp_ns if age.agrees else None, now_s)
            if due:
                self._step(now_s, now_ns)

    def _on_joints(self, position: Array, stamp_ns: int) -> None:
        """Where the hand is."""
        with self._lock:
            if self._stage is not None:
                now_s = time.monotonic()
                measured_s = self._joint_age.measured_s(stamp_ns, self.now_ns(), now_s)
                self._stage.take_joints(position, measured_s)

    def _on_tick(self) -> None:
        """Step where forces fail to, and tell clients how their grasp goes."""
        with self._lock:
            now_s = time.monotonic()
            if self._ticking is not None and self._pace.is_late(now_s):
                self._step(now_s, self.now_ns())
        self._renew()
        self._grasps.tell()

    def _step(self, now_s: float, now_ns: int) -> None:
        """One control step."""
        answered_ns = self._pace.newest_ns or now_ns
        since = self._pace.step(now_s)
        decision = self._dated(self._stage.step(now_s, answered_ns, self._link.blocked, since))
        if decision.command is not None:
            self._link.send(decision.command)
        self._tally.note(decision)
        if decision.lost:
            self.get_logger().error(decision.lost)
        if self._states.get_subscription_count():
            self._publish(decision, now_ns)
        self._grasps.note(decision)

    def _dated(self, decision: Decision) -> Decision:
        """The same, where an input is stale since its clock stepped back: naming that."""
        ages = {**self._ages, 'the joint states': self._joint_age}
        told = [f'{who} by {a.back_s:.3f} s' for who, a in ages.items() if a.back_s > 0]
        if not told or 'stale' not in decision.refusal:
            return decision
        refusal = f'{decision.refusal}: the clock stepped back of {", ".join(told)}'
        ended = decision.ended
        if ended is not None and ended.outcome == GraspOutcome.FAULT:
            ended = replace(ended, message=refusal)
        return replace(decision, refusal=refusal, ended=ended)

    def _publish(self, decision: Decision, now_ns: int) -> None:
        """What was decided, as a message."""
        made = decision.made
        message = GripState(phase=int(made.phase), fingers=self._stage.fingers)
        messages.fill_header(message.header, now_ns, '')
        message.target_force, message.force = packed(made.target_force), packed(made.force)
        message.friction, message.slip_margin = packed(made.friction), packed(made.slip_margin)
        message.command = packed(self._stage.sent)
        message.limited, message.refusal = decision.limited, decision.refusal
        message.input_age = float(made.input_age)
        self._states.publish(message)

    def _on_enable(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        """Let commands out, or no more; the hand keeps its last posture."""
        if self._ticking is None:
            response.message = 'grip_node is not active: activate it first'
            return response
        response.success = True
        response.message = 'enabled' if request.data else 'disabled: the last posture holds'
        if request.data != self._enabled:
            with self._lock:
                self._enabled = request.data
                (self._stage.enable if request.data else self._stage.disable)()
            if not request.data:
                self._grasps.finish(GraspOutcome.FAULT, 'the grip was disabled')
        return response

    def _why_not(self, goal: Grasp.Goal) -> str:
        """Why a grasp cannot be; empty: it can."""
        if self._ticking is None or not self._enabled:
            return 'grip_node is not active' if self._ticking is None else 'the grip is disabled'
        try:
            self._stage.admit(goal.target_force, goal.fingers, goal.timeout)
        except ValueError as err:
            return str(err)
        return ''

    def _begin(self, goal: Grasp.Goal) -> None:
        """Begin a grasp, or open."""
        with self._lock:
            self._grasps.forget()
            self._stage.grasp(goal.target_force, goal.fingers, goal.timeout, goal.adapt)

    def _cancel(self) -> None:
        """The client waits no more."""
        with self._lock:
            self._stage.cancel()

    def diagnose(self) -> DiagnosticStatus:
        """Phase, rate, refusals."""
        return self._tally.status(
            self._hand.name, self._config, self._enabled, self._grasps.is_busy, self.unheard
        )


def build() -> Sequence[ManagedNode]:
    """The node of this executable."""
    return [GripNode()]


def main() -> None:
    """Run grip_node until it is told to stop."""
    main_of(build, serving)


if __name__ == '__main__':
    main()
