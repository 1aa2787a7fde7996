"""mock_hand: a fake of a hand's driver on its own topics, to run everything without the hand.

It takes commands as the driver takes them (type, order, count, rate), reports joint states as the
driver reports them, and fails as it fails: `fault`.
"""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from rcl_interfaces.msg import ParameterType, ParameterValue
from rcl_interfaces.srv import GetParameters
from sensor_msgs.msg import JointState

from tactile_ros.hands import load_hand
from tactile_ros.hands.drivers import in_order, read_command
from tactile_ros.hands.joints import FAULTS, MockHand, taking_part
from tactile_ros.nodes.graph import has_port
from tactile_ros.nodes.grip_node import MESSAGES, newest
from tactile_ros.nodes.lifecycle import ManagedNode, main_of, pairs
from tactile_ros.nodes.parameters import NodeOptions
from tactile_ros.sensors import load_sensor
from tactile_ros.types import Closing

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from rclpy.timer import Timer

    from tactile_ros.hands.description import Finger
    from tactile_ros.hands.drivers import Topic
    from tactile_ros.types import Array, Integers, Recording, Twin

BINS = 24


class PressTable:
    """Readings of a sensor over the normal force of one press.

    Parameters
    ----------
    presses : Recording
        With truth of force; its strongest press is taken.
    """

    def __init__(self, presses: Recording) -> None:
        normal = np.nan_to_num(presses.truth['force'][:, 2])
        last = int(normal.argmax())
        first = int(np.flatnonzero(normal[:last] <= 0.0)[-1]) + 1
        rest = presses.values[normal == 0.0].mean(axis=0)
        edges = np.linspace(0.0, normal[last], BINS + 1)
        place = np.digitize(normal[first : last + 1], edges[1:-1])
        bins = np.unique(place)
        rows = presses.values[first : last + 1]
        self.force = np.array([0.0, *(normal[first : last + 1][place == b].mean() for b in bins)])
        self.values = np.stack([rest, *(rows[place == b].mean(axis=0) for b in bins)])

    def at(self, force: float) -> Array:
        """Readings (t, c) at a normal force (N); beyond the strongest those of it."""
        upper = int(np.clip(np.searchsorted(self.force, force), 1, len(self.force) - 1))
        low, high = self.force[upper - 1], self.force[upper]
        share = min(max((force - low) / (high - low), 0.0), 1.0)
        between: Array = (1.0 - share) * self.values[upper - 1] + share * self.values[upper]
        return between


class PressedTwins(Closing):
    """Twins of one sensor on serial ports, pressed from outside.

    Parameters
    ----------
    sensor : str
        Key of a sensor on a serial port.
    ports : sequence of str
        Path at which each appears.
    seed : int
        Of presses and noise, counted up.

    Attributes
    ----------
    force : list of float
        That presses each now (N).
    twins : list of Twin
        In their order, for faults.
    """

    def __init__(self, sensor: str, ports: Sequence[str], seed: int = 0) -> None:
        spec = load_sensor(sensor)
        config, connection = spec.config(), spec.connection()
        if not has_port(sensor):
            msg = f'a sensor that a fake hand presses must have a serial port; received {sensor!r}'
            raise ValueError(msg)
        self.force = [0.0] * len(ports)
        self._held = ExitStack()
        self.twins: list[Twin] = []
        table = PressTable(spec.presses(config, seed))
        for i, port in enumerate(ports):
            twin = spec.simulate(config, connection, self._signal(table, i), seed + i)
            self.twins.append(self._held.enter_context(twin))
            place = Path(port)
            place.parent.mkdir(parents=True, exist_ok=True)
            place.unlink(missing_ok=True)
            place.symlink_to(twin.port)
            self._held.callback(place.unlink, missing_ok=True)

    def _signal(self, table: PressTable, index: int) -> Callable[[float], Array]:
        """Readings of a twin, whatever the time."""
        return lambda _: table.at(self.force[index])

    def close(self) -> None:
        """End the twins and remove their ports."""
        self._held.close()


NONE = 'none'


@dataclass(frozen=True)
class MockOptions(NodeOptions):
    """Parameters of mock_hand besides those of the hand's driver."""

    hand: str = field(
        default='allegro_v5',
        metadata={'help': 'name of a hand, or a .yaml that describes one', 'read_only': True},
    )
    order: tuple[str, ...] = field(
        default=(),
        metadata={'help': "the controller's order of joints; empty: as its driver ships it"},
    )
    dead_time_s: float = field(
        default=0.0,
        metadata={'help': 'before a command acts', 'unit': 's', 'range': (0.0, 2.0)},
    )
    lag_s: float = field(
        default=0.02,
        metadata={'help': 'time constant of the position loop', 'unit': 's', 'range': (1e-3, 2.0)},
    )
    sensor: str = field(
        default='',
        metadata={'help': 'key of the sensors that its closing presses; empty: none'},
    )
    fingers: tuple[str, ...] = field(
        default=(), metadata={'help': 'sensors that are pressed; empty: all of the hand'}
    )
    ports: tuple[str, ...] = field(
        default=(), metadata={'help': 'paths where their serial ports appear, in their order'}
    )
    seed: int = field(default=0, metadata={'help': 'of the sensors, counted up'})
    contact_at: float = field(
        default=0.4,
        metadata={
            'help': 'closure at which each finger touches',
            'range': (0.0, 1.0),
            'live': True,
        },
    )
    stiffness: float = field(
        default=40.0,
        metadata={
            'help': 'of what a finger touches',
            'unit': 'N per closure',
            'range': (0.0, 1e4),
            'live': True,
        },
    )
    fault: str = field(
        default=NONE,
        metadata={
            'help': 'silent: no joint states; frozen: the same again and again; partial: a joint '
            'is missing; nan: positions are NaN',
            'choices': (NONE, *FAULTS),
            'live': True,
        },
    )


