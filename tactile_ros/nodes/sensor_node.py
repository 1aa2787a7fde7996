"""sensor_node: read one tactile sensor and publish its frames."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import Point, Quaternion

from tactile_ros import messages
from tactile_ros.msg import TactileFrame, TactileLayout
from tactile_ros.nodes.lifecycle import ManagedNode, main_of, pairs
from tactile_ros.nodes.quality import data, latched
from tactile_ros.nodes.reader import Reader
from tactile_ros.sensors import load_sensor
from tactile_ros.types import TaxelStatus

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from tactile_ros.types import Device, Frame, Layout

FAULTS = {
    'saturated taxels': TaxelStatus.SATURATED,
    'stuck taxels': TaxelStatus.STUCK,
    'taxels in error': TaxelStatus.ERROR,
    'stale taxels': TaxelStatus.STALE,
}


@dataclass(frozen=True)
class SensorOptions:
    """Parameters of sensor_node besides those of the sensor's config and connection."""

    sensor: str = field(
        default='reskin_board', metadata={'help': 'key of the sensor', 'read_only': True}
    )
    autostart: bool = field(
        default=True, metadata={'help': 'configure and activate at start', 'read_only': True}
    )
    frame_id: str = field(
        default='tactile_sensor', metadata={'help': 'name of the sensor frame in tf'}
    )
    serial: str = field(default='', metadata={'help': 'which board; goes into layout'})
    listeners: int = field(
        default=0,
        metadata={
            'help': 'read nothing before so many subscriptions to frame are there',
            'range': (0, 100),
        },
    )


class SensorNode(ManagedNode):
    """Publish `frame`, `layout` (latched) and /diagnostics of one sensor.

    Parameters
    ----------
    downstream : callable or None
        Takes every frame and the name of its tf frame in the reader's thread, before it is
        published: the one-process road.
    waits_for : callable or None
        Further condition for the first frame.
    """

    def __init__(
        self,
        downstream: Callable[[Frame, str], None] | None = None,
        waits_for: Callable[[], bool] | None = None,
    ) -> None:
        super().__init__('sensor_node')
        self.declare(SensorOptions())
        self._spec = load_sensor(self.get_parameter('sensor').value)
        self.declare(self._spec.config(), self._spec.connection())
        self._frames = self.managed_publisher(TactileFrame, 'frame', data())
        self._layouts = self.managed_publisher(TactileLayout, 'layout', latched())
        self._downstream = downstream
        self._waits_for = waits_for
        self._reader: Reader | None = None
        self._previous = 0
        self._options = SensorOptions()
        self._layout: Layout | None = None

    def configure(self) -> None:
        """Check the parameters and open the device; a missing port is told and tried again."""
        self._options = self.options(SensorOptions)
        config = self.options(type(self._spec.config()))
        self._layout = replace(
            self._spec.layout(config), frame_id=self._options.frame_id, serial=self._options.serial
        )
        self._reader = self._make_reader()
        self._reader.open()

    def _make_reader(self) -> Reader:
        """Reader of a fresh device: its frames count from 0."""
        config = self.options(type(self._spec.config()))
        connection = self.options(type(self._spec.connection()))
        device: Device = self._spec.open(config, connection, self.now_ns)
        return Reader(device, self._deliver, self.get_logger().error, self._is_awaited)

    def activate(self) -> None:
        """Publish the layout and begin to read."""
        if self._reader is None:
            self._reader = self._make_reader()
            self._reader.open()
        message = TactileLayout()
        messages.fill_layout(message, self._layout, Point, Quaternion)
        message.header.stamp = self.get_clock().now().to_msg()
        self._layouts.publish(message)
        self._previous = 0
        self._reader.start()

    def deactivate(self) -> None:
        """End the reader; the port is free then."""
        if self._reader is not None:
            self._reader.close()
            self._reader = None

    def cleanup(self) -> None:
        """Free the port."""
        self.deactivate()

    def _is_awaited(self) -> bool:
        """Everybody who must see the first frame is there."""
        heard = self._frames.get_subscription_count() >= self._options.listeners
        return heard and (self._waits_for is None or self._waits_for())

    def _deliver(self, frame: Frame) -> None:
        """Hand a frame on and publish it, in the reader's thread."""
        if self._downstream is not None:
            self._downstream(frame, self._options.frame_id)
        if self._frames.get_subscription_count():
            message = TactileFrame()
            messages.fill_frame(message, frame, self._options.frame_id)
            self._frames.publish(message)

    def diagnose(self) -> DiagnosticStatus:
        """Connection, rate, losses and taxels."""
        if self._reader is None:
            return DiagnosticStatus(level=DiagnosticStatus.STALE, name='sensor')
        reading = self._reader.reading
        rate, self._previous = reading.frames - self._previous, reading.frames
        level, sentence = DiagnosticStatus.OK, f'{rate} frames in the last second'
        if reading.sentence or not rate:
            level, sentence = DiagnosticStatus.ERROR, reading.sentence or 'no frame'
        taxels = {name: reading.taxels(bit) for name, bit in FAULTS.items()}
        if level == DiagnosticStatus.OK and any(taxels.values()):
            level, sentence = DiagnosticStatus.WARN, f'{sentence}; taxels need attention'
        status = DiagnosticStatus(level=level, name='sensor', message=sentence)
        status.hardware_id = f'{self._spec.key} {self._options.serial}'.strip()
        last = reading.last
        known = {
            'rate (Hz)': rate,
            'frames': reading.frames,
            'dropped': 0 if last is None else last.dropped,
            'failures': reading.failures,
        }
        status.values = pairs({**known, **self._reader.counters(), **taxels})
        return status


def build() -> Sequence[ManagedNode]:
    """The node of this executable."""
    return [SensorNode()]


def main() -> None:
    """Run sensor_node until it is told to stop."""
    main_of(build)


if __name__ == '__main__':
    main()
