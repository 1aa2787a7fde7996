# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""mock_hand: a fake of a hand's driver on its own topics, to run everything without the hand.

It takes commands and reports joint states as the driver does, and fails as it fails: `fault`.
Where asked, its closing presses simulated sensors: readings between rest and the strongest press
of the sensor's own signal are interpolated by force, and come as bytes from pseudo-terminals.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from contextlib import ExitStack
from functools import partial
from pathlib import Path

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from rcl_interfaces.msg import ParameterType, ParameterValue
from rcl_interfaces.srv import GetParameters
from sensor_msgs.msg import JointState

from tactile_ros.hands import load_hand
from tactile_ros.hands.description import Finger
from tactile_ros.hands.drivers import Topic, in_order, read_command
from tactile_ros.hands.joints import taking_part
from tactile_ros.nodes.graph import has_port
from tactile_ros.nodes.grip_node import MESSAGES
from tactile_ros.nodes.lifecycle import ManagedNode, diagnostic, qos
from tactile_ros.nodes.parameters import MockHandOptions
from tactile_ros.sensors import load_sensor
from tactile_ros.types import Array, Closing, Integers, JointLimits, Recording, Twin

BINS = 24
FASTEST_HZ = 100.0


class PressTable:
    """Readings of a sensor over the normal force of the strongest press of a recording."""

    def __init__(self, presses: Recording) -> None:
        normal = np.nan_to_num(presses.truth['force'][:, 2])
        last = int(normal.argmax())
        first = int(np.flatnonzero(normal[:last] <= 0.0)[-1]) + 1
        rest = presses.values[normal == 0.0].mean(axis=0)
        loading, rows = normal[first : last + 1], presses.values[first : last + 1]
        place = np.digitize(loading, np.linspace(0.0, normal[last], BINS + 1)[1:-1])
        bins = np.unique(place)
        self.force = np.array([0.0, *(loading[place == b].mean() for b in bins)])
        self.values = np.stack([rest, *(rows[place == b].mean(axis=0) for b in bins)])

    def at(self, force: float) -> Array:
        """Readings (t, c) at a normal force (N); beyond the strongest those of it."""
        upper = int(np.clip(np.searchsorted(self.force, force), 1, len(self.force) - 1))
        low, high = self.force[upper - 1], self.force[upper]
        share = min(max((force - low) / (high - low), 0.0), 1.0)
        between: Array = (1.0 - share) * self.values[upper - 1] + share * self.values[upper]
        return between


class ClosedLoopTwins(Closing):
    """Twins of one sensor at the paths of their serial ports, each pressed by its `force` (N)."""

    def __init__(self, sensor: str, ports: Sequence[str], seed: int = 0) -> None:
        if not has_port(sensor):
            msg = f'a sensor that a fake hand presses must have a serial port; received {sensor!r}'
            raise ValueError(msg)
        spec = load_sensor(sensor)
        config, connection = spec.config(), spec.connection()
        self.force = [0.0] * len(ports)
        self._held = ExitStack()
        self.twins: list[Twin] = []
        table = PressTable(spec.presses(config, seed))

        def reading(index: int, _: float) -> Array:
            return table.at(self.force[index])

        for i, port in enumerate(ports):
            twin = spec.simulate(config, connection, partial(reading, i), seed + i)
            self.twins.append(self._held.enter_context(twin))
            place = Path(port)
            place.parent.mkdir(parents=True, exist_ok=True)
            place.unlink(missing_ok=True)
            place.symlink_to(twin.port)
            self._held.callback(place.unlink, missing_ok=True)

    def close(self) -> None:
        """End the twins and remove their ports."""
        self._held.close()


class MockHand:
    """Joints (j,) of a fake hand, which begin at `position` and keep their limits.

    A command acts after `dead_time_s`; `lag_s` is the time constant of the position loop (s).
    """

    def __init__(
        self, limits: JointLimits, position: Array, dead_time_s: float = 0.0, lag_s: float = 0.02
    ) -> None:
        self._limits = limits
        self._dead_time_s, self._lag_s = dead_time_s, lag_s
        self.position = np.clip(position, limits.lower, limits.upper)
        self._target = self.position
        self._arrival_s = 0.0  # until a trajectory's point is reached; 0: position loop
        self._waiting: deque[tuple[float, Array, float]] = deque()
        self._time_s = 0.0
        self.steps = 0

    def command(self, target: Array, horizon_s: float = 0.0) -> None:
        """Take targets (j,), to be reached in `horizon_s` (s); 0: as soon as the loop can."""
        target = np.clip(target, self._limits.lower, self._limits.upper)
        self._waiting.append((self._time_s + self._dead_time_s, target, horizon_s))

    def step(self, dt: float) -> Array:
        """Positions (j,) after a time (s), positive."""
        self._time_s += dt
        self.steps += 1
        while self._waiting and self._waiting[0][0] <= self._time_s:
            _, self._target, self._arrival_s = self._waiting.popleft()
        if self._arrival_s > 0:
            share = min(1.0, dt / self._arrival_s)
            self._arrival_s = max(self._arrival_s - dt, 1e-9)
        else:
            share = 1.0 - np.exp(-dt / self._lag_s)
        most = self._limits.velocity * dt
        move = share * (self._target - self.position)
        self.position = self.position + np.clip(move, -most, most)
        return self.position