class MockHandNode(ManagedNode):
    """A fake of a hand's driver."""

    def __init__(self) -> None:
        super().__init__('mock_hand')
        self.declare(MockOptions())
        self._hand = load_hand(self.get_parameter('hand').value)
        self.declare(self._hand.driver)
        self._ticking: Timer | None = None
        self._ended: list[tuple[object, object]] = []
        self._silenced = False
        self.received: dict[str, int] = {}
        self.refused = 0
        self.joints: MockHand | None = None
        self.caps = np.zeros(0)
        self.pressed: PressedTwins | None = None
        self._pressing: list[tuple[Finger, Integers]] = []

    def configure(self) -> None:
        """Put the hand into its open posture, and answer on the driver's topics."""
        options = self.options(MockOptions)
        driver = self.options(type(self._hand.driver))
        self._hand = self._hand.driven_by(driver)
        order = options.order or driver.joints
        self._order = in_order(driver.joints, order)
        self._back = in_order(order, driver.joints)
        rest = self._hand.posture('open', np.clip(0.0, driver.lower, driver.upper))
        self.joints = MockHand(driver.limits, rest, options.dead_time_s, options.lag_s)
        if options.sensor:
            _, names = taking_part(self._hand, options.fingers)
            found = [(self._hand.fingers[name], self._hand.places(name)) for name in names]
            self._pressing = found
            self.pressed = PressedTwins(options.sensor, options.ports, options.seed)
        self._period_s = 1.0 / min(driver.fastest_hz, 100.0)
        self._driver, self._names = driver, tuple(order)
        self.received, self.refused, self._silenced = {}, 0, False
        self._states = self.create_publisher(JointState, driver.states, newest(10))
        self._ended = [(self.destroy_publisher, self._states)]
        for topic in driver.topics:
            self.received[topic.name] = 0
            heard = self.create_subscription(
                MESSAGES[topic.kind], topic.name, partial(self._on_command, topic), newest(3)
            )
            self._ended.append((self.destroy_subscription, heard))
        if driver.controller:
            name = f'{driver.controller}/get_parameters'
            service = self.create_service(GetParameters, name, self._on_parameters)
            self._ended.append((self.destroy_service, service))

    def activate(self) -> None:
        """Begin to move and to report."""
        self._ticking = self.steady_timer(self._period_s, self._on_tick)

    def deactivate(self) -> None:
        """Stand still and say nothing."""
        if self._ticking is not None:
            self.destroy_timer(self._ticking)
            self._ticking = None

    def cleanup(self) -> None:
        """Leave the topics."""
        for end, thing in self._ended:
            end(thing)
        self._ended = []
        if self.pressed is not None:
            self.pressed.close()
            self.pressed = None

    def _on_command(self, topic: Topic, message: object) -> None:
        """Take a command, or fail on it as the driver does."""
        if self._ticking is None or self._silenced:
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
        """What the controller says of itself."""
        kind = ParameterType.PARAMETER_STRING_ARRAY
        known = {'joints': ParameterValue(type=kind, string_array_value=list(self._names))}
        response.values = [known.get(name, ParameterValue()) for name in request.names]
        return response

    def _on_tick(self) -> None:
        """Move, and report as the driver does."""
        fault = self.get_parameter('fault').value
        before = self.joints.position
        position = self.joints.step(self._period_s)
        self._press()
        if fault == 'silent' or self._silenced:
            return
        message = JointState(name=list(self._driver.joints))
        message.header.stamp = self.get_clock().now().to_msg()
        shown = before if fault == 'frozen' else position
        if fault == 'frozen':
            self.joints.position = before
        if fault == 'nan':
            shown = np.full_like(position, np.nan)
        message.position = shown.tolist()
        message.velocity = ((shown - before) / self._period_s).tolist()
        message.effort = np.zeros(len(shown)).tolist()
        if fault == 'partial':
            message.name, message.position = message.name[1:], message.position[1:]
        self._states.publish(message)

    def _press(self) -> None:
        """Let every finger press its sensor as far as it has closed."""
        if self.pressed is None:
            return
        at, stiffness = (self.get_parameter(n).value for n in ('contact_at', 'stiffness'))
        for i, (finger, place) in enumerate(self._pressing):
            closure = finger.closure_of(self.joints.position[place])
            self.pressed.force[i] = stiffness * max(0.0, closure - at)

    def diagnose(self) -> DiagnosticStatus:
        """What came in."""
        status = DiagnosticStatus(level=DiagnosticStatus.OK, name='mock hand')
        status.message = f'a fake of {self._hand.name}'
        status.hardware_id = self._hand.name
        told = {f'commands on {name}': count for name, count in self.received.items()}
        status.values = pairs({**told, 'refused': self.refused, 'silenced': self._silenced})
        return status


def build() -> Sequence[ManagedNode]:
    """The node of this executable."""
    return [MockHandNode()]


def main() -> None:
    """Run mock_hand until it is told to stop."""
    main_of(build)


if __name__ == '__main__':
    main()
