# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""True force and place of a guided calibration, from a WrenchStamped and a PoseStamped."""

from __future__ import annotations

import threading
import time
from contextlib import suppress

import numpy as np
import rclpy
from geometry_msgs.msg import PoseStamped, WrenchStamped
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import try_shutdown

from tactile_ros.evaluation.guided import UNKNOWN, Truth
from tactile_ros.messages import vector
from tactile_ros.types import Array

FRESH_S = 0.5  # that a message counts


class TruthTopics(Truth):
    """Newest force (3,) (N) and place (3,) (m) of the topics named; NaN once half a second old."""

    steady = False

    def __init__(self, wrench: str, pose: str) -> None:
        self.columns = ('force',) * bool(wrench) + ('position',) * bool(pose)
        self._newest = {'force': (0.0, UNKNOWN), 'position': (0.0, UNKNOWN)}  # arrival (s)
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
        self._node = Node('tactile_truth')
        for topic, kind in ((wrench, WrenchStamped), (pose, PoseStamped)):
            if topic:
                self._node.create_subscription(kind, topic, self._take, qos_profile_sensor_data)
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self._node)
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._spin, daemon=True)
        self._thread.start()

    def now(self) -> tuple[Array, Array | None]:
        """Newest of both; None without the topic of the place."""
        oldest_s = time.monotonic() - FRESH_S
        force, place = (x if came_s > oldest_s else UNKNOWN for came_s, x in self._newest.values())
        return force, place if 'position' in self.columns else None

    def _spin(self) -> None:
        with suppress(ExternalShutdownException):
            while not self._ended.is_set():  # a shutdown by another thread may be missed
                self._executor.spin_once(timeout_sec=0.1)

    def _take(self, message: WrenchStamped | PoseStamped) -> None:
        if isinstance(message, WrenchStamped):
            self._newest['force'] = time.monotonic(), np.array(vector(message.wrench.force))
        else:
            self._newest['position'] = time.monotonic(), np.array(vector(message.pose.position))

    def close(self) -> None:
        """End the node."""
        self._ended.set()
        self._thread.join()
        self._executor.shutdown()
        self._node.destroy_node()
        try_shutdown()
