# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""True force and place from topics of another process' publishers."""

import time
from importlib.util import find_spec

import numpy as np
import pytest

pytestmark = [
    pytest.mark.ros,
    pytest.mark.skipif(find_spec('rclpy') is None, reason='without ROS 2'),
]


def test_topics_give_the_newest_force_and_place() -> None:
    import rclpy
    from geometry_msgs.msg import PoseStamped, WrenchStamped

    from tactile_ros.nodes.truth_node import FRESH_S, TruthTopics

    with TruthTopics('/ft', '/tip') as truth:
        assert np.isnan(truth.now()[0]).all()
        node = rclpy.create_node('bench')
        wrench, pose = WrenchStamped(), PoseStamped()
        wrench.wrench.force.z, pose.pose.position.x = 2.5, 0.004
        publishers = [
            (node.create_publisher(WrenchStamped, '/ft', 1), wrench),
            (node.create_publisher(PoseStamped, '/tip', 1), pose),
        ]
        end, told = time.monotonic() + 120.0, np.full((2, 3), np.nan)
        while np.isnan(told).any():
            assert time.monotonic() < end
            for publisher, message in publishers:
                publisher.publish(message)
            time.sleep(0.02)
            told = np.array(truth.now())
        node.destroy_node()
        np.testing.assert_array_equal(told, [[0, 0, 2.5], [0.004, 0, 0]])
        time.sleep(FRESH_S + 0.1)  # nobody publishes any more
        assert np.isnan(truth.now()).all()
    with TruthTopics('/ft', '') as alone:
        assert alone.now()[1] is None
