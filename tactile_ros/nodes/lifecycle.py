# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Managed nodes: parameters, autostart, one sentence for a failure, diagnostics, a clean exit."""

from __future__ import annotations

import gc
import signal
import sys
import threading
import time
import traceback
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import ExitStack, suppress
from typing import NoReturn, TypeVar

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rcl_interfaces.msg import SetParametersResult
from rclpy.clock import Clock, ClockType
from rclpy.exceptions import InvalidParameterValueException, ParameterException
from rclpy.executors import Executor, SingleThreadedExecutor
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.signals import SignalHandlerOptions
from rclpy.subscription import Subscription
from rclpy.timer import Timer
from rclpy.utilities import try_shutdown

from tactile_ros.errors import TactileError
from tactile_ros.nodes.parameters import Schema

T = TypeVar('T')
SUCCESS = TransitionCallbackReturn.SUCCESS
FAILURE = TransitionCallbackReturn.FAILURE
DIAGNOSTICS_PERIOD_S = 1.0
DRAIN_S = 3.0
# Humble's rclpy has no callback after a change
APPLIES_AFTERWARDS = hasattr(LifecycleNode, 'add_post_set_parameters_callback')
# a recorder must get every baseline, also of tares that follow one another closely
LATCHED_DEPTHS = {'layout': 1, 'baseline': 100, 'calibration': 1, 'robot_description': 1}
SIGNALS = (signal.SIGINT, signal.SIGTERM)
REFUSED = (  # RuntimeError: what rcl refuses, such as a name
    TactileError, ValueError, RuntimeError, ParameterException, InvalidParameterValueException,
)  # fmt: skip


def qos(topic: str = '', depth: int = 1000) -> QoSProfile:
    """Quality of service of a topic: reliable; what describes the data reaches late subscribers.

    A profile is made anew for each use: rclpy writes what a parameter overrides into it.
    """
    latched = topic in LATCHED_DEPTHS
    return QoSProfile(
        depth=LATCHED_DEPTHS.get(topic, depth),
        reliability=ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )


