"""sensor_node: read one tactile sensor and publish its frames."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import replace
from typing import TYPE_CHECKING

from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import Point, Quaternion

from tactile_ros import messages
from tactile_ros.enrolment import playing
from tactile_ros.msg import TactileContact, TactileContacts, TactileFrame, TactileLayout
from tactile_ros.nodes.health import Health
from tactile_ros.nodes.lifecycle import ManagedNode, main_of, pairs
from tactile_ros.nodes.quality import data, latched
from tactile_ros.nodes.reader import Reader
from tactile_ros.nodes.sensor_options import SensorOptions
from tactile_ros.nodes.twin import RELIEF, SignalTruth, parse_fault
from tactile_ros.nodes.views import Views
from tactile_ros.sensors import load_sensor

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from rclpy.publisher import Publisher

    from tactile_ros.types import Array, Device, Frame, Layout, Recording, Twin

AT_ONCE = 0.5  # of a frame's period: what takes less to read was not waited for


class SensorNode(ManagedNode):
    """Publish `frame`, `layout` (latched) and /diagnostics of one sensor, real or simulated.

    On demand also `magnetic_field/chip_<i>` and `image`, and of a twin `truth/contacts`.

    Parameters
    ----------
    downstream : callable or None
        Takes every frame, those that came together at once, and the name of their tf frame in the
        reader's thread, before they are published: the one-process road, which has no queue.
    waits_for : callable or None
        Further condition for the first frame.
    arguments : sequence of str
        ROS arguments for this node alone.
    """

    def __init__(
        self,
        downstream: Callable[[Sequence[Frame], str], None] | None = None,
        waits_for: Callable[[], bool] | None = None,
        arguments: Sequence[str] = (),
    ) -> None:
        super().__init__('sensor_node', arguments)
        self._twin: Twin | None = None
        self._reader: Reader | None = None
        self.declare(SensorOptions())
        self._spec = load_sensor(self.get_parameter('sensor').value)
        self.declare(self._spec.config(), self._spec.connection())
        self._frames = self.managed_publisher(TactileFrame, 'frame', data())
        self._layouts = self.managed_publisher(TactileLayout, 'layout', latched())
        self._downstream = downstream
        self._waits_for = waits_for
        self._options = SensorOptions()
        self._layout: Layout | None = None
        self._health = Health(float('nan'))
        self._views: Views | None = None
        self._held = ExitStack()
        self._truth: SignalTruth | None = None
        self._truths: Publisher | None = None
        self._pending_fault = ''

    def configure(self) -> None:
        """Check the parameters and open the device; a missing port is told and tried again."""
        self._options = self.options(SensorOptions)
        config = self.options(type(self._spec.config()))
        self._layout = replace(
            self._spec.layout(config), frame_id=self._options.frame_id, serial=self._options.serial
        )
        if self._options.simulated:
            self._begin_twin(config)
        self.check({'fault': self._options.fault})
        self._pending_fault = self._options.fault
        self._reader = self._make_reader()
        self._reader.open()

    def _begin_twin(self, config: object) -> None:
        """Let the twin answer from now until cleanup."""
        connection = self.options(type(self._spec.connection()))
        seed = self._options.seed
        signal, recording = self._scene(config)
        twin = self._spec.simulate(config, connection, signal, seed)
        self._twin = self._held.enter_context(twin)
        self._truth = SignalTruth(recording, self.now_ns())
        self._truths = self.create_publisher(TactileContacts, 'truth/contacts', data())
        self._held.callback(self.destroy_publisher, self._truths)

    def _scene(self, config: object) -> tuple[Callable[[float], Array] | None, Recording]:
        """Signal of the twin, None: its own, and the truth of it."""
        seed, lesson = self._options.seed, self._spec.lesson
        if self._options.scene == 'presses':
            return None, self._spec.presses(config, seed)
        if lesson is None:
            msg = f'scene of {self._spec.key} must be presses; it has no lesson'
            raise ValueError(msg)
        recording = lesson.scene(config, seed, 0.0)
        return playing(recording), recording

    def _make_reader(self) -> Reader:
        """Reader of a fresh device: its frames count from 0."""
        config = self.options(type(self._spec.config()))
        connection = self.options(type(self._spec.connection()))
        device: Device = (
            self._spec.open(config, connection, self.now_ns)
            if self._twin is None
            else self._twin.device(self.now_ns)
        )
        queue = self._options.queue if self._downstream is None else 0
        return Reader(
            device,
            self._deliver,
            self.get_logger().error,
            self._is_awaited,
            queue,
            self._kept_back_s(),
        )

    def _kept_back_s(self) -> float:
        """Frames that come so much faster than they are taken have waited in the port (s)."""
        rate_hz = self._layout.rate_hz
        if not self._options.discard_stale:
            return 0.0
        # not a fixed time: on a busy machine it takes milliseconds to decode what waits
        return AT_ONCE / rate_hz if rate_hz > 0 else 1.0

    def activate(self) -> None:
        """Publish the layout and begin to read."""
        if self._reader is None:
            self._reader = self._make_reader()
            self._reader.open()
        message = TactileLayout()
        messages.fill_layout(message, self._layout, Point, Quaternion)
        message.header.stamp = self.get_clock().now().to_msg()
        self._layouts.publish(message)
        name = f'{self._spec.key} {self._options.serial}'.strip()
        self._health = Health(self._layout.rate_hz, hardware_id=name)
        self._views = Views(self, self._layout, self._options.magnetic_field, self._options.image)
        pending, self._pending_fault = self._pending_fault, ''
        self.apply({'fault': pending})
        self._reader.start()

    def deactivate(self) -> None:
        """End the reader; the port is free then."""
        if self._reader is not None:
            self._reader.close()
            self._reader = None
        if self._views is not None:
            self._views.close()
            self._views = None

    def cleanup(self) -> None:
        """Free the port, end the twin."""
        self.deactivate()
        self._held.close()
        self._twin = self._truth = self._truths = None

    def check(self, changes: dict[str, object]) -> None:
        """Refuse a fault that this sensor cannot suffer."""
        fault = str(changes.get('fault', ''))
        if not fault:
            return
        simulated = changes.get('simulated', self.get_parameter('simulated').value)
        if self._twin is not None:
            if fault != RELIEF:
                parse_fault(fault, self._twin.faults)
        elif self._reader is not None or not simulated:
            msg = f'fault must be empty where the sensor is not simulated; received {fault!r}'
            raise ValueError(msg)

    def apply(self, changes: dict[str, object]) -> None:
        """Let the twin suffer a fault."""
        fault = str(changes.get('fault', ''))
        if fault == RELIEF and self._twin is not None:
            self._twin.relieve()
        elif fault and self._twin is not None:
            name, count = parse_fault(fault, self._twin.faults)
            self._twin.inject(name, count)
            self.get_logger().info(f'the twin suffers {name}, {count} times')

    def _is_awaited(self) -> bool:
        """Everybody who must see the first frame is there."""
        heard = self._frames.get_subscription_count() >= self._options.listeners
        return heard and (self._waits_for is None or self._waits_for())

    def _deliver(self, frames: Sequence[Frame]) -> None:
        """Hand frames on and publish them."""
        frame_id = self._options.frame_id
        if self._downstream is not None:
            self._downstream(frames, frame_id)
        for frame in frames:
            self._publish(frame, frame_id)

    def _publish(self, frame: Frame, frame_id: str) -> None:
        """Publish a frame and its views, each where somebody listens."""
        if self._frames.get_subscription_count():
            message = TactileFrame()
            messages.fill_frame(message, frame, frame_id)
            self._frames.publish(message)
        self._views.publish(frame, frame_id)
        if self._truths is not None and self._truths.get_subscription_count():
            self._publish_truth(frame, frame_id)

    def _publish_truth(self, frame: Frame, frame_id: str) -> None:
        """What the twin's signal says at the frame's stamp."""
        state, groups = self._truth.at(frame.stamp_ns, frame.device_time_ns)
        message = TactileContacts()
        messages.fill_contacts(message, state, TactileContact)
        messages.fill_header(message.header, frame.stamp_ns, frame_id)
        message.sequence = frame.sequence
        for name, value in groups.items():
            setattr(message, name, value)
        self._truths.publish(message)

    def diagnose(self) -> DiagnosticStatus:
        """Connection, rate, jitter, losses, taxels and temperature."""
        if self._reader is None:
            return DiagnosticStatus(level=DiagnosticStatus.STALE, name='sensor')
        self._views.look()
        more = {'simulated': self._twin is not None}
        if self._twin is not None:
            suffered = {name: n for name, n in self._twin.injected.items() if n}
            more['injected'] = ', '.join(f'{n} {k}' for k, n in suffered.items()) or 'nothing'
        reader = self._reader
        level, message, values = self._health.judge(
            reader.reading, reader.counters(), reader.is_open, more
        )
        status = DiagnosticStatus(level=level, name='sensor', message=message)
        status.hardware_id = self._health.hardware_id
        status.values = pairs(values)
        return status


def build() -> Sequence[ManagedNode]:
    """The node of this executable."""
    return [SensorNode()]


def main() -> None:
    """Run sensor_node until it is told to stop."""
    main_of(build)


if __name__ == '__main__':
    main()
