# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""record: everything that a replay needs, as it was heard, into a bag that survives a kill."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial

import rclpy.subscription
from diagnostic_msgs.msg import DiagnosticStatus
from std_msgs.msg import String

from tactile_ros.errors import RecordingError
from tactile_ros.evaluation.bag import BagWriter
from tactile_ros.msg import TactileContacts, TactileFrame, TactileLayout
from tactile_ros.nodes.lifecycle import LATCHED_DEPTHS, ManagedNode, diagnostic
from tactile_ros.nodes.parameters import RecordOptions

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


class RecordNode(ManagedNode):
    """Write the topics of one sensor as the middleware gave them, without looking inside."""

    needs_receive_times = True

    def __init__(self) -> None:
        super().__init__('record')
        self.declare(RecordOptions())
        self._writer: BagWriter | None = None
        self._taken = self._taken_before = 0

    def configure(self) -> None:
        """Open the bag."""
        path = self.options(RecordOptions).bag
        if not path:
            msg = 'bag must name a folder for the bag; received nothing'
            raise ValueError(msg)
        self._writer = BagWriter(path)

    def activate(self) -> None:
        """Subscribe to the serialised messages of every topic."""
        for topic, kind in TOPICS.items():
            type_name = f'{kind.__module__.split(".")[0]}/msg/{kind.__name__}'
            latched = topic in LATCHED_DEPTHS
            write = partial(self._write, self.resolve_topic_name(topic), type_name, latched)
            callback = write if GIVES_INFO else partial(write, info={})
            self.subscribe(kind, topic, callback, raw=True)
        self.steady_timer(FLUSH_PERIOD_S, partial(self._store, self._writer.flush))

    def _write(
        self, topic: str, type_name: str, latched: bool, data: bytes, info: Mapping[str, int]
    ) -> None:
        """Write one message, with the time at which the middleware received it."""
        simulated = self.get_parameter('use_sim_time').value
        received_ns = 0 if simulated else info.get('received_timestamp', 0)
        stamp_ns = received_ns if received_ns > 0 else self.now_ns()
        self._taken += 1
        self._store(self._writer.write, topic, type_name, stamp_ns, bytes(data), latched)

    def _store(self, store: Callable[..., None], *given: object) -> None:
        """Store something; a disk that is full is reported once and ends the node."""
        try:
            if not self.exit_code:
                store(*given)
        except RecordingError as err:
            self.get_logger().error(str(err))
            self.exit_code = 1
            self.finished.set()

    def lags(self) -> bool:
        """Messages came since this was asked last."""
        more, self._taken_before = self._taken != self._taken_before, self._taken
        return more

    def cleanup(self) -> None:
        """Close the bag with its index."""
        if self._writer is not None:
            self._store(self._writer.close)
            total = sum(self._writer.counts.values())
            self.get_logger().info(f'{total} messages are in {self._writer.path}')
            self._writer = None

    def diagnose(self) -> DiagnosticStatus:
        """Messages per topic."""
        return diagnostic('record', f'{self._taken} messages', dict(self._writer.counts))