class ManagedNode(LifecycleNode):
    """Lifecycle node with declared, validated parameters and diagnostics at 1 Hz while active.

    `configure`, `activate`, `deactivate` and `cleanup` refuse by a TactileError or ValueError of
    one sentence. Subscriptions and steady timers of an active node end with deactivate.
    `arguments` are ROS arguments for this node alone, which win over those of its process.
    """

    needs_receive_times = False  # the executor of events cannot give them

    def __init__(self, name: str, arguments: Sequence[str] = ()) -> None:
        super().__init__(name, cli_args=['--ros-args', *arguments] if arguments else None)
        self._schemas: list[Schema[object]] = []
        self._configured = self.is_configuring = self.is_active = False
        self._begun = ExitStack()
        self.steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.finished = threading.Event()
        self.exit_code = 0
        self._diagnostics = self.create_publisher(DiagnosticArray, '/diagnostics', 10)

    def declare(self, *defaults: object) -> None:
        """Declare the parameters of dataclasses and validate every later change."""
        first = not self._schemas
        for instance in defaults:
            schema = Schema(instance)
            schema.declare(self)
            self._schemas.append(schema)
        if first:
            self.add_on_set_parameters_callback(self._on_set_parameters)
            if APPLIES_AFTERWARDS:
                self.add_post_set_parameters_callback(lambda given: self.apply(_values(given)))

    def _on_set_parameters(self, parameters: Sequence[Parameter]) -> SetParametersResult:
        """Validate; nothing takes effect here."""
        wanted = _values(parameters)
        try:
            for schema in self._schemas:
                schema.validate(self, wanted, self._configured)
            self.check(wanted)
        except ValueError as err:
            return SetParametersResult(successful=False, reason=str(err))
        if not APPLIES_AFTERWARDS:
            self.apply(wanted)
        return SetParametersResult(successful=True)

    def options(self, kind: type[T]) -> T:
        """Parameters in the dataclass that declared them."""
        return next(s for s in self._schemas if isinstance(s.defaults, kind)).read(self)

    def managed_publisher(self, kind: type, topic: str, depth: int = 1000) -> Publisher:
        """Publisher that is silent while the node is not active; its QoS can be overridden."""
        overridable = QoSOverridingOptions.with_default_policies()
        return self.create_lifecycle_publisher(
            kind, topic, qos(topic, depth), qos_overriding_options=overridable
        )

    def subscribe(
        self, kind: type, topic: str, callback: Callable, depth: int = 1000, raw: bool = False
    ) -> Subscription:
        """Subscription that ends with deactivate; its QoS can be overridden."""
        overridable = QoSOverridingOptions.with_default_policies()
        made = self.create_subscription(
            kind, topic, callback, qos(topic, depth), raw=raw, qos_overriding_options=overridable
        )
        self._begun.callback(self.destroy_subscription, made)
        return made

    def steady_timer(self, period_s: float, callback: Callable[[], None]) -> Timer:
        """Timer of real time, which ends with deactivate."""
        made = self.create_timer(period_s, callback, clock=self.steady)
        self._begun.callback(self.destroy_timer, made)
        return made

    def check(self, changes: dict[str, object]) -> None:
        """Refuse values by a ValueError where their dataclass alone cannot know."""

    def apply(self, changes: dict[str, object]) -> None:
        """Let live values that were accepted take effect."""

    def configure(self) -> None:
        """Get ready."""

    def activate(self) -> None:
        """Begin; the publishers are enabled."""

    def deactivate(self) -> None:
        """End what activate began."""

    def cleanup(self) -> None:
        """Give back what configure took."""

    def diagnose(self) -> DiagnosticStatus:
        """Status of the node, asked for once a second while active."""
        return DiagnosticStatus()

    def lags(self) -> bool:
        """Messages may wait that must be taken before the process ends."""
        return False

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Run configure; a refusal is logged as one sentence."""
        self.is_configuring, done = True, False
        with suppress(KeyboardInterrupt):
            done = self._tried(self.configure)
        self.is_configuring = False
        if not done:
            self._tried(self.cleanup)
            return FAILURE
        self._configured = True
        return super().on_configure(state)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Enable the publishers and begin."""
        done = super().on_activate(state)
        if done == SUCCESS and not self._tried(self.activate):
            self._begun.close()
            super().on_deactivate(state)
            return FAILURE
        self.is_active = True
        self.steady_timer(DIAGNOSTICS_PERIOD_S, self._publish_diagnostics)
        return done

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """End, then silence the publishers."""
        self._stop()
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop and give back what configure took, on the way to any state that has nothing."""
        self._stop()
        done = self._tried(self.cleanup)
        self._configured = self._configured and not done
        return super().on_cleanup(state) if done else FAILURE

    on_shutdown = on_error = on_cleanup

    def _tried(self, step: Callable[[], None]) -> bool:
        """Run a step; what it refuses is logged as its sentence."""
        try:
            step()
        except Exception as err:  # rclpy would swallow it
            foreseen = isinstance(err, (TactileError, ValueError, OSError))
            self.get_logger().error(str(err) if foreseen else traceback.format_exc())
            return False
        return True

    def _stop(self) -> None:
        if self.is_active:
            self.is_active = False
            self.deactivate()
            self._begun.close()

    def _publish_diagnostics(self) -> None:
        try:
            status = self.diagnose()
        except Exception as err:  # what cannot be logged must not end the node
            status = DiagnosticStatus(level=DiagnosticStatus.ERROR, name='diagnostics')
            status.message = f'{type(err).__name__}: {err}'
        status.name = f'{self.get_fully_qualified_name().lstrip("/")}: {status.name}'
        message = DiagnosticArray(status=[status])
        message.header.stamp = self.get_clock().now().to_msg()
        self._diagnostics.publish(message)

    def now_ns(self) -> int:
        """Time of the node's clock (ns), simulated or not."""
        clock = self.get_clock()
        if clock.ros_time_is_active:
            return int(clock.now().nanoseconds)
        return time.time_ns()  # the same clock, without three objects made for it

    def end(self) -> None:
        """Bring the node to its end from whatever state it is in."""
        if self._state_machine.current_state[1] != 'finalized':
            self.trigger_shutdown()
        self.destroy_node()