class MockHandNode(ManagedNode):
    """A fake of a hand's driver."""

    def __init__(self) -> None:
        super().__init__('mock_hand')
        self.declare(MockHandOptions())
        self._hand = load_hand(self.get_parameter('hand').value)
        self.declare(self._hand.driver)
        self._held = ExitStack()
        self._silenced = False
        self.received: dict[str, int] = {}
        self.refused = 0
        self.joints: MockHand | None = None
        self.caps = np.zeros(0)
        self.pressed: ClosedLoopTwins | None = None
        self._pressing: list[tuple[Finger, Integers]] = []

    def configure(self) -> None:
        """Put the hand into its open posture, and answer on the driver's topics."""
        options = self.options(MockHandOptions)
        driver = self.options(type(self._hand.driver))
        self._hand = self._hand.driven_by(driver)
        order = options.order or driver.joints
        self._order = in_order(driver.joints, order)
        self._back = in_order(order, driver.joints)
        rest = self._hand.posture('open', np.clip(0.0, driver.lower, driver.upper))
        self.joints = MockHand(driver.limits, rest, options.dead_time_s, options.lag_s)
        if options.sensor:
            _, names = taking_part(self._hand, options.fingers)
            self._pressing = [(self._hand.fingers[n], self._hand.places(n)) for n in names]
            twins = ClosedLoopTwins(options.sensor, options.ports, options.seed)
            self.pressed = self._held.enter_context(twins)
        self._period_s = 1.0 / min(driver.fastest_hz, FASTEST_HZ)
        self._driver, self._names = driver, tuple(order)
        self.received = {topic.name: 0 for topic in driver.topics}
        self.refused, self._silenced = 0, False
        self._states = self.create_publisher(JointState, driver.states, qos(depth=10))
        self._held.callback(self.destroy_publisher, self._states)
        for topic in driver.topics:
            take, profile = partial(self._on_command, topic), qos(depth=3)
            commands = self.create_subscription(MESSAGES[topic.kind], topic.name, take, profile)
            self._held.callback(self.destroy_subscription, commands)
        if driver.controller:
            name = f'{driver.controller}/get_parameters'
            service = self.create_service(GetParameters, name, self._on_parameters)
            self._held.callback(self.destroy_service, service)

    def activate(self) -> None:
        """Begin to move and to report."""
        self.steady_timer(self._period_s, self._on_tick)

    def cleanup(self) -> None:
        """Leave the topics."""
        self._held.close()
        self.pressed = None

    def _on_command(self, topic: Topic, message: object) -> None:
        if not self.is_active or self._silenced:
            return
        self.received[topic.name] += 1
        try:
            values, horizon_s = read_command(topic.kind, message, self._names)
        except ValueError as err:
            self.refused += 1
            self._silenced = self._driver.falls_silent
            self.get_logger().error(str(err))
            return
        if topic.fill == self._driver.topics[-1].fill:
            self.joints.command(values[self._back], horizon_s)
        else:
            self.caps = values[self._back]

    def _on_parameters(
        self, request: GetParameters.Request, response: GetParameters.Response
    ) -> GetParameters.Response:
        kind = ParameterType.PARAMETER_STRING_ARRAY
        joints = ParameterValue(type=kind, string_array_value=list(self._names))
        response.values = [joints if n == 'joints' else ParameterValue() for n in request.names]
        return response

    def _on_tick(self) -> None:
        fault = self.get_parameter('fault').value
        before = self.joints.position
        position = self.joints.step(self._period_s)
        self._press()
        if fault == 'silent' or self._silenced:
            return
        message = JointState(name=list(self._driver.joints))
        message.header.stamp = self.get_clock().now().to_msg()
        if fault == 'frozen':
            position = self.joints.position = before
        if fault == 'nan':
            position = np.full_like(position, np.nan)
        message.position = position.tolist()
        message.velocity = ((position - before) / self._period_s).tolist()
        message.effort = [0.0] * len(position)
        if fault == 'partial':
            message.name, message.position = message.name[1:], message.position[1:]
        self._states.publish(message)

    def _press(self) -> None:
        if self.pressed is None:
            return
        at, stiffness = (self.get_parameter(n).value for n in ('contact_at', 'stiffness'))
        for i, (finger, place) in enumerate(self._pressing):
            deep = finger.depth(self.joints.position[place], at)
            self.pressed.force[i] = stiffness * max(0.0, deep)

    def diagnose(self) -> DiagnosticStatus:
        """Commands that came in."""
        values = {f'commands on {name}': count for name, count in self.received.items()}
        values = {**values, 'refused': self.refused, 'silenced': self._silenced}
        name = self._hand.name
        return diagnostic('mock hand', f'a fake of {name}', values, hardware_id=name)
