# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""A launch test of the launch files: what they start says something, and ends when asked.

launch_test test/launch/launched.py
"""

import time
import unittest
from pathlib import Path

import launch_testing
import rclpy
from launch.actions import IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch_testing.actions import ReadyToTest
from launch_testing.asserts import EXIT_OK, assertExitCodes
from launch_testing.proc_info_handler import ProcInfoHandler
from rclpy.qos import qos_profile_sensor_data

from launch import LaunchDescription
from tactile_ros.msg import GripState, TactileContacts, TactileFrame

FILES = Path(__file__).parents[2] / 'launch'
PATIENCE_S = 120.0
ENOUGH = 5  # messages of each kind
INTERRUPTED = (EXIT_OK, -2, -15)
SENSED = {'frame': TactileFrame, 'contacts': TactileContacts}
CASES: list[tuple[str, dict[str, str], dict[str, type]]] = [
    ('sensor.launch.py', {'source': 'simulated', 'sensor': 'gradiometer'}, SENSED),
    ('sensor.launch.py', {'source': 'simulated', 'sensor': 'taxel_array', 'stack': 'true',
                          'namespace': 'palm'}, {f'palm/{k}': v for k, v in SENSED.items()}),
    ('sensor.launch.py', {'source': 'recorded', 'speed_up': '4.0'}, SENSED),
    ('grasp.launch.py', {'hand': 'qb_softhand', 'fingers': 'thumb,index', 'mock_hand': 'true',
                         'source': 'simulated'},
     {'thumb/frame': TactileFrame, 'index/contacts': TactileContacts,
      'grip_node/state': GripState}),
]  # fmt: skip


@launch_testing.parametrize('name, arguments, topics', CASES)
def generate_test_description(
    name: str, arguments: dict[str, str], topics: dict[str, type]
) -> tuple[LaunchDescription, dict[str, object]]:
    """One launch file with arguments; the tests get its topics."""
    source = PythonLaunchDescriptionSource(str(FILES / name))
    included = IncludeLaunchDescription(source, launch_arguments=arguments.items())
    return LaunchDescription([included, ReadyToTest()]), {}


class WhileItRuns(unittest.TestCase):
    """Messages of every topic come."""

    def test_messages_come(self, topics: dict[str, type]) -> None:
        rclpy.init()
        node = rclpy.create_node('listener')
        heard = dict.fromkeys(topics, 0)

        def listen(topic: str) -> None:
            def count(_: object) -> None:
                heard[topic] += 1

            node.create_subscription(topics[topic], topic, count, qos_profile_sensor_data)

        for topic in topics:
            listen(topic)
        until = time.monotonic() + PATIENCE_S
        try:
            while min(heard.values()) < ENOUGH and time.monotonic() < until:
                rclpy.spin_once(node, timeout_sec=0.5)
        finally:
            node.destroy_node()
            rclpy.shutdown()
        assert min(heard.values()) >= ENOUGH, heard


@launch_testing.post_shutdown_test()
class WhenItHasEnded(unittest.TestCase):
    """Every process has ended, by itself or as it was asked to."""

    def test_exit_codes(self, proc_info: ProcInfoHandler) -> None:
        assertExitCodes(proc_info, INTERRUPTED)