def _values(parameters: Sequence[Parameter]) -> dict[str, object]:
    return {parameter.name: parameter.value for parameter in parameters}


def diagnostic(
    name: str,
    message: str,
    values: Mapping[str, object],
    level: bytes = DiagnosticStatus.OK,
    hardware_id: str = '',
) -> DiagnosticStatus:
    """Diagnostic status whose values are text."""
    pairs = [
        KeyValue(key=key, value=f'{x:.6g}' if isinstance(x, float) else str(x))
        for key, x in values.items()
    ]
    return DiagnosticStatus(
        level=level, name=name, message=message, hardware_id=hardware_id, values=pairs
    )


def start(nodes: Iterable[ManagedNode], stopped: Sequence[int] = ()) -> None:
    """Configure and activate the nodes whose parameter `autostart` is true, until `stopped`.

    One that cannot has finished with code 1, so that whoever started the process knows.
    """
    for node in nodes:
        if stopped or not node.get_parameter('autostart').value:
            continue
        if node.trigger_configure() != SUCCESS or node.trigger_activate() != SUCCESS:
            node.exit_code = 1
            node.finished.set()
            return


def run(build: Callable[[], ManagedNode | Sequence[ManagedNode]]) -> NoReturn:
    """Run the nodes that `build` makes until a signal or until one has finished; end the process.

    The exit code is 0 after a signal, that of a node that finished, 2 when a parameter cannot be.
    """
    # A handler of ours: the context stays usable for the last words after Ctrl-C.
    try:
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    except Exception as err:  # of several private classes: a file or an argument that cannot be
        sys.exit(f'the ROS arguments cannot be read: {err}')
    # No Event: its lock would wait for itself where a second signal interrupts the first.
    stopped: list[int] = []
    nodes: list[ManagedNode] = []

    def stop(number: int, _: object) -> None:
        stopped.append(number)
        if any(node.is_configuring for node in nodes):  # a calibration may take seconds to load
            raise KeyboardInterrupt

    for number in SIGNALS:
        signal.signal(number, stop)
    try:
        made = build()
    except REFUSED as err:
        rclpy.logging.get_logger('tactile_ros').fatal(str(err))
        try_shutdown()
        sys.exit(2)
    nodes += made if isinstance(made, Sequence) else [made]
    plain = any(node.needs_receive_times for node in nodes)
    executor = SingleThreadedExecutor() if plain else events_executor()
    for node in nodes:
        executor.add_node(node)
    try:
        start(nodes, stopped)
        spin(executor, lambda: bool(stopped) or any(node.finished.is_set() for node in nodes))
        # what waits for a node that must not lose it
        deadline = time.monotonic() + DRAIN_S
        while any([node.lags() for node in nodes]) and time.monotonic() < deadline:
            executor.spin_once(timeout_sec=0.2)
    finally:
        for node in reversed(nodes):
            node.end()
        executor.shutdown()
        # not rclpy.shutdown: to take off its handlers, which were never there, it sets the
        # default for a moment, in which a second signal would kill
        try_shutdown()
    for number in SIGNALS:  # Python's end would let another one kill
        signal.signal(number, signal.SIG_IGN)
    gc.freeze()  # Python's end would look at all that was ever imported: 0.3 s
    sys.exit(0 if stopped else max(node.exit_code for node in nodes))


def events_executor() -> Executor:
    """Executor that wakes on events, where this ROS has it.

    The other looks at every service and timer of all nodes whenever something comes; with the
    nodes of a hand that takes milliseconds, in which their loops have to wait.
    """
    with suppress(ImportError):  # before Kilted
        from rclpy.experimental import EventsExecutor

        return EventsExecutor()
    return SingleThreadedExecutor()


def spin(executor: Executor, done: Callable[[], bool]) -> None:
    """Serve callbacks until done."""
    while not done():
        try:
            executor.spin_once(timeout_sec=0.1)
        except Exception:  # of one callback: the others go on
            if not rclpy.ok():
                raise
            rclpy.logging.get_logger('tactile_ros').error(traceback.format_exc())
