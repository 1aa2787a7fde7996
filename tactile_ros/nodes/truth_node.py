# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""True force and place of a guided calibration, from a WrenchStamped and a PoseStamped."""

from __future__ import annotations

import threading

import numpy as np
import rclpy
from geometry_msgs.msg import PoseStamped, WrenchStamped
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import try_shutdown

from tactile_ros.messages import vector
from tactile_ros.types import Array, Closing


class TruthTopics(Closing):
    """Newest force (3,) (N) and place (3,) (m) of two topics, each listened to where it is named.

    `position` is None without a topic; what has not come yet is NaN.
    """

    def __init__(self, wrench: str, pose: str) -> None:
        self.force: Array = np.full(3, np.nan)
        self.position: Array | None = np.full(3, np.nan) if pose else None
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
        self._node = Node('tactile_truth')
        for topic, kind, take in (
            (wrench, WrenchStamped, self._take_force), (pose, PoseStamped, self._take_place),
        ):  # fmt: skip
            if topic:
                self._node.create_subscription(kind, topic, take, qos_profile_sensor_data)
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self._node)
        self._thread = threading.Thread(target=self._spin, daemon=True)
        self._thread.start()

    def _spin(self) -> None:
        try:
            self._executor.spin()
        except ExternalShutdownException:
            return

    def _take_force(self, message: WrenchStamped) -> None:
        self.force = np.array(vector(message.wrench.force))

    def _take_place(self, message: PoseStamped) -> None:
        self.position = np.array(vector(message.pose.position))

    def close(self) -> None:
        """End the node."""
        self._executor.shutdown()
        self._thread.join()
        self._node.destroy_node()
        try_shutdown()
