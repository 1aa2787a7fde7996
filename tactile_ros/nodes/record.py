"""record: what a replay needs, as it was heard, into a bag that survives a kill."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING

import rclpy.subscription
from diagnostic_msgs.msg import DiagnosticStatus
from std_msgs.msg import String

from tactile_ros.errors import RecordingError
from tactile_ros.evaluation.bag import BagWriter
from tactile_ros.msg import TactileContacts, TactileFrame, TactileLayout
from tactile_ros.nodes.lifecycle import (
    LATCHED_TOPICS,
    ManagedNode,
    baselines,
    data,
    main_of,
    pairs,
)
from tactile_ros.nodes.parameters import NodeOptions

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from rclpy.subscription import Subscription

TOPICS = {
    'layout': TactileLayout,
    'calibration': String,
    'baseline': TactileFrame,
    'frame': TactileFrame,
    'contacts': TactileContacts,
    'truth/contacts': TactileContacts,
}
FLUSH_PERIOD_S = 0.2
# Humble's rclpy gives a callback the message alone
GIVES_INFO = hasattr(rclpy.subscription, 'MessageInfo')


@dataclass(frozen=True)
class RecordOptions(NodeOptions):
    """Parameters of record."""

    bag: str = field(default='', metadata={'help': 'folder of the bag; it must not exist yet'})


class RecordNode(ManagedNode):
    """Write the topics of one sensor as the middleware gave them, without looking inside."""

    def __init__(self) -> None:
        super().__init__('record')
        self.declare(RecordOptions())
        self._writer: BagWriter | None = None
        self._heard: list[Subscription] = []
        self._taken = self._seen = 0

    def configure(self) -> None:
        """Open the bag."""
        path = self.options(RecordOptions).bag
        if not path:
            msg = 'bag must name a folder for the bag; received nothing'
            raise ValueError(msg)
        self._writer = BagWriter(path)

    def activate(self) -> None:
        """Subscribe to everything."""
        self._heard = [self._subscribe(topic, kind) for topic, kind in TOPICS.items()]
        self._flushing = self.steady_timer(FLUSH_PERIOD_S, self._writer.flush)

    def _subscribe(self, topic: str, kind: type) -> Subscription:
        """Subscription to serialised messages."""
        latched = topic in LATCHED_TOPICS
        name = self.resolve_topic_name(topic)
        type_name = f'{kind.__module__.split(".")[0]}/msg/{kind.__name__}'
        write = partial(self._write, name, type_name, latched)
        callback: Callable[..., None] = (
            (lambda data, info: write(data, info['received_timestamp']))
            if GIVES_INFO
            else (lambda data: write(data, 0))
        )
        return self.create_subscription(
            kind, topic, callback, baselines() if latched else data(), raw=True
        )

    def _write(
        self, topic: str, type_name: str, latched: bool, data: bytes, received_ns: int
    ) -> None:
        """One message, with the time at which the middleware received it."""
        simulated = self.get_parameter('use_sim_time').value
        stamp_ns = self.now_ns() if simulated or received_ns <= 0 else received_ns
        self._taken += 1
        try:
            self._writer.write(topic, type_name, stamp_ns, bytes(data), latched)
        except RecordingError as err:
            self.get_logger().error(str(err))
            self.exit_code = 1
            self.finished.set()

    def lags(self) -> bool:
        """Messages came since this was asked last."""
        more, self._seen = self._taken != self._seen, self._taken
        return more

    def deactivate(self) -> None:
        """Listen no more and close the bag with its index."""
        self.destroy_timer(self._flushing)
        for subscription in self._heard:
            self.destroy_subscription(subscription)
        self._heard = []

    def cleanup(self) -> None:
        """Close the bag."""
        if self._writer is not None:
            self._writer.close()
            total = sum(self._writer.counts.values())
            self.get_logger().info(f'{total} messages are in {self._writer.path}')
            self._writer = None

    def diagnose(self) -> DiagnosticStatus:
        """Messages per topic."""
        status = DiagnosticStatus(name='record', message=f'{self._taken} messages')
        status.values = pairs(dict(self._writer.counts))
        return status


def build() -> Sequence[ManagedNode]:
    """The node of this executable."""
    return [RecordNode()]


def main() -> None:
    """Record until told to stop."""
    main_of(build)


if __name__ == '__main__':
    main()
